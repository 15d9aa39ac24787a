//! Numerical building blocks that know no biomechanics: spline spaces, sparse matrices with a fixed
//! pattern, ranks.

pub mod banded;
pub mod bspline;
pub mod cubic;
mod memo;
pub mod rank;
pub mod sparse;
pub mod spectrum;
pub mod staged;

/// The larger, and NaN if either is.
pub fn larger(a: f64, b: f64) -> f64 {
    if a.is_nan() || a > b { a } else { b }
}

/// A real number or a dual number over it: functions generic in this give exact directional derivatives.
pub trait Scalar: num_dual::DualNum<Primitive = f64> + Copy {}

impl<T: num_dual::DualNum<Primitive = f64> + Copy> Scalar for T {}
