//! The Radau scheme: its order on a forward problem, its solutions for the arm, and its predicted deficiencies.

use rand::{RngExt, SeedableRng};
use sinew::internals::deadline::Deadline;
use sinew::internals::methods::dynamic;
use sinew::internals::methods::prediction::{Setting, predict};
use sinew::internals::model::Model;
use sinew::internals::motion::{Measurement, Surroundings};
use sinew::internals::nlp::iterate::Iterate;
use sinew::internals::nlp::options::SqpOptions;
use sinew::internals::nlp::regularity;
use sinew::internals::nlp::sqp;
use sinew::internals::nlp::termination::SqpStatus;
use sinew::internals::outcome::{Outcome, Status};
use sinew::internals::problem::Goal;
use sinew::internals::problem::goals::{Sample, Shape};
use sinew::internals::settings::{Bounds, Initial, LoadSharingGrid, Scheme, Settings};
use sinew::internals::solve::solve;
use sinew::internals::transcription::collocation::Collocation;
use sinew::internals::transcription::radau::Radau;
use sinew::internals::transcription::scheme::Discretisation;

use super::support::{self, measured, model, motion, prepare};

fn settings(stages: usize, change: impl FnOnce(&mut Settings)) -> Settings {
    support::settings(|s| {
        (s.scheme, s.stages) = (Scheme::Radau, stages);
        change(s);
    })
}

fn measure(model: &Model, settings: &Settings, points: usize) -> Measurement {
    measured(settings, model, &motion("arm_curl.csv", model), points)
}

/// Excitation of muscle `m` in the forward problem: smooth, never at a bound.
fn excitation(m: usize, t: f64) -> f64 {
    0.1 + 0.02 * m as f64 + t * t
}

/// At rest, with slightly stretched fibres, which all shorten from the start.
fn initial_state(model: &Model) -> Vec<f64> {
    let q = &measure(model, &settings(1, |_| ()), 6).coordinates[0];
    let mut state = q.clone();
    state.resize(2 * q.len(), 0.0);
    for (m, muscle) in model.muscles.iter().enumerate() {
        let mut path = muscle.path.buffer();
        muscle.path.length(q, false, &mut path);
        state.extend([excitation(m, 0.0), muscle.fibre_length(path.value, 0.0)]);
    }
    state
}

/// One interval of the scheme from `state` = (q, v, then a and l by muscle), as a least-squares problem with zero
/// residual.
fn step(model: &Model, stages: usize, start: f64, h: f64, state: &[f64]) -> Vec<f64> {
    let settings = settings(stages, |s| (s.initial, s.bounds) = (Initial::Free, Bounds::None));
    let inverse = dynamic(model, &settings, &std::sync::Arc::new(Surroundings::constant(model)));
    let scheme = Radau::new(&inverse.control, 1, stages, h);
    let (motion, muscles, nm) = (&inverse.motion, &inverse.muscles, model.muscles.len());
    let mut functions: Vec<_> = (0..motion.q.count).map(|i| (motion.coordinate, i)).collect();
    functions.extend((0..motion.q.count).map(|i| (motion.velocity.unwrap(), i)));
    functions.extend((0..nm).flat_map(|m| [(muscles.activation, m), (muscles.fibre_length.unwrap(), m)]));
    let mut x = vec![0.0; scheme.coefficients().total()];
    let sample =
        |time, (quantity, member), target| Sample { time, quantity, members: vec![(member, 1.0)], weight: 1.0, target };
    let mut samples = Vec::new();
    for (&(quantity, member), &value) in functions.iter().zip(state) {
        samples.push(sample(0.0, (quantity, member), value));
        (0..=stages).for_each(|k| x[scheme.coefficients().index(quantity, k, member)] = value);
    }
    for (j, &t) in scheme.points().iter().enumerate().skip(1) {
        for m in 0..nm {
            let value = excitation(m, start + t);
            samples.push(sample(t, (muscles.excitation.unwrap(), m), value));
            x[scheme.coefficients().index(muscles.excitation.unwrap(), j - 1, m)] = value;
        }
    }
    let goal = Goal { name: "forward", shape: Shape::Square, samples };
    let problem = Collocation::new(&inverse.control, &scheme, &[goal]);
    let mut options = SqpOptions::default();
    options.termination.target = 1e-11;
    let outcome = sqp::solve(&problem, x, options);
    assert_eq!(outcome.status, SqpStatus::Converged, "{:?}", outcome.iterate.kkt_error());
    let last = |&(quantity, member)| outcome.iterate.x[scheme.coefficients().index(quantity, stages, member)];
    functions.iter().map(last).collect()
}

/// The state at `to`, computed from the state at `from`.
pub fn forward(model: &Model, intervals: usize, stages: usize, (from, to): (f64, f64), state: Vec<f64>) -> Vec<f64> {
    let h = (to - from) / intervals as f64;
    (0..intervals).fold(state, |state, k| step(model, stages, from + k as f64 * h, h, &state))
}

#[test]
fn each_number_of_stages_has_its_order_on_a_smooth_forward_problem() {
    let model = model("arm.toml");
    // The stretched fibres snap back within a few milliseconds; after that the solution is smooth.
    let (from, to) = (0.03, 0.05);
    let start = forward(&model, 60, 3, (0.0, from), initial_state(&model));
    let fine = forward(&model, 64, 3, (from, to), start.clone());
    let error = |intervals, stages| {
        let state = forward(&model, intervals, stages, (from, to), start.clone());
        state.iter().zip(&fine).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    };
    for stages in 1..=3 {
        let errors = [8, 16, 32].map(|n| error(n, stages));
        let orders = [(errors[0] / errors[1]).log2(), (errors[1] / errors[2]).log2()];
        println!("{stages} stage(s): errors {errors:?}, orders {orders:?}");
        // With three stages, the last pair is at rounding level.
        let order = if stages == 3 { orders[0] } else { orders[1] };
        let textbook = (2 * stages - 1) as f64;
        assert!((order - textbook).abs() < 0.15, "{stages} stages: {orders:?}");
    }
}

fn solved(model: &Model, settings: &Settings, points: usize) -> Outcome {
    solve(model, &motion("arm_curl.csv", model), settings, points)
}

#[test]
fn every_case_of_table_1_converges_without_ringing() {
    let model = model("arm.toml");
    for (stages, points) in [(1, 6), (1, 11), (2, 6), (3, 6)] {
        for grid in [LoadSharingGrid::Measurement, LoadSharingGrid::Collocation] {
            for bounds in [Bounds::Activation, Bounds::Excitation, Bounds::Both] {
                let settings = settings(stages, |s| {
                    s.h = 1.0 / (points - 1) as f64;
                    s.bounds = bounds;
                    s.load_sharing_grid = grid;
                    s.trajectories = true;
                });
                let outcome = solved(&model, &settings, points);
                let case = format!("{stages} stages, {points} points, {grid:?}, {bounds:?}");
                assert_eq!(outcome.job.status, Status::Converged, "{case}");
                assert!(outcome.job.iterations.unwrap() <= 30, "{case}: {:?}", outcome.job.iterations);
                assert!(outcome.job.max_constraint_velocity.unwrap() < 1e-12, "{case}");
                assert!(outcome.job.mid_interval_error.unwrap().is_finite(), "{case}");
                let row = outcome.regularity.unwrap();
                assert_eq!(row.prediction_agrees, Some(true), "{case} {row:?}");
                if bounds == Bounds::Both {
                    assert!(outcome.muscles.iter().all(|m| m.ringing.unwrap() < 0.5), "{case} {:?}", outcome.muscles);
                    // The reactions alternate little relative to their size (they have kinks where a bound becomes
                    // active).
                    let reactions: Vec<f64> = outcome
                        .trajectories
                        .iter()
                        .filter(|row| row.signal == "reaction_n" && row.name == "elbow.1")
                        .map(|row| row.value)
                        .collect();
                    let largest = reactions.iter().fold(0.0f64, |a, r| a.max(r.abs()));
                    let zigzag = reactions
                        .windows(4)
                        .map(|w| (w[3] - 3.0 * w[2] + 3.0 * w[1] - w[0]).abs() / 8.0)
                        .fold(0.0, f64::max);
                    assert!(!reactions.is_empty() && zigzag < 0.2 * largest, "{case}: {zigzag} of {largest}");
                }
            }
        }
    }
}

#[test]
fn predicted_deficiencies_hold_for_random_patterns_of_active_bounds() {
    let model = model("arm.toml");
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(9);
    for (stages, initial) in
        [(1, Initial::Equilibrium), (2, Initial::Equilibrium), (3, Initial::Equilibrium), (1, Initial::Free)]
    {
        for round in 0..12 {
            let settings = settings(stages, |s| {
                s.initial = initial;
                if round % 2 == 1 {
                    s.load_sharing_grid = LoadSharingGrid::Collocation;
                }
            });
            let points = 5;
            let table = motion("arm_curl.csv", &model);
            let prepared = prepare(&model, &table, &settings, points);
            let (inverse, problem) = (&prepared.inverse, prepared.transcribe());
            let (muscles, places) = (&inverse.muscles, prepared.scheme.coefficients());
            let mut x = prepared.guess(Deadline::default()).unwrap();
            x.iter_mut().for_each(|v| *v += rng.random_range(-0.02..0.02));
            let idle: Vec<bool> = (0..model.muscles.len()).map(|_| rng.random_range(0.0..1.0) < 0.3).collect();
            for m in 0..model.muscles.len() {
                for k in 0..places.count(muscles.activation) {
                    x[places.index(muscles.activation, k, m)] = if idle[m] { 0.0 } else { rng.random_range(0.05..0.6) };
                }
                for j in 0..places.count(muscles.excitation.unwrap()) {
                    x[places.index(muscles.excitation.unwrap(), j, m)] =
                        if idle[m] { 0.0 } else { rng.random_range(0.0..0.5) };
                }
            }
            let active: Vec<usize> = (0..problem.bounds.len())
                .filter(|&row| {
                    let limit = problem.limit(&problem.bounds[row]);
                    let at_once = idle[support::muscle(&model, &limit.member)] && limit.name == "activation";
                    at_once || rng.random_range(0.0..1.0) < 0.4
                })
                .collect();
            let iterate = Iterate::new(&problem, x);
            let setting = Setting::new(inverse, problem.scheme, &prepared.measurement, &settings);
            let predicted = predict(inverse, &problem, &iterate.x, &active, &setting);
            let found = regularity::analyse_dense(&problem, &iterate, &active).unwrap();
            let case = format!("{stages} stages, {initial:?}, round {round}");
            assert_eq!(Some(found.a.deficiency), predicted.a, "A, {case}");
            assert_eq!(Some(found.aj.deficiency), predicted.aj, "[A; J], {case}");
            let counted = regularity::RankCounter::new(&problem).deficiencies(&iterate, &active).unwrap();
            assert_eq!(counted, (found.a.deficiency, found.aj.deficiency), "pivots and SVD, {case}");
        }
    }
}

#[test]
fn without_load_sharing_the_count_is_the_muscles_freedom() {
    // μ = 0, no active bounds: nm (2 nm with a free start) + P (nm + nc − nq) + (nq − nc) = 5 + 5·3 + 2 at five points.
    let model = model("arm.toml");
    for (initial, expected) in [(Initial::Equilibrium, 22), (Initial::Free, 27)] {
        let settings = settings(1, |s| {
            s.mu = 0.0;
            s.bounds = Bounds::None;
            s.initial = initial;
        });
        let table = motion("arm_curl.csv", &model);
        let prepared = prepare(&model, &table, &settings, 6);
        let (inverse, problem) = (&prepared.inverse, prepared.transcribe());
        let (muscles, places) = (&inverse.muscles, prepared.scheme.coefficients());
        let mut x = prepared.guess(Deadline::default()).unwrap();
        for m in 0..5 {
            for k in 0..places.count(muscles.activation) {
                x[places.index(muscles.activation, k, m)] = 0.2 + 0.01 * (k as f64);
                x[places.index(muscles.fibre_length.unwrap(), k, m)] = 1.0 + 0.002 * (k * k) as f64;
            }
        }
        let iterate = Iterate::new(&problem, x);
        let setting = Setting::new(inverse, problem.scheme, &prepared.measurement, &settings);
        assert_eq!(predict(inverse, &problem, &iterate.x, &[], &setting).aj, Some(expected));
        assert_eq!(regularity::analyse_dense(&problem, &iterate, &[]).unwrap().aj.deficiency, expected);
    }
}

#[test]
fn ranks_of_large_problems_are_those_of_the_dense_decomposition() {
    let model = model("arm.toml");
    for (points, mu) in [(11, 0.2), (26, 0.2), (26, 0.0)] {
        let settings = settings(1, |s| {
            s.h = 1.0 / (points - 1) as f64;
            s.mu = mu;
        });
        let table = motion("arm_curl.csv", &model);
        let prepared = prepare(&model, &table, &settings, points);
        let problem = prepared.transcribe();
        let guess = prepared.guess(Deadline::default()).unwrap();
        let outcome = sqp::solve(&problem, guess, SqpOptions::default());
        let active: Vec<usize> =
            (0..problem.bounds.len()).filter(|&r| outcome.iterate.inequalities[r] <= 1e-8).collect();
        let dense = regularity::analyse_dense(&problem, &outcome.iterate, &active).unwrap();
        let counted = regularity::RankCounter::new(&problem).analyse(&outcome.iterate, &active).unwrap();
        for (one, other) in [(&dense.a, &counted.a), (&dense.aj, &counted.aj)] {
            assert_eq!(one.deficiency, other.deficiency, "p = {points}, μ = {mu}");
            let ratio = one.last_kept().unwrap() / other.last_kept().unwrap();
            assert!((ratio - 1.0).abs() < 0.02, "p = {points}: {ratio}");
        }
        assert_eq!(dense.null_directions.is_empty(), counted.null_directions.is_empty());
    }
}
