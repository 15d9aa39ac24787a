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

/// The pattern of a dense front.
#[derive(Clone, Debug, Default)]
struct Pattern {
    own: Vec<usize>,
    border: Vec<usize>,
    /// Of each front that this one takes in, the place of its border unknowns among `own` then `border`.
    children: Vec<Vec<usize>>,
    /// (row, column among `own` then `border`, slot in the matrix' values)
    entries: Vec<(usize, usize, usize)>,
}

/// What is left of a front for the one that takes it in: over unknowns that had no acceptable pivot, then its border.
#[derive(Clone, Debug, Default)]
struct Rest {
    delayed: Vec<usize>,
    values: Vec<f64>,
}

/// A pivot of order 1 or 2: its first row in the front, and the inverse of its block: (1,1), (1,2), (2,2).
#[derive(Clone, Copy, Debug)]
struct Pivot {
    row: usize,
    two: bool,
    inverse: [f64; 3],
}

impl Pivot {
    /// The row after it.
    fn end(&self) -> usize {
        self.row + 1 + usize::from(self.two)
    }
}

/// The pivots and what they stand for: of each front its unknowns in their last order, and D Lᵀ right of the pivots, row by row.
#[derive(Clone, Debug, Default)]
struct Factors {
    /// Unknowns that nothing couples, and the inverses of their entries.
    alone: Vec<(usize, f64)>,
    pivots: Vec<Pivot>,
    unknowns: Vec<usize>,
    rows: Vec<f64>,
    /// Where each front ends in the three.
    ends: Vec<[usize; 3]>,
}

/// The part of a front.
struct FrontFactors<'f> {
    pivots: &'f [Pivot],
    unknowns: &'f [usize],
    rows: &'f [f64],
}

impl Factors {
    fn clear(&mut self) {
        self.alone.clear();
        self.pivots.clear();
        self.unknowns.clear();
        self.rows.clear();
        self.ends.clear();
    }

    fn front(&self, f: usize) -> FrontFactors<'_> {
        let [pivots, unknowns, rows] = if f == 0 { [0; 3] } else { self.ends[f - 1] };
        let ends = self.ends[f];
        FrontFactors {
            pivots: &self.pivots[pivots..ends[0]],
            unknowns: &self.unknowns[unknowns..ends[1]],
            rows: &self.rows[rows..ends[2]],
        }
    }
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
    /// Each after those that it takes in.
    fronts: Vec<Pattern>,
    factors: Factors,
    work: Work,
}

/// Work space of the numeric factorisation.
#[derive(Clone, Debug, Default)]
struct Work {
    front: Vec<f64>,
    /// The first `waiting` are of fronts that are not taken in yet.
    rests: Vec<Rest>,
    waiting: usize,
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
        // From the last back: what a state follows from comes with it, so that it need not be delayed.
        let stage: Vec<usize> = stage.iter().map(|s| count - 1 - s).collect();
        // The first stage that meets each unknown is that of its earliest neighbour.
        let mut met: Vec<usize> = stage.clone();
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
        let mut by_stage = vec![Vec::new(); count];
        for (row, column, slot) in matrix.entries() {
            by_stage[stage[row].min(stage[column])].push((row, column, slot));
        }
        let mut stages = vec![Pattern::default(); count];
        for i in 0..order {
            stages[stage[i]].own.push(i);
            stages[met[i]..stage[i]].iter_mut().for_each(|s| s.border.push(i));
        }
        let mut scratch = Scratch { place: vec![usize::MAX; order], group: vec![None; order] };
        let mut fronts: Vec<Pattern> = Vec::new();
        let mut before: Vec<usize> = Vec::new();
        for (s, (mut pattern, entries)) in stages.into_iter().zip(by_stage).enumerate() {
            pattern.own.sort_by_key(|&i| degree[i]);
            let first = fronts.len();
            let may_part = |i: usize| met[i] == s;
            fronts.extend(scratch.part(pattern, &entries, may_part, &degree));
            let root = fronts.len() - 1;
            let own = fronts[root].own.iter().chain(&fronts[root].border);
            own.enumerate().for_each(|(local, &i)| scratch.place[i] = local);
            let places = |border: &[usize]| border.iter().map(|&i| scratch.place[i]).collect();
            let mut children: Vec<Vec<usize>> = Vec::new();
            if s > 0 {
                children.push(places(&before));
            }
            children.extend(fronts[first..root].iter().map(|leaf| places(&leaf.border)));
            before.clone_from(&fronts[root].border);
            fronts[root].children = children;
        }
        Self {
            order,
            positions: matrix.entries().map(|(i, j, _)| (i as u32, j as u32)).collect(),
            scale: vec![1.0; order],
            scaled: vec![0.0; matrix.values.len()],
            fronts,
            factors: Factors::default(),
            work: Work::default(),
        }
    }

    /// Factorises the matrix with these values in the analysed pattern. `None` if a value is not finite.
    pub fn factorise(&mut self, values: &[f64]) -> Option<Inertia> {
        self.equilibrate(values);
        let (values, factors) = (&self.scaled, &mut self.factors);
        factors.clear();
        let Work { front, rests, waiting, index, place, coupled, progress, target } = &mut self.work;
        *waiting = 0;
        let last = self.fronts.len().saturating_sub(1);
        for (f, pattern) in self.fronts.iter().enumerate() {
            let border = pattern.border.len();
            let first = *waiting - pattern.children.len();
            let taken = &rests[first..*waiting];
            // Own unknowns that nothing couples now (inequalities that are not active) stay out of the front.
            coupled.clear();
            coupled.resize(pattern.own.len(), false);
            coupled.resize(pattern.own.len() + border, true);
            pattern.children.iter().flatten().for_each(|&i| coupled[i] = true);
            for &(i, j, slot) in &pattern.entries {
                if i != j && values[slot] != 0.0 {
                    coupled[i] = true;
                    coupled[j] = true;
                }
            }
            index.clear();
            taken.iter().for_each(|rest| index.extend_from_slice(&rest.delayed));
            place.clear();
            for (&i, &coupled) in pattern.own.iter().chain(&pattern.border).zip(&*coupled) {
                place.push(if coupled { index.len() } else { usize::MAX });
                if coupled {
                    index.push(i);
                }
            }
            let n = index.len();
            let summed = n - border;
            front.clear();
            front.resize(n * n, 0.0);
            let mut delayed = 0;
            for (rest, places) in taken.iter().zip(&pattern.children) {
                let old = rest.delayed.len() + places.len();
                target.clear();
                target.extend(delayed..delayed + rest.delayed.len());
                target.extend(places.iter().map(|&i| place[i]));
                delayed += rest.delayed.len();
                for (&i, values) in target.iter().zip(rest.values.chunks_exact(old.max(1))) {
                    let row = &mut front[i * n..(i + 1) * n];
                    target.iter().zip(values).for_each(|(&j, value)| row[j] += *value);
                }
            }
            for &(i, j, slot) in &pattern.entries {
                let (row, column) = (place[i], place[j]);
                if row == usize::MAX && i == j {
                    factors.alone.push((pattern.own[i], 1.0 / values[slot]));
                } else if row != usize::MAX && column != usize::MAX {
                    front[row * n + column] += values[slot];
                    if row != column {
                        front[column * n + row] += values[slot];
                    }
                }
            }
            let k = eliminate(front, n, summed, f == last, index, progress);
            for pivot in &progress.done {
                for row in pivot.row..pivot.end() {
                    factors.rows.extend_from_slice(&front[row * n + pivot.end()..(row + 1) * n]);
                }
            }
            factors.pivots.extend_from_slice(&progress.done);
            factors.unknowns.extend_from_slice(index);
            factors.ends.push([factors.pivots.len(), factors.unknowns.len(), factors.rows.len()]);
            *waiting = first + 1;
            rests.resize_with(rests.len().max(*waiting), Rest::default);
            let Rest { delayed, values } = &mut rests[first];
            delayed.clear();
            delayed.extend_from_slice(&index[k..summed]);
            values.clear();
            for i in k..n {
                values.extend_from_slice(&front[i * n + k..(i + 1) * n]);
            }
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
        let Factors { alone, pivots, rows, .. } = &self.factors;
        let alone = alone.iter().map(|&(_, inverse)| Pivot { row: 0, two: false, inverse: [inverse, 0.0, 0.0] });
        for pivot in alone.chain(pivots.iter().copied()) {
            let [p, q, r] = pivot.inverse;
            let determinant = p * r - q * q;
            match pivot.two {
                _ if !p.is_finite() || !determinant.is_finite() => return None,
                false if p > 0.0 => inertia.positive += 1,
                false if p < 0.0 => inertia.negative += 1,
                false => {}
                true if determinant < 0.0 => {
                    inertia.positive += 1;
                    inertia.negative += 1;
                }
                true if p > 0.0 => inertia.positive += 2,
                true => inertia.negative += 2,
            }
        }
        rows.iter().all(|value| value.is_finite()).then_some(inertia)
    }

    /// Solves in place with the last factorisation.
    pub fn solve(&self, x: &mut [f64]) {
        debug_assert_eq!(x.len(), self.order);
        x.iter_mut().zip(&self.scale).for_each(|(x, scale)| *x *= scale);
        let mut local = Vec::new();
        for f in 0..self.fronts.len() {
            let front = self.factors.front(f);
            local.clear();
            local.extend(front.unknowns.iter().map(|&i| x[i]));
            forward(&front, &mut local);
            front.unknowns.iter().zip(&local).for_each(|(&i, value)| x[i] = *value);
        }
        for &(i, inverse) in &self.factors.alone {
            x[i] *= inverse;
        }
        for f in (0..self.fronts.len()).rev() {
            let front = self.factors.front(f);
            local.clear();
            local.extend(front.unknowns.iter().map(|&i| x[i]));
            backward(&front, &mut local);
            front.unknowns.iter().zip(&local).for_each(|(&i, value)| x[i] = *value);
        }
        x.iter_mut().zip(&self.scale).for_each(|(x, scale)| *x *= scale);
    }
}

/// L⁻¹ of a front.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2"))]
fn forward(front: &FrontFactors<'_>, x: &mut [f64]) {
    let mut rows = front.rows;
    for pivot in front.pivots {
        let (known, x) = x.split_at_mut(pivot.end());
        let [p, q, r] = pivot.inverse;
        let first;
        (first, rows) = rows.split_at(x.len());
        if pivot.two {
            let second;
            (second, rows) = rows.split_at(x.len());
            let (a, b) = (known[pivot.row], known[pivot.row + 1]);
            let (a, b) = (p * a + q * b, q * a + r * b);
            x.iter_mut().zip(first.iter().zip(second)).for_each(|(x, (f, s))| *x -= a * f + b * s);
        } else {
            let a = p * known[pivot.row];
            x.iter_mut().zip(first).for_each(|(x, f)| *x -= a * f);
        }
    }
}

/// L⁻ᵀ D⁻¹ of a front.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2"))]
fn backward(front: &FrontFactors<'_>, x: &mut [f64]) {
    let mut rows = front.rows;
    for pivot in front.pivots.iter().rev() {
        let (unknown, x) = x.split_at_mut(pivot.end());
        let [p, q, r] = pivot.inverse;
        let last;
        (rows, last) = rows.split_at(rows.len() - x.len());
        if pivot.two {
            let first;
            (rows, first) = rows.split_at(rows.len() - x.len());
            let (a, b) = (unknown[pivot.row] - dot(first, x), unknown[pivot.row + 1] - dot(last, x));
            (unknown[pivot.row], unknown[pivot.row + 1]) = (p * a + q * b, q * a + r * b);
        } else {
            unknown[pivot.row] = p * (unknown[pivot.row] - dot(last, x));
        }
    }
}

/// Σ aᵢ bᵢ, eight at a time: the same sum for each width of vector registers.
#[inline(always)]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    let mut lanes = [0.0f64; 8];
    for (a, b) in a.iter().zip(b) {
        for ((lane, a), b) in lanes.iter_mut().zip(a).zip(b) {
            *lane += a * b;
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    lanes.iter().sum::<f64>() + rest
}

/// Work of a front beside that of its pivots, in multiplications.
const FRONT: usize = 2000;

/// Work space of the analysis, one entry an unknown.
struct Scratch {
    place: Vec<usize>,
    /// The group of each unknown that belongs to one, while its stage is looked at.
    group: Vec<Option<usize>>,
}

impl Scratch {
    /// Parts a stage into fronts of groups and, last, that of the rest: unknowns that `may_part` and have few neighbours, in groups that
    /// nothing couples to one another. How few is chosen by the work that is left.
    fn part(
        &mut self,
        stage: Pattern,
        entries: &[(usize, usize, usize)],
        may_part: impl Fn(usize) -> bool,
        degree: &[usize],
    ) -> Vec<Pattern> {
        let mut limits: Vec<usize> = stage.own.iter().filter(|&&i| may_part(i)).map(|&i| degree[i]).collect();
        limits.dedup();
        let mut best = self.parted(&stage, entries, |_| false);
        for limit in limits {
            let parts = self.parted(&stage, entries, |i| may_part(i) && degree[i] <= limit);
            if work(&parts) < work(&best) {
                best = parts;
            }
        }
        best
    }

    /// The fronts of a stage: the connected groups of the unknowns that `parts`, and the rest.
    fn parted(
        &mut self,
        stage: &Pattern,
        entries: &[(usize, usize, usize)],
        parts: impl Fn(usize) -> bool,
    ) -> Vec<Pattern> {
        let mut count = 0;
        for &i in &stage.own {
            self.group[i] = parts(i).then_some(count);
            count += usize::from(parts(i));
        }
        // The smallest number spreads over each connected group.
        loop {
            let mut changed = false;
            for &(i, j, _) in entries {
                if let (Some(a), Some(b)) = (self.group[i], self.group[j])
                    && a != b
                {
                    (self.group[i], self.group[j]) = (Some(a.min(b)), Some(a.min(b)));
                    changed = true;
                }
            }
            if !changed {
                break;
            }
        }
        let mut fronts = vec![Pattern::default(); count + 1];
        for &i in &stage.own {
            fronts[self.group[i].unwrap_or(count)].own.push(i);
        }
        fronts[count].border.clone_from(&stage.border);
        let mut by_front = vec![Vec::new(); count + 1];
        for &(i, j, slot) in entries {
            let front = self.group[i].or(self.group[j]).unwrap_or(count);
            by_front[front].push((i, j, slot));
            if front < count {
                let border = [i, j].into_iter().filter(|&i| self.group[i].is_none());
                fronts[front].border.extend(border);
            }
        }
        for (front, entries) in fronts.iter_mut().zip(by_front) {
            front.border.sort_unstable();
            front.border.dedup();
            let members = front.own.iter().chain(&front.border);
            members.enumerate().for_each(|(local, &i)| self.place[i] = local);
            let local = |(i, j, slot): (usize, usize, usize)| (self.place[i], self.place[j], slot);
            front.entries = entries.into_iter().map(local).collect();
        }
        for &i in &stage.own {
            self.group[i] = None;
        }
        let last = fronts.pop();
        fronts.retain(|front| !front.own.is_empty());
        fronts.extend(last);
        fronts
    }
}

/// Multiplications of the elimination of these fronts.
fn work(fronts: &[Pattern]) -> usize {
    let front = |f: &Pattern| {
        let (n, rest) = (f.own.len() + f.border.len(), f.border.len());
        FRONT + (n * n * n - rest * rest * rest) / 3
    };
    fronts.iter().map(front).sum()
}

/// What has been eliminated of a front.
#[derive(Clone, Debug, Default)]
struct Progress {
    done: Vec<Pivot>,
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
                eliminate_one(&mut front, k);
                k += 1;
            }
            Some(r) => {
                swap(&mut front, k + 1, if r == k { c } else { r });
                eliminate_two(&mut front, k);
                k += 2;
            }
        }
    }
    // The rest is symmetric: half of it is brought up to date.
    let mut row = k;
    while row < n {
        row += update(&mut front, row, row);
    }
    for i in k..n {
        for j in i + 1..n {
            front.values[j * n + i] = front.values[i * n + j];
        }
    }
    k
}

/// Takes into a row, from a column on, the pivots done since it was last looked at; and into the rows after it that lack the same ones, as
/// long as there are many. Returns how many rows are up to date now.
#[inline(always)]
fn update(front: &mut Front<'_>, row: usize, from: usize) -> usize {
    let taken = &front.progress.taken;
    let lacks = front.progress.done.len() - taken[row];
    let alike = taken[row..].iter().take(TOGETHER).take_while(|&&t| t == taken[row]).count();
    if lacks >= TOGETHER && alike == TOGETHER {
        update_rows::<TOGETHER>(front, row, from);
        TOGETHER
    } else {
        update_rows::<1>(front, row, from);
        1
    }
}

/// So many pivot rows go into as many rows at a time: each is then read from the slower memory once for all of them.
const TOGETHER: usize = 4;

#[inline(always)]
fn update_rows<const ROWS: usize>(front: &mut Front<'_>, row: usize, from: usize) {
    let n = front.n;
    let (above, rest) = front.values.split_at_mut(row * n);
    let own = &mut rest[..ROWS * n];
    let (mut rows, mut multipliers, mut count) = ([0; TOGETHER], [[0.0; ROWS]; TOGETHER], 0);
    for pivot in &front.progress.done[front.progress.taken[row]..] {
        let [p, q, r] = pivot.inverse;
        let first = &above[pivot.row * n + row..][..ROWS];
        let second = if pivot.two { &above[(pivot.row + 1) * n + row..][..ROWS] } else { &[0.0; ROWS] };
        if first.iter().chain(second).all(|&x| x == 0.0) {
            continue;
        }
        for half in 0..=usize::from(pivot.two) {
            let (p, q) = if half == 0 { (p, q) } else { (q, r) };
            rows[count] = pivot.row + half;
            for i in 0..ROWS {
                multipliers[count][i] = p * first[i] + q * second[i];
            }
            count += 1;
            if count == TOGETHER {
                subtract(own, above, n, from, rows, &multipliers);
                count = 0;
            }
        }
    }
    for (&k, multipliers) in rows.iter().zip(&multipliers).take(count) {
        let pivot_row = &above[k * n + from..(k + 1) * n];
        for (own, l) in own.chunks_exact_mut(n).zip(multipliers) {
            own[from..].iter_mut().zip(pivot_row).for_each(|(x, p)| *x -= l * p);
        }
    }
    front.progress.taken[row..row + ROWS].fill(front.progress.done.len());
}

/// `own` −= multipliers × the pivot rows `rows`, from a column on.
#[inline(always)]
fn subtract<const ROWS: usize>(
    own: &mut [f64],
    above: &[f64],
    n: usize,
    from: usize,
    rows: [usize; TOGETHER],
    multipliers: &[[f64; ROWS]; TOGETHER],
) {
    const WIDTH: usize = 8;
    let wide = from + (n - from) / WIDTH * WIDTH;
    for at in (from..wide).step_by(WIDTH) {
        let mut pivots = [[0.0; WIDTH]; TOGETHER];
        for (pivot, k) in pivots.iter_mut().zip(rows) {
            pivot.copy_from_slice(&above[k * n + at..][..WIDTH]);
        }
        for i in 0..ROWS {
            let values: &mut [f64; WIDTH] = (&mut own[i * n + at..][..WIDTH]).try_into().expect("as wide");
            let l = multipliers.map(|of_pivot| of_pivot[i]);
            for (j, x) in values.iter_mut().enumerate() {
                *x -= (l[0] * pivots[0][j] + l[1] * pivots[1][j]) + (l[2] * pivots[2][j] + l[3] * pivots[3][j]);
            }
        }
    }
    for at in wide..n {
        let pivots = rows.map(|k| above[k * n + at]);
        for i in 0..ROWS {
            let l = multipliers.map(|of_pivot| of_pivot[i]);
            own[i * n + at] -= (l[0] * pivots[0] + l[1] * pivots[1]) + (l[2] * pivots[2] + l[3] * pivots[3]);
        }
    }
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
fn eliminate_one(front: &mut Front<'_>, k: usize) {
    let pivot = front.values[k * front.n + k];
    // A zero pivot in a zero column: the unknown is left at zero.
    let inverse = if pivot == 0.0 { 0.0 } else { 1.0 / pivot };
    front.progress.done.push(Pivot { row: k, two: false, inverse: [inverse, 0.0, 0.0] });
}

/// The same of rows k and k + 1.
#[inline(always)]
fn eliminate_two(front: &mut Front<'_>, k: usize) {
    let n = front.n;
    let (first, second) = front.values[k * n..(k + 2) * n].split_at(n);
    let (a, b, d) = (first[k], first[k + 1], second[k + 1]);
    let determinant = a * d - b * b;
    let inverse = [d / determinant, -b / determinant, a / determinant];
    front.progress.done.push(Pivot { row: k, two: true, inverse });
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
    fn unknowns_that_only_zeros_couple_are_solved_for_on_their_own() {
        let matrix = Sparse::from_triplets(3, 3, &[(0, 0, 2.0), (0, 1, 0.0), (1, 1, -4.0), (2, 2, 1.0)]);
        let mut ldl = StagedLdl::new(&matrix, &[0, 0, 1]);
        assert_eq!(ldl.factorise(&matrix.values), Some(Inertia { positive: 2, negative: 1 }));
        let mut x = [1.0, 1.0, 1.0];
        ldl.solve(&mut x);
        assert_eq!(x, [0.5, -0.25, 1.0]);
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
