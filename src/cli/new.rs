//! `sinew new`: a commented study that runs, on a model and motion of the user's or on the reference arm.

use std::fs::OpenOptions;
use std::io::Write;
use std::path::{Path, PathBuf};

use super::{GOOD, print};
use crate::error::{Error, Result, SourceFile};
use crate::motion::MotionTable;
use crate::study::{Study, load_model};

/// The reference arm and its motion, for those who have no model at hand.
const ARM: (&str, &str) = ("arm.toml", include_str!("../../data/models/arm.toml"));
const CURL: (&str, &str) = ("arm_curl.csv", include_str!("../../data/motions/arm_curl.csv"));

/// Writes `name`.toml into this folder, with the arm beside it where the user names no model.
pub fn new(name: &str, files: Option<(PathBuf, PathBuf)>) -> Result<u8> {
    let name = name.strip_suffix(".toml").unwrap_or(name);
    let path = PathBuf::from(format!("{name}.toml"));
    if path.exists() {
        return Err(Error::table("write", &path, "there is such a file already; choose another name"));
    }
    let (model, motion) = match files {
        Some(files) => files,
        None => (beside(&path, ARM)?, beside(&path, CURL)?),
    };
    write_new(&path, &study_text(name, &path, &model, &motion)?)?;
    // What cannot run is not left behind.
    let study = Study::load(&path).inspect_err(|_| _ = std::fs::remove_file(&path))?;
    print(&format!(
        "{}: {} jobs on {}; its comments say what each line does",
        path.display(),
        study.jobs.len(),
        model.display()
    ));
    print(&format!("Next: sinew run {}", path.display()));
    Ok(GOOD)
}

/// Writes a file of ours beside the study; one of the same content may be there.
fn beside(study: &Path, (name, text): (&str, &str)) -> Result<PathBuf> {
    let path = study.with_file_name(name);
    if std::fs::read_to_string(&path).is_ok_and(|there| there == text) {
        return Ok(path);
    }
    write_new(&path, text)?;
    Ok(path)
}

fn write_new(path: &Path, text: &str) -> Result<()> {
    let mut file = OpenOptions::new().write(true).create_new(true).open(path).map_err(|e| match e.kind() {
        std::io::ErrorKind::AlreadyExists => Error::table("write", path, "there is another file of that name"),
        _ => Error::io("write", path, e),
    })?;
    file.write_all(text.as_bytes()).map_err(|e| Error::io("write", path, e))
}

/// The study's text: a mesh that fits the motion, and two axes to begin with.
fn study_text(name: &str, path: &Path, model_path: &Path, motion_path: &Path) -> Result<String> {
    let (_, model) = load_model(&SourceFile::read(model_path)?)?;
    let motion = MotionTable::load(motion_path, &model)?;
    let (duration, is_spatial) = (motion.duration(), model.spatial().is_some());
    let (fewest, longest) = if is_spatial { (20, 0.05) } else { (10, 0.1) };
    let intervals = ((duration / longest).round() as usize).clamp(fewest, MOST_INTERVALS);
    let h = duration / intervals as f64;
    let muscle = model.muscles.first().map_or("NAME", |muscle| muscle.name.as_str());
    let other = model.muscles.get(1).map_or("NAME", |muscle| muscle.name.as_str());
    let coordinate = model.joint_coordinates().into_iter().find(|(_, is_angle)| *is_angle);
    let coordinate = coordinate.map_or_else(|| "COORDINATE".to_owned(), |(name, _)| name.to_owned());
    let quoted = |text: &str| toml::Value::String(text.to_owned()).to_string();
    let from_study = |file: &Path| {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        let file = folder.and_then(|folder| file.strip_prefix(folder).ok()).unwrap_or(file);
        quoted(&file.to_string_lossy())
    };
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let scale = quoted(&format!("muscle.{muscle}.max_isometric_force_scale"));
    Ok(format!(
        r#"# A study: a model, a motion, and what to vary. Run it and look at the results:
#   sinew run {name}.toml
#   sinew report results/{stem}
name = {stem_quoted}
description = ""
model = {model_path}      # what can be varied: sinew keys {model_shown}
motion = {motion_path}

# What all jobs share. `sinew keys` lists all settings.
[base]
h = {h}      # length of an interval of the mesh, s: {intervals} of them in {duration} s
bounds = "both_boxed"      # activations and excitations between 0 and 1
regularity = "optimum"     # rank test at the solution: is the answer unique?
trajectories = true        # functions of time, for figures and `sinew export`

# Every combination is a job.
[sweep.grid]
mu = [0.1, 0.2, 0.4]       # weight of the effort against the tracking of the motion
{scale} = [0.8, 1.0, 1.2]      # a factor on a number of the model

# Other axes (remove the # and run again: jobs that are solved are kept):
# "muscle.*.tendon_slack_length_scale" = [0.97, 1.0, 1.03]      # of all muscles together
# {offset} = [-5.0, 0.0, 5.0]

# A ratio of loads to report:
# [[ratio]]
# name = "my_ratio"
# numerator = {muscle_quoted}
# denominator = [{other_quoted}]      # a muscle, or several; * stands for any letters
"#,
        stem_quoted = quoted(&stem),
        model_path = from_study(model_path),
        model_shown = model_path.display(),
        motion_path = from_study(motion_path),
        offset = quoted(&format!("motion.{coordinate}_offset_deg")),
        muscle_quoted = quoted(muscle),
        other_quoted = quoted(other),
    ))
}

/// A long motion on a fine mesh is not a first study.
const MOST_INTERVALS: usize = 100;
