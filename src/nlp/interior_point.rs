//! The quadratic sub-problem by Mehrotra's predictor–corrector interior-point method, on the exact Hessian.
//!
//! ```text
//! minimise   ½ dᵀ Q d + gᵀ d,   Q = ∇²L + δ D
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
//! The first step only finds a start: taken in full, all slacks and all multipliers are then raised by what the lowest lacks, so that
//! the residuals of the equalities are gone and no product s ν stands out. From the second sub-problem on it begins where the last one ended
//! ([`Interior`]), drawn back from the bounds by as much as is left of the KKT error, takes a step or a few and leaves the rest to the next
//! sub-problem: far from a solution a linearisation is not worth more. Each factorisation serves the predictor, the corrector
//! and, while they make the step longer, a few more that bring the products s ν nearer to each other.
//!
//! Sources: S. Mehrotra, *SIAM J. Optim.* 2, 1992; J. Gondzio, *Comput. Optim. Appl.* 6, 1996.

use super::active_set::{NoStep, Step, raise};
use super::iterate::Iterate;
use super::kkt::{Kkt, KktValues, Rows};
use crate::numerics::sparse::Sparse;

pub const ITERATIONS: usize = 40;
/// Fraction of the way to the boundary.
const TO_BOUNDARY: f64 = 0.999;
/// Of a sub-problem that is a model of the Lagrangian to second order, and of one that is not.
pub const FINE: f64 = 1e-9;
pub const COARSE: f64 = 1e-6;
/// Gondzio's corrections: how many, by how much they aim further, what they must gain, the step long enough without them and the
/// range of s ν, in its aim, that they leave alone.
const CORRECTIONS: usize = 4;
const FURTHER: (f64, f64) = (1.08, 0.08);
const GAIN: f64 = 0.01;
const LONG: f64 = 0.95;
const NEAR: (f64, f64) = (0.1, 10.0);
/// The start: least slack, and multiplier in the gradient's size; how far the lowest comes above zero.
const LEAST_SLACK: f64 = 1e-2;
const RAISE: f64 = 1.1;
/// A start from the last sub-problem: its s ν is at least DRAWN_BACK E^1.5 in the gradient's size, E the KKT error, and a multiplier makes
/// no product further from that than by the factor CENTRED.
const DRAWN_BACK: f64 = 3e-2;
const LEAST_PRODUCT: f64 = 1e-12;
const CENTRED: f64 = 100.0;

/// Where a sub-problem ended: slacks s and multipliers ν of the inequalities, all positive.
#[derive(Clone, Debug)]
pub struct Interior {
    s: Vec<f64>,
    nu: Vec<f64>,
}

impl Interior {
    /// A start for the sub-problem at `here`, a point with this KKT error, whose gradient is of the size `scale`.
    fn start(&self, (here, error): (&Iterate, f64), scale: f64) -> Self {
        let count = self.s.len().max(1) as f64;
        let mean = self.s.iter().zip(&self.nu).map(|(s, nu)| s * nu).sum::<f64>() / count;
        let mu = (DRAWN_BACK * error.min(1.0).powf(1.5) * scale).max(mean).max(LEAST_PRODUCT * scale);
        let s: Vec<f64> = self.s.iter().zip(&here.inequalities).map(|(s, b)| s.max(*b).max(0.1 * mu / scale)).collect();
        let nu = self.nu.iter().zip(&s).map(|(nu, s)| nu.max(mu / (CENTRED * s)).min(CENTRED * mu / s)).collect();
        Self { s, nu }
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

/// Solves the sub-problem at `here`, a point with this KKT error, or takes a few steps towards its solution; `damping` is raised as far as
/// the inertia asks for, and left there. `last`: where the last sub-problem ended, and then this one.
pub fn solve(
    kkt: &mut Kkt,
    (here, error): (&Iterate, f64),
    hessian: &Sparse,
    metric: &Sparse,
    damping: &mut f64,
    Manner { most, tolerance, steps, is_plain }: Manner,
    last: &mut Option<Interior>,
) -> Result<Step, NoStep> {
    let (n, me, mi) = (here.x.len(), here.equalities.len(), here.inequalities.len());
    let largest = |values: &[f64]| values.iter().fold(0.0f64, |a, v| a.max(v.abs()));
    let scale = largest(&here.gradient).max(1e-6);
    let mut d = vec![0.0; n];
    let mut lambda = here.equality_multipliers.clone();
    let start = last.as_ref().filter(|_| !is_plain).map(|last| last.start((here, error), scale));
    let mut has_begun = is_plain || start.is_some();
    let Interior { mut s, mut nu } = start.unwrap_or_else(|| Interior {
        s: here.inequalities.iter().map(|b| b.max(LEAST_SLACK)).collect(),
        nu: here.inequality_multipliers.iter().map(|v| v.max(LEAST_SLACK * scale)).collect(),
    });
    let [mut right, mut solution, mut corrected] = [(); 3].map(|()| vec![0.0; kkt.order()]);
    let corrections = if is_plain { 0 } else { CORRECTIONS };
    // `moved`: d is not zero.
    let (mut taken, mut moved, mut has_asked) = (0, false, false);
    let mut weights = vec![0.0; mi];
    for _ in 0..ITERATIONS {
        // Residuals of the optimality conditions.
        let mut dual = here.gradient.clone();
        let mut primal = here.equalities.clone();
        let mut slack: Vec<f64> = here.inequalities.iter().zip(&s).map(|(b, s)| b - s).collect();
        if moved {
            hessian.add_symmetric_product(1.0, &d, &mut dual);
            metric.add_symmetric_product(*damping, &d, &mut dual);
            here.equality_jacobian.add_product(1.0, &d, &mut primal);
            here.inequality_jacobian.add_product(1.0, &d, &mut slack);
        }
        here.equality_jacobian.add_transpose_product(1.0, &lambda, &mut dual);
        here.inequality_jacobian.add_transpose_product(-1.0, &nu, &mut dual);
        let mu = s.iter().zip(&nu).map(|(s, nu)| s * nu).sum::<f64>() / mi.max(1) as f64;
        let done = largest(&dual) <= tolerance * scale
            && largest(&primal) <= tolerance
            && largest(&slack) <= tolerance
            && mu <= tolerance * scale * 1e-2;
        if done || taken == steps {
            let active = s.iter().zip(&nu).map(|(s, nu)| s * scale < *nu).collect();
            *last = Some(Interior { s, nu: nu.clone() });
            return Ok(Step {
                active,
                direction: d,
                equality_multipliers: lambda,
                inequality_multipliers: nu,
                qp_iterations: 0,
                is_settled: false,
            });
        }
        weights.iter_mut().zip(s.iter().zip(&nu)).for_each(|(w, (s, nu))| *w = s / nu);
        // For the complementarity residuals r.
        let fill = |right: &mut [f64], r: &[f64]| {
            (0..n).for_each(|i| right[i] = -dual[i]);
            (0..me).for_each(|i| right[n + i] = -primal[i]);
            (0..mi).for_each(|i| right[n + me + i] = -slack[i] - r[i] / nu[i]);
        };
        let plain: Vec<f64> = s.iter().zip(&nu).map(|(s, nu)| s * nu).collect();
        fill(&mut right, &plain);
        let mut is_right = |damping: f64| {
            let values = KktValues {
                hessian,
                metric,
                damping,
                equalities: &here.equality_jacobian,
                inequalities: &here.inequality_jacobian,
                rows: Rows::Weighted(&weights),
            };
            kkt.solve_convex(&values, &right, &mut solution).is_some()
        };
        if !is_right(*damping) {
            // Where the largest δ is not enough, none between is tried.
            let may_ask = taken == 0 && most.is_finite() && *damping < most;
            let is_hopeless = may_ask && !std::mem::replace(&mut has_asked, true) && !is_right(most);
            raise(damping)?;
            if is_hopeless || *damping > most {
                return Err(NoStep::Singular);
            }
            continue;
        }
        // (Δs, Δν)
        let of_rows = |r: &[f64], solution: &[f64]| {
            let dnu: Vec<f64> = (0..mi).map(|i| -solution[n + me + i]).collect();
            let ds: Vec<f64> = (0..mi).map(|i| -(r[i] + s[i] * dnu[i]) / nu[i]).collect();
            (ds, dnu)
        };
        let mut step = |r: &[f64], solution: &mut [f64], kkt: &mut Kkt| {
            fill(&mut right, r);
            kkt.solve_roughly(&right, solution);
            of_rows(r, solution)
        };
        let (ds, dnu) = of_rows(&plain, &solution);
        if !std::mem::replace(&mut has_begun, true) {
            d.iter_mut().zip(&solution[..n]).for_each(|(x, dx)| *x += dx);
            moved = true;
            lambda.iter_mut().zip(&solution[n..n + me]).for_each(|(x, dx)| *x += dx);
            begin(&mut s, &ds, LEAST_SLACK);
            begin(&mut nu, &dnu, LEAST_SLACK * scale);
            continue;
        }
        let (reach_s, reach_nu) = (reach(&s, &ds), reach(&nu, &dnu));
        let affine: f64 =
            (0..mi).map(|i| (s[i] + reach_s * ds[i]) * (nu[i] + reach_nu * dnu[i])).sum::<f64>() / mi.max(1) as f64;
        let sigma = if mu > 0.0 { (affine / mu).powi(3).min(1.0) } else { 0.0 };
        let aim = sigma * mu;
        let mut r: Vec<f64> = (0..mi).map(|i| plain[i] + ds[i] * dnu[i] - aim).collect();
        let (mut ds, mut dnu) = step(&r, &mut solution, kkt);
        // One length for all: with an indefinite Q, primal and dual steps do not part.
        let length = |ds: &[f64], dnu: &[f64]| (TO_BOUNDARY * reach(&s, ds).min(reach(&nu, dnu))).min(1.0);
        let mut alpha = length(&ds, &dnu);
        for _ in 0..corrections {
            if alpha >= LONG {
                break;
            }
            let far = (FURTHER.0 * alpha + FURTHER.1).min(1.0);
            for i in 0..mi {
                let product = (s[i] + far * ds[i]) * (nu[i] + far * dnu[i]);
                r[i] -= (product.clamp(NEAR.0 * aim, NEAR.1 * aim) - product).max(-NEAR.1 * aim);
            }
            let (ds_further, dnu_further) = step(&r, &mut corrected, kkt);
            let further = length(&ds_further, &dnu_further);
            if further < alpha + GAIN {
                break;
            }
            (ds, dnu, alpha) = (ds_further, dnu_further, further);
            solution.copy_from_slice(&corrected);
        }
        if alpha.is_nan() || alpha < 1e-8 || !solution.iter().all(|v| v.is_finite()) {
            return Err(NoStep::Singular);
        }
        d.iter_mut().zip(&solution[..n]).for_each(|(x, dx)| *x += alpha * dx);
        lambda.iter_mut().zip(&solution[n..n + me]).for_each(|(x, dx)| *x += alpha * dx);
        s.iter_mut().zip(&ds).for_each(|(x, dx)| *x += alpha * dx);
        nu.iter_mut().zip(&dnu).for_each(|(x, dx)| *x += alpha * dx);
        (taken, moved) = (taken + 1, true);
    }
    Err(NoStep::Unsettled)
}

/// Takes the whole step, then raises all by what the lowest lacks.
fn begin(values: &mut [f64], steps: &[f64], least: f64) {
    values.iter_mut().zip(steps).for_each(|(x, dx)| *x += dx);
    let lowest = values.iter().fold(0.0f64, |a, &v| a.min(v));
    values.iter_mut().for_each(|x| *x = (*x - RAISE * lowest).max(least));
}

/// Largest step that keeps all entries at or above zero, not bounded by 1 but by 1/0.999.
fn reach(values: &[f64], steps: &[f64]) -> f64 {
    let limit = 1.0 / TO_BOUNDARY;
    values.iter().zip(steps).filter(|(_, d)| **d < 0.0).map(|(v, d)| -v / d).fold(limit, f64::min)
}
