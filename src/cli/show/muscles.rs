//! Muscle forces and load ratios, one line per job.

use std::collections::{BTreeMap, HashMap};

use super::{Extent, Results};
use crate::cli::layout::{NOTHING_THERE, Sheet};
use crate::names::counted;
use crate::terminal::{heading, print as say};

/// A muscle without activation counts as idle only if its mean force is below this, N; otherwise it is passive.
const MAX_IDLE_FORCE: f64 = 1.0;
/// What a method is: shown beside its loads, so that methods can be compared.
const METHOD_AXES: [&str; 6] = ["method", "muscle_dynamics", "criterion", "effort_power", "effort_of", "muscle_curves"];
/// Number of muscles shown without `--wide`: those with the largest mean forces.
const TOP: usize = 6;

/// Prints mean and peak forces of the muscles that carry most; `idle` for idle muscles.
pub fn print_forces(results: &Results, extent: Extent) {
    let muscles = &results.muscles;
    let mut by_job: BTreeMap<&str, BTreeMap<&str, usize>> = BTreeMap::new();
    let mut most: Vec<(&str, f64)> = Vec::new();
    for row in 0..muscles.rows() {
        let (Some(job), Some(muscle)) = (muscles.text("job_id", row), muscles.text("muscle", row)) else { continue };
        by_job.entry(job).or_default().insert(muscle, row);
        let force = muscles.number("mean_force_n", row).unwrap_or(0.0);
        match most.iter_mut().find(|(name, _)| *name == muscle) {
            Some((_, known)) => *known = known.max(force),
            None => most.push((muscle, force)),
        }
    }
    if most.is_empty() {
        return;
    }
    let count = most.len();
    most.sort_by(|a, b| b.1.total_cmp(&a.1));
    most.truncate(if extent.wide { count } else { TOP });
    let row_of = |row: usize, name: &str| {
        results.jobs.text("job_id", row).and_then(|id| by_job.get(id)).and_then(|of_job| of_job.get(name).copied())
    };
    let cell = |row: usize, name: &str| {
        let Some(at) = row_of(row, name) else { return NOTHING_THERE.to_owned() };
        let number = |column: &str| muscles.number(column, at).unwrap_or(f64::NAN);
        match muscles.flag("idle", at) {
            Some(true) if number("mean_force_n") < MAX_IDLE_FORCE => "idle".to_owned(),
            _ => {
                let near = ["mean_force_near_low_n", "mean_force_near_high_n"].map(number);
                let near = if near.iter().all(|force| force.is_finite()) {
                    format!(" ({:.1}–{:.1})", near[0], near[1])
                } else {
                    String::new()
                };
                format!("{:.1}{near}/{:.1}", number("mean_force_n"), number("peak_force_n"))
            }
        }
    };
    say("");
    let has_near = (0..muscles.rows()).any(|row| muscles.number("mean_force_near_low_n", row).is_some());
    let near = if has_near { ", in brackets what the mean could be at nearly the same cost" } else { "" };
    say(&heading(&format!("Muscle forces, mean/peak in N{near}, the largest first")));
    let mut sheet = Sheet::default();
    sheet.number("job", 0, (0..extent.jobs).map(|row| results.index(row)).collect());
    if results.axes.iter().any(|axis| METHOD_AXES.contains(&axis.as_str())) {
        sheet.text("method", 0, (0..extent.jobs).map(|row| method(results, row)).collect());
    }
    for (place, (name, _)) in most.iter().enumerate() {
        let rank = u8::try_from(place).unwrap_or(u8::MAX);
        sheet.number(*name, rank, (0..extent.jobs).map(|row| cell(row, name)).collect());
    }
    let shown = most.len() - sheet.print_fitting(extent.wide);
    if shown < count {
        say(&format!("({}: --wide prints all, `sinew report` plots them)", counted(count - shown, "more muscle")));
    }
}

/// The method of a job in a few words, defaults left out.
fn method(results: &Results, row: usize) -> String {
    let swept = METHOD_AXES.into_iter().filter(|axis| results.axes.iter().any(|own| own == axis));
    let said = swept.filter_map(|axis| match (axis, results.swept(axis, row)) {
        ("effort_power", value) => (value != "2").then(|| format!("p = {value}")),
        ("effort_of", value) => (value != "activation").then(|| format!("of {value}")),
        ("criterion", value) => (value != "polynomial").then_some(value),
        (_, value) => Some(value),
    });
    said.filter(|part| !part.is_empty()).collect::<Vec<_>>().join(", ")
}

/// Prints the declared load ratios.
pub fn print_ratios(results: &Results, extent: Extent) {
    let Some(ratios) = &results.ratios else { return };
    let mut names: Vec<(&str, &str)> = Vec::new();
    let mut values: HashMap<(&str, &str, &str), f64> = HashMap::new();
    for row in 0..ratios.rows() {
        let (Some(job), Some(ratio), Some(measure)) =
            (ratios.text("job_id", row), ratios.text("ratio", row), ratios.text("measure", row))
        else {
            continue;
        };
        if !names.contains(&(ratio, measure)) {
            names.push((ratio, measure));
        }
        if let Some(value) = ratios.number("value", row) {
            values.insert((job, ratio, measure), value);
        }
    }
    say("");
    say(&heading("Load ratios"));
    let mut sheet = Sheet::default();
    let rows = || 0..extent.jobs;
    sheet.number("job", 0, rows().map(|row| results.index(row)).collect());
    for axis in &results.axes {
        sheet.text(axis, 2, rows().map(|row| results.swept(axis, row)).collect());
    }
    for &(ratio, measure) in &names {
        let cell = |row| {
            let value = results.jobs.text("job_id", row).and_then(|job| values.get(&(job, ratio, measure)));
            value.map_or(NOTHING_THERE.to_owned(), |value| format!("{value:.4}"))
        };
        sheet.number(format!("{ratio} ({measure})"), 1, rows().map(cell).collect());
    }
    sheet.print(extent.wide);
}
