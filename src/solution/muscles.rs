//! The loads of the muscles.

use super::Solution;
use crate::methods::InverseProblem;
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
        let weights = self.weights();
        let variables = &self.inverse.muscles;
        let duration = self.duration();
        let idle = self.inverse.idle(self.problem, &self.iterate.x);
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
                    excitation_swings: Some(swings(&of(&complete, u))),
                }
            })
            .collect()
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
        inverse.contractions.iter().any(|contraction| contraction.fibre_force_change(&z, &dz).abs() > threshold)
    })
}
