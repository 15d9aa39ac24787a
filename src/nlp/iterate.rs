//! A point of the iteration with everything evaluated there, and its three KKT residuals.

use super::kkt::{KktValues, Rows};
use super::problem::{Multipliers, Problem};
use crate::numerics::larger;
use crate::numerics::sparse::Sparse;

/// x, its multipliers, and the functions and first derivatives at x.
#[derive(Clone, Debug)]
pub struct Iterate {
    pub x: Vec<f64>,
    /// λ
    pub equality_multipliers: Vec<f64>,
    /// ν ≥ 0
    pub inequality_multipliers: Vec<f64>,
    /// f(x)
    pub objective: f64,
    /// ∇f
    pub gradient: Vec<f64>,
    /// c(x), d(x)
    pub equalities: Vec<f64>,
    pub inequalities: Vec<f64>,
    pub equality_jacobian: Sparse,
    pub inequality_jacobian: Sparse,
}

/// Stationarity, feasibility and complementarity of the scaled problem the solver works on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KktError {
    /// ‖∇L‖∞ / max(1e-3, ‖∇f‖∞)
    pub stationarity: f64,
    /// max(|c|, −d)
    pub feasibility: f64,
    /// max |ν d|
    pub complementarity: f64,
}

impl KktError {
    pub fn largest(&self) -> f64 {
        larger(larger(self.stationarity, self.feasibility), self.complementarity)
    }
}

fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, larger)
}

impl Iterate {
    /// Evaluates everything at `x`, with zero multipliers.
    pub fn new(problem: &dyn Problem, x: Vec<f64>) -> Self {
        let [equality_jacobian, inequality_jacobian, _] = problem.patterns();
        let mut iterate = Self {
            equality_multipliers: vec![0.0; problem.equalities()],
            inequality_multipliers: vec![0.0; problem.inequalities()],
            objective: 0.0,
            gradient: vec![0.0; x.len()],
            equalities: vec![0.0; problem.equalities()],
            inequalities: vec![0.0; problem.inequalities()],
            equality_jacobian: equality_jacobian.clone(),
            inequality_jacobian: inequality_jacobian.clone(),
            x,
        };
        iterate.evaluate(problem);
        iterate.differentiate(problem);
        iterate
    }

    /// `self` moved by `fraction · direction`: its functions and its multipliers. First derivatives are there only
    /// after [`Iterate::differentiate`].
    pub fn moved(&self, problem: &dyn Problem, direction: &[f64], fraction: f64) -> Self {
        let mut moved = Self {
            x: self.x.iter().zip(direction).map(|(x, d)| x + fraction * d).collect(),
            equality_multipliers: self.equality_multipliers.clone(),
            inequality_multipliers: self.inequality_multipliers.clone(),
            objective: 0.0,
            gradient: vec![0.0; self.x.len()],
            equalities: vec![0.0; self.equalities.len()],
            inequalities: vec![0.0; self.inequalities.len()],
            equality_jacobian: self.equality_jacobian.without_values(),
            inequality_jacobian: self.inequality_jacobian.without_values(),
        };
        moved.evaluate(problem);
        moved
    }

    /// f, c, d at x.
    pub fn evaluate(&mut self, problem: &dyn Problem) {
        self.objective = 0.5 * residual(problem, &self.x).iter().map(|r| r * r).sum::<f64>();
        if let Some(term) = problem.term() {
            self.objective += term.parts(&self.x).iter().map(|part| part[0]).sum::<f64>();
        }
        problem.constraints(&self.x, &mut self.equalities, &mut self.inequalities);
    }

    /// ∇f and the Jacobians at x.
    pub fn differentiate(&mut self, problem: &dyn Problem) {
        self.gradient.fill(0.0);
        problem.residual_jacobian().add_transpose_product(1.0, &residual(problem, &self.x), &mut self.gradient);
        if let Some(term) = problem.term() {
            let slopes: Vec<f64> = term.parts(&self.x).iter().map(|part| part[1]).collect();
            term.functions().add_transpose_product(1.0, &slopes, &mut self.gradient);
        }
        problem.jacobians(&self.x, &mut self.equality_jacobian, &mut self.inequality_jacobian);
    }

    pub fn multipliers(&self) -> Multipliers<'_> {
        Multipliers { equalities: &self.equality_multipliers, inequalities: &self.inequality_multipliers }
    }

    /// ∇L = ∇f + Aᵀ λ − Bᵀ ν
    pub fn lagrangian_gradient(&self) -> Vec<f64> {
        let mut gradient = self.gradient.clone();
        self.equality_jacobian.add_transpose_product(1.0, &self.equality_multipliers, &mut gradient);
        self.inequality_jacobian.add_transpose_product(-1.0, &self.inequality_multipliers, &mut gradient);
        gradient
    }

    /// The KKT matrix with this point's Jacobians, and damping δ.
    pub fn system<'a>(
        &'a self,
        (hessian, metric): (&'a Sparse, &'a Sparse),
        damping: f64,
        rows: Rows<'a>,
    ) -> KktValues<'a> {
        let (equalities, inequalities) = (&self.equality_jacobian, &self.inequality_jacobian);
        let unit = largest(self.gradient.iter().map(|g| g.abs())).clamp(LEAST_UNIT, 1.0);
        KktValues { hessian, metric, damping, equalities, inequalities, rows, unit }
    }

    /// The right-hand side of the least step onto the equalities and `active` inequalities.
    pub fn onto_constraints(&self, active: &[bool]) -> Vec<f64> {
        let mut right = vec![0.0; self.x.len()];
        right.extend(self.equalities.iter().map(|c| -c));
        right.extend(self.inequalities.iter().zip(active).map(|(d, active)| if *active { -d } else { 0.0 }));
        right
    }

    /// Constraint violation ‖c‖₁ + ‖min(d, 0)‖₁.
    pub fn violation(&self) -> f64 {
        self.equalities.iter().map(|c| c.abs()).sum::<f64>()
            + self.inequalities.iter().map(|d| (-d).max(0.0)).sum::<f64>()
    }

    pub fn kkt_error(&self) -> KktError {
        self.kkt_error_with(&self.lagrangian_gradient())
    }

    /// [`Iterate::kkt_error`] where ∇L is known.
    pub fn kkt_error_with(&self, lagrangian_gradient: &[f64]) -> KktError {
        let scale = largest(self.gradient.iter().map(|g| g.abs())).max(LEAST_UNIT);
        KktError {
            stationarity: largest(lagrangian_gradient.iter().map(|g| g.abs())) / scale,
            feasibility: larger(
                largest(self.equalities.iter().map(|c| c.abs())),
                largest(self.inequalities.iter().map(|d| -d)),
            ),
            complementarity: largest(
                self.inequalities.iter().zip(&self.inequality_multipliers).map(|(d, nu)| (d * nu).abs()),
            ),
        }
    }

    pub fn is_finite(&self) -> bool {
        self.objective.is_finite() && self.equalities.iter().chain(&self.inequalities).all(|v| v.is_finite())
    }
}

/// The least size of a gradient against which ∇L is measured.
const LEAST_UNIT: f64 = 1e-3;

/// r = J x − b
pub fn residual(problem: &dyn Problem, x: &[f64]) -> Vec<f64> {
    let mut residual: Vec<f64> = problem.residual_data().iter().map(|b| -b).collect();
    problem.residual_jacobian().add_product(1.0, x, &mut residual);
    residual
}
