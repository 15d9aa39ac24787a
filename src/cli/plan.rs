//! `sinew plan`: what a study would do, and why.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use comfy_table::{Table, presets::NOTHING};

use super::show::wrapped;
use super::{GOOD, print};
use crate::error::Result;
use crate::run::default_folder;
use crate::run::reasons::{Reason, reasons};
use crate::study::Study;

const FIRST: usize = 20;

pub fn plan(path: &Path, out: Option<PathBuf>, all: bool) -> Result<u8> {
    let study = Study::load(path)?;
    let model = &study.model;
    print(&format!("{}: {} job(s)", study.name, study.jobs.len()));
    if !study.description.is_empty() {
        print(&study.description);
    }
    print(&format!(
        "model  {} ({} bodies, {} joints, {} muscles)",
        study.sources.model.path.display(),
        model.bodies(),
        model.joints(),
        model.muscles.len()
    ));
    print(&format!(
        "motion {} ({} instants, {} s)",
        study.sources.motion.path.display(),
        study.motion.time.len(),
        study.motion.duration()
    ));
    if study.repeated > 0 {
        print(&format!("{} repeated job(s) left out", study.repeated));
    }
    let out = out.unwrap_or_else(|| default_folder(&study));
    let reasons = reasons(&study, &out)?;
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    reasons.iter().for_each(|reason| *counts.entry(reason.class()).or_default() += 1);
    let counts: Vec<String> = counts.iter().map(|(class, count)| format!("{count} {class}")).collect();
    print(&format!("in {}: {}", out.display(), counts.join(", ")));
    print(&format!("a run solves {} of them", reasons.iter().filter(|reason| reason.runs()).count()));
    let has = |wanted: fn(&Reason) -> bool| reasons.iter().any(wanted);
    if has(|reason| matches!(reason, Reason::Failed(_))) {
        print("failed jobs are kept as they are; run with --failed to solve them again");
    }
    if has(|reason| matches!(reason, Reason::DoneBy(_))) {
        print("results of another solver are kept; run with --outdated to renew them");
    }

    let mut table = Table::new();
    table.load_preset(NOTHING);
    let axes = study.axes.iter().map(String::as_str);
    table.set_header(["job", "id"].into_iter().chain(axes).chain(["points", "why"]).map(wrapped));
    let shown = if all { study.jobs.len() } else { FIRST };
    for (job, reason) in study.jobs.iter().zip(&reasons).take(shown) {
        let swept = job.swept.iter().map(|value| value.as_ref().map_or("–".to_owned(), ToString::to_string));
        let end = [job.points.to_string(), reason.to_string()];
        table.add_row([job.index.to_string(), job.id.clone()].into_iter().chain(swept).chain(end));
    }
    print(&table.trim_fmt());
    if study.jobs.len() > shown {
        print(&format!("… and {} more (--all lists them)", study.jobs.len() - shown));
    }
    Ok(GOOD)
}
