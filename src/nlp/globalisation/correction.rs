//! Second-order correction: more Newton steps on the constraints at their new values, the active ones kept, until the
//! filter accepts or the violation no longer falls by its share. Without it the curvature of the constraints makes good
//! steps look bad (the Maratos effect).

use super::filter::Verdict;
use crate::nlp::iterate::Iterate;
use crate::nlp::options::SqpOptions;
use crate::nlp::state::State;
use crate::nlp::subproblem::Step;

pub fn correct(
    state: &mut State<'_>,
    step: &mut Step,
    trial: &Iterate,
    options: &SqpOptions,
    judge: impl Fn(&Iterate) -> Verdict,
) -> Option<(Iterate, Verdict)> {
    if options.correction.most == 0 {
        return None;
    }
    if !step.has_factors {
        state.factorise(step.damping, &step.active)?;
    }
    step.has_factors = true;
    let mut trial = trial.clone();
    let mut last = trial.violation();
    for _ in 0..options.correction.most {
        state.reduce_violation(&mut trial, &step.active);
        let verdict = judge(&trial);
        if verdict != Verdict::Rejected {
            return Some((trial, verdict));
        }
        if trial.violation() > options.correction.share * last {
            return None;
        }
        last = trial.violation();
    }
    None
}
