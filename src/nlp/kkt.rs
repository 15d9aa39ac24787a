//! The linear systems of the solver: one symmetric indefinite matrix, one pattern, many values.
//!
//! ```text
//!     ⎡ H + δ D + ε     Aᵀ      Bᵀ ⎤ ⎡  d ⎤   ⎡ r_x ⎤
//!     ⎢ A             −ε         0 ⎥ ⎢  λ ⎥ = ⎢ r_c ⎥
//!     ⎣ B               0       −ε ⎦ ⎣ −ν ⎦   ⎣ r_d ⎦
//! ```
//!
//! A: equalities, B: inequalities. Rows of inequalities that are not active are replaced by `−1` on the diagonal, so
//! that the pattern, and with it the symbolic factorisation, serves every active set; an interior-point method puts its
//! weights there instead.
//!
//! Factorised stage by stage in time ([`StagedLdl`]) with pivoting. The tiny ε keeps dependent constraints from making
//! the matrix singular; iterative refinement takes it out again. By Sylvester's law the signs of the pivots tell
//! whether H + δ D is positive definite where the active constraints vanish.

use super::problem::Problem;
use crate::deadline::Deadline;
use crate::numerics::sparse::{Pattern, Sparse};
pub use crate::numerics::staged::Inertia;
use crate::numerics::staged::StagedLdl;

/// ε of the variables: this share of δ, within these limits.
const PRIMAL: f64 = 0.1;
const PRIMAL_RANGE: (f64, f64) = (1e-18, 1e-14);
/// ε of the constraints, against entries of order one.
const DUAL: f64 = 1e-11;
const REFINEMENTS: usize = 9;
/// Relative residuals that need no more of them.
const EXACT: f64 = 1e-12;
const ROUGH: f64 = 1e-8;

/// The matrix, its symbolic factorisation and its work space.
pub struct Kkt {
    variables: usize,
    equalities: usize,
    /// With ε.
    matrix: Sparse,
    /// ε of the variables.
    primal: f64,
    /// See [`KktValues::unit`].
    unit: f64,
    hessian_slots: Vec<u32>,
    equality_slots: Vec<u32>,
    inequality_slots: Vec<u32>,
    diagonal_slots: Vec<u32>,
    active: Vec<bool>,
    factors: StagedLdl,
    /// Once this has passed nothing is factorised any more.
    pub deadline: Deadline,
    /// How many there have been.
    pub factorisations: usize,
    /// Whether the last solution with this factorisation was a rough one and needed no refinement.
    is_accurate: bool,
    residual: Vec<f64>,
    correction: Vec<f64>,
}

/// The numbers that fill the matrix.
pub struct KktValues<'a> {
    pub hessian: &'a Sparse,
    pub metric: &'a Sparse,
    /// δ
    pub damping: f64,
    pub equalities: &'a Sparse,
    pub inequalities: &'a Sparse,
    pub rows: Rows<'a>,
    /// Size of the entries of r_x that count as much as 1 in the other rows.
    pub unit: f64,
}

/// What becomes of the inequality rows.
#[derive(Clone, Copy, Debug)]
pub enum Rows<'a> {
    /// Equations for the active ones, nothing for the others.
    Active(&'a [bool]),
    /// All kept, with `−weight` on the diagonal.
    Weighted(&'a [f64]),
}

impl Rows<'_> {
    /// Whether the row stays in the matrix, and its diagonal entry.
    fn row(&self, row: usize) -> (bool, f64) {
        match self {
            Rows::Active(active) if active[row] => (true, 0.0),
            Rows::Active(_) => (false, -1.0),
            Rows::Weighted(weights) => (true, -weights[row]),
        }
    }
}

impl Kkt {
    /// Analyses the patterns of a problem.
    pub fn new(problem: &dyn Problem) -> Self {
        let [equalities, inequalities, hessian] = problem.patterns();
        let n = hessian.columns;
        let (me, mi) = (equalities.rows, inequalities.rows);
        let order = n + me + mi;
        let mut pattern = Pattern::new(order, order);
        hessian.entries().for_each(|(i, j, _)| pattern.add(i, j));
        equalities.entries().for_each(|(i, j, _)| pattern.add(j, n + i));
        inequalities.entries().for_each(|(i, j, _)| pattern.add(j, n + me + i));
        (0..order).for_each(|i| pattern.add(i, i));
        let matrix = pattern.build();
        let slot = |i: usize, j: usize| u32::try_from(pattern.slot(i, j)).expect("fewer entries");
        let [equality_stages, inequality_stages] = problem.constraint_stages();
        let stage = [problem.stages(), equality_stages, inequality_stages].concat();
        Self {
            variables: n,
            equalities: me,
            hessian_slots: hessian.entries().map(|(i, j, _)| slot(i, j)).collect(),
            equality_slots: equalities.entries().map(|(i, j, _)| slot(j, n + i)).collect(),
            inequality_slots: inequalities.entries().map(|(i, j, _)| slot(j, n + me + i)).collect(),
            diagonal_slots: (0..order).map(|i| slot(i, i)).collect(),
            active: vec![false; mi],
            primal: 0.0,
            unit: 1.0,
            factors: StagedLdl::new(&matrix, &stage, n..n + me, n + me..order),
            matrix,
            deadline: Deadline::default(),
            factorisations: 0,
            is_accurate: false,
            residual: vec![0.0; order],
            correction: vec![0.0; order],
        }
    }

    /// Bytes that the factors take at least.
    pub fn bytes(&self) -> usize {
        self.factors.bytes()
    }

    pub fn order(&self) -> usize {
        self.diagonal_slots.len()
    }

    /// Fills and factorises the matrix. `None` if a pivot vanishes, a value is not finite or the deadline has passed.
    pub fn factorise(&mut self, values: &KktValues<'_>) -> Option<Inertia> {
        self.fill(values).then(|| self.factors.factorise(&self.matrix.values)).flatten()
    }

    /// Factorises and, where the Hessian is positive definite on the null space of the rows kept, solves as
    /// [`Kkt::solve_roughly`] does, in less time than one after the other. `None`, as soon as the pivots show it, where
    /// it is not.
    pub fn solve_convex(
        &mut self,
        values: &KktValues<'_>,
        right_hand_side: &[f64],
        solution: &mut [f64],
    ) -> Option<f64> {
        if !self.fill(values) {
            return None;
        }
        self.choose(right_hand_side, solution);
        self.factors.solve_convex(&self.matrix.values, solution).then(|| {
            self.correction.copy_from_slice(solution);
            self.refine(right_hand_side, solution, 1.0, false, ROUGH)
        })
    }

    /// Fills the matrix, unless the deadline has passed.
    fn fill(&mut self, values: &KktValues<'_>) -> bool {
        if self.deadline.passed() {
            return false;
        }
        self.factors.deadline = self.deadline;
        self.factorisations += 1;
        self.is_accurate = false;
        self.unit = values.unit;
        let (n, me) = (self.variables, self.equalities);
        self.primal = (PRIMAL * values.damping).clamp(PRIMAL_RANGE.0, PRIMAL_RANGE.1);
        let matrix = &mut self.matrix.values;
        // Of the variables' diagonal the Hessian may have only some.
        self.diagonal_slots[..n].iter().for_each(|&slot| matrix[slot as usize] = 0.0);
        for (k, &slot) in self.hessian_slots.iter().enumerate() {
            matrix[slot as usize] = values.hessian.values[k] + values.damping * values.metric.values[k];
        }
        self.diagonal_slots[..n].iter().for_each(|&slot| matrix[slot as usize] += self.primal);
        for (&slot, value) in self.equality_slots.iter().zip(&values.equalities.values) {
            matrix[slot as usize] = *value;
        }
        self.diagonal_slots[n..n + me].iter().for_each(|&slot| matrix[slot as usize] = -DUAL);
        for (k, (row, _, _)) in values.inequalities.entries().enumerate() {
            let kept = values.rows.row(row).0;
            matrix[self.inequality_slots[k] as usize] = if kept { values.inequalities.values[k] } else { 0.0 };
        }
        for (row, &slot) in self.diagonal_slots[n + me..].iter().enumerate() {
            let (kept, diagonal) = values.rows.row(row);
            self.active[row] = kept;
            matrix[slot as usize] = diagonal - DUAL;
        }
        true
    }

    /// Solves for `solution` with iterative refinement; entries of `right_hand_side` in rows that are not active are
    /// ignored. Returns the residual's largest entry relative to that of the right-hand side: large where the active
    /// constraints contradict each other.
    pub fn solve(&mut self, right_hand_side: &[f64], solution: &mut [f64]) -> f64 {
        self.begin(right_hand_side, solution);
        self.refine(right_hand_side, solution, 1.0, false, EXACT)
    }

    /// Goes on from what [`Kkt::solve_roughly`] has left.
    pub fn solve_further(&mut self, right_hand_side: &[f64], solution: &mut [f64]) -> f64 {
        self.refine(right_hand_side, solution, f64::INFINITY, false, EXACT)
    }

    /// [`Kkt::solve`] to a residual small enough for a step that is corrected by the next one. Where the last such
    /// solution with the same factorisation needed no refinement this one is not looked at, and its residual taken for
    /// as small.
    pub fn solve_roughly(&mut self, right_hand_side: &[f64], solution: &mut [f64]) -> f64 {
        self.begin(right_hand_side, solution);
        if self.is_accurate { ROUGH } else { self.refine(right_hand_side, solution, 1.0, false, ROUGH) }
    }

    /// [`Kkt::solve`] with ε left in. Where active constraints contradict each other this has a solution, with large
    /// multipliers whose signs tell which of them to let go.
    pub fn solve_regularised(&mut self, right_hand_side: &[f64], solution: &mut [f64]) -> f64 {
        self.begin(right_hand_side, solution);
        self.refine(right_hand_side, solution, 1.0, true, EXACT)
    }

    /// The right-hand side without rows that are not active.
    fn choose(&self, right_hand_side: &[f64], chosen: &mut [f64]) {
        chosen.copy_from_slice(right_hand_side);
        let rows = chosen[self.variables + self.equalities..].iter_mut().zip(&self.active);
        rows.filter(|(_, active)| !**active).for_each(|(x, _)| *x = 0.0);
    }

    /// A first solution, with what it has changed from none.
    fn begin(&mut self, right_hand_side: &[f64], solution: &mut [f64]) {
        self.choose(right_hand_side, solution);
        self.factors.solve(solution);
        self.correction.copy_from_slice(solution);
    }

    /// Corrects the solution until its residual is small `enough` or no longer halves, `best` being that before the
    /// last correction.
    fn refine(
        &mut self,
        right_hand_side: &[f64],
        solution: &mut [f64],
        mut best: f64,
        regularised: bool,
        enough: f64,
    ) -> f64 {
        let n = self.variables + self.equalities;
        let right = |i: usize, active: &[bool]| if i < n || active[i - n] { right_hand_side[i] } else { 0.0 };
        let (variables, unit) = (self.variables, self.unit);
        let weighted = |(i, x): (usize, f64)| if i < variables { x.abs() / unit } else { x.abs() };
        let all = (0..self.order()).map(|i| (i, right(i, &self.active)));
        let scale = all.map(weighted).fold(0.0, f64::max).max(1e-300);
        for refinement in 0..REFINEMENTS {
            for i in 0..self.order() {
                self.residual[i] = right(i, &self.active);
            }
            self.matrix.add_symmetric_product(-1.0, solution, &mut self.residual);
            if !regularised {
                let (of_variables, of_rows) = self.residual.split_at_mut(self.variables);
                let (x, y) = solution.split_at(self.variables);
                of_variables.iter_mut().zip(x).for_each(|(r, x)| *r += self.primal * x);
                of_rows.iter_mut().zip(y).for_each(|(r, y)| *r -= DUAL * y);
            }
            let size = self.residual.iter().copied().enumerate().map(weighted).fold(0.0, f64::max) / scale;
            if size.is_nan() || size >= 0.5 * best {
                if size < best {
                    return size;
                }
                // The last correction did harm or nothing: take it back.
                if best.is_finite() {
                    solution.iter_mut().zip(&self.correction).for_each(|(x, d)| *x -= d);
                }
                return best;
            }
            best = size;
            if size < enough {
                self.is_accurate = refinement == 0 && enough == ROUGH;
                return size;
            }
            self.correction.copy_from_slice(&self.residual);
            self.factors.solve(&mut self.correction);
            solution.iter_mut().zip(&self.correction).for_each(|(x, d)| *x += d);
        }
        best
    }
}
