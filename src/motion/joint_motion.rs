//! Motion of a spatial model from its joint coordinates over time: positions and velocities of all bodies.

use num_dual::Dual64;

use crate::model::spatial::Spatial;
use crate::model::spatial::joint::PER_BODY;
use crate::numerics::cubic::CubicSpline;
use crate::skeleton::frame::{Frame, minus, norm};
use crate::skeleton::{Role, Turn};

/// Joint coordinates as functions of time since the start of the motion, with the changes made by the study.
#[derive(Clone, Debug)]
pub struct JointMotion {
    spatial: Spatial,
    /// One for each joint coordinate of the skeleton.
    coordinates: Vec<CoordinateFunction>,
    /// Start of the motion in the time of the motion table, s.
    start: f64,
    time_scale: f64,
    /// Additional angle of each turn of the skeleton, rad.
    turns: Vec<f64>,
    /// All body coordinates at the start; they fix the signs of the Euler parameters.
    first: Vec<f64>,
}

/// A joint coordinate as a function of time.
#[derive(Clone, Debug)]
pub enum CoordinateFunction {
    Constant(f64),
    /// A spline in the time of the motion table. `first` is its value at the start; `offset` is added, and `scale`
    /// multiplies the excursion from `first`.
    Spline {
        spline: CubicSpline,
        first: f64,
        offset: f64,
        scale: f64,
    },
}

impl JointMotion {
    /// `coordinates`: one for each joint coordinate of the skeleton; `start` in s; `turns`: angles in rad.
    pub fn new(
        spatial: &Spatial,
        coordinates: Vec<CoordinateFunction>,
        start: f64,
        time_scale: f64,
        turns: Vec<f64>,
    ) -> Self {
        let mut motion = Self { spatial: spatial.clone(), coordinates, start, time_scale, turns, first: Vec::new() };
        motion.first = spatial.coordinates_of(&motion.frames(0.0).real(), None);
        motion
    }

    /// Joint coordinates at time `t` (s), with their rates in the dual parts.
    fn pose(&self, t: f64) -> Vec<Dual64> {
        let at = |function: &CoordinateFunction| match function {
            CoordinateFunction::Constant(value) => Dual64::from(*value),
            CoordinateFunction::Spline { spline, first, offset, scale } => {
                let [value, rate, _] = spline.at(self.start + t / self.time_scale);
                Dual64::new(first + offset + scale * (value - first), scale * rate / self.time_scale)
            }
        };
        let mut pose: Vec<Dual64> = self.coordinates.iter().map(at).collect();
        self.spatial.skeleton.follow(&mut pose);
        pose
    }

    /// Poses of all bodies of the skeleton at time `t` (s), with their rates in the dual parts.
    fn frames(&self, t: f64) -> BodyPoses<Dual64> {
        let skeleton = &self.spatial.skeleton;
        let pose = self.pose(t);
        let moving = skeleton.frames(&pose);
        let is_fixed = |body: usize| skeleton.bodies[body].role == Role::Fixed;
        let any_fixed = (0..skeleton.bodies.len()).any(is_fixed);
        if !any_fixed && self.turns.iter().all(|angle| *angle == 0.0) {
            return BodyPoses(moving);
        }
        let held =
            if any_fixed { self.pose(0.0).into_iter().map(|x| Dual64::from(x.re)).collect() } else { Vec::new() };
        let mut frames: Vec<Frame<Dual64>> = vec![Frame::identity(); skeleton.bodies.len()];
        for joint in &skeleton.joints {
            let parent = joint.parent.map_or_else(Frame::identity, |parent| frames[parent]);
            let place = parent * joint.in_parent.lift();
            let pose = if is_fixed(joint.child) { &held } else { &pose };
            let mut frame = place * joint.motion.frame(pose) * joint.in_child.inverse().lift();
            // A body on a fixed one keeps the orientation in space that it has where that one moves.
            let is_on_fixed = joint.parent.is_some_and(is_fixed) && !is_fixed(joint.child);
            let own = |(turn, angle): &(&Turn, &f64)| turn.body == joint.child && **angle != 0.0;
            let turns: Vec<(&Turn, &f64)> = skeleton.turns.iter().zip(&self.turns).filter(own).collect();
            if is_on_fixed || !turns.is_empty() {
                let mut axes = if is_on_fixed { moving[joint.child].axes } else { frame.axes };
                for (turn, angle) in turns {
                    let against = frames[turn.against];
                    let axis = [0, 1, 2].map(|i| (0..3).map(|j| against.axes[i][j].re * turn.axis[j]).sum::<f64>());
                    let turned = Frame::rotation(axis, Dual64::from(*angle));
                    axes = (turned * Frame { axes, origin: frame.origin }).axes;
                }
                let centre = (place * joint.motion.frame(pose)).origin;
                let turned = Frame { axes, origin: [Dual64::from(0.0); 3] };
                let arm = turned.point(&joint.in_child.origin.map(Dual64::from));
                frame = Frame { axes, origin: [0, 1, 2].map(|i| centre[i] - arm[i]) };
            }
            frames[joint.child] = frame;
        }
        BodyPoses(frames)
    }

    /// Coordinates of the bodies with equations of motion. The Euler parameters have the signs closest to those of
    /// `near` (default: to those at the start).
    pub fn measured(&self, t: f64, near: Option<&[f64]>) -> Vec<f64> {
        let near = near.unwrap_or(&self.first);
        let mut padded = near.to_vec();
        padded.extend_from_slice(&self.first[near.len()..]);
        let mut q = self.spatial.coordinates_of(&self.frames(t).real(), Some(&padded));
        q.truncate(PER_BODY * self.spatial.bodies.len());
        q
    }

    /// Coordinates of the bodies with prescribed motion, and their rates.
    pub fn given(&self, t: f64) -> (Vec<f64>, Vec<f64>) {
        if self.spatial.given.is_empty() {
            return Default::default();
        }
        let all: Vec<Dual64> = self.spatial.coordinates_of(&self.frames(t).0, Some(&self.first));
        all[PER_BODY * self.spatial.bodies.len()..].iter().map(|x| (x.re, x.eps)).unzip()
    }

    /// The largest distance (m) between two points that should coincide, with the name of their constraint.
    pub fn gap(&self, t: f64) -> Option<(f64, &str)> {
        let frames = self.frames(t).real();
        let gap = |held: &crate::skeleton::HeldPoint| {
            let [a, b] = [0, 1].map(|k| frames[held.bodies[k]].point(&held.points[k]));
            norm(&minus(&a, &b))
        };
        let gaps = self.spatial.skeleton.held_points.iter().map(|held| (gap(held), held.name.as_str()));
        gaps.max_by(|a, b| a.0.total_cmp(&b.0))
    }
}

/// Poses of all bodies of the skeleton.
struct BodyPoses<T>(Vec<Frame<T>>);

impl BodyPoses<Dual64> {
    /// The frames without their rates.
    fn real(&self) -> Vec<Frame<f64>> {
        let one = |frame: &Frame<Dual64>| Frame {
            axes: frame.axes.map(|row| row.map(|x| x.re)),
            origin: frame.origin.map(|x| x.re),
        };
        self.0.iter().map(one).collect()
    }
}
