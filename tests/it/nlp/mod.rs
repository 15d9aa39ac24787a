//! The solver on its own: textbook problems, every status, every ingredient.

pub mod textbook;

use sinew::internals::nlp::options::SqpOptions;
use sinew::internals::nlp::sqp::{SqpOutcome, solve};
use sinew::internals::nlp::termination::SqpStatus;
use textbook::Textbook;

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
        let near = |answer: &f64| (objective - answer).abs() <= 1e-6 * answer.abs().max(1.0);
        println!("{} {:?} {} {} {objective}", problem.name, outcome.status, outcome.iterations(), outcome.factorisations);
        if outcome.status != SqpStatus::Converged || !problem.answers.iter().any(near) {
            wrong.push(format!("{}: {:?} {objective} instead of {:?}", problem.name, outcome.status, problem.answers));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn problems_without_a_feasible_point_are_infeasible() {
    for problem in textbook::infeasible() {
        let outcome = solved(&problem);
        println!("{} {:?} {}", problem.name, outcome.status, outcome.iterations());
        assert_eq!(outcome.status, SqpStatus::Infeasible, "{}", problem.name);
    }
}

#[test]
fn zz_trace() {
    let Ok(name) = std::env::var("TB") else { return };
    for problem in textbook::all().iter().chain(&textbook::infeasible()).filter(|p| p.name == name) {
        let outcome = solved(problem);
        for (k, r) in outcome.trace.iter().enumerate() {
            println!(
                "{k:3} f {:12.6e} stat {:.1e} feas {:.1e} comp {:.1e} step {:.1e} δ {:.0e} α {:.3} {} ref {} leap {} ext {} {} fact {} x {:.3?}",
                r.objective, r.error.stationarity, r.error.feasibility, r.error.complementarity, r.step_norm,
                r.damping.unwrap_or(0.0), r.fraction.unwrap_or(0.0), r.way.map_or("-", |w| w.name()), r.refusals, r.leap,
                r.extension, if r.is_restored { "restored" } else { "" }, r.factorisations, r.x
            );
        }
        println!("{:?}", outcome.status);
    }
}
