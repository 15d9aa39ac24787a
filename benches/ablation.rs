//! What each ingredient and number of the solver is worth: each is switched off, halved and doubled, on problems the
//! numbers were chosen on and on others.
//!
//! `cargo bench --bench ablation -- [--switches] [--every N] [option=value …] [part of an option's name …]` prints a CSV
//! table; `--switches`: ingredients are only switched off; N: every Nth job of the large studies; `option=value` changes
//! what is usual.
//!
//! Failures, and the median and 90th percentile of factorisations over the problems, one that fails counting as the
//! largest. CPU is that of all problems over that with the usual numbers; failures that take long make it large.

mod case;
#[allow(dead_code)]
#[path = "../tests/it/nlp/textbook.rs"]
mod textbook;

use std::path::Path;
use std::time::Instant as Clock;

use case::Case;
use rayon::prelude::*;
use serde_json::{Value, json};
use sinew::internals::deadline::Deadline;
use sinew::internals::nlp::kkt::Kkt;
use sinew::internals::nlp::options::SqpOptions;
use sinew::internals::nlp::problem::Problem;
use sinew::internals::nlp::sqp::solve_with;
use sinew::internals::nlp::termination::SqpStatus;

/// What does not converge in so many iterations or seconds is a failure here.
const MAX_ITERATIONS: usize = 150;
const MAX_SECONDS: f64 = 10.0;
/// (study, every Nth job of it) that the numbers were chosen on, and others; of large studies every `--every`th of
/// these.
const TUNING: [(&str, usize); 2] = [("table1.toml", 1), ("robustness.toml", 1)];
const HELD_OUT: [(&str, usize); 5] =
    [("robustness.toml", 1), ("pedal.toml", 2), ("arm26.toml", 1), ("table1_radau.toml", 9), ("abduction.toml", 36)];
/// Jobs of a large study.
const LARGE: usize = 150;
/// The held-out half has other samples.
const OTHER_SEED: u64 = 77;

/// Switches that are no flags: an option's name and the value that takes its ingredient out.
const OFF: [(&str, f64); 9] = [
    ("leap.longest", 0.0),
    ("leap.corrections", 0.0),
    ("extension.doublings", 0.0),
    ("correction.most", 0.0),
    ("interior_point.corrections", 0.0),
    ("progress.impatience", 1e6),
    ("portfolio.far", 1e6),
    ("damping.per_error", 1e6),
    ("line_search.at_hand", 0.0),
];

/// A problem and its start.
type Start = (Box<dyn Problem>, Vec<f64>);

struct Score {
    failures: usize,
    median: usize,
    ninth_decile: usize,
    /// Of all factorisations, those of failures too.
    sum: usize,
    seconds: f64,
}

fn main() {
    let mut arguments = std::env::args().skip(1).filter(|argument| argument != "--bench");
    let (mut every, mut only_switches, mut names, mut usual) = (1, false, Vec::new(), usual());
    while let Some(argument) = arguments.next() {
        if argument == "--every" {
            every = arguments.next().and_then(|n| n.parse().ok()).expect("--every needs a number");
        } else if argument == "--switches" {
            only_switches = true;
        } else if let Some((name, value)) = argument.split_once('=') {
            usual = changed(&usual, name, &serde_json::from_str(value).expect("a number or a flag"));
        } else {
            names.push(argument);
        }
    }
    let halves = [cases(&TUNING, every, None), {
        let mut held_out = cases(&HELD_OUT, every, Some(OTHER_SEED));
        held_out.extend(textbook::all().into_iter().map(|p| (p.start.clone(), p)).map(|(start, p)| (boxed(p), start)));
        held_out
    }];
    println!(
        "option,value,tuning_failures,tuning_p50,tuning_p90,tuning_sum,tuning_cpu,held_out_failures,held_out_p50,held_out_p90,held_out_sum,held_out_cpu"
    );
    let base = halves.each_ref().map(|half| score(half, &usual));
    print("usual", &format!("{} and {} problems", halves[0].len(), halves[1].len()), &base, &base);
    for (name, value) in variants(&serde_json::to_value(usual).expect("options are plain"), only_switches) {
        if names.is_empty() || names.iter().any(|part| name.contains(part)) {
            let options = changed(&usual, &name, &value);
            print(&name, &value.to_string(), &halves.each_ref().map(|half| score(half, &options)), &base);
        }
    }
}

fn usual() -> SqpOptions {
    let mut options = SqpOptions::default();
    options.termination.max_iterations = MAX_ITERATIONS;
    options
}

fn print(name: &str, value: &str, scores: &[Score; 2], base: &[Score; 2]) {
    let columns = scores.iter().zip(base).map(|(score, base)| {
        let Score { failures, median, ninth_decile, sum, seconds } = score;
        format!("{failures},{median},{ninth_decile},{sum},{:.2}", seconds / base.seconds)
    });
    println!("{name},{value},{}", columns.collect::<Vec<_>>().join(","));
}

/// The problems of every Nth job of the studies; `seed`: of samples.
fn cases(studies: &[(&str, usize)], every: usize, seed: Option<u64>) -> Vec<Start> {
    let mut cases = Vec::new();
    for &(name, step) in studies {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("studies").join(name);
        let text = std::fs::read_to_string(&path).expect("a shipped study");
        let folder = tempfile::tempdir().expect("a folder to write to");
        let other = folder.path().join("study.toml");
        let text = seed.map_or(text.clone(), |seed| text.replace("seed = 2026", &format!("seed = {seed}")));
        std::fs::write(&other, text.replace("\"../", &format!("\"{}/", env!("CARGO_MANIFEST_DIR"))))
            .expect("a file to write");
        let study = case::study(&other);
        let step = if study.jobs.len() > LARGE { step * every } else { step };
        let of_study = study.jobs.iter().step_by(step).filter_map(|job| case::case(study, job));
        cases.extend(of_study.map(|Case { problem, start }| (boxed(problem), start)));
    }
    cases
}

fn boxed(problem: impl Problem + 'static) -> Box<dyn Problem> {
    Box::new(problem)
}

/// Solves all cases.
fn score(cases: &[Start], options: &SqpOptions) -> Score {
    let solve = |(problem, start): &Start| {
        let clock = Clock::now();
        let mut options = *options;
        options.termination.deadline = Deadline::after(clock, Some(MAX_SECONDS));
        let outcome = solve_with(&mut Kkt::new(&**problem), &**problem, start.clone(), options);
        let cost = (outcome.status == SqpStatus::Converged).then_some(outcome.factorisations);
        (cost, outcome.factorisations, clock.elapsed().as_secs_f64())
    };
    let solved: Vec<(Option<usize>, usize, f64)> = cases.par_iter().map(solve).collect();
    let mut costs: Vec<usize> = solved.iter().map(|(cost, ..)| cost.unwrap_or(usize::MAX)).collect();
    costs.sort_unstable();
    Score {
        failures: solved.iter().filter(|(cost, ..)| cost.is_none()).count(),
        median: costs[costs.len() / 2],
        ninth_decile: costs[costs.len() * 9 / 10],
        sum: solved.iter().map(|(_, factorisations, _)| factorisations).sum(),
        seconds: solved.iter().map(|(.., seconds)| seconds).sum(),
    }
}

/// Each option with the values that are tried in its place.
fn variants(usual: &Value, only_switches: bool) -> Vec<(String, Value)> {
    let mut variants: Vec<(String, Value)> = OFF.map(|(name, value)| (name.to_owned(), json!(value))).to_vec();
    for (group, options) in usual.as_object().expect("groups") {
        if group == "termination" {
            continue;
        }
        for (option, value) in options.as_object().expect("options") {
            let name = format!("{group}.{option}");
            match value {
                Value::Bool(is_on) => variants.insert(0, (name, json!(!is_on))),
                _ if only_switches => {}
                _ => variants.extend([0.5, 2.0].map(|factor| {
                    let changed = factor * value.as_f64().expect("a number");
                    (name.clone(), if value.is_u64() { json!(changed.ceil()) } else { json!(changed) })
                })),
            }
        }
    }
    variants.retain(|(name, value)| at(usual, name) != value);
    variants
}

fn at<'v>(usual: &'v Value, name: &str) -> &'v Value {
    let (group, option) = name.split_once('.').expect("group.option");
    &usual[group][option]
}

fn changed(usual: &SqpOptions, name: &str, value: &Value) -> SqpOptions {
    let mut all = serde_json::to_value(usual).expect("options are plain");
    let (group, option) = name.split_once('.').expect("group.option");
    let is_count = all[group][option].is_u64();
    all[group][option] = if is_count { json!(value.as_f64().expect("a number") as u64) } else { value.clone() };
    serde_json::from_value(all).expect("still options")
}
