//! Reads bodies, joints with their coordinates, and constraints.

use super::document::Element;
use super::frames::{Frames, PlacedFrame};
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

/// Mass of a body whose file gives none, kg. DEPARTURE: OpenSim 4 has no default.
const MASS: f64 = 1.0;

/// Reads a body.
///
/// # Errors
/// If a number is not valid.
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
        notes.changed(&format!("body {}", element.name()), format!("no mass is given: {MASS} kg is assumed"));
    }
    Ok(BodyEntry {
        name: element.name().to_owned(),
        mass: mass.unwrap_or(MASS),
        centre_of_mass: element.vector("mass_center")?.unwrap_or_default(),
        inertia,
        role: Role::Free,
    })
}

/// A joint element. Depending on the version, it is part of the joint set or of the body that it moves.
pub struct Found<'d> {
    pub element: Element<'d>,
    /// The enclosing body, if any.
    pub within: Option<&'d str>,
}

/// A joint that was read, with its coordinates.
pub struct ReadJoint {
    pub entry: JointEntry,
    pub coordinates: Vec<CoordinateEntry>,
}

/// Supported kinds of joint.
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

/// Checks that all joints are of a supported kind.
///
/// # Errors
/// One error that names all unsupported joints, located at the first.
pub fn check_kinds(joints: &[Found<'_>]) -> Result<()> {
    let unknown: Vec<&Found<'_>> = joints.iter().filter(|found| !KINDS.contains(&found.element.tag())).collect();
    let Some(first) = unknown.first() else { return Ok(()) };
    let name = |found: &&Found<'_>| format!("{} `{}`", found.element.tag(), found.element.name());
    let names = unknown.iter().map(name).collect::<Vec<_>>().join(", ");
    let help = format!("describe the motion by a supported kind of joint: {}", KINDS.join(", "));
    Err(first.element.error(format!("not supported: {names}"), &help))
}

/// Reads a joint and its coordinates. The kind must have passed [`check_kinds`].
///
/// # Errors
/// If a frame is missing or unknown, or a number is not valid.
pub fn joint<'d>(reader: &Reader<'d>, found: &Found<'d>, notes: &mut Notes) -> Result<ReadJoint> {
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
        ball: false,
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
                let lost = "the origin and direction of the winging axis are ignored: winging turns about the y-axis \
                            through the joint's origin";
                notes.changed(&format!("joint {name}"), lost);
            }
        }
        _ => unreachable!("`check_kinds` has passed all joints"),
    }
    if entry.kind == JointEntryKind::Axes && entry.rotations.is_empty() && entry.translations.is_empty() {
        entry.kind = JointEntryKind::Weld;
    }
    if element.flag("reverse", false) {
        let lost = "`reverse` is not supported: the motion of the joint differs from OpenSim's";
        notes.lost(&format!("joint {name}"), lost);
    }
    (entry.parent_point, entry.parent_rotation) = parent.point_and_rotation();
    (entry.child_point, entry.child_rotation) = child.point_and_rotation();
    let coordinates = complete(&entry, coordinates, notes);
    Ok(ReadJoint { entry, coordinates })
}

/// ReadJoint frames on the parent and on the child.
fn ends<'d>(frames: &Frames<'d>, found: &Found<'d>, name: &str) -> Result<(PlacedFrame<'d>, PlacedFrame<'d>)> {
    let element = found.element;
    let Some(within) = found.within else {
        let end = |socket: &str| {
            let path = element.reference(socket, &[]);
            let lacks = || element.error(format!("the joint has no {socket}"), "name the frame in its sockets");
            frames.find(element, path.ok_or_else(lacks)?, name)
        };
        return Ok((end("parent_frame")?, end("child_frame")?));
    };
    // Before version 4, the joint itself gives the points and rotations of its frames.
    let Some(parent) = element.text("parent_body") else {
        return Err(element.error("the joint has no <parent_body>", "name the parent body"));
    };
    let placed = |body: PlacedFrame<'d>, point: &str, rotation: &str| -> Result<PlacedFrame<'d>> {
        let point = element.vector(point)?.unwrap_or_default();
        Ok(PlacedFrame::at(body.body, point, element.vector(rotation)?.unwrap_or_default()))
    };
    let parent = placed(frames.find(element, parent, name)?, "location_in_parent", "orientation_in_parent")?;
    Ok((parent, placed(PlacedFrame::on(within), "location", "orientation")?))
}

/// Reads the coordinates of a joint.
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

/// The coordinates that the joint uses. Those that no element describes get a default of 0; those that the joint does
/// not use are dropped with a note.
fn complete(entry: &JointEntry, described: Vec<CoordinateEntry>, notes: &mut Notes) -> Vec<CoordinateEntry> {
    let axes = entry.rotations.iter().chain(&entry.translations).map(|axis| &axis.coordinate);
    let mut used: Vec<&String> = axes.chain(entry.coordinates.iter().flatten()).collect();
    let mut seen = std::collections::HashSet::new();
    used.retain(|name| seen.insert(name.as_str()));
    for unused in described.iter().filter(|coordinate| !seen.contains(coordinate.name.as_str())) {
        notes.remark(&format!("coordinate {}", unused.name), "left out: no joint uses it");
    }
    let new =
        |name: &String| CoordinateEntry { name: name.clone(), default: 0.0, locked: false, range: None, follows: None };
    let find = |name: &String| described.iter().find(|coordinate| coordinate.name == *name).cloned();
    used.into_iter().map(|name| find(name).unwrap_or_else(|| new(name))).collect()
}

/// Reads the axes of a custom joint: translations along axes of the parent's joint frame, then three rotations.
///
/// Constant parts go into the frames: a translation into the parent's; a rotation C is moved past the rotations after
/// it by C R(a, q) = R(C a, q) C, and then goes into the child's.
fn custom<'d>(
    element: Element<'d>,
    entry: &mut JointEntry,
    (parent, child): (&mut PlacedFrame<'d>, &mut PlacedFrame<'d>),
    notes: &mut Notes,
) -> Result<()> {
    let (rotations, translations) = transforms(element, notes)?;
    let mut constant: Frame<f64> = Frame::identity();
    for transform in &rotations {
        let axis = constant.point(&transform.axis);
        let (offset, moving) = transform.split();
        if offset != 0.0 {
            constant = constant * Frame::rotation(transform.axis, offset);
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
    if constant != Frame::identity() {
        *child = child.then(constant.inverse());
    }
    Ok(())
}

/// An axis of a custom joint, and the function (m or rad) of a coordinate that drives it.
struct Transform<'d> {
    axis: [f64; 3],
    coordinate: Option<&'d str>,
    function: FunctionEntry,
}

/// The part of a transform that is not constant: a coordinate, with the sign of the axis and a function (`None`: the
/// coordinate itself).
struct MovingAxis<'d> {
    coordinate: &'d str,
    sign: f64,
    by: Option<FunctionEntry>,
}

impl MovingAxis<'_> {
    fn along(self, axis: [f64; 3]) -> AxisEntry {
        AxisEntry { coordinate: self.coordinate.to_owned(), axis: axis.map(|x| self.sign * x), by: self.by }
    }
}

impl<'d> Transform<'d> {
    /// Splits the function into its constant and the rest, if there is a rest.
    fn split(&self) -> (f64, Option<MovingAxis<'d>>) {
        let coefficients = match &self.function {
            FunctionEntry::Polynomial(c) => c,
            by => {
                return (
                    0.0,
                    self.coordinate.map(|coordinate| MovingAxis { coordinate, sign: 1.0, by: Some(by.clone()) }),
                );
            }
        };
        let offset = coefficients.first().copied().unwrap_or(0.0);
        let moving = self.coordinate.and_then(|coordinate| match coefficients.get(1..).unwrap_or_default() {
            [] => None,
            slopes if slopes.iter().all(|x| *x == 0.0) => None,
            [sign] if sign.abs() == 1.0 => Some(MovingAxis { coordinate, sign: *sign, by: None }),
            slopes => {
                let by = FunctionEntry::Polynomial([&[0.0], slopes].concat());
                Some(MovingAxis { coordinate, sign: 1.0, by: Some(by) })
            }
        });
        (offset, moving)
    }
}

/// Rotations and translations of a custom joint, each in the order of the file.
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
            // Without a function, the coordinate itself drives the axis; without a coordinate, nothing does.
            (None, false, Some(_)) => FunctionEntry::Polynomial(vec![0.0, 1.0]),
            (None, false, None) => FunctionEntry::Polynomial(vec![0.0]),
            (None, true, _) => {
                let lost =
                    format!("the function of axis {} is of an unsupported kind: the axis does not move", axis.name());
                notes.lost(&format!("joint {}", element.name()), lost);
                FunctionEntry::Polynomial(vec![0.0])
            }
        };
        if names.next().is_some() {
            let lost = format!("axis {} is driven by several coordinates: only the first is used", axis.name());
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

/// Reads a constraint. A point constraint becomes a held point; a coordinate coupler makes a coordinate follow another.
/// Other kinds are noted as lost.
///
/// # Errors
/// If a point constraint names no body or an unknown one, or a number is not valid.
pub fn constraint<'d>(
    frames: &Frames<'d>,
    element: Element<'d>,
    coordinates: &mut [CoordinateEntry],
    held: &mut Vec<HeldPointEntry>,
    notes: &mut Notes,
) -> Result<()> {
    let name = format!("constraint {}", element.name());
    if !element.flag("isEnforced", true) || element.flag("isDisabled", false) {
        notes.remark(&name, "left out: disabled in the model");
        return Ok(());
    }
    let lost = "left out: this kind of constraint is not supported, so that the parts it connects can move apart";
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
                _ => notes.lost(&name, "left out: a coupler must relate two known coordinates by a supported function"),
            }
        }
        _ => notes.lost(&format!("{name} ({})", element.tag()), lost),
    }
    Ok(())
}

/// Gives the role "given" to bodies that are welded or locked to the ground, and to floating bases: bodies with a free
/// joint to the ground, in space or in a plane.
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
            let distinct: std::collections::HashSet<&str> = axes.iter().map(|axis| axis.coordinate.as_str()).collect();
            let is_free = axes.iter().all(|axis| axis.by.is_none()) && distinct.len() == axes.len();
            let axis_counts = (joint.rotations.len(), joint.translations.len());
            let floats = parent == GROUND && is_free && [(3, 3), (1, 2)].contains(&axis_counts);
            if (still || floats) && !given.contains(&joint.child) {
                given.push(joint.child.clone());
            }
            if floats && !still {
                let lost = "it has a free joint to the ground: its role is \"given\", so that it moves as the motion \
                            file says, and no residual forces are computed";
                notes.remark(&format!("body {}", joint.child), lost);
            }
        }
    }
    bodies.iter_mut().filter(|body| given.contains(&body.name)).for_each(|body| body.role = Role::Given);
}
