pub mod collocation;
pub mod instant;
pub mod midpoint;
