//! Spatial models in joint coordinates: body frames and musculotendon lengths in a pose.
//!
//! Bodies form a tree rooted at the ground; each joint has its own coordinates (rad, m). Muscle paths pass through
//! fixed points and points that move with a coordinate, and around wrapping surfaces. All quantities are functions of
//! the joint coordinates q; moment arms are −∂L/∂q.

pub mod ball;
pub mod ellipsoid;
pub mod file;
pub mod frame;
pub mod function;
mod half_ellipsoid;
pub mod passive;
pub mod path;
pub mod polynomial;
mod shape;
pub mod surface;
pub mod text;
mod torus;
pub mod wrapping;

use nalgebra::{DMatrix, DVector};
use num_dual::Dual64;

use crate::curves::MuscleCurves;
use crate::entries::{Actuator, Fibre};
use crate::numerics::Scalar;
use frame::Frame;
use function::Function;
use passive::Passive;
use path::MusclePath;
use polynomial::Polynomial;
use surface::Surface;

/// A checked spatial model.
#[derive(Clone, Debug)]
pub struct Skeleton {
    pub name: String,
    pub bodies: Vec<Body>,
    /// Sorted so that each parent comes before its child.
    pub joints: Vec<Joint>,
    pub coordinates: Vec<Coordinate>,
    /// Point constraints in addition to the joints.
    pub held_points: Vec<HeldPoint>,
    pub surfaces: Vec<Surface>,
    pub muscles: Vec<Muscle>,
    pub forces: Vec<Force>,
    pub actuators: Vec<Actuator>,
    /// Lower bound of activations, unless a study sets it.
    pub min_activation: f64,
    pub passive: Vec<Passive>,
    /// Gravitational acceleration, m/s².
    pub gravity: [f64; 3],
    /// Rotations that a study may add to the motion.
    pub turns: Vec<Turn>,
}

/// What determines the motion of a body in a study.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// forces
    Free,
    /// the motion file
    #[serde(alias = "girdle")]
    Given,
    /// nothing: its joint keeps its pose at the start of the motion, and bodies on it keep their orientation in space
    Fixed,
}

/// A point constraint: two points, one in each body's frame (m), that coincide.
#[derive(Clone, Debug, PartialEq)]
pub struct HeldPoint {
    pub name: String,
    pub bodies: [usize; 2],
    pub points: [[f64; 3]; 2],
}

/// An external force on a point of a body, in the ground's axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Force {
    pub name: String,
    pub body: usize,
    /// In the body's frame, m.
    pub point: [f64; 3],
    /// Constant force, N; taken from the motion file if `None`.
    pub force: Option<[f64; 3]>,
    /// Factor on the force.
    pub scale: f64,
}

/// A rotation of a body, and of everything attached to it, around the body's joint about an axis of another body.
#[derive(Clone, Debug, PartialEq)]
pub struct Turn {
    pub name: String,
    pub body: usize,
    /// The body that carries the axis.
    pub against: usize,
    /// In the axes of `against`.
    pub axis: [f64; 3],
    /// Long axis of the body, in its own axes. Its angle about `axis` is reported.
    pub long_axis: [f64; 3],
}

/// A rigid body.
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
    pub name: String,
    /// kg
    pub mass: f64,
    /// In the body's frame, m.
    pub centre_of_mass: [f64; 3],
    /// About the centre of mass: xx, yy, zz, xy, xz, yz, kg m².
    pub inertia: [f64; 6],
    pub role: Role,
}

/// A joint coordinate.
#[derive(Clone, Debug)]
pub struct Coordinate {
    pub name: String,
    /// True for an angle (rad), false for a displacement (m).
    pub is_angle: bool,
    pub default: f64,
    /// Fixed at its default in a study.
    pub locked: bool,
    /// Intended range (rad, m).
    pub range: Option<[f64; 2]>,
    /// The independent coordinate that determines this one, and the function.
    pub follows: Option<(usize, Function)>,
}

/// A joint: its frame in the parent, its motion, its frame in the child.
#[derive(Clone, Debug)]
pub struct Joint {
    pub name: String,
    /// Index of the body; `None` for the ground.
    pub parent: Option<usize>,
    pub child: usize,
    pub in_parent: Frame<f64>,
    pub in_child: Frame<f64>,
    pub motion: Motion,
    /// Whether a study has other angles as unknowns than its coordinates, see [`ball`].
    pub ball: bool,
}

/// The motion that a joint allows its child. Coordinates are indices.
#[derive(Clone, Debug)]
pub enum Motion {
    Weld,
    /// Translations along axes of the parent's joint frame, then rotations. Each rotation turns the axes after it.
    Axes {
        translations: Vec<Axis>,
        rotations: Vec<Axis>,
    },
    /// A point of the child slides on an ellipsoid, the child's z-axis normal to the surface; then the child turns
    /// about its y-axis.
    ///
    /// Coordinates: abduction, elevation, upward rotation, winging.
    /// Source: A. Seth et al., *PLoS ONE* 11(1), 2016, e0141028.
    Ellipsoid {
        /// m
        radii: [f64; 3],
        coordinates: [usize; 4],
    },
}

/// An axis of a joint: translation along or rotation about `direction` by a function (m or rad) of a coordinate.
#[derive(Clone, Debug)]
pub struct Axis {
    pub coordinate: usize,
    pub direction: [f64; 3],
    pub by: Function,
}

/// A musculotendon: its parameters and its path.
#[derive(Clone, Debug)]
pub struct Muscle {
    pub name: String,
    /// N
    pub max_isometric_force: f64,
    /// m
    pub optimal_fibre_length: f64,
    /// m
    pub tendon_slack_length: f64,
    /// rad
    pub pennation_angle: f64,
    pub fibre: Fibre,
    pub curves: MuscleCurves,
    /// Optimal fibre lengths per second.
    pub max_shortening_velocity: f64,
    /// True if the tendon does not stretch.
    pub rigid_tendon: bool,
    /// May have no points where the length is a polynomial.
    pub path: MusclePath,
    /// The musculotendon length as a polynomial of coordinates; along the path if `None`.
    pub length: Option<Polynomial>,
}

impl Muscle {
    /// Whether it is known where it pulls at bodies, and not only its length.
    pub fn has_path(&self) -> bool {
        self.path.points.len() > 1
    }
}

impl Coordinate {
    /// Whether a study or a motion may move it: it is neither locked nor follows another one.
    pub fn is_independent(&self) -> bool {
        !self.locked && self.follows.is_none()
    }
}

impl Motion {
    /// Indices of the coordinates.
    pub fn coordinates(&self) -> Vec<usize> {
        match self {
            Motion::Weld => Vec::new(),
            Motion::Axes { translations, rotations } => {
                translations.iter().chain(rotations).map(|axis| axis.coordinate).collect()
            }
            Motion::Ellipsoid { coordinates, .. } => coordinates.to_vec(),
        }
    }

    /// The child's joint frame relative to the parent's joint frame, at coordinates `q`.
    pub fn frame<T: Scalar>(&self, q: &[T]) -> Frame<T> {
        match self {
            Motion::Weld => Frame::identity(),
            Motion::Axes { translations, rotations } => {
                let mut frame = Frame::identity();
                for Axis { coordinate, direction, by } in translations {
                    let distance = by.at(q[*coordinate]);
                    (0..3).for_each(|i| frame.origin[i] += distance * direction[i]);
                }
                let rotate =
                    |frame, axis: &Axis| frame * Frame::rotation(axis.direction, axis.by.at(q[axis.coordinate]));
                rotations.iter().fold(frame, rotate)
            }
            Motion::Ellipsoid { radii, coordinates } => {
                let [abduction, elevation, upward, winging] = coordinates.map(|c| q[c]);
                let (x, y, z) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
                // The ellipsoid's frame is rotated by 90° about z, so that abduction and elevation are positive.
                let quarter_turn = Frame::rotation(z, T::from(std::f64::consts::FRAC_PI_2));
                let mut sliding =
                    Frame::rotation(x, abduction) * Frame::rotation(y, elevation) * Frame::rotation(z, upward);
                let rotated_radii = [radii[1], radii[0], radii[2]];
                (0..3).for_each(|i| sliding.origin[i] = sliding.axes[i][2] * rotated_radii[i]);
                quarter_turn * sliding * quarter_turn.inverse() * Frame::rotation(y, winging)
            }
        }
    }
}

/// Maximum number of Gauss–Newton steps in one search of [`Motion::coordinates_of`].
const MAX_STEPS: usize = 30;
/// The search ends when no coordinate changes by more than this, rad or m.
const STEP_TOLERANCE: f64 = 1e-13;
/// A frame matches if no entry (of the rotation matrix, or of the origin in m) is off by this much.
const FRAME_TOLERANCE: f64 = 1e-5;

impl Motion {
    /// Inverts [`Motion::frame`]: the coordinates (index and value) at which the frame is nearest to `wanted`.
    ///
    /// Minimises the squared differences of the frame's entries by Gauss–Newton. The search starts at `near` (values of
    /// all coordinates of the model). Until one search reaches `wanted`, it is repeated from starts that are shifted by
    /// ±2 rad or m in the first three coordinates.
    pub fn coordinates_of(&self, wanted: &Frame<f64>, near: &[f64]) -> Vec<(usize, f64)> {
        let coordinates = self.coordinates();
        if coordinates.is_empty() {
            return Vec::new();
        }
        let starts = (0..3usize.pow(coordinates.len().min(3) as u32)).map(|start| {
            let mut q = near.to_vec();
            for (k, &c) in coordinates.iter().take(3).enumerate() {
                q[c] += [0.0, 2.0, -2.0][start / 3usize.pow(k as u32) % 3];
            }
            q
        });
        let found = starts.map(|q| self.nearest(&coordinates, wanted, q));
        let mut best = (f64::INFINITY, near.to_vec());
        for (error, q) in found {
            if error < best.0 {
                best = (error, q);
            }
            if best.0 < FRAME_TOLERANCE {
                break;
            }
        }
        coordinates.into_iter().map(|c| (c, best.1[c])).collect()
    }

    /// One search from `q`. Returns the largest error of an entry (before the last step) and the coordinates.
    fn nearest(&self, coordinates: &[usize], wanted: &Frame<f64>, mut q: Vec<f64>) -> (f64, Vec<f64>) {
        let entries = |frame: &Frame<Dual64>, part: fn(&Dual64) -> f64| {
            let all = frame.axes.iter().flatten().chain(&frame.origin);
            DVector::from_iterator(12, all.map(part))
        };
        let target = DVector::from_iterator(12, wanted.axes.iter().flatten().chain(&wanted.origin).copied());
        let n = coordinates.len();
        let mut error = f64::INFINITY;
        for _ in 0..MAX_STEPS {
            let mut jacobian = DMatrix::zeros(12, n);
            let mut residual = DVector::zeros(12);
            for (k, &c) in coordinates.iter().enumerate() {
                let seeded: Vec<Dual64> =
                    q.iter().enumerate().map(|(i, &x)| Dual64::new(x, f64::from(i == c))).collect();
                let frame = self.frame(&seeded);
                jacobian.set_column(k, &entries(&frame, |x| x.eps));
                residual = &target - entries(&frame, |x| x.re);
            }
            error = residual.amax();
            let Ok(step) = jacobian.svd(true, true).solve(&residual, 1e-9) else { break };
            coordinates.iter().zip(step.iter()).for_each(|(&c, step)| q[c] += step);
            if step.amax().is_nan() || step.amax() <= STEP_TOLERANCE {
                break;
            }
        }
        (error, q)
    }
}

impl Skeleton {
    /// Frame of each body in the ground's frame, in the pose `q`.
    pub fn frames<T: Scalar>(&self, q: &[T]) -> Vec<Frame<T>> {
        let mut frames = vec![Frame::identity(); self.bodies.len()];
        for joint in &self.joints {
            let parent = joint.parent.map_or_else(Frame::identity, |parent| frames[parent]);
            frames[joint.child] =
                parent * joint.in_parent.lift() * joint.motion.frame(q) * joint.in_child.inverse().lift();
        }
        frames
    }

    /// Default values of all coordinates.
    pub fn default_pose(&self) -> Vec<f64> {
        let mut q: Vec<f64> = self.coordinates.iter().map(|coordinate| coordinate.default).collect();
        self.follow(&mut q);
        q
    }

    /// Sets each coordinate that follows another one to its function of that coordinate.
    pub fn follow<T: Scalar>(&self, q: &mut [T]) {
        for (k, coordinate) in self.coordinates.iter().enumerate() {
            if let Some((leader, by)) = &coordinate.follows {
                q[k] = by.at(q[*leader]);
            }
        }
    }

    /// True if a joint cannot move in a study: it is a weld, or all its coordinates are locked.
    pub fn is_locked(&self, joint: &Joint) -> bool {
        joint.motion.coordinates().iter().all(|&c| self.coordinates[c].locked)
    }

    /// Index of the coordinate with this name.
    pub fn coordinate(&self, name: &str) -> Option<usize> {
        self.coordinates.iter().position(|coordinate| coordinate.name == name)
    }
}
