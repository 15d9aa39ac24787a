//! The excitations that eq. (4) allows, without excitations as unknowns (C. Pipeleers et al., *J Biomech* 41, 2008):
//!
//! ```text
//! ȧ/c + a − u_min ≥ 0          c = u_min/τ_act + (1 − u_min)/τ_deact
//! 1 − a − τ_act ȧ ≥ 0
//! ```
//!
//! These are the rates at u = u_min and at u = 1, linear in a and ȧ. With equal time constants they are just the range
//! u_min ≤ u ≤ 1. With others, eq. (4) is not monotonic in u for a > τ_act/(τ_deact − τ_act), and somewhat more would be allowed.

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

/// c, 1/s: how fast an activation falls at an excitation.
pub fn falling(muscle: &Musculotendon, excitation: f64) -> f64 {
    excitation / muscle.activation_time + (1.0 - excitation) / muscle.deactivation_time
}

impl Block for ExcitationRange<'_> {
    fn evaluate(&self, z: &[f64], out: &mut Sink<'_>) {
        if out.wants(Order::Bends) {
            return;
        }
        let (a, rate) = (z[self.activation], z[self.rate]);
        let (slow, fast) = (1.0 / falling(self.muscle, self.least), self.muscle.activation_time);
        out.value(self.lower, slow * rate + a - self.least);
        out.slope(self.lower, self.rate, slow);
        out.slope(self.lower, self.activation, 1.0);
        out.value(self.upper, 1.0 - a - fast * rate);
        out.slope(self.upper, self.rate, -fast);
        out.slope(self.upper, self.activation, -1.0);
    }
}
