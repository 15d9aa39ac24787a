//! A spatial mechanism: a body has the coordinates r (m) of its centre of mass and its Euler parameters p, `nq = 7 nb`.
//!
//! ```text
//! m r̈ − m g − F = …                                    eq. (1) of each body, and with G = ∂(A(p) s)/∂p
//! 4 K(p,p) p̈ − 8 K(ṗ,ṗ) p − Gᵀ F = …                   of its rotation (see `euler`)
//! Φ = 0:  ½ (pᵀp − 1) of each body, then the joints      (see `joint`)
//! ```
//!
//! Bodies that a weld or locked coordinates hold together are one rigid body. Bodies whose motion is given have their coordinates after
//! the unknown ones, and no equations.

pub mod euler;
pub mod jet;
pub mod joint;
mod obstacles;
pub mod path;

use std::any::Any;
use std::sync::Arc;

use nalgebra::{Matrix3, Vector3, Vector4};
use num_dual::Dual64;

use super::mechanics::{EachConstraint, Level, Mechanics, Motion, named, numbered, through};
use crate::numerics::Scalar;
use crate::skeleton::frame::{Frame, Vector, dot, minus, norm};
use crate::skeleton::{self, Role, Skeleton};
use euler::Turning;
use joint::{Joint, PER_BODY, Part, Place};
use path::{Elevation, Obstacle, PathPoint, SpatialPath};

/// Names of the coordinates of a body: position and Euler parameters.
const AXES: [&str; PER_BODY] = ["x", "y", "z", "e0", "e1", "e2", "e3"];

#[derive(Clone, Debug)]
pub struct Spatial {
    pub skeleton: Arc<Skeleton>,
    /// Gravitational acceleration, m/s².
    pub gravity: Vector,
    /// Bodies with equations, in the order of their coordinates.
    pub bodies: Vec<RigidBody>,
    /// Bodies of the skeleton whose motion is given, in the order of their coordinates.
    pub given: Vec<usize>,
    pub joints: Vec<Joint>,
    pub forces: Vec<Force>,
    /// Of each body of the skeleton: the body that moves it, and its frame from there.
    pub places: Vec<(usize, Frame<f64>)>,
}

/// Bodies of the skeleton that move as one.
#[derive(Clone, Debug)]
pub struct RigidBody {
    pub name: String,
    /// kg
    pub mass: f64,
    /// About the centre of mass, in the root's axes, kg m².
    pub inertia: Matrix3<f64>,
    /// The body of the skeleton in whose axes all is given.
    pub root: usize,
    /// Centre of mass in the root's frame, m.
    pub centre: Vector,
}

/// An external force, at a point from the centre of mass in the body's axes.
#[derive(Clone, Debug)]
pub struct Force {
    pub name: String,
    pub body: usize,
    pub point: Vector,
}

impl Joint {
    pub fn is_normal(&self) -> bool {
        self.parts == [Part::Normal]
    }
}

/// Mass, centre and inertia of bodies held together, in the frame of the first.
fn together(skeleton: &Skeleton, members: &[(usize, Frame<f64>)]) -> (f64, Vector, Matrix3<f64>) {
    let mass: f64 = members.iter().map(|(b, _)| skeleton.bodies[*b].mass).sum();
    let centre_of = |(b, frame): &(usize, Frame<f64>)| Vector3::from(frame.point(&skeleton.bodies[*b].centre_of_mass));
    let centre: Vector3<f64> = members.iter().map(|m| centre_of(m) * (skeleton.bodies[m.0].mass / mass)).sum();
    let mut inertia = Matrix3::zeros();
    for member in members {
        let body = &skeleton.bodies[member.0];
        let [xx, yy, zz, xy, xz, yz] = body.inertia;
        let own = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
        let axes = Matrix3::from_fn(|i, j| member.1.axes[i][j]);
        let d = centre_of(member) - centre;
        inertia += axes * own * axes.transpose();
        inertia += (Matrix3::identity() * d.dot(&d) - d * d.transpose()) * body.mass;
    }
    (mass, centre.into(), inertia)
}

impl Spatial {
    /// The mechanism of a skeleton.
    pub fn new(skeleton: Arc<Skeleton>) -> Self {
        let is_given = |b: usize| skeleton.bodies[b].role != Role::Free;
        // Who moves with whom: the root, and the frame in it.
        let mut roots: Vec<(usize, Frame<f64>)> = (0..skeleton.bodies.len()).map(|b| (b, Frame::identity())).collect();
        let pose = skeleton.default_pose();
        for joint in &skeleton.joints {
            let Some(parent) = joint.parent else { continue };
            if skeleton.is_locked(joint) && !is_given(parent) && !is_given(joint.child) {
                let (root, frame) = roots[parent];
                let inner = joint.in_parent * joint.motion.frame(&pose) * joint.in_child.inverse();
                roots[joint.child] = (root, frame * inner);
            }
        }
        let count = skeleton.bodies.len();
        let free: Vec<usize> = (0..count).filter(|&b| !is_given(b) && roots[b].0 == b).collect();
        let given: Vec<usize> = (0..count).filter(|&b| is_given(b)).collect();
        let bodies: Vec<RigidBody> = (free.iter())
            .map(|&root| {
                let members: Vec<(usize, Frame<f64>)> =
                    (0..count).filter(|&b| roots[b].0 == root).map(|b| (b, roots[b].1)).collect();
                let (mass, centre, inertia) = together(&skeleton, &members);
                RigidBody { name: skeleton.bodies[root].name.clone(), mass, inertia, root, centre }
            })
            .collect();
        let places: Vec<(usize, Frame<f64>)> = (roots.iter())
            .map(|(root, frame)| match free.iter().position(|b| b == root) {
                Some(index) => (index, Frame { origin: minus(&frame.origin, &bodies[index].centre), ..*frame }),
                None => {
                    let index = given.iter().position(|b| b == root).expect("free or given");
                    (free.len() + index, *frame)
                }
            })
            .collect();

        let is_free = |body: Option<usize>| body.is_some_and(|b| b < free.len());
        let mut joints: Vec<Joint> =
            bodies.iter().enumerate().map(|(b, body)| Joint::normal(&format!("{}.normal", body.name), b)).collect();
        for joint in &skeleton.joints {
            let (child, parent) = (places[joint.child], joint.parent.map(|parent| places[parent]));
            let same = parent.is_some_and(|parent| parent.0 == child.0);
            if same || !(is_free(Some(child.0)) || is_free(parent.map(|p| p.0))) {
                continue;
            }
            let locked = skeleton.is_locked(joint);
            let held = if locked { joint.in_parent * joint.motion.frame(&pose) } else { joint.in_parent };
            let outer = parent.map_or((None, held), |(body, frame)| (Some(body), frame * held));
            joints.push(Joint::of(joint, locked, outer, (Some(child.0), child.1 * joint.in_child)));
        }
        for held in &skeleton.held_points {
            let [a, b] = held.bodies.map(|b| places[b]);
            if is_free(Some(a.0)) || is_free(Some(b.0)) {
                let place =
                    |(body, frame): (usize, Frame<f64>), x: &Vector| Place { body: Some(body), point: frame.point(x) };
                joints.push(Joint {
                    name: held.name.clone(),
                    parent: place(a, &held.points[0]),
                    child: place(b, &held.points[1]),
                    parts: vec![Part::Coincide],
                });
            }
        }
        let forces = (skeleton.forces.iter())
            .map(|force| {
                let (body, frame) = places[force.body];
                Force { name: force.name.clone(), body, point: frame.point(&force.point) }
            })
            .collect();
        Self { gravity: skeleton.gravity, bodies, given, joints, forces, places, skeleton }
    }

    fn functions<T: Scalar>(&self, q: &[T], each: EachConstraint<'_, T>) {
        let mut row = 0;
        for joint in &self.joints {
            let slots = joint.slots();
            joint.functions(q, |function| {
                each(row, &slots, function.value, &function.gradient, function.hessian.as_flattened());
                row += 1;
            });
        }
    }

    fn turning<'a>(&'a self, body: usize, motion: Motion<'_>) -> Turning<'a> {
        let part = |x: &[f64]| Vector4::from_column_slice(&x[PER_BODY * body + 3..PER_BODY * (body + 1)]);
        Turning {
            inertia: &self.bodies[body].inertia,
            p: part(motion.q),
            rate: part(motion.velocity),
            acceleration: part(motion.acceleration),
        }
    }

    /// Coordinates of all bodies, free and given, where the skeleton's bodies have these frames; Euler parameters of the sign
    /// nearest to those of `near`.
    pub fn coordinates_of<T: Scalar>(&self, frames: &[Frame<T>], near: Option<&[f64]>) -> Vec<T> {
        let free = self.bodies.iter().map(|body| (body.root, body.centre));
        let mut q: Vec<T> = Vec::new();
        for (root, centre) in free.chain(self.given.iter().map(|&b| (b, [0.0; 3]))) {
            let at = q.len();
            let frame = &frames[root];
            q.extend(frame.point(&centre.map(T::from)));
            let p = euler::of_axes(&frame.axes);
            let flipped = near.is_some_and(|near| (0..4).map(|k| p[k].re() * near[at + 3 + k]).sum::<f64>() < 0.0);
            q.extend(p.map(|x| if flipped { -x } else { x }));
        }
        q
    }

    /// Values (rad, m) of the coordinates of joints that move by forces, where the bodies have the coordinates `q` (all of them): of each
    /// joint those whose frame is nearest to that of its bodies, from `near` on (values of all coordinates).
    fn values_of_joints(&self, q: &[f64], near: &[f64]) -> Vec<(usize, f64)> {
        let skeleton = &self.skeleton;
        let frame = |body: usize| {
            let (index, inner) = self.places[body];
            path::frame_of(q, Some(index)) * inner
        };
        let is_free = |body: usize| self.places[body].0 < self.bodies.len();
        let mut values = Vec::new();
        for joint in skeleton.joints.iter().filter(|joint| is_free(joint.child) && !skeleton.is_locked(joint)) {
            let parent = joint.parent.map_or_else(Frame::identity, frame) * joint.in_parent;
            let wanted = parent.inverse() * frame(joint.child) * joint.in_child;
            values.extend(joint.motion.coordinates_of(&wanted, near));
        }
        values
    }

    /// Whether a muscle acts on a free body.
    pub fn is_moved_by(&self, muscle: &skeleton::Muscle) -> bool {
        let is_free = |body: usize| self.places[body].0 < self.bodies.len();
        let movers = muscle.path.points.iter().flat_map(|point| &point.moves).filter_map(|moved| {
            let moves = |joint: &&skeleton::Joint| joint.motion.coordinates().contains(&moved.coordinate);
            self.skeleton.joints.iter().find(moves).map(|joint| joint.child)
        });
        let points = muscle.path.points.iter().map(|point| point.body);
        let surfaces = muscle.path.surfaces.iter().map(|obstacle| self.skeleton.surfaces[obstacle.surface].body);
        points.chain(surfaces).chain(movers).any(is_free)
    }

    /// The path of a muscle that acts on a free body.
    pub fn path(&self, muscle: &skeleton::Muscle) -> SpatialPath {
        let place = |body: usize, x: &Vector| {
            let (index, frame) = self.places[body];
            Place { body: Some(index), point: frame.point(x) }
        };
        let turn = |body: usize, x: &Vector| {
            let frame = self.places[body].1;
            [0, 1, 2].map(|i| (0..3).map(|j| frame.axes[i][j] * x[j]).sum())
        };
        let points = (muscle.path.points.iter())
            .map(|point| match point.in_proportion() {
                None => PathPoint { place: place(point.body, &point.point), moves: None },
                Some((coordinate, slope, start)) => PathPoint {
                    place: place(point.body, &start),
                    moves: Some((self.elevation(coordinate), turn(point.body, &slope))),
                },
            })
            .collect();
        let surfaces = (muscle.path.surfaces.iter())
            .map(|obstacle| {
                let surface = &self.skeleton.surfaces[obstacle.surface];
                let (body, frame) = self.places[surface.body];
                Obstacle {
                    body: Some(body),
                    frame: frame * surface.frame,
                    shape: surface.shape.clone(),
                    parts: obstacle.parts,
                }
            })
            .collect();
        SpatialPath::new(points, surfaces, self.bodies.len())
    }

    /// The angle (rad) of each turn's long axis about its axis, from where it hangs along that of the other body (0) outwards.
    /// `q`: all coordinates.
    pub fn turns_reached(&self, q: &[f64]) -> impl Iterator<Item = (&str, f64)> {
        let turned = move |body: usize, x: [f64; 3]| {
            let (index, frame) = self.places[body];
            let x = [0, 1, 2].map(|i| (0..3).map(|j| frame.axes[i][j] * x[j]).sum::<f64>());
            euler::rotate(&q[PER_BODY * index + 3..PER_BODY * (index + 1)], x)
        };
        self.skeleton.turns.iter().map(move |turn| {
            // In the plane across the axis: from the direction in which the long axis is that of the other body.
            let long = turned(turn.body, turn.long_axis);
            let rest = turned(turn.against, turn.long_axis);
            let across = skeleton::frame::cross(&turned(turn.against, turn.axis), &rest);
            (turn.name.as_str(), dot(&long, &across).atan2(dot(&long, &rest)))
        })
    }

    /// The coordinate that moves a path point, as a function of the bodies; [`Skeleton::check_study`] has seen that it is one.
    fn elevation(&self, coordinate: usize) -> Elevation {
        let joint = self.skeleton.elevation_joint(coordinate).expect("checked with the study");
        let skeleton::Motion::Axes { rotations, .. } = &joint.motion else { unreachable!("checked with the study") };
        let [a1, a2, a3] = [0, 1, 2].map(|i| skeleton::frame::unit(&rotations[i].direction));
        let (c, s) = (dot(&a1, &a3), dot(&a1, &skeleton::frame::cross(&a2, &a3)));
        let turn = |body: Option<usize>, inner: &Frame<f64>, x: &Vector| {
            let frame = body.map_or_else(Frame::identity, |b| self.places[b].1) * *inner;
            [0, 1, 2].map(|i| (0..3).map(|j| frame.axes[i][j] * x[j]).sum())
        };
        Elevation {
            parent: joint.parent.map(|b| self.places[b].0),
            child: Some(self.places[joint.child].0),
            axes: [turn(joint.parent, &joint.in_parent, &a1), turn(Some(joint.child), &joint.in_child, &a3)],
            cosine: [c.hypot(s), s.atan2(c)],
        }
    }
}

impl Mechanics for Spatial {
    fn as_any(&self) -> &dyn Any {
        self
    }

    fn body_coordinate_names(&self) -> Vec<String> {
        self.bodies.iter().flat_map(|body| named(&body.name, &AXES)).collect()
    }

    fn coordinates(&self) -> usize {
        PER_BODY * self.bodies.len()
    }

    fn given_coordinate_names(&self) -> Vec<String> {
        self.given.iter().flat_map(|&body| named(&self.skeleton.bodies[body].name, &AXES)).collect()
    }

    fn constraints(&self) -> usize {
        self.joints.iter().map(Joint::constraints).sum()
    }

    fn reaction_names(&self) -> Vec<Option<String>> {
        let names = |joint: &Joint| {
            let is_real = !joint.is_normal();
            numbered(&joint.name, joint.constraints()).map(|name| is_real.then_some(name)).collect::<Vec<_>>()
        };
        self.joints.iter().flat_map(names).collect()
    }

    fn load_names(&self) -> Vec<String> {
        self.skeleton.forces.iter().flat_map(|force| numbered(&force.name, 3)).collect()
    }

    fn constant_loads(&self) -> Vec<[f64; 3]> {
        self.skeleton.forces.iter().map(|f| f.force.unwrap_or_default().map(|x| x * f.scale)).collect()
    }

    fn joint_coordinates(&self) -> Vec<(&str, bool)> {
        self.skeleton.coordinates.iter().map(|c| (c.name.as_str(), c.is_angle)).collect()
    }

    fn turns(&self) -> Vec<&str> {
        self.skeleton.turns.iter().map(|turn| turn.name.as_str()).collect()
    }

    fn unmoved_coordinates(&self) -> Vec<(String, &'static str)> {
        let why = |coordinate: &skeleton::Coordinate| match (coordinate.locked, &coordinate.follows) {
            (true, _) => Some("is locked in the model"),
            (_, Some(_)) => Some("follows another coordinate of the model"),
            _ => None,
        };
        let coordinates = self.skeleton.coordinates.iter();
        coordinates.filter_map(|coordinate| Some((coordinate.name.clone(), why(coordinate)?))).collect()
    }

    /// Those of bodies that move by forces, except locked and dependent coordinates; all others stay at their defaults.
    fn needed_coordinates(&self) -> Vec<&str> {
        let skeleton = &self.skeleton;
        let free = skeleton.joints.iter().filter(|joint| skeleton.bodies[joint.child].role == Role::Free);
        let coordinates = free.flat_map(|joint| joint.motion.coordinates()).map(|c| &skeleton.coordinates[c]);
        coordinates.filter(|c| !c.locked && c.follows.is_none()).map(|c| c.name.as_str()).collect()
    }

    fn measured_forces(&self) -> Vec<&str> {
        self.skeleton.forces.iter().filter(|f| f.force.is_none()).map(|f| f.name.as_str()).collect()
    }

    fn joint_coordinate_values(&self, q: &[f64], near: &mut Vec<f64>) -> Vec<(&str, f64)> {
        if near.is_empty() {
            *near = self.skeleton.default_pose();
        }
        let found = self.values_of_joints(q, near);
        found.iter().for_each(|&(c, value)| near[c] = value);
        let named = found.iter().map(|&(c, value)| (self.skeleton.coordinates[c].name.as_str(), value));
        named.chain(self.turns_reached(q)).collect()
    }

    fn mass_and_gravity(&self) -> (f64, f64) {
        (self.bodies.iter().map(|body| body.mass).sum(), norm(&self.gravity))
    }

    fn bodies_and_joints(&self) -> (usize, usize) {
        (self.bodies.len(), self.joints.iter().filter(|joint| !joint.is_normal()).count())
    }

    fn tracking_weight(&self, coordinate: usize) -> f64 {
        if coordinate % PER_BODY >= 3 { 2.0 } else { 1.0 }
    }

    fn per_body(&self) -> (usize, usize) {
        (PER_BODY, 3)
    }

    fn constraint_functions(&self, q: &[f64], each: EachConstraint<'_, f64>) {
        self.functions(q, each);
    }

    fn constraint_functions_along(&self, q: &[Dual64], each: EachConstraint<'_, Dual64>) {
        self.functions(q, each);
    }

    fn bones(&self, q: &[f64]) -> Vec<(&str, Vec<Vec<f64>>)> {
        let position = |(body, point): (usize, Vector)| {
            let q = &q[PER_BODY * body..PER_BODY * (body + 1)];
            let turned = euler::rotate(&q[3..], point);
            (0..3).map(|axis| q[axis] + turned[axis]).collect::<Vec<f64>>()
        };
        let joints = || self.joints.iter().filter(|joint| !joint.is_normal());
        let bone = |b: usize| {
            let on_it = |place: &Place| (place.body == Some(b)).then_some((b, place.point));
            let held_by = joints().filter_map(|joint| on_it(&joint.child));
            let forces = self.forces.iter().filter(|f| f.body == b).map(|f| (b, f.point));
            let holds = joints().filter_map(|joint| on_it(&joint.parent)).chain(forces);
            through(held_by.map(position), position((b, [0.0; 3])), holds.map(position))
        };
        let names = self.bodies.iter().map(|body| &body.name);
        let names = names.chain(self.given.iter().map(|&b| &self.skeleton.bodies[b].name));
        names.enumerate().map(|(b, name)| (name.as_str(), bone(b))).collect()
    }

    fn force(&self, motion: Motion<'_>, loads: &[Vector], out: &mut [f64]) {
        for (b, body) in self.bodies.iter().enumerate() {
            let at = PER_BODY * b;
            for axis in 0..3 {
                out[at + axis] = body.mass * (motion.acceleration[at + axis] - self.gravity[axis]);
            }
            out[at + 3..at + PER_BODY].copy_from_slice(self.turning(b, motion).force().as_slice());
        }
        for (force, load) in self.forces.iter().zip(loads).filter(|(force, _)| force.body < self.bodies.len()) {
            let at = PER_BODY * force.body;
            let columns = euler::slopes(&motion.q[at + 3..at + PER_BODY], force.point);
            (0..3).for_each(|axis| out[at + axis] -= load[axis]);
            (0..4).for_each(|k| out[at + 3 + k] -= dot(&columns[k], load));
        }
    }

    fn slopes(&self, motion: Motion<'_>, loads: &[Vector], each: &mut dyn FnMut(usize, Level, usize, f64)) {
        for (b, body) in self.bodies.iter().enumerate() {
            let at = PER_BODY * b;
            for axis in 0..3 {
                each(at + axis, Level::Acceleration, at + axis, body.mass);
            }
            let levels = [Level::Coordinate, Level::Velocity, Level::Acceleration];
            for (slopes, level) in self.turning(b, motion).slopes().iter().zip(levels) {
                for i in 0..4 {
                    (0..4).for_each(|j| each(at + 3 + i, level, at + 3 + j, slopes[(i, j)]));
                }
            }
        }
        for (force, load) in self.forces.iter().zip(loads).filter(|(force, _)| force.body < self.bodies.len()) {
            let at = PER_BODY * force.body + 3;
            for i in 0..4 {
                for j in 0..4 {
                    each(at + i, Level::Coordinate, at + j, -dot(&euler::bend(i, j, force.point), load));
                }
            }
        }
    }

    fn bends(
        &self,
        motion: Motion<'_>,
        _loads: &[Vector],
        lambda: &[f64],
        each: &mut dyn FnMut((Level, usize), (Level, usize), f64),
    ) {
        use Level::{Acceleration, Coordinate, Velocity};
        for b in 0..self.bodies.len() {
            let at = PER_BODY * b + 3;
            let hessian = self.turning(b, motion).hessian(&Vector4::from_column_slice(&lambda[at..at + 4]));
            for i in 0..4 {
                for j in 0..4 {
                    let (row, column) = (at + i, at + j);
                    each((Coordinate, row), (Coordinate, column), hessian.pp[(i, j)]);
                    each((Velocity, row), (Velocity, column), hessian.rate_rate[(i, j)]);
                    for (level, block) in [(Velocity, &hessian.rate_p), (Acceleration, &hessian.acceleration_p)] {
                        each((level, row), (Coordinate, column), block[(i, j)]);
                        each((Coordinate, column), (level, row), block[(i, j)]);
                    }
                }
            }
        }
    }
}
