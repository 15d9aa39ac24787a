//! Sequential quadratic programming with exact second derivatives.
//!
//! ```text
//! repeat
//!     sub-problem   min ∇fᵀ d + ½ dᵀ (H + δ D) d   s.t.  c + A d = 0,  d(x) + B d ≥ 0
//!                   1. H = ∇²L, by its active set, from the last one, if that has settled (active_set)
//!                   2. else: H = ∇²L, by an interior point that goes on where the last one ended (interior_point)
//!                   3. where that needs a large δ: H = ∇²L without its negative curvature, likewise, until the active set settles
//!                   4. at first and where all else fails: H = JᵀJ, likewise, or by Clarabel (qp)
//!     search        x + α d, α = 1, ½, … until the filter accepts; at α = 1 a second-order correction first
//!     leap          along directions that are almost flat, where Newton's method creeps
//!     extend        a step that δ or the convexified Hessian has kept short, for as long as the objective falls
//!     on failure    solve to its end what an interior point has not; with a solution at hand begin the filter anew; raise δ; restore
//!                   feasibility (by Clarabel), or begin the filter anew; give up as `stalled` or `infeasible`
//! ```
//!
//! δ D is a proximal term in the problem's own metric D. It is raised until H + δ D is positive definite on the
//! null space of the active constraints (known from the factorisation's inertia) and falls by five after each full step that did not raise it,
//! nor the KKT error after many iterations in vain, so that the last steps are Newton's and converge quadratically. Far from a solution the convexified Hessian is the
//! better model: a δ that covers all negative curvature shortens every step, leaving it out only those along it.
//!
//! Why the leap: the force–velocity curve is flat at high speed, so a muscle that is worth more when it alternates has its
//! optimum at infinite fibre velocity, with f ~ k/v. Newton's step multiplies v by 1.5; the leap tries up to 64 times the step,
//! corrected by up to three more steps on the optimality conditions with the same factorisation, and is kept if it lowers the KKT error at no
//! loss but what is left of the violation costs. A leap of length 1 is a plain step with those corrections: the iteration is then of higher than second order.

use super::active_set::{self, EXACT_DAMPING, SMALLEST_DAMPING, Step};
use super::filter::{Filter, Verdict};
use super::interior_point::{self, Interior, Manner};
use super::iterate::{Iterate, KktError};
use super::kkt::{Inertia, Kkt, KktValues, Rows};
use super::problem::{Curvature, Multipliers, Problem};
use super::qp::{QpFailure, QuadraticProgramme};
use crate::deadline::Deadline;
use crate::numerics::sparse::Sparse;

#[derive(Clone, Copy, Debug)]
pub struct SqpSettings {
    /// All three KKT residuals of the scaled problem must come below this.
    pub tolerance: f64,
    /// Iterations go on to this as long as they help.
    pub target: f64,
    pub max_iterations: usize,
    /// Gives up as `TimeLimit` when this is past.
    pub deadline: Deadline,
}

impl Default for SqpSettings {
    fn default() -> Self {
        Self { tolerance: 1e-8, target: 9e-9, max_iterations: 300, deadline: Deadline::default() }
    }
}

/// How a solve ended. Only the first is success.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SqpStatus {
    /// All KKT residuals are below the tolerance.
    Converged,
    /// The iterations ran out.
    IterationLimit,
    /// The deadline passed.
    TimeLimit,
    /// The quadratic sub-problem could not be solved in any form.
    QpFailed,
    /// No step is accepted any more.
    Stalled,
    /// A stationary point of the constraint violation that is not feasible.
    Infeasible,
    /// A function or derivative is not finite.
    NonFinite,
}

/// One iteration of the trace.
#[derive(Clone, Debug)]
pub struct Record {
    pub x: Vec<f64>,
    pub objective: f64,
    pub error: KktError,
    /// ‖x_{k+1} − x_k‖; 0 in the last record.
    pub step_norm: f64,
    /// Interior-point iterations of Clarabel in this iteration's sub-problem.
    pub qp_iterations: usize,
}

/// Where to begin: a point, and what is known of the multipliers there.
#[derive(Clone, Debug, Default)]
pub struct Start {
    pub x: Vec<f64>,
    /// λ, ν and the active inequalities, of a problem near this one.
    pub multipliers: Option<(Vec<f64>, Vec<f64>, Vec<bool>)>,
}

impl From<Vec<f64>> for Start {
    fn from(x: Vec<f64>) -> Self {
        Self { x, multipliers: None }
    }
}

#[derive(Clone, Debug)]
pub struct SqpOutcome {
    pub status: SqpStatus,
    pub iterate: Iterate,
    /// One record for each point visited, the last being `iterate`.
    pub trace: Vec<Record>,
    /// Of the KKT matrix, those in vain too.
    pub factorisations: usize,
}

impl SqpOutcome {
    /// Number of steps taken.
    pub fn iterations(&self) -> usize {
        self.trace.len().saturating_sub(1)
    }
}

/// Where fewer iterations than these are allowed nothing is begun anew.
const LEAST_TWICE: usize = 40;
/// Iterations that do not halve the KKT error before a point within the tolerance is good enough.
const PATIENCE: usize = 30;
/// Least δ: however small it keeps muscles that run away from running further than it takes. After so many such iterations it gives way to
/// an even smaller one, and the largest δ with the exact Hessian to this: the convexified Hessian, however good far away, creeps here.
const USUAL_FLOOR: f64 = 1e-13;
const IMPATIENCE: usize = 10;
const STUBBORN_DAMPING: f64 = 1e-2;
const FIRST_DAMPING: f64 = 1e-2;
/// Δ of the proximal term in Clarabel's sub-problem.
const CONVEX_DAMPING: (f64, f64) = (1e-2, 1e6);
/// δ after a full step.
const LOWER: f64 = 0.2;
const RAISE: f64 = 10.0;
const ATTEMPTS: usize = 12;
const SMALLEST_FRACTION: f64 = 0.05;
const CORRECTIONS: usize = 4;
/// How much longer the next leap tried is, and the longest in steps.
const LONGER: f64 = 4.0;
const LONGEST_LEAP: f64 = 64.0;
/// A longer one must leave less than this share of the KKT error that the one before has left; the best less than this of a plain step's.
const MUCH: f64 = 0.5;
const BETTER: f64 = 0.7;
/// A plain step that leaves less than this share of the KKT error is only corrected.
const FAST: f64 = 0.5;
/// A step that leaves more than this share of the KKT error creeps.
const CREEPING: f64 = 0.4;
/// An active set that has changed by no more rows than these, or one of so many, has settled.
const NEARLY: usize = 2;
const FEW: usize = 200;
/// KKT error above which what has been convexified stays so.
const FAR: f64 = 1.0;
/// Tolerance of the convexified sub-problem: this share of the KKT error, and no more.
const PER_ERROR: f64 = 1e-2;
/// Steps of an interior point: far from a solution while the KKT error falls, where it does not, and near one, the KKT error being below
/// NEARBY.
const STEPS: usize = 1;
const STEPS_IDLE: usize = 2;
const STEPS_NEAR: usize = 4;
const NEARBY: f64 = 0.1;
/// KKT error below which f and θ are only noise.
const AT_HAND: f64 = 1e-2;
/// Without negative curvature δ starts no larger than this times the KKT error, so that the last steps are Newton's.
const DAMPING_PER_ERROR: f64 = 3e-3;
/// After so many iterations that do not halve a KKT error below this one sub-problem is solved by the plain interior point: where multipliers
/// are not unique, that which goes on from the last one can go round in a circle.
const STUCK: (usize, f64) = (3, 1e-3);
const RESTORATIONS: usize = 60;
/// How often a step that creeps is made twice as long, and what violation it may leave: this share of the KKT error.
const DOUBLINGS: usize = 16;
const EXTENDED: f64 = 0.1;
/// δ below this shortens no step: what creeps then runs off to infinity and is not helped on its way.
const SHORTENING: f64 = 1e-6;

/// A trial point that was accepted.
struct Accepted {
    trial: Iterate,
    fraction: f64,
    verdict: Verdict,
}

struct Sqp<'p> {
    problem: &'p dyn Problem,
    settings: SqpSettings,
    kkt: &'p mut Kkt,
    /// Of `here` if `has_hessian`.
    hessian: Sparse,
    has_hessian: bool,
    /// A positive semidefinite matrix near the Hessian.
    convex: Sparse,
    metric: Sparse,
    /// JᵀJ
    gauss_newton: Sparse,
    filter: Filter,
    here: Iterate,
    /// Its KKT error.
    error: KktError,
    active: Option<Vec<bool>>,
    /// δ
    damping: f64,
    /// Iterations since the KKT error was last halved.
    idle: usize,
    /// Whether the last sub-problem had to raise δ against negative curvature.
    curved: bool,
    /// Whether the last sub-problem was that of the convexified Hessian, or of JᵀJ.
    convexified: bool,
    /// Whether the last interior point ended with much the same active set as the sub-problem before.
    is_settled: bool,
    /// Where the last interior point ended.
    interior: Option<Interior>,
    /// Whether the interior point is the plain one.
    is_plain: bool,
    /// Whether the last sub-problem was not solved to its end, and whether such a step was refused at this point.
    is_rough: bool,
    refused: bool,
    /// Whether the factorisation at hand is that of the last sub-problem's step.
    is_at_hand: bool,
    /// Factorisations before this solve.
    factorised: usize,
}

/// Solves `problem` from `start`. Deterministic, one thread.
pub fn solve(problem: &dyn Problem, start: impl Into<Start>, settings: SqpSettings) -> SqpOutcome {
    solve_with(&mut Kkt::new(problem), problem, start, settings)
}

/// [`solve`] with the symbolic factorisation of this problem at hand.
///
/// What has not converged when the iterations are over, or is stuck, is begun anew with the plain interior point and as many iterations, unless
/// the time is over; the better of the two answers counts:
/// which of many flat ways the iteration goes down depends on it.
pub fn solve_with(kkt: &mut Kkt, problem: &dyn Problem, start: impl Into<Start>, settings: SqpSettings) -> SqpOutcome {
    kkt.deadline = settings.deadline;
    let start = start.into();
    let mut first = Sqp::new(kkt, problem, start.clone(), settings, false).run();
    let is_stuck = [SqpStatus::IterationLimit, SqpStatus::Stalled, SqpStatus::QpFailed].contains(&first.status);
    if !is_stuck || settings.max_iterations < LEAST_TWICE || settings.deadline.passed() {
        return first;
    }
    if let Some(last) = first.trace.last_mut() {
        last.step_norm = distance(&last.x, &start.x);
    }
    let second = Sqp::new(kkt, problem, start, settings, true).run();
    let error = |run: &SqpOutcome| Some(run.iterate.kkt_error().largest()).filter(|error| error.is_finite());
    let is_better = match (error(&first), error(&second)) {
        _ if second.status == SqpStatus::Converged => true,
        (Some(first), Some(second)) => second <= first,
        (first, _) => first.is_none(),
    };
    let trace = [&first.trace[..], &second.trace].concat();
    let factorisations = first.factorisations + second.factorisations;
    let better = if is_better { second } else { first };
    SqpOutcome { trace, factorisations, ..better }
}

impl<'p> Sqp<'p> {
    fn new(kkt: &'p mut Kkt, problem: &'p dyn Problem, start: Start, settings: SqpSettings, is_plain: bool) -> Self {
        let Start { x: start, multipliers } = start;
        let factorised = kkt.factorisations;
        let [_, _, pattern] = problem.patterns();
        let mut gauss_newton = pattern.clone();
        let (no_lambda, no_nu) = (vec![0.0; problem.equalities()], vec![0.0; problem.inequalities()]);
        problem.hessian(
            &start,
            Multipliers { equalities: &no_lambda, inequalities: &no_nu },
            Curvature::Exact,
            &mut gauss_newton,
        );
        let mut here = Iterate::new(problem, start);
        let active = multipliers.map(|(lambda, nu, active)| {
            (here.equality_multipliers, here.inequality_multipliers) = (lambda, nu);
            active
        });
        Self {
            problem,
            settings,
            kkt,
            hessian: pattern.clone(),
            has_hessian: false,
            convex: pattern.clone(),
            metric: pattern.clone(),
            gauss_newton,
            filter: Filter::new(here.violation()),
            error: here.kkt_error(),
            here,
            active,
            damping: FIRST_DAMPING,
            idle: 0,
            curved: false,
            convexified: false,
            is_settled: true,
            interior: None,
            is_plain,
            is_rough: false,
            refused: false,
            is_at_hand: false,
            factorised,
        }
    }
}

impl Sqp<'_> {
    fn run(mut self) -> SqpOutcome {
        let mut trace: Vec<Record> = Vec::new();
        let (mut halved, mut since) = (f64::INFINITY, 0);
        let status = loop {
            let error = self.error;
            trace.push(Record {
                x: self.here.x.clone(),
                objective: self.here.objective,
                error,
                step_norm: 0.0,
                qp_iterations: 0,
            });
            if error.largest() < 0.5 * halved {
                (halved, since) = (error.largest(), trace.len() - 1);
            }
            self.idle = trace.len() - 1 - since;
            if let Some(status) = self.is_over(error, trace.len() - 1) {
                break status;
            }
            let record = trace.last_mut().expect("just pushed");
            if let Err(status) = self.iterate(error, record) {
                // Work cut short by the deadline looks like a failure of its own.
                break if self.is_late() { SqpStatus::TimeLimit } else { status };
            }
        };
        // A feasibility phase that failed has left the last point of the trace.
        if trace.last().is_some_and(|last| last.x != self.here.x) {
            trace.push(Record {
                x: self.here.x.clone(),
                objective: self.here.objective,
                error: self.error,
                step_norm: 0.0,
                qp_iterations: 0,
            });
        }
        let factorisations = self.kkt.factorisations - self.factorised;
        SqpOutcome { status, iterate: self.here, trace, factorisations }
    }

    fn is_over(&self, error: KktError, iteration: usize) -> Option<SqpStatus> {
        let enough = if self.idle >= PATIENCE { self.settings.tolerance } else { self.settings.target };
        if !self.here.is_finite() || error.largest().is_nan() {
            Some(SqpStatus::NonFinite)
        } else if error.largest() <= enough && self.problem.feasibility(&self.here.x) <= enough {
            Some(SqpStatus::Converged)
        } else if iteration >= self.settings.max_iterations {
            Some(SqpStatus::IterationLimit)
        } else if self.is_late() {
            Some(SqpStatus::TimeLimit)
        } else {
            None
        }
    }

    /// The least δ.
    fn least_damping(&self) -> f64 {
        if self.idle >= IMPATIENCE { SMALLEST_DAMPING } else { USUAL_FLOOR }
    }

    /// The largest δ with the exact Hessian.
    fn most_damping(&self) -> f64 {
        if self.idle >= IMPATIENCE { STUBBORN_DAMPING } else { EXACT_DAMPING }
    }

    /// How an interior point goes about its sub-problem.
    fn manner(&self, most: f64, tolerance: f64, is_plain: bool) -> Manner {
        let steps = match self.error.largest() {
            _ if is_plain => interior_point::ITERATIONS,
            error if error < NEARBY => STEPS_NEAR,
            _ if self.idle >= IMPATIENCE => STEPS_IDLE,
            _ => STEPS,
        };
        Manner { most, tolerance, steps, is_plain }
    }

    fn is_late(&self) -> bool {
        self.settings.deadline.passed()
    }

    /// One step from `here` to the next point.
    fn iterate(&mut self, error: KktError, record: &mut Record) -> Result<(), SqpStatus> {
        (self.has_hessian, self.refused) = (false, false);
        self.problem.metric(&self.here.x, &mut self.metric);
        let before = (self.here.violation(), self.here.objective);
        if !self.curved {
            let most = (DAMPING_PER_ERROR * error.largest()).min(EXACT_DAMPING);
            self.damping = self.damping.min(most).max(self.least_damping());
        }
        for attempt in 0..ATTEMPTS {
            if self.is_late() {
                return Err(SqpStatus::TimeLimit);
            }
            let mut damping = self.damping;
            let step = match self.sub_problem(&mut damping) {
                Ok(step) => step,
                Err(QpFailure::Infeasible) => break,
                Err(QpFailure::Numerical) if attempt + 1 == ATTEMPTS => return Err(SqpStatus::QpFailed),
                Err(QpFailure::Numerical) => {
                    self.damping = RAISE * damping.max(1e-6);
                    self.active = None;
                    continue;
                }
            };
            record.qp_iterations += step.qp_iterations;
            let Some(mut accepted) = self.search(&step, damping, error) else {
                // What an interior point has not solved to its end says nothing of δ, and where it has a larger δ does not help either; nor does it
                // where what was met before is all that is in the way.
                if self.is_rough {
                    self.refused = true;
                } else if error.largest() < AT_HAND && !self.filter.is_empty() {
                    self.filter = Filter::new(before.0);
                } else if self.refused {
                    break;
                } else {
                    self.damping = (RAISE * damping).max(1e-10);
                }
                continue;
            };
            let leaps = accepted.fraction == 1.0
                && step.is_settled
                && damping <= 1e-3
                && error.largest() < 1.0
                && error.largest() > self.settings.target;
            if leaps {
                self.leap(&step, &mut accepted.trial, error);
            }
            if accepted.verdict == Verdict::Progress {
                self.filter.add(before);
            }
            self.curved = damping > self.damping;
            let whole = accepted.fraction == 1.0;
            let direction = self.take(step, accepted, leaps, record);
            // Steps so long that they go to and fro.
            let is_too_long = self.idle >= IMPATIENCE && self.error.largest() >= error.largest();
            self.damping = if whole && attempt == 0 && !self.curved && !is_too_long {
                (LOWER * damping).max(self.least_damping())
            } else {
                damping
            };
            let creeps = self.error.largest() > CREEPING * error.largest();
            let is_short = self.convexified || error.largest() < FAR && damping > SHORTENING;
            if creeps && whole && is_short {
                self.extend(&direction, damping, record);
            }
            return Ok(());
        }
        let restored = self.restore(record);
        self.error = self.here.kkt_error();
        restored
    }

    /// Step and multipliers of the quadratic sub-problem; `damping` comes back as it was used.
    fn sub_problem(&mut self, damping: &mut f64) -> Result<Step, QpFailure> {
        (self.is_at_hand, self.is_rough) = (false, false);
        let error = self.error.largest();
        // What had to be convexified is so until the active set settles; then it is asked again.
        let was_convexified = std::mem::take(&mut self.convexified);
        let far = error > FAR && !self.is_plain;
        let mut hopeless = was_convexified && (far || !self.is_settled);
        if !hopeless && self.active.is_some() {
            self.evaluate_hessian();
        }
        if let Some(guess) = &self.active {
            // What was lowered with the convexified Hessian says nothing of the exact one.
            let usual =
                if was_convexified { damping.max((DAMPING_PER_ERROR * error).min(EXACT_DAMPING)) } else { *damping };
            if !hopeless && self.is_settled {
                let mut exact = usual;
                let found = active_set::solve(
                    self.kkt,
                    (&self.here, error),
                    &self.hessian,
                    &self.metric,
                    &mut exact,
                    (self.most_damping(), was_convexified),
                    guess,
                );
                if let Ok(step) = found {
                    self.is_at_hand = true;
                    *damping = exact;
                    return Ok(step);
                }
                hopeless = exact > self.most_damping();
            }
            // Guessing does not settle on degenerate active sets; an interior point is never in doubt. With the exact
            // Hessian if little δ makes it positive definite, else with the convex one, no finer than that model deserves.
            let coarse = (PER_ERROR * error).clamp(interior_point::COARSE, PER_ERROR);
            let ways = [
                (Curvature::Exact, self.most_damping(), interior_point::FINE),
                (Curvature::Convex, f64::INFINITY, if self.is_plain { interior_point::COARSE } else { coarse }),
            ];
            for (curvature, most, tolerance) in ways.into_iter().skip(usize::from(hopeless)) {
                let hessian = match curvature {
                    Curvature::Exact => &self.hessian,
                    Curvature::Convex => {
                        let (x, multipliers) = (&self.here.x, self.here.multipliers());
                        self.problem.hessian(x, multipliers, curvature, &mut self.convex);
                        &self.convex
                    }
                };
                let least = if curvature == Curvature::Exact { usual } else { *damping };
                let mut delta = least;
                let is_stuck = self.idle >= STUCK.0 && error < STUCK.1;
                let manner = self.manner(most, tolerance, self.is_plain || is_stuck || self.refused);
                let (here, interior) = ((&self.here, error), &mut self.interior);
                let found = interior_point::solve(self.kkt, here, hessian, &self.metric, &mut delta, manner, interior);
                let Ok(mut step) = found else { continue };
                (self.is_at_hand, self.is_rough) = (true, !manner.is_plain);
                // Away from its end the interior point may need more δ than its solution does.
                let mut less = least;
                if delta > less && curvature == Curvature::Exact {
                    let most = less.max(delta / RAISE);
                    let (here, metric) = ((&self.here, error), &self.metric);
                    match active_set::solve(self.kkt, here, hessian, metric, &mut less, (most, false), &step.active) {
                        Ok(better) => (step, delta, self.is_rough) = (better, less, false),
                        Err(_) => self.is_at_hand = false,
                    }
                }
                let changed = step.active.iter().zip(guess).filter(|(now, before)| now != before).count();
                self.is_settled = self.is_plain || changed <= NEARLY.max(guess.len() / FEW);
                self.convexified = curvature == Curvature::Convex;
                *damping = delta;
                return Ok(step);
            }
        }
        // At first, and where all else fails. Clarabel scales and pivots differently: what the own interior point cannot solve it may.
        let delta = damping.clamp(CONVEX_DAMPING.0, CONVEX_DAMPING.1);
        let tolerance = if self.is_plain { interior_point::COARSE } else { PER_ERROR };
        let manner = self.manner(delta, tolerance, self.is_plain || self.refused);
        let mut same = delta;
        let (kkt, here, interior) = (&mut *self.kkt, (&self.here, error), &mut self.interior);
        let found = interior_point::solve(kkt, here, &self.gauss_newton, &self.metric, &mut same, manner, interior);
        if let Ok(step) = found {
            (self.is_at_hand, self.convexified, self.is_rough) = (true, true, !manner.is_plain);
            return Ok(step);
        }
        let mut hessian = self.gauss_newton.clone();
        hessian.values.iter_mut().zip(&self.metric.values).for_each(|(h, d)| *h += delta * d);
        let solution = QuadraticProgramme {
            hessian: &hessian,
            gradient: &self.here.gradient,
            equalities: &self.here.equality_jacobian,
            equality_values: &self.here.equalities,
            inequalities: &self.here.inequality_jacobian,
            inequality_values: &self.here.inequalities,
            deadline: self.settings.deadline,
        }
        .solve()?;
        let mut slack = self.here.inequalities.clone();
        self.here.inequality_jacobian.add_product(1.0, &solution.step, &mut slack);
        Ok(Step {
            active: slack.iter().zip(&solution.inequalities).map(|(slack, nu)| slack < nu).collect(),
            direction: solution.step,
            equality_multipliers: solution.equalities,
            inequality_multipliers: solution.inequalities,
            qp_iterations: solution.iterations,
            is_settled: false,
        })
    }

    /// Evaluates the exact Hessian, once a point: what is convexified may not need it.
    fn evaluate_hessian(&mut self) {
        if !std::mem::replace(&mut self.has_hessian, true) {
            self.problem.hessian(&self.here.x, self.here.multipliers(), Curvature::Exact, &mut self.hessian);
        }
    }

    /// Factorises the last sub-problem's Hessian, the exact one if there is none, with damping δ and the `active` rows as equations.
    fn factorise(&mut self, damping: f64, active: &[bool]) -> Option<Inertia> {
        if !self.convexified {
            self.evaluate_hessian();
        }
        self.kkt.factorise(&KktValues {
            hessian: if self.convexified { &self.convex } else { &self.hessian },
            metric: &self.metric,
            damping,
            equalities: &self.here.equality_jacobian,
            inequalities: &self.here.inequality_jacobian,
            rows: Rows::Active(active),
        })
    }

    /// Backtracks along the step until the filter accepts.
    fn search(&mut self, step: &Step, damping: f64, error: KktError) -> Option<Accepted> {
        let slope: f64 = self.here.gradient.iter().zip(&step.direction).map(|(g, d)| g * d).sum();
        let before = (self.here.violation(), self.here.objective);
        let mut fraction = 1.0;
        while fraction > SMALLEST_FRACTION {
            let mut trial = self.at(&step.direction, fraction);
            let reached = (trial.violation(), trial.objective);
            let mut verdict = self.filter.judge(before, error.largest(), slope, fraction, reached);
            if fraction == 1.0 && verdict == Verdict::Rejected && trial.is_finite() {
                if self.lowers_the_error(&trial, step, error) {
                    verdict = Verdict::Progress;
                } else if let Some(corrected) = self.correct(step, damping, &trial, before, slope, error) {
                    (trial, verdict) = corrected;
                }
            }
            if verdict != Verdict::Rejected {
                return Some(Accepted { trial, fraction, verdict });
            }
            fraction *= 0.5;
        }
        None
    }

    /// `here + fraction · direction`, functions evaluated.
    fn at(&self, direction: &[f64], fraction: f64) -> Iterate {
        self.here.moved(self.problem, direction, fraction)
    }

    /// With a solution at hand a full step that lowers the KKT error is taken.
    fn lowers_the_error(&self, trial: &Iterate, step: &Step, error: KktError) -> bool {
        if error.largest() >= AT_HAND {
            return false;
        }
        let mut full = trial.clone();
        full.equality_multipliers.copy_from_slice(&step.equality_multipliers);
        full.inequality_multipliers.copy_from_slice(&step.inequality_multipliers);
        full.differentiate(self.problem);
        full.kkt_error().largest() < 0.7 * error.largest()
    }

    /// Second-order correction: up to four more Newton steps on the constraints at their new values, the active
    /// ones kept, until the filter accepts or the violation no longer halves.
    fn correct(
        &mut self,
        step: &Step,
        damping: f64,
        trial: &Iterate,
        before: (f64, f64),
        slope: f64,
        error: KktError,
    ) -> Option<(Iterate, Verdict)> {
        if !self.is_at_hand {
            self.factorise(damping, &step.active)?;
        }
        self.is_at_hand = true;
        let mut trial = trial.clone();
        let mut last = trial.violation();
        for _ in 0..CORRECTIONS {
            self.reduce_violation(&mut trial, &step.active);
            let reached = (trial.violation(), trial.objective);
            let verdict = self.filter.judge(before, error.largest(), slope, 1.0, reached);
            if verdict != Verdict::Rejected {
                return Some((trial, verdict));
            }
            if trial.violation() > 0.5 * last {
                return None;
            }
            last = trial.violation();
        }
        None
    }

    /// One step on the equalities and `active` inequalities of `trial` with the factorisation at hand; that of an interior point takes only part
    /// of the way to the inequalities.
    fn reduce_violation(&mut self, trial: &mut Iterate, active: &[bool]) {
        let (n, me) = (trial.x.len(), trial.equalities.len());
        let mut right = vec![0.0; self.kkt.order()];
        right[n..n + me].iter_mut().zip(&trial.equalities).for_each(|(r, c)| *r = -c);
        let inequalities = right[n + me..].iter_mut().zip(&trial.inequalities).zip(active);
        inequalities.for_each(|((r, d), active)| *r = if *active { -d } else { 0.0 });
        let mut solution = vec![0.0; self.kkt.order()];
        self.kkt.solve_roughly(&right, &mut solution);
        trial.x.iter_mut().zip(&solution).for_each(|(x, d)| *x += d);
        trial.evaluate(self.problem);
    }

    /// Tries far more than a settled step; see the module. Leaves `trial` with multipliers and derivatives, moved or not.
    fn leap(&mut self, step: &Step, trial: &mut Iterate, error: KktError) {
        trial.equality_multipliers.copy_from_slice(&step.equality_multipliers);
        trial.inequality_multipliers.copy_from_slice(&step.inequality_multipliers);
        trial.differentiate(self.problem);
        let reached = trial.kkt_error().largest();
        if reached <= self.settings.target {
            return;
        }
        // What is left of the violation may cost the objective as much as the multipliers say.
        let cost: f64 = trial.equalities.iter().zip(&trial.equality_multipliers).map(|(c, l)| (c * l).abs()).sum();
        let highest = trial.objective + cost + 1e-13 * trial.objective.abs();
        let allowed = trial.violation().max(self.settings.tolerance);
        // With f ~ k/v the error falls as 1/v² and Newton's step is v/2: no further out than it takes.
        let reach = 2.0 * (error.largest() / self.settings.target).sqrt();
        let longest = if reached < FAST * error.largest() { 1.0 } else { reach.min(LONGEST_LEAP) };
        let (mut lowest, mut best) = (f64::INFINITY, None);
        let mut next = Some(1.0);
        while let Some(far) = next {
            next = (far < longest).then(|| longest.min(LONGER * far));
            let mut there = if far > 1.0 {
                let mut there = trial.moved(self.problem, &step.direction, far - 1.0);
                there.differentiate(self.problem);
                there
            } else {
                trial.clone()
            };
            let mut slope = there.lagrangian_gradient();
            let mut error = there.kkt_error_with(&slope).largest();
            for _ in 0..3 {
                self.simplified_step(&mut there, &slope, &step.active);
                slope = there.lagrangian_gradient();
                let before = std::mem::replace(&mut error, there.kkt_error_with(&slope).largest());
                if error > 0.5 * before || error <= self.settings.target {
                    break;
                }
            }
            if error > MUCH * lowest {
                break;
            }
            lowest = error;
            if error < BETTER * reached && there.objective <= highest && there.violation() <= allowed {
                best = Some(there);
                if error <= self.settings.target {
                    break;
                }
            }
        }
        if let Some(there) = best {
            *trial = there;
        }
    }

    /// One Newton step on the optimality conditions of `point`, ∇L being `slope` there, with the factorisation at hand.
    fn simplified_step(&mut self, point: &mut Iterate, slope: &[f64], active: &[bool]) {
        let (n, me) = (point.x.len(), point.equalities.len());
        let mut right: Vec<f64> = slope.iter().map(|g| -g).collect();
        right.extend(point.equalities.iter().map(|c| -c));
        right.extend(point.inequalities.iter().map(|d| -d));
        let mut solution = vec![0.0; self.kkt.order()];
        self.kkt.solve_roughly(&right, &mut solution);
        point.x.iter_mut().zip(&solution).for_each(|(x, d)| *x += d);
        point.equality_multipliers.iter_mut().zip(&solution[n..]).for_each(|(l, d)| *l += d);
        let inequalities = point.inequality_multipliers.iter_mut().zip(&solution[n + me..]).zip(active);
        inequalities.for_each(|((nu, d), active)| *nu = if *active { (*nu - d).max(0.0) } else { 0.0 });
        point.evaluate(self.problem);
        point.differentiate(self.problem);
    }

    /// Against negative curvature, or where the Lagrangian is flat, δ or the convexified Hessian makes a step short, and it creeps: goes on along
    /// it, doubling, for as long as the objective falls, with two steps back to the constraints each time.
    fn extend(&mut self, direction: &[f64], damping: f64, record: &mut Record) {
        let active = self.active.clone().unwrap_or_default();
        if !self.is_at_hand && self.factorise(damping, &active).is_none() {
            return;
        }
        let allowed = self.here.violation().max(self.settings.tolerance).max(EXTENDED * self.error.largest());
        let mut further = 1.0;
        let mut best: Option<Iterate> = None;
        for _ in 0..DOUBLINGS {
            let mut there = self.at(direction, further);
            self.reduce_violation(&mut there, &active);
            self.reduce_violation(&mut there, &active);
            let lowest = best.as_ref().unwrap_or(&self.here).objective;
            if !(there.is_finite() && there.objective < lowest && there.violation() <= allowed) {
                break;
            }
            best = Some(there);
            further *= 2.0;
        }
        if let Some(mut best) = best {
            best.differentiate(self.problem);
            record.step_norm = distance(&record.x, &best.x);
            self.move_to(best);
        }
    }

    /// Moves to the accepted point; gives back the step's direction.
    fn take(&mut self, step: Step, accepted: Accepted, leaps: bool, record: &mut Record) -> Vec<f64> {
        let Accepted { mut trial, fraction, .. } = accepted;
        record.step_norm = distance(&self.here.x, &trial.x);
        // A leap has left multipliers and derivatives.
        if !leaps {
            let blend = |old: &mut f64, new: &f64| *old += fraction * (new - *old);
            trial.equality_multipliers.iter_mut().zip(&step.equality_multipliers).for_each(|(o, n)| blend(o, n));
            trial.inequality_multipliers.iter_mut().zip(&step.inequality_multipliers).for_each(|(o, n)| blend(o, n));
            trial.differentiate(self.problem);
        }
        self.move_to(trial);
        self.active = Some(step.active);
        step.direction
    }

    fn move_to(&mut self, there: Iterate) {
        self.error = there.kkt_error();
        self.here = there;
    }

    /// Feasibility phase: lowers ½‖c‖² by Levenberg–Marquardt steps that keep the linearised inequalities, until the filter
    /// accepts the point. Ends as `Infeasible` at a stationary point of ½‖c‖². Where it does not move the filter begins anew, and with nothing in that
    /// it ends as `Stalled`.
    fn restore(&mut self, record: &mut Record) -> Result<(), SqpStatus> {
        let start = self.here.clone();
        let goal = 0.5 * start.violation();
        let mut damping = 1e-4;
        let zero = Sparse::from_triplets(0, start.x.len(), &[]);
        for _ in 0..RESTORATIONS {
            if self.is_late() {
                return Err(SqpStatus::TimeLimit);
            }
            if self.here.violation() <= goal {
                break;
            }
            let mut gradient = vec![0.0; start.x.len()];
            self.here.equality_jacobian.add_transpose_product(1.0, &self.here.equalities, &mut gradient);
            let slope = gradient.iter().fold(0.0f64, |a, g| a.max(g.abs()));
            let size = self.here.equalities.iter().fold(0.0f64, |a, c| a.max(c.abs()));
            if slope <= 1e-7 * size && size > 10.0 * self.settings.tolerance {
                return Err(SqpStatus::Infeasible);
            }
            let mut rows: Vec<(usize, usize, f64)> = Vec::new();
            let gram = self.here.equality_jacobian.gram();
            rows.extend(gram.entries().map(|(i, j, slot)| (i, j, gram.values[slot])));
            rows.extend(self.metric.entries().map(|(i, j, slot)| (i, j, damping * self.metric.values[slot])));
            rows.extend((0..start.x.len()).map(|i| (i, i, 1e-8)));
            let step = QuadraticProgramme {
                hessian: &Sparse::from_triplets(start.x.len(), start.x.len(), &rows),
                gradient: &gradient,
                equalities: &zero,
                equality_values: &[],
                inequalities: &self.here.inequality_jacobian,
                inequality_values: &self.here.inequalities,
                deadline: self.settings.deadline,
            }
            .solve();
            let Ok(step) = step else { return Err(SqpStatus::QpFailed) };
            record.qp_iterations += step.iterations;
            let trial = self.at(&step.step, 1.0);
            if trial.is_finite() && trial.violation() < self.here.violation() {
                self.here = trial;
                self.here.differentiate(self.problem);
                self.problem.metric(&self.here.x, &mut self.metric);
                damping = (0.3 * damping).max(1e-10);
            } else {
                damping *= 10.0;
                if damping > 1e8 {
                    break;
                }
            }
        }
        let has_failed = self.here.violation() > goal;
        if has_failed && !self.filter.is_empty() {
            // What was met before may be all that is in the way.
            self.filter = Filter::new(start.violation());
            self.here = start;
            return Ok(());
        }
        record.step_norm = distance(&start.x, &self.here.x);
        if has_failed {
            return Err(SqpStatus::Stalled);
        }
        // A filter that will not have the restored point would have nothing near it either: it begins anew.
        if self.filter.allows((self.here.violation(), self.here.objective)) {
            self.filter.add((start.violation(), start.objective));
        } else {
            self.filter = Filter::new(self.here.violation());
        }
        self.here.equality_multipliers.fill(0.0);
        self.here.inequality_multipliers.fill(0.0);
        (self.active, self.interior) = (None, None);
        self.damping = FIRST_DAMPING;
        Ok(())
    }
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum::<f64>().sqrt()
}
