//! The quadratic sub-problem by guessing its active set: solve the equality-constrained problem, put in what is
//! violated, take out what has a negative multiplier, until nothing changes (the primal–dual active set method,
//! Hintermüller, Ito and Kunisch, *SIAM J. Optim.* 13, 2002). Each round is one factorisation; from the active set of
//! the last step it takes few.
//!
//! The Hessian need only be positive definite where the active constraints vanish; if it is not, the damping δ grows.
//!
//! Far from a solution the linearisation is worth no more than some share of the KKT error: rows that are wrong by less are left as they are, and
//! put right in the guess for the next sub-problem.

use super::iterate::Iterate;
use super::kkt::{Kkt, KktValues, Rows};
use crate::numerics::sparse::Sparse;

const ROUNDS: usize = 12;
/// A linear system solved worse than this (relative) is one of contradicting constraints.
const ACCURACY: f64 = 1e-6;
/// More wrong rows than these, one of so many, are too many when a round does not halve them; and at first one of so many.
const NEARLY: usize = 4;
const FEW: usize = 200;
const MANY: usize = 10;
/// Rows may be wrong by this share of the KKT error, and in any case by so much.
const PER_ERROR: f64 = 3e-2;
const ROUNDING: f64 = 1e-10;
pub const SMALLEST_DAMPING: f64 = 1e-15;
const LARGEST_DAMPING: f64 = 1e8;
/// A Hessian that needs more than this is convexified: that serves better.
pub const EXACT_DAMPING: f64 = 5e-4;
const RAISE: f64 = 5.0;

/// The step and multipliers of the sub-problem.
#[derive(Clone, Debug)]
pub struct Step {
    pub direction: Vec<f64>,
    pub equality_multipliers: Vec<f64>,
    pub inequality_multipliers: Vec<f64>,
    pub active: Vec<bool>,
    /// Interior-point iterations spent in Clarabel; 0 if the active set was guessed.
    pub qp_iterations: usize,
    /// Whether the factorisation left in the [`Kkt`] is the one that gave this step, and the first one tried:
    /// nothing had to change. Never of an interior point, whose factorisation is of another system.
    pub is_settled: bool,
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

/// Solves the sub-problem at `here`, a point with this KKT error, from the guess `active`. `damping` is raised as far as the inertia asks for, to
/// no more than `most`, and left there for the caller. Where `most` is in doubt it is asked first: each smaller δ would be tried in vain.
pub fn solve(
    kkt: &mut Kkt,
    (here, error): (&Iterate, f64),
    hessian: &Sparse,
    metric: &Sparse,
    damping: &mut f64,
    (most, is_in_doubt): (f64, bool),
    active: &[bool],
) -> Result<Step, NoStep> {
    let mut guess = Guess::new(kkt, (here, error), hessian, metric, active);
    let nearly = NEARLY.max(active.len() / FEW);
    let mut allowed = nearly.max(active.len() / MANY);
    let (mut met, mut in_a_circle) = (Vec::new(), false);
    if is_in_doubt {
        if !guess.is_right(damping.max(most)) {
            *damping = damping.max(RAISE * most);
            return Err(NoStep::Singular);
        }
        guess.factorisations = usize::from(*damping >= most);
    }
    for round in 0..ROUNDS {
        let is_known = round == 0 && guess.factorisations == 1;
        if !is_known && !guess.is_right(*damping) {
            // What has been lowered is raised again. Where the largest δ is not enough, or its step belongs to quite another active set,
            // none between is tried.
            let next = RAISE * *damping;
            let may_do = !is_in_doubt && round == 0 && next < most;
            if may_do && guess.is_right(next) {
                *damping = next;
            } else {
                if *damping >= most || !guess.is_right(most) {
                    *damping = damping.max(RAISE * most);
                    return Err(NoStep::Singular);
                }
                if guess.wrong_rows()?.rows.len() > allowed {
                    return Err(NoStep::Unsettled);
                }
                guess.raise(damping, most)?;
            }
        }
        let wrong = guess.wrong_rows()?;
        if wrong.are_slight {
            return Ok(guess.step(&wrong.rows));
        }
        let count = wrong.rows.len();
        if count > allowed {
            return Err(NoStep::Unsettled);
        }
        allowed = nearly.max(count / 2);
        // Once the same rows are wrong again it would go on in a circle: from then on only the last of them.
        in_a_circle |= met.contains(&wrong.rows);
        guess.turn(if in_a_circle { &wrong.rows[count - 1..] } else { &wrong.rows });
        met.push(wrong.rows);
    }
    Err(NoStep::Unsettled)
}

/// An active set and the solution that goes with it.
struct Guess<'a> {
    kkt: &'a mut Kkt,
    here: &'a Iterate,
    hessian: &'a Sparse,
    metric: &'a Sparse,
    active: Vec<bool>,
    right: Vec<f64>,
    /// d, λ, −ν; and its residual.
    solution: Vec<f64>,
    residual: f64,
    /// Those that count: asking at the largest δ does not, where a smaller one is used.
    factorisations: usize,
    /// By how much a row may be wrong.
    tolerance: f64,
}

/// The rows for which a guess is wrong, and whether they are so by no more than the tolerance.
struct Wrong {
    rows: Vec<usize>,
    are_slight: bool,
}

impl<'a> Guess<'a> {
    fn new(
        kkt: &'a mut Kkt,
        (here, error): (&'a Iterate, f64),
        hessian: &'a Sparse,
        metric: &'a Sparse,
        active: &[bool],
    ) -> Self {
        let right = [&here.gradient, &here.equalities, &here.inequalities].into_iter().flatten().map(|v| -v).collect();
        let solution = vec![0.0; kkt.order()];
        let (active, tolerance) = (active.to_vec(), PER_ERROR * error.min(1.0));
        Self { kkt, here, hessian, metric, active, right, solution, residual: 0.0, factorisations: 0, tolerance }
    }

    /// Factorises and solves; whether H + δ D is positive definite where the active constraints vanish.
    fn is_right(&mut self, damping: f64) -> bool {
        self.factorisations += 1;
        let values = KktValues {
            hessian: self.hessian,
            metric: self.metric,
            damping,
            equalities: &self.here.equality_jacobian,
            inequalities: &self.here.inequality_jacobian,
            rows: Rows::Active(&self.active),
        };
        let residual = self.kkt.solve_convex(&values, &self.right, &mut self.solution);
        self.residual = residual.unwrap_or(self.residual);
        residual.is_some()
    }

    /// Raises δ until it is right, to `most` without asking.
    fn raise(&mut self, damping: &mut f64, most: f64) -> Result<(), NoStep> {
        raise(damping)?;
        while *damping < most && !self.is_right(*damping) {
            raise(damping)?;
        }
        if *damping >= most {
            *damping = most;
            self.is_right(most);
        }
        Ok(())
    }

    /// Looks at the solution with the last factorisation.
    fn wrong_rows(&mut self) -> Result<Wrong, NoStep> {
        let consistent = self.residual <= ACCURACY;
        if !consistent && self.kkt.solve_regularised(&self.right, &mut self.solution).is_nan() {
            return Err(NoStep::Singular);
        }
        let n = self.here.x.len();
        let multipliers = &self.solution[n + self.here.equalities.len()..];
        let mut slack = self.here.inequalities.clone();
        self.here.inequality_jacobian.add_product(1.0, &self.solution[..n], &mut slack);
        let largest = |values: &[f64]| values.iter().fold(1e-300, |a: f64, v| a.max(v.abs()));
        let (scale, of_gradient) = (largest(multipliers), largest(&self.here.gradient));
        let (mut rows, mut are_slight) = (Vec::new(), consistent);
        for (row, active) in self.active.iter().enumerate() {
            let (lacks, rounding, unit) = match active {
                true => (multipliers[row], ROUNDING * scale, of_gradient),
                // Nothing joins rows that already contradict each other.
                false if !consistent => continue,
                false => (-slack[row], ROUNDING, 1.0),
            };
            if lacks > rounding {
                rows.push(row);
                are_slight &= lacks <= self.tolerance * unit;
            }
        }
        if rows.is_empty() && !consistent { Err(NoStep::Singular) } else { Ok(Wrong { rows, are_slight }) }
    }

    fn turn(&mut self, rows: &[usize]) {
        rows.iter().for_each(|&row| self.active[row] = !self.active[row]);
    }

    /// The step; of the active set it gives back the rows in `wrong` are turned.
    fn step(mut self, wrong: &[usize]) -> Step {
        self.kkt.solve_further(&self.right, &mut self.solution);
        self.turn(wrong);
        let (direction, multipliers) = self.solution.split_at(self.here.x.len());
        let (lambda, minus_nu) = multipliers.split_at(self.here.equalities.len());
        let of_active = |(y, active): (&f64, &bool)| if *active { (-y).max(0.0) } else { 0.0 };
        Step {
            direction: direction.to_vec(),
            equality_multipliers: lambda.to_vec(),
            inequality_multipliers: minus_nu.iter().zip(&self.active).map(of_active).collect(),
            active: self.active,
            qp_iterations: 0,
            is_settled: self.factorisations == 1 && wrong.is_empty(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nlp::problem::{Curvature, Multipliers, Problem};

    /// min ½ xᵀ H x + gᵀ x subject to x ≥ 0, as far as the linear algebra asks.
    struct Bounded {
        hessian: Sparse,
        equalities: Sparse,
        inequalities: Sparse,
        stages: Vec<usize>,
    }

    impl Problem for Bounded {
        fn variables(&self) -> usize {
            self.hessian.columns
        }
        fn equalities(&self) -> usize {
            0
        }
        fn inequalities(&self) -> usize {
            self.hessian.columns
        }
        fn residual_jacobian(&self) -> &Sparse {
            &self.equalities
        }
        fn residual_data(&self) -> &[f64] {
            &[]
        }
        fn stages(&self) -> &[usize] {
            &self.stages
        }
        fn constraint_stages(&self) -> [&[usize]; 2] {
            [&[], &self.stages]
        }
        fn constraints(&self, x: &[f64], _: &mut [f64], inequalities: &mut [f64]) {
            inequalities.copy_from_slice(x);
        }
        fn feasibility(&self, x: &[f64]) -> f64 {
            x.iter().fold(0.0, |a, x| a.max(-x))
        }
        fn patterns(&self) -> [&Sparse; 3] {
            [&self.equalities, &self.inequalities, &self.hessian]
        }
        fn jacobians(&self, _: &[f64], _: &mut Sparse, inequalities: &mut Sparse) {
            inequalities.clone_from(&self.inequalities);
        }
        fn hessian(&self, _: &[f64], _: Multipliers<'_>, _: Curvature, out: &mut Sparse) {
            out.clone_from(&self.hessian);
        }
        fn metric(&self, _: &[f64], out: &mut Sparse) {
            out.clone_from(&self.hessian);
        }
    }

    /// Turning all wrong rows goes in a circle here from all but two active sets (after an example of F. E. Curtis, Z. Han and D. P. Robinson,
    /// *Comput. Optim. Appl.* 60, 2015).
    #[test]
    fn a_problem_on_which_guessing_goes_in_a_circle_is_solved_from_each_active_set() {
        let entries = [(0, 0, 4.0), (0, 1, 5.0), (1, 1, 9.0), (0, 2, -5.0), (1, 2, -5.0), (2, 2, 7.0)];
        let problem = Bounded {
            hessian: Sparse::from_triplets(3, 3, &entries),
            equalities: Sparse::from_triplets(0, 3, &[]),
            inequalities: Sparse::from_triplets(3, 3, &[(0, 0, 1.0), (1, 1, 1.0), (2, 2, 1.0)]),
            stages: vec![0; 3],
        };
        for sign in [1.0, -1.0] {
            let mut here = Iterate::new(&problem, vec![0.0; 3]);
            here.gradient = [2.0, 1.0, -3.0].map(|g| sign * g).to_vec();
            let mut kkt = Kkt::new(&problem);
            for guess in 0..8 {
                let active = [1, 2, 4].map(|bit| guess & bit != 0);
                let (hessian, mut damping) = (&problem.hessian, 0.0);
                let step =
                    solve(&mut kkt, (&here, 1e-8), hessian, hessian, &mut damping, (1.0, false), &active).unwrap();
                let mut slope = here.gradient.clone();
                hessian.add_symmetric_product(1.0, &step.direction, &mut slope);
                for (x, slope) in step.direction.iter().zip(&slope) {
                    assert!(*x > -1e-9 && *slope > -1e-9 && (x * slope).abs() < 1e-9, "{sign} {guess}: {x} {slope}");
                }
            }
        }
    }
}
