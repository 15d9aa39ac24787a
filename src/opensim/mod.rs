//! Imports OpenSim models (`.osim`, versions 1 to 4).
//!
//! [`import`] reads a file into a [`SkeletonFile`], the same type that a model file is read into. What cannot be mapped
//! is listed by name, with its effect on results. Sources for the format: OpenSim's documentation and the files it
//! writes.
//!
//! | OpenSim | Sinew |
//! |---|---|
//! | Body | `[[body]]`; `role = "given"` if welded to the ground or on a free joint to it |
//! | Pin-, Slider-, Universal-, Ball-, GimbalJoint | `[[joint]]` |
//! | Planar-, Free-, Weld-, ScapulothoracicJoint | `[[joint]]` |
//! | CustomJoint | `[[joint]]`, with its constant parts in the frames |
//! | Coordinate, its `locked` | `[[coordinate]]`, `locked` |
//! | CoordinateActuator | `[[actuator]]` |
//! | CoordinateLimitForce, SpringGeneralizedForce | `[[passive]]` |
//! | CoordinateCouplerConstraint | `follows` |
//! | PointConstraint | `[[held_point]]` |
//! | Thelen2003-, Millard2012-, DeGrooteFregly2016Muscle | `[[muscle]]`: its parameters, with the curves of De Groote et al. 2016 |
//! | Schutte1993-, RigidTendonMuscle | as above |
//! | PathPoint, MovingPathPoint, ConditionalPathPoint | `path`: fixed, `moves` or `x`, `y`, `z`, `when` |
//! | FunctionBasedPath | `length` |
//! | WrapSphere, WrapCylinder, WrapEllipsoid, WrapTorus | `[[surface]]` |
//! | PathWrap, its range | `surfaces` |

mod document;
pub mod external_loads;
mod frames;
mod function;
mod joints;
mod lost;
mod mend;
mod muscles;
mod passive;
pub mod paths;
mod repair;

use document::{Defaults, Element};
use frames::Frames;
use joints::Found;

use crate::curves::{ActivationDynamics, MuscleCurves};
use crate::entries::{ActuatorEntry, CurvesEntry};
use crate::error::{Issue, Result, SourceFile};
use crate::skeleton::file::{GROUND, MusclesEntry, SkeletonFile};

/// An imported model, and notes on what could not be mapped.
#[derive(Clone, Debug)]
pub struct Imported {
    pub file: SkeletonFile,
    pub notes: Vec<Note>,
}

/// Something that could not be mapped exactly.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Note {
    /// The part of the model.
    pub what: String,
    /// What happened to it, and what that means for results.
    pub lost: String,
    pub weight: Weight,
}

/// How much a note matters for results, the most important first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Weight {
    /// Something that acts on the model is missing.
    Lost,
    /// Something was replaced, and numbers differ.
    Changed,
    /// No effect on numbers.
    Remark,
}

/// Notes collected during an import, without duplicates.
#[derive(Default)]
struct Notes(Vec<Note>);

impl Notes {
    fn lost(&mut self, what: &str, lost: impl Into<String>) {
        self.add(what, lost, Weight::Lost);
    }

    fn changed(&mut self, what: &str, lost: impl Into<String>) {
        self.add(what, lost, Weight::Changed);
    }

    fn remark(&mut self, what: &str, lost: impl Into<String>) {
        self.add(what, lost, Weight::Remark);
    }

    fn add(&mut self, what: &str, lost: impl Into<String>, weight: Weight) {
        self.push(Note { what: what.to_owned(), lost: lost.into(), weight });
    }

    fn push(&mut self, note: Note) {
        if !self.0.contains(&note) {
            self.0.push(note);
        }
    }
}

/// Frames and defaults to which the elements of a file refer.
struct Reader<'d> {
    frames: Frames<'d>,
    defaults: Defaults<'d>,
}

impl<'d> Reader<'d> {
    /// The number under the first of these tags that is present, in the element or else in the file's defaults for its
    /// kind.
    ///
    /// # Errors
    /// If the text is not one finite number.
    fn number(&self, element: Element<'d>, tags: &[&str]) -> Result<Option<f64>> {
        for element in [Some(element), self.defaults.get(element.tag()).copied()].into_iter().flatten() {
            for tag in tags {
                if let Some(number) = element.number(tag)? {
                    return Ok(Some(number));
                }
            }
        }
        Ok(None)
    }

    /// A CoordinateActuator. Its bounds are infinite unless the file has others.
    ///
    /// # Errors
    /// If a number is not valid.
    fn actuator(&self, element: Element<'d>) -> Result<ActuatorEntry> {
        // An infinite bound is none.
        let bound = |tag| element.text(tag).and_then(|text| text.trim().parse().ok()).filter(|b: &f64| b.is_finite());
        Ok(ActuatorEntry {
            name: element.name().to_owned(),
            coordinate: element.text("coordinate").unwrap_or_default().to_owned(),
            optimal_force: self.number(element, &["optimal_force"])?.unwrap_or(1.0),
            min_control: bound("min_control"),
            max_control: bound("max_control"),
        })
    }

    /// Boolean value of a child, or else of the file's defaults for the element's kind, or else `default`.
    fn flag(&self, element: Element<'d>, tag: &str, default: bool) -> bool {
        let fallback = self.defaults.get(element.tag()).map_or(default, |d| d.flag(tag, default));
        element.flag(tag, fallback)
    }
}

/// True if a file is an OpenSim model, by its extension.
pub fn is_osim(file: &SourceFile) -> bool {
    file.path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("osim"))
}

/// Reads an OpenSim model.
///
/// # Errors
/// If the file is not valid XML or not a model, refers to something that does not exist, has a number that is not valid
/// or a joint that is not supported, or does not pass the checks of a model.
pub fn import(source: &SourceFile) -> Result<Imported> {
    let repaired = repair::repaired(source);
    let file = &*repaired;
    let document = document::parse(file)?;
    let root = Element { node: document.root_element(), file };
    let model = if root.tag() == "Model" { Some(root) } else { root.child("Model") };
    let Some(model) = model else {
        let help = "an OpenSim model consists of a <Model> in an <OpenSimDocument>";
        return Err(root.error(format!("<{}> contains no <Model>", root.tag()), help));
    };
    let parts = Parts::of(model);
    let bodies: Vec<Element<'_>> = parts.bodies.iter().copied().filter(|body| body.name() != GROUND).collect();
    let defaults = (model.descendants("defaults").flat_map(|d| d.children())).map(|d| (d.tag(), d)).collect();
    let reader = Reader { frames: Frames::new(model, &bodies), defaults };
    let mut notes = Notes::default();
    let mut read = SkeletonFile {
        name: if model.name().is_empty() { stem(source) } else { model.name().to_owned() },
        source: Some(provenance(source, root, model)),
        dimensions: 3,
        body: bodies.iter().map(|body| joints::body(*body, &mut notes)).collect::<Result<_>>()?,
        joint: Vec::new(),
        coordinate: Vec::new(),
        surface: Vec::new(),
        muscle: Vec::new(),
        held_point: Vec::new(),
        force: Vec::new(),
        actuator: Vec::new(),
        passive: Vec::new(),
        turn: Vec::new(),
        gravity: parts.gravity()?,
        curves: CurvesEntry {
            family: MuscleCurves::DegrooteFregly2016,
            activation_dynamics: ActivationDynamics::DegrooteFregly2016,
            ..CurvesEntry::default()
        },
        muscles: MusclesEntry::default(),
    };
    parts.read_joints(&reader, &bodies, &mut read, &mut notes)?;
    let frames = model.descendants("PhysicalOffsetFrame").filter(|frame| frame.child("WrapObjectSet").is_some());
    let ground = model.child("Ground").into_iter().chain(parts.bodies.iter().copied());
    for owner in ground.chain(frames) {
        read.surface.extend(muscles::surfaces(&reader.frames, owner, &mut notes)?);
    }
    let is_off = |force: &Element<'_>| !force.flag("appliesForce", true) || force.flag("isDisabled", false);
    let (off, forces): (Vec<_>, Vec<_>) = parts.forces.iter().copied().partition(is_off);
    for force in off {
        let kind = if muscles::is_muscle(force) { "muscle" } else { force.tag() };
        notes.remark(&format!("{kind} {}", force.name()), "left out: disabled in the model");
    }
    let (muscles, others): (Vec<_>, Vec<_>) = forces.into_iter().partition(|force| muscles::is_muscle(*force));
    let (actuators, others): (Vec<_>, Vec<_>) =
        others.into_iter().partition(|force| force.tag() == "CoordinateActuator" && force.text("coordinate").is_some());
    for actuator in actuators {
        read.actuator.push(reader.actuator(actuator)?);
    }
    let (passive, others): (Vec<_>, Vec<_>) = others.into_iter().partition(|force| passive::is_passive(*force));
    for force in passive {
        read.passive.push(passive::passive(&reader, force, &read)?);
    }
    lost::forces(others.into_iter(), &mut notes);
    read.muscles.min_activation = muscles::min_activation(&muscles);
    for force in muscles {
        read.muscle.push(muscles::muscle(&reader, force, &mut notes)?);
    }
    lost::others(model, &parts, &mut notes);
    mend::mend(&mut read, &mut notes);
    read.check().map_err(|issue| at(source, root, &issue))?;
    notes.0.sort_by_key(|note| note.weight);
    Ok(Imported { file: read, notes: notes.0 })
}

/// The elements of a model by kind. Depending on the version, they belong to sets or are components.
struct Parts<'d> {
    /// The elements that hold the sets: the model and, in version 1, its engine.
    holders: Vec<Element<'d>>,
    bodies: Vec<Element<'d>>,
    joints: Vec<Element<'d>>,
    constraints: Vec<Element<'d>>,
    forces: Vec<Element<'d>>,
    /// Components of unknown kind.
    others: Vec<Element<'d>>,
}

impl<'d> Parts<'d> {
    /// Collects the elements of a model.
    fn of(model: Element<'d>) -> Self {
        let engine = model.child("DynamicsEngine").and_then(|engine| engine.children().next());
        let holders: Vec<Element<'d>> = [Some(model), engine].into_iter().flatten().collect();
        let set = |tags: &[&str]| holders.iter().flat_map(|holder| holder.objects(tags)).collect::<Vec<_>>();
        let mut parts = Self {
            bodies: set(&["BodySet"]),
            joints: set(&["JointSet"]),
            constraints: set(&["ConstraintSet"]),
            forces: set(&["ForceSet", "ActuatorSet"]),
            others: Vec::new(),
            holders,
        };
        let components = model.objects(&["components"]).into_iter().chain(model.objects(&["ComponentSet"]));
        for component in components {
            let kind = match component.tag() {
                "Body" => &mut parts.bodies,
                tag if tag.ends_with("Joint") => &mut parts.joints,
                tag if tag.ends_with("Constraint") => &mut parts.constraints,
                tag if muscles::is_muscle(component) || lost::is_force(tag) => &mut parts.forces,
                _ => &mut parts.others,
            };
            kind.push(component);
        }
        parts
    }

    /// Gravitational acceleration, m/s².
    fn gravity(&self) -> Result<[f64; 3]> {
        let holder = self.holders.last().expect("the model");
        Ok(holder.vector("gravity")?.unwrap_or([0.0, -9.80665, 0.0]))
    }

    /// Reads the joints with their coordinates and the constraints, and assigns the roles of the bodies.
    fn read_joints(
        &self,
        reader: &Reader<'d>,
        bodies: &[Element<'d>],
        read: &mut SkeletonFile,
        notes: &mut Notes,
    ) -> Result<()> {
        let found = joints_of(&self.joints, bodies);
        joints::check_kinds(&found)?;
        for found in found {
            let joint = joints::joint(reader, &found, notes)?;
            read.joint.push(joint.entry);
            read.coordinate.extend(joint.coordinates);
        }
        for constraint in self.constraints.iter().copied() {
            joints::constraint(&reader.frames, constraint, &mut read.coordinate, &mut read.held_point, notes)?;
        }
        joints::assign_roles(&mut read.body, &read.joint, &read.coordinate, notes);
        Ok(())
    }
}

/// Name of the file without its extension.
fn stem(source: &SourceFile) -> String {
    source.path.file_stem().map_or_else(|| "model".to_owned(), |stem| stem.to_string_lossy().into_owned())
}

/// File name, version and hash, and the credits and publications that the file states.
fn provenance(source: &SourceFile, root: Element<'_>, model: Element<'_>) -> String {
    let file = source.path.file_name().unwrap_or_default().to_string_lossy();
    let version = root.node.attribute("Version").unwrap_or("none");
    let hash = blake3::hash(source.text.as_bytes()).to_hex();
    let mut provenance = format!("{file} (OpenSim, version {version}; BLAKE3 {hash})");
    for (tag, name) in [("credits", "Credits"), ("publications", "Publications")] {
        if let Some(text) = model.text(tag) {
            let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
            provenance.push_str(&format!(". {name}: {text}"));
        }
    }
    provenance
}

/// All joints: those in the joint set (version 4), and those inside the body that they move (older versions).
fn joints_of<'d>(set: &[Element<'d>], bodies: &[Element<'d>]) -> Vec<Found<'d>> {
    let mut found: Vec<Found<'d>> = set.iter().map(|&element| Found { element, within: None }).collect();
    for body in bodies {
        let own = body.either(&["Joint", "joint"]).into_iter().flat_map(|joint| joint.children());
        found.extend(own.map(|element| Found { element, within: Some(body.name()) }));
    }
    found
}

/// An issue with an imported model as an error, located at the element that it concerns.
pub fn error(source: &SourceFile, issue: &Issue) -> crate::error::Error {
    let repaired = repair::repaired(source);
    match document::parse(&repaired) {
        Ok(document) => at(source, Element { node: document.root_element(), file: &repaired }, issue),
        Err(error) => error,
    }
}

/// An issue as an error at the element whose name is the second part of its path, if there is one.
fn at(source: &SourceFile, root: Element<'_>, issue: &Issue) -> crate::error::Error {
    let about = issue.path.get(1).and_then(|name| {
        root.node.descendants().find(|node| node.is_element() && node.attribute("name") == Some(name.as_str()))
    });
    let message = format!("{}: {}", issue.path.join("."), issue.message);
    match about {
        Some(node) => Element { node, file: root.file }.error(message, issue.help.as_deref().unwrap_or("")),
        None => source.error(None, format!("{}: {message}", source.path.display()), "", issue.help.clone()),
    }
}
