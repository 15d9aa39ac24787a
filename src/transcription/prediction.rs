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
//! - Fibre length: the changes δl that vanish at every point, with δl̇ vanishing where a f_l ≠ 0. Midpoint: the alternating mode
//!   of each muscle with a f_l = 0 at all points, whose contraction equation is algebraic. Radau: none from
//!   equilibrium (that is one more row); with a free start, the initial length of each muscle with a f_l = 0 throughout the first interval.
//! - + the dependent joint constraints at every point: their reactions are not unique, nor, in the stabilised form, η.
//!
//! **A**
//! - Per muscle, those bounds' rows − their rank. An idle muscle gives p − 1 at midpoint, s (p − 1) with radau.
//! - + the dependent joint constraints at every point: of Φ, and in the stabilised form of Φ and Φ_q v together.
//!
//! With μ = 0 and no bound active, [Aᵀ Jᵀ] has `2 nm − (linear rows on l) + P (nm + nc − nq)` + the dependent joint constraints, P the number
//! of complete points, and with radau `nq − nc` more: the velocity at t_1 is not tracked and acts on the first forces only. With active
//! bounds no count is given.

use faer::Mat;

use super::collocation::{BoundKind, Collocation, Combination};
use super::instant::{ACTIVATION, ACTIVATION_RATE, EXCITATION, Form, LENGTH, VELOCITY};
use crate::numerics::rank;

/// Predicted row deficiencies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Prediction {
    pub a: Option<usize>,
    pub aj: Option<usize>,
}

/// What the prediction needs to know beside the problem.
#[derive(Clone, Debug)]
pub struct Setting {
    /// Activations in the objective, muscle by muscle; empty with μ = 0.
    pub sharing: Vec<Vec<Combination>>,
    /// Whether the measured instants fix every motion of the scheme.
    pub motion_is_fixed: bool,
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
pub fn predict(problem: &Collocation<'_>, x: &[f64], active: &[usize], setting: &Setting) -> Prediction {
    let (instant, layout) = (&problem.instant, &problem.layout);
    let model = instant.model;
    let locals: Vec<Vec<f64>> = (0..layout.points.len()).map(|j| problem.local(j, x)).collect();
    let complete: Vec<usize> = (0..layout.points.len()).filter(|&j| layout.points[j].complete).collect();
    let (joints_a, joints_aj, missing_at_start) = dependent_joint_constraints(problem, &locals);

    let (mut a, mut free, mut active_bounds) = (joints_a, 0, 0);
    for (m, muscle) in model.muscles.iter().enumerate() {
        let at = instant.muscle(m);
        let mut rows: Vec<Combination> = Vec::new();
        for bound in active.iter().map(|&row| &problem.bounds[row]).filter(|b| b.muscle == m) {
            let map = &layout.points[bound.point].map;
            match bound.kind {
                BoundKind::Activation | BoundKind::ActivationUpper => rows.push(map[at + ACTIVATION].clone()),
                BoundKind::Excitation | BoundKind::ExcitationUpper => {
                    let z = &locals[bound.point];
                    let (value, rate, u) = (z[at + ACTIVATION], z[at + ACTIVATION_RATE], z[at + EXCITATION]);
                    let slope = muscle.activation_residual(value, rate, u).gradient[0];
                    let mut row = map[at + ACTIVATION_RATE].clone();
                    row.extend(map[at + ACTIVATION].iter().map(|&(column, weight)| (column, slope * weight)));
                    rows.push(row);
                }
                BoundKind::Force => {}
            }
        }
        active_bounds += rows.len();
        a += rows.len() - rank_of(&rows).0;
        if let Some(sharing) = setting.sharing.get(m) {
            rows.extend(sharing.iter().cloned());
            // Rows of zeros, for the unknowns that no other row touches.
            rows.extend(layout.points.iter().map(|p| p.map[at + ACTIVATION].iter().map(|&(c, _)| (c, 0.0)).collect()));
            let (rank, unknowns) = rank_of(&rows);
            free += unknowns - rank;
        }
        // Put to exactly 0 before ranks are taken.
        let idle_throughout = locals.iter().all(|z| z[at + ACTIVATION].abs() <= crate::nlp::polish::ACTIVE);
        let mut rows: Vec<Combination> = Vec::new();
        for (point, z) in layout.points.iter().zip(&locals) {
            // Without activation, or a fibre too short or too long for active force, velocity does not matter.
            let force = muscle.fibre_force(z[at + ACTIVATION], z[at + LENGTH], z[at + VELOCITY]);
            let idle = idle_throughout || force.gradient[2] == 0.0;
            let keep = |row: &Combination, kept: bool| -> Combination {
                row.iter().map(|&(column, weight)| (column, if kept { weight } else { 0.0 })).collect()
            };
            rows.push(keep(&point.map[at + LENGTH], point.complete || muscle.rigid_tendon));
            rows.push(keep(&point.map[at + VELOCITY], point.complete && !idle));
        }
        rows.extend(linear_rows_on_length(problem, m));
        let (rank, unknowns) = rank_of(&rows);
        free += unknowns - rank;
    }

    let aj = if !setting.motion_is_fixed {
        None
    } else if !setting.sharing.is_empty() {
        Some(free + joints_aj)
    } else if active_bounds == 0 {
        let muscles = model.muscles.len();
        let linear: usize = (0..muscles).map(|m| linear_rows_on_length(problem, m).len()).sum();
        // nm + nc − nq may be negative for a model with fewer muscles than degrees of freedom.
        let spare = (muscles + model.constraints()).saturating_sub(model.coordinates());
        let start = match instant.form {
            Form::SecondOrder => 0,
            Form::Stabilised => model.coordinates() - (model.constraints() - missing_at_start),
        };
        Some(2 * muscles - linear + complete.len() * spare + start + joints_aj)
    } else {
        None
    };
    Prediction { a: Some(a), aj }
}

/// The linear rows that tie a muscle's fibre length at the start: those of `initial = "equilibrium"`. The rows that name initial
/// values tie nothing: each has an unknown of its own.
fn linear_rows_on_length(problem: &Collocation<'_>, muscle: usize) -> Vec<Combination> {
    let at = problem.instant.muscle(muscle) + LENGTH;
    let mut columns: Vec<usize> =
        problem.layout.points.iter().flat_map(|p| p.map[at].iter().map(|&(column, _)| column)).collect();
    columns.sort_unstable();
    let is_ours = |row: &&Combination| row.iter().all(|(column, _)| columns.binary_search(column).is_ok());
    problem.layout.linear.iter().filter(is_ours).cloned().collect()
}

/// Dependent rows among the joint constraints of all points; the free reactions (and stabilisers) that follow; and the dependent
/// rows of Φ_q at the first point.
fn dependent_joint_constraints(problem: &Collocation<'_>, locals: &[Vec<f64>]) -> (usize, usize, usize) {
    let (instant, layout) = (&problem.instant, &problem.layout);
    let (nq, nc) = (instant.model.coordinates(), instant.model.constraints());
    let nz = instant.variables();
    let mut jacobian = vec![0.0; instant.equations() * nz];
    let mut force = vec![[0.0; 3]; instant.model.muscles.len()];
    let [constraint_row, ..] = instant.row_starts();
    let (mut rows, mut reactions, mut at_start) = (0, 0, None);
    for ((z, point), &t) in locals.iter().zip(&layout.points).zip(&layout.times) {
        instant.jacobian(t, z, &mut jacobian, &mut force);
        let position = Mat::from_fn(nc, nq, |i, j| jacobian[(constraint_row + i) * nz + j]);
        let missing = nc - rank::by_svd(&position).map_or(nc, |r| r.rank);
        at_start.get_or_insert(missing);
        if instant.form == Form::SecondOrder {
            rows += missing;
            reactions += missing;
            continue;
        }
        let [_, velocity_row] = instant.stabilised_row_starts();
        let both = Mat::from_fn(2 * nc, 2 * nq, |i, j| {
            let row = if i < nc { constraint_row + i } else { velocity_row + i - nc };
            jacobian[row * nz + if j < nq { j } else { instant.velocity(j - nq) }]
        });
        rows += 2 * nc - rank::by_svd(&both).map_or(2 * nc, |r| r.rank);
        reactions += if point.complete { 2 * missing } else { 0 };
    }
    (rows, reactions, at_start.unwrap_or(0))
}
