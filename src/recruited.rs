//! Turns the answer of a static job into result rows.

use crate::analysis::{SolvedProblem, ranked};
use crate::methods::prediction::Prediction;
use crate::methods::static_optimisation::{Recruited, Verdict};
use crate::nlp::regularity::RankCounter;
use crate::outcome::{JobRow, Outcome, RegularityRow, Status};
use crate::settings::{Criterion, RegularityMode, Settings};
use crate::solution::Solution;

/// The result rows.
pub fn outcome(context: &SolvedProblem<'_>, recruited: &Recruited) -> Outcome {
    let SolvedProblem { inverse, problem, measurement, settings, .. } = *context;
    let solution = Solution { inverse, problem, measurement, iterate: &recruited.iterate };
    let (status, error) = match &recruited.verdict {
        Verdict::Solved => (Status::Converged, None),
        Verdict::Infeasible(reason) => (Status::Infeasible, Some(reason.clone())),
        Verdict::Unsolved(reason) => (Status::QpFailed, Some(reason.clone())),
        Verdict::Late => (Status::TimeLimit, Some("the job reached its time limit; raise time_limit_s".to_owned())),
    };
    let row = solution.job_row();
    // A linear criterion is not the transcribed problem's: its programmes have their own tolerance.
    let is_checked = is_strictly_convex(settings);
    let mut outcome = Outcome {
        job: JobRow {
            status,
            error,
            n_starts: Some(1),
            n_converged_starts: Some(i64::from(status == Status::Converged)),
            iterations: Some(recruited.iterations as i64),
            objective: recruited.value,
            stationarity: row.stationarity.filter(|_| is_checked),
            complementarity: row.complementarity.filter(|_| is_checked),
            ..row
        },
        muscles: solution.muscle_rows(),
        reserves: solution.reserve_rows(),
        joints: solution.joint_rows(),
        ..Outcome::default()
    };
    for (m, muscle) in outcome.muscles.iter_mut().enumerate() {
        let near = recruited.near_optimal.as_ref().map(|all| all[m]);
        (muscle.mean_force_near_low_n, muscle.mean_force_near_high_n) = near.map(|[low, high]| (low, high)).unzip();
    }
    if settings.trajectories {
        let times = problem.scheme.points();
        let failed: Vec<f64> = recruited.failed.iter().map(|&j| measurement.clock + times[j]).collect();
        outcome.trajectories = solution.trajectory_rows();
        outcome.trajectories.retain(|row| !failed.contains(&row.time_s));
    }
    if status == Status::Converged && settings.regularity != RegularityMode::Off {
        add_uniqueness(&mut outcome, context, recruited);
    }
    if status == Status::Converged && settings.near_optimal > 0.0 && recruited.near_optimal.is_none() {
        outcome.job.remark = Some("near-optimal ranges are missing: a programme failed".to_owned());
    }
    if status == Status::Converged && context.deadline.passed() {
        let reason =
            "solved, but the job reached its time limit before ranges and ranks were complete; raise time_limit_s";
        (outcome.job.status, outcome.job.error) = (Status::TimeLimit, Some(reason.to_owned()));
    }
    outcome
}

/// Whether the criterion is, so that the loads are unique, whatever ranks say: those of a power above 2 do not see its curvature
/// where an effort is 0.
fn is_strictly_convex(settings: &Settings) -> bool {
    settings.criterion == Criterion::Polynomial && settings.effort_power >= 2.0
}

/// Adds ranks, verdicts and the intervals of mean activations.
fn add_uniqueness(outcome: &mut Outcome, context: &SolvedProblem<'_>, recruited: &Recruited) {
    let SolvedProblem { problem, settings, deadline, .. } = *context;
    // A sum is as unique as its faces are small.
    for (m, muscle) in outcome.muscles.iter_mut().enumerate() {
        let mean = muscle.mean_activation;
        let [low, high] = match &recruited.faces {
            Some(faces) => faces[m],
            None if recruited.is_unique => [mean; 2],
            None => continue,
        };
        (muscle.mean_activation_low, muscle.mean_activation_high) = (Some(low.min(mean)), Some(high.max(mean)));
    }
    if !is_strictly_convex(settings) || deadline.passed() {
        return;
    }
    let mut counter = RankCounter::new(problem);
    counter.deadline = deadline;
    let of_squares = settings.effort_power == 2.0;
    let predicted = Prediction { a: None, aj: of_squares.then_some(0) };
    if let Some((row, spectrum, _)) = ranked(&mut counter, context.inverse, problem, &recruited.iterate, predicted) {
        let row = RegularityRow { answer_unique: Some(true), loads_unique: Some(true), null_space: None, ..row };
        (outcome.regularity, outcome.spectrum) = (Some(row), spectrum);
    }
}
