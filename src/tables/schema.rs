//! The only list of the columns of every table. `sinew describe` and `results/README.md` are made from it.

use super::axes::{BEFORE_AXES, ColumnKind};
use super::column::{Column, ColumnInfo, table};
use super::{Table, axes};
use crate::error::nearest;
use crate::outcome::{
    IterationRow, JobRow, JointRow, MuscleRow, OptimumRow, Outcome, RegularityRow, ReserveRow, SensitivityRow,
    SpectrumRow, StepRow, TrajectoryRow,
};
use crate::study::file::{Measure, Ratio};
use crate::study::{Job, Study};

pub use super::axes::axes;

/// Version of the columns' names, types and meanings.
pub const VERSION: u32 = crate::study::SCHEMA_VERSION;

/// Names of the tables, which are the file names without `.parquet`.
pub const TABLES: [&str; 11] = [
    "jobs",
    "regularity",
    "iterations",
    "muscles",
    "reserves",
    "joints",
    "ratios",
    "spectrum",
    "sensitivities",
    "optima",
    "trajectories",
];

/// Tables that exist only if a study asks for them; they are omitted if empty.
pub const ON_REQUEST: [&str; 4] = ["reserves", "joints", "ratios", "trajectories"];

/// Columns with computing times: the only ones in which two runs of a study may differ.
pub const TIMINGS: [&str; 3] = ["solve_s", "rank_s", "wall_s"];

/// The table of a name.
///
/// # Errors
/// If there is none: what is wrong, and which tables there are.
pub fn named(name: &str) -> Result<&'static str, String> {
    TABLES.into_iter().find(|table| *table == name).ok_or_else(|| {
        let near = nearest(name, TABLES).map(|near| format!("did you mean `{near}`? ")).unwrap_or_default();
        format!("there is no table `{name}`; {near}available tables: {}", TABLES.join(", "))
    })
}

/// What one row of a table is.
pub fn row_of(table: &str) -> &'static str {
    match table {
        "jobs" => "a job, including failed ones; the columns between `index` and `status` are the swept axes",
        "regularity" => "a job whose ranks were computed: ranks, verdicts on uniqueness, and what is free",
        "iterations" => "an SQP iteration of the best start of a job; the start guess is number 0",
        "muscles" => "a muscle of a job that has a last iterate; only those of converged jobs are reliable",
        "reserves" => "a reserve or actuator of a job with a last iterate (only if a job has one)",
        "joints" => {
            "a joint of a spatial model, of a job with a last iterate: the load on its child (joint contact load); none where a muscle has a `length`, but no path"
        }
        "ratios" => "a declared load ratio of a job, by measure (only if the study declares one)",
        "spectrum" => "a singular value near the cut between kept and dropped ones",
        "sensitivities" => "how the mean force of a muscle depends on a parameter, at a converged solution",
        "optima" => "an optimum found by the starts of a job, the lowest first",
        "trajectories" => "a value of a function of time (only with `trajectories = true`)",
        _ => "",
    }
}

/// Columns that distinguish the rows of a job.
pub fn row_keys(table: &str) -> &'static [&'static str] {
    match table {
        "iterations" => &["iteration"],
        "muscles" => &["muscle"],
        "reserves" => &["coordinate", "actuator"],
        "joints" => &["joint"],
        "ratios" => &["ratio", "measure"],
        "spectrum" => &["matrix", "index"],
        "sensitivities" => &["muscle", "parameter"],
        "trajectories" => &["time_s", "signal", "name"],
        _ => &[], // one row per job; the order of optima distinguishes them
    }
}

/// The columns of a table, except those of swept axes.
pub fn columns_of(table: &str) -> Vec<ColumnInfo> {
    fn of<R>(columns: Vec<Column<R>>) -> Vec<ColumnInfo> {
        columns.into_iter().map(|column| column.about).collect()
    }
    match table {
        "jobs" => of(jobs()),
        "regularity" => of(regularity()),
        "iterations" => of(iterations()),
        "muscles" => of(muscles()),
        "reserves" => of(reserves()),
        "joints" => of(joints()),
        "ratios" => of(ratios()),
        "spectrum" => of(spectrum()),
        "sensitivities" => of(sensitivities()),
        "optima" => of(optima()),
        "trajectories" => of(trajectories()),
        _ => Vec::new(),
    }
}

/// Unit of a column of a table: `1` for a dimensionless number, empty for counts, flags and texts.
pub fn unit(table: &str, column: &str) -> &'static str {
    let own = columns_of(table).into_iter().find(|about| about.name == column);
    own.map_or_else(|| axes::unit(column), |about| about.unit)
}

/// What the tables of a study depend on in addition to its outcomes.
pub struct Columns<'s> {
    axes: Vec<(&'s str, ColumnKind)>,
    ratios: &'s [Ratio],
}

impl<'s> Columns<'s> {
    pub fn of(study: &'s Study) -> Self {
        let axes = study.axes.iter().enumerate().map(|(i, name)| (name.as_str(), ColumnKind::of(study, i))).collect();
        Self { axes, ratios: &study.ratios }
    }

    /// All tables for the given finished jobs, in their order.
    pub fn tables(&self, finished: &[(&Job, &Outcome)]) -> Vec<Table> {
        let ratio_rows: Vec<Vec<RatioRow<'_>>> =
            finished.iter().map(|(_, outcome)| ratio_rows(outcome, self.ratios)).collect();
        let ratio_lines: Vec<Line<'_, RatioRow<'_>>> = (finished.iter().zip(&ratio_rows))
            .flat_map(|((job, outcome), rows)| rows.iter().map(|row| Line::new(job, outcome, row)))
            .collect();
        vec![
            self.jobs(finished),
            table("regularity", &regularity(), &lines(finished, |o| o.regularity.as_slice())),
            table("iterations", &iterations(), &lines(finished, |o| &o.iterations)),
            table("muscles", &muscles(), &lines(finished, |o| &o.muscles)),
            table("reserves", &reserves(), &lines(finished, |o| &o.reserves)),
            table("joints", &joints(), &lines(finished, |o| &o.joints)),
            table("ratios", &ratios(), &ratio_lines),
            table("spectrum", &spectrum(), &lines(finished, |o| &o.spectrum)),
            table("sensitivities", &sensitivities(), &lines(finished, |o| &o.sensitivities)),
            table("optima", &optima(), &lines(finished, |o| &o.optima)),
            table("trajectories", &trajectories(), &lines(finished, |o| &o.trajectories)),
        ]
    }

    fn jobs(&self, finished: &[(&Job, &Outcome)]) -> Table {
        let mut table = table("jobs", &jobs(), &lines(finished, |o| std::slice::from_ref(&o.job)));
        let after = table.columns.split_off(BEFORE_AXES.len());
        for (axis, (name, kind)) in self.axes.iter().enumerate() {
            let values: Vec<_> = finished.iter().map(|(job, _)| job.swept[axis].as_ref()).collect();
            table.columns.push(((*name).to_owned(), kind.values(&values)));
        }
        table.columns.extend(after);
        table
    }
}

/// A row of an outcome, with its job.
struct Line<'o, R> {
    job: &'o Job,
    status: &'static str,
    row: &'o R,
}

impl<'o, R> Line<'o, R> {
    fn new(job: &'o Job, outcome: &Outcome, row: &'o R) -> Self {
        Self { job, status: outcome.job.status.name(), row }
    }
}

/// Every row of one kind, with its job.
fn lines<'o, R>(finished: &[(&'o Job, &'o Outcome)], rows: fn(&'o Outcome) -> &'o [R]) -> Vec<Line<'o, R>> {
    finished.iter().flat_map(|(job, outcome)| rows(outcome).iter().map(|row| Line::new(job, outcome, row))).collect()
}

fn job_id<'o, R>() -> Column<Line<'o, R>> {
    Column::text(
        "job_id",
        "hash of everything that determines the result: equal jobs have the same id everywhere",
        |l| Some(l.job.id.clone()),
    )
}

fn status<'o, R>() -> Column<Line<'o, R>> {
    Column::text("status", "status of the job, as in `jobs`", |l| Some(l.status.to_owned()))
}

fn jobs<'o>() -> Vec<Column<Line<'o, JobRow>>> {
    use Column as C;
    vec![
        job_id(),
        C::integer("index", "position in the study, from 0", |l| Some(l.job.index as i64)),
        C::text(
            "status",
            "`converged`, or how the job failed: `iteration_limit`, `time_limit`, `qp_failed` (a quadratic sub-problem \
             was not solved), `stalled` (no step was accepted), `infeasible` (constraints contradict each other), \
             `non_finite`, `invalid` (could not be set up), `panicked` (a bug; please report it)",
            |l| Some(l.status.to_owned()),
        ),
        C::text("error", "why the job failed", |l| l.row.error.clone()),
        C::text("warnings", "codes of warnings, separated by `, `; see the table of warnings", |l| {
            l.row.warnings.clone()
        }),
        C::text("remark", "what the warnings found, and how the job was started if not as usual", |l| {
            l.row.remark.clone()
        }),
        C::integer("iterations", "SQP iterations of the best start", |l| l.row.iterations),
        C::integer("factorisations", "factorisations of KKT matrices, for all starts and the analysis together", |l| {
            l.row.factorisations
        }),
        C::number("objective", "1", "half the sum of squared residuals (tracking and load sharing), eq. (26)", |l| {
            l.row.objective
        }),
        C::number("effort", "s", "∫ Σ a² dt over all muscles", |l| l.row.effort),
        C::number(
            "actuator_effort",
            "s",
            "∫ Σ r² dt over the controls of reserves and actuators; null without any",
            |l| l.row.actuator_effort,
        ),
        C::number("control_effort", "s", "∫ Σ u² dt over all excitations and controls", |l| l.row.control_effort),
        C::number(
            "effort_mesh_error",
            "s",
            "estimated discretisation error of the effort: computed minus exact, a rough figure; radau only, null \
             where no estimate is possible (then there is no warning `mesh` either)",
            |l| l.row.effort_mesh_error,
        ),
        C::number("tracking_rms_m", "m", "RMS error of the positions of the bodies at the measured instants", |l| {
            l.row.tracking_rms_m
        }),
        C::number("tracking_rms_deg", "degree", "RMS error of the orientations of the bodies", |l| {
            l.row.tracking_rms_deg
        }),
        C::integer("n_starts", "number of starts made", |l| l.row.n_starts),
        C::integer("n_converged_starts", "number of starts that converged", |l| l.row.n_converged_starts),
        C::integer("n_distinct_optima", "number of different optima found; see `optima`", |l| l.row.n_distinct_optima),
        C::number(
            "stationarity",
            "1",
            "largest entry of the Lagrangian's gradient, relative to the objective's",
            |l| l.row.stationarity,
        ),
        C::number(
            "feasibility",
            "1",
            "largest violation: |eq. (1)| over the weight, |eq. (3)| in normalised force, |Φ| in m or rad, \
             |eq. (4)|·τ, bounds",
            |l| l.row.feasibility,
        ),
        C::number("complementarity", "1", "largest |slack of a bound × its multiplier|", |l| l.row.complementarity),
        C::integer("n_variables", "number of unknowns", |l| l.row.n_variables),
        C::integer("n_equalities", "number of equality constraints", |l| l.row.n_equalities),
        C::integer("n_active", "number of active bounds on activations, excitations and controls", |l| l.row.n_active),
        C::integer(
            "n_active_force",
            "number of active conditions f_m ≥ 0, which are imposed if a ≥ 0 is not; the thesis' ranks exclude them",
            |l| l.row.n_active_force,
        ),
        C::number("min_activation", "1", "smallest activation of any muscle", |l| l.row.min_activation),
        C::number("max_activation", "1", "largest activation of any muscle", |l| l.row.max_activation),
        C::number(
            "max_constraint_velocity",
            "m/s, rad/s",
            "largest |Φ_q q̇| at the points: how far the velocities violate the joints; at rounding level with radau",
            |l| l.row.max_constraint_velocity,
        ),
        C::number(
            "mid_interval_error",
            "1",
            "largest residual midway between the points: |eq. (1)| over the weight, |eq. (3)| in normalised force, \
             |Φ| in m, and |eq. (4)|·τ; null if it overflows",
            |l| l.row.mid_interval_error,
        ),
        C::flag("polished", "active bounds hold exactly where the ranks were computed; false if that failed", |l| {
            l.row.polished
        }),
        C::text("warm_start_from", "id of the job whose solution this one started from", |l| {
            l.row.warm_start_from.clone()
        }),
        C::number("solve_s", "s", "time for all starts", |l| l.row.solve_s),
        C::number("rank_s", "s", "time for ranks, intervals and sensitivities", |l| l.row.rank_s),
        C::number("wall_s", "s", "time of the whole job", |l| l.row.wall_s),
    ]
}

fn regularity<'o>() -> Vec<Column<Line<'o, RegularityRow>>> {
    use Column as C;
    vec![
        job_id(),
        status(),
        C::integer("rows_a", "rows of A, the Jacobian of all equalities and active bounds", |l| Some(l.row.a.size)),
        C::integer("rank_a", "rank of A at MATLAB's tolerance", |l| Some(l.row.a.rank)),
        C::integer("deficiency_a", "rows minus rank of A (the thesis prints it negative)", |l| {
            Some(l.row.a.deficiency)
        }),
        C::integer("predicted_deficiency_a", "the deficiency of A that the pattern of active bounds explains", |l| {
            l.row.a.predicted
        }),
        C::integer(
            "columns_aj",
            "columns of [A; J], the number of unknowns; J is the Jacobian of the residuals",
            |l| Some(l.row.aj.size),
        ),
        C::integer("rank_aj", "rank of [Aᵀ Jᵀ] at MATLAB's tolerance", |l| Some(l.row.aj.rank)),
        C::integer("deficiency_aj", "unknowns minus rank of [Aᵀ Jᵀ]: directions that are free", |l| {
            Some(l.row.aj.deficiency)
        }),
        C::integer("predicted_deficiency_aj", "the deficiency of [Aᵀ Jᵀ] that the pattern explains", |l| {
            l.row.aj.predicted
        }),
        C::integer("deficiency_a_with_force", "that of A with the active conditions f_m ≥ 0 as further rows", |l| {
            l.row.deficiency_a_with_force
        }),
        C::integer("deficiency_aj_with_force", "that of [Aᵀ Jᵀ] with these further rows", |l| {
            l.row.deficiency_aj_with_force
        }),
        C::number("tolerance_a", "1", "singular values of A below it count as 0", |l| Some(l.row.a.tolerance)),
        C::number("tolerance_aj", "1", "singular values of [Aᵀ Jᵀ] below it count as 0", |l| {
            Some(l.row.aj.tolerance)
        }),
        C::number("sigma_max_a", "1", "largest singular value of A", |l| l.row.a.sigma_max),
        C::number("sigma_max_aj", "1", "largest singular value of [Aᵀ Jᵀ]", |l| l.row.aj.sigma_max),
        C::number("sigma_last_kept_a", "1", "smallest singular value of A that is kept", |l| l.row.a.sigma_last_kept),
        C::number("sigma_last_kept_aj", "1", "smallest singular value of [Aᵀ Jᵀ] that is kept", |l| {
            l.row.aj.sigma_last_kept
        }),
        C::number("sigma_first_dropped_a", "1", "largest singular value of A that counts as 0", |l| {
            l.row.a.sigma_first_dropped
        }),
        C::number("sigma_first_dropped_aj", "1", "largest singular value of [Aᵀ Jᵀ] that counts as 0", |l| {
            l.row.aj.sigma_first_dropped
        }),
        C::flag(
            "ambiguous",
            "the singular values have no clear gap at the cut, so the deficiency depends on the tolerance",
            |l| Some(l.row.ambiguous),
        ),
        C::flag(
            "prediction_agrees",
            "some cut between 1e-15 and 1e-9 of the largest singular value gives the predicted deficiencies",
            |l| l.row.prediction_agrees,
        ),
        C::flag("multipliers_unique", "A has full rank: the multipliers are unique", |l| l.row.multipliers_unique),
        C::flag(
            "answer_unique",
            "[Aᵀ Jᵀ] has full rank: excitations, activations, fibre lengths, reactions and motion are unique to first \
             order",
            |l| l.row.answer_unique,
        ),
        C::flag(
            "loads_unique",
            "no free direction changes the force of a muscle at a collocation point: the load sharing is determined",
            |l| l.row.loads_unique,
        ),
        C::flag(
            "unique",
            "both deficiencies are 0, the criterion of the thesis; often false although the answer is unique, since \
             the bounds of an idle muscle are dependent",
            |l| Some(l.row.multipliers_unique? && l.row.answer_unique?),
        ),
        C::text("null_space", "description of what is free", |l| l.row.null_space.clone()),
    ]
}

fn iterations<'o>() -> Vec<Column<Line<'o, IterationRow>>> {
    use Column as C;
    vec![
        job_id(),
        C::integer("iteration", "from 0, the start guess", |l| Some(l.row.iteration)),
        C::number("objective", "1", "half the sum of squared residuals", |l| Some(l.row.objective)),
        C::number("stationarity", "1", "KKT residual, of the scaled problem", |l| Some(l.row.stationarity)),
        C::number("feasibility", "1", "KKT residual", |l| Some(l.row.feasibility)),
        C::number("complementarity", "1", "KKT residual", |l| Some(l.row.complementarity)),
        C::number("step_norm", "1", "2-norm of the step taken", |l| Some(l.row.step_norm)),
        C::number("distance_to_solution", "1", "2-norm of the distance to the last iterate", |l| {
            Some(l.row.distance_to_solution)
        }),
        C::integer("qp_iterations", "iterations of the quadratic sub-problem", |l| Some(l.row.qp_iterations)),
        C::text(
            "way",
            "how the step's quadratic sub-problem was solved: `active_set`, `interior_point` (with the exact Hessian; `_convex`, without \
             its negative curvature; `_gauss_newton`, JᵀJ), `clarabel`; or `restoration` of feasibility",
            |l| step(l).map(|step| step.way.clone()),
        ),
        C::number("damping", "1", "δ, the weight of the proximal term beside the Hessian", |l| step(l)?.damping),
        C::number("step_fraction", "1", "α, the share of the step that the line search took", |l| step(l)?.fraction),
        C::integer("refusals", "steps refused at this iterate", |l| Some(step(l)?.refusals)),
        C::number(
            "leap",
            "1",
            "length, in steps, of the leap along almost flat directions that took the step's place; 0 if none",
            |l| Some(step(l)?.leap),
        ),
        C::number("extension", "1", "how many times as long the step was made afterwards; 0 if not", |l| {
            Some(step(l)?.extension)
        }),
        C::integer("factorisations", "of the KKT matrix, for this step", |l| Some(step(l)?.factorisations)),
        C::integer("deficiency_a", "as in `regularity`, at this iterate", |l| l.row.deficiency_a),
        C::integer("deficiency_aj", "as in `regularity`, at this iterate", |l| l.row.deficiency_aj),
    ]
}

fn step<'o>(line: &Line<'o, IterationRow>) -> Option<&'o StepRow> {
    line.row.step.as_ref()
}

fn muscles<'o>() -> Vec<Column<Line<'o, MuscleRow>>> {
    use Column as C;
    vec![
        job_id(),
        status(),
        C::text("muscle", "name of the muscle", |l| Some(l.row.muscle.clone())),
        C::number("mean_activation", "1", "mean over time", |l| Some(l.row.mean_activation)),
        C::number(
            "mean_activation_low",
            "1",
            "least mean activation over all answers that are equally good to first order",
            |l| l.row.mean_activation_low,
        ),
        C::number("mean_activation_high", "1", "greatest of these; equal to the least if it is unique", |l| {
            l.row.mean_activation_high
        }),
        C::number("peak_activation", "1", "largest at a collocation point", |l| Some(l.row.peak_activation)),
        C::number("peak_excitation", "1", "largest at a collocation point", |l| l.row.peak_excitation),
        C::number("saturated_share", "1", "share of the time with an activation of 1", |l| Some(l.row.saturated_share)),
        C::number(
            "left_out_share",
            "1",
            "share of the time in which the muscle has no strength, because of its length or its velocity, and is left out; null \
             with `dynamic`",
            |l| l.row.left_out_share,
        ),
        C::number("mean_force_n", "N", "mean tendon force", |l| Some(l.row.mean_force_n)),
        C::number(
            "mean_force_mesh_error_n",
            "N",
            "estimated discretisation error of the mean force: computed minus exact, a rough figure; radau only",
            |l| l.row.mean_force_mesh_error_n,
        ),
        C::number(
            "mean_force_near_low_n",
            "N",
            "least mean force where the cost is higher by no more than `near_optimal` times the muscles' part of it; exact with \
             `static`, else an estimate; null if not asked for, if a programme failed, or if the model of the estimate is not convex",
            |l| l.row.mean_force_near_low_n,
        ),
        C::number("mean_force_near_high_n", "N", "greatest of these", |l| l.row.mean_force_near_high_n),
        C::number("peak_force_n", "N", "largest tendon force", |l| Some(l.row.peak_force_n)),
        C::number("impulse_n_s", "N s", "integral of the tendon force", |l| Some(l.row.impulse_n_s)),
        C::number("min_force_n", "N", "smallest tendon force", |l| Some(l.row.min_force_n)),
        C::number("peak_passive_force_n", "N", "largest passive force of the fibres", |l| {
            Some(l.row.peak_passive_force_n)
        }),
        C::number("min_fibre_length", "optimal fibre lengths", "shortest fibre length", |l| l.row.min_fibre_length),
        C::number("max_fibre_length", "optimal fibre lengths", "longest fibre length", |l| l.row.max_fibre_length),
        C::flag("idle", "the activation is 0 at every collocation point (|a| ≤ 1e-8)", |l| Some(l.row.idle)),
        C::number(
            "ringing",
            "optimal fibre lengths/s",
            "largest |v_{j+1} − 2 v_j + v_{j−1}|/4 of the fibre velocity: amplitude of an alternation from point to \
             point",
            |l| l.row.ringing,
        ),
        C::number("direction_changes", "1", "share of points at which the fibre velocity turns up or down", |l| {
            l.row.direction_changes
        }),
        C::number("peak_fibre_velocity_per_s", "optimal fibre lengths/s", "largest |fibre velocity|", |l| {
            l.row.peak_fibre_velocity_per_s
        }),
        C::number(
            "excitation_swings",
            "1",
            "total variation of the excitation over twice its range: 1 if it rises and falls once, 0 if the range is below 0.001",
            |l| l.row.excitation_swings,
        ),
    ]
}

/// A declared load ratio of a job.
struct RatioRow<'s> {
    ratio: &'s str,
    measure: Measure,
    /// `None` if the denominator is 0.
    value: Option<f64>,
}

/// The declared load ratios of a job; none if it has no muscle rows.
fn ratio_rows<'s>(outcome: &Outcome, ratios: &'s [Ratio]) -> Vec<RatioRow<'s>> {
    let mut rows = Vec::new();
    for ratio in ratios.iter().filter(|_| !outcome.muscles.is_empty()) {
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
            rows.push(RatioRow { ratio: &ratio.name, measure, value });
        }
    }
    rows
}

fn ratios<'o>() -> Vec<Column<Line<'o, RatioRow<'o>>>> {
    use Column as C;
    vec![
        job_id(),
        status(),
        C::text("ratio", "its name in the study", |l| Some(l.row.ratio.to_owned())),
        C::text("measure", "`mean_force`, `peak_force`, `impulse` or `activation`", |l| {
            Some(l.row.measure.name().to_owned())
        }),
        C::number("value", "1", "numerator over denominator; null if the denominator is 0", |l| l.row.value),
    ]
}

fn spectrum<'o>() -> Vec<Column<Line<'o, SpectrumRow>>> {
    use Column as C;
    vec![
        job_id(),
        C::text("matrix", "`a` for A, `aj` for [Aᵀ Jᵀ]", |l| Some(l.row.matrix.clone())),
        C::integer("index", "from 0, the largest first", |l| Some(l.row.index)),
        C::number("value", "1", "the singular value", |l| Some(l.row.value)),
    ]
}

fn reserves<'o>() -> Vec<Column<Line<'o, ReserveRow>>> {
    use Column as C;
    vec![
        job_id(),
        status(),
        C::text("coordinate", "name of the joint coordinate", |l| Some(l.row.coordinate.clone())),
        C::text("actuator", "name of the actuator; of a reserve `reserve.` and that of its coordinate", |l| {
            Some(l.row.actuator.clone())
        }),
        C::flag("is_reserve", "true for a reserve, false for an actuator of the model", |l| Some(l.row.is_reserve)),
        C::number("peak_moment_n_m", "N m", "largest moment, of an angle", |l| l.row.peak_moment_n_m),
        C::number("rms_moment_n_m", "N m", "root mean square of the moment over time", |l| l.row.rms_moment_n_m),
        C::number("peak_force_n", "N", "largest force, of a displacement", |l| l.row.peak_force_n),
        C::number("rms_force_n", "N", "root mean square of the force over time", |l| l.row.rms_force_n),
        C::number(
            "share",
            "1",
            "peak relative to the peak of the net moment or force of muscles and actuators at this coordinate; null \
             where joints close a loop; of a floating base, where it is a residual, relative to the weight of all bodies \
             (times 1 m)",
            |l| l.row.share,
        ),
    ]
}

fn joints<'o>() -> Vec<Column<Line<'o, JointRow>>> {
    use Column as C;
    vec![
        job_id(),
        status(),
        C::text("joint", "name of the joint", |l| Some(l.row.joint.clone())),
        C::number("mean_force_n", "N", "size of the force on the child at the joint, mean over time", |l| {
            Some(l.row.mean_force_n)
        }),
        C::number("peak_force_n", "N", "its largest value", |l| Some(l.row.peak_force_n)),
        C::number("mean_force_bw", "body weights", "the mean in weights of all bodies", |l| l.row.mean_force_bw),
        C::number("peak_force_bw", "body weights", "the largest value in weights of all bodies", |l| {
            l.row.peak_force_bw
        }),
        C::number("mean_moment_n_m", "N m", "size of the moment on the child at the joint, mean over time", |l| {
            Some(l.row.mean_moment_n_m)
        }),
        C::number("peak_moment_n_m", "N m", "its largest value", |l| Some(l.row.peak_moment_n_m)),
    ]
}

fn sensitivities<'o>() -> Vec<Column<Line<'o, SensitivityRow>>> {
    use Column as C;
    vec![
        job_id(),
        C::text("muscle", "name of the muscle", |l| Some(l.row.muscle.clone())),
        C::text("parameter", "`mu`, or the path of a numeric parameter of the model", |l| {
            Some(l.row.parameter.clone())
        }),
        C::number("parameter_value", "unit of the parameter", "its value in this job", |l| Some(l.row.parameter_value)),
        C::number("mean_force_slope", "N per unit of the parameter", "∂(mean force)/∂(parameter)", |l| {
            Some(l.row.mean_force_slope)
        }),
        C::number("elasticity", "1", "% of mean force per % of the parameter; null for a force of 0", |l| {
            l.row.elasticity
        }),
    ]
}

fn optima<'o>() -> Vec<Column<Line<'o, OptimumRow>>> {
    use Column as C;
    vec![
        job_id(),
        C::number("objective", "1", "lowest objective of the starts that ended there", |l| Some(l.row.objective)),
        C::integer("starts", "number of starts that ended there", |l| Some(l.row.starts)),
        C::text("idle", "muscles without activation, separated by `, `", |l| Some(l.row.idle.clone())),
        C::integer("deficiency_a", "as in `regularity`, at this optimum", |l| l.row.deficiency_a),
        C::integer("deficiency_aj", "as in `regularity`, at this optimum", |l| l.row.deficiency_aj),
    ]
}

fn trajectories<'o>() -> Vec<Column<Line<'o, TrajectoryRow>>> {
    use Column as C;
    vec![
        job_id(),
        C::number("time_s", "s", "time, as in the motion file", |l| Some(l.row.time_s)),
        C::text(
            "signal",
            "`coordinate`, `measured`, `acceleration` (the unknowns of the motion: m, rad), \
             `joint_coordinate`, `measured_joint_coordinate` (m, rad), `activation`, `excitation` (1), `fibre_length` \
             (optimal fibre lengths), `fibre_velocity` (optimal fibre lengths/s), `force_n`, `reaction_n`, `actuator_force_n` (N), \
             `actuator_moment_n_m` (N m), `net_moment_n_m`, `net_force_n` (of all muscles and actuators at a joint \
             coordinate), `joint_force_n`, `joint_moment_n_m` (on a joint's child at the joint, in the axes of ground, parent \
             and child), `path_point_m`, `bone_point_m` (m), `bound_active` (0 or 1)",
            |l| Some(l.row.signal.clone()),
        ),
        C::text("name", "of the coordinate, muscle, joint or bound", |l| Some(l.row.name.clone())),
        C::number("value", "by signal", "value at that time, in the unit of the signal", |l| Some(l.row.value)),
        C::flag(
            "end_effect",
            "reactions and accelerations of the first and last four points, which ring (midpoint)",
            |l| Some(l.row.end_effect),
        ),
    ]
}
