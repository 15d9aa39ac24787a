//! Interpolating cubic splines.

use super::banded::SymmetricBand;

/// End conditions of a spline.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Ends {
    /// Second derivative zero.
    Natural,
    /// First derivative zero.
    Flat,
    /// Third derivative equal to that of the cubic through the four outermost points; zero if there are only three
    /// points (G. E. Forsythe, M. A. Malcolm and C. B. Moler, *Computer Methods for Mathematical Computations*, 1977,
    /// ch. 4).
    Differenced,
}

/// A twice continuously differentiable piecewise cubic through points with increasing abscissae.
#[derive(Clone, Debug, PartialEq)]
pub struct CubicSpline {
    points: Vec<(f64, f64)>,
    /// Second derivatives at the points.
    moments: Vec<f64>,
}

impl CubicSpline {
    /// # Panics
    /// If there are fewer than two points or their abscissae do not increase.
    pub fn new(points: &[(f64, f64)], ends: Ends) -> Self {
        let n = points.len();
        assert!(n >= 2 && points.windows(2).all(|w| w[0].0 < w[1].0), "abscissae must increase");
        if ends == Ends::Differenced {
            return Self { points: points.to_vec(), moments: differenced(points) };
        }
        let mut matrix = SymmetricBand::new(n, 1);
        let mut moments = vec![0.0; n];
        for (i, pair) in points.windows(2).enumerate() {
            // Each span adds (h/6) [2 1; 1 2] = (h/6) ((1, 1)ᵀ(1, 1) + I) to the matrix, and ± its slope to the
            // right-hand side.
            let h = pair[1].0 - pair[0].0;
            let slope = (pair[1].1 - pair[0].1) / h;
            matrix.add_outer(i, &[1.0, 1.0], h / 6.0);
            matrix.add_outer(i, &[1.0], h / 6.0);
            matrix.add_outer(i + 1, &[1.0], h / 6.0);
            moments[i] += slope;
            moments[i + 1] -= slope;
        }
        if ends == Ends::Natural {
            // A large diagonal entry forces the end moments to zero.
            let penalty = 1e12 * (points[n - 1].0 - points[0].0);
            for end in [0, n - 1] {
                matrix.add_outer(end, &[1.0], penalty);
                moments[end] = 0.0;
            }
        }
        matrix.solve(&mut moments).expect("spline matrices are positive definite");
        Self { points: points.to_vec(), moments }
    }

    /// Value, first and second derivative at `x`. The end cubics are extrapolated outside the points.
    pub fn at(&self, x: f64) -> [f64; 3] {
        let i = self.points.partition_point(|p| p.0 <= x).clamp(1, self.points.len() - 1) - 1;
        let ((x0, y0), (x1, y1)) = (self.points[i], self.points[i + 1]);
        let (m0, m1) = (self.moments[i], self.moments[i + 1]);
        let h = x1 - x0;
        let (s, t) = ((x1 - x) / h, (x - x0) / h);
        [
            s * y0 + t * y1 + h * h / 6.0 * ((s.powi(3) - s) * m0 + (t.powi(3) - t) * m1),
            (y1 - y0) / h + h / 6.0 * ((1.0 - 3.0 * s * s) * m0 + (3.0 * t * t - 1.0) * m1),
            s * m0 + t * m1,
        ]
    }

    /// Third derivative at `x`, constant in each span.
    pub fn third(&self, x: f64) -> f64 {
        let i = self.points.partition_point(|p| p.0 <= x).clamp(1, self.points.len() - 1) - 1;
        (self.moments[i + 1] - self.moments[i]) / (self.points[i + 1].0 - self.points[i].0)
    }
}

/// Moments for [`Ends::Differenced`]. The prescribed third derivatives express the two outer moments by their
/// neighbours, so that only the inner moments are unknown.
fn differenced(points: &[(f64, f64)]) -> Vec<f64> {
    let n = points.len();
    if n == 2 {
        return vec![0.0; 2]; // a straight line
    }
    let width = |i: usize| points[i + 1].0 - points[i].0;
    let slope = |i: usize| (points[i + 1].1 - points[i].1) / width(i);
    let third = |i: usize| {
        let second = |i: usize| (slope(i + 1) - slope(i)) / (points[i + 2].0 - points[i].0);
        if n > 3 { 6.0 * (second(i + 1) - second(i)) / (points[i + 3].0 - points[i].0) } else { 0.0 }
    };
    let (first, last) = (third(0), third(n.saturating_sub(4)));
    let inner = n - 2;
    let mut matrix = SymmetricBand::new(inner, 1);
    let mut moments: Vec<f64> = (1..=inner).map(|i| slope(i) - slope(i - 1)).collect();
    for k in 0..inner {
        let (before, after) = (width(k), width(k + 1));
        matrix.add_outer(k, &[1.0], (before + after) / 3.0);
        if k + 1 < inner {
            // Adds the off-diagonal entry h/6 alone: the diagonal contributions cancel.
            matrix.add_outer(k, &[1.0, 1.0], after / 6.0);
            matrix.add_outer(k, &[1.0], -after / 6.0);
            matrix.add_outer(k + 1, &[1.0], -after / 6.0);
        }
    }
    let (h0, hn) = (width(0), width(n - 2));
    matrix.add_outer(0, &[1.0], h0 / 6.0);
    moments[0] += h0 * h0 / 6.0 * first;
    matrix.add_outer(inner - 1, &[1.0], hn / 6.0);
    moments[inner - 1] -= hn * hn / 6.0 * last;
    matrix.solve(&mut moments).expect("spline matrices are positive definite");
    let ends = [moments[0] - h0 * first, moments[inner - 1] + hn * last];
    [&ends[..1], &moments, &ends[1..]].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cubics_with_matching_ends_are_reproduced() {
        let x = [0.0, 0.3, 0.5, 0.8, 1.0];
        // 3x² − 2x³ is flat at 0 and 1.
        let points = x.map(|x| (x, 3.0 * x * x - 2.0 * x * x * x));
        let spline = CubicSpline::new(&points, Ends::Flat);
        for i in 0..=10 {
            let x = i as f64 / 10.0;
            let [value, first, second] = spline.at(x);
            assert!((value - (3.0 * x * x - 2.0 * x * x * x)).abs() < 1e-13);
            assert!((first - 6.0 * x * (1.0 - x)).abs() < 1e-12);
            assert!((second - (6.0 - 12.0 * x)).abs() < 1e-11);
        }
        let line = CubicSpline::new(&x.map(|x| (x, 2.0 * x - 1.0)), Ends::Natural);
        assert!((line.at(0.65)[0] - 0.3).abs() < 1e-14 && line.at(0.1)[2].abs() < 1e-10);
    }
}
