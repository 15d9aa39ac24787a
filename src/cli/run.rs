//! `sinew run` and `sinew merge`: solve the jobs of a study, write the tables and print them.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::import::say_lost;
use super::{FAILED_JOBS, GOOD, INTERRUPTED, note, print, show};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;

use crate::error::Result;
use crate::names::counted;
use crate::run::{Ended, RunOptions, Shard, collect, default_folder, run as run_study};
use crate::study::Study;
use crate::terminal;

/// Runs a study. If `options.out` is empty, the results go to the default folder.
pub fn run(path: &Path, options: RunOptions) -> Result<u8> {
    let study = Study::load(path)?;
    let out = if options.out.as_os_str().is_empty() { default_folder(&study) } else { options.out.clone() };
    let options = RunOptions { out: out.clone(), ..options };
    let stop = Arc::new(AtomicBool::new(false));
    stop_at_signals(Arc::clone(&stop));
    print_notes(&study)?;
    let report = run_study(&study, &options, &stop)?;
    if options.shard.is_none() && !terminal::is_quiet() {
        show::print_all(&out, false, false)?;
        print("");
    }
    let kept = if report.kept > 0 { format!(" ({} of them from an earlier run)", report.kept) } else { String::new() };
    let finished = format!("{} of {} finished{kept}", report.finished, counted(report.jobs, "job"));
    let code = match report.ended {
        Ended::Interrupted => {
            print("Interrupted: run the same command again to continue.");
            INTERRUPTED
        }
        Ended::FirstFailure => {
            print(
                "Stopped at a failed job because on_failure = \"stop\". Run again to continue with the other jobs, or \
                 with --failed to solve the failed one again.",
            );
            FAILED_JOBS
        }
        Ended::Complete if report.failed > 0 => {
            print(&format!("{} did not converge; run with --failed to solve again.", counted(report.failed, "job")));
            FAILED_JOBS
        }
        Ended::Complete => GOOD,
    };
    let folder = out.display();
    match options.shard {
        Some(Shard { index, count }) => {
            print(&format!("Shard {index}/{count}: {finished}; `sinew merge {folder}` writes the tables"));
        }
        None => {
            if code == GOOD && !terminal::is_quiet() {
                print(&format!("Next: sinew report {folder}"));
            }
            print(&format!("{finished}; results in {folder}"));
        }
    }
    Ok(code)
}

/// Ctrl-C, `kill` and closing the terminal stop a run after the running jobs. A second Ctrl-C or `kill` stops it now.
fn stop_at_signals(stop: Arc<AtomicBool>) {
    let mut wanted = vec![SIGINT, SIGTERM];
    // `nohup` starts the program with SIGHUP ignored; keep it so.
    if !is_ignored(SIGHUP) {
        wanted.push(SIGHUP);
    }
    let Ok(mut signals) = Signals::new(wanted) else { return };
    std::thread::spawn(move || {
        for signal in signals.forever() {
            if stop.swap(true, Ordering::Relaxed) && signal != SIGHUP {
                std::process::exit(i32::from(INTERRUPTED));
            }
            note("\nstopping after the running jobs; all finished jobs are kept (press Ctrl-C again to stop at once)");
        }
    });
}

/// True if the program was started with a signal ignored; false on systems without `/proc`.
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| u64::from_str_radix(line.strip_prefix("SigIgn:")?.trim(), 16).ok());
    mask.is_some_and(|mask| mask >> (signal - 1) & 1 == 1)
}

/// Prints notes before the first job: remarks on the motion file, and what is lost from an OpenSim model.
fn print_notes(study: &Study) -> Result<()> {
    study.motion.notes.iter().for_each(|text| note(&format!("note: {text}")));
    say_lost(&study.sources.model)
}

/// Writes the tables from the finished jobs of all shards.
pub fn merge(dir: &Path) -> Result<u8> {
    let (study, collected) = collect::merge(dir)?;
    if !terminal::is_quiet() {
        show::print_all(dir, false, false)?;
        print("");
    }
    let missing = collected.jobs - collected.finished();
    let folder = dir.display();
    if missing > 0 {
        let file = study.sources.study.path.display();
        print(&format!(
            "{missing} jobs are missing: `sinew status {folder}` lists them. Run their shards again, or \
             `sinew run {file} --out {folder}`."
        ));
    }
    print(&format!("{} of {} finished; results in {folder}", collected.finished(), counted(collected.jobs, "job")));
    Ok(if missing + collected.failed() > 0 { FAILED_JOBS } else { GOOD })
}
