//! Retries failed jobs by continuation: from the nearest solved job to the failed one, in one, two or four steps.

use std::collections::HashMap;

use super::store::Store;
use super::{Solver, solve_catching};
use crate::names::counted;
use crate::outcome::{Outcome, Status};
use crate::settings::{Method, Value};
use crate::study::change::ModelChange;
use crate::study::{Job, Study};
use crate::warm::Answer;

/// Numbers of steps from a neighbour to the failed job, tried in this order.
const STEPS: [usize; 3] = [1, 2, 4];
/// Number of neighbours to try, the nearest first.
const NEIGHBOURS: usize = 2;

/// Failed jobs that may be solved by continuation: those not retried yet, and neither invalid nor panicked.
pub fn candidates<'s>(study: &'s Study, store: &Store) -> Vec<&'s Job> {
    let may_help = |status| !matches!(status, Status::Converged | Status::Invalid | Status::Panicked);
    // The instants of a static job have nothing to start from.
    let is_candidate = |job: &&Job| {
        job.settings.method != Method::Static && store.get(&job.id).is_some_and(|h| may_help(h.status) && !h.retried)
    };
    study.jobs.iter().filter(is_candidate).collect()
}

/// Jobs that a continuation may start from: those solved without one, so that the order of the retries does not matter.
pub fn solved<'s>(study: &'s Study, store: &Store) -> Vec<&'s Job> {
    let is_solved = |job: &&Job| store.get(&job.id).is_some_and(|h| h.status == Status::Converged && !h.retried);
    study.jobs.iter().filter(is_solved).collect()
}

/// The outcome of a failed job after the retry. If no attempt succeeds, this is its first outcome with a note added.
pub fn retry(study: &Study, job: &Job, first: Outcome, solved: &[&Job], solver: &Solver<'_>) -> Outcome {
    let distance = Distance::of(study);
    let mut near: Vec<&Job> = solved.iter().copied().filter(|other| other.settings.is_alike(&job.settings)).collect();
    near.sort_by(|a, b| {
        let (a, b) = ((distance.between(a, job), a.index), (distance.between(b, job), b.index));
        a.partial_cmp(&b).expect("distances are finite")
    });
    let mut tried = Vec::new();
    for neighbour in near.into_iter().take(NEIGHBOURS) {
        tried.push(format!("job {}", neighbour.index));
        for steps in STEPS {
            if let Some(mut outcome) = continuation(study, neighbour, job, steps, solver) {
                let remark =
                    format!("solved by continuation from job {} in {}", neighbour.index, counted(steps, "step"));
                outcome.job.remark = Some(match outcome.job.remark.take() {
                    Some(own) => format!("{own}; {remark}"),
                    None => remark,
                });
                outcome.job.warm_start_from = Some(neighbour.id.clone());
                return outcome;
            }
        }
    }
    let mut outcome = first;
    let note = match tried.is_empty() {
        true => "no solved job from which a continuation could start".to_owned(),
        false => format!("continuation from {} did not help", tried.join(", ")),
    };
    outcome.job.error = Some(outcome.job.error.map_or(note.clone(), |error| format!("{error}; {note}")));
    outcome
}

/// The outcome of the job `to`, approached from `from` in equal steps; `None` if it does not converge.
fn continuation(study: &Study, from: &Job, to: &Job, steps: usize, solver: &Solver<'_>) -> Option<Outcome> {
    let mut answer: Option<Answer> = solve_catching(study, from, None, solver).1;
    for step in 1..steps {
        let between = between(study, from, to, step as f64 / steps as f64);
        answer = solve_catching(study, &between, Some(&answer?), solver).1;
    }
    let (outcome, _) = solve_catching(study, to, Some(&answer?), solver);
    (outcome.job.status == Status::Converged).then_some(outcome)
}

/// The job `to` with its numbers moved back towards those of `from`; a share of 1 gives `to` itself. μ moves along its
/// logarithm, everything else linearly.
fn between(study: &Study, from: &Job, to: &Job, share: f64) -> Job {
    let mix = |a: f64, b: f64| match a > 0.0 && b > 0.0 {
        true => (a.ln() + share * (b.ln() - a.ln())).exp(),
        false => a + share * (b - a),
    };
    let mut job = to.clone();
    let linear = |a: f64, b: f64| a + share * (b - a);
    let (old, new) = (&from.settings, &to.settings);
    job.settings.mu = mix(old.mu, new.mu);
    job.settings.reserve_weight = mix(old.reserve_weight, new.reserve_weight);
    job.settings.excitation_weight = mix(old.excitation_weight, new.excitation_weight);
    job.settings.effort_power = linear(old.effort_power, new.effort_power);
    // A reserve that only the target has is there from the start.
    let reserve = |a: f64, b: f64| if a > 0.0 && b > 0.0 { linear(a, b) } else { b };
    job.settings.reserves = reserve(old.reserves, new.reserves);
    for (coordinate, moment) in &mut job.settings.reserves_at {
        *moment = reserve(old.reserve(coordinate), *moment);
    }
    for (coordinate, weight) in &mut job.settings.tracking_weights {
        *weight = linear(old.tracking_weight(coordinate), *weight);
    }
    let unmoved = (0.0, 1.0);
    let motion = |job: &Job, name: &str| {
        job.settings.motion.iter().find(|(n, ..)| n == name).map_or(unmoved, |(_, offset, scale)| (*offset, *scale))
    };
    let mut names: Vec<&String> = [from, to].iter().flat_map(|j| j.settings.motion.iter().map(|(n, ..)| n)).collect();
    names.sort();
    names.dedup();
    job.settings.motion = (names.into_iter())
        .map(|name| {
            let (a, b) = (motion(from, name), motion(to, name));
            (name.clone(), linear(a.0, b.0), linear(a.1, b.1))
        })
        .collect();
    let set = |job: &Job, path: &str| job.changes.iter().find(|change| change.path == path).map(|c| c.value.clone());
    let number = |job: &Job, path: &str| {
        let own = set(job, path).map_or_else(|| study.model_number(path), |value| value.number());
        own.or_else(|| path.ends_with("_scale").then_some(1.0))
    };
    let mut paths: Vec<(bool, &String)> =
        [from, to].iter().flat_map(|j| j.changes.iter().map(|c| (c.is_factor(), &c.path))).collect();
    paths.sort();
    paths.dedup();
    job.changes = (paths.into_iter())
        .filter_map(|(_, path)| {
            // What is no number is as in the target.
            let value = match (number(from, path), number(to, path)) {
                (Some(from), Some(to)) => Value::Number(linear(from, to)),
                _ => set(to, path)?,
            };
            Some(ModelChange { path: path.clone(), value })
        })
        .collect();
    job
}

/// Distance between jobs in their swept values: numbers relative to the span of their axis, everything else 0 or 1.
struct Distance {
    /// (least, greatest) value of each axis of numbers.
    spans: HashMap<usize, (f64, f64)>,
}

impl Distance {
    fn of(study: &Study) -> Self {
        let mut spans: HashMap<usize, (f64, f64)> = HashMap::new();
        for job in &study.jobs {
            for (axis, value) in job.swept.iter().enumerate() {
                if let Some(number) = value.as_ref().and_then(Value::number) {
                    let span = spans.entry(axis).or_insert((number, number));
                    *span = (span.0.min(number), span.1.max(number));
                }
            }
        }
        Self { spans }
    }

    fn between(&self, a: &Job, b: &Job) -> f64 {
        let apart = |(axis, (a, b)): (usize, (&Option<Value>, &Option<Value>))| {
            let number = |value: &Option<Value>| value.as_ref().and_then(Value::number);
            match (number(a), number(b), self.spans.get(&axis)) {
                (Some(a), Some(b), Some((least, greatest))) if greatest > least => {
                    // Logarithmic if the axis spans a decade or more.
                    let scale = |x: f64| if *least > 0.0 && greatest / least >= 10.0 { x.ln() } else { x };
                    ((scale(a) - scale(b)) / (scale(*greatest) - scale(*least))).abs()
                }
                _ => f64::from(a != b),
            }
        };
        a.swept.iter().zip(&b.swept).enumerate().map(apart).map(|d| d * d).sum::<f64>().sqrt()
    }
}
