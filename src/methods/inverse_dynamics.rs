//! Inverse dynamics without muscles: the net moment or force of each joint coordinate over a motion.

use std::ops::RangeInclusive;

use crate::model::tree::Tree;
use crate::model::tree::dynamics::{Dynamics, Load, Point, State};
use crate::motion::MotionTable;
use crate::motion::external_loads::ExternalLoads;
use crate::motion::low_pass;
use crate::numerics::cubic::{CubicSpline, Ends};
use crate::skeleton::frame::{dot, norm};
use crate::skeleton::{Coordinate, Skeleton};

/// Net moments and forces over time, and what acts from outside.
#[derive(Clone, Debug)]
pub struct NetForces {
    /// Instants of the motion, s.
    pub time: Vec<f64>,
    /// (coordinate, its net moment in N m or force in N at each instant), those that are locked or follow others left out
    pub coordinates: Vec<(usize, Vec<f64>)>,
    /// Of each external load: its largest vertical force over the weight of all bodies.
    pub peaks: Vec<f64>,
}

/// The net forces at the instants of a motion in a `window` (s), the motion's coordinates low-passed at `smoothing_hz`
/// (0: not). A coordinate without a column keeps its default.
pub fn inverse_dynamics(
    skeleton: &Skeleton,
    table: &MotionTable,
    loads: Option<&ExternalLoads>,
    window: RangeInclusive<f64>,
    smoothing_hz: f64,
) -> NetForces {
    let tree = Tree::new(skeleton);
    let spline = |coordinate: &Coordinate| {
        let values = table.column(&coordinate.name).filter(|_| !coordinate.locked)?;
        let smooth = low_pass(&table.time, values, smoothing_hz);
        Some(CubicSpline::new(&table.time.iter().copied().zip(smooth).collect::<Vec<_>>(), Ends::Natural))
    };
    let splines: Vec<Option<CubicSpline>> = skeleton.coordinates.iter().map(spline).collect();
    let is_driven = |c: &usize| !skeleton.coordinates[*c].locked && skeleton.coordinates[*c].follows.is_none();
    let time: Vec<f64> = table.time.iter().copied().filter(|t| window.contains(t)).collect();
    let driven = (0..skeleton.coordinates.len()).filter(is_driven);
    let mut coordinates: Vec<(usize, Vec<f64>)> = driven.map(|c| (c, Vec::with_capacity(time.len()))).collect();
    let loads = loads.map_or(&[][..], |loads| &loads.loads);
    let weight = skeleton.bodies.iter().map(|body| body.mass).sum::<f64>() * norm(&skeleton.gravity);
    let mut peaks = vec![0.0f64; loads.len()];
    for &t in &time {
        let mut motion = [0, 1, 2].map(|_| vec![0.0; splines.len()]);
        for (c, spline) in splines.iter().enumerate() {
            let values = spline.as_ref().map_or([skeleton.coordinates[c].default, 0.0, 0.0], |spline| spline.at(t));
            (0..3).for_each(|level| motion[level][c] = values[level]);
        }
        let mut pose = motion[0].clone();
        skeleton.follow(&mut pose);
        let frames = skeleton.frames(&pose);
        let mut on_links: Vec<Load> = Vec::with_capacity(loads.len());
        for (load, peak) in loads.iter().zip(&mut peaks) {
            let at = load.at(t, &frames);
            *peak = peak.max(-dot(&at.force, &skeleton.gravity) / (norm(&skeleton.gravity) * weight));
            if let Some(link) = tree.places[load.body].0 {
                on_links.push(Load { link, point: Point::OfGround(at.point), force: at.force, moment: at.moment });
            }
        }
        let [values, speeds, accelerations] = &motion;
        let state = State { coordinates: values, speeds, accelerations, virtual_speeds: &[] };
        let forces = Dynamics::new(&tree, state, &on_links).generalised_forces();
        coordinates.iter_mut().for_each(|(c, values)| values.push(forces[*c]));
    }
    NetForces { time, coordinates, peaks }
}
