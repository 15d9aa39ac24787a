//! Wrapping surfaces: the shortest way around one, between two points outside it.
//!
//! When and on which side a path wraps are OpenSim's rules (`WrapCylinder`, `WrapSphere`, `WrapEllipsoid`, `WrapTorus`, version 4.6):
//!
//! | surface | the path wraps | around |
//! |---|---|---|
//! | without a side | where the straight line runs through it | the shorter way |
//! | cylinder with a side | where the line runs through it; where it passes on the other side of the axis, unless both ends are on the side; where neither end is on the side | the way that leaves the first point to the side, see [`positive_way`] |
//! | sphere with a side | where the line runs through it | the way whose middle lies on the side, if an end does not |
//! | ellipsoid with a side | where the line runs through it | the shortest geodesic whose middle lies on the side |
//! | torus | as a cylinder at the point of the ring nearest to the line, its side the middle of the ring | |

use super::ellipsoid::around_ellipsoid;
use super::frame::{Frame, Vector, along, cross, dot, minus, norm, unit};
use super::torus::around_torus;

/// A surface fixed to a body.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    pub name: String,
    /// Index of the body.
    pub body: usize,
    /// In the body's frame.
    pub frame: Frame<f64>,
    pub shape: Shape,
}

/// Lengths in m, in the surface's own frame.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    Sphere {
        radius: f64,
        side: Option<Side>,
    },
    /// About the z-axis, the origin in its middle. A path that would come to it and leave it beyond its ends passes straight on, as in OpenSim:
    /// where that begins, the length jumps. Without ends (`length` infinite) it does not.
    Cylinder {
        radius: f64,
        side: Option<Side>,
        length: f64,
    },
    Ellipsoid {
        radii: Vector,
        side: Option<Side>,
    },
    /// Its ring lies in the plane z = 0, the origin in its middle; paths go through the ring.
    Torus {
        ring: f64,
        tube: f64,
        side: Option<Side>,
    },
}

/// The half of a surface that a path takes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Side {
    /// 0: x, 1: y, 2: z
    pub axis: usize,
    /// 1 or −1
    pub sign: f64,
}

impl Side {
    /// Whether a point of the surface's frame is on it.
    pub fn holds(&self, x: &Vector) -> bool {
        (x[self.axis] >= 0.0) == (self.sign > 0.0)
    }
}

/// What a surface is to a straight line between two points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wrap {
    /// It is not in the way.
    Missed,
    /// An end is inside: there is no way around.
    Inside,
    /// The path wraps it, if not another segment of the path does with less detour.
    Possible(Contact),
    /// The path must wrap it here.
    Certain(Contact),
}

impl Wrap {
    pub fn contact(self) -> Option<Contact> {
        match self {
            Wrap::Possible(contact) | Wrap::Certain(contact) => Some(contact),
            Wrap::Missed | Wrap::Inside => None,
        }
    }

    /// [`Contact::seen_from`], of the contact if there is one.
    pub fn seen_from(self, frame: &Frame<f64>) -> Self {
        match self {
            Wrap::Possible(contact) => Wrap::Possible(contact.seen_from(frame)),
            Wrap::Certain(contact) => Wrap::Certain(contact.seen_from(frame)),
            other => other,
        }
    }
}

/// Where a path lies on a surface: it comes in at `first`, leaves at `last`, `length` of it between them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    pub first: Vector,
    pub last: Vector,
    pub length: f64,
    pub spread: Spread,
}

impl Contact {
    /// Length of a path that comes from `a` and goes on to `b`.
    pub fn path_length(&self, a: &Vector, b: &Vector) -> f64 {
        norm(&minus(&self.first, a)) + self.length + norm(&minus(b, &self.last))
    }

    /// The same contact in the frame that `frame` is in.
    pub fn seen_from(self, frame: &Frame<f64>) -> Self {
        Contact { first: frame.point(&self.first), last: frame.point(&self.last), ..self }
    }
}

/// How neighbouring geodesics spread along one: a distance y and slope y′ across its beginning become `along y + turned y′` and
/// `bent y + kept y′` at its end (y″ = −K y, K the Gaussian curvature).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    pub along: f64,
    pub turned: f64,
    pub bent: f64,
    pub kept: f64,
}

/// An end nearer to its contact counts as this far off, m.
const SHORT: f64 = 1e-9;

impl Shape {
    /// All that tells one shape from another.
    pub fn sizes(&self) -> [f64; 5] {
        let of = |side: &Option<Side>| side.map_or(0.0, |side| side.sign * (1.0 + side.axis as f64));
        match self {
            Shape::Sphere { radius, side } => [1.0, *radius, 0.0, 0.0, of(side)],
            Shape::Cylinder { radius, side, length } => [2.0, *radius, *length, 0.0, of(side)],
            Shape::Ellipsoid { radii: [x, y, z], side } => [3.0, *x, *y, *z, of(side)],
            Shape::Torus { ring, tube, side } => [5.0, *ring, *tube, 0.0, of(side)],
        }
    }

    /// Direction outwards at a point of the surface.
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

    /// Gradient and Hessian, over a then b, of the length of a path that touches, exact.
    ///
    /// With t the way and n the surface's normal at a contact, D from there to the end, and b̂ = n × t: across the surface each
    /// end sees a curvature 1/D (the contact rolls), along it the neighbouring geodesics (the contact stays on its
    /// own). With m the distance at b of paths that leave a with slope 1:
    ///
    /// ```text
    /// ∇L = (−t_a, t_b)      ∂²L/∂b² = n nᵀ/D_b + b̂ b̂ᵀ m′/m,   ∂²L/∂a∂b = − b̂_a b̂_bᵀ/m
    /// ```
    pub fn curvature(&self, a: &Vector, b: &Vector, contact: &Contact) -> ([f64; 6], [[f64; 6]; 6]) {
        let (arriving, leaving) = (minus(&contact.first, a), minus(b, &contact.last));
        let (da, db) = (norm(&arriving).max(SHORT), norm(&leaving).max(SHORT));
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

    /// What the surface is to the line from `a` to `b`, points of its frame. `near`: the contact of a path nearby, from which this one is
    /// sooner found.
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

    /// The contact of the path from `a` to `b`, points of the surface's frame; `None` if it does not touch.
    pub fn contact(&self, a: &Vector, b: &Vector) -> Option<Contact> {
        self.wrap(a, b, None).contact()
    }
}

/// In the plane of both points and the centre: with A the angle between them and cos β = r/d at each, the line runs through
/// where A > β_a + β_b. With a side and an end that is not on it, the path takes the way around that goes to that side of the line.
pub fn around_sphere(radius: f64, side: Option<Side>, a: &Vector, b: &Vector) -> Wrap {
    use std::f64::consts::TAU;
    let (da, db) = (norm(a), norm(b));
    if da < radius || db < radius {
        return Wrap::Inside;
    }
    let along_a = unit(a);
    let across = unit(&minus(b, &along_a.map(|x| x * dot(b, &along_a))));
    let angle = dot(b, &across).atan2(dot(b, &along_a));
    let (beta_a, beta_b) = ((radius / da).acos(), (radius / db).acos());
    if angle - beta_a - beta_b <= 0.0 {
        return Wrap::Missed;
    }
    let way = |across: Vector, arc: f64| {
        let at = |angle: f64| along(&along_a.map(|x| x * radius * angle.cos()), radius * angle.sin(), &across);
        let (sin, cos) = arc.sin_cos();
        let spread = Spread { along: cos, turned: radius * sin, bent: -sin / radius, kept: cos };
        Contact { first: at(beta_a), last: at(beta_a + arc), length: radius * arc, spread }
    };
    let short = way(across, angle - beta_a - beta_b);
    let Some(side) = side else { return Wrap::Possible(short) };
    let ends_on_side = [a, b].map(|x| side.holds(x));
    let long = way(across.map(|x| -x), TAU - angle - beta_a - beta_b);
    // The way from the ends to the contacts.
    let out = (long.first[side.axis] - a[side.axis]) + (long.last[side.axis] - b[side.axis]);
    let contact = if ends_on_side != [true; 2] && out * side.sign >= 0.0 { long } else { short };
    if ends_on_side == [false; 2] { Wrap::Possible(contact) } else { Wrap::Certain(contact) }
}

/// A line that comes no nearer to an axis than the radius less this share of it touches.
const TOUCHES: f64 = 1e-12;

/// In the developed surface the path is straight: across the axis as around a circle, along it in proportion.
fn around_cylinder(radius: f64, side: Option<Side>, a: &Vector, b: &Vector) -> Wrap {
    use std::f64::consts::{PI, TAU};
    let (da, db) = (a[0].hypot(a[1]), b[0].hypot(b[1]));
    if da < radius || db < radius {
        return Wrap::Inside;
    }
    // Where the line, endless, comes nearest to the axis.
    let way = [b[0] - a[0], b[1] - a[1]];
    let share = -(a[0] * way[0] + a[1] * way[1]) / (way[0] * way[0] + way[1] * way[1]);
    let nearest = [a[0] + share * way[0], a[1] + share * way[1], 0.0];
    // A line that touches, within rounding, does not.
    let runs_through = nearest[0].hypot(nearest[1]) < radius * (1.0 - TOUCHES) && 0.0 < share && share < 1.0;
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
    let counter = (theta_b - theta_a).rem_euclid(TAU);
    let positive = match side {
        None => counter <= PI,
        Some(side) => positive_way(side, [theta_a, theta_b], [beta_a, beta_b]),
    };
    let (sign, angle) = if positive { (1.0, counter) } else { (-1.0, TAU - counter) };
    // Where the straight way passes on the other side, a path that must pass on this one goes around in a loop.
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

/// Whether a path goes around a cylinder with a side in the mathematically positive sense: from ends at angles θ to contacts at θ_a + β_a and
/// θ_b − β_b, instead of θ_a − β_a and θ_b + β_b. Of the two contacts of the first end that on the side decides; where both or none is, those of the
/// second end; where none of the four is, the longer way.
fn positive_way(side: Side, theta: [f64; 2], beta: [f64; 2]) -> bool {
    use std::f64::consts::{PI, TAU};
    let on_side = |angle: f64| side.holds(&[angle.cos(), angle.sin(), 0.0]);
    let positive = [theta[0] + beta[0], theta[1] - beta[1]];
    let negative = [theta[0] - beta[0], theta[1] + beta[1]];
    match (on_side(positive[0]), on_side(negative[0])) {
        (true, true) => !on_side(negative[1]),
        (true, false) => true,
        (false, true) => false,
        (false, false) if on_side(negative[1]) => false,
        (false, false) if on_side(positive[1]) => true,
        (false, false) => {
            let between = |[from, to]: [f64; 2]| PI - ((to - from).rem_euclid(TAU) - PI).abs();
            between(positive) > between(negative)
        }
    }
}

/// An orthonormal pair across `normal`.
pub fn tangents(normal: &Vector) -> (Vector, Vector) {
    let smallest = (0..3).min_by(|&i, &j| normal[i].abs().total_cmp(&normal[j].abs())).expect("three axes");
    let mut axis = [0.0; 3];
    axis[smallest] = 1.0;
    let first = unit(&cross(normal, &axis));
    (first, cross(normal, &first))
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
    fn lengths_have_their_first_and_second_derivatives() {
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
                // Not where the way changes sides, nor where contact comes and goes.
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
