//! From a control problem to a programme for the solver.
//!
//! A scheme (`midpoint`, `radau`) is a space of functions, by kind of quantity, and says where equations hold;
//! `coefficients` has the place of each unknown, `places` that of each derivative, `objective` the rows of the goals;
//! `collocation` puts all together. Another scheme is
//! another file beside these two.

pub mod coefficients;
pub mod collocation;
pub mod midpoint;
pub mod objective;
pub mod places;
pub mod radau;
pub mod scheme;
