//! Eq. (1) where the motion is given, projected on the motions that the joints allow (thesis, eq. 1.6):
//!
//! ```text
//! (Σ_m R_m F_m(a_m) + Σ_k T_k r_k − τ)/W = 0      with F_m = N_m a_m + P_m:     A(t) x − b(t) = 0
//! ```
//!
//! | symbol | meaning | unit |
//! |---|---|---|
//! | R | moment arms −∂L/∂θ | m |
//! | N, P | force at full activation beyond the passive one, passive force | N |
//! | T r | reserves and actuators | N m, N |
//! | τ | what the motion needs beside external loads | N m, N |
//! | W | total weight, the unit of this equation | N |

use crate::problem::block::{Block, Order, Sink};
use crate::problem::quantity::Span;

pub struct MomentBalance {
    pub rows: Span,
    /// b among the variables.
    pub needed: Span,
    /// The entries of A.
    pub entries: Vec<Entry>,
}

/// An entry of A, known at each time.
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    /// Number of the row.
    pub row: usize,
    /// The activation or control.
    pub control: usize,
    /// Where its value is among the variables.
    pub factor: usize,
}

impl Block for MomentBalance {
    fn evaluate(&self, z: &[f64], out: &mut Sink<'_>) {
        if out.wants(Order::Bends) {
            return;
        }
        self.rows.range().zip(self.needed.of(z)).for_each(|(row, needed)| out.value(row, -needed));
        for entry in &self.entries {
            let (row, factor) = (self.rows.at(entry.row), z[entry.factor]);
            out.value(row, factor * z[entry.control]);
            out.slope(row, entry.control, factor);
        }
    }

    fn weigh(&self, _z: &[f64], weights: &mut [f64]) {
        self.entries.iter().for_each(|entry| weights[entry.control] = 1.0);
    }
}
