//! What is tried where no step is accepted, one rung after another.

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
    /// Raise δ.
    RaiseDamping,
    /// Restore feasibility: where an interior point was rough, a larger δ does not help either.
    Restore,
}

impl Recovery {
    /// After a step that was refused.
    pub fn next(&mut self, step: &Step) -> Next {
        if step.quality == Quality::Rough {
            self.to_the_end = true;
            Next::ToTheEnd
        } else if self.to_the_end {
            Next::Restore
        } else {
            Next::RaiseDamping
        }
    }
}
