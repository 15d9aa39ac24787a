//! The quadratic sub-problem by guessing its active set: solve the equality-constrained problem, put in what is
//! violated, take out what has a negative multiplier, until nothing changes (the primal–dual active set method,
//! Hintermüller, Ito and Kunisch, *SIAM J. Optim.* 13, 2002). Each round is one factorisation; from the active set of
//! the last step it takes few.
//!
//! The Hessian need only be positive definite where the active constraints vanish; if it is not, the damping δ grows.

use super::iterate::Iterate;
use super::kkt::{Kkt, KktValues, Rows};
use crate::numerics::sparse::Sparse;

const ROUNDS: usize = 12;
/// A linear system solved worse than this (relative) is one of contradicting constraints.
const ACCURACY: f64 = 1e-6;
/// More than so many wrong rows are too many from this round on, or when a round does not halve them.
const NEARLY: usize = 4;
const PATIENCE: usize = 3;
pub const SMALLEST_DAMPING: f64 = 1e-15;
const LARGEST_DAMPING: f64 = 1e8;
/// Above this, guessing gives up: the convexified problem serves better.
pub const EXACT_DAMPING: f64 = 1e-2;
const RAISE: f64 = 5.0;
/// δ that is right is taken where it is no more than this times one that is not: what lies between would cost more than it gains.
const NEAR: f64 = 60.0;

/// The step and multipliers of the sub-problem.
#[derive(Clone, Debug)]
pub struct Step {
    pub direction: Vec<f64>,
    pub equality_multipliers: Vec<f64>,
    pub inequality_multipliers: Vec<f64>,
    pub active: Vec<bool>,
    /// Interior-point iterations spent in Clarabel; 0 if the active set was guessed.
    pub qp_iterations: usize,
    pub factorisations: usize,
}

impl Step {
    /// Whether the factorisation left in the [`Kkt`] is the one that gave this step, and the first one tried:
    /// nothing had to change.
    pub fn is_settled(&self) -> bool {
        self.factorisations == 1
    }
}

/// Why no step came out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoStep {
    /// The active set did not settle.
    Unsettled,
    /// No damping made the Hessian positive definite, or the linear system could not be solved.
    Singular,
}

/// The next larger δ.
pub fn raise(damping: &mut f64) -> Result<(), NoStep> {
    *damping = (RAISE * *damping).max(SMALLEST_DAMPING);
    if *damping > LARGEST_DAMPING { Err(NoStep::Singular) } else { Ok(()) }
}

/// Solves the sub-problem at `here` from the guess `active`. `damping` is raised as far as the inertia asks for and
/// left there for the caller.
pub fn solve(
    kkt: &mut Kkt,
    here: &Iterate,
    hessian: &Sparse,
    metric: &Sparse,
    damping: &mut f64,
    active: &[bool],
) -> Result<Step, NoStep> {
    let (n, me) = (here.x.len(), here.equalities.len());
    let mut active = active.to_vec();
    let mut right = vec![0.0; kkt.order()];
    for i in 0..n {
        right[i] = -here.gradient[i];
    }
    for i in 0..me {
        right[n + i] = -here.equalities[i];
    }
    for i in 0..active.len() {
        right[n + me + i] = -here.inequalities[i];
    }
    let mut solution = vec![0.0; kkt.order()];
    let mut factorisations = 0;
    let mut last_wrong = usize::MAX;
    for round in 0..ROUNDS {
        let mut is_right = |damping: f64, kkt: &mut Kkt| {
            factorisations += 1;
            let inertia = kkt.factorise(&KktValues {
                hessian,
                metric,
                damping,
                equalities: &here.equality_jacobian,
                inequalities: &here.inequality_jacobian,
                rows: Rows::Active(&active),
            });
            inertia.is_some_and(|inertia| kkt.is_right(inertia))
        };
        if !is_right(*damping, kkt) {
            // Where the largest δ is not enough, none between is tried.
            if !is_right(EXACT_DAMPING, kkt) {
                *damping = damping.max(RAISE * EXACT_DAMPING);
                return Err(NoStep::Singular);
            }
            if NEAR * *damping >= EXACT_DAMPING {
                *damping = EXACT_DAMPING;
            } else {
                raise(damping)?;
                while *damping < EXACT_DAMPING && !is_right(*damping, kkt) {
                    raise(damping)?;
                }
                if *damping >= EXACT_DAMPING {
                    *damping = EXACT_DAMPING;
                    is_right(EXACT_DAMPING, kkt);
                }
            }
        }
        let accuracy = kkt.solve(&right, &mut solution);
        let consistent = accuracy <= ACCURACY;
        if !consistent && kkt.solve_regularised(&right, &mut solution).is_nan() {
            return Err(NoStep::Singular);
        }
        let (direction, multipliers) = (&solution[..n], &solution[n + me..]);
        let mut slack = here.inequalities.clone();
        here.inequality_jacobian.add_product(1.0, direction, &mut slack);
        let scale = multipliers.iter().map(|y| y.abs()).fold(0.0, f64::max);
        // Positive: how wrong the guess is for this row.
        let wrong = |row: usize| match active[row] {
            true => multipliers[row] / scale.max(1e-300) - 1e-10,
            // Nothing joins rows that already contradict each other.
            false if consistent => -slack[row] - 1e-10,
            false => 0.0,
        };
        let worst: Vec<(f64, usize)> =
            (0..active.len()).map(|row| (wrong(row), row)).filter(|(by, _)| *by > 0.0).collect();
        if worst.is_empty() && !consistent {
            return Err(NoStep::Singular);
        }
        if worst.is_empty() {
            return Ok(Step {
                direction: direction.to_vec(),
                equality_multipliers: solution[n..n + me].to_vec(),
                inequality_multipliers: multipliers
                    .iter()
                    .zip(&active)
                    .map(|(y, &a)| if a { -y } else { 0.0 })
                    .collect(),
                active,
                qp_iterations: 0,
                factorisations,
            });
        }
        if worst.len() > NEARLY && (round >= PATIENCE || worst.len() > last_wrong / 2) {
            return Err(NoStep::Unsettled);
        }
        last_wrong = worst.len();
        worst.iter().for_each(|&(_, row)| active[row] = !active[row]);
    }
    Err(NoStep::Unsettled)
}
