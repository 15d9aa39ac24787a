//! Warm start: a solved problem as the starting point of another, on a finer mesh or with other parameters.
//!
//! Functions of time are transferred exactly if the new space contains the old one. Multipliers and active bounds are
//! taken from the nearest collocation point, multipliers in proportion to the quadrature weights.

use std::cell::RefCell;
use std::collections::HashMap;

use crate::nlp::iterate::Iterate;
use crate::nlp::polish::active;
use crate::nlp::sqp::Start;
use crate::transcription::collocation::{Bound, Collocation, Rows, evaluate};
use crate::transcription::instant::{EXCITATION, Form, Instant, LENGTH};
use crate::transcription::scheme::{Discretisation, Trajectory};

/// A converged solution, with everything needed to start another problem from it.
pub struct Answer {
    scheme: Box<dyn Discretisation>,
    form: Form,
    rows: Rows,
    x: Vec<f64>,
    equality_multipliers: Vec<f64>,
    inequality_multipliers: Vec<f64>,
    active: Vec<bool>,
}

impl Answer {
    pub fn new(problem: &Collocation<'_>, scheme: Box<dyn Discretisation>, iterate: &Iterate) -> Self {
        Self {
            scheme,
            form: problem.instant.form,
            rows: problem.rows(),
            x: iterate.x.clone(),
            equality_multipliers: iterate.equality_multipliers.clone(),
            inequality_multipliers: iterate.inequality_multipliers.clone(),
            active: active(&iterate.inequalities),
        }
    }

    /// The starting point for `problem`, which must have the same kind of model. Multipliers are transferred only
    /// between problems of the same form.
    pub fn start(&self, problem: &Collocation<'_>, scheme: &dyn Discretisation) -> Start {
        let x = scheme.compose(&Transferred {
            answer: self,
            instant: Instant::new(problem.instant.model, self.form).within(problem.instant.surroundings().clone()),
            stretch: self.stretch(scheme),
            last: RefCell::new((f64::NAN, Vec::new())),
        });
        let multipliers = (self.form == problem.instant.form).then(|| self.multipliers(problem, scheme));
        Start { x, multipliers }
    }

    /// Activation of muscle `m` at time `t` (s).
    pub fn activation(&self, t: f64, m: usize) -> f64 {
        evaluate(&self.scheme.activation_at(t, m), &self.x)
    }

    /// Duration of this solution divided by that of the other.
    fn stretch(&self, scheme: &dyn Discretisation) -> f64 {
        let end = |scheme: &dyn Discretisation| *scheme.breakpoints().last().expect("a start and an end");
        end(self.scheme.as_ref()) / end(scheme)
    }

    /// Multipliers of equalities and of inequalities, and which inequalities are active. Rows without a counterpart get
    /// zero and inactive.
    fn multipliers(&self, problem: &Collocation<'_>, scheme: &dyn Discretisation) -> (Vec<f64>, Vec<f64>, Vec<bool>) {
        let rows = problem.rows();
        let stretch = self.stretch(scheme);
        let nearest: Vec<usize> = rows.times.iter().map(|&t| nearest(&self.rows.times, t * stretch)).collect();
        let (old_weights, new_weights) = (self.scheme.quadrature(), scheme.quadrature());
        let density = rows.times.len() as f64 / self.rows.times.len() as f64;
        let factor = |new: usize, old: usize| match (new_weights[new], old_weights[old]) {
            (new, old) if new > 0.0 && old > 0.0 => density * stretch * new / old,
            _ => 1.0,
        };
        let old_equality: HashMap<(Option<usize>, usize), usize> =
            self.rows.equalities.iter().enumerate().map(|(row, &what)| (what, row)).collect();
        let equality = |&(point, equation): &(Option<usize>, usize)| {
            let old_point = point.map(|j| nearest[j]);
            let scale = point.map_or(1.0, |j| factor(j, nearest[j]));
            old_equality.get(&(old_point, equation)).map_or(0.0, |&row| scale * self.equality_multipliers[row])
        };
        let key = |bound: &Bound, point: usize| (bound.kind, bound.muscle, point);
        let old_inequality: HashMap<_, usize> =
            self.rows.inequalities.iter().enumerate().map(|(row, bound)| (key(bound, bound.point), row)).collect();
        let inequalities: Vec<(f64, bool)> = (rows.inequalities.iter())
            .map(|bound| {
                let old = nearest[bound.point];
                old_inequality.get(&key(bound, old)).map_or((0.0, false), |&row| {
                    (factor(bound.point, old) * self.inequality_multipliers[row], self.active[row])
                })
            })
            .collect();
        let (nu, active) = inequalities.into_iter().unzip();
        (rows.equalities.iter().map(equality).collect(), nu, active)
    }
}

/// Index of the time nearest to `t`; `times` is increasing.
fn nearest(times: &[f64], t: f64) -> usize {
    let after = times.partition_point(|&other| other < t).min(times.len() - 1);
    if after > 0 && t - times[after - 1] < times[after] - t { after - 1 } else { after }
}

/// The functions of time of a solution, stretched to the duration of the new problem.
struct Transferred<'a> {
    answer: &'a Answer,
    /// See [`Answer::stretch`].
    stretch: f64,
    instant: Instant<'a>,
    /// The latest time requested, and the local variables there.
    last: RefCell<(f64, Vec<f64>)>,
}

impl Transferred<'_> {
    fn local(&self, t: f64, index: usize) -> f64 {
        let mut last = self.last.borrow_mut();
        if last.0 != t {
            let map = self.answer.scheme.local_at(&self.instant, t * self.stretch);
            *last = (t, map.iter().map(|combination| evaluate(combination, &self.answer.x)).collect());
        }
        last.1[index]
    }
}

impl Trajectory for Transferred<'_> {
    fn coordinate(&self, t: f64, derivative: usize, i: usize) -> f64 {
        let value = evaluate(&self.answer.scheme.coordinate_at(t * self.stretch, derivative, i), &self.answer.x);
        value * self.stretch.powi(derivative as i32)
    }

    fn length(&self, t: f64, m: usize) -> f64 {
        self.local(t, self.instant.muscle(m) + LENGTH)
    }

    fn activation(&self, t: f64, m: usize) -> f64 {
        self.answer.activation(t * self.stretch, m)
    }

    fn excitation(&self, t: f64, m: usize) -> f64 {
        self.local(t, self.instant.muscle(m) + EXCITATION)
    }

    fn reaction(&self, t: f64, c: usize) -> f64 {
        self.local(t, self.instant.reaction(c))
    }
}
