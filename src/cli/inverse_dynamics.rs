//! `sinew inverse-dynamics`: net moments and forces of the joint coordinates of a spatial model over a motion.

use std::path::Path;

use super::arguments::InverseDynamics;
use super::layout::wrapped;
use super::output::{csv, write_table};
use super::{GOOD, print};
use crate::error::{Result, SourceFile};
use crate::methods::inverse_dynamics::{NetForces, inverse_dynamics};
use crate::motion::MotionTable;
use crate::motion::external_loads::{ExternalLoads, LoadEntry, LoadsFile};
use crate::names::counted;
use crate::opensim;
use crate::skeleton::Skeleton;
use crate::study::{is_spatial, load_skeleton};
use crate::tables::{Table, Values};

/// Instants may be off a window's ends by so much, s.
const ROUNDING: f64 = 1e-9;

pub fn run(arguments: &InverseDynamics) -> Result<u8> {
    let model = SourceFile::read(&arguments.model)?;
    if !is_spatial(&model) {
        let message = format!("{}: a planar model is not supported here", model.path.display());
        return Err(model.error(None, message, "", Some("inverse-dynamics needs a spatial model".to_owned())));
    }
    let (_, skeleton) = load_skeleton(&model)?;
    super::import::say_lost(&model)?;
    let motion = SourceFile::read(&arguments.motion)?;
    let table = MotionTable::from_file(&motion, &skeleton)?;
    let loads = arguments.loads.as_deref().map(|path| read_loads(path, &skeleton, arguments.force_smoothing));
    let loads = loads.transpose()?;
    let [from, to] = window(arguments, &motion, &table)?;
    if let (Some(loads), Some(path)) = (&loads, &arguments.loads) {
        let [first, last] = loads.span;
        if first > from + ROUNDING || last < to - ROUNDING {
            let message = format!(
                "{}: the loads are known from {first} to {last} s, the motion goes from {from} to {to} s",
                path.display()
            );
            let help = format!("choose instants that both have: --window {} {}", from.max(first), to.min(last));
            return Err(SourceFile::read(path)?.error(None, message, "", Some(help)));
        }
    }
    let window = from - ROUNDING..=to + ROUNDING;
    let found = inverse_dynamics(&skeleton, &table, loads.as_ref(), window, arguments.smoothing);
    let out = table_of(&skeleton, &found);
    match &arguments.out {
        None => print(csv(&out)?.trim_end()),
        Some(path) => {
            write_table(&out, vec![("sinew.model".to_owned(), skeleton.name.clone())], path)?;
            summary(&skeleton, &table, loads.as_ref(), &found).iter().for_each(|line| print(&wrapped(line, "    ")));
            print(&format!("{}: {}", counted(found.time.len(), "instant"), path.display()));
        }
    }
    Ok(GOOD)
}

/// The window that was asked for, or the whole motion.
fn window(arguments: &InverseDynamics, file: &SourceFile, table: &MotionTable) -> Result<[f64; 2]> {
    let whole = [table.start(), table.start() + table.duration()];
    let Some(asked) = arguments.window.as_deref() else { return Ok(whole) };
    let [from, to] = [asked[0], asked[1]];
    let is_inside = whole[0] - ROUNDING <= from && from < to && to <= whole[1] + ROUNDING;
    if !is_inside {
        let message = format!("{}: the window {from} to {to} s is not within the motion", file.path.display());
        let help = format!("the motion goes from {} to {} s", whole[0], whole[1]);
        return Err(file.error(None, message, "", Some(help)));
    }
    Ok([from, to])
}

/// Loads from OpenSim's `.xml`, or our own `.toml`.
fn read_loads(path: &Path, skeleton: &Skeleton, smoothing_hz: f64) -> Result<ExternalLoads> {
    let file = SourceFile::read(path)?;
    let is_xml = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("xml"));
    let (entries, table) = if is_xml {
        opensim::external_loads::external_loads(&file)?
    } else {
        let loads: LoadsFile = toml::from_str(&file.text).map_err(|e| file.toml_error(&e))?;
        let mut starts = file.text.match_indices("[[external_load]]").map(|(at, text)| at..at + text.len());
        let placed = |entry: LoadEntry| (entry, starts.next());
        (loads.external_load.into_iter().map(placed).collect(), loads.table)
    };
    let table = SourceFile::read(&path.parent().unwrap_or(Path::new(".")).join(table))?;
    ExternalLoads::new(&file, &entries, &table, skeleton, smoothing_hz)
}

fn table_of(skeleton: &Skeleton, found: &NetForces) -> Table {
    let mut columns = vec![("time_s".to_owned(), Values::Number(found.time.iter().map(|t| Some(*t)).collect()))];
    columns.extend(found.coordinates.iter().map(|(c, values)| {
        let coordinate = &skeleton.coordinates[*c];
        let name = format!("{}_{}", coordinate.name, if coordinate.is_angle { "moment_n_m" } else { "force_n" });
        (name, Values::Number(values.iter().map(|value| Some(*value)).collect()))
    }));
    Table { name: "inverse_dynamics", columns }
}

/// Notes on the motion, the peaks of the loads, and of the residuals: forces between the ground and the model, which
/// loads and accelerations that fit each other would leave at zero.
fn summary(skeleton: &Skeleton, table: &MotionTable, loads: Option<&ExternalLoads>, found: &NetForces) -> Vec<String> {
    let mut lines: Vec<String> = table.notes.iter().map(|note| format!("note: {note}")).collect();
    let without: Vec<&str> = (found.coordinates.iter().map(|(c, _)| skeleton.coordinates[*c].name.as_str()))
        .filter(|name| table.column(name).is_none())
        .collect();
    if !without.is_empty() {
        lines.push(format!("note: without a column in the motion, at their defaults: {}", without.join(", ")));
    }
    for (load, peak) in loads.iter().flat_map(|loads| &loads.loads).zip(&found.peaks) {
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
