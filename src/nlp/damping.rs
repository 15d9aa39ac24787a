//! δ, the weight of the proximal term: the Hessian of a sub-problem is H + δ D, D being the problem's own metric.
//!
//! It is raised until that is positive definite where the active constraints vanish (the factorisation's inertia tells), and falls after
//! each full step that did not raise it, so that the last steps are Newton's and converge quadratically.

use super::options::DampingOptions;

#[derive(Clone, Copy, Debug)]
pub struct Damping {
    options: DampingOptions,
    pub delta: f64,
}

impl Damping {
    pub fn new(options: DampingOptions) -> Self {
        Self { options, delta: options.first }
    }

    /// At a new point.
    pub fn begin(&mut self) {
        self.delta = self.delta.min(self.options.exact);
    }

    /// After a step with `used`, taken in full at the first attempt or not.
    pub fn after_step(&mut self, used: f64, is_whole_first: bool) {
        let was_raised = used > self.delta;
        self.delta =
            if is_whole_first && !was_raised { (self.options.lower * used).max(self.options.floor) } else { used };
    }

    /// After a sub-problem that could not be solved with `used`.
    pub fn after_failure(&mut self, used: f64) {
        self.delta = self.options.retreat * used.max(self.options.least_failed);
    }

    /// After a step with `used` that was refused.
    pub fn after_refusal(&mut self, used: f64) {
        self.delta = (self.options.retreat * used).max(self.options.least_refused);
    }

    /// After the restoration.
    pub fn reset(&mut self) {
        self.delta = self.options.first;
    }
}

impl DampingOptions {
    /// The next larger δ, if there is one.
    pub fn raised(&self, delta: f64) -> Option<f64> {
        let next = (self.raise * delta).max(self.smallest);
        (next <= self.largest).then_some(next)
    }
}
