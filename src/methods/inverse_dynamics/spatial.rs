//! Of a spatial model, in joint coordinates.

use std::ops::RangeInclusive;

use super::NetForce;
use nalgebra::Vector3;

use crate::model::tree::Tree;
use crate::model::tree::dynamics::{Dynamics, Load, Point, State};
use crate::model::tree::screw::{angular, linear};
use crate::motion::external_loads::{ExternalLoads, LoadAt};
use crate::motion::{MotionTable, smooth_spline};
use crate::numerics::cubic::CubicSpline;
use crate::skeleton::frame::{Frame, cross, dot, norm};
use crate::skeleton::{Coordinate, Skeleton};

/// A measured motion of a spatial model, with what acts on it from outside.
pub struct Movement<'m> {
    pub skeleton: &'m Skeleton,
    pub tree: Tree,
    pub loads: Option<&'m ExternalLoads>,
    /// Instants of the motion in the window, s.
    pub time: Vec<f64>,
    /// Of each coordinate; `None` keeps its default.
    splines: Vec<Option<CubicSpline>>,
    /// Components of the model's own forces that come with the motion; `None` for constant ones.
    forces: Vec<Option<[CubicSpline; 3]>>,
}

/// A pose on the way, with everything that moves.
pub struct Snapshot {
    /// s
    pub time: f64,
    /// Values (rad, m), rates and accelerations of all coordinates; those that follow others only by value.
    pub coordinates: [Vec<f64>; 3],
    /// Of the bodies.
    pub frames: Vec<Frame<f64>>,
    /// External loads and then the model's own forces, each with the body that it acts on.
    pub loads: Vec<(LoadAt, usize)>,
}

impl<'m> Movement<'m> {
    /// The instants of a motion in a `window` (s), its coordinates low-passed at `smoothing_hz` (0: not).
    pub fn new(
        skeleton: &'m Skeleton,
        table: &MotionTable,
        loads: Option<&'m ExternalLoads>,
        window: &RangeInclusive<f64>,
        smoothing_hz: f64,
    ) -> Self {
        let of = |coordinate: &Coordinate| {
            let values = table.column(&coordinate.name).filter(|_| !coordinate.locked)?;
            Some(smooth_spline(&table.time, values, smoothing_hz))
        };
        let splines = skeleton.coordinates.iter().map(of).collect();
        let time = table.time.iter().copied().filter(|t| window.contains(t)).collect();
        let components =
            |values: &[Vec<f64>; 3]| values.each_ref().map(|values| smooth_spline(&table.time, values, 0.0));
        let forces = skeleton.forces.iter().map(|force| table.force(&force.name).map(components)).collect();
        Self { skeleton, tree: Tree::new(skeleton), loads, time, splines, forces }
    }

    /// The pose at a time, s.
    pub fn at(&self, time: f64) -> Snapshot {
        let mut coordinates = [0, 1, 2].map(|_| vec![0.0; self.splines.len()]);
        for (c, spline) in self.splines.iter().enumerate() {
            let default = [self.skeleton.coordinates[c].default, 0.0, 0.0];
            let values = spline.as_ref().map_or(default, |spline| spline.at(time));
            (0..3).for_each(|level| coordinates[level][c] = values[level]);
        }
        self.skeleton.follow(&mut coordinates[0]);
        let frames = self.skeleton.frames(&coordinates[0]);
        let loads = self.loads.iter().flat_map(|loads| &loads.loads).map(|load| (load.at(time, &frames), load.body));
        let own = self.skeleton.forces.iter().zip(&self.forces).map(|(own, measured)| {
            let constant = own.force.unwrap_or_default();
            let force = measured.as_ref().map_or(constant, |splines| splines.each_ref().map(|x| x.at(time)[0]));
            let point = frames[own.body].point(&own.point);
            (LoadAt { point, force: force.map(|x| x * own.scale), moment: [0.0; 3] }, own.body)
        });
        let loads = loads.chain(own).collect();
        Snapshot { time, coordinates, frames, loads }
    }
}

impl Snapshot {
    pub fn dynamics<'t>(&self, tree: &'t Tree) -> Dynamics<'t> {
        let on_link = |(at, body): &(LoadAt, usize)| {
            let link = tree.places[*body].0?;
            Some(Load { link, point: Point::OfGround(at.point), force: at.force, moment: at.moment })
        };
        let loads: Vec<Load> = self.loads.iter().filter_map(on_link).collect();
        let [coordinates, speeds, accelerations] = &self.coordinates;
        Dynamics::new(tree, State { coordinates, speeds, accelerations, virtual_speeds: &[] }, &loads)
    }
}

/// What an external load amounts to.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LoadFacts {
    /// Largest vertical force, weights of all bodies.
    pub peak: f64,
    /// Largest speed (m/s) of its body at the centre of pressure, while the vertical force is above [`STANDING`].
    pub speed: f64,
}

/// A foot stands with more than this vertical force, body weights.
const STANDING: f64 = 0.2;

/// Of each external load of a movement.
pub fn load_facts(movement: &Movement<'_>) -> Vec<LoadFacts> {
    let skeleton = movement.skeleton;
    let mut facts = vec![LoadFacts::default(); movement.loads.map_or(0, |loads| loads.loads.len())];
    let unit = (norm(&skeleton.gravity) * weight(skeleton)).max(f64::MIN_POSITIVE);
    let up = skeleton.gravity.map(|g| -g / norm(&skeleton.gravity).max(f64::MIN_POSITIVE));
    for &t in &movement.time {
        let now = movement.at(t);
        let twists = now.dynamics(&movement.tree).twists();
        for ((load, body), own) in now.loads.iter().zip(&mut facts) {
            let vertical = -dot(&load.force, &skeleton.gravity) / unit;
            own.peak = own.peak.max(vertical);
            let Some(link) = movement.tree.places[*body].0.filter(|_| vertical > STANDING) else { continue };
            // Where the wrench's moment has no component across the vertical, at the height of the ground.
            let centre = cross(&up, &load.moment_about_origin()).map(|x| x / dot(&up, &load.force));
            let (twist, _) = twists[link];
            let speed = linear(&twist) + angular(&twist).cross(&Vector3::from(centre));
            own.speed = own.speed.max(speed.norm());
        }
    }
    facts
}

/// The net forces at the instants of a movement, of coordinates that are neither locked nor follow others.
pub fn net_forces(movement: &Movement<'_>) -> Vec<NetForce> {
    let skeleton = movement.skeleton;
    let residuals = residuals(skeleton, &movement.tree);
    let driven = skeleton.coordinates.iter().enumerate().filter(|(_, c)| c.is_independent());
    let mut found: Vec<(usize, NetForce)> = driven
        .map(|(c, coordinate)| {
            let (name, is_residual) = (coordinate.name.clone(), residuals.contains(&c));
            (c, NetForce { coordinate: name, is_angle: coordinate.is_angle, is_residual, values: Vec::new() })
        })
        .collect();
    for &t in &movement.time {
        let now = movement.at(t);
        let forces = now.dynamics(&movement.tree).generalised_forces();
        found.iter_mut().for_each(|(c, own)| own.values.push(forces[*c]));
    }
    found.into_iter().map(|(_, own)| own).collect()
}

/// The six coordinates of a base that floats: what acts there beside the loads would be zero if model, motion and loads
/// agreed.
pub fn residuals(skeleton: &Skeleton, tree: &Tree) -> Vec<usize> {
    let is_on_ground = |body: usize| tree.places[body].0.is_none();
    let joints = skeleton.joints.iter().filter(|joint| joint.parent.is_none_or(is_on_ground));
    let mut found = joints.map(|joint| {
        let mut own = joint.motion.coordinates();
        own.sort_unstable();
        own.dedup();
        own.retain(|&c| skeleton.coordinates[c].is_independent());
        own
    });
    found.find(|own| own.len() == 6).unwrap_or_default()
}

/// Weight of all bodies, N.
pub fn weight(skeleton: &Skeleton) -> f64 {
    skeleton.bodies.iter().map(|body| body.mass).sum::<f64>() * norm(&skeleton.gravity)
}
