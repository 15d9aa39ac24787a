//! Cost of the solves of a study. The unit is specific to the problem: one KKT factorisation plus one evaluation of all
//! first and second derivatives, both at the start guess. Each time is that of the fastest of five runs.
//!
//! `cargo bench --bench cost -- STUDY [N]` solves every Nth job, for example `-- studies/table1.toml` or
//! `-- studies/robustness.toml 4`. Uses one thread.

mod case;

use std::hint::black_box;
use std::path::Path;
use std::time::Instant as Clock;

use case::Case;
use sinew::internals::nlp::iterate::Iterate;
use sinew::internals::nlp::kkt::{Kkt, Rows};
use sinew::internals::nlp::options::SqpOptions;
use sinew::internals::nlp::problem::{Curvature, Problem};
use sinew::internals::nlp::sqp;
use sinew::internals::nlp::termination::SqpStatus;
use sinew::internals::settings::Scheme;
use sinew::internals::study::{Job, Study};

/// Cost of one solve.
struct Cost {
    scheme: Scheme,
    converged: bool,
    iterations: usize,
    factorisations: usize,
    seconds: f64,
    /// Time in the unit described above.
    units: f64,
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|argument| !argument.starts_with("--")).collect();
    let path = arguments.first().map_or("studies/table1.toml", String::as_str);
    let every = arguments.get(1).and_then(|every| every.parse().ok()).unwrap_or(1);
    let study = case::study(Path::new(path));
    let costs: Vec<Cost> = study.jobs.iter().step_by(every).filter_map(|job| cost(study, job)).collect();
    for (name, scheme) in [("midpoint", Some(Scheme::Midpoint)), ("radau", Some(Scheme::Radau)), ("all", None)] {
        let of = || costs.iter().filter(|cost| scheme.is_none_or(|scheme| scheme == cost.scheme));
        if of().next().is_none() {
            continue;
        }
        println!(
            "{name}: {} of {} converged; medians: {:.0} iterations, {:.0} factorisations (90th percentile {:.0}), {:.1} ms, \
             {:.0} units; {:.1} s in total",
            of().filter(|cost| cost.converged).count(),
            of().count(),
            quantile(of().map(|cost| cost.iterations as f64), 0.5),
            quantile(of().map(|cost| cost.factorisations as f64), 0.5),
            quantile(of().map(|cost| cost.factorisations as f64), 0.9),
            1e3 * quantile(of().map(|cost| cost.seconds), 0.5),
            quantile(of().map(|cost| cost.units), 0.5),
            of().map(|cost| cost.seconds).sum::<f64>(),
        );
    }
}

/// The cost of a job's solve; `None` if the job has no measurement or start guess.
fn cost(study: &'static Study, job: &'static Job) -> Option<Cost> {
    let Case { problem, start: guess } = case::case(study, job)?;
    let mut kkt = Kkt::new(&problem);
    let mut here = Iterate::new(&problem, guess.clone());
    let [mut hessian, mut metric] = [0, 1].map(|_| problem.patterns()[2].clone());
    problem.metric(&here.x, &mut metric);
    let evaluation = fastest(|| {
        here.evaluate(&problem);
        here.differentiate(&problem);
        problem.hessian(&here.x, here.multipliers(), Curvature::Exact, &mut hessian);
    });
    let active = vec![false; here.inequalities.len()];
    // δ changes each time: unchanged parts of the matrix would not be factorised again.
    let mut damping = 1e-2;
    let factorisation = fastest(|| {
        damping *= 1.1;
        black_box(kkt.factorise(&here.system((&hessian, &metric), damping, Rows::Active(&active))))
    });

    let mut outcome = None;
    let seconds = fastest(|| {
        outcome = Some(sqp::solve_with(&mut kkt, &problem, guess.clone(), SqpOptions::default()));
    });
    let outcome = outcome?;
    Some(Cost {
        scheme: job.settings.scheme,
        converged: outcome.status == SqpStatus::Converged,
        iterations: outcome.iterations(),
        factorisations: outcome.factorisations,
        seconds,
        units: seconds / (factorisation + evaluation),
    })
}

/// Seconds of the fastest of five runs.
fn fastest<T>(mut run: impl FnMut() -> T) -> f64 {
    let timed = |_| {
        let clock = Clock::now();
        run();
        clock.elapsed().as_secs_f64()
    };
    (0..5).map(timed).fold(f64::INFINITY, f64::min)
}

fn quantile(values: impl Iterator<Item = f64>, share: f64) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values[(values.len() as f64 * share) as usize]
}
