//! Numerical building blocks, independent of biomechanics: splines, sparse matrices with a fixed pattern, LDLᵀ
//! factorisation, ranks and singular values.

pub mod banded;
pub mod bspline;
pub mod cubic;
mod memo;
pub mod rank;
pub mod root;
pub mod sparse;
pub mod spectrum;
pub mod staged;

/// The larger of two numbers; NaN if either is NaN.
pub fn larger(a: f64, b: f64) -> f64 {
    if a.is_nan() || a > b { a } else { b }
}

/// A real or dual number. Functions generic over it give exact directional derivatives.
pub trait Scalar: num_dual::DualNum<Primitive = f64> + Copy {}

impl<T: num_dual::DualNum<Primitive = f64> + Copy> Scalar for T {}
