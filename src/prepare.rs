//! From a job to the programme that the solver gets: the inverse problem, the scheme, the measurement.

use std::sync::Arc;

use crate::deadline::Deadline;
use crate::guess::initial_guess;
use crate::memory::ProblemSize;
use crate::methods::InverseProblem;
use crate::methods::dynamic::{dynamic, goals};
use crate::model::Model;
use crate::motion::{Measurement, MeasurementError, MotionTable};
use crate::outcome::Status;
use crate::settings::{Scheme, Settings};
use crate::transcription::collocation::Collocation;
use crate::transcription::midpoint::Midpoint;
use crate::transcription::radau::Radau;
use crate::transcription::scheme::Discretisation;

/// A job to solve: the model with the job's changes, the motion, the settings, and the number of collocation points.
#[derive(Clone, Copy)]
pub struct Task<'a> {
    pub model: &'a Model,
    pub motion: &'a MotionTable,
    pub settings: &'a Settings,
    pub points: usize,
}

/// Why a job has no result.
pub type Failure = (Status, String);

/// All that the programme of a job is made from.
pub struct Prepared<'a> {
    task: Task<'a>,
    pub inverse: InverseProblem<'a>,
    pub scheme: Arc<dyn Discretisation>,
    pub measurement: Measurement,
    pub size: ProblemSize,
}

impl<'a> Prepared<'a> {
    /// # Errors
    /// If the problem is too large, the motion cannot be measured, or there is no time.
    pub fn new(task: Task<'a>, deadline: Deadline) -> Result<Self, Failure> {
        let Task { model, motion, settings, points } = task;
        let of_motion = settings.of_motion();
        let inverse = dynamic(model, settings, &Arc::new(of_motion.surroundings(motion, model)));
        let size = ProblemSize::of(&inverse, settings, points);
        size.check_transcribing(settings).map_err(|reason| (Status::Invalid, reason))?;
        let measurement = of_motion.measure(motion, model, points, deadline).map_err(|why| match why {
            MeasurementError::DeadlinePassed => late(),
            open => (Status::Infeasible, open.to_string()),
        })?;
        let scheme = discretise(&inverse, settings, points, motion.duration() * settings.time_scale);
        Ok(Self { task, inverse, scheme, measurement, size })
    }

    /// The programme for the solver.
    pub fn transcribe(&self) -> Collocation<'_> {
        let scheme = self.scheme.as_ref();
        let goals = goals(&self.inverse, scheme, &self.measurement, self.task.settings);
        Collocation::new(&self.inverse.control, scheme, &goals)
    }

    /// The start guess, if it is finite and there is time for it.
    pub fn guess(&self, deadline: Deadline) -> Option<Vec<f64>> {
        initial_guess(&self.inverse, self.scheme.as_ref(), self.task.points, &self.measurement, deadline)
    }
}

/// The failure of a job that has no time left before it is solved.
pub fn late() -> Failure {
    (Status::TimeLimit, MeasurementError::DeadlinePassed.to_string())
}

/// The scheme of `settings`, on `points` points (p) over `duration` seconds.
fn discretise(
    inverse: &InverseProblem<'_>,
    settings: &Settings,
    points: usize,
    duration: f64,
) -> Arc<dyn Discretisation> {
    match settings.scheme {
        Scheme::Midpoint => Arc::new(Midpoint::new(&inverse.control, points, duration)),
        Scheme::Radau => Arc::new(Radau::new(&inverse.control, points - 1, settings.stages, duration)),
    }
}
