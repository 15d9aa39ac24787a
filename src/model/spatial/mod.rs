//! A spatial mechanism in joint coordinates θ: those that move by forces are unknowns, those of given motion follow them.
//!
//! ```text
//! ID(θ, θ̇, θ̈) + Φ_θᵀ f_r + R f_m − r = …      eq. (1), with ID by recursive Newton–Euler (see `tree::dynamics`)
//! Φ(θ) = 0                                     eq. (2), for points that are held together (see `loops`)
//! ```
//!
//! A joint has no constraints of its own: its coordinates are what it leaves free. Where the thesis has body coordinates and
//! joint reactions among its unknowns, these equations are what remains of them after the reactions are eliminated.

pub mod fitted;
pub mod jet;
pub mod linkage;
mod loops;
mod obstacles;
pub mod path;

use std::any::Any;
use std::sync::Arc;

use nalgebra::DMatrix;
use num_dual::Dual64;

use super::driven::DrivenCoordinate;
use super::mechanics::{EachConstraint, Level, Mechanics, Motion, numbered, through};
use super::path::Path;
use super::tree::dynamics::{self, Dynamics, Load, Point, State};
use crate::skeleton::frame::{Frame, Vector, cross, dot, norm};
use crate::skeleton::passive::PassiveEntry;
use crate::skeleton::{self, Skeleton};
use fitted::FittedPath;
use linkage::Linkage;
use loops::{Loop, ROWS};
use path::SpatialPath;

/// See [`Spatial::tracking_rows`].
const OWN_SHARE: f64 = 1e-3;

/// A force (N) and a moment (N m) on a body, in the ground's axes, at a point of the ground (m).
#[derive(Clone, Copy, Debug)]
pub struct BodyLoad {
    pub body: usize,
    pub point: Vector,
    pub force: Vector,
    pub moment: Vector,
}

#[derive(Clone, Debug)]
pub struct Spatial {
    pub skeleton: Arc<Skeleton>,
    pub linkage: Arc<Linkage>,
    loops: Vec<Loop>,
    /// External loads beside the skeleton's forces: names and bodies. Each is a force and then a moment about the ground's
    /// origin.
    pub external: Vec<(String, usize)>,
    /// Names of the unknowns: of a ball joint's angles that of the joint with `_1`, `_2` and `_3`.
    names: Vec<String>,
}

impl Spatial {
    /// The mechanism of a skeleton.
    pub fn new(skeleton: Arc<Skeleton>) -> Self {
        let linkage = Arc::new(Linkage::new(&skeleton));
        let loops = skeleton.held_points.iter().filter_map(|held| Loop::new(&linkage, held)).collect();
        let own = skeleton.coordinates.len();
        let name = |&c: &usize| match c.checked_sub(own) {
            None => skeleton.coordinates[c].name.clone(),
            Some(k) => format!("{}_{}", skeleton.joints[linkage.balls[k / 3].joint].name, k % 3 + 1),
        };
        let names = linkage.free.iter().map(name).collect();
        Self { skeleton, linkage, loops, external: Vec::new(), names }
    }

    /// The path of a muscle that moves something, otherwise `None`.
    pub fn path(&self, muscle: &skeleton::Muscle) -> Option<Path> {
        let fitted = FittedPath::new(&self.skeleton, &self.linkage, muscle);
        let path = fitted.map(|fitted| Path::Fitted(Box::new(fitted)));
        let path = path.unwrap_or_else(|| Path::Spatial(SpatialPath::new(&self.skeleton, &self.linkage, muscle)));
        (!path.slots().is_empty()).then_some(path)
    }

    /// Passive elements at unknowns, with the numbers of those.
    pub fn passive(&self) -> impl Iterator<Item = (usize, &PassiveEntry)> {
        let number = |element: &skeleton::passive::Passive| self.linkage.free_number(element.coordinate);
        self.skeleton.passive.iter().filter_map(move |element| Some((number(element)?, &element.entry)))
    }

    /// Whether a held point depends on an unknown.
    pub fn is_held(&self, unknown: usize) -> bool {
        self.loops.iter().any(|held| held.depends_on(unknown))
    }

    /// The angle (rad) of each turn's long axis about its axis, from where it hangs along that of the other body (0)
    /// outwards. `frames`: of all bodies.
    pub fn turns_reached(&self, frames: &[Frame<f64>]) -> Vec<(&str, f64)> {
        let turned = |body: usize, x: &Vector| super::tree::pose::turned(&frames[body], x);
        let reached = |turn: &skeleton::Turn| {
            // In the plane across the axis: from the direction in which the long axis is that of the other body.
            let long = turned(turn.body, &turn.long_axis);
            let rest = turned(turn.against, &turn.long_axis);
            let across = cross(&turned(turn.against, &turn.axis), &rest);
            dot(&long, &across).atan2(dot(&long, &rest))
        };
        self.skeleton.turns.iter().map(|turn| (turn.name.as_str(), reached(turn))).collect()
    }

    /// Brings values of the skeleton's coordinates up to date, from all coordinates `q`; those of ball joints are the nearest
    /// to the values before.
    pub fn skeleton_coordinates(&self, q: &[f64], near: &mut [f64]) {
        let (linkage, own) = (&self.linkage, near.len());
        let known = linkage.free.iter().chain(&linkage.given).zip(q);
        known.filter(|(c, _)| **c < own).for_each(|(&c, &x)| near[c] = x);
        for (k, ball) in linkage.balls.iter().enumerate() {
            let angles = [0, 1, 2].map(|i| q[linkage.free_number(linkage.ball_angle(k, i)).expect("an unknown")]);
            let motion = &self.skeleton.joints[ball.joint].motion;
            let before = ball.coordinates.map(|c| near[c]);
            if let Some(values) = ball.own_coordinates(angles, before) {
                ball.coordinates.into_iter().zip(values).for_each(|(c, value)| near[c] = value);
                continue;
            }
            let rotation = ball.rotation(angles);
            let wanted = Frame { origin: motion.frame(near).origin, ..rotation };
            motion.coordinates_of(&wanted, near).into_iter().for_each(|(c, value)| near[c] = value);
        }
        self.skeleton.follow(near);
    }

    /// What acts on bodies beside gravity and muscles, at all coordinates `q`: the loads, in their order, and the reactions
    /// (N) of held points.
    pub fn loads_at(&self, q: &[f64], loads: &[Vector], reactions: &[f64]) -> Vec<BodyLoad> {
        let frames = self.linkage.frames(q);
        let none = [0.0; 3];
        let (own, external) = loads.split_at(self.skeleton.forces.len());
        let own = self.skeleton.forces.iter().zip(own).map(|(place, force)| {
            let point = frames[place.body].point(&place.point);
            BodyLoad { body: place.body, point, force: *force, moment: none }
        });
        let (external, _) = external.as_chunks::<2>();
        let external = self.external.iter().zip(external);
        let external = external.map(|((_, body), [force, moment])| BodyLoad {
            body: *body,
            point: none,
            force: *force,
            moment: *moment,
        });
        let pose = self.linkage.pose(q);
        let (reactions, _) = reactions.as_chunks::<ROWS>();
        let held = self.loops.iter().zip(reactions).flat_map(|(held, reaction)| held.forces(&pose.links, reaction));
        let held = held.map(|(body, point, force)| BodyLoad { body, point, force, moment: none });
        own.chain(external).chain(held).collect()
    }

    /// Calls `use_it` with the mechanism at a motion, λ being the virtual speeds of the coordinates that move by forces.
    fn at<R>(
        &self,
        motion: Motion<'_>,
        loads: &[[f64; 3]],
        lambda: &[f64],
        use_it: impl FnOnce(&Dynamics<'_>) -> R,
    ) -> R {
        let linkage = &self.linkage;
        let (coordinates, speeds) = (linkage.coordinates(motion.q), linkage.rates(motion.velocity));
        let (accelerations, virtual_speeds) = (linkage.rates(motion.acceleration), linkage.rates(lambda));
        let state = State {
            coordinates: &coordinates,
            speeds: &speeds,
            accelerations: &accelerations,
            virtual_speeds: &virtual_speeds,
        };
        let on_link = |(force, load): (&skeleton::Force, &[f64; 3])| {
            let (link, frame) = linkage.tree.places[force.body];
            let point = Point::OfLink(frame.point(&force.point));
            Some(Load { link: link?, point, force: *load, moment: [0.0; 3] })
        };
        let (own, external) = loads.split_at(self.skeleton.forces.len().min(loads.len()));
        let (external, _) = external.as_chunks::<2>();
        let external = self.external.iter().zip(external).filter_map(|((_, body), [force, moment])| {
            let link = linkage.tree.places[*body].0?;
            Some(Load { link, point: Point::OfGround([0.0; 3]), force: *force, moment: *moment })
        });
        let own = self.skeleton.forces.iter().zip(own).filter_map(on_link);
        let loads: Vec<Load> = own.chain(external).collect();
        use_it(&Dynamics::new(&linkage.tree, state, &loads))
    }

    /// The mass matrix's diagonal in the default pose, kg or kg m².
    fn inertias(&self) -> Vec<f64> {
        let n = self.linkage.free.len();
        let rates = vec![0.0; n + self.linkage.given.len()];
        let default = self.linkage.default_coordinates();
        let force = |acceleration: &[f64]| {
            let mut force = vec![0.0; n];
            self.force(Motion { q: &default, velocity: &rates, acceleration }, &[], &mut force);
            force
        };
        let at_rest = force(&rates);
        let inertia = |i: usize| {
            let mut acceleration = rates.clone();
            acceleration[i] = 1.0;
            force(&acceleration)[i] - at_rest[i]
        };
        (0..n).map(inertia).collect()
    }
}

impl Mechanics for Spatial {
    fn as_any(&self) -> &dyn Any {
        self
    }

    fn coordinate_names(&self) -> Vec<String> {
        self.names.clone()
    }

    fn coordinates(&self) -> usize {
        self.linkage.free.len()
    }

    fn is_angle(&self, coordinate: usize) -> bool {
        self.skeleton.coordinates.get(self.linkage.free[coordinate]).is_none_or(|c| c.is_angle)
    }

    fn given_coordinate_names(&self) -> Vec<String> {
        self.linkage.given.iter().map(|&c| self.skeleton.coordinates[c].name.clone()).collect()
    }

    fn has_velocity_terms(&self) -> bool {
        true
    }

    fn constraints(&self) -> usize {
        ROWS * self.loops.len()
    }

    fn reaction_names(&self) -> Vec<String> {
        self.loops.iter().flat_map(|held| numbered(&held.name, ROWS)).collect()
    }

    fn load_names(&self) -> Vec<String> {
        let own = self.skeleton.forces.iter().flat_map(|force| numbered(&force.name, 3));
        let external = self.external.iter().map(|(name, _)| name);
        own.chain(external.flat_map(|name| numbered(name, 6))).collect()
    }

    fn constant_loads(&self) -> Vec<[f64; 3]> {
        let own = self.skeleton.forces.iter().map(|f| f.force.unwrap_or_default().map(|x| x * f.scale));
        own.chain(std::iter::repeat_n([0.0; 3], 2 * self.external.len())).collect()
    }

    fn joint_coordinates(&self) -> Vec<(&str, bool)> {
        self.skeleton.coordinates.iter().map(|c| (c.name.as_str(), c.is_angle)).collect()
    }

    fn driven_coordinates(&self) -> Vec<DrivenCoordinate<'_>> {
        let numbered = self.names.iter().enumerate();
        numbered.map(|(number, name)| DrivenCoordinate::unknown(name, self.is_angle(number), number)).collect()
    }

    fn coordinate_directions(&self, _q: &[f64]) -> Option<DMatrix<f64>> {
        let n = self.coordinates();
        self.loops.is_empty().then(|| DMatrix::identity(n, n))
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

    /// Those that move by forces; all others stay at their defaults.
    fn needed_coordinates(&self) -> Vec<&str> {
        self.linkage.moved().into_iter().map(|c| self.skeleton.coordinates[c].name.as_str()).collect()
    }

    fn measured_forces(&self) -> Vec<&str> {
        self.skeleton.forces.iter().filter(|f| f.force.is_none()).map(|f| f.name.as_str()).collect()
    }

    fn joint_coordinate_values(&self, q: &[f64], near: &mut Vec<f64>) -> Vec<(&str, f64)> {
        if near.is_empty() {
            *near = self.skeleton.default_pose();
        }
        self.skeleton_coordinates(q, near);
        let named = self.linkage.moved().into_iter().map(|c| (self.skeleton.coordinates[c].name.as_str(), near[c]));
        named.chain(self.turns_reached(&self.linkage.frames(q))).collect()
    }

    fn mass_and_gravity(&self) -> (f64, f64) {
        let bodies = self.skeleton.bodies.iter().enumerate().filter(|(b, _)| self.linkage.moves(*b));
        (bodies.map(|(_, body)| body.mass).sum(), norm(&self.skeleton.gravity))
    }

    fn bodies_and_joints(&self) -> (usize, usize) {
        let bodies = (0..self.skeleton.bodies.len()).filter(|&b| self.linkage.moves(b)).count();
        let moved = self.linkage.moved();
        let is_free = |c: usize| moved.contains(&c);
        let joints = self.skeleton.joints.iter().filter(|joint| joint.motion.coordinates().into_iter().any(is_free));
        (bodies, joints.count() + self.loops.len())
    }

    /// The thesis tracks the coordinates of all bodies. To first order their squared difference is Δθᵀ M Δθ, M summing how far
    /// all links with mass turn (rad) and their centres of mass move (m); the rows are those of M's Cholesky factor.
    ///
    /// DEPARTURE [thesis, Paper B, eq. 16]: the diagonal of M is enlarged by [`OWN_SHARE`], so that coordinates about the same
    /// axis, as in a hanging arm, are tracked one by one too.
    fn tracking_rows(&self, q: &[f64]) -> Vec<Vec<(usize, f64)>> {
        let mut metric = self.linkage.metric(q);
        let n = metric.nrows();
        (0..n).for_each(|i| metric[(i, i)] *= 1.0 + OWN_SHARE);
        let alone = DMatrix::from_diagonal(&metric.diagonal().map(f64::sqrt));
        let factor = metric.cholesky().map_or(alone, |cholesky| cholesky.unpack());
        (0..n).map(|k| (k..n).map(|i| (i, factor[(i, k)])).filter(|(_, factor)| *factor != 0.0).collect()).collect()
    }

    fn constraint_functions(&self, q: &[f64], each: EachConstraint<'_, f64>) {
        if self.loops.is_empty() {
            return;
        }
        let pose = self.linkage.pose(q);
        self.loops.iter().enumerate().for_each(|(k, held)| held.functions(&pose.links, ROWS * k, each));
    }

    fn constraint_functions_along(&self, q: &[Dual64], each: EachConstraint<'_, Dual64>) {
        if self.loops.is_empty() {
            return;
        }
        let links = self.linkage.tree.pose(&self.linkage.coordinates(q));
        self.loops.iter().enumerate().for_each(|(k, held)| held.functions(&links, ROWS * k, each));
    }

    fn bones(&self, q: &[f64]) -> Vec<(&str, Vec<Vec<f64>>)> {
        let frames = self.linkage.frames(q);
        let skeleton = &self.skeleton;
        let place = |body: usize, x: &Vector| frames[body].point(x).to_vec();
        let bone = |b: usize| {
            let held_by = skeleton.joints.iter().filter(|joint| joint.child == b);
            let held_by = held_by.map(|joint| place(b, &joint.in_child.origin));
            let holds = skeleton.joints.iter().filter(|joint| joint.parent == Some(b));
            let forces = skeleton.forces.iter().filter(|f| f.body == b).map(|f| place(b, &f.point));
            let held = skeleton.held_points.iter().filter(|held| held.bodies[0] == b);
            let held = held.map(|held| place(b, &held.points[0]));
            let holds = holds.map(|joint| place(b, &joint.in_parent.origin)).chain(held).chain(forces);
            through(held_by, place(b, &skeleton.bodies[b].centre_of_mass), holds)
        };
        skeleton.bodies.iter().enumerate().map(|(b, body)| (body.name.as_str(), bone(b))).collect()
    }

    fn force(&self, motion: Motion<'_>, loads: &[[f64; 3]], out: &mut [f64]) {
        let forces = self.at(motion, loads, &[], |dynamics| dynamics.generalised_forces());
        out.iter_mut().zip(&self.linkage.free).for_each(|(out, &c)| *out = forces[c]);
    }

    fn slopes(&self, motion: Motion<'_>, loads: &[[f64; 3]], each: &mut dyn FnMut(usize, Level, usize, f64)) {
        use dynamics::Level::{Acceleration, Coordinate, Speed, Virtual};
        let pairs = [Coordinate, Speed, Acceleration].map(|level| (Virtual, level));
        let linkage = &self.linkage;
        self.at(motion, loads, &[], |dynamics| {
            dynamics.second_derivatives(&linkage.is_free, &pairs, &mut |(_, row), (level, column), value| {
                if let (Some(row), Some(column)) = (linkage.free_number(row), linkage.free_number(column)) {
                    each(row, level_of(level), column, value);
                }
            });
        });
    }

    fn bends(
        &self,
        motion: Motion<'_>,
        loads: &[[f64; 3]],
        lambda: &[f64],
        each: &mut dyn FnMut((Level, usize), (Level, usize), f64),
    ) {
        use dynamics::Level::{Acceleration, Coordinate, Speed};
        // All others are zero.
        let pairs = [
            (Coordinate, Coordinate),
            (Coordinate, Speed),
            (Speed, Coordinate),
            (Speed, Speed),
            (Coordinate, Acceleration),
            (Acceleration, Coordinate),
        ];
        let linkage = &self.linkage;
        self.at(motion, loads, lambda, |dynamics| {
            dynamics.second_derivatives(&linkage.is_free, &pairs, &mut |(one, row), (other, column), value| {
                if let (Some(row), Some(column)) = (linkage.free_number(row), linkage.free_number(column)) {
                    each((level_of(one), row), (level_of(other), column), value);
                }
            });
        });
    }
}

fn level_of(level: dynamics::Level) -> Level {
    match level {
        dynamics::Level::Coordinate => Level::Coordinate,
        dynamics::Level::Speed => Level::Velocity,
        dynamics::Level::Acceleration => Level::Acceleration,
        dynamics::Level::Virtual => unreachable!("derivatives by virtual speeds are forces"),
    }
}
