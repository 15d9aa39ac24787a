//! Estimates the discretisation error of the effort and the muscle forces by defect correction, without a second
//! optimisation.
//!
//! The Lagrangian of the transcribed problem sums λᵀ r over the collocation points, where the equations r = 0 hold.
//! That of the continuous problem integrates it:
//!
//! ```text
//! L_h = f + Σ_j λ_jᵀ r(t_j)          L = f + ∫ λ(t)ᵀ r(t) dt
//! ```
//!
//! Here λ(t) is, in each interval, the polynomial with λ(t_j) = λ_j/w_j, where w_j are the quadrature weights.
//!
//! At the solution (x, λ) of the transcribed problem, the gradient of L is the defect d. A Newton step with the KKT
//! matrix K of the transcribed problem at fixed active set, K δ = −d, removes it. A second step with the same factors,
//! from (x, λ) + δ, corrects for most of the nonlinearity. The estimate does not include changes of the active set,
//! nor error components that polynomials on this mesh cannot represent.
//!
//! The integral is approximated by the Radau rule with s stages on both halves of each interval. The error of this
//! rule is 2^(1 − 2s) times the error sought, for which a factor corrects. (Exact integration would include the left
//! ends of the intervals, where a coarse solution is least accurate.)
//!
//! Source: H. J. Stetter, *Numer. Math.* 29, 1978 (the defect correction principle).

use crate::nlp::iterate::Iterate;
use crate::solution::Solution;
use crate::transcription::radau::{lagrange, tableau};
use crate::transcription::scheme::LocalMap;
use crate::uniqueness::Linearised;

/// Estimated errors: computed minus exact values.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshError {
    /// Of ∫Σa² dt, s.
    pub effort: f64,
    /// Of each muscle's mean force, N.
    pub mean_force_n: Vec<f64>,
}

/// The estimate for a solution by Radau collocation. `None` if the KKT system does not determine it.
pub fn estimate(solution: &Solution<'_>, linearised: &mut Linearised<'_>) -> Option<MeshError> {
    let found = solution.iterate;
    let (gradient, equalities) = defect(solution, found);
    let (first, multipliers) = linearised.follow(&gradient, &equalities)?;
    let mut next = Iterate::new(solution.problem, added(&found.x, &first));
    next.equality_multipliers = added(&found.equality_multipliers, &multipliers);
    next.inequality_multipliers.clone_from(&found.inequality_multipliers);
    let (gradient, equalities) = defect(solution, &next);
    let gradient = added(&gradient, &next.lagrangian_gradient());
    let (second, _) = linearised.follow(&gradient, &added(&equalities, &next.equalities))?;
    let step = added(&first, &second);
    let scheme = solution.problem.scheme;
    let stages = (scheme.points().len() - 1) / (scheme.breakpoints().len() - 1);
    let factor = -1.0 / (1.0 - 0.5f64.powi(2 * stages as i32 - 1));
    let error = MeshError {
        effort: factor * solution.effort_slope(&step),
        mean_force_n: solution.mean_force_slopes(&step).into_iter().map(|change| factor * change).collect(),
    };
    (error.effort.is_finite() && error.mean_force_n.iter().all(|error| error.is_finite())).then_some(error)
}

fn added(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a + b).collect()
}

/// The defect: ∂L/∂x − ∂L_h/∂x, and ∂L/∂λ − ∂L_h/∂λ by equality row.
fn defect(solution: &Solution<'_>, iterate: &Iterate) -> (Vec<f64>, Vec<f64>) {
    let (problem, scheme) = (solution.problem, solution.problem.scheme);
    let (control, points) = (problem.control, scheme.points());
    let equations = control.equation_rows();
    let mut gradient = vec![0.0; iterate.x.len()];
    let mut equalities = vec![0.0; iterate.equalities.len()];
    let mut first_row = vec![usize::MAX; points.len()];
    for (row, (point, equation)) in problem.equality_names().into_iter().enumerate() {
        if let (Some(j), 0) = (point, equation) {
            first_row[j] = row;
        }
    }
    let mut slopes = vec![0.0; control.slope_pattern().len()];
    let mut residual = vec![0.0; control.rows()];
    // Adds `factor` times λᵀ ∂r/∂x at time t to the gradient, and stores r(t) in `residual`.
    let mut add = |t: f64, factor: f64, lambda: &[f64], residual: &mut [f64]| {
        let map = LocalMap::new(control, scheme, scheme.place(t));
        let z = map.apply(&iterate.x);
        control.values(&z, residual);
        control.slopes(&z, &mut slopes);
        let mut derivatives = vec![0.0; control.variables()];
        for (&(row, variable), slope) in
            control.slope_pattern().iter().zip(&slopes).filter(|((row, _), _)| *row < equations)
        {
            derivatives[variable] += lambda[row] * slope;
        }
        for (derivative, combination) in derivatives.iter().zip(&map.combinations) {
            combination.iter().for_each(|&(i, w)| gradient[i] += factor * derivative * w);
        }
    };
    for ends in scheme.breakpoints().windows(2) {
        let h = ends[1] - ends[0];
        let own: Vec<usize> =
            (1..points.len()).filter(|&j| points[j] > ends[0] + 1e-9 * h && points[j] <= ends[1] + 1e-9 * h).collect();
        let nodes: Vec<f64> = own.iter().map(|&j| (points[j] - ends[0]) / h).collect();
        let (c, b) = tableau(own.len());
        let weights: Vec<f64> = b.iter().map(|b| b * h).collect();
        let multipliers = |j: usize| &iterate.equality_multipliers[first_row[j]..first_row[j] + equations];
        for &j in &own {
            add(points[j], -1.0, multipliers(j), &mut residual);
            (0..equations).for_each(|row| equalities[first_row[j] + row] -= residual[row]);
        }
        let half = |start: f64| c.iter().zip(&b).map(move |(c, b)| (start + 0.5 * c, 0.5 * b));
        for (x, weight) in half(0.0).chain(half(0.5)) {
            let basis = lagrange(&nodes, x, 0);
            let lambda: Vec<f64> = (0..equations)
                .map(|row| (0..own.len()).map(|n| basis[n] * multipliers(own[n])[row] / weights[n]).sum())
                .collect();
            add(ends[0] + x * h, weight * h, &lambda, &mut residual);
            for (n, &j) in own.iter().enumerate() {
                let share = weight * h * basis[n] / weights[n];
                (0..equations).for_each(|row| equalities[first_row[j] + row] += share * residual[row]);
            }
        }
    }
    (gradient, equalities)
}
