//! The summary: number of jobs, failures with their reasons, and warnings.

use std::collections::BTreeMap;
use std::path::Path;

use super::{Extent, Results};
use crate::cli::layout::wrapped;
use crate::names::counted;
use crate::plausibility::WARNING_KINDS;
use crate::terminal::{heading, print as say, warning};

/// Number of failed jobs listed without `--all`.
const FAILURES: usize = 5;
/// Number of jobs listed with a warning.
const LISTED: usize = 8;

pub fn print(results: &Results, dir: &Path, extent: Extent) {
    let jobs = &results.jobs;
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for row in 0..jobs.rows() {
        *counts.entry(jobs.text("status", row).unwrap_or("?")).or_default() += 1;
    }
    let counts: Vec<String> = counts.iter().map(|(status, count)| format!("{count} {status}")).collect();
    say(&heading(&format!("{} finished: {}", counted(jobs.rows(), "job"), counts.join(", "))));
    failures(results, extent);
    warnings(results, dir);
}

/// Prints failed jobs with their reasons.
fn failures(results: &Results, extent: Extent) {
    let jobs = &results.jobs;
    let failed: Vec<usize> = (0..jobs.rows()).filter(|&row| jobs.text("error", row).is_some()).collect();
    let most = if extent.all { failed.len() } else { FAILURES };
    for &row in failed.iter().take(most) {
        let (status, error) = (jobs.text("status", row).unwrap_or("?"), jobs.text("error", row).unwrap_or_default());
        print_wrapped(&format!("job {}: {status}: {error}", results.index(row)));
    }
    if failed.len() > most {
        say(&format!("… and {} more failed jobs (--all shows them)", failed.len() - most));
    }
}

/// Prints the number of jobs with warnings, and for each kind the jobs, the limit and the remedy.
fn warnings(results: &Results, dir: &Path) {
    let jobs = &results.jobs;
    let mut by_code: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    let mut total = 0;
    for row in 0..jobs.rows() {
        let Some(codes) = jobs.text("warnings", row) else { continue };
        total += 1;
        codes.split(", ").for_each(|code| by_code.entry(code).or_default().push(row));
    }
    if total == 0 {
        return;
    }
    say(&warning(&format!("Warnings in {total} of {}", counted(jobs.rows(), "job"))));
    for (code, rows) in by_code {
        let is_in_all = rows.len() == jobs.rows() && rows.len() > LISTED;
        let mut listed: Vec<String> = rows.iter().take(LISTED).map(|&row| results.index(row)).collect();
        if rows.len() > LISTED {
            listed.push("…".to_owned());
        }
        let kind = WARNING_KINDS.iter().find(|kind| kind.code == code);
        let (limit, remedy) = kind.map_or(("", ""), |kind| (kind.limit, kind.remedy));
        let which = match is_in_all {
            true => "all jobs".to_owned(),
            false => format!("{} ({})", counted(rows.len(), "job"), listed.join(", ")),
        };
        say(&wrapped(&format!("  {code}: {which}; {limit}"), "      "));
        say(&wrapped(&format!("    → {remedy}"), "      "));
    }
    let file = dir.join("jobs.parquet");
    print_wrapped(&format!("  The column `remark` of {} has the details for each job.", file.display()));
}

fn print_wrapped(text: &str) {
    say(&wrapped(text, "    "));
}
