//! OpenSim models (`.osim`, versions 1 to 4) as models of Sinew.
//!
//! [`import`] reads a file into a [`SkeletonFile`], the very thing that a model file is read into, and lists by name what could not be
//! mapped with what that means for results. Facts about the format: OpenSim's documentation and the files it writes.
//!
//! | OpenSim | Sinew |
//! |---|---|
//! | Body, its inertia | `[[body]]`; welded to the ground, or hanging on it by six coordinates: `role = "given"` |
//! | Pin, Slider, Universal, Ball, Gimbal, Planar, Free, Weld, Custom, Scapulothoracic joint | `[[joint]]`; constant parts of a custom joint go into its frames |
//! | Coordinate, locked; CoordinateCouplerConstraint | `[[coordinate]]`, `locked`; `follows` |
//! | PointConstraint | `[[held_point]]` |
//! | Thelen2003, Millard2012, DeGrooteFregly2016, Schutte1993, RigidTendon muscle | `[[muscle]]`: its parameters, with Sinew's curves |
//! | PathPoint, MovingPathPoint, ConditionalPathPoint | `path`: fixed, `moves` or `x`, `y`, `z`, `when` |
//! | WrapSphere, WrapCylinder, WrapEllipsoid, the range of a PathWrap | `[[surface]]`, `surfaces` |

mod document;
mod frames;
mod function;
mod joints;
mod muscles;
mod order;

use document::{Defaults, Element};
use frames::Frames;
use joints::Found;
use order::Ranges;

use crate::error::{Issue, Result, SourceFile};
use crate::model::file::CurvesEntry;
use crate::skeleton::Role;
use crate::skeleton::file::{GROUND, MusclesEntry, ObstacleEntry, SkeletonFile};

/// A model that was read, and what was not.
#[derive(Clone, Debug)]
pub struct Imported {
    pub file: SkeletonFile,
    pub notes: Vec<Note>,
}

/// Something that could not be mapped, and what that means for results.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Note {
    pub what: String,
    pub lost: String,
    /// Whether results may differ for it.
    pub matters: bool,
}

#[derive(Default)]
struct Notes(Vec<Note>);

impl Notes {
    fn add(&mut self, what: &str, lost: impl Into<String>) {
        self.push(Note { what: what.to_owned(), lost: lost.into(), matters: true });
    }

    fn push(&mut self, note: Note) {
        if !self.0.contains(&note) {
            self.0.push(note);
        }
    }
}

/// What the parts of a file refer to.
struct Reader<'d> {
    frames: Frames<'d>,
    defaults: Defaults<'d>,
}

impl<'d> Reader<'d> {
    /// A number under one of these tags, from the element or from the file's defaults for its kind.
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

    fn flag(&self, element: Element<'d>, tag: &str, default: bool) -> bool {
        let fallback = self.defaults.get(element.tag()).map_or(default, |d| d.flag(tag, default));
        element.flag(tag, fallback)
    }
}

/// Whether a file is an OpenSim model, by its ending.
pub fn is_one(file: &SourceFile) -> bool {
    file.path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("osim"))
}

/// Reads an OpenSim model.
///
/// # Errors
/// If the file is no XML or no model, names what is not there, has numbers that are none, or describes no mechanism.
pub fn import(source: &SourceFile) -> Result<Imported> {
    let document = document::parse(source)?;
    let root = Element { node: document.root_element(), file: source };
    let model = if root.tag() == "Model" { Some(root) } else { root.child("Model") };
    let Some(model) = model else {
        let help = "an OpenSim model has a <Model> in an <OpenSimDocument>";
        return Err(root.error(format!("<{}> holds no <Model>", root.tag()), help));
    };
    let mut notes = Notes::default();
    // Version 1 has bodies within an engine.
    let engine = model.child("DynamicsEngine").and_then(|engine| engine.children().next());
    let parts: Vec<Element<'_>> = [Some(model), engine].into_iter().flatten().collect();
    let set = |tags: &[&str]| -> Vec<Element<'_>> { parts.iter().flat_map(|part| part.objects(tags)).collect() };
    let all_bodies = set(&["BodySet"]);
    let bodies: Vec<Element<'_>> = all_bodies.iter().copied().filter(|body| body.name() != GROUND).collect();
    let defaults = (model.descendants("defaults").flat_map(|d| d.children())).map(|d| (d.tag(), d)).collect();
    let reader = Reader { frames: Frames::new(model, &bodies), defaults };

    let mut file = SkeletonFile {
        name: if model.name().is_empty() { stem(source) } else { model.name().to_owned() },
        source: Some(provenance(source, root, model)),
        dimensions: 3,
        body: bodies.iter().map(|body| joints::body(*body)).collect::<Result<_>>()?,
        joint: Vec::new(),
        coordinate: Vec::new(),
        surface: Vec::new(),
        muscle: Vec::new(),
        held_point: Vec::new(),
        force: Vec::new(),
        abduction: None,
        gravity: parts.last().unwrap_or(&model).vector("gravity")?.unwrap_or([0.0, -9.80665, 0.0]),
        curves: CurvesEntry::default(),
        muscles: MusclesEntry::default(),
    };
    for found in joints_of(set(&["JointSet"]), &bodies) {
        let joint = joints::joint(&reader, &found, &mut notes)?;
        file.joint.push(joint.entry);
        file.coordinate.extend(joint.coordinates);
    }
    for constraint in set(&["ConstraintSet"]) {
        joints::constraint(&reader.frames, constraint, &mut file.coordinate, &mut file.held_point, &mut notes)?;
    }
    joints::assign_roles(&mut file.body, &file.joint, &file.coordinate, &mut notes);
    let frames = model.descendants("PhysicalOffsetFrame").filter(|frame| frame.child("WrapObjectSet").is_some());
    let ground = model.child("Ground").into_iter().chain(all_bodies.iter().copied());
    for owner in ground.chain(frames) {
        file.surface.extend(muscles::surfaces(&reader.frames, owner, &mut notes)?);
    }
    let forces = set(&["ForceSet", "ActuatorSet"]);
    for force in forces.iter().copied() {
        if !muscles::is_muscle(force) {
            other_force(force, &mut notes);
        } else if !force.flag("appliesForce", true) || force.flag("isDisabled", false) {
            notes.add(&format!("muscle {}", force.name()), "it is switched off in the model, and left away");
        } else {
            file.muscle.push(muscles::muscle(&reader, force, &mut notes)?);
        }
    }
    left_away(model, &parts, &forces, &mut notes);
    mend(&mut file, &mut notes);
    let checked = file.check().map_err(|issue| at(source, root, &issue))?;
    order::arrange(&mut file, &checked, &ranges(model)?);
    Ok(Imported { file, notes: notes.0 })
}

fn ranges<'d>(model: Element<'d>) -> Result<Ranges<'d>> {
    let mut ranges = Ranges::default();
    for coordinate in model.descendants("Coordinate") {
        ranges.extend(coordinate.vector("range")?.map(|range| (coordinate.name(), range)));
    }
    Ok(ranges)
}

fn stem(source: &SourceFile) -> String {
    source.path.file_stem().map_or_else(|| "model".to_owned(), |stem| stem.to_string_lossy().into_owned())
}

/// File, version and hash, and what it says of its authors and licence.
fn provenance(source: &SourceFile, root: Element<'_>, model: Element<'_>) -> String {
    let file = source.path.file_name().unwrap_or_default().to_string_lossy();
    let version = root.node.attribute("Version").unwrap_or("none");
    let hash = blake3::hash(source.text.as_bytes()).to_hex();
    let mut said = format!("{file} (OpenSim, version {version}; BLAKE3 {hash})");
    for (tag, name) in [("credits", "Credits"), ("publications", "Publications")] {
        if let Some(text) = model.text(tag) {
            let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
            said.push_str(&format!(". {name}: {text}"));
        }
    }
    said
}

/// Joints of a set (version 4), or each within the body that it moves.
fn joints_of<'d>(set: Vec<Element<'d>>, bodies: &[Element<'d>]) -> Vec<Found<'d>> {
    let mut found: Vec<Found<'d>> = set.into_iter().map(|element| Found { element, within: None }).collect();
    for body in bodies {
        let own = body.either(&["Joint", "joint"]).into_iter().flat_map(|joint| joint.children());
        found.extend(own.map(|element| Found { element, within: Some(body.name()) }));
    }
    found
}

fn other_force(force: Element<'_>, notes: &mut Notes) {
    let tag = force.tag();
    let lost = if tag.contains("Actuator") || tag.contains("Motor") {
        "left away: there are no reserve or residual actuators, muscles alone make the motion"
    } else if tag == "ExternalForce" || tag == "PrescribedForce" {
        "left away: add a [[force]] with columns in the motion file, or the motion lacks it"
    } else {
        "left away: a passive force or a kind of muscle that is not known; the muscles make up for it"
    };
    notes.add(&format!("{tag} {}", force.name()), lost);
}

/// How many elements there are of each tag.
fn counts<'d>(elements: impl Iterator<Item = Element<'d>>) -> Vec<(&'d str, usize)> {
    let mut counts: Vec<(&str, usize)> = Vec::new();
    for element in elements {
        match counts.iter_mut().find(|(tag, _)| *tag == element.tag()) {
            Some((_, count)) => *count += 1,
            None => counts.push((element.tag(), 1)),
        }
    }
    counts
}

/// What has no counterpart, in one line a kind.
fn left_away(model: Element<'_>, parts: &[Element<'_>], forces: &[Element<'_>], notes: &mut Notes) {
    for (set, matters, lost) in [
        ("ControllerSet", true, "left away: excitations are what a study finds"),
        ("ContactGeometrySet", true, "left away, with the contact forces that need them"),
        ("ComponentSet", true, "left away: components of other kinds are not known"),
        ("ProbeSet", false, "left away: no influence on results"),
        ("MarkerSet", false, "left away: no influence on results"),
    ] {
        for (tag, count) in counts(parts.iter().flat_map(|part| part.objects(&[set]))) {
            notes.push(Note { what: format!("{count} {tag} of {set}"), lost: lost.to_owned(), matters });
        }
    }
    for (tag, count) in counts(forces.iter().copied().filter(|force| muscles::is_muscle(*force))) {
        let lost = "curves of force over length, velocity and tendon strain are Sinew's: shape parameters, minimum activation and damping are left away, so that forces at a given state differ";
        notes.add(&format!("{count} {tag}"), lost);
    }
    let ranges = model.descendants("Coordinate").filter(|c| c.flag("clamped", false)).count();
    if ranges > 0 {
        notes.add(
            &format!("ranges of {ranges} clamped coordinate(s)"),
            "left away: nothing holds a coordinate in its range",
        );
    }
}

/// Mends what OpenSim lets pass and no mechanism can have, with a note each.
fn mend(file: &mut SkeletonFile, notes: &mut Notes) {
    for body in &mut file.body {
        let who = format!("body {}", body.name);
        if body.role == Role::Given && !body.is_physical() {
            // It moves as given, whatever its mass.
            (body.mass, body.inertia) = (0.0, [0.0; 6]);
        } else if body.mass == 0.0 && body.inertia != [0.0; 6] {
            notes.add(&who, "it has an inertia and no mass: the inertia is left away");
            body.inertia = [0.0; 6];
        } else if body.mass > 0.0 && !body.is_physical() {
            let [xx, yy, zz, ..] = body.inertia;
            notes.add(&who, "its inertia makes no positive definite matrix: products of inertia are left away");
            body.inertia = [xx, yy, zz, 0.0, 0.0, 0.0];
        }
    }
    let known: std::collections::HashSet<&str> = file.surface.iter().map(|surface| surface.name.as_str()).collect();
    for muscle in &mut file.muscle {
        let who = format!("muscle {}", muscle.name);
        let inside: Vec<String> = (file.surface.iter())
            .filter(|surface| muscle.path.iter().any(|point| surface.holds(point)))
            .map(|surface| surface.name.clone())
            .collect();
        muscle.surfaces.retain(|obstacle| {
            let name = obstacle.surface();
            let lost = if !known.contains(name) {
                format!("it does not wrap {name}, which is not here")
            } else if inside.iter().any(|inside| inside == name) {
                format!("a point of its path is inside {name}, which it does not wrap here")
            } else {
                return true;
            };
            notes.add(&who, lost);
            false
        });
    }
}

impl ObstacleEntry {
    fn surface(&self) -> &str {
        match self {
            Self::Any(name) | Self::Part { name, .. } | Self::Parts { name, .. } => name,
        }
    }
}

/// The error of a model that was imported, at the element it is about.
pub fn error(source: &SourceFile, issue: &Issue) -> crate::error::Error {
    match document::parse(source) {
        Ok(document) => at(source, Element { node: document.root_element(), file: source }, issue),
        Err(error) => error,
    }
}

fn at(source: &SourceFile, root: Element<'_>, issue: &Issue) -> crate::error::Error {
    let about = issue.path.get(1).and_then(|name| {
        root.node.descendants().find(|node| node.is_element() && node.attribute("name") == Some(name.as_str()))
    });
    let message = format!("{}: {}", issue.path.join("."), issue.message);
    match about {
        Some(node) => Element { node, file: source }.error(message, issue.help.as_deref().unwrap_or("")),
        None => source.error(None, format!("{}: {message}", source.path.display()), "", issue.help.clone()),
    }
}
