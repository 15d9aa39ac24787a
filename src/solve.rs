//! Solves one job, from its task to its outcome: measure, transcribe, guess, solve, polish, rank, report. Pure: no disk
//! access, no printing, one thread.

use std::sync::Arc;
use std::time::Instant as Clock;

use rand::{RngExt, SeedableRng};

use crate::analysis::{Runs, SolvedProblem, analyse};
use crate::deadline::Deadline;
use crate::guess::initial_guess;
use crate::memory;
use crate::model::Model;
use crate::motion::{Measurement, MeasurementError, MotionSettings, MotionTable};
use crate::nlp::iterate::Iterate;
use crate::nlp::kkt::Kkt;
use crate::nlp::polish::active;
use crate::nlp::problem::Problem;
use crate::nlp::sqp::{self, SqpOutcome, SqpSettings, SqpStatus, Start};
use crate::outcome::{Outcome, SolutionPoint, Status};
use crate::plausibility::{self, Warning};
use crate::study::settings::{Initial, LoadSharingGrid, RegularityMode, Scheme, Settings, WarmStart};
use crate::transcription::collocation::{Collocation, Combination};
use crate::transcription::instant::{Form, Instant};
use crate::transcription::midpoint::Midpoint;
use crate::transcription::prediction::Setting;
use crate::transcription::radau::Radau;
use crate::transcription::scheme::Discretisation;
use crate::warm::Answer;

/// Smallest number of intervals of a coarser mesh.
const COARSE_INTERVALS: usize = 10;

/// A job to solve: the model with the job's changes, the motion, the settings, and the number of collocation points.
#[derive(Clone, Copy)]
pub struct Task<'a> {
    pub model: &'a Model,
    pub motion: &'a MotionTable,
    pub settings: &'a Settings,
    pub points: usize,
}

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
        let settings = Settings { regularity, starts: 1, max_iterations: 0, time_limit_s, ..task.settings.clone() };
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
    let settings =
        Settings { starts: 1, regularity: RegularityMode::Off, trajectories: false, ..task.settings.clone() };
    attempt(Task { settings: &settings, points: intervals / 2 + 1, ..task }, StartFrom::Guess, clock).1
}

/// Solves a job, turns a failure into an outcome, and adds the warnings.
fn attempt(task: Task<'_>, from: StartFrom<'_>, clock: Clock) -> (Outcome, Option<Answer>) {
    let (mut outcome, answer) =
        try_solve(task, from, clock).unwrap_or_else(|(status, reason)| (Outcome::failed(status, reason), None));
    // A motion in the wrong unit may be the reason for a failure.
    let motion = plausibility::of_motion(task.motion, task.model, task.settings);
    warn(&mut outcome, motion, task.model, task.settings);
    (outcome, answer)
}

/// Why a job has no result.
type Failure = (Status, String);

fn try_solve(task: Task<'_>, from: StartFrom<'_>, clock: Clock) -> Result<(Outcome, Option<Answer>), Failure> {
    let Task { model, motion, settings, points } = task;
    let deadline = Deadline::after(clock, settings.time_limit_s);
    let size = memory::ProblemSize::of(&instant_of(model, settings), settings, points);
    size.check_transcribing(settings).map_err(|reason| (Status::Invalid, reason))?;
    let measurement = measured(task, deadline)?;
    let (instant, scheme) = discretise(model, settings, points, motion.duration() * settings.time_scale);
    let instant = instant.within(Arc::new(motion_settings(settings).surroundings(motion, model)));
    let problem = transcribe(&instant, scheme.as_ref(), &measurement, settings);
    in_time(deadline)?;
    let sqp_settings = SqpSettings { max_iterations: settings.max_iterations, deadline, ..SqpSettings::default() };
    let begun = Clock::now();
    let warm = match from {
        StartFrom::Guess => coarser(task, clock).map(|answer| answer.start(&problem, scheme.as_ref())),
        StartFrom::Answer(answer) => Some(answer.start(&problem, scheme.as_ref())),
        StartFrom::Solution(solution) => Some(start_at(solution, &problem)),
    };
    let guess = || initial_guess(&instant, scheme.as_ref(), points, &measurement, deadline);
    let (is_warm, is_alone) = (warm.is_some(), warm.is_some() && settings.starts == 1);
    let first = if is_alone { None } else { guess() };
    in_time(deadline)?;
    if first.is_none() && !is_alone {
        return Err((Status::NonFinite, "the start guess by inverse dynamics is not finite".to_owned()));
    }
    let disturbed = |guess: &[f64], k| disturb(guess, scheme.as_ref(), model, settings.seed, settings.first_start + k);
    let rest = (usize::from(is_warm)..settings.starts).filter_map(|k| Some(Start::from(disturbed(first.as_ref()?, k))));
    let mut kkt = Kkt::new(&problem);
    size.check_solving(kkt.bytes(), problem.variables(), settings).map_err(|reason| (Status::Invalid, reason))?;
    in_time(deadline)?;
    // The reserve after a warm start: if no start converges, the start guess by inverse dynamics is tried.
    let cold = || guess().map(|guess| disturbed(&guess, 0));
    let starts = warm.into_iter().chain(rest);
    let runs = solve_all(&mut kkt, &problem, starts, is_warm.then_some(&cold as &dyn Fn() -> _), sqp_settings);
    let solve_s = begun.elapsed().as_secs_f64();
    let run = &runs.best;
    if run.status == SqpStatus::NonFinite {
        return Err((Status::NonFinite, "a function or derivative became non-finite during the solve".to_owned()));
    }

    let ranked = Clock::now();
    let context =
        SolvedProblem { problem: &problem, scheme: scheme.as_ref(), measurement: &measurement, settings, deadline };
    let mut outcome = analyse(&context, &mut kkt, &runs);
    outcome.job.solve_s = Some(solve_s);
    outcome.job.rank_s = Some(ranked.elapsed().as_secs_f64());
    outcome.job.remark = (runs.made < settings.starts)
        .then(|| format!("{} of {} starts were made before the time limit", runs.made, settings.starts));
    let converged = run.status == SqpStatus::Converged;
    outcome.solution = converged.then(|| SolutionPoint {
        x: run.iterate.x.clone(),
        equality_multipliers: run.iterate.equality_multipliers.clone(),
        inequality_multipliers: run.iterate.inequality_multipliers.clone(),
    });
    let answer = converged.then(|| Answer::new(&problem, scheme, &run.iterate));
    Ok((outcome, answer))
}

/// A start at the solution of the same problem.
fn start_at(solution: &SolutionPoint, problem: &Collocation<'_>) -> Start {
    let active = active(&Iterate::new(problem, solution.x.clone()).inequalities);
    let (lambda, nu) = (solution.equality_multipliers.clone(), solution.inequality_multipliers.clone());
    Start { x: solution.x.clone(), multipliers: Some((lambda, nu, active)) }
}

fn measured(task: Task<'_>, deadline: Deadline) -> Result<Measurement, Failure> {
    let Task { model, motion, settings, points } = task;
    motion_settings(settings).measure(motion, model, points, deadline).map_err(|why| match why {
        MeasurementError::DeadlinePassed => late(),
        open => (Status::Infeasible, open.to_string()),
    })
}

fn late() -> Failure {
    (Status::TimeLimit, MeasurementError::DeadlinePassed.to_string())
}

fn in_time(deadline: Deadline) -> Result<(), Failure> {
    if deadline.passed() { Err(late()) } else { Ok(()) }
}

/// Solves from each start, as far as the time limit allows; if none converges, from the one in reserve.
fn solve_all(
    kkt: &mut Kkt,
    problem: &Collocation<'_>,
    mut starts: impl Iterator<Item = Start>,
    reserve: Option<&dyn Fn() -> Option<Vec<f64>>>,
    settings: SqpSettings,
) -> Runs {
    let first = starts.next().expect("there is a start");
    let mut runs = Runs::of(sqp::solve_with(kkt, problem, first, settings), problem);
    while !settings.deadline.passed()
        && let Some(start) = starts.next()
    {
        runs.add(sqp::solve_with(kkt, problem, start, settings), problem);
    }
    if !settings.deadline.passed()
        && runs.converged == 0
        && let Some(x) = reserve.and_then(|start| start())
    {
        runs.add(sqp::solve_with(kkt, problem, x, settings), problem);
    }
    runs
}

/// Adds the warnings about the motion and the answer; their texts follow the existing remark.
fn warn(outcome: &mut Outcome, motion: Option<Warning>, model: &Model, settings: &Settings) {
    let mut warnings = Vec::from_iter(motion);
    let found = plausibility::of_answer(&outcome.job, &outcome.muscles, model, settings);
    // A job that has not converged has no answer to warn about, but its fibres may show why it failed.
    let may_explain_failure = |warning: &Warning| ["passive", "fibre_length"].contains(&warning.code);
    warnings.extend(found.into_iter().filter(|w| outcome.job.status == Status::Converged || may_explain_failure(w)));
    let (codes, words) = plausibility::said(&warnings);
    outcome.job.warnings = codes;
    let remarks: Vec<String> = outcome.job.remark.take().into_iter().chain(words).collect();
    outcome.job.remark = (!remarks.is_empty()).then(|| remarks.join("; "));
}

/// How to measure the motion for a job with these settings.
pub fn motion_settings(settings: &Settings) -> MotionSettings {
    MotionSettings {
        measurement_ratio: settings.measured_per_interval(),
        smoothing_hz: settings.smoothing_hz,
        noise_sd: settings.noise_sd,
        seed: settings.seed,
        time_scale: settings.time_scale,
        changes: settings.motion.clone(),
    }
}

/// The equations at an instant, in the form that the scheme of `settings` needs.
fn instant_of<'m>(model: &'m Model, settings: &Settings) -> Instant<'m> {
    match settings.scheme {
        Scheme::Midpoint => Instant::new(model, Form::SecondOrder),
        Scheme::Radau => Instant::new(model, Form::Stabilised),
    }
}

/// The equations at an instant and the scheme of `settings`, on `points` points (p) over `duration` seconds.
pub fn discretise<'m>(
    model: &'m Model,
    settings: &Settings,
    points: usize,
    duration: f64,
) -> (Instant<'m>, Box<dyn Discretisation>) {
    let instant = instant_of(model, settings);
    let scheme: Box<dyn Discretisation> = match settings.scheme {
        Scheme::Midpoint => Box::new(Midpoint::new(&instant, points, duration)),
        Scheme::Radau => {
            let equilibrium = settings.initial == Initial::Equilibrium;
            Box::new(Radau::new(&instant, points - 1, settings.stages, duration, equilibrium))
        }
    };
    (instant, scheme)
}

/// Rows of the load-sharing term by muscle, without the factor μ; none if μ = 0.
fn sharing_rows(
    model: &Model,
    scheme: &dyn Discretisation,
    measurement: &Measurement,
    settings: &Settings,
) -> Vec<Vec<Combination>> {
    if settings.mu == 0.0 {
        return Vec::new();
    }
    let instants = match settings.load_sharing_grid {
        LoadSharingGrid::Measurement => &measurement.times,
        LoadSharingGrid::Collocation => scheme.points(),
    };
    (0..model.muscles.len()).map(|m| instants.iter().map(|&t| scheme.activation_at(t, m)).collect()).collect()
}

/// What the predicted deficiencies depend on in addition to the problem.
pub fn prediction_setting(
    model: &Model,
    scheme: &dyn Discretisation,
    measurement: &Measurement,
    settings: &Settings,
) -> Setting {
    Setting {
        sharing: sharing_rows(model, scheme, measurement, settings),
        motion_is_fixed: settings.measured_per_interval() >= settings.points_per_interval(),
    }
}

/// The problem of eq. (26), with the residuals of all body coordinates at the measured instants, and μ a.
pub fn transcribe<'m>(
    instant: &Instant<'m>,
    scheme: &dyn Discretisation,
    measurement: &Measurement,
    settings: &Settings,
) -> Collocation<'m> {
    let mut rows: Vec<Combination> = Vec::new();
    let mut data = Vec::new();
    for (&t, q) in measurement.times.iter().zip(&measurement.coordinates) {
        for (i, &value) in q.iter().enumerate() {
            let weight = instant.model.tracking_weight(i);
            rows.push(scheme.coordinate_at(t, 0, i).into_iter().map(|(k, w)| (k, weight * w)).collect());
            data.push(weight * value);
        }
    }
    for row in sharing_rows(instant.model, scheme, measurement, settings).into_iter().flatten() {
        rows.push(row.into_iter().map(|(i, w)| (i, settings.mu * w)).collect());
        data.push(0.0);
    }
    let activation_weight = 2.5 * settings.mu.max(1e-2).powi(2);
    Collocation::new(instant.clone(), scheme.layout(instant), &rows, data, &settings.bounds.kinds(), activation_weight)
}

/// Start k. For k = 0 this is the guess itself. Otherwise a random alternation is added to its fibre lengths, and its
/// activations get a random factor and offset, seeded by (seed, k).
pub fn disturb(guess: &[f64], scheme: &dyn Discretisation, model: &Model, seed: u64, k: usize) -> Vec<f64> {
    let mut x = guess.to_vec();
    if k == 0 {
        return x;
    }
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(k as u64);
    for m in 0..model.muscles.len() {
        let alternation: f64 = rng.random_range(-0.05..0.05);
        let (factor, offset): (f64, f64) = (rng.random_range(0.2..2.0), rng.random_range(0.0..0.15));
        for c in 0..scheme.state_coefficients() {
            let sign = if c % 2 == 0 { 1.0 } else { -1.0 };
            x[scheme.length_index(c, m)] += sign * alternation + rng.random_range(-0.02..0.02);
            let a = &mut x[scheme.activation_index(c, m)];
            *a = (factor * *a + offset + rng.random_range(-0.05..0.05)).clamp(0.0, 1.0);
        }
        for j in 0..scheme.control_coefficients() {
            x[scheme.excitation_index(j, m)] = x[scheme.activation_index(j, m)];
        }
    }
    scheme.settle(&mut x);
    x
}

/// Why a run did not converge, with its residuals; `None` if it converged.
pub fn reason(run: &SqpOutcome) -> Option<String> {
    let error = run.iterate.kkt_error();
    let residuals = format!(
        "stationarity {:.1e}, feasibility {:.1e}, complementarity {:.1e}",
        error.stationarity, error.feasibility, error.complementarity
    );
    let reason = match run.status {
        SqpStatus::Converged => return None,
        SqpStatus::IterationLimit => {
            format!("stopped after {} SQP iterations in all; raise max_iterations", run.iterations())
        }
        SqpStatus::TimeLimit => "the job reached its time limit; raise time_limit_s".to_owned(),
        SqpStatus::QpFailed => "the quadratic sub-problem could not be solved".to_owned(),
        SqpStatus::Stalled => "no further step is accepted".to_owned(),
        SqpStatus::Infeasible => "the constraints contradict each other near the last iterate".to_owned(),
        SqpStatus::NonFinite => "a function or derivative is not finite".to_owned(),
    };
    Some(format!("{reason} ({residuals})"))
}
