//! Shapes that paths wrap around, contacts with them, and the path around a sphere.

use super::frame::{Frame, Vector, along, cross, dot, minus, norm, unit};

/// Shape of a surface in its own frame. Lengths in m.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    Sphere {
        radius: f64,
        side: Option<Side>,
    },
    /// Around the z-axis, centred at the origin. As in OpenSim, a path passes straight on if both of its contacts would
    /// lie beyond the ends; where that begins, its length jumps. An infinite `length` avoids the jump.
    Cylinder {
        radius: f64,
        side: Option<Side>,
        length: f64,
    },
    Ellipsoid {
        radii: Vector,
        side: Option<Side>,
    },
    /// Around the z-axis, centred at the origin. Paths pass through the ring.
    Torus {
        /// Radius of the centre line of the tube.
        ring: f64,
        /// Radius of the tube.
        tube: f64,
        side: Option<Side>,
    },
}

/// The half of a surface that a path must take.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Side {
    /// 0: x, 1: y, 2: z
    pub axis: usize,
    /// 1 or −1
    pub sign: f64,
}

impl Side {
    /// True if a point (in the surface's frame) is on this side.
    pub fn holds(&self, x: &Vector) -> bool {
        (x[self.axis] >= 0.0) == (self.sign > 0.0)
    }
}

/// Relation of a surface to the straight line between two points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wrap {
    /// The surface is not in the way.
    Missed,
    /// An end is inside the surface: there is no path around it.
    Inside,
    /// The path wraps the surface here, unless another segment does so with a smaller detour.
    Possible(Contact),
    /// The path must wrap the surface here.
    Certain(Contact),
}

impl Wrap {
    pub fn contact(self) -> Option<Contact> {
        match self {
            Wrap::Possible(contact) | Wrap::Certain(contact) => Some(contact),
            Wrap::Missed | Wrap::Inside => None,
        }
    }

    /// Applies [`Contact::transformed`] to the contact, if there is one.
    pub fn transformed(self, frame: &Frame<f64>) -> Self {
        match self {
            Wrap::Possible(contact) => Wrap::Possible(contact.transformed(frame)),
            Wrap::Certain(contact) => Wrap::Certain(contact.transformed(frame)),
            other => other,
        }
    }
}

/// The part of a path that lies on a surface, from `first` to `last` (points) over `length` (m).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    pub first: Vector,
    pub last: Vector,
    pub length: f64,
    pub spread: Spread,
}

impl Contact {
    /// Length of the path from `a` over the contact to `b`, m.
    pub fn path_length(&self, a: &Vector, b: &Vector) -> f64 {
        norm(&minus(&self.first, a)) + self.length + norm(&minus(b, &self.last))
    }

    /// Transforms the contact from `frame` to the frame in which `frame` is given.
    pub fn transformed(self, frame: &Frame<f64>) -> Self {
        Contact { first: frame.point(&self.first), last: frame.point(&self.last), ..self }
    }
}

/// Geodesic deviation along a contact: y″ = −K y, with K the Gaussian curvature.
///
/// A neighbouring geodesic with lateral distance y and slope y′ at the start has distance `along y + turned y′` and
/// slope `bent y + kept y′` at the end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    pub along: f64,
    pub turned: f64,
    pub bent: f64,
    pub kept: f64,
}

/// Path around a sphere, in the plane of both ends and the centre.
///
/// With A the angle between the ends seen from the centre, and cos β = r/d for an end at distance d, the line runs
/// through the sphere if A > β_a + β_b. With a side, and unless both ends are on it, the path takes the longer way if
/// that one leads towards the side.
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
    // Displacement from the ends to the contacts of the longer way, along the axis of the side.
    let out = (long.first[side.axis] - a[side.axis]) + (long.last[side.axis] - b[side.axis]);
    let contact = if ends_on_side != [true; 2] && out * side.sign >= 0.0 { long } else { short };
    if ends_on_side == [false; 2] { Wrap::Possible(contact) } else { Wrap::Certain(contact) }
}

/// Two unit vectors that are orthogonal to each other and to `normal`.
pub fn tangents(normal: &Vector) -> (Vector, Vector) {
    let smallest = (0..3).min_by(|&i, &j| normal[i].abs().total_cmp(&normal[j].abs())).expect("three axes");
    let mut axis = [0.0; 3];
    axis[smallest] = 1.0;
    let first = unit(&cross(normal, &axis));
    (first, cross(normal, &first))
}
