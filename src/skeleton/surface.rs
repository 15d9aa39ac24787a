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
    /// About the z-axis, the origin in its middle. A path that would come to it and leave it beyond its ends passes straight on, as in OpenSim:
    /// where that begins, the length jumps. Without ends (`length` infinite) it does not.
    Cylinder {
        radius: f64,
        side: Option<Side>,
        length: f64,
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
    pub spread: Spread,
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
    /// Whether a point of the surface's frame is inside.
    pub fn holds(&self, x: &Vector) -> bool {
        match self {
            Shape::Sphere { radius } => norm(x) < *radius,
            Shape::Cylinder { radius, .. } => x[0].hypot(x[1]) < *radius,
            Shape::Ellipsoid { radii } => norm(&[0, 1, 2].map(|i| x[i] / radii[i])) < 1.0,
        }
    }

    /// All that tells one shape from another.
    pub fn sizes(&self) -> [f64; 4] {
        match self {
            Shape::Sphere { radius } => [1.0, *radius, 0.0, 0.0],
            Shape::Cylinder { radius, side, length } => {
                let side = side.map_or(0.0, |side| side.sign * (1.0 + side.axis as f64));
                [2.0, *radius, *length, side]
            }
            Shape::Ellipsoid { radii: [x, y, z] } => [3.0, *x, *y, *z],
        }
    }

    /// Direction outwards at a point of the surface.
    pub fn normal(&self, x: &Vector) -> Vector {
        match self {
            Shape::Sphere { .. } => unit(x),
            Shape::Cylinder { .. } => unit(&[x[0], x[1], 0.0]),
            Shape::Ellipsoid { radii } => unit(&[0, 1, 2].map(|i| x[i] / (radii[i] * radii[i]))),
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

    /// The contact of the shortest path from `a` to `b`, points of the surface's frame; `None` if it does not touch. A point
    /// within the surface has no path around it: none either.
    pub fn contact(&self, a: &Vector, b: &Vector) -> Option<Contact> {
        self.contact_near(a, b, None)
    }

    /// [`Shape::contact`], sooner found from that of a path nearby.
    pub fn contact_near(&self, a: &Vector, b: &Vector, near: Option<&Contact>) -> Option<Contact> {
        match self {
            Shape::Sphere { radius } => around_sphere(*radius, a, b),
            Shape::Cylinder { radius, side, length } => {
                let beyond = |x: &Vector| x[2].abs() > 0.5 * length;
                let contact = around_cylinder(*radius, *side, a, b);
                contact.filter(|contact| !(beyond(&contact.first) && beyond(&contact.last)))
            }
            Shape::Ellipsoid { radii } => around_ellipsoid(radii, a, b, near),
        }
    }
}

/// In the plane of both points and the centre: with A the angle between them and cos β = r/d at each, the path touches
/// where A > β_a + β_b.
pub fn around_sphere(radius: f64, a: &Vector, b: &Vector) -> Option<Contact> {
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
    let (sin, cos) = arc.sin_cos();
    let spread = Spread { along: cos, turned: radius * sin, bent: -sin / radius, kept: cos };
    Some(Contact { first: at(beta_a), last: at(beta_a + arc), length: radius * arc, spread })
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
    let length = radius * arc * slope.hypot(1.0);
    Some(Contact {
        first: at(theta_a + sign * beta_a, a[2] + slope * free_a),
        last: at(theta_b - sign * beta_b, b[2] - slope * free_b),
        length,
        spread: Spread { along: 1.0, turned: length, bent: 0.0, kept: 1.0 },
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
            Shape::Sphere { radius: 0.03 },
            Shape::Cylinder { radius: 0.02, side: None, length: f64::INFINITY },
            Shape::Cylinder { radius: 0.02, side, length: 10.0 },
            Shape::Ellipsoid { radii: [0.076, 0.174, 0.075] },
            Shape::Ellipsoid { radii: [0.035, 0.021, 0.031] },
        ];
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(21);
        for shape in &shapes {
            let mut tried = 0;
            while tried < 40 {
                let mut random = || [0; 3].map(|_| rng.random_range(-0.2..0.2));
                let x: [Vector; 2] = [random(), random()];
                let e = 1e-6;
                let far = |x: &Vector| !shape.holds(x) && !shape.holds(&x.map(|x| 0.9 * x));
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
