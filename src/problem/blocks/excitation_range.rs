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
    muscle: &'m Musculotendon,
    activation: usize,
    rate: usize,
    functions: [Function; 2],
}

/// One of the two functions: its row, excitation, sign, and 1/c.
struct Function {
    row: usize,
    excitation: f64,
    sign: f64,
    time: f64,
}

impl<'m> ExcitationRange<'m> {
    /// `least`: u_min; `rows` of the two functions.
    pub fn new(
        muscle: &'m Musculotendon,
        least: f64,
        [activation, rate]: [usize; 2],
        [lower, upper]: [usize; 2],
    ) -> Self {
        let function = |row, excitation, sign| {
            let time = -1.0 / muscle.activation.rate(excitation, excitation).slopes[0];
            Function { row, excitation, sign, time }
        };
        Self { muscle, activation, rate, functions: [function(lower, least, 1.0), function(upper, 1.0, -1.0)] }
    }
}

impl Block for ExcitationRange<'_> {
    fn evaluate(&self, z: &[f64], out: &mut Sink<'_>) {
        for &Function { row, excitation, sign, time } in &self.functions {
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
