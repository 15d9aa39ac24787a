//! Solves one job, from its task to its outcome: measure, transcribe, guess, solve, polish, rank, report. Pure: no disk
//! access, no printing, one thread.

use std::borrow::Cow;
use std::time::Instant as Clock;

use crate::analysis::{SolvedProblem, analyse};
use crate::deadline::Deadline;
use crate::methods::static_optimisation::{Labels, recruit};
use crate::model::Model;
use crate::motion::MotionTable;
use crate::nlp::kkt::Kkt;
use crate::nlp::options::SqpOptions;
use crate::nlp::problem::Problem;
use crate::nlp::termination::SqpStatus;
use crate::outcome::{Outcome, SolutionPoint, Status};
use crate::plausibility::{self, Warning};
use crate::prepare::{Failure, Prepared, Task, late};
use crate::recruited;
use crate::settings::{EffortOf, Method, MuscleDynamics, RegularityMode, Settings, WarmStart};
use crate::starts::{Starts, start_at};
use crate::transcription::collocation::Collocation;
use crate::warm::Answer;

/// Smallest number of intervals of a coarser mesh.
const COARSE_INTERVALS: usize = 10;

/// What a solve starts from.
#[derive(Clone, Copy)]
enum StartFrom<'a> {
    /// The start guess by inverse dynamics, or the solution on a coarser mesh where the settings ask for it.
    Guess,
    /// The solution of another job.
    Answer(&'a Answer),
    /// The solution of the same problem.
    Solution(&'a SolutionPoint),
}

/// Solves one job on `points` collocation points.
pub fn solve(model: &Model, motion: &MotionTable, settings: &Settings, points: usize) -> Outcome {
    solve_from(Task { model, motion, settings, points }, None).0
}

/// Solves one job, starting from the answer of another one (`before`) if given. Returns the outcome and, if it has
/// converged, the answer from which other jobs may start.
pub fn solve_from(task: Task<'_>, before: Option<&Answer>) -> (Outcome, Option<Answer>) {
    let clock = Clock::now();
    let (mut outcome, answer) = attempt(task, before.map_or(StartFrom::Guess, StartFrom::Answer), clock);
    outcome.job.wall_s = Some(clock.elapsed().as_secs_f64());
    (outcome, answer)
}

/// Adds to `solved`, the outcome of the same job with another `regularity` (`had`) or `trajectories`, what `task` asks
/// for in addition, without solving again. `None` if that needs another solve.
pub fn complete(task: Task<'_>, had: RegularityMode, solved: &Outcome) -> Option<Outcome> {
    if !is_completable(had, task.settings) {
        return None;
    }
    let wanted = task.settings.regularity;
    let is_new = wanted != had;
    let clock = Clock::now();
    let mut outcome = solved.clone();
    outcome.trajectories.clear();
    if is_new || task.settings.trajectories {
        let regularity = if is_new { wanted } else { RegularityMode::Off };
        // No iterations: only the stored solution is analysed, in what is left of the time.
        let left = |limit: f64| (limit - solved.job.wall_s.unwrap_or(0.0)).max(0.0);
        let time_limit_s = task.settings.time_limit_s.map(left);
        let trajectories = task.settings.trajectories;
        let again = Settings { regularity, trajectories, ..only_solved(task.settings) };
        let settings = Settings { max_iterations: 0, time_limit_s, ..again };
        let (again, _) =
            attempt(Task { settings: &settings, ..task }, StartFrom::Solution(solved.solution.as_ref()?), clock);
        if again.job.status != Status::Converged || again.job.iterations != Some(0) {
            return None;
        }
        if is_new {
            outcome.replace_ranks(&again);
        }
        outcome.trajectories = again.trajectories;
    }
    outcome.job.wall_s = Some(solved.job.wall_s.unwrap_or(0.0) + clock.elapsed().as_secs_f64());
    Some(outcome)
}

/// The settings of a job whose answer alone is wanted, from one start.
fn only_solved(settings: &Settings) -> Settings {
    let settings = settings.clone();
    Settings { starts: 1, regularity: RegularityMode::Off, trajectories: false, near_optimal: 0.0, ..settings }
}

/// Whether [`complete`] can turn an outcome with the regularity `had` into what `settings` ask for. Only the best
/// solution is stored, but ranks at every iteration need all iterates, and ranks at several optima need all optima.
pub fn is_completable(had: RegularityMode, settings: &Settings) -> bool {
    let wanted = settings.regularity;
    let has_all = had != RegularityMode::Off || settings.starts == 1;
    wanted == had || (wanted != RegularityMode::EveryIteration && (wanted == RegularityMode::Off || has_all))
}

/// The answer on a mesh with half as many intervals, itself started from one with half as many, and so on. `None` if
/// the settings do not ask for it, or the mesh cannot be halved.
fn coarser(task: Task<'_>, clock: Clock) -> Option<Answer> {
    let intervals = task.points - 1;
    if task.settings.warm_start != WarmStart::Mesh || intervals % 2 == 1 || intervals / 2 < COARSE_INTERVALS {
        return None;
    }
    let settings = only_solved(task.settings);
    attempt(Task { settings: &settings, points: intervals / 2 + 1, ..task }, StartFrom::Guess, clock).1
}

/// The answer of a given motion with activations as the effort, which is found more easily, where excitations are. `None` if
/// they are not.
fn without_excitations(task: Task<'_>, clock: Clock) -> Option<Answer> {
    if task.settings.method != Method::Prescribed || task.settings.effort_of != EffortOf::Excitation {
        return None;
    }
    let settings = Settings { effort_of: EffortOf::Activation, ..only_solved(task.settings) };
    attempt(Task { settings: &settings, ..task }, StartFrom::Guess, clock).1
}

/// Solves a job, turns a failure into an outcome, and adds the warnings.
fn attempt(task: Task<'_>, from: StartFrom<'_>, clock: Clock) -> (Outcome, Option<Answer>) {
    let model = with_settings(task.model, task.settings);
    let task = Task { model: &model, ..task };
    let (mut outcome, answer) =
        try_solve(task, from, clock).unwrap_or_else(|(status, reason)| (Outcome::failed(status, reason), None));
    // A motion in the wrong unit may be the reason for a failure.
    let motion = plausibility::of_motion(task.motion, task.model, task.settings);
    warn(&mut outcome, motion, task.model, task.settings);
    (outcome, answer)
}

/// The model with what settings say about all of its muscles.
fn with_settings<'m>(model: &'m Model, settings: &Settings) -> Cow<'m, Model> {
    let is_rigid = settings.muscle_dynamics == MuscleDynamics::RigidTendon;
    let own_curves = settings.muscle_curves.is_none() && settings.activation_dynamics.is_none();
    if !is_rigid && settings.passive_forces && own_curves {
        return Cow::Borrowed(model);
    }
    let mut changed = model.clone();
    for muscle in &mut changed.muscles {
        muscle.rigid_tendon |= is_rigid;
        muscle.has_passive_force &= settings.passive_forces;
        if let Some(family) = settings.muscle_curves {
            muscle.set_curves(family);
        }
        if let Some(family) = settings.activation_dynamics {
            muscle.activation.family = family;
        }
    }
    Cow::Owned(changed)
}

/// A job at each of whose instants the loads are shared alone.
fn recruit_all(prepared: &Prepared<'_>, problem: &Collocation<'_>, settings: &Settings, deadline: Deadline) -> Outcome {
    let begun = Clock::now();
    let names = prepared.given.as_ref().and_then(|given| given.row_names());
    let labels = Labels { names, clock: prepared.measurement.clock };
    let found = recruit(&prepared.inverse, problem, settings, labels, deadline);
    let solve_s = begun.elapsed().as_secs_f64();
    let ranked = Clock::now();
    let (inverse, measurement) = (&prepared.inverse, &prepared.measurement);
    let mut outcome = recruited::outcome(&SolvedProblem { inverse, problem, measurement, settings, deadline }, &found);
    outcome.job.solve_s = Some(solve_s);
    outcome.job.rank_s = Some(ranked.elapsed().as_secs_f64());
    outcome
}

/// The pipeline: prepare, transcribe, start, solve, analyse.
fn try_solve(task: Task<'_>, from: StartFrom<'_>, clock: Clock) -> Result<(Outcome, Option<Answer>), Failure> {
    let settings = task.settings;
    let deadline = Deadline::after(clock, settings.time_limit_s);
    let prepared = Prepared::new(task, deadline)?;
    let problem = prepared.transcribe();
    in_time(deadline)?;

    if settings.method == Method::Static {
        return Ok((recruit_all(&prepared, &problem, settings, deadline), None));
    }
    let begun = Clock::now();
    let warm = match from {
        StartFrom::Guess => {
            let before = coarser(task, clock).or_else(|| without_excitations(task, clock));
            before.map(|answer| answer.start(&prepared.inverse, &problem))
        }
        StartFrom::Answer(answer) => Some(answer.start(&prepared.inverse, &problem)),
        StartFrom::Solution(solution) => Some(start_at(solution, &problem)),
    };
    let guess = || prepared.guess(deadline);
    let starts = Starts::new(warm, &guess, &prepared.inverse, &problem, settings)?;
    in_time(deadline)?;
    let mut kkt = Kkt::new(&problem);
    let size = prepared.size.check_solving(kkt.bytes(), problem.variables(), settings);
    size.map_err(|reason| (Status::Invalid, reason))?;
    in_time(deadline)?;
    let mut options = SqpOptions::default();
    (options.termination.max_iterations, options.termination.deadline) = (settings.max_iterations, deadline);
    let runs = starts.solve(&mut kkt, options);
    let solve_s = begun.elapsed().as_secs_f64();
    if runs.best.status == SqpStatus::NonFinite {
        return Err((Status::NonFinite, "a function or derivative became non-finite during the solve".to_owned()));
    }

    let ranked = Clock::now();
    let solved = SolvedProblem {
        inverse: &prepared.inverse,
        problem: &problem,
        measurement: &prepared.measurement,
        settings,
        deadline,
    };
    let mut outcome = analyse(&solved, &mut kkt, &runs);
    if settings.method == Method::Prescribed && outcome.job.status == Status::Infeasible {
        let reason = "the muscles cannot produce the moments of this motion, or cannot change them fast enough; add \
                      `reserves` to see where";
        let before = outcome.job.error.take().unwrap_or_default();
        outcome.job.error = Some(format!("{reason} ({before})"));
    }
    outcome.job.solve_s = Some(solve_s);
    outcome.job.rank_s = Some(ranked.elapsed().as_secs_f64());
    let few = (runs.made < settings.starts)
        .then(|| format!("{} of {} starts were made before the time limit", runs.made, settings.starts));
    let remarks: Vec<String> = few.into_iter().chain(outcome.job.remark.take()).collect();
    outcome.job.remark = (!remarks.is_empty()).then(|| remarks.join("; "));
    let converged = runs.best.status == SqpStatus::Converged;
    outcome.solution = converged.then(|| SolutionPoint::of(&runs.best.iterate));
    let answer = converged.then(|| Answer::new(&problem, prepared.scheme.clone(), &runs.best.iterate));
    Ok((outcome, answer))
}

fn in_time(deadline: Deadline) -> Result<(), Failure> {
    if deadline.passed() { Err(late()) } else { Ok(()) }
}

/// Adds the warnings about the motion and the answer; their texts follow the existing remark.
fn warn(outcome: &mut Outcome, motion: Option<Warning>, model: &Model, settings: &Settings) {
    let mut warnings = Vec::from_iter(motion);
    let found = plausibility::of_answer(outcome, model, settings);
    // A job that has not converged has no answer to warn about, but its fibres may show why it failed.
    let may_explain_failure = |warning: &Warning| ["passive", "fibre_length"].contains(&warning.code);
    warnings.extend(found.into_iter().filter(|w| outcome.job.status == Status::Converged || may_explain_failure(w)));
    let (codes, words) = plausibility::said(&warnings);
    outcome.job.warnings = codes;
    let remarks: Vec<String> = outcome.job.remark.take().into_iter().chain(words).collect();
    outcome.job.remark = (!remarks.is_empty()).then(|| remarks.join("; "));
}
