//! Regularity (thesis, Paper B eq. 25): the ranks of A and of [Aᵀ Jᵀ].
//!
//! `A` stacks the Jacobian rows of all equalities and of the active inequalities, `J` is the Jacobian of the residuals.
//!
//! - Row deficiency of A = rows − rank(A): dependent constraints, multipliers not unique.
//! - Row deficiency of [Aᵀ Jᵀ] = n − rank([A; J]): directions that change neither constraints nor residuals to first
//!   order. Zero: the quadratic sub-problem has one solution.
//!
//! Both are taken in the scaling that the problem is solved in: reactions and eq. (1) in total weights, eq. (3) in tendon
//! strain, eq. (4) times τ, Φ in m and rad; rows are not scaled otherwise. The thesis prints deficiencies as negative
//! numbers; here they are counts.

use faer::Mat;

use super::iterate::Iterate;
use super::problem::Problem;
use crate::numerics::rank::{self, Rank};
use crate::numerics::sparse::Sparse;

/// Singular values this close to the cut, on either side, are kept.
const AROUND_CUT: usize = 6;
/// Between these fractions of σ_max a singular value is neither clearly zero nor clearly not.
const AMBIGUOUS: (f64, f64) = (1e-15, 1e-9);

/// Rank of one of the two matrices, and its spectrum.
#[derive(Clone, Debug, PartialEq)]
pub struct Spectrum {
    pub rank: Rank,
    /// rows − rank for A, columns − rank for [A; J].
    pub deficiency: usize,
}

impl Spectrum {
    pub fn sigma_max(&self) -> Option<f64> {
        self.rank.singular_values.first().copied()
    }

    pub fn last_kept(&self) -> Option<f64> {
        self.rank.rank.checked_sub(1).and_then(|i| self.rank.singular_values.get(i)).copied()
    }

    pub fn first_dropped(&self) -> Option<f64> {
        self.rank.singular_values.get(self.rank.rank).copied()
    }

    /// (index from 0, value) of the singular values around the cut.
    pub fn around_cut(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        let cut = self.rank.rank;
        let values = self.rank.singular_values.iter().copied().enumerate();
        values.filter(move |&(i, _)| i + AROUND_CUT >= cut && i < cut + AROUND_CUT)
    }

    /// Whether some σ/σ_max lies between 1e-15 and 1e-9.
    pub fn is_ambiguous(&self) -> bool {
        let Some(largest) = self.sigma_max() else { return false };
        self.rank.singular_values.iter().any(|s| (AMBIGUOUS.0..=AMBIGUOUS.1).contains(&(s / largest)))
    }

    /// Whether a cut somewhere within the ambiguous band gives this deficiency.
    pub fn could_be(&self, deficiency: usize) -> bool {
        let Some(largest) = self.sigma_max() else { return deficiency == self.deficiency };
        let above = |cut: f64| self.rank.singular_values.iter().filter(|&&s| s > cut * largest).count();
        let full = self.deficiency + self.rank.rank;
        (above(AMBIGUOUS.1)..=above(AMBIGUOUS.0)).any(|rank| full.checked_sub(rank) == Some(deficiency))
    }
}

/// Both ranks at one point.
#[derive(Clone, Debug, PartialEq)]
pub struct Regularity {
    pub a: Spectrum,
    pub aj: Spectrum,
    /// Orthonormal directions that change neither constraints nor residuals to first order (n each).
    pub null_directions: Vec<Vec<f64>>,
}

/// The ranks at `iterate` by singular values, with the inequality rows `active`. `None` if not finite.
pub fn analyse(problem: &dyn Problem, iterate: &Iterate, active: &[usize]) -> Option<Regularity> {
    let a = stack(iterate, active, None);
    let mut aj = stack(iterate, active, Some(problem.residual_jacobian()));
    let n = iterate.x.len();
    let rank_a = rank::by_svd(&a)?;
    let rank_aj = rank::by_svd(&aj)?;
    let deficiency = n - rank_aj.rank;
    let mut null_directions = Vec::new();
    if deficiency > 0 {
        if aj.nrows() < n {
            aj.resize_with(n, n, |_, _| 0.0);
        }
        let svd = aj.thin_svd().ok()?;
        let v = svd.V();
        null_directions = (rank_aj.rank..n).map(|k| (0..n).map(|i| v[(i, k)]).collect()).collect();
    }
    Some(Regularity {
        a: Spectrum { deficiency: a.nrows() - rank_a.rank, rank: rank_a },
        aj: Spectrum { deficiency, rank: rank_aj },
        null_directions,
    })
}

/// The two deficiencies by pivoted QR: several times cheaper, and an independent check.
pub fn deficiencies(problem: &dyn Problem, iterate: &Iterate, active: &[usize]) -> Option<(usize, usize)> {
    let a = stack(iterate, active, None);
    let aj = stack(iterate, active, Some(problem.residual_jacobian()));
    Some((a.nrows() - rank::by_pivoted_qr(&a)?, iterate.x.len() - rank::by_pivoted_qr(&aj)?))
}

/// [A; J] as a dense matrix: equalities, active inequalities, residuals if given.
fn stack(iterate: &Iterate, active: &[usize], residuals: Option<&Sparse>) -> Mat<f64> {
    let equalities = &iterate.equality_jacobian;
    let rows_a = equalities.rows + active.len();
    let mut matrix = Mat::zeros(rows_a + residuals.map_or(0, |j| j.rows), iterate.x.len());
    for (row, column, slot) in equalities.entries() {
        matrix[(row, column)] = equalities.values[slot];
    }
    let mut place = vec![usize::MAX; iterate.inequality_jacobian.rows];
    active.iter().enumerate().for_each(|(k, &row)| place[row] = equalities.rows + k);
    for (row, column, slot) in iterate.inequality_jacobian.entries() {
        if place[row] != usize::MAX {
            matrix[(place[row], column)] = iterate.inequality_jacobian.values[slot];
        }
    }
    if let Some(j) = residuals {
        for (row, column, slot) in j.entries() {
            matrix[(rows_a + row, column)] = j.values[slot];
        }
    }
    matrix
}
