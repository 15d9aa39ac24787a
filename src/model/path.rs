//! Muscle paths. In the plane: straight lines from the origin over via points to the insertion; in space see [`SpatialPath`].

use num_dual::Dual64;

use super::spatial::fitted::FittedPath;
use super::spatial::path::SpatialPath;
pub use super::straight::{PathLength, StraightPath};
use crate::numerics::Scalar;

/// The path of a musculotendon.
#[derive(Clone, Debug)]
pub enum Path {
    /// In the plane, over points.
    Straight(StraightPath),
    /// In space, over points and around surfaces.
    Spatial(SpatialPath),
    /// Fitted by a polynomial of joint coordinates.
    Fitted(Box<FittedPath>),
}

impl Path {
    /// The unknowns of the motion that the length depends on, increasing.
    pub fn slots(&self) -> &[usize] {
        match self {
            Path::Straight(path) => &path.slots,
            Path::Spatial(path) => &path.slots,
            Path::Fitted(path) => &path.slots,
        }
    }

    pub fn buffer<T: Scalar>(&self) -> PathLength<T> {
        let (zero, n) = (T::from(0.0), self.slots().len());
        PathLength { value: zero, gradient: vec![zero; n], hessian: vec![zero; n * n] }
    }

    /// Writes the length at all coordinates `q`, the given ones included, with first and, if asked, second derivatives.
    pub fn length(&self, q: &[f64], second: bool, out: &mut PathLength<f64>) {
        match self {
            Path::Straight(path) => path.length(q, second, out),
            Path::Spatial(path) => {
                path.length(q, second, out);
            }
            Path::Fitted(path) => path.length(q, out),
        }
    }

    /// [`Path::length`], with the directional derivatives along `direction` in the dual parts.
    pub fn length_along(&self, q: &[f64], direction: &[f64]) -> PathLength<Dual64> {
        match self {
            Path::Straight(path) => {
                let q: Vec<Dual64> = q.iter().zip(direction).map(|(&x, &d)| Dual64::new(x, d)).collect();
                let mut out = self.buffer();
                path.length(&q, true, &mut out);
                out
            }
            Path::Spatial(path) => path.length_along(q, direction),
            Path::Fitted(path) => path.length_along(q, direction),
        }
    }

    /// Where its points are, if it has any, axis by axis, in the ground's frame.
    pub fn positions(&self, q: &[f64]) -> Vec<Vec<f64>> {
        match self {
            Path::Straight(path) => path.points.iter().map(|place| place.at(q).position.to_vec()).collect(),
            Path::Spatial(path) => path.positions(q).into_iter().map(|x| x.to_vec()).collect(),
            Path::Fitted(path) => path.drawn.positions(q).into_iter().map(|x| x.to_vec()).collect(),
        }
    }
}
