//! Eq. (16), the motion's distance from the measured one (thesis, Paper B): `½‖J_q x − q_exp‖²`, over all body coordinates at
//! all measured instants.

use super::{Goal, Sample, Shape};
use crate::problem::quantity::QuantityId;

/// `times` in s; `measured`: a row for each instant; `weights`: by coordinate.
pub fn tracking(coordinates: QuantityId, times: &[f64], measured: &[Vec<f64>], weights: &[f64]) -> Goal {
    let sample = |time: f64, (member, target): (usize, f64)| Sample {
        time,
        quantity: coordinates,
        member,
        weight: weights[member],
        target,
    };
    let instants = times.iter().zip(measured);
    let samples = instants.flat_map(|(&t, q)| q.iter().copied().enumerate().map(move |at| sample(t, at))).collect();
    Goal { name: "tracking", shape: Shape::Square, samples }
}
