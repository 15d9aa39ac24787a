//! The ingredients of the solver one by one.

use num_dual::DualNum;
use sinew::internals::nlp::curvature::Model;
use sinew::internals::nlp::damping::Damping;
use sinew::internals::nlp::globalisation::{Filter, Verdict};
use sinew::internals::nlp::iterate::Iterate;
use sinew::internals::nlp::kkt::Kkt;
use sinew::internals::nlp::options::SqpOptions;
use sinew::internals::nlp::problem::Problem;
use sinew::internals::nlp::recovery::{Next, Recovery};
use sinew::internals::nlp::restoration::restore;
use sinew::internals::nlp::sqp::{SqpOutcome, solve};
use sinew::internals::nlp::state::State;
use sinew::internals::nlp::subproblem::active_set::{self, Ceiling};
use sinew::internals::nlp::subproblem::interior_point::{self, Interior, Manner};
use sinew::internals::nlp::subproblem::{NoStep, Quality, Step, Way};
use sinew::internals::nlp::termination::SqpStatus;
use sinew::internals::nlp::trace::Record;

use super::textbook::{self, Function, Objective, Textbook};

/// min f(x) subject to x ≥ 0.
fn bounded(f: Function, start: &[f64]) -> Textbook {
    let bounds: [Function; 3] = [|x| x[0], |x| x[1], |x| x[2]];
    Textbook::new("bounded", Objective::Value(f), vec![], bounds[..start.len()].to_vec(), start, &[])
}

/// Calls `then` with the state at a problem's start, the multiplier of t = f(x) being that of a solution.
fn at_start<T>(problem: &Textbook, then: impl FnOnce(&mut State<'_>) -> T) -> T {
    let options = SqpOptions::default();
    let mut here = Iterate::new(problem, problem.start.clone());
    here.equality_multipliers[0] = -1.0;
    let mut kkt = Kkt::new(problem);
    let mut state = State::new(&mut kkt, problem, here, options.progress);
    state.models.begin(&problem.start);
    then(&mut state)
}

fn by_active_set(problem: &Textbook, delta: f64, most: f64, active: &[bool]) -> Result<Step, NoStep> {
    let mut options = SqpOptions::default();
    // To the end, far from a solution too.
    options.active_set.per_error = 0.0;
    let ceiling = Ceiling { most, is_in_doubt: false };
    at_start(problem, |state| active_set::solve(state, &options, delta, ceiling, active))
}

fn by_interior_point(problem: &Textbook, manner: Manner, last: &mut Option<Interior>) -> Result<Step, NoStep> {
    at_start(problem, |state| interior_point::solve(state, &SqpOptions::default(), Model::Exact, 0.0, manner, last))
}

const TO_THE_END: Manner = Manner { most: 1.0, tolerance: 1e-9, steps: 40, is_plain: true };

fn assert_same(one: &Step, other: &Step) {
    let near = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);
    assert!(near(&one.direction, &other.direction), "{one:?}\n{other:?}");
    assert!(near(&one.inequality_multipliers, &other.inequality_multipliers), "{one:?}\n{other:?}");
    assert_eq!(one.active, other.active);
}

fn circle(sign: f64, x: &[textbook::N]) -> textbook::N {
    let squares = x[0] * x[0] * 4.0 + x[1] * x[1] * 9.0 + x[2] * x[2] * 7.0;
    let mixed = x[0] * x[1] * 5.0 - x[0] * x[2] * 5.0 - x[1] * x[2] * 5.0;
    squares * 0.5 + mixed + (x[0] * 2.0 + x[1] - x[2] * 3.0) * sign
}

/// Turning all wrong rows goes in a circle here from all but two active sets (after an example of F. E. Curtis, Z. Han
/// and D. P. Robinson, *Comput. Optim. Appl.* 60, 2015).
#[test]
fn the_active_set_is_found_from_each_guess() {
    for problem in [bounded(|x| circle(1.0, x), &[0.0; 3]), bounded(|x| circle(-1.0, x), &[0.0; 3])] {
        let mut first: Option<Step> = None;
        for guess in 0..8 {
            let active = [1, 2, 4].map(|bit| guess & bit != 0);
            let step = by_active_set(&problem, 0.0, 1.0, &active).unwrap();
            for (x, nu) in step.direction.iter().zip(&step.inequality_multipliers) {
                assert!(*x > -1e-9 && *nu > -1e-9 && (x * nu).abs() < 1e-9, "{guess}: {x} {nu}");
            }
            let first = first.get_or_insert_with(|| step.clone());
            assert_same(first, &step);
        }
    }
}

/// −x² + y² with the bounds away.
#[test]
fn negative_curvature_raises_the_damping_as_far_as_it_must() {
    let problem = bounded(|x| -(x[0] * x[0]) + x[1] * x[1] + x[0], &[0.5, 5.0]);
    let step = by_active_set(&problem, 1e-3, 100.0, &[false; 2]).unwrap();
    assert!(step.damping > 2.0 && step.damping < 20.0, "{}", step.damping);
    assert_eq!((step.way, step.quality), (Way::ActiveSet, Quality::Full));
    assert_eq!(by_active_set(&problem, 1e-3, 1.0, &[false; 2]).unwrap_err(), NoStep::TooCurved);
    let manner = Manner { most: 1.0, ..TO_THE_END };
    assert_eq!(by_interior_point(&problem, manner, &mut None).unwrap_err(), NoStep::TooCurved);
}

#[test]
fn the_interior_point_finds_what_the_active_set_finds() {
    for problem in [bounded(|x| circle(1.0, x), &[0.0; 3]), bounded(|x| circle(-1.0, x), &[0.3, 0.2, 0.1])] {
        let plain = by_interior_point(&problem, TO_THE_END, &mut None).unwrap();
        assert_eq!(plain.quality, Quality::Full);
        assert_same(&plain, &by_active_set(&problem, 0.0, 1.0, &[false; 3]).unwrap());
        let manner = Manner { is_plain: false, ..TO_THE_END };
        assert_same(&plain, &by_interior_point(&problem, manner, &mut None).unwrap());
    }
}

/// One step from where the last sub-problem ended is nearer to the solution than one from a start of its own.
#[test]
fn an_interior_point_goes_on_where_the_last_one_ended() {
    let problem = bounded(|x| circle(1.0, x), &[0.0; 3]);
    let exact = by_active_set(&problem, 0.0, 1.0, &[false; 3]).unwrap();
    let mut last = None;
    let few = Manner { steps: 3, is_plain: false, ..TO_THE_END };
    let error = |step: &Step| {
        let change = step.direction.iter().zip(&exact.direction).map(|(a, b)| (a - b).abs());
        change.fold(0.0, f64::max)
    };
    let first = by_interior_point(&problem, few, &mut last).unwrap();
    let second = by_interior_point(&problem, few, &mut last).unwrap();
    assert_eq!(first.quality, Quality::Rough);
    assert!(error(&second) < 0.5 * error(&first), "{} {}", error(&first), error(&second));
}

#[test]
fn the_filter_refuses_what_gets_on_with_neither() {
    let mut filter = Filter::new(SqpOptions::default().filter, 1.0);
    let judge = |filter: &Filter, trial| filter.judge((1.0, 10.0), 1.0, -1.0, 1.0, trial);
    assert_eq!(judge(&filter, (0.5, 20.0)), Verdict::Progress);
    assert_eq!(judge(&filter, (1.0, 10.0)), Verdict::Rejected);
    assert_eq!(judge(&filter, (1.0, 9.0)), Verdict::Progress);
    assert_eq!(judge(&filter, (1e3, 0.0)), Verdict::Rejected, "too wild");
    assert_eq!(judge(&filter, (f64::NAN, 0.0)), Verdict::Rejected);
    filter.add((0.5, 9.5));
    assert_eq!(judge(&filter, (0.6, 9.6)), Verdict::Rejected, "worse than what was met before");
    assert_eq!(judge(&filter, (0.4, 9.6)), Verdict::Progress);
    // Where the constraints hold, descent decides.
    let feasible = |trial| filter.judge((0.0, 10.0), 1.0, -1.0, 1.0, trial);
    assert_eq!([feasible((0.0, 9.0)), feasible((0.0, 9.99999))], [Verdict::Descent, Verdict::Rejected]);
}

fn named(name: &str) -> Textbook {
    textbook::all().into_iter().find(|problem| problem.name == name).expect("a textbook problem")
}

fn solved_with(problem: &Textbook, change: impl FnOnce(&mut SqpOptions)) -> SqpOutcome {
    let mut options = SqpOptions::default();
    change(&mut options);
    solve(problem, problem.start.clone(), options)
}

#[test]
fn the_second_order_correction_spares_short_steps() {
    let short = |change: fn(&mut SqpOptions)| -> usize {
        let all = textbook::all();
        let outcomes = all.iter().filter(|problem| !problem.is_degenerate).map(|problem| solved_with(problem, change));
        outcomes.map(|o| o.trace.iter().filter(|record| record.fraction.is_some_and(|alpha| alpha < 1.0)).count()).sum()
    };
    let (with, without) = (short(|_| {}), short(|options| options.correction.most = 0));
    assert!(5 * with < 4 * without, "{with} {without}");
}

/// A minimum far away behind negative curvature, which δ approaches in short steps.
#[test]
fn the_extension_makes_short_steps_long() {
    let far: Function = |x| (x[0] * x[0] * x[0] * x[0] * 1e-4 - x[0] * x[0]) * 1e-4;
    let problem = Textbook::new("far", Objective::Value(far), vec![], vec![], &[0.01], &[-0.25]);
    let with = solved_with(&problem, |_| {});
    let without = solved_with(&problem, |options| options.extension.doublings = 0);
    assert_eq!(with.status, SqpStatus::Converged);
    assert!((with.iterate.objective + 0.25).abs() < 1e-6);
    assert!(with.trace.iter().any(|record| record.extension > 1.0));
    assert!(with.iterations() < without.iterations(), "{} {}", with.iterations(), without.iterations());
}

#[test]
fn the_restoration_ends_where_the_constraints_are_nearly_met() {
    let problem = named("HS7");
    let options = SqpOptions::default();
    at_start(&problem, |state| {
        let before = state.here.violation();
        let mut record = Record::new(&state.here, state.error);
        assert_eq!(restore(state, &options, &mut record), Ok(true));
        assert!(state.here.violation() < before);
    });
    let [impossible, ..] = &textbook::infeasible()[..] else { panic!("there are some") };
    let mut options = options;
    options.restoration.goal = 0.0;
    at_start(impossible, |state| {
        let mut record = Record::new(&state.here, state.error);
        assert_eq!(restore(state, &options, &mut record), Err(SqpStatus::Infeasible));
    });
}

/// The other preset alone solves what the usual one does.
#[test]
fn the_thorough_preset_solves_the_textbook_problems_too() {
    // Of HS33 it goes to the origin, a stationary point of the violation.
    for problem in textbook::all().iter().filter(|problem| !problem.is_degenerate && problem.name != "HS33") {
        let outcome = solve(problem, problem.start.clone(), SqpOptions::default().thorough());
        assert_eq!(outcome.status, SqpStatus::Converged, "{}", problem.name);
        let is_near = |answer: &f64| (outcome.iterate.objective - answer).abs() <= 1e-6 * answer.abs().max(1.0);
        assert!(problem.answers.iter().any(is_near), "{}: {}", problem.name, outcome.iterate.objective);
    }
}

/// An error between target and tolerance is good enough once nothing helps any more.
#[test]
fn patience_ends() {
    let problem = named("HS6");
    let iterate = solved_with(&problem, |_| {}).iterate;
    let mut termination = SqpOptions::default().termination;
    at_start(&problem, |state| {
        state.move_to(iterate);
        let error = state.error.largest().max(problem.feasibility(&state.here.x));
        (termination.target, termination.tolerance) = (0.5 * error, 2.0 * error);
        assert_eq!(termination.judge(state, 5), None);
        state.progress.idle = termination.patience;
        assert_eq!(termination.judge(state, 5), Some(SqpStatus::Converged));
    });
}

/// f ~ 1/x has its minimum at infinity; Newton's step there is x/2, the leap takes many at once.
#[test]
fn the_leap_runs_ahead_where_newton_creeps() {
    let problem = Textbook::new("1/x", Objective::Value(|x| x[0].powi(-1)), vec![], vec![], &[40.0], &[0.0]);
    let with = solved_with(&problem, |options| options.extension.doublings = 0);
    let without = solved_with(&problem, |options| {
        options.extension.doublings = 0;
        options.leap.longest = 0.0;
    });
    assert!(with.trace.iter().any(|record| record.leap > 1.0));
    assert_eq!(with.status, SqpStatus::Converged);
    assert!(2 * with.iterations() < without.iterations(), "{} {}", with.iterations(), without.iterations());
}

#[test]
fn damping_falls_after_whole_steps_and_rises_after_refusals() {
    let options = SqpOptions::default().damping;
    let progress = at_start(&named("HS6"), |state| state.progress);
    let mut damping = Damping::new(options);
    assert_eq!(damping.delta, options.first);
    damping.after_step(1e-4, true, true, &progress);
    assert_eq!(damping.delta, options.lower * 1e-4);
    damping.after_step(1e-4, false, true, &progress);
    assert_eq!(damping.delta, 1e-4, "raised against negative curvature, it stays there");
    // Only without negative curvature it falls with the error.
    damping.begin(1e-6, &progress);
    assert_eq!(damping.delta, 1e-4);
    damping.after_step(1e-4, false, true, &progress);
    damping.begin(1e-6, &progress);
    assert_eq!(damping.delta, options.per_error * 1e-6);
    damping.after_refusal(1e-3);
    assert_eq!(damping.delta, options.retreat * 1e-3);
    damping.after_failure(0.0);
    assert_eq!(damping.delta, options.retreat * options.least_failed);
    assert_eq!(options.raised(options.largest), None);
}

#[test]
fn the_ladder_of_recovery_is_climbed_rung_by_rung() {
    let options = SqpOptions::default();
    let problem = named("HS6");
    at_start(&problem, |state| {
        let full = active_set::solve(state, &options, 1.0, Ceiling { most: 1e3, is_in_doubt: false }, &[]).unwrap();
        let rough = Step { quality: Quality::Rough, ..full.clone() };
        let mut filter = Filter::new(options.filter, 1.0);
        let mut recovery = Recovery::default();
        assert_eq!(recovery.next(state, &full, &filter, &options), Next::RaiseDamping);
        assert_eq!(recovery.next(state, &rough, &filter, &options), Next::ToTheEnd);
        assert_eq!(recovery.next(state, &full, &filter, &options), Next::Restore);
        // With a solution at hand.
        let small = 0.5 * options.line_search.at_hand;
        (state.error.stationarity, state.error.feasibility, state.error.complementarity) = (small, small, small);
        assert_eq!(recovery.next(state, &full, &filter, &options), Next::Restore, "an empty filter is in no way");
        filter.add((1.0, 1.0));
        assert_eq!(recovery.next(state, &full, &filter, &options), Next::NewFilter);
    });
}
