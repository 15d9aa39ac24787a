//! Warm start: a solved problem as the starting point of another, on a finer mesh or with other parameters.
//!
//! Functions of time are transferred exactly if the new space contains the old one. Multipliers and active bounds are
//! taken from the nearest collocation point, multipliers in proportion to the quadrature weights.

use std::collections::HashMap;
use std::sync::Arc;

use crate::methods::InverseProblem;
use crate::nlp::iterate::Iterate;
use crate::nlp::polish::active;
use crate::nlp::sqp::Start;
use crate::problem::{Equation, Kind, Limit, Quantity, QuantityId};
use crate::transcription::collocation::Collocation;
use crate::transcription::places::Bound;
use crate::transcription::scheme::{Discretisation, Trajectory, evaluate};

/// A converged solution, with everything needed to start another problem from it.
pub struct Answer {
    scheme: Arc<dyn Discretisation>,
    quantities: Vec<Quantity>,
    equations: Vec<Equation>,
    limits: Vec<Limit>,
    equality_names: Vec<(Option<usize>, usize)>,
    bounds: Vec<Bound>,
    x: Vec<f64>,
    equality_multipliers: Vec<f64>,
    inequality_multipliers: Vec<f64>,
    active: Vec<bool>,
}

impl Answer {
    pub fn new(problem: &Collocation<'_>, scheme: Arc<dyn Discretisation>, iterate: &Iterate) -> Self {
        Self {
            scheme,
            quantities: problem.control.quantities.clone(),
            equations: problem.control.equations.clone(),
            limits: problem.control.limits.clone(),
            equality_names: problem.equality_names(),
            bounds: problem.bounds.clone(),
            x: iterate.x.clone(),
            equality_multipliers: iterate.equality_multipliers.clone(),
            inequality_multipliers: iterate.inequality_multipliers.clone(),
            active: active(&iterate.inequalities),
        }
    }

    /// The starting point for `problem`, which must have the same kind of model. Multipliers are transferred only
    /// between problems with the same equations.
    pub fn start(&self, inverse: &InverseProblem<'_>, problem: &Collocation<'_>) -> Start {
        let stretch = self.stretch(problem.scheme);
        let x = problem.scheme.compose(&Transferred { answer: self, inverse, stretch });
        let pairs = self.equations.iter().zip(&inverse.control.equations);
        let same = pairs.clone().all(|(a, b)| a.name == b.name && a.rows.count == b.rows.count);
        let is_same = same && self.equations.len() == inverse.control.equations.len();
        Start { x, multipliers: is_same.then(|| self.multipliers(problem)) }
    }

    /// The function of this answer with this name.
    fn function(&self, quantity: &str, member: &str) -> Option<(QuantityId, usize)> {
        let is_own = |own: &Quantity| own.name == quantity && own.kind != Kind::Given;
        let id = self.quantities.iter().position(is_own)?;
        let member = self.quantities[id].members.iter().position(|own| own == member)?;
        Some((QuantityId(id), member))
    }

    /// Duration of this solution divided by that of the other.
    fn stretch(&self, scheme: &dyn Discretisation) -> f64 {
        let end = |scheme: &dyn Discretisation| *scheme.breakpoints().last().expect("a start and an end");
        end(self.scheme.as_ref()) / end(scheme)
    }

    /// Multipliers of equalities and of inequalities, and which inequalities are active. Rows without a counterpart get
    /// zero and inactive.
    fn multipliers(&self, problem: &Collocation<'_>) -> (Vec<f64>, Vec<f64>, Vec<bool>) {
        let (old_times, new_times) = (self.scheme.points(), problem.scheme.points());
        let stretch = self.stretch(problem.scheme);
        let nearest: Vec<usize> = new_times.iter().map(|&t| nearest(old_times, t * stretch)).collect();
        let (old_weights, new_weights) = (self.scheme.quadrature(), problem.scheme.quadrature());
        let density = new_times.len() as f64 / old_times.len() as f64;
        let factor = |new: usize, old: usize| match (new_weights[new], old_weights[old]) {
            (new, old) if new > 0.0 && old > 0.0 => density * stretch * new / old,
            _ => 1.0,
        };
        let old_equality: HashMap<(Option<usize>, usize), usize> =
            self.equality_names.iter().enumerate().map(|(row, &what)| (what, row)).collect();
        let equality = |&(point, equation): &(Option<usize>, usize)| {
            let old_point = point.map(|j| nearest[j]);
            let scale = point.map_or(1.0, |j| factor(j, nearest[j]));
            old_equality.get(&(old_point, equation)).map_or(0.0, |&row| scale * self.equality_multipliers[row])
        };
        let key = |limit: &Limit, point: usize| (limit.name, limit.member.clone(), point);
        let old_bounds = self.bounds.iter().enumerate();
        let old_inequality: HashMap<_, usize> =
            old_bounds.map(|(row, bound)| (key(&self.limits[bound.limit], bound.point), row)).collect();
        let inequalities: Vec<(f64, bool)> = (problem.bounds.iter())
            .map(|bound| {
                let old = nearest[bound.point];
                old_inequality.get(&key(problem.limit(bound), old)).map_or((0.0, false), |&row| {
                    (factor(bound.point, old) * self.inequality_multipliers[row], self.active[row])
                })
            })
            .collect();
        let (nu, active) = inequalities.into_iter().unzip();
        (problem.equality_names().iter().map(equality).collect(), nu, active)
    }
}

/// Index of the time nearest to `t`; `times` is increasing.
fn nearest(times: &[f64], t: f64) -> usize {
    let after = times.partition_point(|&other| other < t).min(times.len() - 1);
    if after > 0 && t - times[after - 1] < times[after] - t { after - 1 } else { after }
}

/// The functions of time of a solution, by name, stretched to the duration of the new problem. Those that the solution does
/// not have are zero.
struct Transferred<'a> {
    answer: &'a Answer,
    inverse: &'a InverseProblem<'a>,
    /// See [`Answer::stretch`].
    stretch: f64,
}

impl Trajectory for Transferred<'_> {
    fn value(&self, t: f64, quantity: QuantityId, member: usize, derivative: usize) -> f64 {
        let answer = self.answer;
        let new = self.inverse.control.quantity(quantity);
        let scale = self.stretch.powi(derivative as i32);
        let find = |name: &str| answer.function(name, &new.members[member]);
        // Derivatives of coordinates are best taken from the velocities, and velocities may have to be taken from coordinates.
        let (from, level, scale) = match (new.name, find("velocity")) {
            ("velocity", Some(velocity)) => (Some(velocity), derivative, scale * self.stretch),
            ("velocity", None) => (find("coordinate"), derivative + 1, scale * self.stretch),
            ("coordinate", Some(velocity)) if derivative > 0 => (Some(velocity), derivative - 1, scale),
            // Zero but for the discretisation's error.
            ("stabiliser", _) => (None, 0, 1.0),
            (name, _) => (find(name), derivative, scale),
        };
        let at = |(from, member), level| evaluate(&answer.scheme.at(t * self.stretch, from, member, level), &answer.x);
        match (new.name, from, find("activation")) {
            // Excitations that were no unknowns are those of eq. (4).
            ("excitation", None, Some(activation)) => {
                let (a, rate) = (at(activation, 0), self.stretch * at(activation, 1));
                self.inverse.model.muscles[member].excitation(a, rate).clamp(0.0, 1.0)
            }
            _ => from.map_or(0.0, |from| scale * at(from, level)),
        }
    }
}
