//! Gathers the data of the report page: manifest, tables by column, the thesis' numbers and curves, and a baseline.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::Path;

use serde_json::{Map, Value as Json, json};

use crate::compare::{JobComparison, Tolerances, compare};
use crate::curves::{Curves, MuscleCurves, Shape};
use crate::error::{Error, Result};
use crate::plausibility::WARNING_KINDS;
use crate::run::manifest::Manifest;
use crate::table1::THESIS;
use crate::tables::{self, Table, Values, schema};

/// The tables on the page, each with the largest number of cells it may contribute. A note reports omitted jobs.
const CELL_LIMITS: [(&str, usize); 9] = [
    ("jobs", usize::MAX),
    ("regularity", 400_000),
    ("muscles", 600_000),
    ("ratios", 200_000),
    ("iterations", 150_000),
    ("spectrum", 150_000),
    ("optima", 60_000),
    ("sensitivities", 60_000),
    ("trajectories", 900_000),
];
/// A page of more jobs than this omits [`OPTIONAL_COLUMNS`].
const MANY_JOBS: usize = 2_000;
const OPTIONAL_COLUMNS: [&str; 8] = [
    "impulse_n_s",
    "min_force_n",
    "direction_changes",
    "peak_fibre_velocity_per_s",
    "tolerance_a",
    "tolerance_aj",
    "sigma_max_a",
    "sigma_max_aj",
];
/// Baseline tables whose curves are drawn with the new ones.
const BASELINE_TABLES: [&str; 4] = ["jobs", "muscles", "ratios", "trajectories"];
/// Largest number of changes against a baseline to list.
const MAX_CHANGES: usize = 2_000;

/// All data of the page, as `page.js` and `figures.js` read it.
pub fn gather(dir: &Path, baseline: Option<&Path>) -> Result<Json> {
    let Some(manifest) = Manifest::read(dir)? else {
        let reason = "it contains no manifest.json, so it is not a results folder; `sinew run STUDY` creates one";
        return Err(Error::table("report on", dir, reason));
    };
    let mut notes: Vec<String> = manifest
        .altered_files(dir)
        .into_iter()
        .map(|name| format!("{name} is not the file recorded in the manifest"))
        .collect();
    let found = read_all(dir, &mut notes)?;
    let jobs = found.get("jobs").and_then(|jobs| jobs["rows"].as_u64()).unwrap_or_default() as usize;
    let beside = baseline.map(|baseline| baseline_data(dir, baseline, &mut notes)).transpose()?;
    let units: Map<String, Json> =
        manifest.axes.iter().map(|axis| (axis.clone(), json!(tables::axis_unit(axis)))).collect();
    let study = &manifest.study;
    Ok(json!({
        "study": {
            "name": study.name,
            "description": study.description,
            "file": study.file,
            "hash": study.hash,
            "model": { "file": study.model.file, "hash": study.model.hash },
            "motion": { "file": study.motion.file, "hash": study.motion.hash },
        },
        "sinew": manifest.sinew,
        "host": manifest.host,
        // The manifest of a baseline lists no jobs.
        "planned": manifest.jobs.len().max(jobs),
        "axes": manifest.axes,
        "units": units,
        "base": manifest.base,
        "tables": found,
        "notes": notes,
        "warnings": WARNING_KINDS.map(|kind| json!({ "code": kind.code, "limit": kind.limit, "remedy": kind.remedy })),
        "thesis": THESIS.map(|(grid, bounds, a, aj)| json!({ "grid": grid, "bounds": bounds, "a": a, "aj": aj })),
        "curves": curves(),
        "beside": beside,
    }))
}

fn read_all(dir: &Path, notes: &mut Vec<String>) -> Result<Map<String, Json>> {
    let mut found = Map::new();
    let mut many = false;
    for (name, cells) in CELL_LIMITS {
        let path = dir.join(format!("{name}.parquet"));
        if !path.exists() {
            continue;
        }
        let mut table = tables::read(name, &path)?;
        many |= name == "jobs" && table.rows() > MANY_JOBS;
        if many {
            table.columns.retain(|(column, _)| !OPTIONAL_COLUMNS.contains(&column.as_str()));
        }
        let rows = whole_jobs(&table, cells);
        if rows < table.rows() {
            let jobs = count_jobs(&table, rows);
            notes.push(format!(
                "the page shows only the first {jobs} jobs of the table {name}; {name}.parquet contains all of them"
            ));
        }
        found.insert(name.to_owned(), columns(&table, rows));
    }
    Ok(found)
}

/// The largest number of leading rows that has at most `cells` cells and ends with the last row of a job.
fn whole_jobs(table: &Table, cells: usize) -> usize {
    let most = cells / table.columns.len().max(1);
    if table.rows() <= most {
        return table.rows();
    }
    let job = |row: usize| table.text("job_id", row);
    (1..=most).rev().find(|&row| job(row) != job(row - 1)).unwrap_or(0)
}

/// The number of jobs in the first `rows` rows.
fn count_jobs(table: &Table, rows: usize) -> usize {
    (0..rows).filter_map(|row| table.text("job_id", row)).collect::<HashSet<_>>().len()
}

/// The first `rows` rows as `{rows, columns: [{name, unit, values}]}`. A text column is `{name, words, at}`: the
/// distinct texts, and for each row the index of its text, −1 if missing.
fn columns(table: &Table, rows: usize) -> Json {
    let mut columns = Vec::new();
    for (name, values) in &table.columns {
        let unit = schema::unit(table.name, name);
        let column = match values {
            Values::Number(v) => json!({ "name": name, "unit": unit, "values": v[..rows] }),
            Values::Integer(v) => json!({ "name": name, "unit": unit, "values": v[..rows] }),
            Values::Flag(v) => json!({ "name": name, "unit": unit, "values": v[..rows] }),
            Values::Text(v) => {
                let mut places: HashMap<&str, usize> = HashMap::new();
                let mut words: Vec<&str> = Vec::new();
                let mut at: Vec<i64> = Vec::with_capacity(rows);
                for word in &v[..rows] {
                    at.push(word.as_deref().map_or(-1, |word| {
                        let place = *places.entry(word).or_insert(words.len());
                        if place == words.len() {
                            words.push(word);
                        }
                        place as i64
                    }));
                }
                json!({ "name": name, "words": words, "at": at })
            }
        };
        columns.push(column);
    }
    json!({ "rows": rows, "columns": columns })
}

/// The muscle curves of each family with default parameters; those of the thesis as in its Figures 2 to 4.
fn curves() -> Json {
    let families = MuscleCurves::VARIANTS.iter().map(|family| (family.name(), family.with(&Shape::default())));
    let families: Vec<_> = families.collect();
    let figure =
        |title: &str, figure: &str, [x, y]: [&str; 2], [from, to]: [f64; 2], of: fn(&dyn Curves, f64) -> f64| {
            let series = families.iter().map(|(name, family)| {
                let at = (0..=100).map(|i| from + (to - from) * f64::from(i) / 100.0);
                json!({ "name": name, "points": at.map(|x| [x, of(family.as_ref(), x)]).collect::<Vec<_>>() })
            });
            json!({ "title": title, "figure": figure, "x": x, "y": y, "series": series.collect::<Vec<_>>() })
        };
    let length = ["fibre length / optimal", "force / maximum"];
    let velocity = ["fibre velocity / maximum shortening", "force / isometric"];
    json!([
        figure("Active force–length", "Figure 2", length, [0.3, 1.9], |own, l| own.active_force_length(l).value),
        figure("Passive force–length", "Figure 2", length, [0.3, 1.55], |own, l| own.passive_force_length(l).value),
        figure("Force–velocity", "Figure 3", velocity, [-1.0, 1.0], |own, v| own.force_velocity(v).value),
        figure("Tendon", "Figure 4", ["strain", "force / maximum"], [0.0, 0.049], |own, l| own.tendon_force(l)),
    ])
}

/// The baseline's tables and the changes against it.
fn baseline_data(dir: &Path, baseline: &Path, notes: &mut Vec<String>) -> Result<Json> {
    let comparison = compare(dir, baseline, &Tolerances::read(baseline, &[])?)?;
    notes.extend(comparison.warnings.iter().cloned());
    let counts: BTreeMap<&str, usize> = comparison.counts();
    let mut changes = Vec::new();
    for (job, verdict) in &comparison.jobs {
        if let JobComparison::Changed { cells } = verdict {
            changes.extend(cells.iter().map(|change| {
                json!({ "job": job.index, "job_id": job.job_id, "table": change.table, "row": change.row,
                        "column": change.column, "baseline": change.baseline, "found": change.found,
                        "tolerance": change.tolerance })
            }));
        }
    }
    if changes.len() > MAX_CHANGES {
        notes.push(format!("{} cells have changed; the page lists the first {MAX_CHANGES}", changes.len()));
        changes.truncate(MAX_CHANGES);
    }
    let mut old = Map::new();
    for (name, cells) in CELL_LIMITS.into_iter().filter(|(name, _)| BASELINE_TABLES.contains(name)) {
        let path = baseline.join(format!("{name}.parquet"));
        if path.exists() {
            let table = tables::read(name, &path)?;
            let rows = whole_jobs(&table, cells);
            old.insert(name.to_owned(), columns(&table, rows));
        }
    }
    Ok(json!({ "folder": baseline, "counts": counts, "gone": comparison.removed, "changes": changes, "tables": old }))
}
