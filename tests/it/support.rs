//! Helpers for several tests: the shipped models, ad-hoc studies, temporary folders.

use std::path::{Path, PathBuf};

use rand::RngExt;
use sinew::internals::deadline::Deadline;
use sinew::internals::error::SourceFile;
use sinew::internals::methods::InverseProblem;
use sinew::internals::model::Model;
use sinew::internals::model::file::ModelFile;
use sinew::internals::motion::{Measurement, MotionTable};
use sinew::internals::prepare::{Prepared, Task};
use sinew::internals::problem::{ControlProblem, Kind};
use sinew::internals::settings::{Scheme, Settings};
use sinew::internals::study::Study;

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
    settings.of_motion().measure(table, model, points, Deadline::default()).unwrap()
}

/// A job before it is transcribed.
pub fn prepare<'m>(model: &'m Model, motion: &'m MotionTable, settings: &'m Settings, points: usize) -> Prepared<'m> {
    Prepared::new(Task { model, motion, settings, points }, Deadline::default()).unwrap()
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

/// The number of the muscle with this name.
pub fn muscle(model: &Model, name: &str) -> usize {
    model.muscles.iter().position(|muscle| muscle.name == name).unwrap()
}

/// Compares slopes and bends of all equations at z with differences, by the variables that `which` selects.
pub fn check_derivatives(
    control: &ControlProblem<'_>,
    z: &[f64],
    multipliers: &[f64],
    which: impl Fn(usize) -> bool,
    (slope_tolerance, bend_tolerance): (f64, f64),
) {
    let (nz, rows) = (control.variables(), control.rows());
    let slopes = |z: &[f64]| {
        let mut values = vec![0.0; control.slope_pattern().len()];
        control.slopes(z, &mut values);
        let mut dense = vec![0.0; rows * nz];
        let entries = control.slope_pattern().iter().zip(values);
        entries.for_each(|(&(row, variable), value)| dense[row * nz + variable] = value);
        dense
    };
    let exact = slopes(z);
    let mut bends = vec![0.0; control.bend_pattern().len()];
    control.bends(z, multipliers, &mut bends);
    let mut hessian = vec![0.0; nz * nz];
    for (&(i, j), value) in control.bend_pattern().iter().zip(bends) {
        (hessian[i * nz + j], hessian[j * nz + i]) = (value, value);
    }
    let is_given = |j: usize| control.quantity(control.read_of(j).quantity).kind == Kind::Given;
    for j in (0..nz).filter(|&j| which(j) && !is_given(j)) {
        let e = 1e-6;
        let at = |s: f64| {
            let mut y = z.to_vec();
            y[j] += s;
            let mut values = vec![0.0; rows];
            control.values(&y, &mut values);
            let slopes = slopes(&y);
            let gradient: Vec<f64> =
                (0..nz).map(|k| (0..rows).map(|i| multipliers[i] * slopes[i * nz + k]).sum()).collect();
            (values, gradient)
        };
        let ((up, gradient_up), (down, gradient_down)) = (at(e), at(-e));
        for i in 0..rows {
            let (slope, value) = ((up[i] - down[i]) / (2.0 * e), exact[i * nz + j]);
            assert!((slope - value).abs() < slope_tolerance * (1.0 + value.abs()), "{i} {j}: {slope} {value}");
        }
        for i in (0..nz).filter(|&i| !is_given(i)) {
            let (bend, value) = ((gradient_up[i] - gradient_down[i]) / (2.0 * e), hessian[i * nz + j]);
            assert!((bend - value).abs() < bend_tolerance * (1.0 + value.abs()), "{i} {j}: {bend} {value}");
        }
    }
}

/// Random variables at an instant, with muscles in their working range.
pub fn random_instant(inverse: &InverseProblem<'_>, rng: &mut impl rand::Rng) -> Vec<f64> {
    let mut z: Vec<f64> = (0..inverse.control.variables()).map(|_| rng.random_range(-0.5..0.5)).collect();
    let muscles = &inverse.muscles;
    for (span, range) in [(muscles.a, 0.02..1.0), (muscles.l, 0.6..1.3), (muscles.u, 0.0..1.0)] {
        span.range().for_each(|at| z[at] = rng.random_range(range.clone()));
    }
    z
}
