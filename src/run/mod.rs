//! Runs a study: jobs in parallel, each finished one on disk before the next is counted, tables at the end.
//!
//! Knows rayon and indicatif; `solve` knows neither. A finished job is one line of `finished.jsonl`, flushed; a run that was
//! cut off goes on where it stopped, and the tables are made from the same lines either way.

mod manifest;
mod progress;
mod store;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::outcome::{Outcome, Status};
use crate::solve::solve_from;
use crate::study::{Job, Study};
use crate::tables::{self, schema};
use crate::warm::Answer;
use progress::Progress;
use store::Store;

/// How to run.
#[derive(Clone, Debug)]
pub struct RunOptions {
    pub out: PathBuf,
    /// Jobs at a time; all cores if `None`.
    pub threads: Option<usize>,
    /// Forget earlier results of this folder.
    pub fresh: bool,
}

/// How it went.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunReport {
    pub jobs: usize,
    pub finished: usize,
    /// Finished, but not converged.
    pub failed: usize,
    /// Taken from an earlier run.
    pub kept: usize,
    /// Stopped by the user before all jobs were done.
    pub interrupted: bool,
}

/// Runs all jobs of a study that have no result yet and writes the tables.
///
/// # Errors
/// If the folder or a file cannot be written. What was finished before stays on disk.
pub fn run(study: &Study, options: &RunOptions, stop: &AtomicBool) -> Result<RunReport> {
    run_with(study, options, stop, &|study, job, before| match study.model_of(job) {
        Ok(model) => solve_from(&model, &study.motion, &job.settings, job.points, before),
        Err(complaint) => (Outcome::failed(Status::Invalid, complaint.message), None),
    })
}

/// Solves a job, from the answer of the one before where there is one.
pub type Solver<'s> = dyn Fn(&Study, &Job, Option<&Answer>) -> (Outcome, Option<Answer>) + Sync + 's;

/// [`run`] with another solver in place of [`solve_from`], for tests of the engine.
pub fn run_with(study: &Study, options: &RunOptions, stop: &AtomicBool, solver: &Solver<'_>) -> Result<RunReport> {
    std::fs::create_dir_all(&options.out).map_err(|e| Error::io("create", &options.out, e))?;
    let mut store = Store::open(&options.out, options.fresh)?;
    let is_pending: Vec<bool> = study.jobs.iter().map(|job| store.get(&job.id).is_none()).collect();
    let pending = is_pending.iter().filter(|pending| **pending).count();
    let kept = study.jobs.len() - pending;
    let blocks: Vec<&[Job]> = study.jobs.chunk_by(|_, next| next.warm_start_from.is_some()).collect();
    if let Some(note) = store.version_note(study) {
        eprintln!("note: {note}");
    }

    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(options.threads.unwrap_or(0))
        .thread_name(|i| format!("{WORKER}{i}"))
        .build()
        .map_err(|e| Error::io("start threads for", &options.out, std::io::Error::other(e)))?;
    let mut progress = Progress::new(pending);
    let (send, receive) = mpsc::channel::<(&Job, Outcome)>();
    quiet_workers();
    let written = std::thread::scope(|scope| {
        scope.spawn(|| {
            pool.install(|| {
                blocks.par_iter().with_max_len(1).for_each_with(send, |send, block| {
                    let last = block.iter().rposition(|job| is_pending[job.index]);
                    let mut before = None;
                    // A finished job that a pending one starts from is solved again, for its answer.
                    for job in &block[..last.map_or(0, |last| last + 1)] {
                        if stop.load(Ordering::Relaxed) {
                            break;
                        }
                        let (mut outcome, answer) = contained(study, job, before.as_ref(), solver);
                        outcome.job.warm_start_from = job.warm_start_from.clone().filter(|_| before.is_some());
                        before = answer;
                        if is_pending[job.index] {
                            // The receiver hangs up only when the disk fails; then nothing is left to say.
                            let _ = send.send((job, outcome));
                        }
                    }
                });
            });
        });
        let mut result = Ok(());
        for (job, outcome) in receive {
            if result.is_ok() {
                progress.finished(outcome.job.status);
                result = store.add(&job.id, outcome);
                if result.is_err() {
                    stop.store(true, Ordering::Relaxed);
                }
            }
        }
        result
    });
    progress.end();
    written?;

    let finished: Vec<(&Job, &Outcome)> =
        study.jobs.iter().filter_map(|job| store.get(&job.id).map(|outcome| (job, outcome))).collect();
    write_tables(study, &finished, &options.out)?;
    Ok(RunReport {
        jobs: study.jobs.len(),
        finished: finished.len(),
        failed: finished.iter().filter(|(_, o)| o.job.status != Status::Converged).count(),
        kept,
        interrupted: finished.len() < study.jobs.len(),
    })
}

/// One job; a panic in it becomes its row.
fn contained(study: &Study, job: &Job, before: Option<&Answer>, solver: &Solver<'_>) -> (Outcome, Option<Answer>) {
    catch_unwind(AssertUnwindSafe(|| solver(study, job, before))).unwrap_or_else(|payload| {
        let message = payload
            .downcast_ref::<String>()
            .map(String::as_str)
            .or_else(|| payload.downcast_ref::<&str>().copied())
            .unwrap_or("no message");
        let reason = format!("the program failed inside this job (please report it): {message}");
        (Outcome::failed(Status::Panicked, reason), None)
    })
}

const WORKER: &str = "sinew-worker-";

/// Keeps panics of the workers off the terminal: they become rows.
fn quiet_workers() {
    use std::sync::Once;
    static INSTALL: Once = Once::new();
    INSTALL.call_once(|| {
        let usual = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            if !std::thread::current().name().is_some_and(|name| name.starts_with(WORKER)) {
                usual(info);
            }
        }));
    });
}

fn write_tables(study: &Study, finished: &[(&Job, &Outcome)], out: &Path) -> Result<()> {
    let provenance = manifest::provenance(study);
    let mut hashes = Vec::new();
    for table in schema::tables(finished) {
        let path = out.join(format!("{}.parquet", table.name));
        if table.name == "trajectories" && table.rows() == 0 {
            let _ = std::fs::remove_file(&path); // of an earlier run that stored them
            continue;
        }
        let units: serde_json::Map<String, serde_json::Value> =
            table.columns.iter().map(|(name, _)| (name.clone(), schema::unit(name).into())).collect();
        let mut metadata = provenance.clone();
        metadata.push(("sinew.units".to_owned(), serde_json::Value::Object(units).to_string()));
        tables::write(&table, &path, &metadata)?;
        let bytes = std::fs::read(&path).map_err(|e| Error::io("read", &path, e))?;
        hashes.push((format!("{}.parquet", table.name), blake3::hash(&bytes).to_hex().to_string()));
    }
    manifest::write(study, finished.len(), &hashes, &out.join("manifest.json"))
}

/// The folder of a study's results unless the user names another: `results/<study>` in the current folder.
pub fn default_folder(study: &Study) -> PathBuf {
    Path::new("results").join(&study.name)
}
