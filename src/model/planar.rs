//! A planar mechanism: a body has the coordinates x, y (m) of its centre of mass and its angle φ (rad), `nq = 3 nb`.

use std::any::Any;

use nalgebra::DMatrix;
use num_dual::Dual64;

use super::body::{Body, ExternalForce, Place};
use super::driven::DrivenCoordinate;
use super::joint::Joint;
use super::mechanics::{EachConstraint, Level, Mechanics, Motion, named, numbered, through};
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
    /// Diagonal of the mass matrix M: mass, mass, inertia of each body (kg, kg, kg m²).
    pub fn mass_diagonal(&self) -> Vec<f64> {
        self.bodies.iter().flat_map(|body| [body.mass, body.mass, body.inertia]).collect()
    }

    /// Names of the joint coordinates, in the order of the joints.
    pub fn coordinates_of_joints(&self) -> impl Iterator<Item = (&Joint, &str)> {
        self.joints.iter().filter_map(|joint| joint.coordinate.as_deref().map(|name| (joint, name)))
    }

    fn functions<T: Scalar>(&self, q: &[T], each: EachConstraint<'_, T>) {
        let mut row = 0;
        for joint in &self.joints {
            let slots = joint.slots().map(|slot| slot.unwrap_or(usize::MAX));
            joint.constraints(q, |function| {
                each(row, &slots, function.value, &function.gradient, function.hessian.as_flattened());
                row += 1;
            });
        }
    }
}

impl Mechanics for Planar {
    fn as_any(&self) -> &dyn Any {
        self
    }

    fn coordinate_names(&self) -> Vec<String> {
        self.bodies.iter().flat_map(|body| named(&body.name, &["x", "y", "angle"])).collect()
    }

    fn coordinates(&self) -> usize {
        3 * self.bodies.len()
    }

    fn is_angle(&self, coordinate: usize) -> bool {
        coordinate % 3 == 2
    }

    fn constraints(&self) -> usize {
        self.joints.iter().map(|joint| joint.kind.constraints()).sum()
    }

    fn reaction_names(&self) -> Vec<String> {
        self.joints.iter().flat_map(|joint| numbered(&joint.name, joint.kind.constraints())).collect()
    }

    fn load_names(&self) -> Vec<String> {
        self.forces.iter().flat_map(|force| numbered(&force.name, 3)).collect()
    }

    fn constant_loads(&self) -> Vec<[f64; 3]> {
        self.forces.iter().map(|f| [f.force[0], f.force[1], f.moment]).collect()
    }

    fn joint_coordinates(&self) -> Vec<(&str, bool)> {
        self.coordinates_of_joints().map(|(joint, name)| (name, joint.kind.is_angular())).collect()
    }

    fn driven_coordinates(&self) -> Vec<DrivenCoordinate<'_>> {
        self.coordinates_of_joints().map(|(joint, name)| DrivenCoordinate::of_joint(joint, name)).collect()
    }

    fn coordinate_directions(&self, q: &[f64]) -> Option<DMatrix<f64>> {
        self.directions(q)
    }

    /// All, unless there are loops, where some follow from others.
    fn needed_coordinates(&self) -> Vec<&str> {
        if self.joints.len() > self.bodies.len() {
            return Vec::new();
        }
        self.coordinates_of_joints().map(|(_, name)| name).collect()
    }

    fn joint_coordinate_values(&self, q: &[f64], _near: &mut Vec<f64>) -> Vec<(&str, f64)> {
        self.coordinates_of_joints().map(|(joint, name)| (name, joint.coordinate_value(q).value)).collect()
    }

    fn mass_and_gravity(&self) -> (f64, f64) {
        (self.bodies.iter().map(|body| body.mass).sum(), self.gravity[0].hypot(self.gravity[1]))
    }

    fn bodies_and_joints(&self) -> (usize, usize) {
        (self.bodies.len(), self.joints.len())
    }

    fn tracking_rows(&self, _q: &[f64]) -> Vec<Vec<(usize, f64)>> {
        (0..self.coordinates()).map(|i| vec![(i, 1.0)]).collect()
    }

    fn constraint_functions(&self, q: &[f64], each: EachConstraint<'_, f64>) {
        self.functions(q, each);
    }

    fn constraint_functions_along(&self, q: &[Dual64], each: EachConstraint<'_, Dual64>) {
        self.functions(q, each);
    }

    fn bones(&self, q: &[f64]) -> Vec<(&str, Vec<Vec<f64>>)> {
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

    fn force(&self, motion: Motion<'_>, loads: &[[f64; 3]], out: &mut [f64]) {
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

    fn slopes(&self, motion: Motion<'_>, loads: &[[f64; 3]], each: &mut dyn FnMut(usize, Level, usize, f64)) {
        for (i, mass) in self.mass_diagonal().into_iter().enumerate() {
            each(i, Level::Acceleration, i, mass);
        }
        for (force, load) in self.forces.iter().zip(loads) {
            let bend = Place::Body(force.body, force.point).at(motion.q).second;
            let angle = 3 * force.body + 2;
            each(angle, Level::Coordinate, angle, -(bend[0] * load[0] + bend[1] * load[1]));
        }
    }

    fn bends(
        &self,
        motion: Motion<'_>,
        loads: &[[f64; 3]],
        lambda: &[f64],
        each: &mut dyn FnMut((Level, usize), (Level, usize), f64),
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
