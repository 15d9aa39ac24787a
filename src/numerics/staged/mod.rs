//! Multifrontal L D Lᵀ factorisation of a sparse symmetric indefinite matrix whose unknowns belong to stages (instants
//! in time) that couple only to nearby stages. Work and memory are linear in the number of stages.
//!
//! The dense fronts form a tree: a chain along the stages and, within each stage, small fronts for groups of unknowns
//! (such as those of one muscle) that couple to one another only through the remaining unknowns of the stage:
//!
//! ```text
//!            delayed    own     border: later unknowns coupled so far
//!          ⎡    ·         ·         ·   ⎤
//!   F  =   ⎢    ·         ·         ·   ⎥   pivots come only from the first two groups
//!          ⎣    ·         ·         ·   ⎦
//! ```
//!
//! Pivots of order 1 and 2 must pass a threshold test against their whole columns; unknowns without an acceptable pivot
//! are delayed to the parent front. This keeps the factors bounded without regularisation (Duff and Reid, *The
//! multifrontal solution of indefinite sparse symmetric linear equations*, ACM TOMS 9, 1983). By Sylvester's law of
//! inertia, the signs of the pivots are the signs of the eigenvalues.
//!
//! If the leading fronts have the same entries as in the previous factorisation, they are reused and only the rest is
//! refactorised ([`checkpoint`]); the result is bitwise the same.

mod analysis;
mod checkpoint;
mod front;

use std::ops::Range;
use std::sync::Arc;

use self::analysis::{FrontPattern, Fronts, fronts};
use self::checkpoint::Checkpoints;
use self::front::{LANE, Lane, Panel, Pivot, flat, flat_mut, lanes};
use super::memo::Memo;
use super::sparse::Sparse;
use crate::deadline::Deadline;

/// Least pivot whose inverse is far from overflow.
const LEAST_PIVOT: f64 = 1e-30;
const EQUILIBRATION_PASSES: usize = 2;
const ZERO: Lane = Lane([0.0; LANE]);

/// Numbers of positive and negative eigenvalues. The remaining ones are zero to working precision.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Inertia {
    pub positive: usize,
    pub negative: usize,
}

/// Contribution block of a front to its parent: the rows of its delayed unknowns, and the Schur complement on its
/// border.
#[derive(Clone, Debug, Default)]
struct Contribution {
    /// Index of the front.
    front: usize,
    /// Unknowns that had no acceptable pivot.
    delayed: Vec<u32>,
    /// Rows of the delayed unknowns, one after the other; columns: the delayed unknowns, then the border.
    rows: Vec<f64>,
    /// Upper triangle of the border block, `lanes(border)` lanes per row; empty if it is zero.
    border: Vec<Lane>,
    /// Number of negative eigenvalues minus number of duals among the unknowns eliminated in the front's subtree.
    excess: isize,
}

impl Contribution {
    /// Copies `other`, reusing the allocated memory.
    fn copy_from(&mut self, other: &Self) {
        self.front = other.front;
        self.delayed.clone_from(&other.delayed);
        self.rows.clone_from(&other.rows);
        self.border.clone_from(&other.border);
        self.excess = other.excess;
    }
}

/// The numeric factors. For each front with at least one pivot: its unknowns in elimination order, and the rows of D Lᵀ
/// to the right of the pivots. Each row is stored in whole lanes, from the lane of its pivot on, with zeros up to and
/// including the pivot block.
#[derive(Clone, Debug, Default)]
struct Factors {
    /// Unknowns coupled to nothing, each with the inverse of its diagonal entry.
    uncoupled: Vec<(usize, f64)>,
    pivots: Vec<Pivot>,
    unknowns: Vec<u32>,
    rows: Vec<Lane>,
    fronts: Vec<FrontEnd>,
    /// Sum of zero times the rows: NaN once any entry is not finite.
    zeros: Lane,
}

/// Where a front with pivots ends in the lists of [`Factors`], and the size of its border.
#[derive(Clone, Copy, Debug, Default)]
struct FrontEnd {
    pivots: usize,
    unknowns: usize,
    rows: usize,
    border: usize,
}

/// The part of [`Factors`] that belongs to one front.
struct FrontFactors<'f> {
    pivots: &'f [Pivot],
    /// Fully summed unknowns, and the border.
    unknowns: [&'f [u32]; 2],
    rows: &'f [Lane],
}

impl Factors {
    /// Keeps only the first `fronts` fronts with pivots and the first `uncoupled` uncoupled unknowns.
    fn truncate(&mut self, fronts: usize, uncoupled: usize) {
        self.fronts.truncate(fronts);
        self.uncoupled.truncate(uncoupled);
        let end = self.fronts.last().copied().unwrap_or_default();
        self.pivots.truncate(end.pivots);
        self.unknowns.truncate(end.unknowns);
        self.rows.truncate(end.rows);
    }

    fn is_finite(&self) -> bool {
        self.zeros.0.iter().all(|zero| !zero.is_nan())
    }

    fn front(&self, f: usize) -> FrontFactors<'_> {
        let start = if f == 0 { FrontEnd::default() } else { self.fronts[f - 1] };
        let end = self.fronts[f];
        let (summed, border) =
            self.unknowns[start.unknowns..end.unknowns].split_at(end.unknowns - end.border - start.unknowns);
        FrontFactors {
            pivots: &self.pivots[start.pivots..end.pivots],
            unknowns: [summed, border],
            rows: &self.rows[start.rows..end.rows],
        }
    }

    /// Appends the rows of `pivots` from a panel.
    fn keep(&mut self, panel: &Panel<'_>, pivots: &[Pivot]) {
        let mut zeros = self.zeros;
        for pivot in pivots {
            for row in pivot.row..pivot.end() {
                let start = self.rows.len();
                let row = &panel.values[row * panel.width..][pivot.row / LANE..panel.width];
                for lane in row {
                    zeros.0.iter_mut().zip(lane.0).for_each(|(zero, value)| *zero += 0.0 * value);
                }
                self.rows.extend_from_slice(row);
                let kept = flat_mut(&mut self.rows[start..]);
                kept[..pivot.end() - pivot.row / LANE * LANE].fill(0.0);
            }
        }
        self.zeros = zeros;
        self.pivots.extend_from_slice(pivots);
    }
}

impl FrontFactors<'_> {
    /// Applies `change` to the front's part of x, gathered into lanes in `local` and scattered back.
    fn apply(&self, change: fn(&[Pivot], &[Lane], &mut [Lane]), x: &mut [f64], local: &mut Vec<Lane>) {
        let [summed, border] = self.unknowns;
        local.clear();
        local.resize(lanes(summed.len()) + lanes(border.len()), ZERO);
        let (head, tail) = local.split_at_mut(lanes(summed.len()));
        summed.iter().zip(flat_mut(head)).for_each(|(&i, to)| *to = x[i as usize]);
        border.iter().zip(flat_mut(tail)).for_each(|(&i, to)| *to = x[i as usize]);
        change(self.pivots, self.rows, local);
        let (head, tail) = local.split_at(lanes(summed.len()));
        summed.iter().zip(flat(head)).for_each(|(&i, from)| x[i as usize] = *from);
        border.iter().zip(flat(tail)).for_each(|(&i, from)| x[i as usize] = *from);
    }
}

/// The factorisation: one symbolic analysis, and a numeric factorisation whenever the values change.
#[derive(Clone, Debug)]
pub struct StagedLdl {
    /// Compressed sparse columns: start of each column, and row of each value.
    column_start: Arc<[usize]>,
    rows: Arc<[u32]>,
    /// Diagonal scaling S; the factorised matrix is S K S.
    scale: Vec<f64>,
    fronts: Arc<Fronts>,
    /// The ranges `equations` and `loose`; see [`StagedLdl::new`].
    duals: [Range<usize>; 2],
    factors: Factors,
    checkpoints: Checkpoints,
    work: Work,
    /// Once this has passed, a factorisation stops without a result.
    pub deadline: Deadline,
}

/// Workspace of the numeric factorisation.
#[derive(Clone, Debug, Default)]
struct Work {
    /// A stack: the first `pending` entries await assembly into their parent front.
    contributions: Vec<Contribution>,
    pending: usize,
    panel: Vec<Lane>,
    border: Vec<Lane>,
    scaled: Vec<Lane>,
    pivots: Vec<Pivot>,
    unknowns: Vec<u32>,
    /// For each unknown in the front's pattern: its column in the front, and its entry of S.
    column: Vec<usize>,
    scale: Vec<f64>,
    /// Column in the front of each unknown of a child's contribution.
    target: Vec<usize>,
    /// Largest entry of each row during equilibration.
    largest: Vec<f64>,
    /// A front's part of a right-hand side.
    local: Vec<Lane>,
}

/// Column of an unknown that is left out of its front.
const ABSENT: usize = usize::MAX;

/// Patterns with more entries than this are not cached.
const MAX_CACHED_ENTRIES: usize = 200_000;

/// [`fronts`], cached for the patterns seen most recently.
fn shared_fronts(matrix: &Sparse, stage: &[usize], equations: Range<usize>, loose: Range<usize>) -> Arc<Fronts> {
    type Shape = (Arc<[usize]>, Arc<[u32]>, Vec<usize>, [Range<usize>; 2]);
    static CACHE: Memo<Shape, Arc<Fronts>> = Memo::new();
    let analyse = || fronts(matrix, stage, equations.clone(), loose.clone()).into();
    if matrix.values.len() > MAX_CACHED_ENTRIES {
        return analyse();
    }
    let (columns, rows) = (matrix.column_start.clone(), matrix.row_index.clone());
    CACHE.get((columns, rows, stage.to_vec(), [equations.clone(), loose.clone()]), analyse)
}

impl StagedLdl {
    /// Analyses the pattern of `matrix` (upper triangle); `stage[i]` is the stage of unknown i, counted from 0.
    ///
    /// The duals (multipliers) are two ranges of unknowns: `equations` have a zero or negligible diagonal
    /// entry; `loose` ones may be uncoupled, that is, have nothing but their diagonal entry (multipliers of inactive
    /// inequalities).
    pub fn new(matrix: &Sparse, stage: &[usize], equations: Range<usize>, loose: Range<usize>) -> Self {
        Self {
            column_start: matrix.column_start.clone(),
            rows: matrix.row_index.clone(),
            scale: vec![1.0; matrix.columns],
            fronts: shared_fronts(matrix, stage, equations.clone(), loose.clone()),
            duals: [equations, loose],
            factors: Factors::default(),
            checkpoints: Checkpoints::default(),
            work: Work::default(),
            deadline: Deadline::default(),
        }
    }

    /// Least number of bytes that a factorisation needs.
    pub fn bytes(&self) -> usize {
        self.fronts.bytes()
    }

    /// Factorises the matrix with these values in the analysed pattern. `None` if a value is not finite or the deadline
    /// passes.
    pub fn factorise(&mut self, values: &[f64]) -> Option<Inertia> {
        if self.eliminate(values, None) { self.inertia() } else { None }
    }

    /// Factorises the matrix and tests whether the number of positive eigenvalues is the order minus the number of
    /// duals. If so, solves for `x` in place and returns true; forward substitution runs during the factorisation,
    /// while each front is still in cache. Otherwise stops as soon as the pivots rule that inertia out, leaving no
    /// usable factors.
    ///
    /// Why stopping early is safe: if the block of the duals is negative definite, the inertia of the matrix is that of
    /// this block plus that of its Schur complement. Each dual outside a principal submatrix accounts for at most one
    /// of its negative eigenvalues (interlacing).
    pub fn solve_convex(&mut self, values: &[f64], x: &mut [f64]) -> bool {
        let duals: usize = self.duals.iter().map(Range::len).sum();
        let is_convex = self.eliminate(values, Some(x))
            && self.inertia().is_some_and(|inertia| inertia.positive == self.scale.len() - duals);
        if is_convex {
            self.backward(x);
        }
        is_convex
    }

    /// Reuses the leading fronts whose entries have not changed and refactorises the rest. Returns false if the
    /// deadline passes. Given a right-hand side, also solves with S and L on the way, and returns false once more
    /// eigenvalues are negative than the remaining duals account for.
    fn eliminate(&mut self, values: &[f64], mut right: Option<&mut [f64]>) -> bool {
        self.equilibrate(values);
        let Self { fronts, scale, duals, factors, checkpoints, work, .. } = self;
        let reused = checkpoints.resume(fronts, (values, scale), factors, work);
        if let Some(x) = &mut right {
            x.iter_mut().zip(&*scale).for_each(|(x, scale)| *x *= scale);
            (0..factors.fronts.len()).for_each(|f| factors.front(f).apply(front::forward, x, &mut work.local));
        }
        let deadline = self.deadline;
        (reused..fronts.len()).all(|f| {
            if deadline.passed() {
                return false;
            }
            let before = factors.fronts.len();
            work.factorise((fronts, f), (values, scale), duals, factors, &mut checkpoints.entries);
            checkpoints.record(f + 1, factors, &work.contributions[..work.pending]);
            let Some(x) = &mut right else { return true };
            (before..factors.fronts.len()).for_each(|f| factors.front(f).apply(front::forward, x, &mut work.local));
            let contribution = &work.contributions[work.pending - 1];
            let duals_left = || count_duals(duals, contribution.delayed.iter().chain(fronts.get(f).border()));
            contribution.excess <= 0 || contribution.excess <= duals_left()
        })
    }

    /// Chooses S such that the largest entry of each row of S K S is near 1 (D. Ruiz, RAL-TR-2001-034), so that the
    /// pivot test compares entries of similar size. The signs of the eigenvalues do not change.
    fn equilibrate(&mut self, values: &[f64]) {
        let Self { scale, rows, column_start, work: Work { largest, .. }, .. } = self;
        scale.fill(1.0);
        for _ in 0..EQUILIBRATION_PASSES {
            largest.clear();
            largest.resize(scale.len(), 0.0f64);
            for (j, column) in column_start.windows(2).enumerate() {
                let (column_scale, mut column_largest) = (scale[j], largest[j]);
                for (&i, value) in rows[column[0]..column[1]].iter().zip(&values[column[0]..column[1]]) {
                    let size = (value * scale[i as usize] * column_scale).abs();
                    let row_largest = &mut largest[i as usize];
                    *row_largest = if size > *row_largest { size } else { *row_largest };
                    column_largest = if size > column_largest { size } else { column_largest };
                }
                largest[j] = if column_largest > largest[j] { column_largest } else { largest[j] };
            }
            for (scale, largest) in scale.iter_mut().zip(&*largest) {
                if *largest > 0.0 {
                    *scale /= largest.sqrt();
                }
            }
        }
    }

    /// The inertia, from the signs of the pivots. `None` if a factor is not finite.
    fn inertia(&self) -> Option<Inertia> {
        let mut inertia = Inertia { positive: 0, negative: 0 };
        let Factors { uncoupled, pivots, .. } = &self.factors;
        let uncoupled =
            uncoupled.iter().map(|&(_, inverse)| Pivot { row: 0, two: false, inverse: [inverse, 0.0, 0.0] });
        for pivot in uncoupled.chain(pivots.iter().copied()) {
            let (positive, negative) = pivot.signs()?;
            inertia.positive += positive;
            inertia.negative += negative;
        }
        self.factors.is_finite().then_some(inertia)
    }

    /// Solves in place with the latest factorisation.
    pub fn solve(&mut self, x: &mut [f64]) {
        debug_assert_eq!(x.len(), self.scale.len());
        let Self { scale, factors, work: Work { local, .. }, .. } = self;
        x.iter_mut().zip(&*scale).for_each(|(x, scale)| *x *= scale);
        (0..factors.fronts.len()).for_each(|f| factors.front(f).apply(front::forward, x, local));
        self.backward(x);
    }

    /// The second half of a solve: backward substitution with D, Lᵀ and S.
    fn backward(&mut self, x: &mut [f64]) {
        let Self { scale, factors, work: Work { local, .. }, .. } = self;
        for &(i, inverse) in &factors.uncoupled {
            x[i] *= inverse;
        }
        (0..factors.fronts.len()).rev().for_each(|f| factors.front(f).apply(front::backward, x, local));
        x.iter_mut().zip(&*scale).for_each(|(x, scale)| *x *= scale);
    }
}

/// Number of duals among `unknowns`.
fn count_duals<'a>(duals: &[Range<usize>; 2], unknowns: impl IntoIterator<Item = &'a u32>) -> isize {
    unknowns.into_iter().filter(|i| duals.iter().any(|of| of.contains(&(**i as usize)))).count() as isize
}

impl Work {
    /// Assembles front `f` from the contributions of its children and its own entries (appended to `entries`),
    /// factorises it, and leaves its contribution as the last pending one.
    fn factorise(
        &mut self,
        (fronts, f): (&Fronts, usize),
        (values, scale): (&[f64], &[f64]),
        duals: &[Range<usize>; 2],
        factors: &mut Factors,
        entries: &mut Vec<f64>,
    ) {
        let pattern = fronts.get(f);
        let first = self.pending - pattern.children;
        self.arrange((fronts, pattern), (values, scale), first, factors);
        let (summed, border) = (self.unknowns.len(), pattern.border().len());
        let start = lanes(summed);
        let width = start + lanes(border);
        self.panel.clear();
        self.panel.resize(summed * width, ZERO);
        self.border.clear();
        let has_border_block =
            self.contributions[first..self.pending].iter().any(|contribution| !contribution.border.is_empty());
        if has_border_block {
            self.border.resize(lanes(border) * LANE * lanes(border), ZERO);
        }
        self.extend_add(fronts, first, width, start * LANE);
        let panel = flat_mut(&mut self.panel);
        let before = entries.len();
        entries.extend(pattern.entries.iter().map(|entry| entry.value(values, &self.scale)));
        for (entry, value) in pattern.entries.iter().zip(&entries[before..]) {
            let [row, column] = entry.places().map(|place| self.column[place]);
            if row != ABSENT && column != ABSENT {
                panel[row * width * LANE + column] += value;
            }
        }
        // The fully summed block is stored in full.
        for i in 0..summed {
            let (above, below) = panel.split_at_mut((i + 1) * width * LANE);
            let row = &above[i * width * LANE..][i + 1..summed];
            below.chunks_exact_mut(width * LANE).zip(row).for_each(|(below, value)| below[i] = *value);
        }
        self.pivots.clear();
        let mut panel = Panel { values: &mut self.panel, width, unknowns: &mut self.unknowns };
        // An unknown coupled to one other only changes that one's diagonal entry: any pivot will do, such as that of the bound of
        // a variable, however small.
        let is_of_one = summed == 1 && border == 1 && flat(panel.values)[0].abs() > LEAST_PIVOT;
        let takes_all = f + 1 == fronts.len() || is_of_one;
        let eliminated = if summed > 0 { front::eliminate(&mut panel, takes_all, &mut self.pivots) } else { 0 };
        if eliminated > 0 {
            if border > 0 {
                self.border.resize(lanes(border) * LANE * lanes(border), ZERO);
                front::update_border(&mut self.border, &panel, start, &self.pivots, &mut self.scaled);
            }
            factors.keep(&panel, &self.pivots);
            factors.unknowns.extend_from_slice(&self.unknowns);
            factors.unknowns.extend_from_slice(pattern.border());
            factors.fronts.push(FrontEnd {
                pivots: factors.pivots.len(),
                unknowns: factors.unknowns.len(),
                rows: factors.rows.len(),
                border,
            });
        }
        let excess =
            self.contributions[first..self.pending].iter().map(|contribution| contribution.excess).sum::<isize>();
        self.pending = first + 1;
        self.contributions.resize_with(self.contributions.len().max(self.pending), Contribution::default);
        let contribution = &mut self.contributions[first];
        contribution.front = f;
        contribution.delayed.clear();
        contribution.delayed.extend_from_slice(&self.unknowns[eliminated..]);
        contribution.rows.clear();
        for row in self.panel.chunks_exact(width.max(1)).skip(eliminated) {
            let (own, border_row) = row.split_at(start);
            contribution.rows.extend_from_slice(&flat(own)[eliminated..summed]);
            contribution.rows.extend_from_slice(&flat(border_row)[..border]);
        }
        std::mem::swap(&mut contribution.border, &mut self.border);
        let negative =
            self.pivots.iter().filter_map(Pivot::signs).map(|(_, negative)| negative as isize).sum::<isize>();
        contribution.excess = excess + negative - count_duals(duals, &self.unknowns[..eliminated]);
    }

    /// Lists the fully summed unknowns of the front and assigns a column to each unknown; delayed ones come first. Own
    /// unknowns that nothing couples at present (multipliers of inactive inequalities) are left out of the front.
    fn arrange(
        &mut self,
        (fronts, pattern): (&Fronts, FrontPattern<'_>),
        (values, scale): (&[f64], &[f64]),
        first: usize,
        factors: &mut Factors,
    ) {
        let own = pattern.own;
        let Self { contributions, unknowns, column, .. } = self;
        self.scale.clear();
        self.scale.extend(pattern.unknowns.iter().map(|&i| scale[i as usize]));
        column.clear();
        column.resize(pattern.unknowns.len(), 0);
        let contributions = &contributions[first..self.pending];
        // Coupled unknowns get 0 for now: anything but `ABSENT`.
        pattern.loose.iter().for_each(|entry| column[entry.places()[0]] = ABSENT);
        for contribution in contributions {
            fronts.get(contribution.front).places.iter().for_each(|&place| column[usize::from(place)] = 0);
        }
        for coupling in pattern.couplings {
            if values[coupling.slot()] != 0.0 {
                coupling.places().into_iter().for_each(|place| column[place] = 0);
            }
        }
        for entry in pattern.loose {
            let [place, _] = entry.places();
            if column[place] == ABSENT {
                factors.uncoupled.push((pattern.unknowns[place] as usize, 1.0 / entry.value(values, &self.scale)));
            }
        }
        unknowns.clear();
        contributions.iter().for_each(|contribution| unknowns.extend_from_slice(&contribution.delayed));
        for (&i, column) in pattern.unknowns.iter().zip(&mut column[..own]) {
            if *column != ABSENT {
                *column = unknowns.len();
                unknowns.push(i);
            }
        }
        let start = lanes(unknowns.len()) * LANE;
        column[own..].iter_mut().enumerate().for_each(|(j, column)| *column = start + j);
    }

    /// Extend-add: adds the pending contributions from `first` on to this front, whose border begins at column `start`.
    fn extend_add(&mut self, fronts: &Fronts, first: usize, width: usize, start: usize) {
        let (panel, border) = (flat_mut(&mut self.panel), flat_mut(&mut self.border));
        let (width, border_width) = (width * LANE, width * LANE - start);
        let mut delayed = 0;
        for contribution in &self.contributions[first..self.pending] {
            let places = fronts.get(contribution.front).places;
            let target = &mut self.target;
            target.clear();
            target.extend(delayed..delayed + contribution.delayed.len());
            target.extend(places.iter().map(|&place| self.column[usize::from(place)]));
            let own = contribution.delayed.len();
            for (i, row) in contribution.rows.chunks_exact(target.len().max(1)).enumerate() {
                let out = &mut panel[(delayed + i) * width..][..width];
                target[i..].iter().zip(&row[i..]).for_each(|(&j, value)| out[j] += *value);
            }
            let contribution_width = lanes(places.len()) * LANE;
            for (i, row) in
                flat(&contribution.border).chunks_exact(contribution_width.max(1)).take(places.len()).enumerate()
            {
                let (row, target) = (&row[i..], &target[own + i..]);
                let to = target[0];
                let out = if to < start {
                    &mut panel[to * width..][..width]
                } else {
                    &mut border[(to - start) * border_width..][..border_width]
                };
                let shift = if to < start { 0 } else { start };
                target.iter().zip(row).for_each(|(&j, value)| out[j - shift] += *value);
            }
            delayed += own;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    /// A random saddle-point matrix with `each` unknowns in each of `stages` stages; two fifths of them have a zero
    /// diagonal block.
    fn matrix(rng: &mut impl rand::Rng, stages: usize, each: usize) -> (Sparse, Vec<usize>) {
        let stage: Vec<usize> = (0..each * stages).map(|i| i / each).collect();
        let mut triplets = Vec::new();
        for i in 0..each * stages {
            for j in i..each * stages {
                let dual = |k: usize| 5 * (k % each) >= 3 * each;
                if stage[j] - stage[i] <= 2 && !(dual(i) && dual(j)) && rng.random_range(0.0..1.0) < 0.7 {
                    triplets.push((i, j, rng.random_range(-1.0..1.0)));
                }
            }
        }
        (Sparse::from_triplets(each * stages, each * stages, &triplets), stage)
    }

    #[test]
    fn unknowns_coupled_only_by_zeros_are_solved_separately() {
        let matrix = Sparse::from_triplets(3, 3, &[(0, 0, 2.0), (0, 1, 0.0), (1, 1, -4.0), (2, 2, 1.0)]);
        for (loose, uncoupled) in [(0..3, 3), (1..3, 2), (0..0, 0)] {
            let mut ldl = StagedLdl::new(&matrix, &[0, 0, 1], 0..0, loose);
            assert_eq!(ldl.factorise(&matrix.values), Some(Inertia { positive: 2, negative: 1 }));
            assert_eq!(ldl.factors.uncoupled.len(), uncoupled);
            let mut x = [1.0, 1.0, 1.0];
            ldl.solve(&mut x);
            assert_eq!(x, [0.5, -0.25, 1.0]);
        }
    }

    #[test]
    fn solve_convex_fails_exactly_if_the_inertia_is_wrong() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(8);
        let stages = 12;
        let (variables, duals) = (4 * stages, 2 * stages);
        let stage: Vec<usize> = (0..variables).map(|i| i / 4).chain((0..duals).map(|i| i / 2)).collect();
        let mut outcomes = [0, 0];
        let mut stopped_early = 0;
        for trial in 0..60 {
            let mut triplets: Vec<_> = (variables..variables + duals).map(|i| (i, i, -1e-3)).collect();
            for j in 0..variables + duals {
                for i in 0..variables.min(j + 1) {
                    if stage[i].abs_diff(stage[j]) <= 1 {
                        let shift = if i == j { 0.1 * f64::from(trial) } else { 0.0 };
                        triplets.push((i, j, shift + rng.random_range(-1.0..1.0)));
                    }
                }
            }
            let matrix = Sparse::from_triplets(variables + duals, variables + duals, &triplets);
            let equations = variables..variables + stages;
            let mut ldl = StagedLdl::new(&matrix, &stage, equations.clone(), equations.end..variables + duals);
            let right: Vec<f64> = (0..matrix.columns).map(|_| rng.random_range(-1.0..1.0)).collect();
            let mut x = right.clone();
            let is_convex = ldl.solve_convex(&matrix.values, &mut x);
            stopped_early += usize::from(ldl.factors.fronts.len() < ldl.fronts.len() / 2);
            let inertia = ldl.factorise(&matrix.values).unwrap();
            assert_eq!(is_convex, inertia.positive == variables, "{trial}");
            if is_convex {
                let mut again = right;
                ldl.solve(&mut again);
                assert_eq!(x, again, "{trial}");
            }
            outcomes[usize::from(is_convex)] += 1;
        }
        assert!(outcomes.iter().all(|count| *count > 10) && stopped_early > 5, "{outcomes:?}, {stopped_early}");
    }

    #[test]
    fn refactorising_changed_fronts_gives_the_same_numbers() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(9);
        let stages = 300;
        let (mut matrix, stage) = matrix(&mut rng, stages, 5);
        let (n, analysed) = (matrix.columns, matrix.clone());
        let new = || StagedLdl::new(&analysed, &stage, 0..0, n / 2..n);
        let mut ldl = new();
        assert!(ldl.factorise(&matrix.values).is_some());
        let at = |s: usize| analysed.entries().find(|&(i, j, _)| i == j && stage[i] == s).unwrap().2;
        // Elimination runs from the last stage to the first.
        for (changed, least, most) in [(0, 200, 300), (150, 75, 150), (stages - 1, 0, 0), (40, 180, 260)] {
            matrix.values[at(changed)] += 1.0;
            let values = &matrix.values;
            ldl.equilibrate(values);
            let StagedLdl { checkpoints, fronts, scale, factors, work, .. } = &mut ldl;
            let reused = checkpoints.resume(fronts, (values, scale), factors, work);
            assert!((least..=most).contains(&reused), "{changed}: {reused}");
            let mut fresh = new();
            assert_eq!(ldl.factorise(values), fresh.factorise(values));
            let mut solutions = [(); 2].map(|()| (0..n).map(|i| (i as f64).sin()).collect::<Vec<f64>>());
            ldl.solve(&mut solutions[0]);
            fresh.solve(&mut solutions[1]);
            assert_eq!(solutions[0], solutions[1], "{changed}");
            // Factors that are not finite are not reused.
            let mut broken = matrix.values.clone();
            broken[at(stages / 3)] = f64::NAN;
            assert_eq!(ldl.factorise(&broken), None);
            assert_eq!(ldl.factorise(values), fresh.factorise(values));
        }
    }

    #[test]
    fn solutions_and_inertia_agree_with_dense_eigenvalues() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(5);
        // In the last case, fronts span many lanes.
        for (stages, each) in [(1, 5), (2, 5), (7, 5), (20, 5), (6, 25)] {
            let (matrix, stage) = matrix(&mut rng, stages, each);
            let n = matrix.columns;
            let mut ldl = StagedLdl::new(&matrix, &stage, 0..0, n / 2..n);
            let inertia = ldl.factorise(&matrix.values).unwrap();
            let mut dense = faer::Mat::<f64>::zeros(n, n);
            for (i, j, slot) in matrix.entries() {
                dense[(i, j)] = matrix.values[slot];
                dense[(j, i)] = matrix.values[slot];
            }
            let eigenvalues = dense.self_adjoint_eigenvalues(faer::Side::Lower).unwrap();
            assert_eq!(inertia.positive, eigenvalues.iter().filter(|e| **e > 0.0).count());
            assert_eq!(inertia.positive + inertia.negative, n);
            let right: Vec<f64> = (0..n).map(|_| rng.random_range(-1.0..1.0)).collect();
            let mut x = right.clone();
            ldl.solve(&mut x);
            let mut residual = right;
            matrix.add_symmetric_product(-1.0, &x, &mut residual);
            let size = x.iter().fold(1.0f64, |a, b| a.max(b.abs()));
            assert!(residual.iter().all(|r| r.abs() < 1e-11 * size), "{stages}");
        }
    }
}
