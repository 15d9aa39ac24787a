//! Finished jobs on their way from the workers to the disk and to the terminal.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;

use rayon::prelude::*;

use super::progress::Progress;
use super::store::{self, Store};
use crate::error::Result;
use crate::outcome::{Outcome, Status};
use crate::study::file::OnFailure;
use crate::study::{Job, Study};

/// Number of finished jobs that may wait for the disk before the workers block.
const QUEUE_LENGTH: usize = 4096;

/// Stores, counts and shows the finished jobs of a run.
pub struct Session<'r> {
    pub store: Store,
    /// By job: time of the line that a new one will replace, ms since 1970; 0 if there is none.
    pub since: Vec<u64>,
    pub progress: Progress,
    stop: &'r AtomicBool,
    on_failure: OnFailure,
    /// A job failed, and the study stops at the first failure.
    pub failure: bool,
}

/// Stores the outcome of a job. The flag says whether it was retried by continuation.
pub type Finish<'s> = dyn Fn(&Job, Outcome, bool) + 's;

/// A finished job on its way from the worker to the disk.
struct Finished {
    index: usize,
    status: Status,
    error: Option<String>,
    line: Vec<u8>,
}

impl<'r> Session<'r> {
    pub fn new(study: &Study, store: Store, count: usize, stop: &'r AtomicBool) -> Self {
        let since = study.jobs.iter().map(|job| store.get(&job.id).map_or(0, |header| header.time_ms)).collect();
        Self { since, store, progress: Progress::new(count), stop, on_failure: study.on_failure, failure: false }
    }

    /// Processes all pieces in parallel. The workers format the lines; this thread writes them, in batches if they
    /// arrive fast.
    pub fn work<P: Sync>(
        &mut self,
        pool: &rayon::ThreadPool,
        pieces: &[P],
        work: impl Fn(&P, &Finish<'_>) + Sync,
    ) -> Result<()> {
        let (send, receive) = mpsc::sync_channel::<Finished>(QUEUE_LENGTH);
        let (stop, at_failure, since) = (self.stop, self.on_failure == OnFailure::Stop, &self.since);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                pool.install(|| {
                    pieces.par_iter().with_max_len(1).for_each_with(send, |send, piece| {
                        let finish = |job: &Job, outcome: Outcome, retried: bool| {
                            let line = store::line(&job.id, &outcome, retried, since[job.index]);
                            let (status, error) = (outcome.job.status, outcome.job.error);
                            if at_failure && status != Status::Converged {
                                stop.store(true, Ordering::Relaxed);
                            }
                            // This fails only if the receiver is gone, and then nothing can be stored any more.
                            let _ = send.send(Finished { index: job.index, status, error, line });
                        };
                        if !stop.load(Ordering::Relaxed) {
                            work(piece, &finish);
                        }
                    });
                });
            });
            let mut result = Ok(());
            while let Ok(first) = receive.recv() {
                let batch: Vec<Finished> = std::iter::once(first).chain(receive.try_iter()).collect();
                if result.is_err() {
                    continue;
                }
                let (lines, news): (Vec<_>, Vec<_>) =
                    batch.into_iter().map(|f| (f.line, (f.index, f.status, f.error))).unzip();
                result = self.store.add(&lines);
                if result.is_err() {
                    self.stop.store(true, Ordering::Relaxed);
                    continue;
                }
                for (index, status, error) in news {
                    self.progress.finished(index, status, error.as_deref());
                    self.failure |= at_failure && status != Status::Converged;
                }
            }
            self.progress.end();
            result
        })
    }
}
