//! Starts from the answers of other jobs.

use sinew::internals::prepare::Task;
use sinew::internals::settings::{RegularityMode, Scheme, WarmStart};
use sinew::internals::solve::{solve, solve_from};

use sinew::internals::transcription::scheme::evaluate;

use super::support::{model, motion, prepare, settings};

/// The points of a mesh with half the step contain the old points; there, the start has the old values.
#[test]
fn an_answer_is_prolonged_exactly() {
    let arm = model("arm.toml");
    let table = motion("arm_curl.csv", &arm);
    for (scheme, stages) in [(Scheme::Radau, 1), (Scheme::Radau, 3), (Scheme::Midpoint, 1)] {
        let settings = settings(|s| {
            (s.scheme, s.stages, s.h, s.regularity) = (scheme, stages, 0.1, RegularityMode::Off);
        });
        let (outcome, answer) = solve_from(Task { model: &arm, motion: &table, settings: &settings, points: 11 }, None);
        let same = prepare(&arm, &table, &settings, 11);
        let problem = same.transcribe();
        let answer = answer.unwrap();
        let start = answer.start(&same.inverse, &problem);
        let coarse = start.x.clone();
        // On its own mesh, the answer reproduces its solution, including the multipliers.
        let again = sinew::internals::nlp::sqp::solve(&problem, start, Default::default());
        assert!(again.iterations() <= 2, "{scheme:?} {stages}: {} iterations", again.iterations());
        assert!((again.iterate.objective - outcome.job.objective.unwrap()).abs() < 1e-9);

        if scheme == Scheme::Radau {
            let fine = prepare(&arm, &table, &settings, 21);
            let x = answer.start(&fine.inverse, &fine.transcribe()).x;
            for k in 0..=40 {
                let t = 0.025 * f64::from(k);
                for m in 0..arm.muscles.len() {
                    let fine = evaluate(&fine.inverse.activation_at(fine.scheme.as_ref(), t, m), &x);
                    let coarse = evaluate(&same.inverse.activation_at(same.scheme.as_ref(), t, m), &coarse);
                    assert!((fine - coarse).abs() < 1e-12, "{t} {fine} {coarse}");
                }
            }
        }
    }
}

#[test]
fn mesh_continuation_ends_where_a_cold_start_does_in_no_more_iterations() {
    let arm = model("arm.toml");
    let table = motion("arm_curl.csv", &arm);
    let run = |warm_start: WarmStart| {
        let settings = settings(|s| {
            (s.scheme, s.h, s.regularity, s.warm_start) = (Scheme::Radau, 0.025, RegularityMode::Off, warm_start);
        });
        solve(&arm, &table, &settings, 41).job
    };
    let (cold, warm) = (run(WarmStart::Off), run(WarmStart::Mesh));
    assert!((cold.objective.unwrap() / warm.objective.unwrap() - 1.0).abs() < 1e-6);
    assert!(warm.iterations.unwrap() <= 6, "{:?} after {:?} cold", warm.iterations, cold.iterations);
}
