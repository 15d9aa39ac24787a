//! The shortest way around an ellipsoid: straight to it, along a geodesic, straight on.
//!
//! ```text
//! f(x) = Σ x_i²/a_i² − 1 = 0,   n = ∇f/|∇f|
//! geodesic:  x″ = −κ n,   κ = x′ᵀ(∇²f) x′ / |∇f|
//! unknowns:  the first contact S (two numbers) and the length ℓ of the geodesic, which ends in E
//! equations: r_1 = n(S)·(a − S) = 0,   r_2 = n(E)·(b − E) = 0,   r_3 = b̂(E)·(b − E) = 0,   b̂ = n × x′
//! ```
//!
//! The geodesic begins in the direction in which the straight part arrives. Along with it go the distances to its neighbours
//! (y″ = −K y, K the Gaussian curvature), which give Newton's matrix: with κ and τ the surface's curvature along x′ and its
//! torsion, D the straight parts, y the neighbour that a ray from a becomes and m = y + D_b y′ at b,
//!
//! ```text
//! S + σ x′ + β b̂,  E + η x′:   δr_3 = −m β/D_a,   δr_1 = −D_a (κ_S σ + τ_S β),   δr_2 = D_b (κ_E η + τ_E y β/D_a)
//! ```
//!
//! The matrix is exact at the solution, so the convergence is quadratic. The start is the way around a sphere of which the
//! ellipsoid is the affine image, or, where that fails, a taut string of nodes. Source: A. Scholz et al., *Multibody Syst. Dyn.* 36, 2016.

use super::frame::{Vector, along, cross, dot, minus, norm, unit};
use super::half_ellipsoid::guide;
use super::surface::{Contact, Side, Spread, Wrap, around_sphere};

const NODES: usize = 24;
const SWEEPS: usize = 400;
const NEWTON: usize = 40;

/// Below this share of the straight parts, a residual that does not fall is rounding.
const ROUNDING: f64 = 1e-11;

/// How closely a way is found.
#[derive(Clone, Copy)]
struct Care {
    /// Runge–Kutta steps along the geodesic.
    steps: usize,
    /// Newton's method ends at residuals below this share of the straight parts, and gives up above `least` of it.
    aim: f64,
    least: f64,
}

const FINE: Care = Care { steps: 48, aim: 1e-13, least: 1e-9 };
/// To begin [`FINE`] with.
const ROUGH: Care = Care { steps: 8, aim: 1e-3, least: 1e-2 };
/// A rough way further from its start than this share of the smallest radius is not used.
const ROUGHLY_THERE: f64 = 0.5;

/// An end this far inside, as OpenSim counts it (Σ x²/r² − 1), is on the surface.
const ON_SURFACE: f64 = -1e-4;

/// See [`super::surface::Shape::wrap`].
pub fn around_ellipsoid(radii: &Vector, side: Option<Side>, a: &Vector, b: &Vector, near: Option<&Contact>) -> Wrap {
    // In units of the mean radius.
    let unit_length = radii.iter().sum::<f64>() / 3.0;
    let scaled = |x: &Vector| x.map(|x| x / unit_length);
    let radii = scaled(radii);
    let ellipsoid = Ellipsoid { radii, weights: radii.map(|r| 2.0 / (r * r)) };
    let (a, b) = (scaled(a), scaled(b));
    if ellipsoid.value(&a) < ON_SURFACE || ellipsoid.value(&b) < ON_SURFACE {
        return Wrap::Inside;
    }
    if !ellipsoid.hides(&a, &b) {
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

struct Ellipsoid {
    radii: Vector,
    /// 2/r²: the second derivatives of f.
    weights: Vector,
}

impl Ellipsoid {
    fn value(&self, x: &Vector) -> f64 {
        (0..3).map(|i| (x[i] / self.radii[i]).powi(2)).sum::<f64>() - 1.0
    }

    fn gradient(&self, x: &Vector) -> Vector {
        [0, 1, 2].map(|i| self.weights[i] * x[i])
    }

    fn normal(&self, x: &Vector) -> Vector {
        unit(&self.gradient(x))
    }

    /// The shortest way around. `near`: first contact and length of one nearby.
    fn shortest(&self, a: &Vector, b: &Vector, near: Option<(Vector, f64)>) -> Option<Contact> {
        let fine = |first, length| self.taut(a, b, first, length, &FINE);
        let affine = self.affine(a, b);
        // The shortest way is no longer than any: not one that goes around more than once.
        let is_short = |contact: &Contact| {
            contact.length > 0.0 && affine.is_none_or(|(_, _, all)| contact.path_length(a, b) <= all * (1.0 + 1e-3))
        };
        let nearby = |(first, length)| fine(self.onto(&first), length).filter(is_short);
        let around = || {
            let (first, length, _) = affine?;
            let is_near = |contact: &Contact| {
                let far = norm(&minus(&contact.first, &first)).max((contact.length - length).abs());
                far < ROUGHLY_THERE * self.radii.iter().copied().fold(f64::INFINITY, f64::min)
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

    /// The geodesic nearest to the way that OpenSim takes around one half, see [`half_ellipsoid`](super::half_ellipsoid).
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

    /// First contact and length of the way in the plane through both ends and a point of the surface, on the side of that point.
    fn section(&self, a: &Vector, b: &Vector, through: &Vector) -> Option<(Vector, f64)> {
        // In the affine image that is a sphere, planes and tangents stay what they are.
        let over = |x: &Vector| [0, 1, 2].map(|i| x[i] / self.radii[i]);
        let [a, b, through] = [a, b, through].map(over);
        let way = unit(&minus(&b, &a));
        let up = minus(&through, &a);
        let up = unit(&along(&up, -dot(&up, &way), &way));
        let normal = cross(&way, &up);
        let centre = normal.map(|n| n * dot(&normal, &a));
        let radius = (1.0 - dot(&centre, &centre)).max(0.0).sqrt();
        let polar = |x: &Vector| {
            let x = minus(x, &centre);
            (dot(&x, &up).atan2(dot(&x, &way)), norm(&x))
        };
        let ((angle_a, far_a), (angle_b, far_b)) = (polar(&a), polar(&b));
        let (beta_a, beta_b) = ((radius / far_a).min(1.0).acos(), (radius / far_b).min(1.0).acos());
        // Over the top of the circle, clockwise from a to b.
        let (from, to) = (angle_a - beta_a, angle_b + beta_b);
        let arc = (from - to).rem_euclid(std::f64::consts::TAU);
        let at = |k: usize| {
            let (sin, cos) = (from - arc * k as f64 / NODES as f64).sin_cos();
            let x = along(&along(&centre, radius * cos, &way), radius * sin, &up);
            [0, 1, 2].map(|i| x[i] * self.radii[i])
        };
        let length: f64 = (0..NODES).map(|k| norm(&minus(&at(k + 1), &at(k)))).sum();
        (radius > 0.0 && length.is_finite()).then_some((at(0), length))
    }

    /// Whether the straight line from a to b, both outside, goes through.
    fn hides(&self, a: &Vector, b: &Vector) -> bool {
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

    /// First contact, length on the surface and length in all of the affine image of the way around the unit sphere.
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

    /// The geodesic of some length from `x` in the direction `t`; backwards for a negative length.
    fn geodesic(&self, x: Vector, t: Vector, length: f64, steps: usize) -> Geodesic {
        // Of x and t, and of the Gaussian curvature: 1/(∏ r² (Σ x²/r⁴)²).
        let curved = -2.0 * self.weights.iter().product::<f64>();
        let forces = |x: &Vector, t: &Vector| {
            let gradient = self.gradient(x);
            let less = 1.0 / dot(&gradient, &gradient);
            let bent = -less * dot(&self.gradient(t), t);
            (gradient.map(|g| g * bent), curved * less * less)
        };
        let h = length / steps as f64;
        // (x, t), and the neighbours (y, y′) that begin with (1, 0) and with (0, 1).
        let (mut x, mut t, mut y) = (x, t, [1.0, 0.0, 0.0, 1.0]);
        let rate = |y: &[f64; 4], k: f64| [y[1], k * y[0], y[3], k * y[2]];
        let step = |y: &[f64; 4], h: f64, by: &[f64; 4]| [0, 1, 2, 3].map(|i| y[i] + h * by[i]);
        for _ in 0..steps {
            let (a1, k1) = forces(&x, &t);
            let (v1, y1) = (t, rate(&y, k1));
            let v2 = along(&t, h / 2.0, &a1);
            let (a2, k2) = forces(&along(&x, h / 2.0, &v1), &v2);
            let y2 = rate(&step(&y, h / 2.0, &y1), k2);
            let v3 = along(&t, h / 2.0, &a2);
            let (a3, k3) = forces(&along(&x, h / 2.0, &v2), &v3);
            let y3 = rate(&step(&y, h / 2.0, &y2), k3);
            let v4 = along(&t, h, &a3);
            let (a4, k4) = forces(&along(&x, h, &v3), &v4);
            let y4 = rate(&step(&y, h, &y3), k4);
            for i in 0..3 {
                x[i] += h / 6.0 * (v1[i] + 2.0 * v2[i] + 2.0 * v3[i] + v4[i]);
                t[i] += h / 6.0 * (a1[i] + 2.0 * a2[i] + 2.0 * a3[i] + a4[i]);
            }
            (0..4).for_each(|i| y[i] += h / 6.0 * (y1[i] + 2.0 * y2[i] + 2.0 * y3[i] + y4[i]));
        }
        Geodesic { end: x, way: unit(&t), spread: Spread { along: y[0], bent: y[1], turned: y[2], kept: y[3] } }
    }

    /// Curvature along `t` and torsion (how the normal turns across it) at `x`.
    fn curvature(&self, x: &Vector, t: &Vector, across: &Vector) -> (f64, f64) {
        let turned = self.gradient(t);
        let steep = norm(&self.gradient(x));
        (dot(&turned, t) / steep, dot(&turned, across) / steep)
    }

    /// The trial with a first contact and a length; see the module.
    fn trial(&self, a: &Vector, b: &Vector, first: Vector, length: f64, steps: usize) -> Trial {
        let normal = self.normal(&first);
        let arriving = minus(&first, a);
        let way = unit(&along(&arriving, -dot(&arriving, &normal), &normal));
        let geodesic = self.geodesic(first, way, length, steps);
        let (normal_last, rest) = (self.normal(&geodesic.end), minus(b, &geodesic.end));
        let across = cross(&normal_last, &geodesic.way);
        let residual = [-dot(&normal, &arriving), dot(&normal_last, &rest), dot(&across, &rest)];
        Trial { first, length, way, geodesic, residual }
    }

    /// Solves the equations of the module by a damped Newton method.
    fn taut(&self, a: &Vector, b: &Vector, first: Vector, length: f64, care: &Care) -> Option<Contact> {
        let mut now = self.trial(a, b, first, length, care.steps);
        let scale = norm(&minus(a, &now.first)).max(norm(&minus(b, &now.geodesic.end))).max(1e-3);
        let done = |trial: &Trial| {
            let Geodesic { end, spread, .. } = trial.geodesic;
            (norm(&trial.residual) <= care.least * scale).then_some(Contact {
                first: trial.first,
                last: end,
                length: trial.length,
                spread,
            })
        };
        for _ in 0..NEWTON {
            if norm(&now.residual) <= care.aim * scale {
                break;
            }
            let [r1, r2, r3] = now.residual;
            let (end, way_last) = (now.geodesic.end, now.geodesic.way);
            let Spread { along: c, turned, bent, kept } = now.geodesic.spread;
            let da = dot(&minus(&now.first, a), &now.way).max(1e-3 * scale);
            let db = dot(&minus(b, &end), &way_last).max(1e-3 * scale);
            let across = cross(&self.normal(&now.first), &now.way);
            let across_last = cross(&self.normal(&end), &way_last);
            let (bend, torsion) = self.curvature(&now.first, &now.way, &across);
            let (bend_last, torsion_last) = self.curvature(&end, &way_last, &across_last);
            let (y, m) = (da * c + turned, da * c + turned + db * (da * bent + kept));
            let beta = r3 * da / m;
            let sigma = (r1 - da * torsion * beta) / (da * bend);
            let eta = -(r2 + db * torsion_last * y * beta / da) / (db * bend_last);
            if !(beta.is_finite() && sigma.is_finite() && eta.is_finite()) {
                return None;
            }
            let mut share = 1.0;
            loop {
                let point = along(&along(&now.first, share * sigma, &now.way), share * beta, &across);
                let trial = self.trial(a, b, self.onto(&point), now.length + share * (eta - sigma), care.steps);
                if norm(&trial.residual) < norm(&now.residual) {
                    now = trial;
                    break;
                }
                share *= 0.5;
                if share < 1e-6 || norm(&now.residual) <= ROUNDING * scale {
                    // As good as rounding lets it be, or not at all.
                    return done(&now);
                }
            }
        }
        done(&now)
    }
}

/// Where a geodesic ends, in which direction, and how its neighbours spread.
#[derive(Clone, Copy)]
struct Geodesic {
    end: Vector,
    way: Vector,
    spread: Spread,
}

struct Trial {
    first: Vector,
    length: f64,
    /// In which the geodesic begins.
    way: Vector,
    geodesic: Geodesic,
    residual: [f64; 3],
}
