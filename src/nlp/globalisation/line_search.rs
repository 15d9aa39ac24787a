//! Backtracking along the step, α = 1, ½, …, until the filter accepts; at α = 1 a second-order correction first.

use super::correction;
use super::filter::{Filter, Verdict};
use crate::nlp::iterate::Iterate;
use crate::nlp::options::SqpOptions;
use crate::nlp::state::State;
use crate::nlp::subproblem::Step;

/// A trial point that was accepted.
pub struct Accepted {
    pub trial: Iterate,
    /// α
    pub fraction: f64,
    pub verdict: Verdict,
}

pub fn search(state: &mut State<'_>, filter: &Filter, step: &mut Step, options: &SqpOptions) -> Option<Accepted> {
    let slope: f64 = state.here.gradient.iter().zip(&step.direction).map(|(g, d)| g * d).sum();
    let (before, error) = (state.pair(), state.error.largest());
    let judge = |trial: &Iterate, fraction: f64| {
        filter.judge(before, error, slope, fraction, (trial.violation(), trial.objective))
    };
    let mut fraction = 1.0;
    while fraction > options.line_search.smallest_fraction {
        let mut trial = state.at(&step.direction, fraction);
        let mut verdict = judge(&trial, fraction);
        if fraction == 1.0 && verdict == Verdict::Rejected && trial.is_finite() {
            if lowers_the_error(state, &trial, step, options) {
                verdict = Verdict::Progress;
            } else if let Some(corrected) = correction::correct(state, step, &trial, options, |trial| judge(trial, 1.0))
            {
                (trial, verdict) = corrected;
            }
        }
        if verdict != Verdict::Rejected {
            return Some(Accepted { trial, fraction, verdict });
        }
        fraction *= options.line_search.shorten;
    }
    None
}

/// With a solution at hand a full step that lowers the error is taken.
fn lowers_the_error(state: &State<'_>, trial: &Iterate, step: &Step, options: &SqpOptions) -> bool {
    let error = state.error.largest();
    if error >= options.line_search.at_hand {
        return false;
    }
    let mut full = trial.clone();
    full.equality_multipliers.copy_from_slice(&step.equality_multipliers);
    full.inequality_multipliers.copy_from_slice(&step.inequality_multipliers);
    full.differentiate(state.problem);
    full.kkt_error().largest() < options.line_search.share * error
}
