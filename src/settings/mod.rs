//! The settings of a job, as `[base]` and the axes of a study set them. (Both can also set values of the model.)

mod choices;
mod limits;
mod value;

pub use choices::{
    BoundKind, Bounds, Criterion, EffortOf, EffortWeight, Initial, LoadSharingGrid, Method, MuscleDynamics,
    RegularityMode, Scheme, WarmStart,
};
pub use limits::Limits;
pub use value::{InvalidValue, Value, describe};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use value::{choice, flag, integer, number};

use crate::curves::{ActivationDynamics, MuscleCurves};
use crate::entries::is_default;
use crate::error::nearest;
use crate::model::Model;
use crate::model::musculotendon::Musculotendon;
use crate::motion::MotionSettings;

/// All settings of a job.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Settings {
    #[serde(skip_serializing_if = "is_default")]
    pub method: Method,
    #[serde(skip_serializing_if = "is_default")]
    pub muscle_dynamics: MuscleDynamics,
    #[serde(skip_serializing_if = "is_default")]
    pub criterion: Criterion,
    #[serde(skip_serializing_if = "is_default")]
    pub effort_of: EffortOf,
    #[serde(skip_serializing_if = "is_default")]
    pub effort_weight: EffortWeight,
    /// The muscles' curves; those of the model if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub muscle_curves: Option<MuscleCurves>,
    /// How activations follow excitations; as the model has it if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub activation_dynamics: Option<ActivationDynamics>,
    /// Whether stretched fibres have a passive force.
    #[serde(skip_serializing_if = "is_true")]
    pub passive_forces: bool,
    /// Lower bound of activations and, if they are bounded, of excitations. The default is that of the model: 0.01 of one imported
    /// from OpenSim, else 0.
    #[schemars(range(min = 0.0, max = 0.5))]
    #[serde(skip_serializing_if = "is_zero")]
    pub min_activation: f64,
    /// ε of the near-optimal ranges: how far each muscle's mean force could be otherwise while the cost is higher by no more than ε
    /// times the muscles' part of it; 0 for none. Exact with `static`, where it takes up to 50 small programmes a muscle and
    /// instant; otherwise an estimate by a quadratic model, which takes about as long as ten solves a muscle.
    #[schemars(range(min = 0.0, max = 10.0))]
    #[serde(skip_serializing_if = "is_zero")]
    pub near_optimal: f64,
    /// Load-sharing parameter μ: the objective has the term μ²/2 ‖a‖², eq. (26).
    #[schemars(range(min = 0.0, max = 1e6))]
    pub mu: f64,
    /// Power p of the effort. With `dynamic`, of activations in the load-sharing term: 2 is the thesis' sum over the instants of the
    /// load-sharing grid; other powers, above 2, are an integral, μ²/2 ∫ Σ a^p dt, and need the bound a ≥ 0. With `static`, of
    /// ∫ Σ w e^p dt; 1 too, which leaves the answer open.
    #[schemars(range(min = 1.0, max = 10.0))]
    #[serde(skip_serializing_if = "is_two")]
    pub effort_power: f64,
    /// Length of a mesh interval, s. It must divide the duration of the motion.
    #[schemars(range(min = 1e-6, max = 1e6))]
    pub h: f64,
    /// Number of mesh intervals, in place of h.
    #[schemars(range(min = 2, max = 1_000_000))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub intervals: Option<usize>,
    pub scheme: Scheme,
    /// Radau points per interval. The default is 3 for planar models, and 1 for spatial models, where 3 takes about ten
    /// times as long and does not always converge; 1 is fast, but overestimates the effort on coarse meshes.
    #[schemars(range(min = 1, max = 3))]
    pub stages: usize,
    pub initial: Initial,
    pub bounds: Bounds,
    pub load_sharing_grid: LoadSharingGrid,
    /// Moment (N m) or force (N) of a reserve actuator at each joint coordinate, at a control of 1; 0 for none. A number
    /// for all coordinates, or a table by coordinate, such as `reserves.elbow_angle`.
    #[schemars(range(min = 0.0, max = 1e9))]
    #[serde(skip_serializing_if = "is_zero")]
    pub reserves: f64,
    /// `reserves.<coordinate>`, by coordinate.
    #[schemars(skip)]
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub reserves_at: Vec<(String, f64)>,
    /// `tracking_weight.<coordinate>`, by coordinate that moves by forces.
    #[schemars(skip)]
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub tracking_weights: Vec<(String, f64)>,
    /// Weight of the squared controls of reserves, relative to squared activations in the load-sharing term.
    #[schemars(range(min = 1e-9, max = 1e9))]
    #[serde(skip_serializing_if = "is_one")]
    pub reserve_weight: f64,
    /// Weight of squared excitations beside squared activations in the load-sharing term; 0 as in the thesis. Without it
    /// excitations may chatter on fine meshes: the finer, the more, and no mesh is fine enough. 0.01 ends that.
    #[schemars(range(min = 0.0, max = 1e6))]
    #[serde(skip_serializing_if = "is_zero")]
    pub excitation_weight: f64,
    /// Measured instants per interval. The default is twice the number of collocation points per interval.
    #[schemars(range(min = 1, max = 1000))]
    pub measurement_ratio: Option<usize>,
    /// Standard deviation of seeded Gaussian noise on measured coordinates, m and rad.
    #[schemars(range(min = 0.0, max = 1e3))]
    pub noise_sd: f64,
    /// Cut-off frequency of the zero-lag Butterworth low-pass filter of the motion, Hz; 0 for no filter.
    #[schemars(range(min = 0.0, max = 1e6))]
    pub smoothing_hz: f64,
    /// Number of start guesses. The first comes from inverse dynamics; the others are random perturbations of it.
    #[schemars(range(min = 1, max = 100_000))]
    pub starts: usize,
    /// Number of the first start guess; 0 is the one from inverse dynamics.
    #[schemars(range(min = 0, max = 1_000_000))]
    pub first_start: usize,
    pub warm_start: WarmStart,
    /// Seed of the noise and of the perturbed start guesses.
    pub seed: u64,
    pub regularity: RegularityMode,
    /// Whether to store functions of time in `trajectories.parquet`.
    pub trajectories: bool,
    /// Largest number of SQP iterations of a solve. A solve that is stuck or reaches the limit is restarted once with
    /// other options, unless the limit is below 40.
    #[schemars(range(min = 0, max = 1_000_000))]
    pub max_iterations: usize,
    /// Wall-clock time limit of a job, including ranks, s; none by default. It is checked before each factorisation.
    #[schemars(range(min = 0.0, max = 1e9))]
    pub time_limit_s: Option<f64>,
    /// Memory limit of a job, MB; 1000 by default. A job is not started if its estimated memory is larger.
    #[schemars(range(min = 1.0, max = 1e9))]
    #[serde(skip_serializing_if = "is_default_memory")]
    pub memory_limit_mb: f64,
    /// `motion.time_scale`
    #[schemars(skip)]
    pub time_scale: f64,
    /// `motion.<coordinate>_offset_…` (SI) and `motion.<coordinate>_scale`, by coordinate.
    #[schemars(skip)]
    pub motion: Vec<(String, f64, f64)>,
    /// Limits of warnings, `warn.…`.
    #[schemars(skip)]
    #[serde(skip_serializing_if = "Limits::are_default")]
    pub warn: Limits,
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

fn is_true(value: &bool) -> bool {
    *value
}

fn is_two(value: &f64) -> bool {
    *value == 2.0
}

fn is_one(value: &f64) -> bool {
    *value == 1.0
}

/// 1 GB per job, because one job per core runs at the same time.
const DEFAULT_MEMORY: f64 = 1000.0;

/// The default is not part of a job's identity, because the limit does not change a result.
fn is_default_memory(limit: &f64) -> bool {
    *limit == DEFAULT_MEMORY
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            method: Method::default(),
            muscle_dynamics: MuscleDynamics::default(),
            criterion: Criterion::default(),
            effort_of: EffortOf::default(),
            effort_weight: EffortWeight::default(),
            muscle_curves: None,
            activation_dynamics: None,
            passive_forces: true,
            min_activation: 0.0,
            near_optimal: 0.0,
            mu: 0.2,
            effort_power: 2.0,
            h: 0.1,
            intervals: None,
            scheme: Scheme::Radau,
            stages: 3,
            initial: Initial::Equilibrium,
            bounds: Bounds::Both,
            load_sharing_grid: LoadSharingGrid::Measurement,
            reserves: 0.0,
            reserves_at: Vec::new(),
            tracking_weights: Vec::new(),
            reserve_weight: 1.0,
            excitation_weight: 0.0,
            measurement_ratio: None,
            noise_sd: 0.0,
            smoothing_hz: 0.0,
            starts: 1,
            first_start: 0,
            warm_start: WarmStart::Off,
            seed: 1,
            regularity: RegularityMode::EveryIteration,
            trajectories: false,
            max_iterations: 300,
            time_limit_s: None,
            memory_limit_mb: DEFAULT_MEMORY,
            time_scale: 1.0,
            motion: Vec::new(),
            warn: Limits::default(),
        }
    }
}

/// Limit that prevents a mistyped h from exhausting the memory.
const MAX_POINTS: usize = 100_001;

/// Suffixes of the changes of a coordinate of the motion.
const MOTION_ENDINGS: [&str; 4] = ["_offset_deg", "_offset_rad", "_offset_m", "_scale"];

/// The names of plain settings, for messages.
pub const NAMES: &[&str] = &[
    "method",
    "muscle_dynamics",
    "criterion",
    "effort_of",
    "effort_weight",
    "muscle_curves",
    "activation_dynamics",
    "passive_forces",
    "min_activation",
    "near_optimal",
    "mu",
    "effort_power",
    "h",
    "intervals",
    "scheme",
    "stages",
    "initial",
    "bounds",
    "load_sharing_grid",
    "reserves",
    "reserve_weight",
    "excitation_weight",
    "measurement_ratio",
    "noise_sd",
    "smoothing_hz",
    "starts",
    "first_start",
    "warm_start",
    "seed",
    "regularity",
    "trajectories",
    "max_iterations",
    "time_limit_s",
    "memory_limit_mb",
];

impl Settings {
    /// Sets a plain setting, or one of `motion.…` or `warn.…`. `coordinates` are the joint coordinates of the model,
    /// and whether each is an angle.
    ///
    /// # Errors
    /// A [`InvalidValue`] on an unknown name, a wrong type or a value out of range.
    pub fn set(&mut self, name: &str, value: &Value, coordinates: &[(String, bool)]) -> Result<(), InvalidValue> {
        match name {
            "mu" => self.mu = number(value, 0.0..=1e6, "a number from 0 to 1e6; the thesis uses 0.2")?,
            "effort_power" => {
                self.effort_power = number(value, 1.0..=10.0, "1, or a power from 2 to 10; the thesis uses 2")?;
            }
            "method" => self.method = choice(value, Method::ALL, Method::parse)?,
            "muscle_dynamics" => {
                self.muscle_dynamics = choice(value, MuscleDynamics::ALL, MuscleDynamics::parse)?;
            }
            "criterion" => self.criterion = choice(value, Criterion::ALL, Criterion::parse)?,
            "effort_of" => self.effort_of = choice(value, EffortOf::ALL, EffortOf::parse)?,
            "effort_weight" => self.effort_weight = choice(value, EffortWeight::ALL, EffortWeight::parse)?,
            "muscle_curves" => self.muscle_curves = Some(choice(value, MuscleCurves::ALL, MuscleCurves::parse)?),
            "activation_dynamics" => {
                self.activation_dynamics = Some(choice(value, ActivationDynamics::ALL, ActivationDynamics::parse)?);
            }
            "passive_forces" => self.passive_forces = flag(value)?,
            "min_activation" => {
                self.min_activation = number(value, 0.0..=0.5, "an activation from 0 to 0.5, such as 0.01")?;
            }
            "near_optimal" => {
                self.near_optimal = number(value, 0.0..=10.0, "a share of the effort, such as 0.05; 0 for none")?;
            }
            "h" => {
                self.h = number(value, 1e-6..=1e6, "a positive time in seconds, such as 0.1")?;
                self.intervals = None;
            }
            "intervals" => self.intervals = Some(integer(value, 2..=1_000_000)? as usize),
            "scheme" => self.scheme = choice(value, Scheme::ALL, Scheme::parse)?,
            "stages" => self.stages = integer(value, 1..=3)? as usize,
            "initial" => self.initial = choice(value, Initial::ALL, Initial::parse)?,
            "bounds" => self.bounds = choice(value, Bounds::ALL, Bounds::parse)?,
            "load_sharing_grid" => {
                self.load_sharing_grid = choice(value, LoadSharingGrid::ALL, LoadSharingGrid::parse)?;
            }
            "reserves" => self.reserves = number(value, 0.0..=1e9, RESERVE)?,
            "reserve_weight" => {
                self.reserve_weight = number(value, 1e-9..=1e9, "a positive weight; 1 counts as an activation does")?;
            }
            "excitation_weight" => {
                self.excitation_weight =
                    number(value, 0.0..=1e6, "a weight from 0 to 1e6; 1 counts as an activation does")?;
            }
            "measurement_ratio" => self.measurement_ratio = Some(integer(value, 1..=1000)? as usize),
            "noise_sd" => self.noise_sd = number(value, 0.0..=1e3, "a standard deviation in m and rad, 0 for none")?,
            "smoothing_hz" => self.smoothing_hz = number(value, 0.0..=1e6, "a frequency in Hz, 0 for none")?,
            "starts" => self.starts = integer(value, 1..=100_000)? as usize,
            "first_start" => self.first_start = integer(value, 0..=1_000_000)? as usize,
            "warm_start" => self.warm_start = choice(value, WarmStart::ALL, WarmStart::parse)?,
            "seed" => self.seed = integer(value, 0..=i64::MAX)? as u64,
            "regularity" => self.regularity = choice(value, RegularityMode::ALL, RegularityMode::parse)?,
            "trajectories" => self.trajectories = flag(value)?,
            "max_iterations" => self.max_iterations = integer(value, 0..=1_000_000)? as usize,
            "time_limit_s" => {
                self.time_limit_s = Some(number(value, 0.0..=1e9, "a time in seconds; omit the key for no limit")?);
            }
            "memory_limit_mb" => self.memory_limit_mb = number(value, 1.0..=1e9, "a size in MB, such as 4000")?,
            _ => match name.split_once('.') {
                Some(("motion", change)) => self.set_motion(change, value, coordinates)?,
                Some(("warn", limit)) => self.set_limit(limit, value)?,
                Some(("reserves", coordinate)) => {
                    set_at(&mut self.reserves_at, coordinate, number(value, 0.0..=1e9, RESERVE)?);
                }
                Some(("tracking_weight", coordinate)) => {
                    let weight = number(value, 0.0..=1e9, "a weight from 0 to 1e9; 1 is the default")?;
                    set_at(&mut self.tracking_weights, coordinate, weight);
                }
                _ => return Err(unknown(name)),
            },
        }
        Ok(())
    }

    fn set_limit(&mut self, name: &str, value: &Value) -> Result<(), InvalidValue> {
        let limit = self.warn.named(name).ok_or_else(|| {
            let near = nearest(name, Limits::NAMES).map(|n| format!("did you mean `warn.{n}`? ")).unwrap_or_default();
            let known = Limits::NAMES.map(|name| format!("warn.{name}")).join(", ");
            InvalidValue::new(format!("unknown limit `warn.{name}`"), format!("{near}available limits: {known}"))
        })?;
        *limit = number(value, 0.0..=1e9, "a number from 0 to 1e9")?;
        Ok(())
    }

    /// The reserve's moment (N m) or force (N) at a joint coordinate.
    pub fn reserve(&self, coordinate: &str) -> f64 {
        at(&self.reserves_at, coordinate).unwrap_or(self.reserves)
    }

    /// The weight of a coordinate's squared distance from the measured motion, relative to its default.
    pub fn tracking_weight(&self, coordinate: &str) -> f64 {
        at(&self.tracking_weights, coordinate).unwrap_or(1.0)
    }

    /// Whether both have the same unknowns, so that the answer of one is a start for the other.
    pub fn is_alike(&self, other: &Self) -> bool {
        (self.method, self.muscle_dynamics) == (other.method, other.muscle_dynamics) && self.method != Method::Static
    }

    /// The weight of a muscle's effort relative to the mean of all.
    pub fn effort_weights(&self, model: &Model) -> Vec<f64> {
        let of = |muscle: &Musculotendon| match self.effort_weight {
            EffortWeight::None => 1.0,
            EffortWeight::Volume => muscle.max_isometric_force * muscle.optimal_fibre_length,
            EffortWeight::MaxForce => muscle.max_isometric_force,
        };
        let all: Vec<f64> = model.muscles.iter().map(of).collect();
        let mean = all.iter().sum::<f64>() / all.len().max(1) as f64;
        all.iter().zip(&model.muscles).map(|(weight, muscle)| weight / mean * muscle.effort_weight).collect()
    }

    /// Whether there is a reserve at any coordinate.
    pub fn has_reserves(&self) -> bool {
        self.reserves > 0.0 || self.reserves_at.iter().any(|(_, moment)| *moment > 0.0)
    }

    /// The value of a setting or of a change of the motion, as written in a study; `None` if it is not set.
    pub fn get(&self, name: &str) -> Option<Value> {
        if let Some(limit) = name.strip_prefix("warn.") {
            return self.warn.clone().named(limit).map(|limit| Value::Number(*limit));
        }
        if let Some(coordinate) = name.strip_prefix("reserves.") {
            return Some(Value::Number(self.reserve(coordinate)));
        }
        if let Some(coordinate) = name.strip_prefix("tracking_weight.") {
            return Some(Value::Number(self.tracking_weight(coordinate)));
        }
        // These are not serialised if they have their default.
        match name {
            "h" if self.intervals.is_some() => return None,
            "intervals" => return self.intervals.map(|n| Value::Integer(n as i64)),
            "effort_power" => return Some(Value::Number(self.effort_power)),
            "method" => return Some(Value::Text(self.method.name().to_owned())),
            "muscle_dynamics" => return Some(Value::Text(self.muscle_dynamics.name().to_owned())),
            "criterion" => return Some(Value::Text(self.criterion.name().to_owned())),
            "effort_of" => return Some(Value::Text(self.effort_of.name().to_owned())),
            "effort_weight" => return Some(Value::Text(self.effort_weight.name().to_owned())),
            "muscle_curves" => return self.muscle_curves.map(|family| Value::Text(family.name().to_owned())),
            "activation_dynamics" => {
                return self.activation_dynamics.map(|family| Value::Text(family.name().to_owned()));
            }
            "passive_forces" => return Some(Value::Flag(self.passive_forces)),
            "min_activation" => return Some(Value::Number(self.min_activation)),
            "near_optimal" => return Some(Value::Number(self.near_optimal)),
            "reserves" => return Some(Value::Number(self.reserves)),
            "reserve_weight" => return Some(Value::Number(self.reserve_weight)),
            "excitation_weight" => return Some(Value::Number(self.excitation_weight)),
            "memory_limit_mb" => return Some(Value::Number(self.memory_limit_mb)),
            _ => {}
        }
        let Some(change) = name.strip_prefix("motion.") else {
            let all = serde_json::to_value(self).expect("settings are plain data");
            let found = NAMES.contains(&name).then(|| all[name].clone())?;
            return serde_json::from_value(found).ok();
        };
        if change == "time_scale" {
            return Some(Value::Number(self.time_scale));
        }
        let (coordinate, ending) = MOTION_ENDINGS.iter().find_map(|e| Some((change.strip_suffix(e)?, *e)))?;
        let (_, offset, scale) =
            self.motion.iter().find(|(name, ..)| name == coordinate).cloned().unwrap_or((String::new(), 0.0, 1.0));
        Some(Value::Number(match ending {
            "_scale" => scale,
            "_offset_deg" => offset.to_degrees(),
            _ => offset,
        }))
    }

    /// The same settings in a unique form: derived values are filled in, and settings that the scheme ignores reset.
    pub fn canonical(&self) -> Self {
        let mut same = self.clone();
        if same.intervals.is_some() {
            same.h = Self::default().h;
        }
        same.measurement_ratio = Some(self.measured_per_interval());
        same.reserves_at.retain(|(_, moment)| *moment != self.reserves);
        same.tracking_weights.retain(|(_, weight)| *weight != 1.0);
        if !self.has_reserves() {
            same.reserve_weight = 1.0;
        }
        let own = Self::default();
        if self.method == Method::Prescribed {
            (same.mu, same.excitation_weight) = (own.mu, 0.0);
            same.load_sharing_grid = own.load_sharing_grid;
            same.tracking_weights.clear();
        } else if self.method == Method::Static {
            (same.mu, same.excitation_weight, same.bounds) = (own.mu, 0.0, own.bounds);
            (same.starts, same.first_start, same.warm_start) = (1, 0, own.warm_start);
            (same.initial, same.max_iterations) = (own.initial, own.max_iterations);
            same.load_sharing_grid = own.load_sharing_grid;
            same.activation_dynamics = None;
            same.tracking_weights.clear();
            if self.criterion == Criterion::MinMax {
                same.effort_power = 2.0;
            }
        } else if self.mu == 0.0 {
            (same.effort_power, same.excitation_weight) = (2.0, 0.0);
        }
        if self.effort_power != 2.0 {
            same.load_sharing_grid = own.load_sharing_grid;
        }
        if self.muscle_dynamics == MuscleDynamics::Force {
            (same.passive_forces, same.effort_of) = (true, own.effort_of);
            (same.bounds, same.excitation_weight, same.initial) = (own.bounds, 0.0, own.initial);
            (same.muscle_curves, same.activation_dynamics) = (None, None);
        }
        if self.muscle_dynamics == MuscleDynamics::RigidTendon && self.initial != Initial::Steady {
            same.initial = own.initial;
        }
        if self.scheme == Scheme::Midpoint {
            (same.stages, same.initial) = (1, Initial::Equilibrium);
        }
        same
    }

    /// Collocation points in an interval of length h.
    pub fn points_per_interval(&self) -> usize {
        if self.scheme == Scheme::Radau { self.stages } else { 1 }
    }

    /// Measured instants in an interval of length h.
    pub fn measured_per_interval(&self) -> usize {
        self.measurement_ratio.unwrap_or(2 * self.points_per_interval())
    }

    /// How to measure the motion.
    pub fn of_motion(&self) -> MotionSettings {
        MotionSettings {
            measurement_ratio: self.measured_per_interval(),
            smoothing_hz: self.smoothing_hz,
            noise_sd: self.noise_sd,
            seed: self.seed,
            time_scale: self.time_scale,
            changes: self.motion.clone(),
        }
    }

    fn set_motion(&mut self, change: &str, value: &Value, coordinates: &[(String, bool)]) -> Result<(), InvalidValue> {
        if change == "time_scale" {
            self.time_scale = number(value, 1e-6..=1e6, "a positive factor")?;
            return Ok(());
        }
        let Some((coordinate, ending)) = MOTION_ENDINGS.iter().find_map(|e| change.strip_suffix(e).map(|c| (c, *e)))
        else {
            return Err(InvalidValue::new(
                format!("unknown change `motion.{change}`"),
                "allowed are time_scale, <coordinate>_offset_deg (or _rad, _m) and <coordinate>_scale",
            ));
        };
        let (name, is_angle) = find_coordinate(coordinate, coordinates)?;
        let unit_fits = match ending {
            "_offset_m" => !is_angle,
            "_scale" => true,
            _ => *is_angle,
        };
        if !unit_fits {
            let unit = if *is_angle { "_offset_deg or _offset_rad" } else { "_offset_m" };
            return Err(InvalidValue::new(format!("`{name}` has no {ending}"), format!("use `motion.{name}{unit}`")));
        }
        let number = number(value, -1e6..=1e6, "a number")?;
        let at = match self.motion.iter().position(|(n, ..)| n == name) {
            Some(at) => at,
            None => {
                self.motion.push((name.clone(), 0.0, 1.0));
                self.motion.len() - 1
            }
        };
        match ending {
            "_scale" => self.motion[at].2 = number,
            "_offset_deg" => self.motion[at].1 = number.to_radians(),
            _ => self.motion[at].1 = number,
        }
        // A unique form of the changes, because they are part of a job's identity.
        self.motion.retain(|(_, offset, scale)| (*offset, *scale) != (0.0, 1.0));
        self.motion.sort_by(|a, b| a.0.cmp(&b.0));
        Ok(())
    }

    /// Number of collocation points on a motion of `duration` seconds.
    ///
    /// # Errors
    /// If h does not divide the duration.
    pub fn points(&self, duration: f64) -> Result<usize, InvalidValue> {
        let duration = duration * self.time_scale;
        if let Some(intervals) = self.intervals {
            return check_points(intervals + 1, &format!("intervals = {intervals}"), "choose fewer");
        }
        let intervals = duration / self.h;
        let whole = intervals.round();
        if (intervals - whole).abs() > 1e-6 * whole.max(1.0) || whole < 2.0 {
            let (few, many) = (intervals.floor().max(2.0), intervals.ceil().max(3.0));
            return Err(InvalidValue::new(
                format!(
                    "h = {} s does not divide the motion's duration of {duration} s into two or more intervals; `intervals` \
                     always does",
                    self.h
                ),
                format!(
                    "the nearest values that do: {} s ({few} intervals), {} s ({many})",
                    duration / few,
                    duration / many
                ),
            ));
        }
        check_points(whole as usize + 1, &format!("h = {} s", self.h), "choose a larger h")
    }
}

fn check_points(points: usize, what: &str, help: &str) -> Result<usize, InvalidValue> {
    if points > MAX_POINTS {
        let message = format!("{what} gives {points} points; at most {MAX_POINTS} are allowed");
        return Err(InvalidValue::new(message, help));
    }
    Ok(points)
}

/// The value of a coordinate in a list by coordinate.
fn at(list: &[(String, f64)], coordinate: &str) -> Option<f64> {
    list.iter().find(|(name, _)| name == coordinate).map(|(_, value)| *value)
}

/// Sets the value of a coordinate.
fn set_at(list: &mut Vec<(String, f64)>, coordinate: &str, value: f64) {
    list.retain(|(other, _)| other != coordinate);
    list.push((coordinate.to_owned(), value));
    // A unique form, because they are part of a job's identity.
    list.sort_by(|a, b| a.0.cmp(&b.0));
}

/// What a reserve may be.
const RESERVE: &str = "a moment in N m (a force in N), such as 5.0; 0 for no reserve";

fn find_coordinate<'c>(name: &str, coordinates: &'c [(String, bool)]) -> Result<&'c (String, bool), InvalidValue> {
    coordinates.iter().find(|(known, _)| known == name).ok_or_else(|| {
        let names: Vec<&str> = coordinates.iter().map(|(name, _)| name.as_str()).collect();
        let near = nearest(name, names.iter().copied()).map(|n| format!("did you mean `{n}`? "));
        InvalidValue::new(
            format!("unknown joint coordinate `{name}`"),
            format!("{}the model has: {}", near.unwrap_or_default(), names.join(", ")),
        )
    })
}

/// The complaint about a name that is neither a setting nor a number of the model.
pub fn unknown(name: &str) -> InvalidValue {
    if name == "girdle" {
        return InvalidValue::new(
            "the setting `girdle` is now a role of bodies",
            "set `body.clavicle,scapula.role` (or the bodies of your model) to \"fixed\", \"given\" (it was \
             prescribed) or \"free\" (it was equilibrium)",
        );
    }
    let near = nearest(name, NAMES.iter().copied()).map(|n| format!("did you mean `{n}`? ")).unwrap_or_default();
    InvalidValue::new(
        format!("unknown setting `{name}`"),
        format!(
            "{near}available settings: {}; parameters of the model are set by path, such as \
             muscle.<name>.tendon_slack_length or body.<name>.mass_scale; changes of the motion begin with motion., \
             limits of warnings with warn.",
            NAMES.join(", ")
        ),
    )
}
