//! The parts of the objective, by name.
//!
//! Each is a sum over instants, of a convex function φ of functions of time y, or of a sum of them:
//!
//! ```text
//! Σ_k w_k φ(Σ_i c_i y_i(t_k) − ŷ_k)
//! ```
//!
//! Where φ(e) = e²/2 it is a part of the least-squares objective: rows of J and b.

pub mod effort;
pub mod tracking;

pub use effort::{Effort, control_use, effort, integral};
pub use tracking::tracking;

use super::quantity::QuantityId;

/// A part of the objective.
#[derive(Clone, Debug)]
pub struct Goal {
    pub name: &'static str,
    pub shape: Shape,
    pub samples: Vec<Sample>,
}

/// The function φ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// ½ (w e)², with the weight inside.
    Square,
    /// w |e|^p, p > 2
    Power(f64),
}

impl Shape {
    /// φ, φ′ and φ″ at e, without the weight.
    pub fn at(self, e: f64) -> [f64; 3] {
        match self {
            Shape::Square => [0.5 * e * e, e, 1.0],
            Shape::Power(p) => {
                let size = e.abs();
                [size.powf(p), p * size.powf(p - 1.0) * e.signum(), p * (p - 1.0) * size.powf(p - 2.0)]
            }
        }
    }
}

/// One term of the sum.
#[derive(Clone, Debug)]
pub struct Sample {
    /// s
    pub time: f64,
    pub quantity: QuantityId,
    /// (i, c_i)
    pub members: Vec<(usize, f64)>,
    pub weight: f64,
    /// ŷ
    pub target: f64,
}
