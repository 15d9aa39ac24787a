//! The TOML file of a spatial model, and the checks that turn it into a [`Skeleton`].
//!
//! `data/models/upper_limb.toml` is an example. Units are SI, angles are in radians. A frame is given by its origin and
//! by body-fixed rotations about x, y and z.

use std::collections::BTreeSet;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::ball::Ball;
use super::frame::Frame;
use super::function::{Function, FunctionEntry};
use super::passive::{Passive, PassiveEntry};
use super::path::{Move, MusclePath, Obstacle, PathPoint};
use super::polynomial::LengthEntry;
use super::surface::{Shape, Side, Surface};
use super::{Axis, Body, Coordinate, Force, HeldPoint, Joint, Motion, Muscle, Role, Skeleton, Turn};
use crate::curves::{ForceVelocity, MillardParameters};
use crate::entries::{ActuatorEntry, CurvesEntry, FibreEntry, finite, is_default, named, positive, unique};
use crate::error::{Issue, Mistakes, Result, SourceFile, first, nearest};

pub(super) type Checked<T> = std::result::Result<T, Issue>;

/// Name of the ground: the root of the joint tree. Path points, surfaces, forces and held points may lie on it too.
pub const GROUND: &str = "ground";

/// A spatial model as written in its file.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SkeletonFile {
    /// Name of the model.
    pub name: String,
    /// Where the data come from, and their licence.
    pub source: Option<String>,
    /// Must be 3. Files of planar models do not have this key.
    pub dimensions: u8,
    /// Rigid bodies. The body `ground` is predefined.
    pub body: Vec<BodyEntry>,
    /// Joints. They form a tree rooted at the ground.
    pub joint: Vec<JointEntry>,
    /// Joint coordinates.
    pub coordinate: Vec<CoordinateEntry>,
    /// Surfaces that muscles wrap around.
    #[serde(default)]
    pub surface: Vec<SurfaceEntry>,
    /// Musculotendons.
    #[serde(default)]
    pub muscle: Vec<MuscleEntry>,
    /// Point constraints: points of two bodies that must coincide.
    #[serde(default)]
    pub held_point: Vec<HeldPointEntry>,
    /// External forces.
    #[serde(default)]
    pub force: Vec<ForceEntry>,
    /// Actuators that are no muscles. Those at coordinates that do not move by forces have no effect.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub actuator: Vec<ActuatorEntry>,
    /// Springs, dampers and soft limits at joint coordinates. Those at coordinates that do not move by forces have no effect.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub passive: Vec<PassiveEntry>,
    /// Rotations that a study may add to the motion as `motion.<name>_offset_deg`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub turn: Vec<TurnEntry>,
    /// Acceleration of gravity in the ground frame, m/s².
    #[serde(default = "earth")]
    pub gravity: [f64; 3],
    /// The muscles' curves.
    #[serde(default)]
    pub curves: CurvesEntry,
    /// Defaults for muscles that do not set these values.
    #[serde(default)]
    pub muscles: MusclesEntry,
}

fn earth() -> [f64; 3] {
    [0.0, -9.81, 0.0]
}

#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MusclesEntry {
    /// Activation time constant, s.
    pub activation_time: f64,
    /// Deactivation time constant, s.
    pub deactivation_time: f64,
    /// Largest shortening velocity, optimal fibre lengths per second.
    pub max_shortening_velocity: f64,
    /// Tendons with a slack length below this are rigid, m.
    pub rigid_tendon_below: f64,
    /// Lower bound of all activations, unless a study sets `min_activation`.
    #[serde(skip_serializing_if = "is_default")]
    pub min_activation: f64,
}

impl Default for MusclesEntry {
    /// Time constants and velocity from the thesis.
    fn default() -> Self {
        Self {
            activation_time: 0.12,
            deactivation_time: 0.12,
            max_shortening_velocity: 1.0,
            rigid_tendon_below: 0.0,
            min_activation: 0.0,
        }
    }
}

#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HeldPointEntry {
    /// Name of the constraint.
    pub name: String,
    /// The two bodies.
    pub bodies: [String; 2],
    /// One point in each body's frame, m.
    pub points: [[f64; 3]; 2],
}

/// An external force on a body.
///
/// Without `force`, the motion file supplies it over time in the columns `<name>_x_n`, `<name>_y_n` and `<name>_z_n`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ForceEntry {
    /// Name of the force.
    pub name: String,
    /// The body it acts on.
    pub body: String,
    /// Point of application in the body's frame, m.
    #[serde(default)]
    pub point: [f64; 3],
    /// The force in the axes of the ground, N. If absent, the motion file supplies it over time.
    pub force: Option<[f64; 3]>,
    /// Factor on the force.
    #[serde(default = "one")]
    pub scale: f64,
}

fn one() -> f64 {
    1.0
}

/// A rotation that a study may add to the motion.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TurnEntry {
    /// Name of the rotation; its angle is reported as a joint coordinate.
    pub name: String,
    /// The body that turns, with everything attached to it.
    pub body: String,
    /// The body that carries the axis.
    pub against: String,
    /// Axis of rotation, in the axes of `against`.
    pub axis: [f64; 3],
    /// Long axis of `body`, in its own axes. Its angle about `axis` is reported.
    pub long_axis: [f64; 3],
}

#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BodyEntry {
    /// Name of the body.
    pub name: String,
    /// Mass, kg.
    pub mass: f64,
    /// Centre of mass in the body's frame, m.
    pub centre_of_mass: [f64; 3],
    /// Moments and products of inertia xx, yy, zz, xy, xz, yz about the centre of mass, kg m².
    pub inertia: [f64; 6],
    /// What moves the body in a study.
    #[serde(default = "free")]
    pub role: Role,
}

fn free() -> Role {
    Role::Free
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum JointEntryKind {
    /// no motion
    Weld,
    /// translations and rotations along and about axes
    Axes,
    /// sliding on an ellipsoid, like the scapula on the thorax
    Ellipsoid,
}

#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct JointEntry {
    /// Name of the joint.
    pub name: String,
    /// What the joint allows.
    pub kind: JointEntryKind,
    /// `ground` or a body.
    pub parent: String,
    /// The body that moves relative to the parent.
    pub child: String,
    /// Origin of the joint frame in the parent's frame, m.
    #[serde(default)]
    pub parent_point: [f64; 3],
    /// Body-fixed rotations about x, y and z of the joint frame in the parent's, rad.
    #[serde(default)]
    pub parent_rotation: [f64; 3],
    /// Origin of the joint frame in the child's frame, m.
    #[serde(default)]
    pub child_point: [f64; 3],
    /// Body-fixed rotations about x, y and z of the joint frame in the child's, rad.
    #[serde(default)]
    pub child_rotation: [f64; 3],
    /// Of an `axes` joint: translations in the joint frame of the parent.
    #[serde(default)]
    pub translations: Vec<AxisEntry>,
    /// Of an `axes` joint: rotations. Each one also rotates the axes after it.
    #[serde(default)]
    pub rotations: Vec<AxisEntry>,
    /// Of an `axes` joint with three rotations: whether a study takes angles as unknowns that are regular where these
    /// coordinates are singular, as in a shoulder with a plane of elevation when the arm hangs. Motion files, results and
    /// changes of the motion keep the coordinates.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub ball: bool,
    /// Of an ellipsoid joint: radii along x, y and z, m.
    pub radii: Option<[f64; 3]>,
    /// Of an ellipsoid joint: the coordinates of abduction, elevation, upward rotation and winging.
    pub coordinates: Option<[String; 4]>,
}

#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AxisEntry {
    /// The coordinate that drives the axis.
    pub coordinate: String,
    /// Direction of the axis.
    pub axis: [f64; 3],
    /// Translation (m) or rotation (rad) as a function of the coordinate; the coordinate itself if absent.
    pub by: Option<FunctionEntry>,
}

#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CoordinateEntry {
    /// Name of the coordinate, as in motion files.
    pub name: String,
    /// Value if no other is given, rad or m.
    #[serde(default)]
    pub default: f64,
    /// Fixed at its default in a study.
    #[serde(default)]
    pub locked: bool,
    /// Intended range, rad or m. A motion outside it is not an error.
    pub range: Option<[f64; 2]>,
    /// The coordinate that determines this one, and the function (a coordinate coupler).
    pub follows: Option<FollowsEntry>,
}

#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FollowsEntry {
    /// The other coordinate.
    pub coordinate: String,
    /// The function of it.
    pub by: FunctionEntry,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum SurfaceKind {
    /// with `radius`
    Sphere,
    /// about z, with `radius` and `length`
    Cylinder,
    /// with `radii`
    Ellipsoid,
    /// about z, with `ring_radius` and `radius`
    Torus,
}

#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SurfaceEntry {
    /// Name of the surface.
    pub name: String,
    /// Its shape.
    pub kind: SurfaceKind,
    /// `ground` or a body.
    pub body: String,
    /// Its centre in the body's frame, m.
    #[serde(default)]
    pub point: [f64; 3],
    /// Body-fixed rotations about x, y and z of its frame in the body's, rad.
    #[serde(default)]
    pub rotation: [f64; 3],
    /// Of a sphere, a cylinder or the tube of a torus: its radius, m.
    pub radius: Option<f64>,
    /// Of an ellipsoid: radii along x, y and z, m.
    pub radii: Option<[f64; 3]>,
    /// Of a torus: radius of the centre line of its tube, m. It lies in the plane z = 0.
    pub ring_radius: Option<f64>,
    /// The half of the surface that paths must take: `x`, `-x`, `y`, `-y`, or (except for a cylinder) `z`, `-z`. Either
    /// half if absent.
    pub side: Option<String>,
    /// Of a cylinder: its length, m; infinite if absent. The length of a path jumps where the path slips off an end.
    pub length: Option<f64>,
}

#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PointEntry {
    /// `ground` or a body.
    pub body: String,
    /// The point in the body's frame, m.
    #[serde(default)]
    pub point: [f64; 3],
    /// Moves the point in proportion to a coordinate.
    pub moves: Option<MovesEntry>,
    /// A function of a coordinate that is added to the point's x, m.
    pub x: Option<FollowsEntry>,
    /// A function of a coordinate that is added to the point's y, m.
    pub y: Option<FollowsEntry>,
    /// A function of a coordinate that is added to the point's z, m.
    pub z: Option<FollowsEntry>,
    /// When the path passes through the point; always if absent.
    pub when: Option<WhenEntry>,
}

/// True while a coordinate (rad, m) is in a range.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WhenEntry {
    /// The coordinate.
    pub coordinate: String,
    /// Its range, rad or m.
    pub range: [f64; 2],
}

/// Moves a point by `slope` (m/rad) times a coordinate.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MovesEntry {
    /// The coordinate.
    pub coordinate: String,
    /// Displacement per unit of the coordinate, m/rad.
    pub slope: [f64; 3],
}

#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MuscleEntry {
    /// Name of the muscle.
    pub name: String,
    /// Maximum isometric force of the fibres, N.
    pub max_isometric_force: f64,
    /// Optimal fibre length, m.
    pub optimal_fibre_length: f64,
    /// Tendon slack length, m.
    pub tendon_slack_length: f64,
    /// Pennation angle at the optimal fibre length, rad.
    #[serde(default)]
    pub pennation_angle: f64,
    /// Activation time constant, s; that of `[muscles]` if absent.
    pub activation_time: Option<f64>,
    /// Deactivation time constant, s; that of `[muscles]` if absent.
    pub deactivation_time: Option<f64>,
    /// Largest shortening velocity, optimal fibre lengths per second; that of `[muscles]` if absent.
    pub max_shortening_velocity: Option<f64>,
    /// How sharply activation dynamics switch between the time constants (`degroote_fregly_2016`); 0.1 if absent.
    pub activation_steepness: Option<f64>,
    /// Force of a passive damper beside the fibre at the maximum shortening velocity, maximum isometric forces; 0 if absent.
    pub damping: Option<f64>,
    /// Factor on the weight of its effort in the objective, not of min/max; 1 if absent.
    pub effort_weight: Option<f64>,
    /// Width of the active force–length curve relative to the published one (`degroote_fregly_2016`); 1 if absent.
    pub active_width: Option<f64>,
    /// Strain of the fibre at a passive force of 1 (`degroote_fregly_2016`); 0.6 if absent.
    pub passive_strain: Option<f64>,
    /// Strain of the tendon at a force of 1 (`degroote_fregly_2016`); 0.049 if absent.
    pub tendon_strain: Option<f64>,
    /// Shape of the curves (`millard_2012`).
    pub millard: Option<MillardParameters>,
    /// Whether the tendon is rigid; determined by `rigid_tendon_below` if absent.
    pub rigid_tendon: Option<bool>,
    /// Origin, via points, insertion: at least two points; none are needed with `length`.
    #[serde(default)]
    pub path: Vec<PointEntry>,
    /// The length of the musculotendon as a polynomial of coordinates, fitted beforehand, in place of that along the path.
    /// Points of the path are then for drawings and for the loads that joints carry.
    pub length: Option<LengthEntry>,
    /// Surfaces that the path wraps around, in the order in which they are placed on it, as in OpenSim.
    #[serde(default)]
    pub surfaces: Vec<ObstacleEntry>,
}

/// A wrapping surface of a muscle: its name alone, or with the part (or first and last part) of the path that may wrap
/// it. Part k lies between path points k and k + 1.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum ObstacleEntry {
    /// the name alone
    Any(String),
    /// the name, and the one part that may wrap it
    Part {
        /// Name of the surface.
        name: String,
        /// The part, from 0.
        part: usize,
    },
    /// the name, and the first and last part that may wrap it
    Parts {
        /// Name of the surface.
        name: String,
        /// First and last part, from 0.
        parts: [usize; 2],
    },
}

impl PointEntry {
    /// True if both points are fixed to the same body at the same location.
    pub fn repeats(&self, other: &Self) -> bool {
        let is_fixed =
            |p: &Self| p.when.is_none() && p.moves.is_none() && p.x.is_none() && p.y.is_none() && p.z.is_none();
        is_fixed(self) && is_fixed(other) && self.body == other.body && self.point == other.point
    }
}

impl ObstacleEntry {
    pub fn surface(&self) -> &str {
        match self {
            Self::Any(name) | Self::Part { name, .. } | Self::Parts { name, .. } => name,
        }
    }

    /// Renumbers the parts after path points that repeated their predecessor were removed. `removed`: the indices of
    /// these points, increasing. Returns false if no part is left.
    pub fn renumber(&mut self, removed: &[usize]) -> bool {
        let (first, last) = match self {
            Self::Any(_) => return true,
            Self::Part { part, .. } => (*part, *part),
            Self::Parts { parts: [first, last], .. } => (*first, *last),
        };
        let before = |part: usize| removed.iter().filter(|&&point| point <= part).count();
        // The part that ended in a removed point had zero length; the parts next to it remain.
        let vanished = removed.contains(&(last + 1));
        let (new_first, new_last) = (first - before(first), last - before(last));
        let Some(new_last) = new_last.checked_sub(usize::from(vanished)).filter(|last| *last >= new_first) else {
            return false;
        };
        match self {
            Self::Part { part, .. } => *part = new_first,
            Self::Parts { parts, .. } => *parts = [new_first, new_last],
            Self::Any(_) => {}
        }
        true
    }
}

impl SkeletonFile {
    /// The JSON Schema of a spatial model file.
    pub fn schema() -> serde_json::Value {
        schemars::schema_for!(Self).to_value()
    }

    /// True if the table is a spatial model.
    pub fn is_spatial(table: &toml::Table) -> bool {
        table.contains_key("dimensions")
    }

    /// Reads and checks a file.
    ///
    /// # Errors
    /// All mistakes, each with its location.
    pub fn load(file: &SourceFile) -> Result<Skeleton> {
        if file.text.lines().any(|line| line.trim() == "[abduction]") {
            let help = "write `[[turn]]` and `name = \"abduction\"` in its place";
            let message = format!("{}: the table `[abduction]` is now a `[[turn]]`", file.path.display());
            return Err(file.error(None, message, "", Some(help.to_owned())));
        }
        file.toml::<Self>()?.check_all().map_err(|issues| Issue::all_in_file(&issues, file))
    }

    /// [`SkeletonFile::check_all`].
    ///
    /// # Errors
    /// The first [`Issue`].
    pub fn check(&self) -> Checked<Skeleton> {
        self.check_all().map_err(first)
    }

    /// Checks what the types cannot express.
    ///
    /// # Errors
    /// All mistakes, each with the path of the offending value.
    pub fn check_all(&self) -> std::result::Result<Skeleton, Vec<Issue>> {
        let mut mistakes = Mistakes::default();
        if self.dimensions != 3 {
            let message = format!("found {}", self.dimensions);
            mistakes.push(Issue::new(
                &["dimensions"],
                message,
                "a spatial model has dimensions = 3; a planar model does not have this key",
            ));
        }
        mistakes.take(named(&["name"], &self.name));
        mistakes.take(unique("body", self.body.iter().map(|body| body.name.as_str())));
        let turns = self.turn.iter().map(|turn| turn.name.as_str());
        let coordinates = self.coordinate.iter().map(|coordinate| coordinate.name.as_str());
        mistakes.take(unique("coordinate", coordinates.chain(turns)));
        mistakes.take(unique("surface", self.surface.iter().map(|surface| surface.name.as_str())));
        mistakes.take(unique("joint", self.joint.iter().map(|joint| joint.name.as_str())));
        mistakes.take(unique("muscle", self.muscle.iter().map(|muscle| muscle.name.as_str())));
        mistakes.take(unique("held_point", self.held_point.iter().map(|held| held.name.as_str())));
        mistakes.take(unique("force", self.force.iter().map(|force| force.name.as_str())));
        mistakes.take(unique("actuator", self.actuator.iter().map(|actuator| actuator.name.as_str())));
        mistakes.take(unique("passive", self.passive.iter().map(|element| element.name.as_str())));
        mistakes.take(finite(&["gravity"], &self.gravity));
        if self.body.iter().any(|body| body.name == GROUND) {
            mistakes.push(Issue::new(
                &["body", GROUND],
                "the name `ground` is reserved",
                "give this body another name",
            ));
        }
        let mut bodies = mistakes.all(self.body.iter().map(BodyEntry::check));
        let names = self.names();
        if names.bodies.last() == Some(&GROUND) {
            bodies.push(Body::ground());
        }
        let mut joints = mistakes.all(self.joint.iter().map(|joint| joint.check(&names)));
        let curve = mistakes.take(self.curves.check()).unwrap_or_default();
        if !(0.0..=0.5).contains(&self.muscles.min_activation) {
            let found = format!("found {}", self.muscles.min_activation);
            let help = "it must be an activation from 0 to 0.5, such as 0.01";
            mistakes.push(Issue::new(&["muscles", "min_activation"], found, help));
        }
        let muscle = |muscle: &MuscleEntry| muscle.check(&names, (&self.muscles, &self.curves), curve);
        let muscles = mistakes.all(self.muscle.iter().map(muscle));
        let surfaces = mistakes.all(self.surface.iter().map(|surface| surface.check(&names)));
        let held_points = mistakes.all(self.held_point.iter().map(|held| held.check(&names)));
        let forces = mistakes.all(self.force.iter().map(|force| force.check(&names)));
        let coordinates = self.coordinate.iter().map(|coordinate| coordinate.name.as_str());
        let actuators = mistakes.all(self.actuator.iter().map(|actuator| actuator.check(coordinates.clone())));
        let passive = mistakes.all(self.passive.iter().map(|element| passive(element, &names.coordinates)));
        let turns = mistakes.all(self.turn.iter().map(|turn| turn.check(&names)));
        mistakes.none()?;

        if names.bodies.last() == Some(&GROUND) {
            joints.push(Joint::of_ground(names.bodies.len() - 1));
        }
        let one = |issue: Issue| vec![issue];
        sort(&mut joints, &names).map_err(one)?;
        let skeleton = Skeleton {
            name: self.name.clone(),
            bodies,
            coordinates: self.coordinates(&joints).map_err(one)?,
            min_activation: self.muscles.min_activation,
            joints,
            surfaces,
            held_points,
            forces,
            actuators,
            passive,
            turns,
            gravity: self.gravity,
            muscles,
        };
        Ok(skeleton)
    }

    /// Names that other entries refer to. The ground counts as a body if something is attached to it.
    fn names(&self) -> Names<'_> {
        let ground = self.uses_ground().then_some(GROUND);
        Names {
            bodies: self.body.iter().map(|body| body.name.as_str()).chain(ground).collect(),
            coordinates: self.coordinate.iter().map(|coordinate| coordinate.name.as_str()).collect(),
            surfaces: self.surface.iter().map(|surface| surface.name.as_str()).collect(),
        }
    }

    /// True if path points, surfaces, forces or held points are on the ground.
    fn uses_ground(&self) -> bool {
        let points = self.muscle.iter().flat_map(|muscle| &muscle.path).map(|point| &point.body);
        let others = self.surface.iter().map(|surface| &surface.body).chain(self.force.iter().map(|force| &force.body));
        points.chain(others).chain(self.held_point.iter().flat_map(|held| &held.bodies)).any(|body| body == GROUND)
    }

    /// Finds from the joints whether each coordinate is an angle, and checks that a joint uses it.
    fn coordinates(&self, joints: &[Joint]) -> Checked<Vec<Coordinate>> {
        let mut kinds: Vec<Option<bool>> = vec![None; self.coordinate.len()];
        for joint in joints {
            // (coordinate, is an angle, drives its axis directly)
            let used: Vec<(usize, bool, bool)> = match &joint.motion {
                Motion::Weld => Vec::new(),
                Motion::Axes { translations, rotations } => {
                    let moves = translations.iter().map(|axis| (axis.coordinate, false, axis.by.is_identity()));
                    // Rotations first: a coordinate that drives a rotation is an angle, whatever else it drives.
                    rotations.iter().map(|axis| (axis.coordinate, true, axis.by.is_identity())).chain(moves).collect()
                }
                Motion::Ellipsoid { coordinates, .. } => coordinates.iter().map(|c| (*c, true, true)).collect(),
            };
            for (coordinate, is_angle, itself) in used {
                if kinds[coordinate].is_some() && itself {
                    let name = &self.coordinate[coordinate].name;
                    let message = format!("`{name}` moves more than one axis");
                    let help = "give each axis its own coordinate, or drive the axis by a function (`by`)";
                    return Err(Issue::new(&["joint", &joint.name], message, help));
                }
                kinds[coordinate].get_or_insert(is_angle);
            }
        }
        let names: Vec<&str> = self.coordinate.iter().map(|coordinate| coordinate.name.as_str()).collect();
        let coordinate = |(entry, kind): (&CoordinateEntry, Option<bool>)| {
            let place = |key: &'static str| ["coordinate", entry.name.as_str(), key];
            let Some(is_angle) = kind else {
                let help = "remove it, or name it in a joint";
                return Err(Issue::new(&["coordinate", &entry.name], "no joint uses it", help));
            };
            if !entry.default.is_finite() {
                return Err(Issue::new(&place("default"), "not a finite number", "give a finite number (rad or m)"));
            }
            let follows = entry.follows.as_ref().map(|follows| {
                let leader = find("coordinate", &names, &follows.coordinate, &place("follows"))?;
                if self.coordinate[leader].follows.is_some() {
                    let message = format!("`{}` itself follows another coordinate", follows.coordinate);
                    let help = "name the independent coordinate, and give the function of that one";
                    return Err(Issue::new(&place("follows"), message, help));
                }
                Ok((leader, follows.by.check(&place("follows"))?))
            });
            Ok(Coordinate {
                name: entry.name.clone(),
                is_angle,
                default: entry.default,
                locked: entry.locked,
                range: entry.range,
                follows: follows.transpose()?,
            })
        };
        self.coordinate.iter().zip(kinds).map(coordinate).collect()
    }
}

/// Names that other entries refer to.
struct Names<'f> {
    bodies: Vec<&'f str>,
    coordinates: Vec<&'f str>,
    surfaces: Vec<&'f str>,
}

/// Index of `name` among `names`.
fn find(kind: &str, names: &[&str], name: &str, path: &[&str]) -> Checked<usize> {
    names.iter().position(|known| *known == name).ok_or_else(|| {
        let near = nearest(name, names.iter().copied()).map(|n| format!("did you mean `{n}`? ")).unwrap_or_default();
        Issue::new(path, format!("there is no {kind} `{name}`"), format!("{near}the model has: {}", names.join(", ")))
    })
}

/// A passive element with numbers that make sense, at a coordinate of the model.
fn passive(element: &PassiveEntry, coordinates: &[&str]) -> Checked<Passive> {
    let place = |key: &'static str| ["passive", element.name.as_str(), key];
    let coordinate = find("coordinate", coordinates, &element.coordinate, &place("coordinate"))?;
    let sizes = [
        ("stiffness", element.stiffness),
        ("damping", element.damping),
        ("lower_stiffness", element.lower_stiffness),
        ("upper_stiffness", element.upper_stiffness),
        ("limit_damping", element.limit_damping),
    ];
    for (key, value) in sizes {
        if !(value >= 0.0 && value.is_finite()) {
            return Err(Issue::new(&place(key), format!("found {value}"), "it must be a number of at least 0"));
        }
    }
    let limits = [
        ("lower_stiffness", element.lower_stiffness, element.lower.is_none()),
        ("upper_stiffness", element.upper_stiffness, element.upper.is_none()),
        ("limit_damping", element.limit_damping, element.lower.is_none() && element.upper.is_none()),
    ];
    if let Some((key, value, _)) = limits.into_iter().find(|(_, value, without)| *value > 0.0 && *without) {
        let help = "give the limit too (`lower` or `upper`), or remove it";
        return Err(Issue::new(&place(key), format!("found {value}, but no limit"), help));
    }
    positive(&place("transition"), element.transition, "rad or m")?;
    let limits: Vec<f64> = [element.lower, element.upper, Some(element.rest)].into_iter().flatten().collect();
    finite(&place("rest"), &limits)?;
    if let (Some(lower), Some(upper)) = (element.lower, element.upper)
        && lower > upper
    {
        return Err(Issue::new(
            &place("lower"),
            format!("found {lower}, above the upper limit {upper}"),
            "exchange them",
        ));
    }
    Ok(Passive { coordinate, entry: element.clone() })
}

impl BodyEntry {
    fn check(&self) -> Checked<Body> {
        finite(&["body", &self.name, "centre_of_mass"], &self.centre_of_mass)?;
        finite(&["body", &self.name, "inertia"], &self.inertia)?;
        // Massless bodies are allowed if each coordinate that moves by forces moves a mass:
        // `Skeleton::check_study` checks this.
        if self.mass == 0.0 && self.inertia == [0.0; 6] {
            return Ok(self.body());
        }
        positive(&["body", &self.name, "mass"], self.mass, "kg")?;
        if !self.is_physical() {
            let help = "xx, yy, zz, xy, xz, yz about the centre of mass must form a positive definite matrix (kg m²)";
            return Err(Issue::new(&["body", &self.name, "inertia"], format!("found {:?}", self.inertia), help));
        }
        Ok(self.body())
    }

    /// True if the inertia matrix is positive definite: all its leading minors are positive.
    pub fn is_physical(&self) -> bool {
        let [xx, yy, zz, xy, xz, yz] = self.inertia;
        let minors =
            [xx, xx * yy - xy * xy, xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)];
        minors.iter().all(|minor| *minor > 0.0)
    }

    fn body(&self) -> Body {
        Body {
            name: self.name.clone(),
            mass: self.mass,
            centre_of_mass: self.centre_of_mass,
            inertia: self.inertia,
            role: self.role,
        }
    }
}

impl Body {
    fn ground() -> Self {
        Self { name: GROUND.to_owned(), mass: 0.0, centre_of_mass: [0.0; 3], inertia: [0.0; 6], role: Role::Given }
    }
}

impl Joint {
    fn of_ground(child: usize) -> Self {
        let (in_parent, in_child) = (Frame::identity(), Frame::identity());
        Self { name: GROUND.to_owned(), parent: None, child, in_parent, in_child, motion: Motion::Weld, ball: false }
    }
}

impl HeldPointEntry {
    fn check(&self, names: &Names<'_>) -> Checked<HeldPoint> {
        finite(&["held_point", &self.name, "points"], self.points.as_flattened())?;
        let body = |k: usize| find("body", &names.bodies, &self.bodies[k], &["held_point", &self.name, "bodies"]);
        Ok(HeldPoint { name: self.name.clone(), bodies: [body(0)?, body(1)?], points: self.points })
    }
}

impl ForceEntry {
    fn check(&self, names: &Names<'_>) -> Checked<Force> {
        finite(&["force", &self.name, "point"], &self.point)?;
        finite(&["force", &self.name, "scale"], &[self.scale])?;
        self.force.iter().try_for_each(|force| finite(&["force", &self.name, "force"], force))?;
        let body = find("body", &names.bodies, &self.body, &["force", &self.name, "body"])?;
        Ok(Force { name: self.name.clone(), body, point: self.point, force: self.force, scale: self.scale })
    }
}

impl TurnEntry {
    fn check(&self, names: &Names<'_>) -> Checked<Turn> {
        let body = |name: &str, key: &str| find("body", &names.bodies, name, &["turn", &self.name, key]);
        for (key, axis) in [("axis", &self.axis), ("long_axis", &self.long_axis)] {
            let length = super::frame::norm(axis);
            if !(length.is_finite() && length > 1e-9) {
                let message = format!("the axis {axis:?} has no direction");
                return Err(Issue::new(&["turn", &self.name, key], message, "give a nonzero vector"));
            }
        }
        Ok(Turn {
            name: self.name.clone(),
            body: body(&self.body, "body")?,
            against: body(&self.against, "against")?,
            axis: super::frame::unit(&self.axis),
            long_axis: super::frame::unit(&self.long_axis),
        })
    }
}

impl JointEntry {
    fn check(&self, names: &Names<'_>) -> Checked<Joint> {
        let place = |key: &'static str| ["joint", self.name.as_str(), key];
        let parent = match self.parent.as_str() {
            GROUND => None,
            name => Some(find("body", &names.bodies, name, &place("parent"))?),
        };
        let axes = |entries: &[AxisEntry], key: &'static str| {
            let axis = |entry: &AxisEntry| {
                if super::frame::norm(&entry.axis).is_nan() || super::frame::norm(&entry.axis) < 1e-9 {
                    return Err(Issue::new(
                        &place(key),
                        format!("the axis {:?} has no direction", entry.axis),
                        "give a nonzero vector",
                    ));
                }
                let by = entry.by.as_ref().map_or(Ok(Function::identity()), |by| by.check(&place(key)))?;
                let coordinate = find("coordinate", &names.coordinates, &entry.coordinate, &place(key))?;
                Ok(Axis { coordinate, direction: entry.axis, by })
            };
            entries.iter().map(axis).collect::<Checked<Vec<_>>>()
        };
        let mismatch = |key: &'static str, help: &str| {
            Err(Issue::new(&place(key), "the keys do not match this kind of joint", help))
        };
        let motion = match self.kind {
            JointEntryKind::Axes if self.rotations.is_empty() && self.translations.is_empty() => {
                return mismatch("kind", "add rotations or translations, or use kind = \"weld\"");
            }
            JointEntryKind::Axes => Motion::Axes {
                translations: axes(&self.translations, "translations")?,
                rotations: axes(&self.rotations, "rotations")?,
            },
            JointEntryKind::Weld => Motion::Weld,
            JointEntryKind::Ellipsoid => {
                let (Some(radii), Some(coordinates)) = (self.radii, &self.coordinates) else {
                    let help = "an ellipsoid joint needs radii and four coordinates: abduction, elevation, upward \
                                rotation, winging";
                    return Err(Issue::new(&["joint", &self.name], "radii or coordinates are missing", help));
                };
                radii.iter().try_for_each(|radius| positive(&place("radii"), *radius, "m"))?;
                let mut found = [0; 4];
                for (index, name) in found.iter_mut().zip(coordinates) {
                    *index = find("coordinate", &names.coordinates, name, &place("coordinates"))?;
                }
                Motion::Ellipsoid { radii, coordinates: found }
            }
        };
        if self.kind != JointEntryKind::Axes && !(self.rotations.is_empty() && self.translations.is_empty()) {
            return mismatch("kind", "rotations and translations require kind = \"axes\"");
        }
        if self.kind != JointEntryKind::Ellipsoid && (self.radii.is_some() || self.coordinates.is_some()) {
            return mismatch("kind", "radii and coordinates require kind = \"ellipsoid\"");
        }
        if self.ball && self.rotations.len() != 3 {
            return mismatch("ball", "a ball joint has three rotations");
        }
        for (key, values) in [
            ("parent_point", self.parent_point),
            ("parent_rotation", self.parent_rotation),
            ("child_point", self.child_point),
            ("child_rotation", self.child_rotation),
        ] {
            finite(&place(key), &values)?;
        }
        let joint = Joint {
            name: self.name.clone(),
            parent,
            child: find("body", &names.bodies, &self.child, &place("child"))?,
            in_parent: Frame::placed(self.parent_point, self.parent_rotation),
            in_child: Frame::placed(self.child_point, self.child_rotation),
            motion,
            ball: self.ball,
        };
        if self.ball && Ball::of(0, &joint).is_none() {
            return mismatch("ball", "the rotations of a ball joint are its coordinates themselves, without functions");
        }
        Ok(joint)
    }
}

/// Sorts joints so that parents come before children.
///
/// # Errors
/// If the joints do not form a tree that is rooted at the ground and holds every body.
fn sort(joints: &mut Vec<Joint>, names: &Names<'_>) -> Checked<()> {
    let mut placed: BTreeSet<Option<usize>> = [None].into();
    let mut sorted: Vec<Joint> = Vec::with_capacity(joints.len());
    while !joints.is_empty() {
        let Some(next) = joints.iter().position(|joint| placed.contains(&joint.parent)) else {
            let joint = &joints[0];
            let message =
                format!("`{}` is not connected to the ground", joint.parent.map_or("ground", |p| names.bodies[p]));
            return Err(Issue::new(
                &["joint", &joint.name, "parent"],
                message,
                "joints must form a tree rooted at the ground",
            ));
        };
        let joint = joints.remove(next);
        if !placed.insert(Some(joint.child)) {
            let message = format!("`{}` is the child of two joints", names.bodies[joint.child]);
            return Err(Issue::new(
                &["joint", &joint.name, "child"],
                message,
                "joints must form a tree: each body is the child of one joint",
            ));
        }
        sorted.push(joint);
    }
    if let Some(body) = (0..names.bodies.len()).find(|body| !placed.contains(&Some(*body))) {
        let help = "add a joint with this body as its child";
        return Err(Issue::new(&["body", names.bodies[body]], "no joint has this body as its child", help));
    }
    *joints = sorted;
    Ok(())
}

impl SurfaceEntry {
    fn check(&self, names: &Names<'_>) -> Checked<Surface> {
        let place = |key: &'static str| ["surface", self.name.as_str(), key];
        let missing =
            |key: &'static str, help: &str| Issue::new(&["surface", &self.name], format!("`{key}` is missing"), help);
        let radius = || {
            let radius = self
                .radius
                .ok_or_else(|| missing("radius", "give the radius of the sphere, cylinder or torus tube (m)"))?;
            positive(&place("radius"), radius, "m").map(|()| radius)
        };
        let shape = match self.kind {
            SurfaceKind::Sphere => Shape::Sphere { radius: radius()?, side: self.side()? },
            SurfaceKind::Cylinder => {
                let length = self.length.unwrap_or(f64::INFINITY);
                if length.is_nan() || length <= 0.0 {
                    let message = format!("found {length}");
                    return Err(Issue::new(
                        &place("length"),
                        message,
                        "it must be positive (m); omit it for an infinite cylinder",
                    ));
                }
                Shape::Cylinder { radius: radius()?, side: self.side()?, length }
            }
            SurfaceKind::Ellipsoid => {
                let radii = self.radii.ok_or_else(|| missing("radii", "an ellipsoid needs three radii (m)"))?;
                radii.iter().try_for_each(|radius| positive(&place("radii"), *radius, "m"))?;
                Shape::Ellipsoid { radii, side: self.side()? }
            }
            SurfaceKind::Torus => {
                let ring = self.ring_radius.ok_or_else(|| missing("ring_radius", "a torus needs a ring radius (m)"))?;
                positive(&place("ring_radius"), ring, "m")?;
                Shape::Torus { ring, tube: radius()?, side: self.side()? }
            }
        };
        finite(&place("point"), &self.point)?;
        finite(&place("rotation"), &self.rotation)?;
        Ok(Surface {
            name: self.name.clone(),
            body: find("body", &names.bodies, &self.body, &place("body"))?,
            frame: Frame::placed(self.point, self.rotation),
            shape,
        })
    }

    fn side(&self) -> Checked<Option<Side>> {
        let Some(side) = &self.side else { return Ok(None) };
        let (sign, axis) = match side.strip_prefix('-') {
            Some(axis) => (-1.0, axis),
            None => (1.0, side.as_str()),
        };
        match axis {
            "x" => Ok(Some(Side { axis: 0, sign })),
            "y" => Ok(Some(Side { axis: 1, sign })),
            "z" if self.kind != SurfaceKind::Cylinder => Ok(Some(Side { axis: 2, sign })),
            _ => Err(Issue::new(
                &["surface", &self.name, "side"],
                format!("found \"{side}\""),
                "allowed are x, -x, y, -y and, except for a cylinder, z and -z",
            )),
        }
    }
}

impl MuscleEntry {
    fn fibre(&self, [activation_time, deactivation_time]: [f64; 2]) -> FibreEntry {
        FibreEntry {
            activation_time,
            deactivation_time,
            activation_steepness: self.activation_steepness,
            damping: self.damping,
            effort_weight: self.effort_weight,
            active_width: self.active_width,
            passive_strain: self.passive_strain,
            tendon_strain: self.tendon_strain,
            millard: self.millard,
        }
    }

    /// Checks that no two successive points coincide, which would leave the path's direction undefined.
    fn check_points_differ(&self) -> Checked<()> {
        let Some(k) = self.path.windows(2).position(|pair| pair[1].repeats(&pair[0])) else { return Ok(()) };
        let index = (k + 1).to_string();
        let message = "the point coincides with the previous one: the path has zero length between them";
        let help = "remove one of the two points, or correct its position";
        Err(Issue::new(&["muscle", &self.name, "path", &index], message, help))
    }

    fn check(
        &self,
        names: &Names<'_>,
        (defaults, curves): (&MusclesEntry, &CurvesEntry),
        force_velocity: ForceVelocity,
    ) -> Checked<Muscle> {
        let place = |key: &'static str| ["muscle", self.name.as_str(), key];
        if self.path.len() < 2 && !(self.path.is_empty() && self.length.is_some()) {
            let help = "a path needs an origin and an insertion, or the muscle a `length`";
            return Err(Issue::new(&place("path"), "fewer than two points", help));
        }
        self.check_points_differ()?;
        let point = |entry: &PointEntry| {
            finite(&place("path"), &entry.point)?;
            let coordinate = |name: &str| find("coordinate", &names.coordinates, name, &place("path"));
            let mut moves = Vec::new();
            if let Some(MovesEntry { coordinate: name, slope }) = &entry.moves {
                finite(&place("path"), slope)?;
                let line = |component: usize| Function::Polynomial(vec![0.0, slope[component]]);
                let coordinate = coordinate(name)?;
                moves.extend((0..3).map(|component| Move { component, coordinate, by: line(component) }));
            }
            for (component, follows) in [&entry.x, &entry.y, &entry.z].into_iter().enumerate() {
                let Some(follows) = follows else { continue };
                let (coordinate, by) = (coordinate(&follows.coordinate)?, follows.by.check(&place("path"))?);
                moves.push(Move { component, coordinate, by });
            }
            let when = entry.when.as_ref().map(|when| {
                if when.range[0].is_nan() || when.range[1].is_nan() || when.range[0] > when.range[1] {
                    let message = format!("found the range {:?}", when.range);
                    return Err(Issue::new(&place("path"), message, "give the lower limit first (rad or m)"));
                }
                Ok((coordinate(&when.coordinate)?, when.range))
            });
            Ok(PathPoint {
                body: find("body", &names.bodies, &entry.body, &place("path"))?,
                point: entry.point,
                moves,
                when: when.transpose()?,
            })
        };
        if !(self.tendon_slack_length >= 0.0 && self.tendon_slack_length.is_finite()) {
            let message = format!("found {}", self.tendon_slack_length);
            return Err(Issue::new(&place("tendon_slack_length"), message, "it must be zero or a positive length (m)"));
        }
        if !(0.0..1.5).contains(&self.pennation_angle) {
            let message = format!("found {}", self.pennation_angle);
            return Err(Issue::new(&place("pennation_angle"), message, "it must be an angle from 0 to below 1.5 rad"));
        }
        positive(&place("max_isometric_force"), self.max_isometric_force, "N")?;
        positive(&place("optimal_fibre_length"), self.optimal_fibre_length, "m")?;
        let rigid_tendon = self.rigid_tendon.unwrap_or(self.tendon_slack_length < defaults.rigid_tendon_below);
        if self.tendon_slack_length == 0.0 && !rigid_tendon {
            let message = "a tendon of zero length cannot be elastic";
            let help = "set rigid_tendon = true, or rigid_tendon_below in [muscles]";
            return Err(Issue::new(&place("tendon_slack_length"), message, help));
        }
        let number = |key: &'static str, own: Option<f64>, default: f64, unit: &str| {
            let value = own.unwrap_or(default);
            let place = if own.is_some() { place(key) } else { ["muscles", key, ""] };
            positive(place.as_slice().strip_suffix(&[""]).unwrap_or(&place), value, unit).map(|()| value)
        };
        let surface = |entry: &ObstacleEntry| {
            let (name, parts) = match entry {
                ObstacleEntry::Any(name) => (name, None),
                ObstacleEntry::Part { name, part } => (name, Some([*part; 2])),
                ObstacleEntry::Parts { name, parts } => (name, Some(*parts)),
            };
            if parts.is_some_and(|[first, last]| first > last || last + 1 >= self.path.len()) {
                let help = match self.path.len().checked_sub(2) {
                    Some(last) => format!("the path has parts 0 to {last}"),
                    None => "the path has no points, and so no parts".to_owned(),
                };
                return Err(Issue::new(
                    &place("surfaces"),
                    format!("`{name}` is assigned to parts that the path does not have"),
                    help,
                ));
            }
            Ok(Obstacle { surface: find("surface", &names.surfaces, name, &place("surfaces"))?, parts })
        };
        let times = [
            number("activation_time", self.activation_time, defaults.activation_time, "s")?,
            number("deactivation_time", self.deactivation_time, defaults.deactivation_time, "s")?,
        ];
        Ok(Muscle {
            name: self.name.clone(),
            max_isometric_force: self.max_isometric_force,
            optimal_fibre_length: self.optimal_fibre_length,
            tendon_slack_length: self.tendon_slack_length,
            pennation_angle: self.pennation_angle,
            fibre: self.fibre(times).check(&self.name, curves.activation_dynamics, force_velocity)?,
            curves: curves.family,
            max_shortening_velocity: number(
                "max_shortening_velocity",
                self.max_shortening_velocity,
                defaults.max_shortening_velocity,
                "optimal fibre lengths per second",
            )?,
            rigid_tendon,
            path: MusclePath {
                points: self.path.iter().map(point).collect::<Checked<Vec<_>>>()?,
                surfaces: self.surfaces.iter().map(surface).collect::<Checked<Vec<_>>>()?,
            },
            length: self
                .length
                .as_ref()
                .map(|length| length.check(&names.coordinates, &place("length")))
                .transpose()?,
        })
    }
}
