//! What a model has and Sinew does not, by name or in one line a kind, with what that means.

use indexmap::IndexMap;

use super::document::Element;
use super::{Notes, Parts, Weight, muscles};

/// Kinds of force that stand among a model's components, beside muscles.
pub fn is_force(tag: &str) -> bool {
    ["Force", "Actuator", "Motor", "Ligament", "Muscle"].iter().any(|ending| tag.ends_with(ending))
        || tag.starts_with("Blankevoort")
}

/// Forces that are not muscles, in one line a kind.
pub fn forces<'d>(forces: impl Iterator<Item = Element<'d>>, notes: &mut Notes) {
    for (tag, names) in by_kind(forces) {
        notes.lost(&format!("{tag} {}", names.join(", ")), meaning(tag));
    }
}

/// What it means that a kind of force is not there.
fn meaning(tag: &str) -> &'static str {
    let has = |parts: &[&str]| parts.iter().any(|part| tag.contains(part));
    if has(&["HuntCrossley", "ElasticFoundation", "HalfSpace", "Contact", "Meyer"]) {
        "left out: there are no contact forces; the force of the ground must come with the motion, as a [[force]]"
    } else if has(&["Actuator", "Motor"]) {
        "left out: there are no reserve or residual actuators, the muscles alone make the motion"
    } else if tag == "ExternalForce" || tag == "PrescribedForce" {
        "left out: add a [[force]] with columns in the motion file, or the motion lacks it"
    } else if tag.contains("Muscle") {
        "left out: this kind of muscle is not supported; the other muscles make up for it"
    } else {
        "left out: this passive force is not supported; the muscles make up for it"
    }
}

/// The names of the elements of each tag.
fn by_kind<'d>(elements: impl Iterator<Item = Element<'d>>) -> IndexMap<&'d str, Vec<&'d str>> {
    let mut kinds: IndexMap<&str, Vec<&str>> = IndexMap::new();
    elements.for_each(|element| kinds.entry(element.tag()).or_default().push(element.name()));
    kinds
}

/// What else has no counterpart, in one line a kind.
pub fn others(model: Element<'_>, parts: &Parts<'_>, notes: &mut Notes) {
    for (set, weight, lost) in [
        ("ControllerSet", Weight::Remark, "left out: excitations are what a study finds"),
        ("ContactGeometrySet", Weight::Remark, "left out: without contact forces they do nothing"),
        ("ProbeSet", Weight::Remark, "left out: no influence on results"),
        ("MarkerSet", Weight::Remark, "left out: no influence on results"),
    ] {
        for (tag, names) in by_kind(parts.holders.iter().flat_map(|holder| holder.objects(&[set]))) {
            notes.add(&format!("{} {tag} of {set}", names.len()), lost, weight);
        }
    }
    for (tag, names) in by_kind(parts.others.iter().copied()) {
        let weight = if ["Marker", "Probe", "Frame", "Reporter"].iter().any(|kind| tag.contains(kind)) {
            Weight::Remark
        } else {
            Weight::Lost
        };
        notes.add(
            &format!("{} {tag} among the components", names.len()),
            "left out: this kind is not supported",
            weight,
        );
    }
    for (tag, names) in by_kind(parts.forces.iter().copied().filter(|force| muscles::is_muscle(*force))) {
        let lost = "curves of force over length, velocity and tendon strain are Sinew's: shape parameters, minimum activation and damping are ignored, so that forces at a given state differ";
        notes.changed(&format!("{} {tag}", names.len()), lost);
    }
    let ranges = model.descendants("Coordinate").filter(|c| c.flag("clamped", false)).count();
    if ranges > 0 {
        notes.remark(
            &format!("ranges of {ranges} clamped coordinate(s)"),
            "ignored: nothing holds a coordinate in its range",
        );
    }
}
