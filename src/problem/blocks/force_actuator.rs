//! A muscle that makes any force from 0 to its maximum at any time, and its part of eq. (1) (thesis, eqs 1.3, 1.7, 1.8):
//!
//! ```text
//! … + (F_o/W) a ∂L_mt/∂q = 0        (1)
//! ```
//!
//! Symbols as in `contraction`; a is the force over F_o.

use crate::model::Musculotendon;
use crate::problem::block::{Block, Order, Sink};
use crate::problem::quantity::Span;

pub struct ForceActuator<'m> {
    pub muscle: &'m Musculotendon,
    /// F_o/W
    pub strength: f64,
    /// All coordinates, those of given motion last.
    pub coordinates: Span,
    pub activation: usize,
    /// Rows of eq. (1).
    pub motion: Span,
    /// Weight of a step in activation, relative to one in q.
    pub step_weight: f64,
}

impl Block for ForceActuator<'_> {
    fn evaluate(&self, z: &[f64], out: &mut Sink<'_>) {
        let (path, slots) = (&self.muscle.path, self.muscle.path.slots());
        let (q, n) = (self.coordinates.of(z), slots.len());
        let pull = self.strength * z[self.activation];
        if out.wants(Order::Bends) {
            let mut direction: Vec<f64> = self.motion.range().map(|row| out.multiplier(row)).collect();
            direction.resize(self.coordinates.count, 0.0);
            let length = if out.is_recording() { path.buffer() } else { path.length_along(q, &direction) };
            for (i, &one) in slots.iter().enumerate() {
                for (j, &other) in slots.iter().enumerate().skip(i) {
                    let bend = pull * length.hessian[i * n + j].eps;
                    out.bend(self.coordinates.at(one), self.coordinates.at(other), bend);
                }
                out.bend(self.coordinates.at(one), self.activation, self.strength * length.gradient[i].eps);
            }
            return;
        }
        let mut length = path.buffer();
        if !out.is_recording() {
            path.length(q, out.wants(Order::Slopes), &mut length);
        }
        for (i, &one) in slots.iter().enumerate() {
            out.value(self.motion.at(one), pull * length.gradient[i]);
            out.slope(self.motion.at(one), self.activation, self.strength * length.gradient[i]);
            for j in 0..if out.wants(Order::Slopes) { n } else { 0 } {
                out.slope(self.motion.at(one), self.coordinates.at(slots[j]), pull * length.hessian[i * n + j]);
            }
        }
    }

    fn weigh(&self, _z: &[f64], weights: &mut [f64]) {
        weights[self.activation] = self.step_weight;
    }
}
