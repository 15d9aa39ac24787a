//! Wrapping surfaces: the shortest way around one, between two points outside it.

use super::ellipsoid::around_ellipsoid;
use super::frame::{Frame, Vector, along, cross, dot, minus, norm, unit};

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
    },
    /// About the z-axis, of any length. DEPARTURE [OpenSim, WrapCylinder]: a cylinder ends nowhere, so that contact does not
    /// come and go at its ends.
    Cylinder {
        radius: f64,
        side: Option<Side>,
    },
    Ellipsoid {
        radii: Vector,
    },
}

/// A path passes the axis of a cylinder on this side only, touching or not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Side {
    /// 0: x, 1: y
    pub axis: usize,
    pub sign: f64,
}

/// Where a path lies on a surface: it comes in at `first`, leaves at `last`, `length` of it between them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    pub first: Vector,
    pub last: Vector,
    pub length: f64,
}

impl Shape {
    /// Whether a point of the surface's frame is inside.
    pub fn holds(&self, x: &Vector) -> bool {
        match self {
            Shape::Sphere { radius } => norm(x) < *radius,
            Shape::Cylinder { radius, .. } => x[0].hypot(x[1]) < *radius,
            Shape::Ellipsoid { radii } => norm(&[0, 1, 2].map(|i| x[i] / radii[i])) < 1.0,
        }
    }

    /// The contact of the shortest path from `a` to `b`, points of the surface's frame; `None` if it does not touch. A point
    /// within the surface has no path around it: none either.
    pub fn contact(&self, a: &Vector, b: &Vector) -> Option<Contact> {
        match self {
            Shape::Sphere { radius } => around_sphere(*radius, a, b),
            Shape::Cylinder { radius, side } => around_cylinder(*radius, *side, a, b),
            Shape::Ellipsoid { radii } => around_ellipsoid(radii, a, b),
        }
    }
}

/// In the plane of both points and the centre: with A the angle between them and cos β = r/d at each, the path touches
/// where A > β_a + β_b.
fn around_sphere(radius: f64, a: &Vector, b: &Vector) -> Option<Contact> {
    let (da, db) = (norm(a), norm(b));
    if da <= radius || db <= radius {
        return None;
    }
    let along_a = unit(a);
    let across = unit(&minus(b, &along_a.map(|x| x * dot(b, &along_a))));
    let angle = dot(b, &across).atan2(dot(b, &along_a));
    let (beta_a, beta_b) = ((radius / da).acos(), (radius / db).acos());
    let arc = angle - beta_a - beta_b;
    if arc <= 0.0 {
        return None;
    }
    let at = |angle: f64| along(&along_a.map(|x| x * radius * angle.cos()), radius * angle.sin(), &across);
    Some(Contact { first: at(beta_a), last: at(beta_a + arc), length: radius * arc })
}

/// In the developed surface the path is straight: across the axis as around a circle, along it in proportion.
fn around_cylinder(radius: f64, side: Option<Side>, a: &Vector, b: &Vector) -> Option<Contact> {
    use std::f64::consts::{PI, TAU};
    let (da, db) = (a[0].hypot(a[1]), b[0].hypot(b[1]));
    if da <= radius || db <= radius {
        return None;
    }
    let (theta_a, theta_b) = (a[1].atan2(a[0]), b[1].atan2(b[0]));
    let counter = (theta_b - theta_a).rem_euclid(TAU);
    // Which way round: the shorter one, or the one that passes the given side.
    let positive = match side {
        None => counter <= PI,
        Some(side) => {
            let wanted = match (side.axis, side.sign > 0.0) {
                (0, true) => 0.0,
                (0, false) => PI,
                (_, true) => PI / 2.0,
                (_, false) => -PI / 2.0,
            };
            (wanted - theta_a).rem_euclid(TAU) <= counter
        }
    };
    let (sign, angle) = if positive { (1.0, counter) } else { (-1.0, TAU - counter) };
    let (beta_a, beta_b) = ((radius / da).acos(), (radius / db).acos());
    let arc = angle - beta_a - beta_b;
    if arc <= 0.0 {
        return None;
    }
    let (free_a, free_b) = ((da * da - radius * radius).sqrt(), (db * db - radius * radius).sqrt());
    let across = free_a + radius * arc + free_b;
    let slope = (b[2] - a[2]) / across;
    let at = |angle: f64, z: f64| [radius * angle.cos(), radius * angle.sin(), z];
    Some(Contact {
        first: at(theta_a + sign * beta_a, a[2] + slope * free_a),
        last: at(theta_b - sign * beta_b, b[2] - slope * free_b),
        length: radius * arc * slope.hypot(1.0),
    })
}

/// An orthonormal pair across `normal`.
pub fn tangents(normal: &Vector) -> (Vector, Vector) {
    let smallest = (0..3).min_by(|&i, &j| normal[i].abs().total_cmp(&normal[j].abs())).expect("three axes");
    let mut axis = [0.0; 3];
    axis[smallest] = 1.0;
    let first = unit(&cross(normal, &axis));
    (first, cross(normal, &first))
}
