//! The columns of every table: the only list of them.

use super::{Table, Values};
use crate::outcome::{JobRow, MatrixRank, MuscleRow, Outcome, RegularityRow};
use crate::study::file::{Measure, Ratio};
use crate::study::settings::Value;
use crate::study::{Job, Study};

/// Version of names, types and meanings of the columns.
pub const VERSION: u32 = crate::study::SCHEMA_VERSION;

/// Names of the tables, which are the file names without `.parquet`.
pub const TABLES: [&str; 9] =
    ["jobs", "regularity", "iterations", "muscles", "ratios", "spectrum", "sensitivities", "optima", "trajectories"];

/// Tables that are left out where they have no row, since a study has to ask for them.
pub const ON_REQUEST: [&str; 2] = ["ratios", "trajectories"];

/// Columns of `jobs` before those of the axes, and the first after them.
const BEFORE_AXES: [&str; 2] = ["job_id", "index"];
const AFTER_AXES: &str = "status";

/// Names of what a study swept, from its table of jobs.
pub fn axes(jobs: &Table) -> Vec<String> {
    let names = jobs.columns.iter().map(|(name, _)| name.clone());
    names.filter(|name| !BEFORE_AXES.contains(&name.as_str())).take_while(|name| name != AFTER_AXES).collect()
}

/// Columns that tell the rows of one job apart.
pub fn row_keys(table: &str) -> &'static [&'static str] {
    match table {
        "iterations" => &["iteration"],
        "muscles" => &["muscle"],
        "ratios" => &["ratio", "measure"],
        "spectrum" => &["matrix", "index"],
        "sensitivities" => &["muscle", "parameter"],
        "trajectories" => &["time_s", "signal", "name"],
        _ => &[], // one row a job; optima by their order
    }
}

/// What the tables of a study depend on beside its outcomes.
pub struct Columns<'s> {
    axes: Vec<(&'s str, Kind)>,
    ratios: &'s [Ratio],
}

/// Settings that are whole numbers.
const COUNTS: [&str; 7] =
    ["stages", "measurement_ratio", "starts", "first_start", "seed", "max_iterations", crate::study::sweep::SAMPLE];

/// Type of a swept column: that of all its values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Integer,
    Number,
    Flag,
    Text,
}

impl<'s> Columns<'s> {
    pub fn of(study: &'s Study) -> Self {
        // Real numbers are real in every study, whatever values it has of them.
        let kind = |axis: usize| {
            let values = || study.jobs.iter().filter_map(move |job| job.swept[axis].as_ref());
            if COUNTS.contains(&study.axes[axis].as_str()) && values().all(|v| matches!(v, Value::Integer(_))) {
                Kind::Integer
            } else if values().all(|v| v.number().is_some()) {
                Kind::Number
            } else if values().all(|v| matches!(v, Value::Flag(_))) {
                Kind::Flag
            } else {
                Kind::Text
            }
        };
        let axes = study.axes.iter().enumerate().map(|(i, name)| (name.as_str(), kind(i))).collect();
        Self { axes, ratios: &study.ratios }
    }

    /// All tables for some finished jobs, in their order.
    pub fn tables(&self, finished: &[(&Job, &Outcome)]) -> Vec<Table> {
        vec![
            self.jobs(finished),
            regularity(finished),
            iterations(finished),
            muscles(finished),
            ratios(finished, self.ratios),
            spectrum(finished),
            sensitivities(finished),
            optima(finished),
            trajectories(finished),
        ]
    }
}

/// Columns that are times taken: two runs of one study may differ in these only.
pub const TIMINGS: [&str; 3] = ["solve_s", "rank_s", "wall_s"];

fn numbers<R>(rows: &[R], f: impl Fn(&R) -> Option<f64>) -> Values {
    Values::Number(rows.iter().map(f).collect())
}

fn integers<R>(rows: &[R], f: impl Fn(&R) -> Option<i64>) -> Values {
    Values::Integer(rows.iter().map(f).collect())
}

fn flags<R>(rows: &[R], f: impl Fn(&R) -> Option<bool>) -> Values {
    Values::Flag(rows.iter().map(f).collect())
}

fn texts<R>(rows: &[R], f: impl Fn(&R) -> Option<String>) -> Values {
    Values::Text(rows.iter().map(f).collect())
}

fn table(name: &'static str, columns: Vec<(&str, Values)>) -> Table {
    Table { name, columns: columns.into_iter().map(|(name, values)| (name.to_owned(), values)).collect() }
}

impl Kind {
    fn values(self, values: &[Option<&Value>]) -> Values {
        match self {
            Kind::Integer => integers(values, |v| match v {
                Some(Value::Integer(i)) => Some(*i),
                _ => None,
            }),
            Kind::Number => numbers(values, |v| v.and_then(Value::number)),
            Kind::Flag => flags(values, |v| match v {
                Some(Value::Flag(f)) => Some(*f),
                _ => None,
            }),
            Kind::Text => texts(values, |v| v.map(ToString::to_string)),
        }
    }
}

impl Columns<'_> {
    fn jobs(&self, rows: &[(&Job, &Outcome)]) -> Table {
        let mut jobs = table(
            "jobs",
            vec![
                ("job_id", texts(rows, |(job, _)| Some(job.id.clone()))),
                ("index", integers(rows, |(job, _)| Some(job.index as i64))),
            ],
        );
        for (axis, (name, kind)) in self.axes.iter().enumerate() {
            let values: Vec<Option<&Value>> = rows.iter().map(|(job, _)| job.swept[axis].as_ref()).collect();
            jobs.columns.push(((*name).to_owned(), kind.values(&values)));
        }
        jobs.columns.extend(job_rows(rows).into_iter().map(|(name, values)| (name.to_owned(), values)));
        jobs
    }
}

fn job_rows(rows: &[(&Job, &Outcome)]) -> Vec<(&'static str, Values)> {
    let number = |f: fn(&JobRow) -> Option<f64>| numbers(rows, |(_, o)| f(&o.job));
    let integer = |f: fn(&JobRow) -> Option<i64>| integers(rows, |(_, o)| f(&o.job));
    vec![
        ("status", texts(rows, |(_, o)| Some(o.job.status.name().to_owned()))),
        ("error", texts(rows, |(_, o)| o.job.error.clone())),
        ("warnings", texts(rows, |(_, o)| o.job.warnings.clone())),
        ("remark", texts(rows, |(_, o)| o.job.remark.clone())),
        ("iterations", integer(|j| j.iterations)),
        ("factorisations", integer(|j| j.factorisations)),
        ("objective", number(|j| j.objective)),
        ("effort", number(|j| j.effort)),
        ("effort_mesh_error", number(|j| j.effort_mesh_error)),
        ("tracking_rms_m", number(|j| j.tracking_rms_m)),
        ("tracking_rms_deg", number(|j| j.tracking_rms_deg)),
        ("n_starts", integer(|j| j.n_starts)),
        ("n_converged_starts", integer(|j| j.n_converged_starts)),
        ("n_distinct_optima", integer(|j| j.n_distinct_optima)),
        ("stationarity", number(|j| j.stationarity)),
        ("feasibility", number(|j| j.feasibility)),
        ("complementarity", number(|j| j.complementarity)),
        ("n_variables", integer(|j| j.n_variables)),
        ("n_equalities", integer(|j| j.n_equalities)),
        ("n_active", integer(|j| j.n_active)),
        ("n_active_force", integer(|j| j.n_active_force)),
        ("min_activation", number(|j| j.min_activation)),
        ("max_activation", number(|j| j.max_activation)),
        ("max_constraint_velocity", number(|j| j.max_constraint_velocity)),
        ("mid_interval_error", number(|j| j.mid_interval_error)),
        ("polished", flags(rows, |(_, o)| o.job.polished)),
        ("warm_start_from", texts(rows, |(_, o)| o.job.warm_start_from.clone())),
        ("solve_s", number(|j| j.solve_s)),
        ("rank_s", number(|j| j.rank_s)),
        ("wall_s", number(|j| j.wall_s)),
    ]
}

fn regularity(finished: &[(&Job, &Outcome)]) -> Table {
    let rows: Vec<(Of<'_>, &RegularityRow)> =
        finished.iter().filter_map(|(job, o)| Some((Of::new(job, o), o.regularity.as_ref()?))).collect();
    type Pick = fn(&RegularityRow) -> &MatrixRank;
    let matrix = |pick: Pick, f: fn(&MatrixRank) -> Option<i64>| integers(&rows, |(_, r)| f(pick(r)));
    let value = |pick: Pick, f: fn(&MatrixRank) -> Option<f64>| numbers(&rows, |(_, r)| f(pick(r)));
    let (a, aj): (Pick, Pick) = (|r| &r.a, |r| &r.aj);
    table(
        "regularity",
        vec![
            ("job_id", texts(&rows, |(of, _)| Some(of.job.to_owned()))),
            ("status", texts(&rows, |(of, _)| Some(of.status.to_owned()))),
            ("rows_a", matrix(a, |m| Some(m.size))),
            ("rank_a", matrix(a, |m| Some(m.rank))),
            ("deficiency_a", matrix(a, |m| Some(m.deficiency))),
            ("predicted_deficiency_a", matrix(a, |m| m.predicted)),
            ("columns_aj", matrix(aj, |m| Some(m.size))),
            ("rank_aj", matrix(aj, |m| Some(m.rank))),
            ("deficiency_aj", matrix(aj, |m| Some(m.deficiency))),
            ("predicted_deficiency_aj", matrix(aj, |m| m.predicted)),
            ("deficiency_a_with_force", integers(&rows, |(_, r)| r.deficiency_a_with_force)),
            ("deficiency_aj_with_force", integers(&rows, |(_, r)| r.deficiency_aj_with_force)),
            ("tolerance_a", value(a, |m| Some(m.tolerance))),
            ("tolerance_aj", value(aj, |m| Some(m.tolerance))),
            ("sigma_max_a", value(a, |m| m.sigma_max)),
            ("sigma_max_aj", value(aj, |m| m.sigma_max)),
            ("sigma_last_kept_a", value(a, |m| m.sigma_last_kept)),
            ("sigma_last_kept_aj", value(aj, |m| m.sigma_last_kept)),
            ("sigma_first_dropped_a", value(a, |m| m.sigma_first_dropped)),
            ("sigma_first_dropped_aj", value(aj, |m| m.sigma_first_dropped)),
            ("ambiguous", flags(&rows, |(_, r)| Some(r.ambiguous))),
            ("prediction_agrees", flags(&rows, |(_, r)| r.prediction_agrees)),
            ("multipliers_unique", flags(&rows, |(_, r)| r.multipliers_unique)),
            ("answer_unique", flags(&rows, |(_, r)| r.answer_unique)),
            ("loads_unique", flags(&rows, |(_, r)| r.loads_unique)),
            ("unique", flags(&rows, |(_, r)| Some(r.multipliers_unique? && r.answer_unique?))),
            ("null_space", texts(&rows, |(_, r)| r.null_space.clone())),
        ],
    )
}

/// The job that a row is of.
#[derive(Clone, Copy)]
struct Of<'o> {
    job: &'o str,
    status: &'static str,
}

impl<'o> Of<'o> {
    fn new(job: &'o Job, outcome: &Outcome) -> Self {
        Self { job: &job.id, status: outcome.job.status.name() }
    }
}

/// Every row of one kind, with its job.
fn each<'o, R>(finished: &[(&'o Job, &'o Outcome)], rows: fn(&'o Outcome) -> &'o Vec<R>) -> Vec<(Of<'o>, &'o R)> {
    finished.iter().flat_map(|(job, outcome)| rows(outcome).iter().map(|row| (Of::new(job, outcome), row))).collect()
}

fn iterations(finished: &[(&Job, &Outcome)]) -> Table {
    let rows = each(finished, |o| &o.iterations);
    table(
        "iterations",
        vec![
            ("job_id", texts(&rows, |(of, _)| Some(of.job.to_owned()))),
            ("iteration", integers(&rows, |(_, r)| Some(r.iteration))),
            ("objective", numbers(&rows, |(_, r)| Some(r.objective))),
            ("stationarity", numbers(&rows, |(_, r)| Some(r.stationarity))),
            ("feasibility", numbers(&rows, |(_, r)| Some(r.feasibility))),
            ("complementarity", numbers(&rows, |(_, r)| Some(r.complementarity))),
            ("step_norm", numbers(&rows, |(_, r)| Some(r.step_norm))),
            ("distance_to_solution", numbers(&rows, |(_, r)| Some(r.distance_to_solution))),
            ("qp_iterations", integers(&rows, |(_, r)| Some(r.qp_iterations))),
            ("deficiency_a", integers(&rows, |(_, r)| r.deficiency_a)),
            ("deficiency_aj", integers(&rows, |(_, r)| r.deficiency_aj)),
        ],
    )
}

fn muscles(finished: &[(&Job, &Outcome)]) -> Table {
    let rows = each(finished, |o| &o.muscles);
    table(
        "muscles",
        vec![
            ("job_id", texts(&rows, |(of, _)| Some(of.job.to_owned()))),
            ("status", texts(&rows, |(of, _)| Some(of.status.to_owned()))),
            ("muscle", texts(&rows, |(_, r)| Some(r.muscle.clone()))),
            ("mean_activation", numbers(&rows, |(_, r)| Some(r.mean_activation))),
            ("mean_activation_low", numbers(&rows, |(_, r)| r.mean_activation_low)),
            ("mean_activation_high", numbers(&rows, |(_, r)| r.mean_activation_high)),
            ("peak_activation", numbers(&rows, |(_, r)| Some(r.peak_activation))),
            ("peak_excitation", numbers(&rows, |(_, r)| Some(r.peak_excitation))),
            ("saturated_share", numbers(&rows, |(_, r)| Some(r.saturated_share))),
            ("mean_force_n", numbers(&rows, |(_, r)| Some(r.mean_force_n))),
            ("mean_force_mesh_error_n", numbers(&rows, |(_, r)| r.mean_force_mesh_error_n)),
            ("peak_force_n", numbers(&rows, |(_, r)| Some(r.peak_force_n))),
            ("impulse_n_s", numbers(&rows, |(_, r)| Some(r.impulse_n_s))),
            ("min_force_n", numbers(&rows, |(_, r)| Some(r.min_force_n))),
            ("peak_passive_force_n", numbers(&rows, |(_, r)| Some(r.peak_passive_force_n))),
            ("min_fibre_length", numbers(&rows, |(_, r)| Some(r.min_fibre_length))),
            ("max_fibre_length", numbers(&rows, |(_, r)| Some(r.max_fibre_length))),
            ("idle", flags(&rows, |(_, r)| Some(r.idle))),
            ("ringing", numbers(&rows, |(_, r)| Some(r.ringing))),
            ("direction_changes", numbers(&rows, |(_, r)| Some(r.direction_changes))),
            ("peak_fibre_velocity_per_s", numbers(&rows, |(_, r)| Some(r.peak_fibre_velocity_per_s))),
        ],
    )
}

/// The declared load ratios of each job that has muscles; null where the denominator is 0.
fn ratios(finished: &[(&Job, &Outcome)], ratios: &[Ratio]) -> Table {
    struct Row<'o> {
        of: Of<'o>,
        ratio: &'o str,
        measure: Measure,
        value: Option<f64>,
    }
    let mut rows = Vec::new();
    for (job, outcome) in finished.iter().filter(|(_, outcome)| !outcome.muscles.is_empty()) {
        for ratio in ratios {
            for &measure in &ratio.measure.0 {
                let total = |muscles: &[String]| {
                    let of = |row: &MuscleRow| match measure {
                        Measure::MeanForce => row.mean_force_n,
                        Measure::PeakForce => row.peak_force_n,
                        Measure::Impulse => row.impulse_n_s,
                        Measure::Activation => row.mean_activation / muscles.len() as f64,
                    };
                    outcome.muscles.iter().filter(|row| muscles.contains(&row.muscle)).map(of).sum::<f64>()
                };
                let value = Some(total(&ratio.numerator.0) / total(&ratio.denominator.0)).filter(|v| v.is_finite());
                rows.push(Row { of: Of::new(job, outcome), ratio: &ratio.name, measure, value });
            }
        }
    }
    table(
        "ratios",
        vec![
            ("job_id", texts(&rows, |r| Some(r.of.job.to_owned()))),
            ("status", texts(&rows, |r| Some(r.of.status.to_owned()))),
            ("ratio", texts(&rows, |r| Some(r.ratio.to_owned()))),
            ("measure", texts(&rows, |r| Some(r.measure.name().to_owned()))),
            ("value", numbers(&rows, |r| r.value)),
        ],
    )
}

fn spectrum(finished: &[(&Job, &Outcome)]) -> Table {
    let rows = each(finished, |o| &o.spectrum);
    table(
        "spectrum",
        vec![
            ("job_id", texts(&rows, |(of, _)| Some(of.job.to_owned()))),
            ("matrix", texts(&rows, |(_, r)| Some(r.matrix.clone()))),
            ("index", integers(&rows, |(_, r)| Some(r.index))),
            ("value", numbers(&rows, |(_, r)| Some(r.value))),
        ],
    )
}

fn sensitivities(finished: &[(&Job, &Outcome)]) -> Table {
    let rows = each(finished, |o| &o.sensitivities);
    table(
        "sensitivities",
        vec![
            ("job_id", texts(&rows, |(of, _)| Some(of.job.to_owned()))),
            ("muscle", texts(&rows, |(_, r)| Some(r.muscle.clone()))),
            ("parameter", texts(&rows, |(_, r)| Some(r.parameter.clone()))),
            ("parameter_value", numbers(&rows, |(_, r)| Some(r.parameter_value))),
            ("mean_force_slope", numbers(&rows, |(_, r)| Some(r.mean_force_slope))),
            ("elasticity", numbers(&rows, |(_, r)| r.elasticity)),
        ],
    )
}

fn optima(finished: &[(&Job, &Outcome)]) -> Table {
    let rows = each(finished, |o| &o.optima);
    table(
        "optima",
        vec![
            ("job_id", texts(&rows, |(of, _)| Some(of.job.to_owned()))),
            ("objective", numbers(&rows, |(_, r)| Some(r.objective))),
            ("starts", integers(&rows, |(_, r)| Some(r.starts))),
            ("idle", texts(&rows, |(_, r)| Some(r.idle.clone()))),
            ("deficiency_a", integers(&rows, |(_, r)| r.deficiency_a)),
            ("deficiency_aj", integers(&rows, |(_, r)| r.deficiency_aj)),
        ],
    )
}

fn trajectories(finished: &[(&Job, &Outcome)]) -> Table {
    let rows = each(finished, |o| &o.trajectories);
    table(
        "trajectories",
        vec![
            ("job_id", texts(&rows, |(of, _)| Some(of.job.to_owned()))),
            ("time_s", numbers(&rows, |(_, r)| Some(r.time_s))),
            ("signal", texts(&rows, |(_, r)| Some(r.signal.clone()))),
            ("name", texts(&rows, |(_, r)| Some(r.name.clone()))),
            ("value", numbers(&rows, |(_, r)| Some(r.value))),
            ("end_effect", flags(&rows, |(_, r)| Some(r.end_effect))),
        ],
    )
}

/// Unit of a column, for the file metadata: of a swept number of the model by the last key of its path.
pub fn unit(column: &str) -> &'static str {
    let by_ending = [
        ("_scale", "1"),
        ("_per_s", "optimal fibre lengths/s"),
        ("max_shortening_velocity", "optimal fibre lengths/s"),
        ("_n_s", "N s"),
        ("_n", "N"),
        ("_hz", "Hz"),
        ("_deg", "degree"),
        ("_rad", "rad"),
        ("_m", "m"),
        ("_s", "s"),
        (".mass", "kg"),
        (".inertia", "kg m²"),
        ("_isometric_force", "N"),
        ("_length", "m"),
        ("ation_time", "s"),
        (".moment", "N m"),
    ];
    match column {
        "effort" | "effort_mesh_error" | "h" => "s",
        "min_fibre_length" | "max_fibre_length" => "optimal fibre lengths",
        "max_constraint_velocity" => "m/s, rad/s",
        "mean_force_slope" => "N per unit of the parameter",
        "ringing" => "optimal fibre lengths/s",
        "noise_sd" => "m, rad",
        _ if column.contains("point.") || column.contains("centre_of_mass.") => "m",
        _ if column.starts_with("gravity.") => "m/s²",
        _ if column.contains(".force.") => "N",
        _ => by_ending.iter().find(|(ending, _)| column.ends_with(ending)).map_or("1", |(_, unit)| unit),
    }
}
