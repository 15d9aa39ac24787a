//! Singular values of a sparse matrix whose columns come in stages (time), counted without a dense factorisation: work and
//! memory linear in the number of stages.
//!
//! The eigenvalues of the symmetric matrix
//!
//! ```text
//!     ⎡ 0  Mᵀ ⎤
//!     ⎣ M  0  ⎦
//! ```
//!
//! are ±σ_i and zeros, so that the number of singular values above s > 0 is the number of positive pivots of its L D Lᵀ with −s on the
//! diagonal (Sylvester's law; [`StagedLdl`]). Nothing is squared: values down to about 1e-15 of the largest are told apart, as by a dense
//! decomposition. Inverse iteration on the same factors gives vectors of the null space.

use faer::{Mat, linalg::solvers::Qr};
use rand::{RngExt, SeedableRng};

use super::sparse::{Pattern, Sparse};
use super::staged::StagedLdl;

/// One matrix (rows × columns) and its symbolic factorisation.
#[derive(Clone, Debug)]
pub struct StagedSpectrum {
    rows: usize,
    columns: usize,
    matrix: Sparse,
    /// For each entry of M in storage order, its slot in `matrix`.
    slots: Vec<usize>,
    diagonal: Vec<usize>,
    factors: StagedLdl,
    sigma_max: f64,
    /// The shift that is factorised, and the count there.
    counted: Option<(f64, usize)>,
}

impl StagedSpectrum {
    /// Analyses the pattern of `m`; `row_stages` and `column_stages` count from 0.
    pub fn new(m: &Sparse, row_stages: &[usize], column_stages: &[usize]) -> Self {
        let (rows, columns) = (m.rows, m.columns);
        let order = rows + columns;
        let mut pattern = Pattern::new(order, order);
        m.entries().for_each(|(i, j, _)| pattern.add(j, columns + i));
        (0..order).for_each(|i| pattern.add(i, i));
        let matrix = pattern.build();
        let stages = [column_stages, row_stages].concat();
        Self {
            rows,
            columns,
            slots: m.entries().map(|(i, j, _)| pattern.slot(j, columns + i)).collect(),
            diagonal: (0..order).map(|i| pattern.slot(i, i)).collect(),
            factors: StagedLdl::new(&matrix, &stages, 0..0, columns..order),
            matrix,
            sigma_max: 0.0,
            counted: None,
        }
    }

    /// Takes the values of a matrix with the analysed pattern. Rows left at zero do not count.
    pub fn set(&mut self, m: &Sparse) {
        m.values.iter().zip(&self.slots).for_each(|(value, &slot)| self.matrix.values[slot] = *value);
        self.sigma_max = self.largest(m);
        self.counted = None;
    }

    /// σ_max, by Golub and Kahan's bidiagonalisation, to about one per cent or better.
    pub fn sigma_max(&self) -> f64 {
        self.sigma_max
    }

    fn largest(&self, m: &Sparse) -> f64 {
        let norm = |v: &[f64]| v.iter().map(|v| v * v).sum::<f64>().sqrt();
        let scale = |v: &mut [f64], by: f64| v.iter_mut().for_each(|v| *v *= by);
        // A start with a part along every coordinate.
        let mut x: Vec<f64> = (0..self.columns).map(|i| 1.0 + 0.5 * (i as f64 * 0.7).sin()).collect();
        let mut y = vec![0.0; self.rows];
        let mut bidiagonal = Mat::zeros(BIDIAGONAL, BIDIAGONAL);
        let mut beta = norm(&x);
        for k in 0..BIDIAGONAL {
            if beta == 0.0 {
                break;
            }
            scale(&mut x, 1.0 / beta);
            // α y = M x − β y, β x = Mᵀ y − α x
            scale(&mut y, if k == 0 { 0.0 } else { -beta });
            m.add_product(1.0, &x, &mut y);
            let alpha = norm(&y);
            bidiagonal[(k, k)] = alpha;
            if alpha == 0.0 {
                break;
            }
            scale(&mut y, 1.0 / alpha);
            scale(&mut x, -alpha);
            m.add_transpose_product(1.0, &y, &mut x);
            beta = norm(&x);
            if k + 1 < BIDIAGONAL {
                bidiagonal[(k, k + 1)] = beta;
            }
        }
        let values = if bidiagonal.is_all_finite() { bidiagonal.singular_values().ok() } else { None };
        values.and_then(|values| values.first().copied()).unwrap_or(f64::NAN)
    }

    /// Number of singular values above `s` > 0. `None` if a value is not finite.
    pub fn count_above(&mut self, s: f64) -> Option<usize> {
        if let Some((shift, count)) = self.counted
            && shift == s
        {
            return Some(count);
        }
        self.counted = None;
        self.diagonal.iter().for_each(|&slot| self.matrix.values[slot] = -s);
        let count = self.factors.factorise(&self.matrix.values)?.positive;
        self.counted = Some((s, count));
        Some(count)
    }

    /// The singular value with `index` (0 the largest), which is between `low` and `high`, to a relative `precision`; two counts if it is
    /// as near to `about`, one where that is well above rounding.
    pub fn value(
        &mut self,
        index: usize,
        (mut low, mut high): (f64, f64),
        precision: f64,
        about: Option<f64>,
    ) -> Option<f64> {
        if let Some(about) = about.filter(|about| low < *about && *about < high) {
            // It is no larger than `about` but for rounding: down from there in growing steps.
            let mut step = (1.0 + precision).sqrt();
            let mut middle = (about * step).min(high);
            let mut is_certain = about > CERTAIN * self.sigma_max;
            while low < middle && (std::mem::take(&mut is_certain) || self.count_above(middle)? <= index) {
                high = middle;
                middle = about / step;
                step = step.powi(4);
            }
            low = low.max(middle);
        }
        while high > low * (1.0 + precision) * (1.0 + 1e-12) {
            let middle = (low * high).sqrt();
            if self.count_above(middle)? > index { low = middle } else { high = middle }
        }
        Some((low * high).sqrt())
    }

    /// What is at and just above `cut`, by one factorisation and subspace iteration. `missing`: how many singular values of this side are at or
    /// below it, `count` of which are wanted. `m` is the matrix last set. `None` if a value is not finite.
    pub fn near(&mut self, m: &Sparse, side: Side, cut: f64, missing: usize, count: usize) -> Option<NearCut> {
        let (range, across) = match side {
            Side::Columns => (0..self.columns, self.rows),
            Side::Rows => (self.columns..self.rows + self.columns, self.columns),
        };
        // If all are wanted, a few more part them from what is just above the cut.
        let (count, guards) = if count < missing { (count, 0) } else { (missing, GUARDS) };
        let width = (count + guards).min(range.len()).min(across);
        if width == 0 {
            return Some(NearCut { below: Vec::new(), above: None });
        }
        let mut is_zero = vec![matches!(side, Side::Rows); range.len()];
        if let Side::Rows = side {
            m.entries().filter(|&(_, _, slot)| m.values[slot] != 0.0).for_each(|(row, ..)| is_zero[row] = false);
        }
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(0);
        let mut basis = Mat::from_fn(range.len(), width, |i, _| {
            let value = rng.random_range(-1.0..1.0);
            if is_zero[i] { 0.0 } else { value }
        });
        self.count_above(cut)?;
        let first = width.saturating_sub(count);
        let mut last = f64::INFINITY;
        let mut x = vec![0.0; self.rows + self.columns];
        for iteration in 1.. {
            for k in 0..width {
                x.fill(0.0);
                range.clone().enumerate().for_each(|(i, at)| x[at] = basis[(i, k)]);
                self.factors.solve(&mut x);
                range.clone().enumerate().for_each(|(i, at)| basis[(i, k)] = x[at]);
            }
            if !basis.is_all_finite() {
                return None;
            }
            basis = Qr::new(basis.as_ref()).compute_thin_Q();
            // Rayleigh and Ritz: the singular vectors of M within the subspace.
            let mut image = Mat::zeros(across, width);
            for k in 0..width {
                let vector: Vec<f64> = (0..range.len()).map(|i| basis[(i, k)]).collect();
                let mut y = vec![0.0; across];
                match side {
                    Side::Columns => m.add_product(1.0, &vector, &mut y),
                    Side::Rows => m.add_transpose_product(1.0, &vector, &mut y),
                }
                (0..across).for_each(|i| image[(i, k)] = y[i]);
            }
            let svd = Qr::new(image.as_ref()).thin_R().to_owned().svd().ok()?;
            let values = svd.S().column_vector();
            let above = first.checked_sub(1).map(|k| values[k]);
            let before = std::mem::replace(&mut last, above.unwrap_or(0.0));
            let has_settled = iteration >= LEAST_ITERATIONS && (before - last).abs() <= SETTLED * last;
            if has_settled || iteration == MOST_ITERATIONS {
                let vectors = &basis * svd.V();
                let of = |k: usize| (values[k], (0..range.len()).map(|i| vectors[(i, k)]).collect());
                return Some(NearCut { below: (first..width).map(of).collect(), above });
            }
        }
        None
    }
}

/// Whose singular vectors: the columns' (right) or the rows' (left).
#[derive(Clone, Copy, Debug)]
pub enum Side {
    Columns,
    Rows,
}

/// What is near a cut.
#[derive(Clone, Debug)]
pub struct NearCut {
    /// Orthonormal vectors of the space of the singular vectors with σ ≤ cut, each with its singular value within the subspace, largest first:
    /// as many as were wanted; the singular vectors themselves if those are all. A value above the cut says that it has not got there.
    pub below: Vec<(f64, Vec<f64>)>,
    /// About the smallest singular value above the cut; not if only some of those below were wanted.
    pub above: Option<f64>,
}

/// A Ritz value that is more than this share of σ_max is no smaller than the singular value but for what the precision allows.
const CERTAIN: f64 = 1e-9;
/// Order of the bidiagonal matrix of which σ_max is taken.
const BIDIAGONAL: usize = 20;
/// Inverse iterations; they end when the value above the cut changes by no more than this share.
const LEAST_ITERATIONS: usize = 2;
const MOST_ITERATIONS: usize = 12;
const SETTLED: f64 = 1e-4;
const GUARDS: usize = 2;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::rank;

    #[test]
    fn counts_values_and_null_vectors_agree_with_the_dense_decomposition() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(12);
        for (stages, rows_per, columns_per) in [(6usize, 4usize, 6usize), (6, 7, 5), (1, 5, 5)] {
            let (rows, columns) = (stages * rows_per, stages * columns_per);
            let mut triplets = Vec::new();
            for i in 0..rows {
                for j in 0..columns {
                    let near = (i / rows_per).abs_diff(j / columns_per) <= 1;
                    // Every third stage repeats a row and has a column of zeros.
                    let twin = if i % (3 * rows_per) == 1 { i - 1 } else { i };
                    if near && j % (2 * columns_per) != 3 && rng.random_range(0.0..1.0) < 0.8 {
                        triplets.push((twin, j, rng.random_range(-1.0..1.0)));
                        if twin != i || i % (3 * rows_per) == 0 {
                            let value = triplets.last().unwrap().2;
                            triplets.push((twin + 1, j, 2.0 * value));
                        }
                    }
                }
            }
            triplets.retain(|&(i, ..)| i < rows);
            let m = Sparse::from_triplets(rows, columns, &triplets);
            let dense = Mat::from_fn(rows, columns, |i, j| {
                m.entries().filter(|&(a, b, _)| a == i && b == j).map(|(.., slot)| m.values[slot]).sum::<f64>()
            });
            let svd = rank::by_svd(&dense).unwrap();
            let stage = |count: usize, per: usize| (0..count).map(|i| i / per).collect::<Vec<_>>();
            let mut spectrum = StagedSpectrum::new(&m, &stage(rows, rows_per), &stage(columns, columns_per));
            spectrum.set(&m);
            assert!((spectrum.sigma_max() / svd.singular_values[0] - 1.0).abs() < 1e-2);
            assert_eq!(spectrum.count_above(svd.tolerance), Some(svd.rank));
            let last = svd.rank - 1;
            let bracket = (svd.tolerance, svd.singular_values[0] * 1.01);
            for about in [None, Some(1.1 * svd.singular_values[last]), Some(svd.singular_values[last])] {
                let value = spectrum.value(last, bracket, 1e-6, about).unwrap();
                assert!((value / svd.singular_values[last] - 1.0).abs() < 1e-5);
            }
            for side in [Side::Columns, Side::Rows] {
                let rows_in_use = (0..rows).filter(|&i| (0..columns).any(|j| dense[(i, j)] != 0.0)).count();
                let (length, missing) = match side {
                    Side::Columns => (columns, columns - svd.rank),
                    Side::Rows => (rows, rows_in_use - svd.rank),
                };
                let near = spectrum.near(&m, side, svd.tolerance, missing, length).unwrap();
                assert_eq!(near.below.len(), missing);
                assert!(near.above.is_none_or(|above| (above / svd.singular_values[last] - 1.0).abs() < 0.5));
                for (a, (value, x)) in near.below.iter().enumerate() {
                    let mut y = vec![0.0; rows.max(columns)];
                    match side {
                        Side::Columns => m.add_product(1.0, x, &mut y),
                        Side::Rows => m.add_transpose_product(1.0, x, &mut y),
                    }
                    assert!(y.iter().all(|v| v.abs() < 1e-12) && *value < 1e-12, "{value}: {y:?}");
                    for (b, (_, other)) in near.below.iter().enumerate() {
                        let product: f64 = x.iter().zip(other).map(|(x, o)| x * o).sum();
                        assert!((product - f64::from(u8::from(a == b))).abs() < 1e-12);
                    }
                }
                if missing > 1 {
                    assert_eq!(spectrum.near(&m, side, svd.tolerance, missing, 1).unwrap().below.len(), 1);
                }
            }
        }
    }
}
