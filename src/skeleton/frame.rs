//! Vectors and rigid transforms x ↦ R x + p.

use std::ops::Mul;

use crate::numerics::Scalar;

pub type Vector = [f64; 3];

pub fn dot(a: &Vector, b: &Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub fn minus(a: &Vector, b: &Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// a + factor b
pub fn along(a: &Vector, factor: f64, b: &Vector) -> Vector {
    [a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]]
}

pub fn cross(a: &Vector, b: &Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub fn norm(a: &Vector) -> f64 {
    dot(a, a).sqrt()
}

/// a / |a|; zero stays zero.
pub fn unit(a: &Vector) -> Vector {
    let length = norm(a);
    if length > 0.0 { a.map(|x| x / length) } else { *a }
}

/// A frame within an outer frame: its rotation matrix R and its origin p (m).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame<T> {
    /// `axes[i][j]` = R_ij
    pub axes: [[T; 3]; 3],
    pub origin: [T; 3],
}

impl<T: Scalar> Frame<T> {
    pub fn identity() -> Self {
        let entry = |i, j| T::from(f64::from(i == j));
        let axes = [0, 1, 2].map(|i| [0, 1, 2].map(|j| entry(i, j)));
        Self { axes, origin: [T::zero(); 3] }
    }

    /// Rotation by `angle` (rad) about an axis through the origin, by Rodrigues' formula. The axis need not be a unit
    /// vector, but must not be 0.
    pub fn rotation(axis: Vector, angle: T) -> Self {
        let [x, y, z] = unit(&axis);
        let (s, c) = angle.sin_cos();
        let v = -c + 1.0;
        let axes = [
            [v * (x * x) + c, v * (x * y) - s * z, v * (x * z) + s * y],
            [v * (x * y) + s * z, v * (y * y) + c, v * (y * z) - s * x],
            [v * (x * z) - s * y, v * (y * z) + s * x, v * (z * z) + c],
        ];
        Self { axes, origin: [T::zero(); 3] }
    }

    /// The outer frame within this one.
    pub fn inverse(&self) -> Self {
        let axes = [0, 1, 2].map(|i| [0, 1, 2].map(|j| self.axes[j][i]));
        let back = Self { axes, origin: [T::zero(); 3] };
        Self { origin: back.point(&self.origin).map(|x| -x), ..back }
    }

    /// Maps a point from this frame to the outer frame.
    pub fn point(&self, x: &[T; 3]) -> [T; 3] {
        [0, 1, 2].map(|i| self.axes[i][0] * x[0] + self.axes[i][1] * x[1] + self.axes[i][2] * x[2] + self.origin[i])
    }
}

impl Frame<f64> {
    /// A frame at a point, turned by body-fixed rotations about x, y and z (rad).
    pub fn placed(point: Vector, xyz: Vector) -> Self {
        let turn = |i: usize| {
            let mut axis = [0.0; 3];
            axis[i] = 1.0;
            Self::rotation(axis, xyz[i])
        };
        Self { origin: point, ..turn(0) * turn(1) * turn(2) }
    }

    /// The same frame in another scalar type.
    pub fn lift<T: Scalar>(&self) -> Frame<T> {
        Frame { axes: self.axes.map(|row| row.map(T::from)), origin: self.origin.map(T::from) }
    }
}

impl<T: Scalar> Mul for Frame<T> {
    type Output = Self;

    fn mul(self, inner: Self) -> Self {
        let entry = |i: usize, j: usize| {
            self.axes[i][0] * inner.axes[0][j] + self.axes[i][1] * inner.axes[1][j] + self.axes[i][2] * inner.axes[2][j]
        };
        let axes = [0, 1, 2].map(|i| [0, 1, 2].map(|j| entry(i, j)));
        Self { axes, origin: self.point(&inner.origin) }
    }
}
