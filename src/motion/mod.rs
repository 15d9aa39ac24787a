//! The measured motion: from a table of joint coordinates over time to measured values of the unknowns.

pub mod columns;
pub mod external_loads;
pub mod joint_motion;
mod low_pass;
pub mod sampling;
pub mod surroundings;
pub mod table;
pub mod text;

pub use low_pass::{HIGHEST_CUTOFF, low_pass, smooth_spline};
pub use sampling::{Measurement, MeasurementError, MotionSettings};
pub use surroundings::Surroundings;
pub use table::MotionTable;
