//! `sinew run` and `sinew merge`: solve, keep, show.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::import::say_lost;
use super::{FAILED_JOBS, GOOD, INTERRUPTED, note, print, show};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;

use crate::error::Result;
use crate::run::{Ended, RunOptions, Shard, collect, default_folder, run as run_study};
use crate::study::Study;
use crate::terminal;

/// Runs a study; `options.out` is empty for the usual folder.
pub fn run(path: &Path, options: RunOptions) -> Result<u8> {
    let study = Study::load(path)?;
    let out = if options.out.as_os_str().is_empty() { default_folder(&study) } else { options.out.clone() };
    let options = RunOptions { out: out.clone(), ..options };
    let stop = Arc::new(AtomicBool::new(false));
    stop_at_signals(Arc::clone(&stop));
    notes(&study)?;
    let report = run_study(&study, &options, &stop)?;
    if options.shard.is_none() && !terminal::is_quiet() {
        show::print_all(&out, false, false)?;
        print("");
    }
    let kept = if report.kept > 0 { format!(" ({} of them earlier)", report.kept) } else { String::new() };
    let finished = format!("{} of {} jobs finished{kept}", report.finished, report.jobs);
    let code = match report.ended {
        Ended::Interrupted => {
            print("Interrupted: run the same command again to continue.");
            INTERRUPTED
        }
        Ended::FirstFailure => {
            print(
                "Stopped at a failed job, as on_failure = \"stop\" asks. Run again to continue with the others, or with \
                 --failed to solve it again.",
            );
            FAILED_JOBS
        }
        Ended::Complete if report.failed > 0 => {
            print(&format!("{} jobs did not converge; --failed solves them again.", report.failed));
            FAILED_JOBS
        }
        Ended::Complete => GOOD,
    };
    let folder = out.display();
    match options.shard {
        Some(Shard { index, count }) => {
            print(&format!("Shard {index}/{count}: {finished}; `sinew merge {folder}` makes the tables"));
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
            note(
                "\nstopping when the running jobs are finished; all finished jobs are kept (Ctrl-C again stops at once)",
            );
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
    if !terminal::is_quiet() {
        show::print_all(dir, false, false)?;
        print("");
    }
    let missing = collected.jobs - collected.finished();
    let folder = dir.display();
    if missing > 0 {
        let file = study.sources.study.path.display();
        print(&format!(
            "{missing} jobs are missing: `sinew status {folder}` names them. Run their shards again, or `sinew run {file} \
             --out {folder}`."
        ));
    }
    print(&format!("{} of {} jobs finished; results in {folder}", collected.finished(), collected.jobs));
    Ok(if missing + collected.failed() > 0 { FAILED_JOBS } else { GOOD })
}
