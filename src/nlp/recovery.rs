//! What is tried where no step is accepted, one rung after another.

use super::globalisation::filter::Filter;
use super::options::SqpOptions;
use super::state::State;
use super::subproblem::{Quality, Step};

/// The rung on which a point is.
#[derive(Default)]
pub struct Recovery {
    /// Whether a rough step has been refused.
    pub to_the_end: bool,
}

/// What comes next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    /// Solve the sub-problem to its end: what is rough says nothing of δ.
    ToTheEnd,
    /// Begin the filter anew: with a solution at hand what was met before may be all that is in the way.
    NewFilter,
    /// Raise δ.
    RaiseDamping,
    /// Restore feasibility: where an interior point was rough, a larger δ does not help either.
    Restore,
}

impl Recovery {
    /// After a step that was refused.
    pub fn next(&mut self, state: &State<'_>, step: &Step, filter: &Filter, options: &SqpOptions) -> Next {
        if step.quality == Quality::Rough {
            self.to_the_end = true;
            Next::ToTheEnd
        } else if state.error.largest() < options.line_search.at_hand && !filter.is_empty() {
            Next::NewFilter
        } else if self.to_the_end {
            Next::Restore
        } else {
            Next::RaiseDamping
        }
    }
}
