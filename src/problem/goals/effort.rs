//! The effort of eq. (26), which shares the load among muscles (thesis, Paper B): `μ²/2 ‖a‖²` over the instants of the
//! load-sharing grid; with another power p, `μ²/2 ∫ Σ a^p dt`. And the use of controls beside it, in place of the sum over
//! muscles: `reserve_weight Σ r²` of reserves, `excitation_weight Σ u²` of excitations.

use super::{Goal, Sample, Shape};
use crate::problem::quantity::QuantityId;

/// The effort of muscles; `weights`: by muscle; `instants`: times (s) and weights. `power`: p.
pub fn effort(activations: QuantityId, weights: &[f64], instants: &[(f64, f64)], mu: f64, power: f64) -> Goal {
    let of = |factor: fn(f64, f64) -> f64| weights.iter().map(|&weight| factor(mu, weight)).collect::<Vec<f64>>();
    if power == 2.0 {
        let samples = samples(activations, &of(|mu, weight| mu * weight.sqrt()), instants, f64::sqrt);
        return Goal { name: "effort", shape: Shape::Square, samples };
    }
    let samples = samples(activations, &of(|mu, weight| 0.5 * mu * mu * weight), instants, |weight| weight);
    Goal { name: "effort", shape: Shape::Power(power), samples }
}

/// The effort `e = o + s y` of a function y at a time (s), with its weight (of the muscle, times s).
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    pub time: f64,
    pub member: usize,
    pub weight: f64,
    /// o, s
    pub line: [f64; 2],
}

/// `∫ Σ w e^p dt`, a sum over instants of a quadrature.
pub fn integral(quantity: QuantityId, power: f64, efforts: impl Iterator<Item = Effort>) -> Goal {
    let shape = if power == 2.0 { Shape::Square } else { Shape::Power(power) };
    let sample = |Effort { time, member, weight, line: [offset, scale] }| Sample {
        time,
        quantity,
        members: vec![(member, scale)],
        // ½ (v e)² of a square.
        weight: if power == 2.0 { f64::sqrt(2.0 * weight) } else { weight },
        target: -offset,
    };
    Goal { name: "effort", shape, samples: efforts.map(sample).collect() }
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
