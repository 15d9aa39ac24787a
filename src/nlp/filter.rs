//! The filter: a step must improve either the constraint violation θ or the objective f against every pair met
//! before (Fletcher and Leyffer, *Math. Program.* 91, 2002; margins and switching condition as in Wächter and Biegler,
//! *Math. Program.* 106, 2006).

const MARGIN: f64 = 1e-5;
const ARMIJO: f64 = 1e-4;
/// θ after a step may be this times that before it, or times the KKT error if that is larger: f is worth no more.
const WILD: f64 = 100.0;

#[derive(Clone, Debug)]
pub struct Filter {
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
    pub fn new(violation: f64) -> Self {
        Self { entries: Vec::new(), ceiling: 1e2 * violation.max(1.0), floor: 1e-4 * violation.max(1.0) }
    }

    /// Whether no pair has been met.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Judges the step from (θ, f), where the KKT error is `error`, by the fraction α with slope `∇fᵀ d` to `trial`.
    pub fn judge(&self, here: (f64, f64), error: f64, slope: f64, alpha: f64, trial: (f64, f64)) -> Verdict {
        let ((violation, objective), (trial_violation, trial_objective)) = (here, trial);
        let ceiling = self.ceiling.min(WILD * violation.max(error));
        if !trial_violation.is_finite() || !trial_objective.is_finite() || trial_violation > ceiling {
            return Verdict::Rejected;
        }
        if !self.allows(trial) {
            return Verdict::Rejected;
        }
        let noise = noise(objective);
        let switching = slope < 0.0 && alpha * (-slope).powf(2.3) > violation.powf(1.1);
        if violation <= self.floor && switching {
            if trial_objective <= objective + ARMIJO * alpha * slope + noise {
                Verdict::Descent
            } else {
                Verdict::Rejected
            }
        } else if trial_violation <= (1.0 - MARGIN) * violation
            || trial_objective <= objective - MARGIN * violation + noise
        {
            Verdict::Progress
        } else {
            Verdict::Rejected
        }
    }

    /// Whether (θ, f) improves on every pair met before.
    pub fn allows(&self, (violation, objective): (f64, f64)) -> bool {
        let better =
            |&(v, o): &(f64, f64)| violation <= (1.0 - MARGIN) * v || objective <= o - MARGIN * v + noise(objective);
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
