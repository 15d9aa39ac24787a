//! The solver on its own: textbook problems, every status, every ingredient.

mod ingredients;
mod textbook;

use std::time::Instant;

use num_dual::DualNum;
use sinew::internals::deadline::Deadline;
use sinew::internals::nlp::options::SqpOptions;
use sinew::internals::nlp::sqp::{SqpOutcome, solve};
use sinew::internals::nlp::termination::SqpStatus;
use textbook::{N, Objective, Textbook};

fn solved(problem: &Textbook) -> SqpOutcome {
    solve(problem, problem.start.clone(), SqpOptions::default())
}

#[test]
fn textbook_problems_have_their_known_answers() {
    let problems = textbook::all();
    assert!(problems.len() >= 30);
    let mut wrong = Vec::new();
    for problem in &problems {
        let outcome = solved(problem);
        let objective = outcome.iterate.objective;
        let tolerance = if problem.is_degenerate { 2e-2 } else { 1e-6 };
        let is_near = |answer: &f64| (objective - answer).abs() <= tolerance * answer.abs().max(1.0);
        let is_over = problem.is_degenerate || outcome.status == SqpStatus::Converged;
        if !is_over || !problem.answers.iter().any(is_near) {
            wrong.push(format!("{}: {:?} {objective} instead of {:?}", problem.name, outcome.status, problem.answers));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// The KKT conditions, worked out anew from the problem's functions.
#[test]
fn answers_satisfy_the_conditions_of_optimality() {
    for problem in textbook::all().iter().filter(|problem| !problem.is_degenerate) {
        let iterate = solved(problem).iterate;
        let slope = iterate.lagrangian_gradient();
        let largest = |values: &[f64]| values.iter().fold(0.0f64, |a, v| a.max(v.abs()));
        let scale = largest(&iterate.gradient).max(1e-3);
        assert!(largest(&slope) <= 1e-8 * scale, "{}: {slope:?}", problem.name);
        assert!(largest(&iterate.equalities) <= 1e-8, "{}", problem.name);
        for (d, nu) in iterate.inequalities.iter().zip(&iterate.inequality_multipliers) {
            assert!(*d >= -1e-8 && *nu >= 0.0 && (d * nu).abs() <= 1e-8, "{}: {d} {nu}", problem.name);
        }
    }
}

#[test]
fn problems_without_a_feasible_point_are_infeasible() {
    for problem in textbook::infeasible() {
        assert_eq!(solved(&problem).status, SqpStatus::Infeasible, "{}", problem.name);
    }
}

#[test]
fn a_solve_ends_at_its_limits() {
    let problem = &textbook::all()[0];
    let mut options = SqpOptions::default();
    options.termination.max_iterations = 2;
    let outcome = solve(problem, problem.start.clone(), options);
    assert_eq!((outcome.status, outcome.iterations()), (SqpStatus::IterationLimit, 2));
    let mut options = SqpOptions::default();
    options.termination.deadline = Deadline::after(Instant::now(), Some(0.0));
    assert_eq!(solve(problem, problem.start.clone(), options).status, SqpStatus::TimeLimit);
}

#[test]
fn functions_that_are_not_finite_end_a_solve() {
    let root = Textbook::new("root of −1", Objective::Value(|x| x[0].sqrt()), vec![], vec![], &[-1.0], &[]);
    assert_eq!(solved(&root).status, SqpStatus::NonFinite);
}

/// Second derivatives that are not finite leave no way to solve a sub-problem.
#[test]
fn a_hessian_that_is_not_finite_ends_a_solve() {
    let bad = |x: &[N]| N::new(x[0].re, x[0].eps1, x[0].eps2, f64::NAN);
    let problem = Textbook::new("no curvature", Objective::Value(bad), vec![], vec![|x| x[0] - 1.0], &[2.0], &[]);
    assert_eq!(solved(&problem).status, SqpStatus::QpFailed);
}

/// With the wrong sign in a derivative no step gets anywhere.
#[test]
fn a_wrong_derivative_stalls() {
    let wrong = |x: &[N]| N::new(x[0].re * x[0].re - 1.0, -2.0 * x[0].re * x[0].eps1, -2.0 * x[0].re * x[0].eps2, 0.0);
    let problem = Textbook::new("wrong", Objective::Squares(vec![|x| x[0]]), vec![wrong], vec![], &[3.0], &[]);
    assert_eq!(solved(&problem).status, SqpStatus::Stalled);
}

#[test]
fn the_trace_accounts_for_all_work() {
    for problem in textbook::all().iter().filter(|problem| !problem.is_degenerate) {
        let outcome = solved(problem);
        let factorisations: usize = outcome.trace.iter().map(|record| record.factorisations).sum();
        assert_eq!(factorisations, outcome.factorisations, "{}", problem.name);
        let (last, steps) = outcome.trace.split_last().unwrap();
        assert!(last.way.is_none() && last.x == outcome.iterate.x, "{}", problem.name);
        for record in steps {
            assert!(record.way.is_none() || record.fraction.is_some_and(|alpha| alpha > 0.0 && alpha <= 1.0));
        }
    }
}

#[test]
fn the_same_solve_twice_is_the_same() {
    for problem in textbook::all() {
        let [one, other] = [(); 2].map(|()| solved(&problem));
        assert!(one.trace.iter().map(|record| &record.x).eq(other.trace.iter().map(|record| &record.x)));
    }
}
