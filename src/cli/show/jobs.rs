//! The jobs, one line each, and what is not determined in them.

use std::collections::{BTreeMap, HashMap};

use super::ranks::printed;
use super::{Extent, Results};
use crate::cli::layout::{NOTHING_THERE, Sheet, folded, of_status, of_warning, wrapped};
use crate::names::counted;
use crate::terminal::{heading, print as say, width};

/// Swept values that need more than 1/SHARE of the line are replaced by their differences.
const SHARE: usize = 2;
/// Width of the column of differences, in characters.
const DIFFERENCES: usize = 34;

pub fn print(results: &Results, extent: Extent) {
    let jobs = &results.jobs;
    say("");
    say(&heading("Jobs"));
    let rows = 0..extent.jobs;
    let mut sheet = Sheet::default();
    sheet.number("job", 0, rows.clone().map(|row| results.index(row)).collect());
    add_swept(&mut sheet, results, extent);
    sheet.text("status", 1, rows.clone().map(|row| jobs.display("status", row).unwrap_or_default()).collect());
    sheet.colored(of_status);
    let ranks: BTreeMap<&str, usize> =
        (0..results.regularity.rows()).filter_map(|row| Some((results.regularity.text("job_id", row)?, row))).collect();
    let rank = |row: usize| jobs.text("job_id", row).and_then(|id| ranks.get(id)).copied();
    let number = |name: &str, digits: usize, factor: f64| {
        let text =
            |row| jobs.number(name, row).map_or(NOTHING_THERE.to_owned(), |v| format!("{:.digits$}", v * factor));
        rows.clone().map(text).collect()
    };
    let count = |name: &str, row| {
        rank(row).and_then(|r| results.regularity.integer(name, r)).map_or(NOTHING_THERE.to_owned(), printed)
    };
    let whole = |name: &str| rows.clone().map(|r| jobs.display(name, r).unwrap_or(NOTHING_THERE.to_owned())).collect();
    if !results.regularity.columns.is_empty() && results.regularity.rows() > 0 {
        let verdict = |row| verdict(results, rank(row));
        sheet.text("unique", 1, rows.clone().map(verdict).collect());
        let deficiencies = |row| format!("{}/{}", count("deficiency_a", row), count("deficiency_aj", row));
        sheet.number("A/[Aᵀ Jᵀ]", 5, rows.clone().map(deficiencies).collect());
        let predicted =
            |row| format!("{}/{}", count("predicted_deficiency_a", row), count("predicted_deficiency_aj", row));
        sheet.number("predicted", 6, rows.clone().map(predicted).collect());
    }
    // A model without displacements has angles to track only.
    if rows.clone().any(|row| jobs.number("tracking_rms_m", row).is_some()) {
        sheet.number("tracking, mm", 2, number("tracking_rms_m", 2, 1e3));
    } else {
        sheet.number("tracking, °", 2, number("tracking_rms_deg", 2, 1.0));
    }
    sheet.number("effort, s", 4, number("effort", 5, 1.0));
    sheet.number("iterations", 6, whole("iterations"));
    sheet.number("objective", 6, number("objective", 7, 1.0));
    sheet.number("optima", 6, whole("n_distinct_optima"));
    sheet.number("time, s", 6, number("wall_s", 3, 1.0));
    sheet.text("warnings", 3, rows.map(|row| jobs.text("warnings", row).unwrap_or("").to_owned()).collect());
    sheet.colored(of_warning);
    sheet.print(extent.wide);
    if extent.jobs < jobs.rows() {
        say(&format!("… and {} (--all shows all)", counted(jobs.rows() - extent.jobs, "more job")));
    }
    if results.regularity.rows() > 0 {
        let starts = (0..jobs.rows()).filter_map(|row| jobs.integer("n_starts", row)).max().unwrap_or(1);
        let starts = if starts == 1 { "one start".to_owned() } else { format!("{starts} starts") };
        say(&wrapped(
            &format!(
                "unique: `answer` (everything is determined), `loads` (only the muscle loads), or `no`; with `?`, \
                 singular values have no clear gap and the ranks depend on the tolerance. The verdict holds for the \
                 optimum found from {starts}; there may be others. A/[Aᵀ Jᵀ]: rank deficiencies."
            ),
            "",
        ));
    }
}

/// Adds the swept values: one column each if there is room, otherwise the differences from the most common values.
fn add_swept(sheet: &mut Sheet, results: &Results, extent: Extent) {
    let (same, varied): (Vec<&String>, Vec<&String>) =
        results.axes.iter().partition(|axis| extent.jobs > 1 && is_same(results, axis, extent.jobs));
    if !same.is_empty() {
        let same: Vec<String> = same.iter().map(|axis| format!("{axis} = {}", results.swept(axis, 0))).collect();
        say(&wrapped(&format!("Same in all jobs shown: {}", same.join(", ")), "  "));
    }
    let cells = |axis: &str| (0..extent.jobs).map(|row| results.swept(axis, row)).collect::<Vec<String>>();
    let longest = |axis: &str| cells(axis).iter().map(|cell| cell.chars().count()).max().unwrap_or(0).max(10) + 2;
    if extent.wide || varied.iter().map(|axis| longest(axis)).sum::<usize>() <= width() / SHARE {
        varied.into_iter().for_each(|axis| _ = sheet.text(axis, 0, cells(axis)));
        return;
    }
    let values = |axis: &str| (0..extent.jobs).map(|row| results.jobs.display(axis, row).unwrap_or_default()).collect();
    let common: HashMap<&str, String> = varied.iter().map(|axis| (axis.as_str(), most_common(values(axis)))).collect();
    let usual: Vec<String> = varied.iter().map(|axis| format!("{axis} = {}", short(&common[axis.as_str()]))).collect();
    say(&wrapped(&format!("Unless stated otherwise: {}", usual.join(", ")), "  "));
    let differences = |row: usize| {
        let whole = |axis: &str| results.jobs.display(axis, row).unwrap_or_default();
        let differing = varied.iter().filter(|axis| whole(axis) != common[axis.as_str()]);
        let text: Vec<String> = differing.map(|axis| format!("{axis} = {}", results.swept(axis, row))).collect();
        folded(&text.join(", "), DIFFERENCES)
    };
    sheet.text("what differs", 0, (0..extent.jobs).map(differences).collect());
}

fn is_same(results: &Results, axis: &str, rows: usize) -> bool {
    (1..rows).all(|row| results.jobs.display(axis, row) == results.jobs.display(axis, 0))
}

fn most_common(cells: Vec<String>) -> String {
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    cells.into_iter().for_each(|cell| *counts.entry(cell).or_default() += 1);
    counts.into_iter().max_by_key(|(_, count)| *count).map_or_else(String::new, |(cell, _)| cell)
}

fn verdict(results: &Results, rank: Option<usize>) -> String {
    let flag = |name: &str| rank.and_then(|row| results.regularity.flag(name, row));
    let verdict = match (flag("answer_unique"), flag("loads_unique")) {
        (Some(true), _) => "answer",
        (_, Some(true)) => "loads",
        (_, Some(false)) => "no",
        _ => return NOTHING_THERE.to_owned(),
    };
    let is_ambiguous = flag("ambiguous") == Some(true);
    format!("{verdict}{}", if is_ambiguous { "?" } else { "" })
}

/// Shortens a number with many digits for a table. Integers and other texts are unchanged.
pub fn short(text: &str) -> String {
    match text.parse::<f64>() {
        Ok(number) if text.len() > 9 && text.contains(['.', 'e']) => match number.abs() {
            1e-3..1e6 => format!("{number:.5}"),
            _ => format!("{number:.4e}"),
        },
        _ => text.to_owned(),
    }
}

/// Number of jobs with non-unique answers shown without `--all`.
const FREEDOMS: usize = 6;

/// Prints what is free in answers that are not unique, and the range of the mean activations.
pub fn print_freedoms(results: &Results, extent: Extent) {
    let (regularity, muscles) = (&results.regularity, &results.muscles);
    let mut by_job: BTreeMap<&str, (String, Vec<String>)> = BTreeMap::new();
    for row in 0..regularity.rows() {
        if let (Some(id), Some(words)) = (regularity.text("job_id", row), regularity.text("null_space", row)) {
            by_job.insert(id, (words.to_owned(), Vec::new()));
        }
    }
    for row in 0..muscles.rows() {
        let number = |name: &str| muscles.number(name, row);
        let ends = number("mean_activation_low").zip(number("mean_activation_high"));
        let Some((low, high)) = ends.filter(|(low, high)| high - low > 1e-6) else { continue };
        let entry = muscles.text("job_id", row).and_then(|id| by_job.get_mut(id));
        if let (Some((_, intervals)), Some(name)) = (entry, muscles.text("muscle", row)) {
            intervals.push(format!("{name} {low:.3} to {high:.3}"));
        }
    }
    let free: Vec<usize> = (0..extent.jobs)
        .filter(|&row| results.jobs.text("job_id", row).is_some_and(|id| by_job.contains_key(id)))
        .collect();
    if free.is_empty() {
        return;
    }
    say("");
    say(&heading("Not determined (share of the null space of [A; J])"));
    let shown = if extent.all { free.len() } else { FREEDOMS.min(free.len()) };
    for &row in &free[..shown] {
        let (words, intervals) = &by_job[results.jobs.text("job_id", row).expect("the job has an id")];
        say(&wrapped(&format!("job {}: {words}", results.index(row)), "    "));
        if !intervals.is_empty() {
            let text = format!("    mean activations that are equally good to first order: {}", intervals.join(", "));
            say(&wrapped(&text, "      "));
        }
    }
    if shown < free.len() {
        say(&format!("… and {} (--all shows all)", counted(free.len() - shown, "more job")));
    }
}
