//! Planar rigid bodies, points on them, and constant external forces.

use crate::numerics::Scalar;

/// A planar rigid body. Its coordinates are those of its centre of mass and its angle.
#[derive(Clone, Debug)]
pub struct Body {
    pub name: String,
    /// kg
    pub mass: f64,
    /// About the centre of mass, kg m².
    pub inertia: f64,
    /// Centre of mass in the body's own frame, m: points in the model file are given in that frame.
    pub centre_of_mass: [f64; 2],
}

/// A point fixed to the ground or to a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Place {
    /// In the ground frame, m.
    Ground([f64; 2]),
    /// On body `index`, relative to its centre of mass in its own axes, m.
    Body(usize, [f64; 2]),
}

/// A constant force on a body, given in the ground frame.
#[derive(Clone, Debug)]
pub struct ExternalForce {
    pub name: String,
    pub body: usize,
    /// Point of attack relative to the centre of mass in the body's axes, m.
    pub point: [f64; 2],
    /// N, in the ground frame.
    pub force: [f64; 2],
    /// N m
    pub moment: f64,
}

/// A place in the ground frame, with its derivatives by the angle of its body:
/// `position = r + R(φ) s`, `first = R'(φ) s`, `second = −R(φ) s` (m).
#[derive(Clone, Copy, Debug)]
pub struct PointOnBody<T> {
    pub position: [T; 2],
    pub first: [T; 2],
    pub second: [T; 2],
}

impl Place {
    /// Index of the body, or `None` for the ground.
    pub fn body(&self) -> Option<usize> {
        match self {
            Place::Ground(_) => None,
            Place::Body(body, _) => Some(*body),
        }
    }

    /// The point at body coordinates `q` (length `nq`).
    pub fn at<T: Scalar>(&self, q: &[T]) -> PointOnBody<T> {
        match *self {
            Place::Ground([x, y]) => {
                let zero = T::from(0.0);
                PointOnBody { position: [T::from(x), T::from(y)], first: [zero; 2], second: [zero; 2] }
            }
            Place::Body(body, s) => {
                let (x, y, angle) = (q[3 * body], q[3 * body + 1], q[3 * body + 2]);
                let [dx, dy] = rotate(angle, s);
                PointOnBody { position: [x + dx, y + dy], first: [-dy, dx], second: [-dx, -dy] }
            }
        }
    }
}

/// R(φ) s
pub fn rotate<T: Scalar>(angle: T, s: [f64; 2]) -> [T; 2] {
    let (sin, cos) = angle.sin_cos();
    [cos * s[0] - sin * s[1], sin * s[0] + cos * s[1]]
}
