//! Runs a study: solves the jobs in parallel, stores each one before counting it as finished, and writes the tables at
//! the end.
//!
//! Uses rayon and indicatif; `solve` uses neither. A finished job is one line on disk. An interrupted run continues
//! where it stopped, and the tables are made from the same lines either way.

pub mod collect;
pub mod folder;
mod known;
pub mod manifest;
mod progress;
pub mod reasons;
mod retry;
mod session;
pub mod store;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::SOLVER;
use crate::error::{Error, Result};
use crate::model::Model;
use crate::names::counted;
use crate::outcome::{Outcome, Status};
use crate::prepare::Task;
use crate::solve::solve_from;
use crate::study::file::OnFailure;
use crate::study::{Job, Study};
use crate::tables::schema;
use crate::terminal;
use crate::warm::Answer;
use collect::write_tables;
use folder::FolderLock;
use known::Known;
use manifest::Manifest;
use progress::Progress;
use session::{Finish, Session};
use store::{Header, Store};

/// Options of a run.
#[derive(Clone, Debug, Default)]
pub struct RunOptions {
    pub out: PathBuf,
    /// Number of jobs to solve at a time; one per core if `None`.
    pub threads: Option<usize>,
    /// Discard the earlier results in this folder.
    pub fresh: bool,
    /// Solve failed jobs again.
    pub failed: bool,
    /// Solve jobs again that were finished by another version of the solver.
    pub outdated: bool,
    /// Run only this part of the study and write no tables: `merge` makes them when all parts are finished.
    pub shard: Option<Shard>,
}

/// Part `index` of `count`: every `count`-th block of jobs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// From 0.
    pub index: usize,
    pub count: usize,
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let parts = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
        match parts {
            Some((index, count)) if index < count => Ok(Self { index, count }),
            _ => Err(format!("`{text}` is not a shard; write I/N with I from 0 to N - 1, such as 0/4")),
        }
    }
}

impl Shard {
    /// Whether block number `block` belongs to this part.
    pub fn has(self, block: usize) -> bool {
        block % self.count == self.index
    }
}

/// Counts of the jobs in this run's part of the study, and how the run ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunReport {
    pub jobs: usize,
    pub finished: usize,
    /// Finished, but not converged.
    pub failed: usize,
    /// Kept from an earlier run.
    pub kept: usize,
    pub ended: Ended,
}

/// Why a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    Complete,
    /// The user stopped it.
    Interrupted,
    /// A job failed, and the study stops at the first failure.
    FirstFailure,
}

/// Runs all jobs of a study that have no result yet and writes the tables.
///
/// # Errors
/// If the folder or a file cannot be written. Jobs that were finished before remain on disk.
pub fn run(study: &Study, options: &RunOptions, stop: &AtomicBool) -> Result<RunReport> {
    run_with(study, options, stop, &|study, job, before| match study.model_of(job) {
        Ok(model) => solve_from(task(study, job, &model), before),
        Err(complaint) => (Outcome::failed(Status::Invalid, complaint.message), None),
    })
}

/// The task of a job for [`solve_from`]; `model` is the result of [`Study::model_of`].
pub fn task<'a>(study: &'a Study, job: &'a Job, model: &'a Model) -> Task<'a> {
    Task { model, motion: &study.motion, settings: &job.settings, points: job.points }
}

/// Solves a job, starting from the answer of the previous one if there is one.
pub type Solver<'s> = dyn Fn(&Study, &Job, Option<&Answer>) -> (Outcome, Option<Answer>) + Sync + 's;

/// [`run`] with another solver in place of [`solve_from`], for tests of the engine.
pub fn run_with(study: &Study, options: &RunOptions, stop: &AtomicBool, solver: &Solver<'_>) -> Result<RunReport> {
    std::fs::create_dir_all(&options.out).map_err(|e| Error::io("create", &options.out, e))?;
    let existing = check_folder(study, options)?;
    // If this run were cut off right now, tables of discarded results would be taken for complete ones.
    let discard = || write_plan(study, options, existing.clone(), true);
    let store = Store::open(&options.out, options.shard, options.fresh.then_some(&discard as &dyn Fn() -> Result<()>))?;
    if let Some(note) = version_note(study, &store).filter(|_| !options.outdated) {
        terminal::note(&format!("note: {note}"));
    }
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(options.threads.unwrap_or(0))
        .thread_name(|i| format!("{WORKER}{i}"))
        .build()
        .map_err(|e| Error::io("start threads for", &options.out, std::io::Error::other(e)))?;
    quiet_workers();

    let todo = Todo::new(study, &store, options);
    write_plan(study, options, existing, todo.count > 0)?;
    let known = Known::new(study, &options.out, &store, todo.jobs())?;
    let mut session = Session::new(study, store, todo.count, stop);
    session.work(&pool, &todo.blocks, |block, finish| {
        solve_block(study, block, &todo, stop, solver, known.as_ref(), finish);
    })?;
    let ended = match (session.failure, stop.load(Ordering::Relaxed)) {
        (true, _) => Ended::FirstFailure,
        (_, true) => Ended::Interrupted,
        _ => Ended::Complete,
    };
    if study.on_failure == OnFailure::Retry && ended == Ended::Complete && options.shard.is_none() {
        retry_failed(study, &mut session, &pool, solver)?;
    }
    let Session { mut store, .. } = session;
    let report = todo.report(&store, ended);
    if options.shard.is_none() {
        write_tables(study, &mut store, &options.out)?;
    }
    Ok(report)
}

/// What this run has to solve.
struct Todo<'s> {
    /// This run's part of the study, in blocks for one thread each.
    mine: Vec<&'s [Job]>,
    /// The blocks of `mine` that contain a pending job.
    blocks: Vec<&'s [Job]>,
    /// By index of the job.
    is_pending: Vec<bool>,
    /// Number of pending jobs in `mine`.
    count: usize,
}

impl<'s> Todo<'s> {
    fn new(study: &'s Study, store: &Store, options: &RunOptions) -> Self {
        let is_wanted = |header: Option<&Header>| match header {
            None => true,
            Some(h) if h.status != Status::Converged && options.failed => true,
            Some(h) => h.solver != SOLVER && options.outdated,
        };
        let mine: Vec<&[Job]> = (study.blocks().into_iter().enumerate())
            .filter(|(i, _)| options.shard.is_none_or(|shard| shard.has(*i)))
            .map(|(_, block)| block)
            .collect();
        let is_pending: Vec<bool> = study.jobs.iter().map(|job| is_wanted(store.get(&job.id))).collect();
        let has_pending = |block: &&[Job]| block.iter().any(|job| is_pending[job.index]);
        let blocks = mine.iter().copied().filter(has_pending).collect();
        let count = mine.iter().flat_map(|block| block.iter()).filter(|job| is_pending[job.index]).count();
        Self { mine, blocks, is_pending, count }
    }

    /// The pending jobs.
    fn jobs(&self) -> impl Iterator<Item = &'s Job> + '_ {
        self.blocks.iter().flat_map(|block| block.iter()).filter(|job| self.is_pending[job.index])
    }

    fn report(&self, store: &Store, ended: Ended) -> RunReport {
        let jobs = self.mine.iter().map(|block| block.len()).sum();
        let status = |job: &Job| store.get(&job.id).map(|header| header.status);
        let done: Vec<Status> = self.mine.iter().flat_map(|block| block.iter()).filter_map(status).collect();
        RunReport {
            jobs,
            finished: done.len(),
            failed: done.iter().filter(|status| **status != Status::Converged).count(),
            kept: jobs - self.count,
            ended: if done.len() == jobs && ended == Ended::Interrupted { Ended::Complete } else { ended },
        }
    }
}

/// Solves the pending jobs of a block, each from the answer of the previous one. A finished job that a pending one
/// starts from is solved again, since its answer was not stored.
fn solve_block(
    study: &Study,
    block: &[Job],
    todo: &Todo<'_>,
    stop: &AtomicBool,
    solver: &Solver<'_>,
    known: Option<&Known<'_>>,
    finish: &Finish<'_>,
) {
    let last = block.iter().rposition(|job| todo.is_pending[job.index]);
    let mut before = None;
    for job in &block[..last.map_or(0, |last| last + 1)] {
        if stop.load(Ordering::Relaxed) {
            break;
        }
        if let Some(outcome) = known.and_then(|known| complete_catching(known, job)) {
            finish(job, outcome, false);
            continue;
        }
        let (mut outcome, answer) = solve_catching(study, job, before.as_ref(), solver);
        outcome.job.warm_start_from = job.warm_start_from.clone().filter(|_| before.is_some());
        before = answer;
        if todo.is_pending[job.index] {
            finish(job, outcome, false);
        }
    }
}

/// Completes a job from its known solution. `None` if it has to be solved, also if the completion panics.
fn complete_catching(known: &Known<'_>, job: &Job) -> Option<Outcome> {
    catch_unwind(AssertUnwindSafe(|| known.complete(job))).unwrap_or_default()
}

/// Retries the failed jobs when all others are done.
fn retry_failed(study: &Study, session: &mut Session<'_>, pool: &rayon::ThreadPool, solver: &Solver<'_>) -> Result<()> {
    let candidates = retry::candidates(study, &session.store);
    candidates.iter().for_each(|job| session.since[job.index] = session.store.get(&job.id).map_or(0, |h| h.time_ms));
    let solved = retry::solved(study, &session.store);
    let mut failed: Vec<(&Job, Outcome)> = Vec::new();
    for job in candidates {
        failed.extend(session.store.outcome(&job.id)?.map(|outcome| (job, outcome)));
    }
    if failed.is_empty() {
        return Ok(());
    }
    terminal::note(&format!(
        "{} failed: retrying by continuation from the nearest solved neighbours",
        counted(failed.len(), "job")
    ));
    session.progress = Progress::new(failed.len());
    session.work(pool, &failed, |(job, first), finish| {
        finish(job, retry::retry(study, job, first.clone(), &solved, solver), true);
    })
}

/// Solves a job. A panic becomes an outcome with the status `panicked`.
fn solve_catching(study: &Study, job: &Job, before: Option<&Answer>, solver: &Solver<'_>) -> (Outcome, Option<Answer>) {
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

/// Keeps the workers' panic messages off the terminal: they go into the job's row.
fn quiet_workers() {
    use std::sync::Once;
    static INSTALL: Once = Once::new();
    INSTALL.call_once(|| {
        let default_hook = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            if !std::thread::current().name().is_some_and(|name| name.starts_with(WORKER)) {
                default_hook(info);
            }
        }));
    });
}

/// Refuses to overwrite files that no run has written or the results of another study, and to mix shards of different
/// plans. Returns the existing manifest.
pub fn check_folder(study: &Study, options: &RunOptions) -> Result<Option<Manifest>> {
    let Some(manifest) = folder::check_ownership(&options.out)? else { return Ok(None) };
    let refuse = |reason: String| Err(Error::table("run in", &options.out, reason));
    if options.fresh {
        return Ok(Some(manifest));
    }
    if manifest.study.name != study.name {
        let (there, here) = (&manifest.study.name, &study.name);
        return refuse(format!(
            "it contains the study `{there}`, not `{here}`; choose another --out, or use --fresh to discard its results"
        ));
    }
    if options.shard.is_some() && manifest.study.hash != study.hash() {
        return refuse(
            "its plan was written for other jobs than the study has now; run without --shard to write a new plan, or \
             choose another --out"
                .to_owned(),
        );
    }
    Ok(Some(manifest))
}

/// Writes the plan before the first job starts. If there are jobs to solve (`work`), removes the tables of an earlier
/// run: if this run were interrupted, they would be mistaken for its own. They can be made again from the finished jobs
/// at any time.
pub fn write_plan(study: &Study, options: &RunOptions, existing: Option<Manifest>, work: bool) -> Result<()> {
    let same = |manifest: &Manifest| {
        manifest.study.hash == study.hash() && manifest.sources.study.text == study.sources.study.text
    };
    if options.shard.is_some() && existing.as_ref().is_some_and(same) {
        return Ok(());
    }
    let _hold = FolderLock::take(&options.out)?;
    let mut files = existing.map(|manifest| manifest.files).unwrap_or_default();
    if work && options.shard.is_none() {
        files.clear();
        for name in schema::TABLES {
            let _ = std::fs::remove_file(folder::table(&options.out, name));
        }
    }
    Manifest { files, ..Manifest::of(study) }.write(&options.out)
}

/// A note if results of this study come from another version of the solver.
fn version_note(study: &Study, store: &Store) -> Option<String> {
    let headers = study.jobs.iter().filter_map(|job| store.get(&job.id));
    let mut others: Vec<&str> =
        headers.map(|header| header.solver.as_str()).filter(|solver| *solver != SOLVER).collect();
    let count = others.len();
    others.sort_unstable();
    others.dedup();
    let names = others.join(", ");
    (count > 0).then(|| {
        format!(
            "results of {} are from solver {names}, this is {SOLVER}: --outdated renews them",
            counted(count, "job")
        )
    })
}

/// The default results folder of a study: `results/<study>` in the current folder.
pub fn default_folder(study: &Study) -> PathBuf {
    Path::new("results").join(&study.name)
}
