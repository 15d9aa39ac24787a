//! One job to its outcome, the whole pipeline on one screen: measure, transcribe, guess, solve, polish, rank,
//! report. Pure: no disk, no printing, one thread.

use std::sync::Arc;
use std::time::Instant as Clock;

use rand::{RngExt, SeedableRng};

use crate::guess::start_guess;
use crate::model::Model;
use crate::motion::{Measurement, MotionSettings, MotionTable};
use crate::nlp::deadline::Deadline;
use crate::nlp::iterate::Iterate;
use crate::nlp::kkt::Kkt;
use crate::nlp::polish::{ACTIVE, active, polish};
use crate::nlp::regularity::{self, RankCounter};
use crate::nlp::sqp::{self, SqpOutcome, SqpSettings, SqpStatus, Start};
use crate::outcome::{IterationRow, JobRow, MatrixRank, OptimumRow, Outcome, RegularityRow, SpectrumRow, Status};
use crate::solution::{self, Solution};
use crate::study::settings::{Initial, LoadSharingGrid, RegularityMode, Scheme, Settings, WarmStart};
use crate::transcription::collocation::{BoundKind, Collocation, Combination};
use crate::transcription::instant::{ACTIVATION, Form, Instant};
use crate::transcription::midpoint::Midpoint;
use crate::transcription::prediction::{Setting, predict};
use crate::transcription::radau::Radau;
use crate::transcription::scheme::Discretisation;
use crate::uniqueness;
use crate::warm::Answer;

/// Objectives closer than this (relative) with the same idle muscles are one optimum.
const SAME_OPTIMUM: f64 = 1e-6;
/// A null direction (of length 1) that moves a normalised muscle force by more than this moves loads.
const MOVES_LOAD: f64 = 1e-6;

/// Meshes of fewer intervals are not halved any more.
const COARSE_INTERVALS: usize = 10;

/// Solves one job on `points` collocation points.
pub fn solve(model: &Model, table: &MotionTable, settings: &Settings, points: usize) -> Outcome {
    solve_from(model, table, settings, points, None).0
}

/// [`solve`], started from the answer of another job; and what one may start from this. None where it has not converged.
pub fn solve_from(
    model: &Model,
    table: &MotionTable,
    settings: &Settings,
    points: usize,
    before: Option<&Answer>,
) -> (Outcome, Option<Answer>) {
    let clock = Clock::now();
    let (mut outcome, answer) = solve_timed(model, table, settings, points, before, clock);
    outcome.job.wall_s = Some(clock.elapsed().as_secs_f64());
    (outcome, answer)
}

/// The answer on a mesh of half as many intervals, with a start of its own from half of those; none where that cannot be.
fn coarser(model: &Model, table: &MotionTable, settings: &Settings, points: usize, clock: Clock) -> Option<Answer> {
    let intervals = points - 1;
    if settings.warm_start != WarmStart::Mesh || intervals % 2 == 1 || intervals / 2 < COARSE_INTERVALS {
        return None;
    }
    let settings = Settings { starts: 1, regularity: RegularityMode::Off, trajectories: false, ..settings.clone() };
    solve_timed(model, table, &settings, intervals / 2 + 1, None, clock).1
}

fn solve_timed(
    model: &Model,
    table: &MotionTable,
    settings: &Settings,
    points: usize,
    before: Option<&Answer>,
    clock: Clock,
) -> (Outcome, Option<Answer>) {
    let measurement = match motion_settings(settings).measure(table, model, points) {
        Ok(measurement) => measurement,
        Err((time, gap)) => {
            let reason = format!(
                "the joints cannot all be closed at t = {time:.4} s: {} stay up to {:.3e} m or rad open, and no small \
                 change of the pose reduces that (slope {:.1e}); check the lengths of the bodies in this loop",
                gap.joints.join(", "),
                gap.gap,
                gap.slope
            );
            return (Outcome::failed(Status::Infeasible, reason), None);
        }
    };
    let (instant, scheme) = discretise(model, settings, points, table.duration() * settings.time_scale);
    let instant = instant.within(Arc::new(motion_settings(settings).surroundings(table, model)));
    let problem = transcribe(&instant, scheme.as_ref(), &measurement, settings);
    let deadline = Deadline::after(clock, settings.time_limit_s);
    let sqp_settings = SqpSettings { max_iterations: settings.max_iterations, deadline, ..SqpSettings::default() };
    let solved = Clock::now();
    let coarse = coarser(model, table, settings, points, clock);
    // The start by inverse dynamics gives way to a better one.
    let warm = before.or(coarse.as_ref()).map(|answer| answer.start(&problem, scheme.as_ref()));
    let mut starts: Vec<Start> = warm.into_iter().collect();
    let guess = || start_guess(&instant, scheme.as_ref(), points, &measurement);
    let is_warm = !starts.is_empty();
    if starts.len() < settings.starts {
        let Some(guess) = guess() else {
            let reason = "the start guess by inverse dynamics is not finite";
            return (Outcome::failed(Status::NonFinite, reason), None);
        };
        let rest = settings.first_start + starts.len()..settings.first_start + settings.starts;
        starts.extend(rest.map(|k| disturb(&guess, scheme.as_ref(), model, settings.seed, k).into()));
    }
    let mut kkt = Kkt::new(&problem);
    let solve = |kkt: &mut Kkt, start| sqp::solve_with(kkt, &problem, start, sqp_settings);
    let mut runs: Vec<SqpOutcome> = starts.into_iter().map(|start| solve(&mut kkt, start)).collect();
    // A warm start that leads nowhere gives way to the one by inverse dynamics.
    if is_warm && !deadline.passed() && runs.iter().all(|run| run.status != SqpStatus::Converged) {
        let cold = guess().map(|guess| disturb(&guess, scheme.as_ref(), model, settings.seed, settings.first_start));
        runs.extend(cold.map(|x| solve(&mut kkt, x.into())));
    }
    let solve_s = solved.elapsed().as_secs_f64();
    let best = best(&runs);
    let run = &runs[best];
    if run.status == SqpStatus::NonFinite {
        return (Outcome::failed(Status::NonFinite, "a function or derivative is not finite along the way"), None);
    }

    let ranked = Clock::now();
    // Ranks are taken at the polished point; it is also the solution where it is as good a one.
    let polished = if deadline.passed() { None } else { polished(&mut kkt, &problem, &run.iterate) };
    let ranked_at = polished.as_ref().unwrap_or(&run.iterate);
    let good = ranked_at.kkt_error().largest() <= sqp_settings.target.max(run.iterate.kkt_error().largest());
    let point = if good { ranked_at } else { &run.iterate };
    let solution = Solution { problem: &problem, scheme: scheme.as_ref(), measurement: &measurement, iterate: point };
    let mut outcome = Outcome {
        job: JobRow {
            status: run.status.into(),
            error: reason(run),
            n_starts: Some(runs.len() as i64),
            n_converged_starts: Some(runs.iter().filter(|r| r.status == SqpStatus::Converged).count() as i64),
            iterations: Some(run.iterations() as i64),
            polished: Some(polished.is_some()),
            solve_s: Some(solve_s),
            ..solution.job_row()
        },
        muscles: solution.muscle_rows(),
        ..Outcome::default()
    };
    if settings.trajectories {
        outcome.trajectories = solution.trajectory_rows();
    }
    let ranks_wanted = settings.regularity != RegularityMode::Off;
    let mut counter = (ranks_wanted && !deadline.passed()).then(|| RankCounter::new(&problem));
    counter.iter_mut().for_each(|counter| counter.deadline = deadline);
    let every = counter.as_mut().filter(|_| settings.regularity == RegularityMode::EveryIteration);
    outcome.iterations = iteration_rows(&problem, run, every);
    if let Some(counter) = &mut counter {
        let setting = prediction_setting(model, scheme.as_ref(), &measurement, settings);
        if let Some((row, spectrum, null_directions)) = regularity_rows(counter, &problem, ranked_at, &setting) {
            // The last iterate is the solution: its count is the polished one.
            if let (Some(last), true) = (outcome.iterations.last_mut(), run.status == SqpStatus::Converged) {
                (last.deficiency_a, last.deficiency_aj) = (Some(row.a.deficiency), Some(row.aj.deficiency));
            }
            (outcome.regularity, outcome.spectrum) = (Some(row), spectrum);
            let means = solution.mean_activations();
            let intervals = uniqueness::activation_intervals(&problem, point, &means, &null_directions, deadline);
            for (muscle, interval) in outcome.muscles.iter_mut().zip(intervals) {
                (muscle.mean_activation_low, muscle.mean_activation_high) = interval.unzip();
            }
        }
    }
    let known = outcome.regularity.as_ref().map(|row| (row.a.deficiency, row.aj.deficiency));
    outcome.optima = optima(&mut kkt, &problem, &runs, counter.as_mut(), known);
    outcome.job.n_distinct_optima = Some(outcome.optima.len() as i64);
    if ranks_wanted && run.status == SqpStatus::Converged {
        let tracking = measurement.times.len() * model.coordinates();
        let parameters = uniqueness::parameters(&problem, point, settings.mu, tracking);
        let means: Vec<f64> = outcome.muscles.iter().map(|muscle| muscle.mean_force_n).collect();
        let slopes = |direction: &[f64]| solution.mean_force_slopes(direction);
        outcome.sensitivities = uniqueness::sensitivities(&mut kkt, &problem, point, &parameters, slopes, &means);
    }
    if ranks_wanted && run.status == SqpStatus::Converged && deadline.passed() {
        let reason = "solved, but the time limit of the job passed before all ranks were taken; raise time_limit_s";
        (outcome.job.status, outcome.job.error) = (Status::TimeLimit, Some(reason.to_owned()));
    }
    outcome.job.rank_s = Some(ranked.elapsed().as_secs_f64());
    let answer = (run.status == SqpStatus::Converged).then(|| Answer::new(&problem, scheme, &run.iterate));
    (outcome, answer)
}

/// How the motion is measured for a job with these settings.
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

/// The equations at an instant and the scheme that `settings` ask for, on `points` points (p) over `duration` seconds.
pub fn discretise<'m>(
    model: &'m Model,
    settings: &Settings,
    points: usize,
    duration: f64,
) -> (Instant<'m>, Box<dyn Discretisation>) {
    match settings.scheme {
        Scheme::Midpoint => {
            let instant = Instant::new(model, Form::SecondOrder);
            let scheme = Midpoint::new(&instant, points, duration);
            (instant, Box::new(scheme))
        }
        Scheme::Radau => {
            let instant = Instant::new(model, Form::Stabilised);
            let equilibrium = settings.initial == Initial::Equilibrium;
            let scheme = Radau::new(&instant, points - 1, settings.stages, duration, equilibrium);
            (instant, Box::new(scheme))
        }
    }
}

/// Rows of the load-sharing term by muscle, without μ; none with μ = 0.
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

/// What the predicted deficiencies depend on beside the problem.
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

/// The problem of eq. (26): tracking of all body coordinates at the measured instants, and μ a.
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

/// Start k: the guess itself for k = 0; else its fibre lengths given a random alternation and its activations
/// a random factor and offset, seeded by (seed, k).
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

/// The converged run of lowest objective; if none converged, that of least KKT error.
fn best(runs: &[SqpOutcome]) -> usize {
    let converged = runs.iter().enumerate().filter(|(_, run)| run.status == SqpStatus::Converged);
    let nearest = || {
        let error = |run: &SqpOutcome| Some(run.iterate.kkt_error().largest()).filter(|e| e.is_finite());
        let errors = runs.iter().enumerate().filter_map(|(k, run)| Some((k, error(run)?)));
        errors.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(k, _)| k)
    };
    converged.min_by(|a, b| a.1.iterate.objective.total_cmp(&b.1.iterate.objective)).map_or_else(nearest, |(k, _)| k)
}

/// The optima among the converged runs, the lowest first: objectives more than 1e-6 relative, or idle sets, apart. `lowest`: the deficiencies of
/// the lowest one where they are known.
fn optima(
    kkt: &mut Kkt,
    problem: &Collocation<'_>,
    runs: &[SqpOutcome],
    mut counter: Option<&mut RankCounter>,
    lowest: Option<(i64, i64)>,
) -> Vec<OptimumRow> {
    let mut converged: Vec<&SqpOutcome> = runs.iter().filter(|run| run.status == SqpStatus::Converged).collect();
    converged.sort_by(|a, b| a.iterate.objective.total_cmp(&b.iterate.objective));
    let mut optima: Vec<(OptimumRow, Vec<bool>)> = Vec::new();
    for run in converged {
        let (objective, idle) = (run.iterate.objective, idle(problem, &run.iterate.x));
        let same = |(row, other): &&mut (OptimumRow, Vec<bool>)| {
            let size = objective.abs().max(row.objective.abs());
            (row.objective - objective).abs() <= SAME_OPTIMUM * size && *other == idle
        };
        if let Some((row, _)) = optima.iter_mut().find(same) {
            row.starts += 1;
            continue;
        }
        let deficiencies = lowest.filter(|_| optima.is_empty()).or_else(|| {
            let counter = counter.as_mut()?;
            let point = polished(kkt, problem, &run.iterate).unwrap_or_else(|| run.iterate.clone());
            let (a, aj) = counter.deficiencies(&point, &active_rows(problem, &point).0)?;
            Some((a as i64, aj as i64))
        });
        let names = problem.instant.model.muscles.iter().zip(&idle).filter(|(_, idle)| **idle);
        let names: Vec<&str> = names.map(|(muscle, _)| muscle.name.as_str()).collect();
        let row = OptimumRow {
            objective,
            starts: 1,
            idle: names.join(", "),
            deficiency_a: deficiencies.map(|d| d.0),
            deficiency_aj: deficiencies.map(|d| d.1),
        };
        optima.push((row, idle));
    }
    optima.into_iter().map(|(row, _)| row).collect()
}

/// Which muscles have |a| ≤ 1e-8 at every collocation point.
pub fn idle(problem: &Collocation<'_>, x: &[f64]) -> Vec<bool> {
    let muscles = problem.instant.model.muscles.len();
    let mut idle = vec![true; muscles];
    for point in 0..problem.layout.times.len() {
        let z = problem.local(point, x);
        for (m, idle) in idle.iter_mut().enumerate() {
            *idle &= z[problem.instant.muscle(m) + ACTIVATION].abs() <= ACTIVE;
        }
    }
    idle
}

/// The solution with active bounds exactly on their value.
fn polished(kkt: &mut Kkt, problem: &Collocation<'_>, iterate: &Iterate) -> Option<Iterate> {
    let mut x = polish(kkt, problem, &iterate.x, &active(&iterate.inequalities))?;
    // An idle muscle is put to exactly 0 where a ≥ 0 is not imposed, too.
    for (m, idle) in idle(problem, &x).into_iter().enumerate() {
        if idle {
            let at = problem.instant.muscle(m) + ACTIVATION;
            let indices: Vec<usize> =
                problem.layout.points.iter().flat_map(|p| p.map[at].iter().map(|&(index, _)| index)).collect();
            indices.into_iter().for_each(|index| {
                if x[index].abs() <= ACTIVE {
                    x[index] = 0.0;
                }
            });
        }
    }
    let mut polished = Iterate::new(problem, x);
    polished.equality_multipliers.clone_from(&iterate.equality_multipliers);
    polished.inequality_multipliers.clone_from(&iterate.inequality_multipliers);
    Some(polished)
}

fn reason(run: &SqpOutcome) -> Option<String> {
    let error = run.iterate.kkt_error();
    let residuals = format!(
        "stationarity {:.1e}, feasibility {:.1e}, complementarity {:.1e}",
        error.stationarity, error.feasibility, error.complementarity
    );
    let reason = match run.status {
        SqpStatus::Converged => return None,
        SqpStatus::IterationLimit => format!("stopped after {} SQP iterations; raise max_iterations", run.iterations()),
        SqpStatus::TimeLimit => "the time limit of the job passed; raise time_limit_s".to_owned(),
        SqpStatus::QpFailed => "the quadratic sub-problem could not be solved".to_owned(),
        SqpStatus::Stalled => "no step is accepted any more".to_owned(),
        SqpStatus::Infeasible => "the constraints contradict each other near the last iterate".to_owned(),
        SqpStatus::NonFinite => "a function or derivative is not finite".to_owned(),
    };
    Some(format!("{reason} ({residuals})"))
}

/// Rows of `iterate`'s inequalities that are active, those of f_m ≥ 0 apart.
fn active_rows(problem: &Collocation<'_>, iterate: &Iterate) -> (Vec<usize>, Vec<usize>) {
    let active = active(&iterate.inequalities);
    (0..active.len()).filter(|&row| active[row]).partition(|&row| problem.bounds[row].kind != BoundKind::Force)
}

fn iteration_rows(
    problem: &Collocation<'_>,
    run: &SqpOutcome,
    mut counter: Option<&mut RankCounter>,
) -> Vec<IterationRow> {
    let solution = &run.iterate.x;
    run.trace
        .iter()
        .enumerate()
        .map(|(iteration, record)| {
            let deficiencies = counter.as_mut().filter(|counter| !counter.deadline.passed()).and_then(|counter| {
                let iterate = Iterate::new(problem, record.x.clone());
                counter.deficiencies(&iterate, &active_rows(problem, &iterate).0)
            });
            let distance = record.x.iter().zip(solution).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt();
            IterationRow {
                iteration: iteration as i64,
                objective: record.objective,
                stationarity: record.error.stationarity,
                feasibility: record.error.feasibility,
                complementarity: record.error.complementarity,
                step_norm: record.step_norm,
                distance_to_solution: distance,
                qp_iterations: record.qp_iterations as i64,
                deficiency_a: deficiencies.map(|d| d.0 as i64),
                deficiency_aj: deficiencies.map(|d| d.1 as i64),
            }
        })
        .collect()
}

/// Ranks at a polished point, beside what the pattern of active bounds predicts.
fn regularity_rows(
    counter: &mut RankCounter,
    problem: &Collocation<'_>,
    point: &Iterate,
    setting: &Setting,
) -> Option<(RegularityRow, Vec<SpectrumRow>, Vec<Vec<f64>>)> {
    let (bounds, force) = active_rows(problem, point);
    let found = counter.analyse(point, &bounds)?;
    let with_force = if force.is_empty() {
        (found.a.deficiency, found.aj.deficiency)
    } else {
        let mut all = bounds.clone();
        all.extend(&force);
        counter.deficiencies(point, &all)?
    };
    let predicted = predict(problem, &point.x, &bounds, setting);
    let row = |spectrum: &regularity::Spectrum, predicted: Option<usize>| MatrixRank {
        size: (spectrum.rank + spectrum.deficiency) as i64,
        rank: spectrum.rank as i64,
        deficiency: spectrum.deficiency as i64,
        predicted: predicted.map(|p| p as i64),
        tolerance: spectrum.tolerance,
        sigma_max: spectrum.sigma_max,
        sigma_last_kept: spectrum.last_kept(),
        sigma_first_dropped: spectrum.first_dropped(),
    };
    let agrees = |spectrum: &regularity::Spectrum, predicted: usize| {
        spectrum.deficiency == predicted || (spectrum.is_ambiguous() && spectrum.could_be(predicted))
    };
    let spectrum = [("a", &found.a), ("aj", &found.aj)]
        .into_iter()
        .flat_map(|(matrix, spectrum)| {
            spectrum.around_cut.iter().map(move |&(index, value)| SpectrumRow {
                matrix: matrix.to_owned(),
                index: index as i64,
                value,
            })
        })
        .collect();
    let regularity = RegularityRow {
        a: row(&found.a, predicted.a),
        aj: row(&found.aj, predicted.aj),
        deficiency_a_with_force: Some(with_force.0 as i64),
        deficiency_aj_with_force: Some(with_force.1 as i64),
        ambiguous: found.a.is_ambiguous() || found.aj.is_ambiguous(),
        prediction_agrees: predicted.a.zip(predicted.aj).map(|(a, aj)| agrees(&found.a, a) && agrees(&found.aj, aj)),
        unique: found.a.deficiency == 0 && found.aj.deficiency == 0,
        loads_unique: !found.null_directions.iter().any(|d| solution::moves_load(problem, &point.x, d, MOVES_LOAD)),
        null_space: uniqueness::describe(problem, &found.null_directions, &idle(problem, &point.x)),
    };
    Some((regularity, spectrum, found.null_directions))
}
