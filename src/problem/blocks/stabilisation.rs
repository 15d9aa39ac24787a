//! The joints on the velocity level, which lowers the index of the constrained motion from 3 to 2. Not in the thesis;
//! source: C. W. Gear, B. Leimkuhler and G. K. Gupta, *J. Comput. Appl. Math.* 12–13, 1985.
//!
//! ```text
//! q̇ − v − Φ_qᵀ η = 0
//! Φ_q v = 0
//! ```
//!
//! | symbol | meaning | unit |
//! |---|---|---|
//! | v | velocities, whose rate is q̈ in eq. (1) | m/s, rad/s |
//! | η | multipliers, zero but for the discretisation's error | – |
//!
//! With multipliers κ and γ of the two rows, `Φ_η = Σ η_c Φ_c` and `Φ_γ` alike, the second derivatives are those of γ's
//! directional derivative along v less those of η's along κ.

use super::along;
use crate::model::Mechanics;
use crate::problem::block::{Block, Order, Sink};
use crate::problem::quantity::Span;

pub struct Stabilisation<'m> {
    pub mechanics: &'m dyn Mechanics,
    /// All coordinates, those of given motion last.
    pub coordinates: Span,
    /// Rates of those that move by forces.
    pub rates: Span,
    /// v, with rates of the given coordinates.
    pub velocities: Span,
    /// η
    pub multipliers: Span,
    pub kinematic_rows: Span,
    pub velocity_rows: Span,
}

impl Block for Stabilisation<'_> {
    fn evaluate(&self, z: &[f64], out: &mut Sink<'_>) {
        if out.wants(Order::Bends) {
            self.bend(z, out);
            return;
        }
        let nq = self.rates.count;
        for i in 0..nq {
            out.value(self.kinematic_rows.at(i), z[self.rates.at(i)] - z[self.velocities.at(i)]);
            out.slope(self.kinematic_rows.at(i), self.rates.at(i), 1.0);
            out.slope(self.kinematic_rows.at(i), self.velocities.at(i), -1.0);
        }
        let velocities = self.velocities.of(z);
        self.mechanics.constraint_functions(self.coordinates.of(z), &mut |row, slots, _, gradient, hessian| {
            let eta = z[self.multipliers.at(row)];
            for (i, &one) in slots.iter().enumerate().filter(|(_, slot)| **slot < velocities.len()) {
                let is_free = one < nq;
                out.value(self.velocity_rows.at(row), velocities[one] * gradient[i]);
                if is_free {
                    out.value(self.kinematic_rows.at(one), -eta * gradient[i]);
                    out.slope(self.kinematic_rows.at(one), self.multipliers.at(row), -gradient[i]);
                    out.slope(self.velocity_rows.at(row), self.velocities.at(one), gradient[i]);
                }
                if out.wants(Order::Values) {
                    continue;
                }
                for (j, &other) in slots.iter().enumerate().filter(|(_, slot)| **slot < nq) {
                    let (second, by) = (hessian[i * slots.len() + j], self.coordinates.at(other));
                    if is_free {
                        out.slope(self.kinematic_rows.at(one), by, -eta * second);
                    }
                    out.slope(self.velocity_rows.at(row), by, velocities[one] * second);
                }
            }
        });
    }
}

impl Stabilisation<'_> {
    fn bend(&self, z: &[f64], out: &mut Sink<'_>) {
        let (q, nq) = (self.coordinates.of(z), self.rates.count);
        let kappa: Vec<f64> = self.kinematic_rows.range().map(|row| out.multiplier(row)).collect();
        self.mechanics.constraint_functions_along(&along(q, &kappa), &mut |row, slots, _, gradient, hessian| {
            let eta = z[self.multipliers.at(row)];
            for (i, &one) in slots.iter().enumerate().filter(|(_, slot)| **slot < nq) {
                out.bend(self.coordinates.at(one), self.multipliers.at(row), -gradient[i].eps);
                for (j, &other) in slots.iter().enumerate().skip(i).filter(|(_, slot)| **slot < nq) {
                    let bend = -eta * hessian[i * slots.len() + j].eps;
                    out.bend(self.coordinates.at(one), self.coordinates.at(other), bend);
                }
            }
        });
        let moving = along(q, self.velocities.of(z));
        self.mechanics.constraint_functions_along(&moving, &mut |row, slots, _, _, hessian| {
            let gamma = out.multiplier(self.velocity_rows.at(row));
            for (i, &one) in slots.iter().enumerate().filter(|(_, slot)| **slot < nq) {
                for (j, &other) in slots.iter().enumerate().filter(|(_, slot)| **slot < nq) {
                    let second = hessian[i * slots.len() + j];
                    if j >= i {
                        out.bend(self.coordinates.at(one), self.coordinates.at(other), gamma * second.eps);
                    }
                    out.bend(self.coordinates.at(one), self.velocities.at(other), gamma * second.re);
                }
            }
        });
    }
}
