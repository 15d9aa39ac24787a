//! The models of second derivatives at a point: ∇²L, what is left of it without negative curvature, and JᵀJ.

use super::iterate::Iterate;
use super::problem::{Curvature, Multipliers, Problem};
use crate::numerics::sparse::Sparse;

/// Which Hessian a sub-problem has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Model {
    /// ∇²L
    Exact,
    /// ∇²L without its negative curvature, block by block.
    Convex,
    /// The objective's Hessian at the start.
    GaussNewton,
}

/// The models at one point, each evaluated when it is first asked for, and the metric D there.
pub struct Models<'p> {
    problem: &'p dyn Problem,
    exact: Sparse,
    convex: Sparse,
    gauss_newton: Sparse,
    has_exact: bool,
    has_convex: bool,
    pub metric: Sparse,
}

impl<'p> Models<'p> {
    pub fn new(problem: &'p dyn Problem, start: &[f64]) -> Self {
        let [_, _, pattern] = problem.patterns();
        let mut gauss_newton = pattern.clone();
        let (no_lambda, no_nu) = (vec![0.0; problem.equalities()], vec![0.0; problem.inequalities()]);
        let none = Multipliers { equalities: &no_lambda, inequalities: &no_nu };
        problem.hessian(start, none, Curvature::Exact, &mut gauss_newton);
        let [exact, convex, metric] = [(); 3].map(|()| pattern.clone());
        Self { problem, exact, convex, gauss_newton, has_exact: false, has_convex: false, metric }
    }

    /// Forgets the models of another point and evaluates the metric at this one.
    pub fn begin(&mut self, x: &[f64]) {
        (self.has_exact, self.has_convex) = (false, false);
        self.problem.metric(x, &mut self.metric);
    }

    /// The Hessian of the model at `here`, and the metric.
    pub fn at(&mut self, model: Model, here: &Iterate) -> (&Sparse, &Sparse) {
        let hessian = match model {
            Model::Exact => {
                if !std::mem::replace(&mut self.has_exact, true) {
                    self.problem.hessian(&here.x, here.multipliers(), Curvature::Exact, &mut self.exact);
                }
                &self.exact
            }
            Model::Convex => {
                if !std::mem::replace(&mut self.has_convex, true) {
                    self.problem.hessian(&here.x, here.multipliers(), Curvature::Convex, &mut self.convex);
                }
                &self.convex
            }
            Model::GaussNewton => &self.gauss_newton,
        };
        (hessian, &self.metric)
    }
}
