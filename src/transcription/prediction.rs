//! The rank deficiencies that the pattern of active bounds explains, for the midpoint scheme.
//!
//! Let a muscle's activation have p + 1 coefficients (degree 1, one point in each of p spans), and likewise its fibre
//! length. Then, with μ > 0:
//!
//! **[Aᵀ Jᵀ]**
//! - +1 for each muscle with a = 0 at all points: its contraction equation is algebraic in the fibre length, p equations
//!   for p + 1 coefficients, and the alternating mode is free.
//! - +1, if activation enters the objective at the collocation points only, for each muscle without an active
//!   excitation bound: the alternating mode of its activation vanishes at every point, and u pays for it freely. (With
//!   further instants the mode has a cost; with an active excitation bound, `δȧ + s δa = 0` there removes it.)
//! - + the dependent joint constraints at every point: their reactions are not unique.
//!
//! **A**
//! - Per muscle, the rows `{δa_j : a_j at a bound}` and `{δȧ_j + s_j δa_j : u_j at a bound}`, s_j = u/τ_act + (1 − u)/τ_deact
//!   (for τ_act = τ_deact; in general ∂/∂a of eq. 4), live in p + 1 coefficients: rows − rank.
//! - + the dependent joint constraints at every point.
//!
//! With μ = 0 and no bound active, [Aᵀ Jᵀ] has 2 nm + p (nm + nc − nq) + the dependent joint constraints; with active
//! bounds no count is given.

use faer::Mat;

use super::collocation::{BoundKind, Collocation};
use super::instant::{ACTIVATION, ACTIVATION_RATE, EXCITATION};
use super::midpoint::Midpoint;
use crate::numerics::rank;

/// Predicted row deficiencies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Prediction {
    pub a: Option<usize>,
    pub aj: Option<usize>,
}

/// What the prediction needs to know beside the problem.
#[derive(Clone, Copy, Debug)]
pub struct Setting {
    /// μ > 0
    pub shares_load: bool,
    /// Activation enters the objective at the collocation points only.
    pub at_collocation_points_only: bool,
}

impl Midpoint {
    /// Predicts both deficiencies at a polished point `x` from which `active` bounds (rows of `problem.bounds`) hold.
    pub fn predict(&self, problem: &Collocation<'_>, x: &[f64], active: &[usize], setting: Setting) -> Prediction {
        let instant = &problem.instant;
        let model = instant.model;
        let points = self.points.len();
        let locals: Vec<Vec<f64>> = (0..points).map(|j| problem.local(j, x)).collect();

        let joints: usize = locals
            .iter()
            .map(|z| {
                let rows: Vec<_> =
                    model.joints.iter().flat_map(|j| j.constraints(z).into_iter().map(|f| (j.slots(), f))).collect();
                let mut jacobian = Mat::zeros(rows.len(), model.coordinates());
                for (row, (slots, function)) in rows.iter().enumerate() {
                    for (slot, gradient) in slots.iter().zip(function.gradient) {
                        if let Some(coordinate) = slot {
                            jacobian[(row, *coordinate)] = gradient;
                        }
                    }
                }
                rank::by_svd(&jacobian).map_or(0, |r| rows.len() - r.rank)
            })
            .sum();

        let (mut a, mut idle, mut unbounded_excitation, mut active_bounds) = (joints, 0, 0, 0);
        for (m, muscle) in model.muscles.iter().enumerate() {
            let at = instant.muscle(m);
            let mut rows: Vec<Vec<f64>> = Vec::new();
            let mut excitation_bound = false;
            for bound in active.iter().map(|&row| &problem.bounds[row]).filter(|b| b.muscle == m) {
                let t = self.points[bound.point];
                let mut row = vec![0.0; points + 1];
                let mut add = |derivative: usize, factor: f64| {
                    let basis = self.state.basis(t, derivative);
                    basis.values.iter().enumerate().for_each(|(k, b)| row[basis.first + k] += factor * b);
                };
                match bound.kind {
                    BoundKind::Activation | BoundKind::ActivationUpper => add(0, 1.0),
                    BoundKind::Excitation | BoundKind::ExcitationUpper => {
                        let z = &locals[bound.point];
                        let (value, rate, u) = (z[at + ACTIVATION], z[at + ACTIVATION_RATE], z[at + EXCITATION]);
                        add(1, 1.0);
                        add(0, muscle.activation_residual(value, rate, u).gradient[0]);
                        excitation_bound = true;
                    }
                    BoundKind::Force => continue,
                }
                rows.push(row);
            }
            active_bounds += rows.len();
            let matrix = Mat::from_fn(rows.len(), points + 1, |i, j| rows[i][j]);
            a += rank::by_svd(&matrix).map_or(0, |r| rows.len() - r.rank);
            idle += usize::from(locals.iter().all(|z| z[at + ACTIVATION].abs() <= crate::nlp::polish::ACTIVE));
            unbounded_excitation += usize::from(!excitation_bound);
        }

        let aj = if setting.shares_load {
            let alternating = if setting.at_collocation_points_only { unbounded_excitation } else { 0 };
            Some(idle + alternating + joints)
        } else if active_bounds == 0 {
            let muscles = model.muscles.len();
            // nm + nc − nq may be negative for a model with fewer muscles than degrees of freedom.
            let free = points as i64 * (muscles as i64 + model.constraints() as i64 - model.coordinates() as i64);
            Some((2 * muscles as i64 + free.max(0)) as usize + joints)
        } else {
            None
        };
        Prediction { a: Some(a), aj }
    }
}
