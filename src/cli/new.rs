//! `sinew new`: writes a commented, runnable study of the user's model and motion, or of the reference arm.

use std::path::{Path, PathBuf};

use super::{GOOD, print};
use crate::error::{Error, Result, SourceFile};
use crate::files::write_new;
use crate::model::Model;
use crate::motion::MotionTable;
use crate::names::counted;
use crate::study::{Study, load_model};

/// The reference arm and its motion, used if the user names no model.
const ARM: (&str, &str) = ("arm.toml", include_str!("../../data/models/arm.toml"));
const CURL: (&str, &str) = ("arm_curl.csv", include_str!("../../data/motions/arm_curl.csv"));

const OTHER_FILE: &str = "a different file with this name exists";

/// What the user names for a study.
pub struct Named {
    pub model: PathBuf,
    pub motion: PathBuf,
    pub loads: Option<PathBuf>,
    /// s
    pub window: Option<[f64; 2]>,
}

impl Named {
    /// The model, and the duration of the motion to solve, s.
    fn read(&self) -> Result<(Model, f64)> {
        let (_, model) = load_model(&SourceFile::read(&self.model)?)?;
        let motion = MotionTable::load(&self.motion, &model)?;
        let duration = self.window.map_or(motion.duration(), |[from, to]| to - from);
        Ok((model, duration))
    }
}

/// Writes `name`.toml; without `files`, also the reference arm and its motion beside it.
pub fn new(name: &str, files: Option<Named>) -> Result<u8> {
    let name = name.strip_suffix(".toml").unwrap_or(name);
    let path = PathBuf::from(format!("{name}.toml"));
    if path.exists() {
        return Err(Error::table("write", &path, "the file already exists; choose another name"));
    }
    let mut written = Vec::new();
    let study = written_study(name, &path, files, &mut written).inspect_err(|_| {
        // A study that cannot be loaded is removed, with what came with it.
        written.iter().for_each(|file| _ = std::fs::remove_file(file));
    })?;
    print(&format!(
        "{}: {} on {}; comments in the file explain each line",
        path.display(),
        counted(study.jobs.len(), "job"),
        study.sources.model.path.display()
    ));
    print(&format!("Next: sinew run {}", path.display()));
    Ok(GOOD)
}

/// Writes the study and loads it. `written` gets the files that did not exist before.
fn written_study(name: &str, path: &Path, files: Option<Named>, written: &mut Vec<PathBuf>) -> Result<Study> {
    let files = match files {
        Some(files) => files,
        None => {
            let (model, motion) = (beside(path, ARM, written)?, beside(path, CURL, written)?);
            Named { model, motion, loads: None, window: None }
        }
    };
    let text =
        if files.loads.is_some() { text_with_loads(name, path, &files)? } else { study_text(name, path, &files)? };
    write_new(path, &text, OTHER_FILE)?;
    written.push(path.to_owned());
    Study::load(path)
}

/// Writes a bundled file beside the study, unless it is already there with the same content.
fn beside(study: &Path, (name, text): (&str, &str), written: &mut Vec<PathBuf>) -> Result<PathBuf> {
    let path = study.with_file_name(name);
    if std::fs::read_to_string(&path).is_ok_and(|existing| existing == text) {
        return Ok(path);
    }
    write_new(&path, text, OTHER_FILE)?;
    written.push(path.clone());
    Ok(path)
}

/// A file as the study names it: relative to the study's folder, or absolute if it is elsewhere.
fn from_study(study: &Path, file: &Path) -> PathBuf {
    let folder = study.parent().filter(|folder| !folder.as_os_str().is_empty());
    match folder.map(|folder| file.strip_prefix(folder)) {
        None => file.to_owned(),
        Some(Ok(inside)) => inside.to_owned(),
        Some(Err(_)) => std::path::absolute(file).unwrap_or_else(|_| file.to_owned()),
    }
}

/// The text of the study: a mesh that fits the motion, and two axes.
fn study_text(name: &str, path: &Path, files: &Named) -> Result<String> {
    let Named { model: model_path, motion: motion_path, .. } = files;
    let (model, duration) = files.read()?;
    let is_spatial = model.spatial().is_some();
    let (min_intervals, max_h) = if is_spatial { (40, 0.025) } else { (10, 0.1) };
    let intervals = ((duration / max_h).round() as usize).clamp(min_intervals, MAX_INTERVALS);
    let h = duration / intervals as f64;
    // The README sweeps the biceps of the reference arm.
    let sweepable = || model.muscles.iter().filter(|muscle| muscle.name == "biceps").chain(&model.muscles);
    let muscle = sweepable().next().map_or("NAME", |muscle| muscle.name.as_str());
    let other = sweepable().map(|other| other.name.as_str()).find(|name| *name != muscle).unwrap_or("NAME");
    let coordinate = model.mechanics.joint_coordinates().into_iter().find(|(_, is_angle)| *is_angle);
    let coordinate = coordinate.map_or_else(|| "COORDINATE".to_owned(), |(name, _)| name.to_owned());
    let from_study = |file: &Path| quoted(&from_study(path, file).to_string_lossy());
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let scale = quoted(&format!("muscle.{muscle}.max_isometric_force_scale"));
    Ok(format!(
        r#"# A study: a model, a motion, and what to vary. To run it and look at the results:
#   sinew run {name}.toml
#   sinew report results/{stem}
name = {stem_quoted}
description = ""
model = {model_path}      # parameters that can be varied: sinew keys {model_shown}
motion = {motion_path}
{window}
# Values of all jobs. `sinew keys` lists all settings.
[base]
# Length of a mesh interval, s: {intervals} intervals in {duration} s. Halve it while jobs have the warning `mesh`.
h = {h}
bounds = "both_boxed"      # activations and excitations between 0 and 1
regularity = "optimum"     # rank test at the solution: is the answer unique?
trajectories = true        # store functions of time, for figures and `sinew export`

# Each combination of these values is a job.
[sweep.grid]
mu = [0.1, 0.2, 0.4]       # weight of the effort relative to tracking the motion
{scale} = [0.8, 1.0, 1.2]      # factor on a parameter of the model

# Other axes (remove the # and run again; solved jobs are kept):
# "muscle.*.tendon_slack_length_scale" = [0.97, 1.0, 1.03]      # all muscles together
# {offset} = [-5.0, 0.0, 5.0]

# A load ratio to report:
# [[ratio]]
# name = "my_ratio"
# numerator = {muscle_quoted}
# denominator = [{other_quoted}]      # one or several muscles; * stands for any characters
"#,
        stem_quoted = quoted(&stem),
        model_path = from_study(model_path),
        model_shown = model_path.display(),
        motion_path = from_study(motion_path),
        window = window_line(files.window),
        offset = quoted(&format!("motion.{coordinate}_offset_deg")),
        muscle_quoted = quoted(muscle),
        other_quoted = quoted(other),
    ))
}

fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

fn window_line(window: Option<[f64; 2]>) -> String {
    window.map_or_else(String::new, |[from, to]| format!("window = [{from}, {to}]      # part of the motion, s\n"))
}

/// Length of a mesh interval of a motion with external loads, s.
const INTERVAL: f64 = 0.045;

/// The text of a study in which all bodies move by forces, under external loads: one job, and axes to add.
fn text_with_loads(name: &str, path: &Path, files: &Named) -> Result<String> {
    let (model, duration) = files.read()?;
    let intervals = ((duration / INTERVAL).round() as usize).clamp(4, MAX_INTERVALS);
    let from_study = |file: &Path| quoted(&from_study(path, file).to_string_lossy());
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let muscle = model.muscles.first().map_or("NAME", |muscle| muscle.name.as_str());
    Ok(format!(
        r#"# A study: a model, a motion, what acts on it, and what to vary. To run it and look at the results:
#   sinew run {name}.toml
#   sinew report results/{stem}
name = {stem_quoted}
description = ""
model = {model}      # what moves, and what drives it: sinew check {model_shown}
motion = {motion}
loads = {loads}      # what the loads amount to: sinew check {name}.toml
force_smoothing_hz = 0.0      # cut-off of a low-pass filter of the loads, Hz; 0 for none
{window}
# Values of all jobs. `sinew keys` lists all settings.
[base]
"body.*.role" = "free"     # all bodies move by forces, the floating base too
intervals = {intervals}             # of the mesh; more of them while the job has the warning `mesh`
smoothing_hz = 6.0         # cut-off of the low-pass filter of the motion, Hz
bounds = "both_boxed"      # activations and excitations between 0 and 1
mu = 0.1                   # weight of the effort relative to tracking the motion
reserves = 1.0             # N m or N at each coordinate; those of the floating base are its residuals
regularity = "off"         # "optimum" tests whether the answer is unique, which takes long with many muscles
trajectories = true        # store functions of time: joint moments, contact loads and so on

# Each value is a job; remove the # and run again, solved jobs are kept:
# [sweep.grid]
# mu = [0.05, 0.1, 0.2]
# {scale} = [0.8, 1.0, 1.2]      # factor on a parameter of the model
"#,
        stem_quoted = quoted(&stem),
        model = from_study(&files.model),
        model_shown = files.model.display(),
        motion = from_study(&files.motion),
        loads = from_study(files.loads.as_deref().expect("there are loads")),
        window = window_line(files.window),
        scale = quoted(&format!("muscle.{muscle}.max_isometric_force_scale")),
    ))
}

/// Limits the mesh of a long motion, so that the first study runs quickly.
const MAX_INTERVALS: usize = 100;
