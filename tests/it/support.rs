//! Helpers for several tests: the shipped models, ad-hoc studies, temporary folders.

use std::path::{Path, PathBuf};

use sinew::deadline::Deadline;
use sinew::error::SourceFile;
use sinew::model::Model;
use sinew::model::file::ModelFile;
use sinew::motion::{Measurement, MotionTable};
use sinew::solve::motion_settings;
use sinew::study::Study;
use sinew::study::settings::{Scheme, Settings};
use sinew::transcription::instant::{Form, Instant};
use sinew::transcription::midpoint::Midpoint;

pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// A file of the folder next to the project, which does not exist on every machine.
pub fn shared(file: &str) -> Option<PathBuf> {
    let path = root().join("../shared").join(file);
    if !path.exists() {
        eprintln!("SKIPPED: {} is not there", path.display());
        return None;
    }
    Some(path)
}

pub fn model(name: &str) -> Model {
    let path = root().join("data/models").join(name);
    ModelFile::load(&SourceFile::read(&path).unwrap()).unwrap().1
}

pub fn motion(name: &str, model: &Model) -> MotionTable {
    MotionTable::load(&root().join("data/motions").join(name), model).unwrap()
}

/// A temporary folder with the given files, such as a study; their texts may contain {root}.
pub fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in files {
        let text = text.replace("{root}", root().to_str().unwrap());
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    folder
}

pub fn study(folder: &tempfile::TempDir) -> (PathBuf, Study) {
    let path = folder.path().join("study.toml");
    let study = Study::load(&path).unwrap_or_else(|e| panic!("{:?}", miette::Report::new(e)));
    (path, study)
}

/// Settings with h = 0.2, modified by `change`.
pub fn settings(change: impl FnOnce(&mut Settings)) -> Settings {
    let mut settings = Settings { h: 0.2, scheme: Scheme::Midpoint, ..Settings::default() };
    change(&mut settings);
    settings
}

/// The measurement for the given settings, on `points` collocation points.
pub fn measured(settings: &Settings, model: &Model, table: &MotionTable, points: usize) -> Measurement {
    motion_settings(settings).measure(table, model, points, Deadline::default()).unwrap()
}

/// Measurement and scheme of a motion on `points` points.
pub fn prepare<'m>(model: &'m Model, table: &MotionTable, points: usize) -> (Instant<'m>, Midpoint, Measurement) {
    let measurement = measured(&settings(|_| ()), model, table, points);
    let instant = Instant::new(model, Form::SecondOrder);
    let scheme = Midpoint::new(&instant, points, table.duration());
    (instant, scheme, measurement)
}

/// The study for tests of the engine: fast, with two axes.
pub const SMALL: &str = r#"
name = "small"
model = "{root}/data/models/arm.toml"
motion = "{root}/data/motions/arm_curl.csv"
[base]
h = 0.2
regularity = "optimum"
[sweep.grid]
mu = [0.1, 0.2, 0.4]
bounds = ["activation", "both"]
"#;
