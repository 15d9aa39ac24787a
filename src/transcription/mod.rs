//! From model, motion and settings to a problem of the solver.
//!
//! `instant` has the equations at one time; a scheme (`midpoint`, `radau`) says how their variables depend on coefficients;
//! `collocation` assembles both into a sparse problem; `prediction` counts the rank deficiencies that active
//! bounds explain. Another scheme is another file beside these two.

pub mod collocation;
pub mod instant;
pub mod midpoint;
pub mod prediction;
pub mod radau;
pub mod scheme;
