//! Eq. (4), activation dynamics (thesis, Paper B):
//!
//! ```text
//! τ (ȧ − g(a, u)) = 0         g = (u − a)(u/τ_act + (1 − u)/τ_deact), or that of another family
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
        let law = &self.muscle.activation;
        let time = law.up.max(law.down);
        let rate = law.rate(z[self.activation], z[self.excitation]);
        out.value(self.row, time * (z[self.rate] - rate.value));
        out.slope(self.row, self.rate, time);
        out.slope(self.row, self.activation, -time * rate.slopes[0]);
        out.slope(self.row, self.excitation, -time * rate.slopes[1]);
        if out.wants(Order::Bends) {
            let weight = -time * out.multiplier(self.row);
            out.bend(self.activation, self.activation, weight * rate.bends[0]);
            out.bend(self.activation, self.excitation, weight * rate.bends[1]);
            out.bend(self.excitation, self.excitation, weight * rate.bends[2]);
        }
    }

    fn weigh(&self, _z: &[f64], weights: &mut [f64]) {
        weights[self.activation] = self.step_weight;
        weights[self.excitation] = 0.1 * self.step_weight;
    }
}
