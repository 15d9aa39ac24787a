//! `sinew rank`: ranks muscles by their response to a swept parameter. Each job is compared with the job of the
//! reference value, using only the tables.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use super::arguments::{Format, Look};
use super::layout::Sheet;
use super::output::{print_table, write_table};
use super::{GOOD, print};
use crate::error::{Error, Result, nearest};
use crate::names::counted;
use crate::outcome::Status;
use crate::run::folder;
use crate::tables::{self, Table, Values, schema};
use crate::terminal::heading;

/// Columns of `muscles` to rank by.
const MEASURES: [&str; 6] =
    ["mean_force_n", "peak_force_n", "impulse_n_s", "mean_activation", "peak_activation", "min_force_n"];
/// Values of an axis listed in a message.
const MOST_VALUES: usize = 12;
/// Muscles printed for each job.
const FIRST: usize = 10;

pub struct RankOptions<'a> {
    pub axis: &'a str,
    pub reference: &'a str,
    pub measure: &'a str,
    pub out: Option<&'a Path>,
    pub look: Look,
}

/// The value of one muscle in a job and in its reference job.
struct Response {
    muscle: String,
    reference: f64,
    value: f64,
}

impl Response {
    fn difference(&self) -> f64 {
        self.value - self.reference
    }

    fn relative(&self) -> Option<f64> {
        (self.reference != 0.0).then(|| self.difference() / self.reference)
    }
}

/// The changes in a job relative to its reference job, largest first.
struct Ranking {
    /// Row of the job in `jobs`.
    row: usize,
    changes: Vec<Response>,
}

pub fn rank(folder: &Path, options: &RankOptions<'_>) -> Result<u8> {
    let jobs = tables::read("jobs", &folder::table(folder, "jobs"))?;
    let muscles = tables::read("muscles", &folder::table(folder, "muscles"))?;
    let axes = schema::axes(&jobs);
    check(folder, &jobs, &axes, options)?;
    let rankings = rankings(&jobs, &muscles, &axes, options);
    match options.out {
        Some(out) => {
            let table = table(&jobs, &axes, options.measure, &rankings);
            write_table(&table, vec![("sinew.axis".to_owned(), options.axis.to_owned())], out)?;
            print(&format!("{}: {}", counted(table.rows(), "row"), out.display()));
        }
        None if options.look.format == Format::Table => {
            rankings.iter().for_each(|ranking| print_ranking(&jobs, &axes, options, ranking));
        }
        None => print_table(&table(&jobs, &axes, options.measure, &rankings), options.look)?,
    }
    Ok(GOOD)
}

fn check(folder: &Path, jobs: &Table, axes: &[String], options: &RankOptions<'_>) -> Result<()> {
    let wrong = |reason: String| Err(Error::table("rank the muscles of", folder, reason));
    if !axes.iter().any(|axis| axis == options.axis) {
        let near = nearest(options.axis, axes.iter().map(String::as_str));
        let near = near.map(|n| format!("did you mean `{n}`? ")).unwrap_or_default();
        return wrong(format!(
            "`{}` is not a swept parameter; {near}swept parameters: {}",
            options.axis,
            axes.join(", ")
        ));
    }
    if !MEASURES.contains(&options.measure) {
        return wrong(format!("`{}` is not a measure; available measures: {}", options.measure, MEASURES.join(", ")));
    }
    if !(0..jobs.rows()).any(|row| is_reference(jobs, options, row)) {
        let mut values: Vec<String> =
            (0..jobs.rows()).map(|row| jobs.display(options.axis, row).unwrap_or_default()).collect();
        values.sort_by(|a, b| a.parse::<f64>().ok().partial_cmp(&b.parse::<f64>().ok()).unwrap_or(a.cmp(b)));
        values.dedup();
        if values.len() > MOST_VALUES {
            values.truncate(MOST_VALUES);
            values.push("…".to_owned());
        }
        let (axis, reference) = (options.axis, options.reference);
        return wrong(format!("no job has {axis} = {reference}; its values: {}", values.join(", ")));
    }
    Ok(())
}

fn is_reference(jobs: &Table, options: &RankOptions<'_>, row: usize) -> bool {
    let value = jobs.display(options.axis, row).unwrap_or_default();
    match (value.parse::<f64>(), options.reference.parse::<f64>()) {
        (Ok(a), Ok(b)) => (a - b).abs() <= 1e-12 * a.abs().max(b.abs()),
        _ => value == options.reference,
    }
}

/// The values of all axes except the ranked one.
fn others(jobs: &Table, axes: &[String], options: &RankOptions<'_>, row: usize) -> Vec<(String, String)> {
    let others = axes.iter().filter(|axis| *axis != options.axis);
    others.map(|axis| (axis.clone(), jobs.display(axis, row).unwrap_or_default())).collect()
}

/// Compares every converged job with the converged job of the reference value that agrees in all other axes.
fn rankings(jobs: &Table, muscles: &Table, axes: &[String], options: &RankOptions<'_>) -> Vec<Ranking> {
    let mut loads: BTreeMap<&str, Vec<(&str, f64)>> = BTreeMap::new();
    for row in 0..muscles.rows() {
        if let (Some(job), Some(muscle), Some(value)) =
            (muscles.text("job_id", row), muscles.text("muscle", row), muscles.number(options.measure, row))
        {
            loads.entry(job).or_default().push((muscle, value));
        }
    }
    let is_converged = |row: usize| jobs.text("status", row) == Some(Status::Converged.name());
    let load = |row: usize| is_converged(row).then(|| loads.get(jobs.text("job_id", row)?))?;
    let mut references: HashMap<Vec<(String, String)>, usize> = HashMap::new();
    for row in (0..jobs.rows()).filter(|&row| is_reference(jobs, options, row)) {
        references.entry(others(jobs, axes, options, row)).or_insert(row);
    }
    let ranking = |row: usize| {
        let reference = *references.get(&others(jobs, axes, options, row))?;
        let before: HashMap<&str, f64> = load(reference)?.iter().copied().collect();
        // Match by name: a muscle that acts on no moving body in one of the jobs has no row there.
        let change = |&(muscle, value): &(&str, f64)| {
            let reference = *before.get(muscle)?;
            Some(Response { muscle: muscle.to_owned(), reference, value })
        };
        let mut changes: Vec<Response> = load(row)?.iter().filter_map(change).collect();
        changes.sort_by(|a, b| b.difference().abs().total_cmp(&a.difference().abs()));
        Some(Ranking { row, changes })
    };
    (0..jobs.rows()).filter(|&row| !is_reference(jobs, options, row)).filter_map(ranking).collect()
}

fn print_ranking(jobs: &Table, axes: &[String], options: &RankOptions<'_>, ranking: &Ranking) {
    let others = others(jobs, axes, options, ranking.row);
    let here: Vec<String> = others.into_iter().map(|(axis, value)| format!("{axis} = {value}")).collect();
    let here = if here.is_empty() { String::new() } else { format!(" ({})", here.join(", ")) };
    let value = jobs.display(options.axis, ranking.row).unwrap_or_default();
    print("");
    print(&heading(&format!("{} = {value}{here}: {}", options.axis, options.measure)));
    let first = &ranking.changes[..FIRST.min(ranking.changes.len())];
    let number = |of: fn(&Response) -> f64| first.iter().map(|change| format!("{:.3}", of(change))).collect();
    let mut sheet = Sheet::default();
    sheet.text("muscle", 0, first.iter().map(|change| change.muscle.clone()).collect());
    sheet.number("reference", 1, number(|change| change.reference)).number("value", 1, number(|change| change.value));
    sheet.number("change", 0, first.iter().map(|change| format!("{:+.3}", change.difference())).collect());
    let percent = |change: &Response| change.relative().map_or(String::new(), |r| format!("{:+.1} %", 100.0 * r));
    sheet.number("relative", 0, first.iter().map(percent).collect());
    sheet.print(options.look.wide);
}

/// All muscles of all jobs: swept values, rank, muscle, reference, value, change and relative change.
fn table(jobs: &Table, axes: &[String], measure: &str, rankings: &[Ranking]) -> Table {
    let rows = || rankings.iter().flat_map(|r| r.changes.iter().enumerate().map(move |(k, change)| (r.row, k, change)));
    let number = |of: fn(&Response) -> Option<f64>| Values::Number(rows().map(|(_, _, change)| of(change)).collect());
    let mut columns: Vec<(String, Values)> = (axes.iter())
        .map(|axis| (axis.clone(), Values::Text(rows().map(|(row, ..)| jobs.display(axis, row)).collect())))
        .collect();
    columns.extend([
        ("rank".to_owned(), Values::Integer(rows().map(|(_, k, _)| Some(k as i64 + 1)).collect())),
        ("muscle".to_owned(), Values::Text(rows().map(|(_, _, change)| Some(change.muscle.clone())).collect())),
        (format!("reference_{measure}"), number(|change| Some(change.reference))),
        (measure.to_owned(), number(|change| Some(change.value))),
        (format!("change_{measure}"), number(|change| Some(change.difference()))),
        ("relative_change".to_owned(), number(Response::relative)),
    ]);
    Table { name: "ranking", columns }
}
