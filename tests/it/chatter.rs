//! Excitations that alternate from point to point: nothing in the thesis' objective keeps them from it.

use sinew::internals::outcome::{Outcome, Status};
use sinew::internals::settings::{LoadSharingGrid, RegularityMode, Scheme};
use sinew::internals::solve::solve;

use super::support::{model, motion, settings};

fn solved(scheme: Scheme, stages: usize, h: f64, excitation_weight: f64, grid: LoadSharingGrid) -> Outcome {
    let arm = model("arm.toml");
    let settings = settings(|s| {
        (s.scheme, s.stages, s.h, s.load_sharing_grid) = (scheme, stages, h, grid);
        (s.regularity, s.excitation_weight) = (RegularityMode::Optimum, excitation_weight);
    });
    solve(&arm, &motion("arm_curl.csv", &arm), &settings, (1.0 / h).round() as usize + 1)
}

fn swings(outcome: &Outcome) -> f64 {
    outcome.muscles.iter().filter_map(|row| row.excitation_swings).fold(0.0, f64::max)
}

fn warns(outcome: &Outcome) -> bool {
    outcome.job.warnings.as_ref().is_some_and(|codes| codes.contains("chatter"))
}

#[test]
fn excitations_chatter_within_intervals_unless_they_cost() {
    let [free, costly] = [0.0, 0.1].map(|w| solved(Scheme::Radau, 3, 0.05, w, LoadSharingGrid::Measurement));
    for outcome in [&free, &costly] {
        assert_eq!(outcome.job.status, Status::Converged, "{:?}", outcome.job.error);
    }
    assert!(swings(&free) > 8.0 && warns(&free), "{}", swings(&free));
    assert!(swings(&costly) < 3.0 && !warns(&costly), "{}", swings(&costly));
    // The loads are nearly the same.
    for (one, other) in free.muscles.iter().zip(&costly.muscles) {
        let change = (one.mean_force_n - other.mean_force_n).abs();
        assert!(change < 0.02 * one.mean_force_n.abs().max(1.0), "{}: {change} N", one.muscle);
    }
}

/// Excitations in the objective add rows to J; the ranks are predicted with them.
#[test]
fn ranks_count_excitations() {
    for (scheme, stages) in [(Scheme::Midpoint, 1), (Scheme::Radau, 1), (Scheme::Radau, 2)] {
        for grid in [LoadSharingGrid::Measurement, LoadSharingGrid::Collocation] {
            let outcome = solved(scheme, stages, 0.1, 0.01, grid);
            assert_eq!(outcome.job.status, Status::Converged, "{:?}", outcome.job.error);
            let regularity = outcome.regularity.unwrap();
            assert_eq!(regularity.prediction_agrees, Some(true), "{scheme:?} {stages} {grid:?}: {regularity:?}");
        }
    }
}
