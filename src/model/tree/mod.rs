//! A spatial mechanism in joint coordinates θ: a tree of links, each with one degree of freedom.
//!
//! A joint with several axes is a chain of links, of which only the last carries a body. Link k moves by s_k, a function
//! of the coordinates (see `drive`): a spline, a coordinate that follows another one, or a part of the motion on an
//! ellipsoid. `dynamics` knows the links only.

mod drive;
pub mod dynamics;
pub mod pose;
pub mod screw;

use std::f64::consts::FRAC_PI_2;

use nalgebra::Vector3;

use crate::numerics::Scalar;
use crate::skeleton::ball::Ball;
use crate::skeleton::frame::{Frame, Vector, unit};
use crate::skeleton::{Axis, Motion, Skeleton};
pub use drive::{Drive, Part};
use screw::{MassProperties, Screw, screw};

/// A tree of links.
#[derive(Clone, Debug)]
pub struct Tree {
    /// Sorted so that each parent comes before its child.
    pub links: Vec<Link>,
    /// Of each body of the skeleton: the link that carries it (`None`: the ground), and its frame on that.
    pub places: Vec<(Option<usize>, Frame<f64>)>,
    /// Number of joint coordinates, those that are locked or follow others included.
    pub coordinates: usize,
    /// Gravitational acceleration, m/s².
    pub gravity: Vector,
}

/// One degree of freedom and what it carries.
#[derive(Clone, Debug)]
pub struct Link {
    pub parent: Option<usize>,
    /// Where it is in its parent at s = 0.
    before: Frame<f64>,
    axis: LinkAxis,
    pub drive: Drive,
    /// In the link's own frame.
    mass: MassProperties,
}

/// A direction in the link's axes.
#[derive(Clone, Copy, Debug)]
enum LinkAxis {
    /// Unit vector.
    Turns(Vector),
    /// m per unit of s.
    Slides(Vector),
}

impl LinkAxis {
    fn frame<T: Scalar>(&self, s: T) -> Frame<T> {
        match self {
            Self::Turns(axis) => Frame::rotation(*axis, s),
            Self::Slides(direction) => Frame { origin: direction.map(|x| s * x), ..Frame::identity() },
        }
    }

    /// The twist of a unit speed, `frame` being the link's.
    fn twist(&self, frame: &Frame<f64>) -> Screw {
        let in_ground = |x: &Vector| Vector3::from_fn(|i, _| (0..3).map(|j| frame.axes[i][j] * x[j]).sum());
        match self {
            Self::Turns(axis) => {
                let omega = in_ground(axis);
                screw(omega, Vector3::from(frame.origin).cross(&omega))
            }
            Self::Slides(direction) => screw(Vector3::zeros(), in_ground(direction)),
        }
    }
}

impl Tree {
    /// The links of a skeleton without [`Tree::unsupported`] coordinates.
    pub fn new(skeleton: &Skeleton) -> Self {
        Self::with_balls(skeleton, &[])
    }

    /// The same with the angles of ball joints as coordinates, three each, after those of the skeleton.
    pub fn with_balls(skeleton: &Skeleton, balls: &[Ball]) -> Self {
        let ground = (None, Frame::identity());
        let mut tree = Self {
            links: Vec::new(),
            places: vec![ground; skeleton.bodies.len()],
            coordinates: skeleton.coordinates.len() + 3 * balls.len(),
            gravity: skeleton.gravity,
        };
        for (number, joint) in skeleton.joints.iter().enumerate() {
            let (mut link, frame) = joint.parent.map_or(ground, |parent| tree.places[parent]);
            let mut before = frame * joint.in_parent;
            let mut motion = motion(skeleton, &joint.motion);
            if let Some(k) = balls.iter().position(|ball| ball.joint == number) {
                motion.truncate(motion.len() - 3);
                let turns = balls[k].axes.into_iter().enumerate();
                motion.extend(turns.map(|(i, axis)| {
                    let coordinate = skeleton.coordinates.len() + 3 * k + i;
                    (Frame::identity(), LinkAxis::Turns(axis), Drive::alone(coordinate))
                }));
            }
            for (turn, axis, drive) in motion {
                link = Some(tree.add(link, before * turn, axis, drive));
                before = Frame::identity();
            }
            tree.places[joint.child] = (link, before * joint.in_child.inverse());
        }
        for (body, (link, frame)) in skeleton.bodies.iter().zip(&tree.places) {
            if let Some(link) = *link {
                let mass = MassProperties::of_body(body.mass, body.centre_of_mass, body.inertia);
                tree.links[link].mass.add(&mass.within(frame));
            }
        }
        tree
    }

    /// Links with mass, and their centres of mass in their own frames (m).
    pub fn centres_of_mass(&self) -> impl Iterator<Item = (usize, Vector)> {
        let with_mass = self.links.iter().enumerate().filter(|(_, link)| link.mass.mass > 0.0);
        with_mass.map(|(k, link)| (k, (link.mass.moment / link.mass.mass).into()))
    }

    /// A coordinate of a joint on an ellipsoid that follows another one, which is not supported.
    pub fn unsupported(skeleton: &Skeleton) -> Option<&str> {
        let on_ellipsoids = skeleton.joints.iter().filter(|joint| matches!(joint.motion, Motion::Ellipsoid { .. }));
        let mut coordinates = on_ellipsoids.flat_map(|j| j.motion.coordinates()).map(|c| &skeleton.coordinates[c]);
        coordinates.find(|coordinate| coordinate.follows.is_some()).map(|coordinate| coordinate.name.as_str())
    }

    fn add(&mut self, parent: Option<usize>, before: Frame<f64>, axis: LinkAxis, drive: Drive) -> usize {
        self.links.push(Link { parent, before, axis, drive, mass: MassProperties::default() });
        self.links.len() - 1
    }
}

/// The links of a joint: a fixed frame before the link, its axis, and what moves it.
fn motion(skeleton: &Skeleton, motion: &Motion) -> Vec<(Frame<f64>, LinkAxis, Drive)> {
    match motion {
        Motion::Weld => Vec::new(),
        Motion::Axes { translations, rotations } => {
            let link = |axis: &Axis, kind: fn(Vector) -> LinkAxis, direction: Vector| {
                (Frame::identity(), kind(direction), Drive::by(skeleton, axis.coordinate, &axis.by))
            };
            let slides = translations.iter().map(|axis| link(axis, LinkAxis::Slides, axis.direction));
            slides.chain(rotations.iter().map(|axis| link(axis, LinkAxis::Turns, unit(&axis.direction)))).collect()
        }
        Motion::Ellipsoid { radii, coordinates } => ellipsoid(*radii, *coordinates),
    }
}

/// On an ellipsoid, as in [`Motion::frame`]: with abduction a and elevation e the origin moves by r_y sin e,
/// −r_x sin a cos e and r_z cos a cos e. By the addition theorems the products are sums of sines of e + a and e − a.
fn ellipsoid(radii: Vector, [abduction, elevation, upward, winging]: [usize; 4]) -> Vec<(Frame<f64>, LinkAxis, Drive)> {
    let [x, y, z] = [0, 1, 2].map(|i| [0, 1, 2].map(|j| f64::from(i == j)));
    let quarter_turn = Frame::rotation(z, FRAC_PI_2);
    let sine = |of_abduction: f64, amplitude: f64, phase: f64| Drive {
        terms: vec![(elevation, 1.0), (abduction, of_abduction)],
        functions: vec![Part::Sine { amplitude, phase }],
    };
    let alone = Drive { functions: vec![Part::Sine { amplitude: radii[1], phase: 0.0 }], ..Drive::alone(elevation) };
    let half = [0.5 * radii[0], 0.5 * radii[2]];
    let slides = [
        (x, alone),
        (y, sine(1.0, -half[0], 0.0)),
        (y, sine(-1.0, half[0], 0.0)),
        (z, sine(1.0, half[1], FRAC_PI_2)),
        (z, sine(-1.0, half[1], FRAC_PI_2)),
    ];
    let turns = [(x, abduction), (y, elevation), (z, upward)];
    let mut links: Vec<(Frame<f64>, LinkAxis, Drive)> = Vec::new();
    links.extend(slides.map(|(axis, drive)| (Frame::identity(), LinkAxis::Slides(axis), drive)));
    links.extend(turns.map(|(axis, coordinate)| (Frame::identity(), LinkAxis::Turns(axis), Drive::alone(coordinate))));
    links[0].0 = quarter_turn;
    links.push((quarter_turn.inverse(), LinkAxis::Turns(y), Drive::alone(winging)));
    links
}
