//! Turns a solution into rows: loads, activations, residuals of the unscaled problem, functions of time.

use crate::methods::InverseProblem;
use crate::model::Model;
use crate::motion::Measurement;
use crate::nlp::iterate::Iterate;
use crate::nlp::polish::active;
use crate::nlp::problem::Problem;
use crate::numerics::larger;
use crate::outcome::{JobRow, MuscleRow, Status, TrajectoryRow};
use crate::problem::Bounded;
use crate::transcription::collocation::Collocation;
use crate::transcription::scheme::{Combination, LocalMap, evaluate};

/// Number of points at each end where reactions and accelerations of the midpoint scheme ring.
const END_POINTS: usize = 4;
/// An activation closer to 1 than this counts as being at its upper bound.
const SATURATED: f64 = 1e-6;

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

    /// Body coordinate `i`, or a derivative, at time t (s).
    fn coordinate(&self, t: f64, derivative: usize, i: usize) -> f64 {
        evaluate(&self.inverse.coordinate_at(self.problem.scheme, t, derivative, i), &self.iterate.x)
    }

    /// The job's row, without status, starts and times.
    pub fn job_row(&self) -> JobRow {
        let (problem, iterate) = (self.problem, self.iterate);
        let muscles = 0..self.model().muscles.len();
        let locals = self.locals();
        let at_points = || locals.iter().flat_map(|z| self.inverse.muscles.a.of(z).iter().copied());
        let (rms_m, rms_deg) = self.tracking_rms();
        let active = active(&iterate.inequalities);
        let force = (0..active.len()).filter(|&row| active[row] && is_force(problem, row)).count();
        let [stationarity, complementarity] = self.unscaled_errors();
        let max_activation = at_points().fold(f64::NEG_INFINITY, f64::max);
        JobRow {
            objective: Some(iterate.objective),
            effort: Some(muscles.map(|m| self.integrate(|t| self.activation(t, m).powi(2))).sum()),
            tracking_rms_m: Some(rms_m),
            tracking_rms_deg: Some(rms_deg),
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
            mid_interval_error: Some(self.mid_interval_error()),
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

    /// RMS difference from the measured body coordinates: positions (m) and angles (degrees).
    fn tracking_rms(&self) -> (f64, f64) {
        let (each, positions) = self.model().per_body();
        let (mut metres, mut degrees) = (0.0, 0.0);
        for (&t, measured) in self.measurement.times.iter().zip(&self.measurement.coordinates) {
            for (i, value) in measured.iter().enumerate() {
                let difference = self.coordinate(t, 0, i) - value;
                if i % each < positions {
                    metres += difference * difference;
                } else {
                    degrees += (self.model().tracking_weight(i) * difference).to_degrees().powi(2);
                }
            }
        }
        let angles = (self.measurement.times.len() * self.model().bodies()) as f64;
        ((metres / (positions as f64 * angles)).sqrt(), (degrees / angles).sqrt())
    }

    /// max |Φ_q q̇| over the points. The midpoint scheme imposes Φ = 0 there, but not its derivative.
    fn max_constraint_velocity(&self) -> f64 {
        let mut worst: f64 = 0.0;
        for (j, &t) in self.problem.scheme.points().iter().enumerate() {
            let z = self.problem.local(j, &self.iterate.x);
            let mut velocity: Vec<f64> = (0..self.model().coordinates()).map(|i| self.coordinate(t, 1, i)).collect();
            let motion = &self.inverse.motion;
            velocity.extend(motion.rates.iter().flat_map(|rates| rates.of(&z).iter().skip(motion.q.count)));
            self.model().mechanics.constraint_functions(motion.all.of(&z), |_, slots, _, gradient, _| {
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

    /// ∫ f dt over the motion.
    fn integrate(&self, f: impl Fn(f64) -> f64) -> f64 {
        self.quadrature().map(|(t, weight)| weight * f(t)).sum()
    }

    /// Four-point Gauss quadrature on each polynomial piece, exact up to degree 7: instants and weights, s.
    fn quadrature(&self) -> impl Iterator<Item = (f64, f64)> {
        let (near, far) = (0.339_981_043_584_856_3, 0.861_136_311_594_052_6);
        let rule = [(near, 0.652_145_154_862_546_1), (far, 0.347_854_845_137_453_9)];
        self.problem.scheme.breakpoints().windows(2).flat_map(move |w| {
            let (middle, half) = (0.5 * (w[0] + w[1]), 0.5 * (w[1] - w[0]));
            rule.into_iter().flat_map(move |(x, b)| [(middle - half * x, half * b), (middle + half * x, half * b)])
        })
    }

    /// Each muscle's mean activation as a linear combination of the entries of x.
    pub fn mean_activations(&self) -> Vec<Combination> {
        let duration = self.duration();
        (0..self.model().muscles.len())
            .map(|m| {
                let mut weights = std::collections::BTreeMap::new();
                for (t, weight) in self.quadrature() {
                    for (i, w) in self.activation_combination(t, m) {
                        *weights.entry(i).or_insert(0.0) += weight * w / duration;
                    }
                }
                weights.into_iter().collect()
            })
            .collect()
    }

    /// Derivative of the effort ∫Σa² dt (s) along a direction.
    pub fn effort_slope(&self, direction: &[f64]) -> f64 {
        let product = |t: f64, m: usize| {
            let combination = self.activation_combination(t, m);
            evaluate(&combination, &self.iterate.x) * evaluate(&combination, direction)
        };
        (0..self.model().muscles.len()).map(|m| 2.0 * self.integrate(|t| product(t, m))).sum()
    }

    /// Derivative of each muscle's mean force (N) along a direction.
    pub fn mean_force_slopes(&self, direction: &[f64]) -> Vec<f64> {
        let duration = self.duration();
        let mut slopes = vec![0.0; self.model().muscles.len()];
        for (j, weight) in self.problem.scheme.quadrature().into_iter().enumerate() {
            if !self.problem.points[j].complete {
                continue;
            }
            let z = self.problem.local(j, &self.iterate.x);
            let dz = self.problem.local_change(j, direction);
            for (m, muscle) in self.model().muscles.iter().enumerate() {
                let change = self.inverse.contractions[m].fibre_force_change(&z, &dz);
                slopes[m] += weight / duration * muscle.max_isometric_force * change;
            }
        }
        slopes
    }

    pub fn muscle_rows(&self) -> Vec<MuscleRow> {
        let (locals, complete) = (self.locals(), self.complete_locals());
        let points = &self.problem.points;
        let weights: Vec<f64> = self
            .problem
            .scheme
            .quadrature()
            .into_iter()
            .zip(points)
            .filter(|(_, p)| p.complete)
            .map(|(w, _)| w)
            .collect();
        let variables = &self.inverse.muscles;
        let duration = self.duration();
        let idle = crate::analysis::idle(self.inverse, self.problem, &self.iterate.x);
        self.model()
            .muscles
            .iter()
            .enumerate()
            .map(|(m, muscle)| {
                let [a, l, u] = [variables.a, variables.l, variables.u].map(|span| span.at(m));
                let forces: Vec<f64> =
                    complete.iter().map(|z| muscle.max_isometric_force * self.inverse.fibre_force(z, m)).collect();
                let velocities: Vec<f64> = complete.iter().map(|z| z[variables.l_rate.at(m)]).collect();
                let impulse: f64 = weights.iter().zip(&forces).map(|(w, f)| w * f).sum();
                let largest = |values: &[f64]| values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                let of =
                    |points: &[Vec<f64>], variable: usize| points.iter().map(|z| z[variable]).collect::<Vec<f64>>();
                let lengths = of(&locals, l);
                let at_one = weights.iter().zip(&complete).filter(|(_, z)| z[a] > 1.0 - SATURATED);
                let (ringing, direction_changes) = ringing(&velocities);
                MuscleRow {
                    muscle: muscle.name.clone(),
                    mean_activation_low: None,
                    mean_activation_high: None,
                    mean_activation: self.integrate(|t| self.activation(t, m)) / duration,
                    peak_activation: largest(&of(&locals, a)),
                    peak_excitation: largest(&of(&complete, u)),
                    saturated_share: at_one.map(|(weight, _)| weight).sum::<f64>() / duration,
                    mean_force_n: impulse / duration,
                    mean_force_mesh_error_n: None,
                    peak_force_n: largest(&forces),
                    min_force_n: forces.iter().copied().fold(f64::INFINITY, f64::min),
                    impulse_n_s: impulse,
                    peak_passive_force_n: lengths.iter().map(|&l| muscle.passive_force(l)).fold(0.0, f64::max),
                    min_fibre_length: lengths.iter().copied().fold(f64::INFINITY, f64::min),
                    max_fibre_length: largest(&lengths),
                    idle: idle[m],
                    ringing,
                    direction_changes,
                    peak_fibre_velocity_per_s: velocities.iter().fold(0.0, |a, v| a.max(v.abs())),
                }
            })
            .collect()
    }

    /// Functions of time at the collocation points, and the measured coordinates at the measured instants. Times are
    /// those of the motion file, which `motion.time_scale` stretches from the start of the motion.
    pub fn trajectory_rows(&self) -> Vec<TrajectoryRow> {
        let (model, clock) = (self.model(), self.measurement.clock);
        let mut rows = Vec::new();
        let mut push = |t: f64, signal: &str, name: &str, value: f64, end_effect: bool| {
            rows.push(TrajectoryRow {
                time_s: clock + t,
                signal: signal.to_owned(),
                name: name.to_owned(),
                value,
                end_effect,
            });
        };
        self.push_measured(&mut push);
        let mut near = Vec::new();
        // Functions of degree 0 ring at both ends.
        let rings = self.inverse.motion.velocity.is_none();
        let count = self.problem.scheme.points().len();
        for (j, (&t, z)) in self.problem.scheme.points().iter().zip(self.locals()).enumerate() {
            let end = rings && (j < END_POINTS || j + END_POINTS >= count);
            let (q, complete) = (self.inverse.motion.all.of(&z), self.problem.points[j].complete);
            for (i, name) in model.body_coordinate_names().iter().enumerate().filter(|_| complete) {
                push(t, "acceleration", name, z[self.inverse.motion.accelerations.at(i)], end);
            }
            for (name, value) in model.joint_coordinate_values(q, &mut near) {
                push(t, "joint_coordinate", name, value, false);
            }
            self.push_muscles(&mut push, (t, &z), complete);
            let paths = model.muscles.iter().map(|muscle| (muscle.name.as_str(), muscle.path.positions(q)));
            let lines = paths.map(|path| ("path_point_m", path));
            for (signal, (name, line)) in
                lines.chain(model.mechanics.bones(q).into_iter().map(|bone| ("bone_point_m", bone)))
            {
                for (k, place) in line.iter().enumerate() {
                    for (axis, x) in ["x", "y", "z"].iter().zip(place) {
                        push(t, signal, &format!("{name}.{k}.{axis}"), *x, false);
                    }
                }
            }
            for (row, name) in model.reaction_names().into_iter().enumerate().filter(|_| complete) {
                let Some(name) = name else { continue };
                push(t, "reaction_n", &name, model.weight() * z[self.inverse.motion.reactions.at(row)], end);
            }
        }
        let active = active(&self.iterate.inequalities);
        for (bound, active) in self.problem.bounds.iter().zip(active) {
            let limit = self.problem.limit(bound);
            let name = format!("{}.{}", limit.member, limit.name);
            let t = self.problem.scheme.points()[bound.point];
            push(t, "bound_active", &name, f64::from(u8::from(active)), false);
        }
        rows
    }

    /// The measured coordinates at the measured instants, and the solution's there.
    fn push_measured(&self, push: &mut impl FnMut(f64, &str, &str, f64, bool)) {
        let (model, motion) = (self.model(), &self.inverse.motion);
        let names = model.body_coordinate_names();
        let mut near = Vec::new();
        for (&t, measured) in self.measurement.times.iter().zip(&self.measurement.coordinates) {
            for (i, name) in names.iter().enumerate() {
                push(t, "measured", name, measured[i], false);
                push(t, "coordinate", name, self.coordinate(t, 0, i), false);
            }
            let mut all = motion.all.of(&self.inverse.control.given_at(t)).to_vec();
            all[..measured.len()].copy_from_slice(measured);
            for (name, value) in model.joint_coordinate_values(&all, &mut near) {
                push(t, "measured_joint_coordinate", name, value, false);
            }
        }
    }

    /// The muscles' variables at a point.
    fn push_muscles(&self, push: &mut impl FnMut(f64, &str, &str, f64, bool), (t, z): (f64, &[f64]), complete: bool) {
        let muscles = &self.inverse.muscles;
        for (m, muscle) in self.model().muscles.iter().enumerate() {
            push(t, "activation", &muscle.name, z[muscles.a.at(m)], false);
            push(t, "fibre_length", &muscle.name, z[muscles.l.at(m)], false);
            if complete {
                let force = muscle.max_isometric_force * self.inverse.fibre_force(z, m);
                push(t, "excitation", &muscle.name, z[muscles.u.at(m)], false);
                push(t, "fibre_velocity", &muscle.name, z[muscles.l_rate.at(m)], false);
                push(t, "force_n", &muscle.name, force, false);
            }
        }
    }
}

/// Whether an inequality is a condition f_m ≥ 0, which is none of the thesis'.
pub fn is_force(problem: &Collocation<'_>, row: usize) -> bool {
    matches!(problem.limit(&problem.bounds[row]).bounded, Bounded::Function(_))
}

/// (max |v_{j+1} − 2 v_j + v_{j−1}|/4, share of inner points at which v turns)
fn ringing(velocities: &[f64]) -> (f64, f64) {
    let inner = velocities.windows(3);
    let count = inner.len().max(1) as f64;
    let amplitude = velocities.windows(3).map(|w| (w[2] - 2.0 * w[1] + w[0]).abs() / 4.0).fold(0.0, f64::max);
    let turns = inner.filter(|w| (w[2] - w[1]) * (w[1] - w[0]) < 0.0).count();
    (amplitude, turns as f64 / count)
}

/// Whether moving along `direction` changes the force of any muscle at any collocation point by more than `threshold`.
pub fn moves_load(
    inverse: &InverseProblem<'_>,
    problem: &Collocation<'_>,
    x: &[f64],
    direction: &[f64],
    threshold: f64,
) -> bool {
    (0..problem.points.len()).filter(|&j| problem.points[j].complete).any(|j| {
        let (z, dz) = (problem.local(j, x), problem.local_change(j, direction));
        inverse.contractions.iter().any(|contraction| contraction.fibre_force_change(&z, &dz).abs() > threshold)
    })
}
