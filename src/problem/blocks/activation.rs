//! Eq. (4), activation dynamics (thesis, Paper B):
//!
//! ```text
//! τ (ȧ − (u − a)(u/τ_act + (1 − u)/τ_deact)) = 0
//! ```
//!
//! | symbol | meaning | unit |
//! |---|---|---|
//! | a, ȧ | activation and its rate | –, 1/s |
//! | u | excitation | – |
//! | τ_act, τ_deact | time constants, 0.12 s both in the thesis; τ is the larger | s |

use crate::model::Musculotendon;
use crate::problem::block::{Block, Order, Sink};

pub struct Activation<'m> {
    pub muscle: &'m Musculotendon,
    pub activation: usize,
    pub rate: usize,
    pub excitation: usize,
    pub row: usize,
    /// Weight of a step in activation, relative to one in q.
    pub step_weight: f64,
}

impl Block for Activation<'_> {
    fn evaluate(&self, z: &[f64], out: &mut Sink<'_>) {
        let time = self.muscle.activation_time.max(self.muscle.deactivation_time);
        let residual = self.muscle.activation_residual(z[self.activation], z[self.rate], z[self.excitation]);
        out.value(self.row, time * residual.value);
        for (variable, by) in [self.activation, self.rate, self.excitation].into_iter().zip(residual.gradient) {
            out.slope(self.row, variable, time * by);
        }
        if out.wants(Order::Bends) {
            let weight = time * out.multiplier(self.row);
            out.bend(self.activation, self.excitation, weight * residual.mixed);
            out.bend(self.excitation, self.excitation, weight * residual.excitation);
        }
    }

    fn weigh(&self, _z: &[f64], weights: &mut [f64]) {
        weights[self.activation] = self.step_weight;
        weights[self.excitation] = 0.1 * self.step_weight;
    }
}
