//! The interface between a transcribed problem and the solver.

use std::borrow::Cow;

use crate::numerics::sparse::Sparse;

/// A constrained nonlinear problem with fixed sparsity patterns, least squares and perhaps a smooth convex term:
///
/// ```text
/// minimise   f(x) = ½ ‖J x − b‖² + Σ_k φ_k((K x)_k)
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

    /// The smooth convex term, if the objective has one.
    fn term(&self) -> Option<&dyn ConvexTerm> {
        None
    }

    /// The stage in time of each variable; constraints tie only near stages, which makes the linear algebra linear in
    /// time.
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

    /// Upper triangle of ∇²ₓₓ L(x, λ, ν), ∇²f included; or a positive semidefinite matrix near it.
    fn hessian(&self, x: &[f64], multipliers: Multipliers<'_>, curvature: Curvature, out: &mut Sparse);

    /// Upper triangle, in the Hessian's pattern, of the positive semidefinite matrix that measures steps: what
    /// counts as a large change of each variable at `x`.
    fn metric(&self, x: &[f64], out: &mut Sparse);
}

/// A sum of smooth convex functions, each of one linear function of x: `Σ_k φ_k(y_k)`, y = K x.
pub trait ConvexTerm: Sync {
    /// K, with a fixed pattern.
    fn functions(&self) -> &Sparse;

    /// φ_k, φ_k′ and φ_k″ ≥ 0 at y_k.
    fn part(&self, k: usize, y: f64) -> [f64; 3];

    /// φ_k, φ_k′ and φ_k″ of all parts at x.
    fn parts(&self, x: &[f64]) -> Vec<[f64; 3]> {
        let mut y = vec![0.0; self.functions().rows];
        self.functions().add_product(1.0, x, &mut y);
        y.into_iter().enumerate().map(|(k, y)| self.part(k, y)).collect()
    }
}

/// Rows R whose product RᵀR is ∇²f: J, and below it √φ″ K, with the same pattern at every x.
pub fn objective_rows<'p>(problem: &'p dyn Problem, x: &[f64]) -> Cow<'p, Sparse> {
    let jacobian = problem.residual_jacobian();
    let Some(term) = problem.term() else { return Cow::Borrowed(jacobian) };
    let parts = term.parts(x);
    let below = term.functions();
    let mut triplets: Vec<(usize, usize, f64)> =
        jacobian.entries().map(|(row, column, slot)| (row, column, jacobian.values[slot])).collect();
    triplets.extend(
        below
            .entries()
            .map(|(k, column, slot)| (jacobian.rows + k, column, parts[k][2].max(0.0).sqrt() * below.values[slot])),
    );
    Cow::Owned(Sparse::from_triplets(jacobian.rows + below.rows, jacobian.columns, &triplets))
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
