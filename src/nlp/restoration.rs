//! The feasibility phase: lowers ½‖c‖² by Levenberg–Marquardt steps that keep the linearised inequalities.

use super::iterate::Iterate;
use super::options::SqpOptions;
use super::state::State;
use super::subproblem::clarabel::{QpSolution, QuadraticProgramme};
use super::termination::SqpStatus;
use super::trace::Record;
use crate::numerics::sparse::Sparse;

/// A small multiple of the identity beside the Gauss–Newton matrix: the metric may be singular.
const REGULARISATION: f64 = 1e-8;
/// Range of the Levenberg–Marquardt parameter.
const RANGE: (f64, f64) = (1e-10, 1e8);

/// Moves `state` to where the violation has fallen by its share, or as near as it gets; gives back whether it has.
///
/// # Errors
/// `Infeasible` at a stationary point of ½‖c‖², `QpFailed`, `TimeLimit`.
pub fn restore(state: &mut State<'_>, options: &SqpOptions, record: &mut Record) -> Result<bool, SqpStatus> {
    let numbers = &options.restoration;
    let goal = numbers.goal * state.here.violation();
    let mut damping = numbers.damping;
    for _ in 0..numbers.max_steps {
        if options.termination.deadline.passed() {
            return Err(SqpStatus::TimeLimit);
        }
        if state.here.violation() <= goal {
            break;
        }
        let gradient = gradient(&state.here);
        let slope = gradient.iter().fold(0.0f64, |a, g| a.max(g.abs()));
        let size = state.here.equalities.iter().fold(0.0f64, |a, c| a.max(c.abs()));
        if slope <= numbers.stationary * size && size > 10.0 * options.termination.tolerance {
            return Err(SqpStatus::Infeasible);
        }
        let step = step(state, &gradient, damping, options).ok_or(SqpStatus::QpFailed)?;
        record.qp_iterations += step.iterations;
        let mut trial = state.at(&step.step, 1.0);
        if trial.is_finite() && trial.violation() < state.here.violation() {
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
    Ok(state.here.violation() <= goal)
}

/// ∇½‖c‖²
fn gradient(here: &Iterate) -> Vec<f64> {
    let mut gradient = vec![0.0; here.x.len()];
    here.equality_jacobian.add_transpose_product(1.0, &here.equalities, &mut gradient);
    gradient
}

/// The Levenberg–Marquardt step, by Clarabel.
fn step(state: &State<'_>, gradient: &[f64], damping: f64, options: &SqpOptions) -> Option<QpSolution> {
    let n = gradient.len();
    let gram = state.here.equality_jacobian.gram();
    let metric = &state.models.metric;
    let mut entries: Vec<(usize, usize, f64)> = gram.entries().map(|(i, j, slot)| (i, j, gram.values[slot])).collect();
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
    programme.solve().ok()
}
