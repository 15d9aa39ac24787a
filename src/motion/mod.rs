//! The measured motion: from a table of joint coordinates over time to measured body coordinates.

pub mod columns;
pub mod external_loads;
pub mod joint_motion;
pub mod sampling;
pub mod surroundings;
pub mod table;
pub mod text;

pub use sampling::{HIGHEST_CUTOFF, Measurement, MeasurementError, MotionSettings, low_pass, smooth_spline};
pub use surroundings::Surroundings;
pub use table::MotionTable;
