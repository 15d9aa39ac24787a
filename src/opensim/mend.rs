//! What OpenSim lets pass and Sinew's models cannot have, mended with a note each.

use std::collections::HashSet;

use super::Notes;
use crate::skeleton::Role;
use crate::skeleton::file::{BodyEntry, SkeletonFile};

/// Mass of a massless body that moves by forces, kg, and the radius of gyration of one whose inertia is none, m.
const SMALL_MASS: f64 = 0.01;
const SMALL_RADIUS: f64 = 0.01;

pub fn mend(file: &mut SkeletonFile, notes: &mut Notes) {
    file.body.iter_mut().for_each(|body| mend_body(body, notes));
    distinguish("joint", file.joint.iter_mut().map(|joint| &mut joint.name), notes);
    distinguish("constraint", file.held_point.iter_mut().map(|held| &mut held.name), notes);
    distinguish("muscle", file.muscle.iter_mut().map(|muscle| &mut muscle.name), notes);
    distinguish("wrapping object", file.surface.iter_mut().map(|surface| &mut surface.name), notes);
    let known: HashSet<&str> = file.surface.iter().map(|surface| surface.name.as_str()).collect();
    for muscle in &mut file.muscle {
        let who = format!("muscle {}", muscle.name);
        muscle.surfaces.retain(|obstacle| {
            let name = obstacle.surface();
            if !known.contains(name) {
                notes.lost(&who, format!("it does not wrap {name}, which is not here"));
            }
            known.contains(name)
        });
        let before = muscle.path.len();
        // A path of two equal points is an error of its own.
        let repeated: Vec<usize> =
            (1..before).filter(|&k| before > 2 && muscle.path[k].repeats(&muscle.path[k - 1])).collect();
        repeated.iter().rev().for_each(|&k| drop(muscle.path.remove(k)));
        muscle.surfaces.retain_mut(|obstacle| obstacle.renumber(&repeated));
        if muscle.path.len() < before {
            notes.remark(
                &who,
                format!("{} point(s) of its path repeat the one before: left out", before - muscle.path.len()),
            );
        }
    }
}

/// Gives the second and later ones of a name a number.
fn distinguish<'f>(kind: &str, names: impl Iterator<Item = &'f mut String>, notes: &mut Notes) {
    let names: Vec<&mut String> = names.collect();
    // What refers to a name that is there must go on to find it.
    let mut taken: HashSet<String> = names.iter().map(|name| name.to_string()).collect();
    let mut seen = HashSet::new();
    for name in names {
        if seen.insert(name.clone()) {
            continue;
        }
        let own = (2..).map(|k| format!("{name}_{k}")).find(|own| !taken.contains(own)).expect("numbers do not end");
        notes.remark(&format!("{kind} {name}"), format!("the name occurs more than once; this one is `{own}`"));
        taken.insert(own.clone());
        *name = own;
    }
}

fn mend_body(body: &mut BodyEntry, notes: &mut Notes) {
    let who = format!("body {}", body.name);
    if body.role == Role::Given {
        // It moves as given, whatever its mass.
        if body.mass == 0.0 || !body.is_physical() {
            (body.mass, body.inertia) = (0.0, [0.0; 6]);
        }
        return;
    }
    let massless = body.mass == 0.0;
    if massless {
        body.mass = SMALL_MASS;
    }
    // A negative one is a mistake, not a lack.
    if body.mass > 0.0 && !body.is_physical() && body.inertia[..3].iter().all(|&x| x >= 0.0) {
        let [xx, yy, zz, ..] = body.inertia;
        let small = body.mass * SMALL_RADIUS * SMALL_RADIUS;
        let own = [xx, yy, zz].map(|x| if x > 0.0 { x } else { small });
        let none = (0..3).filter(|&i| own[i] != body.inertia[i]).map(|i| ["x", "y", "z"][i]).collect::<Vec<_>>();
        if none.is_empty() {
            notes.changed(&who, "its inertia makes no positive definite matrix: products of inertia are ignored");
        } else if !massless {
            let about = none.join(", ");
            let lost = format!(
                "no inertia about {about}: {small:.1e} kg m² is taken, which acts only where it turns that way"
            );
            notes.changed(&who, lost);
        }
        body.inertia = [own[0], own[1], own[2], 0.0, 0.0, 0.0];
    }
    if massless {
        let least = body.inertia[..3].iter().fold(f64::INFINITY, |a, &b| a.min(b));
        notes.changed(
            &who,
            format!("no mass: {SMALL_MASS} kg and {least:.1e} kg m² are taken, since it moves by forces"),
        );
    }
}
