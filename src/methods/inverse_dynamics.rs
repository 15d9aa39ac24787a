//! Inverse dynamics without muscles: the net moment or force of each joint coordinate over a motion.

use std::ops::RangeInclusive;

use crate::model::tree::Tree;
use crate::model::tree::dynamics::{Dynamics, Load, Point, State};
use crate::motion::external_loads::ExternalLoads;
use crate::motion::{MotionTable, low_pass};
use crate::numerics::cubic::{CubicSpline, Ends};
use crate::skeleton::frame::{Frame, dot, norm};
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
}

/// A pose on the way, with everything that moves.
pub struct Instant {
    /// s
    pub time: f64,
    /// Values (rad, m), rates and accelerations of all coordinates; those that follow others only by value.
    pub coordinates: [Vec<f64>; 3],
    /// Of the bodies.
    pub frames: Vec<Frame<f64>>,
    /// External loads on links.
    pub loads: Vec<Load>,
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
        let spline = |coordinate: &Coordinate| {
            let values = table.column(&coordinate.name).filter(|_| !coordinate.locked)?;
            let smooth = low_pass(&table.time, values, smoothing_hz);
            Some(CubicSpline::new(&table.time.iter().copied().zip(smooth).collect::<Vec<_>>(), Ends::Natural))
        };
        let splines = skeleton.coordinates.iter().map(spline).collect();
        let time = table.time.iter().copied().filter(|t| window.contains(t)).collect();
        Self { skeleton, tree: Tree::new(skeleton), loads, time, splines }
    }

    /// The pose at a time, s.
    pub fn at(&self, time: f64) -> Instant {
        let mut coordinates = [0, 1, 2].map(|_| vec![0.0; self.splines.len()]);
        for (c, spline) in self.splines.iter().enumerate() {
            let default = [self.skeleton.coordinates[c].default, 0.0, 0.0];
            let values = spline.as_ref().map_or(default, |spline| spline.at(time));
            (0..3).for_each(|level| coordinates[level][c] = values[level]);
        }
        self.skeleton.follow(&mut coordinates[0]);
        let frames = self.skeleton.frames(&coordinates[0]);
        let on_link = |load: &crate::motion::external_loads::ExternalLoad| {
            let at = load.at(time, &frames);
            let link = self.tree.places[load.body].0?;
            Some(Load { link, point: Point::OfGround(at.point), force: at.force, moment: at.moment })
        };
        let loads = self.loads.iter().flat_map(|loads| &loads.loads).filter_map(on_link).collect();
        Instant { time, coordinates, frames, loads }
    }
}

impl Instant {
    pub fn dynamics<'t>(&self, tree: &'t Tree) -> Dynamics<'t> {
        let [coordinates, speeds, accelerations] = &self.coordinates;
        Dynamics::new(tree, State { coordinates, speeds, accelerations, virtual_speeds: &[] }, &self.loads)
    }
}

/// Net moments and forces over time.
#[derive(Clone, Debug)]
pub struct NetForces {
    /// (coordinate, its net moment in N m or force in N at each instant), those that are locked or follow others left out
    pub coordinates: Vec<(usize, Vec<f64>)>,
    /// Of each external load on a body that moves: its largest vertical force over the weight of all bodies.
    pub peaks: Vec<f64>,
}

/// The net forces at the instants of a movement.
pub fn inverse_dynamics(movement: &Movement<'_>) -> NetForces {
    let skeleton = movement.skeleton;
    let is_driven = |c: &usize| !skeleton.coordinates[*c].locked && skeleton.coordinates[*c].follows.is_none();
    let driven = (0..skeleton.coordinates.len()).filter(is_driven);
    let mut coordinates: Vec<(usize, Vec<f64>)> = driven.map(|c| (c, Vec::new())).collect();
    let gravity = norm(&skeleton.gravity);
    let weight = weight(skeleton);
    let mut peaks: Vec<f64> = Vec::new();
    for &t in &movement.time {
        let now = movement.at(t);
        peaks.resize(now.loads.len(), 0.0);
        for (load, peak) in now.loads.iter().zip(&mut peaks) {
            *peak = peak.max(-dot(&load.force, &skeleton.gravity) / (gravity * weight));
        }
        let forces = now.dynamics(&movement.tree).generalised_forces();
        coordinates.iter_mut().for_each(|(c, values)| values.push(forces[*c]));
    }
    NetForces { coordinates, peaks }
}

/// Weight of all bodies, N.
pub fn weight(skeleton: &Skeleton) -> f64 {
    skeleton.bodies.iter().map(|body| body.mass).sum::<f64>() * norm(&skeleton.gravity)
}
