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
use crate::model::Joint;
use crate::problem::block::{Block, Order, Sink};
use crate::problem::quantity::Span;

pub struct Reserve<'m> {
    /// The joint that θ belongs to.
    pub joint: &'m Joint,
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
        let slots: Vec<(usize, usize)> =
            self.joint.slots().into_iter().enumerate().filter_map(|(i, slot)| Some((i, slot?))).collect();
        let q = self.coordinates.of(z);
        let pull = -self.strength * z[self.control];
        if out.wants(Order::Bends) {
            let lambda: Vec<f64> = self.motion.range().map(|row| out.multiplier(row)).collect();
            let angle = self.joint.coordinate_value(&along(q, &lambda));
            for (k, &(i, one)) in slots.iter().enumerate() {
                out.bend(self.coordinates.at(one), self.control, -self.strength * angle.gradient[i].eps);
                for &(j, other) in &slots[k..] {
                    out.bend(self.coordinates.at(one), self.coordinates.at(other), pull * angle.hessian[i][j].eps);
                }
            }
            return;
        }
        let angle = self.joint.coordinate_value(q);
        for &(i, one) in &slots {
            out.value(self.motion.at(one), pull * angle.gradient[i]);
            out.slope(self.motion.at(one), self.control, -self.strength * angle.gradient[i]);
            for &(j, other) in &slots {
                out.slope(self.motion.at(one), self.coordinates.at(other), pull * angle.hessian[i][j]);
            }
        }
    }

    fn weigh(&self, _z: &[f64], weights: &mut [f64]) {
        weights[self.control] = 0.1 * self.step_weight;
    }
}
