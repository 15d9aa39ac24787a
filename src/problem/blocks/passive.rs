//! Springs, dampers and soft limits at a joint coordinate that is an unknown, and their part of eq. (1). Not in the thesis;
//! source: OpenSim's CoordinateLimitForce and SpringGeneralizedForce (see `skeleton::passive`).
//!
//! ```text
//! … − τ(q, q̇)/W = 0        (1)
//! ```

use crate::problem::block::{Block, Order, Sink};
use crate::skeleton::passive::PassiveEntry;

pub struct PassiveMoment<'m> {
    pub element: &'m PassiveEntry,
    /// 1/W
    pub unit: f64,
    /// q and q̇ among the variables.
    pub variables: [usize; 2],
    /// Row of eq. (1).
    pub row: usize,
}

impl Block for PassiveMoment<'_> {
    fn evaluate(&self, z: &[f64], out: &mut Sink<'_>) {
        let [q, rate] = self.variables;
        let force = self.element.at(z[q], z[rate]);
        if out.wants(Order::Bends) {
            let weight = -self.unit * out.multiplier(self.row);
            out.bend(q, q, weight * force.hessian[0][0]);
            out.bend(q, rate, weight * force.hessian[0][1]);
            return;
        }
        out.value(self.row, -self.unit * force.value);
        for (variable, slope) in self.variables.into_iter().zip(force.gradient) {
            out.slope(self.row, variable, -self.unit * slope);
        }
    }
}
