//! What the equations of motion and the results need to know of a mechanism.

use std::any::Any;

use nalgebra::DMatrix;
use num_dual::Dual64;

use super::driven::DrivenCoordinate;

/// A coordinate, its rate or its acceleration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    Coordinate,
    Velocity,
    Acceleration,
}

/// The motion at an instant, given coordinates last; velocities may be empty for a mechanism whose equations have none.
#[derive(Clone, Copy, Debug)]
pub struct Motion<'a> {
    pub q: &'a [f64],
    pub velocity: &'a [f64],
    pub acceleration: &'a [f64],
}

/// Receives a constraint function: its row, its coordinates (`usize::MAX` for the ground, nq and more for given ones), value, gradient and Hessian over those.
pub type EachConstraint<'e, T> = &'e mut dyn FnMut(usize, &[usize], T, &[T], &[T]);

/// Bodies, joints and external forces, with the equations of their motion. Where `q` is asked for, it holds all
/// coordinates, those of given motion last.
pub trait Mechanics: std::fmt::Debug + Send + Sync {
    /// For code that knows one kind of mechanism only.
    fn as_any(&self) -> &dyn Any;

    /// Names of the coordinates that are unknowns, nq of them: `upper_arm.x` and so on of a planar mechanism.
    fn coordinate_names(&self) -> Vec<String>;

    /// Number nq of coordinates that are unknowns.
    fn coordinates(&self) -> usize;

    /// Whether an unknown is an angle (rad) or a length (m).
    fn is_angle(&self, coordinate: usize) -> bool;

    /// Names of the coordinates whose motion is given.
    fn given_coordinate_names(&self) -> Vec<String> {
        Vec::new()
    }

    /// Whether velocities are in the equations of motion.
    fn has_velocity_terms(&self) -> bool {
        false
    }

    /// Number of joint constraints nc.
    fn constraints(&self) -> usize;

    /// Name of the reaction of each constraint, `joint.0` and so on.
    fn reaction_names(&self) -> Vec<String>;

    /// Names of the components of the external forces: three each; of a planar one the third is its moment. A load with a
    /// moment in space counts as two.
    fn load_names(&self) -> Vec<String>;

    /// The external forces where nothing else is known of them, see [`Mechanics::force`].
    fn constant_loads(&self) -> Vec<[f64; 3]>;

    /// The joint coordinates by name, and whether each is an angle.
    fn joint_coordinates(&self) -> Vec<(&str, bool)>;

    /// The joint coordinates that actuators may drive.
    fn driven_coordinates(&self) -> Vec<DrivenCoordinate<'_>>;

    /// The motions (a column each, nq rows) in which one of them changes at a rate of 1 and all others stay. `None` if joints
    /// that close a loop allow none.
    fn coordinate_directions(&self, q: &[f64]) -> Option<DMatrix<f64>>;

    /// What a study may change in a motion beside the joint coordinates, by name; angles.
    fn turns(&self) -> Vec<&str> {
        Vec::new()
    }

    /// Joint coordinates that stay as they are whatever the motion says, with why.
    fn unmoved_coordinates(&self) -> Vec<(String, &'static str)> {
        Vec::new()
    }

    /// Joint coordinates that a motion must have.
    fn needed_coordinates(&self) -> Vec<&str>;

    /// External forces that the motion file must have over time.
    fn measured_forces(&self) -> Vec<&str> {
        Vec::new()
    }

    /// Values of the joint coordinates (rad, m), of a spatial model those that move by forces and its turns. `near`: values
    /// before, from which those of ball joints are found, and which are brought up to date.
    fn joint_coordinate_values(&self, q: &[f64], near: &mut Vec<f64>) -> Vec<(&str, f64)>;

    /// Total mass (kg) of the bodies that move by forces, and the size of gravity, m/s².
    fn mass_and_gravity(&self) -> (f64, f64);

    /// Numbers of bodies that move by forces, and of joints.
    fn bodies_and_joints(&self) -> (usize, usize);

    /// The tracking term at a measured pose `q`: a sum of squares of these combinations of differences of the unknowns, each
    /// with its factors.
    fn tracking_rows(&self, q: &[f64]) -> Vec<Vec<(usize, f64)>>;

    /// Hands each constraint function to `each`.
    fn constraint_functions(&self, q: &[f64], each: EachConstraint<'_, f64>);

    /// The same with directional derivatives in the dual parts.
    fn constraint_functions_along(&self, q: &[Dual64], each: EachConstraint<'_, Dual64>);

    /// Inertial forces less gravity and external forces, `M q̈ + (quadratic velocity terms) − g_ext`, N and N m.
    /// `loads`: each external force in the ground's axes (N), planar ones with their moment (N m) third.
    fn force(&self, motion: Motion<'_>, loads: &[[f64; 3]], out: &mut [f64]);

    /// Hands the non-zero derivatives of [`Mechanics::force`] to `each`: row, by what, which of it, value. They are the same
    /// ones at every motion.
    fn slopes(&self, motion: Motion<'_>, loads: &[[f64; 3]], each: &mut dyn FnMut(usize, Level, usize, f64));

    /// Hands the non-zero second derivatives of `λᵀ force` to `each`, both of a symmetric pair; the same ones at every motion.
    fn bends(
        &self,
        motion: Motion<'_>,
        loads: &[[f64; 3]],
        lambda: &[f64],
        each: &mut dyn FnMut((Level, usize), (Level, usize), f64),
    );

    /// Each body as a line over points in the ground frame (m), from the joints that hold it to those that it holds and the external forces
    /// on it; over its centre of mass where these are fewer than two.
    fn bones(&self, q: &[f64]) -> Vec<(&str, Vec<Vec<f64>>)>;
}

/// `name.axis` for each axis.
pub(super) fn named<'n>(name: &'n str, axes: &'n [&str]) -> impl Iterator<Item = String> + use<'n> {
    axes.iter().map(move |axis| format!("{name}.{axis}"))
}

/// `name.0`, `name.1` and so on.
pub(super) fn numbered(name: &str, count: usize) -> impl Iterator<Item = String> + use<'_> {
    (0..count).map(move |k| format!("{name}.{k}"))
}

/// The line of a bone; see [`Mechanics::bones`].
pub(super) fn through(
    first: impl Iterator<Item = Vec<f64>>,
    centre: Vec<f64>,
    last: impl Iterator<Item = Vec<f64>>,
) -> Vec<Vec<f64>> {
    let (mut line, last): (Vec<_>, Vec<_>) = (first.collect(), last.collect());
    if line.len() + last.len() < 2 {
        line.push(centre);
    }
    line.extend(last);
    line
}
