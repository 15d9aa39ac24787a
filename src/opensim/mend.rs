//! Corrects what OpenSim accepts and Sinew does not: bodies without mass or inertia, repeated names, missing wrapping
//! surfaces and repeated path points. Each correction leaves a note.

use std::collections::HashSet;

use super::Notes;
use crate::names::counted;
use crate::skeleton::Role;
use crate::skeleton::file::{BodyEntry, SkeletonFile};

/// Mass given to a massless body that moves by forces, kg.
const SMALL_MASS: f64 = 0.01;
/// Radius of gyration about an axis without inertia, m.
const SMALL_RADIUS: f64 = 0.01;

/// Applies all corrections.
pub fn mend(file: &mut SkeletonFile, notes: &mut Notes) {
    let needed: Vec<bool> = file.body.iter().map(|body| needs_mass(file, &body.name)).collect();
    file.body.iter_mut().zip(needed).for_each(|(body, needs_mass)| mend_body(body, needs_mass, notes));
    make_unique("joint", file.joint.iter_mut().map(|joint| &mut joint.name), notes);
    make_unique("constraint", file.held_point.iter_mut().map(|held| &mut held.name), notes);
    make_unique("actuator", file.actuator.iter_mut().map(|actuator| &mut actuator.name), notes);
    make_unique("passive force", file.passive.iter_mut().map(|element| &mut element.name), notes);
    make_unique("muscle", file.muscle.iter_mut().map(|muscle| &mut muscle.name), notes);
    make_unique("wrapping object", file.surface.iter_mut().map(|surface| &mut surface.name), notes);
    let known: HashSet<&str> = file.surface.iter().map(|surface| surface.name.as_str()).collect();
    for muscle in &mut file.muscle {
        let who = format!("muscle {}", muscle.name);
        muscle.surfaces.retain(|obstacle| {
            let name = obstacle.surface();
            if !known.contains(name) {
                notes.lost(&who, format!("it does not wrap {name}: this surface was not imported"));
            }
            known.contains(name)
        });
        let before = muscle.path.len();
        // A path of two coincident points is left as it is: the check of the model reports it.
        let repeated: Vec<usize> =
            (1..before).filter(|&k| before > 2 && muscle.path[k].repeats(&muscle.path[k - 1])).collect();
        repeated.iter().rev().for_each(|&k| drop(muscle.path.remove(k)));
        muscle.surfaces.retain_mut(|obstacle| obstacle.renumber(&repeated));
        if muscle.path.len() < before {
            notes.remark(
                &who,
                format!("{} left out: they repeat the point before", counted(before - muscle.path.len(), "path point")),
            );
        }
    }
}

/// Makes names unique by appending a number to the second and later occurrences of a name.
fn make_unique<'f>(kind: &str, names: impl Iterator<Item = &'f mut String>, notes: &mut Notes) {
    let names: Vec<&mut String> = names.collect();
    // A new name must not be one that exists: references to that one must stay valid.
    let mut taken: HashSet<String> = names.iter().map(|name| name.to_string()).collect();
    let mut seen = HashSet::new();
    for name in names {
        if seen.insert(name.clone()) {
            continue;
        }
        let own = (2..)
            .map(|k| format!("{name}_{k}"))
            .find(|own| !taken.contains(own))
            .expect("there is always a free number");
        notes.remark(
            &format!("{kind} {name}"),
            format!("the name occurs more than once: this one is renamed to `{own}`"),
        );
        taken.insert(own.clone());
        *name = own;
    }
}

/// Whether a coordinate of a body's joint moves by forces, but nothing that has a mass beyond it.
fn needs_mass(file: &SkeletonFile, body: &str) -> bool {
    let Some(joint) = file.joint.iter().find(|joint| joint.child == body) else { return false };
    let of_axes = joint.translations.iter().chain(&joint.rotations).map(|axis| &axis.coordinate);
    let mut coordinates = of_axes.chain(joint.coordinates.iter().flatten());
    let is_free = |name: &String| {
        file.coordinate
            .iter()
            .any(|coordinate| coordinate.name == *name && !coordinate.locked && coordinate.follows.is_none())
    };
    coordinates.any(is_free) && !carries_mass(file, body, file.body.len())
}

/// Whether a body, or one of so many beyond it, has a mass.
fn carries_mass(file: &SkeletonFile, body: &str, depth: usize) -> bool {
    let own = file.body.iter().any(|own| own.name == body && own.mass > 0.0);
    let mut beyond = file.joint.iter().filter(|joint| joint.parent == body);
    own || (depth > 0 && beyond.any(|joint| carries_mass(file, &joint.child, depth - 1)))
}

/// Gives a body that moves by forces a small mass or inertia where it needs one and has none, and drops products of inertia that make
/// its inertia matrix indefinite.
fn mend_body(body: &mut BodyEntry, needs_mass: bool, notes: &mut Notes) {
    let who = format!("body {}", body.name);
    let massless = body.mass == 0.0;
    if massless && (body.role == Role::Given || !needs_mass) {
        body.inertia = [0.0; 6];
        return;
    }
    if massless {
        body.mass = SMALL_MASS;
    }
    // A negative mass or moment of inertia is a mistake: the check of the model reports it.
    if body.mass > 0.0 && !body.is_physical() && body.inertia[..3].iter().all(|&x| x >= 0.0) {
        let [xx, yy, zz, ..] = body.inertia;
        let small = body.mass * SMALL_RADIUS * SMALL_RADIUS;
        let own = [xx, yy, zz].map(|x| if x > 0.0 { x } else { small });
        let none = (0..3).filter(|&i| own[i] != body.inertia[i]).map(|i| ["x", "y", "z"][i]).collect::<Vec<_>>();
        if none.is_empty() {
            notes.changed(&who, "its inertia matrix is not positive definite: the products of inertia are ignored");
        } else if !massless {
            let about = none.join(", ");
            let lost = format!(
                "no inertia about {about}: {small:.1e} kg m² is assumed, which matters only if it rotates that way"
            );
            notes.changed(&who, lost);
        }
        body.inertia = [own[0], own[1], own[2], 0.0, 0.0, 0.0];
    }
    if massless {
        let least = body.inertia[..3].iter().fold(f64::INFINITY, |a, &b| a.min(b));
        notes.changed(
            &who,
            format!("no mass: {SMALL_MASS} kg and {least:.1e} kg m² are assumed, because it moves by forces"),
        );
    }
}
