//! Functions of one joint coordinate. They drive axes of joints, points of paths and dependent coordinates.

use num_dual::Dual64;
use serde::{Deserialize, Serialize};

use crate::error::Issue;
use crate::numerics::Scalar;
use crate::numerics::cubic::{CubicSpline, Ends};

/// A function as written in a model file. Its argument is in rad or m.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum FunctionEntry {
    /// Coefficients, the constant first: `[offset, slope]` is a line.
    Polynomial(Vec<f64>),
    /// Points `[x, y]` of a cubic spline, with increasing x. It extrapolates linearly. As in
    /// OpenSim's SimmSpline, the third derivative in each outer span is that of the cubic through the four outermost
    /// points. Two points define a line.
    Spline(Vec<[f64; 2]>),
    /// Points `[x, y]` of a piecewise linear function, with increasing x. It extrapolates linearly.
    Lines(Vec<[f64; 2]>),
}

/// A checked function.
#[derive(Clone, Debug)]
pub enum Function {
    /// Coefficients, the constant first.
    Polynomial(Vec<f64>),
    /// First and last abscissa, outside which it is straight; the spline.
    Spline([f64; 2], CubicSpline),
    Lines(Vec<[f64; 2]>),
}

impl FunctionEntry {
    /// Checks the function; `place` is its path in the model file.
    ///
    /// # Errors
    /// If there are no numbers or too few points, a number is not finite, or x does not increase.
    pub fn check(&self, place: &[&str]) -> Result<Function, Issue> {
        let numbers: Vec<f64> = match self {
            Self::Polynomial(numbers) => numbers.clone(),
            Self::Spline(points) | Self::Lines(points) => points.as_flattened().to_vec(),
        };
        if numbers.is_empty() || !numbers.iter().all(|x| x.is_finite()) {
            let help = "give finite numbers: polynomial = [offset, slope], or spline = [[x, y], …]";
            return Err(Issue::new(place, "the function is empty or contains a number that is not finite", help));
        }
        if let Self::Spline(points) | Self::Lines(points) = self
            && (points.len() < 2 || !points.windows(2).all(|w| w[0][0] < w[1][0]))
        {
            let help = "give at least two points [x, y] with increasing x";
            return Err(Issue::new(place, "the function has fewer than two points, or x does not increase", help));
        }
        Ok(match self {
            Self::Polynomial(coefficients) => Function::Polynomial(coefficients.clone()),
            Self::Lines(points) => Function::Lines(points.clone()),
            Self::Spline(points) if points.len() == 2 => Function::Lines(points.clone()),
            Self::Spline(points) => {
                let ends = [points[0][0], points[points.len() - 1][0]];
                let points: Vec<(f64, f64)> = points.iter().map(|p| (p[0], p[1])).collect();
                Function::Spline(ends, CubicSpline::new(&points, Ends::Differenced))
            }
        })
    }
}

impl Function {
    /// f(x) = x
    pub fn identity() -> Self {
        Self::Polynomial(vec![0.0, 1.0])
    }

    pub fn is_identity(&self) -> bool {
        matches!(self, Self::Polynomial(c) if c[..] == [0.0, 1.0])
    }

    /// Offset and slope if the function is a straight line.
    pub fn line(&self) -> Option<[f64; 2]> {
        match self {
            Self::Polynomial(c) if c.len() <= 2 => Some([c[0], c.get(1).copied().unwrap_or(0.0)]),
            Self::Lines(points) if points.len() == 2 => {
                let slope = (points[1][1] - points[0][1]) / (points[1][0] - points[0][0]);
                Some([points[0][1] - slope * points[0][0], slope])
            }
            _ => None,
        }
    }

    /// The value at `x`. Dual numbers carry exact derivatives through.
    pub fn at<T: Scalar>(&self, x: T) -> T {
        match self {
            Self::Polynomial(coefficients) => horner(coefficients, x),
            Self::Lines(points) => {
                let i = points.partition_point(|p| p[0] <= x.re()).clamp(1, points.len() - 1);
                let [[x0, y0], [x1, y1]] = [points[i - 1], points[i]];
                (x - x0) * ((y1 - y0) / (x1 - x0)) + y0
            }
            Self::Spline(ends, spline) => {
                let near = x.re().clamp(ends[0], ends[1]);
                let [value, first, second] = spline.at(near);
                if near == x.re() {
                    let third = spline.third(near);
                    horner(&[value, first, second / 2.0, third / 6.0], x - near)
                } else {
                    (x - near) * first + value
                }
            }
        }
    }

    /// Value and first four derivatives at `x`.
    pub fn derivatives(&self, x: f64) -> [f64; 5] {
        match self {
            Self::Polynomial(coefficients) => {
                let mut factors = coefficients.clone();
                [0; 5].map(|_| {
                    let value = horner(&factors, x);
                    factors = factors.iter().enumerate().skip(1).map(|(power, c)| power as f64 * c).collect();
                    value
                })
            }
            Self::Lines(_) => {
                let y = self.at(Dual64::new(x, 1.0));
                [y.re, y.eps, 0.0, 0.0, 0.0]
            }
            Self::Spline(ends, spline) => {
                let near = x.clamp(ends[0], ends[1]);
                let [value, first, second] = spline.at(near);
                if near == x {
                    [value, first, second, spline.third(near), 0.0]
                } else {
                    [value + (x - near) * first, first, 0.0, 0.0, 0.0]
                }
            }
        }
    }
}

fn horner<T: Scalar>(coefficients: &[f64], x: T) -> T {
    coefficients.iter().rev().fold(T::zero(), |sum, c| sum * x + *c)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn splines_reproduce_cubics_and_extrapolate_linearly() {
        let cubic = |x: f64| 1.0 - 2.0 * x + 3.0 * x * x - 0.5 * x * x * x;
        let points = [-1.0, -0.2, 0.1, 0.9, 1.3, 2.0].map(|x| [x, cubic(x)]);
        let spline = FunctionEntry::Spline(points.to_vec()).check(&["spline"]).unwrap();
        for x in [-0.9, -0.2, 0.0, 0.77, 1.9] {
            let y = spline.at(Dual64::new(x, 1.0));
            assert!((y.re - cubic(x)).abs() < 1e-12, "{x}");
            assert!((y.eps - (-2.0 + 6.0 * x - 1.5 * x * x)).abs() < 1e-11, "{x}");
        }
        let (end, slope) = (cubic(2.0), -2.0 + 12.0 - 6.0);
        assert!((spline.at(2.5) - (end + 0.5 * slope)).abs() < 1e-11);
    }

    #[test]
    fn three_points_make_a_parabola_and_two_a_line() {
        let parabola = FunctionEntry::Spline(vec![[0.0, 0.0], [1.0, 1.0], [3.0, 9.0]]).check(&["spline"]).unwrap();
        assert!((parabola.at(2.0) - 4.0f64).abs() < 1e-12);
        let line = FunctionEntry::Spline(vec![[0.0, 1.0], [2.0, 5.0]]).check(&["spline"]).unwrap();
        assert_eq!(line.line(), Some([1.0, 2.0]));
        assert!(FunctionEntry::Lines(vec![[0.0, 1.0], [0.0, 2.0]]).check(&["lines"]).is_err());
        assert!(FunctionEntry::Polynomial(vec![f64::NAN]).check(&["polynomial"]).is_err());
    }
}
