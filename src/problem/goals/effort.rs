//! The effort of eq. (26), which shares the load among muscles (thesis, Paper B): `μ²/2 ‖a‖²` over the instants of the
//! load-sharing grid; with another power p, `μ²/2 ∫ Σ a^p dt`. And the use of controls beside it, in place of the sum over
//! muscles: `reserve_weight Σ r²` of reserves, `excitation_weight Σ u²` of excitations.

use super::{Goal, Sample, Shape};
use crate::problem::quantity::QuantityId;

/// The effort of `muscles` muscles; `instants`: times (s) and weights. `power`: p.
pub fn effort(activations: QuantityId, muscles: usize, instants: &[(f64, f64)], mu: f64, power: f64) -> Goal {
    if power == 2.0 {
        let samples = samples(activations, &vec![mu; muscles], instants, f64::sqrt);
        return Goal { name: "effort", shape: Shape::Square, samples };
    }
    let samples = samples(activations, &vec![0.5 * mu * mu; muscles], instants, |weight| weight);
    Goal { name: "effort", shape: Shape::Power(power), samples }
}

/// The use of controls; `weights`: by member, the root of its weight times μ.
pub fn control_use(name: &'static str, controls: QuantityId, weights: &[f64], instants: &[(f64, f64)]) -> Goal {
    Goal { name, shape: Shape::Square, samples: samples(controls, weights, instants, f64::sqrt) }
}

fn samples(
    quantity: QuantityId,
    weights: &[f64],
    instants: &[(f64, f64)],
    of_weight: impl Fn(f64) -> f64 + Copy,
) -> Vec<Sample> {
    let all = weights.iter().enumerate();
    let sample = |(time, instant): (f64, f64), (member, weight): (usize, &f64)| Sample {
        time,
        quantity,
        members: vec![(member, 1.0)],
        weight: weight * of_weight(instant),
        target: 0.0,
    };
    all.flat_map(|at| instants.iter().map(move |&instant| sample(instant, at))).collect()
}
