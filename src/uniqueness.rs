//! Uniqueness beyond ranks: how far a non-unique solution can move, along which directions, and how sensitive the
//! muscle forces are to parameters.

use std::collections::BTreeMap;

use crate::deadline::Deadline;
use crate::methods::InverseProblem;
use crate::methods::muscle_force::MuscleForce;
use crate::model::Model;
use crate::nlp::iterate::Iterate;
use crate::nlp::kkt::{Kkt, Rows};
use crate::nlp::polish::active;
use crate::nlp::problem::{Curvature, Problem, objective_rows};
use crate::nlp::subproblem::qp::QuadraticProgramme;
use crate::numerics::sparse::Sparse;
use crate::outcome::SensitivityRow;
use crate::problem::{Kind, QuantityId};
use crate::transcription::collocation::Collocation;
use crate::transcription::scheme::{Combination, evaluate};

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
    inverse: &InverseProblem<'_>,
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
            let programme = programme.get_or_insert_with(|| OptimalSet::new(inverse, problem, iterate, deadline));
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
    fn new(inverse: &InverseProblem<'_>, problem: &Collocation<'_>, iterate: &Iterate, deadline: Deadline) -> Self {
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
        stack(&objective_rows(problem, &iterate.x), &|_| true);
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
        for (j, point) in problem.points.iter().enumerate() {
            let z = problem.local(j, &iterate.x);
            for a in inverse.muscles.a.range() {
                for (sign, room) in [(1.0, z[a].max(0.0)), (-1.0, (1.0 - z[a]).max(0.0))] {
                    let row = point.map.combinations[a].iter();
                    unequal.extend(row.map(|&(column, weight)| (slack.len(), column, sign * weight)));
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

/// What a null direction may move.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Part {
    /// A function of a quantity, by member and quantity.
    Function(usize, QuantityId),
    Motion,
}

/// Describes in words which quantities the null directions move, the largest share first. `None` if there are none.
pub fn describe(
    inverse: &InverseProblem<'_>,
    problem: &Collocation<'_>,
    null_directions: &[Vec<f64>],
    idle: &[bool],
) -> Option<String> {
    let shares = shares(inverse, problem, null_directions);
    let total: f64 = shares.values().map(|(square, _)| square).sum();
    let mut parts: Vec<(f64, String)> = shares
        .into_iter()
        .filter(|(_, (square, _))| *square >= MIN_SHARE * total && total > 0.0)
        .map(|(part, (square, product))| {
            let moves = if product < -0.3 * square { "alternates between points" } else { "free" };
            let words = match part {
                Part::Motion => format!("the motion {moves}"),
                Part::Function(member, id) => {
                    let quantity = inverse.control.quantity(id);
                    let muscles = &inverse.muscles;
                    let own = [Some(muscles.activation), muscles.fibre_length, muscles.excitation];
                    let of_muscle = own.contains(&Some(id));
                    let is_idle = of_muscle && idle[member];
                    let while_idle = if is_idle { " while idle" } else { "" };
                    format!("{}: {} {moves}{while_idle}", quantity.members[member], quantity.name.replace('_', " "))
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

/// Of each part its sum of squares in the null directions, and its sum of products of consecutive values.
fn shares(
    inverse: &InverseProblem<'_>,
    problem: &Collocation<'_>,
    null_directions: &[Vec<f64>],
) -> BTreeMap<Part, (f64, f64)> {
    let (control, motion) = (&inverse.control, &inverse.motion);
    let mut shares: BTreeMap<Part, (f64, f64)> = BTreeMap::new();
    let times = problem.scheme.points();
    let step = (times[times.len() - 1] - times[0]) / (times.len() - 1) as f64;
    // Joint reactions follow from the muscle forces and are not described; the motion is described as one.
    let is_described = |id: QuantityId| {
        let is_motion = id == motion.coordinate || Some(id) == motion.velocity;
        !is_motion && !matches!(control.quantity(id).kind, Kind::Algebraic | Kind::Given)
    };
    for direction in null_directions {
        let mut before: BTreeMap<(Part, usize), f64> = BTreeMap::new();
        for j in 0..problem.points.len() {
            let z = problem.local_change(j, direction);
            // A state that alternates may be zero at every point, so its rate times half a step counts too. Products of
            // consecutive values and of consecutive rates are formed separately.
            let mut note = |part: Part, derivative: usize, value: f64| {
                let share = shares.entry(part).or_default();
                share.0 += value * value;
                share.1 += value * before.insert((part, derivative), value).unwrap_or(0.0);
            };
            for read in control.reads.iter().filter(|read| is_described(read.quantity)) {
                let unit = if read.derivative == 0 { 1.0 } else { 0.5 * step };
                for (member, variable) in read.variables.range().enumerate() {
                    note(Part::Function(member, read.quantity), read.derivative, unit * z[variable]);
                }
            }
            note(Part::Motion, 0, motion.q.of(&z).iter().map(|v| v * v).sum::<f64>().sqrt());
        }
    }
    shares
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

/// The parameters: μ (if positive), and the tendon slack length of every muscle.
pub fn parameters(
    inverse: &InverseProblem<'_>,
    problem: &Collocation<'_>,
    iterate: &Iterate,
    mu: f64,
) -> Vec<Parameter> {
    let (n, me) = (iterate.x.len(), iterate.equalities.len());
    let mut parameters = Vec::new();
    if mu > 0.0 {
        // All goals but tracking have the factor μ².
        let jacobian = problem.residual_jacobian();
        let mut residual = vec![0.0; jacobian.rows];
        jacobian.add_product(1.0, &iterate.x, &mut residual);
        residual[problem.objective.rows("tracking")].fill(0.0);
        let mut gradient = vec![0.0; n];
        jacobian.add_transpose_product(2.0 / mu, &residual, &mut gradient);
        if let Some(term) = problem.term() {
            let slopes: Vec<f64> = term.parts(&iterate.x).iter().map(|part| part[1]).collect();
            term.functions().add_transpose_product(2.0 / mu, &slopes, &mut gradient);
        }
        parameters.push(Parameter { name: "mu".to_owned(), value: mu, gradient, equalities: vec![0.0; me] });
    }
    let rows = problem.equality_names();
    let contractions = inverse.forces.iter().filter_map(|force| match force {
        MuscleForce::Contraction(contraction) => Some(contraction),
        MuscleForce::Linear(_) => None,
    });
    for contraction in contractions {
        let (mut gradient, mut equalities) = (vec![0.0; n], vec![0.0; me]);
        for (row, &(point, equation)) in rows.iter().enumerate() {
            let Some(j) = point.filter(|_| equation == contraction.row) else { continue };
            let (slope, mixed) = contraction.slope_by_slack(&problem.local(j, &iterate.x));
            let lambda = iterate.equality_multipliers[row];
            equalities[row] = slope;
            for (variable, by) in mixed {
                let terms = problem.points[j].map.combinations[variable].iter();
                terms.for_each(|&(i, weight)| gradient[i] += weight * lambda * by);
            }
        }
        let name = format!("muscle.{}.tendon_slack_length", contraction.muscle.name);
        parameters.push(Parameter { name, value: contraction.muscle.tendon_slack_length, gradient, equalities });
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
        let active = active(&iterate.inequalities);
        let inertia = kkt.factorise(&iterate.system((&hessian, &metric), 0.0, Rows::Active(&active)))?;
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
    model: &Model,
    parameters: &[Parameter],
    mean_force: impl Fn(&[f64]) -> Vec<f64>,
    means: &[f64],
) -> Vec<SensitivityRow> {
    let mut rows = Vec::new();
    for parameter in parameters {
        let Some((step, _)) = linearised.follow(&parameter.gradient, &parameter.equalities) else { continue };
        for (m, slope) in mean_force(&step).into_iter().enumerate() {
            rows.push(SensitivityRow {
                muscle: model.muscles[m].name.clone(),
                parameter: parameter.name.clone(),
                parameter_value: parameter.value,
                mean_force_slope: slope,
                elasticity: (means[m] > 1e-6).then(|| slope * parameter.value / means[m]),
            });
        }
    }
    rows
}
