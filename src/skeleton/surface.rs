//! Wrapping surfaces: the shortest path around one between two points outside it.
//!
//! Whether and which way a path wraps follows OpenSim 4.6 (`WrapCylinder`, `WrapSphere`, `WrapEllipsoid`, `WrapTorus`).
//! The "line" is the straight line between the two ends.
//!
//! - Sphere, cylinder and ellipsoid without a side: the path wraps if the line runs through the surface, and takes the
//!   shorter way.
//! - Cylinder with a side: the path wraps if the line runs through it, if neither end is on the side, or if one end is
//!   and the line passes the axis on the other side. It takes the way that leaves the first end towards the side, see
//!   [`is_counterclockwise`].
//! - Sphere with a side: the path wraps if the line runs through it. Unless both ends are on the side, it takes the
//!   longer way if that one leads towards the side.
//! - Ellipsoid with a side: the path wraps if the line runs through it, along the geodesic nearest to OpenSim's path
//!   around the half on the side.
//! - Torus: treated as a cylinder at the point of the ring nearest to the line, with the middle of the ring as its
//!   side.

use super::ellipsoid::around_ellipsoid;
use super::frame::{Frame, Vector, cross, minus, norm, unit};
use super::shape::around_sphere;
pub use super::shape::{Contact, Shape, Side, Spread, Wrap, tangents};
use super::torus::around_torus;

/// A surface fixed to a body.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    pub name: String,
    /// Index of the body.
    pub body: usize,
    /// Frame of the surface in the body's frame.
    pub frame: Frame<f64>,
    pub shape: Shape,
}

/// Lower bound of the distance between an end and its contact in [`Shape::curvature`], m.
const MIN_DISTANCE: f64 = 1e-9;

impl Shape {
    /// Kind, dimensions and side as numbers that identify the shape.
    pub fn sizes(&self) -> [f64; 5] {
        let of = |side: &Option<Side>| side.map_or(0.0, |side| side.sign * (1.0 + side.axis as f64));
        match self {
            Shape::Sphere { radius, side } => [1.0, *radius, 0.0, 0.0, of(side)],
            Shape::Cylinder { radius, side, length } => [2.0, *radius, *length, 0.0, of(side)],
            Shape::Ellipsoid { radii: [x, y, z], side } => [3.0, *x, *y, *z, of(side)],
            Shape::Torus { ring, tube, side } => [5.0, *ring, *tube, 0.0, of(side)],
        }
    }

    /// Outward unit normal at a point of the surface.
    pub fn normal(&self, x: &Vector) -> Vector {
        match self {
            Shape::Sphere { .. } => unit(x),
            Shape::Cylinder { .. } => unit(&[x[0], x[1], 0.0]),
            Shape::Torus { ring, .. } => {
                let to_ring = ring / x[0].hypot(x[1]);
                unit(&[x[0] * (1.0 - to_ring), x[1] * (1.0 - to_ring), x[2]])
            }
            Shape::Ellipsoid { radii, .. } => unit(&[0, 1, 2].map(|i| x[i] / (radii[i] * radii[i]))),
        }
    }

    /// Exact gradient and Hessian, with respect to a and then b, of the length L of a touching path.
    ///
    /// At each contact, t is the direction of the path, n the normal of the surface, D the distance to the end, and
    /// b̂ = n × t. Along n the curvature of L is 1/D, as the contact moves along its geodesic; along b̂ it follows from
    /// the neighbouring geodesics. With m the lateral distance at b of a path that leaves a with slope 1, and
    /// m′ = ∂m/∂D_b:
    ///
    /// ```text
    /// ∇L = (−t_a, t_b)      ∂²L/∂b² = n nᵀ/D_b + b̂ b̂ᵀ m′/m,   ∂²L/∂a∂b = − b̂_a b̂_bᵀ/m
    /// ```
    ///
    /// ∂²L/∂a² is the same with a in the place of b.
    ///
    /// DEPARTURE [exact derivatives]: those of a torus, whose contacts are on a cylinder that moves with the path, are central
    /// differences of L, accurate to about 1e-9 (gradient) and 1e-7 (Hessian, 1/m).
    pub fn curvature(&self, a: &Vector, b: &Vector, contact: &Contact) -> ([f64; 6], [[f64; 6]; 6]) {
        if let Shape::Torus { .. } = self {
            return self.differences(a, b);
        }
        let (arriving, leaving) = (minus(&contact.first, a), minus(b, &contact.last));
        let (da, db) = (norm(&arriving).max(MIN_DISTANCE), norm(&leaving).max(MIN_DISTANCE));
        let (ta, tb) = (unit(&arriving), unit(&leaving));
        let (na, nb) = (self.normal(&contact.first), self.normal(&contact.last));
        let (across_a, across_b) = (cross(&na, &ta), cross(&nb, &tb));
        let Spread { along, turned, bent, kept } = contact.spread;
        let m = da * along + turned + db * (da * bent + kept);
        let (slope_a, slope_b) = (db * bent + along, da * bent + kept);
        let mut hessian = [[0.0; 6]; 6];
        for i in 0..3 {
            for j in 0..3 {
                hessian[i][j] = na[i] * na[j] / da + across_a[i] * across_a[j] * slope_a / m;
                hessian[3 + i][3 + j] = nb[i] * nb[j] / db + across_b[i] * across_b[j] * slope_b / m;
                hessian[i][3 + j] = -across_a[i] * across_b[j] / m;
                hessian[3 + j][i] = hessian[i][3 + j];
            }
        }
        ([-ta[0], -ta[1], -ta[2], tb[0], tb[1], tb[2]], hessian)
    }

    /// Gradient and Hessian of the length of the path from a to b by central differences.
    fn differences(&self, a: &Vector, b: &Vector) -> ([f64; 6], [[f64; 6]; 6]) {
        let length = |steps: &[(usize, f64)]| {
            let mut ends = [*a, *b];
            steps.iter().for_each(|&(i, step)| ends[i / 3][i % 3] += step);
            let [a, b] = ends;
            self.contact(&a, &b).map_or_else(|| norm(&minus(&b, &a)), |contact| contact.path_length(&a, &b))
        };
        let here = length(&[]);
        let (mut gradient, mut hessian) = ([0.0; 6], [[0.0; 6]; 6]);
        for i in 0..6 {
            gradient[i] = (length(&[(i, SLOPE_STEP)]) - length(&[(i, -SLOPE_STEP)])) / (2.0 * SLOPE_STEP);
            for j in 0..=i {
                let at = |x: f64, y: f64| length(&[(i, x * BEND_STEP), (j, y * BEND_STEP)]);
                let bend = if i == j {
                    at(1.0, 0.0) - 2.0 * here + at(-1.0, 0.0)
                } else {
                    0.25 * (at(1.0, 1.0) - at(1.0, -1.0) - at(-1.0, 1.0) + at(-1.0, -1.0))
                };
                hessian[i][j] = bend / (BEND_STEP * BEND_STEP);
                hessian[j][i] = hessian[i][j];
            }
        }
        (gradient, hessian)
    }

    /// Relation of the surface to the line from `a` to `b` (in the surface's frame, m). `near`: the contact of a path
    /// nearby as a starting guess.
    pub fn wrap(&self, a: &Vector, b: &Vector, near: Option<&Contact>) -> Wrap {
        match self {
            Shape::Sphere { radius, side } => around_sphere(*radius, *side, a, b),
            Shape::Cylinder { radius, side, length } => {
                let beyond = |x: &Vector| x[2].abs() > 0.5 * length;
                let wrap = around_cylinder(*radius, *side, a, b);
                match wrap.contact() {
                    Some(contact) if beyond(&contact.first) && beyond(&contact.last) => Wrap::Missed,
                    _ => wrap,
                }
            }
            Shape::Ellipsoid { radii, side } => around_ellipsoid(radii, *side, a, b, near),
            Shape::Torus { ring, tube, side } => around_torus(*ring, *tube, *side, a, b),
        }
    }

    /// Contact of the path from `a` to `b` (in the surface's frame, m); `None` if the path does not touch.
    pub fn contact(&self, a: &Vector, b: &Vector) -> Option<Contact> {
        self.wrap(a, b, None).contact()
    }
}

/// Steps of differences of lengths for first and second derivatives, m.
const SLOPE_STEP: f64 = 1e-6;
const BEND_STEP: f64 = 1e-4;

/// Relative tolerance: a line that enters a cylinder by less than this fraction of the radius only touches it.
const GRAZING: f64 = 1e-12;

/// Path around a cylinder: a straight line on the developed surface. Across the axis it is the path around a circle;
/// along the axis it advances in proportion.
fn around_cylinder(radius: f64, side: Option<Side>, a: &Vector, b: &Vector) -> Wrap {
    use std::f64::consts::{PI, TAU};
    let (da, db) = (a[0].hypot(a[1]), b[0].hypot(b[1]));
    if da < radius || db < radius {
        return Wrap::Inside;
    }
    // Point of the infinite line nearest to the axis.
    let direction = [b[0] - a[0], b[1] - a[1]];
    let share =
        -(a[0] * direction[0] + a[1] * direction[1]) / (direction[0] * direction[0] + direction[1] * direction[1]);
    let nearest = [a[0] + share * direction[0], a[1] + share * direction[1], 0.0];
    // A line that only touches, within rounding, does not run through.
    let runs_through = nearest[0].hypot(nearest[1]) < radius * (1.0 - GRAZING) && 0.0 < share && share < 1.0;
    let is_certain = match side {
        None if runs_through => true,
        None => return Wrap::Missed,
        Some(side) => match [a, b].map(|x| side.holds(x)) {
            [false, false] => false,
            _ if runs_through => true,
            [true, true] => return Wrap::Missed,
            _ if side.holds(&nearest) => return Wrap::Missed,
            _ => false,
        },
    };
    let (theta_a, theta_b) = (a[1].atan2(a[0]), b[1].atan2(b[0]));
    let (beta_a, beta_b) = ((radius / da).acos(), (radius / db).acos());
    let turn = (theta_b - theta_a).rem_euclid(TAU);
    let counterclockwise = match side {
        None => turn <= PI,
        Some(side) => is_counterclockwise(side, [theta_a, theta_b], [beta_a, beta_b]),
    };
    let (sign, angle) = if counterclockwise { (1.0, turn) } else { (-1.0, TAU - turn) };
    // If the line passes on the other side, a path that must take this side makes a loop.
    let arc = (angle - beta_a - beta_b).rem_euclid(TAU);
    let (free_a, free_b) = ((da * da - radius * radius).sqrt(), (db * db - radius * radius).sqrt());
    let across = free_a + radius * arc + free_b;
    let slope = (b[2] - a[2]) / across;
    let at = |angle: f64, z: f64| [radius * angle.cos(), radius * angle.sin(), z];
    let length = radius * arc * slope.hypot(1.0);
    let contact = Contact {
        first: at(theta_a + sign * beta_a, a[2] + slope * free_a),
        last: at(theta_b - sign * beta_b, b[2] - slope * free_b),
        length,
        spread: Spread { along: 1.0, turned: length, bent: 0.0, kept: 1.0 },
    };
    if is_certain { Wrap::Certain(contact) } else { Wrap::Possible(contact) }
}

/// True if a path goes around a cylinder with a side counterclockwise about z.
///
/// The ends are at angles θ. The contacts are at θ_a + β_a and θ_b − β_b if the path goes counterclockwise, and at
/// θ_a − β_a and θ_b + β_b if it goes clockwise. The path takes the direction whose first contact is on the side. If
/// both or neither are, the second contacts decide. If none of the four is on the side, the path takes the longer way.
fn is_counterclockwise(side: Side, theta: [f64; 2], beta: [f64; 2]) -> bool {
    use std::f64::consts::{PI, TAU};
    let on_side = |angle: f64| side.holds(&[angle.cos(), angle.sin(), 0.0]);
    let forward = [theta[0] + beta[0], theta[1] - beta[1]];
    let backward = [theta[0] - beta[0], theta[1] + beta[1]];
    match (on_side(forward[0]), on_side(backward[0])) {
        (true, true) => !on_side(backward[1]),
        (true, false) => true,
        (false, true) => false,
        (false, false) if on_side(backward[1]) => false,
        (false, false) if on_side(forward[1]) => true,
        (false, false) => {
            let between = |[from, to]: [f64; 2]| PI - ((to - from).rem_euclid(TAU) - PI).abs();
            between(forward) > between(backward)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    fn length(shape: &Shape, a: &Vector, b: &Vector) -> Option<(f64, Contact)> {
        let contact = shape.contact(a, b)?;
        Some((norm(&minus(&contact.first, a)) + contact.length + norm(&minus(b, &contact.last)), contact))
    }

    #[test]
    fn gradients_and_hessians_match_differences() {
        let side = Some(Side { axis: 1, sign: -1.0 });
        let shapes = [
            Shape::Sphere { radius: 0.03, side: None },
            Shape::Cylinder { radius: 0.02, side: None, length: f64::INFINITY },
            Shape::Cylinder { radius: 0.02, side, length: 10.0 },
            Shape::Ellipsoid { radii: [0.076, 0.174, 0.075], side: None },
            Shape::Ellipsoid { radii: [0.035, 0.021, 0.031], side: None },
        ];
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(21);
        for shape in &shapes {
            let mut tried = 0;
            while tried < 40 {
                let mut random = || [0; 3].map(|_| rng.random_range(-0.2..0.2));
                let x: [Vector; 2] = [random(), random()];
                let e = 1e-6;
                let far = |x: &Vector| {
                    [1.0, 0.9].iter().all(|f| shape.wrap(&x.map(|x| f * x), &[1.0; 3], None) != Wrap::Inside)
                };
                let Some((_, contact)) = length(shape, &x[0], &x[1]) else { continue };
                // Skip points near a change of side or a loss of contact, where the length is not smooth.
                if !far(&x[0]) || !far(&x[1]) || contact.length < 1e-3 || contact.spread.kept < -0.3 {
                    continue;
                }
                tried += 1;
                let (gradient, hessian) = shape.curvature(&x[0], &x[1], &contact);
                for i in 0..6 {
                    let at = |e: f64| {
                        let mut y = x;
                        y[i / 3][i % 3] += e;
                        let (value, contact) = length(shape, &y[0], &y[1]).unwrap();
                        (value, shape.curvature(&y[0], &y[1], &contact).0)
                    };
                    let (up, down) = (at(e), at(-e));
                    let slope = (up.0 - down.0) / (2.0 * e);
                    assert!((slope - gradient[i]).abs() < 1e-6, "{shape:?} {i} {slope} {}", gradient[i]);
                    for j in 0..6 {
                        let bend = (up.1[j] - down.1[j]) / (2.0 * e);
                        let size = 1.0 + hessian[i][i].abs().max(hessian[j][j].abs());
                        assert!(
                            (bend - hessian[i][j]).abs() < 1e-6 * size,
                            "{shape:?} {i}{j} {bend} {}",
                            hessian[i][j]
                        );
                    }
                }
            }
        }
    }
}
