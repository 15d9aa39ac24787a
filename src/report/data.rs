//! What the page is made from: the manifest, the tables column by column, the thesis' numbers and curves, a baseline.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::Path;

use serde_json::{Map, Value as Json, json};

use crate::compare::{Tolerances, Verdict, compare};
use crate::error::{Error, Result};
use crate::model::curves::{ForceVelocity, Jet, active_force_length, passive_force_length, tendon_force};
use crate::plausibility::KINDS;
use crate::run::manifest::Manifest;
use crate::table1::THESIS;
use crate::tables::{self, Table, Values, schema};

/// Cells of a table that the page takes, at most; jobs beyond are named as left out.
const CELLS: [(&str, usize); 9] = [
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
/// Columns that a page of many jobs does without.
const MANY_JOBS: usize = 2_000;
const OF_FEW: [&str; 8] = [
    "impulse_n_s",
    "min_force_n",
    "direction_changes",
    "peak_fibre_velocity_per_s",
    "tolerance_a",
    "tolerance_aj",
    "sigma_max_a",
    "sigma_max_aj",
];
/// Tables of a baseline whose curves are drawn beside the new ones.
const OF_BASELINE: [&str; 4] = ["jobs", "muscles", "ratios", "trajectories"];
/// Changes against a baseline that are listed.
const CHANGES: usize = 2_000;

pub fn gather(dir: &Path, baseline: Option<&Path>) -> Result<Json> {
    let Some(manifest) = Manifest::read(dir)? else {
        let reason = "there is no manifest.json in it, so it is no results folder; `sinew run STUDY` makes one";
        return Err(Error::table("report on", dir, reason));
    };
    let mut notes: Vec<String> = manifest
        .altered(dir)
        .into_iter()
        .map(|name| format!("{name} is not the file that the manifest speaks of"))
        .collect();
    let found = read_all(dir, &mut notes)?;
    let jobs = found.get("jobs").and_then(|jobs| jobs["rows"].as_u64()).unwrap_or_default() as usize;
    let beside = baseline.map(|baseline| beside(dir, baseline, &mut notes)).transpose()?;
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
        // A baseline's manifest names no jobs.
        "planned": manifest.jobs.len().max(jobs),
        "axes": manifest.axes,
        "units": units,
        "base": manifest.base,
        "tables": found,
        "notes": notes,
        "warnings": KINDS.map(|kind| json!({ "code": kind.code, "limit": kind.limit, "remedy": kind.remedy })),
        "thesis": THESIS.map(|(grid, bounds, a, aj)| json!({ "grid": grid, "bounds": bounds, "a": a, "aj": aj })),
        "curves": curves(),
        "beside": beside,
    }))
}

fn read_all(dir: &Path, notes: &mut Vec<String>) -> Result<Map<String, Json>> {
    let mut found = Map::new();
    let mut many = false;
    for (name, cells) in CELLS {
        let path = dir.join(format!("{name}.parquet"));
        if !path.exists() {
            continue;
        }
        let mut table = tables::read(name, &path)?;
        many |= name == "jobs" && table.rows() > MANY_JOBS;
        if many {
            table.columns.retain(|(column, _)| !OF_FEW.contains(&column.as_str()));
        }
        let rows = whole_jobs(&table, cells);
        if rows < table.rows() {
            let jobs = jobs_of(&table, rows);
            notes.push(format!("of {name} the page has the first {jobs} jobs; all are in {name}.parquet"));
        }
        found.insert(name.to_owned(), columns(&table, rows));
    }
    Ok(found)
}

/// The number of rows, of no more than so many cells, that ends with the last row of a job.
fn whole_jobs(table: &Table, cells: usize) -> usize {
    let most = cells / table.columns.len().max(1);
    if table.rows() <= most {
        return table.rows();
    }
    let job = |row: usize| table.text("job_id", row);
    (1..=most).rev().find(|&row| job(row) != job(row - 1)).unwrap_or(0)
}

fn jobs_of(table: &Table, rows: usize) -> usize {
    (0..rows).filter_map(|row| table.text("job_id", row)).collect::<HashSet<_>>().len()
}

/// `{rows, columns: [{name, unit, values}]}`; texts as `{name, words, at}`, −1 where missing.
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

/// Figures 2 to 4 of the thesis: the curves of every muscle with its default parameters.
fn curves() -> Json {
    let sampled = |curve: &dyn Fn(f64) -> f64, from: f64, to: f64| -> Vec<[f64; 2]> {
        (0..=100).map(|i| from + (to - from) * f64::from(i) / 100.0).map(|x| [x, curve(x)]).collect()
    };
    let value = |curve: fn(f64) -> Jet| move |x: f64| curve(x).value;
    let velocity = ForceVelocity::default();
    json!([
        { "title": "Active force–length", "figure": "Figure 2", "x": "fibre length / optimal", "y": "force / maximum",
          "points": sampled(&value(active_force_length), 0.3, 1.8) },
        { "title": "Passive force–length", "figure": "Figure 2", "x": "fibre length / optimal", "y": "force / maximum",
          "points": sampled(&value(passive_force_length), 0.3, 1.55) },
        { "title": "Force–velocity", "figure": "Figure 3", "x": "fibre velocity / maximum shortening", "y": "force / isometric",
          "points": sampled(&|v| velocity.at(v).value, -1.0, 1.0) },
        { "title": "Tendon", "figure": "Figure 4", "x": "strain", "y": "force / maximum",
          "points": sampled(&tendon_force, 0.0, 0.035) },
    ])
}

/// The baseline's own tables, and what has changed.
fn beside(dir: &Path, baseline: &Path, notes: &mut Vec<String>) -> Result<Json> {
    let comparison = compare(dir, baseline, &Tolerances::read(baseline, &[])?)?;
    notes.extend(comparison.warnings.iter().cloned());
    let counts: BTreeMap<&str, usize> = comparison.counts();
    let mut changes = Vec::new();
    for (job, verdict) in &comparison.jobs {
        if let Verdict::Changed { cells } = verdict {
            changes.extend(cells.iter().map(|change| {
                json!({ "job": job.index, "job_id": job.job_id, "table": change.table, "row": change.row, "column": change.column,
                        "baseline": change.baseline, "found": change.found, "tolerance": change.tolerance })
            }));
        }
    }
    if changes.len() > CHANGES {
        notes.push(format!("{} cells have changed; the page lists the first {CHANGES}", changes.len()));
        changes.truncate(CHANGES);
    }
    let mut old = Map::new();
    for (name, cells) in CELLS.into_iter().filter(|(name, _)| OF_BASELINE.contains(name)) {
        let path = baseline.join(format!("{name}.parquet"));
        if path.exists() {
            let table = tables::read(name, &path)?;
            let rows = whole_jobs(&table, cells);
            old.insert(name.to_owned(), columns(&table, rows));
        }
    }
    Ok(json!({ "folder": baseline, "counts": counts, "gone": comparison.gone, "changes": changes, "tables": old }))
}
