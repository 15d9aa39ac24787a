//! `sinew moment-arms`: lengths and moment arms of all muscles of a spatial model in given poses.

use std::path::Path;

use super::output::{csv, write_table};
use super::{GOOD, print};
use crate::error::{Result, SourceFile, nearest};
use crate::motion::text::{Row, TextTable, at_line};
use crate::names::counted;
use crate::skeleton::Skeleton;
use crate::study::load_skeleton;
use crate::tables::{Table, Values};

pub fn moment_arms(model: &Path, poses: &Path, out: Option<&Path>) -> Result<u8> {
    let model = SourceFile::read(model)?;
    let (_, skeleton) = load_skeleton(&model)?;
    super::import::say_lost(&model)?;
    let poses = read_poses(&SourceFile::read(poses)?, &skeleton)?;
    let table = table(&skeleton, &poses);
    let metadata = vec![("sinew.model".to_owned(), skeleton.name.clone())];
    match out {
        None => print(csv(&table)?.trim_end()),
        Some(path) => {
            write_table(&table, metadata, path)?;
            print(&format!(
                "{}, {}: {}",
                counted(poses.len(), "pose"),
                counted(skeleton.muscles.len(), "muscle"),
                path.display()
            ));
        }
    }
    Ok(GOOD)
}

/// Reads the poses, each with the coordinates in the model's order. Coordinates without a column keep their default.
fn read_poses(file: &SourceFile, skeleton: &Skeleton) -> Result<Vec<Vec<f64>>> {
    let text = TextTable::csv(file)?;
    // (coordinate, factor to SI) of each column
    let mut columns: Vec<Option<(usize, f64)>> = Vec::new();
    for name in &text.names {
        let unit = [("_deg", 1f64.to_radians(), true), ("_rad", 1.0, true), ("_m", 1.0, false)];
        let found = unit.iter().find_map(|(ending, factor, is_angle)| {
            let index = skeleton.coordinate(name.strip_suffix(ending)?)?;
            (skeleton.coordinates[index].is_angle == *is_angle).then_some((index, *factor))
        });
        if found.is_none() && looks_like_a_coordinate(name) {
            let known: Vec<String> = skeleton.coordinates.iter().map(column).collect();
            let near = nearest(name, known.iter().map(String::as_str)).map(|n| format!("did you mean `{n}`? "));
            let help = format!("{}the model has: {}", near.unwrap_or_default(), known.join(", "));
            return Err(text.error(file, format!("`{name}` is not a coordinate of `{}`", skeleton.name), &help));
        }
        if let Some(before) = columns.iter().position(|own| found.is_some() && own.map(|c| c.0) == found.map(|c| c.0)) {
            let message = format!("`{}` and `{name}` are columns of the same coordinate", text.names[before]);
            return Err(text.error(file, message, "remove one of them"));
        }
        columns.push(found);
    }
    if columns.iter().all(Option::is_none) {
        return Err(text.error(file, "no column is a coordinate", "give columns names such as elbow_flexion_deg"));
    }
    if text.rows.is_empty() {
        return Err(text.error(file, "the file has no poses", "add a row for each pose below the column names"));
    }
    let pose = |row: &Row| {
        let mut pose = skeleton.default_pose();
        for ((field, column), name) in row.fields.iter().zip(&columns).zip(&text.names) {
            let Some((index, factor)) = column else { continue };
            match field.parse::<f64>() {
                Ok(value) if value.is_finite() => pose[*index] = value * factor,
                _ => {
                    let message = format!("line {}: `{field}` in column `{name}` is not a finite number", row.line);
                    return Err(at_line(file, row.line, message, "give a finite number"));
                }
            }
        }
        Ok(pose)
    };
    text.rows.iter().map(pose).collect()
}

/// True if a column name has a unit and is not one of the columns that this command writes itself.
fn looks_like_a_coordinate(name: &str) -> bool {
    let is_output = name == "length_m" || name.starts_with("moment_arm_") || name.starts_with("fd_");
    !is_output && ["_deg", "_rad", "_m"].iter().any(|ending| name.ends_with(ending))
}

fn column(coordinate: &crate::skeleton::Coordinate) -> String {
    format!("{}_{}", coordinate.name, if coordinate.is_angle { "deg" } else { "m" })
}

fn table(skeleton: &Skeleton, poses: &[Vec<f64>]) -> Table {
    let angles: Vec<usize> = (0..skeleton.coordinates.len()).filter(|&k| skeleton.coordinates[k].is_angle).collect();
    let (mut pose, mut muscle, mut length) = (Vec::new(), Vec::new(), Vec::new());
    let mut arms: Vec<Vec<Option<f64>>> = vec![Vec::new(); angles.len()];
    for (row, q) in poses.iter().enumerate() {
        for (found, own) in skeleton.lengths_and_moment_arms(q).into_iter().zip(&skeleton.muscles) {
            pose.push(Some(row as i64));
            muscle.push(Some(own.name.clone()));
            length.push(Some(found.0));
            angles.iter().zip(&mut arms).for_each(|(&k, column)| column.push(Some(found.1[k])));
        }
    }
    let mut columns = vec![
        ("pose".to_owned(), Values::Integer(pose)),
        ("muscle".to_owned(), Values::Text(muscle)),
        ("length_m".to_owned(), Values::Number(length)),
    ];
    let names = angles.iter().map(|&k| format!("moment_arm_{}_m", skeleton.coordinates[k].name));
    columns.extend(names.zip(arms.into_iter().map(Values::Number)));
    Table { name: "moment_arms", columns }
}
