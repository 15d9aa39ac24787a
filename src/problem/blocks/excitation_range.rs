//! The excitations that activation dynamics allow, without excitations as unknowns (C. Pipeleers et al., *J Biomech* 41, 2008):
//!
//! ```text
//! (ȧ − g(a, u_min))/c ≥ 0          c = −∂g/∂a at a = u = u_min
//! (g(a, 1) − ȧ)/c ≥ 0              c = −∂g/∂a at a = u = 1
//! ```
//!
//! g(a, u) is the rate of the activation. With eq. (4) of the thesis both are linear in a and ȧ, and with equal time constants
//! they are just the range u_min ≤ u ≤ 1. With others, eq. (4) is not monotonic in u for a > τ_act/(τ_deact − τ_act), and somewhat
//! more would be allowed. With `degroote_fregly_2016` g is monotonic in u.

use crate::model::Musculotendon;
use crate::problem::block::{Block, Order, Sink};

pub struct ExcitationRange<'m> {
    pub muscle: &'m Musculotendon,
    /// u_min
    pub least: f64,
    pub activation: usize,
    pub rate: usize,
    /// Rows of the two functions.
    pub lower: usize,
    pub upper: usize,
}

impl ExcitationRange<'_> {
    /// The row, excitation, sign, and 1/c of both functions.
    fn functions(&self) -> [(usize, f64, f64, f64); 2] {
        let law = &self.muscle.activation;
        [(self.lower, self.least, 1.0), (self.upper, 1.0, -1.0)]
            .map(|(row, u, sign)| (row, u, sign, -1.0 / law.rate(u, u).slopes[0]))
    }
}

impl Block for ExcitationRange<'_> {
    fn evaluate(&self, z: &[f64], out: &mut Sink<'_>) {
        for (row, excitation, sign, time) in self.functions() {
            let rate = self.muscle.activation.rate(z[self.activation], excitation);
            out.value(row, sign * time * (z[self.rate] - rate.value));
            out.slope(row, self.rate, sign * time);
            out.slope(row, self.activation, -sign * time * rate.slopes[0]);
            if out.wants(Order::Bends) {
                let weight = -sign * time * out.multiplier(row);
                out.bend(self.activation, self.activation, weight * rate.bends[0]);
            }
        }
    }
}
