//! The shortest way around an ellipsoid: straight to it, along a geodesic, straight on.
//!
//! ```text
//! f(x) = Σ x_i²/a_i² − 1 = 0,   n = ∇f/|∇f|
//! geodesic:  x″ = −κ n,   κ = x′ᵀ(∇²f) x′ / |∇f|
//! unknowns:  the first contact S (two numbers) and the length ℓ of the geodesic, which ends in E
//! equations: n(S)·(a − S) = 0,   n(E)·(b − E) = 0,   (n × x′)(E)·(b − E) = 0
//! ```
//!
//! The geodesic begins in the direction in which the straight part arrives. Newton's method from a taut string of a few
//! nodes. Source: A. Scholz et al., *Multibody Syst. Dyn.* 36, 2016 (one surface, derivatives by differences).

use super::frame::{Vector, along, cross, dot, minus, norm, unit};
use super::surface::{Contact, tangents};

const NODES: usize = 24;
const SWEEPS: usize = 400;
/// Runge–Kutta steps along the geodesic.
const STEPS: usize = 96;
const NEWTON: usize = 40;
const DIFFERENCE: f64 = 1e-7;
const TOLERANCE: f64 = 1e-13;

/// See [`super::surface::Shape::contact`].
pub fn around_ellipsoid(radii: &Vector, a: &Vector, b: &Vector) -> Option<Contact> {
    // In units of the mean radius.
    let unit_length = radii.iter().sum::<f64>() / 3.0;
    let scaled = |x: &Vector| x.map(|x| x / unit_length);
    let ellipsoid = Ellipsoid { radii: scaled(radii) };
    let (a, b) = (scaled(a), scaled(b));
    if !ellipsoid.hides(&a, &b) {
        return None;
    }
    let (first, length) = ellipsoid.string(&a, &b)?;
    let (first, last, length) = ellipsoid.taut(&a, &b, first, length)?;
    let back = |x: &Vector| x.map(|x| x * unit_length);
    (length > 0.0).then(|| Contact { first: back(&first), last: back(&last), length: length * unit_length })
}

struct Ellipsoid {
    radii: Vector,
}

impl Ellipsoid {
    fn value(&self, x: &Vector) -> f64 {
        (0..3).map(|i| (x[i] / self.radii[i]).powi(2)).sum::<f64>() - 1.0
    }

    fn gradient(&self, x: &Vector) -> Vector {
        [0, 1, 2].map(|i| 2.0 * x[i] / (self.radii[i] * self.radii[i]))
    }

    fn normal(&self, x: &Vector) -> Vector {
        unit(&self.gradient(x))
    }

    /// Whether the straight line from a to b, both outside, goes through.
    fn hides(&self, a: &Vector, b: &Vector) -> bool {
        if self.value(a) <= 0.0 || self.value(b) <= 0.0 {
            return false;
        }
        let over = |x: &Vector| [0, 1, 2].map(|i| x[i] / self.radii[i]);
        let (start, way) = (over(a), over(&minus(b, a)));
        let nearest = (-dot(&start, &way) / dot(&way, &way)).clamp(0.0, 1.0);
        let point = along(&start, nearest, &way);
        dot(&point, &point) < 1.0
    }

    /// The nearest point of the surface, as good as a few Newton steps along the gradient make it.
    fn onto(&self, x: &Vector) -> Vector {
        let mut x = *x;
        for _ in 0..4 {
            let gradient = self.gradient(&x);
            x = along(&x, -self.value(&x) / dot(&gradient, &gradient).max(1e-300), &gradient);
        }
        x
    }

    /// First contact and length on the surface of a string of nodes, pulled taut outside the ellipsoid.
    fn string(&self, a: &Vector, b: &Vector) -> Option<(Vector, f64)> {
        let way = minus(b, a);
        let mut nodes: Vec<Vector> = (0..=NODES).map(|k| along(a, k as f64 / NODES as f64, &way)).collect();
        for _ in 0..SWEEPS {
            for parity in [1, 2] {
                for k in (parity..NODES).step_by(2) {
                    let middle = [0, 1, 2].map(|i| 0.5 * (nodes[k - 1][i] + nodes[k + 1][i]));
                    nodes[k] = if self.value(&middle) < 0.0 { self.onto(&middle) } else { middle };
                }
            }
        }
        let touching: Vec<usize> = (1..NODES).filter(|&k| self.value(&nodes[k]) < 1e-6).collect();
        let (&first, &last) = (touching.first()?, touching.last()?);
        let length = (first..last).map(|k| norm(&minus(&nodes[k + 1], &nodes[k]))).sum::<f64>();
        Some((self.onto(&nodes[first]), length))
    }

    /// End and direction there of the geodesic of some length from `x` in the direction `t`; backwards for a negative length.
    fn geodesic(&self, x: Vector, t: Vector, length: f64) -> (Vector, Vector) {
        let acceleration = |x: &Vector, t: &Vector| {
            let gradient = self.gradient(x);
            let bent: f64 = (0..3).map(|i| 2.0 * t[i] * t[i] / (self.radii[i] * self.radii[i])).sum();
            gradient.map(|g| -g * bent / dot(&gradient, &gradient))
        };
        let h = length / STEPS as f64;
        let (mut x, mut t) = (x, t);
        for _ in 0..STEPS {
            let (v1, a1) = (t, acceleration(&x, &t));
            let (v2, a2) = (along(&t, h / 2.0, &a1), acceleration(&along(&x, h / 2.0, &v1), &along(&t, h / 2.0, &a1)));
            let (v3, a3) = (along(&t, h / 2.0, &a2), acceleration(&along(&x, h / 2.0, &v2), &along(&t, h / 2.0, &a2)));
            let (v4, a4) = (along(&t, h, &a3), acceleration(&along(&x, h, &v3), &along(&t, h, &a3)));
            for i in 0..3 {
                x[i] += h / 6.0 * (v1[i] + 2.0 * v2[i] + 2.0 * v3[i] + v4[i]);
                t[i] += h / 6.0 * (a1[i] + 2.0 * a2[i] + 2.0 * a3[i] + a4[i]);
            }
        }
        (x, unit(&t))
    }

    /// The three equations of the module for a first contact and a length, and the last contact.
    fn residual(&self, a: &Vector, b: &Vector, first: &Vector, length: f64) -> ([f64; 3], Vector) {
        let normal = self.normal(first);
        let arriving = minus(first, a);
        let direction = unit(&along(&arriving, -dot(&arriving, &normal), &normal));
        let (last, leaving) = self.geodesic(*first, direction, length);
        let (normal_last, rest) = (self.normal(&last), minus(b, &last));
        let across = cross(&normal_last, &leaving);
        ([-dot(&normal, &arriving), dot(&normal_last, &rest), dot(&across, &rest)], last)
    }

    /// Solves the equations of the module by a damped Newton method.
    fn taut(&self, a: &Vector, b: &Vector, first: Vector, length: f64) -> Option<(Vector, Vector, f64)> {
        let (mut first, mut length) = (first, length);
        let (mut residual, mut last) = self.residual(a, b, &first, length);
        let scale = norm(&minus(a, &first)).max(norm(&minus(b, &last))).max(1e-3);
        for _ in 0..NEWTON {
            if norm(&residual) <= TOLERANCE * scale {
                return Some((first, last, length));
            }
            let (u, v) = tangents(&self.normal(&first));
            let moved = |step: &Vector| {
                let point = along(&along(&first, step[0], &u), step[1], &v);
                (self.onto(&point), length + step[2])
            };
            let mut jacobian = [[0.0; 3]; 3];
            for column in 0..3 {
                let mut step = [0.0; 3];
                step[column] = DIFFERENCE;
                let (plus, plus_length) = moved(&step);
                let (minus_point, minus_length) = moved(&step.map(|s| -s));
                let up = self.residual(a, b, &plus, plus_length).0;
                let down = self.residual(a, b, &minus_point, minus_length).0;
                (0..3).for_each(|row| jacobian[row][column] = (up[row] - down[row]) / (2.0 * DIFFERENCE));
            }
            let step = solve(&jacobian, &residual.map(|r| -r))?;
            let mut share = 1.0;
            loop {
                let (point, trial_length) = moved(&step.map(|s| s * share));
                let (trial, trial_last) = self.residual(a, b, &point, trial_length);
                if norm(&trial) < norm(&residual) {
                    (first, length, residual, last) = (point, trial_length, trial, trial_last);
                    break;
                }
                share *= 0.5;
                if share < 1e-6 {
                    // As good as rounding lets it be, or not at all.
                    return (norm(&residual) <= 1e-9 * scale).then_some((first, last, length));
                }
            }
        }
        (norm(&residual) <= 1e-9 * scale).then_some((first, last, length))
    }
}

/// Cramer's rule; `None` for a singular matrix.
fn solve(matrix: &[[f64; 3]; 3], right: &Vector) -> Option<Vector> {
    let column = |j: usize| [matrix[0][j], matrix[1][j], matrix[2][j]];
    let (x, y, z) = (column(0), column(1), column(2));
    let determinant = dot(&x, &cross(&y, &z));
    let solution = [dot(right, &cross(&y, &z)), dot(&x, &cross(right, &z)), dot(&x, &cross(&y, right))];
    Some(solution.map(|s| s / determinant)).filter(|s| s.iter().all(|x| x.is_finite()))
}
