//! `sinew run`: solve, keep, show.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::{FAILED_JOBS, GOOD, INTERRUPTED, print, show};
use crate::error::Result;
use crate::run::{RunOptions, default_folder, run as run_study};
use crate::study::Study;

pub fn run(path: &Path, out: Option<PathBuf>, threads: Option<usize>, fresh: bool) -> Result<u8> {
    let study = Study::load(path)?;
    let out = out.unwrap_or_else(|| default_folder(&study));
    let stop = Arc::new(AtomicBool::new(false));
    let on_signal = Arc::clone(&stop);
    // A handler that is there already (in tests) serves as well.
    let _ = ctrlc::set_handler(move || {
        if on_signal.swap(true, Ordering::Relaxed) {
            std::process::exit(i32::from(INTERRUPTED));
        }
        eprintln!("\nstopping after the jobs at work; everything finished is kept (Ctrl-C again stops now)");
    });
    let report = run_study(&study, &RunOptions { out: out.clone(), threads, fresh }, &stop)?;
    show::show(&out, false)?;
    print("");
    let kept = if report.kept > 0 { format!(" ({} of them from an earlier run)", report.kept) } else { String::new() };
    print(&format!("{} of {} job(s) finished{kept}, tables in {}", report.finished, report.jobs, out.display()));
    if report.interrupted {
        print("interrupted: run the same command again to go on");
        return Ok(INTERRUPTED);
    }
    if report.failed > 0 {
        print(&format!("{} job(s) did not converge: see status and error in jobs.parquet", report.failed));
        return Ok(FAILED_JOBS);
    }
    Ok(GOOD)
}
