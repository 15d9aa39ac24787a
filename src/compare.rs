//! Compares results with a baseline, job by job, from the tables alone.
//!
//! Jobs are matched by their id, which is the hash of everything that determines them. Each column has a tolerance:
//! exact for ranks, statuses, and other counts and texts; relative and absolute for numbers. Times are ignored.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use indexmap::IndexMap;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result, SourceFile};
use crate::files::write_atomically;
use crate::names::counted;
use crate::run::folder::check_ownership;
use crate::run::manifest::Manifest;
use crate::study::axis::SAMPLE;
use crate::tables::{self, Table, Values, schema};

/// Tables of a new baseline: small, but sufficient to detect drift.
const ACCEPTED: [&str; 4] = ["jobs", "regularity", "muscles", "ratios"];

/// The file in a baseline with its own tolerances, by column or `table.column`.
const TOLERANCES: &str = "tolerances.toml";

/// In place of a column: all columns that are not ignored.
const EVERY: &str = "*";

/// How far a value may differ from its baseline.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Tolerance {
    Exact,
    Ignored,
    /// Replaces the relative part of a column's default tolerance and keeps the absolute part.
    Relative(f64),
    /// |now − then| ≤ absolute + relative · |then|
    Within {
        relative: f64,
        absolute: f64,
    },
}

const fn within(relative: f64, absolute: f64) -> Tolerance {
    Tolerance::Within { relative, absolute }
}

impl Tolerance {
    /// The default tolerance of a column.
    fn default_of(column: &str, values: &Values) -> Self {
        match column {
            "index" | "error" | "remark" => Tolerance::Ignored,
            _ if schema::TIMINGS.contains(&column) => Tolerance::Ignored,
            // The amount of work may differ slightly between machines; a slow-down of the solver is still detected.
            "iterations" | "qp_iterations" => within(0.25, 2.0),
            // Residuals below the solver's target are equivalent to 0.
            "stationarity" | "feasibility" | "complementarity" | "max_constraint_velocity" => within(0.0, 1e-8),
            "mid_interval_error" | "ringing" | "direction_changes" | "peak_fibre_velocity_per_s" => within(1e-3, 1e-6),
            "mean_activation_low" | "mean_activation_high" => within(1e-3, 1e-5),
            "mean_force_slope" | "elasticity" => within(1e-3, 1e-6),
            _ if !matches!(values, Values::Number(_)) => Tolerance::Exact,
            _ if column.starts_with("sigma_") || column.starts_with("tolerance_") => within(1e-3, 1e-9),
            _ => within(1e-6, 1e-9),
        }
    }

    /// Parses `exact`, `ignore`, or a relative tolerance.
    ///
    /// # Errors
    /// If the text is anything else.
    pub fn parse(text: &str) -> std::result::Result<Self, String> {
        match text {
            "exact" => Ok(Tolerance::Exact),
            "ignore" => Ok(Tolerance::Ignored),
            _ => match text.parse::<f64>() {
                Ok(relative) if (0.0..f64::INFINITY).contains(&relative) => Ok(Tolerance::Relative(relative)),
                _ => Err(format!("`{text}` is not a tolerance; give a relative one such as 1e-4, exact, or ignore")),
            },
        }
    }
}

impl std::fmt::Display for Tolerance {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Tolerance::Exact => f.write_str("exact"),
            Tolerance::Ignored => f.write_str("ignored"),
            Tolerance::Relative(relative) => write!(f, "{relative:e} relative"),
            Tolerance::Within { relative, absolute } => write!(f, "± {absolute:e} + {relative:e} relative"),
        }
    }
}

/// Tolerances by column, or by `table.column`.
#[derive(Clone, Debug, Default)]
pub struct Tolerances(BTreeMap<String, Tolerance>);

/// As written in `tolerances.toml`.
#[derive(Deserialize)]
#[serde(untagged, deny_unknown_fields)]
enum Written {
    Relative(f64),
    Word(String),
    Both {
        #[serde(default)]
        relative: f64,
        #[serde(default)]
        absolute: f64,
    },
}

impl Tolerances {
    /// Reads the tolerances in a baseline, if there are any. Those of the command line (`given`) override them.
    pub fn read(baseline: &Path, given: &[(String, Tolerance)]) -> Result<Self> {
        let path = baseline.join(TOLERANCES);
        let mut tolerances = Self::default();
        if path.exists() {
            let file = SourceFile::read(&path)?;
            let help =
                "give a relative tolerance such as 1e-4, \"exact\", \"ignore\", or { relative = …, absolute = … }";
            let table: toml::Table = toml::from_str(&file.text).map_err(|e| file.toml_error(&e))?;
            for (column, value) in table {
                let place = [column.clone()];
                let wrong = || {
                    let message = format!("{column}: found {value}");
                    file.error(file.toml_span(&place), message, "here", Some(help.to_owned()))
                };
                let tolerance = match value.clone().try_into::<Written>().map_err(|_| wrong())? {
                    Written::Relative(relative) => Tolerance::parse(&relative.to_string()).map_err(|_| wrong())?,
                    Written::Word(word) => Tolerance::parse(&word).map_err(|_| wrong())?,
                    Written::Both { relative, absolute } => within(relative, absolute),
                };
                if let Tolerance::Within { relative, absolute } = tolerance
                    && !(relative >= 0.0 && absolute >= 0.0 && relative.is_finite() && absolute.is_finite())
                {
                    return Err(wrong());
                }
                tolerances.0.insert(column, tolerance);
            }
        }
        tolerances.0.extend(given.iter().cloned());
        Ok(tolerances)
    }

    /// The first name that is not a column of any table.
    fn unknown<'t>(&'t self, tables: &BTreeMap<&'static str, Table>) -> Option<&'t String> {
        let known = |name: &str| match name.split_once('.') {
            _ if name == EVERY || tables.values().any(|table| table.column(name).is_some()) => true,
            Some((table, column)) => tables.get(table).is_some_and(|table| table.column(column).is_some()),
            None => false,
        };
        self.0.keys().find(|name| !known(name))
    }

    fn of(&self, table: &str, column: &str, values: &Values) -> Tolerance {
        let own = self.0.get(&format!("{table}.{column}")).or_else(|| self.0.get(column));
        let default = Tolerance::default_of(column, values);
        let general = self.0.get(EVERY).filter(|_| default != Tolerance::Ignored);
        match (own.or(general), default) {
            (Some(Tolerance::Relative(relative)), Tolerance::Within { absolute, .. }) => within(*relative, absolute),
            (Some(Tolerance::Relative(relative)), _) => within(*relative, 0.0),
            (Some(other), _) => *other,
            (None, default) => default,
        }
    }
}

/// A job as it is shown to users.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct JobName {
    pub job_id: String,
    pub index: i64,
    /// Its swept values.
    pub swept: IndexMap<String, String>,
}

impl std::fmt::Display for JobName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let swept: Vec<String> = self.swept.iter().map(|(name, value)| format!("{name} = {value}")).collect();
        let swept = if swept.is_empty() { self.job_id.clone() } else { swept.join(", ") };
        write!(f, "job {} ({swept})", self.index)
    }
}

/// A value that has changed by more than its tolerance.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Change {
    pub table: String,
    /// The row of the job, such as a muscle; empty if a job has only one row.
    pub row: String,
    pub column: String,
    pub baseline: Option<String>,
    pub found: Option<String>,
    pub tolerance: String,
}

impl std::fmt::Display for Change {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let row = if self.row.is_empty() { String::new() } else { format!("[{}]", self.row) };
        let shown = |value: &Option<String>| value.clone().unwrap_or_else(|| "null".to_owned());
        let (then, now) = (shown(&self.baseline), shown(&self.found));
        write!(f, "{}{row}.{}: {then} → {now} ({})", self.table, self.column, self.tolerance)
    }
}

/// The result of the comparison for a job.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "class", rename_all = "snake_case")]
pub enum JobComparison {
    Unchanged,
    Changed {
        cells: Vec<Change>,
    },
    /// Not in the baseline.
    New,
    /// In the baseline only.
    Missing,
    /// Converged in the baseline, but not now.
    NewlyFailed {
        status: String,
        error: Option<String>,
    },
}

/// The result of a comparison.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// The jobs of both sides: those of the baseline in their order, then new ones.
    pub jobs: Vec<(JobName, JobComparison)>,
    /// Tables and columns of the baseline that no longer exist, which also counts as drift.
    pub removed: Vec<String>,
    /// Notes that do not affect the verdicts.
    pub warnings: Vec<String>,
}

impl Comparison {
    /// Number of jobs of each class, and of changed cells.
    pub fn counts(&self) -> BTreeMap<&'static str, usize> {
        let mut counts: BTreeMap<&'static str, usize> =
            ["unchanged", "changed", "new", "missing", "newly_failed", "changed_cells"].map(|class| (class, 0)).into();
        for (_, verdict) in &self.jobs {
            let class = match verdict {
                JobComparison::Unchanged => "unchanged",
                JobComparison::Changed { cells } => {
                    *counts.entry("changed_cells").or_default() += cells.len();
                    "changed"
                }
                JobComparison::New => "new",
                JobComparison::Missing => "missing",
                JobComparison::NewlyFailed { .. } => "newly_failed",
            };
            *counts.entry(class).or_default() += 1;
        }
        counts
    }

    /// Whether anything differs from the baseline.
    pub fn drifted(&self) -> bool {
        !self.removed.is_empty() || self.jobs.iter().any(|(_, verdict)| *verdict != JobComparison::Unchanged)
    }

    /// The comparison as JSON, without the unchanged jobs.
    pub fn json(&self) -> serde_json::Value {
        let jobs: Vec<serde_json::Value> = (self.jobs.iter())
            .filter(|(_, verdict)| *verdict != JobComparison::Unchanged)
            .map(|(name, verdict)| {
                let mut job = serde_json::to_value(name).expect("plain data");
                let verdict = serde_json::to_value(verdict).expect("plain data");
                if let (Some(job), serde_json::Value::Object(verdict)) = (job.as_object_mut(), verdict) {
                    job.extend(verdict);
                }
                job
            })
            .collect();
        serde_json::json!({
            "drift": self.drifted(),
            "counts": self.counts(),
            "jobs": jobs,
            "removed": self.removed,
            "warnings": self.warnings,
        })
    }

    /// The comparison as JUnit XML, for services that display test results. Each job is a test case.
    pub fn junit(&self, suite: &str) -> Result<String> {
        use quick_junit::{NonSuccessKind, Report, TestCase, TestCaseStatus, TestSuite};
        let mut tests = TestSuite::new(suite);
        for (name, verdict) in &self.jobs {
            let status = match verdict_text(verdict) {
                None => TestCaseStatus::success(),
                Some((message, lines)) => {
                    let mut status = TestCaseStatus::non_success(NonSuccessKind::Failure);
                    status.set_message(message).set_description(lines.join("\n"));
                    status
                }
            };
            let mut case = TestCase::new(name.to_string(), status);
            case.set_classname(suite);
            tests.add_test_case(case);
        }
        for removed in &self.removed {
            let mut status = TestCaseStatus::non_success(NonSuccessKind::Failure);
            status.set_message("in the baseline only");
            tests.add_test_case(TestCase::new(removed.clone(), status));
        }
        let mut report = Report::new("sinew compare");
        report.add_test_suite(tests);
        report.to_string().map_err(|e| Error::table("write JUnit XML for", Path::new(suite), e))
    }
}

/// A headline, and a line for each difference; `None` if the job is unchanged.
pub fn verdict_text(verdict: &JobComparison) -> Option<(String, Vec<String>)> {
    Some(match verdict {
        JobComparison::Unchanged => return None,
        JobComparison::Changed { cells } => {
            (format!("changed in {}", counted(cells.len(), "value")), cells.iter().map(ToString::to_string).collect())
        }
        JobComparison::New => ("new: not in the baseline".to_owned(), Vec::new()),
        JobComparison::Missing => ("missing: in the baseline only".to_owned(), Vec::new()),
        JobComparison::NewlyFailed { status, error } => {
            (format!("newly failed: {status}"), error.iter().cloned().collect())
        }
    })
}

/// The tables of a folder that both sides have.
struct ComparedFolder {
    tables: BTreeMap<&'static str, Table>,
}

impl ComparedFolder {
    fn read(folder: &Path, names: &[&'static str]) -> Result<Self> {
        let table = |name: &&'static str| Ok((*name, tables::read(name, &folder.join(format!("{name}.parquet")))?));
        Ok(Self { tables: names.iter().map(table).collect::<Result<_>>()? })
    }

    fn jobs(&self) -> &Table {
        &self.tables["jobs"]
    }

    fn name(&self, row: usize) -> JobName {
        let jobs = self.jobs();
        let mut axes = schema::axes(jobs);
        if axes.iter().any(|axis| axis == SAMPLE) {
            axes.retain(|axis| axis == SAMPLE); // the number of the sample identifies the job
        }
        JobName {
            job_id: jobs.text("job_id", row).unwrap_or_default().to_owned(),
            index: jobs.integer("index", row).unwrap_or(-1),
            swept: axes.into_iter().filter_map(|axis| Some((axis.clone(), jobs.display(&axis, row)?))).collect(),
        }
    }
}

/// Compares the tables of a results folder with those of a baseline, which need not have all tables.
///
/// # Errors
/// If either contains no `jobs.parquet`, or a table cannot be read.
pub fn compare(folder: &Path, baseline: &Path, tolerances: &Tolerances) -> Result<Comparison> {
    let there = |folder: &Path, name: &str| folder.join(format!("{name}.parquet")).exists();
    for side in [folder, baseline] {
        if !there(side, "jobs") {
            let reason = "it contains no jobs.parquet; give a results folder and a baseline (a copy of a results \
                          folder, or made by --accept)";
            return Err(Error::table("compare", side, reason));
        }
    }
    let mut warnings = warnings(folder, baseline);
    let old: Vec<&'static str> = schema::TABLES.into_iter().filter(|name| there(baseline, name)).collect();
    let (names, lost): (Vec<&'static str>, Vec<&'static str>) = old.into_iter().partition(|name| there(folder, name));
    let mut removed: Vec<String> = lost.into_iter().map(|name| format!("the table {name}")).collect();
    let (now, then) = (ComparedFolder::read(folder, &names)?, ComparedFolder::read(baseline, &names)?);
    if let Some(unknown) = tolerances.unknown(&then.tables) {
        let reason = format!("there is a tolerance for `{unknown}`, but no table of the baseline has such a column");
        return Err(Error::table("compare with", baseline, reason));
    }
    let mut cells = changes(&now, &then, tolerances, &mut removed, &mut warnings);

    let place = |side: &ComparedFolder| -> HashMap<String, usize> {
        (0..side.jobs().rows()).filter_map(|row| Some((side.jobs().text("job_id", row)?.to_owned(), row))).collect()
    };
    let (now_at, then_at) = (place(&now), place(&then));
    let mut jobs = Vec::new();
    for row in 0..then.jobs().rows() {
        let name = then.name(row);
        let verdict = match now_at.get(&name.job_id) {
            None => JobComparison::Missing,
            Some(&at) => {
                let status =
                    |side: &ComparedFolder, row| side.jobs().text("status", row).unwrap_or_default().to_owned();
                let (was, is) = (status(&then, row), status(&now, at));
                if was == "converged" && is != "converged" {
                    JobComparison::NewlyFailed { status: is, error: now.jobs().text("error", at).map(str::to_owned) }
                } else {
                    match cells.remove(&name.job_id) {
                        None => JobComparison::Unchanged,
                        Some(cells) => JobComparison::Changed { cells },
                    }
                }
            }
        };
        jobs.push((name, verdict));
    }
    for row in 0..now.jobs().rows() {
        let name = now.name(row);
        if !then_at.contains_key(&name.job_id) {
            jobs.push((name, JobComparison::New));
        }
    }
    if !jobs.is_empty()
        && jobs.iter().all(|(_, verdict)| matches!(verdict, JobComparison::New | JobComparison::Missing))
    {
        warnings.push(
            "the two sides have no job in common: the study, its model or motion, or the version of the results has \
             changed"
                .to_owned(),
        );
    }
    Ok(Comparison { jobs, removed, warnings })
}

fn warnings(folder: &Path, baseline: &Path) -> Vec<String> {
    let mut warnings = Vec::new();
    let mut solvers = Vec::new();
    for side in [folder, baseline] {
        match Manifest::read(side) {
            Ok(Some(manifest)) => {
                for name in manifest.altered_files(side) {
                    let path = side.join(name);
                    warnings.push(format!("{} is not the file recorded in its manifest", path.display()));
                }
                solvers.push(manifest.sinew.solver);
            }
            Ok(None) => {}
            Err(error) => warnings.push(error.to_string()),
        }
    }
    if let [now, then] = &solvers[..]
        && now != then
    {
        warnings.push(format!("the baseline was made with solver {then}, these results with {now}"));
    }
    warnings
}

/// Changed cells by job, for jobs on both sides.
fn changes(
    now: &ComparedFolder,
    then: &ComparedFolder,
    tolerances: &Tolerances,
    removed: &mut Vec<String>,
    warnings: &mut Vec<String>,
) -> HashMap<String, Vec<Change>> {
    let mut found: HashMap<String, Vec<Change>> = HashMap::new();
    let ids = |side: &ComparedFolder| -> std::collections::HashSet<String> {
        (0..side.jobs().rows()).filter_map(|row| side.jobs().text("job_id", row).map(str::to_owned)).collect()
    };
    let (now_ids, then_ids) = (ids(now), ids(then));
    let old_axes = schema::axes(then.jobs());
    for (name, old) in &then.tables {
        let new = &now.tables[name];
        let mut columns: Vec<(&str, Tolerance)> = Vec::new();
        for (column, values) in old.columns.iter().filter(|(column, _)| column != "job_id") {
            let tolerance = tolerances.of(name, column, values);
            match new.column(column) {
                _ if tolerance == Tolerance::Ignored => {}
                Some(_) => columns.push((column, tolerance)),
                None if *name == "jobs" && old_axes.contains(column) => {
                    warnings.push(format!("`{column}` is no longer swept"));
                }
                None => removed.push(format!("the column {name}.{column}")),
            }
        }
        let keys = schema::row_keys(name);
        let (old_rows, new_rows) = (rows(old, keys), rows(new, keys));
        let mut report = |key: &(String, String), column: &str, then, now, tolerance: String| {
            if now_ids.contains(&key.0) && then_ids.contains(&key.0) {
                let change = Change {
                    table: (*name).to_owned(),
                    row: key.1.clone(),
                    column: column.to_owned(),
                    baseline: then,
                    found: now,
                    tolerance,
                };
                found.entry(key.0.clone()).or_default().push(change);
            }
        };
        let mut order: Vec<(&(String, String), &usize)> = old_rows.iter().collect();
        order.sort_by_key(|(_, row)| **row);
        for (key, &row) in order {
            let Some(&at) = new_rows.get(key) else {
                report(key, "(row)", Some("there".to_owned()), None, "exact".to_owned());
                continue;
            };
            for &(column, tolerance) in &columns {
                if !agrees(old, row, new, at, column, tolerance) {
                    report(key, column, old.display(column, row), new.display(column, at), tolerance.to_string());
                }
            }
        }
        let mut added: Vec<(&(String, String), &usize)> =
            new_rows.iter().filter(|(key, _)| !old_rows.contains_key(*key)).collect();
        added.sort_by_key(|(_, row)| **row);
        added.into_iter().for_each(|(key, _)| report(key, "(row)", None, Some("there".to_owned()), "exact".to_owned()));
    }
    found
}

/// Rows by job and by the key that distinguishes the rows of a job. Rows with equal keys are numbered.
fn rows(table: &Table, keys: &[&str]) -> HashMap<(String, String), usize> {
    let mut found = HashMap::new();
    for row in 0..table.rows() {
        let job = table.text("job_id", row).unwrap_or_default().to_owned();
        let key: Vec<String> = keys.iter().map(|key| table.display(key, row).unwrap_or_default()).collect();
        let key = key.join(", ");
        let mut number = 1;
        let mut unique = (job.clone(), key.clone());
        while found.contains_key(&unique) {
            number += 1;
            unique = (job.clone(), format!("{key} #{number}"));
        }
        found.insert(unique, row);
    }
    found
}

/// Whether a value agrees with its baseline within a tolerance.
fn agrees(old: &Table, row: usize, new: &Table, at: usize, column: &str, tolerance: Tolerance) -> bool {
    let exact = || old.display(column, row) == new.display(column, at);
    let Tolerance::Within { relative, absolute } = tolerance else { return exact() };
    match (old.number(column, row), new.number(column, at)) {
        (Some(then), Some(now)) => (now - then).abs() <= absolute + relative * then.abs(),
        _ => exact(),
    }
}

/// Makes tables of a results folder the baseline: those that the baseline has, or the default ones if it is new.
/// Returns the names of the copied files.
///
/// # Errors
/// If the tables cannot be read, do not cover the whole study, or differ from those recorded in the manifest; if the
/// baseline has files that Sinew has not written; if a file cannot be copied.
pub fn accept(folder: &Path, baseline: &Path) -> Result<Vec<String>> {
    let refuse = |reason: String| Err(Error::table("accept", folder, reason));
    let Some(mut manifest) = Manifest::read(folder)? else {
        return refuse("it contains no manifest.json, so it is not a results folder".to_owned());
    };
    if let Some(name) = manifest.altered_files(folder).first() {
        return refuse(format!(
            "{name} is not the file recorded in its manifest; `sinew merge` makes the tables again"
        ));
    }
    if !manifest.files.contains_key("jobs.parquet") {
        return refuse("its run has not ended, so there are no tables".to_owned());
    }
    let jobs = manifest.jobs.len();
    if manifest.finished < jobs {
        return refuse(format!("{} of {jobs} jobs are finished; run the study to its end first", manifest.finished));
    }
    for name in schema::TABLES.iter().filter(|name| manifest.files.contains_key(&format!("{name}.parquet"))) {
        tables::read(name, &folder.join(format!("{name}.parquet")))?;
    }
    if folder.canonicalize().ok().is_some_and(|path| baseline.canonicalize().ok() == Some(path)) {
        return Err(Error::table("accept", folder, "it is the baseline itself"));
    }
    std::fs::create_dir_all(baseline).map_err(|e| Error::io("create", baseline, e))?;
    check_ownership(baseline)?;
    let file = |name: &str| format!("{name}.parquet");
    let has_own = baseline.join(file("jobs")).exists();
    let wanted = |name: &&&str| {
        let here = folder.join(file(name)).exists();
        here && (ACCEPTED.contains(*name) && !has_own
            || baseline.join(file(name)).exists()
            || **name == "ratios" && baseline.join(file("muscles")).exists())
    };
    let names: Vec<String> = schema::TABLES.iter().filter(wanted).map(|name| file(name)).collect();
    for name in &names {
        let from = folder.join(name);
        write_atomically(&baseline.join(name), std::fs::read(&from).map_err(|e| Error::io("read", &from, e))?)?;
    }
    for name in schema::TABLES.iter().map(|name| file(name)).filter(|name| !names.contains(name)) {
        let _ = std::fs::remove_file(baseline.join(name)); // a table that the results no longer have
    }
    manifest.files.retain(|name, _| names.contains(name));
    manifest.portable().write(baseline)?;
    Ok(names)
}
