//! From model, motion and settings to a problem of the solver.
//!
//! `instant` has the equations at one time; `midpoint` says how their variables depend on spline coefficients;
//! `collocation` assembles both into a sparse problem; `prediction` counts the rank deficiencies that active
//! bounds explain. Another scheme is another file beside `midpoint`.

pub mod collocation;
pub mod instant;
pub mod midpoint;
pub mod prediction;
