//! Banded Cholesky factorisation, for the normal equations of spline fits.

/// A symmetric positive definite band matrix, solved by Cholesky factorisation in place in O(n · band²).
pub struct SymmetricBand {
    order: usize,
    band: usize,
    /// `lower[i][k]` = entry (i, i − k), k = 0 … band.
    lower: Vec<Vec<f64>>,
}

impl SymmetricBand {
    pub fn new(order: usize, band: usize) -> Self {
        Self { order, band, lower: vec![vec![0.0; band + 1]; order] }
    }

    /// Adds `weight · b bᵀ`, where the vector b holds `values` from index `first` on and zeros elsewhere.
    pub fn add_outer(&mut self, first: usize, values: &[f64], weight: f64) {
        for (i, vi) in values.iter().enumerate() {
            for (j, vj) in values[..=i].iter().enumerate() {
                self.lower[first + i][i - j] += weight * vi * vj;
            }
        }
    }

    /// Solves for `right_hand_side` in place; `None` if the matrix is not positive definite.
    pub fn solve(mut self, right_hand_side: &mut [f64]) -> Option<()> {
        let (n, band) = (self.order, self.band);
        for i in 0..n {
            for j in i.saturating_sub(band)..=i {
                let from = i.saturating_sub(band).max(j.saturating_sub(band));
                let sum: f64 = (from..j).map(|k| self.lower[i][i - k] * self.lower[j][j - k]).sum();
                let value = self.lower[i][i - j] - sum;
                self.lower[i][i - j] = if i == j {
                    if value.is_nan() || value <= 0.0 {
                        return None;
                    }
                    value.sqrt()
                } else {
                    value / self.lower[j][0]
                };
            }
        }
        for i in 0..n {
            let sum: f64 = (i.saturating_sub(band)..i).map(|k| self.lower[i][i - k] * right_hand_side[k]).sum();
            right_hand_side[i] = (right_hand_side[i] - sum) / self.lower[i][0];
        }
        for i in (0..n).rev() {
            let sum: f64 = (i + 1..n.min(i + band + 1)).map(|k| self.lower[k][k - i] * right_hand_side[k]).sum();
            right_hand_side[i] = (right_hand_side[i] - sum) / self.lower[i][0];
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_difference_system_is_solved() {
        let n = 7;
        let mut matrix = SymmetricBand::new(n, 1);
        for i in 0..n {
            matrix.add_outer(i, &[1.0], 0.1);
        }
        for i in 0..n - 1 {
            matrix.add_outer(i, &[-1.0, 1.0], 1.0);
        }
        let expected: Vec<f64> = (0..n).map(|i| (i as f64).sin()).collect();
        let mut b = vec![0.0; n];
        for i in 0..n {
            b[i] += 0.1 * expected[i];
        }
        for i in 0..n - 1 {
            let d = expected[i + 1] - expected[i];
            b[i] -= d;
            b[i + 1] += d;
        }
        matrix.solve(&mut b).unwrap();
        assert!(b.iter().zip(&expected).all(|(x, y)| (x - y).abs() < 1e-12));
    }
}
