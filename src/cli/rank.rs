//! `sinew rank`: which muscles answer a change: every muscle against the job of the reference value, from the tables alone.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use super::{GOOD, print, write_table};
use crate::error::{Error, Result, nearest};
use crate::outcome::Status;
use crate::tables::{self, Table, Values, schema};

/// Measures of muscles.parquet that are ranked by.
const MEASURES: [&str; 6] =
    ["mean_force_n", "peak_force_n", "impulse_n_s", "mean_activation", "peak_activation", "min_force_n"];

pub struct Options<'a> {
    pub axis: &'a str,
    pub reference: &'a str,
    pub measure: &'a str,
    pub out: Option<&'a Path>,
}

/// Change of one muscle in one job.
struct Change {
    muscle: String,
    reference: f64,
    value: f64,
}

pub fn rank(folder: &Path, options: &Options<'_>) -> Result<u8> {
    let wrong = |reason: String| Error::table("rank the muscles of", folder, reason);
    let jobs = tables::read("jobs", &folder.join("jobs.parquet"))?;
    let muscles = tables::read("muscles", &folder.join("muscles.parquet"))?;
    let axes = schema::axes(&jobs);
    if !axes.iter().any(|axis| axis == options.axis) {
        let near = nearest(options.axis, axes.iter().map(String::as_str));
        let near = near.map(|n| format!("did you mean `{n}`? ")).unwrap_or_default();
        return Err(wrong(format!("`{}` is not swept; {near}swept: {}", options.axis, axes.join(", "))));
    }
    if !MEASURES.contains(&options.measure) {
        return Err(wrong(format!("`{}` is no measure; there is: {}", options.measure, MEASURES.join(", "))));
    }
    let value = |row: usize| jobs.display(options.axis, row).unwrap_or_default();
    let is_reference = |row: usize| match (value(row).parse::<f64>(), options.reference.parse::<f64>()) {
        (Ok(a), Ok(b)) => (a - b).abs() <= 1e-12 * a.abs().max(b.abs()),
        _ => value(row) == options.reference,
    };
    let rows = || 0..jobs.rows();
    if !rows().any(is_reference) {
        let mut there: Vec<String> = rows().map(value).collect();
        there.dedup();
        return Err(wrong(format!(
            "no job has {} = {}; there is: {}",
            options.axis,
            options.reference,
            there.join(", ")
        )));
    }
    // What else a job is.
    let others = |row: usize| -> Vec<(String, String)> {
        let others = axes.iter().filter(|axis| *axis != options.axis);
        others.map(|axis| (axis.clone(), jobs.display(axis, row).unwrap_or_default())).collect()
    };
    let mut loads: BTreeMap<&str, Vec<(&str, f64)>> = BTreeMap::new();
    for row in 0..muscles.rows() {
        if let (Some(job), Some(muscle), Some(value)) =
            (muscles.text("job_id", row), muscles.text("muscle", row), muscles.number(options.measure, row))
        {
            loads.entry(job).or_default().push((muscle, value));
        }
    }
    let converged = |row: usize| jobs.text("status", row) == Some(Status::Converged.name());
    let load = |row: usize| converged(row).then(|| loads.get(jobs.text("job_id", row)?))?;
    let mut columns: Vec<(String, Vec<Option<String>>)> = axes.iter().map(|axis| (axis.clone(), Vec::new())).collect();
    let mut references: HashMap<Vec<(String, String)>, usize> = HashMap::new();
    for row in rows().filter(|&row| is_reference(row)) {
        references.entry(others(row)).or_insert(row);
    }
    let (mut ranks, mut names) = (Vec::new(), Vec::new());
    let mut numbers: [Vec<Option<f64>>; 4] = Default::default();
    for row in rows().filter(|&row| !is_reference(row)) {
        let others = others(row);
        let reference = references.get(&others).copied();
        let (Some(now), Some(before)) = (load(row), reference.and_then(load)) else { continue };
        let before: HashMap<&str, f64> = before.iter().copied().collect();
        let mut changes: Vec<Change> = (now.iter())
            .filter_map(|(muscle, value)| {
                // By name: a muscle that acts on nothing in one of the jobs has no row there.
                let reference = *before.get(muscle)?;
                Some(Change { muscle: (*muscle).to_owned(), reference, value: *value })
            })
            .collect();
        changes.sort_by(|a, b| (b.value - b.reference).abs().total_cmp(&(a.value - a.reference).abs()));
        let here: Vec<String> = others.into_iter().map(|(axis, value)| format!("{axis} = {value}")).collect();
        let here = if here.is_empty() { String::new() } else { format!(" ({})", here.join(", ")) };
        if options.out.is_none() {
            print(&format!("\n{} = {}{here}: {}", options.axis, value(row), options.measure));
        }
        for (k, change) in changes.iter().enumerate() {
            let by = change.value - change.reference;
            let relative = (change.reference != 0.0).then(|| by / change.reference);
            if options.out.is_none() && k < 10 {
                let percent = relative.map_or(String::new(), |r| format!("{:+.1} %", 100.0 * r));
                let Change { muscle, reference, value } = change;
                print(&format!("{:>3}  {muscle:<28} {reference:>10.3} → {value:>10.3}  {by:>+10.3}  {percent}", k + 1));
            }
            for (axis, column) in &mut columns {
                column.push(jobs.display(axis, row));
            }
            ranks.push(Some(k as i64 + 1));
            names.push(Some(change.muscle.clone()));
            let four = [Some(change.reference), Some(change.value), Some(by), relative];
            numbers.iter_mut().zip(four).for_each(|(column, x)| column.push(x));
        }
    }
    if let Some(out) = options.out {
        let mut all: Vec<(String, Values)> =
            columns.into_iter().map(|(axis, values)| (axis, Values::Text(values))).collect();
        all.push(("rank".to_owned(), Values::Integer(ranks)));
        all.push(("muscle".to_owned(), Values::Text(names)));
        let measure = options.measure;
        let heads =
            [format!("reference_{measure}"), measure.to_owned(), format!("change_{measure}"), "relative_change".into()];
        all.extend(heads.into_iter().zip(numbers.map(Values::Number)));
        let table = Table { name: "ranking", columns: all };
        let rows = table.rows();
        let metadata = vec![("sinew.axis".to_owned(), options.axis.to_owned())];
        if let Some(path) = write_table(&table, metadata, Some(out))? {
            print(&format!("{rows} row(s): {}", path.display()));
        }
    }
    Ok(GOOD)
}
