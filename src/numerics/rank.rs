//! Numerical rank of a dense matrix, by singular value decomposition or by QR with column pivoting.

use faer::{
    Mat,
    linalg::solvers::{ColPivQr, Qr},
};

/// Numerical rank of a matrix, with its singular values.
#[derive(Clone, Debug, PartialEq)]
pub struct Rank {
    pub rows: usize,
    pub columns: usize,
    pub rank: usize,
    /// Singular values at or below this count as zero: `max(rows, columns) · ε · σ_max`, as in MATLAB's `rank`.
    pub tolerance: f64,
    /// All `min(rows, columns)` singular values, in descending order.
    pub singular_values: Vec<f64>,
}

impl Rank {
    /// The rank from all singular values of a matrix (at least one), in descending order.
    fn new(rows: usize, columns: usize, singular_values: Vec<f64>) -> Self {
        let tolerance = tolerance(rows, columns, singular_values[0]);
        let rank = singular_values.iter().filter(|&&s| s > tolerance).count();
        Self { rows, columns, rank, tolerance, singular_values }
    }
}

/// The default tolerance of MATLAB's `rank`, as used in the thesis.
pub fn tolerance(rows: usize, columns: usize, sigma_max: f64) -> f64 {
    rows.max(columns) as f64 * f64::EPSILON * sigma_max
}

/// Rank by singular value decomposition.
///
/// # Errors
/// `None` if the matrix has a non-finite entry or the decomposition does not converge.
pub fn by_svd(matrix: &Mat<f64>) -> Option<Rank> {
    let (rows, columns) = (matrix.nrows(), matrix.ncols());
    if rows == 0 || columns == 0 {
        return Some(Rank { rows, columns, rank: 0, tolerance: 0.0, singular_values: Vec::new() });
    }
    if !matrix.is_all_finite() {
        return None;
    }
    Some(Rank::new(rows, columns, matrix.singular_values().ok()?))
}

/// As [`by_svd`], with an orthonormal basis of the null space.
pub fn with_null_space(matrix: &Mat<f64>) -> Option<(Rank, Vec<Vec<f64>>)> {
    let (rows, columns) = (matrix.nrows(), matrix.ncols());
    if rows == 0 || columns == 0 || !matrix.is_all_finite() {
        return by_svd(matrix).map(|rank| (rank, Vec::new()));
    }
    // M = Q R: R has the same singular values and right singular vectors as M, and no more rows than columns.
    let reduced = Qr::new(matrix.as_ref());
    let mut r = Mat::zeros(columns, columns);
    r.submatrix_mut(0, 0, rows.min(columns), columns).copy_from(reduced.thin_R());
    let mut singular_values: Vec<f64> = r.singular_values().ok()?;
    singular_values.truncate(rows.min(columns));
    let rank = Rank::new(rows, columns, singular_values);
    let mut null_space = Vec::new();
    if rank.rank < columns {
        let svd = r.svd().ok()?;
        let v = svd.V();
        null_space = (rank.rank..columns).map(|k| (0..columns).map(|i| v[(i, k)]).collect()).collect();
    }
    Some((rank, null_space))
}

/// Rank by QR with column pivoting: the number of diagonal entries of R above `max(rows, columns) · ε · |R₁₁|`. Several
/// times cheaper than [`by_svd`], and independent of it. `None` if the matrix has a non-finite entry.
pub fn by_pivoted_qr(matrix: &Mat<f64>) -> Option<usize> {
    let (rows, columns) = (matrix.nrows(), matrix.ncols());
    if rows == 0 || columns == 0 {
        return Some(0);
    }
    if !matrix.is_all_finite() {
        return None;
    }
    // Reduce a tall matrix to its R first: pivoting is cheaper on the smaller matrix.
    let tall = (rows > columns).then(|| Qr::new(matrix.as_ref()).thin_R().to_owned());
    let r = ColPivQr::new(tall.as_ref().unwrap_or(matrix).as_ref()).R().to_owned();
    let diagonal: Vec<f64> = (0..rows.min(columns)).map(|i| r[(i, i)].abs()).collect();
    let cut = tolerance(rows, columns, diagonal[0]);
    Some(diagonal.iter().filter(|&&d| d > cut).count())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_methods_find_the_rank_of_a_product() {
        for (rows, columns, rank) in [(9, 7, 4), (5, 12, 5), (12, 12, 1)] {
            let left = Mat::from_fn(rows, rank, |i, j| ((3 * i + 5 * j + i * j) as f64).sin());
            let right = Mat::from_fn(rank, columns, |i, j| ((7 * i + 2 * j + i * j) as f64).cos());
            let product = &left * &right;
            assert_eq!(by_svd(&product).unwrap().rank, rank);
            assert_eq!(by_pivoted_qr(&product), Some(rank));
        }
    }

    #[test]
    fn a_matrix_that_is_not_finite_has_no_rank() {
        let matrix = Mat::from_fn(2, 2, |_, _| f64::NAN);
        assert!(by_svd(&matrix).is_none());
        assert!(by_pivoted_qr(&matrix).is_none());
    }
}
