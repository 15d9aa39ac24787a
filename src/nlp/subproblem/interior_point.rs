//! The quadratic sub-problem by Mehrotra's predictor–corrector interior-point method, with any Hessian.
//!
//! ```text
//! minimise   ½ dᵀ Q d + gᵀ d,   Q = H + δ D
//! subject to c + A d = 0,   b + B d = s ≥ 0
//!
//!     ⎡ Q  Aᵀ  Bᵀ   ⎤ ⎡  Δd ⎤     ⎡ Q d + g + Aᵀλ − Bᵀν ⎤
//!     ⎢ A  0   0    ⎥ ⎢  Δλ ⎥ = − ⎢ A d + c             ⎥
//!     ⎣ B  0  −S/N  ⎦ ⎣ −Δν ⎦     ⎣ B d + b − s + r/ν   ⎦     r = s ν (+ Δs Δν) − σ μ
//! ```
//!
//! Q need not be positive definite, only where the equalities vanish and S/N weighs the rest: the inertia tells, and δ
//! grows until it is. Degenerate active sets, on which guessing cycles, do it no harm.
//!
//! The first step only finds a start: taken in full, all slacks and all multipliers are then raised by what the lowest
//! lacks, so that the residuals of the equalities are gone and no product s ν stands out. From the second sub-problem
//! on it begins where the last one ended ([`Interior`]), drawn back from the bounds by as much as is left of the KKT
//! error, takes a step or a few and leaves the rest to the next sub-problem: far from a solution a linearisation is not
//! worth more. Each factorisation serves the predictor, the corrector and, while they make the step longer, a few more
//! that bring the products s ν nearer to each other.
//!
//! Sources: S. Mehrotra, *SIAM J. Optim.* 2, 1992; J. Gondzio, *Comput. Optim. Appl.* 6, 1996.

use super::{NoStep, Quality, Step, Way};
use crate::nlp::curvature::Model;
use crate::nlp::iterate::Iterate;
use crate::nlp::kkt::{Kkt, Rows};
use crate::nlp::options::{DampingOptions, InteriorPointOptions, SqpOptions};
use crate::nlp::state::State;
use crate::numerics::sparse::Sparse;

/// Where a sub-problem ended: slacks s and multipliers ν of the inequalities, all positive.
#[derive(Clone, Debug)]
pub struct Interior {
    s: Vec<f64>,
    nu: Vec<f64>,
}

impl Interior {
    /// A start of its own.
    fn cold(here: &Iterate, scale: f64, least: f64) -> Self {
        Self {
            s: here.inequalities.iter().map(|b| b.max(least)).collect(),
            nu: here.inequality_multipliers.iter().map(|v| v.max(least * scale)).collect(),
        }
    }

    /// A start for the sub-problem at `here`, a point with this error, whose gradient is of the size `scale`.
    fn start(&self, (here, error): (&Iterate, f64), scale: f64, numbers: &InteriorPointOptions) -> Self {
        let least = numbers.least_product * scale;
        let mu = (numbers.drawn_back * error.min(1.0).powf(1.5) * scale).max(self.mean()).max(least);
        let s: Vec<f64> = self.s.iter().zip(&here.inequalities).map(|(s, b)| s.max(*b).max(0.1 * mu / scale)).collect();
        let centred = numbers.centred;
        let nu = self.nu.iter().zip(&s).map(|(nu, s)| nu.max(mu / (centred * s)).min(centred * mu / s)).collect();
        Self { s, nu }
    }

    /// μ, the mean of s ν.
    fn mean(&self) -> f64 {
        self.products().sum::<f64>() / self.s.len().max(1) as f64
    }

    fn products(&self) -> impl Iterator<Item = f64> {
        self.s.iter().zip(&self.nu).map(|(s, nu)| s * nu)
    }
}

/// How far to go, and how.
#[derive(Clone, Copy, Debug)]
pub struct Manner {
    /// δ is raised up to here.
    pub most: f64,
    /// Relative.
    pub tolerance: f64,
    /// No more than these are taken.
    pub steps: usize,
    /// Each sub-problem from its own start, to its end, without that first step and without the further corrections.
    pub is_plain: bool,
}

/// Solves the sub-problem with the Hessian of `model`, or takes a few steps towards its solution; δ is raised from
/// `delta` as far as the inertia asks for. `last`: where the last sub-problem ended, and then this one.
pub fn solve(
    state: &mut State<'_>,
    options: &SqpOptions,
    model: Model,
    delta: f64,
    manner: Manner,
    last: &mut Option<Interior>,
) -> Result<Step, NoStep> {
    let mut search = Search::new(state, options, model, delta, manner, last.as_ref());
    for _ in 0..options.interior_point.max_iterations {
        let residuals = search.residuals();
        if search.taken == manner.steps || search.is_done(&residuals) {
            let (step, interior) = search.step(model);
            *last = Some(interior);
            return Ok(step);
        }
        if !search.factorise(&residuals) {
            search.raise_delta()?;
        } else if search.has_begun {
            search.advance(&residuals)?;
        } else {
            search.begin();
        }
    }
    Err(NoStep::Unsettled)
}

/// The iteration within one sub-problem.
struct Search<'a> {
    kkt: &'a mut Kkt,
    here: &'a Iterate,
    hessian: &'a Sparse,
    metric: &'a Sparse,
    numbers: InteriorPointOptions,
    damping: DampingOptions,
    manner: Manner,
    /// Size of the gradient.
    scale: f64,
    delta: f64,
    d: Vec<f64>,
    lambda: Vec<f64>,
    inner: Interior,
    /// Whether the start has been found.
    has_begun: bool,
    /// Whether the largest δ has been asked.
    has_asked: bool,
    /// Whether d is not zero.
    has_moved: bool,
    taken: usize,
    /// The right-hand side and solution of the last system.
    right: Vec<f64>,
    solution: Vec<f64>,
}

/// Of the optimality conditions, without the complementarity.
struct Residuals {
    dual: Vec<f64>,
    primal: Vec<f64>,
    slack: Vec<f64>,
}

/// Δs and Δν.
struct Change {
    s: Vec<f64>,
    nu: Vec<f64>,
}

impl<'a> Search<'a> {
    fn new(
        state: &'a mut State<'_>,
        options: &SqpOptions,
        model: Model,
        delta: f64,
        manner: Manner,
        last: Option<&Interior>,
    ) -> Self {
        let State { kkt, here, models, error, .. } = state;
        let (hessian, metric) = models.at(model, here);
        let numbers = options.interior_point;
        let scale = largest(&here.gradient).max(1e-6);
        let start = last.filter(|_| !manner.is_plain).map(|last| last.start((here, error.largest()), scale, &numbers));
        Self {
            hessian,
            metric,
            numbers,
            damping: options.damping,
            manner,
            scale,
            delta,
            d: vec![0.0; here.x.len()],
            lambda: here.equality_multipliers.clone(),
            has_begun: manner.is_plain || start.is_some(),
            inner: start.unwrap_or_else(|| Interior::cold(here, scale, numbers.least_slack)),
            has_asked: false,
            has_moved: false,
            taken: 0,
            right: vec![0.0; kkt.order()],
            solution: vec![0.0; kkt.order()],
            kkt,
            here,
        }
    }

    fn residuals(&self) -> Residuals {
        let here = self.here;
        let mut dual = here.gradient.clone();
        let mut primal = here.equalities.clone();
        let mut slack: Vec<f64> = here.inequalities.iter().zip(&self.inner.s).map(|(b, s)| b - s).collect();
        if self.has_moved {
            self.hessian.add_symmetric_product(1.0, &self.d, &mut dual);
            self.metric.add_symmetric_product(self.delta, &self.d, &mut dual);
            here.equality_jacobian.add_product(1.0, &self.d, &mut primal);
            here.inequality_jacobian.add_product(1.0, &self.d, &mut slack);
        }
        here.equality_jacobian.add_transpose_product(1.0, &self.lambda, &mut dual);
        here.inequality_jacobian.add_transpose_product(-1.0, &self.inner.nu, &mut dual);
        Residuals { dual, primal, slack }
    }

    fn is_done(&self, Residuals { dual, primal, slack }: &Residuals) -> bool {
        let tolerance = self.manner.tolerance;
        largest(dual) <= tolerance * self.scale
            && largest(primal) <= tolerance
            && largest(slack) <= tolerance
            && self.inner.mean() <= tolerance * self.scale * 1e-2
    }

    fn step(self, model: Model) -> (Step, Interior) {
        let Interior { s, nu } = &self.inner;
        let step = Step {
            active: s.iter().zip(nu).map(|(s, nu)| s * self.scale < *nu).collect(),
            direction: self.d,
            equality_multipliers: self.lambda,
            inequality_multipliers: nu.clone(),
            damping: self.delta,
            way: Way::InteriorPoint(model),
            quality: if self.manner.is_plain { Quality::Full } else { Quality::Rough },
            has_factors: true,
            is_settled: false,
            qp_iterations: 0,
        };
        (step, self.inner)
    }

    /// Factorises and solves for the predictor; whether Q is positive definite enough.
    fn factorise(&mut self, residuals: &Residuals) -> bool {
        let products: Vec<f64> = self.inner.products().collect();
        self.fill(residuals, &products);
        self.is_right(self.delta)
    }

    fn is_right(&mut self, delta: f64) -> bool {
        let weights: Vec<f64> = self.inner.s.iter().zip(&self.inner.nu).map(|(s, nu)| s / nu).collect();
        let values = self.here.system((self.hessian, self.metric), delta, Rows::Weighted(&weights));
        self.kkt.solve_convex(&values, &self.right, &mut self.solution).is_some()
    }

    /// Where the largest δ is not enough, none between is tried.
    fn raise_delta(&mut self) -> Result<(), NoStep> {
        let most = self.manner.most;
        let may_ask = self.taken == 0 && most.is_finite() && self.delta < most;
        let is_hopeless = may_ask && !std::mem::replace(&mut self.has_asked, true) && !self.is_right(most);
        self.delta = self.damping.raised(self.delta).ok_or(NoStep::Singular)?;
        if is_hopeless || self.delta > most { Err(NoStep::TooCurved) } else { Ok(()) }
    }

    /// The right-hand side for the complementarity residuals r.
    fn fill(&mut self, Residuals { dual, primal, slack }: &Residuals, r: &[f64]) {
        let (n, me) = (dual.len(), primal.len());
        let (of_variables, of_rows) = self.right.split_at_mut(n);
        of_variables.iter_mut().zip(dual).for_each(|(right, dual)| *right = -dual);
        of_rows.iter_mut().zip(primal).for_each(|(right, primal)| *right = -primal);
        let of_inequalities = of_rows[me..].iter_mut().zip(slack).zip(r.iter().zip(&self.inner.nu));
        of_inequalities.for_each(|((right, slack), (r, nu))| *right = -slack - r / nu);
    }

    /// Δs and Δν of the last solution, r being what it was solved for.
    fn change(&self, r: &[f64]) -> Change {
        let Interior { s, nu } = &self.inner;
        let at = self.here.x.len() + self.lambda.len();
        let dnu: Vec<f64> = self.solution[at..].iter().map(|minus| -minus).collect();
        let ds = (0..s.len()).map(|i| -(r[i] + s[i] * dnu[i]) / nu[i]).collect();
        Change { s: ds, nu: dnu }
    }

    fn solve_for(&mut self, residuals: &Residuals, r: &[f64]) -> Change {
        self.fill(residuals, r);
        self.kkt.solve_roughly(&self.right, &mut self.solution);
        self.change(r)
    }

    /// Finds the start: takes the predictor in full, then raises all slacks and all multipliers by what the lowest
    /// lacks.
    fn begin(&mut self) {
        let products: Vec<f64> = self.inner.products().collect();
        let change = self.change(&products);
        self.move_by(1.0);
        let InteriorPointOptions { least_slack, raise, .. } = self.numbers;
        let lift = |values: &mut [f64], steps: &[f64], least: f64| {
            values.iter_mut().zip(steps).for_each(|(x, dx)| *x += dx);
            let lowest = values.iter().fold(0.0f64, |a, &v| a.min(v));
            values.iter_mut().for_each(|x| *x = (*x - raise * lowest).max(least));
        };
        lift(&mut self.inner.s, &change.s, least_slack);
        lift(&mut self.inner.nu, &change.nu, least_slack * self.scale);
        self.has_begun = true;
    }

    /// Moves d and λ.
    fn move_by(&mut self, alpha: f64) {
        let (dd, rest) = self.solution.split_at(self.d.len());
        self.d.iter_mut().zip(dd).for_each(|(x, dx)| *x += alpha * dx);
        self.lambda.iter_mut().zip(rest).for_each(|(x, dx)| *x += alpha * dx);
        self.has_moved = true;
    }

    /// One length for all: with an indefinite Q, primal and dual steps do not part.
    fn length(&self, change: &Change) -> f64 {
        let Interior { s, nu } = &self.inner;
        let to_boundary = self.numbers.to_boundary;
        (to_boundary * reach(s, &change.s, to_boundary).min(reach(nu, &change.nu, to_boundary))).min(1.0)
    }

    /// Predictor, corrector, further corrections, step.
    fn advance(&mut self, residuals: &Residuals) -> Result<(), NoStep> {
        let plain: Vec<f64> = self.inner.products().collect();
        let predictor = self.change(&plain);
        let aim = self.aim(&predictor);
        let mi = plain.len();
        let mut r: Vec<f64> = (0..mi).map(|i| plain[i] + predictor.s[i] * predictor.nu[i] - aim).collect();
        let mut change = self.solve_for(residuals, &r);
        let mut alpha = self.length(&change);
        let corrections = if self.manner.is_plain { 0 } else { self.numbers.corrections };
        for _ in 0..corrections {
            if alpha >= self.numbers.long {
                break;
            }
            self.centre(&mut r, &change, alpha, aim);
            let solution = self.solution.clone();
            let further = self.solve_for(residuals, &r);
            let length = self.length(&further);
            if length < alpha + self.numbers.gain {
                self.solution = solution;
                break;
            }
            (change, alpha) = (further, length);
        }
        if alpha.is_nan() || alpha < 1e-8 || !self.solution.iter().all(|v| v.is_finite()) {
            return Err(NoStep::Singular);
        }
        self.move_by(alpha);
        self.inner.s.iter_mut().zip(&change.s).for_each(|(x, dx)| *x += alpha * dx);
        self.inner.nu.iter_mut().zip(&change.nu).for_each(|(x, dx)| *x += alpha * dx);
        self.taken += 1;
        Ok(())
    }

    /// σ μ, by Mehrotra's rule.
    fn aim(&self, predictor: &Change) -> f64 {
        let Interior { s, nu } = &self.inner;
        let to_boundary = self.numbers.to_boundary;
        let [far_s, far_nu] = [(s, &predictor.s), (nu, &predictor.nu)].map(|(v, d)| reach(v, d, to_boundary));
        let reached = (0..s.len()).map(|i| (s[i] + far_s * predictor.s[i]) * (nu[i] + far_nu * predictor.nu[i]));
        let (mu, affine) = (self.inner.mean(), reached.sum::<f64>() / s.len().max(1) as f64);
        let sigma = if mu > 0.0 { (affine / mu).powi(3).min(1.0) } else { 0.0 };
        sigma * mu
    }

    /// Gondzio: asks for the products s ν a little further out to be neither far above nor far below the aim.
    fn centre(&self, r: &mut [f64], change: &Change, alpha: f64, aim: f64) {
        let InteriorPointOptions { further_factor, further, lowest_product, highest_product, .. } = self.numbers;
        let Interior { s, nu } = &self.inner;
        let far = (further_factor * alpha + further).min(1.0);
        for i in 0..r.len() {
            let product = (s[i] + far * change.s[i]) * (nu[i] + far * change.nu[i]);
            let wanted = product.clamp(lowest_product * aim, highest_product * aim);
            r[i] -= (wanted - product).max(-highest_product * aim);
        }
    }
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0f64, |a, v| a.max(v.abs()))
}

/// Largest step that keeps all entries at or above zero, bounded not by 1 but by what `to_boundary` makes 1.
fn reach(values: &[f64], steps: &[f64], to_boundary: f64) -> f64 {
    let limit = 1.0 / to_boundary;
    values.iter().zip(steps).filter(|(_, d)| **d < 0.0).map(|(v, d)| -v / d).fold(limit, f64::min)
}
