//! Sequential quadratic programming with exact second derivatives.
//!
//! ```text
//! repeat
//!     sub-problem   min ∇fᵀ d + ½ dᵀ (H + δ D) d   s.t.  c + A d = 0,  d(x) + B d ≥ 0
//!     search        x + α d, α = 1, ½, … until the filter accepts; at α = 1 a second-order correction first
//!     leap          along directions that are almost flat, where Newton's method creeps
//!     extend        a step that δ or the convex Hessian has kept short, for as long as the objective falls
//!     on failure    solve to its end what is rough; with a solution at hand begin the filter anew; raise δ; restore feasibility, or begin
//!                   the filter anew; give up as `stalled` or `infeasible`
//! ```

use super::acceleration::{extension, leap};
use super::damping::Damping;
use super::globalisation::filter::{Filter, Verdict};
use super::globalisation::line_search::{self, Accepted};
use super::iterate::Iterate;
use super::kkt::Kkt;
use super::options::SqpOptions;
use super::problem::Problem;
use super::recovery::{Next, Recovery};
use super::restoration;
use super::state::State;
use super::subproblem::portfolio::Portfolio;
use super::subproblem::{NoStep, Step};
use super::termination::SqpStatus;
use super::trace::Record;

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

    fn error(&self) -> Option<f64> {
        Some(self.iterate.kkt_error().largest()).filter(|error| error.is_finite())
    }
}

/// Solves `problem` from `start`. Deterministic, one thread.
pub fn solve(problem: &dyn Problem, start: impl Into<Start>, options: SqpOptions) -> SqpOutcome {
    solve_with(&mut Kkt::new(problem), problem, start, options)
}

/// [`solve`] with the symbolic factorisation of this problem at hand.
///
/// What has not converged when the iterations are over, or is stuck, is begun anew with another preset and as many
/// iterations, unless the time is over; the better of the two answers counts: which of many flat ways the iteration
/// goes down depends on it.
pub fn solve_with(kkt: &mut Kkt, problem: &dyn Problem, start: impl Into<Start>, options: SqpOptions) -> SqpOutcome {
    kkt.deadline = options.termination.deadline;
    let start = start.into();
    let mut first = Solver::new(kkt, problem, start.clone(), options).run();
    let may_restart = options.restart.is_on && options.termination.max_iterations >= options.restart.least_iterations;
    if !first.status.is_stuck() || !may_restart || options.termination.deadline.passed() {
        return first;
    }
    if let Some(last) = first.trace.last_mut() {
        last.moved_to(&start.x);
    }
    let second = Solver::new(kkt, problem, start, options.thorough()).run();
    let is_better = match (first.error(), second.error()) {
        _ if second.status == SqpStatus::Converged => true,
        (Some(first), Some(second)) => second <= first,
        (first, _) => first.is_none(),
    };
    let trace = [&first.trace[..], &second.trace].concat();
    let factorisations = first.factorisations + second.factorisations;
    let better = if is_better { second } else { first };
    SqpOutcome { trace, factorisations, ..better }
}

struct Solver<'p> {
    options: SqpOptions,
    state: State<'p>,
    damping: Damping,
    portfolio: Portfolio,
    filter: Filter,
    /// Factorisations before this solve.
    factorised: usize,
}

impl<'p> Solver<'p> {
    fn new(kkt: &'p mut Kkt, problem: &'p dyn Problem, start: Start, options: SqpOptions) -> Self {
        let factorised = kkt.factorisations;
        let mut here = Iterate::new(problem, start.x);
        let active = start.multipliers.map(|(lambda, nu, active)| {
            (here.equality_multipliers, here.inequality_multipliers) = (lambda, nu);
            active
        });
        Self {
            options,
            filter: Filter::new(options.filter, here.violation()),
            state: State::new(kkt, problem, here, options.progress),
            damping: Damping::new(options.damping),
            portfolio: Portfolio::new(active),
            factorised,
        }
    }

    /// The loop.
    fn run(mut self) -> SqpOutcome {
        let mut trace: Vec<Record> = Vec::new();
        let status = loop {
            self.state.progress.note(self.state.error.largest());
            let mut record = Record::new(&self.state.here, self.state.error);
            let over = self.options.termination.judge(&self.state, trace.len());
            let ended = over.map_or_else(|| self.iterate(&mut record).err(), Some);
            trace.push(record);
            if let Some(status) = ended {
                break status;
            }
        };
        // A feasibility phase that failed has left the last point of the trace.
        if trace.last().is_some_and(|last| last.x != self.state.here.x) {
            trace.push(Record::new(&self.state.here, self.state.error));
        }
        let factorisations = self.state.kkt.factorisations - self.factorised;
        SqpOutcome { status, iterate: self.state.here, trace, factorisations }
    }

    /// One step from a point to the next.
    fn iterate(&mut self, record: &mut Record) -> Result<(), SqpStatus> {
        let factorised = self.state.kkt.factorisations;
        let moved = self.step_or_restore(record);
        record.factorisations = self.state.kkt.factorisations - factorised;
        // Work cut short by the deadline looks like a failure of its own.
        moved.map_err(|status| if self.is_late() { SqpStatus::TimeLimit } else { status })
    }

    fn step_or_restore(&mut self, record: &mut Record) -> Result<(), SqpStatus> {
        self.state.models.begin(&self.state.here.x);
        self.damping.begin(self.state.error.largest(), &self.state.progress);
        let mut recovery = Recovery::default();
        for attempt in 1..=self.options.recovery.attempts {
            if self.is_late() {
                return Err(SqpStatus::TimeLimit);
            }
            let delta = self.damping.delta;
            let mut step = match self.portfolio.solve(&mut self.state, &self.options, delta, recovery.to_the_end) {
                Ok(step) => step,
                Err(NoStep::Infeasible) => break,
                Err(_) if attempt == self.options.recovery.attempts => return Err(SqpStatus::QpFailed),
                Err(_) => {
                    self.damping.after_failure(delta);
                    self.portfolio.forget_active();
                    continue;
                }
            };
            record.qp_iterations += step.qp_iterations;
            if let Some(accepted) = line_search::search(&mut self.state, &self.filter, &mut step, &self.options) {
                record.refusals = attempt - 1;
                self.take(step, accepted, record);
                return Ok(());
            }
            match recovery.next(&self.state, &step, &self.filter, &self.options) {
                Next::ToTheEnd => {}
                Next::NewFilter => self.filter = Filter::new(self.options.filter, self.state.here.violation()),
                Next::RaiseDamping => self.damping.after_refusal(step.damping),
                Next::Restore => break,
            }
        }
        self.restore(record)
    }

    /// Moves to the accepted point, or further.
    fn take(&mut self, step: Step, Accepted { mut trial, fraction, verdict }: Accepted, record: &mut Record) {
        let (state, options) = (&mut self.state, &self.options);
        let before = state.error.largest();
        (record.damping, record.fraction, record.way) = (Some(step.damping), Some(fraction), Some(step.way));
        if leap::is_worth(state, &step, fraction, options) {
            record.leap = leap::leap(state, &step, &mut trial, options);
        } else {
            let blend = |old: &mut f64, new: &f64| *old += fraction * (new - *old);
            trial.equality_multipliers.iter_mut().zip(&step.equality_multipliers).for_each(|(o, n)| blend(o, n));
            trial.inequality_multipliers.iter_mut().zip(&step.inequality_multipliers).for_each(|(o, n)| blend(o, n));
            trial.differentiate(state.problem);
        }
        if verdict == Verdict::Progress {
            self.filter.add(state.pair());
        }
        state.move_to(trial);
        // Steps so long that they go to and fro.
        let is_too_long = state.progress.is_impatient() && state.error.largest() >= before;
        let is_whole = fraction == 1.0;
        self.damping.after_step(step.damping, is_whole && record.refusals == 0, !is_too_long, &state.progress);
        if is_whole && extension::is_worth(state, &step, before, options) {
            record.extension = extension::extend(state, &step, options);
        }
        record.moved_to(&state.here.x);
        self.portfolio.took(step.active);
    }

    /// Restores feasibility. Where that does not get on the filter begins anew, and with nothing in that it ends as
    /// `Stalled`.
    fn restore(&mut self, record: &mut Record) -> Result<(), SqpStatus> {
        let start = self.state.here.clone();
        let restored = restoration::restore(&mut self.state, &self.options, record);
        if restored == Ok(false) && !self.filter.is_empty() {
            // What was met before may be all that is in the way.
            self.filter = Filter::new(self.options.filter, start.violation());
            self.state.move_to(start);
            return Ok(());
        }
        self.state.error = self.state.here.kkt_error();
        let restored = restored?;
        record.is_restored = true;
        record.moved_to(&self.state.here.x);
        if !restored {
            return Err(SqpStatus::Stalled);
        }
        // A filter that will not have the restored point would have nothing near it either: it begins anew.
        if self.filter.allows(self.state.pair()) {
            self.filter.add((start.violation(), start.objective));
        } else {
            self.filter = Filter::new(self.options.filter, self.state.here.violation());
        }
        // The multipliers of the point before are the best that is known.
        let here = &mut self.state.here;
        here.equality_multipliers = start.equality_multipliers;
        here.inequality_multipliers = start.inequality_multipliers;
        self.state.error = here.kkt_error();
        Ok(())
    }

    fn is_late(&self) -> bool {
        self.options.termination.deadline.passed()
    }
}
