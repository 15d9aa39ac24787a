//! Uniqueness beyond ranks: how far a non-unique solution can move, along which directions, and how sensitive the
//! muscle forces are to parameters.

use std::collections::BTreeMap;

use crate::deadline::Deadline;
use crate::nlp::iterate::Iterate;
use crate::nlp::kkt::{Kkt, KktValues, Rows};
use crate::nlp::polish::active;
use crate::nlp::problem::{Curvature, Problem};
use crate::nlp::qp::QuadraticProgramme;
use crate::numerics::sparse::Sparse;
use crate::outcome::SensitivityRow;
use crate::transcription::collocation::{Collocation, Combination, evaluate};
use crate::transcription::instant::{ACTIVATION, ACTIVATION_RATE, EXCITATION, LENGTH, VELOCITY};

/// A null direction of length 1 moves a mean activation if it changes it by more than this.
const MOVES_ACTIVATION: f64 = 1e-6;
/// An active bound is strongly active if its multiplier exceeds this fraction of the largest one.
const STRONGLY_ACTIVE: f64 = 1e-9;
/// Parts with a smaller share of the null space are not described.
const MIN_SHARE: f64 = 0.05;
/// Largest number of parts described.
const MAX_PARTS: usize = 5;
/// A linear system whose relative residual exceeds this counts as unsolvable.
const MAX_RESIDUAL: f64 = 1e-6;

/// The interval of each muscle's mean activation over all solutions that are equally good to first order: constraints
/// and residuals unchanged, strongly active bounds still active, other bounds not crossed, activations within 0 … 1
/// (or no further outside than they are).
///
/// `means`: each muscle's mean activation as a linear combination of x; `null_directions`: see [`Regularity`]. The
/// interval is `None` if a linear programme fails.
///
/// [`Regularity`]: crate::nlp::regularity::Regularity
pub fn activation_intervals(
    problem: &Collocation<'_>,
    iterate: &Iterate,
    means: &[Combination],
    null_directions: &[Vec<f64>],
    deadline: Deadline,
) -> Vec<Option<(f64, f64)>> {
    let moves = |mean: &Combination| null_directions.iter().any(|d| evaluate(mean, d).abs() > MOVES_ACTIVATION);
    let mut programme = None;
    means
        .iter()
        .map(|mean| {
            let value = evaluate(mean, &iterate.x);
            if !moves(mean) {
                return Some((value, value));
            }
            let programme = programme.get_or_insert_with(|| OptimalSet::new(problem, iterate, deadline));
            let (low, high) = (programme.least(mean, 1.0)?, -programme.least(mean, -1.0)?);
            Some((value + low.min(0.0), value + high.max(0.0)))
        })
        .collect()
}

/// The steps d to equally good solutions, to first order: E d = 0, F d + s ≥ 0.
struct OptimalSet {
    equalities: Sparse,
    inequalities: Sparse,
    slack: Vec<f64>,
    deadline: Deadline,
}

impl OptimalSet {
    fn new(problem: &Collocation<'_>, iterate: &Iterate, deadline: Deadline) -> Self {
        let n = iterate.x.len();
        let largest = iterate.inequality_multipliers.iter().fold(0.0f64, |a, nu| a.max(*nu));
        let is_active = active(&iterate.inequalities);
        let kept: Vec<bool> = (is_active.iter().zip(&iterate.inequality_multipliers))
            .map(|(&active, &nu)| active && nu > STRONGLY_ACTIVE * largest)
            .collect();
        let (mut equal, mut unequal) = (Vec::new(), Vec::new());
        let mut rows = 0;
        let mut stack = |matrix: &Sparse, keep: &dyn Fn(usize) -> bool| {
            let mut place = vec![usize::MAX; matrix.rows];
            for row in (0..matrix.rows).filter(|&row| keep(row)) {
                place[row] = rows;
                rows += 1;
            }
            let entries = matrix.entries().filter(|(row, ..)| place[*row] != usize::MAX);
            equal.extend(entries.map(|(row, column, slot)| (place[row], column, matrix.values[slot])));
        };
        stack(&iterate.equality_jacobian, &|_| true);
        stack(problem.residual_jacobian(), &|_| true);
        stack(&iterate.inequality_jacobian, &|row| kept[row]);
        let equalities = Sparse::from_triplets(rows, n, &equal);
        let mut slack = Vec::new();
        let mut place = vec![usize::MAX; kept.len()];
        for row in (0..kept.len()).filter(|&row| !kept[row]) {
            place[row] = slack.len();
            slack.push(iterate.inequalities[row].max(0.0));
        }
        for (row, column, slot) in iterate.inequality_jacobian.entries().filter(|(row, ..)| !kept[*row]) {
            unequal.push((place[row], column, iterate.inequality_jacobian.values[slot]));
        }
        for (j, point) in problem.layout.points.iter().enumerate() {
            let z = problem.local(j, &iterate.x);
            for m in 0..problem.instant.model.muscles.len() {
                let at = problem.instant.muscle(m) + ACTIVATION;
                for (sign, room) in [(1.0, z[at].max(0.0)), (-1.0, (1.0 - z[at]).max(0.0))] {
                    unequal.extend(point.map[at].iter().map(|&(column, weight)| (slack.len(), column, sign * weight)));
                    slack.push(room);
                }
            }
        }
        Self { equalities, inequalities: Sparse::from_triplets(slack.len(), n, &unequal), slack, deadline }
    }

    /// Least value of `sign` times the functional over these steps. `None` if the linear programme fails.
    fn least(&self, functional: &Combination, sign: f64) -> Option<f64> {
        let n = self.equalities.columns;
        let mut gradient = vec![0.0; n];
        functional.iter().for_each(|&(i, weight)| gradient[i] += sign * weight);
        let solution = QuadraticProgramme {
            hessian: &Sparse::from_triplets(n, n, &[]),
            gradient: &gradient,
            equalities: &self.equalities,
            equality_values: &vec![0.0; self.equalities.rows],
            inequalities: &self.inequalities,
            inequality_values: &self.slack,
            deadline: self.deadline,
        }
        .solve()
        .ok()?;
        Some(sign * evaluate(functional, &solution.step)).filter(|value| value.is_finite())
    }
}

/// Describes in words which quantities the null directions move, the largest share first. `None` if there are none.
pub fn describe(problem: &Collocation<'_>, null_directions: &[Vec<f64>], idle: &[bool]) -> Option<String> {
    let instant = &problem.instant;
    let model = instant.model;
    // By (muscle, kind of state): sum of squares, and sum of products of consecutive values.
    let mut shares: BTreeMap<(usize, usize), (f64, f64)> = BTreeMap::new();
    let mut total = 0.0;
    let times = &problem.layout.times;
    let step = (times[times.len() - 1] - times[0]) / (times.len() - 1) as f64;
    for direction in null_directions {
        let mut before: BTreeMap<(usize, usize, bool), f64> = BTreeMap::new();
        for j in 0..problem.layout.points.len() {
            let z = problem.local(j, direction);
            // A state that alternates may be zero at every point, so its rate times half a step counts too. Products of
            // consecutive values and of consecutive rates are formed separately.
            let mut note = |what: (usize, usize), is_rate: bool, value: f64| {
                let share = shares.entry(what).or_default();
                share.0 += value * value;
                share.1 += value * before.insert((what.0, what.1, is_rate), value).unwrap_or(0.0);
                total += value * value;
            };
            for m in 0..model.muscles.len() {
                let at = instant.muscle(m);
                for kind in [ACTIVATION, LENGTH, EXCITATION] {
                    note((m, kind), false, z[at + kind]);
                }
                note((m, ACTIVATION), true, 0.5 * step * z[at + ACTIVATION_RATE]);
                note((m, LENGTH), true, 0.5 * step * z[at + VELOCITY]);
            }
            // Joint reactions follow from the muscle forces and are not described.
            let motion = z[..model.coordinates()].iter().map(|v| v * v).sum::<f64>().sqrt();
            note((model.muscles.len(), 0), false, motion);
        }
    }
    let mut parts: Vec<(f64, String)> = shares
        .into_iter()
        .filter(|(_, (square, _))| *square >= MIN_SHARE * total && total > 0.0)
        .map(|((m, kind), (square, product))| {
            let moves = if product < -0.3 * square { "alternates between points" } else { "free" };
            let words = match model.muscles.get(m) {
                None => format!("the motion {moves}"),
                Some(muscle) => {
                    let what = [(ACTIVATION, "activation"), (LENGTH, "fibre length"), (EXCITATION, "excitation")];
                    let what = what.iter().find(|(k, _)| *k == kind).map_or("", |(_, name)| name);
                    let idle = if idle[m] { " while idle" } else { "" };
                    format!("{}: {what} {moves}{idle}", muscle.name)
                }
            };
            (square / total, words)
        })
        .collect();
    parts.sort_by(|a, b| b.0.total_cmp(&a.0));
    parts.truncate(MAX_PARTS);
    let words: Vec<String> =
        parts.into_iter().map(|(share, words)| format!("{words} ({:.0} %)", 100.0 * share)).collect();
    (!words.is_empty()).then(|| words.join("; "))
}

/// A parameter θ, with the derivatives of the optimality conditions with respect to it at fixed x, λ and ν.
pub struct Parameter {
    /// `mu`, or the path of a numeric parameter of the model.
    pub name: String,
    /// θ
    pub value: f64,
    /// ∂(∇L)/∂θ
    pub gradient: Vec<f64>,
    /// ∂c/∂θ
    pub equalities: Vec<f64>,
}

/// The parameters: μ (if positive), and the tendon slack length of every muscle. `sharing`: the first load-sharing row
/// (μ a) of J.
pub fn parameters(problem: &Collocation<'_>, iterate: &Iterate, mu: f64, sharing: usize) -> Vec<Parameter> {
    let (n, me) = (iterate.x.len(), iterate.equalities.len());
    let mut parameters = Vec::new();
    if mu > 0.0 {
        // J_s = μ R, so that ∇(½‖J_s x‖²) = μ² RᵀR x.
        let jacobian = problem.residual_jacobian();
        let mut residual = vec![0.0; jacobian.rows];
        jacobian.add_product(1.0, &iterate.x, &mut residual);
        residual[..sharing].fill(0.0);
        let mut gradient = vec![0.0; n];
        jacobian.add_transpose_product(2.0 / mu, &residual, &mut gradient);
        parameters.push(Parameter { name: "mu".to_owned(), value: mu, gradient, equalities: vec![0.0; me] });
    }
    let instant = &problem.instant;
    let [_, contraction, _] = instant.row_starts();
    let rows = problem.rows().equalities;
    for (m, muscle) in instant.model.muscles.iter().enumerate() {
        let (mut gradient, mut equalities) = (vec![0.0; n], vec![0.0; me]);
        for (row, &(point, equation)) in rows.iter().enumerate() {
            let Some(j) = point.filter(|_| equation == contraction + m) else { continue };
            let z = problem.local(j, &iterate.x);
            let (slope, mixed) = instant.slope_by_slack(problem.layout.times[j], &z, m);
            let lambda = iterate.equality_multipliers[row];
            equalities[row] = slope;
            for (local, by) in mixed {
                problem.layout.points[j].map[local].iter().for_each(|&(i, weight)| gradient[i] += weight * lambda * by);
            }
        }
        let name = format!("muscle.{}.tendon_slack_length", muscle.name);
        parameters.push(Parameter { name, value: muscle.tendon_slack_length, gradient, equalities });
    }
    parameters
}

/// The KKT system at a solution, factorised with the active set fixed. It gives the first-order response of the
/// solution to changes in the problem.
pub struct Linearised<'k> {
    kkt: &'k mut Kkt,
    unknowns: usize,
}

impl<'k> Linearised<'k> {
    /// Factorises the KKT matrix. `None` if this fails, or the inertia shows that the solution is not a strict minimum.
    pub fn new(kkt: &'k mut Kkt, problem: &Collocation<'_>, iterate: &Iterate) -> Option<Self> {
        let [_, _, pattern] = problem.patterns();
        let (mut hessian, metric) = (pattern.clone(), pattern.clone());
        problem.hessian(&iterate.x, iterate.multipliers(), Curvature::Exact, &mut hessian);
        let inertia = kkt.factorise(&KktValues {
            hessian: &hessian,
            metric: &metric,
            damping: 0.0,
            equalities: &iterate.equality_jacobian,
            inequalities: &iterate.inequality_jacobian,
            rows: Rows::Active(&active(&iterate.inequalities)),
        })?;
        let unknowns = iterate.x.len();
        (inertia.positive == unknowns).then_some(Self { kkt, unknowns })
    }

    /// The changes of x and of the equality multipliers in response to the changes `gradient` of ∇L and `equalities`
    /// of the equality constraints c. `None` if the system does not determine them.
    pub fn follow(&mut self, gradient: &[f64], equalities: &[f64]) -> Option<(Vec<f64>, Vec<f64>)> {
        let n = self.unknowns;
        let (mut right, mut solution) = (vec![0.0; self.kkt.order()], vec![0.0; self.kkt.order()]);
        right[..n].iter_mut().zip(gradient).for_each(|(r, g)| *r = -g);
        right[n..n + equalities.len()].iter_mut().zip(equalities).for_each(|(r, c)| *r = -c);
        if self.kkt.solve_roughly(&right, &mut solution) > MAX_RESIDUAL {
            return None;
        }
        let multipliers = solution[n..n + equalities.len()].to_vec();
        solution.truncate(n);
        Some((solution, multipliers))
    }
}

/// ∂(mean force)/∂θ of every muscle for every parameter, without another optimisation. Parameters whose effect the KKT
/// system does not determine are left out.
///
/// `mean_force`: the change of the mean forces (N) along a direction of x; `means`: the mean forces, N.
pub fn sensitivities(
    linearised: &mut Linearised<'_>,
    problem: &Collocation<'_>,
    parameters: &[Parameter],
    mean_force: impl Fn(&[f64]) -> Vec<f64>,
    means: &[f64],
) -> Vec<SensitivityRow> {
    let mut rows = Vec::new();
    for parameter in parameters {
        let Some((step, _)) = linearised.follow(&parameter.gradient, &parameter.equalities) else { continue };
        for (m, slope) in mean_force(&step).into_iter().enumerate() {
            rows.push(SensitivityRow {
                muscle: problem.instant.model.muscles[m].name.clone(),
                parameter: parameter.name.clone(),
                parameter_value: parameter.value,
                mean_force_slope: slope,
                elasticity: (means[m] > 1e-6).then(|| slope * parameter.value / means[m]),
            });
        }
    }
    rows
}
