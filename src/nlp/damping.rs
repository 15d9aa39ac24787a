//! δ, the weight of the proximal term: the Hessian of a sub-problem is H + δ D, D being the problem's own metric.
//!
//! It is raised until that is positive definite where the active constraints vanish (the factorisation's inertia
//! tells), and falls after each full step that did not raise it, and to a share of the error where there is no negative
//! curvature, so that the last steps are Newton's and converge quadratically.

use super::options::DampingOptions;
use super::state::Progress;

#[derive(Clone, Copy, Debug)]
pub struct Damping {
    options: DampingOptions,
    pub delta: f64,
    /// Whether the last sub-problem had to raise it against negative curvature.
    is_curved: bool,
}

impl Damping {
    pub fn new(options: DampingOptions) -> Self {
        Self { options, delta: options.first, is_curved: false }
    }

    /// At a new point with this error.
    pub fn begin(&mut self, error: f64, progress: &Progress) {
        if !self.is_curved {
            self.delta = self.delta.min(self.options.near_solution(error)).max(self.options.least(progress));
        }
    }

    /// After a step with `used`, taken in full at the first attempt or not, by which a solve gets on or not.
    pub fn after_step(&mut self, used: f64, is_whole_first: bool, gets_on: bool, progress: &Progress) {
        self.is_curved = used > self.delta;
        self.delta = if is_whole_first && !self.is_curved && gets_on {
            (self.options.lower * used).max(self.options.least(progress))
        } else {
            used
        };
    }

    /// After a sub-problem that could not be solved with `used`.
    pub fn after_failure(&mut self, used: f64) {
        self.delta = self.options.retreat * used.max(self.options.least_failed);
    }

    /// After a step with `used` that was refused.
    pub fn after_refusal(&mut self, used: f64) {
        self.delta = (self.options.retreat * used).max(self.options.least_refused);
    }
}

impl DampingOptions {
    /// The largest δ to begin with at a point with this error.
    pub fn near_solution(&self, error: f64) -> f64 {
        (self.per_error * error).min(self.exact)
    }

    fn least(&self, progress: &Progress) -> f64 {
        if progress.is_impatient() { self.smallest } else { self.floor }
    }

    /// The largest δ with the exact Hessian.
    pub fn most_exact(&self, progress: &Progress) -> f64 {
        if progress.is_impatient() { self.stubborn } else { self.exact }
    }

    /// The next larger δ, if there is one.
    pub fn raised(&self, delta: f64) -> Option<f64> {
        let next = (self.raise * delta).max(self.smallest);
        (next <= self.largest).then_some(next)
    }
}
