//! The interface between a transcribed problem and the solver.

use crate::numerics::sparse::Sparse;

/// A constrained nonlinear least-squares problem with fixed sparsity patterns:
///
/// ```text
/// minimise   f(x) = ½ ‖J x − b‖²
/// subject to c(x) = 0    (equalities)
///            d(x) ≥ 0    (inequalities)
/// ```
///
/// Sign convention, used everywhere: `L(x, λ, ν) = f(x) + λᵀ c(x) − νᵀ d(x)` with `ν ≥ 0`.
pub trait Problem: Sync {
    /// Length of the decision vector x.
    fn variables(&self) -> usize;
    fn equalities(&self) -> usize;
    fn inequalities(&self) -> usize;

    /// J, residuals × variables, constant.
    fn residual_jacobian(&self) -> &Sparse;
    /// b
    fn residual_data(&self) -> &[f64];

    /// The stage in time of each variable; constraints tie only near stages, which makes the linear algebra linear in time.
    fn stages(&self) -> &[usize];

    /// The stages of the equalities and of the inequalities: where their multipliers are best eliminated.
    fn constraint_stages(&self) -> [&[usize]; 2];

    /// c(x) and d(x).
    fn constraints(&self, x: &[f64], equalities: &mut [f64], inequalities: &mut [f64]);

    /// Largest violation of any constraint in the units of the unscaled problem.
    fn feasibility(&self, x: &[f64]) -> f64;

    /// Zero matrices with the patterns of ∂c/∂x, ∂d/∂x and of the upper triangle of ∇²L.
    fn patterns(&self) -> [&Sparse; 3];

    /// ∂c/∂x and ∂d/∂x into matrices of the given patterns, which need not have values before.
    fn jacobians(&self, x: &[f64], equalities: &mut Sparse, inequalities: &mut Sparse);

    /// Upper triangle of ∇²ₓₓ L(x, λ, ν), JᵀJ included; or a positive semidefinite matrix near it.
    fn hessian(&self, x: &[f64], multipliers: Multipliers<'_>, curvature: Curvature, out: &mut Sparse);

    /// Upper triangle, in the Hessian's pattern, of the positive semidefinite matrix that measures steps: what
    /// counts as a large change of each variable at `x`.
    fn metric(&self, x: &[f64], out: &mut Sparse);
}

/// λ and ν of the Lagrangian.
#[derive(Clone, Copy, Debug)]
pub struct Multipliers<'a> {
    pub equalities: &'a [f64],
    pub inequalities: &'a [f64],
}

/// Which Hessian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Curvature {
    Exact,
    /// Negative curvature left out, block by block.
    Convex,
}
