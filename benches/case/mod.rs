//! A job's problem and start guess, for the benchmarks of the solver.

use std::path::Path;

use sinew::internals::deadline::Deadline;
use sinew::internals::prepare::{Prepared, Task};
use sinew::internals::starts::disturb;
use sinew::internals::study::{Job, Study};
use sinew::internals::transcription::collocation::Collocation;

pub struct Case {
    pub problem: Collocation<'static>,
    pub start: Vec<f64>,
}

/// A study, for as long as the benchmark runs.
pub fn study(path: &Path) -> &'static Study {
    Box::leak(Box::new(Study::load(path).unwrap_or_else(|e| panic!("{:?}", miette::Report::new(e)))))
}

/// `None` if the job has no measurement or no start guess.
pub fn case(study: &'static Study, job: &'static Job) -> Option<Case> {
    let (settings, points) = (&job.settings, job.points);
    let model = Box::leak(Box::new(study.model_of(job).ok()?));
    let task = Task { model, motion: &study.motion, settings, points };
    let prepared: &'static Prepared<'_> = Box::leak(Box::new(Prepared::new(task, Deadline::default()).ok()?));
    let problem = prepared.transcribe();
    let guess = prepared.guess(Deadline::default())?;
    let start = disturb(&guess, problem.scheme, &prepared.inverse, settings.seed, settings.first_start);
    Some(Case { problem, start })
}
