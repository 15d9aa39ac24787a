//! The thesis' transcription: B-splines with exactly one collocation point in each span (`scheme = "midpoint"`).
//!
//! `p` collocation points `t_j = (j − 1) h`; breakpoints at the midpoints between neighbouring points, and the two ends:
//! `p` spans. A function of degree d has `p + d` coefficients: p equations at the points, and d initial values φ, which
//! are unknowns with equality rows of their own (thesis, Paper B eq. 13). A function has "the same degree as its highest
//! derivative": coordinates 2, fibre length and activation 1, excitation, reactions and controls r of actuators 0.
//!
//! Order of the decision vector, which keeps the problem banded in time, with coefficient k of each spline in block k:
//!
//! ```text
//! φ = q, q̇, l, a at t_1 | span 1: q l a u f_r r | span 2: q l a u f_r r | … | span p | tail: q l a | q
//! ```
//!
//! One point in the middle of a span is the implicit midpoint rule, which damps nothing: fibre velocities alternate
//! from point to point and do not converge with h. See the README.

use super::coefficients::{Coefficients, Family};
use super::scheme::{Combination, Discretisation, Place, Trajectory, evaluate};
use crate::numerics::bspline::SplineSpace;
use crate::problem::{ControlProblem, Kind, QuantityId};

/// The spline spaces and the place of every coefficient in the decision vector.
#[derive(Clone, Debug)]
pub struct Midpoint {
    /// Collocation points, s.
    points: Vec<f64>,
    breakpoints: Vec<f64>,
    /// By degree.
    spaces: [SplineSpace; 3],
    /// By quantity.
    kinds: Vec<Kind>,
    coefficients: Coefficients,
}

impl Midpoint {
    /// `points` collocation points, at least 2, on `duration` seconds.
    pub fn new(problem: &ControlProblem<'_>, points: usize, duration: f64) -> Self {
        let (points, breakpoints) = mesh(points, duration);
        let family = |quantity: &crate::problem::Quantity| Family {
            members: quantity.members.len(),
            blocks: if quantity.kind == Kind::Given { 0..0 } else { 0..points.len() + quantity.kind.order() },
            initial: quantity.kind.order(),
        };
        Self {
            spaces: [0, 1, 2].map(|degree| SplineSpace::new(degree, &breakpoints)),
            kinds: problem.quantities.iter().map(|quantity| quantity.kind).collect(),
            coefficients: Coefficients::new(problem.quantities.iter().map(family).collect()),
            points,
            breakpoints,
        }
    }

    fn quantities(&self) -> impl Iterator<Item = (QuantityId, Kind)> {
        let all = self.kinds.iter().enumerate().map(|(id, kind)| (QuantityId(id), *kind));
        all.filter(|(_, kind)| *kind != Kind::Given)
    }
}

/// The collocation points (s): `count` of them on `duration` seconds; and the breakpoints: the first point, the middles
/// between neighbours, the last point.
pub fn mesh(count: usize, duration: f64) -> (Vec<f64>, Vec<f64>) {
    let h = duration / (count - 1) as f64;
    let points: Vec<f64> = (0..count).map(|j| j as f64 * h).collect();
    let mut breakpoints = vec![points[0]];
    breakpoints.extend(points.windows(2).map(|w| 0.5 * (w[0] + w[1])));
    breakpoints.push(points[count - 1]);
    (points, breakpoints)
}

impl Discretisation for Midpoint {
    fn points(&self) -> &[f64] {
        &self.points
    }

    fn breakpoints(&self) -> &[f64] {
        &self.breakpoints
    }

    fn coefficients(&self) -> &Coefficients {
        &self.coefficients
    }

    fn place(&self, t: f64) -> Place {
        Place { time: t, piece: None, share: 0.0 }
    }

    fn point(&self, j: usize) -> Place {
        self.place(self.points[j])
    }

    /// Splines reach over several intervals: each point is one, after that of the initial values.
    fn stage(&self, point: usize) -> usize {
        1 + point
    }

    fn function(&self, place: Place, quantity: QuantityId, member: usize, derivative: usize) -> Combination {
        let basis = self.spaces[self.kinds[quantity.0].order()].basis(place.time, derivative);
        let index = |i| self.coefficients.index(quantity, basis.first + i, member);
        basis.values.iter().enumerate().map(|(i, &weight)| (index(i), weight)).collect()
    }

    fn is_complete(&self, _point: usize) -> bool {
        true
    }

    /// The trapezoidal rule.
    fn quadrature(&self) -> Vec<f64> {
        let n = self.points.len();
        let h = self.points[1] - self.points[0];
        (0..n).map(|j| if j == 0 || j == n - 1 { 0.5 * h } else { h }).collect()
    }

    /// The rows `spline(t_1) − φ = 0`.
    fn linear(&self) -> Vec<Combination> {
        let mut rows = Vec::new();
        for (quantity, kind) in self.quantities() {
            for derivative in 0..kind.order() {
                for member in 0..self.coefficients.members(quantity) {
                    let mut row = self.function(self.place(0.0), quantity, member, derivative);
                    row.push((self.coefficients.initial(quantity, derivative, member), -1.0));
                    rows.push(row);
                }
            }
        }
        rows
    }

    fn settle(&self, x: &mut [f64]) {
        for row in self.linear() {
            let (value, _) = row[row.len() - 1];
            x[value] += evaluate(&row, x);
        }
    }

    /// By the blossom: the coefficient of a spline of degree 2 on the knots a, b is `f(m) − f″(m) (b − a)²/8`, m their middle.
    fn compose(&self, functions: &dyn Trajectory) -> Vec<f64> {
        let mut x = vec![0.0; self.coefficients.total()];
        let clamped = |k: usize| self.breakpoints[k.clamp(1, self.breakpoints.len()) - 1];
        for (quantity, kind) in self.quantities() {
            for k in 0..self.coefficients.count(quantity) {
                let (a, b) = (clamped(k), clamped(k + 1));
                for member in 0..self.coefficients.members(quantity) {
                    let value = |t, derivative| functions.value(t, quantity, member, derivative);
                    x[self.coefficients.index(quantity, k, member)] = match kind.order() {
                        0 => value(self.points[k], 0),
                        1 => value(self.breakpoints[k], 0),
                        _ => {
                            let middle = 0.5 * (a + b);
                            value(middle, 0) - value(middle, 2) * (b - a).powi(2) / 8.0
                        }
                    };
                }
            }
        }
        self.settle(&mut x);
        x
    }
}
