//! The leap along directions that are almost flat.
//!
//! The force–velocity curve is flat at high speed, so a muscle that is worth more when it alternates has its optimum at
//! infinite fibre velocity, with f ~ k/v. Newton's step multiplies v by 1.5; the leap tries up to 64 times the step,
//! corrected by up to three more steps on the optimality conditions with the same factorisation, and is kept if it
//! lowers the KKT error at no loss but what is left of the violation costs. A leap of length 1 is a plain step with
//! those corrections: the iteration is then of higher than second order.

use crate::nlp::iterate::Iterate;
use crate::nlp::options::{LeapOptions, SqpOptions};
use crate::nlp::state::State;
use crate::nlp::subproblem::Step;

/// Whether a step is one to leap along.
pub fn is_worth(state: &State<'_>, step: &Step, fraction: f64, options: &SqpOptions) -> bool {
    let error = state.error.largest();
    let LeapOptions { longest, most_damping, below, .. } = options.leap;
    longest >= 1.0
        && fraction == 1.0
        && step.is_settled
        && step.damping <= most_damping
        && error < below
        && error > options.termination.target
}

/// Tries far more than a settled step. Leaves `trial`, the end of the step, with multipliers and derivatives, moved or
/// not; gives back the length of the leap.
pub fn leap(state: &mut State<'_>, step: &Step, trial: &mut Iterate, options: &SqpOptions) -> f64 {
    let LeapOptions { longest, longer, much, better, fast, .. } = options.leap;
    let target = options.termination.target;
    trial.equality_multipliers.copy_from_slice(&step.equality_multipliers);
    trial.inequality_multipliers.copy_from_slice(&step.inequality_multipliers);
    trial.differentiate(state.problem);
    let reached = trial.kkt_error().largest();
    if reached <= target {
        return 0.0;
    }
    // What is left of the violation may cost the objective as much as the multipliers say.
    let cost: f64 = trial.equalities.iter().zip(&trial.equality_multipliers).map(|(c, l)| (c * l).abs()).sum();
    let highest = trial.objective + cost + 1e-13 * trial.objective.abs();
    let allowed = trial.violation().max(options.termination.tolerance);
    // With f ~ k/v the error falls as 1/v² and Newton's step is v/2: no further out than it takes.
    let error = state.error.largest();
    let reach = 2.0 * (error / target).sqrt();
    let longest = if reached < fast * error { 1.0 } else { reach.min(longest) };
    let (mut lowest, mut best) = (f64::INFINITY, None);
    let mut next = Some(1.0);
    while let Some(far) = next {
        next = (far < longest).then(|| longest.min(longer * far));
        let (there, error) = corrected(state, step, trial, far, options);
        if error > much * lowest {
            break;
        }
        lowest = error;
        if error < better * reached && there.objective <= highest && there.violation() <= allowed {
            best = Some((there, far));
            if error <= target {
                break;
            }
        }
    }
    let Some((there, far)) = best else { return 0.0 };
    *trial = there;
    far
}

/// The point so `far` along the step, corrected; and its error.
fn corrected(state: &mut State<'_>, step: &Step, trial: &Iterate, far: f64, options: &SqpOptions) -> (Iterate, f64) {
    let mut there = if far > 1.0 {
        let mut there = trial.moved(state.problem, &step.direction, far - 1.0);
        there.differentiate(state.problem);
        there
    } else {
        trial.clone()
    };
    let mut slope = there.lagrangian_gradient();
    let mut error = there.kkt_error_with(&slope).largest();
    for _ in 0..options.leap.corrections {
        simplified_step(state, &mut there, &slope, &step.active);
        slope = there.lagrangian_gradient();
        let before = std::mem::replace(&mut error, there.kkt_error_with(&slope).largest());
        if error > options.leap.much * before || error <= options.termination.target {
            break;
        }
    }
    (there, error)
}

/// One Newton step on the optimality conditions of `point`, ∇L being `slope` there, with the factorisation at hand.
fn simplified_step(state: &mut State<'_>, point: &mut Iterate, slope: &[f64], active: &[bool]) {
    let (n, me) = (point.x.len(), point.equalities.len());
    let mut right: Vec<f64> = slope.iter().map(|g| -g).collect();
    right.extend(point.equalities.iter().map(|c| -c));
    right.extend(point.inequalities.iter().map(|d| -d));
    let mut solution = vec![0.0; state.kkt.order()];
    state.kkt.solve_roughly(&right, &mut solution);
    point.x.iter_mut().zip(&solution).for_each(|(x, d)| *x += d);
    point.equality_multipliers.iter_mut().zip(&solution[n..]).for_each(|(l, d)| *l += d);
    let inequalities = point.inequality_multipliers.iter_mut().zip(&solution[n + me..]).zip(active);
    inequalities.for_each(|((nu, d), active)| *nu = if *active { (*nu - d).max(0.0) } else { 0.0 });
    point.evaluate(state.problem);
    point.differentiate(state.problem);
}
