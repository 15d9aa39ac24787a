//! The feasibility phase: lowers `ψ = ½‖c‖² + ½‖min(d, 0)‖²` by regularised Newton steps.
//!
//! ```text
//! min ½‖c + A s‖² + ½ sᵀ C s + ½ δ sᵀ D s + ½‖v‖²   s.t.  d + B s ≥ 0 where d ≥ 0,  d + B s + v ≥ 0 elsewhere
//! ```
//!
//! C is what is positive of Σ c ∇²c: near a stationary point that is not feasible steps are Newton's.

use super::iterate::Iterate;
use super::options::SqpOptions;
use super::problem::{Curvature, Multipliers};
use super::state::State;
use super::subproblem::qp::{QpFailure, QuadraticProgramme};
use super::termination::SqpStatus;
use super::trace::Record;
use crate::numerics::sparse::Sparse;

/// A small multiple of the identity beside the Hessian: the metric may be singular.
const REGULARISATION: f64 = 1e-8;
/// Range of δ.
const RANGE: (f64, f64) = (1e-10, 1e8);

/// Moves `state` to where ψ has fallen by its share, or as near as it gets; gives back whether it has.
///
/// # Errors
/// `Infeasible` at a stationary point of ψ, `QpFailed`, `TimeLimit`.
pub fn restore(state: &mut State<'_>, options: &SqpOptions, record: &mut Record) -> Result<bool, SqpStatus> {
    let numbers = &options.restoration;
    let goal = numbers.goal * numbers.goal * infeasibility(&state.here);
    let mut damping = numbers.damping;
    for _ in 0..numbers.max_steps {
        let before = infeasibility(&state.here);
        if options.termination.deadline.passed() {
            return Err(SqpStatus::TimeLimit);
        }
        if before <= goal {
            break;
        }
        let step = step(state, damping, options).map_err(|_| SqpStatus::QpFailed)?;
        record.qp_iterations += step.qp_iterations;
        let is_far = before > options.termination.tolerance;
        if is_far && damping <= numbers.damping && step.descent <= numbers.stationary * before {
            return Err(SqpStatus::Infeasible);
        }
        let mut trial = state.at(&step.direction, 1.0);
        if trial.is_finite() && infeasibility(&trial) < before {
            trial.differentiate(state.problem);
            state.here = trial;
            state.models.begin(&state.here.x);
            damping = (numbers.lower * damping).max(RANGE.0);
        } else {
            damping *= numbers.raise;
            if damping > RANGE.1 {
                break;
            }
        }
    }
    Ok(infeasibility(&state.here) <= goal)
}

/// ψ
fn infeasibility(here: &Iterate) -> f64 {
    let of_rows = here.equalities.iter().copied().chain(here.inequalities.iter().map(|d| d.min(0.0)));
    0.5 * of_rows.map(|row| row * row).sum::<f64>()
}

/// The step s, and by how much the model of ψ falls.
struct Restoring {
    direction: Vec<f64>,
    descent: f64,
    qp_iterations: usize,
}

/// Solves for the step, by Clarabel, with one more unknown for each violated inequality.
fn step(state: &State<'_>, damping: f64, options: &SqpOptions) -> Result<Restoring, QpFailure> {
    let here = &state.here;
    let n = here.x.len();
    let violated: Vec<usize> = (0..here.inequalities.len()).filter(|&row| here.inequalities[row] < 0.0).collect();
    let all = n + violated.len();
    let mut gradient = vec![0.0; n];
    here.equality_jacobian.add_transpose_product(1.0, &here.equalities, &mut gradient);
    gradient.resize(all, 0.0);
    let (gram, curvature, metric) = (here.equality_jacobian.gram(), curvature(state), &state.models.metric);
    let mut hessian: Vec<(usize, usize, f64)> = Vec::new();
    for (matrix, factor) in [(&gram, 1.0), (&curvature, 1.0), (metric, damping)] {
        hessian.extend(matrix.entries().map(|(i, j, slot)| (i, j, factor * matrix.values[slot])));
    }
    hessian.extend((0..all).map(|i| (i, i, if i < n { REGULARISATION } else { 1.0 })));
    let hessian = Sparse::from_triplets(all, all, &hessian);
    let bounds = &here.inequality_jacobian;
    let mut rows: Vec<(usize, usize, f64)> = bounds.entries().map(|(i, j, slot)| (i, j, bounds.values[slot])).collect();
    rows.extend(violated.iter().enumerate().map(|(k, &row)| (row, n + k, 1.0)));
    let solution = QuadraticProgramme {
        hessian: &hessian,
        gradient: &gradient,
        equalities: &Sparse::from_triplets(0, all, &[]),
        equality_values: &[],
        inequalities: &Sparse::from_triplets(bounds.rows, all, &rows),
        inequality_values: &here.inequalities,
        deadline: options.termination.deadline,
    }
    .solve()?;
    let mut product = gradient.clone();
    hessian.add_symmetric_product(0.5, &solution.step, &mut product);
    let model: f64 = product.iter().zip(&solution.step).map(|(g, s)| g * s).sum();
    let start: f64 = violated.iter().map(|&row| 0.5 * here.inequalities[row].powi(2)).sum();
    let mut direction = solution.step;
    direction.truncate(n);
    Ok(Restoring { direction, descent: start - model, qp_iterations: solution.iterations })
}

/// The positive part of Σ c ∇²c.
fn curvature(state: &State<'_>) -> Sparse {
    let here = &state.here;
    let none = vec![0.0; here.inequalities.len()];
    let hessian = |equalities: &[f64], curvature: Curvature| {
        let mut out = state.models.metric.clone();
        let multipliers = Multipliers { equalities, inequalities: &none };
        state.problem.hessian(&here.x, multipliers, curvature, &mut out);
        out
    };
    let mut both = hessian(&here.equalities, Curvature::Convex);
    let of_objective = hessian(&vec![0.0; here.equalities.len()], Curvature::Exact);
    both.values.iter_mut().zip(&of_objective.values).for_each(|(h, f)| *h -= f);
    both
}
