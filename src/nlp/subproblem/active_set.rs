//! The quadratic sub-problem by guessing its active set: solve the equality-constrained problem, put in what is
//! violated, take out what has a negative multiplier, until nothing changes (the primal–dual active set method,
//! Hintermüller, Ito and Kunisch, *SIAM J. Optim.* 13, 2002). Each round is one factorisation; from the active set of
//! the last step it takes few.
//!
//! The Hessian need only be positive definite where the active constraints vanish; if it is not, the damping δ grows.
//!
//! Far from a solution the linearisation is worth no more than some share of the KKT error: rows that are wrong by less
//! are left as they are, and put right in the guess for the next sub-problem.

use super::{NoStep, Quality, Step, Way};
use crate::nlp::curvature::Model;
use crate::nlp::iterate::Iterate;
use crate::nlp::kkt::{Kkt, Rows};
use crate::nlp::options::{ActiveSetOptions, DampingOptions, SqpOptions};
use crate::nlp::state::State;
use crate::numerics::sparse::Sparse;

/// How far δ may be raised.
#[derive(Clone, Copy, Debug)]
pub struct Ceiling {
    pub most: f64,
    /// Where that is in doubt it is asked first: each smaller δ would be tried in vain.
    pub is_in_doubt: bool,
}

/// Solves the sub-problem with the exact Hessian from the guess `active`. δ is raised from `delta` as far as the
/// inertia asks for.
pub fn solve(
    state: &mut State<'_>,
    options: &SqpOptions,
    delta: f64,
    ceiling: Ceiling,
    active: &[bool],
) -> Result<Step, NoStep> {
    let numbers = &options.active_set;
    let mut guess = Guess::new(state, options, delta, active);
    let nearly = numbers.nearly.max(active.len() / numbers.few);
    let mut allowed = nearly.max(active.len() / numbers.many);
    let (mut met, mut in_a_circle) = (Vec::new(), false);
    let mut is_known = ceiling.is_in_doubt && guess.ask_first(ceiling.most)?;
    for round in 0..numbers.rounds {
        if !std::mem::take(&mut is_known) && !guess.is_right(guess.delta) {
            guess.raise(ceiling, round, allowed)?;
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
    numbers: ActiveSetOptions,
    damping: DampingOptions,
    active: Vec<bool>,
    delta: f64,
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
    fn new(state: &'a mut State<'_>, options: &SqpOptions, delta: f64, active: &[bool]) -> Self {
        let State { kkt, here, models, error, .. } = state;
        let (hessian, metric) = models.at(Model::Exact, here);
        let right = [&here.gradient, &here.equalities, &here.inequalities].into_iter().flatten().map(|v| -v).collect();
        Self {
            numbers: options.active_set,
            damping: options.damping,
            active: active.to_vec(),
            delta,
            right,
            solution: vec![0.0; kkt.order()],
            residual: 0.0,
            factorisations: 0,
            tolerance: options.active_set.per_error * error.largest().min(1.0),
            kkt,
            here,
            hessian,
            metric,
        }
    }

    /// Factorises and solves; whether H + δ D is positive definite where the active constraints vanish.
    fn is_right(&mut self, delta: f64) -> bool {
        self.factorisations += 1;
        let values = self.here.system((self.hessian, self.metric), delta, Rows::Active(&self.active));
        let residual = self.kkt.solve_convex(&values, &self.right, &mut self.solution);
        self.residual = residual.unwrap_or(self.residual);
        residual.is_some()
    }

    /// Asks the largest δ; whether that is the one to use.
    fn ask_first(&mut self, most: f64) -> Result<bool, NoStep> {
        if !self.is_right(self.delta.max(most)) {
            return Err(NoStep::TooCurved);
        }
        let is_used = self.delta >= most;
        self.factorisations = usize::from(is_used);
        Ok(is_used)
    }

    /// What has been lowered is raised again. Where the largest δ is not enough, or its step belongs to quite another
    /// active set, none between is tried.
    fn raise(&mut self, Ceiling { most, is_in_doubt }: Ceiling, round: usize, allowed: usize) -> Result<(), NoStep> {
        let next = self.damping.raise * self.delta;
        if !is_in_doubt && round == 0 && next < most && self.is_right(next) {
            self.delta = next;
            return Ok(());
        }
        if self.delta >= most || !self.is_right(most) {
            return Err(NoStep::TooCurved);
        }
        if self.wrong_rows()?.rows.len() > allowed {
            return Err(NoStep::Unsettled);
        }
        loop {
            self.delta = self.damping.raised(self.delta).ok_or(NoStep::Singular)?;
            if self.delta >= most {
                self.delta = most;
                self.is_right(most);
                return Ok(());
            }
            if self.is_right(self.delta) {
                return Ok(());
            }
        }
    }

    /// Looks at the solution with the last factorisation.
    fn wrong_rows(&mut self) -> Result<Wrong, NoStep> {
        let consistent = self.residual <= self.numbers.accuracy;
        if !consistent && self.kkt.solve_regularised(&self.right, &mut self.solution).is_nan() {
            return Err(NoStep::Singular);
        }
        let n = self.here.x.len();
        let multipliers = &self.solution[n + self.here.equalities.len()..];
        let mut slack = self.here.inequalities.clone();
        self.here.inequality_jacobian.add_product(1.0, &self.solution[..n], &mut slack);
        let largest = |values: &[f64]| values.iter().fold(1e-300, |a: f64, v| a.max(v.abs()));
        let rounding = self.numbers.rounding;
        let (scale, of_gradient) = (largest(multipliers), largest(&self.here.gradient));
        let (mut rows, mut are_slight) = (Vec::new(), consistent);
        for (row, active) in self.active.iter().enumerate() {
            let (lacks, least, unit) = match active {
                true => (multipliers[row], rounding * scale, of_gradient),
                // Nothing joins rows that already contradict each other.
                false if !consistent => continue,
                false => (-slack[row], rounding, 1.0),
            };
            if lacks > least {
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
            damping: self.delta,
            way: Way::ActiveSet,
            quality: Quality::Full,
            has_factors: true,
            is_settled: self.factorisations == 1 && wrong.is_empty(),
            qp_iterations: 0,
        }
    }
}
