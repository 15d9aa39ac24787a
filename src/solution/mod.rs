//! Turns a solution into rows: loads, activations, residuals of the unscaled problem, functions of time.

mod actuators;
mod joints;
mod muscles;
mod trajectories;

pub use muscles::moves_load;

use nalgebra::{DMatrix, DVector};

use crate::methods::InverseProblem;
use crate::model::Model;
use crate::motion::Measurement;
use crate::nlp::iterate::Iterate;
use crate::nlp::polish::active;
use crate::nlp::problem::Problem;
use crate::numerics::larger;
use crate::outcome::{JobRow, Status};
use crate::problem::{Kind, QuantityId};
use crate::settings::BoundKind;
use crate::transcription::collocation::Collocation;
use crate::transcription::scheme::{Combination, LocalMap, evaluate, gauss};

/// A solved problem.
pub struct Solution<'s> {
    pub inverse: &'s InverseProblem<'s>,
    pub problem: &'s Collocation<'s>,
    pub measurement: &'s Measurement,
    pub iterate: &'s Iterate,
}

impl Solution<'_> {
    fn model(&self) -> &Model {
        self.inverse.model
    }

    /// z at every collocation point.
    fn locals(&self) -> Vec<Vec<f64>> {
        (0..self.problem.points.len()).map(|j| self.problem.local(j, &self.iterate.x)).collect()
    }

    /// z at the points where every function has a value.
    fn complete_locals(&self) -> Vec<Vec<f64>> {
        let points = &self.problem.points;
        (0..points.len()).filter(|&j| points[j].complete).map(|j| self.problem.local(j, &self.iterate.x)).collect()
    }

    fn duration(&self) -> f64 {
        let breakpoints = self.problem.scheme.breakpoints();
        breakpoints[breakpoints.len() - 1] - breakpoints[0]
    }

    fn activation(&self, t: f64, muscle: usize) -> f64 {
        evaluate(&self.activation_combination(t, muscle), &self.iterate.x)
    }

    fn activation_combination(&self, t: f64, muscle: usize) -> Combination {
        self.inverse.activation_at(self.problem.scheme, t, muscle)
    }

    /// The coordinates that move by forces, or a derivative of them, at time t (s).
    fn coordinates(&self, t: f64, derivative: usize) -> Vec<f64> {
        let motion = &self.inverse.motion;
        if motion.is_given {
            let z = self.inverse.control.given_at(t);
            let levels = [Some(motion.all), motion.rates, Some(motion.all_accelerations)];
            let span = levels[derivative].expect("a given motion has its derivatives");
            return span.of(&z)[..motion.q.count].to_vec();
        }
        let at = |i| evaluate(&self.inverse.coordinate_at(self.problem.scheme, t, derivative, i), &self.iterate.x);
        (0..motion.q.count).map(at).collect()
    }

    /// Joint reactions at a point, N: unknowns, or what is left of eq. (1) where they are eliminated.
    pub fn reactions(&self, z: &[f64]) -> Vec<f64> {
        let (motion, mechanics) = (&self.inverse.motion, &self.model().mechanics);
        if motion.reaction.is_some() {
            return motion.reactions.of(z).iter().map(|reaction| self.model().weight() * reaction).collect();
        }
        if mechanics.constraints() == 0 {
            return Vec::new();
        }
        let (nq, q) = (motion.q.count, motion.all.of(z));
        let mut left = DVector::from(self.inverse.generalised_forces(z));
        let mut slopes = DMatrix::zeros(nq, mechanics.constraints());
        mechanics.constraint_functions(q, &mut |row, slots, _, gradient, _| {
            let own = slots.iter().zip(gradient).filter(|(slot, _)| **slot < nq);
            own.for_each(|(&slot, slope)| slopes[(slot, row)] += slope);
        });
        left.neg_mut();
        let found = slopes.svd(true, true).solve(&left, 1e-12);
        found.map_or_else(|_| Vec::new(), |reactions| reactions.iter().copied().collect())
    }

    /// The job's row, without status, starts and times.
    pub fn job_row(&self) -> JobRow {
        let (problem, iterate) = (self.problem, self.iterate);
        let muscles = &self.inverse.muscles;
        let with_activations = self.inverse.points_with_activations(problem);
        let locals: Vec<Vec<f64>> = with_activations.iter().map(|&j| problem.local(j, &iterate.x)).collect();
        let at_points = || locals.iter().flat_map(|z| self.inverse.muscles.a.of(z).iter().copied());
        // A motion that is given is not tracked, and instants on their own have nothing between them.
        let is_given = self.inverse.motion.is_given;
        let is_continuous = self.inverse.control.quantity(muscles.activation).kind.is_state();
        let (rms_m, rms_deg) = if is_given { (None, None) } else { self.tracking_rms() };
        let active = active(&iterate.inequalities);
        let force = (0..active.len()).filter(|&row| active[row] && is_force(problem, row)).count();
        let [stationarity, complementarity] = self.unscaled_errors();
        let max_activation = at_points().fold(f64::NEG_INFINITY, f64::max);
        JobRow {
            objective: Some(iterate.objective),
            effort: Some(self.square(muscles.activation)),
            actuator_effort: self.inverse.actuators.first().map(|drive| self.square(drive.quantity)),
            control_effort: Some(self.control_effort()),
            tracking_rms_m: rms_m,
            tracking_rms_deg: rms_deg,
            stationarity: Some(stationarity),
            feasibility: Some(problem.feasibility(&iterate.x)),
            complementarity: Some(complementarity),
            n_variables: Some(problem.variables() as i64),
            n_equalities: Some(problem.equalities() as i64),
            n_active: Some((active.iter().filter(|a| **a).count() - force) as i64),
            n_active_force: Some(force as i64),
            min_activation: Some(at_points().fold(f64::INFINITY, f64::min)),
            max_activation: Some(max_activation),
            max_constraint_velocity: Some(self.max_constraint_velocity()),
            mid_interval_error: (!is_given || is_continuous).then(|| self.mid_interval_error()),
            ..JobRow::failed(Status::Invalid, String::new())
        }
    }

    /// Stationarity and complementarity of the unscaled problem (reactions in newtons).
    fn unscaled_errors(&self) -> [f64; 2] {
        let units = &self.problem.units;
        let largest = |values: &[f64]| values.iter().zip(units).map(|(v, unit)| (v / unit).abs()).fold(0.0, f64::max);
        let error = self.iterate.kkt_error();
        let stationarity = largest(&self.iterate.lagrangian_gradient()) / largest(&self.iterate.gradient).max(1e-3);
        [stationarity, error.complementarity]
    }

    /// RMS difference from the measured coordinates: positions (m) and angles (degrees), if there are any.
    fn tracking_rms(&self) -> (Option<f64>, Option<f64>) {
        let mechanics = &self.model().mechanics;
        let rms = |angles: bool| {
            let own: Vec<usize> = (0..mechanics.coordinates()).filter(|&i| mechanics.is_angle(i) == angles).collect();
            let instants = self.measurement.times.iter().zip(&self.measurement.coordinates);
            let squares = instants.flat_map(|(&t, measured)| {
                let found = self.coordinates(t, 0);
                own.iter().map(move |&i| (found[i] - measured[i]).powi(2))
            });
            let count = own.len() * self.measurement.times.len();
            (count > 0).then(|| (squares.sum::<f64>() / count as f64).sqrt())
        };
        (rms(false), rms(true).map(f64::to_degrees))
    }

    /// max |Φ_q q̇| over the points. The midpoint scheme imposes Φ = 0 there, but not its derivative.
    fn max_constraint_velocity(&self) -> f64 {
        let mut worst: f64 = 0.0;
        for (j, &t) in self.problem.scheme.points().iter().enumerate() {
            let z = self.problem.local(j, &self.iterate.x);
            let mut velocity = self.coordinates(t, 1);
            let motion = &self.inverse.motion;
            velocity.extend(motion.rates.iter().flat_map(|rates| rates.of(&z).iter().skip(motion.q.count)));
            self.model().mechanics.constraint_functions(motion.all.of(&z), &mut |_, slots, _, gradient, _| {
                let moving = slots.iter().zip(gradient).filter(|(slot, _)| **slot < velocity.len());
                let rate: f64 = moving.map(|(&slot, g)| g * velocity[slot]).sum();
                worst = worst.max(rate.abs());
            });
        }
        worst
    }

    /// How well the equations hold where the scheme does not impose them: the largest of |eq. (1)| over total weight,
    /// |eq. (3)| in normalised force, |Φ| in m and |eq. (4)|·τ midway between neighbouring points.
    fn mid_interval_error(&self) -> f64 {
        let control = &self.inverse.control;
        let mut residual = vec![0.0; control.rows()];
        let mut worst = 0.0;
        for pair in self.problem.scheme.points().windows(2) {
            let place = self.problem.scheme.place(0.5 * (pair[0] + pair[1]));
            let z = LocalMap::new(control, self.problem.scheme, place).apply(&self.iterate.x);
            control.printed_values(&z, &mut residual);
            for equation in control.equations.iter().filter(|equation| equation.is_printed) {
                worst = equation.rows.of(&residual).iter().map(|r| r.abs()).fold(worst, larger);
            }
        }
        worst
    }

    /// The quadrature weights of the points where every function has a value, s.
    fn weights(&self) -> Vec<f64> {
        let points = self.problem.points.iter();
        self.problem.scheme.quadrature().into_iter().zip(points).filter(|(_, p)| p.complete).map(|(w, _)| w).collect()
    }

    /// ∫Σy² dt over the functions of a quantity.
    fn square(&self, quantity: QuantityId) -> f64 {
        let members = self.inverse.control.quantity(quantity).members.len();
        let value = |t, member| evaluate(&self.problem.scheme.at(t, quantity, member, 0), &self.iterate.x);
        (0..members).map(|member| self.integrate(|t| value(t, member).powi(2))).sum()
    }

    fn control_effort(&self) -> f64 {
        let quantities = self.inverse.control.quantities.iter().enumerate();
        let controls = quantities.filter(|(_, quantity)| quantity.kind == Kind::Control);
        let unknown: f64 = controls.map(|(id, _)| self.square(QuantityId(id))).sum();
        if self.inverse.muscles.u.count > 0 {
            return unknown;
        }
        // Excitations that are no unknowns, at the points where eq. (4) gives them.
        let (locals, muscles) = (self.complete_locals(), 0..self.inverse.forces.len());
        let square =
            |z: &Vec<f64>| muscles.clone().filter_map(|m| self.inverse.excitation(z, m)).map(|u| u * u).sum::<f64>();
        unknown + self.weights().iter().zip(&locals).map(|(weight, z)| weight * square(z)).sum::<f64>()
    }

    /// ∫ f dt over the motion.
    fn integrate(&self, f: impl Fn(f64) -> f64) -> f64 {
        gauss(self.problem.scheme.breakpoints()).map(|(t, weight)| weight * f(t)).sum()
    }
}

/// Whether an inequality is a condition f_m ≥ 0, which is none of the thesis'.
pub fn is_force(problem: &Collocation<'_>, row: usize) -> bool {
    problem.limit(&problem.bounds[row]).name == BoundKind::Force.name()
}
