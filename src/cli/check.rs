//! `sinew check`: reports mistakes in files, with their locations.

use std::path::Path;
use std::sync::Arc;

use super::layout::wrapped;
use super::movement::load_lines;
use super::{BAD_INPUT, GOOD, print};
use crate::error::{Error, Issue, Result, SourceFile};
use crate::methods::inverse_dynamics::spatial::Movement;
use crate::model::Model;
use crate::model::file::ModelFile;
use crate::motion::MotionTable;
use crate::names::counted;
use crate::opensim;
use crate::plausibility;
use crate::skeleton::Skeleton;
use crate::skeleton::file::SkeletonFile;
use crate::study::{Study, load_model};
use crate::terminal;

pub fn check(files: &[std::path::PathBuf], model: Option<&Path>) -> Result<u8> {
    let model = match model {
        Some(path) => Some(load_model(&SourceFile::read(path)?)?.1),
        None => None,
    };
    let mut code = GOOD;
    for path in files {
        match check_one(path, model.as_ref()) {
            Ok(summary) => {
                let text = format!("{}: {summary}", path.display());
                text.lines().for_each(|line| print(&wrapped(line, "    ")));
            }
            Err(error) => {
                terminal::error(&format!("{:?}", miette::Report::new(error)));
                code = BAD_INPUT;
            }
        }
    }
    Ok(code)
}

fn check_one(path: &Path, model: Option<&Model>) -> Result<String> {
    match path.extension().and_then(|e| e.to_str()) {
        Some("csv" | "mot" | "sto") => {
            let Some(model) = model else {
                let file = SourceFile::read(path)?;
                return Err(file.error(
                    None,
                    format!("{}: a motion can only be checked against a model", path.display()),
                    "",
                    Some("add --model MODEL.toml, or check the study that uses this motion".to_owned()),
                ));
            };
            Ok(described_motion(&MotionTable::load(path, model)?, model))
        }
        Some("osim") => {
            let file = SourceFile::read(path)?;
            let imported = opensim::import(&file)?;
            let skeleton = imported.file.check().map_err(|issue| opensim::error(&file, &issue))?;
            let list = super::import::listed(&imported.notes);
            let list = if list.is_empty() { list } else { format!("\n{list}") };
            Ok(format!("OpenSim model, {}{list}", described(&skeleton)))
        }
        Some("toml") => {
            let file = SourceFile::read(path)?;
            let table: toml::Table = toml::from_str(&file.text).map_err(|e| file.toml_error(&e))?;
            if ["motion", "sweep", "base"].iter().any(|key| table.contains_key(*key)) {
                let study = Study::load(path)?;
                let motion = described_motion(&study.motion, &study.model);
                let warning = plausibility::of_motion(&study.motion, &study.model, &study.base);
                let warning = warning.map(|w| format!("\nwarning: {}: {}", w.code, w.found)).unwrap_or_default();
                let jobs = counted(study.jobs.len(), "job");
                Ok(format!("study, {jobs}\n{motion}{warning}{}{}", described_loads(&study), lost_of_model(&study)?))
            } else if SkeletonFile::is_spatial(&table) {
                Ok(described(&SkeletonFile::load(&file)?))
            } else {
                let (_, model) = ModelFile::load(&file)?;
                Ok(format!(
                    "model, {} bodies and {} muscles",
                    model.mechanics.bodies_and_joints().0,
                    model.muscles.len()
                ))
            }
        }
        _ => Err(Error::Table {
            action: "check",
            path: path.to_owned(),
            reason: "supported are studies and models (.toml), OpenSim models (.osim) and motions (.csv, .mot, .sto)"
                .to_owned(),
        }),
    }
}

fn described(model: &Skeleton) -> String {
    let (bodies, muscles) = (model.bodies.len(), model.muscles.len());
    let rigid = model.muscles.iter().filter(|muscle| muscle.rigid_tendon).map(|muscle| muscle.name.as_str());
    let rigid = rigid.collect::<Vec<_>>().join(", ");
    let rigid = if rigid.is_empty() { rigid } else { format!("; rigid tendons: {rigid}") };
    // Obstacles to a study are not mistakes: lengths and moment arms can still be computed.
    let obstacles = model.obstacles();
    let line = |issue: &Issue| format!("\n  {}: {}", issue.path.join("."), issue.message);
    let list = obstacles.iter().map(line).collect::<String>();
    let title = if list.is_empty() { "" } else { "\nNot usable in a study (only for lengths and moment arms):" };
    let moved = if list.is_empty() { drives(model) } else { String::new() };
    format!("spatial model, {bodies} bodies and {muscles} muscles{rigid}{title}{list}{moved}")
}

/// What remains to move, and what drives each coordinate.
fn drives(skeleton: &Skeleton) -> String {
    let model = Model::of_skeleton(Arc::new(skeleton.clone()));
    let counts: Vec<String> = (model.mechanics.driven_coordinates().iter().enumerate())
        .map(|(number, coordinate)| {
            let muscles = model.muscles.iter().filter(|muscle| muscle.path.slots().contains(&number)).count();
            let actuators = model.actuators.iter().filter(|own| own.coordinate == coordinate.name).count();
            let by = [(muscles, "muscle"), (actuators, "actuator")].into_iter().filter(|(count, _)| *count > 0);
            let by: Vec<String> = by.map(|(count, what)| counted(count, what)).collect();
            let by = if by.is_empty() { "nothing".to_owned() } else { by.join(", ") };
            format!("{} ({by})", coordinate.name)
        })
        .collect();
    let given = model.mechanics.given_coordinate_names();
    let of_kind = |wanted: &str| -> Vec<String> {
        let unmoved = model.mechanics.unmoved_coordinates().into_iter();
        unmoved.filter(|(_, why)| why.contains(wanted)).map(|(name, _)| name).collect()
    };
    let lines = [
        ("Moves by forces, driven by", counts),
        ("Moves as the motion file says", given),
        ("Locked", of_kind("locked")),
        ("Follows another coordinate", of_kind("follows")),
    ];
    let lines = lines.iter().filter(|(_, names)| !names.is_empty());
    lines.map(|(what, names)| format!("\n{what}: {}", names.join(", "))).collect()
}

/// Describes a motion: duration, sampling, and the range, largest rate and intended range of each coordinate.
fn described_motion(table: &MotionTable, model: &Model) -> String {
    let start = table.start();
    let mean = 1.0 / table.rate();
    let inside = table.time.iter().filter(|t| (table.window[0]..=table.window[1]).contains(*t)).count();
    let steps = table.time.windows(2).map(|pair| pair[1] - pair[0]);
    let (least, most) = steps.fold((f64::INFINITY, 0.0f64), |(low, high), step| (low.min(step), high.max(step)));
    let even = if most - least > 1e-3 * mean { format!(", steps of {least:.6} to {most:.6} s") } else { String::new() };
    let mut out = format!(
        "motion, {} at {} instants: {start} to {} s, {:.1} Hz{even}",
        counted(table.columns.len(), "coordinate"),
        inside,
        table.window[1],
        table.rate()
    );
    let angles = model.mechanics.joint_coordinates();
    let ranges = |name: &str| {
        let skeleton = &model.spatial()?.skeleton;
        skeleton.coordinates.iter().find(|coordinate| coordinate.name == name)?.range
    };
    for (name, values) in &table.columns {
        let is_angle = angles.iter().any(|(known, is_angle)| known == name && *is_angle);
        let (factor, unit) = if is_angle { (1f64.to_degrees(), "°") } else { (1e3, " mm") };
        let (rate, [low, high]) = plausibility::rate_and_range(&table.time, values);
        let intended = ranges(name)
            .map(|[low, high]| format!(" (range in the model: {:.1} to {:.1}{unit})", low * factor, high * factor));
        out.push_str(&format!(
            "\n  {name}: {:.1} to {:.1}{unit}, rate up to {:.1}{unit}/s{}",
            tenths(low * factor),
            tenths(high * factor),
            tenths(rate * factor),
            intended.unwrap_or_default()
        ));
    }
    table.notes.iter().for_each(|note| out.push_str(&format!("\nnote: {note}")));
    out
}

/// What external loads amount to, and whether one acts on a body that moves fast under it.
fn described_loads(study: &Study) -> String {
    let (Some(spatial), Some(loads)) = (study.model.spatial(), &study.motion.loads) else { return String::new() };
    let [from, to] = study.motion.window;
    let smoothing = study.base.smoothing_hz;
    let movement = Movement::new(&spatial.skeleton, &study.motion, Some(loads), &(from..=to), smoothing);
    load_lines(&movement).into_iter().map(|line| format!("\n{line}")).collect()
}

/// Rounds to tenths; a zero has no sign.
fn tenths(value: f64) -> f64 {
    (10.0 * value).round() / 10.0 + 0.0
}

/// Lists what is lost from the model of a study if it is an OpenSim model; empty otherwise.
fn lost_of_model(study: &Study) -> Result<String> {
    let source = &study.sources.model;
    if !opensim::is_osim(source) {
        return Ok(String::new());
    }
    let notes = opensim::import(source)?.notes;
    if notes.is_empty() {
        return Ok(String::new());
    }
    let list = super::import::listed(&notes);
    Ok(format!("\n{}:\n{list}", source.path.display()))
}
