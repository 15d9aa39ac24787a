//! Small dense symmetric systems.

/// L of a positive definite matrix, row by row.
pub struct Cholesky {
    n: usize,
    lower: Vec<f64>,
}

/// A pivot below this fraction of its diagonal entry is dependent on those before: it is left out.
const DEPENDENT: f64 = 1e-14;

impl Cholesky {
    /// Factorises the matrix whose lower triangle is in `matrix` (n × n, row by row). Dependent rows are left out: their part of
    /// a solution is zero.
    pub fn new(n: usize, mut matrix: Vec<f64>) -> Self {
        for i in 0..n {
            for j in 0..i {
                let dot: f64 = (0..j).map(|k| matrix[i * n + k] * matrix[j * n + k]).sum();
                let pivot = matrix[j * n + j];
                matrix[i * n + j] = if pivot == 0.0 { 0.0 } else { (matrix[i * n + j] - dot) / pivot };
            }
            let square: f64 = (0..i).map(|k| matrix[i * n + k].powi(2)).sum();
            let left = matrix[i * n + i] - square;
            matrix[i * n + i] = if left > DEPENDENT * matrix[i * n + i] { left.sqrt() } else { 0.0 };
        }
        Self { n, lower: matrix }
    }

    pub fn solve(&self, right: &mut [f64]) {
        let (n, l) = (self.n, &self.lower);
        for i in 0..n {
            let dot: f64 = (0..i).map(|k| l[i * n + k] * right[k]).sum();
            right[i] = if l[i * n + i] == 0.0 { 0.0 } else { (right[i] - dot) / l[i * n + i] };
        }
        for i in (0..n).rev() {
            let dot: f64 = (i + 1..n).map(|k| l[k * n + i] * right[k]).sum();
            right[i] = if l[i * n + i] == 0.0 { 0.0 } else { (right[i] - dot) / l[i * n + i] };
        }
    }
}
