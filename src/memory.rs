//! Predicts the memory use of a job from its size, so that jobs that are too large are rejected before they allocate
//! it.
//!
//! The constants are fitted to the peak memory use of the whole program in 11 problems with 5 to 1001 intervals, 5 to
//! 500 muscles, and 1 or 3 stages.

use crate::methods::InverseProblem;
use crate::settings::{RegularityMode, Settings};

/// Memory of the program without a problem, bytes.
const BASE: f64 = 20e6;
/// Functions, patterns and derivatives at a collocation point, bytes per local unknown and equation.
const PER_UNKNOWN_AT_POINT: f64 = 1100.0;
/// A residual row during transcription, bytes.
const PER_ROW_TRANSCRIBING: f64 = 600.0;
/// A residual row after transcription, bytes.
const PER_ROW_SOLVING: f64 = 150.0;
/// Number of factorisations held at the same time, including spare capacity.
const FACTORISATIONS: f64 = 3.0;
/// Number of additional factorisations if ranks are computed.
const FACTORISATIONS_FOR_RANKS: f64 = 1.0;
/// Largest number of SQP iterates assumed to be kept.
const MAX_ITERATES: usize = 100;

/// The size of a problem.
#[derive(Clone, Copy, Debug)]
pub struct ProblemSize {
    /// Memory of the data at the collocation points, bytes.
    points: f64,
    /// Number of residual rows.
    rows: f64,
}

impl ProblemSize {
    /// The size of the problem with `points` points (p).
    pub fn of(inverse: &InverseProblem<'_>, settings: &Settings, points: usize) -> Self {
        let intervals = points as f64 - 1.0;
        let local = (inverse.control.variables() + inverse.control.rows()) as f64;
        let columns = (inverse.motion.q.count + inverse.muscles.a.count) as f64;
        Self {
            points: PER_UNKNOWN_AT_POINT * local * (settings.points_per_interval() as f64 * intervals + 1.0),
            rows: columns * (settings.measured_per_interval() as f64 * intervals + 1.0),
        }
    }

    /// Checks that transcribing the problem stays within the memory limit.
    ///
    /// # Errors
    /// A message with the memory needed, the limit and a remedy.
    pub fn check_transcribing(self, settings: &Settings) -> Result<(), String> {
        check(BASE + self.points + PER_ROW_TRANSCRIBING * self.rows, settings)
    }

    /// Checks that solving the problem stays within the memory limit. `factors`: bytes of a factorisation; `variables`:
    /// length of the decision vector.
    ///
    /// # Errors
    /// A message with the memory needed, the limit and a remedy.
    pub fn check_solving(self, factors: usize, variables: usize, settings: &Settings) -> Result<(), String> {
        let kept =
            FACTORISATIONS + if settings.regularity == RegularityMode::Off { 0.0 } else { FACTORISATIONS_FOR_RANKS };
        let trace = 8.0 * (variables * settings.max_iterations.min(MAX_ITERATES)) as f64;
        check(BASE + self.points + PER_ROW_SOLVING * self.rows + kept * factors as f64 + trace, settings)
    }
}

fn check(bytes: f64, settings: &Settings) -> Result<(), String> {
    let (needed, limit) = (bytes / 1e6, settings.memory_limit_mb);
    if needed <= limit {
        return Ok(());
    }
    Err(format!(
        "the problem needs about {needed:.0} MB, more than memory_limit_mb = {limit}; use a larger h, fewer stages or \
         a smaller measurement_ratio, or raise the limit"
    ))
}
