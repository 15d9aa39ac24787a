//! Motion files: CSV, and OpenSim's `.mot`/`.sto` storage tables.
//!
//! One column is `time` (s), the others joint coordinates, in any order. CSV headers carry the unit as a
//! suffix (`elbow_angle_deg`, `elbow_angle_rad`, `slide_m`); lines that begin with `#` are comments. Storage files say
//! `inDegrees=yes|no` in their header, which ends with `endheader`. An external force that the model leaves to the motion has the columns
//! `<name>_x_n`, `<name>_y_n` and `<name>_z_n`.

use std::path::Path;

use crate::error::{Result, SourceFile};
use crate::model::Model;

/// Joint coordinates over time, in SI units (rad, m).
#[derive(Clone, Debug, PartialEq)]
pub struct MotionTable {
    /// s, increasing, at least two
    pub time: Vec<f64>,
    /// (name of the joint coordinate, one value per time)
    pub columns: Vec<(String, Vec<f64>)>,
    /// (name of the external force, its components in the ground's axes, N)
    pub forces: Vec<(String, [Vec<f64>; 3])>,
}

/// One row of text fields with its line number (from 1).
struct Row<'t> {
    line: usize,
    fields: Vec<&'t str>,
}

impl MotionTable {
    /// Reads a motion file for a model; the ending decides the format.
    ///
    /// # Errors
    /// A message with file and line if the header lacks `time`, a column is no coordinate of the model or has no
    /// unit, a field is missing or no finite number, or time does not increase.
    pub fn load(path: &Path, model: &Model) -> Result<Self> {
        Self::from_file(&SourceFile::read(path)?, model)
    }

    /// [`MotionTable::load`] of a file that is read already.
    pub fn from_file(file: &SourceFile, model: &Model) -> Result<Self> {
        let path = &file.path;
        let ending = path.extension().and_then(|e| e.to_str()).unwrap_or("");
        match ending {
            "csv" => Self::from_csv(file, model),
            "mot" | "sto" => Self::from_storage(file, model),
            _ => Err(file.error(
                None,
                format!("{}: unknown kind of motion file `.{ending}`", path.display()),
                "",
                Some("a motion is a .csv, .mot or .sto file".to_owned()),
            )),
        }
    }

    fn from_csv(file: &SourceFile, model: &Model) -> Result<Self> {
        let mut rows = Vec::new();
        // Spreadsheets put a byte order mark first.
        for (i, line) in file.text.trim_start_matches('\u{feff}').lines().enumerate() {
            if !line.trim().is_empty() && !line.starts_with('#') {
                rows.push(Row { line: i + 1, fields: line.split(',').map(str::trim).collect() });
            }
        }
        Self::assemble(file, model, rows, None)
    }

    fn from_storage(file: &SourceFile, model: &Model) -> Result<Self> {
        let mut in_degrees = None;
        let mut body = None;
        for (i, line) in file.text.lines().enumerate() {
            let line = line.trim();
            if line.eq_ignore_ascii_case("endheader") {
                body = Some(i + 1);
                break;
            }
            if let Some((key, value)) = line.split_once('=')
                && key.trim().eq_ignore_ascii_case("inDegrees")
            {
                in_degrees = match value.trim().to_ascii_lowercase().as_str() {
                    "yes" => Some(true),
                    "no" => Some(false),
                    other => {
                        return Err(file.error(
                            file.line_span(i + 1),
                            format!("inDegrees={other}"),
                            "here",
                            Some("write inDegrees=yes or inDegrees=no".to_owned()),
                        ));
                    }
                };
            }
        }
        let Some(body) = body else {
            return Err(file.error(
                file.line_span(1),
                "the header has no line `endheader`",
                "the header begins here",
                Some("an OpenSim storage file has a header that ends with the line `endheader`".to_owned()),
            ));
        };
        let Some(in_degrees) = in_degrees else {
            return Err(file.error(
                file.line_span(1),
                "the header does not say `inDegrees`",
                "the header begins here",
                Some("add the line inDegrees=yes or inDegrees=no above `endheader`".to_owned()),
            ));
        };
        let rows = file
            .text
            .lines()
            .enumerate()
            .skip(body)
            .filter(|(_, line)| !line.trim().is_empty())
            .map(|(i, line)| Row { line: i + 1, fields: line.split_whitespace().collect() })
            .collect();
        Self::assemble(file, model, rows, Some(in_degrees))
    }

    /// `in_degrees` is what a storage header says; a CSV header has a unit in each name.
    fn assemble(file: &SourceFile, model: &Model, rows: Vec<Row<'_>>, in_degrees: Option<bool>) -> Result<Self> {
        let Some((header, rows)) = rows.split_first() else {
            return Err(file.error(
                None,
                "the file holds no table",
                "",
                Some("the first row names the columns".into()),
            ));
        };
        let coordinates = model.joint_coordinates();
        let known: Vec<&str> = coordinates.iter().map(|(name, _)| *name).collect();
        let forces = model.measured_forces();
        // (column, force, axis)
        let mut force_columns: Vec<(usize, usize, usize)> = Vec::new();
        let mut time_column = None;
        let mut wanted: Vec<(usize, String, f64)> = Vec::new();
        for (index, field) in header.fields.iter().enumerate() {
            if *field == "time" || (in_degrees.is_none() && *field == "time_s") {
                time_column = Some(index);
                continue;
            }
            let of_force = |(k, force): (usize, &&str)| {
                let axis = field.strip_prefix(*force)?;
                Some((k, ["_x_n", "_y_n", "_z_n"].iter().position(|ending| *ending == axis)?))
            };
            if let Some((force, axis)) = forces.iter().enumerate().find_map(of_force) {
                force_columns.push((index, force, axis));
                continue;
            }
            let (name, unit) = match in_degrees {
                Some(_) => (*field, None),
                None => match field.rsplit_once('_') {
                    Some((name, unit @ ("deg" | "rad" | "m"))) => (name, Some(unit)),
                    _ => (*field, None),
                },
            };
            // OpenSim 4 writes /jointset/elbow/elbow_flexion/value.
            let short = name.trim_end_matches("/value").rsplit('/').next().unwrap_or(name);
            let Some(&(coordinate, angular)) = coordinates.iter().find(|(known, _)| *known == short) else {
                if in_degrees.is_some() {
                    continue; // storage files hold all coordinates of the subject: take those the model has
                }
                let near = crate::error::nearest(short, known.iter().copied());
                let near = near.map(|n| format!("did you mean `{n}`? ")).unwrap_or_default();
                return Err(file.error(
                    file.line_span(header.line),
                    format!("the column `{field}` is no joint coordinate of the model `{}`", model.name),
                    "in this header",
                    Some(format!("{near}the model has: {}{}", known.join(", "), forces_said(&forces))),
                ));
            };
            if wanted.iter().any(|(_, other, _)| other == coordinate) {
                return Err(file.error(
                    file.line_span(header.line),
                    format!("the joint coordinate `{coordinate}` has two columns"),
                    "in this header",
                    Some("remove one of them".to_owned()),
                ));
            }
            let factor = match (angular, in_degrees, unit) {
                (true, Some(true), _) | (true, None, Some("deg")) => std::f64::consts::PI / 180.0,
                (true, Some(false), _) | (true, None, Some("rad")) => 1.0,
                (false, Some(_), _) | (false, None, Some("m")) => 1.0,
                _ => {
                    let units = if angular { "_deg or _rad" } else { "_m" };
                    return Err(file.error(
                        file.line_span(header.line),
                        format!("the column `{field}` does not say its unit"),
                        "in this header",
                        Some(format!("name it `{coordinate}` with the ending {units}")),
                    ));
                }
            };
            wanted.push((index, coordinate.to_owned(), factor));
        }
        let Some(time_column) = time_column else {
            return Err(file.error(
                file.line_span(header.line),
                "there is no column `time`",
                "in this header",
                Some("name the column that holds the seconds `time`".to_owned()),
            ));
        };
        if wanted.is_empty() {
            return Err(file.error(
                file.line_span(header.line),
                format!("no column is a joint coordinate of the model `{}`", model.name),
                "in this header",
                Some(format!("the model has: {}", known.join(", "))),
            ));
        }
        let mut table = MotionTable {
            time: Vec::with_capacity(rows.len()),
            columns: wanted.iter().map(|(_, name, _)| (name.clone(), Vec::with_capacity(rows.len()))).collect(),
            forces: forces.iter().map(|name| ((*name).to_owned(), Default::default())).collect(),
        };
        for (k, force) in forces.iter().enumerate() {
            let there = force_columns.iter().filter(|(_, other, _)| *other == k).count();
            if there != 3 {
                return Err(file.error(
                    file.line_span(header.line),
                    format!("the external force `{force}` has {there} of its three columns"),
                    "in this header",
                    Some(format!(
                        "add {force}_x_n, {force}_y_n and {force}_z_n (newtons), or give the force in the model"
                    )),
                ));
            }
        }
        for row in rows {
            let bad = |message: String, help: &str| {
                Err(file.error(file.line_span(row.line), message, "in this row", Some(help.to_owned())))
            };
            if row.fields.len() != header.fields.len() {
                return bad(
                    format!("line {}: {} fields under {} columns", row.line, row.fields.len(), header.fields.len()),
                    "each row has one field per column",
                );
            }
            let number = |index: usize| row.fields[index].parse::<f64>().ok().filter(|v| v.is_finite());
            let Some(time) = number(time_column) else {
                return bad(
                    format!("line {}: `{}` is no finite number", row.line, row.fields[time_column]),
                    "time is in seconds",
                );
            };
            if table.time.last().is_some_and(|&last| last >= time) {
                return bad(
                    format!(
                        "line {}: time {time} s does not come after {} s",
                        row.line,
                        table.time[table.time.len() - 1]
                    ),
                    "sort the rows by time and remove repeated instants",
                );
            }
            table.time.push(time);
            for &(index, force, axis) in &force_columns {
                let Some(value) = number(index) else {
                    return bad(
                        format!("line {}: `{}` is no finite number", row.line, row.fields[index]),
                        "forces are in newtons",
                    );
                };
                table.forces[force].1[axis].push(value);
            }
            for ((index, _, factor), (name, values)) in wanted.iter().zip(&mut table.columns) {
                match number(*index) {
                    Some(value) => values.push(value * factor),
                    None => {
                        return bad(
                            format!(
                                "line {}: `{}` in column `{name}` is no finite number",
                                row.line, row.fields[*index]
                            ),
                            "fill gaps before: Sinew does not guess measurements",
                        );
                    }
                }
            }
        }
        if table.time.len() < 4 {
            return Err(file.error(
                file.line_span(header.line),
                format!("the table has {} row(s)", table.time.len()),
                "",
                Some("a motion needs at least four instants".to_owned()),
            ));
        }
        Ok(table)
    }

    /// Values of a joint coordinate, rad or m.
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        self.columns.iter().find(|(column, _)| column == name).map(|(_, values)| values.as_slice())
    }

    /// Components of an external force, N.
    pub fn force(&self, name: &str) -> Option<&[Vec<f64>; 3]> {
        self.forces.iter().find(|(force, _)| force == name).map(|(_, values)| values)
    }

    pub fn start(&self) -> f64 {
        self.time[0]
    }

    /// s
    pub fn duration(&self) -> f64 {
        self.time[self.time.len() - 1] - self.time[0]
    }
}

fn forces_said(forces: &[&str]) -> String {
    let columns = forces.iter().map(|force| format!("; of the force {force}: {force}_x_n, {force}_y_n, {force}_z_n"));
    columns.collect()
}
