//! A number with its first and second derivatives over N slots: the chain and product rules, nothing else.

use std::ops::{Add, Mul, Sub};

use crate::numerics::Scalar;

#[derive(Clone, Copy, Debug)]
pub struct Jet<T, const N: usize> {
    pub value: T,
    pub gradient: [T; N],
    pub hessian: [[T; N]; N],
}

pub fn dot<T: Scalar, const N: usize>(a: &[Jet<T, N>; 3], b: &[Jet<T, N>; 3]) -> Jet<T, N> {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

impl<T: Scalar, const N: usize> Jet<T, N> {
    pub fn constant(value: T) -> Self {
        let zero = T::from(0.0);
        Self { value, gradient: [zero; N], hessian: [[zero; N]; N] }
    }

    pub fn scaled(mut self, factor: f64) -> Self {
        self.value *= factor;
        self.gradient.iter_mut().for_each(|g| *g *= factor);
        self.hessian.as_flattened_mut().iter_mut().for_each(|h| *h *= factor);
        self
    }

    /// f(x) of jets x, from the value, the gradient and the Hessian of f.
    pub fn compose<const M: usize>(value: T, gradient: &[T; M], hessian: &[[T; M]; M], x: &[Self; M]) -> Self {
        let mut out = Self::constant(T::from(0.0));
        out.add_function(value, gradient, hessian, &std::array::from_fn(|i| x[i].gradient));
        for i in 0..M {
            for a in 0..N {
                for b in 0..N {
                    out.hessian[a][b] += gradient[i] * x[i].hessian[a][b];
                }
            }
        }
        out
    }

    /// Adds f(x), from the value, the gradient and the Hessian of f and the slopes of x: all but the part of second derivatives of x.
    pub fn add_function<const M: usize>(
        &mut self,
        value: T,
        gradient: &[T; M],
        hessian: &[[T; M]; M],
        slopes: &[[T; N]; M],
    ) {
        self.value += value;
        for i in 0..M {
            // Row i of H J, then its outer product with row i of J.
            let mut row = [T::from(0.0); N];
            for j in 0..M {
                for b in 0..N {
                    row[b] += hessian[i][j] * slopes[j][b];
                }
            }
            for a in 0..N {
                self.gradient[a] += gradient[i] * slopes[i][a];
                for b in 0..N {
                    self.hessian[a][b] += slopes[i][a] * row[b];
                }
            }
        }
    }

    /// Adds x yᵀ + y xᵀ to the Hessian.
    pub fn add_product(&mut self, x: &[T; N], y: &[T; N]) {
        for a in 0..N {
            for b in 0..N {
                self.hessian[a][b] += x[a] * y[b] + y[a] * x[b];
            }
        }
    }
}

impl<T: Scalar, const N: usize> Add for Jet<T, N> {
    type Output = Self;

    fn add(mut self, other: Self) -> Self {
        self.value += other.value;
        for a in 0..N {
            self.gradient[a] += other.gradient[a];
            for b in 0..N {
                self.hessian[a][b] += other.hessian[a][b];
            }
        }
        self
    }
}

impl<T: Scalar, const N: usize> Sub for Jet<T, N> {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        self + other.scaled(-1.0)
    }
}

impl<T: Scalar, const N: usize> Mul for Jet<T, N> {
    type Output = Self;

    fn mul(self, other: Self) -> Self {
        let mut out = Self::constant(self.value * other.value);
        for a in 0..N {
            out.gradient[a] = self.value * other.gradient[a] + self.gradient[a] * other.value;
            for b in 0..N {
                out.hessian[a][b] = self.value * other.hessian[a][b]
                    + self.hessian[a][b] * other.value
                    + self.gradient[a] * other.gradient[b]
                    + self.gradient[b] * other.gradient[a];
            }
        }
        out
    }
}
