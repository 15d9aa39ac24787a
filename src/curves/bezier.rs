//! Curves pieced together of quintic Bézier curves with zero curvature at their ends (M. Millard et al., *J Biomech Eng* 135:021005,
//! 2013, appendix).

use super::Jet;
use crate::numerics::root::increasing_root;

/// A point with the slope of the curve there.
#[derive(Clone, Copy, Debug)]
pub struct Knot {
    pub x: f64,
    pub y: f64,
    pub slope: f64,
}

pub const fn knot(x: f64, y: f64, slope: f64) -> Knot {
    Knot { x, y, slope }
}

/// y(x), a line outside its knots.
#[derive(Clone, Debug)]
pub struct BezierCurve {
    knots: Vec<Knot>,
    corners: Vec<Corner>,
}

/// x(u) and y(u), u from 0 to 1, as coefficients of powers of u.
#[derive(Clone, Copy, Debug)]
struct Corner {
    x: [f64; 6],
    y: [f64; 6],
}

impl BezierCurve {
    /// The curve through `knots`. `curviness` of each piece: how near it comes to the corner of the lines through its two
    /// knots, from 0 (straight lines between the knots) to 1.
    pub fn new(knots: Vec<Knot>, curviness: &[f64]) -> Self {
        let corners = knots.windows(2).zip(curviness).map(|(ends, c)| Corner::new(ends[0], ends[1], 0.1 + 0.8 * c));
        Self { corners: corners.collect(), knots }
    }

    /// Whether x increases along it, so that each x has one y.
    pub fn is_function(&self) -> bool {
        let slope = |corner: &Corner, i: i32| power(&corner.x, f64::from(i) / 50.0)[1];
        self.corners.iter().all(|corner| (0..=50).all(|i| slope(corner, i) > 0.0))
    }

    pub fn at(&self, x: f64) -> Jet {
        match self.knots.iter().position(|knot| x < knot.x) {
            Some(0) => line(self.knots[0], x),
            Some(after) => {
                let corner = &self.corners[after - 1];
                corner.at(solve(&corner.x, x))
            }
            None => line(self.knots[self.knots.len() - 1], x),
        }
    }

    /// x at a value of y of an increasing curve.
    pub fn inverse(&self, y: f64) -> f64 {
        let last = self.knots[self.knots.len() - 1];
        match self.knots.iter().position(|knot| y < knot.y) {
            Some(0) => f64::NEG_INFINITY,
            Some(after) => {
                let corner = &self.corners[after - 1];
                power(&corner.x, solve(&corner.y, y))[0]
            }
            None => last.x + (y - last.y) / last.slope,
        }
    }
}

fn line(knot: Knot, x: f64) -> Jet {
    Jet { value: knot.y + knot.slope * (x - knot.x), first: knot.slope, second: 0.0 }
}

impl Corner {
    /// Control points lie on the lines through the ends, the inner ones twice, which makes the curvature vanish at the ends.
    fn new(from: Knot, to: Knot, curviness: f64) -> Self {
        let turn = from.slope - to.slope;
        let x = if turn.abs() > 1e-8 {
            (to.y - from.y - to.x * to.slope + from.x * from.slope) / turn
        } else {
            0.5 * (from.x + to.x)
        };
        let y = (x - to.x) * to.slope + to.y;
        let between = |from: f64, to: f64, middle: f64| {
            let (before, after) = (from + curviness * (middle - from), to + curviness * (middle - to));
            powers([from, before, before, after, after, to])
        };
        Self { x: between(from.x, to.x, x), y: between(from.y, to.y, y) }
    }

    fn at(&self, u: f64) -> Jet {
        let ([_, x1, x2], [y, y1, y2]) = (power(&self.x, u), power(&self.y, u));
        Jet { value: y, first: y1 / x1, second: (y2 * x1 - y1 * x2) / x1.powi(3) }
    }
}

/// The coefficients of powers of u, from the control points.
fn powers(p: [f64; 6]) -> [f64; 6] {
    let binomial = [1.0, 5.0, 10.0, 10.0, 5.0, 1.0];
    // The differences of order k of the control points.
    let (mut differences, mut found) = (p, [0.0; 6]);
    for k in 0..6 {
        found[k] = binomial[k] * differences[0];
        (0..5 - k).for_each(|i| differences[i] = differences[i + 1] - differences[i]);
    }
    found
}

/// A polynomial with its first two derivatives.
fn power(c: &[f64; 6], u: f64) -> [f64; 3] {
    let mut found = [0.0; 3];
    for &coefficient in c.iter().rev() {
        found[2] = found[2] * u + 2.0 * found[1];
        found[1] = found[1] * u + found[0];
        found[0] = found[0] * u + coefficient;
    }
    found
}

/// u in [0, 1] at which an increasing polynomial has a value.
fn solve(c: &[f64; 6], value: f64) -> f64 {
    let size = c.iter().sum::<f64>() - c[0];
    let start = ((value - c[0]) / size).clamp(0.0, 1.0);
    let precision = [2.0 * f64::EPSILON * size.abs(), f64::EPSILON];
    increasing_root([0.0, 1.0], start, precision, |u| {
        let [found, slope, _] = power(c, u);
        [found - value, slope]
    })
}
