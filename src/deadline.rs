//! The time limit of a job, checked before each lengthy operation: a factorisation, a quadratic programme, a rank.

use std::time::{Duration, Instant};

/// A point in time, or none.
#[derive(Clone, Copy, Debug, Default)]
pub struct Deadline(Option<Instant>);

impl Deadline {
    /// `limit_s` seconds after `start`; no deadline if `None`.
    pub fn after(start: Instant, limit_s: Option<f64>) -> Self {
        Self(limit_s.map(|limit| start + Duration::from_secs_f64(limit)))
    }

    pub fn passed(self) -> bool {
        self.0.is_some_and(|deadline| Instant::now() >= deadline)
    }

    /// Seconds left; infinite without a deadline.
    pub fn left_s(self) -> f64 {
        self.0.map_or(f64::INFINITY, |deadline| deadline.saturating_duration_since(Instant::now()).as_secs_f64())
    }
}
