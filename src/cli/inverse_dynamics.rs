//! `sinew inverse-dynamics`: net moments and forces of the joint coordinates over a motion.

use super::arguments::MovementArguments;
use super::movement::{Files, deliver, instants, load_lines, window};
use crate::error::{Result, SourceFile};
use crate::methods::inverse_dynamics::{NetForce, planar, spatial};
use crate::motion::MotionTable;
use crate::study::{is_spatial, load_model};
use crate::tables::{Table, Values};
use crate::terminal::note;

pub fn run(arguments: &MovementArguments) -> Result<u8> {
    let model = SourceFile::read(&arguments.model)?;
    if !is_spatial(&model) {
        return of_planar(arguments, &model);
    }
    let files = Files::read(arguments, &model)?;
    let movement = files.movement();
    let found = spatial::net_forces(&movement);
    written(arguments, &files.skeleton.name, load_lines(&movement), &movement.time, &found)
}

fn of_planar(arguments: &MovementArguments, file: &SourceFile) -> Result<u8> {
    let refused = |message: &str, help: &str| {
        Err(file.error(None, format!("{}: {message}", file.path.display()), "", Some(help.to_owned())))
    };
    if arguments.loads.is_some() || arguments.force_smoothing > 0.0 {
        return refused("the model is planar", "external loads need a spatial model");
    }
    let (_, model) = load_model(file)?;
    let motion = SourceFile::read(&arguments.motion)?;
    let table = MotionTable::from_file(&motion, &model)?;
    let instants = instants(window(arguments, &motion, &table)?);
    let time: Vec<f64> = table.time.iter().copied().filter(|t| instants.contains(t)).collect();
    table.notes.iter().for_each(|remark| note(&format!("note: {remark}")));
    let mechanism = model.planar().expect("a model is planar or spatial");
    match planar::net_forces(mechanism, &table, &time, arguments.smoothing) {
        Ok(found) => written(arguments, &model.name, Vec::new(), &time, &found),
        Err(why) => refused(&why, "net moments need joints that form a tree, and a column for each joint coordinate"),
    }
}

/// Prints the table, or writes it and prints `lines` and the residuals.
fn written(
    arguments: &MovementArguments,
    model: &str,
    mut lines: Vec<String>,
    time: &[f64],
    found: &[NetForce],
) -> Result<u8> {
    let numbers = |values: &[f64]| Values::Number(values.iter().map(|value| Some(*value)).collect());
    let mut columns = vec![("time_s".to_owned(), numbers(time))];
    columns.extend(found.iter().map(|own| {
        let unit = if own.is_angle { "moment_n_m" } else { "force_n" };
        (format!("{}_{unit}", own.coordinate), numbers(&own.values))
    }));
    let table = Table { name: "inverse_dynamics", columns };
    let residual = |own: &NetForce| {
        let peak = own.values.iter().fold(0.0f64, |peak, value| peak.max(value.abs()));
        format!("{} {peak:.1} {}", own.coordinate, if own.is_angle { "N m" } else { "N" })
    };
    let residuals: Vec<String> = found.iter().filter(|own| own.is_residual).map(residual).collect();
    if !residuals.is_empty() {
        lines.push(format!("residuals of the floating base up to: {}", residuals.join(", ")));
    }
    deliver(&table, model, arguments.out.as_deref(), &lines, time.len())
}
