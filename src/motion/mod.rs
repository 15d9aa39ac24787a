//! The measured motion: a table of joint coordinates over time, and what is made of it.

pub mod sampling;
pub mod table;

pub use sampling::{Measurement, MotionSettings};
pub use table::MotionTable;
