//! The linear criteria: Σ w |e| (p = 1), and max e with the lexicographic stages after it.
//!
//! ```text
//! minimise β + Σ_others w |r|    subject to A x = b,   e_i ≤ β of all muscles,   bounds
//! ```
//!
//! Afterwards the muscles whose bound e_i ≤ β has a multiplier keep β as their bound, and the programme is solved for the rest.
//! The end is unique; the first maximum is not.

use super::{Criterion, Failure, Optimum, Programme};
use crate::deadline::Deadline;
use crate::nlp::subproblem::qp::{QpSolution, QuadraticProgramme};
use crate::numerics::sparse::Sparse;

/// A muscle stays at the maximum if its multiplier exceeds this share of their sum.
const AT_MAXIMUM: f64 = 1e-6;
/// The stages end below this maximum.
const NOTHING_LEFT: f64 = 1e-7;
/// How much more a muscle may have that stays at a maximum, so that rounding does not make the next programme infeasible.
const ROUNDING: f64 = 1e-9;

/// A linear programme over x⁺, x⁻ (of variables that may be negative) and the maximum β.
struct Linear<'p> {
    programme: &'p Programme,
    /// First and, if it may be negative, second part of each variable.
    parts: Vec<(usize, Option<usize>)>,
    /// β, if there is one.
    maximum: Option<usize>,
    count: usize,
    equalities: Vec<(usize, usize, f64)>,
    right: Vec<f64>,
    inequalities: Vec<(usize, usize, f64)>,
    slack: Vec<f64>,
    /// The rows of each variable's bounds.
    bound_rows: Vec<[Option<usize>; 2]>,
}

impl<'p> Linear<'p> {
    fn new(programme: &'p Programme, has_maximum: bool) -> Self {
        let mut count = 0;
        let mut next = || {
            count += 1;
            count - 1
        };
        let parts: Vec<(usize, Option<usize>)> =
            programme.terms.iter().map(|term| (next(), (!term.is_muscle).then(&mut next))).collect();
        let maximum = has_maximum.then(&mut next);
        let mut linear = Self {
            programme,
            parts,
            maximum,
            count,
            equalities: Vec::new(),
            right: programme.right.clone(),
            inequalities: Vec::new(),
            slack: Vec::new(),
            bound_rows: Vec::new(),
        };
        for (i, column) in programme.columns.iter().enumerate() {
            for &(row, value) in column {
                linear.equalities.extend(linear.entries(i, value).map(|(part, value)| (row, part, value)));
            }
        }
        for (i, term) in programme.terms.iter().enumerate() {
            let [low, high] = term.bounds;
            let entries: Vec<(usize, f64)> = linear.entries(i, 1.0).collect();
            let lower = low.is_finite().then(|| linear.at_least(&entries, low));
            let negative: Vec<(usize, f64)> = entries.iter().map(|(part, value)| (*part, -value)).collect();
            let upper = high.is_finite().then(|| linear.at_least(&negative, -high));
            linear.bound_rows.push([lower, upper]);
            if linear.parts[i].1.is_some() {
                for (part, _) in &entries {
                    linear.at_least(&[(*part, 1.0)], 0.0);
                }
            }
        }
        linear
    }

    /// The parts of variable i, with their signs times `value`.
    fn entries(&self, i: usize, value: f64) -> impl Iterator<Item = (usize, f64)> + use<> {
        let (positive, negative) = self.parts[i];
        [(positive, value)].into_iter().chain(negative.map(|part| (part, -value)))
    }

    /// Adds `entries · x ≥ bound`; returns the row.
    fn at_least(&mut self, entries: &[(usize, f64)], bound: f64) -> usize {
        let row = self.slack.len();
        self.inequalities.extend(entries.iter().map(|&(part, value)| (row, part, value)));
        self.slack.push(-bound);
        row
    }

    /// Adds e_i ≤ β.
    fn below_maximum(&mut self, i: usize) -> usize {
        let term = self.programme.terms[i];
        let beta = self.maximum.expect("a programme with a maximum");
        let mut entries: Vec<(usize, f64)> = self.entries(i, -term.scale).collect();
        entries.push((beta, 1.0));
        self.at_least(&entries, term.offset)
    }

    /// The criterion without constants: β, or Σ w e, and Σ w |r|.
    fn cost(&self) -> Vec<f64> {
        let mut cost = vec![0.0; self.count];
        for (term, (positive, negative)) in self.programme.terms.iter().zip(&self.parts) {
            let slope = term.weight * term.scale;
            match negative {
                Some(negative) => (cost[*positive], cost[*negative]) = (slope.abs(), slope.abs()),
                None if self.maximum.is_none() => cost[*positive] = slope,
                None => {}
            }
        }
        if let Some(beta) = self.maximum {
            cost[beta] = 1.0;
        }
        cost
    }

    fn solve(&self, gradient: &[f64], deadline: Deadline) -> Result<QpSolution, Failure> {
        let rows = self.right.len();
        let found = QuadraticProgramme {
            hessian: &Sparse::from_triplets(self.count, self.count, &[]),
            gradient,
            equalities: &Sparse::from_triplets(rows, self.count, &self.equalities),
            equality_values: &self.right.iter().map(|b| -b).collect::<Vec<f64>>(),
            inequalities: &Sparse::from_triplets(self.slack.len(), self.count, &self.inequalities),
            inequality_values: &self.slack,
            deadline,
        };
        Ok(found.solve()?)
    }

    fn x(&self, step: &[f64]) -> Vec<f64> {
        let value = |(positive, negative): &(usize, Option<usize>)| step[*positive] - negative.map_or(0.0, |k| step[k]);
        let within = |x: f64, [low, high]: [f64; 2]| x.max(low).min(high);
        self.parts.iter().zip(&self.programme.terms).map(|(part, term)| within(value(part), term.bounds)).collect()
    }

    fn optimum(&self, solution: &QpSolution, value: f64, iterations: usize, stages: usize) -> Optimum {
        let of = |bound: usize| {
            let multiplier = |rows: &[Option<usize>; 2]| rows[bound].map_or(0.0, |row| solution.inequalities[row]);
            self.bound_rows.iter().map(multiplier).collect()
        };
        Optimum {
            x: self.x(&solution.step),
            multipliers: solution.equalities.iter().map(|lambda| -lambda).collect(),
            lower: of(0),
            upper: of(1),
            value,
            iterations,
            stages,
            is_unique: false,
        }
    }
}

/// Muscles of a programme.
fn muscles(programme: &Programme) -> Vec<usize> {
    (0..programme.terms.len()).filter(|&i| programme.terms[i].is_muscle).collect()
}

/// Σ w o of the muscles, which [`Linear::cost`] leaves out.
fn constant(programme: &Programme) -> f64 {
    programme.terms.iter().filter(|term| term.is_muscle).map(|term| term.weight * term.offset).sum()
}

/// The least Σ w |e|.
pub fn sum(programme: &Programme, deadline: Deadline) -> Result<Optimum, Failure> {
    let linear = Linear::new(programme, false);
    let cost = linear.cost();
    let solution = linear.solve(&cost, deadline)?;
    let value = constant(programme) + cost.iter().zip(&solution.step).map(|(c, x)| c * x).sum::<f64>();
    Ok(linear.optimum(&solution, value, solution.iterations, 1))
}

/// The least maximum, and the least maximum of the rest, and so on; reserves and actuators never cost more than with the first.
pub fn min_max(programme: &Programme, deadline: Deadline) -> Result<Optimum, Failure> {
    let mut bounded = programme.clone();
    let mut rest = muscles(programme);
    let mut found: Option<(Optimum, f64)> = None;
    let (mut iterations, mut stages) = (0, 0);
    loop {
        let mut linear = Linear::new(&bounded, true);
        let rows: Vec<usize> = rest.iter().map(|&i| linear.below_maximum(i)).collect();
        let beta = linear.maximum.expect("a programme with a maximum");
        // Without muscles left, the maximum is 0.
        linear.at_least(&[(beta, 1.0)], 0.0);
        let cost = linear.cost();
        let beside = |step: &[f64]| -> f64 { (0..step.len()).filter(|&k| k != beta).map(|k| cost[k] * step[k]).sum() };
        if let Some((_, limit)) = &found {
            let others = cost.iter().enumerate().filter(|(k, c)| *k != beta && **c != 0.0);
            let row: Vec<(usize, f64)> = others.map(|(k, c)| (k, -c)).collect();
            linear.at_least(&row, -(limit + ROUNDING * (1.0 + limit)));
        }
        let solution = match (linear.solve(&cost, deadline), found.take()) {
            (Ok(solution), before) => {
                found = before;
                solution
            }
            // Bounds that hold up to rounding: what was found before is as good, but not known to be the end.
            (Err(_), Some((optimum, _))) if !deadline.passed() => return Ok(optimum),
            (Err(why), _) => return Err(why),
        };
        (iterations, stages) = (iterations + solution.iterations, stages + 1);
        let maximum = solution.step[beta];
        let value = found.as_ref().map_or(maximum + beside(&solution.step), |(optimum, _)| optimum.value);
        let limit = found.as_ref().map_or(beside(&solution.step), |(_, limit)| *limit);
        let total: f64 = rows.iter().map(|&row| solution.inequalities[row]).sum();
        let stays = |row: usize| solution.inequalities[row] > AT_MAXIMUM * total;
        let fixed: Vec<usize> = rest.iter().zip(&rows).filter(|(_, row)| stays(**row)).map(|(i, _)| *i).collect();
        let is_end = maximum < NOTHING_LEFT || fixed.len() == rest.len();
        let optimum = Optimum { is_unique: is_end, ..linear.optimum(&solution, value, iterations, stages) };
        if is_end || fixed.is_empty() {
            return Ok(optimum);
        }
        for i in fixed {
            let term = &mut bounded.terms[i];
            // e ≤ β as a bound on x; scales are positive.
            let most = (maximum + ROUNDING - term.offset) / term.scale;
            term.bounds[1] = most.max(term.bounds[0]).min(term.bounds[1]);
            rest.retain(|&other| other != i);
        }
        found = Some((optimum, limit));
    }
}

/// x_i where `sign · x_i` is least and the criterion (of min/max the first maximum) is at most `budget`.
pub fn least(programme: &Programme, i: usize, sign: f64, budget: f64, deadline: Deadline) -> Result<f64, Failure> {
    let is_maximum = programme.criterion == Criterion::MinMax;
    let mut linear = Linear::new(programme, is_maximum);
    if is_maximum {
        for i in muscles(programme) {
            linear.below_maximum(i);
        }
    }
    let left = if is_maximum { budget } else { budget - constant(programme) };
    let cost: Vec<(usize, f64)> = linear.cost().into_iter().enumerate().map(|(part, c)| (part, -c)).collect();
    linear.at_least(&cost, -left);
    let mut gradient = vec![0.0; linear.count];
    linear.entries(i, sign).for_each(|(part, value)| gradient[part] = value);
    let solution = linear.solve(&gradient, deadline)?;
    Ok(linear.x(&solution.step)[i])
}
