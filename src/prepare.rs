//! From a job to the programme that the solver gets: the inverse problem, the scheme, the measurement.

use std::sync::Arc;

use crate::deadline::Deadline;
use crate::guess::initial_guess;
use crate::memory::ProblemSize;
use crate::methods::given_motion::GivenMotion;
use crate::methods::static_optimisation::start::start;
use crate::methods::{InverseProblem, dynamic, prescribed, static_optimisation};
use crate::model::Model;
use crate::motion::{Measurement, MeasurementError, MotionTable};
use crate::outcome::Status;
use crate::problem::Goal;
use crate::settings::{Criterion, Method, Scheme, Settings};
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
    /// The motion, where it is given.
    pub given: Option<Arc<GivenMotion<'a>>>,
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
        let surroundings = Arc::new(of_motion.surroundings(motion, model));
        let unmeasured = |why| match why {
            MeasurementError::DeadlinePassed => late(),
            open => (Status::Infeasible, open.to_string()),
        };
        let (inverse, given) = match settings.method {
            Method::Dynamic => (dynamic::dynamic(model, settings, &surroundings), None),
            method => {
                let given = GivenMotion::new(model, motion, settings, surroundings, deadline).map_err(unmeasured)?;
                let given = Arc::new(given);
                let problem = if method == Method::Static { static_optimisation::problem } else { prescribed::problem };
                (problem(model, settings, &given), Some(given))
            }
        };
        let size = ProblemSize::of(&inverse, settings, points);
        size.check_transcribing(settings).map_err(|reason| (Status::Invalid, reason))?;
        let measurement = of_motion.measure(motion, model, points, deadline).map_err(unmeasured)?;
        let scheme = discretise(&inverse, settings, points, motion.duration() * settings.time_scale);
        Ok(Self { task, inverse, given, scheme, measurement, size })
    }

    /// The programme for the solver.
    pub fn transcribe(&self) -> Collocation<'_> {
        Collocation::new(&self.inverse.control, self.scheme.as_ref(), &self.goals())
    }

    /// The objective; nothing where it is no sum of squares or higher powers.
    fn goals(&self) -> Vec<Goal> {
        let (inverse, scheme, settings) = (&self.inverse, self.scheme.as_ref(), self.task.settings);
        let is_linear = settings.criterion == Criterion::MinMax || settings.effort_power < 2.0;
        match settings.method {
            Method::Dynamic => dynamic::goals(inverse, scheme, &self.measurement, settings),
            Method::Static if is_linear => Vec::new(),
            Method::Static => static_optimisation::goals(inverse, scheme, settings),
            Method::Prescribed => prescribed::goals(inverse, scheme, settings),
        }
    }

    /// The start guess, if it is finite and there is time for it.
    pub fn guess(&self, deadline: Deadline) -> Option<Vec<f64>> {
        let (inverse, scheme) = (&self.inverse, self.scheme.as_ref());
        match &self.given {
            Some(given) => start(inverse, given, scheme, self.task.settings, deadline),
            None => initial_guess(inverse, scheme, self.task.points, &self.measurement, deadline),
        }
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
