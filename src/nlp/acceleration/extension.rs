//! The extension of steps kept short. Against negative curvature, or where the Lagrangian is flat, δ or the convex
//! Hessian makes a step short, and it creeps: the extension goes on along it, doubling, for as long as the objective
//! falls, with two steps back to the constraints each time.

use crate::nlp::iterate::Iterate;
use crate::nlp::options::SqpOptions;
use crate::nlp::state::State;
use crate::nlp::subproblem::Step;

/// Whether a full step from a point with the error `before` has left much of it, and was kept short. A small δ shortens
/// no step: what creeps then runs off to infinity and is not helped on its way.
pub fn is_worth(state: &State<'_>, step: &Step, before: f64, options: &SqpOptions) -> bool {
    let numbers = &options.extension;
    let creeps = state.error.largest() > numbers.creeping * before;
    creeps && (step.way.is_convexified() || before < numbers.below && step.damping > numbers.shortening)
}

/// Moves on along the step that led to `state`; gives back how many times as long it has become, 0 if not at all.
pub fn extend(state: &mut State<'_>, step: &Step, options: &SqpOptions) -> f64 {
    if !step.has_factors && state.factorise(step.damping, &step.active).is_none() {
        return 0.0;
    }
    let error = options.extension.violation * state.error.largest();
    let allowed = state.here.violation().max(options.termination.tolerance).max(error);
    let mut further = 1.0;
    let mut best: Option<Iterate> = None;
    for _ in 0..options.extension.doublings {
        let mut there = state.at(&step.direction, further);
        state.reduce_violation(&mut there, &step.active);
        state.reduce_violation(&mut there, &step.active);
        let lowest = best.as_ref().unwrap_or(&state.here).objective;
        if !(there.is_finite() && there.objective < lowest && there.violation() <= allowed) {
            break;
        }
        best = Some(there);
        further *= 2.0;
    }
    let Some(mut best) = best else { return 0.0 };
    best.differentiate(state.problem);
    state.move_to(best);
    0.5 * further
}
