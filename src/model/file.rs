//! The TOML file of a planar model, and the checks that turn it into a [`Model`].
//!
//! Units are SI; angles are in degrees if the key ends in `_deg`. `data/models/arm.toml` is a commented example.

use std::sync::Arc;

use schemars::JsonSchema;
use serde::Deserialize;

use super::Model;
use super::body::{Body, ExternalForce, Place};
use super::joint::{Joint, JointKind};
use super::musculotendon::Musculotendon;
use super::path::{Path, StraightPath};
use super::planar::Planar;
use crate::curves::{ForceVelocity, MillardParameters};
use crate::entries::{ActuatorEntry, CurvesEntry, FibreEntry, finite, named, positive, unique};
use crate::error::{Issue, Mistakes, Result, SourceFile, first, nearest};
use crate::names;

#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ModelFile {
    /// Name of the model.
    pub name: String,
    /// Where the data come from, and their licence.
    pub source: Option<String>,
    /// Acceleration of gravity in the ground frame, m/s².
    #[serde(default = "earth")]
    pub gravity: [f64; 2],
    /// The muscles' curves.
    #[serde(default)]
    pub curves: CurvesEntry,
    /// Rigid bodies. The body `ground` is predefined.
    #[serde(default)]
    pub body: Vec<BodyEntry>,
    /// Joints between bodies. More joints than bodies close loops.
    #[serde(default)]
    pub joint: Vec<JointEntry>,
    /// Musculotendons.
    #[serde(default)]
    pub muscle: Vec<MuscleEntry>,
    /// Constant external forces.
    #[serde(default)]
    pub force: Vec<ForceEntry>,
    /// Actuators that are no muscles.
    #[serde(default)]
    pub actuator: Vec<ActuatorEntry>,
}

fn earth() -> [f64; 2] {
    [0.0, -9.81]
}

#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BodyEntry {
    /// Name of the body.
    pub name: String,
    /// Mass, kg.
    pub mass: f64,
    /// Centre of mass in the body's frame, m.
    pub centre_of_mass: [f64; 2],
    /// Moment of inertia about the centre of mass, kg m².
    pub inertia: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum JointEntryKind {
    /// a hinge
    Revolute,
    /// a slider along `axis`
    Prismatic,
    /// no motion
    Weld,
}

#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct JointEntry {
    /// Name of the joint.
    pub name: String,
    /// What the joint allows.
    pub kind: JointEntryKind,
    /// `ground` or a body.
    pub parent: String,
    /// Position of the joint in the parent's frame, m.
    pub parent_point: [f64; 2],
    /// The body that moves relative to the parent.
    pub child: String,
    /// Position of the joint in the child's frame, m.
    pub child_point: [f64; 2],
    /// Name of the joint coordinate in motion files. Omit it for a joint that only closes a loop.
    pub coordinate: Option<String>,
    /// Child angle − parent angle when the coordinate is zero (always, for welds and prismatic joints), degrees.
    #[serde(default)]
    pub angle_deg: f64,
    /// Direction of a prismatic joint in the parent's frame.
    pub axis: Option<[f64; 2]>,
}

#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PointEntry {
    /// `ground` or a body.
    pub body: String,
    /// The point in the body's frame, m.
    pub point: [f64; 2],
}

#[derive(Clone, Debug, Deserialize, JsonSchema)]
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
    /// Pennation angle at the optimal fibre length, degrees.
    #[serde(default)]
    pub pennation_angle_deg: f64,
    /// Activation time constant, s.
    #[serde(default = "thesis_time")]
    pub activation_time: f64,
    /// Deactivation time constant, s.
    #[serde(default = "thesis_time")]
    pub deactivation_time: f64,
    /// Largest shortening velocity, optimal fibre lengths per second.
    #[serde(default = "thesis_velocity")]
    pub max_shortening_velocity: f64,
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
    /// Origin, via points, insertion: at least two points.
    pub path: Vec<PointEntry>,
}

fn thesis_time() -> f64 {
    0.12
}

fn thesis_velocity() -> f64 {
    1.0
}

#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ForceEntry {
    /// Name of the force.
    pub name: String,
    /// The body it acts on.
    pub body: String,
    /// Point of application in the body's frame, m.
    #[serde(default)]
    pub point: [f64; 2],
    /// The force in the ground frame, N.
    pub force: [f64; 2],
    /// An additional moment, N m.
    #[serde(default)]
    pub moment: f64,
}

impl MuscleEntry {
    fn fibre(&self) -> FibreEntry {
        FibreEntry {
            activation_time: self.activation_time,
            deactivation_time: self.deactivation_time,
            activation_steepness: self.activation_steepness,
            damping: self.damping,
            effort_weight: self.effort_weight,
            active_width: self.active_width,
            passive_strain: self.passive_strain,
            tendon_strain: self.tendon_strain,
            millard: self.millard,
        }
    }
}

impl ModelFile {
    /// The JSON Schema of a planar model file.
    pub fn schema() -> serde_json::Value {
        schemars::schema_for!(Self).to_value()
    }

    /// Reads and checks a model file.
    ///
    /// # Errors
    /// All mistakes, each with its location.
    pub fn load(file: &SourceFile) -> Result<(toml::Table, Model)> {
        let entry: ModelFile = file.toml()?;
        let model = entry.check_all().map_err(|issues| Issue::all_in_file(&issues, file))?;
        let table = toml::from_str(&file.text).map_err(|e| file.toml_error(&e))?;
        Ok((table, model))
    }

    /// [`ModelFile::check_all`].
    ///
    /// # Errors
    /// The first [`Issue`].
    pub fn check(&self) -> std::result::Result<Model, Issue> {
        self.check_all().map_err(first)
    }

    /// Checks what the types cannot express.
    ///
    /// # Errors
    /// All mistakes, each with the path of the offending value.
    pub fn check_all(&self) -> std::result::Result<Model, Vec<Issue>> {
        let mut mistakes = Mistakes::default();
        if self.body.is_empty() {
            mistakes.push(Issue::new(&["body"], "the model has no body", "add at least one `[[body]]` table"));
        }
        if self.muscle.is_empty() {
            mistakes.push(Issue::new(&["muscle"], "the model has no muscle", "add at least one `[[muscle]]` table"));
        }
        mistakes.take(named(&["name"], &self.name));
        mistakes.take(finite(&["gravity"], &self.gravity));
        mistakes.take(unique("body", self.body.iter().map(|b| b.name.as_str())));
        mistakes.take(unique("joint", self.joint.iter().map(|j| j.name.as_str())));
        mistakes.take(unique("muscle", self.muscle.iter().map(|m| m.name.as_str())));
        mistakes.take(unique("force", self.force.iter().map(|f| f.name.as_str())));
        mistakes.take(unique("actuator", self.actuator.iter().map(|a| a.name.as_str())));
        if self.body.iter().any(|b| b.name == "ground") {
            mistakes.push(Issue::new(
                &["body", "ground"],
                "the name `ground` is reserved",
                "give this body another name",
            ));
        }
        for body in &self.body {
            mistakes.take(positive(&["body", &body.name, "mass"], body.mass, "kg"));
            mistakes.take(positive(&["body", &body.name, "inertia"], body.inertia, "kg m²"));
            mistakes.take(finite(&["body", &body.name, "centre_of_mass"], &body.centre_of_mass));
        }
        let joints = mistakes.all(self.joint.iter().map(|joint| self.joint(joint)));
        for (i, joint) in joints.iter().enumerate() {
            if let Some(name) = &joint.coordinate {
                mistakes.take(named(&["joint", &joint.name, "coordinate"], name));
            }
            if let Some(name) = &joint.coordinate
                && joints[..i].iter().any(|other| other.coordinate.as_ref() == Some(name))
            {
                mistakes.push(Issue::new(
                    &["joint", &joint.name, "coordinate"],
                    format!("two joints have the coordinate `{name}`"),
                    "give the coordinate of each joint its own name",
                ));
            }
        }
        if joints.len() == self.joint.len() {
            mistakes.take(self.check_connections(&joints));
        }
        let curve = mistakes.take(self.curves.check()).unwrap_or_default();
        let muscles = mistakes.all(self.muscle.iter().map(|muscle| self.muscle(muscle, curve)));
        let forces = mistakes.all(self.force.iter().map(|force| self.force(force)));
        let coordinates = self.joint.iter().filter_map(|joint| joint.coordinate.as_deref());
        let actuators = mistakes.all(self.actuator.iter().map(|actuator| actuator.check(coordinates.clone())));
        mistakes.none()?;
        let bodies = self
            .body
            .iter()
            .map(|b| Body { name: b.name.clone(), mass: b.mass, inertia: b.inertia, centre_of_mass: b.centre_of_mass })
            .collect();
        let mechanics = Arc::new(Planar { gravity: self.gravity, bodies, joints, forces });
        Ok(Model { name: self.name.clone(), mechanics, muscles, actuators, min_activation: 0.0 })
    }

    /// Checks that a chain of joints connects each body to the ground, which determines its position.
    fn check_connections(&self, joints: &[Joint]) -> std::result::Result<(), Issue> {
        let mut connected = vec![false; self.body.len()];
        for _ in &self.body {
            for joint in joints {
                let ends = joint.bodies();
                if ends.iter().any(|end| end.is_none_or(|body| connected[body])) {
                    ends.into_iter().flatten().for_each(|body| connected[body] = true);
                }
            }
        }
        match connected.iter().position(|connected| !connected) {
            None => Ok(()),
            Some(body) => Err(Issue::new(
                &["body", &self.body[body].name],
                "no chain of joints connects this body to the ground",
                "add a joint between it and the ground, or a body that is connected to the ground",
            )),
        }
    }

    /// Converts a point in a body's frame to a point relative to its centre of mass.
    fn place(&self, body: &str, point: [f64; 2], path: &[&str]) -> std::result::Result<Place, Issue> {
        finite(path, &point)?;
        if body == "ground" {
            return Ok(Place::Ground(point));
        }
        match self.body.iter().position(|b| b.name == body) {
            Some(index) => {
                let centre = self.body[index].centre_of_mass;
                Ok(Place::Body(index, [point[0] - centre[0], point[1] - centre[1]]))
            }
            None => {
                let names = || self.body.iter().map(|b| b.name.as_str()).chain(["ground"]);
                let allowed = names().collect::<Vec<_>>().join(", ");
                let near = nearest(body, names()).map(|n| format!("did you mean `{n}`? ")).unwrap_or_default();
                Err(Issue::new(path, format!("unknown body `{body}`"), format!("{near}the model has: {allowed}")))
            }
        }
    }

    fn joint(&self, j: &JointEntry) -> std::result::Result<Joint, Issue> {
        let at = |key: &'static str| ["joint".to_owned(), j.name.clone(), key.to_owned()];
        let parent = self.place(&j.parent, j.parent_point, &at("parent").each_ref().map(String::as_str))?;
        let child = self.place(&j.child, j.child_point, &at("child").each_ref().map(String::as_str))?;
        if j.parent == j.child {
            return Err(Issue::new(
                &["joint", &j.name, "child"],
                format!("both sides of the joint are `{}`", j.parent),
                "a joint connects two bodies, or a body and the ground",
            ));
        }
        if j.child == "ground" {
            return Err(Issue::new(
                &["joint", &j.name, "child"],
                "the ground cannot be the child",
                "swap parent and child",
            ));
        }
        finite(&["joint", &j.name, "angle_deg"], &[j.angle_deg])?;
        let angle = j.angle_deg.to_radians();
        let kind = match (j.kind, j.axis) {
            (JointEntryKind::Revolute, None) => JointKind::Revolute { angle },
            (JointEntryKind::Weld, None) => JointKind::Weld { angle },
            (JointEntryKind::Prismatic, Some(axis)) => {
                let length = axis[0].hypot(axis[1]);
                if !(length > 0.0 && length.is_finite()) {
                    return Err(Issue::new(
                        &["joint", &j.name, "axis"],
                        format!("found {axis:?}"),
                        "give a direction, such as [1.0, 0.0]",
                    ));
                }
                JointKind::Prismatic { axis: axis.map(|a| a / length), angle }
            }
            (JointEntryKind::Prismatic, None) => {
                return Err(Issue::new(
                    &["joint", &j.name],
                    "a prismatic joint needs an axis",
                    "add `axis = [x, y]` in the parent's frame",
                ));
            }
            (_, Some(_)) => {
                return Err(Issue::new(
                    &["joint", &j.name, "axis"],
                    "only a prismatic joint has an axis",
                    "remove the key, or set kind = \"prismatic\"",
                ));
            }
        };
        if j.kind == JointEntryKind::Weld && j.coordinate.is_some() {
            return Err(Issue::new(
                &["joint", &j.name, "coordinate"],
                "a weld has no coordinate",
                "remove the key, or make the joint revolute",
            ));
        }
        Ok(Joint { name: j.name.clone(), kind, parent, child, coordinate: j.coordinate.clone() })
    }

    fn muscle(&self, m: &MuscleEntry, force_velocity: ForceVelocity) -> std::result::Result<Musculotendon, Issue> {
        let path = ["muscle", m.name.as_str()];
        let key = |k: &'static str| [path[0], path[1], k];
        positive(&key("max_isometric_force"), m.max_isometric_force, "N")?;
        positive(&key("optimal_fibre_length"), m.optimal_fibre_length, "m")?;
        positive(&key("tendon_slack_length"), m.tendon_slack_length, "m")?;
        positive(&key("max_shortening_velocity"), m.max_shortening_velocity, "optimal fibre lengths per second")?;
        if !(0.0..85.0).contains(&m.pennation_angle_deg) {
            return Err(Issue::new(
                &key("pennation_angle_deg"),
                format!("found {}", m.pennation_angle_deg),
                "it must be at least 0 and below 85 degrees",
            ));
        }
        if m.path.len() < 2 {
            return Err(Issue::new(
                &key("path"),
                format!("found {}", names::counted(m.path.len(), "point")),
                "a muscle needs an origin and an insertion",
            ));
        }
        let points = m
            .path
            .iter()
            .enumerate()
            .map(|(i, p)| self.place(&p.body, p.point, &["muscle", &m.name, "path", &i.to_string()]))
            .collect::<std::result::Result<Vec<_>, _>>()?;
        if points.windows(2).any(|w| w[0] == w[1]) {
            return Err(Issue::new(
                &key("path"),
                "two successive points coincide",
                "remove one of them: a segment of zero length has no direction",
            ));
        }
        let path = StraightPath::new(points);
        if path.points.iter().all(|p| p.body() == path.points[0].body()) {
            return Err(Issue::new(
                &key("path"),
                "all points are on the same body",
                "origin and insertion must be on different bodies for the muscle to act on a joint",
            ));
        }
        let fibre = m.fibre().check(&m.name, self.curves.activation_dynamics, force_velocity)?;
        Ok(Musculotendon {
            name: m.name.clone(),
            max_isometric_force: m.max_isometric_force,
            optimal_fibre_length: m.optimal_fibre_length,
            tendon_slack_length: m.tendon_slack_length,
            pennation_angle: m.pennation_angle_deg.to_radians(),
            activation: fibre.activation,
            max_shortening_velocity: m.max_shortening_velocity,
            damping: fibre.damping,
            effort_weight: fibre.effort_weight,
            shape: fibre.shape,
            curves: self.curves.family.with(&fibre.shape),
            rigid_tendon: false,
            has_passive_force: true,
            path: Path::Straight(path),
        })
    }

    fn force(&self, f: &ForceEntry) -> std::result::Result<ExternalForce, Issue> {
        finite(&["force", &f.name, "force"], &f.force)?;
        finite(&["force", &f.name, "moment"], &[f.moment])?;
        match self.place(&f.body, f.point, &["force", &f.name, "body"])? {
            Place::Body(body, point) => {
                Ok(ExternalForce { name: f.name.clone(), body, point, force: f.force, moment: f.moment })
            }
            Place::Ground(_) => Err(Issue::new(
                &["force", &f.name, "body"],
                "a force on the ground has no effect",
                "name the body that the force acts on",
            )),
        }
    }
}
