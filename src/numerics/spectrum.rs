//! Counts the singular values of a sparse matrix whose rows and columns belong to stages (instants in time), without a
//! dense decomposition. Work and memory are linear in the number of stages.
//!
//! The eigenvalues of the symmetric matrix
//!
//! ```text
//!     ⎡ 0  Mᵀ ⎤
//!     ⎣ M  0  ⎦
//! ```
//!
//! are ±σ_i and zeros. The number of singular values above s > 0 is therefore the number of positive pivots of its LDLᵀ
//! factorisation with −s on the diagonal (Sylvester's law of inertia; [`StagedLdl`]). Nothing is squared, so singular
//! values down to about 1e-15 σ_max are resolved, as by a dense decomposition. Inverse iteration with the same factors
//! gives null vectors.

use faer::{Mat, linalg::solvers::Qr};
use rand::{RngExt, SeedableRng};

use super::sparse::{Pattern, Sparse};
use super::staged::StagedLdl;

/// A matrix M (rows × columns) and the factorisation of its augmented matrix.
#[derive(Clone, Debug)]
pub struct StagedSpectrum {
    rows: usize,
    columns: usize,
    /// The augmented matrix, upper triangle.
    matrix: Sparse,
    /// For each entry of M in storage order, its slot in `matrix`.
    slots: Vec<usize>,
    /// Slots of the diagonal in `matrix`.
    diagonal: Vec<usize>,
    factors: StagedLdl,
    sigma_max: f64,
    /// The shift s of the current factors, and the number of singular values above it.
    factorised: Option<(f64, usize)>,
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
            factorised: None,
        }
    }

    /// Sets the values of M, which must have the analysed pattern. Zero rows do not count.
    pub fn set(&mut self, m: &Sparse) {
        m.values.iter().zip(&self.slots).for_each(|(value, &slot)| self.matrix.values[slot] = *value);
        self.sigma_max = self.largest(m);
        self.factorised = None;
    }

    /// σ_max by Golub–Kahan bidiagonalisation, accurate to about 1 %.
    pub fn sigma_max(&self) -> f64 {
        self.sigma_max
    }

    fn largest(&self, m: &Sparse) -> f64 {
        let norm = |v: &[f64]| v.iter().map(|v| v * v).sum::<f64>().sqrt();
        let scale = |v: &mut [f64], by: f64| v.iter_mut().for_each(|v| *v *= by);
        // The start vector has a component along every coordinate.
        let mut x: Vec<f64> = (0..self.columns).map(|i| 1.0 + 0.5 * (i as f64 * 0.7).sin()).collect();
        let mut y = vec![0.0; self.rows];
        let mut bidiagonal = Mat::zeros(BIDIAGONAL_ORDER, BIDIAGONAL_ORDER);
        let mut beta = norm(&x);
        for k in 0..BIDIAGONAL_ORDER {
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
            if k + 1 < BIDIAGONAL_ORDER {
                bidiagonal[(k, k + 1)] = beta;
            }
        }
        let values = if bidiagonal.is_all_finite() { bidiagonal.singular_values().ok() } else { None };
        values.and_then(|values| values.first().copied()).unwrap_or(f64::NAN)
    }

    /// Number of singular values above `s` > 0. `None` if a value is not finite.
    pub fn count_above(&mut self, s: f64) -> Option<usize> {
        if let Some((shift, count)) = self.factorised
            && shift == s
        {
            return Some(count);
        }
        self.factorised = None;
        self.diagonal.iter().for_each(|&slot| self.matrix.values[slot] = -s);
        let count = self.factors.factorise(&self.matrix.values)?.positive;
        self.factorised = Some((s, count));
        Some(count)
    }

    /// The singular value number `index` (0 is the largest) to a relative `precision`, by bisection of the bracket
    /// (`low`, `high`). With an estimate `about` of that precision this takes two counts, or one if the estimate is
    /// well above rounding error. `None` if a value is not finite.
    pub fn value(
        &mut self,
        index: usize,
        (mut low, mut high): (f64, f64),
        precision: f64,
        about: Option<f64>,
    ) -> Option<f64> {
        if let Some(about) = about.filter(|about| low < *about && *about < high) {
            // `about` is an upper bound up to rounding: search downwards from it in growing steps.
            let mut step = (1.0 + precision).sqrt();
            let mut middle = (about * step).min(high);
            let mut is_reliable = about > RELIABLE_RITZ * self.sigma_max;
            while low < middle && (std::mem::take(&mut is_reliable) || self.count_above(middle)? <= index) {
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

    /// The singular vectors with σ ≤ `cut` and the singular value just above it, by one factorisation and inverse
    /// subspace iteration. `missing` is the number of singular values of this side at or below `cut`; at most `count`
    /// of their vectors are returned. `m` is the matrix last set. `None` if a value is not finite.
    pub fn near(&mut self, m: &Sparse, side: Side, cut: f64, missing: usize, count: usize) -> Option<NearCut> {
        let (range, across) = match side {
            Side::Columns => (0..self.columns, self.rows),
            Side::Rows => (self.columns..self.rows + self.columns, self.columns),
        };
        // If all are wanted, guard vectors separate them from the singular vectors just above the cut.
        let (count, guards) = if count < missing { (count, 0) } else { (missing, GUARD_VECTORS) };
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
            // Rayleigh–Ritz: the singular vectors of M restricted to the subspace.
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
            let has_converged = iteration >= MIN_ITERATIONS && (before - last).abs() <= CONVERGENCE_TOLERANCE * last;
            if has_converged || iteration == MAX_ITERATIONS {
                let vectors = &basis * svd.V();
                let of = |k: usize| (values[k], (0..range.len()).map(|i| vectors[(i, k)]).collect());
                return Some(NearCut { below: (first..width).map(of).collect(), above });
            }
        }
        None
    }
}

/// Which singular vectors: those of the columns (right) or of the rows (left).
#[derive(Clone, Copy, Debug)]
pub enum Side {
    Columns,
    Rows,
}

/// Singular vectors below a cut, and the singular value above it.
#[derive(Clone, Debug)]
pub struct NearCut {
    /// Orthonormal vectors in the span of the singular vectors with σ ≤ cut, as many as were requested, each with its
    /// Ritz value, largest first. If all were requested, they are the singular vectors themselves. A Ritz value above
    /// the cut means that the iteration has not converged.
    pub below: Vec<(f64, Vec<f64>)>,
    /// Approximation to the smallest singular value above the cut; `None` if only some of those below were requested.
    pub above: Option<f64>,
}

/// A Ritz value above this fraction of σ_max bounds its singular value from above to within the precision, so that no
/// count is needed to confirm it.
const RELIABLE_RITZ: f64 = 1e-9;
/// Order of the bidiagonal matrix whose largest singular value approximates σ_max.
const BIDIAGONAL_ORDER: usize = 20;
/// Limits on the number of subspace iterations.
const MIN_ITERATIONS: usize = 2;
const MAX_ITERATIONS: usize = 12;
/// Iteration stops when the singular value above the cut changes by no more than this, relative.
const CONVERGENCE_TOLERANCE: f64 = 1e-4;
/// Number of additional vectors in the subspace.
const GUARD_VECTORS: usize = 2;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::rank;

    #[test]
    fn counts_values_and_null_vectors_agree_with_the_dense_svd() {
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
