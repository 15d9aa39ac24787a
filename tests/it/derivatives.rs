//! Derivatives of the transcribed problem against finite differences, at random points near the start guess.

use rand::{RngExt, SeedableRng};
use sinew::internals::deadline::Deadline;
use sinew::internals::methods::dynamic;
use sinew::internals::model::file::ModelFile;
use sinew::internals::motion::Surroundings;
use sinew::internals::nlp::iterate::Iterate;
use sinew::internals::nlp::problem::{Curvature, Multipliers, Problem};
use sinew::internals::numerics::sparse::Sparse;
use sinew::internals::settings::{Bounds, Scheme};

use super::support::{check_derivatives, model, motion, prepare, random_instant, settings};

fn dense(matrix: &Sparse) -> Vec<Vec<f64>> {
    let mut rows = vec![vec![0.0; matrix.columns]; matrix.rows];
    matrix.entries().for_each(|(i, j, slot)| rows[i][j] += matrix.values[slot]);
    rows
}

#[test]
fn jacobians_and_hessian_of_the_whole_problem_agree_with_differences() {
    let cases = [
        ("arm.toml", "arm_curl.csv", 4, Scheme::Midpoint, 1),
        ("arm.toml", "arm_curl.csv", 4, Scheme::Radau, 1),
        ("arm.toml", "arm_curl.csv", 3, Scheme::Radau, 3),
        ("pedal.toml", "pedal_turn.csv", 3, Scheme::Midpoint, 1),
        ("pedal.toml", "pedal_turn.csv", 3, Scheme::Radau, 2),
    ];
    for (model_name, motion_name, points, scheme, stages) in cases {
        let model = model(model_name);
        let table = motion(motion_name, &model);
        let settings = settings(|s| {
            s.bounds = Bounds::ExcitationBoxed;
            (s.scheme, s.stages) = (scheme, stages);
            // The convex term, beside the least squares.
            s.effort_power = if stages == 3 { 3.0 } else { 2.0 };
        });
        let prepared = prepare(&model, &table, &settings, points);
        let problem = prepared.transcribe();
        let guess = prepared.guess(Deadline::default()).unwrap();
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(6);
        let mut here = Iterate::new(&problem, guess.iter().map(|x| x + rng.random_range(-0.02..0.02)).collect());
        here.equality_multipliers.iter_mut().for_each(|l| *l = rng.random_range(-1.0..1.0));
        here.inequality_multipliers.iter_mut().for_each(|l| *l = rng.random_range(0.0..1.0));
        let (a, b) = (dense(&here.equality_jacobian), dense(&here.inequality_jacobian));
        let [_, _, pattern] = problem.patterns();
        let mut hessian = pattern.clone();
        problem.hessian(&here.x, here.multipliers(), Curvature::Exact, &mut hessian);
        let hessian = dense(&hessian);
        for k in 0..here.x.len() {
            let e = 1e-6;
            let shifted = |s: f64| {
                let mut there = here.clone();
                there.x[k] += s;
                there.evaluate(&problem);
                there.differentiate(&problem);
                there
            };
            let (low, high) = (shifted(-e), shifted(e));
            let check = |exact: f64, low: f64, high: f64, what: &str, tolerance: f64| {
                let difference = (high - low) / (2.0 * e);
                assert!(
                    (difference - exact).abs() < tolerance * (1.0 + exact.abs()),
                    "{model_name} {what} by {k}: {difference} and {exact}"
                );
            };
            check(here.gradient[k], low.objective, high.objective, "objective", 1e-6);
            (0..a.len()).for_each(|i| check(a[i][k], low.equalities[i], high.equalities[i], "equality", 2e-5));
            (0..b.len()).for_each(|i| check(b[i][k], low.inequalities[i], high.inequalities[i], "inequality", 2e-5));
            // ∇L = ∇f + Aᵀλ − Bᵀν: the sign convention, tested.
            let (g_low, g_high) = (low.lagrangian_gradient(), high.lagrangian_gradient());
            for i in 0..here.x.len() {
                check(hessian[i.min(k)][i.max(k)], g_low[i], g_high[i], "Lagrangian gradient", 1e-3);
            }
        }
    }
}

#[test]
fn the_convexified_hessian_is_positive_semidefinite_and_above_the_gauss_newton_one() {
    let model = model("arm.toml");
    let table = motion("arm_curl.csv", &model);
    let settings = settings(|_| ());
    let prepared = prepare(&model, &table, &settings, 4);
    let problem = prepared.transcribe();
    let guess = prepared.guess(Deadline::default()).unwrap();
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(7);
    let lambda: Vec<f64> = (0..problem.equalities()).map(|_| rng.random_range(-1.0..1.0)).collect();
    let nu = vec![0.1; problem.inequalities()];
    let [_, _, pattern] = problem.patterns();
    let smallest = |curvature| {
        let mut hessian = pattern.clone();
        let multipliers = Multipliers { equalities: &lambda, inequalities: &nu };
        problem.hessian(&guess, multipliers, curvature, &mut hessian);
        let n = hessian.columns;
        let rows = dense(&hessian);
        let full = faer::Mat::from_fn(n, n, |i, j| rows[i.min(j)][i.max(j)]);
        full.self_adjoint_eigenvalues(faer::Side::Lower).unwrap()[0]
    };
    assert!(smallest(Curvature::Convex) > -1e-9);
    assert!(smallest(Curvature::Exact) < -1e-3, "random multipliers give negative curvature");
}

/// Random variables of a model with every kind of joint, a loop, via points, loads, an actuator, reserves and unequal times.
#[test]
fn every_block_has_its_derivatives() {
    let file: ModelFile = toml::from_str(include_str!("../fixtures/everything.toml")).unwrap();
    let model = file.check().unwrap();
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(4);
    for scheme in [Scheme::Midpoint, Scheme::Radau] {
        let settings = settings(|s| (s.scheme, s.reserves) = (scheme, 4.0));
        let inverse = dynamic(&model, &settings, &std::sync::Arc::new(Surroundings::constant(&model)));
        for _ in 0..5 {
            let mut z = random_instant(&inverse, &mut rng);
            let given = inverse.control.given_at(0.0);
            z.iter_mut().zip(&given).filter(|(_, given)| **given != 0.0).for_each(|(z, given)| *z = *given);
            let multipliers: Vec<f64> = (0..inverse.control.rows()).map(|_| rng.random_range(-1.0..1.0)).collect();
            check_derivatives(&inverse.control, &z, &multipliers, |_| true, (1e-6, 2e-5));
        }
    }
}
