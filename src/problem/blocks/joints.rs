//! Eq. (2), joints of planar models and held points of spatial ones as constraints, and their part of eq. (1) (thesis, Paper B):
//!
//! ```text
//! … + Φ_qᵀ f_r = 0        (1)
//! Φ(q) = 0                (2)
//! ```
//!
//! | symbol | meaning | unit |
//! |---|---|---|
//! | Φ | a function for each degree of freedom that a joint takes away | m, rad |
//! | f_r | joint reactions | total weight W |
//!
//! With λ the multipliers of eq. (1), their second derivatives `∇²(λ·Φ_qᵀ f_r)` are those of ∇²Φ along λ, exact by dual
//! numbers q + ε λ.

use super::along;
use crate::model::Mechanics;
use crate::problem::block::{Block, Order, Sink};
use crate::problem::quantity::Span;

pub struct Joints<'m> {
    pub mechanics: &'m dyn Mechanics,
    /// All coordinates, those of given motion last.
    pub coordinates: Span,
    pub reactions: Span,
    /// Rows of eq. (1).
    pub motion: Span,
    pub rows: Span,
}

impl Block for Joints<'_> {
    fn evaluate(&self, z: &[f64], out: &mut Sink<'_>) {
        let (q, nq) = (self.coordinates.of(z), self.motion.count);
        if out.wants(Order::Bends) {
            let lambda: Vec<f64> = self.motion.range().map(|row| out.multiplier(row)).collect();
            self.mechanics.constraint_functions_along(&along(q, &lambda), &mut |row, slots, _, gradient, hessian| {
                let (reaction, weight) = (z[self.reactions.at(row)], out.multiplier(self.rows.at(row)));
                for (i, &one) in slots.iter().enumerate().filter(|(_, slot)| **slot < nq) {
                    out.bend(self.coordinates.at(one), self.reactions.at(row), gradient[i].eps);
                    for (j, &other) in slots.iter().enumerate().skip(i).filter(|(_, slot)| **slot < nq) {
                        let second = hessian[i * slots.len() + j];
                        let bend = reaction * second.eps + weight * second.re;
                        out.bend(self.coordinates.at(one), self.coordinates.at(other), bend);
                    }
                }
            });
            return;
        }
        self.mechanics.constraint_functions(q, &mut |row, slots, value, gradient, hessian| {
            let reaction = z[self.reactions.at(row)];
            out.value(self.rows.at(row), value);
            for (i, &one) in slots.iter().enumerate().filter(|(_, slot)| **slot < nq) {
                out.value(self.motion.at(one), reaction * gradient[i]);
                out.slope(self.rows.at(row), self.coordinates.at(one), gradient[i]);
                out.slope(self.motion.at(one), self.reactions.at(row), gradient[i]);
                if out.wants(Order::Slopes) {
                    for (j, &other) in slots.iter().enumerate().filter(|(_, slot)| **slot < nq) {
                        let second = hessian[i * slots.len() + j];
                        out.slope(self.motion.at(one), self.coordinates.at(other), reaction * second);
                    }
                }
            }
        });
    }
}
