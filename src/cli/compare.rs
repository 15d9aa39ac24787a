//! `sinew compare`: prints how results differ from a baseline.

use std::path::{Path, PathBuf};

use super::{FAILED_JOBS, GOOD, note, print};
use crate::compare::{Tolerance, Tolerances, accept, compare as compare_folders, verdict_text};
use crate::error::Result;
use crate::files::write_atomically;
use crate::run::manifest::Manifest;

/// Tolerances, files to write, and whether to accept the results as the baseline.
pub struct CompareOptions {
    pub tolerances: Vec<(String, Tolerance)>,
    pub json: Option<PathBuf>,
    pub junit: Option<PathBuf>,
    pub accept: bool,
}

/// Parses `COLUMN=TOLERANCE`.
pub fn tolerance(text: &str) -> std::result::Result<(String, Tolerance), String> {
    let (column, value) = text
        .split_once('=')
        .ok_or_else(|| format!("`{text}` does not have the form COLUMN=TOLERANCE, such as mean_force_n=1e-4"))?;
    Ok((column.to_owned(), Tolerance::parse(value)?))
}

pub fn compare(dir: &Path, baseline: &Path, options: &CompareOptions) -> Result<u8> {
    if options.accept && !baseline.join("jobs.parquet").exists() {
        return accepted(dir, baseline);
    }
    let tolerances = Tolerances::read(baseline, &options.tolerances)?;
    let comparison = compare_folders(dir, baseline, &tolerances)?;
    for warning in &comparison.warnings {
        note(&format!("warning: {warning}"));
    }
    for (name, verdict) in &comparison.jobs {
        if let Some((headline, lines)) = verdict_text(verdict) {
            print(&format!("{name}: {headline}"));
            lines.iter().for_each(|line| print(&format!("    {line}")));
        }
    }
    comparison.removed.iter().for_each(|gone| print(&format!("{gone} is in the baseline only")));
    let counts: Vec<String> = comparison.counts().iter().map(|(class, n)| format!("{n} {class}")).collect();
    print(&format!("{}: {}", if comparison.drifted() { "drift" } else { "no drift" }, counts.join(", ")));
    let write = |path: &Option<PathBuf>, text: &dyn Fn() -> Result<String>| match path {
        None => Ok(()),
        Some(path) => write_atomically(path, text()?),
    };
    let suite = Manifest::read(dir).ok().flatten().map_or_else(|| "sinew".to_owned(), |manifest| manifest.study.name);
    write(&options.json, &|| Ok(format!("{:#}\n", comparison.json())))?;
    write(&options.junit, &|| comparison.junit(&suite))?;
    match (options.accept, comparison.drifted()) {
        (true, _) => accepted(dir, baseline),
        (false, true) => Ok(FAILED_JOBS),
        (false, false) => Ok(GOOD),
    }
}

fn accepted(dir: &Path, baseline: &Path) -> Result<u8> {
    let names = accept(dir, baseline)?;
    print(&format!("accepted as the baseline in {}: {}", baseline.display(), names.join(", ")));
    Ok(GOOD)
}
