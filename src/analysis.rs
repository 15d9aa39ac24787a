//! Turns the runs of a job into result rows: loads of the best run, ranks if requested, intervals of non-unique
//! activations, sensitivities to parameters, and discretisation errors.

use crate::deadline::Deadline;
use crate::mesh_error;
use crate::methods::InverseProblem;
use crate::methods::prediction::{Prediction, Setting, predict};
use crate::motion::Measurement;
use crate::names::counted;
use crate::near_optimal;
use crate::nlp::iterate::Iterate;
use crate::nlp::kkt::Kkt;
use crate::nlp::options::Termination;
use crate::nlp::polish::{ACTIVE, active, polish};
use crate::nlp::regularity::{self, RankCounter};
use crate::nlp::sqp::SqpOutcome;
use crate::nlp::termination::SqpStatus;
use crate::nlp::trace::{Record, distance};
use crate::outcome::{
    IterationRow, JobRow, MatrixRank, OptimumRow, Outcome, RegularityRow, SpectrumRow, Status, StepRow,
};
use crate::settings::{RegularityMode, Scheme, Settings};
use crate::solution::{self, Solution};
use crate::transcription::collocation::Collocation;
use crate::uniqueness::{self, Linearised};

/// Runs with the same idle muscles whose objectives differ by no more than this (relative) have reached the same
/// optimum.
const SAME_OPTIMUM: f64 = 1e-6;
/// A null direction of length 1 moves loads if it changes a normalised muscle force by more than this.
const MOVES_LOAD: f64 = 1e-6;

/// Results of the starts of a job. Only the best run and the distinct optima are kept, as there may be very many
/// starts.
pub struct Runs {
    /// The converged run with the lowest objective; if none has converged, the one with the smallest KKT error.
    pub best: SqpOutcome,
    /// Number of runs.
    pub made: usize,
    /// Number of converged runs.
    pub converged: usize,
    optima: Vec<Optimum>,
}

/// A distinct optimum; see [`SAME_OPTIMUM`].
struct Optimum {
    /// The iterate with the lowest objective.
    iterate: Iterate,
    /// By muscle.
    idle: Vec<bool>,
    /// Number of starts that reached it.
    starts: i64,
}

impl Runs {
    /// The results with the first run.
    pub fn of(run: SqpOutcome, inverse: &InverseProblem<'_>, problem: &Collocation<'_>) -> Self {
        let mut runs = Self { best: run, made: 1, converged: 0, optima: Vec::new() };
        if runs.best.status == SqpStatus::Converged {
            runs.converged = 1;
            runs.optima.push(Optimum::of(runs.best.iterate.clone(), inverse, problem));
        }
        runs
    }

    /// Adds a run.
    pub fn add(&mut self, run: SqpOutcome, inverse: &InverseProblem<'_>, problem: &Collocation<'_>) {
        self.made += 1;
        let error = |run: &SqpOutcome| Some(run.iterate.kkt_error().largest()).filter(|e| e.is_finite());
        let is_better = match (run.status == SqpStatus::Converged, self.converged > 0) {
            (true, true) => run.iterate.objective < self.best.iterate.objective,
            (false, false) => match (error(&run), error(&self.best)) {
                (Some(new), Some(old)) => new < old,
                (new, old) => new.is_some() && old.is_none(),
            },
            (new, _) => new,
        };
        if run.status == SqpStatus::Converged {
            self.converged += 1;
            let new = Optimum::of(run.iterate.clone(), inverse, problem);
            match self.optima.iter_mut().find(|known| known.is_same(&new)) {
                Some(known) => {
                    known.starts += 1;
                    if new.iterate.objective < known.iterate.objective {
                        known.iterate = new.iterate;
                    }
                }
                None => self.optima.push(new),
            }
        }
        if is_better {
            self.best = run;
        }
    }
}

impl Optimum {
    fn of(iterate: Iterate, inverse: &InverseProblem<'_>, problem: &Collocation<'_>) -> Self {
        Self { idle: inverse.idle(problem, &iterate.x), iterate, starts: 1 }
    }

    fn is_same(&self, other: &Self) -> bool {
        let (a, b) = (self.iterate.objective, other.iterate.objective);
        (a - b).abs() <= SAME_OPTIMUM * a.abs().max(b.abs()) && self.idle == other.idle
    }
}

/// The problem that a job has solved.
pub struct SolvedProblem<'c> {
    pub inverse: &'c InverseProblem<'c>,
    pub problem: &'c Collocation<'c>,
    pub measurement: &'c Measurement,
    pub settings: &'c Settings,
    pub deadline: Deadline,
}

/// The result rows of a job from its runs.
pub fn analyse(context: &SolvedProblem<'_>, kkt: &mut Kkt, runs: &Runs) -> Outcome {
    let SolvedProblem { inverse, problem, measurement, settings, deadline } = *context;
    let run = &runs.best;
    let converged = run.status == SqpStatus::Converged;
    // Ranks are computed at the polished point. It also serves as the solution if its KKT error is within the target or
    // no larger than that of the run.
    let polished = if deadline.passed() { None } else { polished(kkt, inverse, problem, &run.iterate) };
    let ranked_at = polished.as_ref().unwrap_or(&run.iterate);
    let target = Termination::default().target;
    let is_as_good = ranked_at.kkt_error().largest() <= target.max(run.iterate.kkt_error().largest());
    let point = if is_as_good { ranked_at } else { &run.iterate };
    let solution = Solution { inverse, problem, measurement, iterate: point };
    let mut outcome = Outcome {
        job: JobRow {
            status: run.status.into(),
            error: reason(run),
            n_starts: Some(runs.made as i64),
            n_converged_starts: Some(runs.converged as i64),
            iterations: Some(run.iterations() as i64),
            factorisations: Some(kkt.factorisations as i64),
            polished: Some(polished.is_some()),
            ..solution.job_row()
        },
        muscles: solution.muscle_rows(),
        reserves: solution.reserve_rows(),
        joints: solution.joint_rows(),
        ..Outcome::default()
    };
    if settings.trajectories {
        outcome.trajectories = solution.trajectory_rows();
    }
    let with_ranks = settings.regularity != RegularityMode::Off;
    let mut counter = (with_ranks && !deadline.passed()).then(|| RankCounter::new(problem));
    counter.iter_mut().for_each(|counter| counter.deadline = deadline);
    let every_iteration = counter.as_mut().filter(|_| settings.regularity == RegularityMode::EveryIteration);
    outcome.iterations = iteration_rows(problem, run, every_iteration);
    if let Some(counter) = &mut counter {
        add_ranks(&mut outcome, context, counter, &solution, ranked_at, converged);
    }
    let known = outcome.regularity.as_ref().map(|row| (row.a.deficiency, row.aj.deficiency));
    outcome.optima = optima(kkt, inverse, problem, &runs.optima, counter.as_mut(), known);
    outcome.job.n_distinct_optima = Some(outcome.optima.len() as i64);
    if converged && settings.near_optimal > 0.0 && !deadline.passed() {
        add_near_optimal(&mut outcome, kkt, &solution, settings.near_optimal);
    }
    if converged {
        add_changes(&mut outcome, context, kkt, &solution);
    }
    if with_ranks && converged && deadline.passed() {
        let reason = "solved, but the job reached its time limit before all ranks were computed; raise time_limit_s";
        (outcome.job.status, outcome.job.error) = (Status::TimeLimit, Some(reason.to_owned()));
        withdraw(&mut outcome);
    }
    outcome
}

/// Adds the ranges of mean forces at nearly the same cost, and a remark if some are missing.
fn add_near_optimal(outcome: &mut Outcome, kkt: &mut Kkt, solution: &Solution<'_>, share: f64) {
    let changes = near_optimal::changes(solution, kkt, share);
    let missing = changes.iter().filter(|change| change.is_none()).count();
    for (muscle, change) in outcome.muscles.iter_mut().zip(changes) {
        let range = change.map(|[less, more]| (muscle.mean_force_n + less, muscle.mean_force_n + more));
        (muscle.mean_force_near_low_n, muscle.mean_force_near_high_n) = range.unzip();
    }
    outcome.job.remark = (missing > 0).then(|| {
        let ranges = counted(missing, "near-optimal range");
        format!("{ranges} missing: the quadratic model is not convex there, or there is no effort")
    });
}

/// Adds ranks and, if the run has converged, the intervals of mean activations and the verdicts on uniqueness.
fn add_ranks(
    outcome: &mut Outcome,
    context: &SolvedProblem<'_>,
    counter: &mut RankCounter<'_>,
    solution: &Solution<'_>,
    ranked_at: &Iterate,
    converged: bool,
) {
    let SolvedProblem { inverse, problem, measurement, settings, deadline } = *context;
    let setting = Setting::new(inverse, problem.scheme, measurement, settings);
    let (bounds, _) = active_rows(problem, ranked_at);
    let predicted = predict(inverse, problem, &ranked_at.x, &bounds, &setting);
    let found = ranked(counter, inverse, problem, ranked_at, predicted);
    let Some((row, spectrum, null_directions)) = found else {
        return;
    };
    if converged {
        // The last iterate is the solution: report the deficiencies at the polished point for it.
        if let Some(last) = outcome.iterations.last_mut() {
            (last.deficiency_a, last.deficiency_aj) = (Some(row.a.deficiency), Some(row.aj.deficiency));
        }
        let means = solution.mean_activations();
        let intervals =
            uniqueness::activation_intervals(inverse, problem, solution.iterate, &means, &null_directions, deadline);
        for (muscle, interval) in outcome.muscles.iter_mut().zip(intervals) {
            (muscle.mean_activation_low, muscle.mean_activation_high) = interval.unzip();
        }
    }
    (outcome.regularity, outcome.spectrum) = (Some(row), spectrum);
    if !converged {
        withdraw(outcome);
    }
}

/// Removes the results that are valid only for a converged job.
fn withdraw(outcome: &mut Outcome) {
    if let Some(row) = &mut outcome.regularity {
        (row.multipliers_unique, row.answer_unique, row.loads_unique, row.null_space) = (None, None, None, None);
    }
    for muscle in &mut outcome.muscles {
        (muscle.mean_activation_low, muscle.mean_activation_high) = (None, None);
        muscle.mean_force_mesh_error_n = None;
    }
    outcome.sensitivities.clear();
    outcome.job.effort_mesh_error = None;
}

/// Adds sensitivities (if ranks are requested) and discretisation errors.
fn add_changes(outcome: &mut Outcome, context: &SolvedProblem<'_>, kkt: &mut Kkt, solution: &Solution<'_>) {
    let SolvedProblem { inverse, problem, settings, .. } = *context;
    let Some(mut linearised) = Linearised::new(kkt, problem, solution.iterate) else { return };
    if settings.regularity != RegularityMode::Off {
        // With a given motion nothing is weighed against it.
        let mu = if inverse.motion.is_given { 0.0 } else { settings.mu };
        let parameters = uniqueness::parameters(inverse, problem, solution.iterate, mu);
        let means: Vec<f64> = outcome.muscles.iter().map(|muscle| muscle.mean_force_n).collect();
        let slopes = |direction: &[f64]| solution.mean_force_slopes(direction);
        outcome.sensitivities = uniqueness::sensitivities(&mut linearised, inverse.model, &parameters, slopes, &means);
    }
    // The error of the midpoint scheme does not decrease with mesh refinement.
    let error = (settings.scheme == Scheme::Radau).then(|| mesh_error::estimate(solution, &mut linearised)).flatten();
    if let Some(error) = error {
        outcome.job.effort_mesh_error = Some(error.effort);
        for (muscle, error) in outcome.muscles.iter_mut().zip(error.mean_force_n) {
            muscle.mean_force_mesh_error_n = Some(error);
        }
    }
}

/// The optima reached by the starts, in order of increasing objective. `lowest`: the deficiencies of the first one, if
/// known.
fn optima(
    kkt: &mut Kkt,
    inverse: &InverseProblem<'_>,
    problem: &Collocation<'_>,
    reached: &[Optimum],
    mut counter: Option<&mut RankCounter<'_>>,
    lowest: Option<(i64, i64)>,
) -> Vec<OptimumRow> {
    let mut reached: Vec<&Optimum> = reached.iter().collect();
    reached.sort_by(|a, b| a.iterate.objective.total_cmp(&b.iterate.objective));
    let mut rows: Vec<OptimumRow> = Vec::new();
    for Optimum { iterate, idle, starts } in reached {
        let deficiencies = lowest.filter(|_| rows.is_empty()).or_else(|| {
            let counter = counter.as_mut()?;
            let point = polished(kkt, inverse, problem, iterate).unwrap_or_else(|| iterate.clone());
            let (a, aj) = counter.deficiencies(&point, &active_rows(problem, &point).0)?;
            Some((a as i64, aj as i64))
        });
        let names = inverse.model.muscles.iter().zip(idle).filter(|(_, idle)| **idle);
        let names: Vec<&str> = names.map(|(muscle, _)| muscle.name.as_str()).collect();
        rows.push(OptimumRow {
            objective: iterate.objective,
            starts: *starts,
            idle: names.join(", "),
            deficiency_a: deficiencies.map(|d| d.0),
            deficiency_aj: deficiencies.map(|d| d.1),
        });
    }
    rows
}

/// The solution with the active bounds satisfied exactly. `None` if polishing fails.
fn polished(
    kkt: &mut Kkt,
    inverse: &InverseProblem<'_>,
    problem: &Collocation<'_>,
    iterate: &Iterate,
) -> Option<Iterate> {
    let mut x = polish(kkt, problem, &iterate.x, &active(&iterate.inequalities))?;
    // Set the activation of an idle muscle to exactly 0, even where a ≥ 0 is not imposed.
    for (m, idle) in inverse.idle(problem, &x).into_iter().enumerate() {
        if idle {
            let maps = problem.points.iter().map(|point| &point.map.combinations[inverse.muscles.a.at(m)]);
            maps.flatten().for_each(|&(index, _)| {
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

/// Rows of the active inequalities of `iterate`, except f_m ≥ 0; and those of f_m ≥ 0.
fn active_rows(problem: &Collocation<'_>, iterate: &Iterate) -> (Vec<usize>, Vec<usize>) {
    let active = active(&iterate.inequalities);
    (0..active.len()).filter(|&row| active[row]).partition(|&row| !solution::is_force(problem, row))
}

/// One row per SQP iteration; deficiencies if there is a `counter`, until its deadline passes.
fn iteration_rows(
    problem: &Collocation<'_>,
    run: &SqpOutcome,
    mut counter: Option<&mut RankCounter<'_>>,
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
            IterationRow {
                iteration: iteration as i64,
                objective: record.objective,
                stationarity: record.error.stationarity,
                feasibility: record.error.feasibility,
                complementarity: record.error.complementarity,
                step_norm: record.step_norm,
                distance_to_solution: distance(&record.x, solution),
                qp_iterations: record.qp_iterations as i64,
                deficiency_a: deficiencies.map(|d| d.0 as i64),
                deficiency_aj: deficiencies.map(|d| d.1 as i64),
                step: step_row(record),
            }
        })
        .collect()
}

/// How the step away from a point came about, if there was one.
fn step_row(record: &Record) -> Option<StepRow> {
    let way = record.way.map(|way| way.name()).or(record.is_restored.then_some("restoration"))?;
    Some(StepRow {
        way: way.to_owned(),
        damping: record.damping,
        fraction: record.fraction,
        refusals: record.refusals as i64,
        leap: record.leap,
        extension: record.extension,
        factorisations: record.factorisations as i64,
    })
}

/// Ranks at a polished point, with the `predicted` deficiencies; the singular values
/// around the tolerance; and the null directions. `None` if the ranks cannot be computed.
pub fn ranked(
    counter: &mut RankCounter<'_>,
    inverse: &InverseProblem<'_>,
    problem: &Collocation<'_>,
    point: &Iterate,
    predicted: Prediction,
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
        multipliers_unique: Some(found.a.deficiency == 0),
        answer_unique: Some(found.aj.deficiency == 0),
        loads_unique: Some(
            !found.null_directions.iter().any(|d| solution::moves_load(inverse, problem, &point.x, d, MOVES_LOAD)),
        ),
        null_space: uniqueness::describe(inverse, problem, &found.null_directions, &inverse.idle(problem, &point.x)),
    };
    Some((regularity, spectrum, found.null_directions))
}

/// Why a run did not converge, with its residuals; `None` if it converged.
fn reason(run: &SqpOutcome) -> Option<String> {
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
