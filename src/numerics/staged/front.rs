//! Partial L D Lᵀ factorisation of one dense front.
//!
//! ```text
//!          fully summed    border
//!        ⎡               │         ⎤  panel: rows of the fully summed unknowns, all columns, updated after each pivot
//!   F =  ⎢───────────────┼─────────⎥
//!        ⎣               │    C    ⎦  border: its upper triangle, updated once, after the last pivot
//! ```
//!
//! Rows are stored in whole lanes, padded with zeros, and the border's columns start in a lane of their own, so that no
//! loop has a remainder. The code is compiled for each vector register width, with fused multiply–add in all of them, so
//! that the results are the same.

use bytemuck::{Pod, Zeroable, cast_slice, cast_slice_mut};
use pulp::{Arch, Simd, WithSimd};

/// A pivot must be at least this fraction of the largest entry in its column.
const PIVOT_THRESHOLD: f64 = 1e-4;
pub const LANE: usize = 8;

/// Columns processed together: the widest vector register, and one cache line.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct Lane(pub [f64; LANE]);

/// Number of lanes that hold `columns` columns.
pub fn lanes(columns: usize) -> usize {
    columns.div_ceil(LANE)
}

/// The lanes as a slice of numbers.
pub fn flat(lanes: &[Lane]) -> &[f64] {
    cast_slice(lanes)
}

pub fn flat_mut(lanes: &mut [Lane]) -> &mut [f64] {
    cast_slice_mut(lanes)
}

/// A pivot of order 1 or 2: its first row in the front, and entries (1,1), (1,2), (2,2) of the inverse of its block.
#[derive(Clone, Copy, Debug)]
pub struct Pivot {
    pub row: usize,
    /// Whether its order is 2.
    pub two: bool,
    pub inverse: [f64; 3],
}

/// The rows of the fully summed unknowns of a front, `width` lanes each.
pub struct Panel<'f> {
    pub values: &'f mut [Lane],
    pub width: usize,
    /// The unknown of each row.
    pub unknowns: &'f mut [u32],
}

impl Panel<'_> {
    #[inline(always)]
    fn row(&self, i: usize) -> &[Lane] {
        &self.values[i * self.width..][..self.width]
    }

    #[inline(always)]
    fn at(&self, i: usize, j: usize) -> f64 {
        flat(self.row(i))[j]
    }

    #[inline(always)]
    fn entry(&mut self, i: usize, j: usize) -> &mut f64 {
        &mut flat_mut(&mut self.values[i * self.width..][..self.width])[j]
    }

    /// Largest magnitude in row `c` from column `k` on, excluding columns `c` and `excluded`. All entries left of `k`
    /// are zero.
    #[inline(always)]
    fn largest<S: Simd>(&mut self, simd: S, k: usize, c: usize, excluded: usize) -> f64 {
        let kept = [c, excluded].map(|j| std::mem::replace(self.entry(c, j), 0.0));
        let size = largest_of(simd, &self.row(c)[k / LANE..]);
        // In reverse order, since the two columns may be the same.
        *self.entry(c, excluded) = kept[1];
        *self.entry(c, c) = kept[0];
        size
    }

    /// The candidate row other than `c` whose entry in row `c` has the largest magnitude.
    #[inline(always)]
    fn partner<S: Simd>(&mut self, simd: S, k: usize, c: usize) -> Option<usize> {
        let (first, rows) = (k / LANE, self.unknowns.len());
        let own = std::mem::replace(self.entry(c, c), 0.0);
        let row = &self.row(c)[first..lanes(rows)];
        let size = largest_of(simd, row);
        let place = || flat(row).iter().position(|v| v.abs() == size).map(|j| j + first * LANE);
        let found = if size > 0.0 { place() } else { None };
        *self.entry(c, c) = own;
        found
    }

    /// The next acceptable pivot among rows k, k + 1, …: one row, or two. The search starts at `from` and wraps around.
    #[inline(always)]
    fn find_pivot<S: Simd>(&mut self, simd: S, k: usize, from: usize) -> Option<(usize, Option<usize>)> {
        let rows = self.unknowns.len();
        let from = if from < rows { from.max(k) } else { k };
        for c in (from..rows).chain(k..from) {
            let a = self.at(c, c);
            if a != 0.0 && a.abs() >= PIVOT_THRESHOLD * self.largest(simd, k, c, c) {
                return Some((c, None));
            }
            let Some(r) = self.partner(simd, k, c) else { continue };
            let (rest_c, rest_r) = (self.largest(simd, k, c, r), self.largest(simd, k, r, c));
            let (b, d) = (self.at(c, r), self.at(r, r));
            let determinant = (a * d - b * b).abs();
            let growth = (d.abs() * rest_c + b.abs() * rest_r).max(b.abs() * rest_c + a.abs() * rest_r);
            if determinant > 0.0 && growth * PIVOT_THRESHOLD <= determinant {
                return Some((c, Some(r)));
            }
        }
        None
    }

    /// Swaps rows and columns i and j ≥ i.
    #[inline(always)]
    fn swap(&mut self, i: usize, j: usize) {
        if i == j {
            return;
        }
        self.unknowns.swap(i, j);
        let (head, tail) = self.values.split_at_mut(j * self.width);
        head[i * self.width..][..self.width].swap_with_slice(&mut tail[..self.width]);
        for row in flat_mut(self.values).chunks_exact_mut(self.width * LANE) {
            row.swap(i, j);
        }
    }

    /// Eliminates row k as a pivot of order 1 from the rows below it.
    #[inline(always)]
    fn eliminate_one<S: Simd>(&mut self, simd: S, k: usize) -> Pivot {
        let pivot = self.at(k, k);
        // A zero pivot occurs only in a zero column. The zero inverse sets the unknown to zero.
        let inverse = if pivot == 0.0 { 0.0 } else { 1.0 / pivot };
        let (above, below) = self.values.split_at_mut((k + 1) * self.width);
        let pivot_row = &above[k * self.width..];
        for (row, a) in below.chunks_exact_mut(self.width).zip(&flat(pivot_row)[k + 1..]) {
            if *a != 0.0 {
                subtract(simd, &mut row[k / LANE..], inverse * a, &pivot_row[k / LANE..]);
            }
            flat_mut(row)[k] = 0.0;
        }
        Pivot { row: k, two: false, inverse: [inverse, 0.0, 0.0] }
    }

    /// Eliminates rows k and k + 1 as a pivot of order 2 from the rows below them.
    #[inline(always)]
    fn eliminate_two<S: Simd>(&mut self, simd: S, k: usize) -> Pivot {
        let (a, b, d) = (self.at(k, k), self.at(k, k + 1), self.at(k + 1, k + 1));
        let determinant = a * d - b * b;
        let [p, q, r] = [d / determinant, -b / determinant, a / determinant];
        let (above, below) = self.values.split_at_mut((k + 2) * self.width);
        let (first, second) = above[k * self.width..].split_at(self.width);
        let columns = flat(first)[k + 2..].iter().zip(&flat(second)[k + 2..]);
        let (first, second) = (&first[k / LANE..], &second[k / LANE..]);
        for (row, (a, b)) in below.chunks_exact_mut(self.width).zip(columns) {
            if *a != 0.0 || *b != 0.0 {
                subtract_both(simd, &mut row[k / LANE..], [p * a + q * b, q * a + r * b], [first, second]);
            }
            flat_mut(row)[k..k + 2].fill(0.0);
        }
        Pivot { row: k, two: true, inverse: [p, q, r] }
    }
}

/// x −= l f
#[inline(always)]
fn subtract<S: Simd>(simd: S, x: &mut [Lane], l: f64, f: &[Lane]) {
    let l = simd.splat_f64s(-l);
    let (x, f) = (S::as_mut_simd_f64s(flat_mut(x)).0, S::as_simd_f64s(flat(f)).0);
    for (x, f) in x.iter_mut().zip(f) {
        *x = simd.mul_add_f64s(l, *f, *x);
    }
}

/// x −= l₁ f₁ + l₂ f₂
#[inline(always)]
fn subtract_both<S: Simd>(simd: S, x: &mut [Lane], l: [f64; 2], f: [&[Lane]; 2]) {
    let l = l.map(|l| simd.splat_f64s(-l));
    let (x, f) = (S::as_mut_simd_f64s(flat_mut(x)).0, f.map(|f| S::as_simd_f64s(flat(f)).0));
    for ((x, a), b) in x.iter_mut().zip(f[0]).zip(f[1]) {
        *x = simd.mul_add_f64s(l[1], *b, simd.mul_add_f64s(l[0], *a, *x));
    }
}

/// Largest magnitude.
#[inline(always)]
fn largest_of<S: Simd>(simd: S, values: &[Lane]) -> f64 {
    let values = S::as_simd_f64s(flat(values)).0;
    simd.reduce_max_f64s(values.iter().fold(simd.splat_f64s(0.0), |a, v| simd.max_f64s(a, simd.abs_f64s(*v))))
}

/// Σ aᵢ bᵢ. Uses one partial sum per lane column, so that the result does not depend on the vector register width. Runs
/// from the last lane to the first, because the caller has just written the first lane of `b`.
#[inline(always)]
fn dot<S: Simd>(simd: S, a: &[Lane], b: &[Lane]) -> f64 {
    let mut sums = Lane::default();
    for (a, b) in a.iter().zip(b).rev() {
        let (a, b) = (S::as_simd_f64s(&a.0).0, S::as_simd_f64s(&b.0).0);
        for (sum, (a, b)) in S::as_mut_simd_f64s(&mut sums.0).0.iter_mut().zip(a.iter().zip(b)) {
            *sum = simd.mul_add_f64s(*a, *b, *sum);
        }
    }
    let [a, b, c, d, e, f, g, h] = sums.0;
    ((a + e) + (c + g)) + ((b + f) + (d + h))
}

/// Eliminates all rows with an acceptable pivot and moves them to the front of the panel; in the last front, eliminates
/// every row. Returns the number of rows eliminated.
pub fn eliminate(panel: &mut Panel<'_>, is_last: bool, pivots: &mut Vec<Pivot>) -> usize {
    struct Eliminate<'a, 'f>(&'a mut Panel<'f>, bool, &'a mut Vec<Pivot>);
    impl WithSimd for Eliminate<'_, '_> {
        type Output = usize;

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> usize {
            let Self(panel, is_last, pivots) = self;
            let rows = panel.unknowns.len();
            // The search continues where it last ended: rejected rows are tried again after all the others.
            let (mut k, mut from) = (0, 0);
            while k < rows {
                let (c, partner) = match panel.find_pivot(simd, k, from) {
                    Some(pivot) => pivot,
                    None if !is_last => break,
                    // There is no parent to delay to: take the largest diagonal entry, however small.
                    None => {
                        let size = |i: usize| panel.at(i, i).abs();
                        ((k..rows).max_by(|&a, &b| size(a).total_cmp(&size(b))).unwrap_or(k), None)
                    }
                };
                panel.swap(k, c);
                from = c + 1;
                match partner {
                    None => {
                        pivots.push(panel.eliminate_one(simd, k));
                        k += 1;
                    }
                    Some(r) => {
                        panel.swap(k + 1, if r == k { c } else { r });
                        pivots.push(panel.eliminate_two(simd, k));
                        k += 2;
                    }
                }
            }
            k
        }
    }
    Arch::new().dispatch(Eliminate(panel, is_last, pivots))
}

/// C −= Uᵀ D⁻¹ U, where U holds the pivot rows of the panel from column lane `first` on. C is square, with as many
/// lanes of columns as U; entries left of its diagonal lanes are not updated. `scaled` is workspace for D⁻¹ U.
pub fn update_border(border: &mut [Lane], panel: &Panel<'_>, first: usize, pivots: &[Pivot], scaled: &mut Vec<Lane>) {
    struct UpdateBorder<'a> {
        border: &'a mut [Lane],
        rows: &'a [Lane],
        width: usize,
        first: usize,
        scaled: &'a [Lane],
    }
    impl WithSimd for UpdateBorder<'_> {
        type Output = ();

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            let Self { border, rows, width, first, scaled } = self;
            let per_lane = LANE / S::F64_LANES;
            let border_width = width - first;
            let rows = S::as_simd_f64s(flat(rows)).0;
            for tile in 0..border_width {
                let out = &mut border[tile * LANE * border_width..][..LANE * border_width];
                let out = S::as_mut_simd_f64s(flat_mut(out)).0;
                for column in tile * per_lane..border_width * per_lane {
                    let mut sums = [simd.splat_f64s(0.0); LANE];
                    let here = rows.iter().skip(first * per_lane + column).step_by(width * per_lane);
                    for (u, l) in here.zip(scaled.iter().skip(tile).step_by(border_width)) {
                        for (sum, l) in sums.iter_mut().zip(l.0) {
                            *sum = simd.mul_add_f64s(simd.splat_f64s(l), *u, *sum);
                        }
                    }
                    for (i, sum) in sums.into_iter().enumerate() {
                        let out = &mut out[i * border_width * per_lane + column];
                        *out = simd.sub_f64s(*out, sum);
                    }
                }
            }
        }
    }
    scaled.clear();
    for pivot in pivots {
        let [p, q, r] = pivot.inverse;
        let upper = &panel.row(pivot.row)[first..];
        if pivot.two {
            let lower = &panel.row(pivot.row + 1)[first..];
            for (p, q) in [(p, q), (q, r)] {
                let of_both = |(a, b): (&Lane, &Lane)| {
                    let mut both = *a;
                    both.0.iter_mut().zip(b.0).for_each(|(a, b)| *a = p * *a + q * b);
                    both
                };
                scaled.extend(upper.iter().zip(lower).map(of_both));
            }
        } else {
            scaled.extend(upper.iter().map(|a| Lane(a.0.map(|a| p * a))));
        }
    }
    let (rows, width) = (&panel.values[..pivots.last().map_or(0, Pivot::end) * panel.width], panel.width);
    Arch::new().dispatch(UpdateBorder { border, rows, width, first, scaled });
}

impl Pivot {
    /// Numbers of its positive and negative eigenvalues. `None` if it is not finite.
    pub fn signs(&self) -> Option<(usize, usize)> {
        let [p, q, r] = self.inverse;
        let determinant = p * r - q * q;
        match self.two {
            _ if !p.is_finite() || !determinant.is_finite() => None,
            false => Some(((p > 0.0).into(), (p < 0.0).into())),
            true if determinant < 0.0 => Some((1, 1)),
            true if p > 0.0 => Some((2, 0)),
            true => Some((0, 2)),
        }
    }

    /// The first row after it.
    pub fn end(&self) -> usize {
        self.row + 1 + usize::from(self.two)
    }
}

/// Forward substitution: applies L⁻¹ of a front to `x` in place. `rows` is its part of [`Factors`](super::Factors).
pub fn forward(pivots: &[Pivot], rows: &[Lane], x: &mut [Lane]) {
    struct Forward<'a>(&'a [Pivot], &'a [Lane], &'a mut [Lane]);
    impl WithSimd for Forward<'_> {
        type Output = ();

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            let Self(pivots, mut rows, x) = self;
            for pivot in pivots {
                let [p, q, r] = pivot.inverse;
                let known = flat(x);
                let (a, b) = (known[pivot.row], if pivot.two { known[pivot.row + 1] } else { 0.0 });
                let x = &mut x[pivot.row / LANE..];
                let first;
                (first, rows) = rows.split_at(x.len());
                if pivot.two {
                    let second;
                    (second, rows) = rows.split_at(x.len());
                    subtract_both(simd, x, [p * a + q * b, q * a + r * b], [first, second]);
                } else {
                    subtract(simd, x, p * a, first);
                }
            }
        }
    }
    Arch::new().dispatch(Forward(pivots, rows, x));
}

/// Backward substitution: applies L⁻ᵀ D⁻¹ of a front to `x` in place. `rows` as in [`forward`].
pub fn backward(pivots: &[Pivot], rows: &[Lane], x: &mut [Lane]) {
    struct Backward<'a>(&'a [Pivot], &'a [Lane], &'a mut [Lane]);
    impl WithSimd for Backward<'_> {
        type Output = ();

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            let Self(pivots, mut rows, x) = self;
            for pivot in pivots.iter().rev() {
                let [p, q, r] = pivot.inverse;
                let later = &x[pivot.row / LANE..];
                let last;
                (rows, last) = rows.split_at(rows.len() - later.len());
                if pivot.two {
                    let first;
                    (rows, first) = rows.split_at(rows.len() - later.len());
                    let sums = [dot(simd, first, later), dot(simd, last, later)];
                    let x = &mut flat_mut(x)[pivot.row..pivot.row + 2];
                    let (a, b) = (x[0] - sums[0], x[1] - sums[1]);
                    (x[0], x[1]) = (p * a + q * b, q * a + r * b);
                } else {
                    let sum = dot(simd, last, later);
                    let x = &mut flat_mut(x)[pivot.row];
                    *x = p * (*x - sum);
                }
            }
        }
    }
    Arch::new().dispatch(Backward(pivots, rows, x));
}
