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
//! Source: S. Mehrotra, *SIAM J. Optim.* 2, 1992.

use super::active_set::{NoStep, Step, raise};
use super::iterate::Iterate;
use super::kkt::{Kkt, KktValues, Rows};
use crate::numerics::sparse::Sparse;

const ITERATIONS: usize = 40;
/// Fraction of the way to the boundary.
const TO_BOUNDARY: f64 = 0.995;
const TOLERANCE: f64 = 1e-9;
const LEAST_SLACK: f64 = 1e-2;

/// Solves the sub-problem at `here`; `damping` is raised as far as the inertia asks for, up to `most`, and left there.
pub fn solve(
    kkt: &mut Kkt,
    here: &Iterate,
    hessian: &Sparse,
    metric: &Sparse,
    damping: &mut f64,
    most: f64,
) -> Result<Step, NoStep> {
    let (n, me, mi) = (here.x.len(), here.equalities.len(), here.inequalities.len());
    let largest = |values: &[f64]| values.iter().fold(0.0f64, |a, v| a.max(v.abs()));
    let scale = largest(&here.gradient).max(1e-6);
    let mut d = vec![0.0; n];
    let mut lambda = here.equality_multipliers.clone();
    let mut s: Vec<f64> = here.inequalities.iter().map(|b| b.max(LEAST_SLACK)).collect();
    let mut nu: Vec<f64> = here.inequality_multipliers.iter().map(|v| v.max(LEAST_SLACK * scale)).collect();
    let (mut right, mut solution) = (vec![0.0; kkt.order()], vec![0.0; kkt.order()]);
    let mut weights = vec![0.0; mi];
    for factorisations in 0..ITERATIONS {
        // Residuals of the optimality conditions.
        let mut dual = here.gradient.clone();
        hessian.add_symmetric_product(1.0, &d, &mut dual);
        metric.add_symmetric_product(*damping, &d, &mut dual);
        here.equality_jacobian.add_transpose_product(1.0, &lambda, &mut dual);
        here.inequality_jacobian.add_transpose_product(-1.0, &nu, &mut dual);
        let mut primal = here.equalities.clone();
        here.equality_jacobian.add_product(1.0, &d, &mut primal);
        let mut slack: Vec<f64> = here.inequalities.iter().zip(&s).map(|(b, s)| b - s).collect();
        here.inequality_jacobian.add_product(1.0, &d, &mut slack);
        let mu = s.iter().zip(&nu).map(|(s, nu)| s * nu).sum::<f64>() / mi.max(1) as f64;
        let done = largest(&dual) <= TOLERANCE * scale
            && largest(&primal) <= TOLERANCE
            && largest(&slack) <= TOLERANCE
            && mu <= TOLERANCE * scale * 1e-2;
        if done {
            return Ok(Step {
                active: s.iter().zip(&nu).map(|(s, nu)| s * scale < *nu).collect(),
                direction: d,
                equality_multipliers: lambda,
                inequality_multipliers: nu,
                qp_iterations: 0,
                factorisations,
            });
        }
        weights.iter_mut().zip(s.iter().zip(&nu)).for_each(|(w, (s, nu))| *w = s / nu);
        let inertia = kkt.factorise(&KktValues {
            hessian,
            metric,
            damping: *damping,
            equalities: &here.equality_jacobian,
            inequalities: &here.inequality_jacobian,
            rows: Rows::Weighted(&weights),
        });
        if !inertia.is_some_and(|inertia| kkt.is_right(inertia)) {
            raise(damping)?;
            if *damping > most {
                return Err(NoStep::Singular);
            }
            continue;
        }
        // (Δs, Δν) from a solution of the system for the complementarity residuals r.
        let mut step = |r: &[f64], solution: &mut [f64], kkt: &mut Kkt| {
            (0..n).for_each(|i| right[i] = -dual[i]);
            (0..me).for_each(|i| right[n + i] = -primal[i]);
            (0..mi).for_each(|i| right[n + me + i] = -slack[i] - r[i] / nu[i]);
            kkt.solve(&right, solution);
            let dnu: Vec<f64> = (0..mi).map(|i| -solution[n + me + i]).collect();
            let ds: Vec<f64> = (0..mi).map(|i| -(r[i] + s[i] * dnu[i]) / nu[i]).collect();
            (ds, dnu)
        };
        let plain: Vec<f64> = s.iter().zip(&nu).map(|(s, nu)| s * nu).collect();
        let (ds, dnu) = step(&plain, &mut solution, kkt);
        let (reach_s, reach_nu) = (reach(&s, &ds), reach(&nu, &dnu));
        let affine: f64 =
            (0..mi).map(|i| (s[i] + reach_s * ds[i]) * (nu[i] + reach_nu * dnu[i])).sum::<f64>() / mi.max(1) as f64;
        let sigma = if mu > 0.0 { (affine / mu).powi(3).min(1.0) } else { 0.0 };
        let corrected: Vec<f64> = (0..mi).map(|i| plain[i] + ds[i] * dnu[i] - sigma * mu).collect();
        let (ds, dnu) = step(&corrected, &mut solution, kkt);
        // One length for all: with an indefinite Q, primal and dual steps do not part.
        let alpha = (TO_BOUNDARY * reach(&s, &ds).min(reach(&nu, &dnu))).min(1.0);
        if alpha.is_nan() || alpha < 1e-8 || !solution.iter().all(|v| v.is_finite()) {
            return Err(NoStep::Singular);
        }
        d.iter_mut().zip(&solution[..n]).for_each(|(x, dx)| *x += alpha * dx);
        lambda.iter_mut().zip(&solution[n..n + me]).for_each(|(x, dx)| *x += alpha * dx);
        s.iter_mut().zip(&ds).for_each(|(x, dx)| *x += alpha * dx);
        nu.iter_mut().zip(&dnu).for_each(|(x, dx)| *x += alpha * dx);
    }
    Err(NoStep::Unsettled)
}

/// Largest step that keeps all entries at or above zero, not bounded by 1 but by 1/0.995.
fn reach(values: &[f64], steps: &[f64]) -> f64 {
    let limit = 1.0 / TO_BOUNDARY;
    values.iter().zip(steps).filter(|(_, d)| **d < 0.0).map(|(v, d)| -v / d).fold(limit, f64::min)
}
