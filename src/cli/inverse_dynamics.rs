//! `sinew inverse-dynamics`: net moments and forces of the joint coordinates of a spatial model over a motion.

use super::arguments::MovementArguments;
use super::layout::wrapped;
use super::movement::Files;
use super::output::{csv, write_table};
use super::{GOOD, print};
use crate::error::Result;
use crate::methods::inverse_dynamics::{NetForces, inverse_dynamics};
use crate::names::counted;
use crate::tables::{Table, Values};

pub fn run(arguments: &MovementArguments) -> Result<u8> {
    let files = Files::read(arguments)?;
    let movement = files.movement();
    let found = inverse_dynamics(&movement);
    let out = table(&files, &movement.time, &found);
    match &arguments.out {
        None => print(csv(&out)?.trim_end()),
        Some(path) => {
            write_table(&out, vec![("sinew.model".to_owned(), files.skeleton.name.clone())], path)?;
            let lines = files.notes().into_iter().chain(summary(&files, &found));
            lines.for_each(|line| print(&wrapped(&line, "    ")));
            print(&format!("{}: {}", counted(movement.time.len(), "instant"), path.display()));
        }
    }
    Ok(GOOD)
}

fn table(files: &Files, time: &[f64], found: &NetForces) -> Table {
    let numbers = |values: &[f64]| Values::Number(values.iter().map(|value| Some(*value)).collect());
    let mut columns = vec![("time_s".to_owned(), numbers(time))];
    columns.extend(found.coordinates.iter().map(|(c, values)| {
        let coordinate = &files.skeleton.coordinates[*c];
        let unit = if coordinate.is_angle { "moment_n_m" } else { "force_n" };
        (format!("{}_{unit}", coordinate.name), numbers(values))
    }));
    Table { name: "inverse_dynamics", columns }
}

/// The peaks of the loads, and of the residuals: forces between the ground and the model, which loads and accelerations
/// that fit each other would leave at zero.
fn summary(files: &Files, found: &NetForces) -> Vec<String> {
    let skeleton = &files.skeleton;
    let mut lines = Vec::new();
    for (load, peak) in files.loads.iter().flat_map(|loads| &loads.loads).zip(&found.peaks) {
        let body = &skeleton.bodies[load.body].name;
        lines.push(format!("load {} on {body}: vertical force up to {peak:.2} times the model's weight", load.name));
    }
    let roots = skeleton.joints.iter().filter(|joint| joint.parent.is_none());
    let of_ground: Vec<usize> = roots.flat_map(|joint| joint.motion.coordinates()).collect();
    let residuals = found.coordinates.iter().filter(|(c, _)| of_ground.contains(c));
    let peaks = residuals.map(|(c, values)| {
        let coordinate = &skeleton.coordinates[*c];
        let peak = values.iter().fold(0.0f64, |peak, value| peak.max(value.abs()));
        format!("{} {peak:.1} {}", coordinate.name, if coordinate.is_angle { "N m" } else { "N" })
    });
    let peaks: Vec<String> = peaks.collect();
    if !peaks.is_empty() {
        lines.push(format!("largest between model and ground beside the loads: {}", peaks.join(", ")));
    }
    lines
}
