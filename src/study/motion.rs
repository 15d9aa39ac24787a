//! The motion of a study: its window, the loads that act with it, and whether the model can perform it.

use std::sync::Arc;

use super::file::StudyFile;
use super::sources::Sources;
use crate::deadline::Deadline;
use crate::error::{Result, SourceFile};
use crate::model::Model;
use crate::motion::{MeasurementError, MotionSettings, MotionTable};
use crate::settings::Settings;

/// Sets the window of the motion, and its loads.
///
/// # Errors
/// If the window is not within the motion, or the loads do not fit the model or do not cover it.
pub fn attach(sources: &Sources, file: &StudyFile, model: &Model, motion: &mut MotionTable) -> Result<()> {
    let refused = |key: &str, message: String, help: String| {
        Err(sources.study.error(sources.study.toml_span(&[key.to_owned()]), message, "here", Some(help)))
    };
    if let Some([from, to]) = file.window {
        let [first, last] = motion.span();
        if !(from < to && from >= first - ROUNDING && to <= last + ROUNDING) {
            let help = format!("choose a start and an end within the motion, {first} to {last} s");
            return refused("window", format!("found [{from}, {to}]"), help);
        }
        motion.window = [from.max(first), to.min(last)];
    }
    let Some(loads) = &sources.loads else {
        if file.force_smoothing_hz != 0.0 {
            let help = "name a file of loads, or remove the key".to_owned();
            return refused("force_smoothing_hz", "there are no `loads` to smooth".to_owned(), help);
        }
        return Ok(());
    };
    let Some(spatial) = model.spatial() else {
        let help = "give a planar model a `[[force]]`, or remove the key".to_owned();
        return refused("loads", "files of loads need a spatial model".to_owned(), help);
    };
    if !(file.force_smoothing_hz >= 0.0 && file.force_smoothing_hz.is_finite()) {
        let found = format!("found {}", file.force_smoothing_hz);
        return refused("force_smoothing_hz", found, "it must be a frequency in Hz, 0 for no filter".to_owned());
    }
    let (found, off) = loads.loads(&spatial.skeleton, file.force_smoothing_hz)?;
    if !off.is_empty() {
        motion.notes.push(format!("turned off in {}: {}", loads.file.path.display(), off.join(", ")));
    }
    let ([first, last], [from, to]) = (found.span, motion.window);
    if first > from + ROUNDING || last < to - ROUNDING {
        let table = loads.table.path.display();
        let message = format!("{table}: loads from {first} to {last} s, but the motion goes from {from} to {to} s");
        let [low, high] = [from.max(first), to.min(last)];
        let help = if low < high {
            format!("solve the part that both have: window = [{low}, {high}]")
        } else {
            "the two have no instants in common: check their columns of time".to_owned()
        };
        return refused("loads", message, help);
    }
    motion.loads = Some(Arc::new(found));
    Ok(())
}

/// Instants may be off the ends of a table by so much, s.
const ROUNDING: f64 = 1e-9;

/// Names and bodies of the loads that come with a motion.
pub fn external(motion: &MotionTable) -> Vec<(String, usize)> {
    let loads = motion.loads.iter().flat_map(|loads| &loads.loads);
    loads.map(|load| (load.name.clone(), load.body)).collect()
}

/// Hash of the motion and all that acts with it.
pub fn motion_hash(sources: &Sources, file: &StudyFile) -> String {
    let mut hasher = blake3::Hasher::new();
    hasher.update(sources.motion.text.as_bytes());
    if let Some(loads) = &sources.loads {
        hasher.update(loads.file.text.as_bytes());
        hasher.update(loads.table.text.as_bytes());
        hasher.update(&file.force_smoothing_hz.to_le_bytes());
    }
    file.window.iter().flatten().for_each(|end| {
        hasher.update(&end.to_le_bytes());
    });
    hasher.finalize().to_hex().to_string()
}

/// Refuses a motion without a column for each joint coordinate that must be measured. In a planar model these are all
/// of them, unless it has loops, where some follow from others. In a spatial model those without a column are at their
/// defaults, with a note; only a motion without any is refused.
pub fn check_coverage(model: &Model, motion: &mut MotionTable, file: &SourceFile) -> Result<()> {
    let needed = model.mechanics.needed_coordinates();
    let missing: Vec<&str> = needed.iter().copied().filter(|name| motion.column(name).is_none()).collect();
    if let Some(spatial) = model.spatial()
        && missing.len() < needed.len()
    {
        let coordinates = spatial.skeleton.coordinates.iter().filter(|c| c.is_independent());
        let without: Vec<&str> =
            coordinates.map(|c| c.name.as_str()).filter(|name| motion.column(name).is_none()).collect();
        if !without.is_empty() {
            motion.notes.push(format!("without a column, at their defaults: {}", without.join(", ")));
        }
        return Ok(());
    }
    if missing.is_empty() {
        return Ok(());
    }
    Err(file.error(
        None,
        format!("{}: no column for {}", file.path.display(), missing.join(", ")),
        "",
        Some(format!("the model `{}` needs a column for each of these joint coordinates", model.name)),
    ))
}

/// Number of instants at which the joints of a planar model are closed, to check that it can perform the motion.
const CLOSURE_CHECKS: usize = 101;

/// Largest distance (m) that a motion may leave between two points that the model holds together.
const LARGEST_GAP: f64 = 5e-3;

/// Refuses a motion that separates points that the model holds together, by more than measurement errors explain.
pub fn check_held_points(model: &Model, motion: &MotionTable, base: &Settings, file: &SourceFile) -> Result<()> {
    // The motion as in the file, without the study's changes to single coordinates.
    let plain = Settings { motion: Vec::new(), time_scale: 1.0, noise_sd: 0.0, ..base.clone() };
    let plain = plain.of_motion();
    let Some(spatial) = model.spatial() else {
        let plain = MotionSettings { measurement_ratio: 1, ..plain };
        let instants = motion.time.len().min(CLOSURE_CHECKS);
        return match plain.measure(motion, model, instants, Deadline::default()) {
            Err(moved @ MeasurementError::InconsistentMotion { .. }) => {
                let help =
                    "give only the coordinates that the loop leaves free, or values that close it (to 2° or 5 mm)";
                Err(file.error(None, format!("{}: {moved}", file.path.display()), "", Some(help.to_owned())))
            }
            // Joints that do not close here may close in the changed models; each job reports its own.
            _ => Ok(()),
        };
    };
    let measured = plain.joint_motion(motion, spatial);
    let [from, to] = motion.window;
    for &time in motion.time.iter().filter(|t| (from..=to).contains(*t)) {
        let Some((gap, name)) = measured.gap(time - motion.start()).filter(|(gap, _)| *gap > LARGEST_GAP) else {
            continue;
        };
        let help = format!(
            "change the coordinates of the two bodies so that the points meet (to {} mm); the model joins them",
            1e3 * LARGEST_GAP
        );
        return Err(file.error(
            None,
            format!("{}: at time {time} s the points of `{name}` are {:.1} mm apart", file.path.display(), 1e3 * gap),
            "",
            Some(help),
        ));
    }
    Ok(())
}
