//! A spatial model by its joint coordinates: where its bodies are in a pose, and how long its muscles are.
//!
//! Bodies form a tree from the ground; each joint has its coordinates (rad, m). Muscle paths go over fixed points, points that
//! move with a coordinate, and wrapping surfaces. Everything is a function of the joint coordinates q; moment arms are −∂L/∂q.

mod check;
pub mod ellipsoid;
pub mod file;
pub mod frame;
pub mod function;
mod half_ellipsoid;
pub mod path;
pub mod surface;
pub mod text;
mod torus;
pub mod wrapping;

use nalgebra::{DMatrix, DVector};
use num_dual::Dual64;

use crate::model::curves::ForceVelocity;
use crate::numerics::Scalar;
use frame::Frame;
use function::Function;
use path::MusclePath;
use surface::Surface;

/// A checked spatial model.
#[derive(Clone, Debug)]
pub struct Skeleton {
    pub name: String,
    pub bodies: Vec<Body>,
    /// In an order in which each parent comes before its child.
    pub joints: Vec<Joint>,
    pub coordinates: Vec<Coordinate>,
    /// Points of two bodies held together, beside the joints.
    pub held_points: Vec<HeldPoint>,
    pub surfaces: Vec<Surface>,
    pub muscles: Vec<Muscle>,
    pub forces: Vec<Force>,
    /// Gravitational acceleration, m/s².
    pub gravity: [f64; 3],
    /// What an abduction added to the motion turns.
    pub abduction: Option<Abduction>,
}

/// How a body moves in a study.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// By forces.
    Free,
    /// As the motion file says.
    Given,
    /// By the study's variant of the girdle.
    Girdle,
}

/// Variants of the shoulder girdle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Girdle {
    /// Stays as it is at the start of the motion.
    Fixed,
    /// Moves as the motion file says.
    Prescribed,
    /// Moves by forces.
    Equilibrium,
}

/// A point of each of two bodies (in their frames, m) that are one.
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
    /// Constant, N; from the motion file if `None`.
    pub force: Option<[f64; 3]>,
    pub scale: f64,
}

/// A rotation of a body, and all that hangs on it, about its joint and an axis of another body.
#[derive(Clone, Debug, PartialEq)]
pub struct Abduction {
    pub body: usize,
    pub against: usize,
    /// In the axes of `against`.
    pub axis: [f64; 3],
    /// Long axis of the body, in its own axes; its angle about `axis` is that which is reported.
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
    /// rad if true, m if not
    pub is_angle: bool,
    pub default: f64,
    /// Stays at its default in a study.
    pub locked: bool,
    /// What it is meant for.
    pub range: Option<[f64; 2]>,
    /// It is a function of another coordinate, which follows none.
    pub follows: Option<(usize, Function)>,
}

/// A joint: frame in the parent, motion, frame in the child.
#[derive(Clone, Debug)]
pub struct Joint {
    pub name: String,
    /// Index of the body; `None` for the ground.
    pub parent: Option<usize>,
    pub child: usize,
    pub in_parent: Frame<f64>,
    pub in_child: Frame<f64>,
    pub motion: Motion,
}

/// What a joint lets its child do. Coordinates by index.
#[derive(Clone, Debug)]
pub enum Motion {
    Weld,
    /// Translations along axes of the parent's frame, then rotations about axes that move with the ones before.
    Axes {
        translations: Vec<Axis>,
        rotations: Vec<Axis>,
    },
    /// A point of the child slides on an ellipsoid, its z-axis normal to it; then it turns about its y-axis.
    ///
    /// Coordinates: abduction, elevation, upward rotation, winging. Source: A. Seth et al., *PLoS ONE* 11(1), 2016, e0141028.
    Ellipsoid {
        radii: [f64; 3],
        coordinates: [usize; 4],
    },
}

/// An axis of a joint: along or about `direction` by a function of a coordinate.
#[derive(Clone, Debug)]
pub struct Axis {
    pub coordinate: usize,
    pub direction: [f64; 3],
    pub by: Function,
}

/// A muscle's path and its parameters.
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
    /// s
    pub activation_time: f64,
    /// s
    pub deactivation_time: f64,
    /// Optimal fibre lengths a second.
    pub max_shortening_velocity: f64,
    /// The tendon does not stretch.
    pub rigid_tendon: bool,
    pub force_velocity: ForceVelocity,
    pub path: MusclePath,
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

    /// The child's joint frame in the parent's.
    pub fn frame<T: Scalar>(&self, q: &[T]) -> Frame<T> {
        match self {
            Motion::Weld => Frame::identity(),
            Motion::Axes { translations, rotations } => {
                let mut frame = Frame::identity();
                for Axis { coordinate, direction, by } in translations {
                    let distance = by.at(q[*coordinate]);
                    (0..3).for_each(|i| frame.origin[i] += distance * direction[i]);
                }
                let turned =
                    |frame, axis: &Axis| frame * Frame::rotation(axis.direction, axis.by.at(q[axis.coordinate]));
                rotations.iter().fold(frame, turned)
            }
            Motion::Ellipsoid { radii, coordinates } => {
                let [abduction, elevation, upward, winging] = coordinates.map(|c| q[c]);
                let (x, y, z) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
                // The ellipsoid's frame is turned by a quarter about z, so that abduction and elevation count positive.
                let quarter = Frame::rotation(z, T::from(std::f64::consts::FRAC_PI_2));
                let mut on = Frame::rotation(x, abduction) * Frame::rotation(y, elevation) * Frame::rotation(z, upward);
                let turned = [radii[1], radii[0], radii[2]];
                (0..3).for_each(|i| on.origin[i] = on.axes[i][2] * turned[i]);
                quarter * on * quarter.inverse() * Frame::rotation(y, winging)
            }
        }
    }
}

/// Steps of the search for coordinates, and what counts as none.
const STEPS: usize = 30;
const NO_STEP: f64 = 1e-13;
/// A frame this near (m, and as a rotation's entries) is the one.
const SAME: f64 = 1e-5;

impl Motion {
    /// The coordinates (by index) at which the child's joint frame in the parent's is nearest to `wanted`: least squares over its entries,
    /// by Gauss–Newton from `near` (all coordinates), from elsewhere if that leads nowhere.
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
        for (miss, q) in found {
            if miss < best.0 {
                best = (miss, q);
            }
            if best.0 < SAME {
                break;
            }
        }
        coordinates.into_iter().map(|c| (c, best.1[c])).collect()
    }

    /// One search: how far off it ends, and where.
    fn nearest(&self, coordinates: &[usize], wanted: &Frame<f64>, mut q: Vec<f64>) -> (f64, Vec<f64>) {
        let entries = |frame: &Frame<Dual64>, part: fn(&Dual64) -> f64| {
            let all = frame.axes.iter().flatten().chain(&frame.origin);
            DVector::from_iterator(12, all.map(part))
        };
        let target = DVector::from_iterator(12, wanted.axes.iter().flatten().chain(&wanted.origin).copied());
        let n = coordinates.len();
        let mut miss = f64::INFINITY;
        for _ in 0..STEPS {
            let mut slopes = DMatrix::zeros(12, n);
            let mut gap = DVector::zeros(12);
            for (k, &c) in coordinates.iter().enumerate() {
                let seeded: Vec<Dual64> =
                    q.iter().enumerate().map(|(i, &x)| Dual64::new(x, f64::from(i == c))).collect();
                let frame = self.frame(&seeded);
                slopes.set_column(k, &entries(&frame, |x| x.eps));
                gap = &target - entries(&frame, |x| x.re);
            }
            miss = gap.amax();
            let Ok(step) = slopes.svd(true, true).solve(&gap, 1e-9) else { break };
            coordinates.iter().zip(step.iter()).for_each(|(&c, step)| q[c] += step);
            if step.amax().is_nan() || step.amax() <= NO_STEP {
                break;
            }
        }
        (miss, q)
    }
}

impl Skeleton {
    /// Where each body is: its frame in the ground's.
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

    /// Gives coordinates that follow others their values.
    pub fn follow<T: Scalar>(&self, q: &mut [T]) {
        for (k, coordinate) in self.coordinates.iter().enumerate() {
            if let Some((leader, by)) = &coordinate.follows {
                q[k] = by.at(q[*leader]);
            }
        }
    }

    /// Whether a joint holds still in a study: a weld, or one of locked coordinates only.
    pub fn is_locked(&self, joint: &Joint) -> bool {
        joint.motion.coordinates().iter().all(|&c| self.coordinates[c].locked)
    }

    /// The joint that has a coordinate as the second of three rotations, the first two about axes at right angles.
    pub fn elevation_joint(&self, coordinate: usize) -> Option<&Joint> {
        self.joints.iter().find(|joint| match &joint.motion {
            Motion::Axes { rotations, .. } => {
                rotations.len() == 3
                    && rotations[1].coordinate == coordinate
                    && rotations[1].by.is_identity()
                    && frame::dot(&frame::unit(&rotations[0].direction), &frame::unit(&rotations[1].direction)).abs()
                        < 1e-6
            }
            _ => false,
        })
    }

    pub fn coordinate(&self, name: &str) -> Option<usize> {
        self.coordinates.iter().position(|coordinate| coordinate.name == name)
    }
}
