//! Regularity (thesis, Paper B eq. 25): the ranks of A and of [Aᵀ Jᵀ].
//!
//! `A` stacks the Jacobian rows of all equalities and of the active inequalities, `J` is the Jacobian of the residuals.
//!
//! - Row deficiency of A = rows − rank(A): dependent constraints, multipliers not unique.
//! - Row deficiency of [Aᵀ Jᵀ] = n − rank([A; J]): directions that change neither constraints nor residuals to first
//!   order. Zero: the quadratic sub-problem has one solution.
//!
//! Both are taken in the scaling that the problem is solved in: reactions and eq. (1) in total weights, eq. (3) in
//! tendon strain, eq. (4) times τ, Φ in m and rad; rows are not scaled otherwise. The thesis prints deficiencies as
//! negative numbers; here they are counts.
//!
//! Pivots are counted stage by stage in time ([`StagedSpectrum`]), linear in the number of points. Two independent
//! checks give the same numbers for problems that are not too large: a dense singular value decomposition, and QR with
//! column pivoting.

use faer::Mat;

use super::iterate::Iterate;
use super::problem::{Problem, objective_rows};
use crate::deadline::Deadline;
use crate::numerics::rank::{self, Rank};
use crate::numerics::sparse::{Pattern, Sparse};
use crate::numerics::spectrum::{Side, StagedSpectrum};

/// So many singular values on either side of the cut are kept where they are known; else one.
const AROUND_CUT: usize = 6;
/// Between these fractions of σ_max a singular value is neither clearly zero nor clearly not.
const AMBIGUOUS: (f64, f64) = (1e-15, 1e-9);
/// Singular values above the cut are known to this relative precision; those below, which are rounding, to a factor of
/// two.
const PRECISION: f64 = 1e-3;
const ROUGHLY: f64 = 1.0;
/// Below this share of σ_max no singular value is looked for.
const LEAST: f64 = 1e-18;
/// Up to so many null directions, or so many numbers in them, are found all; else so many random ones.
const FEW: usize = 24;
const CHEAP: usize = 50_000;
const SAMPLED: usize = 3;

/// Rank of one of the two matrices, and its spectrum near the cut.
#[derive(Clone, Debug, PartialEq)]
pub struct Spectrum {
    pub rank: usize,
    /// rows − rank for A, columns − rank for [A; J].
    pub deficiency: usize,
    pub tolerance: f64,
    pub sigma_max: Option<f64>,
    /// (index from 0, value) of singular values around the cut, largest first.
    pub around_cut: Vec<(usize, f64)>,
    /// Numbers of singular values above the two ends of the ambiguous band, upper end first.
    above_band: (usize, usize),
}

impl Spectrum {
    fn dense(rank: &Rank, full: usize) -> Self {
        let values = &rank.singular_values;
        let largest = values.first().copied().unwrap_or(0.0);
        let above = |cut: f64| values.iter().filter(|&&s| s > cut * largest).count();
        let near = |i: usize| i + AROUND_CUT >= rank.rank && i < rank.rank + AROUND_CUT;
        Self {
            rank: rank.rank,
            deficiency: full - rank.rank,
            tolerance: rank.tolerance,
            sigma_max: values.first().copied(),
            around_cut: values.iter().copied().enumerate().filter(|&(i, _)| near(i)).collect(),
            above_band: (above(AMBIGUOUS.1), above(AMBIGUOUS.0)),
        }
    }

    /// By counting, and the vectors of `side` below the cut: all of them, or, if there are many, none of the rows and
    /// random ones of the columns. `rows` of the matrix `m`, last set, are not left at zero.
    fn counted(
        matrix: &mut StagedSpectrum,
        m: &Sparse,
        rows: usize,
        side: Side,
        deadline: Deadline,
    ) -> Option<(Self, Vec<Vec<f64>>)> {
        let sigma_max = matrix.sigma_max();
        let tolerance = rank::tolerance(rows, m.columns, sigma_max);
        let [top, bottom] = [AMBIGUOUS.1, AMBIGUOUS.0].map(|share| share * sigma_max);
        let rank = matrix.count_above(tolerance)?;
        let (full, sampled) = match side {
            Side::Rows => (rows, 0),
            Side::Columns => (m.columns, SAMPLED),
        };
        let deficiency = full - rank;
        let wanted = if deficiency <= FEW || deficiency * full <= CHEAP { deficiency } else { sampled };
        let near = matrix.near(m, side, tolerance, deficiency, wanted)?;
        let (dropped, vectors): (Vec<f64>, Vec<Vec<f64>>) = near.below.into_iter().unzip();
        let is_known = dropped.len() == deficiency && dropped.iter().all(|value| *value <= tolerance);
        let mut around_cut = Vec::new();
        let mut high = 0;
        if rank > 0 && !deadline.passed() {
            let kept = matrix.value(rank - 1, (tolerance, 1.01 * sigma_max), PRECISION, near.above)?;
            high = if kept > 2.0 * top { rank } else { matrix.count_above(top)? };
            around_cut.push((rank - 1, kept));
        }
        let low = if is_known {
            around_cut.extend(dropped.iter().enumerate().map(|(k, value)| (rank + k, *value)).take(AROUND_CUT));
            rank + dropped.iter().filter(|value| **value > bottom).count()
        } else {
            let low = matrix.count_above(bottom)?;
            if rank < rows.min(m.columns) {
                let bracket = if rank < low { (bottom, tolerance) } else { (LEAST * sigma_max, bottom) };
                around_cut.push((rank, matrix.value(rank, bracket, ROUGHLY, None)?));
            }
            low
        };
        if deadline.passed() {
            return None;
        }
        let spectrum =
            Self { rank, deficiency, tolerance, sigma_max: Some(sigma_max), around_cut, above_band: (high, low) };
        Some((spectrum, vectors))
    }

    pub fn last_kept(&self) -> Option<f64> {
        self.around_cut.iter().rev().find(|(i, _)| *i < self.rank).map(|(_, value)| *value)
    }

    pub fn first_dropped(&self) -> Option<f64> {
        self.around_cut.iter().find(|(i, _)| *i >= self.rank).map(|(_, value)| *value)
    }

    /// Whether some σ/σ_max lies between 1e-15 and 1e-9.
    pub fn is_ambiguous(&self) -> bool {
        self.above_band.0 != self.above_band.1
    }

    /// Whether a cut somewhere within the ambiguous band gives this deficiency.
    pub fn could_be(&self, deficiency: usize) -> bool {
        let full = self.deficiency + self.rank;
        (self.above_band.0..=self.above_band.1).any(|rank| full.checked_sub(rank) == Some(deficiency))
    }
}

/// Both ranks at one point.
#[derive(Clone, Debug)]
pub struct Regularity {
    pub a: Spectrum,
    pub aj: Spectrum,
    /// Orthonormal directions that change neither constraints nor residuals to first order (n each): all of them, or,
    /// in large problems with many, random ones.
    pub null_directions: Vec<Vec<f64>>,
}

/// The ranks by dense singular value decomposition: an independent check.
pub fn analyse_dense(problem: &dyn Problem, iterate: &Iterate, active: &[usize]) -> Option<Regularity> {
    let a = stack(iterate, active, None);
    let aj = stack(iterate, active, Some(&objective_rows(problem, &iterate.x)));
    let n = iterate.x.len();
    let rank_a = rank::by_svd(&a)?;
    let (rank_aj, null_directions) = rank::with_null_space(&aj)?;
    Some(Regularity { a: Spectrum::dense(&rank_a, a.nrows()), aj: Spectrum::dense(&rank_aj, n), null_directions })
}

/// Counts both ranks of one problem at any of its points; symbolic work once.
pub struct RankCounter<'p> {
    problem: &'p dyn Problem,
    equalities: usize,
    /// All equalities and inequalities, those not active left at zero; and J below.
    stacked: [Sparse; 2],
    /// Slots in both of each entry of the equality and of the inequality Jacobian.
    equality_slots: [Vec<usize>; 2],
    inequality_slots: [Vec<usize>; 2],
    /// Slots of each entry of the objective's rows in the second, if they change with x.
    objective_slots: Vec<usize>,
    spectra: [StagedSpectrum; 2],
    /// Once this has passed nothing is counted any more.
    pub deadline: Deadline,
}

impl<'p> RankCounter<'p> {
    pub fn new(problem: &'p dyn Problem) -> Self {
        let [equalities, inequalities, _] = problem.patterns();
        let residuals = &*objective_rows(problem, &vec![0.0; problem.variables()]);
        let (n, rows_a) = (equalities.columns, equalities.rows + inequalities.rows);
        let [equality_stages, inequality_stages] = problem.constraint_stages();
        let mut residual_stages = vec![0; residuals.rows];
        for (row, column, _) in residuals.entries() {
            residual_stages[row] = residual_stages[row].max(problem.stages()[column]);
        }
        let mut objective_slots = Vec::new();
        let parts = [false, true].map(|with_residuals| {
            let mut pattern = Pattern::new(rows_a + if with_residuals { residuals.rows } else { 0 }, n);
            equalities.entries().for_each(|(i, j, _)| pattern.add(i, j));
            inequalities.entries().for_each(|(i, j, _)| pattern.add(equalities.rows + i, j));
            let mut stages = [equality_stages, inequality_stages].concat();
            if with_residuals {
                residuals.entries().for_each(|(i, j, _)| pattern.add(rows_a + i, j));
                stages.extend(&residual_stages);
            }
            let mut matrix = pattern.build();
            if with_residuals {
                for (i, j, slot) in residuals.entries() {
                    let place = pattern.slot(rows_a + i, j);
                    matrix.values[place] = residuals.values[slot];
                    if problem.term().is_some() {
                        objective_slots.push(place);
                    }
                }
            }
            let equality_slots: Vec<usize> = equalities.entries().map(|(i, j, _)| pattern.slot(i, j)).collect();
            let inequality_slots: Vec<usize> =
                inequalities.entries().map(|(i, j, _)| pattern.slot(equalities.rows + i, j)).collect();
            let spectrum = StagedSpectrum::new(&matrix, &stages, problem.stages());
            (matrix, equality_slots, inequality_slots, spectrum)
        });
        let [(a, ea, ia, sa), (aj, eaj, iaj, saj)] = parts;
        Self {
            problem,
            objective_slots,
            equalities: equalities.rows,
            stacked: [a, aj],
            equality_slots: [ea, eaj],
            inequality_slots: [ia, iaj],
            spectra: [sa, saj],
            deadline: Deadline::default(),
        }
    }

    fn set(&mut self, iterate: &Iterate, active: &[usize]) {
        let mut is_active = vec![false; iterate.inequality_jacobian.rows];
        active.iter().for_each(|&row| is_active[row] = true);
        if self.problem.term().is_some() {
            let rows = objective_rows(self.problem, &iterate.x);
            let slots = self.objective_slots.iter().zip(&rows.values);
            slots.for_each(|(&slot, value)| self.stacked[1].values[slot] = *value);
        }
        for part in 0..2 {
            let matrix = &mut self.stacked[part];
            let equalities = &iterate.equality_jacobian.values;
            self.equality_slots[part].iter().zip(equalities).for_each(|(&slot, value)| matrix.values[slot] = *value);
            let entries = iterate.inequality_jacobian.entries().zip(&self.inequality_slots[part]);
            for ((row, _, from), &slot) in entries {
                matrix.values[slot] = if is_active[row] { iterate.inequality_jacobian.values[from] } else { 0.0 };
            }
            self.spectra[part].set(matrix);
        }
    }

    /// (rows of A, rows of [A; J], columns) with so many active inequalities.
    fn sizes(&self, active: usize) -> (usize, usize, usize) {
        let residuals = self.stacked[1].rows - self.stacked[0].rows;
        (self.equalities + active, self.equalities + active + residuals, self.stacked[0].columns)
    }

    /// The two deficiencies, of A and of [A; J]. `None` if not finite.
    pub fn deficiencies(&mut self, iterate: &Iterate, active: &[usize]) -> Option<(usize, usize)> {
        self.set(iterate, active);
        let (rows_a, rows_aj, n) = self.sizes(active.len());
        let [a, aj] = &mut self.spectra;
        let rank_a = a.count_above(rank::tolerance(rows_a, n, a.sigma_max()))?;
        let rank_aj = aj.count_above(rank::tolerance(rows_aj, n, aj.sigma_max()))?;
        Some((rows_a - rank_a, n - rank_aj))
    }

    /// Ranks and the spectra near the cuts. `None` if not finite or too late.
    pub fn analyse(&mut self, iterate: &Iterate, active: &[usize]) -> Option<Regularity> {
        if self.deadline.passed() {
            return None;
        }
        self.set(iterate, active);
        let (rows_a, rows_aj, _) = self.sizes(active.len());
        let [a, aj] = &mut self.spectra;
        let (a, _) = Spectrum::counted(a, &self.stacked[0], rows_a, Side::Rows, self.deadline)?;
        let (aj, null_directions) = Spectrum::counted(aj, &self.stacked[1], rows_aj, Side::Columns, self.deadline)?;
        Some(Regularity { a, aj, null_directions })
    }
}

/// The two deficiencies by pivoted QR: an independent check.
pub fn deficiencies_by_qr(problem: &dyn Problem, iterate: &Iterate, active: &[usize]) -> Option<(usize, usize)> {
    let a = stack(iterate, active, None);
    let aj = stack(iterate, active, Some(&objective_rows(problem, &iterate.x)));
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
