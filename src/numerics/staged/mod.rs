//! L D Lᵀ of a sparse symmetric indefinite matrix whose unknowns come in stages (time), each coupled only to
//! near stages. Work and memory are linear in the number of stages.
//!
//! Dense fronts in a tree: a chain along the stages, and in each stage small ones for the groups of unknowns (a muscle's)
//! that meet only through the others of their stage:
//!
//! ```text
//!            delayed    own     border: later unknowns met so far
//!          ⎡    ·         ·         ·   ⎤
//!   F  =   ⎢    ·         ·         ·   ⎥   pivots only from the first two groups
//!          ⎣    ·         ·         ·   ⎦
//! ```
//!
//! Pivots of order 1 and 2 must pass a threshold test against their whole columns; those that do not are
//! delayed to the next front. That keeps the factors bounded without regularisation (Duff and Reid, *The
//! multifrontal solution of indefinite sparse symmetric linear equations*, ACM TOMS 9, 1983). By Sylvester's law
//! the signs of the pivots are the signs of the eigenvalues.
//!
//! A matrix that differs from the last one only from some front on is eliminated only from there on ([`checkpoint`]): the numbers are the same.

mod analysis;
mod checkpoint;
mod front;

use std::ops::Range;
use std::sync::Arc;

use self::analysis::{Fronts, Pattern, fronts};
use self::checkpoint::Checkpoints;
use self::front::{LANE, Lane, Panel, Pivot, flat, flat_mut, lanes};
use super::memo::Memo;
use super::sparse::Sparse;
use crate::deadline::Deadline;

const EQUILIBRATIONS: usize = 2;
const ZERO: Lane = Lane([0.0; LANE]);

/// Number of positive and negative eigenvalues; what is missing to the order is zero to working precision.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Inertia {
    pub positive: usize,
    pub negative: usize,
}

/// What is left of a front for the one that takes it in: rows of unknowns that had no acceptable pivot, and its border.
#[derive(Clone, Debug, Default)]
struct Rest {
    /// Which front.
    front: usize,
    delayed: Vec<u32>,
    /// Over the delayed ones, then the border, row by row.
    rows: Vec<f64>,
    /// The upper half, `lanes` of the border a row; empty if it is zero.
    border: Vec<Lane>,
    /// Negative eigenvalues of what has been eliminated, less its duals.
    excess: isize,
}

impl Rest {
    /// Becomes a copy, in the memory it has.
    fn copy_from(&mut self, other: &Self) {
        self.front = other.front;
        self.delayed.clone_from(&other.delayed);
        self.rows.clone_from(&other.rows);
        self.border.clone_from(&other.border);
        self.excess = other.excess;
    }
}

/// The pivots and what they stand for: of each front that has any its unknowns in their last order, and D Lᵀ right of the pivots, row by row, in whole
/// lanes from that of the pivot on; zero up to and in the pivot.
#[derive(Clone, Debug, Default)]
struct Factors {
    /// Unknowns that nothing couples, and the inverses of their entries.
    alone: Vec<(usize, f64)>,
    pivots: Vec<Pivot>,
    unknowns: Vec<u32>,
    rows: Vec<Lane>,
    fronts: Vec<FrontEnd>,
    /// Zero times the rows: not a number once any is not finite.
    zeros: Lane,
}

/// Where a front that has pivots ends in the factors, and how many of its unknowns are its border.
#[derive(Clone, Copy, Debug, Default)]
struct FrontEnd {
    pivots: usize,
    unknowns: usize,
    rows: usize,
    border: usize,
}

/// The part of a front.
struct FrontFactors<'f> {
    pivots: &'f [Pivot],
    /// Those that could be pivots, and the border.
    unknowns: [&'f [u32]; 2],
    rows: &'f [Lane],
}

impl Factors {
    /// Keeps only the first of the fronts that have pivots, and of the unknowns that nothing couples.
    fn truncate(&mut self, fronts: usize, alone: usize) {
        self.fronts.truncate(fronts);
        self.alone.truncate(alone);
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

    /// Keeps the rows of the first `pivots` of a panel.
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
    /// Changes its part of x, which goes into `local` by lanes.
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

/// The factorisation; symbolic once, numeric as often as values change.
#[derive(Clone, Debug)]
pub struct StagedLdl {
    /// Where each column starts, and the row of each value.
    column_start: Arc<[usize]>,
    rows: Arc<[u32]>,
    /// S: what is factorised is S K S.
    scale: Vec<f64>,
    fronts: Arc<Fronts>,
    duals: [Range<usize>; 2],
    factors: Factors,
    checkpoints: Checkpoints,
    work: Work,
    /// A factorisation ends without a result when this passes.
    pub deadline: Deadline,
}

/// Work space of the numeric factorisation.
#[derive(Clone, Debug, Default)]
struct Work {
    /// The first `waiting` are of fronts that are not taken in yet.
    rests: Vec<Rest>,
    waiting: usize,
    panel: Vec<Lane>,
    border: Vec<Lane>,
    scaled: Vec<Lane>,
    pivots: Vec<Pivot>,
    unknowns: Vec<u32>,
    /// The column in the front of each unknown of its pattern, and its S.
    column: Vec<usize>,
    scale: Vec<f64>,
    /// The column of each unknown of a front that is taken in.
    target: Vec<usize>,
    /// Of each row, while it is equilibrated.
    largest: Vec<f64>,
    /// A front's part of a right-hand side.
    local: Vec<Lane>,
}

const ABSENT: usize = usize::MAX;

/// Shapes of problems whose fronts are kept for the next one like it have no more entries than these.
const SHARED: usize = 200_000;

/// [`fronts`], worked out once for all problems of a shape.
fn shared_fronts(matrix: &Sparse, stage: &[usize], equations: Range<usize>, loose: Range<usize>) -> Arc<Fronts> {
    type Shape = (Arc<[usize]>, Arc<[u32]>, Vec<usize>, [Range<usize>; 2]);
    static KNOWN: Memo<Shape, Arc<Fronts>> = Memo::new();
    let work_out = || fronts(matrix, stage, equations.clone(), loose.clone()).into();
    if matrix.values.len() > SHARED {
        return work_out();
    }
    let (columns, rows) = (matrix.column_start.clone(), matrix.row_index.clone());
    KNOWN.get((columns, rows, stage.to_vec(), [equations.clone(), loose.clone()]), work_out)
}

impl StagedLdl {
    /// Analyses the pattern of `matrix` (upper triangle); `stage[i]` is the stage of unknown i, counted from 0. `equations` are unknowns
    /// with nothing on the diagonal, `loose` ones of which some may have nothing else: the duals.
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

    /// Bytes that a factorisation takes at least.
    pub fn bytes(&self) -> usize {
        self.fronts.bytes()
    }

    /// Factorises the matrix with these values in the analysed pattern. `None` if a value is not finite or the deadline passes.
    pub fn factorise(&mut self, values: &[f64]) -> Option<Inertia> {
        if self.eliminate(values, None) { self.inertia() } else { None }
    }

    /// Factorises the matrix and tells whether all but as many eigenvalues as there are duals are positive; if so it solves for `x` in place, half of
    /// that on the way, while what it needs of the factors is at hand. Gives up, with nothing to solve with, as soon as the pivots show that
    /// fewer are.
    ///
    /// With duals that are negative definite by themselves, the eigenvalues are theirs and those of the Schur complement of the others. Of a
    /// principal submatrix of that, the duals outside can turn no more negative ones than they are (interlacing).
    pub fn solve_convex(&mut self, values: &[f64], x: &mut [f64]) -> bool {
        let duals: usize = self.duals.iter().map(Range::len).sum();
        let is_convex = self.eliminate(values, Some(x))
            && self.inertia().is_some_and(|inertia| inertia.positive == self.scale.len() - duals);
        if is_convex {
            self.backward(x);
        }
        is_convex
    }

    /// Eliminates front by front but for the first ones, if they are as they were. With a right-hand side it solves with S and L on the way, and gives up,
    /// returning false, once more eigenvalues are negative than the duals left account for.
    fn eliminate(&mut self, values: &[f64], mut right: Option<&mut [f64]>) -> bool {
        self.equilibrate(values);
        let Self { fronts, scale, duals, factors, checkpoints, work, .. } = self;
        let begin = checkpoints.resume(fronts, (values, scale), factors, work);
        if let Some(x) = &mut right {
            x.iter_mut().zip(&*scale).for_each(|(x, scale)| *x *= scale);
            (0..factors.fronts.len()).for_each(|f| factors.front(f).apply(front::forward, x, &mut work.local));
        }
        let deadline = self.deadline;
        (begin..fronts.len()).all(|f| {
            if deadline.passed() {
                return false;
            }
            let before = factors.fronts.len();
            work.factorise((fronts, f), (values, scale), duals, factors, &mut checkpoints.entries);
            checkpoints.pass(f + 1, factors, &work.rests[..work.waiting]);
            let Some(x) = &mut right else { return true };
            (before..factors.fronts.len()).for_each(|f| factors.front(f).apply(front::forward, x, &mut work.local));
            let rest = &work.rests[work.waiting - 1];
            let duals_left = || count_duals(duals, rest.delayed.iter().chain(fronts.get(f).border()));
            rest.excess <= 0 || rest.excess <= duals_left()
        })
    }

    /// S so that the largest entry of each row of S K S is near 1 (D. Ruiz, RAL-TR-2001-034): pivots are then judged against
    /// entries of like size. The signs of the eigenvalues stay.
    fn equilibrate(&mut self, values: &[f64]) {
        let Self { scale, rows, column_start, work: Work { largest, .. }, .. } = self;
        scale.fill(1.0);
        for _ in 0..EQUILIBRATIONS {
            largest.clear();
            largest.resize(scale.len(), 0.0f64);
            for (j, column) in column_start.windows(2).enumerate() {
                let (of_scale, mut of_column) = (scale[j], largest[j]);
                for (&i, value) in rows[column[0]..column[1]].iter().zip(&values[column[0]..column[1]]) {
                    let size = (value * scale[i as usize] * of_scale).abs();
                    let of_row = &mut largest[i as usize];
                    *of_row = if size > *of_row { size } else { *of_row };
                    of_column = if size > of_column { size } else { of_column };
                }
                largest[j] = if of_column > largest[j] { of_column } else { largest[j] };
            }
            for (scale, largest) in scale.iter_mut().zip(&*largest) {
                if *largest > 0.0 {
                    *scale /= largest.sqrt();
                }
            }
        }
    }

    /// Signs of the eigenvalues, from those of the pivots.
    fn inertia(&self) -> Option<Inertia> {
        let mut inertia = Inertia { positive: 0, negative: 0 };
        let Factors { alone, pivots, .. } = &self.factors;
        let alone = alone.iter().map(|&(_, inverse)| Pivot { row: 0, two: false, inverse: [inverse, 0.0, 0.0] });
        for pivot in alone.chain(pivots.iter().copied()) {
            let (positive, negative) = pivot.signs()?;
            inertia.positive += positive;
            inertia.negative += negative;
        }
        self.factors.is_finite().then_some(inertia)
    }

    /// Solves in place with the last factorisation.
    pub fn solve(&mut self, x: &mut [f64]) {
        debug_assert_eq!(x.len(), self.scale.len());
        let Self { scale, factors, work: Work { local, .. }, .. } = self;
        x.iter_mut().zip(&*scale).for_each(|(x, scale)| *x *= scale);
        (0..factors.fronts.len()).for_each(|f| factors.front(f).apply(front::forward, x, local));
        self.backward(x);
    }

    /// The half of a solution that is left with D, Lᵀ and S.
    fn backward(&mut self, x: &mut [f64]) {
        let Self { scale, factors, work: Work { local, .. }, .. } = self;
        for &(i, inverse) in &factors.alone {
            x[i] *= inverse;
        }
        (0..factors.fronts.len()).rev().for_each(|f| factors.front(f).apply(front::backward, x, local));
        x.iter_mut().zip(&*scale).for_each(|(x, scale)| *x *= scale);
    }
}

/// How many of the unknowns are duals.
fn count_duals<'a>(duals: &[Range<usize>; 2], unknowns: impl IntoIterator<Item = &'a u32>) -> isize {
    unknowns.into_iter().filter(|i| duals.iter().any(|of| of.contains(&(**i as usize)))).count() as isize
}

impl Work {
    /// Factorises a front: the rests of those that it takes in, and its own entries, which are added to `entries`. What is left of it is the last of
    /// those that wait then.
    fn factorise(
        &mut self,
        (fronts, f): (&Fronts, usize),
        (values, scale): (&[f64], &[f64]),
        duals: &[Range<usize>; 2],
        factors: &mut Factors,
        entries: &mut Vec<f64>,
    ) {
        let pattern = fronts.get(f);
        let first = self.waiting - pattern.takes;
        self.arrange((fronts, pattern), (values, scale), first, factors);
        let (summed, border) = (self.unknowns.len(), pattern.border().len());
        let start = lanes(summed);
        let width = start + lanes(border);
        self.panel.clear();
        self.panel.resize(summed * width, ZERO);
        self.border.clear();
        let meets = self.rests[first..self.waiting].iter().any(|rest| !rest.border.is_empty());
        if meets {
            self.border.resize(lanes(border) * LANE * lanes(border), ZERO);
        }
        self.take_in(fronts, first, width, start * LANE);
        let panel = flat_mut(&mut self.panel);
        let before = entries.len();
        entries.extend(pattern.entries.iter().map(|entry| entry.value(values, &self.scale)));
        for (entry, value) in pattern.entries.iter().zip(&entries[before..]) {
            let [row, column] = entry.places().map(|place| self.column[place]);
            if row != ABSENT && column != ABSENT {
                panel[row * width * LANE + column] += value;
            }
        }
        // What may be pivots is held whole.
        for i in 0..summed {
            let (above, below) = panel.split_at_mut((i + 1) * width * LANE);
            let row = &above[i * width * LANE..][i + 1..summed];
            below.chunks_exact_mut(width * LANE).zip(row).for_each(|(below, value)| below[i] = *value);
        }
        self.pivots.clear();
        let mut panel = Panel { values: &mut self.panel, width, unknowns: &mut self.unknowns };
        let done = if summed > 0 { front::eliminate(&mut panel, f + 1 == fronts.len(), &mut self.pivots) } else { 0 };
        if done > 0 {
            if border > 0 {
                self.border.resize(lanes(border) * LANE * lanes(border), ZERO);
                front::complete(&mut self.border, &panel, start, &self.pivots, &mut self.scaled);
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
        let excess = self.rests[first..self.waiting].iter().map(|rest| rest.excess).sum::<isize>();
        self.waiting = first + 1;
        self.rests.resize_with(self.rests.len().max(self.waiting), Rest::default);
        let rest = &mut self.rests[first];
        rest.front = f;
        rest.delayed.clear();
        rest.delayed.extend_from_slice(&self.unknowns[done..]);
        rest.rows.clear();
        for row in self.panel.chunks_exact(width.max(1)).skip(done) {
            let (own, border_row) = row.split_at(start);
            rest.rows.extend_from_slice(&flat(own)[done..summed]);
            rest.rows.extend_from_slice(&flat(border_row)[..border]);
        }
        std::mem::swap(&mut rest.border, &mut self.border);
        let negative =
            self.pivots.iter().filter_map(Pivot::signs).map(|(_, negative)| negative as isize).sum::<isize>();
        rest.excess = excess + negative - count_duals(duals, &self.unknowns[..done]);
    }

    /// Settles which unknowns the front holds, and the column of each: what was delayed comes first. Own unknowns that nothing couples now
    /// (inequalities that are not active) stay out of it.
    fn arrange(
        &mut self,
        (fronts, pattern): (&Fronts, Pattern<'_>),
        (values, scale): (&[f64], &[f64]),
        first: usize,
        factors: &mut Factors,
    ) {
        let own = pattern.own;
        let Self { rests, unknowns, column, .. } = self;
        self.scale.clear();
        self.scale.extend(pattern.unknowns.iter().map(|&i| scale[i as usize]));
        column.clear();
        column.resize(pattern.unknowns.len(), 0);
        let rests = &rests[first..self.waiting];
        // Coupled: for now just not absent.
        pattern.loose.iter().for_each(|entry| column[entry.places()[0]] = ABSENT);
        for rest in rests {
            fronts.get(rest.front).places.iter().for_each(|&place| column[usize::from(place)] = 0);
        }
        for coupling in pattern.couplings {
            if values[coupling.slot()] != 0.0 {
                coupling.places().into_iter().for_each(|place| column[place] = 0);
            }
        }
        for entry in pattern.loose {
            let [place, _] = entry.places();
            if column[place] == ABSENT {
                factors.alone.push((pattern.unknowns[place] as usize, 1.0 / entry.value(values, &self.scale)));
            }
        }
        unknowns.clear();
        rests.iter().for_each(|rest| unknowns.extend_from_slice(&rest.delayed));
        for (&i, column) in pattern.unknowns.iter().zip(&mut column[..own]) {
            if *column != ABSENT {
                *column = unknowns.len();
                unknowns.push(i);
            }
        }
        let start = lanes(unknowns.len()) * LANE;
        column[own..].iter_mut().enumerate().for_each(|(j, column)| *column = start + j);
    }

    /// Adds the rests of the fronts from `first` on to this one, the border of which begins in column `start`.
    fn take_in(&mut self, fronts: &Fronts, first: usize, width: usize, start: usize) {
        let (panel, border) = (flat_mut(&mut self.panel), flat_mut(&mut self.border));
        let (width, border_width) = (width * LANE, width * LANE - start);
        let mut delayed = 0;
        for rest in &self.rests[first..self.waiting] {
            let places = fronts.get(rest.front).places;
            let target = &mut self.target;
            target.clear();
            target.extend(delayed..delayed + rest.delayed.len());
            target.extend(places.iter().map(|&place| self.column[usize::from(place)]));
            let own = rest.delayed.len();
            for (i, row) in rest.rows.chunks_exact(target.len().max(1)).enumerate() {
                let out = &mut panel[(delayed + i) * width..][..width];
                target[i..].iter().zip(&row[i..]).for_each(|(&j, value)| out[j] += *value);
            }
            let rest_width = lanes(places.len()) * LANE;
            for (i, row) in flat(&rest.border).chunks_exact(rest_width.max(1)).take(places.len()).enumerate() {
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

    /// A random saddle-point matrix over `stages` stages of `each` unknowns, of which two fifths have a zero diagonal block.
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
    fn unknowns_that_only_zeros_couple_are_solved_for_on_their_own() {
        let matrix = Sparse::from_triplets(3, 3, &[(0, 0, 2.0), (0, 1, 0.0), (1, 1, -4.0), (2, 2, 1.0)]);
        for (loose, alone) in [(0..3, 3), (1..3, 2), (0..0, 0)] {
            let mut ldl = StagedLdl::new(&matrix, &[0, 0, 1], 0..0, loose);
            assert_eq!(ldl.factorise(&matrix.values), Some(Inertia { positive: 2, negative: 1 }));
            assert_eq!(ldl.factors.alone.len(), alone);
            let mut x = [1.0, 1.0, 1.0];
            ldl.solve(&mut x);
            assert_eq!(x, [0.5, -0.25, 1.0]);
        }
    }

    #[test]
    fn what_is_not_convex_is_given_up_and_nothing_else() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(8);
        let stages = 12;
        let (variables, duals) = (4 * stages, 2 * stages);
        let stage: Vec<usize> = (0..variables).map(|i| i / 4).chain((0..duals).map(|i| i / 2)).collect();
        let mut outcomes = [0, 0];
        let mut given_up = 0;
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
            given_up += usize::from(ldl.factors.fronts.len() < ldl.fronts.len() / 2);
            let inertia = ldl.factorise(&matrix.values).unwrap();
            assert_eq!(is_convex, inertia.positive == variables, "{trial}");
            if is_convex {
                let mut again = right;
                ldl.solve(&mut again);
                assert_eq!(x, again, "{trial}");
            }
            outcomes[usize::from(is_convex)] += 1;
        }
        assert!(outcomes.iter().all(|count| *count > 10) && given_up > 5, "{outcomes:?}, {given_up}");
    }

    #[test]
    fn what_has_changed_in_a_late_front_is_eliminated_from_there_and_the_numbers_are_the_same() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(9);
        let stages = 300;
        let (mut matrix, stage) = matrix(&mut rng, stages, 5);
        let (n, analysed) = (matrix.columns, matrix.clone());
        let new = || StagedLdl::new(&analysed, &stage, 0..0, n / 2..n);
        let mut ldl = new();
        assert!(ldl.factorise(&matrix.values).is_some());
        let at = |s: usize| analysed.entries().find(|&(i, j, _)| i == j && stage[i] == s).unwrap().2;
        // Elimination goes from the last stage back.
        for (changed, least, most) in [(0, 200, 300), (150, 75, 150), (stages - 1, 0, 0), (40, 180, 260)] {
            matrix.values[at(changed)] += 1.0;
            let values = &matrix.values;
            ldl.equilibrate(values);
            let StagedLdl { checkpoints, fronts, scale, factors, work, .. } = &mut ldl;
            let begin = checkpoints.resume(fronts, (values, scale), factors, work);
            assert!((least..=most).contains(&begin), "{changed}: {begin}");
            let mut fresh = new();
            assert_eq!(ldl.factorise(values), fresh.factorise(values));
            let mut solutions = [(); 2].map(|()| (0..n).map(|i| (i as f64).sin()).collect::<Vec<f64>>());
            ldl.solve(&mut solutions[0]);
            fresh.solve(&mut solutions[1]);
            assert_eq!(solutions[0], solutions[1], "{changed}");
            // Nothing is gone on from that is not finite.
            let mut broken = matrix.values.clone();
            broken[at(stages / 3)] = f64::NAN;
            assert_eq!(ldl.factorise(&broken), None);
            assert_eq!(ldl.factorise(values), fresh.factorise(values));
        }
    }

    #[test]
    fn solutions_and_inertia_agree_with_the_dense_eigenvalues() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(5);
        // The last with fronts of many lanes.
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
