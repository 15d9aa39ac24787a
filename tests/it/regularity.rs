//! Predicted against computed deficiencies, for the jobs of Table 1 and for random patterns of active bounds.

use rand::{RngExt, SeedableRng};
use sinew::deadline::Deadline;
use sinew::guess::initial_guess;
use sinew::nlp::iterate::Iterate;
use sinew::nlp::regularity;
use sinew::outcome::Status;
use sinew::run::{RunOptions, run};
use sinew::solve::{discretise, prediction_setting, transcribe};
use sinew::study::Study;
use sinew::study::settings::{Bounds, LoadSharingGrid, Scheme};
use sinew::transcription::collocation::BoundKind;
use sinew::transcription::prediction::predict;
use sinew::transcription::scheme::Discretisation;

use super::support::{model, motion, prepare, root, settings};

#[test]
fn every_job_of_table_1_converges_and_has_the_predicted_deficiencies() {
    let study = Study::load(&root().join("studies/table1.toml")).unwrap();
    assert_eq!(study.jobs.len(), 12);
    let mut excused = 0;
    for job in &study.jobs {
        let model = study.model_of(job).unwrap();
        let outcome = sinew::solve::solve(&model, &study.motion, &job.settings, job.points);
        assert_eq!(outcome.job.status, Status::Converged, "{:?}", job.swept);
        for residual in [outcome.job.stationarity, outcome.job.feasibility, outcome.job.complementarity] {
            assert!(residual.unwrap() <= 1e-8, "{:?}: {residual:?}", job.swept);
        }
        let row = outcome.regularity.unwrap();
        assert_eq!(row.prediction_agrees, Some(true), "{:?} {row:?}", job.swept);
        let same = Some(row.a.deficiency) == row.a.predicted && Some(row.aj.deficiency) == row.aj.predicted;
        assert!(same || row.ambiguous);
        excused += usize::from(!same);
        // The fast rank of the last iterate comes from another factorisation of nearly the same matrices.
        assert!(outcome.iterations.last().unwrap().deficiency_a.is_some());
    }
    // Differences come from nearly free directions: fibre velocities that tend to infinity.
    assert!(excused <= 3, "{excused} of 12 differ from the prediction");
}

#[test]
fn dependent_active_bounds_are_counted_for_random_patterns() {
    let model = model("arm.toml");
    let table = motion("arm_curl.csv", &model);
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(8);
    for points in [4, 6] {
        let (instant, scheme, measurement) = prepare(&model, &table, points);
        let guess = initial_guess(&instant, &scheme, points, &measurement, Deadline::default()).unwrap();
        for round in 0..40 {
            let grid = if round % 2 == 0 { LoadSharingGrid::Measurement } else { LoadSharingGrid::Collocation };
            let settings = settings(|s| {
                s.bounds = Bounds::Both;
                s.load_sharing_grid = grid;
            });
            let problem = transcribe(&instant, &scheme, &measurement, &settings);
            // Some muscles are entirely idle; the others have a random pattern of bounds that are treated as active.
            let idle: Vec<bool> = (0..model.muscles.len()).map(|_| rng.random_range(0.0..1.0) < 0.3).collect();
            let mut x: Vec<f64> = guess.iter().map(|v| v + rng.random_range(-0.02..0.02)).collect();
            for m in 0..model.muscles.len() {
                for k in 0..scheme.state.dimension() {
                    let a = &mut x[scheme.activation_index(k, m)];
                    *a = if idle[m] { 0.0 } else { rng.random_range(0.05..0.6) };
                }
                for j in 0..points {
                    x[scheme.excitation_index(j, m)] = if idle[m] { 0.0 } else { rng.random_range(0.0..0.5) };
                }
            }
            let active: Vec<usize> = (0..problem.bounds.len())
                .filter(|&row| {
                    let bound = problem.bounds[row];
                    if idle[bound.muscle] {
                        // All a are at 0; each bound on u may or may not be treated as active, too.
                        bound.kind == BoundKind::Activation || rng.random_range(0.0..1.0) < 0.5
                    } else {
                        rng.random_range(0.0..1.0) < 0.4
                    }
                })
                .collect();
            let iterate = Iterate::new(&problem, x);
            let found = regularity::analyse_dense(&problem, &iterate, &active).unwrap();
            let setting = prediction_setting(&model, &scheme, &measurement, &settings);
            let predicted = predict(&problem, &iterate.x, &active, &setting);
            assert_eq!(Some(found.a.deficiency), predicted.a, "A, p = {points}, round {round}");
            assert_eq!(Some(found.aj.deficiency), predicted.aj, "[A; J], p = {points}, round {round}");
            let both = (found.a.deficiency, found.aj.deficiency);
            let by_qr = regularity::deficiencies_by_qr(&problem, &iterate, &active).unwrap();
            assert_eq!(by_qr, both, "QR and SVD");
            let counted = regularity::RankCounter::new(&problem).deficiencies(&iterate, &active).unwrap();
            assert_eq!(counted, both, "pivots and SVD");
        }
    }
}

#[test]
fn without_load_sharing_the_count_is_the_muscles_freedom() {
    // μ = 0, no active bounds: 2 nm + p (nm + nc − nq) = 10 + 6·3 = 28 at p = 6.
    let model = model("arm.toml");
    let table = motion("arm_curl.csv", &model);
    let (instant, scheme, measurement) = prepare(&model, &table, 6);
    let settings = settings(|s| {
        s.mu = 0.0;
        s.bounds = Bounds::None;
    });
    let problem = transcribe(&instant, &scheme, &measurement, &settings);
    let mut x = initial_guess(&instant, &scheme, 6, &measurement, Deadline::default()).unwrap();
    // Activations and slow fibres, so that every muscle produces force.
    for m in 0..5 {
        for k in 0..scheme.state.dimension() {
            x[scheme.activation_index(k, m)] = 0.2 + 0.01 * (k as f64);
            x[scheme.length_index(k, m)] = 1.0 + 0.002 * (k * k) as f64;
        }
    }
    let iterate = Iterate::new(&problem, x);
    let found = regularity::analyse_dense(&problem, &iterate, &[]).unwrap();
    assert_eq!(found.aj.deficiency, 28);
    let setting = prediction_setting(&model, &scheme, &measurement, &settings);
    assert_eq!(predict(&problem, &iterate.x, &[], &setting).aj, Some(28));
}

#[test]
fn a_result_folder_says_whether_each_answer_is_unique() {
    let folder = super::support::folder(&[("study.toml", super::support::SMALL)]);
    let (_, study) = super::support::study(&folder);
    let out = folder.path().join("out");
    run(&study, &RunOptions { out: out.clone(), threads: Some(1), ..RunOptions::default() }, &false.into()).unwrap();
    let table = sinew::tables::read("regularity", &out.join("regularity.parquet")).unwrap();
    for row in 0..table.rows() {
        let none = |name| table.integer(name, row) == Some(0);
        assert_eq!(table.flag("unique", row), Some(none("deficiency_a") && none("deficiency_aj")));
        // With μ > 0, free directions change values between the points, but never a force at a point.
        assert_eq!(table.flag("loads_unique", row), Some(true));
    }
}

/// Fine meshes, for which the thesis' method of counting takes seconds.
#[test]
fn on_fine_meshes_pivots_count_as_the_singular_values_do() {
    let model = model("arm.toml");
    let table = motion("arm_curl.csv", &model);
    for (scheme, points) in [(Scheme::Radau, 51), (Scheme::Midpoint, 101)] {
        let settings = settings(|s| (s.scheme, s.h) = (scheme, 1.0 / (points - 1) as f64));
        let measurement = super::support::measured(&settings, &model, &table, points);
        let (instant, scheme) = discretise(&model, &settings, points, table.duration());
        let problem = transcribe(&instant, scheme.as_ref(), &measurement, &settings);
        let mut x = initial_guess(&instant, scheme.as_ref(), points, &measurement, Deadline::default()).unwrap();
        // One muscle is idle: all but a few of its active bounds on a and u depend on the others.
        (0..scheme.state_coefficients()).for_each(|k| x[scheme.activation_index(k, 4)] = 0.0);
        (0..scheme.control_coefficients()).for_each(|j| x[scheme.excitation_index(j, 4)] = 0.0);
        let iterate = Iterate::new(&problem, x);
        let active: Vec<usize> = (0..problem.bounds.len()).filter(|&row| problem.bounds[row].muscle == 4).collect();
        let found = regularity::analyse_dense(&problem, &iterate, &active).unwrap();
        let counted = regularity::RankCounter::new(&problem).deficiencies(&iterate, &active).unwrap();
        assert_eq!(counted, (found.a.deficiency, found.aj.deficiency));
        assert!(counted.0 + 2 >= points, "{counted:?}");
    }
}
