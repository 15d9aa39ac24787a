//! A spatial model by its joint coordinates: where its bodies are in a pose, and how long its muscles are.
//!
//! Bodies form a tree from the ground; each joint has its coordinates (rad, m). Muscle paths go over fixed points, points that
//! move with a coordinate, and wrapping surfaces. Everything is a function of the joint coordinates q; moment arms are −∂L/∂q.

pub mod ellipsoid;
pub mod file;
pub mod frame;
pub mod path;
pub mod surface;

use crate::numerics::Scalar;
use frame::Frame;
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
    pub surfaces: Vec<Surface>,
    pub muscles: Vec<Muscle>,
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
}

/// A joint coordinate.
#[derive(Clone, Debug, PartialEq)]
pub struct Coordinate {
    pub name: String,
    /// rad if true, m if not
    pub is_angle: bool,
    pub default: f64,
}

/// A joint: frame in the parent, motion, frame in the child.
#[derive(Clone, Debug, PartialEq)]
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
#[derive(Clone, Debug, PartialEq)]
pub enum Motion {
    Weld,
    /// Translations along axes of the parent's frame, then rotations about axes that move with the ones before.
    Axes {
        translations: Vec<(usize, [f64; 3])>,
        rotations: Vec<(usize, [f64; 3])>,
    },
    /// A point of the child slides on an ellipsoid, its z-axis normal to it; then it turns about its y-axis.
    ///
    /// Coordinates: abduction, elevation, upward rotation, winging. Source: A. Seth et al., *PLoS ONE* 11(1), 2016, e0141028.
    Ellipsoid {
        radii: [f64; 3],
        coordinates: [usize; 4],
    },
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
    pub path: MusclePath,
}

impl Motion {
    /// The child's joint frame in the parent's.
    fn frame<T: Scalar>(&self, q: &[T]) -> Frame<T> {
        match self {
            Motion::Weld => Frame::identity(),
            Motion::Axes { translations, rotations } => {
                let mut frame = Frame::identity();
                for (coordinate, axis) in translations {
                    (0..3).for_each(|i| frame.origin[i] += q[*coordinate] * axis[i]);
                }
                rotations.iter().fold(frame, |frame, (coordinate, axis)| frame * Frame::rotation(*axis, q[*coordinate]))
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
        self.coordinates.iter().map(|coordinate| coordinate.default).collect()
    }

    pub fn coordinate(&self, name: &str) -> Option<usize> {
        self.coordinates.iter().position(|coordinate| coordinate.name == name)
    }
}
