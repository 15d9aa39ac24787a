//! Expands a study file into jobs: pure and deterministic, without solving anything.

pub mod axis;
pub mod change;
pub mod file;
pub mod loads;
mod motion;
mod plan;
mod sample;
mod size;
pub mod sources;
pub mod sweep;

use std::path::Path;
use std::sync::Arc;

use crate::entries::named;
use crate::error::{Error, Issue, Mistakes, Result, SourceFile};
use crate::model::Model;
use crate::model::file::ModelFile;
use crate::motion::MotionTable;
use crate::names;
use crate::opensim;
use crate::settings::{InvalidValue, RegularityMode, Settings, Value};
use crate::skeleton::Skeleton;
use crate::skeleton::file::SkeletonFile;
use change::{ModelChange, changed_model};
use file::StudyFile;
use file::{OnFailure, OneOrMany, Ratio};
use motion::{attach, check_coverage, check_held_points, external, motion_hash};
use plan::Plan;
use sources::Sources;

/// Part of every job's identity. Raise it when the meaning of a result changes.
pub const SCHEMA_VERSION: u32 = 4;

/// A study, checked and expanded.
#[derive(Clone, Debug)]
pub struct Study {
    pub name: String,
    pub description: String,
    /// The source texts of study, model and motion.
    pub sources: Sources,
    pub model: Model,
    pub motion: Arc<MotionTable>,
    /// Names of the swept axes, in order.
    pub axes: Vec<String>,
    pub jobs: Vec<Job>,
    /// Number of swept points that repeated an earlier job and were omitted.
    pub repeated: usize,
    /// Load ratios to report, with their muscles by name.
    pub ratios: Vec<Ratio>,
    pub on_failure: OnFailure,
    /// Settings of a job, except where an axis sets them.
    pub base: Settings,
    pub model_hash: String,
    pub motion_hash: String,
    model_table: toml::Table,
}

/// One problem to solve.
#[derive(Clone, Debug, PartialEq)]
pub struct Job {
    pub id: String,
    /// Position in the study, from 0.
    pub index: usize,
    pub settings: Settings,
    pub changes: Vec<ModelChange>,
    /// This job's value on each of [`Study::axes`]; `None` if it has none.
    pub swept: Vec<Option<Value>>,
    /// Number of collocation points p.
    pub points: usize,
    /// Id of the previous job, if this one starts from its solution.
    pub warm_start_from: Option<String>,
}

impl Study {
    /// Reads, checks and expands a study file with its model and motion, or the manifest of a run (or its folder),
    /// which contains all three.
    ///
    /// # Errors
    /// The mistakes found first, with their places in the file.
    pub fn load(path: &Path) -> Result<Self> {
        let (sources, file) = Sources::read(path)?;
        Self::from_sources(sources, file)
    }

    /// Like [`Study::load`], for files that have been read already.
    ///
    /// # Errors
    /// The mistakes found first, with their places in the file.
    pub fn from_sources(sources: Sources, file: StudyFile) -> Result<Self> {
        let (mut model_table, mut model) = load_model(&sources.model)?;
        if let Some(muscles) = &file.muscles {
            keep_muscles(&mut model_table, &muscles.0).map_err(|issue| issue.in_file(&sources.study))?;
            let invalid = |why: InvalidValue| Issue::new(&["muscles"], why.message, why.help).in_file(&sources.study);
            model = changed_model(&model_table, &[]).map_err(invalid)?;
        }
        let mut motion = MotionTable::from_file(&sources.motion, &model)?;
        check_coverage(&model, &mut motion, &sources.motion)?;
        let fail = |issue: Issue| issue.in_file(&sources.study);
        attach(&sources, &file, &model, &mut motion)?;
        let model = model.with_external(external(&motion));
        let motion = Arc::new(motion);
        let mut mistakes = Mistakes::default();
        mistakes.take(check_name(&file.name));
        let ratios = mistakes.take(ratios(&file.ratio, &model)).unwrap_or_default();
        let plan = match Plan::new(&file, &model, &model_table) {
            Ok(plan) => Some(plan),
            Err(issues) => {
                issues.into_iter().for_each(|issue| mistakes.push(issue));
                None
            }
        };
        mistakes.none().map_err(|issues| Issue::all_in_file(&issues, &sources.study))?;
        let plan = plan.expect("there are no mistakes");

        let model_hash = canonical_hash(&model_table);
        let motion_hash = motion_hash(&sources, &file);
        let jobs = plan.jobs(&motion, &model_hash, &motion_hash).map_err(fail)?;
        plan.check_models(&model, &jobs).map_err(fail)?;
        plan.check_settings(&jobs).map_err(fail)?;
        plan.check_smoothing(&motion, &jobs).map_err(fail)?;
        check_held_points(&model, &motion, &plan.base, &sources.motion)?;
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

    /// The model of a job, with its changes applied.
    ///
    /// # Errors
    /// If the changes together make the model invalid. (Only in a study with very many changed models, of which not all
    /// are checked when it is loaded.)
    pub fn model_of(&self, job: &Job) -> std::result::Result<Model, InvalidValue> {
        Ok(changed_model(&self.model_table, &job.changes)?.with_external(external(&self.motion)))
    }

    /// `regularity` and id of each job that has the same solution as `job`, since it differs only in `regularity` and
    /// `trajectories`. Empty for a job that starts from another job's solution.
    pub fn same_solution(&self, job: &Job) -> Vec<(RegularityMode, String)> {
        let next = self.jobs.get(job.index + 1).and_then(|next| next.warm_start_from.as_ref());
        if job.warm_start_from.is_some() || next == Some(&job.id) {
            return Vec::new();
        }
        plan::same_solution(&job.settings, &job.changes, &self.model_hash, &self.motion_hash)
    }

    /// The number at a path of the model file.
    pub fn model_number(&self, path: &str) -> Option<f64> {
        change::number_at(&self.model_table, path)
    }

    /// Hash of everything that determines the results.
    pub fn hash(&self) -> String {
        let mut hasher = blake3::Hasher::new();
        self.jobs.iter().for_each(|job| {
            hasher.update(job.id.as_bytes());
        });
        hasher.finalize().to_hex()[..16].to_owned()
    }

    /// The jobs in blocks for one thread each: single jobs, or jobs that start from one another.
    pub fn blocks(&self) -> Vec<&[Job]> {
        self.jobs.chunk_by(|_, next| next.warm_start_from.is_some()).collect()
    }
}

/// Removes the muscles that no pattern matches from the table of a model.
fn keep_muscles(model: &mut toml::Table, patterns: &[String]) -> std::result::Result<(), Issue> {
    let muscles = model.entry("muscle").or_insert_with(|| toml::Value::Array(Vec::new()));
    let Some(muscles) = muscles.as_array_mut() else { return Ok(()) };
    let name = |muscle: &toml::Value| muscle.get("name").and_then(toml::Value::as_str).unwrap_or_default().to_owned();
    let names: Vec<String> = muscles.iter().map(name).collect();
    if patterns.is_empty() {
        return Err(Issue::new(&["muscles"], "the list is empty", "name muscles to keep, or remove the key"));
    }
    for pattern in patterns {
        let wild = wildmatch::WildMatch::new(pattern);
        if !names.iter().any(|name| wild.matches(name)) {
            let near = crate::error::nearest(pattern, names.iter().map(String::as_str));
            let near = near.map(|near| format!("did you mean `{near}`? ")).unwrap_or_default();
            let help = format!("{near}muscles of the model: {}", names.join(", "));
            return Err(Issue::new(&["muscles"], format!("no muscle matches `{pattern}`"), help));
        }
    }
    muscles.retain(|muscle| patterns.iter().any(|pattern| wildmatch::WildMatch::new(pattern).matches(&name(muscle))));
    Ok(())
}

fn check_name(name: &str) -> std::result::Result<(), Issue> {
    let fits = name.chars().all(|c| c.is_alphanumeric() || "-_.".contains(c));
    if !fits || name.starts_with('.') || names::defect(name).is_some() {
        let help =
            "the name becomes a folder: use at most 200 letters, digits, -, _ and ., and do not begin with - or .";
        return Err(Issue::new(&["name"], format!("found \"{}\"", names::shown(name)), help));
    }
    Ok(())
}

/// The declared ratios, with wildcards replaced by the names of the muscles.
fn ratios(declared: &[Ratio], model: &Model) -> std::result::Result<Vec<Ratio>, Issue> {
    // Which muscles take part may differ between jobs, so any muscle of the file may be named.
    let names: Vec<&str> = match model.spatial() {
        Some(spatial) => spatial.skeleton.muscles.iter().map(|muscle| muscle.name.as_str()).collect(),
        None => model.muscles.iter().map(|muscle| muscle.name.as_str()).collect(),
    };
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
                "the list of muscles is empty",
                "name a muscle or a list of muscles",
            ));
        }
        Ok(OneOrMany(found))
    };
    let mut resolved: Vec<Ratio> = Vec::new();
    for (index, ratio) in declared.iter().enumerate() {
        if resolved.iter().any(|other| other.name == ratio.name) {
            let help = "give each ratio a different name";
            return Err(Issue::new(
                &["ratio", &index.to_string(), "name"],
                format!("`{}` is declared twice", ratio.name),
                help,
            ));
        }
        named(&["ratio", &index.to_string(), "name"], &ratio.name)?;
        if ratio.measure.0.is_empty() {
            let help = "remove the key for mean_force, or name one: mean_force, peak_force, impulse, activation";
            return Err(Issue::new(&["ratio", &index.to_string(), "measure"], "the list of measures is empty", help));
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

/// Loads a model file, planar or spatial: its table and the checked model.
///
/// # Errors
/// The first mistake, with its place.
pub fn load_model(file: &SourceFile) -> Result<(toml::Table, Model)> {
    if !is_spatial(file) {
        return ModelFile::load(file);
    }
    let (table, skeleton) = load_skeleton(file)?;
    skeleton.check_study().map_err(|issue| error_of(file, &issue))?;
    Ok((table, Model::of_skeleton(Arc::new(skeleton))))
}

/// True for an OpenSim model and for the file of a spatial model.
pub fn is_spatial(file: &SourceFile) -> bool {
    opensim::is_osim(file) || toml::from_str(&file.text).is_ok_and(|table| SkeletonFile::is_spatial(&table))
}

/// Loads a spatial model from a model file or an OpenSim model: its table and the checked model.
///
/// # Errors
/// The first mistake, with its place.
pub fn load_skeleton(file: &SourceFile) -> Result<(toml::Table, Skeleton)> {
    if opensim::is_osim(file) {
        let imported = opensim::import(file)?.file;
        let skeleton = imported.check().map_err(|issue| error_of(file, &issue))?;
        return Ok((toml::Table::try_from(imported).expect("a model is plain data"), skeleton));
    }
    let skeleton = SkeletonFile::load(file)?;
    Ok((toml::from_str(&file.text).map_err(|e| file.toml_error(&e))?, skeleton))
}

/// Locates an issue of a spatial model in the model file or the OpenSim model.
fn error_of(file: &SourceFile, issue: &Issue) -> Error {
    if opensim::is_osim(file) { opensim::error(file, issue) } else { issue.in_file(file) }
}

/// Hash of a table's content, independent of its layout and comments.
fn canonical_hash(table: &toml::Table) -> String {
    let mut value = serde_json::to_value(table).expect("a TOML table is plain data");
    value.sort_all_objects();
    blake3::hash(value.to_string().as_bytes()).to_hex()[..16].to_owned()
}
