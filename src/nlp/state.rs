//! What all ingredients of the solver look at: the point, its error, its curvature, the linear systems.

use super::curvature::{Model, Models};
use super::iterate::{Iterate, KktError};
use super::kkt::{Inertia, Kkt, Rows};
use super::options::ProgressOptions;
use super::problem::Problem;

pub struct State<'p> {
    pub problem: &'p dyn Problem,
    pub kkt: &'p mut Kkt,
    pub here: Iterate,
    pub error: KktError,
    pub models: Models<'p>,
    pub progress: Progress,
}

impl<'p> State<'p> {
    pub fn new(kkt: &'p mut Kkt, problem: &'p dyn Problem, here: Iterate, options: ProgressOptions) -> Self {
        let models = Models::new(problem, &here.x);
        Self { problem, kkt, error: here.kkt_error(), here, models, progress: Progress::new(options) }
    }

    /// `here + fraction · direction`, functions evaluated.
    pub fn at(&self, direction: &[f64], fraction: f64) -> Iterate {
        self.here.moved(self.problem, direction, fraction)
    }

    /// Moves to a point with first derivatives.
    pub fn move_to(&mut self, there: Iterate) {
        self.error = there.kkt_error();
        self.here = there;
    }

    /// Constraint violation and objective.
    pub fn pair(&self) -> (f64, f64) {
        (self.here.violation(), self.here.objective)
    }

    /// Factorises the exact Hessian with damping δ and the `active` rows as equations.
    pub fn factorise(&mut self, damping: f64, active: &[bool]) -> Option<Inertia> {
        let model = self.models.at(Model::Exact, &self.here);
        self.kkt.factorise(&self.here.system(model, damping, Rows::Active(active)))
    }

    /// One step of `trial` onto the equalities and `active` inequalities with the factorisation at hand; that of an
    /// interior point takes only part of the way to the inequalities.
    pub fn reduce_violation(&mut self, trial: &mut Iterate, active: &[bool]) {
        let mut solution = vec![0.0; self.kkt.order()];
        self.kkt.solve_roughly(&trial.onto_constraints(active), &mut solution);
        trial.x.iter_mut().zip(&solution).for_each(|(x, d)| *x += d);
        trial.evaluate(self.problem);
    }
}

/// How long nothing has helped.
#[derive(Clone, Copy, Debug)]
pub struct Progress {
    options: ProgressOptions,
    /// The error when it last fell by its share.
    lowest: f64,
    /// Iterations since.
    pub idle: usize,
}

impl Progress {
    fn new(options: ProgressOptions) -> Self {
        Self { options, lowest: f64::INFINITY, idle: 0 }
    }

    /// At each point, once.
    pub fn note(&mut self, error: f64) {
        if error < self.options.share * self.lowest {
            (self.lowest, self.idle) = (error, 0);
        } else {
            self.idle += 1;
        }
    }

    pub fn is_impatient(&self) -> bool {
        self.idle >= self.options.impatience
    }
}
