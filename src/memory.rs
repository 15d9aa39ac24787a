//! How much memory a job will take, foreseen from its size: what is too large is refused before the memory is taken.
//!
//! The constants are fitted to peaks of the whole program: 11 problems of 5 to 1001 intervals, 5 to 500 muscles, 1 and 3 stages.

use crate::study::settings::{RegularityMode, Settings};
use crate::transcription::instant::Instant;

/// What the program takes without a problem, bytes.
const PROGRAM: f64 = 20e6;
/// Functions, patterns and derivatives at a collocation point, bytes by local unknown and equation.
const AT_POINT: f64 = 1100.0;
/// A residual row, bytes: while they are put together, and afterwards.
const ROW_IN_MAKING: f64 = 600.0;
const ROW: f64 = 150.0;
/// Factorisations kept at a time, room to grow in them included.
const FACTORS: f64 = 3.0;
/// Further ones where ranks are taken.
const RANKS: f64 = 1.0;
/// Points of the iteration that are kept.
const ITERATIONS: usize = 100;

/// The size of a problem.
#[derive(Clone, Copy, Debug)]
pub struct Size {
    /// Bytes of what is there once for each collocation point.
    points: f64,
    /// Residual rows.
    rows: f64,
}

impl Size {
    /// Of the problem on `points` points p.
    pub fn of(instant: &Instant<'_>, settings: &Settings, points: usize) -> Self {
        let intervals = points as f64 - 1.0;
        let local = (instant.variables() + instant.equations()) as f64;
        let columns = (instant.model.coordinates() + instant.model.muscles.len()) as f64;
        Self {
            points: AT_POINT * local * (settings.points_per_interval() as f64 * intervals + 1.0),
            rows: columns * (settings.measured_per_interval() as f64 * intervals + 1.0),
        }
    }

    /// # Errors
    /// Why the problem is not put together.
    pub fn check_transcribing(self, settings: &Settings) -> Result<(), String> {
        check(PROGRAM + self.points + ROW_IN_MAKING * self.rows, settings)
    }

    /// # Errors
    /// Why a problem of so many variables with factors of so many bytes is not solved.
    pub fn check_solving(self, factors: usize, variables: usize, settings: &Settings) -> Result<(), String> {
        let kept = FACTORS + if settings.regularity == RegularityMode::Off { 0.0 } else { RANKS };
        let trace = 8.0 * (variables * settings.max_iterations.min(ITERATIONS)) as f64;
        check(PROGRAM + self.points + ROW * self.rows + kept * factors as f64 + trace, settings)
    }
}

fn check(bytes: f64, settings: &Settings) -> Result<(), String> {
    let (needed, limit) = (bytes / 1e6, settings.memory_limit_mb);
    if needed <= limit {
        return Ok(());
    }
    Err(format!(
        "the problem takes about {needed:.0} MB, more than memory_limit_mb = {limit}; a larger h, fewer stages or a smaller \
         measurement_ratio make it smaller, or raise the limit"
    ))
}
