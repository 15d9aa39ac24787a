//! `sinew export`: writes selected jobs as OpenSim storage files, or tables as CSV.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::{Path, PathBuf};

use super::output::csv;
use super::{GOOD, print};
use crate::error::{Error, Result};
use crate::files::write_atomically;
use crate::names::counted;
use crate::run::folder;
use crate::tables::{self, Table, Values, schema};

/// Signals of `trajectories` that are exported, each to its own file: signal, and suffix of the file name.
const SIGNALS: [(&str, &str); 6] = [
    ("joint_coordinate", "coordinates"),
    ("activation", "activations"),
    ("excitation", "excitations"),
    ("force_n", "forces"),
    ("fibre_length", "fibre_lengths"),
    ("fibre_velocity", "fibre_velocities"),
];

/// What to export, and where.
pub struct ExportOptions {
    /// Write storage files instead of CSV tables.
    pub sto: bool,
    /// The table to write; all if `None`.
    pub table: Option<String>,
    /// Numbers of the jobs; all if empty.
    pub jobs: Vec<u64>,
    /// `DIR/export` if `None`.
    pub out: Option<PathBuf>,
}

pub fn export(dir: &Path, options: &ExportOptions) -> Result<u8> {
    let out = options.out.clone().unwrap_or_else(|| dir.join("export"));
    let jobs = tables::read("jobs", &folder::table(dir, "jobs"))?;
    let chosen = chosen_jobs(dir, &jobs, &options.jobs)?;
    std::fs::create_dir_all(&out).map_err(|e| Error::io("create", &out, e))?;
    let count = if options.sto {
        storage_files(dir, &chosen, &out)?
    } else {
        csv_files(dir, &chosen, options.table.as_deref(), &out)?
    };
    print(&format!("{} in {}", counted(count, "file"), out.display()));
    Ok(GOOD)
}

/// Ids of the requested jobs, with their numbers.
fn chosen_jobs(dir: &Path, jobs: &Table, wanted: &[u64]) -> Result<HashMap<String, i64>> {
    let mut chosen = HashMap::new();
    for row in 0..jobs.rows() {
        if let (Some(id), Some(index)) = (jobs.text("job_id", row), jobs.integer("index", row))
            && (wanted.is_empty() || wanted.iter().any(|&number| i64::try_from(number) == Ok(index)))
        {
            chosen.insert(id.to_owned(), index);
        }
    }
    let missing = wanted.iter().find(|&&number| !chosen.values().any(|&index| i64::try_from(number) == Ok(index)));
    match missing {
        None => Ok(chosen),
        Some(number) => Err(Error::table("export", dir, format!("the folder has no finished job {number}"))),
    }
}

/// The times of a signal, and for each of its names the values at these times.
type TimeSeries = (Vec<f64>, Vec<(String, Vec<f64>)>);

/// Writes a file for each job and signal; returns the number of files.
fn storage_files(dir: &Path, chosen: &HashMap<String, i64>, out: &Path) -> Result<usize> {
    let path = folder::table(dir, "trajectories");
    if !path.exists() {
        let reason = "there is no trajectories.parquet: set `trajectories = true` in [base] of the study and run it \
                      again (solved jobs are not solved again)";
        return Err(Error::table("export trajectories of", dir, reason));
    }
    let table = tables::read("trajectories", &path)?;
    let mut count = 0;
    let mut start = 0;
    while start < table.rows() {
        let id = table.text("job_id", start).unwrap_or_default();
        let end = (start..table.rows()).find(|&row| table.text("job_id", row) != Some(id)).unwrap_or(table.rows());
        if let Some(index) = chosen.get(id) {
            for (signal, title) in SIGNALS {
                let Some(series) = time_series(&table, start..end, signal) else { continue };
                let name = format!("job-{index}_{title}");
                write_atomically(&out.join(format!("{name}.sto")), storage(&name, &series))?;
                count += 1;
            }
        }
        start = end;
    }
    Ok(count)
}

/// One signal of one job, at the times where all its names have a value; `None` if the job does not have the signal.
fn time_series(table: &Table, rows: std::ops::Range<usize>, signal: &str) -> Option<TimeSeries> {
    let mut names: Vec<&str> = Vec::new();
    // Keys are the bits of the times, in the order of time: an instant has the same bits in every row.
    let mut at: BTreeMap<u64, HashMap<&str, f64>> = BTreeMap::new();
    let sort_key = |time: f64| time.to_bits() ^ if time < 0.0 { u64::MAX } else { 1 << 63 };
    let mut times: BTreeMap<u64, f64> = BTreeMap::new();
    for row in rows.filter(|&row| table.text("signal", row) == Some(signal)) {
        let (Some(time), Some(name), Some(value)) =
            (table.number("time_s", row), table.text("name", row), table.number("value", row))
        else {
            continue;
        };
        if !names.contains(&name) {
            names.push(name);
        }
        times.insert(sort_key(time), time);
        at.entry(sort_key(time)).or_default().insert(name, value);
    }
    let complete: BTreeSet<u64> =
        at.iter().filter(|(_, values)| values.len() == names.len()).map(|(t, _)| *t).collect();
    let values = |name: &str| complete.iter().map(|t| at[t][name]).collect();
    let columns: Vec<(String, Vec<f64>)> = names.iter().map(|name| ((*name).to_owned(), values(name))).collect();
    (!columns.is_empty()).then(|| (complete.iter().map(|t| times[t]).collect(), columns))
}

/// The text of an OpenSim storage file, version 1, SI units and radians.
fn storage(name: &str, (times, columns): &TimeSeries) -> String {
    let mut text = format!(
        "{name}\nversion=1\nnRows={}\nnColumns={}\ninDegrees=no\nendheader\ntime",
        times.len(),
        columns.len() + 1
    );
    columns.iter().for_each(|(name, _)| text.push_str(&format!("\t{name}")));
    text.push('\n');
    for (row, time) in times.iter().enumerate() {
        text.push_str(&time.to_string());
        columns.iter().for_each(|(_, values)| text.push_str(&format!("\t{}", values[row])));
        text.push('\n');
    }
    text
}

/// Writes a CSV file for each table, or for the requested one; returns the number of files.
fn csv_files(dir: &Path, chosen: &HashMap<String, i64>, wanted: Option<&str>, out: &Path) -> Result<usize> {
    let wanted = wanted.map(schema::named).transpose().map_err(|reason| Error::table("export", dir, reason))?;
    let mut count = 0;
    for name in schema::TABLES.into_iter().filter(|name| wanted.is_none_or(|wanted| wanted == *name)) {
        let path = folder::table(dir, name);
        if !path.exists() && wanted.is_none() {
            continue;
        }
        let table = of_jobs(tables::read(name, &path)?, chosen);
        write_atomically(&out.join(format!("{name}.csv")), csv(&table)?)?;
        count += 1;
    }
    Ok(count)
}

/// The rows of the chosen jobs.
fn of_jobs(table: Table, chosen: &HashMap<String, i64>) -> Table {
    let is_chosen = |row: usize| table.text("job_id", row).is_some_and(|id| chosen.contains_key(id));
    let rows: Vec<usize> = (0..table.rows()).filter(|&row| is_chosen(row)).collect();
    fn picked<T: Clone>(values: &[T], rows: &[usize]) -> Vec<T> {
        rows.iter().map(|&row| values[row].clone()).collect()
    }
    let columns = (table.columns.iter())
        .map(|(name, values)| {
            let values = match values {
                Values::Number(v) => Values::Number(picked(v, &rows)),
                Values::Integer(v) => Values::Integer(picked(v, &rows)),
                Values::Flag(v) => Values::Flag(picked(v, &rows)),
                Values::Text(v) => Values::Text(picked(v, &rows)),
            };
            (name.clone(), values)
        })
        .collect();
    Table { name: table.name, columns }
}
