//! The feasibility phase: lowers `ψ = ½‖c‖² + ½‖min(d, 0)‖²` by regularised Newton steps on ½‖c‖² that keep the linearised inequalities.
//! Its Hessian is AᵀA, and of Σ c ∇²c what is positive: near a stationary point that is not feasible steps are Newton's.

use super::iterate::Iterate;
use super::options::SqpOptions;
use super::problem::{Curvature, Multipliers};
use super::state::State;
use super::subproblem::clarabel::{QpFailure, QpSolution, QuadraticProgramme};
use super::termination::SqpStatus;
use super::trace::Record;
use crate::numerics::sparse::Sparse;

/// A small multiple of the identity beside the Gauss–Newton matrix: the metric may be singular.
const REGULARISATION: f64 = 1e-8;
/// Range of the weight of the proximal term.
const RANGE: (f64, f64) = (1e-10, 1e8);

/// Moves `state` to where ψ has fallen by its share, or as near as it gets; gives back whether it has.
///
/// # Errors
/// `Infeasible` at a stationary point of ½‖c‖² or where the linearised inequalities contradict each other, `QpFailed`, `TimeLimit`.
pub fn restore(state: &mut State<'_>, options: &SqpOptions, record: &mut Record) -> Result<bool, SqpStatus> {
    let numbers = &options.restoration;
    let goal = numbers.goal * numbers.goal * infeasibility(&state.here);
    let mut damping = numbers.damping;
    for _ in 0..numbers.max_steps {
        if options.termination.deadline.passed() {
            return Err(SqpStatus::TimeLimit);
        }
        if infeasibility(&state.here) <= goal {
            break;
        }
        let gradient = gradient(&state.here);
        let slope = gradient.iter().fold(0.0f64, |a, g| a.max(g.abs()));
        let size = state.here.equalities.iter().fold(0.0f64, |a, c| a.max(c.abs()));
        if slope <= numbers.stationary * size && size > 10.0 * options.termination.tolerance {
            return Err(SqpStatus::Infeasible);
        }
        let step = step(state, &gradient, damping, options).map_err(|failure| match failure {
            QpFailure::Infeasible => SqpStatus::Infeasible,
            QpFailure::Numerical => SqpStatus::QpFailed,
        })?;
        record.qp_iterations += step.iterations;
        let mut trial = state.at(&step.step, 1.0);
        if trial.is_finite() && infeasibility(&trial) < infeasibility(&state.here) {
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

/// ∇½‖c‖²
fn gradient(here: &Iterate) -> Vec<f64> {
    let mut gradient = vec![0.0; here.x.len()];
    here.equality_jacobian.add_transpose_product(1.0, &here.equalities, &mut gradient);
    gradient
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

/// The step, by Clarabel.
fn step(
    state: &State<'_>,
    gradient: &[f64],
    damping: f64,
    options: &SqpOptions,
) -> Result<QpSolution, QpFailure> {
    let n = gradient.len();
    let gram = state.here.equality_jacobian.gram();
    let metric = &state.models.metric;
    let mut entries: Vec<(usize, usize, f64)> = gram.entries().map(|(i, j, slot)| (i, j, gram.values[slot])).collect();
    let curvature = curvature(state);
    entries.extend(curvature.entries().map(|(i, j, slot)| (i, j, curvature.values[slot])));
    entries.extend(metric.entries().map(|(i, j, slot)| (i, j, damping * metric.values[slot])));
    entries.extend((0..n).map(|i| (i, i, REGULARISATION)));
    let none = Sparse::from_triplets(0, n, &[]);
    let programme = QuadraticProgramme {
        hessian: &Sparse::from_triplets(n, n, &entries),
        gradient,
        equalities: &none,
        equality_values: &[],
        inequalities: &state.here.inequality_jacobian,
        inequality_values: &state.here.inequalities,
        deadline: options.termination.deadline,
    };
    programme.solve()
}
