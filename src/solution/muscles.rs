//! The loads of the muscles.

use super::Solution;
use crate::methods::InverseProblem;
use crate::methods::muscle_force::Fibre;
use crate::nlp::iterate::Iterate;
use crate::outcome::MuscleRow;
use crate::transcription::collocation::Collocation;
use crate::transcription::scheme::{Combination, evaluate, gauss};

/// An activation closer to 1 than this counts as being at its upper bound.
const SATURATED: f64 = 1e-6;

impl Solution<'_> {
    /// Each muscle's mean activation as a linear combination of the entries of x.
    pub fn mean_activations(&self) -> Vec<Combination> {
        let duration = self.duration();
        (0..self.model().muscles.len())
            .map(|m| {
                let mut weights = std::collections::BTreeMap::new();
                for (t, weight) in gauss(self.problem.scheme.breakpoints()) {
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
        let mut slopes = vec![0.0; self.model().muscles.len()];
        self.each_mean_force_slope(|m, index, slope| slopes[m] += slope * direction[index]);
        slopes
    }

    /// The gradient of each muscle's mean force, N per entry of x.
    pub fn mean_force_gradients(&self) -> Vec<Vec<f64>> {
        let mut gradients = vec![vec![0.0; self.iterate.x.len()]; self.model().muscles.len()];
        self.each_mean_force_slope(|m, index, slope| gradients[m][index] += slope);
        gradients
    }

    /// Hands over the parts of which those gradients are the sums: the muscle, the entry of x, and the slope.
    fn each_mean_force_slope(&self, mut add: impl FnMut(usize, usize, f64)) {
        let duration = self.duration();
        for (j, weight) in self.problem.scheme.quadrature().into_iter().enumerate() {
            let point = &self.problem.points[j];
            if !point.complete {
                continue;
            }
            let z = self.problem.local(j, &self.iterate.x);
            for (m, force) in self.inverse.forces.iter().enumerate() {
                let unit = weight / duration * force.muscle().max_isometric_force;
                for (variable, slope) in force.slopes(&z) {
                    let terms = point.map.combinations[variable].iter();
                    terms.for_each(|&(index, weight)| add(m, index, unit * slope * weight));
                }
            }
        }
    }

    /// The muscles' part of the objective: what it falls by without activations and excitations.
    pub fn muscle_cost(&self) -> f64 {
        let coefficients = self.problem.scheme.coefficients();
        let muscles = &self.inverse.muscles;
        let mut idle = self.iterate.x.clone();
        for quantity in [Some(muscles.activation), muscles.excitation].into_iter().flatten() {
            for member in 0..coefficients.members(quantity) {
                (0..coefficients.count(quantity)).for_each(|k| idle[coefficients.index(quantity, k, member)] = 0.0);
            }
        }
        self.iterate.objective - Iterate::new(self.problem, idle).objective
    }

    pub fn muscle_rows(&self) -> Vec<MuscleRow> {
        let at = |j: usize| self.problem.local(j, &self.iterate.x);
        let locals: Vec<Vec<f64>> = self.inverse.points_with_activations(self.problem).into_iter().map(at).collect();
        let complete = self.complete_locals();
        let idle = self.inverse.idle(self.problem, &self.iterate.x);
        let row = |(m, idle): (usize, bool)| MuscleRow { idle, ..self.muscle_row(m, &locals, &complete) };
        idle.into_iter().enumerate().map(row).collect()
    }

    /// `locals`: z at the points with activations; `complete`: at those where every function has a value.
    fn muscle_row(&self, m: usize, locals: &[Vec<f64>], complete: &[Vec<f64>]) -> MuscleRow {
        let (weights, duration) = (self.weights(), self.duration());
        let (variables, force) = (&self.inverse.muscles, &self.inverse.forces[m]);
        let (muscle, a) = (force.muscle(), variables.a.at(m));
        let largest = |values: &[f64]| values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let smallest = |values: &[f64]| values.iter().copied().fold(f64::INFINITY, f64::min);
        let of = |points: &[Vec<f64>], variable: usize| points.iter().map(|z| z[variable]).collect::<Vec<f64>>();
        let forces: Vec<f64> = complete.iter().map(|z| muscle.max_isometric_force * force.value(z)).collect();
        let impulse: f64 = weights.iter().zip(&forces).map(|(w, f)| w * f).sum();
        let share = |points: &dyn Fn(&Vec<f64>) -> bool| {
            let there = weights.iter().zip(complete).filter(|(_, z)| points(z));
            there.fold(0.0, |sum, (weight, _)| sum + weight) / duration
        };
        let fibres = |points: &[Vec<f64>]| points.iter().map(|z| force.fibre(z)).collect::<Option<Vec<Fibre>>>();
        let lengths: Option<Vec<f64>> = fibres(locals).map(|all| all.iter().map(|fibre| fibre.length).collect());
        let velocities: Option<Vec<f64>> = fibres(complete).map(|all| all.iter().map(|fibre| fibre.velocity).collect());
        let rings = velocities.as_deref().map(ringing);
        let excitations: Option<Vec<f64>> = complete.iter().map(|z| self.inverse.excitation(z, m)).collect();
        MuscleRow {
            muscle: muscle.name.clone(),
            mean_activation_low: None,
            mean_activation_high: None,
            mean_activation: self.integrate(|t| self.activation(t, m)) / duration,
            peak_activation: largest(&of(locals, a)),
            peak_excitation: excitations.as_deref().map(largest),
            saturated_share: share(&|z| z[a] > 1.0 - SATURATED),
            left_out_share: self.inverse.motion.is_given.then(|| share(&|z| force.is_left_out(z))),
            mean_force_n: impulse / duration,
            mean_force_mesh_error_n: None,
            mean_force_near_low_n: None,
            mean_force_near_high_n: None,
            peak_force_n: largest(&forces),
            min_force_n: smallest(&forces),
            impulse_n_s: impulse,
            peak_passive_force_n: locals.iter().map(|z| force.passive_force(z)).fold(0.0, f64::max),
            min_fibre_length: lengths.as_deref().map(smallest),
            max_fibre_length: lengths.as_deref().map(largest),
            idle: false,
            ringing: rings.map(|(amplitude, _)| amplitude),
            direction_changes: rings.map(|(_, turns)| turns),
            peak_fibre_velocity_per_s: velocities.map(|all| all.iter().fold(0.0, |a: f64, v| a.max(v.abs()))),
            excitation_swings: excitations.as_deref().map(swings),
        }
    }
}

/// (max |v_{j+1} − 2 v_j + v_{j−1}|/4, share of inner points at which v turns)
fn ringing(velocities: &[f64]) -> (f64, f64) {
    let inner = velocities.windows(3);
    let count = inner.len().max(1) as f64;
    let amplitude = velocities.windows(3).map(|w| (w[2] - 2.0 * w[1] + w[0]).abs() / 4.0).fold(0.0, f64::max);
    let turns = inner.filter(|w| (w[2] - w[1]) * (w[1] - w[0]) < 0.0).count();
    (amplitude, turns as f64 / count)
}

/// Values that change by less than this do not swing.
const STILL: f64 = 1e-3;

/// Total variation over twice the range.
fn swings(values: &[f64]) -> f64 {
    let (low, high) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), &v| (l.min(v), h.max(v)));
    let variation: f64 = values.windows(2).map(|pair| (pair[1] - pair[0]).abs()).sum();
    if high - low > STILL { variation / (2.0 * (high - low)) } else { 0.0 }
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
        inverse.forces.iter().any(|force| force.change(&z, &dz).abs() > threshold)
    })
}
