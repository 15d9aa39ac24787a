//! From a study file to jobs: pure, deterministic, no solving.

pub mod change;
pub mod file;
mod sample;
pub mod settings;
pub mod sources;
pub mod sweep;

use std::collections::{HashMap, HashSet};
use std::path::Path;
use std::sync::Arc;

use indexmap::IndexMap;
use serde::Serialize;

use crate::error::{Issue, Result, SourceFile};
use crate::model::Model;
use crate::model::file::ModelFile;
use crate::motion::MotionTable;
use crate::skeleton::file::SkeletonFile;
use change::{ModelChange, changed_model, is_model_path};
use file::{OnFailure, OneOrMany, Ratio, StudyFile};
use settings::{Complaint, Settings, Value, WarmStart};
use sources::Sources;
use sweep::{Expansion, Place, Point};

/// A part of every job's identity: raised when the meaning of a result changes.
pub const SCHEMA_VERSION: u32 = 3;

/// A study, checked and expanded.
#[derive(Clone, Debug)]
pub struct Study {
    pub name: String,
    pub description: String,
    /// The texts that all of this is made from.
    pub sources: Sources,
    pub model: Model,
    pub motion: Arc<MotionTable>,
    /// Names of everything swept, in order.
    pub axes: Vec<String>,
    pub jobs: Vec<Job>,
    /// Jobs of the sweeps that were there already, and left out.
    pub repeated: usize,
    /// Load ratios to report, muscles by name.
    pub ratios: Vec<Ratio>,
    pub on_failure: OnFailure,
    /// What a job has that nothing sweeps.
    pub base: Settings,
    pub model_hash: String,
    pub motion_hash: String,
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
    /// This job's value of each of [`Study::axes`]; `None` where it has none.
    pub swept: Vec<Option<Value>>,
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

impl Identity<'_> {
    fn hash(&self) -> String {
        let canonical = serde_json::to_vec(self).expect("settings are plain data");
        blake3::hash(&canonical).to_hex()[..16].to_owned()
    }
}

/// Most jobs that start from one another in a row: such a block is one piece of work.
const BLOCK: usize = 16;

/// Changed models are checked before a run up to this many, spread over the study; others when their job is set up, where
/// a model that is none makes the job `invalid`.
const CHECKED_MODELS: usize = 2000;

impl Study {
    /// Reads, checks and expands a study file with its model and motion; or the manifest of a run (or its folder), which
    /// holds all three.
    ///
    /// # Errors
    /// The first mistake, with its place in the file it is in.
    pub fn load(path: &Path) -> Result<Self> {
        let (sources, file) = Sources::read(path)?;
        refuse_spatial(&sources.model)?;
        let (model_table, model) = ModelFile::load(&sources.model)?;
        let motion = Arc::new(MotionTable::from_file(&sources.motion, &model)?);
        check_coverage(&model, &motion, &sources.motion)?;
        let fail = |issue: Issue| issue.in_file(&sources.study);
        check_name(&file.name).map_err(fail)?;
        let ratios = ratios(&file.ratio, &model).map_err(fail)?;
        let plan = Plan::new(&file, &model, &model_table).map_err(fail)?;

        let model_hash = canonical_hash(&model_table);
        let motion_hash = blake3::hash(sources.motion.text.as_bytes()).to_hex().to_string();
        let jobs = plan.jobs(&motion, &model_hash, &motion_hash).map_err(fail)?;
        plan.check_models(&jobs).map_err(fail)?;
        let total: usize = plan.sweeps.iter().map(|sweep| sweep.points.len()).sum();
        let (axes, base) = (plan.axes.keys().map(ToString::to_string).collect(), plan.base);
        Ok(Self {
            name: file.name,
            description: file.description,
            model,
            motion,
            axes,
            repeated: total - jobs.len(),
            jobs,
            ratios,
            on_failure: file.on_failure,
            base,
            model_hash,
            motion_hash,
            model_table,
            sources,
        })
    }

    /// The model of a job, its changes made.
    ///
    /// # Errors
    /// If the changes together make no model (a swept value was checked alone where a study has very many models).
    pub fn model_of(&self, job: &Job) -> std::result::Result<Model, Complaint> {
        changed_model(&self.model_table, &job.changes)
    }

    /// The number of the model file at a path.
    pub fn model_number(&self, path: &str) -> Option<f64> {
        change::number_at(&self.model_table, path)
    }

    /// Hash of everything that decides the results.
    pub fn hash(&self) -> String {
        let mut hasher = blake3::Hasher::new();
        self.jobs.iter().for_each(|job| {
            hasher.update(job.id.as_bytes());
        });
        hasher.finalize().to_hex()[..16].to_owned()
    }

    /// The jobs in the pieces that are worked on by one thread: alone, or those that start from one another.
    pub fn blocks(&self) -> Vec<&[Job]> {
        self.jobs.chunk_by(|_, next| next.warm_start_from.is_some()).collect()
    }
}

/// The base and the expanded sweeps, before they are jobs.
struct Plan<'m> {
    base: Settings,
    base_changes: Vec<ModelChange>,
    sweeps: Vec<Expansion>,
    /// Everything swept, with its first place in the file.
    axes: IndexMap<Arc<str>, Place>,
    /// The paths that each name of the model's numbers stands for.
    paths: HashMap<Arc<str>, Vec<String>>,
    /// The model's joint coordinates, with whether each is an angle.
    coordinates: Vec<(String, bool)>,
    model_table: &'m toml::Table,
}

impl<'m> Plan<'m> {
    fn new(file: &StudyFile, model: &Model, model_table: &'m toml::Table) -> std::result::Result<Self, Issue> {
        let coordinates =
            model.joint_coordinates().map(|(joint, name)| (name.to_owned(), joint.kind.is_angular())).collect();
        let mut plan = Plan {
            base: Settings::default(),
            base_changes: Vec::new(),
            sweeps: Vec::new(),
            axes: IndexMap::new(),
            paths: HashMap::new(),
            coordinates,
            model_table,
        };
        for (name, value) in flatten(&file.base) {
            let place = || vec!["base".to_owned(), name.clone()];
            let value = value.ok_or_else(|| {
                let help = "[base] holds single values; lists go in [sweep.grid]";
                sweep::issue(place(), "found a list or a table", help)
            })?;
            plan.learn(&name).map_err(|c| complaint_at(place(), c))?;
            let (mut base, mut changes) = (plan.base.clone(), plan.base_changes.clone());
            plan.assign(&mut base, &mut changes, &name, &value).map_err(|c| complaint_at(place(), c))?;
            (plan.base, plan.base_changes) = (base, changes);
        }
        changed_model(model_table, &plan.base_changes)
            .map_err(|c| complaint_at(vec!["base".to_owned(), plan.culprit(&plan.base_changes)], c))?;

        let single = [sweep_of_nothing()];
        let sweeps: &[file::Sweep] = if file.sweep.0.is_empty() { &single } else { &file.sweep.0 };
        for (i, sweep) in sweeps.iter().enumerate() {
            // A table is [sweep], several are [[sweep]]; a path through the one has no index.
            let place =
                if sweeps.len() == 1 { vec!["sweep".to_owned()] } else { vec!["sweep".to_owned(), i.to_string()] };
            let value = |point: &Point, name: &str| plan.value_at(point, name);
            let check = |name: &str, value: &Value| match is_model_path(name) || name == sweep::SAMPLE {
                true if value.number().is_none() => Err(Complaint::new(format!("found {value}"), "it is a number")),
                true => Ok(()),
                false => Settings::default().set(name, value, &plan.coordinates),
            };
            let expansion = sweep::expand(sweep, &place, &sweep::Context { value: &value, check: &check })?;
            for (name, place) in &expansion.axes {
                if **name != *sweep::SAMPLE {
                    plan.learn(name).map_err(|c| complaint_at(place.clone(), c))?;
                }
                plan.axes.entry(Arc::clone(name)).or_insert(place.clone());
            }
            plan.sweeps.push(expansion);
        }
        plan.check_overlaps()?;
        Ok(plan)
    }

    /// Finds what a name stands for, and that it stands for something.
    fn learn(&mut self, name: &str) -> std::result::Result<(), Complaint> {
        if is_model_path(name) && !self.paths.contains_key(name) {
            let paths = change::matching(self.model_table, name)?;
            for path in &paths {
                ModelChange { path: path.clone(), value: 1.0 }.apply(&mut self.model_table.clone())?;
            }
            self.paths.insert(name.into(), paths);
        }
        Ok(())
    }

    fn assign(
        &self,
        settings: &mut Settings,
        changes: &mut Vec<ModelChange>,
        name: &str,
        value: &Value,
    ) -> std::result::Result<(), Complaint> {
        let Some(paths) = self.paths.get(name) else { return settings.set(name, value, &self.coordinates) };
        for path in paths {
            // A swept value replaces the fixed one; a change that changes nothing is none, so that a job has one identity.
            let change = ModelChange::new(path, value)?;
            changes.retain(|other| other.path != change.path);
            if !change.is_idle(self.model_table) {
                changes.push(change);
            }
        }
        // A factor applies to whatever value is set.
        changes.sort_by(|a, b| (a.is_factor(), &a.path).cmp(&(b.is_factor(), &b.path)));
        Ok(())
    }

    /// What a job at a point has under a name, for conditions.
    fn value_at(&self, point: &Point, name: &str) -> Option<Value> {
        if let Some((_, value)) = point.iter().find(|(own, _)| **own == *name) {
            return Some(value.clone());
        }
        if !is_model_path(name) {
            return self.base.get(name);
        }
        let wanted = change::matching(self.model_table, name).ok()?;
        let covers = |(own, _): &&(Arc<str>, Value)| {
            is_model_path(own)
                && change::matching(self.model_table, own)
                    .is_ok_and(|paths| wanted.iter().all(|path| paths.contains(path)))
        };
        let covered = point.iter().find(covers).map(|(_, value)| value.clone());
        covered.or_else(|| self.value(name, &self.base, &self.base_changes))
    }

    /// Refuses axes that would set the same thing in one job.
    fn check_overlaps(&self) -> std::result::Result<(), Issue> {
        let mut seen: HashSet<Vec<&str>> = HashSet::new();
        for point in self.sweeps.iter().flat_map(|sweep| &sweep.points) {
            let names: Vec<&str> = point.iter().map(|(name, _)| &**name).collect();
            if !seen.insert(names.clone()) {
                continue;
            }
            let mut owners: HashMap<String, &str> = HashMap::new();
            for name in names {
                for target in self.targets(name) {
                    if let Some(other) = owners.insert(target.clone(), name) {
                        let message = format!("`{name}` and `{other}` both set {target}");
                        let help = "a job has one value of each: sweep it under one name, or in two sweeps ([[sweep]])";
                        return Err(sweep::issue(self.place(name), message, help));
                    }
                }
            }
        }
        Ok(())
    }

    /// What a swept name sets.
    fn targets(&self, name: &str) -> Vec<String> {
        match self.paths.get(name) {
            Some(paths) => paths.clone(),
            None => vec![name.trim_end_matches("_deg").trim_end_matches("_rad").to_owned()],
        }
    }

    /// What settings and changes have under a name; `None` where the paths it stands for differ.
    fn value(&self, name: &str, settings: &Settings, changes: &[ModelChange]) -> Option<Value> {
        if !is_model_path(name) {
            return settings.get(name);
        }
        let found: Vec<String>;
        let paths = match self.paths.get(name) {
            Some(paths) => paths,
            None => {
                found = change::matching(self.model_table, name).ok()?;
                &found
            }
        };
        let number = |path: &String| {
            let set = changes.iter().find(|change| change.path == *path).map(|change| change.value);
            let factor = path.ends_with("_scale").then_some(1.0);
            set.or_else(|| change::number_at(self.model_table, path)).or(factor)
        };
        let mut numbers = paths.iter().map(number);
        let first = numbers.next()??;
        numbers.all(|number| number == Some(first)).then_some(Value::Number(first))
    }

    /// The jobs in the order of the sweeps, each once.
    fn jobs(&self, motion: &MotionTable, model_hash: &str, motion_hash: &str) -> std::result::Result<Vec<Job>, Issue> {
        let mut jobs: Vec<Job> = Vec::with_capacity(self.sweeps.iter().map(|sweep| sweep.points.len()).sum());
        let mut known = HashSet::new();
        for sweep in &self.sweeps {
            let (first, mut in_block) = (jobs.len(), 0);
            for point in &sweep.points {
                let (settings, changes) = self.resolved(point)?;
                let points = settings.points(motion.duration()).map_err(|c| complaint_at(self.place("h"), c))?;
                let swept: Vec<Option<Value>> = (self.axes.keys())
                    .map(|axis| {
                        let own = point.iter().find(|(name, _)| name == axis).map(|(_, value)| value.clone());
                        own.or_else(|| self.value(axis, &settings, &changes))
                    })
                    .collect();
                let canonical = settings.canonical();
                let identity = Identity {
                    schema: SCHEMA_VERSION,
                    settings: &canonical,
                    changes: &changes,
                    model: model_hash,
                    motion: motion_hash,
                    warm_start_from: None,
                };
                let mut id = identity.hash();
                if !known.insert(id.clone()) {
                    continue;
                }
                let before = jobs[first..].last().filter(|before| {
                    let others = sweep.axes.len().saturating_sub(1);
                    let alike = |(name, _): (&Arc<str>, &Place)| {
                        let axis = self.axes.get_index_of(name).expect("each axis of a sweep is one of the study");
                        before.swept[axis] == swept[axis]
                    };
                    settings.warm_start == WarmStart::Neighbour
                        && in_block < BLOCK
                        && sweep.axes.iter().take(others).all(alike)
                });
                let warm_start_from = before.map(|job| job.id.clone());
                if warm_start_from.is_some() {
                    id = Identity { warm_start_from: warm_start_from.as_deref(), ..identity }.hash();
                }
                in_block = if warm_start_from.is_some() { in_block + 1 } else { 1 };
                jobs.push(Job { id, index: jobs.len(), settings, changes, swept, points, warm_start_from });
            }
        }
        Ok(jobs)
    }

    /// The base with a point of a sweep set.
    fn resolved(&self, point: &Point) -> std::result::Result<(Settings, Vec<ModelChange>), Issue> {
        let (mut settings, mut changes) = (self.base.clone(), self.base_changes.clone());
        for (name, value) in point.iter().filter(|(name, _)| **name != *sweep::SAMPLE) {
            self.assign(&mut settings, &mut changes, name, value).map_err(|c| complaint_at(self.place(name), c))?;
        }
        Ok((settings, changes))
    }

    fn check_models(&self, jobs: &[Job]) -> std::result::Result<(), Issue> {
        let changed: Vec<&Job> = jobs.iter().filter(|job| job.changes != self.base_changes).collect();
        let stride = changed.len().div_ceil(CHECKED_MODELS).max(1);
        let mut before: Option<&[ModelChange]> = None;
        for job in changed.into_iter().step_by(stride) {
            if before != Some(&job.changes[..]) {
                changed_model(self.model_table, &job.changes)
                    .map_err(|c| complaint_at(self.place(&self.culprit(&job.changes)), c))?;
            }
            before = Some(&job.changes);
        }
        Ok(())
    }

    /// Where a name is set: in its sweep, or in the base.
    fn place(&self, name: &str) -> Place {
        let swept = self.axes.iter().find(|(axis, _)| {
            ***axis == *name || self.paths.get(*axis).is_some_and(|paths| paths.iter().any(|path| path == name))
        });
        swept.map_or_else(|| vec!["base".to_owned(), name.to_owned()], |(_, place)| place.clone())
    }

    /// The path of the first change without which the ones before it still make a model.
    fn culprit(&self, changes: &[ModelChange]) -> String {
        let first = (1..=changes.len()).find(|&n| changed_model(self.model_table, &changes[..n]).is_err());
        first.map_or_else(String::new, |n| changes[n - 1].path.clone())
    }
}

fn sweep_of_nothing() -> file::Sweep {
    file::Sweep::default()
}

fn check_name(name: &str) -> std::result::Result<(), Issue> {
    let fits = name.chars().all(|c| c.is_alphanumeric() || "-_.".contains(c));
    if !fits || name.starts_with('.') || name.is_empty() {
        let help = "the name becomes a folder: letters, digits, - _ and . only";
        return Err(Issue::new(&["name"], format!("found \"{name}\""), help));
    }
    Ok(())
}

/// The declared ratios with their muscles by name.
fn ratios(declared: &[Ratio], model: &Model) -> std::result::Result<Vec<Ratio>, Issue> {
    let names: Vec<&str> = model.muscles.iter().map(|muscle| muscle.name.as_str()).collect();
    let muscles = |index: usize, key: &str, patterns: &OneOrMany<String>| {
        let mut found: Vec<String> = Vec::new();
        for pattern in &patterns.0 {
            let wild = wildmatch::WildMatch::new(pattern);
            let before = found.len();
            found.extend(names.iter().filter(|name| wild.matches(name)).map(|name| (*name).to_owned()));
            if found.len() == before {
                let near =
                    crate::error::nearest(pattern, names.iter().copied()).map(|n| format!("did you mean `{n}`? "));
                let help = format!("{}muscles of the model: {}", near.unwrap_or_default(), names.join(", "));
                return Err(Issue::new(
                    &["ratio", &index.to_string(), key],
                    format!("no muscle is called `{pattern}`"),
                    help,
                ));
            }
        }
        found.sort();
        found.dedup();
        if found.is_empty() {
            return Err(Issue::new(
                &["ratio", &index.to_string(), key],
                "no muscle",
                "name a muscle or a list of them",
            ));
        }
        Ok(OneOrMany(found))
    };
    let mut resolved: Vec<Ratio> = Vec::new();
    for (index, ratio) in declared.iter().enumerate() {
        if resolved.iter().any(|other| other.name == ratio.name) {
            let help = "give each ratio a name of its own";
            return Err(Issue::new(
                &["ratio", &index.to_string(), "name"],
                format!("`{}` is there twice", ratio.name),
                help,
            ));
        }
        if ratio.measure.0.is_empty() {
            let help = "leave it out for mean_force, or name one: mean_force, peak_force, impulse, activation";
            return Err(Issue::new(&["ratio", &index.to_string(), "measure"], "no measure", help));
        }
        resolved.push(Ratio {
            name: ratio.name.clone(),
            numerator: muscles(index, "numerator", &ratio.numerator)?,
            denominator: muscles(index, "denominator", &ratio.denominator)?,
            measure: ratio.measure.clone(),
        });
    }
    Ok(resolved)
}

/// Spatial models have paths and moment arms so far, and no equations.
fn refuse_spatial(file: &SourceFile) -> Result<()> {
    match toml::from_str::<toml::Table>(&file.text) {
        Ok(table) if SkeletonFile::is_one(&table) => {
            let help = "take a planar model; `sinew moment-arms` takes this one";
            let message = format!("{}: studies cannot solve spatial models yet", file.path.display());
            Err(file.error(
                file.toml_span(&["dimensions".to_owned()]),
                message,
                "a spatial model",
                Some(help.to_owned()),
            ))
        }
        _ => Ok(()),
    }
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

/// `a.b.c = v`, written as tables or as a quoted key, becomes ("a.b.c", v). `None`: neither number, text nor flag.
fn flatten(table: &toml::Table) -> Vec<(String, Option<Value>)> {
    let mut flat = Vec::new();
    for (key, value) in table {
        match value {
            toml::Value::Table(inner) => {
                flat.extend(flatten(inner).into_iter().map(|(name, value)| (format!("{key}.{name}"), value)));
            }
            other => flat.push((key.clone(), Value::of(other))),
        }
    }
    flat
}

fn complaint_at(place: Place, complaint: Complaint) -> Issue {
    Issue { path: place, message: complaint.message, help: Some(complaint.help) }
}

/// Hash of a table's content, not of its layout or comments.
fn canonical_hash(table: &toml::Table) -> String {
    let mut value = serde_json::to_value(table).expect("a TOML table is plain data");
    value.sort_all_objects();
    blake3::hash(value.to_string().as_bytes()).to_hex()[..16].to_owned()
}
