//! Why a run would solve a job, or not, as shown by `plan`.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use super::known;
use super::manifest::{Manifest, fields};
use super::store::Store;
use crate::SOLVER;
use crate::error::Result;
use crate::outcome::Status;
use crate::settings::{Settings, Value};
use crate::study::{Job, SCHEMA_VERSION, Study};

/// What is known about a job before a run.
#[derive(Clone, Debug, PartialEq)]
pub enum Reason {
    /// Never run here.
    New,
    /// A job with the same swept values was planned here, but something else has changed: what, from what, to what.
    Changed(Vec<String>),
    /// Already solved with another `regularity` or `trajectories`: what is missing is added without solving again.
    Solved,
    Done,
    /// Done by another version of the solver.
    DoneBy(String),
    /// Recorded as failed.
    Failed(Status),
}

impl Reason {
    /// Whether a plain run solves this job.
    pub fn runs(&self) -> bool {
        matches!(self, Reason::New | Reason::Changed(_) | Reason::Solved)
    }

    /// The class of the reason, by which jobs are counted.
    pub fn class(&self) -> &'static str {
        match self {
            Reason::New => "new",
            Reason::Changed(_) => "changed",
            Reason::Solved => "solved, to be completed",
            Reason::Done => "done",
            Reason::DoneBy(_) => "done by another solver",
            Reason::Failed(_) => "failed before",
        }
    }
}

impl std::fmt::Display for Reason {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Reason::Changed(what) => write!(f, "changed: {}", what.join(", ")),
            Reason::DoneBy(solver) => write!(f, "done by solver {solver}"),
            Reason::Failed(status) => write!(f, "failed before: {}", status.name()),
            other => f.write_str(other.class()),
        }
    }
}

/// The reason of each job, in the order of the study.
pub fn reasons(study: &Study, folder: &Path) -> Result<Vec<Reason>> {
    if !folder.is_dir() {
        return Ok(vec![Reason::New; study.jobs.len()]);
    }
    let store = Store::read(folder)?;
    let known = |job: &Job| {
        store.get(&job.id).map(|header| match header.status {
            Status::Converged if header.solver == SOLVER => Reason::Done,
            Status::Converged => Reason::DoneBy(header.solver.clone()),
            status => Reason::Failed(status),
        })
    };
    let found: Vec<Option<Reason>> = study.jobs.iter().map(known).collect();
    let before = match found.iter().any(Option::is_none) {
        // If the manifest cannot be read, its jobs count as new.
        true => Manifest::read(folder).unwrap_or(None).map(EarlierPlan::new),
        false => None,
    };
    let unknown = |job: &Job| match before.as_ref().and_then(|before| before.changes(study, job)) {
        Some(what) if !what.is_empty() => Reason::Changed(what),
        _ => Reason::New,
    };
    let solved = |job: &Job| known::find(study, job, &store).map(|_| Reason::Solved);
    let reason = |(job, found): (&Job, Option<Reason>)| found.or_else(|| solved(job)).unwrap_or_else(|| unknown(job));
    Ok(study.jobs.iter().zip(found).map(reason).collect())
}

/// The plan of the earlier run, with its jobs by their swept values.
struct EarlierPlan {
    manifest: Manifest,
    by_swept: HashMap<String, usize>,
}

/// Swept values as one text, sorted by name, so that the order of the axes does not matter.
fn key<'v>(axes: &[String], swept: impl Iterator<Item = &'v Option<Value>>) -> String {
    let mut parts: Vec<String> =
        axes.iter().zip(swept).filter_map(|(name, value)| Some(format!("{name}={}", value.as_ref()?))).collect();
    parts.sort();
    parts.join(";")
}

impl EarlierPlan {
    fn new(manifest: Manifest) -> Self {
        let jobs = manifest.jobs.iter().enumerate();
        let by_swept = jobs.map(|(i, job)| (key(&manifest.axes, job.swept.iter()), i)).collect();
        Self { manifest, by_swept }
    }

    /// What has changed in the job with the same swept values; `None` if there was none.
    fn changes(&self, study: &Study, job: &Job) -> Option<Vec<String>> {
        let old = &self.manifest.jobs[*self.by_swept.get(&key(&study.axes, job.swept.iter()))?];
        let mut what = Vec::new();
        let version = self.manifest.sinew.schema_version;
        if version != SCHEMA_VERSION {
            what.push(format!("result schema {version} → {SCHEMA_VERSION}"));
        }
        if self.manifest.study.model.hash != study.model_hash {
            what.push("the model file".to_owned());
        }
        if self.manifest.study.motion.hash != study.motion_hash {
            what.push("the motion file".to_owned());
        }
        // A manifest of an older version has no settings that came later.
        let defaults = fields(&Settings::default());
        for (name, now) in fields(&job.settings) {
            let then =
                old.settings.get(&name).or_else(|| self.manifest.base.get(&name)).or_else(|| defaults.get(&name));
            if then != Some(&now) {
                what.push(format!("{name} {} → {now}", then.map_or("unknown".to_owned(), ToString::to_string)));
            }
        }
        let now: BTreeMap<&str, &Value> =
            job.changes.iter().map(|change| (change.path.as_str(), &change.value)).collect();
        let paths: std::collections::BTreeSet<&str> =
            now.keys().copied().chain(old.model_changes.keys().map(String::as_str)).collect();
        for path in paths {
            let (then, now) = (old.model_changes.get(path), now.get(path).copied());
            if then != now {
                let shown = |value: Option<&Value>| value.map_or("as in the model".to_owned(), ToString::to_string);
                what.push(format!("{path} {} → {}", shown(then), shown(now)));
            }
        }
        if what.is_empty() && old.job_id != job.id {
            what.push("the job it starts from".to_owned());
        }
        Some(what)
    }
}
