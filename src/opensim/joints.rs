//! Bodies, joints with their coordinates, and constraints.

use super::document::Element;
use super::frames::{Frames, Placed};
use super::function::function_of;
use super::{Notes, Reader};
use crate::error::Result;
use crate::skeleton::Role;
use crate::skeleton::file::{
    AxisEntry, BodyEntry, CoordinateEntry, FollowsEntry, GROUND, HeldPointEntry, JointEntry, JointEntryKind,
};
use crate::skeleton::frame::Frame;
use crate::skeleton::function::FunctionEntry;

const UNITS: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// Of a body whose file gives none, kg. DEPARTURE: OpenSim 4 has no default.
const MASS: f64 = 1.0;

pub fn body(element: Element<'_>, notes: &mut Notes) -> Result<BodyEntry> {
    let one = |tag: &str| Ok::<f64, crate::error::Error>(element.number(tag)?.unwrap_or(0.0));
    let inertia = match element.vector::<6>("inertia")? {
        Some(inertia) => inertia,
        None => [
            one("inertia_xx")?,
            one("inertia_yy")?,
            one("inertia_zz")?,
            one("inertia_xy")?,
            one("inertia_xz")?,
            one("inertia_yz")?,
        ],
    };
    let mass = element.number("mass")?;
    if mass.is_none() {
        notes.changed(&format!("body {}", element.name()), format!("its file gives no mass: {MASS} kg is assumed"));
    }
    Ok(BodyEntry {
        name: element.name().to_owned(),
        mass: mass.unwrap_or(MASS),
        centre_of_mass: element.vector("mass_center")?.unwrap_or_default(),
        inertia,
        role: Role::Free,
    })
}

/// A joint of a model, wherever its version writes it: in a set of joints, or in the body that it moves.
pub struct Found<'d> {
    pub element: Element<'d>,
    /// The body that it is written in.
    pub within: Option<&'d str>,
}

/// What came of a joint.
pub struct Joint {
    pub entry: JointEntry,
    pub coordinates: Vec<CoordinateEntry>,
}

/// Kinds of joint that can be read.
const KINDS: [&str; 10] = [
    "WeldJoint",
    "PinJoint",
    "SliderJoint",
    "UniversalJoint",
    "BallJoint",
    "GimbalJoint",
    "PlanarJoint",
    "FreeJoint",
    "CustomJoint",
    "ScapulothoracicJoint",
];

/// # Errors
/// If there are joints of other kinds: all of them, at the first.
pub fn check_kinds(joints: &[Found<'_>]) -> Result<()> {
    let unknown: Vec<&Found<'_>> = joints.iter().filter(|found| !KINDS.contains(&found.element.tag())).collect();
    let Some(first) = unknown.first() else { return Ok(()) };
    let name = |found: &&Found<'_>| format!("{} `{}`", found.element.tag(), found.element.name());
    let names = unknown.iter().map(name).collect::<Vec<_>>().join(", ");
    let help = format!("describe the motion by a joint of a kind that is: {}", KINDS.join(", "));
    Err(first.element.error(format!("not supported: {names}"), &help))
}

pub fn joint<'d>(reader: &Reader<'d>, found: &Found<'d>, notes: &mut Notes) -> Result<Joint> {
    let element = found.element;
    let name = if element.name().is_empty() { found.within.unwrap_or("joint") } else { element.name() };
    let (mut parent, mut child) = ends(&reader.frames, found, name)?;
    let coordinates = coordinates(reader, element, notes)?;
    let named =
        |k: usize| coordinates.get(k).map_or_else(|| format!("{name}_coord_{k}"), |coordinate| coordinate.name.clone());
    let axes = |start: usize, of: &[usize]| -> Vec<AxisEntry> {
        let axis =
            |(k, &axis): (usize, &usize)| AxisEntry { coordinate: named(start + k), axis: UNITS[axis], by: None };
        of.iter().enumerate().map(axis).collect()
    };
    let mut entry = JointEntry {
        name: name.to_owned(),
        kind: JointEntryKind::Axes,
        parent: parent.body.to_owned(),
        child: child.body.to_owned(),
        parent_point: [0.0; 3],
        parent_rotation: [0.0; 3],
        child_point: [0.0; 3],
        child_rotation: [0.0; 3],
        translations: Vec::new(),
        rotations: Vec::new(),
        radii: None,
        coordinates: None,
    };
    match element.tag() {
        "WeldJoint" => entry.kind = JointEntryKind::Weld,
        "PinJoint" => entry.rotations = axes(0, &[2]),
        "SliderJoint" => entry.translations = axes(0, &[0]),
        "UniversalJoint" => entry.rotations = axes(0, &[0, 1]),
        "BallJoint" | "GimbalJoint" => entry.rotations = axes(0, &[0, 1, 2]),
        "PlanarJoint" => (entry.rotations, entry.translations) = (axes(0, &[2]), axes(1, &[0, 1])),
        "FreeJoint" => (entry.rotations, entry.translations) = (axes(0, &[0, 1, 2]), axes(3, &[0, 1, 2])),
        "CustomJoint" => custom(element, &mut entry, (&mut parent, &mut child), notes)?,
        "ScapulothoracicJoint" => {
            entry.kind = JointEntryKind::Ellipsoid;
            entry.radii = element.vector("thoracic_ellipsoid_radii_x_y_z")?;
            entry.coordinates = Some([0, 1, 2, 3].map(named));
            let origin = element.numbers("scapula_winging_axis_origin")?.unwrap_or_default();
            let direction = element.number("scapula_winging_axis_direction")?.unwrap_or(0.0);
            if direction != 0.0 || origin.iter().any(|x| *x != 0.0) {
                let lost = "winging turns about the y-axis through the joint's point: its own origin and direction are ignored";
                notes.changed(&format!("joint {name}"), lost);
            }
        }
        _ => unreachable!("`check_kinds` has seen all joints"),
    }
    if entry.kind == JointEntryKind::Axes && entry.rotations.is_empty() && entry.translations.is_empty() {
        entry.kind = JointEntryKind::Weld;
    }
    if element.flag("reverse", false) {
        let lost = "reversed joints (`reverse`) are not supported: its motion is not that of OpenSim";
        notes.lost(&format!("joint {name}"), lost);
    }
    (entry.parent_point, entry.parent_rotation) = parent.point_and_rotation();
    (entry.child_point, entry.child_rotation) = child.point_and_rotation();
    let coordinates = complete(&entry, coordinates, notes);
    Ok(Joint { entry, coordinates })
}

/// Frames of parent and child.
fn ends<'d>(frames: &Frames<'d>, found: &Found<'d>, name: &str) -> Result<(Placed<'d>, Placed<'d>)> {
    let element = found.element;
    let Some(within) = found.within else {
        let end = |socket: &str| {
            let path = element.reference(socket, &[]);
            let lacks = || element.error(format!("the joint has no {socket}"), "name it in its sockets");
            frames.find(element, path.ok_or_else(lacks)?, name)
        };
        return Ok((end("parent_frame")?, end("child_frame")?));
    };
    // Before version 4: points and rotations are the joint's own.
    let Some(parent) = element.text("parent_body") else {
        return Err(element.error("the joint has no <parent_body>", "name the body that it hangs on"));
    };
    let placed = |body: Placed<'d>, point: &str, rotation: &str| -> Result<Placed<'d>> {
        let point = element.vector(point)?.unwrap_or_default();
        Ok(Placed::at(body.body, point, element.vector(rotation)?.unwrap_or_default()))
    };
    let parent = placed(frames.find(element, parent, name)?, "location_in_parent", "orientation_in_parent")?;
    Ok((parent, placed(Placed::on(within), "location", "orientation")?))
}

fn coordinates<'d>(reader: &Reader<'d>, joint: Element<'d>, notes: &mut Notes) -> Result<Vec<CoordinateEntry>> {
    let elements = joint.objects(&["coordinates", "CoordinateSet"]);
    let coordinate = |element: &Element<'d>| {
        let name = element.name().to_owned();
        if element.flag("prescribed", false) {
            let lost = "its prescribed function is ignored: a study takes the coordinate from the motion file";
            notes.changed(&format!("coordinate {name}"), lost);
        }
        let default = reader.number(*element, &["default_value"])?.unwrap_or(0.0);
        let range = element.vector::<2>("range")?;
        Ok(CoordinateEntry { name, default, locked: element.flag("locked", false), range, follows: None })
    };
    elements.iter().filter(|element| element.tag() == "Coordinate").map(coordinate).collect()
}

/// Coordinates that axes name and no element describes are at 0, and those that move nothing fall away.
fn complete(entry: &JointEntry, described: Vec<CoordinateEntry>, notes: &mut Notes) -> Vec<CoordinateEntry> {
    let axes = entry.rotations.iter().chain(&entry.translations).map(|axis| &axis.coordinate);
    let mut used: Vec<&String> = axes.chain(entry.coordinates.iter().flatten()).collect();
    let mut seen = std::collections::HashSet::new();
    used.retain(|name| seen.insert(name.as_str()));
    for left in described.iter().filter(|coordinate| !seen.contains(coordinate.name.as_str())) {
        notes.remark(&format!("coordinate {}", left.name), "left out: it moves nothing");
    }
    let new =
        |name: &String| CoordinateEntry { name: name.clone(), default: 0.0, locked: false, range: None, follows: None };
    let find = |name: &String| described.iter().find(|coordinate| coordinate.name == *name).cloned();
    used.into_iter().map(|name| find(name).unwrap_or_else(|| new(name))).collect()
}

/// Translations along axes of the parent, then three rotations. What is constant goes into the frames: a translation into the parent's, a
/// rotation C first past those after it, C R(a, q) = R(C a, q) C, and then into the child's.
fn custom<'d>(
    element: Element<'d>,
    entry: &mut JointEntry,
    (parent, child): (&mut Placed<'d>, &mut Placed<'d>),
    notes: &mut Notes,
) -> Result<()> {
    let (rotations, translations) = transforms(element, notes)?;
    let mut turned: Frame<f64> = Frame::identity();
    for transform in &rotations {
        let axis = turned.point(&transform.axis);
        let (offset, moving) = transform.split();
        if offset != 0.0 {
            turned = turned * Frame::rotation(transform.axis, offset);
        }
        entry.rotations.extend(moving.map(|moving| moving.along(axis)));
    }
    let mut shift = [0.0; 3];
    for transform in &translations {
        let (offset, moving) = transform.split();
        (0..3).for_each(|i| shift[i] += offset * transform.axis[i]);
        entry.translations.extend(moving.map(|moving| moving.along(transform.axis)));
    }
    if shift != [0.0; 3] {
        *parent = parent.then(Frame { origin: shift, ..Frame::identity() });
    }
    if turned != Frame::identity() {
        *child = child.then(turned.inverse());
    }
    Ok(())
}

/// An axis of a custom joint, and what moves along or about it.
struct Transform<'d> {
    axis: [f64; 3],
    coordinate: Option<&'d str>,
    function: FunctionEntry,
}

/// What is left of a transform without its constant part: the coordinate, in the axis' direction or against it, by a function.
struct Moving<'d> {
    coordinate: &'d str,
    sign: f64,
    by: Option<FunctionEntry>,
}

impl Moving<'_> {
    fn along(self, axis: [f64; 3]) -> AxisEntry {
        AxisEntry { coordinate: self.coordinate.to_owned(), axis: axis.map(|x| self.sign * x), by: self.by }
    }
}

impl<'d> Transform<'d> {
    fn split(&self) -> (f64, Option<Moving<'d>>) {
        let coefficients = match &self.function {
            FunctionEntry::Polynomial(c) => c,
            by => {
                return (0.0, self.coordinate.map(|coordinate| Moving { coordinate, sign: 1.0, by: Some(by.clone()) }));
            }
        };
        let offset = coefficients.first().copied().unwrap_or(0.0);
        let moving = self.coordinate.and_then(|coordinate| match coefficients.get(1..).unwrap_or_default() {
            [] => None,
            slopes if slopes.iter().all(|x| *x == 0.0) => None,
            [sign] if sign.abs() == 1.0 => Some(Moving { coordinate, sign: *sign, by: None }),
            slopes => {
                let by = FunctionEntry::Polynomial([&[0.0], slopes].concat());
                Some(Moving { coordinate, sign: 1.0, by: Some(by) })
            }
        });
        (offset, moving)
    }
}

/// Rotations and translations of a custom joint, in their order.
fn transforms<'d>(element: Element<'d>, notes: &mut Notes) -> Result<(Vec<Transform<'d>>, Vec<Transform<'d>>)> {
    let axes: Vec<Element<'d>> = match element.child("SpatialTransform") {
        Some(transform) => transform.children().filter(|child| child.tag() == "TransformAxis").collect(),
        None => element.objects(&["TransformAxisSet"]), // version 1
    };
    let (mut rotations, mut translations) = (Vec::new(), Vec::new());
    for axis in axes {
        let coordinates = axis.text("coordinates").or_else(|| axis.text("coordinate")).unwrap_or("");
        let mut names = coordinates.split_whitespace();
        let coordinate = names.next();
        let function = match (function_of(axis, "function")?, axis.has_function(), coordinate) {
            (Some(function), _, _) => function,
            // Without a function the coordinate itself; without a coordinate nothing moves.
            (None, false, Some(_)) => FunctionEntry::Polynomial(vec![0.0, 1.0]),
            (None, false, None) => FunctionEntry::Polynomial(vec![0.0]),
            (None, true, _) => {
                let lost = format!(
                    "the function of the axis {} is of a kind that is not supported: nothing moves along it",
                    axis.name()
                );
                notes.lost(&format!("joint {}", element.name()), lost);
                FunctionEntry::Polynomial(vec![0.0])
            }
        };
        if names.next().is_some() {
            let lost = format!("the axis {} is driven by several coordinates: only the first is taken", axis.name());
            notes.lost(&format!("joint {}", element.name()), lost);
        }
        let Some(direction) = axis.vector::<3>("axis")? else {
            return Err(axis.error("the axis has no direction", "write <axis> x y z </axis>"));
        };
        let is_rotation = match axis.text("is_rotation") {
            Some(_) => axis.flag("is_rotation", false),
            None => axis.name().starts_with("rotation"),
        };
        let transform = Transform { axis: direction, coordinate, function };
        (if is_rotation { &mut rotations } else { &mut translations }).push(transform);
    }
    Ok((rotations, translations))
}

/// What constraints beside the joints become: points held together, and coordinates that follow others.
pub fn constraint<'d>(
    frames: &Frames<'d>,
    element: Element<'d>,
    coordinates: &mut [CoordinateEntry],
    held: &mut Vec<HeldPointEntry>,
    notes: &mut Notes,
) -> Result<()> {
    let name = format!("constraint {}", element.name());
    if !element.flag("isEnforced", true) || element.flag("isDisabled", false) {
        notes.remark(&name, "left out: it is switched off in the model");
        return Ok(());
    }
    let lost = "left out: what it holds together is free to part";
    match element.tag() {
        "PointConstraint" => {
            let end = |socket: &str, older: &str, point: &str| -> Result<(String, [f64; 3])> {
                let Some(path) = element.reference(socket, &[older]) else {
                    return Err(element.error(format!("the constraint has no {socket}"), "name its two bodies"));
                };
                let placed = frames.find(element, path, element.name())?;
                Ok((placed.body.to_owned(), placed.frame.point(&element.vector(point)?.unwrap_or_default())))
            };
            let (a, b) = (end("body_1", "body_1", "location_body_1")?, end("body_2", "body_2", "location_body_2")?);
            let name = element.name().to_owned();
            held.push(HeldPointEntry { name, bodies: [a.0, b.0], points: [a.1, b.1] });
        }
        "CoordinateCouplerConstraint" => {
            let leaders: Vec<&str> =
                element.text("independent_coordinate_names").unwrap_or("").split_whitespace().collect();
            let follower = element.text("dependent_coordinate_name").unwrap_or("");
            let by = function_of(element, "coupled_coordinates_function")?;
            let known = leaders.iter().all(|name| coordinates.iter().any(|c| c.name == *name));
            let follower = coordinates.iter_mut().find(|coordinate| coordinate.name == follower);
            match (&leaders[..], follower, by) {
                ([leader], Some(follower), Some(by)) if known => {
                    follower.follows = Some(FollowsEntry { coordinate: (*leader).to_owned(), by });
                }
                _ => notes.lost(
                    &name,
                    "left out: it couples several coordinates, or by a function of a kind that is not supported",
                ),
            }
        }
        _ => notes.lost(&format!("{name} ({})", element.tag()), lost),
    }
    Ok(())
}

/// Bodies that move as given: those welded to the ground (or locked there), and floating bases: those with a free joint to the ground, in space
/// or in a plane.
pub fn assign_roles(
    bodies: &mut [BodyEntry],
    joints: &[JointEntry],
    coordinates: &[CoordinateEntry],
    notes: &mut Notes,
) {
    let locked = |name: &str| coordinates.iter().any(|c| c.name == name && c.locked);
    let mut given = vec![GROUND.to_owned()];
    let mut seen = 0;
    while seen < given.len() {
        let parent = given[seen].clone();
        seen += 1;
        for joint in joints.iter().filter(|joint| joint.parent == parent) {
            let mut moving = joint.rotations.iter().chain(&joint.translations).filter(|axis| !locked(&axis.coordinate));
            let still =
                joint.kind == JointEntryKind::Weld || (joint.kind == JointEntryKind::Axes && moving.next().is_none());
            let axes: Vec<&AxisEntry> = joint.rotations.iter().chain(&joint.translations).collect();
            let own: std::collections::HashSet<&str> = axes.iter().map(|axis| axis.coordinate.as_str()).collect();
            let is_free = axes.iter().all(|axis| axis.by.is_none()) && own.len() == axes.len();
            let freedoms = (joint.rotations.len(), joint.translations.len());
            let floats = parent == GROUND && is_free && [(3, 3), (1, 2)].contains(&freedoms);
            if (still || floats) && !given.contains(&joint.child) {
                given.push(joint.child.clone());
            }
            if floats && !still {
                let lost = "its joint to the ground is free: its role is \"given\", it moves as the motion file says and no residual forces are computed";
                notes.remark(&format!("body {}", joint.child), lost);
            }
        }
    }
    bodies.iter_mut().filter(|body| given.contains(&body.name)).for_each(|body| body.role = Role::Given);
}
