//! Reads muscles with their paths, and wrapping surfaces.

use super::document::Element;
use super::frames::{Frames, PlacedFrame};
use super::function::function_of;
use super::{Notes, Reader, paths};
use crate::curves::MillardParameters;
use crate::error::Result;
use crate::skeleton::file::{
    FollowsEntry, MovesEntry, MuscleEntry, ObstacleEntry, PointEntry, SurfaceEntry, SurfaceKind, WhenEntry,
};
use crate::skeleton::function::FunctionEntry;

/// Supported kinds of muscle by the start of their tag, each with its default time constants of activation and
/// deactivation, s.
const KINDS: [(&str, [f64; 2]); 6] = [
    ("Thelen2003Muscle", [0.015, 0.05]),
    ("Millard2012EquilibriumMuscle", [0.01, 0.04]),
    ("Millard2012AccelerationMuscle", [0.01, 0.04]),
    ("DeGrooteFregly2016Muscle", [0.015, 0.06]),
    ("Schutte1993Muscle", [0.0; 2]),
    ("RigidTendonMuscle", [0.0; 2]),
];

/// True if an element of the force set is a supported muscle.
pub fn is_muscle(element: Element<'_>) -> bool {
    KINDS.iter().any(|(kind, _)| element.tag().starts_with(kind))
}

/// Default maximum shortening velocity of all kinds, optimal fibre lengths per second.
const VELOCITY: f64 = 10.0;

/// Reads a muscle. Parameters that its file does not give have OpenSim's defaults.
///
/// # Errors
/// If it has no path, a body is unknown, or a number is not valid.
pub fn muscle<'d>(reader: &Reader<'d>, element: Element<'d>, notes: &mut Notes) -> Result<MuscleEntry> {
    let name = element.name();
    let number = |tags: &[&str]| reader.number(element, tags);
    let times = KINDS.iter().find(|(kind, _)| element.tag().starts_with(kind)).map_or([0.0; 2], |(_, times)| *times);
    let mut activation = number(&["activation_time_constant"])?.unwrap_or(times[0]);
    let mut deactivation = number(&["deactivation_time_constant"])?.unwrap_or(times[1]);
    let mut velocity = number(&["max_contraction_velocity", "Vmax"])?.unwrap_or(VELOCITY);
    if element.tag().starts_with("Schutte1993Muscle") {
        // ȧ = (u − a) (k1 u + k2) / T; the fibre shortens by at most its optimal length in T.
        let scale = number(&["time_scale"])?.unwrap_or(0.1);
        let (k1, k2) = (number(&["activation1"])?.unwrap_or(7.667), number(&["activation2"])?.unwrap_or(1.459854));
        (activation, deactivation, velocity) = (scale / (k1 + k2), scale / k2, 1.0 / scale);
    }
    let time = |time: f64| (time > 0.0).then_some(time);
    let flag = |tag: &str| reader.flag(element, tag, false);
    let mut or_default = |tag: &str, default: f64, unit: &str| -> Result<f64> {
        let found = number(&[tag])?;
        if found.is_none() {
            let lost = format!("no {tag}: {default} {unit}, OpenSim's default, is used");
            notes.changed(&format!("muscle {name}"), lost);
        }
        Ok(found.unwrap_or(default))
    };
    let tendon_slack_length = or_default("tendon_slack_length", 0.2, "m")?;
    let max_isometric_force = or_default("max_isometric_force", 1000.0, "N")?;
    let optimal_fibre_length = or_default("optimal_fiber_length", 0.1, "m")?;
    if tendon_slack_length == 0.0 {
        let lost = "its tendon slack length is 0: the tendon is rigid, and the fibre spans the whole path";
        notes.changed(&format!("muscle {name}"), lost);
    }
    let rigid = flag("ignore_tendon_compliance") || element.tag() == "RigidTendonMuscle" || tendon_slack_length == 0.0;
    for (tag, lost) in [
        ("ignore_activation_dynamics", "activation follows excitation with its time constants, not instantly"),
        ("ignore_passive_fiber_force", "the fibre has a passive force"),
    ] {
        if flag(tag) {
            notes.changed(&format!("muscle {name}"), format!("{tag} is ignored: {lost}"));
        }
    }
    let path = (element.either(&["GeometryPath"]))
        .or_else(|| Some(element).filter(|e| e.child("PathPointSet").is_some() || e.child("MusclePointSet").is_some()));
    let fitted = element.descendants("FunctionBasedPath").next();
    if path.is_none() && fitted.is_none() {
        let help = "give it a path with an origin and an insertion";
        return Err(element.error("the muscle has no <GeometryPath> and no <FunctionBasedPath>", help));
    }
    if path.is_none() {
        let lost = "it has a length, but no path: it is not drawn, and no loads of joints are given";
        notes.changed(&format!("muscle {name}"), lost);
    }
    let millard = millard(reader, element, notes)?;
    let points = path.map_or_else(Vec::new, |path| path.objects(&["PathPointSet", "MusclePointSet"]));
    Ok(MuscleEntry {
        name: name.to_owned(),
        max_isometric_force,
        optimal_fibre_length,
        tendon_slack_length,
        pennation_angle: number(&["pennation_angle_at_optimal", "pennation_angle"])?.unwrap_or(0.0),
        activation_time: time(activation),
        deactivation_time: time(deactivation),
        activation_steepness: number(&["activation_dynamics_smoothing"])?.filter(|b| *b > 0.0),
        damping: damping(reader, element)?,
        effort_weight: None,
        active_width: number(&["active_force_width_scale"])?.filter(|width| *width != 1.0),
        passive_strain: strain(reader, element, millard.map(|own| own.passive_strain_at_one), &PASSIVE_STRAINS)?,
        tendon_strain: strain(reader, element, millard.map(|own| own.tendon_strain_at_one), &TENDON_STRAINS)?,
        millard,
        max_shortening_velocity: Some(velocity),
        rigid_tendon: rigid.then_some(true),
        path: points.iter().map(|point| path_point(reader, *point, name, notes)).collect::<Result<_>>()?,
        length: fitted.map(|fitted| paths::length(fitted, name, notes)).transpose()?,
        surfaces: path.map_or_else(|| Ok(Vec::new()), |path| obstacles(path, points.len()))?,
    })
}

/// OpenSim's lower bound of activations.
const MIN_ACTIVATION: f64 = 0.01;

/// The lower bound of all activations: the least of all muscles.
pub fn min_activation(muscles: &[Element<'_>]) -> f64 {
    let own = |muscle: &Element<'_>| {
        let bound = |tag| muscle.text(tag).and_then(|text| text.trim().parse().ok());
        let found: Option<f64> = ["minimum_activation", "min_control"].into_iter().find_map(bound);
        found.filter(|least| (0.0..=0.5).contains(least)).unwrap_or(MIN_ACTIVATION)
    };
    muscles.iter().map(own).reduce(f64::min).unwrap_or(0.0)
}

/// The damping of the kinds that have one, with the default of the class.
fn damping<'d>(reader: &Reader<'d>, element: Element<'d>) -> Result<Option<f64>> {
    let default = if element.tag().starts_with("Millard2012Equilibrium") { 0.1 } else { 0.0 };
    let found = reader.number(element, &["fiber_damping"])?.unwrap_or(default);
    Ok((found != 0.0).then_some(found))
}

/// Tags of the strain of a fibre at a passive force of 1, and of a tendon at a force of 1.
const PASSIVE_STRAINS: [&str; 2] = ["passive_fiber_strain_at_one_norm_force", "FmaxMuscleStrain"];
const TENDON_STRAINS: [&str; 2] = ["tendon_strain_at_one_norm_force", "FmaxTendonStrain"];

/// A strain of De Groote's curves: that of Millard's, as Moco takes it, or of the file.
fn strain<'d>(
    reader: &Reader<'d>,
    element: Element<'d>,
    of_millard: Option<f64>,
    tags: &[&str],
) -> Result<Option<f64>> {
    let found = if of_millard.is_some() { of_millard } else { reader.number(element, tags)? };
    Ok(found.filter(|strain| *strain > 0.0))
}

/// The shape of Millard's curves.
fn millard<'d>(reader: &Reader<'d>, element: Element<'d>, notes: &mut Notes) -> Result<Option<MillardParameters>> {
    if !element.tag().starts_with("Millard2012") {
        return Ok(None);
    }
    let mut shape = MillardParameters::default();
    for (curve, tag, place) in [
        ("ActiveForceLengthCurve", "min_norm_active_fiber_length", &mut shape.min_active_length),
        ("ActiveForceLengthCurve", "transition_norm_fiber_length", &mut shape.transition_length),
        ("ActiveForceLengthCurve", "max_norm_active_fiber_length", &mut shape.max_active_length),
        ("ActiveForceLengthCurve", "shallow_ascending_slope", &mut shape.ascending_slope),
        ("ForceVelocityCurve", "isometric_slope", &mut shape.isometric_slope),
        ("ForceVelocityCurve", "concentric_slope_near_vmax", &mut shape.concentric_slope),
        ("ForceVelocityCurve", "eccentric_slope_near_vmax", &mut shape.eccentric_slope),
        ("ForceVelocityCurve", "max_eccentric_velocity_force_multiplier", &mut shape.eccentric_limit),
        ("FiberForceLengthCurve", "strain_at_zero_force", &mut shape.passive_strain_at_zero),
        ("FiberForceLengthCurve", "strain_at_one_norm_force", &mut shape.passive_strain_at_one),
        ("TendonForceLengthCurve", "strain_at_one_norm_force", &mut shape.tendon_strain_at_one),
    ] {
        let default = || reader.defaults.get(element.tag()).and_then(|default| default.child(curve));
        if let Some(curve) = element.child(curve).or_else(default)
            && let Some(number) = reader.number(curve, &[tag])?
        {
            *place = number;
        }
    }
    if shape.defect().is_some() {
        let lost = "the parameters of its Millard curves do not shape curves: the defaults are used";
        notes.changed(&format!("muscle {}", element.name()), lost);
        return Ok(None);
    }
    Ok(Some(shape))
}

/// Reads a point of a muscle's path: fixed, moving or conditional.
fn path_point<'d>(reader: &Reader<'d>, element: Element<'d>, muscle: &str, notes: &mut Notes) -> Result<PointEntry> {
    let Some(body) = element.reference("parent_frame", &["body"]) else {
        return Err(element.error("the path point has no body", "name the body in <socket_parent_frame>"));
    };
    let placed = reader.frames.find(element, body, muscle)?;
    let coordinate = |socket: &str| {
        let path = element.reference(socket, &[socket])?;
        path.rsplit('/').next().map(str::to_owned)
    };
    let mut entry = PointEntry {
        body: placed.body.to_owned(),
        point: [0.0; 3],
        moves: None,
        x: None,
        y: None,
        z: None,
        when: None,
    };
    let who = || format!("muscle {muscle}, point {}", element.name());
    match element.tag() {
        "MovingPathPoint" | "MovingMusclePoint" => {
            let mut components = Vec::new();
            for (tag, older, socket) in [
                ("x_location", "XAttachment", "x_coordinate"),
                ("y_location", "YAttachment", "y_coordinate"),
                ("z_location", "ZAttachment", "z_coordinate"),
            ] {
                let function = match function_of(element, tag)? {
                    Some(function) => Some(function),
                    None => function_of(element, older)?,
                };
                match (function, coordinate(socket)) {
                    (Some(by), Some(coordinate)) => components.push(FollowsEntry { coordinate, by }),
                    _ => {
                        notes.lost(&who(), format!("its {tag} has no supported function: 0 m is used"));
                        let by = FunctionEntry::Polynomial(vec![0.0]);
                        components.push(FollowsEntry { coordinate: String::new(), by });
                    }
                }
            }
            if placed.frame != crate::skeleton::frame::Frame::identity() {
                notes.lost(
                    &who(),
                    "it moves in an offset frame: its position is read as if it were in the frame of the body",
                );
            }
            set_moving(&mut entry, components);
        }
        tag => {
            let location = element.vector("location")?;
            if location.is_none() {
                notes.changed(&who(), "it has no location: 0 0 0, OpenSim's default, is used");
            }
            entry.point = placed.frame.point(&location.unwrap_or_default());
            if tag == "ConditionalPathPoint" || tag == "MuscleViaPoint" {
                let range = element.vector::<2>("range")?;
                match (coordinate("coordinate"), range) {
                    (Some(coordinate), Some(range)) => entry.when = Some(WhenEntry { coordinate, range }),
                    _ => notes.changed(&who(), "it has no coordinate or no range: the path always passes through it"),
                }
            }
        }
    }
    Ok(entry)
}

/// Sets the components of a moving point. If all are linear functions of at most one coordinate, they become a location
/// and a slope; otherwise each component keeps its function.
fn set_moving(entry: &mut PointEntry, components: Vec<FollowsEntry>) {
    let lines: Option<Vec<[f64; 2]>> =
        components.iter().map(|component| component.by.check(&[]).ok()?.line()).collect();
    let mut names: Vec<&String> = (components.iter().zip(lines.iter().flatten()))
        .filter(|(_, line)| line[1] != 0.0)
        .map(|(component, _)| &component.coordinate)
        .collect();
    names.dedup();
    if let (Some(lines), ..=1) = (&lines, names.len()) {
        entry.point = [0, 1, 2].map(|i| lines[i][0]);
        let slope = [0, 1, 2].map(|i| lines[i][1]);
        entry.moves = names.first().map(|name| MovesEntry { coordinate: (*name).clone(), slope });
        return;
    }
    let mut components = components.into_iter().map(Some);
    let mut next = || components.next().flatten().filter(|component| !component.coordinate.is_empty());
    (entry.x, entry.y, entry.z) = (next(), next(), next());
}

/// Surfaces of a path, each with the parts of the path that may wrap it. OpenSim counts points from 1; −1 is the first
/// or last point.
///
/// # Errors
/// If a wrap names no object, or its range is not valid.
fn obstacles(path: Element<'_>, points: usize) -> Result<Vec<ObstacleEntry>> {
    let wraps = path.objects(&["PathWrapSet", "MuscleWrapSet"]);
    let obstacle = |wrap: &Element<'_>| {
        let Some(name) = wrap.text("wrap_object") else {
            return Err(wrap.error("the wrap names no object", "name the object in <wrap_object>"));
        };
        let name = name.rsplit('/').next().unwrap_or(name).to_owned();
        let [first, last] = wrap.vector::<2>("range")?.unwrap_or([-1.0, -1.0]);
        let first = if first < 1.0 { 1 } else { first as usize };
        let last = if last < 1.0 { points } else { (last as usize).min(points) };
        if first >= last {
            return Err(wrap.error("the range covers no part of the path", "give two points in order, counted from 1"));
        }
        Ok(match (first, last) {
            (1, last) if last == points => ObstacleEntry::Any(name),
            (first, last) if last == first + 1 => ObstacleEntry::Part { name, part: first - 1 },
            (first, last) => ObstacleEntry::Parts { name, parts: [first - 1, last - 2] },
        })
    };
    wraps.iter().map(obstacle).collect()
}

/// Reads the wrapping surfaces of a body, or of a frame on a body.
///
/// # Errors
/// If the frame is unknown, or a number is not valid.
pub fn surfaces<'d>(frames: &Frames<'d>, owner: Element<'d>, notes: &mut Notes) -> Result<Vec<SurfaceEntry>> {
    let elements = owner.objects(&["WrapObjectSet"]);
    if elements.is_empty() {
        return Ok(Vec::new());
    }
    let placed = match owner.tag() {
        "Body" | "Ground" => PlacedFrame::on(if owner.tag() == "Ground" { "ground" } else { owner.name() }),
        _ => frames.find(owner, owner.name(), owner.name())?,
    };
    let mut found = Vec::new();
    for element in elements {
        let who = format!("wrapping object {}", element.name());
        if !element.flag("active", true) {
            notes.remark(&who, "left out: inactive in the model");
            continue;
        }
        let point = element.vector("translation")?.unwrap_or_default();
        let rotation = element.vector("xyz_body_rotation")?.unwrap_or_default();
        let placed = placed.within(point, rotation);
        let (point, rotation) = placed.point_and_rotation();
        let side = element.text("quadrant").unwrap_or("all").to_lowercase();
        let side = side.trim_start_matches('+');
        let mut surface = SurfaceEntry {
            name: element.name().to_owned(),
            kind: SurfaceKind::Sphere,
            body: placed.body.to_owned(),
            point,
            rotation,
            radius: element.number("radius")?,
            radii: None,
            ring_radius: None,
            side: (!["all", "unassigned", ""].contains(&side)).then(|| side.to_owned()),
            length: None,
        };
        match element.tag() {
            "WrapSphere" => {}
            "WrapCylinder" => {
                surface.kind = SurfaceKind::Cylinder;
                surface.length = element.number("length")?;
            }
            "WrapEllipsoid" => {
                surface.kind = SurfaceKind::Ellipsoid;
                (surface.radius, surface.radii) = (None, element.vector("dimensions")?);
            }
            "WrapTorus" => {
                surface.kind = SurfaceKind::Torus;
                (surface.radius, surface.ring_radius) =
                    (element.number("inner_radius")?, element.number("outer_radius")?);
            }
            other => {
                notes.lost(&who, format!("{other} is not supported: paths do not wrap it"));
                continue;
            }
        }
        if surface.kind == SurfaceKind::Cylinder && ["z", "-z"].contains(&side) {
            // A cylinder has no side along its axis. OpenSim takes the half beyond its middle.
            notes.lost(&who, format!("its quadrant {side} is ignored: paths take the shorter way around"));
            surface.side = None;
        }
        found.push(surface);
    }
    Ok(found)
}
