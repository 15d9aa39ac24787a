//! What is missing where no x carries the load: the least moments to be added.
//!
//! ```text
//! minimise ½ ‖s‖²   subject to A x + s = b,   lower ≤ x ≤ upper
//! ```
//!
//! The s found is a certificate: of all x within the bounds, none has a larger sᵀ A x, and sᵀ A x < sᵀ b.

use super::{Programme, Term, interior_point};

/// What is missing below this share of the load is rounding.
const NEGLIGIBLE: f64 = 1e-6;
/// Weight of the variables themselves, which makes the answer unique.
const SELECTION: f64 = 1e-9;

/// The moments (in the units of the rows) that are missing.
#[derive(Clone, Debug)]
pub struct Missing {
    pub moments: Vec<f64>,
    /// By how much sᵀ b exceeds the largest sᵀ A x, over ‖s‖²: 1 if s is exact, and above 0 if nothing carries the load.
    pub certificate: f64,
    /// Size of the load.
    scale: f64,
}

impl Missing {
    /// Whether the load can be carried.
    pub fn is_none(&self) -> bool {
        self.moments.iter().all(|s| s.abs() <= NEGLIGIBLE * self.scale)
    }

    /// The row of which most is missing.
    pub fn largest(&self) -> Option<usize> {
        let rows = 0..self.moments.len();
        rows.max_by(|&a, &b| self.moments[a].abs().total_cmp(&self.moments[b].abs()))
    }
}

/// What is missing; `None` if the solver gives up.
pub fn missing(programme: &Programme) -> Option<Missing> {
    let scale = programme.right.iter().fold(0.0f64, |a, b| a.max(b.abs())).max(1e-3);
    let mut elastic = programme.clone();
    for term in &mut elastic.terms {
        *term = Term { weight: SELECTION, offset: 0.0, scale: 1.0, ..*term };
    }
    for row in 0..programme.rows {
        elastic.columns.push(vec![(row, scale)]);
        let bounds = [f64::NEG_INFINITY, f64::INFINITY];
        elastic.terms.push(Term { weight: 1.0, offset: 0.0, scale: 1.0, bounds, is_muscle: true });
    }
    let found = interior_point::minimise(&elastic, 2.0, None).ok()?;
    let moments: Vec<f64> = found.x[programme.columns.len()..].iter().map(|s| s * scale).collect();
    // The largest sᵀ A x over the bounds.
    let most: f64 = programme
        .columns
        .iter()
        .zip(&programme.terms)
        .map(|(column, term)| {
            let pull: f64 = column.iter().map(|&(row, value)| value * moments[row]).sum();
            let best = if pull > 0.0 { term.bounds[1] } else { term.bounds[0] };
            // A free variable leaves no load in its rows.
            if best.is_finite() { pull * best } else { 0.0 }
        })
        .sum();
    let load: f64 = programme.right.iter().zip(&moments).map(|(b, s)| b * s).sum();
    let square: f64 = moments.iter().map(|s| s * s).sum();
    Some(Missing { certificate: if square > 0.0 { (load - most) / square } else { 0.0 }, moments, scale })
}
