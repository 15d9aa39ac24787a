//! L D Lᵀ of a sparse symmetric indefinite matrix whose unknowns come in stages (time), each coupled only to
//! near stages. Work and memory are linear in the number of stages.
//!
//! A dense window slides along the stages (a chain of fronts):
//!
//! ```text
//!            delayed  own stage  border: later unknowns met so far
//!          ⎡    ·         ·         ·   ⎤
//!   F  =   ⎢    ·         ·         ·   ⎥   pivots only from the first two groups
//!          ⎣    ·         ·         ·   ⎦
//! ```
//!
//! Pivots of order 1 and 2 must pass a threshold test against their whole columns; those that do not are
//! delayed to the next stage. That keeps the factors bounded without regularisation (Duff and Reid, *The
//! multifrontal solution of indefinite sparse symmetric linear equations*, ACM TOMS 9, 1983). By Sylvester's law
//! the signs of the pivots are the signs of the eigenvalues.

use multiversion::multiversion;

use super::sparse::Sparse;

/// A pivot must be at least this fraction of its column.
const THRESHOLD: f64 = 0.02;
const EQUILIBRATIONS: usize = 3;

/// Number of positive and negative eigenvalues; what is missing to the order is zero to working precision.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Inertia {
    pub positive: usize,
    pub negative: usize,
}

#[derive(Clone, Debug, Default)]
struct Stage {
    own: Vec<usize>,
    border: Vec<usize>,
    /// Place of each of the previous stage's border unknowns among `own` then `border`.
    carry: Vec<usize>,
    /// (row, column among `own` then `border`, slot in the matrix' values)
    entries: Vec<(usize, usize, usize)>,
}

#[derive(Clone, Copy, Debug)]
struct Pivot {
    first: usize,
    /// For a pivot of order 2.
    second: Option<usize>,
    /// Inverse of the pivot block: (1,1), (1,2), (2,2).
    inverse: [f64; 3],
    /// End of this pivot's entries in `rows` and `multipliers`.
    end: usize,
}

/// D and the columns of L.
#[derive(Clone, Debug, Default)]
struct Factors {
    pivots: Vec<Pivot>,
    rows: Vec<usize>,
    multipliers: Vec<[f64; 2]>,
}

/// The factorisation; symbolic once, numeric as often as values change.
#[derive(Clone, Debug)]
pub struct StagedLdl {
    order: usize,
    /// (row, column) of each value.
    positions: Vec<(u32, u32)>,
    /// S, and S K S as factorised.
    scale: Vec<f64>,
    scaled: Vec<f64>,
    stages: Vec<Stage>,
    factors: Factors,
    work: Work,
}

/// Work space of the numeric factorisation.
#[derive(Clone, Debug, Default)]
struct Work {
    front: Vec<f64>,
    carried: Vec<f64>,
    delayed: Vec<usize>,
    index: Vec<usize>,
    place: Vec<usize>,
    coupled: Vec<bool>,
    progress: Progress,
    target: Vec<usize>,
}

impl StagedLdl {
    /// Analyses the pattern of `matrix` (upper triangle); `stage[i]` is the stage of unknown i, counted from 0.
    pub fn new(matrix: &Sparse, stage: &[usize]) -> Self {
        let order = matrix.columns;
        let count = stage.iter().max().map_or(0, |last| last + 1);
        // The first stage that meets each unknown is that of its earliest neighbour.
        let mut met: Vec<usize> = stage.to_vec();
        for (row, column, _) in matrix.entries() {
            let earliest = stage[row].min(stage[column]);
            met[row] = met[row].min(earliest);
            met[column] = met[column].min(earliest);
        }
        // Unknowns with few neighbours first: they fill in least.
        let mut degree = vec![0; order];
        for (row, column, _) in matrix.entries() {
            degree[row] += 1;
            degree[column] += 1;
        }
        let mut stages = vec![Stage::default(); count];
        for i in 0..order {
            stages[stage[i]].own.push(i);
            stages[met[i]..stage[i]].iter_mut().for_each(|s| s.border.push(i));
        }
        stages.iter_mut().for_each(|s| s.own.sort_by_key(|&i| degree[i]));
        let mut place = vec![usize::MAX; order];
        let mut by_stage = vec![Vec::new(); count];
        for (row, column, slot) in matrix.entries() {
            by_stage[stage[row].min(stage[column])].push((row, column, slot));
        }
        for s in 0..count {
            let members: Vec<usize> = stages[s].own.iter().chain(&stages[s].border).copied().collect();
            members.iter().enumerate().for_each(|(local, &i)| place[i] = local);
            if s > 0 {
                stages[s].carry = stages[s - 1].border.iter().map(|&i| place[i]).collect();
            }
            stages[s].entries =
                by_stage[s].iter().map(|&(row, column, slot)| (place[row], place[column], slot)).collect();
        }
        Self {
            order,
            positions: matrix.entries().map(|(i, j, _)| (i as u32, j as u32)).collect(),
            scale: vec![1.0; order],
            scaled: vec![0.0; matrix.values.len()],
            stages,
            factors: Factors::default(),
            work: Work::default(),
        }
    }

    /// Factorises the matrix with these values in the analysed pattern. `None` if a value is not finite.
    pub fn factorise(&mut self, values: &[f64]) -> Option<Inertia> {
        self.equilibrate(values);
        let (values, factors) = (&self.scaled, &mut self.factors);
        factors.pivots.clear();
        factors.rows.clear();
        factors.multipliers.clear();
        let Work { front, carried, delayed, index, place, coupled, progress, target } = &mut self.work;
        delayed.clear();
        carried.clear();
        let last = self.stages.len().saturating_sub(1);
        for s in 0..self.stages.len() {
            let stage = &self.stages[s];
            let nd = delayed.len();
            let old = nd + stage.carry.len();
            // Own unknowns that nothing couples now (inequalities that are not active) stay out of the front.
            coupled.clear();
            coupled.resize(stage.own.len() + stage.border.len(), false);
            coupled[stage.own.len()..].fill(true);
            stage.carry.iter().for_each(|&i| coupled[i] = true);
            for &(i, j, slot) in &stage.entries {
                if i != j && values[slot] != 0.0 {
                    coupled[i] = true;
                    coupled[j] = true;
                }
            }
            index.clear();
            index.extend_from_slice(delayed);
            place.clear();
            for (&i, &coupled) in stage.own.iter().chain(&stage.border).zip(&*coupled) {
                place.push(if coupled { index.len() } else { usize::MAX });
                if coupled {
                    index.push(i);
                }
            }
            let n = index.len();
            let summed = n - stage.border.len();
            front.clear();
            front.resize(n * n, 0.0);
            let to = |k: usize| if k < nd { k } else { place[stage.carry[k - nd]] };
            target.clear();
            target.extend((0..old).map(to));
            for i in 0..old {
                let row = &mut front[target[i] * n..(target[i] + 1) * n];
                target.iter().zip(&carried[i * old..(i + 1) * old]).for_each(|(&j, value)| row[j] = *value);
            }
            for &(i, j, slot) in &stage.entries {
                let (row, column) = (place[i], place[j]);
                if row == usize::MAX && row == column {
                    let inverse = [1.0 / values[slot], 0.0, 0.0];
                    let end = factors.rows.len();
                    factors.pivots.push(Pivot { first: stage.own[i], second: None, inverse, end });
                } else if row != usize::MAX && column != usize::MAX {
                    front[row * n + column] += values[slot];
                    if row != column {
                        front[column * n + row] += values[slot];
                    }
                }
            }
            let k = eliminate(front, n, summed, s == last, index, factors, progress);
            carried.clear();
            for i in k..n {
                carried.extend_from_slice(&front[i * n + k..(i + 1) * n]);
            }
            delayed.clear();
            delayed.extend_from_slice(&index[k..summed]);
        }
        self.inertia()
    }

    /// S so that the largest entry of each row of S K S is near 1 (D. Ruiz, RAL-TR-2001-034): pivots are then judged against
    /// entries of like size. The signs of the eigenvalues stay.
    fn equilibrate(&mut self, values: &[f64]) {
        self.scale.fill(1.0);
        let mut largest = vec![0.0f64; self.order];
        for _ in 0..EQUILIBRATIONS {
            largest.fill(0.0);
            for (&(i, j), value) in self.positions.iter().zip(values) {
                let (i, j) = (i as usize, j as usize);
                let size = (value * self.scale[i] * self.scale[j]).abs();
                largest[i] = if size > largest[i] { size } else { largest[i] };
                largest[j] = if size > largest[j] { size } else { largest[j] };
            }
            for (scale, largest) in self.scale.iter_mut().zip(&largest) {
                if *largest > 0.0 {
                    *scale /= largest.sqrt();
                }
            }
        }
        for ((scaled, value), &(i, j)) in self.scaled.iter_mut().zip(values).zip(&self.positions) {
            *scaled = value * self.scale[i as usize] * self.scale[j as usize];
        }
    }

    /// Signs of the eigenvalues, from those of the pivots.
    fn inertia(&self) -> Option<Inertia> {
        let mut inertia = Inertia { positive: 0, negative: 0 };
        for pivot in &self.factors.pivots {
            let [p, q, r] = pivot.inverse;
            let determinant = p * r - q * q;
            match pivot.second {
                _ if !p.is_finite() || !determinant.is_finite() => return None,
                None if p > 0.0 => inertia.positive += 1,
                None if p < 0.0 => inertia.negative += 1,
                None => {}
                Some(_) if determinant < 0.0 => {
                    inertia.positive += 1;
                    inertia.negative += 1;
                }
                Some(_) if p > 0.0 => inertia.positive += 2,
                Some(_) => inertia.negative += 2,
            }
        }
        self.factors.multipliers.iter().flatten().all(|l| l.is_finite()).then_some(inertia)
    }

    /// Solves in place with the last factorisation.
    pub fn solve(&self, x: &mut [f64]) {
        debug_assert_eq!(x.len(), self.order);
        x.iter_mut().zip(&self.scale).for_each(|(x, scale)| *x *= scale);
        let Factors { pivots, rows, multipliers } = &self.factors;
        let mut begin = 0;
        for pivot in pivots {
            let (a, b) = (x[pivot.first], pivot.second.map_or(0.0, |i| x[i]));
            for at in begin..pivot.end {
                let [l, m] = multipliers[at];
                x[rows[at]] -= l * a + m * b;
            }
            begin = pivot.end;
        }
        for (k, pivot) in pivots.iter().enumerate().rev() {
            let begin = if k == 0 { 0 } else { pivots[k - 1].end };
            let (a, b) = (x[pivot.first], pivot.second.map_or(0.0, |i| x[i]));
            let [p, q, r] = pivot.inverse;
            let (mut first, mut second) = (p * a + q * b, q * a + r * b);
            for at in begin..pivot.end {
                let (value, [l, m]) = (x[rows[at]], multipliers[at]);
                first -= l * value;
                second -= m * value;
            }
            x[pivot.first] = first;
            if let Some(i) = pivot.second {
                x[i] = second;
            }
        }
        x.iter_mut().zip(&self.scale).for_each(|(x, scale)| *x *= scale);
    }
}

/// A pivot of the front that is being eliminated: its first row there, and the inverse of its block.
#[derive(Clone, Copy, Debug)]
struct Done {
    row: usize,
    two: bool,
    inverse: [f64; 3],
}

/// What has been eliminated of a front.
#[derive(Clone, Debug, Default)]
struct Progress {
    done: Vec<Done>,
    /// How many of the pivots done each row has taken in.
    taken: Vec<usize>,
}

/// A front, the rows of which are brought up to date when they are looked at: each then stays in the fastest memory while the pivot
/// rows pass by, and columns that are gone by then cost nothing.
struct Front<'f> {
    values: &'f mut [f64],
    n: usize,
    index: &'f mut [usize],
    progress: &'f mut Progress,
}

/// Eliminates as many of the first `summed` unknowns as have an acceptable pivot, of the last front all. Returns their number.
///
/// Compiled for each width of vector registers; without fused multiply–add, so that the numbers are the same on all.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2"))]
fn eliminate(
    values: &mut [f64],
    n: usize,
    summed: usize,
    is_last: bool,
    index: &mut [usize],
    factors: &mut Factors,
    progress: &mut Progress,
) -> usize {
    progress.done.clear();
    progress.taken.clear();
    progress.taken.resize(n, 0);
    let mut front = Front { values, n, index, progress };
    // The search goes on where it last ended: rows refused there are looked at again after all others.
    let (mut k, mut from) = (0, 0);
    while k < summed {
        let (c, partner) = match find_pivot(&mut front, k, summed, from) {
            Some(pivot) => pivot,
            None if !is_last => break,
            // Nothing is left to delay to: the largest diagonal entry, however small.
            None => {
                let size = |i: usize| front.values[i * n + i].abs();
                ((k..summed).max_by(|&a, &b| size(a).total_cmp(&size(b))).unwrap_or(k), None)
            }
        };
        swap(&mut front, k, c);
        from = c + 1;
        match partner {
            None => {
                eliminate_one(&mut front, k, factors);
                k += 1;
            }
            Some(r) => {
                swap(&mut front, k + 1, if r == k { c } else { r });
                eliminate_two(&mut front, k, factors);
                k += 2;
            }
        }
    }
    (k..n).for_each(|row| update(&mut front, row, k));
    k
}

/// Takes into a row, from column k on, the pivots done since it was last looked at.
#[inline(always)]
fn update(front: &mut Front<'_>, row: usize, k: usize) {
    let n = front.n;
    let (above, rest) = front.values.split_at_mut(row * n);
    let own = &mut rest[k..n];
    for pivot in &front.progress.done[front.progress.taken[row]..] {
        let first = &above[pivot.row * n..(pivot.row + 1) * n];
        let [p, q, r] = pivot.inverse;
        if pivot.two {
            let second = &above[(pivot.row + 1) * n..(pivot.row + 2) * n];
            let (x, y) = (first[row], second[row]);
            if x != 0.0 || y != 0.0 {
                let (l, m) = (p * x + q * y, q * x + r * y);
                let pivot_rows = first[k..].iter().zip(&second[k..]);
                own.iter_mut().zip(pivot_rows).for_each(|(z, (p, q))| *z -= l * p + m * q);
            }
        } else if first[row] != 0.0 {
            let l = first[row] * p;
            own.iter_mut().zip(&first[k..]).for_each(|(x, p)| *x -= l * p);
        }
    }
    front.progress.taken[row] = front.progress.done.len();
}

/// Largest magnitude, eight at a time.
#[inline(always)]
fn largest_of(values: &[f64]) -> f64 {
    let mut lanes = [0.0f64; 8];
    let (chunks, rest) = values.as_chunks::<8>();
    for chunk in chunks {
        for (lane, v) in lanes.iter_mut().zip(chunk) {
            *lane = if v.abs() > *lane { v.abs() } else { *lane };
        }
    }
    lanes.iter().chain(rest).fold(0.0, |a, v| if v.abs() > a { v.abs() } else { a })
}

/// Largest entry of a row between two columns.
#[inline(always)]
fn span(row: &[f64], from: usize, to: usize) -> f64 {
    largest_of(&row[from.min(to)..to])
}

/// Largest entry of row `c` among columns k … n but `c` and `but`.
#[inline(always)]
fn largest(front: &Front<'_>, k: usize, c: usize, but: usize) -> f64 {
    let n = front.n;
    let row = &front.values[c * n..(c + 1) * n];
    let (first, second) = (c.min(but), c.max(but));
    span(row, k, first).max(span(row, (first + 1).max(k), second)).max(span(row, (second + 1).max(k), n))
}

/// The column among k … summed but `c` where row `c` is largest.
#[inline(always)]
fn partner(front: &Front<'_>, k: usize, summed: usize, c: usize) -> Option<usize> {
    let row = &front.values[c * front.n..(c + 1) * front.n];
    let size = span(row, k, c).max(span(row, c + 1, summed));
    (size > 0.0).then(|| (k..summed).find(|&j| j != c && row[j].abs() == size))?
}

/// The next acceptable pivot among rows k … summed, `from` on and around: one row, or two.
#[inline(always)]
fn find_pivot(front: &mut Front<'_>, k: usize, summed: usize, from: usize) -> Option<(usize, Option<usize>)> {
    let n = front.n;
    let from = if from < summed { from.max(k) } else { k };
    for c in (from..summed).chain(k..from) {
        update(front, c, k);
        let a = front.values[c * n + c];
        if a != 0.0 && a.abs() >= THRESHOLD * largest(front, k, c, c) {
            return Some((c, None));
        }
        let Some(r) = partner(front, k, summed, c) else { continue };
        update(front, r, k);
        let (rest_c, rest_r) = (largest(front, k, c, r), largest(front, k, r, c));
        let (b, d) = (front.values[c * n + r], front.values[r * n + r]);
        let determinant = (a * d - b * b).abs();
        let growth = (d.abs() * rest_c + b.abs() * rest_r).max(b.abs() * rest_c + a.abs() * rest_r);
        if determinant > 0.0 && growth * THRESHOLD <= determinant {
            return Some((c, Some(r)));
        }
    }
    None
}

/// Exchanges rows and columns i and j ≥ i.
#[inline(always)]
fn swap(front: &mut Front<'_>, i: usize, j: usize) {
    if i == j {
        return;
    }
    let n = front.n;
    front.index.swap(i, j);
    front.progress.taken.swap(i, j);
    let (head, tail) = front.values.split_at_mut(j * n);
    head[i * n..(i + 1) * n].swap_with_slice(&mut tail[..n]);
    front.values.chunks_exact_mut(n).for_each(|row| row.swap(i, j));
}

/// Row k is up to date and becomes a pivot; the rows below take it in later.
#[inline(always)]
fn eliminate_one(front: &mut Front<'_>, k: usize, factors: &mut Factors) {
    let Factors { pivots, rows, multipliers } = factors;
    let row = &front.values[k * front.n..(k + 1) * front.n];
    // A zero pivot in a zero column: the unknown is left at zero.
    let inverse = if row[k] == 0.0 { 0.0 } else { 1.0 / row[k] };
    for j in k + 1..front.n {
        let l = row[j] * inverse;
        if l != 0.0 {
            rows.push(front.index[j]);
            multipliers.push([l, 0.0]);
        }
    }
    pivots.push(Pivot { first: front.index[k], second: None, inverse: [inverse, 0.0, 0.0], end: rows.len() });
    front.progress.done.push(Done { row: k, two: false, inverse: [inverse, 0.0, 0.0] });
}

/// The same of rows k and k + 1.
#[inline(always)]
fn eliminate_two(front: &mut Front<'_>, k: usize, factors: &mut Factors) {
    let Factors { pivots, rows, multipliers } = factors;
    let n = front.n;
    let (first, second) = front.values[k * n..(k + 2) * n].split_at(n);
    let (a, b, d) = (first[k], first[k + 1], second[k + 1]);
    let determinant = a * d - b * b;
    let inverse = [d / determinant, -b / determinant, a / determinant];
    for j in k + 2..n {
        let (x, y) = (first[j], second[j]);
        if x != 0.0 || y != 0.0 {
            rows.push(front.index[j]);
            multipliers.push([inverse[0] * x + inverse[1] * y, inverse[1] * x + inverse[2] * y]);
        }
    }
    pivots.push(Pivot { first: front.index[k], second: Some(front.index[k + 1]), inverse, end: rows.len() });
    front.progress.done.push(Done { row: k, two: true, inverse });
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    /// A random saddle-point matrix over `stages` stages of 5 unknowns, of which 2 have a zero diagonal block.
    fn matrix(rng: &mut impl rand::Rng, stages: usize) -> (Sparse, Vec<usize>) {
        let stage: Vec<usize> = (0..5 * stages).map(|i| i / 5).collect();
        let mut triplets = Vec::new();
        for i in 0..5 * stages {
            for j in i..5 * stages {
                let dual = |k: usize| k % 5 >= 3;
                if stage[j] - stage[i] <= 2 && !(dual(i) && dual(j)) && rng.random_range(0.0..1.0) < 0.7 {
                    triplets.push((i, j, rng.random_range(-1.0..1.0)));
                }
            }
        }
        (Sparse::from_triplets(5 * stages, 5 * stages, &triplets), stage)
    }

    #[test]
    fn solutions_and_inertia_agree_with_the_dense_eigenvalues() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(5);
        for stages in [1, 2, 7, 20] {
            let (matrix, stage) = matrix(&mut rng, stages);
            let n = matrix.columns;
            let mut ldl = StagedLdl::new(&matrix, &stage);
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
