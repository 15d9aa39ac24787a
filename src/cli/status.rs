//! `sinew status`: shows the progress of a run from its plan and finished jobs, during the run or afterwards.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::SystemTime;

use super::{FAILED_JOBS, GOOD, print};
use crate::error::{Error, Result};
use crate::names::counted;
use crate::outcome::Status;
use crate::run::manifest::{Manifest, PlannedJob};
use crate::run::store::Store;

/// Number of failed jobs, and of missing jobs, that are listed.
const LISTED: usize = 10;
/// The rate is measured over this time before the last finished job, ms.
const RATE_WINDOW: u64 = 60_000;

pub fn status(dir: &Path) -> Result<u8> {
    let Some(manifest) = Manifest::read(dir)? else {
        let reason = "it has no manifest.json, so it is not a results folder; `sinew run STUDY` creates one";
        return Err(Error::table("show the status of", dir, reason));
    };
    let mut store = Store::read(dir)?;
    let mut counts: BTreeMap<Status, usize> = BTreeMap::new();
    let (mut failed, mut missing, mut times): (Vec<&PlannedJob>, Vec<&PlannedJob>, Vec<u64>) = Default::default();
    for job in &manifest.jobs {
        match store.get(&job.job_id) {
            None => missing.push(job),
            Some(header) => {
                *counts.entry(header.status).or_default() += 1;
                times.push(header.time_ms);
                if header.status != Status::Converged {
                    failed.push(job);
                }
            }
        }
    }
    let total = manifest.jobs.len();
    let done: Vec<String> = counts.iter().map(|(status, count)| format!("{count} {}", status.name())).collect();
    let done = if done.is_empty() { String::new() } else { format!(" ({})", done.join(", ")) };
    print(&format!("{}: {} of {total} jobs finished{done}, {} to do", manifest.study.name, times.len(), missing.len()));
    if store.damaged > 0 {
        print(&format!("{}: the jobs on them will be solved again", counted(store.damaged, "damaged line")));
    }
    times.sort_unstable();
    if let Some(&last) = times.last() {
        let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).map_or(0, |d| d.as_millis() as u64);
        print(&format!("the last job finished {:.0} s ago", now.saturating_sub(last) as f64 / 1e3));
    }
    if Store::is_in_use(dir) {
        let recent: Vec<u64> = times.iter().copied().filter(|t| t + RATE_WINDOW >= times[times.len() - 1]).collect();
        let span = recent.last().zip(recent.first()).map_or(0, |(last, first)| last - first) as f64 / 1e3;
        let eta = match recent.len() {
            n if n > 1 && span > 0.0 => {
                let rate = (n - 1) as f64 / span;
                format!(
                    ": {rate:.2} jobs per second in the last minute, about {:.0} s left",
                    missing.len() as f64 / rate
                )
            }
            _ => String::new(),
        };
        print(&format!("a run is in progress{eta}"));
    } else if !missing.is_empty() {
        print(
            "no run is in progress on this machine: `sinew run` continues, `sinew merge` writes tables of the finished \
             jobs",
        );
    }
    for job in failed.iter().take(LISTED) {
        let outcome = store.outcome(&job.job_id)?;
        let (status, error) = outcome.map_or((Status::Invalid, None), |o| (o.job.status, o.job.error));
        let swept = swept(&manifest, job);
        print(&format!("job {}{swept}: {}: {}", job.index, status.name(), error.unwrap_or_default()));
    }
    if failed.len() > LISTED {
        print(&format!("… and {}: see jobs.parquet", counted(failed.len() - LISTED, "more failed job")));
    }
    if !missing.is_empty() && !times.is_empty() {
        let listed: Vec<String> = missing.iter().take(LISTED).map(|job| job.index.to_string()).collect();
        let more = if missing.len() > LISTED { ", …" } else { "" };
        print(&format!("to do: {}{more}", listed.join(", ")));
    }
    Ok(if missing.is_empty() && failed.is_empty() { GOOD } else { FAILED_JOBS })
}

fn swept(manifest: &Manifest, job: &PlannedJob) -> String {
    let values = manifest.axes.iter().zip(&job.swept);
    let text: Vec<String> = values.filter_map(|(name, value)| Some(format!("{name} = {}", value.as_ref()?))).collect();
    if text.is_empty() { String::new() } else { format!(" ({})", text.join(", ")) }
}
