//! The outcome of one job: plain rows, ready for the tables. Missing values are `None`, never NaN.

use serde::{Deserialize, Serialize};

use crate::nlp::iterate::Iterate;
use crate::nlp::termination::SqpStatus;

/// How a job ended. Only `converged` is success.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// All three KKT residuals are below the tolerance.
    Converged,
    /// The limit of SQP iterations was reached.
    IterationLimit,
    /// The wall-clock limit was reached.
    TimeLimit,
    /// The quadratic sub-problem could not be solved.
    QpFailed,
    /// No further step was accepted.
    Stalled,
    /// The constraints contradict each other.
    Infeasible,
    /// A function or derivative was not finite.
    NonFinite,
    /// The job could not be set up.
    Invalid,
    /// The program failed inside the job.
    Panicked,
}

impl Status {
    pub fn name(self) -> &'static str {
        match self {
            Status::Converged => "converged",
            Status::IterationLimit => "iteration_limit",
            Status::TimeLimit => "time_limit",
            Status::QpFailed => "qp_failed",
            Status::Stalled => "stalled",
            Status::Infeasible => "infeasible",
            Status::NonFinite => "non_finite",
            Status::Invalid => "invalid",
            Status::Panicked => "panicked",
        }
    }
}

impl From<SqpStatus> for Status {
    fn from(status: SqpStatus) -> Self {
        match status {
            SqpStatus::Converged => Status::Converged,
            SqpStatus::IterationLimit => Status::IterationLimit,
            SqpStatus::TimeLimit => Status::TimeLimit,
            SqpStatus::QpFailed => Status::QpFailed,
            SqpStatus::Stalled => Status::Stalled,
            SqpStatus::Infeasible => Status::Infeasible,
            SqpStatus::NonFinite => Status::NonFinite,
        }
    }
}

/// All results of one job.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Outcome {
    pub job: JobRow,
    pub regularity: Option<RegularityRow>,
    pub iterations: Vec<IterationRow>,
    pub muscles: Vec<MuscleRow>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub reserves: Vec<ReserveRow>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub joints: Vec<JointRow>,
    pub spectrum: Vec<SpectrumRow>,
    pub sensitivities: Vec<SensitivityRow>,
    pub optima: Vec<OptimumRow>,
    pub trajectories: Vec<TrajectoryRow>,
    /// The final point of a converged solve. It is in no table, but stored so that ranks and trajectories can be added
    /// later.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub solution: Option<SolutionPoint>,
}

/// The decision vector and the multipliers of a converged solve, in the scaled units of the transcription.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SolutionPoint {
    #[serde(with = "base64_doubles")]
    pub x: Vec<f64>,
    #[serde(with = "base64_doubles")]
    pub equality_multipliers: Vec<f64>,
    #[serde(with = "base64_doubles")]
    pub inequality_multipliers: Vec<f64>,
}

impl SolutionPoint {
    pub fn of(iterate: &Iterate) -> Self {
        Self {
            x: iterate.x.clone(),
            equality_multipliers: iterate.equality_multipliers.clone(),
            inequality_multipliers: iterate.inequality_multipliers.clone(),
        }
    }
}

/// Numbers as the base64 text of their little-endian bytes: exact, and half as long as decimal digits.
mod base64_doubles {
    use base64::Engine;
    use base64::engine::general_purpose::STANDARD;
    use serde::{Deserialize, Deserializer, Serializer, de::Error};

    pub fn serialize<S: Serializer>(values: &[f64], serializer: S) -> Result<S::Ok, S::Error> {
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        serializer.serialize_str(&STANDARD.encode(bytes))
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<f64>, D::Error> {
        let bytes = STANDARD.decode(String::deserialize(deserializer)?).map_err(D::Error::custom)?;
        let (numbers, rest) = bytes.as_chunks::<8>();
        if !rest.is_empty() {
            return Err(D::Error::custom("not a whole number of doubles"));
        }
        Ok(numbers.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect())
    }
}

/// The job's row in `jobs.parquet`, except its id and swept values.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct JobRow {
    pub status: Status,
    /// The reason, if the status is not `converged`.
    pub error: Option<String>,
    /// Codes of warnings, separated by commas; see [`crate::plausibility`].
    pub warnings: Option<String>,
    /// What the warnings found, and how the job was started if not as usual.
    pub remark: Option<String>,
    /// Iterations of the best start, including those of a second attempt.
    pub iterations: Option<i64>,
    /// Factorisations of KKT matrices, for all starts and the analysis together.
    pub factorisations: Option<i64>,
    pub objective: Option<f64>,
    /// ∫Σa² dt, s
    pub effort: Option<f64>,
    /// ∫Σr² dt over reserves and actuators, s
    pub actuator_effort: Option<f64>,
    /// ∫Σu² dt over excitations and the controls of reserves and actuators, s
    pub control_effort: Option<f64>,
    /// Estimated discretisation error of the effort, computed minus exact, s
    pub effort_mesh_error: Option<f64>,
    pub tracking_rms_m: Option<f64>,
    pub tracking_rms_deg: Option<f64>,
    pub n_starts: Option<i64>,
    pub n_converged_starts: Option<i64>,
    pub n_distinct_optima: Option<i64>,
    pub stationarity: Option<f64>,
    pub feasibility: Option<f64>,
    pub complementarity: Option<f64>,
    pub n_variables: Option<i64>,
    pub n_equalities: Option<i64>,
    pub n_active: Option<i64>,
    pub n_active_force: Option<i64>,
    pub min_activation: Option<f64>,
    pub max_activation: Option<f64>,
    /// max |Φ_q q̇| over the collocation points, m/s and rad/s
    pub max_constraint_velocity: Option<f64>,
    /// Largest residual of the equations midway between the points, see the README.
    pub mid_interval_error: Option<f64>,
    /// Unknowns are moved exactly onto active bounds before ranks are taken; false if that failed.
    pub polished: Option<bool>,
    pub warm_start_from: Option<String>,
    pub solve_s: Option<f64>,
    pub rank_s: Option<f64>,
    pub wall_s: Option<f64>,
}

impl Default for JobRow {
    fn default() -> Self {
        Self::failed(Status::Invalid, String::new())
    }
}

impl JobRow {
    /// The row of a job that has only a status and a reason.
    pub fn failed(status: Status, error: String) -> Self {
        Self {
            status,
            error: Some(error),
            warnings: None,
            remark: None,
            iterations: None,
            factorisations: None,
            objective: None,
            effort: None,
            actuator_effort: None,
            control_effort: None,
            effort_mesh_error: None,
            tracking_rms_m: None,
            tracking_rms_deg: None,
            n_starts: None,
            n_converged_starts: None,
            n_distinct_optima: None,
            stationarity: None,
            feasibility: None,
            complementarity: None,
            n_variables: None,
            n_equalities: None,
            n_active: None,
            n_active_force: None,
            min_activation: None,
            max_activation: None,
            max_constraint_velocity: None,
            mid_interval_error: None,
            polished: None,
            warm_start_from: None,
            solve_s: None,
            rank_s: None,
            wall_s: None,
        }
    }
}

impl Outcome {
    pub fn failed(status: Status, error: impl Into<String>) -> Self {
        Self { job: JobRow::failed(status, error.into()), ..Self::default() }
    }

    /// Takes ranks, muscle rows and sensitivities from `other`, an analysis of the same solution.
    pub fn replace_ranks(&mut self, other: &Self) {
        self.regularity.clone_from(&other.regularity);
        self.spectrum.clone_from(&other.spectrum);
        self.sensitivities.clone_from(&other.sensitivities);
        self.muscles.clone_from(&other.muscles);
        self.job.rank_s = other.job.rank_s;
        let known = other.regularity.as_ref().map(|row| (row.a.deficiency, row.aj.deficiency));
        for row in &mut self.iterations {
            (row.deficiency_a, row.deficiency_aj) = (None, None);
        }
        if let Some(last) = self.iterations.last_mut() {
            (last.deficiency_a, last.deficiency_aj) = known.unzip();
        }
        if known.is_none() {
            for row in &mut self.optima {
                (row.deficiency_a, row.deficiency_aj) = (None, None);
            }
        } else if let Some(lowest) = self.optima.first_mut() {
            (lowest.deficiency_a, lowest.deficiency_aj) = known.unzip();
        }
    }
}

/// The job's row in `regularity.parquet`. Deficiencies are counts; the thesis prints them negative.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RegularityRow {
    pub a: MatrixRank,
    pub aj: MatrixRank,
    /// With the active conditions f_m ≥ 0 as additional rows of A.
    pub deficiency_a_with_force: Option<i64>,
    pub deficiency_aj_with_force: Option<i64>,
    /// Some σ/σ_max lies between 1e-15 and 1e-9.
    pub ambiguous: bool,
    /// Whether the deficiencies equal the predicted ones, for the cut used or for another one within that band.
    pub prediction_agrees: Option<bool>,
    /// A has full row rank: the multipliers are unique. This field and those below are set for converged jobs only.
    pub multipliers_unique: Option<bool>,
    /// [Aᵀ Jᵀ] has full rank: every direction changes a constraint or a residual.
    pub answer_unique: Option<bool>,
    /// No direction that leaves constraints and residuals unchanged changes a muscle's force at a collocation point.
    pub loads_unique: Option<bool>,
    /// Description of the directions that change neither constraints nor residuals.
    pub null_space: Option<String>,
}

/// Rank of A or of [Aᵀ Jᵀ].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MatrixRank {
    /// Rows of A; columns of [A; J], which is the number of unknowns.
    pub size: i64,
    pub rank: i64,
    pub deficiency: i64,
    pub predicted: Option<i64>,
    pub tolerance: f64,
    pub sigma_max: Option<f64>,
    pub sigma_last_kept: Option<f64>,
    pub sigma_first_dropped: Option<f64>,
}

/// One iteration of the best start.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct IterationRow {
    pub iteration: i64,
    pub objective: f64,
    pub stationarity: f64,
    pub feasibility: f64,
    pub complementarity: f64,
    pub step_norm: f64,
    pub distance_to_solution: f64,
    pub qp_iterations: i64,
    pub deficiency_a: Option<i64>,
    pub deficiency_aj: Option<i64>,
    /// How the step came about; `None` at the last iterate, and in results of older versions.
    #[serde(default)]
    pub step: Option<StepRow>,
}

/// The step that leads from an iterate to the next.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StepRow {
    /// How the quadratic sub-problem was solved; `restoration` if feasibility was restored instead.
    pub way: String,
    /// δ, the weight of the proximal term.
    pub damping: Option<f64>,
    /// α, the share of the step.
    pub fraction: Option<f64>,
    /// Steps refused before.
    pub refusals: i64,
    /// Length of the leap in steps.
    #[serde(default)]
    pub leap: f64,
    /// How many times as long the step was made afterwards.
    pub extension: f64,
    /// Of the KKT matrix.
    pub factorisations: i64,
}

/// What a joint of a spatial model carries in a job: the size of the force and of the moment on its child, at the joint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct JointRow {
    pub joint: String,
    pub mean_force_n: f64,
    pub peak_force_n: f64,
    /// In units of the weight of all bodies; `None` without gravity.
    pub mean_force_bw: Option<f64>,
    pub peak_force_bw: Option<f64>,
    pub mean_moment_n_m: f64,
    pub peak_moment_n_m: f64,
}

/// One muscle of a job.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MuscleRow {
    pub muscle: String,
    pub mean_activation: f64,
    /// Interval of the mean activation over all answers that are equally good to first order.
    pub mean_activation_low: Option<f64>,
    pub mean_activation_high: Option<f64>,
    pub peak_activation: f64,
    pub peak_excitation: Option<f64>,
    /// Share of the time with an activation of 1.
    pub saturated_share: f64,
    /// Share of the time in which it has no strength and is left out; `None` where that cannot be.
    #[serde(default)]
    pub left_out_share: Option<f64>,
    pub mean_force_n: f64,
    /// Estimated discretisation error of the mean force, computed minus exact.
    pub mean_force_mesh_error_n: Option<f64>,
    /// Smallest and largest mean force at nearly the same cost.
    #[serde(default)]
    pub mean_force_near_low_n: Option<f64>,
    #[serde(default)]
    pub mean_force_near_high_n: Option<f64>,
    pub peak_force_n: f64,
    pub min_force_n: f64,
    pub impulse_n_s: f64,
    pub peak_passive_force_n: f64,
    /// In optimal fibre lengths, as is `max_fibre_length`.
    pub min_fibre_length: Option<f64>,
    pub max_fibre_length: Option<f64>,
    /// |a| ≤ 1e-8 at every collocation point.
    pub idle: bool,
    /// max |v_{j+1} − 2 v_j + v_{j−1}|/4 of the fibre velocity, optimal fibre lengths per second.
    pub ringing: Option<f64>,
    /// Share of inner points at which the fibre velocity changes from rising to falling or back.
    pub direction_changes: Option<f64>,
    pub peak_fibre_velocity_per_s: Option<f64>,
    /// Total variation of the excitation over twice its range: 1 if it rises and falls once. `None` in results of older versions.
    #[serde(default)]
    pub excitation_swings: Option<f64>,
}

/// A reserve or another actuator of a job, at a joint coordinate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ReserveRow {
    pub coordinate: String,
    /// Name of the actuator; of a reserve `reserve.` and that of its coordinate.
    pub actuator: String,
    pub is_reserve: bool,
    /// Of a moment, N m.
    pub peak_moment_n_m: Option<f64>,
    pub rms_moment_n_m: Option<f64>,
    /// Of a force, N.
    pub peak_force_n: Option<f64>,
    pub rms_force_n: Option<f64>,
    /// Peak relative to the peak of the net joint moment or force.
    pub share: Option<f64>,
}

/// One of the optima found by the starts of a job, the lowest first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OptimumRow {
    pub objective: f64,
    /// Number of starts that ended there.
    pub starts: i64,
    /// Muscles without activation, separated by commas.
    pub idle: String,
    pub deficiency_a: Option<i64>,
    pub deficiency_aj: Option<i64>,
}

/// How a muscle's mean force depends on a parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SensitivityRow {
    pub muscle: String,
    /// `mu`, or the path of a numeric parameter of the model.
    pub parameter: String,
    pub parameter_value: f64,
    /// N per unit of the parameter.
    pub mean_force_slope: f64,
    /// Change of the force in per cent for a change of the parameter by one per cent; null for a force of zero.
    pub elasticity: Option<f64>,
}

/// One singular value near the cut.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SpectrumRow {
    pub matrix: String,
    /// From 0, largest first.
    pub index: i64,
    pub value: f64,
}

/// One value of a function of time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrajectoryRow {
    pub time_s: f64,
    pub signal: String,
    pub name: String,
    pub value: f64,
    /// Set on reactions and accelerations of the first and last four points, which ring at both ends.
    pub end_effect: bool,
}
