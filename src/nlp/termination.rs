//! When a solve is over, and how it ended.

use super::options::Termination;
use super::state::State;

/// How a solve ended. Only the first is success.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SqpStatus {
    /// All KKT residuals are below the tolerance.
    Converged,
    /// The iterations ran out.
    IterationLimit,
    /// The deadline passed.
    TimeLimit,
    /// The quadratic sub-problem could not be solved in any form.
    QpFailed,
    /// No step is accepted any more.
    Stalled,
    /// A stationary point of the constraint violation that is not feasible.
    Infeasible,
    /// A function or derivative is not finite.
    NonFinite,
}

impl SqpStatus {
    /// Whether another way through the same problem may end better.
    pub fn is_stuck(self) -> bool {
        matches!(self, Self::IterationLimit | Self::Stalled | Self::QpFailed)
    }
}

impl Termination {
    /// The status of a solve that is over after so many `iterations`.
    pub fn judge(&self, state: &State<'_>, iterations: usize) -> Option<SqpStatus> {
        let enough = if state.progress.idle >= self.patience { self.tolerance } else { self.target };
        let error = state.error.largest();
        if !state.here.is_finite() || error.is_nan() {
            Some(SqpStatus::NonFinite)
        } else if error <= enough && state.problem.feasibility(&state.here.x) <= enough {
            Some(SqpStatus::Converged)
        } else if iterations >= self.max_iterations {
            Some(SqpStatus::IterationLimit)
        } else if self.deadline.passed() {
            Some(SqpStatus::TimeLimit)
        } else {
            None
        }
    }
}
