//! Loads that joints carry in a motion with known muscle forces (joint contact loads, joint reactions).
//!
//! ```text
//! F_j = Σ over bodies carried by joint j  (I A + V ×* I V − external loads − muscles)
//! ```
//!
//! A path passes through a point with a condition or not; a study, in which such points come and go smoothly, has other
//! tensions within the width of a switch.
//!
//! Everything that acts on the bodies on the far side of a joint is known, and what is missing passes through the joint:
//! muscles pull at both ends of each straight part of their path, at path points and where a path meets a surface.
//!
//! Source: K. M. Steele et al., *Gait & Posture* 35, 2012, as implemented in OpenSim's JointReaction.

use nalgebra::Vector3;

use super::spatial::{Movement, Snapshot};
use crate::model::tree::Tree;
use crate::model::tree::dynamics::{Dynamics, State};
use crate::model::tree::screw::{MassProperties, Screw, angular, cross_wrench, linear, screw};
use crate::motion::external_loads::LoadAt;
use crate::numerics::cubic::CubicSpline;
use crate::skeleton::Skeleton;
use crate::skeleton::frame::{Frame, Vector, minus, unit};

/// Forces of muscles over time.
pub struct MuscleForces {
    /// (muscle, force in N)
    pub forces: Vec<(usize, CubicSpline)>,
}

/// Load on the child of a joint, at the origin of the joint's frame there, in the ground's axes.
#[derive(Clone, Copy, Debug)]
pub struct JointLoad {
    /// N
    pub force: Vector,
    /// N m
    pub moment: Vector,
}

/// A model at an instant, with all that acts on it from outside.
pub struct Instant<'a> {
    pub skeleton: &'a Skeleton,
    pub tree: &'a Tree,
    /// Of the tree's coordinates.
    pub state: State<'a>,
    /// Values of the skeleton's coordinates.
    pub coordinates: &'a [f64],
    /// Of the bodies.
    pub frames: &'a [Frame<f64>],
    /// Loads with the bodies that they act on.
    pub loads: &'a [(LoadAt, usize)],
}

/// The load of each joint at an instant of a movement.
pub fn joint_loads(movement: &Movement<'_>, now: &Snapshot, muscles: &MuscleForces) -> Vec<JointLoad> {
    let tensions: Vec<(usize, f64)> = muscles.forces.iter().map(|(m, spline)| (*m, spline.at(now.time)[0])).collect();
    let [coordinates, speeds, accelerations] = &now.coordinates;
    let instant = Instant {
        skeleton: movement.skeleton,
        tree: &movement.tree,
        state: State { coordinates, speeds, accelerations, virtual_speeds: &[] },
        coordinates,
        frames: &now.frames,
        loads: &now.loads,
    };
    loads_at(&instant, &tensions)
}

/// The load of each joint; `tensions`: muscles with their forces, N.
pub fn loads_at(now: &Instant<'_>, tensions: &[(usize, f64)]) -> Vec<JointLoad> {
    let Instant { skeleton, frames, .. } = *now;
    let mut carried = inertial_wrenches(now);
    for &(muscle, tension) in tensions {
        let path = &skeleton.muscles[muscle].path;
        for part in path.route(skeleton, now.coordinates, frames).straight_parts(frames, now.coordinates) {
            let [from, to] = part.ends;
            let pull = Vector3::from(unit(&minus(&to, &from))) * tension;
            for (body, point, force) in [(part.bodies[0], from, pull), (part.bodies[1], to, -pull)] {
                carried[body] -= screw(Vector3::from(point).cross(&force), force);
            }
        }
    }
    // From the tips inwards.
    for joint in skeleton.joints.iter().rev() {
        if let Some(parent) = joint.parent {
            let beyond = carried[joint.child];
            carried[parent] += beyond;
        }
    }
    let at_joint = |joint: &crate::skeleton::Joint| {
        let wrench = carried[joint.child];
        let origin = Vector3::from((frames[joint.child] * joint.in_child).origin);
        let force = linear(&wrench);
        JointLoad { force: force.into(), moment: (angular(&wrench) - origin.cross(&force)).into() }
    };
    skeleton.joints.iter().map(at_joint).collect()
}

/// What each body needs for its motion beside gravity and external loads, about the ground's origin.
fn inertial_wrenches(now: &Instant<'_>) -> Vec<Screw> {
    let twists = Dynamics::new(now.tree, now.state, &[]).twists();
    let [gx, gy, gz] = now.skeleton.gravity;
    let at_rest = (Screw::zeros(), Screw::new(0.0, 0.0, 0.0, -gx, -gy, -gz));
    let bodies = now.skeleton.bodies.iter().zip(&now.tree.places).zip(now.frames);
    let inertial = bodies.map(|((body, (link, _)), frame): ((_, _), &Frame<f64>)| {
        let (v, a) = link.map_or(at_rest, |link| twists[link]);
        let inertia = MassProperties::of_body(body.mass, body.centre_of_mass, body.inertia).within(frame).matrix();
        inertia * a + cross_wrench(&v, &(inertia * v))
    });
    let mut wrenches: Vec<Screw> = inertial.collect();
    for (at, body) in now.loads {
        let force = Vector3::from(at.force);
        wrenches[*body] -= screw(Vector3::from(at.point).cross(&force) + Vector3::from(at.moment), force);
    }
    wrenches
}
