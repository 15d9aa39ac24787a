//! Going further than the step where Newton's method creeps.

pub mod extension;
pub mod leap;
