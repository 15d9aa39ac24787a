//! The effort of eq. (26), which shares the load among muscles (thesis, Paper B): `μ²/2 ‖a‖²` over the instants of the
//! load-sharing grid; and the use of reserves beside it, `μ²/2 · reserve_weight Σ r²`.

use super::{Goal, Sample, Shape};
use crate::problem::quantity::QuantityId;

/// The effort of `muscles` muscles; `times` in s.
pub fn effort(activations: QuantityId, muscles: usize, times: &[f64], mu: f64) -> Goal {
    Goal { name: "effort", shape: Shape::Square, samples: samples(activations, &vec![mu; muscles], times) }
}

/// The use of reserves; `weights`: by reserve, including μ and the root of the reserve's weight.
pub fn reserve_use(reserves: QuantityId, weights: &[f64], times: &[f64]) -> Goal {
    Goal { name: "reserve_use", shape: Shape::Square, samples: samples(reserves, weights, times) }
}

fn samples(quantity: QuantityId, weights: &[f64], times: &[f64]) -> Vec<Sample> {
    let all = weights.iter().enumerate().filter(|(_, weight)| **weight != 0.0);
    let sample = |time: f64, (member, &weight): (usize, &f64)| Sample { time, quantity, member, weight, target: 0.0 };
    all.flat_map(|at| times.iter().map(move |&time| sample(time, at))).collect()
}
