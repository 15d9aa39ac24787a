//! A reserve or another actuator at a joint coordinate, and its part of eq. (1). Not in the thesis; source: J. L. Hicks et
//! al., *J. Biomech. Eng.* 137, 2015 (reserve actuators), and OpenSim's CoordinateActuator.
//!
//! ```text
//! … − (T/W) r ∂θ/∂q = 0        (1)
//! ```
//!
//! | symbol | meaning | unit |
//! |---|---|---|
//! | r | control | – |
//! | T | moment or force at r = 1 | N m, N |
//! | θ | the joint coordinate, a function of q | rad, m |
//! | W | total weight, the unit of eq. (1) | N |

use super::along;
use crate::model::DrivenCoordinate;
use crate::problem::block::{Block, Order, Sink};
use crate::problem::quantity::Span;

pub struct Reserve<'m> {
    pub coordinate: DrivenCoordinate<'m>,
    /// T/W
    pub strength: f64,
    pub coordinates: Span,
    pub control: usize,
    /// Rows of eq. (1).
    pub motion: Span,
    /// Weight of a step in the control, relative to one in q.
    pub step_weight: f64,
}

impl Block for Reserve<'_> {
    fn evaluate(&self, z: &[f64], out: &mut Sink<'_>) {
        let q = self.coordinates.of(z);
        let pull = -self.strength * z[self.control];
        if out.wants(Order::Bends) {
            let lambda: Vec<f64> = self.motion.range().map(|row| out.multiplier(row)).collect();
            let angle = self.coordinate.slopes(&along(q, &lambda));
            // A linear θ bends nothing.
            for (i, row) in angle.hessian.chunks_exact(angle.slots.len()).enumerate() {
                let one = self.coordinates.at(angle.slots[i]);
                out.bend(one, self.control, -self.strength * angle.gradient[i].eps);
                for (&other, bend) in angle.slots.iter().zip(row).skip(i) {
                    out.bend(one, self.coordinates.at(other), pull * bend.eps);
                }
            }
            return;
        }
        let angle = self.coordinate.slopes(q);
        for (i, &one) in angle.slots.iter().enumerate() {
            out.value(self.motion.at(one), pull * angle.gradient[i]);
            out.slope(self.motion.at(one), self.control, -self.strength * angle.gradient[i]);
        }
        for (&one, row) in angle.slots.iter().zip(angle.hessian.chunks_exact(angle.slots.len())) {
            for (&other, bend) in angle.slots.iter().zip(row) {
                out.slope(self.motion.at(one), self.coordinates.at(other), pull * bend);
            }
        }
    }

    fn weigh(&self, _z: &[f64], weights: &mut [f64]) {
        weights[self.control] = 0.1 * self.step_weight;
    }
}
