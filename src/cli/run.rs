//! `sinew run` and `sinew merge`: solve, keep, show.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::import::say_lost;
use super::{FAILED_JOBS, GOOD, INTERRUPTED, note, print, show};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;

use crate::error::Result;
use crate::run::{Ended, RunOptions, collect, default_folder, run as run_study};
use crate::study::Study;

/// Runs a study; `options.out` is empty for the usual folder.
pub fn run(path: &Path, options: RunOptions) -> Result<u8> {
    let study = Study::load(path)?;
    let out = if options.out.as_os_str().is_empty() { default_folder(&study) } else { options.out.clone() };
    let options = RunOptions { out: out.clone(), ..options };
    let stop = Arc::new(AtomicBool::new(false));
    stop_at_signals(Arc::clone(&stop));
    notes(&study)?;
    let report = run_study(&study, &options, &stop)?;
    match options.shard {
        None => {
            show::show(&out, false)?;
            print("");
        }
        Some(shard) => print(&format!("shard {}/{} of {}", shard.index, shard.count, study.name)),
    }
    let kept = if report.kept > 0 { format!(" ({} of them from an earlier run)", report.kept) } else { String::new() };
    let place = if options.shard.is_some() { "`sinew merge` makes the tables in" } else { "tables in" };
    print(&format!("{} of {} job(s) finished{kept}, {place} {}", report.finished, report.jobs, out.display()));
    match report.ended {
        Ended::Interrupted => {
            print("interrupted: run the same command again to go on");
            Ok(INTERRUPTED)
        }
        Ended::FirstFailure => {
            print(
                "stopped at a failed job, as on_failure = \"stop\" asks: run again to go on with the others, with --failed to \
                 solve it again",
            );
            Ok(FAILED_JOBS)
        }
        Ended::Complete if report.failed > 0 => {
            print(&format!(
                "{} job(s) did not converge: see status and error in jobs.parquet; --failed solves them again",
                report.failed
            ));
            Ok(FAILED_JOBS)
        }
        Ended::Complete => Ok(GOOD),
    }
}

/// Ctrl-C, `kill` and a terminal that is closed stop a run after the jobs at work; the first two again stop it now.
fn stop_at_signals(stop: Arc<AtomicBool>) {
    let mut wanted = vec![SIGINT, SIGTERM];
    // What `nohup` asks for.
    if !is_ignored(SIGHUP) {
        wanted.push(SIGHUP);
    }
    let Ok(mut signals) = Signals::new(wanted) else { return };
    std::thread::spawn(move || {
        for signal in signals.forever() {
            if stop.swap(true, Ordering::Relaxed) && signal != SIGHUP {
                std::process::exit(i32::from(INTERRUPTED));
            }
            note("\nstopping after the jobs at work; everything finished is kept (Ctrl-C again stops now)");
        }
    });
}

/// Whether the program was started with a signal ignored (where the system tells).
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| u64::from_str_radix(line.strip_prefix("SigIgn:")?.trim(), 16).ok());
    mask.is_some_and(|mask| mask >> (signal - 1) & 1 == 1)
}

/// What a user should know before the first job: columns that are not used, and what an OpenSim model loses.
fn notes(study: &Study) -> Result<()> {
    study.motion.notes.iter().for_each(|text| note(&format!("note: {text}")));
    say_lost(&study.sources.model)
}

/// Makes the tables from what all shards have finished.
pub fn merge(dir: &Path) -> Result<u8> {
    let (study, collected) = collect::merge(dir)?;
    show::show(dir, false)?;
    print("");
    print(&format!("{} of {} job(s) finished, tables in {}", collected.finished(), collected.jobs, dir.display()));
    let missing = collected.jobs - collected.finished();
    if missing > 0 {
        print(&format!(
            "{missing} job(s) are missing: `sinew status {}` names them; run their shards again, or `sinew run {} --out {}`",
            dir.display(),
            study.sources.study.path.display(),
            dir.display()
        ));
    }
    Ok(if missing + collected.failed() > 0 { FAILED_JOBS } else { GOOD })
}
