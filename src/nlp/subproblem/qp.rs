//! Convex quadratic programmes by Clarabel. The only file that knows it.
//!
//! ```text
//! minimise   ½ dᵀ P d + gᵀ d
//! subject to A d + c = 0,   B d + s ≥ 0
//! ```

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus, ZeroConeT};

use crate::deadline::Deadline;
use crate::numerics::sparse::Sparse;

/// A convex quadratic programme; see the module.
pub struct QuadraticProgramme<'a> {
    /// Upper triangle of P, positive semidefinite.
    pub hessian: &'a Sparse,
    pub gradient: &'a [f64],
    pub equalities: &'a Sparse,
    pub equality_values: &'a [f64],
    pub inequalities: &'a Sparse,
    pub inequality_values: &'a [f64],
    pub deadline: Deadline,
}

/// Minimiser and multipliers: `P d + g + Aᵀ λ − Bᵀ ν = 0`, `ν ≥ 0`.
#[derive(Clone, Debug)]
pub struct QpSolution {
    pub step: Vec<f64>,
    pub equalities: Vec<f64>,
    pub inequalities: Vec<f64>,
    pub iterations: usize,
}

/// Why there is no solution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum QpFailure {
    /// The constraints contradict each other.
    Infeasible,
    /// Clarabel gave up; the data may be badly scaled, indefinite or not finite, or the deadline has passed.
    Numerical,
}

impl QuadraticProgramme<'_> {
    /// Solves by an interior-point method, one thread.
    pub fn solve(&self) -> Result<QpSolution, QpFailure> {
        // Clarabel factorises before it looks at the clock.
        if self.deadline.passed() {
            return Err(QpFailure::Numerical);
        }
        let n = self.hessian.columns;
        let (me, mi) = (self.equalities.rows, self.inequalities.rows);
        // Stack [A; −B], column by column.
        let mut column_start = Vec::with_capacity(n + 1);
        let mut row_index = Vec::new();
        let mut values = Vec::new();
        column_start.push(0);
        for column in 0..n {
            for slot in self.equalities.column_start[column]..self.equalities.column_start[column + 1] {
                row_index.push(self.equalities.row_index[slot] as usize);
                values.push(self.equalities.values[slot]);
            }
            for slot in self.inequalities.column_start[column]..self.inequalities.column_start[column + 1] {
                row_index.push(me + self.inequalities.row_index[slot] as usize);
                values.push(-self.inequalities.values[slot]);
            }
            column_start.push(row_index.len());
        }
        let constraints = CscMatrix::new(me + mi, n, column_start, row_index, values);
        let right: Vec<f64> =
            self.equality_values.iter().map(|c| -c).chain(self.inequality_values.iter().copied()).collect();
        let hessian = CscMatrix::new(
            n,
            n,
            self.hessian.column_start.to_vec(),
            self.hessian.row_index.iter().map(|&row| row as usize).collect(),
            self.hessian.values.clone(),
        );
        let cones = [ZeroConeT(me), NonnegativeConeT(mi)];
        let settings = DefaultSettings {
            verbose: false,
            max_threads: 1,
            time_limit: self.deadline.left_s(),
            presolve_enable: false,
            max_iter: 60,
            tol_gap_abs: 1e-10,
            tol_gap_rel: 1e-10,
            tol_feas: 1e-10,
            ..DefaultSettings::default()
        };
        let mut solver = DefaultSolver::new(&hessian, self.gradient, &constraints, &right, &cones, settings)
            .map_err(|_| QpFailure::Numerical)?;
        solver.solve();
        let solution = &solver.solution;
        match solution.status {
            SolverStatus::Solved | SolverStatus::AlmostSolved if solution.x.iter().all(|x| x.is_finite()) => {
                Ok(QpSolution {
                    step: solution.x.clone(),
                    equalities: solution.z[..me].to_vec(),
                    inequalities: solution.z[me..].to_vec(),
                    iterations: solution.iterations as usize,
                })
            }
            SolverStatus::PrimalInfeasible | SolverStatus::AlmostPrimalInfeasible => Err(QpFailure::Infeasible),
            _ => Err(QpFailure::Numerical),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signs_of_step_and_multipliers_are_those_of_the_module() {
        // min ½(x² + y²) − 2x − y  s.t. x − y = 0.5, x ≤ 1, y ≥ −9: x = 1, y = 0.5.
        let hessian = Sparse::from_triplets(2, 2, &[(0, 0, 1.0), (1, 1, 1.0)]);
        let equalities = Sparse::from_triplets(1, 2, &[(0, 0, 1.0), (0, 1, -1.0)]);
        let inequalities = Sparse::from_triplets(2, 2, &[(0, 0, -1.0), (1, 1, 1.0)]);
        let programme = QuadraticProgramme {
            hessian: &hessian,
            gradient: &[-2.0, -1.0],
            equalities: &equalities,
            equality_values: &[-0.5],
            inequalities: &inequalities,
            inequality_values: &[1.0, 9.0],
            deadline: Deadline::default(),
        };
        let solution = programme.solve().unwrap();
        assert!((solution.step[0] - 1.0).abs() < 1e-7 && (solution.step[1] - 0.5).abs() < 1e-7);
        // y: 0.5 − 1 − λ = 0; x: 1 − 2 + λ + ν = 0.
        assert!((solution.equalities[0] + 0.5).abs() < 1e-6);
        assert!((solution.inequalities[0] - 1.5).abs() < 1e-6 && solution.inequalities[1].abs() < 1e-6);
        let contradiction = QuadraticProgramme { equality_values: &[-20.0], ..programme };
        assert_eq!(contradiction.solve().unwrap_err(), QpFailure::Infeasible);
    }
}
