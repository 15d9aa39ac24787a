//! What each iteration did.

use super::iterate::{Iterate, KktError};
use super::subproblem::Way;

/// One point of the iteration, and the step that led away from it.
#[derive(Clone, Debug)]
pub struct Record {
    pub x: Vec<f64>,
    pub objective: f64,
    pub error: KktError,
    /// ‖x_{k+1} − x_k‖; 0 in the last record.
    pub step_norm: f64,
    /// Iterations of Clarabel in this point's sub-problems.
    pub qp_iterations: usize,
    /// δ of the step.
    pub damping: Option<f64>,
    /// α, the share of the step that was taken.
    pub fraction: Option<f64>,
    /// How its sub-problem was solved.
    pub way: Option<Way>,
    /// Steps that were refused or could not be computed.
    pub refusals: usize,
    /// Length of the leap in steps; 0 if there was none.
    pub leap: f64,
    /// How many times as long the extension made the step; 0 if there was none.
    pub extension: f64,
    /// Whether feasibility was restored.
    pub is_restored: bool,
    /// Of the KKT matrix, those in vain too.
    pub factorisations: usize,
}

impl Record {
    pub fn new(here: &Iterate, error: KktError) -> Self {
        Self {
            x: here.x.clone(),
            objective: here.objective,
            error,
            step_norm: 0.0,
            qp_iterations: 0,
            damping: None,
            fraction: None,
            way: None,
            refusals: 0,
            leap: 0.0,
            extension: 0.0,
            is_restored: false,
            factorisations: 0,
        }
    }

    /// Notes how far the step has led.
    pub fn moved_to(&mut self, x: &[f64]) {
        self.step_norm = distance(&self.x, x);
    }
}

pub fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum::<f64>().sqrt()
}
