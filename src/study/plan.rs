//! The jobs of a study: resolves base and sweeps into settings and model changes, identifies each job, and drops
//! repetitions.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use indexmap::IndexMap;
use serde::Serialize;

use super::axis::{self, Expansion, KeyPath, SweepPoint};
use super::change::{self, ModelChange, changed_model, is_model_path};
use super::file::{StudyFile, Sweep};
use super::size;
use super::sweep;
use super::{Job, SCHEMA_VERSION};
use crate::error::{Issue, Mistakes, nearest};
use crate::model::Model;
use crate::motion::{HIGHEST_CUTOFF, MotionTable};
use crate::settings::{
    BoundKind, Criterion, EffortOf, Initial, InvalidValue, Method, MuscleDynamics, RegularityMode, Scheme, Settings,
    Value, WarmStart,
};

/// Everything that determines a job's result. The job's id is its hash.
#[derive(Serialize)]
struct Identity<'a> {
    schema: u32,
    settings: &'a Settings,
    changes: &'a [ModelChange],
    model: &'a str,
    motion: &'a str,
    warm_start_from: Option<&'a str>,
}

/// `regularity` and id of each job that differs from a given one only in `regularity` and `trajectories`, which do not
/// affect the solution. `settings` and `changes` are those of the given job, which must not start from another one.
pub fn same_solution(
    settings: &Settings,
    changes: &[ModelChange],
    model: &str,
    motion: &str,
) -> Vec<(RegularityMode, String)> {
    let modes = [RegularityMode::EveryIteration, RegularityMode::Optimum, RegularityMode::Off];
    let pairs = modes.iter().flat_map(|&regularity| [true, false].map(|trajectories| (regularity, trajectories)));
    pairs
        .filter(|&pair| pair != (settings.regularity, settings.trajectories))
        .map(|(regularity, trajectories)| {
            let canonical = Settings { regularity, trajectories, ..settings.canonical() };
            let identity = Identity {
                schema: SCHEMA_VERSION,
                settings: &canonical,
                changes,
                model,
                motion,
                warm_start_from: None,
            };
            (regularity, identity.hash())
        })
        .collect()
}

impl Identity<'_> {
    fn hash(&self) -> String {
        let canonical = serde_json::to_vec(self).expect("settings are plain data");
        blake3::hash(&canonical).to_hex()[..16].to_owned()
    }
}

/// Default of `stages` for spatial models, which take much longer with more stages.
const SPATIAL_STAGES: usize = 1;

/// Unless confirmed, a value set for a number of the model may be at most this many times larger or smaller than the
/// model's own.
const MAX_RATIO: f64 = 10.0;

/// Largest number of consecutive jobs that start from one another. One thread solves such a block.
const MAX_BLOCK: usize = 16;

/// Largest number of changed models to check before a run, spread over the study. The others are checked when their job
/// is set up, where an invalid model makes the job `invalid`.
const CHECKED_MODELS: usize = 2000;

/// The base and the expanded sweeps, from which the jobs are made.
pub struct Plan<'m> {
    pub base: Settings,
    base_changes: Vec<ModelChange>,
    pub sweeps: Vec<Expansion>,
    /// The swept names, each with its first place in the file.
    pub axes: IndexMap<Arc<str>, KeyPath>,
    /// The paths that each name of model numbers stands for.
    paths: HashMap<Arc<str>, Vec<String>>,
    /// The model's joint coordinates, each with whether it is an angle.
    coordinates: Vec<(String, bool)>,
    /// The model's turns.
    turns: Vec<String>,
    /// The coordinates that changes of the motion do not affect, each with the reason.
    unmoved: Vec<(String, &'static str)>,
    /// Names whose values may differ greatly from the model's.
    confirmed: &'m [String],
    model_table: &'m toml::Table,
    /// Whether the base says what the model says otherwise.
    sets_min_activation: bool,
}

impl<'m> Plan<'m> {
    /// Reads base and sweeps.
    ///
    /// # Errors
    /// All mistakes in the base, or all in the sweeps.
    pub fn new(
        file: &'m StudyFile,
        model: &Model,
        model_table: &'m toml::Table,
    ) -> std::result::Result<Self, Vec<Issue>> {
        let mut mistakes = Mistakes::default();
        let coordinates =
            model.motion_coordinates().into_iter().map(|(name, is_angle)| (name.to_owned(), is_angle)).collect();
        let mut base = Settings { min_activation: model.min_activation, ..Settings::default() };
        if model.spatial().is_some() {
            base.stages = SPATIAL_STAGES;
        }
        let mut plan = Plan {
            base,
            base_changes: Vec::new(),
            sweeps: Vec::new(),
            axes: IndexMap::new(),
            paths: HashMap::new(),
            coordinates,
            turns: model.mechanics.turns().into_iter().map(str::to_owned).collect(),
            unmoved: model.mechanics.unmoved_coordinates(),
            confirmed: &file.confirm,
            model_table,
            sets_min_activation: file.base.contains_key("min_activation"),
        };
        let base = flatten(&file.base);
        for (name, value) in &base {
            mistakes.take(plan.set_base(name, value.clone()));
        }
        mistakes.none()?;
        plan.check_base(&base).map_err(|issue| vec![issue])?;
        changed_model(model_table, &plan.base_changes)
            .map_err(|c| vec![complaint_at(vec!["base".to_owned(), plan.culprit(&plan.base_changes)], c)])?;

        let single = [Sweep::default()];
        let sweeps: &[Sweep] = if file.sweep.0.is_empty() { &single } else { &file.sweep.0 };
        size::check(sweeps).map_err(|issue| vec![issue])?;
        for (i, sweep) in sweeps.iter().enumerate() {
            // Several sweeps are a list, [[sweep]]; a single one is a table, [sweep], and its path has no index.
            let place =
                if sweeps.len() == 1 { vec!["sweep".to_owned()] } else { vec!["sweep".to_owned(), i.to_string()] };
            let value = |point: &SweepPoint, name: &str| plan.value_at(point, name);
            let check = |name: &str, value: &Value| match name {
                axis::SAMPLE if value.number().is_none() => {
                    Err(InvalidValue::new(format!("found {value}"), "give a number"))
                }
                axis::SAMPLE => Ok(()),
                _ if is_model_path(name) => ModelChange::check(plan.model_table, name, value),
                _ => Settings::default().set(name, value, &plan.coordinates),
            };
            let context = sweep::SweepContext { value: &value, check: &check };
            let Some(expansion) = mistakes.take(sweep::expand(sweep, &place, &context)) else { continue };
            for (name, place) in &expansion.axes {
                if **name != *axis::SAMPLE {
                    mistakes.take(plan.resolve(name).map_err(|c| complaint_at(place.clone(), c)));
                }
                plan.axes.entry(Arc::clone(name)).or_insert(place.clone());
            }
            plan.sweeps.push(expansion);
        }
        mistakes.none()?;
        plan.check_overlaps().map_err(|issue| vec![issue])?;
        Ok(plan)
    }

    fn set_base(&mut self, name: &str, value: Option<Value>) -> std::result::Result<(), Issue> {
        let place = || vec!["base".to_owned(), name.to_owned()];
        let value = value.ok_or_else(|| {
            let help = "[base] holds single values; lists belong in [sweep.grid]";
            axis::issue(place(), "found a list or a table", help)
        })?;
        self.resolve(name).map_err(|c| complaint_at(place(), c))?;
        let (mut base, mut changes) = (self.base.clone(), self.base_changes.clone());
        self.assign(&mut base, &mut changes, name, &value).map_err(|c| complaint_at(place(), c))?;
        (self.base, self.base_changes) = (base, changes);
        Ok(())
    }

    /// Refuses a base in which two names set the same thing, and confirmed names that lead to no number of the model.
    fn check_base(&self, base: &[(String, Option<Value>)]) -> std::result::Result<(), Issue> {
        let mut owners = Owners::default();
        for (name, _) in base {
            for target in self.targets(name) {
                if let Some(other) = owners.insert(&target, name).filter(|other| !self.is_pair(name, other)) {
                    let message = format!("`{name}` and `{other}` both set {target}");
                    return Err(axis::issue(vec!["base".to_owned(), name.clone()], message, "keep one of them"));
                }
            }
        }
        for (i, name) in self.confirmed.iter().enumerate() {
            let found = change::matching(self.model_table, name).unwrap_or_default();
            if !found.iter().any(|path| change::number_at(self.model_table, path).is_some()) {
                let help = "give the names of numbers that the study sets, such as muscle.triceps.tendon_slack_length";
                let message = format!("`{name}` is not a numeric parameter of the model");
                return Err(axis::issue(vec!["confirm".to_owned(), i.to_string()], message, help));
            }
        }
        Ok(())
    }

    /// Whether two names are a number and its factor, which [`Plan::check_overlaps`] reports with a message of its own.
    fn is_pair(&self, name: &str, other: &str) -> bool {
        is_model_path(name) && name.trim_end_matches("_scale") == other.trim_end_matches("_scale")
    }

    /// Finds the paths that a name stands for, and checks that they exist.
    fn resolve(&mut self, name: &str) -> std::result::Result<(), InvalidValue> {
        if name == "muscles.min_activation" {
            let message = "`muscles.min_activation` is only what the model has where a study sets nothing";
            return Err(InvalidValue::new(message, "set `min_activation` instead"));
        }
        if is_model_path(name) && !self.paths.contains_key(name) {
            let paths = change::matching(self.model_table, name)?;
            for path in &paths {
                let value = change::value_at(self.model_table, path).unwrap_or(Value::Number(1.0));
                ModelChange { path: path.clone(), value }.apply(&mut self.model_table.clone())?;
            }
            self.paths.insert(name.into(), paths);
        }
        Ok(())
    }

    /// Sets a name to a value, in the settings or as changes of the model.
    fn assign(
        &self,
        settings: &mut Settings,
        changes: &mut Vec<ModelChange>,
        name: &str,
        value: &Value,
    ) -> std::result::Result<(), InvalidValue> {
        let Some(paths) = self.paths.get(name) else {
            self.check_moves(name)?;
            return settings.set(name, value, &self.coordinates);
        };
        for path in paths {
            self.check_size(name, path, value)?;
            // A swept value replaces the fixed one. Changes without effect are dropped: equal jobs have equal ids.
            let change = ModelChange::new(self.model_table, path, value)?;
            changes.retain(|other| other.path != change.path);
            if !change.has_no_effect(self.model_table) {
                changes.push(change);
            }
        }
        // Factors come last, so that they apply to the values that are set.
        changes.sort_by(|a, b| (a.is_factor(), &a.path).cmp(&(b.is_factor(), &b.path)));
        Ok(())
    }

    /// Refuses a change of the motion that would not move its coordinate.
    fn check_moves(&self, name: &str) -> std::result::Result<(), InvalidValue> {
        let change = name.strip_prefix("motion.").unwrap_or("");
        if change.strip_suffix("_scale").is_some_and(|turn| self.turns.iter().any(|known| known == turn)) {
            let help = "a turn has no motion of its own to scale: use its _offset_deg";
            return Err(InvalidValue::new(format!("`{name}` would have no effect"), help));
        }
        let of = |(coordinate, _): &&(String, &str)| {
            change
                .strip_prefix(coordinate.as_str())
                .is_some_and(|rest| rest == "_scale" || rest.starts_with("_offset_"))
        };
        match self.unmoved.iter().find(of) {
            None => Ok(()),
            Some((coordinate, why)) => {
                let help = "the key would have no effect: remove it, or unlock the coordinate in the model";
                Err(InvalidValue::new(format!("`{coordinate}` {why}"), help))
            }
        }
    }

    /// Refuses a value that differs greatly from the model's own, unless the study confirms it.
    fn check_size(&self, name: &str, path: &str, value: &Value) -> std::result::Result<(), InvalidValue> {
        let (Some(own), Some(new)) = (change::number_at(self.model_table, path), value.number()) else { return Ok(()) };
        // A value of 0 is taken to be intended.
        let is_far = own != 0.0 && new != 0.0 && !(own.abs() / MAX_RATIO..=own.abs() * MAX_RATIO).contains(&new.abs());
        if path.ends_with("_scale") || !is_far || self.confirmed.iter().any(|known| known == name || known == path) {
            return Ok(());
        }
        let times = new / own;
        let times = if times.abs() < 1e-2 { format!("{times:.1e}") } else { format!("{times:.3}") };
        let message = format!("{new} is {times} times the model's own value, {own}");
        let help = format!(
            "did you mean `{path}_scale`, or another unit? If the value is correct, put confirm = [\"{name}\"] at the \
             top of the study"
        );
        Err(InvalidValue::new(message, help))
    }

    /// The value of a name for a job at a point, for conditions.
    fn value_at(&self, point: &SweepPoint, name: &str) -> Option<Value> {
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

    /// Refuses axes that would set the same thing twice in one job.
    fn check_overlaps(&self) -> std::result::Result<(), Issue> {
        if let Some(base) = self.other_way(self.base_changes.iter().map(|change| &change.path)) {
            let message = format!("[base] sets the number of `{base}` twice: as a value and by a factor");
            return Err(axis::issue(vec!["base".to_owned(), base.to_owned()], message, "keep one of the two"));
        }
        let mut seen: HashSet<Vec<&str>> = HashSet::new();
        for point in self.sweeps.iter().flat_map(|sweep| &sweep.points) {
            let names: Vec<&str> = point.iter().map(|(name, _)| &**name).collect();
            if !seen.insert(names.clone()) {
                continue;
            }
            let mut owners = Owners::default();
            for name in names {
                if let Some(base) = self.other_way(self.paths.get(name).into_iter().flatten()) {
                    let message =
                        format!("`{name}` is swept, and [base] sets `{base}`: one number, as a value and by a factor");
                    return Err(axis::issue(self.place(name), message, "keep one of the two"));
                }
                for target in self.targets(name) {
                    if let Some(other) = owners.insert(&target, name) {
                        let message = format!("`{name}` and `{other}` both set {target}");
                        let help = "a job has one value of it: sweep it under one name, or in two sweeps ([[sweep]])";
                        return Err(axis::issue(self.place(name), message, help));
                    }
                }
            }
        }
        Ok(())
    }

    /// The change by which the base sets one of these numbers in the other way: by a factor if the path is a value, as
    /// a value if it is a factor.
    fn other_way<'p>(&self, mut paths: impl Iterator<Item = &'p String>) -> Option<&str> {
        paths.find_map(|path| {
            let other = path.strip_suffix("_scale").map_or_else(|| format!("{path}_scale"), str::to_owned);
            self.base_changes.iter().find(|change| change.path == other).map(|change| change.path.as_str())
        })
    }

    /// The things that a name sets.
    fn targets(&self, name: &str) -> Vec<String> {
        match self.paths.get(name) {
            // A value and its factor set the same number.
            Some(paths) => paths.iter().map(|path| path.strip_suffix("_scale").unwrap_or(path).to_owned()).collect(),
            None => vec![name.trim_end_matches("_deg").trim_end_matches("_rad").to_owned()],
        }
    }

    /// The value of a name in settings and changes; `None` if the paths it stands for have different values.
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
        let value = |path: &String| {
            let set = changes.iter().find(|change| change.path == *path).map(|change| change.value.clone());
            let factor = path.ends_with("_scale").then_some(Value::Number(1.0));
            set.or_else(|| change::value_at(self.model_table, path)).or(factor)
        };
        let mut values = paths.iter().map(value);
        let first = values.next()??;
        values.all(|value| value.is_some_and(|value| value.same(&first))).then_some(first)
    }

    /// The jobs in the order of the sweeps, without repetitions.
    pub fn jobs(
        &self,
        motion: &MotionTable,
        model_hash: &str,
        motion_hash: &str,
    ) -> std::result::Result<Vec<Job>, Issue> {
        let mut jobs: Vec<Job> = Vec::with_capacity(self.sweeps.iter().map(|sweep| sweep.points.len()).sum());
        let mut known = HashSet::new();
        for sweep in &self.sweeps {
            let (first, mut in_block) = (jobs.len(), 0);
            for point in &sweep.points {
                let (settings, changes) = self.settings_at(point)?;
                let points = settings.points(motion.duration());
                let key = if settings.intervals.is_some() { "intervals" } else { "h" };
                let points = points.map_err(|c| complaint_at(self.place(key), c))?;
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
                    let alike = |(name, _): (&Arc<str>, &KeyPath)| {
                        let axis = self.axes.get_index_of(name).expect("each axis of a sweep is one of the study");
                        before.swept[axis] == swept[axis]
                    };
                    settings.warm_start == WarmStart::Neighbour
                        && settings.is_alike(&before.settings)
                        && in_block < MAX_BLOCK
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

    /// Settings and model changes at a point: those of the base, with the point's values set.
    fn settings_at(&self, point: &SweepPoint) -> std::result::Result<(Settings, Vec<ModelChange>), Issue> {
        let (mut settings, mut changes) = (self.base.clone(), self.base_changes.clone());
        for (name, value) in point.iter().filter(|(name, _)| **name != *axis::SAMPLE) {
            self.assign(&mut settings, &mut changes, name, value).map_err(|c| complaint_at(self.place(name), c))?;
        }
        // What the model says is for muscles with activations that are bounded.
        let is_set = self.sets_min_activation || point.iter().any(|(name, _)| **name == *"min_activation");
        let is_bounded = settings.method == Method::Static || settings.bounds.kinds().contains(&BoundKind::Activation);
        if !is_set && (settings.muscle_dynamics == MuscleDynamics::Force || !is_bounded) {
            settings.min_activation = 0.0;
        }
        Ok((settings, changes))
    }

    /// Checks that the changed models are valid, up to [`CHECKED_MODELS`] of them, and that jobs fit their models.
    pub fn check_models(&self, model: &Model, jobs: &[Job]) -> std::result::Result<(), Issue> {
        let (changed, plain): (Vec<&Job>, Vec<&Job>) = jobs.iter().partition(|job| !job.changes.is_empty());
        plain.into_iter().try_for_each(|job| self.check_job(model, job))?;
        let stride = changed.len().div_ceil(CHECKED_MODELS).max(1);
        let mut last: Option<(&[ModelChange], Model)> = None;
        for job in changed.into_iter().step_by(stride) {
            let model = match last {
                Some((changes, model)) if changes == &job.changes[..] => model,
                _ => changed_model(self.model_table, &job.changes)
                    .map_err(|c| complaint_at(self.place(&self.culprit(&job.changes)), c))?,
            };
            self.check_job(&model, job)?;
            last = Some((&job.changes, model));
        }
        Ok(())
    }

    /// Refuses reserves at coordinates that have none, coordinates that nothing drives, and actuators that cost nothing.
    fn check_job(&self, model: &Model, job: &Job) -> std::result::Result<(), Issue> {
        let known = model.mechanics.driven_coordinates();
        let is_known = |name: &str| known.iter().any(|coordinate| coordinate.name == name);
        let unknown = job.settings.reserves_at.iter().find(|(name, moment)| *moment > 0.0 && !is_known(name));
        if let Some((name, _)) = unknown {
            let names: Vec<&str> = known.iter().map(|coordinate| coordinate.name).collect();
            let near =
                nearest(name, names.iter().copied()).map(|n| format!("did you mean `{n}`? ")).unwrap_or_default();
            let help = format!("{near}reserves can act at: {}", names.join(", "));
            let message = format!("`{name}` does not move by forces, or is another unknown of a ball joint");
            return Err(complaint_at(self.place(&format!("reserves.{name}")), InvalidValue::new(message, help)));
        }
        let tracked = model.mechanics.coordinate_names();
        if let Some((name, _)) = job.settings.tracking_weights.iter().find(|(name, _)| !tracked.contains(name)) {
            let near = nearest(name, tracked.iter().map(String::as_str)).map(|n| format!("did you mean `{n}`? "));
            let help = format!("{}tracked are: {}", near.unwrap_or_default(), tracked.join(", "));
            let message = format!("`{name}` does not move by forces, or is another unknown of a ball joint");
            return Err(complaint_at(self.place(&format!("tracking_weight.{name}")), InvalidValue::new(message, help)));
        }
        self.check_drives(model, job)?;
        if job.settings.method != Method::Dynamic {
            return Ok(());
        }
        let has_actuators = job.settings.has_reserves() || !model.actuators.is_empty();
        if job.settings.mu == 0.0 && has_actuators {
            let help = "with mu = 0 reserves and actuators cost nothing, so that their loads would be arbitrary: set a \
                        positive mu, such as 0.01";
            return Err(complaint_at(self.place("mu"), InvalidValue::new("mu = 0 with reserves or actuators", help)));
        }
        Ok(())
    }

    /// Refuses a filter whose cut-off frequency is too high for the sampling of the motion.
    pub fn check_smoothing(&self, motion: &MotionTable, jobs: &[Job]) -> std::result::Result<(), Issue> {
        let rounded = |hz: f64| (1e3 * hz).round() / 1e3;
        let rate = rounded(motion.rate());
        let highest = rounded(HIGHEST_CUTOFF * rate);
        let Some(job) = jobs.iter().find(|job| job.settings.smoothing_hz > highest) else { return Ok(()) };
        let message = format!("{} Hz, but the motion has {rate} instants per second", job.settings.smoothing_hz);
        let help = format!(
            "the cut-off may be at most {HIGHEST_CUTOFF} times that ({highest} Hz); 0 leaves the motion unfiltered"
        );
        Err(complaint_at(self.place("smoothing_hz"), InvalidValue::new(message, help)))
    }

    /// Refuses a coordinate that moves by forces and that nothing drives.
    fn check_drives(&self, model: &Model, job: &Job) -> std::result::Result<(), Issue> {
        let undriven = model.undriven(|name| job.settings.reserve(name) > 0.0);
        let Some(first) = undriven.first() else { return Ok(()) };
        let role = job.changes.iter().find(|change| change.path.ends_with(".role"));
        let place = role.map_or_else(|| vec!["model".to_owned()], |change| self.place(&change.path));
        let message = format!("no muscle, actuator or reserve drives {}, which move by forces", undriven.join(", "));
        let help = format!(
            "lock it (`\"coordinate.{first}.locked\" = true`), give its body the role \"given\", or add a reserve \
             (`\"reserves.{first}\" = 1.0`)"
        );
        Err(complaint_at(place, InvalidValue::new(message, help)))
    }

    /// Refuses settings that do not fit one another.
    pub fn check_settings(&self, jobs: &[Job]) -> std::result::Result<(), Issue> {
        for job in jobs {
            self.check_method(&job.settings)?;
            let has_least = job.settings.method == Method::Static
                || job.settings.muscle_dynamics == MuscleDynamics::Force
                || job.settings.bounds.kinds().contains(&BoundKind::Activation);
            if job.settings.min_activation > 0.0 && !has_least {
                let message = format!("found bounds = \"{}\"", job.settings.bounds.name());
                let help = "min_activation bounds activations: set bounds = \"both\", or another with activation";
                return Err(complaint_at(self.place("min_activation"), InvalidValue::new(message, help)));
            }
            if job.settings.method != Method::Static
                && job.settings.effort_power != 2.0
                && !job.settings.bounds.kinds().contains(&BoundKind::Activation)
            {
                let message = format!("{} with bounds = \"{}\"", job.settings.effort_power, job.settings.bounds.name());
                let help = "a power other than 2 needs a ≥ 0: set bounds = \"both\", or another with activation";
                return Err(complaint_at(self.place("effort_power"), InvalidValue::new(message, help)));
            }
        }
        Ok(())
    }

    /// Refuses what a method does not have.
    fn check_method(&self, settings: &Settings) -> std::result::Result<(), Issue> {
        let (method, own) = (settings.method, Settings::default());
        let refused =
            |name: &str, found: String, help: &str| Err(complaint_at(self.place(name), InvalidValue::new(found, help)));
        let power = settings.effort_power;
        if power < 2.0 && (power != 1.0 || method != Method::Static) {
            let help = "it must be a power from 2 to 10; 1, a linear criterion, only with method = \"static\"";
            return refused("effort_power", format!("found the number {power}"), help);
        }
        let of_method = |name: &str, value: &str| format!("{name} = {value} with method = \"{}\"", method.name());
        let quoted = |value: &str| format!("\"{value}\"");
        if method != Method::Dynamic {
            if settings.scheme != Scheme::Radau {
                let found = of_method("scheme", &quoted(settings.scheme.name()));
                return refused("scheme", found, "set scheme = \"radau\", at whose points the loads are found");
            }
            if settings.noise_sd > 0.0 {
                let help = "the motion is given as it is, and its accelerations with it; remove noise_sd";
                return refused("noise_sd", of_method("noise_sd", &settings.noise_sd.to_string()), help);
            }
        }
        if method == Method::Prescribed && settings.muscle_dynamics == MuscleDynamics::Force {
            let help = "muscles without dynamics share each instant's load alone: set method = \"static\"";
            return refused("muscle_dynamics", of_method("muscle_dynamics", &quoted("force")), help);
        }
        let has_effort = match method {
            Method::Static => settings.effort_of != EffortOf::Excitation,
            Method::Prescribed => settings.effort_of != EffortOf::Force,
            Method::Dynamic => settings.effort_of == own.effort_of,
        };
        let is_static = method == Method::Static;
        let unfit = [
            ("criterion", is_static || settings.criterion == own.criterion, quoted(settings.criterion.name())),
            (
                "effort_weight",
                settings.criterion != Criterion::MinMax || settings.effort_weight == own.effort_weight,
                quoted(settings.effort_weight.name()),
            ),
            ("effort_of", has_effort, quoted(settings.effort_of.name())),
            (
                "initial",
                method != Method::Dynamic || settings.initial != Initial::Steady,
                quoted(settings.initial.name()),
            ),
        ];
        match unfit.into_iter().find(|(_, fits, _)| !fits) {
            None => Ok(()),
            Some((name, _, value)) => {
                let help = "this method, or this criterion, has no such setting; give each method its own [[sweep]]";
                refused(name, of_method(name, &value), help)
            }
        }
    }

    /// Where a name is set: in its sweep, or in the base.
    fn place(&self, name: &str) -> KeyPath {
        let swept = self.axes.iter().find(|(axis, _)| {
            ***axis == *name || self.paths.get(*axis).is_some_and(|paths| paths.iter().any(|path| path == name))
        });
        swept.map_or_else(|| vec!["base".to_owned(), name.to_owned()], |(_, place)| place.clone())
    }

    /// The path of the first change that makes the model invalid.
    fn culprit(&self, changes: &[ModelChange]) -> String {
        let first = (1..=changes.len()).find(|&n| changed_model(self.model_table, &changes[..n]).is_err());
        first.map_or_else(String::new, |n| changes[n - 1].path.clone())
    }
}

/// Which name sets which target: a number, or a list of numbers.
#[derive(Default)]
struct Owners<'n> {
    targets: HashMap<String, &'n str>,
    /// Everything that contains a target.
    outer: HashMap<String, &'n str>,
}

impl<'n> Owners<'n> {
    /// Records that a name sets a target. Returns another name that sets it, a part of it, or something that contains
    /// it.
    fn insert(&mut self, target: &str, name: &'n str) -> Option<&'n str> {
        let outer = || target.match_indices('.').map(|(end, _)| &target[..end]);
        let other = self.outer.get(target).or_else(|| outer().find_map(|outer| self.targets.get(outer))).copied();
        for outer in outer() {
            self.outer.insert(outer.to_owned(), name);
        }
        let other = self.targets.insert(target.to_owned(), name).or(other);
        // What is said of all coordinates leaves room for what is said of one.
        other.filter(|other| name != "reserves" && *other != "reserves")
    }
}

/// `a.b.c = v`, written as tables or as a quoted key, becomes ("a.b.c", v); v is `None` if it is neither a number, a
/// text nor a flag.
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

fn complaint_at(place: KeyPath, complaint: InvalidValue) -> Issue {
    Issue { path: place, message: complaint.message, help: Some(complaint.help) }
}
