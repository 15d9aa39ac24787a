//! Ball joints in angles that are regular where the joint's own coordinates are singular.
//!
//! Three rotations R = R_1(θ_1) R_2(θ_2) R_3(θ_3) about axes a_1, a_2, a_3 are singular where the first and the last turn
//! about the same axis: a shoulder's plane of elevation in a hanging arm, where θ_2 is near 0. Instead, with b along a_2
//! and c = a_3 × b,
//!
//! ```text
//! R = R_b(α) R_c(β) R_3(γ)
//! ```
//!
//! which is singular at β = ±90°, an elevation by 90° across the first plane.

use super::frame::{Frame, Vector, cross, dot, norm, unit};
use super::{Joint, Motion, Role, Skeleton};

/// A ball joint in the angles α, β and γ.
#[derive(Clone, Debug)]
pub struct Ball {
    /// Number of the joint.
    pub joint: usize,
    /// The joint's own coordinates.
    pub coordinates: [usize; 3],
    /// a_1, a_2 and a_3.
    own: [Vector; 3],
    /// b, c and a_3.
    pub axes: [Vector; 3],
    /// If a_1 and a_2 are at right angles: a_1 along b, c and a_3, with a_1·R a_3 = C cos(θ_2 − δ); C and δ.
    elevation: Option<(Vector, [f64; 2])>,
}

/// A function of α and β, with first and second derivatives.
#[derive(Clone, Copy, Debug)]
pub struct OfAngles {
    pub value: f64,
    pub gradient: [f64; 2],
    pub hessian: [[f64; 2]; 2],
}

impl Ball {
    /// The ball joint at a joint with three rotations, `None` of others.
    pub fn of(number: usize, joint: &Joint) -> Option<Self> {
        let Motion::Axes { rotations, .. } = &joint.motion else { return None };
        let [first, second, third] = &rotations[..] else { return None };
        if !rotations.iter().all(|axis| axis.by.is_identity()) {
            return None;
        }
        let [a1, a2, a3] = [first, second, third].map(|axis| unit(&axis.direction));
        let along = dot(&a2, &a3);
        let b = unit(&[0, 1, 2].map(|i| a2[i] - along * a3[i]));
        let axes = [b, cross(&a3, &b), a3];
        let elevation = (dot(&a1, &a2).abs() < 1e-6).then(|| {
            let (c, s) = (dot(&a1, &a3), dot(&a1, &cross(&a2, &a3)));
            (axes.map(|axis| dot(&a1, &axis)), [c.hypot(s), s.atan2(c)])
        });
        let coordinates = [first, second, third].map(|axis| axis.coordinate);
        (b != [0.0; 3]).then_some(Self { joint: number, coordinates, own: [a1, a2, a3], axes, elevation })
    }

    /// R at the angles α, β and γ.
    pub fn rotation(&self, angles: [f64; 3]) -> Frame<f64> {
        let turns = (0..3).map(|i| Frame::rotation(self.axes[i], angles[i]));
        turns.fold(Frame::identity(), |frame, turn| frame * turn)
    }

    /// α, β and γ of the joint's rotation; α and γ the nearest to those before.
    pub fn angles(&self, rotation: &Frame<f64>, near: [f64; 3]) -> [f64; 3] {
        let turned = self.axes.map(|axis| rotation.axes.map(|row| dot(&row, &axis)));
        let entry = |i: usize, j: usize| dot(&self.axes[i], &turned[j]);
        let alpha = (-entry(1, 2)).atan2(entry(2, 2));
        let beta = entry(0, 2).clamp(-1.0, 1.0).asin();
        let gamma = (-entry(0, 1)).atan2(entry(0, 0));
        [nearest(alpha, near[0]), beta, nearest(gamma, near[2])]
    }

    /// The elevation θ_2 (rad), if it is one.
    pub fn elevation(&self, alpha: f64, beta: f64) -> Option<OfAngles> {
        let ([b, c, a], [size, offset]) = self.elevation?;
        let ((sa, ca), (sb, cb)) = (alpha.sin_cos(), beta.sin_cos());
        let x = (b * sb + cb * (a * ca - c * sa)) / size;
        let first = [-cb * (a * sa + c * ca) / size, (b * cb - sb * (a * ca - c * sa)) / size];
        let mixed = sb * (a * sa + c * ca) / size;
        let second = [[-cb * (a * ca - c * sa) / size, mixed], [mixed, -x]];
        let x = x.clamp(-1.0, 1.0);
        let sine = (1.0 - x * x).max(1e-16).sqrt();
        let (slope, bend) = (-1.0 / sine, -x / sine.powi(3));
        let hessian = [0, 1].map(|i| [0, 1].map(|j| bend * first[i] * first[j] + slope * second[i][j]));
        Some(OfAngles { value: offset + x.acos(), gradient: first.map(|d| slope * d), hessian })
    }

    /// The joint's own coordinates at the angles α, β and γ, the first and the third the nearest to those before; `None` if the
    /// first two axes are not at right angles. Where the first and the last axis coincide, the first coordinate stays.
    pub fn own_coordinates(&self, angles: [f64; 3], near: [f64; 3]) -> Option<[f64; 3]> {
        let second = self.elevation(angles[0], angles[1])?.value;
        let rotation = self.rotation(angles);
        let [a1, a2, a3] = self.own;
        // R_1 turns R_2 a_3 into R a_3, R_3 what is across a_3.
        let (from, to) = (Frame::rotation(a2, second).point(&a3), rotation.point(&a3));
        let angle = |axis: &Vector, from: &Vector, to: &Vector| {
            let across = |x: &Vector| [0, 1, 2].map(|i| x[i] - dot(x, axis) * axis[i]);
            let (from, to) = (across(from), across(to));
            (norm(&from) > 1e-9).then(|| dot(axis, &cross(&from, &to)).atan2(dot(&from, &to)))
        };
        let first = angle(&a1, &from, &to).unwrap_or(near[0]);
        let rest = (Frame::rotation(a1, first) * Frame::rotation(a2, second)).inverse() * rotation;
        let third = angle(&a3, &self.axes[0], &rest.point(&self.axes[0])).unwrap_or(near[2]);
        Some([nearest(first, near[0]), second, nearest(third, near[2])])
    }

    /// Whether the elevation is a function of α and β.
    pub fn has_elevation(&self) -> bool {
        self.elevation.is_some()
    }
}

/// An angle plus whole turns, as near as possible to another one.
fn nearest(angle: f64, near: f64) -> f64 {
    let turn = std::f64::consts::TAU;
    angle + turn * ((near - angle) / turn).round()
}

impl Skeleton {
    /// The ball joints whose coordinates are unknowns of a study: of bodies that move by forces, with coordinates that are
    /// neither locked nor followed by others, and drive nothing else.
    pub fn balls(&self) -> Vec<Ball> {
        let is_leader = |c: usize| {
            self.coordinates.iter().any(|other| other.follows.as_ref().is_some_and(|(leader, _)| *leader == c))
        };
        let is_own = |&c: &usize| {
            let uses = self.joints.iter().flat_map(|joint| joint.motion.coordinates()).filter(|own| *own == c).count();
            self.coordinates[c].is_independent() && !is_leader(c) && uses == 1
        };
        let asked = self.joints.iter().enumerate().filter(|(_, joint)| joint.ball);
        let free = asked.filter(|(_, joint)| self.bodies[joint.child].role == Role::Free);
        free.filter_map(|(k, joint)| Ball::of(k, joint)).filter(|ball| ball.coordinates.iter().all(is_own)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::skeleton::{Axis, function::Function};

    fn shoulder() -> (Joint, Ball) {
        let axis = |coordinate, direction| Axis { coordinate, direction, by: Function::identity() };
        let rotations = vec![axis(0, [0.0, 1.0, 0.0]), axis(1, [-1.0, 0.0, 0.0]), axis(2, [-0.0846, 0.9947, -0.0584])];
        let motion = Motion::Axes { translations: Vec::new(), rotations };
        let (in_parent, in_child) = (Frame::identity(), Frame::identity());
        let joint =
            Joint { name: "shoulder".to_owned(), parent: None, child: 0, in_parent, in_child, motion, ball: true };
        let ball = Ball::of(0, &joint).unwrap();
        (joint, ball)
    }

    #[test]
    fn the_angles_give_the_rotation_back_and_the_elevation_is_the_second_coordinate() {
        let (joint, ball) = shoulder();
        for q in [[0.4f64, 1.0, 0.3], [-1.2, 0.3, 2.5], [1.0, 0.9, -0.4]] {
            let rotation = joint.motion.frame(&q);
            let angles = ball.angles(&rotation, [0.0, 0.0, 6.0]);
            assert!((angles[2] - 6.0).abs() < 3.2);
            let again = ball.rotation(angles);
            let gap = again.axes.iter().flatten().zip(rotation.axes.iter().flatten());
            assert!(gap.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) < 1e-12);
            let turned = [q[0] + 0.3, 0.0, q[2] + 6.0];
            let back = ball.own_coordinates(angles, turned).unwrap();
            assert!((back[0] - q[0]).abs() < 1e-9 && (back[1] - q[1]).abs() < 1e-9, "{back:?}");
            assert!((back[2] - q[2] - std::f64::consts::TAU).abs() < 1e-9, "{back:?}");
            let found = ball.elevation(angles[0], angles[1]).unwrap();
            assert!((found.value - q[1]).abs() < 1e-12, "{} {}", found.value, q[1]);
            let h = 1e-6;
            for k in 0..2 {
                let at = |s: f64| {
                    let mut moved = [angles[0], angles[1]];
                    moved[k] += s;
                    ball.elevation(moved[0], moved[1]).unwrap()
                };
                let (low, high) = (at(-h), at(h));
                assert!(((high.value - low.value) / (2.0 * h) - found.gradient[k]).abs() < 1e-8);
                for i in 0..2 {
                    let bend = (high.gradient[i] - low.gradient[i]) / (2.0 * h);
                    assert!((bend - found.hessian[i][k]).abs() < 1e-6 * (1.0 + bend.abs()));
                }
            }
        }
    }
}
