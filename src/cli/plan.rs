//! `sinew plan`: lists the jobs of a study, and which of them a run would solve.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::arguments::{Format, Look};
use super::layout::{NOTHING_THERE, Sheet};
use super::output::print_table;
use super::{GOOD, print};
use crate::error::Result;
use crate::names::counted;
use crate::run::default_folder;
use crate::run::reasons::{Reason, reasons};
use crate::study::Study;
use crate::tables::{Table, Values};
use crate::terminal::heading;

/// Number of jobs listed without `--all`.
const FIRST: usize = 20;

pub fn plan(path: &Path, out: Option<PathBuf>, all: bool, look: Look) -> Result<u8> {
    let study = Study::load(path)?;
    let out = out.unwrap_or_else(|| default_folder(&study));
    let reasons = reasons(&study, &out)?;
    if look.format != Format::Table {
        print_table(&table(&study, &reasons), look)?;
        return Ok(GOOD);
    }
    print_summary(&study, &reasons, &out);
    let shown = if all { study.jobs.len() } else { FIRST.min(study.jobs.len()) };
    let jobs = &study.jobs[..shown];
    let mut sheet = Sheet::default();
    sheet.number("job", 0, jobs.iter().map(|job| job.index.to_string()).collect());
    for (axis, name) in study.axes.iter().enumerate() {
        let value = |value: &Option<_>| value.as_ref().map_or(NOTHING_THERE.to_owned(), ToString::to_string);
        sheet.text(name, 1, jobs.iter().map(|job| value(&job.swept[axis])).collect());
    }
    sheet.text("state", 0, reasons[..shown].iter().map(ToString::to_string).collect());
    sheet.number("points", 2, jobs.iter().map(|job| job.points.to_string()).collect());
    sheet.text("id", 3, jobs.iter().map(|job| job.id.clone()).collect());
    sheet.print(look.wide);
    if study.jobs.len() > shown {
        print(&format!("… and {} (--all lists them)", counted(study.jobs.len() - shown, "more job")));
    }
    Ok(GOOD)
}

fn print_summary(study: &Study, reasons: &[Reason], out: &Path) {
    let model = &study.model;
    print(&heading(&format!("{}: {}", study.name, counted(study.jobs.len(), "job"))));
    if !study.description.is_empty() {
        print(&study.description);
    }
    let ((bodies, joints), muscles) = (model.mechanics.bodies_and_joints(), model.muscles.len());
    let path = study.sources.model.path.display();
    print(&format!("model  {path} ({bodies} bodies, {joints} joints, {muscles} muscles)"));
    // Without what rounding leaves of a difference of times.
    let (instants, duration) = (study.motion.time.len(), (1e9 * study.motion.duration()).round() / 1e9);
    print(&format!("motion {} ({instants} instants, {duration} s)", study.sources.motion.path.display()));
    if study.repeated > 0 {
        print(&format!("{} repeated jobs omitted", study.repeated));
    }
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    reasons.iter().for_each(|reason| *counts.entry(reason.class()).or_default() += 1);
    let counts: Vec<String> = counts.iter().map(|(class, count)| format!("{count} {class}")).collect();
    print(&format!("in {}: {}", out.display(), counts.join(", ")));
    print(&format!("a run would solve {} of them", reasons.iter().filter(|reason| reason.runs()).count()));
    let has = |wanted: fn(&Reason) -> bool| reasons.iter().any(wanted);
    if has(|reason| matches!(reason, Reason::Failed(_))) {
        print("failed jobs are kept; run with --failed to solve them again");
    }
    if has(|reason| matches!(reason, Reason::DoneBy(_))) {
        print("results of another version of the solver are kept; run with --outdated to renew them");
    }
    print("");
}

/// All jobs with their swept values.
fn table(study: &Study, reasons: &[Reason]) -> Table {
    let jobs = &study.jobs;
    let mut columns = vec![
        ("job_id".to_owned(), Values::Text(jobs.iter().map(|job| Some(job.id.clone())).collect())),
        ("index".to_owned(), Values::Integer(jobs.iter().map(|job| Some(job.index as i64)).collect())),
    ];
    for (axis, name) in study.axes.iter().enumerate() {
        let value = |job: &crate::study::Job| job.swept[axis].as_ref().map(ToString::to_string);
        columns.push((name.clone(), Values::Text(jobs.iter().map(value).collect())));
    }
    columns.push(("points".to_owned(), Values::Integer(jobs.iter().map(|job| Some(job.points as i64)).collect())));
    columns.push(("state".to_owned(), Values::Text(reasons.iter().map(|reason| Some(reason.to_string())).collect())));
    Table { name: "plan", columns }
}
