//! The jobs of a study: base and sweeps resolved into settings and changes of the model, each job once and with its identity.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use indexmap::IndexMap;
use serde::Serialize;

use super::change::{self, ModelChange, changed_model, is_model_path};
use super::file::{StudyFile, Sweep};
use super::settings::{Complaint, Girdle, RegularityMode, Settings, Value, WarmStart};
use super::size;
use super::sweep::{self, Expansion, Place, Point};
use super::{Job, SCHEMA_VERSION};
use crate::error::{Issue, Mistakes};
use crate::model::Model;
use crate::motion::{HIGHEST_CUTOFF, MotionTable};

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

/// Ids of the jobs that differ from one in `regularity` and `trajectories` only, which do not change the solution; with
/// their `regularity`. `settings` and `changes` are those of a job that starts from no other.
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

/// The default of `stages` for spatial models, which take much longer with more.
const SPATIAL_STAGES: usize = 1;

/// A value set for a number of the model may be up to this many times larger or smaller than the model's own.
const FAR: f64 = 10.0;

/// Most jobs that start from one another in a row: such a block is one piece of work.
const BLOCK: usize = 16;

/// Changed models are checked before a run up to this many, spread over the study; others when their job is set up, where
/// a model that is none makes the job `invalid`.
const CHECKED_MODELS: usize = 2000;

/// The base and the expanded sweeps, before they are jobs.
pub struct Plan<'m> {
    pub base: Settings,
    base_changes: Vec<ModelChange>,
    pub sweeps: Vec<Expansion>,
    /// Everything swept, with its first place in the file.
    pub axes: IndexMap<Arc<str>, Place>,
    /// The paths that each name of the model's numbers stands for.
    paths: HashMap<Arc<str>, Vec<String>>,
    /// The model's joint coordinates, with whether each is an angle.
    coordinates: Vec<(String, bool)>,
    /// Those that no change of the motion moves, with why.
    unmoved: Vec<(String, &'static str)>,
    /// Names whose values may be far from the model's.
    confirmed: &'m [String],
    model_table: &'m toml::Table,
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
        let mut base = Settings::default();
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
            unmoved: model.unmoved_coordinates(),
            confirmed: &file.confirm,
            model_table,
        };
        let base = flatten(&file.base);
        for (name, value) in &base {
            mistakes.take(plan.set_base(name, value.clone()));
        }
        mistakes.none()?;
        plan.check_base(&base).map_err(|issue| vec![issue])?;
        changed_model(model_table, &plan.base_changes, plan.base.girdle)
            .map_err(|c| vec![complaint_at(vec!["base".to_owned(), plan.culprit(&plan.base_changes)], c)])?;

        let single = [Sweep::default()];
        let sweeps: &[Sweep] = if file.sweep.0.is_empty() { &single } else { &file.sweep.0 };
        size::check(sweeps).map_err(|issue| vec![issue])?;
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
            let context = sweep::Context { value: &value, check: &check };
            let Some(expansion) = mistakes.take(sweep::expand(sweep, &place, &context)) else { continue };
            for (name, place) in &expansion.axes {
                if **name != *sweep::SAMPLE {
                    mistakes.take(plan.learn(name).map_err(|c| complaint_at(place.clone(), c)));
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
            let help = "[base] holds single values; lists go in [sweep.grid]";
            sweep::issue(place(), "found a list or a table", help)
        })?;
        self.learn(name).map_err(|c| complaint_at(place(), c))?;
        let (mut base, mut changes) = (self.base.clone(), self.base_changes.clone());
        self.assign(&mut base, &mut changes, name, &value).map_err(|c| complaint_at(place(), c))?;
        (self.base, self.base_changes) = (base, changes);
        Ok(())
    }

    /// Refuses two names for one thing in the base, and names that are confirmed and lead to no number of the model.
    fn check_base(&self, base: &[(String, Option<Value>)]) -> std::result::Result<(), Issue> {
        let mut owners = Owners::default();
        for (name, _) in base {
            for target in self.targets(name) {
                if let Some(other) = owners.insert(&target, name).filter(|other| !self.is_pair(name, other)) {
                    let message = format!("`{name}` and `{other}` both set {target}");
                    return Err(sweep::issue(vec!["base".to_owned(), name.clone()], message, "keep one of them"));
                }
            }
        }
        for (i, name) in self.confirmed.iter().enumerate() {
            let found = change::matching(self.model_table, name).unwrap_or_default();
            if !found.iter().any(|path| change::number_at(self.model_table, path).is_some()) {
                let help = "names are those of numbers that the study sets, such as muscle.triceps.tendon_slack_length";
                let message = format!("`{name}` is no number of the model");
                return Err(sweep::issue(vec!["confirm".to_owned(), i.to_string()], message, help));
            }
        }
        Ok(())
    }

    /// Whether two names are a number and its factor, which [`Plan::check_overlaps`] has its own words for.
    fn is_pair(&self, name: &str, other: &str) -> bool {
        is_model_path(name) && name.trim_end_matches("_scale") == other.trim_end_matches("_scale")
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
        let Some(paths) = self.paths.get(name) else {
            self.check_moves(name)?;
            return settings.set(name, value, &self.coordinates);
        };
        for path in paths {
            self.check_size(name, path, value)?;
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

    /// Refuses a change of the motion of a coordinate that the study does not move.
    fn check_moves(&self, name: &str) -> std::result::Result<(), Complaint> {
        let change = name.strip_prefix("motion.").unwrap_or("");
        let of = |(coordinate, _): &&(String, &str)| {
            change
                .strip_prefix(coordinate.as_str())
                .is_some_and(|rest| rest == "_scale" || rest.starts_with("_offset_"))
        };
        match self.unmoved.iter().find(of) {
            None => Ok(()),
            Some((coordinate, why)) => {
                let help = "all jobs would be the same: remove the key, or unlock the coordinate in the model";
                Err(Complaint::new(format!("`{coordinate}` {why}"), help))
            }
        }
    }

    /// Refuses a value far from the model's own that the study does not confirm.
    fn check_size(&self, name: &str, path: &str, value: &Value) -> std::result::Result<(), Complaint> {
        let (Some(own), Some(new)) = (change::number_at(self.model_table, path), value.number()) else { return Ok(()) };
        // 0 is meant.
        let is_far = own != 0.0 && new != 0.0 && !(own.abs() / FAR..=own.abs() * FAR).contains(&new.abs());
        if path.ends_with("_scale") || !is_far || self.confirmed.iter().any(|known| known == name || known == path) {
            return Ok(());
        }
        let times = new / own;
        let times = if times.abs() < 1e-2 { format!("{times:.1e}") } else { format!("{times:.3}") };
        let message = format!("{new} is {times} times the model's own value, {own}");
        let help = format!(
            "is `{path}_scale` meant, or is the unit another one? If the value is right, say so: confirm = [\"{name}\"] at the top of the study"
        );
        Err(Complaint::new(message, help))
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
        if let Some(base) = self.other_way(self.base_changes.iter().map(|change| &change.path)) {
            let message = format!("`{base}` is there, and the same number in another way: absolute and by a factor");
            return Err(sweep::issue(
                vec!["base".to_owned(), base.to_owned()],
                message,
                "say it in one of the two ways",
            ));
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
                        format!("`{name}` is swept, and [base] sets `{base}`: one number, absolute and by a factor");
                    return Err(sweep::issue(self.place(name), message, "say it in one of the two ways"));
                }
                for target in self.targets(name) {
                    if let Some(other) = owners.insert(&target, name) {
                        let message = format!("`{name}` and `{other}` both set {target}");
                        let help = "a job has one value of each: sweep it under one name, or in two sweeps ([[sweep]])";
                        return Err(sweep::issue(self.place(name), message, help));
                    }
                }
            }
        }
        Ok(())
    }

    /// What the base sets of one of these paths in the other way: by a factor, or absolute.
    fn other_way<'p>(&self, mut paths: impl Iterator<Item = &'p String>) -> Option<&str> {
        paths.find_map(|path| {
            let other = path.strip_suffix("_scale").map_or_else(|| format!("{path}_scale"), str::to_owned);
            self.base_changes.iter().find(|change| change.path == other).map(|change| change.path.as_str())
        })
    }

    /// What a swept name sets.
    fn targets(&self, name: &str) -> Vec<String> {
        match self.paths.get(name) {
            // A number has one value, set or scaled.
            Some(paths) => paths.iter().map(|path| path.strip_suffix("_scale").unwrap_or(path).to_owned()).collect(),
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

    /// Checks the changed models, up to [`CHECKED_MODELS`] of them.
    pub fn check_models(&self, jobs: &[Job]) -> std::result::Result<(), Issue> {
        let changed: Vec<&Job> = jobs.iter().filter(|job| job.changes != self.base_changes).collect();
        let stride = changed.len().div_ceil(CHECKED_MODELS).max(1);
        let mut before: Option<&[ModelChange]> = None;
        for job in changed.into_iter().step_by(stride) {
            if before != Some(&job.changes[..]) {
                changed_model(self.model_table, &job.changes, job.settings.girdle)
                    .map_err(|c| complaint_at(self.place(&self.culprit(&job.changes)), c))?;
            }
            before = Some(&job.changes);
        }
        Ok(())
    }

    /// A filter can only take away what the motion's sampling has.
    pub fn check_smoothing(&self, motion: &MotionTable, jobs: &[Job]) -> std::result::Result<(), Issue> {
        let rounded = |hz: f64| (1e3 * hz).round() / 1e3;
        let rate = rounded((motion.time.len() - 1) as f64 / motion.duration());
        let highest = rounded(HIGHEST_CUTOFF * rate);
        let Some(job) = jobs.iter().find(|job| job.settings.smoothing_hz > highest) else { return Ok(()) };
        let message = format!("{} Hz, and the motion has {rate} instants a second", job.settings.smoothing_hz);
        let help =
            format!("a cut-off is at most {HIGHEST_CUTOFF} of that ({highest} Hz); 0 leaves the motion as it is");
        Err(complaint_at(self.place("smoothing_hz"), Complaint::new(message, help)))
    }

    /// A girdle is only that of spatial models.
    pub fn check_girdle(&self, model: &Model, jobs: &[Job]) -> std::result::Result<(), Issue> {
        let spatial = model.spatial().is_some();
        for job in jobs {
            if !spatial && job.settings.girdle != Girdle::Prescribed {
                let help = "only spatial models have a girdle: remove the key";
                return Err(complaint_at(self.place("girdle"), Complaint::new("the model is planar", help)));
            }
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
        let first =
            (1..=changes.len()).find(|&n| changed_model(self.model_table, &changes[..n], self.base.girdle).is_err());
        first.map_or_else(String::new, |n| changes[n - 1].path.clone())
    }
}

/// Which name sets a number, or numbers within a list.
#[derive(Default)]
struct Owners<'n> {
    targets: HashMap<String, &'n str>,
    /// What targets are within.
    outer: HashMap<String, &'n str>,
}

impl<'n> Owners<'n> {
    /// Notes that a name sets a target; another that sets it, something within it, or what it is within.
    fn insert(&mut self, target: &str, name: &'n str) -> Option<&'n str> {
        let outer = || target.match_indices('.').map(|(end, _)| &target[..end]);
        let other = self.outer.get(target).or_else(|| outer().find_map(|outer| self.targets.get(outer))).copied();
        for outer in outer() {
            self.outer.insert(outer.to_owned(), name);
        }
        self.targets.insert(target.to_owned(), name).or(other)
    }
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
