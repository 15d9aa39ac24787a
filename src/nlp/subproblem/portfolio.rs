//! Which way of solving the sub-problem is tried, given what became of the last one.

use super::active_set::{self, Ceiling};
use super::interior_point::{self, Interior, Manner};
use super::qp::{QpFailure, QuadraticProgramme};
use super::{NoStep, Quality, Step, Way};
use crate::nlp::curvature::Model;
use crate::nlp::options::SqpOptions;
use crate::nlp::state::State;
use crate::numerics::sparse::Sparse;

/// What the last sub-problem has left for the next.
pub struct Portfolio {
    /// The active set of the last step taken.
    active: Option<Vec<bool>>,
    /// Where the last interior point ended.
    interior: Option<Interior>,
    /// Whether the last interior point ended with much the same active set as the sub-problem before.
    is_settled: bool,
    /// Whether negative curvature was left out.
    was_convexified: bool,
}

/// What is known of a sub-problem before it is solved.
struct Question {
    /// δ to begin with, and that with the exact Hessian.
    delta: f64,
    exact_delta: f64,
    /// Largest δ with the exact Hessian.
    most: f64,
    /// Whether the exact Hessian is likely to need more.
    is_in_doubt: bool,
    /// Whether an interior point is to go to its end.
    to_the_end: bool,
}

impl Portfolio {
    pub fn new(active: Option<Vec<bool>>) -> Self {
        Self { active, interior: None, is_settled: true, was_convexified: false }
    }

    /// A step with this active set has been taken.
    pub fn took(&mut self, active: Vec<bool>) {
        self.active = Some(active);
    }

    /// Makes no guess next time.
    pub fn forget_active(&mut self) {
        self.active = None;
    }

    /// Step and multipliers of the sub-problem at `state` with at least this δ; `to_the_end`: where a rough step would
    /// not do.
    pub fn solve(
        &mut self,
        state: &mut State<'_>,
        options: &SqpOptions,
        delta: f64,
        to_the_end: bool,
    ) -> Result<Step, NoStep> {
        let error = state.error.largest();
        let is_in_doubt = std::mem::take(&mut self.was_convexified);
        // What was lowered with the convex Hessian says nothing of the exact one.
        let exact_delta = if is_in_doubt { delta.max(options.damping.near_solution(error)) } else { delta };
        let question =
            Question { delta, exact_delta, most: options.damping.most_exact(&state.progress), is_in_doubt, to_the_end };
        let found = self.by_second_derivatives(state, options, &question);
        let step = match found.or_else(|| self.by_gauss_newton(state, options, &question)) {
            Some(step) => step,
            None => by_clarabel(state, options, delta)?,
        };
        self.was_convexified = step.way.is_convexified();
        Ok(step)
    }

    /// Ways 1 to 3, if there is an active set to begin with.
    fn by_second_derivatives(
        &mut self,
        state: &mut State<'_>,
        options: &SqpOptions,
        question: &Question,
    ) -> Option<Step> {
        let ways = &options.portfolio;
        let far = state.error.largest() > ways.far && !ways.to_the_end;
        // What had to be made convex is so until the active set settles; then the exact Hessian is asked again.
        let is_near = state.error.largest() < ways.at_hand;
        let mut hopeless = question.is_in_doubt && (far || !(self.is_settled || is_near));
        let guess = self.active.clone()?;
        if !hopeless && self.is_settled && ways.guesses {
            let ceiling = Ceiling { most: question.most, is_in_doubt: question.is_in_doubt };
            match active_set::solve(state, options, question.exact_delta, ceiling, &guess) {
                Ok(step) => return Some(step),
                Err(why) => hopeless = why == NoStep::TooCurved || question.exact_delta > question.most,
            }
        }
        // Guessing does not settle on degenerate active sets; an interior point is never in doubt.
        let exact = if hopeless { None } else { self.by_interior_point(state, options, question, Model::Exact) };
        let step = exact.or_else(|| {
            if ways.convex { self.by_interior_point(state, options, question, Model::Convex) } else { None }
        })?;
        let changed = step.active.iter().zip(&guess).filter(|(now, before)| now != before).count();
        self.is_settled = ways.to_the_end || changed <= ways.nearly.max(guess.len() / ways.few);
        Some(step)
    }

    /// With the exact Hessian if little δ makes it positive definite, or with the convex one, no finer than that model
    /// deserves.
    fn by_interior_point(
        &mut self,
        state: &mut State<'_>,
        options: &SqpOptions,
        question: &Question,
        model: Model,
    ) -> Option<Step> {
        let ways = &options.portfolio;
        let error = state.error.largest();
        let coarse = options.interior_point.coarse;
        let (least, most, tolerance) = match model {
            Model::Exact => {
                let fine = (ways.per_error * error.powf(1.5)).clamp(options.interior_point.fine, ways.per_error);
                (question.exact_delta, question.most, fine)
            }
            _ if ways.to_the_end => (question.delta, f64::INFINITY, coarse),
            _ => (question.delta, f64::INFINITY, (ways.per_error * error).clamp(coarse, ways.per_error)),
        };
        let is_plain = ways.to_the_end || question.to_the_end;
        let manner = manner(state, options, most, tolerance, is_plain);
        let step = interior_point::solve(state, options, model, least, manner, &mut self.interior).ok()?;
        Some(if model == Model::Exact && step.damping > least {
            less_damped(state, options, least, step)
        } else {
            step
        })
    }

    fn by_gauss_newton(&mut self, state: &mut State<'_>, options: &SqpOptions, question: &Question) -> Option<Step> {
        let ways = &options.portfolio;
        let delta = gauss_newton_delta(options, question.delta);
        let tolerance = if ways.to_the_end { options.interior_point.coarse } else { ways.per_error };
        let manner = manner(state, options, delta, tolerance, ways.to_the_end || question.to_the_end);
        let interior = &mut self.interior;
        let step = interior_point::solve(state, options, Model::GaussNewton, delta, manner, interior).ok()?;
        // That this model has more δ says nothing of the others.
        Some(Step { damping: question.delta, ..step })
    }
}

fn gauss_newton_delta(options: &SqpOptions, delta: f64) -> f64 {
    delta.clamp(options.damping.gauss_newton_least, options.damping.gauss_newton_most)
}

/// How an interior point goes about its sub-problem: far from a solution a linearisation is not worth many steps.
fn manner(state: &State<'_>, options: &SqpOptions, most: f64, tolerance: f64, is_plain: bool) -> Manner {
    let ways = &options.portfolio;
    let steps = match state.error.largest() {
        _ if is_plain => options.interior_point.max_iterations,
        error if error < ways.near => ways.steps_near,
        _ if state.progress.is_impatient() => ways.steps_idle,
        _ => ways.steps,
    };
    Manner { most, tolerance, steps, is_plain }
}

/// Away from its end the interior point may need more δ than its solution does: that with its active set and as little
/// δ as possible.
fn less_damped(state: &mut State<'_>, options: &SqpOptions, least: f64, step: Step) -> Step {
    let most = least.max(step.damping / options.damping.retreat);
    let ceiling = Ceiling { most, is_in_doubt: false };
    match active_set::solve(state, options, least, ceiling, &step.active) {
        Ok(better) => better,
        Err(_) => Step { has_factors: false, ..step },
    }
}

/// Clarabel scales and pivots differently: what the own interior point cannot solve it may.
fn by_clarabel(state: &mut State<'_>, options: &SqpOptions, delta: f64) -> Result<Step, NoStep> {
    let here = &state.here;
    let (gauss_newton, metric) = state.models.at(Model::GaussNewton, here);
    let mut hessian: Sparse = gauss_newton.clone();
    let weight = gauss_newton_delta(options, delta);
    hessian.values.iter_mut().zip(&metric.values).for_each(|(h, d)| *h += weight * d);
    let solution = QuadraticProgramme {
        hessian: &hessian,
        gradient: &here.gradient,
        equalities: &here.equality_jacobian,
        equality_values: &here.equalities,
        inequalities: &here.inequality_jacobian,
        inequality_values: &here.inequalities,
        deadline: options.termination.deadline,
    }
    .solve()
    .map_err(|failure| match failure {
        QpFailure::Infeasible => NoStep::Infeasible,
        QpFailure::Numerical => NoStep::Singular,
    })?;
    let mut slack = here.inequalities.clone();
    here.inequality_jacobian.add_product(1.0, &solution.step, &mut slack);
    Ok(Step {
        active: slack.iter().zip(&solution.inequalities).map(|(slack, nu)| slack < nu).collect(),
        direction: solution.step,
        equality_multipliers: solution.equalities,
        inequality_multipliers: solution.inequalities,
        damping: delta,
        way: Way::Clarabel,
        quality: Quality::Full,
        has_factors: false,
        is_settled: false,
        qp_iterations: solution.iterations,
    })
}
