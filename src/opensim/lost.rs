//! Notes what a model has and Sinew does not support, by name or in one line per kind, and what that means for results.

use crate::names::counted;
use indexmap::IndexMap;

use super::document::Element;
use super::{Notes, Parts, Weight, muscles};

/// True if a component of a model is a force, by its tag.
pub fn is_force(tag: &str) -> bool {
    ["Force", "Actuator", "Motor", "Ligament", "Muscle"].iter().any(|ending| tag.ends_with(ending))
        || tag.starts_with("Blankevoort")
}

/// Notes forces that are not muscles, in one line per kind.
pub fn forces<'d>(forces: impl Iterator<Item = Element<'d>>, notes: &mut Notes) {
    for (tag, names) in by_kind(forces) {
        notes.lost(&format!("{tag} {}", names.join(", ")), meaning(tag));
    }
}

/// What it means for results that a kind of force is left out.
fn meaning(tag: &str) -> &'static str {
    let has = |parts: &[&str]| parts.iter().any(|part| tag.contains(part));
    if has(&["HuntCrossley", "ElasticFoundation", "HalfSpace", "Contact", "Meyer"]) {
        "left out: contact forces are not supported; supply the ground reaction as `loads` of a study"
    } else if has(&["Actuator", "Motor"]) {
        "left out: this kind of actuator is not supported; the muscles alone produce the motion"
    } else if tag == "ExternalForce" || tag == "PrescribedForce" {
        "left out: supply it as `loads` of a study, or the force is missing"
    } else if tag.contains("Muscle") {
        "left out: this kind of muscle is not supported; the other muscles compensate for it"
    } else {
        "left out: this passive force is not supported; the muscles compensate for it"
    }
}

/// Names of the elements, grouped by tag.
fn by_kind<'d>(elements: impl Iterator<Item = Element<'d>>) -> IndexMap<&'d str, Vec<&'d str>> {
    let mut kinds: IndexMap<&str, Vec<&str>> = IndexMap::new();
    elements.for_each(|element| kinds.entry(element.tag()).or_default().push(element.name()));
    kinds
}

/// Notes everything else that has no counterpart, in one line per kind.
pub fn others(model: Element<'_>, parts: &Parts<'_>, notes: &mut Notes) {
    for (set, weight, lost) in [
        ("ControllerSet", Weight::Remark, "left out: a study computes the excitations itself"),
        ("ContactGeometrySet", Weight::Remark, "left out: no effect without contact forces"),
        ("ProbeSet", Weight::Remark, "left out: no effect on results"),
        ("MarkerSet", Weight::Remark, "left out: no effect on results"),
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
        let lost = if tag.starts_with("DeGrooteFregly2016") {
            continue;
        } else if tag.starts_with("Millard2012") {
            "they have the curves of De Groote et al. 2016, as in Moco; muscle_curves = \"millard_2012\" takes their own"
        } else {
            "they have the curves of De Groote et al. 2016, as in Moco, and not their own, so that forces at a given state \
             differ"
        };
        notes.changed(&format!("{} {tag}", names.len()), lost);
    }
    let ranges = model.descendants("Coordinate").filter(|c| c.flag("clamped", false)).count();
    if ranges > 0 {
        notes.remark(
            &format!("ranges of {}", counted(ranges, "clamped coordinate")),
            "ignored: coordinates may leave their range",
        );
    }
}
