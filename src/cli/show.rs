//! `sinew show`: the tables of a results folder in the terminal, from the Parquet files alone.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use comfy_table::{CellAlignment, Table as Grid, presets::NOTHING};

use super::{GOOD, note, print};
use crate::error::{Error, Result};
use crate::plausibility::KINDS;
use crate::run::manifest::Manifest;
use crate::study::sweep::SAMPLE;
use crate::table1::{Group, THESIS, groups, thesis};
use crate::tables::{self, Table, schema};

const FIRST: usize = 24;
const BEST: usize = 5;
/// A muscle without activation that carries more in the mean is passive, not idle, N.
const CARRIES: f64 = 1.0;

pub fn show(dir: &Path, all: bool) -> Result<u8> {
    let Some(manifest) = Manifest::read(dir)? else {
        let reason = "there is no manifest.json in it, so it is no results folder; `sinew run STUDY` makes one";
        return Err(Error::table("show", dir, reason));
    };
    if !dir.join("jobs.parquet").exists() {
        let reason = "its run has not ended, so there are no tables; `sinew status` tells how far it is, `sinew merge` makes \
                      tables of what is finished";
        return Err(Error::table("show", dir, reason));
    }
    for name in manifest.altered(dir) {
        note(&format!("warning: {} is not the file that its manifest speaks of", dir.join(name).display()));
    }
    let read = |name: &'static str| tables::read(name, &dir.join(format!("{name}.parquet")));
    let (jobs, regularity, muscles) = (read("jobs")?, read("regularity")?, read("muscles")?);
    let ratios = if dir.join("ratios.parquet").exists() { Some(read("ratios")?) } else { None };
    let axes = schema::axes(&jobs);
    counts(&jobs);
    let groups = groups(&jobs, &regularity, &axes);
    let sampled = axes.iter().any(|axis| axis == SAMPLE);
    if sampled && !groups.is_empty() {
        search(&groups);
        if let Some(ratios) = &ratios {
            ratio_table(&jobs, ratios, &axes, if all { jobs.rows() } else { FIRST.min(jobs.rows()) });
        }
        remarks(&jobs, 0, if all { usize::MAX } else { BEST });
        return Ok(GOOD);
    }
    for group in &groups {
        rank_table(group);
    }
    let limit = if all { jobs.rows() } else { FIRST.min(jobs.rows()) };
    job_table(&jobs, &regularity, &axes, limit);
    muscle_table(&jobs, &muscles, limit);
    if let Some(ratios) = &ratios {
        ratio_table(&jobs, ratios, &axes, limit);
    }
    freedoms(&jobs, &regularity, &muscles, limit);
    remarks(&jobs, limit, usize::MAX);
    if limit < jobs.rows() {
        print(&format!("\n… {} more job(s): --all shows them", jobs.rows() - limit));
    }
    Ok(GOOD)
}

fn counts(jobs: &Table) {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for row in 0..jobs.rows() {
        *counts.entry(jobs.text("status", row).unwrap_or("?")).or_default() += 1;
    }
    let text: Vec<String> = counts.iter().map(|(status, count)| format!("{count} {status}")).collect();
    print(&format!("{} finished job(s): {}", jobs.rows(), text.join(", ")));
    warnings(jobs);
}

/// How many jobs have warnings, and of each kind what it looks at and what to do.
fn warnings(jobs: &Table) {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    let mut total = 0;
    for codes in (0..jobs.rows()).filter_map(|row| jobs.text("warnings", row)) {
        total += 1;
        codes.split(", ").for_each(|code| *counts.entry(code).or_default() += 1);
    }
    if total == 0 {
        return;
    }
    print(&format!("{total} job(s) with warnings:"));
    for (code, count) in counts {
        let kind = KINDS.iter().find(|kind| kind.code == code);
        let (limit, remedy) = kind.map_or(("", ""), |kind| (kind.limit, kind.remedy));
        print(&format!("  {code} ({count}): {limit}\n    {remedy}"));
    }
}

fn grid(header: Vec<String>) -> Grid {
    let columns = header.len();
    let mut grid = Grid::new();
    grid.load_preset(NOTHING).set_header(header.iter().map(|name| wrapped(name)));
    for column in 1..columns {
        if let Some(column) = grid.column_mut(column) {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    grid
}

/// A column's name for a table: a path of the model takes a line for each of its parts.
pub fn wrapped(name: &str) -> String {
    name.replace('.', ".\n")
}

/// A deficiency as the thesis prints it: 0, −1, …
fn printed(deficiency: i64) -> String {
    (-deficiency).to_string()
}

/// Table 1 in the thesis' layout, its numbers in brackets.
fn rank_table(group: &Group) {
    let others: Vec<String> = group.others.iter().map(|(name, value)| format!("{name} = {value}")).collect();
    print(&format!(
        "\nRank deficiencies, in brackets the thesis' Table 1{}",
        if others.is_empty() { String::new() } else { format!(" ({})", others.join(", ")) }
    ));
    for (grid_name, title) in
        [("measurement", "a at the measured instants"), ("collocation", "a at the collocation points")]
    {
        let bounds = ["activation", "excitation", "both"];
        let mut table = grid([title, "a ≥ 0", "u ≥ 0", "u, a ≥ 0"].map(str::to_owned).to_vec());
        type Pick = fn((i64, i64)) -> i64;
        let picks: [(&str, Pick); 2] = [("of A", |d| d.0), ("of [Aᵀ Jᵀ]", |d| d.1)];
        for (name, pick) in picks {
            let mut row = vec![name.to_owned()];
            for bound in bounds {
                let cell = group.cells.get(&(grid_name.to_owned(), bound.to_owned()));
                row.push(match cell {
                    None => "–".to_owned(),
                    Some(cell) => {
                        let found = match cell.deficiencies {
                            Some(found) if cell.status == "converged" => printed(pick(found)),
                            _ => cell.status.clone(),
                        };
                        let mark = match (cell.deficiencies, cell.predicted) {
                            (Some(found), Some(predicted)) if pick(found) != pick(predicted) => {
                                format!(" predicted {}", printed(pick(predicted)))
                            }
                            _ => String::new(),
                        };
                        let print =
                            thesis(grid_name, bound).map_or(String::new(), |t| format!(" ({})", printed(pick(t))));
                        format!("{found}{print}{mark}")
                    }
                });
            }
            table.add_row(row);
        }
        print(&table.trim_fmt());
    }
    print(&format!(
        "{} of the 12 numbers are the thesis' as counted, {} as predicted from the active bounds",
        group.matches(),
        group.predicted_matches()
    ));
    if group.ambiguous() > 0 {
        print(&format!(
            "ambiguous in {} of {} cases: singular values without a clear gap, so that the count hangs on the tolerance",
            group.ambiguous(),
            group.cells.len()
        ));
    }
}

/// What a search over sampled arms found.
fn search(groups: &[Group]) {
    let mut histogram = BTreeMap::<usize, usize>::new();
    groups.iter().for_each(|group| *histogram.entry(group.matches()).or_default() += 1);
    print(&format!("\n{} sampled arm(s), by how many of the 12 numbers of Table 1 come out", groups.len()));
    let mut table = grid(["numbers", "arms"].map(str::to_owned).to_vec());
    for (matches, count) in histogram.iter().rev() {
        table.add_row([matches.to_string(), count.to_string()]);
    }
    print(&table.trim_fmt());

    print("\nHow common each cell's numbers are over the converged jobs (thesis in brackets)");
    let header = ["case", "converged", "A", "share", "[Aᵀ Jᵀ]", "share", "both", "most common A/[Aᵀ Jᵀ]"];
    let mut table = grid(header.map(str::to_owned).to_vec());
    for (grid_name, bounds, a, aj) in THESIS {
        let key = (grid_name.to_owned(), bounds.to_owned());
        let found: Vec<(i64, i64)> =
            groups.iter().filter_map(|g| g.cells.get(&key).filter(|c| c.status == "converged")?.deficiencies).collect();
        let share = |count: usize| match found.len() {
            0 => "–".to_owned(),
            total => format!("{:.1} %", 100.0 * count as f64 / total as f64),
        };
        let mut common = BTreeMap::<(i64, i64), usize>::new();
        found.iter().for_each(|pair| *common.entry(*pair).or_default() += 1);
        let mut common: Vec<_> = common.into_iter().collect();
        common.sort_by_key(|&(pair, count)| (std::cmp::Reverse(count), pair));
        let top: Vec<String> = common
            .iter()
            .take(3)
            .map(|((a, aj), count)| format!("{}/{} {}", printed(*a), printed(*aj), share(*count)))
            .collect();
        table.add_row([
            format!("{grid_name}, {bounds}"),
            found.len().to_string(),
            format!("({})", printed(a)),
            share(found.iter().filter(|f| f.0 == a).count()),
            format!("({})", printed(aj)),
            share(found.iter().filter(|f| f.1 == aj).count()),
            share(found.iter().filter(|f| **f == (a, aj)).count()),
            top.join(", "),
        ]);
    }
    print(&table.trim_fmt());

    let mut best: Vec<&Group> = groups.iter().collect();
    best.sort_by_key(|group| std::cmp::Reverse(group.matches()));
    for group in best.iter().take(BEST) {
        let others: Vec<String> = group.others.iter().map(|(name, value)| format!("{name} {value}")).collect();
        let cells: Vec<String> = THESIS
            .iter()
            .map(|&(grid_name, bounds, ..)| {
                let cell = group.cells.get(&(grid_name.to_owned(), bounds.to_owned()));
                let found = cell.and_then(|c| c.deficiencies).map(|(a, aj)| format!("{}/{}", printed(a), printed(aj)));
                found.unwrap_or_else(|| "–".to_owned())
            })
            .collect();
        print(&format!("{}: {} numbers, {}", others.join(", "), group.matches(), cells.join("  ")));
    }
}

fn job_table(jobs: &Table, regularity: &Table, axes: &[String], limit: usize) {
    let ranks: BTreeMap<&str, usize> =
        (0..regularity.rows()).filter_map(|row| Some((regularity.text("job_id", row)?, row))).collect();
    let mut header: Vec<String> = vec!["job".to_owned()];
    header.extend(axes.iter().cloned());
    let rest = [
        "status",
        "iter.",
        "objective",
        "effort",
        "rms mm",
        "A",
        "[Aᵀ Jᵀ]",
        "predicted",
        "unique",
        "optima",
        "s",
        "warnings",
    ];
    header.extend(rest.map(str::to_owned));
    let mut table = grid(header);
    for row in 0..limit {
        let rank = jobs.text("job_id", row).and_then(|id| ranks.get(id)).copied();
        let number = |name: &str, digits: usize, factor: f64| {
            jobs.number(name, row).map_or("–".to_owned(), |v| format!("{:.digits$}", v * factor))
        };
        let count = |name: &str| rank.and_then(|r| regularity.integer(name, r)).map_or("–".to_owned(), printed);
        let verdict = |name: &str| rank.and_then(|r| regularity.flag(name, r));
        let mut cells = vec![jobs.display("index", row).unwrap_or_default()];
        cells.extend(axes.iter().map(|axis| short(&jobs.display(axis, row).unwrap_or_default())));
        cells.push(jobs.display("status", row).unwrap_or_default());
        cells.push(jobs.display("iterations", row).unwrap_or("–".to_owned()));
        cells.push(number("objective", 7, 1.0));
        cells.push(number("effort", 5, 1.0));
        cells.push(number("tracking_rms_m", 2, 1e3));
        cells.push(count("deficiency_a"));
        cells.push(count("deficiency_aj"));
        cells.push(format!("{}/{}", count("predicted_deficiency_a"), count("predicted_deficiency_aj")));
        let unique = match (verdict("answer_unique"), verdict("loads_unique")) {
            (Some(true), _) => "answer",
            (_, Some(true)) => "loads",
            (_, Some(false)) => "no",
            _ => "–",
        };
        cells.push(unique.to_owned());
        cells.push(jobs.display("n_distinct_optima", row).unwrap_or("–".to_owned()));
        cells.push(number("wall_s", 3, 1.0));
        cells.push(jobs.text("warnings", row).unwrap_or("").to_owned());
        table.add_row(cells);
    }
    print(&format!("\nJobs\n{}", table.trim_fmt()));
    if regularity.rows() > 0 {
        let starts = (0..jobs.rows()).filter_map(|row| jobs.integer("n_starts", row)).max().unwrap_or(1);
        print(&format!(
            "unique: the answer, only its muscle loads, or no. A verdict on the optimum that was found, from {starts} start(s): there may be others."
        ));
    }
}

/// A number of many digits, cut to what a table bears; whole numbers stay as they are.
fn short(text: &str) -> String {
    match text.parse::<f64>() {
        Ok(number) if text.len() > 9 && text.contains(['.', 'e']) => match number.abs() {
            1e-3..1e6 => format!("{number:.5}"),
            _ => format!("{number:.4e}"),
        },
        _ => text.to_owned(),
    }
}

/// Mean force of each muscle, `idle` where it does nothing.
fn muscle_table(jobs: &Table, muscles: &Table, limit: usize) {
    let mut names: Vec<&str> = Vec::new();
    let mut by_job: BTreeMap<&str, BTreeMap<&str, usize>> = BTreeMap::new();
    for row in 0..muscles.rows() {
        if let (Some(job), Some(muscle)) = (muscles.text("job_id", row), muscles.text("muscle", row)) {
            if !names.contains(&muscle) {
                names.push(muscle);
            }
            by_job.entry(job).or_default().insert(muscle, row);
        }
    }
    if names.is_empty() {
        return;
    }
    let mut table =
        grid(["job"].into_iter().chain(names.iter().copied()).chain(["ringing 1/s"]).map(str::to_owned).collect());
    for row in 0..limit {
        let Some(rows) = jobs.text("job_id", row).and_then(|id| by_job.get(id)) else { continue };
        let status = jobs.text("status", row).filter(|status| *status != "converged");
        let mark = status.map_or(String::new(), |status| format!(" ({status})"));
        let mut cells = vec![format!("{}{mark}", jobs.display("index", row).unwrap_or_default())];
        for name in &names {
            cells.push(match rows.get(name) {
                None => "–".to_owned(),
                Some(&r) => {
                    let (mean, peak) = (muscles.number("mean_force_n", r), muscles.number("peak_force_n", r));
                    let idle = match muscles.flag("idle", r) {
                        Some(true) if mean.is_some_and(|force| force > CARRIES) => " passive",
                        Some(true) => " idle",
                        _ => "",
                    };
                    format!("{:.1}/{:.1}{idle}", mean.unwrap_or(f64::NAN), peak.unwrap_or(f64::NAN))
                }
            });
        }
        let ringing = rows.values().filter_map(|&r| muscles.number("ringing", r)).fold(0.0, f64::max);
        cells.push(format!("{ringing:.1}"));
        table.add_row(cells);
    }
    print(&format!("\nMuscle forces, mean/peak in N\n{}", table.trim_fmt()));
}

/// Load ratios against what is swept.
fn ratio_table(jobs: &Table, ratios: &Table, axes: &[String], limit: usize) {
    let mut names: Vec<(String, String)> = Vec::new();
    let mut values: HashMap<&str, HashMap<(String, String), f64>> = HashMap::new();
    for row in 0..ratios.rows() {
        let text = |column: &str| ratios.text(column, row).unwrap_or_default().to_owned();
        let name = (text("ratio"), text("measure"));
        if !names.contains(&name) {
            names.push(name.clone());
        }
        if let (Some(job), Some(value)) = (ratios.text("job_id", row), ratios.number("value", row)) {
            values.entry(job).or_default().insert(name, value);
        }
    }
    let heads = names.iter().map(|(ratio, measure)| format!("{ratio} ({measure})"));
    let mut table = grid(std::iter::once("job".to_owned()).chain(axes.iter().cloned()).chain(heads).collect());
    for row in 0..limit {
        let Some(of_job) = jobs.text("job_id", row).and_then(|id| values.get(id)) else { continue };
        let mut cells = vec![jobs.display("index", row).unwrap_or_default()];
        cells.extend(axes.iter().map(|axis| short(&jobs.display(axis, row).unwrap_or_default())));
        cells.extend(names.iter().map(|name| of_job.get(name).map_or("–".to_owned(), |value| format!("{value:.4}"))));
        table.add_row(cells);
    }
    print(&format!("\nLoad ratios\n{}", table.trim_fmt()));
}

/// What may move in the answers that are not unique, and how far the mean activations.
fn freedoms(jobs: &Table, regularity: &Table, muscles: &Table, limit: usize) {
    let mut lines: BTreeMap<&str, (String, Vec<String>)> = BTreeMap::new();
    for row in 0..regularity.rows() {
        if let (Some(id), Some(words)) = (regularity.text("job_id", row), regularity.text("null_space", row)) {
            lines.insert(id, (words.to_owned(), Vec::new()));
        }
    }
    for row in 0..muscles.rows() {
        let number = |name: &str| muscles.number(name, row);
        let ends = number("mean_activation_low").zip(number("mean_activation_high"));
        let Some((low, high)) = ends.filter(|(low, high)| high - low > 1e-6) else { continue };
        let entry = muscles.text("job_id", row).and_then(|id| lines.get_mut(id));
        if let (Some((_, intervals)), Some(name)) = (entry, muscles.text("muscle", row)) {
            intervals.push(format!("{name} {low:.3} … {high:.3}"));
        }
    }
    let mut first = true;
    for row in 0..limit {
        let Some((words, intervals)) = jobs.text("job_id", row).and_then(|id| lines.get(id)) else { continue };
        if std::mem::take(&mut first) {
            print("\nNot determined (share of the null space of [A; J])");
        }
        let index = jobs.display("index", row).unwrap_or_default();
        print(&format!("job {index}: {words}"));
        if !intervals.is_empty() {
            print(&format!("        as good to first order, mean activation: {}", intervals.join(", ")));
        }
    }
}

/// Reasons of failed jobs, `most` of them, and remarks on the first `limit` jobs.
fn remarks(jobs: &Table, limit: usize, most: usize) {
    let mut failed = 0;
    for row in 0..jobs.rows() {
        let index = jobs.display("index", row).unwrap_or_default();
        if let Some(error) = jobs.text("error", row) {
            failed += 1;
            if failed <= most {
                print(&format!("job {index}: {}: {error}", jobs.text("status", row).unwrap_or("?")));
            }
        } else if let (Some(remark), true) = (jobs.text("remark", row), row < limit) {
            print(&format!("job {index}: {remark}"));
        }
    }
    if failed > most {
        print(&format!("… and {} more failed job(s): --all shows them", failed - most));
    }
}
