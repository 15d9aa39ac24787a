//! Intervals, descriptions of null spaces, and sensitivities, each checked by an independent computation.

use sinew::internals::deadline::Deadline;
use sinew::internals::nlp::iterate::Iterate;
use sinew::internals::nlp::options::SqpOptions;
use sinew::internals::nlp::polish::active;
use sinew::internals::nlp::regularity::analyse_dense;
use sinew::internals::nlp::sqp;
use sinew::internals::outcome::Outcome;
use sinew::internals::prepare::Task;
use sinew::internals::settings::{Bounds, RegularityMode, Scheme, Settings};
use sinew::internals::solution::Solution;
use sinew::internals::solve::{solve, solve_from};
use sinew::internals::transcription::scheme::evaluate;
use sinew::internals::uniqueness::activation_intervals;

use super::support::{model, motion, prepare, settings};

fn radau(change: impl FnOnce(&mut Settings)) -> Settings {
    settings(|s| {
        s.scheme = Scheme::Radau;
        s.h = 0.1;
        s.regularity = RegularityMode::Optimum;
        change(s);
    })
}

fn slope(outcome: &Outcome, muscle: &str, parameter: &str) -> f64 {
    let row = outcome.sensitivities.iter().find(|row| row.muscle == muscle && row.parameter == parameter);
    row.unwrap_or_else(|| panic!("no row for {muscle} and {parameter}")).mean_force_slope
}

#[test]
fn sensitivities_are_those_of_solving_again() {
    let arm = model("arm.toml");
    let table = motion("arm_curl.csv", &arm);
    let at = |mu: f64, slack: f64| {
        let mut changed = arm.clone();
        changed.muscles[2].tendon_slack_length *= slack;
        let settings = radau(|s| (s.mu, s.bounds) = (mu, Bounds::Activation));
        let (first, answer) =
            solve_from(Task { model: &changed, motion: &table, settings: &settings, points: 11 }, None);
        (first, answer)
    };
    let (middle, _) = at(0.2, 1.0);
    let forces = |outcome: &Outcome| outcome.muscles.iter().map(|m| m.mean_force_n).collect::<Vec<_>>();
    let names: Vec<&str> = middle.muscles.iter().map(|m| m.muscle.as_str()).collect();
    let step = 1e-4;
    let (low, high) = (forces(&at(0.2 - step, 1.0).0), forces(&at(0.2 + step, 1.0).0));
    let biceps = arm.muscles[2].tendon_slack_length;
    let (short, long) = (forces(&at(0.2, 1.0 - step).0), forces(&at(0.2, 1.0 + step).0));
    let path = format!("muscle.{}.tendon_slack_length", names[2]);
    let mut largest = 0.0f64;
    for (m, name) in names.iter().enumerate() {
        let by_mu = (high[m] - low[m]) / (2.0 * step);
        let by_slack = (long[m] - short[m]) / (2.0 * step * biceps);
        largest = largest.max(by_mu.abs());
        assert!((slope(&middle, name, "mu") - by_mu).abs() < 2e-3 * (1.0 + by_mu.abs()), "{name} {by_mu}");
        let found = slope(&middle, name, &path);
        assert!((found - by_slack).abs() < 5e-3 * (1.0 + by_slack.abs()), "{name} {found} {by_slack}");
    }
    assert!(largest > 1.0, "μ moves loads");
}

/// With p > 2 the objective is no sum of squares: its curvature takes the place of JᵀJ in ranks and sensitivities.
#[test]
fn efforts_of_higher_powers_spread_the_load_and_are_unique() {
    let arm = model("arm.toml");
    let table = motion("arm_curl.csv", &arm);
    let at = |power: f64, mu: f64| {
        let settings = radau(|s| (s.effort_power, s.mu, s.bounds) = (power, mu, Bounds::Both));
        solve(&arm, &table, &settings, 11)
    };
    let (low, high) = (at(2.5, 0.2), at(4.0, 0.2));
    for outcome in [&low, &high] {
        assert_eq!(outcome.job.status, sinew::internals::outcome::Status::Converged, "{:?}", outcome.job.error);
        let row = outcome.regularity.as_ref().unwrap();
        assert_eq!((row.prediction_agrees, row.loads_unique), (Some(true), Some(true)), "{row:?}");
    }
    let peak = |outcome: &Outcome| outcome.muscles.iter().map(|m| m.peak_activation).fold(0.0, f64::max);
    assert!(peak(&high) < peak(&low), "{} {}", peak(&high), peak(&low));
    let step = 1e-4;
    let (less, more) = (at(4.0, 0.2 - step), at(4.0, 0.2 + step));
    for (m, row) in high.muscles.iter().enumerate() {
        let by_mu = (more.muscles[m].mean_force_n - less.muscles[m].mean_force_n) / (2.0 * step);
        let found = slope(&high, &row.muscle, "mu");
        assert!((found - by_mu).abs() < 1e-2 * (0.1 + by_mu.abs()), "{}: {found} {by_mu}", row.muscle);
    }
}

#[test]
fn without_load_sharing_activations_are_intervals_that_hold_every_null_direction() {
    let arm = model("arm.toml");
    let table = motion("arm_curl.csv", &arm);
    let settings = radau(|s| (s.mu, s.bounds) = (0.0, Bounds::Activation));
    let outcome = solve(&arm, &table, &settings, 11);
    assert_eq!(outcome.regularity.as_ref().unwrap().loads_unique, Some(false));
    assert!(outcome.regularity.as_ref().unwrap().null_space.is_some());
    let wide =
        |m: &sinew::internals::outcome::MuscleRow| m.mean_activation_high.unwrap() - m.mean_activation_low.unwrap();
    assert!(outcome.muscles.iter().any(|m| wide(m) > 1e-2), "{:?}", outcome.muscles);

    let prepared = prepare(&arm, &table, &settings, 11);
    let (inverse, measurement, problem) = (&prepared.inverse, &prepared.measurement, prepared.transcribe());
    let guess = prepared.guess(Deadline::default()).unwrap();
    let iterate: Iterate = sqp::solve(&problem, guess, SqpOptions::default()).iterate;
    let rows: Vec<usize> = (0..iterate.inequalities.len()).filter(|&r| active(&iterate.inequalities)[r]).collect();
    let null = analyse_dense(&problem, &iterate, &rows).unwrap().null_directions;
    let solution = Solution { inverse, problem: &problem, measurement, iterate: &iterate };
    let means = solution.mean_activations();
    let intervals = activation_intervals(inverse, &problem, &iterate, &means, &null, Default::default());
    // Follow each null direction until an activation leaves 0 … 1: the mean activation stays within the interval.
    let mut reached = 0;
    for direction in null.iter().flat_map(|d| [d.clone(), d.iter().map(|v| -v).collect()]) {
        let mut length = f64::INFINITY;
        for j in 0..problem.points.len() {
            let (z, dz) = (problem.local(j, &iterate.x), problem.local_change(j, &direction));
            for at in inverse.muscles.a.range() {
                let (a, da) = (z[at], dz[at]);
                let room = if da > 0.0 { (1.0 - a).max(0.0) / da } else { a.max(0.0) / -da };
                length = if da.abs() > 1e-9 { length.min(room) } else { length };
            }
        }
        for (mean, interval) in means.iter().zip(&intervals) {
            let (low, high) = interval.unwrap();
            let there = evaluate(mean, &iterate.x) + length.min(1e3) * evaluate(mean, &direction);
            assert!(there > low - 1e-6 && there < high + 1e-6, "{there} outside {low} … {high}");
            reached += usize::from(there > low + 1e-3 && there < high - 1e-3);
        }
    }
    assert!(reached > 0 && !null.is_empty());
}

#[test]
fn a_unique_load_is_an_interval_of_no_width() {
    let arm = model("arm.toml");
    let table = motion("arm_curl.csv", &arm);
    let outcome = solve(&arm, &table, &radau(|s| s.mu = 0.2), 11);
    for muscle in &outcome.muscles {
        let (low, high) = (muscle.mean_activation_low.unwrap(), muscle.mean_activation_high.unwrap());
        assert!((low - muscle.mean_activation).abs() < 1e-9 && (high - low).abs() < 1e-9, "{muscle:?}");
    }
    // An idle muscle's fibre is free in the midpoint scheme, and the description says so.
    let ringing = settings(|s| (s.bounds, s.regularity) = (Bounds::Both, RegularityMode::Optimum));
    let words = solve(&arm, &table, &ringing, 6).regularity.unwrap().null_space.unwrap();
    assert!(words.contains("while idle"), "{words}");
}
