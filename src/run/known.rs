//! Jobs that were already solved with another `regularity` or `trajectories` setting: their stored solution is used,
//! and only what is missing is computed.

use std::path::Path;
use std::sync::{Mutex, PoisonError};

use super::store::{Header, Store};
use super::task;
use crate::SOLVER;
use crate::error::Result;
use crate::outcome::{Outcome, Status};
use crate::settings::RegularityMode;
use crate::solve;
use crate::study::{Job, Study};

/// The id of a finished job with the same solution as `job`, from which `job` can be completed, and that job's
/// `regularity`.
pub fn find(study: &Study, job: &Job, store: &Store) -> Option<(RegularityMode, String)> {
    // A job solved by continuation depends on its neighbours.
    let is_usable = |h: &Header| h.status == Status::Converged && h.solver == SOLVER && !h.retried;
    let is_solved = |id: &str| store.get(id).is_some_and(is_usable);
    let same = study.same_solution(job).into_iter();
    same.filter(|(had, _)| solve::is_completable(*had, &job.settings)).find(|(_, id)| is_solved(id))
}

/// The solved jobs of a folder, for workers to read.
pub struct Known<'s> {
    study: &'s Study,
    store: Mutex<Store>,
}

impl<'s> Known<'s> {
    /// `None` if no pending job can be completed from a finished one.
    ///
    /// # Errors
    /// If the finished jobs of the folder cannot be read.
    pub fn new<'j>(
        study: &'s Study,
        folder: &Path,
        store: &Store,
        mut pending: impl Iterator<Item = &'j Job>,
    ) -> Result<Option<Self>> {
        if store.is_empty() || !pending.any(|job| find(study, job, store).is_some()) {
            return Ok(None);
        }
        Ok(Some(Self { study, store: Mutex::new(Store::read(folder)?) }))
    }

    /// The outcome of `job`, completed from the solution of a finished job; `None` if it has to be solved.
    pub fn complete(&self, job: &Job) -> Option<Outcome> {
        let (had, solved) = {
            let mut store = self.store.lock().unwrap_or_else(PoisonError::into_inner);
            let (had, id) = find(self.study, job, &store)?;
            (had, store.outcome(&id).ok()??)
        };
        let model = self.study.model_of(job).ok()?;
        solve::complete(task(self.study, job, &model), had, &solved)
    }
}
