//! Joints in space as constraint equations Φ(q) = 0 on positions and Euler parameters (Nikravesh 1988, ch. 7).
//!
//! | part | constraints |
//! |---|---|
//! | normal | ½ (pᵀp − 1) of one body; its multiplier is no joint reaction |
//! | coincide | the child's point is the parent's (m, m, m): spherical joints, and points held together |
//! | along | the child's point stays on a line or in a plane of the parent: n·(P_c − P_p) = 0 for each direction n (m) |
//! | turn | a·b = constant for a direction of the parent and one of the child: one for a universal joint, two for a revolute, three for a weld |
//! | ellipsoid | the child's point on an ellipsoid of the parent, an axis of the child tangential to it (scapulothoracic; m, rad) |
//!
//! The slots of a function are the seven coordinates x, y, z, e_0 … e_3 of the parent, then of the child.

use super::euler::rotated;
use super::jet::{Jet, dot};
use crate::numerics::Scalar;
use crate::skeleton::frame::{Frame, Vector, cross, unit};
use crate::skeleton::surface::tangents;
use crate::skeleton::{self, Axis, Motion};

/// Coordinates of a body.
pub const PER_BODY: usize = 7;
/// A function of two bodies.
pub type Pair<T> = Jet<T, { 2 * PER_BODY }>;

/// A point of the ground (body `None`) or of a body, from its centre of mass in its axes, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    pub body: Option<usize>,
    pub point: Vector,
}

#[derive(Clone, Debug)]
pub struct Joint {
    pub name: String,
    pub parent: Place,
    pub child: Place,
    pub parts: Vec<Part>,
}

/// Constraints of a joint; see the module. Directions in the axes of the parent (first) and of the child (second).
#[derive(Clone, Debug, PartialEq)]
pub enum Part {
    Normal,
    Coincide,
    Along(Vector),
    Turn(Vector, Vector, f64),
    Ellipsoid {
        /// In the parent: where the ellipsoid is, its axes, its radii.
        axes: [Vector; 3],
        radii: Vector,
        /// In the child.
        tangent: Vector,
    },
}

impl Part {
    pub fn constraints(&self) -> usize {
        match self {
            Part::Normal | Part::Along(_) | Part::Turn(..) => 1,
            Part::Ellipsoid { .. } => 2,
            Part::Coincide => 3,
        }
    }
}

/// Something fixed to a body, in jets: a direction, or a point if `origin`.
fn fixed<T: Scalar>(body: Option<usize>, side: usize, q: &[T], x: Vector, origin: bool) -> [Pair<T>; 3] {
    let Some(body) = body else { return x.map(|x| Jet::constant(T::from(x))) };
    let at = PER_BODY * side;
    let q = &q[PER_BODY * body..PER_BODY * (body + 1)];
    let mut out = rotated(&q[3..], at + 3, x);
    if origin {
        for (i, jet) in out.iter_mut().enumerate() {
            jet.value += q[i];
            jet.gradient[at + i] = T::from(1.0);
        }
    }
    out
}

impl Joint {
    pub fn constraints(&self) -> usize {
        self.parts.iter().map(Part::constraints).sum()
    }

    /// Coordinate of each slot, `usize::MAX` for the ground's.
    pub fn slots(&self) -> [usize; 2 * PER_BODY] {
        let bodies = [self.parent.body, self.child.body];
        std::array::from_fn(|i| bodies[i / PER_BODY].map_or(usize::MAX, |body| PER_BODY * body + i % PER_BODY))
    }

    /// Hands each constraint function to `each`.
    pub fn functions<T: Scalar>(&self, q: &[T], mut each: impl FnMut(&Pair<T>)) {
        let parent = |x: Vector| fixed(self.parent.body, 0, q, x, false);
        let child = |x: Vector| fixed(self.child.body, 1, q, x, false);
        let gap = || {
            let a = fixed(self.parent.body, 0, q, self.parent.point, true);
            let b = fixed(self.child.body, 1, q, self.child.point, true);
            [0, 1, 2].map(|i| b[i] - a[i])
        };
        for part in &self.parts {
            match part {
                Part::Normal => {
                    let body = self.child.body.expect("a body of its own");
                    let p = &q[PER_BODY * body + 3..PER_BODY * (body + 1)];
                    let mut norm = Jet::constant((p.iter().map(|x| *x * *x).sum::<T>() - 1.0) * 0.5);
                    for (k, x) in p.iter().enumerate() {
                        norm.gradient[PER_BODY + 3 + k] = *x;
                        norm.hessian[PER_BODY + 3 + k][PER_BODY + 3 + k] = T::from(1.0);
                    }
                    each(&norm);
                }
                Part::Coincide => gap().iter().for_each(&mut each),
                Part::Along(n) => each(&dot(&parent(*n), &gap())),
                Part::Turn(a, b, wanted) => {
                    let mut turn = dot(&parent(*a), &child(*b));
                    turn.value -= *wanted;
                    each(&turn);
                }
                Part::Ellipsoid { axes, radii, tangent } => {
                    // x_i along the axes over the radii: |x| = 1 on the ellipsoid.
                    let (gap, tangent) = (gap(), child(*tangent));
                    let frame = axes.map(parent);
                    let over = |i: usize| dot(&frame[i], &gap).scaled(1.0 / radii[i]);
                    let x = [over(0), over(1), over(2)];
                    let along = [0, 1, 2].map(|i| dot(&frame[i], &tangent));
                    let mut on = dot(&x, &x);
                    on.value -= 1.0;
                    let smallest = radii.iter().copied().fold(f64::INFINITY, f64::min);
                    each(&on.scaled(0.5 * smallest));
                    each(&dot(&x, &along));
                }
            }
        }
    }

    /// ½ (pᵀp − 1) = 0
    pub fn normal(name: &str, body: usize) -> Self {
        let place = |body| Place { body, point: [0.0; 3] };
        Self { name: name.to_owned(), parent: place(None), child: place(Some(body)), parts: vec![Part::Normal] }
    }

    /// The constraints of a joint of a skeleton between `parent` and `child`, given with the joint's frames in them: everything that
    /// its coordinates leave fixed. Of a `locked` joint, all: its frames are those of the pose it is locked in.
    pub fn of(
        joint: &skeleton::Joint,
        locked: bool,
        parent: (Option<usize>, Frame<f64>),
        child: (Option<usize>, Frame<f64>),
    ) -> Self {
        let column = |frame: &Frame<f64>, x: &Vector| [0, 1, 2].map(|i| (0..3).map(|j| frame.axes[i][j] * x[j]).sum());
        let (in_parent, in_child) = (|x: Vector| column(&parent.1, &x), |x: Vector| column(&child.1, &x));
        let unit_axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let parts = match &joint.motion {
            Motion::Ellipsoid { radii, .. } => vec![Part::Ellipsoid {
                axes: unit_axes.map(in_parent),
                radii: *radii,
                tangent: in_child([0.0, 1.0, 0.0]),
            }],
            motion => {
                let (translations, rotations): (&[_], &[_]) = match motion {
                    Motion::Axes { translations, rotations } if !locked => (translations, rotations),
                    _ => (&[], &[]),
                };
                let axis = |entries: &[Axis], i: usize| unit(&entries[i].direction);
                let mut parts = match translations.len() {
                    0 => vec![Part::Coincide],
                    1 => {
                        let (a, b) = tangents(&axis(translations, 0));
                        vec![Part::Along(in_parent(a)), Part::Along(in_parent(b))]
                    }
                    2 => vec![Part::Along(in_parent(unit(&cross(&axis(translations, 0), &axis(translations, 1)))))],
                    _ => Vec::new(),
                };
                let dot = crate::skeleton::frame::dot;
                match rotations.len() {
                    0 => parts.extend(
                        [(0, 1), (1, 2), (2, 0)]
                            .map(|(i, j)| Part::Turn(in_parent(unit_axes[i]), in_child(unit_axes[j]), 0.0)),
                    ),
                    1 => {
                        let axis = axis(rotations, 0);
                        let (a, b) = tangents(&axis);
                        parts.extend([a, b].map(|n| Part::Turn(in_parent(n), in_child(axis), 0.0)));
                    }
                    2 => {
                        let (a, b) = (axis(rotations, 0), axis(rotations, 1));
                        parts.push(Part::Turn(in_parent(a), in_child(b), dot(&a, &b)));
                    }
                    _ => {}
                }
                parts
            }
        };
        Self {
            name: joint.name.clone(),
            parent: Place { body: parent.0, point: parent.1.origin },
            child: Place { body: child.0, point: child.1.origin },
            parts,
        }
    }
}
