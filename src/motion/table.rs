//! Motion files: CSV, and OpenSim's `.mot`/`.sto` storage tables.
//!
//! One column is `time` (s); the others are joint coordinates, in any order. CSV column names carry the unit as a
//! suffix (`elbow_angle_deg`, `elbow_angle_rad`, `slide_m`); lines that begin with `#` are comments. Storage files
//! declare `inDegrees=yes|no` in their header, which ends with `endheader`. An external force whose values come from
//! the motion has the columns `<name>_x_n`, `<name>_y_n` and `<name>_z_n`.

use std::path::Path;
use std::sync::Arc;

use super::external_loads::ExternalLoads;
use super::text::{Row, TextTable, at_line};
use crate::error::{Result, SourceFile, nearest};
use crate::model::Model;
use crate::names::counted;
use crate::skeleton::Skeleton;

/// Joint coordinates over time, in SI units (rad, m).
#[derive(Clone, Debug, PartialEq)]
pub struct MotionTable {
    /// Instants, s, increasing; at least four.
    pub time: Vec<f64>,
    /// (name of the joint coordinate, one value per instant)
    pub columns: Vec<(String, Vec<f64>)>,
    /// (name of the external force, its components in ground axes, N)
    pub forces: Vec<(String, [Vec<f64>; 3])>,
    /// Remarks on data that are ignored, missing or contradict the model.
    pub notes: Vec<String>,
    /// First and last instant of the part that is used, s; the whole table by default.
    pub window: [f64; 2],
    /// External loads on the bodies of a spatial model.
    pub loads: Option<Arc<ExternalLoads>>,
}

/// What a motion can hold of a model.
pub struct Wanted<'m> {
    name: &'m str,
    /// Joint coordinates, and whether each is an angle.
    coordinates: Vec<(&'m str, bool)>,
    /// External forces that the motion file must have.
    forces: Vec<&'m str>,
    /// Of a spatial model.
    skeleton: Option<&'m Skeleton>,
}

impl<'m> From<&'m Model> for Wanted<'m> {
    fn from(model: &'m Model) -> Self {
        let (mechanics, skeleton) = (&model.mechanics, model.spatial().map(|spatial| &*spatial.skeleton));
        let (coordinates, forces) = (mechanics.joint_coordinates(), mechanics.measured_forces());
        Self { name: &model.name, coordinates, forces, skeleton }
    }
}

impl<'m> From<&'m Skeleton> for Wanted<'m> {
    fn from(skeleton: &'m Skeleton) -> Self {
        let coordinates = skeleton.coordinates.iter().map(|c| (c.name.as_str(), c.is_angle)).collect();
        let forces = skeleton.forces.iter().filter(|force| force.force.is_none());
        let forces = forces.map(|force| force.name.as_str()).collect();
        Self { name: &skeleton.name, coordinates, forces, skeleton: Some(skeleton) }
    }
}

/// The meaning of a column.
enum MotionColumn {
    Time,
    /// Index of the force, and of its axis.
    Force(usize, usize),
    /// Name of the coordinate, and the factor to SI units.
    Coordinate(String, f64),
    Ignored,
}

impl MotionTable {
    /// Reads a motion file for a model; the file extension determines the format.
    ///
    /// # Errors
    /// If there is no column `time`, a column is not a joint coordinate of the model or has no unit, a field is
    /// missing or not a finite number, or time does not increase. The error names file and line.
    pub fn load<'m>(path: &Path, model: impl Into<Wanted<'m>>) -> Result<Self> {
        Self::from_file(&SourceFile::read(path)?, model)
    }

    /// As [`MotionTable::load`], for a file already read.
    pub fn from_file<'m>(file: &SourceFile, model: impl Into<Wanted<'m>>) -> Result<Self> {
        let ending = file.path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
        let refused = |message: String, help: &str| Err(file.error(None, message, "", Some(help.to_owned())));
        let name = file.path.display();
        let text = match ending.as_str() {
            "csv" => TextTable::csv(file)?,
            "mot" | "sto" => {
                let text = TextTable::storage(file)?;
                if text.in_degrees.is_none() {
                    let help = "add the line inDegrees=yes or inDegrees=no above `endheader`";
                    return Err(at_line(file, 1, "the header does not declare inDegrees", help));
                }
                text
            }
            "trc" | "c3d" => {
                let help =
                    "a motion holds joint coordinates: run inverse kinematics on the markers and use its .mot file";
                return refused(format!("{name}: a .{ending} file holds marker positions"), help);
            }
            _ => {
                return refused(
                    format!("{name}: unknown type of motion file `.{ending}`"),
                    "a motion is a .csv, .mot or .sto file",
                );
            }
        };
        Self::assemble(file, &model.into(), &text)
    }

    fn assemble(file: &SourceFile, model: &Wanted<'_>, text: &TextTable) -> Result<Self> {
        let columns: Vec<MotionColumn> =
            (text.names.iter()).map(|name| column_of(file, model, text, name)).collect::<Result<_>>()?;
        check_columns(file, model, text, &columns)?;
        let forces = &model.forces;
        let coordinates = columns.iter().filter_map(|column| match column {
            MotionColumn::Coordinate(name, _) => Some((name.clone(), Vec::with_capacity(text.rows.len()))),
            _ => None,
        });
        let mut table = MotionTable {
            time: Vec::with_capacity(text.rows.len()),
            columns: coordinates.collect(),
            forces: forces.iter().map(|name| ((*name).to_owned(), Default::default())).collect(),
            notes: text.notes.clone(),
            window: [0.0; 2],
            loads: None,
        };
        for row in &text.rows {
            table.add(file, row, &text.names, &columns)?;
        }
        if table.time.len() < 4 {
            let message = format!("the table has {}", counted(table.time.len(), "row"));
            return Err(text.error(file, message, "a motion needs at least four instants"));
        }
        table.window = table.span();
        table.notes.extend(gap(&table.time));
        table.notes.extend(contradictions(&table, model));
        Ok(table)
    }

    fn add(&mut self, file: &SourceFile, row: &Row, names: &[String], columns: &[MotionColumn]) -> Result<()> {
        let number = |index: usize, help: &str| {
            let field = &row.fields[index];
            field.parse::<f64>().ok().filter(|value| value.is_finite()).ok_or_else(|| {
                let message =
                    format!("line {}: `{field}` in column `{}` is not a finite number", row.line, names[index]);
                let comma = field.contains(',') && field.replace(',', ".").parse::<f64>().is_ok();
                at_line(
                    file,
                    row.line,
                    message,
                    if comma { "write decimals with a point: 0.25, not 0,25" } else { help },
                )
            })
        };
        let mut coordinate = 0;
        for (index, column) in columns.iter().enumerate() {
            match column {
                MotionColumn::Time => {
                    let time = number(index, "time is in seconds")?;
                    if let Some(last) = self.time.last().filter(|last| **last >= time) {
                        let message = format!("line {}: time {time} s is not later than {last} s", row.line);
                        return Err(at_line(
                            file,
                            row.line,
                            message,
                            "sort the rows by time and remove repeated instants",
                        ));
                    }
                    self.time.push(time);
                }
                MotionColumn::Force(force, axis) => {
                    self.forces[*force].1[*axis].push(number(index, "forces are in newtons")?)
                }
                MotionColumn::Coordinate(_, factor) => {
                    let value = number(index, "fill gaps beforehand: Sinew does not guess measurements")?;
                    self.columns[coordinate].1.push(value * factor);
                    coordinate += 1;
                }
                MotionColumn::Ignored => {}
            }
        }
        Ok(())
    }

    /// Values of a joint coordinate, rad or m.
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        self.columns.iter().find(|(column, _)| column == name).map(|(_, values)| values.as_slice())
    }

    /// Components of an external force, N.
    pub fn force(&self, name: &str) -> Option<&[Vec<f64>; 3]> {
        self.forces.iter().find(|(force, _)| force == name).map(|(_, values)| values)
    }

    /// The first instant that is used, s.
    pub fn start(&self) -> f64 {
        self.window[0]
    }

    /// Last minus first instant that is used, s.
    pub fn duration(&self) -> f64 {
        self.window[1] - self.window[0]
    }

    /// First and last instant of the whole table, s.
    pub fn span(&self) -> [f64; 2] {
        [self.time[0], self.time[self.time.len() - 1]]
    }

    /// Instants per second.
    pub fn rate(&self) -> f64 {
        let [first, last] = self.span();
        (self.time.len() - 1) as f64 / (last - first)
    }
}

/// The meaning of the column named `field`.
fn column_of(file: &SourceFile, model: &Wanted<'_>, text: &TextTable, field: &str) -> Result<MotionColumn> {
    let is_storage = text.in_degrees.is_some();
    if field == "time" || (!is_storage && field == "time_s") {
        return Ok(MotionColumn::Time);
    }
    let forces = &model.forces;
    let of_force = |(k, force): (usize, &&str)| {
        let axis = field.strip_prefix(*force)?;
        Some((k, ["_x_n", "_y_n", "_z_n"].iter().position(|ending| *ending == axis)?))
    };
    if let Some((force, axis)) = forces.iter().enumerate().find_map(of_force) {
        return Ok(MotionColumn::Force(force, axis));
    }
    let (name, unit) = match field.rsplit_once('_') {
        Some((name, unit @ ("deg" | "rad" | "m"))) if !is_storage => (name, Some(unit)),
        _ => (field, None),
    };
    // OpenSim 4 writes /jointset/elbow/elbow_flexion/value.
    let short = name.trim_end_matches("/value").rsplit('/').next().unwrap_or(name);
    let coordinates = &model.coordinates;
    let Some(&(coordinate, angular)) = coordinates.iter().find(|(known, _)| *known == short) else {
        if is_storage {
            return Ok(MotionColumn::Ignored); // storage files contain all coordinates of the subject
        }
        let known: Vec<&str> = coordinates.iter().map(|(name, _)| *name).collect();
        let near = nearest(short, known.iter().copied()).map(|n| format!("did you mean `{n}`? ")).unwrap_or_default();
        let message = format!("the column `{field}` is not a joint coordinate of the model `{}`", model.name);
        let help = format!("{near}the model has: {}{}", known.join(", "), force_columns(forces));
        return Err(text.error(file, message, &help));
    };
    let factor = match (angular, text.in_degrees, unit) {
        (true, Some(true), _) | (true, None, Some("deg")) => std::f64::consts::PI / 180.0,
        (true, Some(false), _) | (true, None, Some("rad")) => 1.0,
        (false, Some(_), _) | (false, None, Some("m")) => 1.0,
        _ => {
            let units = if angular { "_deg or _rad" } else { "_m" };
            let help = format!("append the unit to its name: `{coordinate}` followed by {units}");
            return Err(text.error(file, format!("the column `{field}` has no valid unit"), &help));
        }
    };
    Ok(MotionColumn::Coordinate(coordinate.to_owned(), factor))
}

/// Checks that there is one time column, at least one coordinate, no coordinate twice, and all three columns of each
/// force.
fn check_columns(file: &SourceFile, model: &Wanted<'_>, text: &TextTable, columns: &[MotionColumn]) -> Result<()> {
    let named = |wanted: &dyn Fn(&MotionColumn) -> bool| {
        let found = columns.iter().zip(&text.names).enumerate().filter(|(_, (column, _))| wanted(column));
        found.map(|(k, (_, name))| format!("{} (`{name}`)", k + 1)).collect::<Vec<String>>()
    };
    let times = named(&|column| matches!(column, MotionColumn::Time));
    if times.is_empty() {
        return Err(text.error(file, "there is no column `time`", "name the column of instants in seconds `time`"));
    }
    if times.len() > 1 {
        let message = format!("several columns hold the time: {}", times.join(" and "));
        return Err(text.error(file, message, "keep the one in seconds"));
    }
    let coordinates = &model.coordinates;
    let mut has_coordinate = false;
    for (coordinate, _) in coordinates {
        let own = named(&|column| matches!(column, MotionColumn::Coordinate(name, _) if name == coordinate));
        has_coordinate |= !own.is_empty();
        if own.len() > 1 {
            let message = format!("the joint coordinate `{coordinate}` has {} columns: {}", own.len(), own.join(", "));
            return Err(text.error(file, message, "keep one of them"));
        }
    }
    if !has_coordinate {
        let known: Vec<&str> = coordinates.iter().map(|(name, _)| *name).collect();
        let message = format!("no column is a joint coordinate of the model `{}`", model.name);
        return Err(text.error(file, message, &format!("the model has: {}", known.join(", "))));
    }
    for (k, force) in model.forces.iter().enumerate() {
        let present = named(&|column| matches!(column, MotionColumn::Force(own, _) if *own == k)).len();
        if present != 3 {
            let message = format!("the external force `{force}` has {present} of its three columns");
            let help =
                format!("add {force}_x_n, {force}_y_n and {force}_z_n (newtons), or specify the force in the model");
            return Err(text.error(file, message, &help));
        }
    }
    Ok(())
}

/// A step longer than this many median steps is a gap.
const GAP_STEPS: f64 = 5.0;

/// A remark on the longest step of a motion, if it is a gap.
fn gap(time: &[f64]) -> Option<String> {
    let steps: Vec<(f64, f64)> = time.windows(2).map(|pair| (pair[1] - pair[0], pair[0])).collect();
    let mut sorted: Vec<f64> = steps.iter().map(|step| step.0).collect();
    sorted.sort_by(f64::total_cmp);
    let median = sorted[sorted.len() / 2];
    let (longest, at) = steps.into_iter().max_by(|a, b| a.0.total_cmp(&b.0))?;
    (longest > GAP_STEPS * median).then(|| {
        format!(
            "there are no measurements between {at:.3} and {:.3} s ({:.0} times the median step): the motion is \
             interpolated there",
            at + longest,
            longest / median
        )
    })
}

/// A column that deviates from the model by more than this (rad, m) contradicts it.
const MAX_DEVIATION: f64 = 1e-3;

/// Remarks on columns that contradict the model: those of locked or dependent coordinates with other values.
fn contradictions(table: &MotionTable, model: &Wanted<'_>) -> Vec<String> {
    let Some(skeleton) = model.skeleton else { return Vec::new() };
    let mut notes = Vec::new();
    for coordinate in &skeleton.coordinates {
        let Some(values) = table.column(&coordinate.name) else { continue };
        let furthest = |own: &dyn Fn(usize) -> f64| {
            values.iter().enumerate().map(|(i, value)| (value - own(i)).abs()).fold(0.0, f64::max)
        };
        let shown = |x: f64| {
            if coordinate.is_angle { format!("{:.4}°", x.to_degrees()) } else { format!("{x:.4} m") }
        };
        let name = &coordinate.name;
        if coordinate.locked {
            let deviation = furthest(&|_| coordinate.default);
            if deviation > MAX_DEVIATION {
                let at = shown(coordinate.default);
                notes.push(format!(
                    "column `{name}` is ignored: the coordinate is locked at {at}, but the column deviates by up to {}",
                    shown(deviation)
                ));
            }
        } else if let Some((leader, function)) = &coordinate.follows {
            let leader = &skeleton.coordinates[*leader];
            let given = table.column(&leader.name);
            let deviation = furthest(&|i| function.at(given.map_or(leader.default, |values| values[i])));
            if deviation > MAX_DEVIATION {
                notes.push(format!(
                    "column `{name}` is ignored: the coordinate depends on `{}`, but the column deviates from \
                     it by up to {} (in another unit?)",
                    leader.name,
                    shown(deviation)
                ));
            }
        }
    }
    notes
}

/// The columns that each force needs, as part of a help text.
fn force_columns(forces: &[&str]) -> String {
    let columns = forces.iter().map(|force| format!("; for the force {force}: {force}_x_n, {force}_y_n, {force}_z_n"));
    columns.collect()
}
