//! B-spline spaces on given breakpoints, by the Cox–de Boor recursion.
//!
//! A [`SplineSpace`] of degree `d` on `s` spans has `s + d` coefficients, and its splines are `d − 1` times
//! continuously differentiable (degree 0: piecewise constant, right-continuous). The knots are the breakpoints, with
//! the first and last repeated to multiplicity `d + 1`, so that the first coefficient is the value at the start.
//!
//! Source: C. de Boor, *A Practical Guide to Splines*, Springer 1978, ch. X.

/// The space of splines of a given degree on given breakpoints.
#[derive(Clone, Debug)]
pub struct SplineSpace {
    degree: usize,
    knots: Vec<f64>,
}

/// Values (or derivatives) at one time of the basis functions that are nonzero there: function `first + i` has the
/// value `values[i]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Basis {
    pub first: usize,
    pub values: Vec<f64>,
}

impl SplineSpace {
    /// The space of this degree on increasing `breakpoints` (seconds, at least two).
    ///
    /// # Panics
    /// If there are fewer than two breakpoints or they do not increase.
    pub fn new(degree: usize, breakpoints: &[f64]) -> Self {
        assert!(breakpoints.len() >= 2, "a spline space needs at least one span");
        assert!(breakpoints.windows(2).all(|w| w[0] < w[1]), "breakpoints must increase");
        let mut knots = vec![breakpoints[0]; degree];
        knots.extend_from_slice(breakpoints);
        knots.extend(std::iter::repeat_n(breakpoints[breakpoints.len() - 1], degree));
        Self { degree, knots }
    }

    pub fn degree(&self) -> usize {
        self.degree
    }

    /// Number of coefficients: spans + degree.
    pub fn dimension(&self) -> usize {
        self.knots.len() - self.degree - 1
    }

    /// The index k of the span with `knots[k] ≤ t < knots[k + 1]`; the last span includes the end point.
    fn span(&self, t: f64) -> usize {
        let last = self.knots.len() - self.degree - 2;
        let after = self.knots.partition_point(|&k| k <= t);
        after.saturating_sub(1).clamp(self.degree, last)
    }

    /// The basis at `t`, differentiated `derivative` times (per second to that power).
    ///
    /// Outside the breakpoints, the polynomials of the first and last span are extrapolated. Derivatives of order
    /// above the degree are zero.
    pub fn basis(&self, t: f64, derivative: usize) -> Basis {
        let k = self.span(t);
        let first = k - self.degree;
        if derivative > self.degree {
            return Basis { first, values: vec![0.0; self.degree + 1] };
        }
        // N_{i,r}(t), r = 0 … d − derivative, for the r + 1 functions that are nonzero on span k.
        let lower = self.degree - derivative;
        let mut values = vec![1.0];
        for r in 1..=lower {
            let mut next = vec![0.0; r + 1];
            for (i, value) in values.iter().enumerate() {
                let (left, right) = (self.knots[k + 1 + i - r], self.knots[k + 1 + i]);
                let share = value / (right - left);
                next[i] += share * (right - t);
                next[i + 1] += share * (t - left);
            }
            values = next;
        }
        // N'_{i,r} = r (N_{i,r−1} / (t_{i+r} − t_i) − N_{i+1,r−1} / (t_{i+r+1} − t_{i+1})), `derivative` times.
        for r in lower + 1..=self.degree {
            let mut next = vec![0.0; r + 1];
            for (i, value) in values.iter().enumerate() {
                let (left, right) = (self.knots[k + 1 + i - r], self.knots[k + 1 + i]);
                let share = r as f64 * value / (right - left);
                next[i] -= share;
                next[i + 1] += share;
            }
            values = next;
        }
        Basis { first, values }
    }

    /// The value at `t` of the `derivative`-th derivative of the spline with these coefficients.
    pub fn value(&self, coefficients: &[f64], t: f64, derivative: usize) -> f64 {
        let basis = self.basis(t, derivative);
        basis.values.iter().zip(&coefficients[basis.first..]).map(|(b, c)| b * c).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spaces() -> impl Iterator<Item = SplineSpace> {
        (0..=4).map(|degree| SplineSpace::new(degree, &[0.0, 0.1, 0.35, 0.5, 0.9, 1.0]))
    }

    #[test]
    fn the_basis_is_a_partition_of_unity_and_its_derivatives_sum_to_zero() {
        for space in spaces() {
            assert_eq!(space.dimension(), 5 + space.degree());
            for i in 0..=40 {
                let t = i as f64 / 40.0;
                let sum: f64 = space.basis(t, 0).values.iter().sum();
                assert!((sum - 1.0).abs() < 1e-14);
                assert!(space.basis(t, 0).values.iter().all(|&b| b >= -1e-15));
                if space.degree() > 0 {
                    assert!(space.basis(t, 1).values.iter().sum::<f64>().abs() < 1e-12);
                }
            }
        }
    }

    #[test]
    fn polynomials_of_the_degree_are_reproduced_with_their_derivatives() {
        for space in spaces().skip(1) {
            let d = space.degree();
            // Marsden: t = Σ ξ_i N_i with the Greville points ξ_i = mean of d interior knots.
            let greville: Vec<f64> =
                (0..space.dimension()).map(|i| space.knots[i + 1..=i + d].iter().sum::<f64>() / d as f64).collect();
            for i in 0..=20 {
                let t = i as f64 / 20.0;
                assert!((space.value(&greville, t, 0) - t).abs() < 1e-14);
                assert!((space.value(&greville, t, 1) - 1.0).abs() < 1e-12);
            }
            // t^d: each coefficient is its blossom, the product of d interior knots; its d-th derivative is d!.
            let power: Vec<f64> = (0..space.dimension()).map(|i| space.knots[i + 1..=i + d].iter().product()).collect();
            let factorial: f64 = (1..=d).map(|k| k as f64).product();
            for i in 0..=20 {
                let t = i as f64 / 20.0;
                assert!((space.value(&power, t, 0) - t.powi(d as i32)).abs() < 1e-13);
                assert!((space.value(&power, t, d) - factorial).abs() < 1e-8);
            }
        }
    }

    #[test]
    fn derivatives_agree_with_differences() {
        for space in spaces().skip(2) {
            let coefficients: Vec<f64> = (0..space.dimension()).map(|i| ((i * 7 + 3) % 5) as f64).collect();
            for t in [0.05, 0.2, 0.42, 0.7, 0.95] {
                let e = 1e-5;
                let difference =
                    (space.value(&coefficients, t + e, 0) - space.value(&coefficients, t - e, 0)) / (2.0 * e);
                assert!((difference - space.value(&coefficients, t, 1)).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn degree_zero_is_right_continuous_and_includes_the_end() {
        let space = SplineSpace::new(0, &[0.0, 0.5, 1.0]);
        assert_eq!(space.value(&[3.0, 4.0], 0.5, 0), 4.0);
        assert_eq!(space.value(&[3.0, 4.0], 1.0, 0), 4.0);
        assert_eq!(space.value(&[3.0, 4.0], 0.0, 0), 3.0);
    }
}
