//! The rank deficiencies that the pattern of active bounds explains, for any scheme.
//!
//! A muscle's activation has some coefficients (midpoint: p + 1, radau: one at t_1 and one at each point), and likewise its fibre
//! length. Then, with μ > 0 and enough measured instants to fix the motion:
//!
//! **[Aᵀ Jᵀ]**
//! - Activation: the changes δa that vanish at every instant of the load-sharing grid and meet the active bounds' rows
//!   `{δa_j : a_j at a bound}`, `{δȧ_j + s_j δa_j : u_j at a bound}`, s_j = u/τ_act + (1 − u)/τ_deact (for τ_act = τ_deact; in general ∂/∂a of
//!   eq. 4); u pays for them freely. Midpoint, collocation grid: the alternating mode of each muscle without an active excitation
//!   bound. Else none.
//!   With `excitation_weight` > 0, u pays for none of them: `δȧ_j + s_j δa_j` vanishes at every point.
//! - Fibre length: the changes δl that vanish at every point, with δl̇ vanishing where a f_l ≠ 0. Midpoint: the alternating mode
//!   of each muscle with a f_l = 0 at all points, whose contraction equation is algebraic. Radau: none from
//!   equilibrium (that is one more row); with a free start, the initial length of each muscle with a f_l = 0 throughout the first interval.
//! - + the dependent joint constraints at every point: their reactions are not unique, nor, in the stabilised form, η.
//!
//! **A**
//! - Per muscle, those bounds' rows − their rank. An idle muscle gives p − 1 at midpoint, s (p − 1) with radau.
//! - + the dependent joint constraints at every point: of Φ, and in the stabilised form of Φ and Φ_q v together.
//!
//! Of muscles that make any force (`muscle_dynamics = "force"`) the activations are controls: they have no initial values, and
//! no fibres.
//!
//! With μ = 0 and no bound active, [Aᵀ Jᵀ] has `2 nm − (linear rows on l) + P (nm + nr + nc − nq)` + the dependent joint constraints, nr actuators, P the number
//! of complete points, and with radau `nq − nc` more: the velocity at t_1 is not tracked and acts on the first forces only. With active
//! bounds no count is given.

use faer::Mat;

use super::InverseProblem;
use super::dynamic::effort_instants;
use super::muscle_force::MuscleForce;
use crate::motion::Measurement;
use crate::numerics::rank;
use crate::problem::Bounded;
use crate::settings::{EffortOf, Initial, Settings};
use crate::transcription::collocation::Collocation;
use crate::transcription::scheme::{Combination, Discretisation, quadrature};

/// Predicted row deficiencies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Prediction {
    pub a: Option<usize>,
    pub aj: Option<usize>,
}

/// What the predicted deficiencies depend on in addition to the problem.
#[derive(Clone, Debug)]
pub struct Setting {
    /// Activations in the objective, muscle by muscle; empty with μ = 0.
    pub sharing: Vec<Vec<Combination>>,
    /// Whether excitations are in the objective.
    pub has_excitations: bool,
    /// Whether the measured instants fix every motion of the scheme.
    pub motion_is_fixed: bool,
    /// Whether these counts hold: not where the moments of a given motion tie what the objective leaves open, nor with rates of
    /// activations at the start.
    pub is_counted: bool,
}

impl Setting {
    pub fn new(
        inverse: &InverseProblem<'_>,
        scheme: &dyn Discretisation,
        measurement: &Measurement,
        settings: &Settings,
    ) -> Self {
        let is_given = inverse.motion.is_given;
        let of_excitations = is_given && settings.effort_of == EffortOf::Excitation;
        let instants = match (is_given, of_excitations) {
            (true, true) => Vec::new(),
            (true, false) => quadrature(scheme),
            _ => effort_instants(scheme, measurement, settings),
        };
        let rows = |m| instants.iter().map(|&(t, _)| inverse.activation_at(scheme, t, m)).collect();
        let muscles = if settings.mu > 0.0 || is_given { inverse.muscles.a.count } else { 0 };
        Self {
            sharing: (0..muscles).map(rows).collect(),
            has_excitations: settings.excitation_weight > 0.0 || of_excitations,
            motion_is_fixed: is_given || settings.measured_per_interval() >= settings.points_per_interval(),
            is_counted: !is_given || (!of_excitations && settings.initial != Initial::Steady),
        }
    }
}

/// Rank of rows over the few unknowns they touch, and the number of those.
fn rank_of(rows: &[Combination]) -> (usize, usize) {
    let mut columns: Vec<usize> = rows.iter().flatten().map(|&(column, _)| column).collect();
    columns.sort_unstable();
    columns.dedup();
    let mut matrix = Mat::zeros(rows.len(), columns.len());
    for (row, combination) in rows.iter().enumerate() {
        for &(column, weight) in combination {
            let at = columns.partition_point(|&c| c < column);
            matrix[(row, at)] += weight;
        }
    }
    (rank::by_svd(&matrix).map_or(0, |r| r.rank), columns.len())
}

/// Predicts both deficiencies at a polished point `x` at which the `active` bounds (rows of `problem.bounds`) hold.
pub fn predict(
    inverse: &InverseProblem<'_>,
    problem: &Collocation<'_>,
    x: &[f64],
    active: &[usize],
    setting: &Setting,
) -> Prediction {
    if !setting.is_counted {
        return Prediction { a: None, aj: None };
    }
    let model = inverse.model;
    let locals: Vec<Vec<f64>> = (0..problem.points.len()).map(|j| problem.local(j, x)).collect();
    let joints = dependent_joint_constraints(inverse, problem, &locals);
    let (mut a, mut free) = (joints.rows, 0);
    for m in 0..model.muscles.len() {
        let mut rows = active_rows(inverse, problem, &locals, active, m);
        a += rows.len() - rank_of(&rows).0;
        if let Some(sharing) = setting.sharing.get(m) {
            rows.extend(sharing.iter().cloned());
            if setting.has_excitations && inverse.muscles.u.count > 0 {
                let complete = (0..locals.len()).filter(|&j| problem.points[j].complete);
                rows.extend(complete.map(|j| excitation_row(inverse, problem, &locals[j], j, m)));
            }
            // Rows of zeros, for the unknowns that no other row touches.
            let map = problem.points.iter().map(|point| &point.map.combinations[inverse.muscles.a.at(m)]);
            rows.extend(map.map(|row| row.iter().map(|&(column, _)| (column, 0.0)).collect()));
            let (rank, unknowns) = rank_of(&rows);
            free += unknowns - rank;
        }
        let (rank, unknowns) = rank_of(&fibre_rows(inverse, problem, &locals, m));
        free += unknowns - rank;
    }

    let aj = if !setting.motion_is_fixed {
        None
    } else if !setting.sharing.is_empty() {
        Some(free + joints.free_reactions)
    } else if active.is_empty() {
        let muscles = model.muscles.len();
        let linear: usize = (0..muscles).map(|m| linear_rows_on_length(inverse, problem, m).len()).sum();
        // nm + nc − nq may be negative for a model with fewer muscles than degrees of freedom.
        let spare = (muscles + inverse.actuators.len() + model.mechanics.constraints())
            .saturating_sub(model.mechanics.coordinates());
        let complete = problem.points.iter().filter(|point| point.complete).count();
        let start = match inverse.motion.stabilisation {
            None => 0,
            Some(_) => model.mechanics.coordinates() - (model.mechanics.constraints() - joints.missing_at_start),
        };
        let initial = if inverse.muscles.l.count > 0 { 2 * muscles } else { 0 };
        Some(initial - linear + complete * spare + start + joints.free_reactions)
    } else {
        None
    };
    Prediction { a: Some(a), aj }
}

/// The rows of a muscle's active bounds, over the unknowns of its activation.
fn active_rows(
    inverse: &InverseProblem<'_>,
    problem: &Collocation<'_>,
    locals: &[Vec<f64>],
    active: &[usize],
    m: usize,
) -> Vec<Combination> {
    let muscles = &inverse.muscles;
    let (a, u) = (muscles.a.at(m), muscles.u.get(m));
    let mut rows = Vec::new();
    for bound in active.iter().map(|&row| &problem.bounds[row]) {
        let limit = problem.limit(bound);
        let map = &problem.points[bound.point].map.combinations;
        let variable = match limit.bounded {
            Bounded::Below(variable) | Bounded::Above(variable) => variable,
            Bounded::Function(function) if limit.member == inverse.model.muscles[m].name && limit.name != "force" => {
                rows.push(function_row(problem, &locals[bound.point], bound.point, function));
                continue;
            }
            Bounded::Function(_) => continue,
        };
        if variable == a {
            rows.push(map[a].clone());
        } else if Some(variable) == u {
            rows.push(excitation_row(inverse, problem, &locals[bound.point], bound.point, m));
        }
    }
    rows
}

/// How a function of a limit changes with the unknowns, z being the variables at its point.
fn function_row(problem: &Collocation<'_>, z: &[f64], point: usize, function: usize) -> Combination {
    let control = problem.control;
    let mut slopes = vec![0.0; control.slope_pattern().len()];
    control.slopes(z, &mut slopes);
    let own = control.slope_pattern().iter().zip(slopes).filter(|((row, _), _)| *row == function);
    let of_variable = |(&(_, variable), slope): (&(usize, usize), f64)| {
        let terms = problem.points[point].map.combinations[variable].iter();
        terms.map(move |&(column, weight)| (column, slope * weight)).collect::<Combination>()
    };
    own.flat_map(of_variable).collect()
}

/// What a muscle's excitation at a point is changed by, z being the variables there: `δȧ + s δa`.
fn excitation_row(
    inverse: &InverseProblem<'_>,
    problem: &Collocation<'_>,
    z: &[f64],
    point: usize,
    m: usize,
) -> Combination {
    let muscles = &inverse.muscles;
    let (a, rate, u) = (muscles.a.at(m), muscles.a_rate.at(m), muscles.u.at(m));
    let map = &problem.points[point].map.combinations;
    let slope = -inverse.model.muscles[m].activation.rate(z[a], z[u]).slopes[0];
    let mut row = map[rate].clone();
    row.extend(map[a].iter().map(|&(column, weight)| (column, slope * weight)));
    row
}

/// The rows that fix a muscle's fibre length where its activation and its force are known.
fn fibre_rows(
    inverse: &InverseProblem<'_>,
    problem: &Collocation<'_>,
    locals: &[Vec<f64>],
    m: usize,
) -> Vec<Combination> {
    let (muscles, muscle) = (&inverse.muscles, &inverse.model.muscles[m]);
    let MuscleForce::Contraction(contraction) = &inverse.forces[m] else { return Vec::new() };
    // Put to exactly 0 before ranks are taken.
    let idle_throughout = locals.iter().all(|z| z[muscles.a.at(m)].abs() <= crate::nlp::polish::ACTIVE);
    let mut rows: Vec<Combination> = Vec::new();
    for (point, z) in problem.points.iter().zip(locals) {
        // Without activation, or a fibre too short or too long for active force, velocity does not matter.
        let idle = idle_throughout || contraction.fibre_force(z).gradient[2] == 0.0;
        let keep = |variable: usize, kept: bool| -> Combination {
            let row = point.map.combinations[variable].iter();
            row.map(|&(column, weight)| (column, if kept { weight } else { 0.0 })).collect()
        };
        rows.push(keep(muscles.l.at(m), point.complete || muscle.rigid_tendon));
        rows.push(keep(muscles.l_rate.at(m), point.complete && !idle));
    }
    rows.extend(linear_rows_on_length(inverse, problem, m));
    rows
}

/// The linear rows that tie a muscle's fibre length at the start: those of `initial = "equilibrium"`. The rows that name initial
/// values tie nothing: each has an unknown of its own.
fn linear_rows_on_length(inverse: &InverseProblem<'_>, problem: &Collocation<'_>, muscle: usize) -> Vec<Combination> {
    let Some(at) = inverse.muscles.l.get(muscle) else { return Vec::new() };
    let maps = problem.points.iter().map(|point| &point.map.combinations[at]);
    let mut columns: Vec<usize> = maps.flat_map(|row| row.iter().map(|&(column, _)| column)).collect();
    columns.sort_unstable();
    let is_ours = |row: &&Combination| row.iter().all(|(column, _)| columns.binary_search(column).is_ok());
    problem.linear.iter().filter(is_ours).cloned().collect()
}

/// Dependent joint constraints; see [`dependent_joint_constraints`].
struct DependentJoints {
    /// Dependent rows at all points.
    rows: usize,
    /// Reactions, and stabilisers, that are free therefore.
    free_reactions: usize,
    /// Dependent rows of Φ_q at the first point.
    missing_at_start: usize,
}

/// Counts the dependent rows among the joint constraints of all points.
fn dependent_joint_constraints(
    inverse: &InverseProblem<'_>,
    problem: &Collocation<'_>,
    locals: &[Vec<f64>],
) -> DependentJoints {
    let (control, motion) = (&inverse.control, &inverse.motion);
    let (nq, nc) = (motion.q.count, motion.joints.count);
    let mut slopes = vec![0.0; control.slope_pattern().len()];
    let mut found = DependentJoints { rows: 0, free_reactions: 0, missing_at_start: 0 };
    for (j, (z, point)) in locals.iter().zip(&problem.points).enumerate() {
        control.slopes(z, &mut slopes);
        let mut jacobian = Mat::<f64>::zeros(control.rows(), control.variables());
        for (&(row, variable), value) in control.slope_pattern().iter().zip(&slopes) {
            jacobian[(row, variable)] = *value;
        }
        let position = Mat::from_fn(nc, nq, |i, k| jacobian[(motion.joints.at(i), motion.q.at(k))]);
        let missing = nc - rank::by_svd(&position).map_or(nc, |r| r.rank);
        if j == 0 {
            found.missing_at_start = missing;
        }
        let (Some(stabilisation), Some(rates)) = (motion.stabilisation, motion.rates) else {
            found.rows += missing;
            found.free_reactions += missing;
            continue;
        };
        let both = Mat::from_fn(2 * nc, 2 * nq, |i, k| {
            let row = if i < nc { motion.joints.at(i) } else { stabilisation.joint_velocities.at(i - nc) };
            jacobian[(row, if k < nq { motion.q.at(k) } else { rates.at(k - nq) })]
        });
        found.rows += 2 * nc - rank::by_svd(&both).map_or(2 * nc, |r| r.rank);
        found.free_reactions += if point.complete { 2 * missing } else { 0 };
    }
    found
}
