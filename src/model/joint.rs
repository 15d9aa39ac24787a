//! Joints as constraint equations Φ(q) = 0 on body coordinates (thesis, Paper B eq. 2; Nikravesh,
//! *Computer-Aided Analysis of Mechanical Systems*, Prentice-Hall 1988, ch. 4).
//!
//! | kind | constraints | joint coordinate |
//! |---|---|---|
//! | revolute | the two points coincide (m, m) | angle of the child against the parent, rad |
//! | prismatic | the child's point stays on an axis of the parent (m), no turning (rad) | distance along the axis, m |
//! | weld | the two points coincide (m, m), no turning (rad) | – |
//!
//! Everything is generic in the number type, so that a dual number gives exact directional derivatives of
//! the Hessians.

use crate::numerics::Scalar;

use super::body::{Place, rotate};

#[derive(Clone, Debug)]
pub struct Joint {
    pub name: String,
    pub kind: JointKind,
    pub parent: Place,
    pub child: Place,
    /// Name of the joint coordinate, absent for welds and for joints that only close a loop.
    pub coordinate: Option<String>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum JointKind {
    /// `angle` = child angle − parent angle where the coordinate is zero, rad.
    Revolute {
        angle: f64,
    },
    /// `axis` is a unit vector in the parent's axes; `angle` as above, kept.
    Prismatic {
        axis: [f64; 2],
        angle: f64,
    },
    Weld {
        angle: f64,
    },
}

impl JointKind {
    pub fn constraints(&self) -> usize {
        match self {
            JointKind::Revolute { .. } => 2,
            JointKind::Prismatic { .. } => 2,
            JointKind::Weld { .. } => 3,
        }
    }

    /// Whether the joint coordinate is an angle (rad) and not a length (m).
    pub fn is_angular(&self) -> bool {
        !matches!(self, JointKind::Prismatic { .. })
    }
}

/// One scalar function of the coordinates of at most two bodies, with its gradient and Hessian over
/// those six coordinates: slot 0–2 the parent's, 3–5 the child's.
#[derive(Clone, Copy, Debug)]
pub struct PairFunction<T> {
    pub value: T,
    pub gradient: [T; 6],
    pub hessian: [[T; 6]; 6],
}

impl<T: Scalar> PairFunction<T> {
    fn zero() -> Self {
        let zero = T::from(0.0);
        Self { value: zero, gradient: [zero; 6], hessian: [[zero; 6]; 6] }
    }
}

fn angle_of<T: Scalar>(place: &Place, q: &[T]) -> T {
    place.body().map_or(T::from(0.0), |body| q[3 * body + 2])
}

impl Joint {
    /// The body of each half of the six slots of a [`PairFunction`].
    pub fn bodies(&self) -> [Option<usize>; 2] {
        [self.parent.body(), self.child.body()]
    }

    /// Body coordinate of each of the six slots; `None` on the ground.
    pub fn slots(&self) -> [Option<usize>; 6] {
        let [parent, child] = self.bodies();
        std::array::from_fn(|i| if i < 3 { parent } else { child }.map(|body| 3 * body + i % 3))
    }

    /// Calls `each` with the constraint functions of this joint, first and second derivatives with them.
    pub fn constraints<T: Scalar>(&self, q: &[T], mut each: impl FnMut(&PairFunction<T>)) {
        match self.kind {
            JointKind::Revolute { .. } => self.coincidence(q, each),
            JointKind::Weld { angle } => {
                self.coincidence(q, &mut each);
                each(&self.relative_angle(q, angle));
            }
            JointKind::Prismatic { axis, angle } => {
                each(&self.offset_along(q, [-axis[1], axis[0]]));
                each(&self.relative_angle(q, angle));
            }
        }
    }

    /// The joint coordinate (rad or m) at `q`; zero for a weld.
    pub fn coordinate_value<T: Scalar>(&self, q: &[T]) -> PairFunction<T> {
        match self.kind {
            JointKind::Revolute { angle } => self.relative_angle(q, angle),
            JointKind::Prismatic { axis, .. } => self.offset_along(q, axis),
            JointKind::Weld { .. } => PairFunction::zero(),
        }
    }

    /// child point − parent point, x and y.
    fn coincidence<T: Scalar>(&self, q: &[T], mut each: impl FnMut(&PairFunction<T>)) {
        let (parent, child) = (self.parent.at(q), self.child.at(q));
        for axis in 0..2 {
            let mut row = PairFunction::zero();
            row.value = child.position[axis] - parent.position[axis];
            row.gradient[axis] = T::from(-1.0);
            row.gradient[2] = -parent.first[axis];
            row.gradient[3 + axis] = T::from(1.0);
            row.gradient[5] = child.first[axis];
            row.hessian[2][2] = -parent.second[axis];
            row.hessian[5][5] = child.second[axis];
            each(&row);
        }
    }

    /// child angle − parent angle − reference.
    fn relative_angle<T: Scalar>(&self, q: &[T], reference: f64) -> PairFunction<T> {
        let mut row = PairFunction::zero();
        row.value = angle_of(&self.child, q) - angle_of(&self.parent, q) - reference;
        row.gradient[2] = T::from(-1.0);
        row.gradient[5] = T::from(1.0);
        row
    }

    /// n(φ_parent) · (child point − parent point) for a direction n fixed in the parent.
    fn offset_along<T: Scalar>(&self, q: &[T], direction: [f64; 2]) -> PairFunction<T> {
        let (parent, child) = (self.parent.at(q), self.child.at(q));
        let n = rotate(angle_of(&self.parent, q), direction);
        let n1 = [-n[1], n[0]];
        let dot = |a: [T; 2], b: [T; 2]| a[0] * b[0] + a[1] * b[1];
        let d = [child.position[0] - parent.position[0], child.position[1] - parent.position[1]];
        let mut row = PairFunction::zero();
        row.value = dot(n, d);
        row.gradient = [-n[0], -n[1], dot(n1, d) - dot(n, parent.first), n[0], n[1], dot(n, child.first)];
        // n'' = −n; the mixed terms come from n'(φ_parent) meeting the derivatives of d.
        row.hessian[2][2] = -dot(n, d) - dot(n1, parent.first) * 2.0 - dot(n, parent.second);
        row.hessian[5][5] = dot(n, child.second);
        let mixed = [(0, -n1[0]), (1, -n1[1]), (3, n1[0]), (4, n1[1]), (5, dot(n1, child.first))];
        for (slot, value) in mixed {
            row.hessian[2][slot] = value;
            row.hessian[slot][2] = value;
        }
        row
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use num_dual::Dual64;
    use rand::{RngExt, SeedableRng};

    fn joints() -> Vec<Joint> {
        let parent = Place::Body(0, [0.1, -0.2]);
        let child = Place::Body(1, [-0.05, 0.3]);
        let ground = Place::Ground([0.4, 0.1]);
        let kinds = [
            JointKind::Revolute { angle: 0.3 },
            JointKind::Prismatic { axis: [0.6, 0.8], angle: -0.2 },
            JointKind::Weld { angle: 0.1 },
        ];
        kinds
            .into_iter()
            .flat_map(|kind| [(parent, child), (ground, child)].map(|(parent, child)| (kind, parent, child)))
            .map(|(kind, parent, child)| Joint { name: "j".into(), kind, parent, child, coordinate: None })
            .collect()
    }

    #[test]
    fn gradients_and_hessians_agree_with_dual_numbers() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        for joint in joints() {
            for _ in 0..10 {
                let q: Vec<f64> = (0..6).map(|_| rng.random_range(-1.0..1.0)).collect();
                let all = |q: &[f64]| {
                    let mut rows = vec![joint.coordinate_value(q)];
                    joint.constraints(q, |row| rows.push(*row));
                    rows
                };
                let exact = all(&q);
                for (slot, coordinate) in joint.slots().into_iter().enumerate() {
                    let Some(coordinate) = coordinate else { continue };
                    let mut dual: Vec<Dual64> = q.iter().map(|&x| Dual64::from(x)).collect();
                    dual[coordinate] = dual[coordinate].derivative();
                    let mut rows = vec![joint.coordinate_value(&dual)];
                    joint.constraints(&dual, |row| rows.push(*row));
                    for (row, exact) in rows.iter().zip(&exact) {
                        assert!((row.value.eps - exact.gradient[slot]).abs() < 1e-13);
                        for (other, place) in joint.slots().into_iter().enumerate() {
                            if place.is_some() {
                                assert!((row.gradient[other].eps - exact.hessian[slot][other]).abs() < 1e-13);
                            }
                        }
                    }
                }
            }
        }
    }
}
