//! Springs and soft limits at coordinates: CoordinateLimitForce and SpringGeneralizedForce.

use super::Reader;
use super::document::Element;
use crate::error::Result;
use crate::skeleton::file::SkeletonFile;
use crate::skeleton::passive::PassiveEntry;

/// Smallest width of a transition, rad or m: OpenSim's may be 0.
const LEAST_TRANSITION: f64 = 1e-3;

/// True if a force is a passive one at a coordinate.
pub fn is_passive(force: Element<'_>) -> bool {
    ["CoordinateLimitForce", "SpringGeneralizedForce"].contains(&force.tag()) && force.text("coordinate").is_some()
}

/// Reads one. Limits, stiffness and damping of an angle are in degrees in OpenSim.
///
/// # Errors
/// If a number is not valid.
pub fn passive<'d>(reader: &Reader<'d>, force: Element<'d>, file: &SkeletonFile) -> Result<PassiveEntry> {
    let name = force.text("coordinate").unwrap_or_default().trim();
    let coordinate = name.rsplit('/').next().unwrap_or(name).to_owned();
    let number = |tag: &str| reader.number(force, &[tag]).map(|number| number.unwrap_or(0.0));
    let mut entry = PassiveEntry {
        name: force.name().to_owned(),
        stiffness: 0.0,
        rest: 0.0,
        damping: 0.0,
        lower: None,
        upper: None,
        lower_stiffness: 0.0,
        upper_stiffness: 0.0,
        transition: LEAST_TRANSITION,
        limit_damping: 0.0,
        coordinate,
    };
    if force.tag() == "SpringGeneralizedForce" {
        entry.stiffness = number("stiffness")?;
        entry.rest = number("rest_length")?;
        entry.damping = number("viscosity")?;
        return Ok(entry);
    }
    let is_angle = file.joint.iter().any(|joint| {
        joint.rotations.iter().any(|axis| axis.coordinate == entry.coordinate)
            || joint.coordinates.iter().flatten().any(|own| *own == entry.coordinate)
    });
    let unit = if is_angle { 1f64.to_radians() } else { 1.0 };
    entry.lower = Some(number("lower_limit")? * unit);
    entry.upper = Some(number("upper_limit")? * unit);
    entry.lower_stiffness = number("lower_stiffness")? / unit;
    entry.upper_stiffness = number("upper_stiffness")? / unit;
    entry.transition = (number("transition")? * unit).max(LEAST_TRANSITION);
    entry.limit_damping = number("damping")? / unit;
    Ok(entry)
}
