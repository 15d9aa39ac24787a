//! Muscle recruitment at an instant: which of all forces that carry the load is the best (thesis, eq. 1.6).
//!
//! ```text
//! minimise   Σ φ_i(x_i)          or   max e_i
//! subject to A x = b,   lower ≤ x ≤ upper
//! ```
//!
//! x has the activations of all muscles and the controls of reserves and actuators, A their moments at 1, b the moments that
//! the motion needs. Each e_i = o_i + s_i x_i is an effort, and φ_i = w_i e_i^p.
//!
//! | file | criterion |
//! |---|---|
//! | `interior_point` | Σ w e^p, p ≥ 2: strictly convex, so that the answer is unique |
//! | `linear` | Σ w \|e\|, and max e with what follows where it is lexicographic: linear programmes |
//! | `missing` | what is missing where no x carries the load |
//! | `ranges` | how far each force could be otherwise at (nearly) the same cost |
//!
//! Sources: R. D. Crowninshield and R. A. Brand, *J Biomech* 14, 1981 (polynomial criteria); J. Rasmussen et al., *J Biomech* 34,
//! 2001 (min/max).

mod cholesky;
mod interior_point;
mod linear;
mod missing;
mod ranges;

pub use missing::missing;
pub use ranges::Ranges;

use crate::deadline::Deadline;
use crate::nlp::subproblem::qp::QpFailure;

/// A programme; see the module.
#[derive(Clone, Debug)]
pub struct Programme {
    /// Number of rows of A.
    pub rows: usize,
    /// A, column by column: (row, value).
    pub columns: Vec<Vec<(usize, f64)>>,
    pub right: Vec<f64>,
    pub terms: Vec<Term>,
    pub criterion: Criterion,
}

/// The effort of a variable and its share in the criterion.
#[derive(Clone, Copy, Debug)]
pub struct Term {
    /// w
    pub weight: f64,
    /// o and s of e = o + s x.
    pub offset: f64,
    pub scale: f64,
    /// May be infinite.
    pub bounds: [f64; 2],
    /// Whether it is a muscle's. The others, of reserves and actuators, are squared with a power p ≥ 2 and taken by their size
    /// with the linear criteria; they are beside the maximum.
    pub is_muscle: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Criterion {
    /// Σ w e^p
    Polynomial(f64),
    /// max e over the muscles, then the largest of the others where those that are at the maximum stay, and so on.
    MinMax,
}

/// The best x.
#[derive(Clone, Debug)]
pub struct Optimum {
    pub x: Vec<f64>,
    /// y of ∇f = Aᵀ y + z_lower − z_upper.
    pub multipliers: Vec<f64>,
    /// z ≥ 0
    pub lower: Vec<f64>,
    pub upper: Vec<f64>,
    /// The criterion, with its first maximum.
    pub value: f64,
    /// Iterations, of all programmes.
    pub iterations: usize,
    /// Linear programmes solved, of min/max one for each maximum.
    pub stages: usize,
    /// Whether the answer is the only one: of strictly convex criteria, and of min/max where nothing is left to lower.
    pub is_unique: bool,
}

/// Why there is none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Failure {
    /// No x carries the load.
    Infeasible,
    /// The solver gave up.
    Numerical,
}

impl From<QpFailure> for Failure {
    fn from(failure: QpFailure) -> Self {
        match failure {
            QpFailure::Infeasible => Self::Infeasible,
            QpFailure::Numerical => Self::Numerical,
        }
    }
}

impl Term {
    /// e
    pub fn effort(&self, x: f64) -> f64 {
        self.offset + self.scale * x
    }
}

impl Programme {
    /// The optimum.
    ///
    /// # Errors
    /// If there is none, or it is not found before the deadline.
    pub fn solve(&self, deadline: Deadline) -> Result<Optimum, Failure> {
        if deadline.passed() {
            return Err(Failure::Numerical);
        }
        let found = match self.criterion {
            Criterion::Polynomial(power) if power >= 2.0 => interior_point::minimise(self, power, None),
            Criterion::Polynomial(_) => linear::sum(self, deadline),
            Criterion::MinMax => linear::min_max(self, deadline),
        };
        // A solver may give up on what is infeasible.
        match found {
            Err(Failure::Numerical) if missing(self).is_some_and(|missing| !missing.is_none()) => {
                Err(Failure::Infeasible)
            }
            found => found,
        }
    }

    /// A x
    pub fn loads(&self, x: &[f64]) -> Vec<f64> {
        let mut loads = vec![0.0; self.rows];
        for (column, x) in self.columns.iter().zip(x) {
            column.iter().for_each(|&(row, value)| loads[row] += value * x);
        }
        loads
    }

    /// The sum of efforts of muscles alone, with this power.
    pub fn muscle_effort(&self, power: f64, x: &[f64]) -> f64 {
        let muscles = self.terms.iter().zip(x).filter(|(term, _)| term.is_muscle);
        muscles.map(|(term, &x)| term.weight * term.effort(x).abs().powf(power)).sum()
    }
}

#[cfg(test)]
mod tests;
