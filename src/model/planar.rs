//! A planar mechanism: a body has the coordinates x, y (m) of its centre of mass and its angle φ (rad), `nq = 3 nb`.

use super::body::{Body, ExternalForce, Place};
use super::joint::Joint;
use super::mechanics::{Level, Motion, through};
use crate::numerics::Scalar;

#[derive(Clone, Debug)]
pub struct Planar {
    /// Gravitational acceleration, m/s².
    pub gravity: [f64; 2],
    pub bodies: Vec<Body>,
    pub joints: Vec<Joint>,
    pub forces: Vec<ExternalForce>,
}

impl Planar {
    pub fn coordinates(&self) -> usize {
        3 * self.bodies.len()
    }

    pub fn constraints(&self) -> usize {
        self.joints.iter().map(|joint| joint.kind.constraints()).sum()
    }

    /// Diagonal of the mass matrix M: mass, mass, inertia of each body (kg, kg, kg m²).
    pub fn mass_diagonal(&self) -> Vec<f64> {
        self.bodies.iter().flat_map(|body| [body.mass, body.mass, body.inertia]).collect()
    }

    /// Names of the joint coordinates, in the order of the joints.
    pub fn joint_coordinates(&self) -> impl Iterator<Item = (&Joint, &str)> {
        self.joints.iter().filter_map(|joint| joint.coordinate.as_deref().map(|name| (joint, name)))
    }

    /// See [`super::Mechanics::bones`].
    pub fn bones(&self, q: &[f64]) -> Vec<(&str, Vec<Vec<f64>>)> {
        let position = |place: Place| place.at(q).position.to_vec();
        let bone = |b: usize| {
            let on_it = |place: &&Place| place.body() == Some(b);
            let held_by = self.joints.iter().map(|joint| &joint.child).filter(on_it).copied();
            let holds = self.joints.iter().map(|joint| &joint.parent).filter(on_it).copied();
            let forces = self.forces.iter().filter(|f| f.body == b).map(|f| Place::Body(b, f.point));
            through(held_by.map(position), position(Place::Body(b, [0.0; 2])), holds.chain(forces).map(position))
        };
        self.bodies.iter().enumerate().map(|(b, body)| (body.name.as_str(), bone(b))).collect()
    }

    /// See [`super::Mechanics::constraint_functions`].
    pub fn constraint_functions<T: Scalar>(&self, q: &[T], mut each: impl FnMut(usize, &[usize], T, &[T], &[T])) {
        let mut row = 0;
        for joint in &self.joints {
            let slots = joint.slots().map(|slot| slot.unwrap_or(usize::MAX));
            joint.constraints(q, |function| {
                each(row, &slots, function.value, &function.gradient, function.hessian.as_flattened());
                row += 1;
            });
        }
    }

    /// M q̈ − g_ext
    pub fn force(&self, motion: Motion<'_>, loads: &[[f64; 3]], out: &mut [f64]) {
        for (b, body) in self.bodies.iter().enumerate() {
            for axis in 0..2 {
                out[3 * b + axis] = body.mass * (motion.acceleration[3 * b + axis] - self.gravity[axis]);
            }
            out[3 * b + 2] = body.inertia * motion.acceleration[3 * b + 2];
        }
        for (force, load) in self.forces.iter().zip(loads) {
            let place = Place::Body(force.body, force.point).at(motion.q);
            for axis in 0..2 {
                out[3 * force.body + axis] -= load[axis];
            }
            out[3 * force.body + 2] -= place.first[0] * load[0] + place.first[1] * load[1] + load[2];
        }
    }

    pub fn slopes(&self, motion: Motion<'_>, loads: &[[f64; 3]], mut each: impl FnMut(usize, Level, usize, f64)) {
        for (i, mass) in self.mass_diagonal().into_iter().enumerate() {
            each(i, Level::Acceleration, i, mass);
        }
        for (force, load) in self.forces.iter().zip(loads) {
            let bend = Place::Body(force.body, force.point).at(motion.q).second;
            let angle = 3 * force.body + 2;
            each(angle, Level::Coordinate, angle, -(bend[0] * load[0] + bend[1] * load[1]));
        }
    }

    pub fn bends(
        &self,
        motion: Motion<'_>,
        loads: &[[f64; 3]],
        lambda: &[f64],
        mut each: impl FnMut((Level, usize), (Level, usize), f64),
    ) {
        for (force, load) in self.forces.iter().zip(loads) {
            // The third derivative by the angle is −R′ s.
            let first = Place::Body(force.body, force.point).at(motion.q).first;
            let angle = 3 * force.body + 2;
            let bend = lambda[angle] * (first[0] * load[0] + first[1] * load[1]);
            each((Level::Coordinate, angle), (Level::Coordinate, angle), bend);
        }
    }
}
