//! How far each force could be otherwise at nearly the same cost: the largest and the smallest x_i with f(x) ≤ f* + ε E*, E* the
//! muscles' part of f*.
//!
//! With p ≥ 2 that is the end of a curve of optima: x_i is least where `x_i + λ f(x)` is, for the λ at which f reaches the
//! budget. Near the optimum f − f* goes as 1/λ², which finds λ in a few steps. With linear criteria it is a linear programme.
//!
//! Asked for by M. H. Sohn et al., *J Biomech* 46, 2013; D. Stanev and K. Moustakas, *PLoS ONE* 14, 2019.

use super::interior_point::{Tilt, minimise_near};
use super::{Criterion, Failure, Optimum, Programme, linear};
use crate::deadline::Deadline;

/// The budget is met to this share.
const ACCURACY: f64 = 1e-4;
const MAX_STEPS: usize = 40;
/// A range that uses this share of the budget is good enough where rounding allows no more.
const NEAR: f64 = 0.99;
/// Below this share of the first λ the criterion no longer matters: the bounds and the load end the range.
const LEAST_FACTOR: f64 = 1e-7;
/// A criterion that is linear is at its optimum up to this.
const ROUNDING: f64 = 1e-9;

/// Smallest and largest value of each variable.
pub type Ranges = Vec<[f64; 2]>;

impl Programme {
    /// The ranges of the muscles' variables, the others as they are; `share`: ε. With 0, of the optimal face.
    ///
    /// # Errors
    /// If a programme fails, or the deadline passes.
    pub fn ranges(&self, optimum: &Optimum, share: f64, deadline: Deadline) -> Result<Ranges, Failure> {
        let mut ranges: Ranges = optimum.x.iter().map(|&x| [x, x]).collect();
        for i in (0..self.terms.len()).filter(|&i| self.terms[i].is_muscle) {
            for (side, sign) in [(0, 1.0), (1, -1.0)] {
                if deadline.passed() {
                    return Err(Failure::Numerical);
                }
                let end = match self.criterion {
                    Criterion::Polynomial(power) if power >= 2.0 => {
                        let room = share * self.muscle_effort(power, &optimum.x);
                        self.end(optimum, power, room, (i, sign))?
                    }
                    _ => {
                        let effort = match self.criterion {
                            Criterion::MinMax => self.largest_effort(&optimum.x),
                            Criterion::Polynomial(power) => self.muscle_effort(power, &optimum.x),
                        };
                        let budget = optimum.value + share * effort + ROUNDING * (1.0 + optimum.value.abs());
                        linear::least(self, i, sign, budget, deadline)?
                    }
                };
                // The optimum itself is in the range.
                ranges[i][side] = if side == 0 { end.min(optimum.x[i]) } else { end.max(optimum.x[i]) };
            }
        }
        Ok(ranges)
    }

    /// The largest effort of a muscle.
    pub fn largest_effort(&self, x: &[f64]) -> f64 {
        let muscles = self.terms.iter().zip(x).filter(|(term, _)| term.is_muscle);
        muscles.map(|(term, &x)| term.effort(x)).fold(0.0, f64::max)
    }

    /// The tilted optimum from that of squares with the same tilt.
    fn end_from_squares(&self, power: f64, tilt: Tilt) -> Result<Optimum, Failure> {
        let squares = minimise_near(self, 2.0, Some(tilt), None)?;
        minimise_near(self, power, Some(tilt), Some(&squares))
    }

    /// The least `sign · x_i` with f ≤ f* + room.
    fn end(&self, optimum: &Optimum, power: f64, room: f64, (i, sign): (usize, f64)) -> Result<f64, Failure> {
        let term = &self.terms[i];
        let here = optimum.x[i];
        let is_there = if sign > 0.0 { here <= term.bounds[0] } else { here >= term.bounds[1] };
        if room <= 0.0 || is_there || self.columns[i].is_empty() {
            return Ok(here);
        }
        let first = 1.0 / (2.0 * (room * term.weight).sqrt() * term.scale);
        let mut factor = first;
        // λ and f − f* at both sides of the budget.
        let (mut small, mut large): (Option<f64>, Option<f64>) = (None, None);
        let near = (power != 2.0).then_some(optimum);
        // The end nearest to the budget on its inner side.
        let mut inside: Option<(f64, f64)> = None;
        for step in 0..MAX_STEPS {
            let tilt = Tilt { variable: i, slope: sign, factor };
            // From elsewhere if the iteration does not get there from the optimum.
            let found = minimise_near(self, power, Some(tilt), near).or_else(|_| self.end_from_squares(power, tilt))?;
            let more = found.value - optimum.value;
            let ratio = more / room;
            if (ratio - 1.0).abs() <= ACCURACY || (ratio < 1.0 && factor <= LEAST_FACTOR * first) {
                return Ok(found.x[i]);
            }
            if ratio < 1.0 && inside.is_none_or(|(best, _)| ratio > best) {
                inside = Some((ratio, found.x[i]));
            }
            let side = if ratio > 1.0 { &mut small } else { &mut large };
            *side = Some(factor);
            let guess = factor * ratio.clamp(1e-6, 1e6).sqrt();
            factor = match (small, large) {
                (Some(small), Some(large)) if step % 3 == 2 || guess <= small || guess >= large => {
                    (small * large).sqrt()
                }
                (None, Some(_)) => guess.min(0.5 * factor),
                _ => guess,
            };
        }
        inside.filter(|(ratio, _)| *ratio > NEAR).map(|(_, x)| x).ok_or(Failure::Numerical)
    }
}
