//! The filter: a step must improve either the constraint violation θ or the objective f against every pair met
//! before (Fletcher and Leyffer, *Math. Program.* 91, 2002; margins and switching condition as in Wächter and Biegler,
//! *Math. Program.* 106, 2006).

use crate::nlp::options::FilterOptions;

#[derive(Clone, Debug)]
pub struct Filter {
    options: FilterOptions,
    entries: Vec<(f64, f64)>,
    /// θ above this is never accepted.
    ceiling: f64,
    /// Below this θ, descent of f decides.
    floor: f64,
}

/// What the filter says of a trial point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Accepted for descent of f.
    Descent,
    /// Accepted for progress in either; the pair left behind joins the filter.
    Progress,
    Rejected,
}

impl Filter {
    pub fn new(options: FilterOptions, violation: f64) -> Self {
        let size = violation.max(1.0);
        Self { options, entries: Vec::new(), ceiling: options.ceiling * size, floor: options.floor * size }
    }

    /// Whether no pair has been met.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Judges the step from (θ, f), where the KKT error is `error`, by the fraction α with slope `∇fᵀ d` to `trial`.
    pub fn judge(&self, here: (f64, f64), error: f64, slope: f64, alpha: f64, trial: (f64, f64)) -> Verdict {
        let ((violation, objective), (trial_violation, trial_objective)) = (here, trial);
        let ceiling = self.ceiling.min(self.options.wild * violation.max(error));
        if !trial_violation.is_finite() || !trial_objective.is_finite() || trial_violation > ceiling {
            return Verdict::Rejected;
        }
        if !self.allows(trial) {
            return Verdict::Rejected;
        }
        let noise = noise(objective);
        let switching = slope < 0.0 && alpha * (-slope).powf(2.3) > violation.powf(1.1);
        if violation <= self.floor && switching {
            if trial_objective <= objective + self.options.armijo * alpha * slope + noise {
                Verdict::Descent
            } else {
                Verdict::Rejected
            }
        } else if trial_violation <= (1.0 - self.options.margin) * violation
            || trial_objective <= objective - self.options.margin * violation + noise
        {
            Verdict::Progress
        } else {
            Verdict::Rejected
        }
    }

    /// Whether (θ, f) improves on every pair met before.
    pub fn allows(&self, (violation, objective): (f64, f64)) -> bool {
        let better = |&(v, o): &(f64, f64)| {
            violation <= (1.0 - self.options.margin) * v || objective <= o - self.options.margin * v + noise(objective)
        };
        self.entries.iter().all(better)
    }

    /// Adds the pair that a progress step left behind.
    pub fn add(&mut self, here: (f64, f64)) {
        self.entries.retain(|&(v, o)| v < here.0 || o < here.1);
        self.entries.push(here);
    }
}

/// What rounding may do to an objective.
fn noise(objective: f64) -> f64 {
    10.0 * f64::EPSILON * objective.abs()
}
