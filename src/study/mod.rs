//! From a study file to jobs: pure, deterministic, no solving.

pub mod change;
pub mod settings;
pub mod sweep;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Serialize;

use crate::error::{Error, Issue, Result, SourceFile, nearest};
use crate::model::Model;
use crate::model::file::ModelFile;
use crate::motion::MotionTable;
use change::{ModelChange, changed_model, is_model_path};
use settings::{Complaint, Settings, Value, WarmStart};

/// A part of every job's identity: raised when the meaning of a result changes.
pub const SCHEMA_VERSION: u32 = 2;

/// A study, checked and expanded.
#[derive(Clone, Debug)]
pub struct Study {
    pub name: String,
    pub description: String,
    pub path: PathBuf,
    pub model_path: PathBuf,
    pub motion_path: PathBuf,
    pub model: Model,
    pub motion: Arc<MotionTable>,
    /// Names of everything swept, in order.
    pub axes: Vec<String>,
    pub jobs: Vec<Job>,
    motion_hash: String,
    model_table: toml::Table,
}

/// One solve to do.
#[derive(Clone, Debug, PartialEq)]
pub struct Job {
    pub id: String,
    /// Position in the study, from 0.
    pub index: usize,
    pub settings: Settings,
    pub changes: Vec<ModelChange>,
    /// What the study swept, with this job's values, in the order of [`Study::axes`].
    pub swept: Vec<(String, Value)>,
    /// Number of collocation points p.
    pub points: usize,
    /// Id of the job before, if this one starts from its solution.
    pub warm_start_from: Option<String>,
}

/// What a job's id is the hash of.
#[derive(Serialize)]
struct Identity<'a> {
    schema: u32,
    settings: &'a Settings,
    changes: &'a [ModelChange],
    model: &'a str,
    motion: &'a str,
    warm_start_from: Option<&'a str>,
}

/// Most jobs that start from one another in a row: such a block is one piece of work.
const BLOCK: usize = 16;

const KEYS: [&str; 6] = ["name", "description", "model", "motion", "base", "sweep"];

impl Study {
    /// Reads, checks and expands a study file with its model and motion.
    ///
    /// # Errors
    /// The first mistake, with its place in the file it is in.
    pub fn load(path: &Path) -> Result<Self> {
        let file = SourceFile::read(path)?;
        let table: toml::Table = toml::from_str(&file.text).map_err(|e| file.toml_error(&e))?;
        let fail = |issue: Issue| issue.in_file(&file);
        for key in table.keys() {
            if !KEYS.contains(&key.as_str()) {
                let near = nearest(key, KEYS).map(|n| format!("did you mean `{n}`? ")).unwrap_or_default();
                return Err(fail(Issue::new(&[key], "unknown key", format!("{near}a study has: {}", KEYS.join(", ")))));
            }
        }
        let text = |key: &str| match table.get(key) {
            Some(toml::Value::String(text)) if !text.is_empty() => Ok(text.clone()),
            Some(other) => Err(fail(Issue::new(&[key], format!("found {other}"), "it must be a text in quotes"))),
            None => {
                let help = format!("add the line {key} = \"…\" at the top of the study");
                Err(file.error(None, format!("the study has no `{key}`"), "", Some(help)))
            }
        };
        let name = text("name")?;
        if !name.chars().all(|c| c.is_alphanumeric() || "-_.".contains(c)) || name.starts_with('.') {
            return Err(fail(Issue::new(
                &["name"],
                format!("found \"{name}\""),
                "the name becomes a folder: letters, digits, - _ and . only",
            )));
        }
        let folder = path.parent().unwrap_or(Path::new(""));
        let model_path = folder.join(text("model")?);
        let motion_path = folder.join(text("motion")?);
        let description = if table.contains_key("description") { text("description")? } else { String::new() };

        let (model_table, model) = ModelFile::load(&read_named(&file, "model", &model_path)?)?;
        let motion_file = read_named(&file, "motion", &motion_path)?;
        let motion = Arc::new(MotionTable::from_file(&motion_file, &model)?);
        check_coverage(&model, &motion, &motion_file)?;

        let coordinates: Vec<(String, bool)> =
            model.joint_coordinates().map(|(joint, name)| (name.to_owned(), joint.kind.is_angular())).collect();
        let sub_table = |key: &str| match table.get(key) {
            None => Ok(toml::Table::new()),
            Some(toml::Value::Table(table)) => Ok(table.clone()),
            Some(_) => Err(fail(Issue::new(&[key], "found a value", format!("write it as a table: [{key}]")))),
        };
        let mut base = Settings::default();
        let mut base_changes = Vec::new();
        for (name, value) in flatten(&sub_table("base")?) {
            let assigned = value
                .ok_or_else(|| {
                    Complaint::new("found a list or a table", "[base] holds single values; lists go in [sweep.grid]")
                })
                .and_then(|value| assign(&mut base, &mut base_changes, &name, &value, &coordinates));
            assigned.map_err(|c| fail(complaint_at(&["base"], &name, c)))?;
        }
        changed_model(&model_table, &base_changes)
            .map_err(|c| fail(complaint_at(&["base"], culprit(&model_table, &base_changes), c)))?;

        let assignments = sweep::expand(&sub_table("sweep")?).map_err(fail)?;
        let axes: Vec<String> = assignments[0].iter().map(|(name, _)| name.clone()).collect();
        if let Some(twice) = axes.iter().enumerate().find(|(i, name)| axes[..*i].contains(name)).map(|(_, name)| name) {
            return Err(fail(Issue::new(&["sweep"], format!("`{twice}` is swept twice"), "sweep each name once")));
        }
        let model_hash = canonical_hash(&model_table);
        let motion_hash = blake3::hash(motion_file.text.as_bytes()).to_hex().to_string();
        let mut jobs: Vec<Job> = Vec::with_capacity(assignments.len());
        let mut in_block = 0;
        for (index, swept) in assignments.into_iter().enumerate() {
            let mut settings = base.clone();
            let mut changes = base_changes.clone();
            for (name, value) in &swept {
                if name != sweep::SAMPLE {
                    assign(&mut settings, &mut changes, name, value, &coordinates)
                        .map_err(|c| fail(swept_issue(&table, name, c)))?;
                }
            }
            let points = settings.points(motion.duration()).map_err(|c| {
                fail(if axes.iter().any(|a| a == "h") {
                    swept_issue(&table, "h", c)
                } else {
                    complaint_at(&["base"], "h", c)
                })
            })?;
            if changes != base_changes {
                changed_model(&model_table, &changes).map_err(|c| {
                    let name = culprit(&model_table, &changes);
                    let swept = axes.iter().any(|axis| axis == name);
                    fail(if swept { swept_issue(&table, name, c) } else { complaint_at(&["base"], name, c) })
                })?;
            }
            let before = jobs.last().filter(|before| {
                let others = axes.len().saturating_sub(1);
                settings.warm_start == WarmStart::Neighbour
                    && in_block < BLOCK
                    && before.swept[..others] == swept[..others]
            });
            let warm_start_from = before.map(|job| job.id.clone());
            in_block = if before.is_some() { in_block + 1 } else { 1 };
            let identity = Identity {
                schema: SCHEMA_VERSION,
                settings: &settings,
                changes: &changes,
                model: &model_hash,
                motion: &motion_hash,
                warm_start_from: warm_start_from.as_deref(),
            };
            let canonical = serde_json::to_vec(&identity).expect("settings are plain data");
            let id = blake3::hash(&canonical).to_hex()[..16].to_owned();
            jobs.push(Job { id, index, settings, changes, swept, points, warm_start_from });
        }
        let mut first = std::collections::HashMap::new();
        for job in &jobs {
            if let Some(other) = first.insert(&job.id, job.index) {
                return Err(fail(Issue::new(
                    &["sweep"],
                    format!("jobs {other} and {} are the same", job.index),
                    "remove the repeated value of an axis",
                )));
            }
        }
        Ok(Self {
            name,
            description,
            path: path.to_owned(),
            model_path,
            motion_path,
            model,
            motion,
            axes,
            jobs,
            motion_hash,
            model_table,
        })
    }

    /// The model of a job, its changes made.
    ///
    /// # Errors
    /// Not for jobs of this study: each was checked when the study was loaded.
    pub fn model_of(&self, job: &Job) -> std::result::Result<Model, Complaint> {
        changed_model(&self.model_table, &job.changes)
    }

    /// Hash of everything that decides the results.
    pub fn hash(&self) -> String {
        let mut hasher = blake3::Hasher::new();
        self.jobs.iter().for_each(|job| {
            hasher.update(job.id.as_bytes());
        });
        hasher.finalize().to_hex()[..16].to_owned()
    }

    /// Hash of the motion file.
    pub fn motion_hash(&self) -> &str {
        &self.motion_hash
    }

    pub fn model_hash(&self) -> String {
        canonical_hash(&self.model_table)
    }
}

/// Reads a file that a study names; if it is not there the error points at the key.
fn read_named(study: &SourceFile, key: &str, path: &Path) -> Result<SourceFile> {
    SourceFile::read(path).map_err(|error| match &error {
        Error::Io { cause, .. } if cause.kind() == std::io::ErrorKind::NotFound => {
            let help = miette::Diagnostic::help(&error).map(|h| h.to_string());
            study.error(
                study.toml_span(&[key.to_owned()]),
                format!("the {key} file {} does not exist", path.display()),
                "named here, relative to the study file",
                help,
            )
        }
        _ => error,
    })
}

/// Every joint coordinate must be measured, unless loops leave some of them to the others.
fn check_coverage(model: &Model, motion: &MotionTable, file: &SourceFile) -> Result<()> {
    let closed_loops = model.joints.len() > model.bodies.len();
    let missing: Vec<&str> = model
        .joint_coordinates()
        .map(|(_, name)| name)
        .filter(|name| !motion.columns.iter().any(|(column, _)| column == name))
        .collect();
    if missing.is_empty() || closed_loops {
        return Ok(());
    }
    Err(file.error(
        None,
        format!("{}: no column for {}", file.path.display(), missing.join(", ")),
        "",
        Some(format!("the model `{}` needs each of its joint coordinates over time", model.name)),
    ))
}

fn assign(
    settings: &mut Settings,
    changes: &mut Vec<ModelChange>,
    name: &str,
    value: &Value,
    coordinates: &[(String, bool)],
) -> std::result::Result<(), Complaint> {
    if is_model_path(name) {
        // A swept value replaces the fixed one; a factor applies to whatever value is set.
        let change = ModelChange::new(name, value)?;
        changes.retain(|other| other.path != change.path);
        let at = if change.is_factor() {
            changes.len()
        } else {
            changes.iter().position(ModelChange::is_factor).unwrap_or(changes.len())
        };
        changes.insert(at, change);
        Ok(())
    } else {
        settings.set(name, value, coordinates)
    }
}

/// The path of the first change without which the ones before it still make a model.
fn culprit<'c>(model: &toml::Table, changes: &'c [ModelChange]) -> &'c str {
    let first = (1..=changes.len()).find(|&n| changed_model(model, &changes[..n]).is_err());
    first.map_or("", |n| changes[n - 1].path.as_str())
}

/// `a.b.c = v`, written as tables or as a quoted key, becomes ("a.b.c", v). `None`: neither number, text nor flag.
fn flatten(table: &toml::Table) -> Vec<(String, Option<Value>)> {
    let mut flat = Vec::new();
    for (key, value) in table {
        match value {
            toml::Value::Table(inner) => {
                flat.extend(flatten(inner).into_iter().map(|(name, value)| (format!("{key}.{name}"), value)));
            }
            toml::Value::Boolean(flag) => flat.push((key.clone(), Some(Value::Flag(*flag)))),
            toml::Value::Integer(number) => flat.push((key.clone(), Some(Value::Integer(*number)))),
            toml::Value::Float(number) => flat.push((key.clone(), Some(Value::Number(*number)))),
            toml::Value::String(text) => flat.push((key.clone(), Some(Value::Text(text.clone())))),
            _ => flat.push((key.clone(), None)),
        }
    }
    flat
}

/// The issue of a name that may be written as a quoted key or as nested tables.
fn complaint_at(parents: &[&str], name: &str, complaint: Complaint) -> Issue {
    let path = parents.iter().copied().chain([name]).filter(|k| !k.is_empty()).map(str::to_owned).collect();
    Issue { path, message: complaint.message, help: Some(complaint.help) }
}

fn swept_issue(study: &toml::Table, name: &str, complaint: Complaint) -> Issue {
    let sweep = study.get("sweep").and_then(toml::Value::as_table);
    let kind = sweep
        .and_then(|s| s.iter().find(|(_, axes)| axes.get(name).is_some()).map(|(kind, _)| kind.as_str()))
        .unwrap_or("grid");
    complaint_at(&["sweep", kind], name, complaint)
}

/// Hash of a table's content, not of its layout or comments.
fn canonical_hash(table: &toml::Table) -> String {
    let value = serde_json::to_value(table).expect("a TOML table is plain data");
    let mut canonical = String::new();
    write_canonical(&value, &mut canonical);
    blake3::hash(canonical.as_bytes()).to_hex()[..16].to_owned()
}

/// JSON with sorted keys.
fn write_canonical(value: &serde_json::Value, out: &mut String) {
    match value {
        serde_json::Value::Object(map) => {
            let mut keys: Vec<&String> = map.keys().collect();
            keys.sort();
            out.push('{');
            for key in keys {
                out.push_str(&serde_json::Value::String(key.clone()).to_string());
                out.push(':');
                write_canonical(&map[key], out);
                out.push(',');
            }
            out.push('}');
        }
        serde_json::Value::Array(items) => {
            out.push('[');
            items.iter().for_each(|item| {
                write_canonical(item, out);
                out.push(',');
            });
            out.push(']');
        }
        other => out.push_str(&other.to_string()),
    }
}
