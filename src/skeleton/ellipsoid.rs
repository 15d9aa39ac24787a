//! The shortest path from a to b around an ellipsoid: a straight part, a geodesic on the surface, and a straight part.
//!
//! ```text
//! f(x) = Σ x_i²/a_i² − 1 = 0,   n = ∇f/|∇f|
//! geodesic:  x″ = −κ n,   κ = x′ᵀ(∇²f) x′ / |∇f|
//! unknowns:  the first contact S (two numbers) and the length ℓ of the geodesic, which ends at E
//! equations: r_1 = n(S)·(a − S) = 0,   r_2 = n(E)·(b − E) = 0,   r_3 = b̂(E)·(b − E) = 0,   b̂ = n × x′
//! ```
//!
//! The geodesic starts in the direction in which the straight part arrives. The deviation of its neighbours
//! (y″ = −K y, K the Gaussian curvature) is integrated along with it and gives the Newton matrix. Let κ be the normal
//! curvature of the surface along x′, τ its geodesic torsion, D the lengths of the straight parts, and y and
//! m = y + D_b y′ the deviations at E and at b of a ray that leaves a with slope 1. Moving S by σ and β, and E by η,
//! changes the residuals:
//!
//! ```text
//! S + σ x′ + β b̂,  E + η x′:   δr_3 = −m β/D_a,   δr_1 = −D_a (κ_S σ + τ_S β),   δr_2 = D_b (κ_E η + τ_E y β/D_a)
//! ```
//!
//! The matrix is exact at the solution, so that convergence is quadratic. The iteration starts from the affine image of
//! the path around a sphere or, if that fails, from a taut polyline.
//!
//! Source: A. Scholz et al., *Multibody Syst. Dyn.* 36, 2016.

use super::frame::{Vector, along, cross, dot, minus, norm, unit};
use super::half_ellipsoid::guide;
use super::shape::{Contact, Side, Spread, Wrap, around_sphere};

/// Intervals of a polyline.
const NODES: usize = 24;
/// Relaxation sweeps over a polyline.
const SWEEPS: usize = 400;
/// Maximum number of Newton iterations.
const MAX_ITERATIONS: usize = 40;

/// A residual below this fraction of the straight parts that no longer decreases is at rounding level.
const ROUNDING: f64 = 1e-11;

/// Accuracy of a path.
#[derive(Clone, Copy)]
struct Accuracy {
    /// Runge–Kutta steps along the geodesic.
    steps: usize,
    /// Newton's method ends at a residual below this fraction of the straight parts.
    target: f64,
    /// The path is rejected if its final residual is above this fraction of the straight parts.
    limit: f64,
}

const FINE: Accuracy = Accuracy { steps: 48, target: 1e-13, limit: 1e-9 };
/// Provides the starting point of [`FINE`].
const ROUGH: Accuracy = Accuracy { steps: 8, target: 1e-3, limit: 1e-2 };
/// A rough path is not used if it is farther from its start than this fraction of the smallest radius.
const MAX_ROUGH_SHIFT: f64 = 0.5;

/// An end at which Σ x²/r² − 1 is below this is inside, as in OpenSim.
const ON_SURFACE: f64 = -1e-4;

/// [`super::surface::Shape::wrap`] for an ellipsoid.
pub fn around_ellipsoid(radii: &Vector, side: Option<Side>, a: &Vector, b: &Vector, near: Option<&Contact>) -> Wrap {
    // Work in units of the mean radius.
    let unit_length = radii.iter().sum::<f64>() / 3.0;
    let scaled = |x: &Vector| x.map(|x| x / unit_length);
    let radii = scaled(radii);
    let ellipsoid = Ellipsoid { radii, weights: radii.map(|r| 2.0 / (r * r)) };
    let (a, b) = (scaled(a), scaled(b));
    if ellipsoid.value(&a) < ON_SURFACE || ellipsoid.value(&b) < ON_SURFACE {
        return Wrap::Inside;
    }
    if !ellipsoid.blocks(&a, &b) {
        return Wrap::Missed;
    }
    let near = near.map(|near| (scaled(&near.first), near.length / unit_length));
    let found = match side {
        None => ellipsoid.shortest(&a, &b, near),
        Some(side) => ellipsoid.shortest_on(side, &a, &b, near),
    };
    let Some(found) = found.filter(|found| found.length > 0.0) else { return Wrap::Missed };
    let back = |x: &Vector| x.map(|x| x * unit_length);
    let Spread { along, turned, bent, kept } = found.spread;
    let spread = Spread { along, turned: turned * unit_length, bent: bent / unit_length, kept };
    let (first, last) = (back(&found.first), back(&found.last));
    Wrap::Certain(Contact { first, last, length: found.length * unit_length, spread })
}

/// An ellipsoid centred at the origin, f(x) = 0.
struct Ellipsoid {
    radii: Vector,
    /// Second derivatives of f: 2/r².
    weights: Vector,
}

impl Ellipsoid {
    /// f(x)
    fn value(&self, x: &Vector) -> f64 {
        (0..3).map(|i| (x[i] / self.radii[i]).powi(2)).sum::<f64>() - 1.0
    }

    /// ∇f(x)
    fn gradient(&self, x: &Vector) -> Vector {
        [0, 1, 2].map(|i| self.weights[i] * x[i])
    }

    fn normal(&self, x: &Vector) -> Vector {
        unit(&self.gradient(x))
    }

    /// The shortest path around. `near`: first contact and arc length of a path nearby, as a starting guess.
    fn shortest(&self, a: &Vector, b: &Vector, near: Option<(Vector, f64)>) -> Option<Contact> {
        let fine = |first, length| self.taut(a, b, first, length, &FINE);
        let affine = self.affine(a, b);
        // The shortest path is not longer than the affine one. This rejects geodesics that go around more than once.
        let is_short = |contact: &Contact| {
            contact.length > 0.0 && affine.is_none_or(|(_, _, all)| contact.path_length(a, b) <= all * (1.0 + 1e-3))
        };
        let nearby = |(first, length)| fine(self.onto(&first), length).filter(is_short);
        let around = || {
            let (first, length, _) = affine?;
            let is_near = |contact: &Contact| {
                let far = norm(&minus(&contact.first, &first)).max((contact.length - length).abs());
                far < MAX_ROUGH_SHIFT * self.radii.iter().copied().fold(f64::INFINITY, f64::min)
            };
            let rough = self.taut(a, b, first, length, &ROUGH).filter(is_near);
            let from_rough = rough.and_then(|rough| fine(rough.first, rough.length)).filter(is_short);
            from_rough.or_else(|| fine(first, length).filter(is_short))
        };
        let string = || {
            let (first, length) = self.string(a, b)?;
            fine(first, length)
        };
        near.and_then(nearby).or_else(around).or_else(string)
    }

    /// The geodesic nearest to OpenSim's path around one half, see [`half_ellipsoid`](super::half_ellipsoid).
    fn shortest_on(&self, side: Side, a: &Vector, b: &Vector, near: Option<(Vector, f64)>) -> Option<Contact> {
        let (first, length) = self.section(a, b, &guide(&self.radii, side, a, b)?)?;
        let is_near = |contact: &Contact| {
            let all = norm(&minus(&first, a)) + length;
            contact.length > 0.0 && (contact.path_length(a, b) - all).abs() < all
        };
        let fine = |first, length| self.taut(a, b, first, length, &FINE).filter(is_near);
        let nearby = |(first, length)| fine(self.onto(&first), length);
        near.and_then(nearby).or_else(|| fine(first, length)).or_else(|| self.shortest(a, b, None))
    }

    /// First contact and arc length of the path in the plane through both ends and the surface point `through`, on the
    /// side of that point.
    fn section(&self, a: &Vector, b: &Vector, through: &Vector) -> Option<(Vector, f64)> {
        // The affine map to the unit sphere preserves planes and tangents.
        let over = |x: &Vector| [0, 1, 2].map(|i| x[i] / self.radii[i]);
        let [a, b, through] = [a, b, through].map(over);
        let direction = unit(&minus(&b, &a));
        let up = minus(&through, &a);
        let up = unit(&along(&up, -dot(&up, &direction), &direction));
        let normal = cross(&direction, &up);
        let centre = normal.map(|n| n * dot(&normal, &a));
        let radius = (1.0 - dot(&centre, &centre)).max(0.0).sqrt();
        let polar = |x: &Vector| {
            let x = minus(x, &centre);
            (dot(&x, &up).atan2(dot(&x, &direction)), norm(&x))
        };
        let ((angle_a, far_a), (angle_b, far_b)) = (polar(&a), polar(&b));
        let (beta_a, beta_b) = ((radius / far_a).min(1.0).acos(), (radius / far_b).min(1.0).acos());
        // Over the top of the circle of intersection, clockwise from a to b.
        let (from, to) = (angle_a - beta_a, angle_b + beta_b);
        let arc = (from - to).rem_euclid(std::f64::consts::TAU);
        let at = |k: usize| {
            let (sin, cos) = (from - arc * k as f64 / NODES as f64).sin_cos();
            let x = along(&along(&centre, radius * cos, &direction), radius * sin, &up);
            [0, 1, 2].map(|i| x[i] * self.radii[i])
        };
        let length: f64 = (0..NODES).map(|k| norm(&minus(&at(k + 1), &at(k)))).sum();
        (radius > 0.0 && length.is_finite()).then_some((at(0), length))
    }

    /// True if the straight line from a to b, both outside, runs through the ellipsoid.
    fn blocks(&self, a: &Vector, b: &Vector) -> bool {
        let over = |x: &Vector| [0, 1, 2].map(|i| x[i] / self.radii[i]);
        let (start, direction) = (over(a), over(&minus(b, a)));
        let nearest = (-dot(&start, &direction) / dot(&direction, &direction)).clamp(0.0, 1.0);
        let point = along(&start, nearest, &direction);
        dot(&point, &point) < 1.0
    }

    /// Projects a point onto the surface by four Newton steps along the gradient of f.
    fn onto(&self, x: &Vector) -> Vector {
        let mut x = *x;
        for _ in 0..4 {
            let gradient = self.gradient(&x);
            x = along(&x, -self.value(&x) / dot(&gradient, &gradient).max(1e-300), &gradient);
        }
        x
    }

    /// First contact and arc length of a polyline that is pulled taut outside the ellipsoid.
    fn string(&self, a: &Vector, b: &Vector) -> Option<(Vector, f64)> {
        let direction = minus(b, a);
        let mut nodes: Vec<Vector> = (0..=NODES).map(|k| along(a, k as f64 / NODES as f64, &direction)).collect();
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

    /// First contact, arc length and total length of the affine image of the path around the unit sphere.
    fn affine(&self, a: &Vector, b: &Vector) -> Option<(Vector, f64, f64)> {
        let over = |x: &Vector| [0, 1, 2].map(|i| x[i] / self.radii[i]);
        let back = |x: &Vector| [0, 1, 2].map(|i| x[i] * self.radii[i]);
        let contact = around_sphere(1.0, None, &over(a), &over(b)).contact()?;
        let (sin, cos) = contact.length.sin_cos();
        let across = along(&contact.last, -cos, &contact.first).map(|x| x / sin.max(1e-12));
        let at = |k: usize| {
            let (sin, cos) = (contact.length * k as f64 / NODES as f64).sin_cos();
            back(&along(&contact.first.map(|x| x * cos), sin, &across))
        };
        let length: f64 = (0..NODES).map(|k| norm(&minus(&at(k + 1), &at(k)))).sum();
        let (first, last) = (back(&contact.first), back(&contact.last));
        let all = norm(&minus(&first, a)) + length + norm(&minus(b, &last));
        Some((first, length, all))
    }

    /// The geodesic of a given length from `x` in the direction `t` (backwards if the length is negative), by `steps`
    /// fourth-order Runge–Kutta steps.
    fn geodesic(&self, x: Vector, t: Vector, length: f64, steps: usize) -> Geodesic {
        // Returns x″ and −K, where the Gaussian curvature is K = 1/(∏ r² (Σ x²/r⁴)²).
        let curved = -2.0 * self.weights.iter().product::<f64>();
        let accelerations = |x: &Vector, t: &Vector| {
            let gradient = self.gradient(x);
            let inverse = 1.0 / dot(&gradient, &gradient);
            let factor = -inverse * dot(&self.gradient(t), t);
            (gradient.map(|g| g * factor), curved * inverse * inverse)
        };
        let h = length / steps as f64;
        // The state (x, t), and the deviations (y, y′) that start from (1, 0) and from (0, 1).
        let (mut x, mut t, mut y) = (x, t, [1.0, 0.0, 0.0, 1.0]);
        let rate = |y: &[f64; 4], k: f64| [y[1], k * y[0], y[3], k * y[2]];
        let step = |y: &[f64; 4], h: f64, by: &[f64; 4]| [0, 1, 2, 3].map(|i| y[i] + h * by[i]);
        for _ in 0..steps {
            let (a1, k1) = accelerations(&x, &t);
            let (v1, y1) = (t, rate(&y, k1));
            let v2 = along(&t, h / 2.0, &a1);
            let (a2, k2) = accelerations(&along(&x, h / 2.0, &v1), &v2);
            let y2 = rate(&step(&y, h / 2.0, &y1), k2);
            let v3 = along(&t, h / 2.0, &a2);
            let (a3, k3) = accelerations(&along(&x, h / 2.0, &v2), &v3);
            let y3 = rate(&step(&y, h / 2.0, &y2), k3);
            let v4 = along(&t, h, &a3);
            let (a4, k4) = accelerations(&along(&x, h, &v3), &v4);
            let y4 = rate(&step(&y, h, &y3), k4);
            for i in 0..3 {
                x[i] += h / 6.0 * (v1[i] + 2.0 * v2[i] + 2.0 * v3[i] + v4[i]);
                t[i] += h / 6.0 * (a1[i] + 2.0 * a2[i] + 2.0 * a3[i] + a4[i]);
            }
            (0..4).for_each(|i| y[i] += h / 6.0 * (y1[i] + 2.0 * y2[i] + 2.0 * y3[i] + y4[i]));
        }
        Geodesic { end: x, direction: unit(&t), spread: Spread { along: y[0], bent: y[1], turned: y[2], kept: y[3] } }
    }

    /// Normal curvature along `t` and geodesic torsion (rotation of the normal towards `across`) at `x`.
    fn curvature(&self, x: &Vector, t: &Vector, across: &Vector) -> (f64, f64) {
        let change = self.gradient(t);
        let slope = norm(&self.gradient(x));
        (dot(&change, t) / slope, dot(&change, across) / slope)
    }

    /// Evaluates the equations of the module head for a first contact and an arc length.
    fn trial(&self, a: &Vector, b: &Vector, first: Vector, length: f64, steps: usize) -> Trial {
        let normal = self.normal(&first);
        let arriving = minus(&first, a);
        let direction = unit(&along(&arriving, -dot(&arriving, &normal), &normal));
        let geodesic = self.geodesic(first, direction, length, steps);
        let (normal_last, rest) = (self.normal(&geodesic.end), minus(b, &geodesic.end));
        let across = cross(&normal_last, &geodesic.direction);
        let residual = [-dot(&normal, &arriving), dot(&normal_last, &rest), dot(&across, &rest)];
        Trial { first, length, direction, geodesic, residual }
    }

    /// Solves the equations of the module head by a damped Newton method. `None` if it fails.
    fn taut(&self, a: &Vector, b: &Vector, first: Vector, length: f64, accuracy: &Accuracy) -> Option<Contact> {
        let mut now = self.trial(a, b, first, length, accuracy.steps);
        let scale = norm(&minus(a, &now.first)).max(norm(&minus(b, &now.geodesic.end))).max(1e-3);
        let done = |trial: &Trial| {
            let Geodesic { end, spread, .. } = trial.geodesic;
            (norm(&trial.residual) <= accuracy.limit * scale).then_some(Contact {
                first: trial.first,
                last: end,
                length: trial.length,
                spread,
            })
        };
        for _ in 0..MAX_ITERATIONS {
            if norm(&now.residual) <= accuracy.target * scale {
                break;
            }
            let [r1, r2, r3] = now.residual;
            let (end, direction_last) = (now.geodesic.end, now.geodesic.direction);
            let Spread { along: c, turned, bent, kept } = now.geodesic.spread;
            let da = dot(&minus(&now.first, a), &now.direction).max(1e-3 * scale);
            let db = dot(&minus(b, &end), &direction_last).max(1e-3 * scale);
            let across = cross(&self.normal(&now.first), &now.direction);
            let across_last = cross(&self.normal(&end), &direction_last);
            let (bend, torsion) = self.curvature(&now.first, &now.direction, &across);
            let (bend_last, torsion_last) = self.curvature(&end, &direction_last, &across_last);
            let (y, m) = (da * c + turned, da * c + turned + db * (da * bent + kept));
            let beta = r3 * da / m;
            let sigma = (r1 - da * torsion * beta) / (da * bend);
            let eta = -(r2 + db * torsion_last * y * beta / da) / (db * bend_last);
            if !(beta.is_finite() && sigma.is_finite() && eta.is_finite()) {
                return None;
            }
            let mut share = 1.0;
            loop {
                let point = along(&along(&now.first, share * sigma, &now.direction), share * beta, &across);
                let trial = self.trial(a, b, self.onto(&point), now.length + share * (eta - sigma), accuracy.steps);
                if norm(&trial.residual) < norm(&now.residual) {
                    now = trial;
                    break;
                }
                share *= 0.5;
                if share < 1e-6 || norm(&now.residual) <= ROUNDING * scale {
                    // The residual no longer decreases: converged to rounding level, or failed.
                    return done(&now);
                }
            }
        }
        done(&now)
    }
}

/// End of a geodesic: its point, its unit direction, and the deviation of its neighbours.
#[derive(Clone, Copy)]
struct Geodesic {
    end: Vector,
    direction: Vector,
    spread: Spread,
}

/// The path for trial values of the unknowns.
struct Trial {
    first: Vector,
    length: f64,
    /// Unit direction in which the geodesic starts.
    direction: Vector,
    geodesic: Geodesic,
    /// r_1, r_2, r_3
    residual: [f64; 3],
}
