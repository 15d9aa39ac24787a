//! Motion of a spatial model from its joint coordinates over time.

use crate::model::spatial::Spatial;
use crate::numerics::cubic::{CubicSpline, Ends};
use crate::skeleton::frame::{Frame, Vector, minus, norm};
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
    /// Given coordinates that fixed bodies and turns change, over time since the start.
    changed: Vec<(usize, CubicSpline)>,
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

impl CoordinateFunction {
    /// The value, rate and acceleration at a time of the table (s) that runs `time_scale` times slower.
    fn at(&self, time: f64, time_scale: f64) -> [f64; 3] {
        match self {
            Self::Constant(value) => [*value, 0.0, 0.0],
            Self::Spline { spline, first, offset, scale } => {
                let [value, rate, acceleration] = spline.at(time);
                let rate = scale * rate / time_scale;
                [first + offset + scale * (value - first), rate, scale * acceleration / (time_scale * time_scale)]
            }
        }
    }
}

impl JointMotion {
    /// `coordinates`: one for each joint coordinate of the skeleton; `clock`: start (s) and scale of the time; `turns`: angles
    /// in rad; `instants` of the motion since its start, s.
    pub fn new(
        spatial: &Spatial,
        coordinates: Vec<CoordinateFunction>,
        clock: (f64, f64),
        turns: Vec<f64>,
        instants: &[f64],
    ) -> Self {
        let (start, time_scale) = clock;
        let mut motion = Self { spatial: spatial.clone(), coordinates, start, time_scale, turns, changed: Vec::new() };
        let changed = motion.changed_joints(|role| role != Role::Free);
        if !changed.is_empty() {
            let mut near: Option<Vec<f64>> = None;
            let poses: Vec<Vec<f64>> = (instants.iter())
                .map(|&t| {
                    let pose = motion.changed_pose(t, &changed, near.as_deref());
                    near = Some(pose.clone());
                    pose
                })
                .collect();
            let spline = |c: usize| {
                let points: Vec<(f64, f64)> = instants.iter().zip(&poses).map(|(&t, pose)| (t, pose[c])).collect();
                (c, CubicSpline::new(&points, Ends::Natural))
            };
            let given = changed.iter().flat_map(|&joint| spatial.skeleton.joints[joint].motion.coordinates());
            motion.changed = given.map(spline).collect();
        }
        motion
    }

    /// Values of all joint coordinates at time `t` (s), as the motion has them.
    fn pose(&self, t: f64) -> Vec<f64> {
        let at = |function: &CoordinateFunction| function.at(self.clock(t), self.time_scale)[0];
        let mut pose: Vec<f64> = self.coordinates.iter().map(at).collect();
        self.spatial.skeleton.follow(&mut pose);
        pose
    }

    fn is_fixed(&self, body: usize) -> bool {
        self.spatial.skeleton.bodies[body].role == Role::Fixed
    }

    /// Joints of bodies with such a role whose coordinates are not those of the motion, because the body is turned or is on
    /// a fixed one.
    fn changed_joints(&self, has: impl Fn(Role) -> bool) -> Vec<usize> {
        let skeleton = &self.spatial.skeleton;
        let is_turned = |body: usize| skeleton.turns.iter().zip(&self.turns).any(|(t, a)| t.body == body && *a != 0.0);
        let joints = skeleton.joints.iter().enumerate().filter(|(_, joint)| has(skeleton.bodies[joint.child].role));
        let changed = joints.filter(|(_, joint)| {
            let on_fixed = joint.parent.is_some_and(|parent| self.is_fixed(parent));
            (on_fixed || is_turned(joint.child)) && !skeleton.is_locked(joint)
        });
        changed.map(|(k, _)| k).collect()
    }

    /// The time of the motion table at time `t` (s).
    pub fn clock(&self, t: f64) -> f64 {
        self.start + t / self.time_scale
    }

    /// Poses of all bodies of the skeleton at time `t` (s).
    pub fn frames(&self, t: f64) -> Vec<Frame<f64>> {
        let skeleton = &self.spatial.skeleton;
        let pose = self.pose(t);
        let moving = skeleton.frames(&pose);
        let any_fixed = (0..skeleton.bodies.len()).any(|body| self.is_fixed(body));
        if !any_fixed && self.turns.iter().all(|angle| *angle == 0.0) {
            return moving;
        }
        let held = self.pose(0.0);
        let mut frames: Vec<Frame<f64>> = vec![Frame::identity(); skeleton.bodies.len()];
        for joint in &skeleton.joints {
            let parent = joint.parent.map_or_else(Frame::identity, |parent| frames[parent]);
            let place = parent * joint.in_parent;
            let pose = if self.is_fixed(joint.child) { &held } else { &pose };
            let mut frame = place * joint.motion.frame(pose) * joint.in_child.inverse();
            // A body on a fixed one keeps the orientation in space that it has where that one moves.
            let is_on_fixed = joint.parent.is_some_and(|parent| self.is_fixed(parent)) && !self.is_fixed(joint.child);
            let own = |(turn, angle): &(&Turn, &f64)| turn.body == joint.child && **angle != 0.0;
            let turns: Vec<(&Turn, &f64)> = skeleton.turns.iter().zip(&self.turns).filter(own).collect();
            if is_on_fixed || !turns.is_empty() {
                let mut axes = if is_on_fixed { moving[joint.child].axes } else { frame.axes };
                for (turn, angle) in turns {
                    let against = frames[turn.against];
                    let axis: Vector = against.axes.map(|row| (0..3).map(|j| row[j] * turn.axis[j]).sum());
                    axes = (Frame::rotation(axis, *angle) * Frame { axes, origin: frame.origin }).axes;
                }
                let centre = (place * joint.motion.frame(pose)).origin;
                let arm = Frame { axes, origin: [0.0; 3] }.point(&joint.in_child.origin);
                frame = Frame { axes, origin: minus(&centre, &arm) };
            }
            frames[joint.child] = frame;
        }
        frames
    }

    /// Values of all joint coordinates, those of `joints` so that their bodies are where they should be; the nearest to
    /// `near` (default: to the motion).
    fn changed_pose(&self, t: f64, joints: &[usize], near: Option<&[f64]>) -> Vec<f64> {
        let mut pose = self.pose(t);
        if joints.is_empty() {
            return pose;
        }
        let frames = self.frames(t);
        let start = near.map_or_else(|| pose.clone(), <[f64]>::to_vec);
        for joint in joints.iter().map(|&k| &self.spatial.skeleton.joints[k]) {
            let parent = joint.parent.map_or_else(Frame::identity, |parent| frames[parent]) * joint.in_parent;
            let wanted = parent.inverse() * frames[joint.child] * joint.in_child;
            joint.motion.coordinates_of(&wanted, &start).into_iter().for_each(|(c, value)| pose[c] = value);
        }
        pose
    }

    /// Coordinates that move by forces, the nearest to those before.
    pub fn measured(&self, t: f64, before: Option<&[f64]>) -> Vec<f64> {
        let linkage = &self.spatial.linkage;
        let before = before.map(|before| linkage.coordinates(before));
        // A ball joint's own coordinates are not among those before: the motion's are as near.
        let near = before.as_ref().map(|before| {
            let mut near = self.pose(t);
            let own = near.len();
            linkage.free.iter().filter(|c| **c < own).for_each(|&c| near[c] = before[c]);
            near
        });
        let mut pose = self.changed_pose(t, &self.changed_joints(|role| role == Role::Free), near.as_deref());
        for (k, ball) in linkage.balls.iter().enumerate() {
            let near = [0, 1, 2].map(|i| before.as_ref().map_or(0.0, |before| before[linkage.ball_angle(k, i)]));
            pose.extend(ball.angles(&self.spatial.skeleton.joints[ball.joint].motion.frame(&pose), near));
        }
        linkage.free.iter().map(|&c| pose[c]).collect()
    }

    /// Given coordinates, their rates and accelerations.
    pub fn given(&self, t: f64) -> [Vec<f64>; 3] {
        let skeleton = &self.spatial.skeleton;
        let is_held = |c: usize| {
            let joint = skeleton.joints.iter().find(|joint| joint.motion.coordinates().contains(&c));
            joint.is_some_and(|joint| self.is_fixed(joint.child))
        };
        let at = |c: usize| {
            if let Some((_, spline)) = self.changed.iter().find(|(changed, _)| *changed == c) {
                return spline.at(t);
            }
            if is_held(c) {
                let [value, ..] = self.coordinates[c].at(self.start, self.time_scale);
                return [value, 0.0, 0.0];
            }
            self.coordinates[c].at(self.clock(t), self.time_scale)
        };
        let values: Vec<[f64; 3]> = self.spatial.linkage.given.iter().map(|&c| at(c)).collect();
        [0, 1, 2].map(|level| values.iter().map(|value| value[level]).collect())
    }

    /// The largest distance (m) between two points that should coincide, with the name of their constraint.
    pub fn gap(&self, t: f64) -> Option<(f64, &str)> {
        let frames = self.frames(t);
        let gap = |held: &crate::skeleton::HeldPoint| {
            let [a, b] = [0, 1].map(|k| frames[held.bodies[k]].point(&held.points[k]));
            norm(&minus(&a, &b))
        };
        let gaps = self.spatial.skeleton.held_points.iter().map(|held| (gap(held), held.name.as_str()));
        gaps.max_by(|a, b| a.0.total_cmp(&b.0))
    }
}
