//! `sinew show`: prints the tables of a results folder, using only the Parquet files.

pub mod jobs;
mod muscles;
mod ranks;
mod search;
mod summary;

use std::path::Path;

use super::arguments::{Format, Look};
use super::layout::wrapped;
use super::output::print_table;
use super::{GOOD, note, print};
use crate::error::{Error, Result};
use crate::run::folder;
use crate::run::manifest::Manifest;
use crate::study::axis::SAMPLE;
use crate::table1::groups;
use crate::tables::{self, Table, schema};
use crate::terminal::heading;

/// Number of jobs shown without `--all`.
const FIRST: usize = 24;

/// How much to show.
#[derive(Clone, Copy)]
pub struct Extent {
    /// Number of jobs, from the first.
    pub jobs: usize,
    /// All failures, rank tables and non-unique answers.
    pub all: bool,
    /// All columns.
    pub wide: bool,
}

/// The tables of a results folder that are shown.
pub struct Results {
    pub jobs: Table,
    pub regularity: Table,
    pub muscles: Table,
    /// Present if the study declares load ratios.
    pub ratios: Option<Table>,
    /// Names of the swept parameters.
    pub axes: Vec<String>,
    manifest: Manifest,
}

impl Results {
    /// # Errors
    /// If the folder holds no tables.
    pub fn read(dir: &Path) -> Result<Self> {
        let manifest = manifest(dir)?;
        for name in manifest.altered_files(dir) {
            note(&format!("warning: {} has changed since its manifest was written", dir.join(name).display()));
        }
        let read = |name: &'static str| tables::read(name, &folder::table(dir, name));
        let ratios = if folder::table(dir, "ratios").exists() { Some(read("ratios")?) } else { None };
        let jobs = read("jobs")?;
        let axes = schema::axes(&jobs);
        Ok(Self { axes, jobs, regularity: read("regularity")?, muscles: read("muscles")?, ratios, manifest })
    }

    /// A swept value of a job as text, shortened for a table.
    pub fn swept(&self, axis: &str, row: usize) -> String {
        jobs::short(&self.jobs.display(axis, row).unwrap_or_default())
    }

    /// A job's value of a text setting, swept or not.
    pub fn setting(&self, name: &str, row: usize) -> String {
        let base = || self.manifest.base.get(name).and_then(|value| value.as_str()).unwrap_or_default().to_owned();
        self.jobs.display(name, row).unwrap_or_else(base)
    }

    /// A job's number in the study.
    pub fn index(&self, row: usize) -> String {
        self.jobs.display("index", row).unwrap_or_default()
    }
}

fn manifest(dir: &Path) -> Result<Manifest> {
    let Some(manifest) = Manifest::read(dir)? else {
        let reason = "it has no manifest.json, so it is not a results folder; `sinew run STUDY` creates one";
        return Err(Error::table("show", dir, reason));
    };
    if !folder::table(dir, "jobs").exists() {
        let reason = "its run has not ended, so there are no tables yet; `sinew status` shows its progress, \
                      `sinew merge` writes tables of the finished jobs";
        return Err(Error::table("show", dir, reason));
    }
    Ok(manifest)
}

/// Prints one table in the requested format, or an overview of all tables.
pub fn show(dir: &Path, all: bool, table: Option<&str>, look: Look) -> Result<u8> {
    if look.format == Format::Table && table.is_none() {
        print_all(dir, all, look.wide)?;
        next_steps(dir);
        return Ok(GOOD);
    }
    let name = schema::named(table.unwrap_or("jobs")).map_err(|reason| Error::table("show", dir, reason))?;
    manifest(dir)?;
    print_table(&tables::read(name, &folder::table(dir, name))?, look)?;
    Ok(GOOD)
}

/// Prints the overview: failures, warnings, ranks, jobs, muscles.
pub fn print_all(dir: &Path, all: bool, wide: bool) -> Result<()> {
    let results = Results::read(dir)?;
    let count = results.jobs.rows();
    let extent = Extent { jobs: if all { count } else { FIRST.min(count) }, all, wide };
    summary::print(&results, dir, extent);
    let groups = groups(&results.jobs, &results.regularity, &results.axes);
    if !groups.is_empty() && results.axes.iter().any(|axis| axis == SAMPLE) {
        search::print(&groups);
    } else {
        ranks::print(&results, &groups, extent);
        jobs::print(&results, extent);
        muscles::print_forces(&results, extent);
        jobs::print_freedoms(&results, extent);
    }
    muscles::print_ratios(&results, extent);
    Ok(())
}

/// Prints which commands to use next, and the results folder in the last line.
fn next_steps(dir: &Path) {
    let folder = dir.display();
    print(&format!("\n{}", heading("Next")));
    let commands = [
        (format!("sinew report {folder}"), "a page of figures: loads, ranks, time courses"),
        ("sinew describe".to_owned(), "what each table and column means"),
    ];
    let longest = commands.iter().map(|(command, _)| command.chars().count()).max().unwrap_or(0);
    for (command, what) in commands {
        print(&wrapped(&format!("  {command:longest$}   {what}"), "      "));
    }
    print(&format!("Results: {folder}"));
}
