//! The assembled problem: instants at collocation points, tied to one decision vector by affine maps.
//!
//! Each scheme says how the variables z of each point depend on the decision vector x: `z_j = B_j x + b_j`, with B_j sparse
//! and constant and b_j the given functions of time ([`LocalMap`]). Everything else follows:
//!
//! ```text
//! ∂c/∂x = [ linear rows ; G_1 B_1 ; … ; G_p B_p ]           G_j = ∂(equations)/∂z at point j
//! ∇²L   = ∇²f + Σ_j B_jᵀ W_j B_j                             W_j = Hessian of λ_jᵀ equations − ν_jᵀ functions of limits
//! ```
//!
//! Patterns and the place of each product in them are worked out once.

use std::ops::Range;
use std::sync::Arc;

use super::objective::Objective;
use super::places::{Bound, Point, Scatter, Stages, add, equalities, hessian, inequalities, stages, units};
use super::scheme::{Combination, Discretisation, LocalMap, evaluate};
use crate::nlp::problem::{ConvexTerm, Curvature, Multipliers, Problem};
use crate::numerics::larger;
use crate::numerics::sparse::Sparse;
use crate::problem::{Bounded, ControlProblem, Goal, Limit};

/// A transcribed problem. See the module.
pub struct Collocation<'p> {
    pub control: &'p ControlProblem<'p>,
    pub scheme: &'p dyn Discretisation,
    pub points: Vec<Point>,
    pub bounds: Vec<Bound>,
    pub objective: Objective,
    /// Linear equalities `Σ weight · x = constant`, before those of the points.
    pub linear: Vec<Combination>,
    linear_constants: Vec<f64>,
    /// The maps of all points one after the other: a column each variable.
    maps: Sparse,
    /// First equality and first inequality of each point, and the numbers of both.
    row_starts: Vec<usize>,
    bound_starts: Vec<usize>,
    stages: Stages,
    equality_pattern: Sparse,
    inequality_pattern: Sparse,
    hessian_pattern: Sparse,
    gram: Vec<f64>,
    term_scatter: Scatter,
    jacobian_scatter: Vec<Scatter>,
    /// Of the functions of limits.
    function_scatter: Vec<Scatter>,
    hessian_scatter: Vec<Scatter>,
    /// Of each variable with itself: (variable, slot, factor).
    metric_scatter: Vec<Scatter>,
    /// Factor of each unknown's unit: X = unit · x.
    pub units: Vec<f64>,
}

impl<'p> Collocation<'p> {
    pub fn new(control: &'p ControlProblem<'p>, scheme: &'p dyn Discretisation, goals: &[Goal]) -> Self {
        let (points, linear) = (points(control, scheme), scheme.linear());
        let n = scheme.coefficients().total();
        let objective = Objective::new(scheme, goals);
        let holds = |point: &Point, limit: &Limit| match limit.bounded {
            Bounded::Below(variable) | Bounded::Above(variable) => {
                point.complete || control.is_known_at_start(variable)
            }
            Bounded::Function(_) => point.complete,
        };
        let (mut row_starts, mut bound_starts, mut bounds) = (vec![linear.len()], vec![0], Vec::new());
        for (j, point) in points.iter().enumerate() {
            let all = control.limits.iter().enumerate().filter(|(_, limit)| holds(point, limit));
            bounds.extend(all.map(|(limit, _)| Bound { limit, point: j }));
            bound_starts.push(bounds.len());
            row_starts.push(row_starts[j] + point.rows.len());
        }
        let equalities = equalities(control, &points, &linear, &row_starts, n);
        let inequalities = inequalities(control, &points, &bounds, n);
        let hessian = hessian(control, &points, &objective);
        let maps = points.iter().flat_map(|point| &point.map.combinations).enumerate();
        let triplets: Vec<(usize, usize, f64)> =
            maps.flat_map(|(k, terms)| terms.iter().map(move |&(index, weight)| (index, k, weight))).collect();
        Self {
            maps: Sparse::from_triplets(n, control.variables() * points.len(), &triplets),
            stages: stages(&points, &linear, &bounds, n),
            units: units(control, &points, n),
            control,
            scheme,
            points,
            bounds,
            objective,
            linear,
            linear_constants: scheme.linear_constants(),
            row_starts,
            bound_starts,
            equality_pattern: equalities.0,
            jacobian_scatter: equalities.1,
            inequality_pattern: inequalities.0,
            function_scatter: inequalities.1,
            hessian_pattern: hessian.pattern,
            gram: hessian.gram,
            term_scatter: hessian.term,
            hessian_scatter: hessian.scatter,
            metric_scatter: hessian.metric,
        }
    }

    /// What each equality is: (point, equation), or (none, number of the linear row).
    pub fn equality_names(&self) -> Vec<(Option<usize>, usize)> {
        let linear = (0..self.linear.len()).map(|row| (None, row));
        let points = self.points.iter().enumerate();
        linear.chain(points.flat_map(|(j, point)| point.rows.iter().map(move |&row| (Some(j), row)))).collect()
    }

    /// The limit that an inequality imposes.
    pub fn limit(&self, bound: &Bound) -> &Limit {
        &self.control.limits[bound.limit]
    }

    /// Variables z of a point.
    pub fn local(&self, point: usize, x: &[f64]) -> Vec<f64> {
        let mut z = self.local_change(point, x);
        z.iter_mut().zip(&self.points[point].map.constants).for_each(|(z, b)| *z += b);
        z
    }

    /// How the variables z of a point change along a direction of x.
    pub fn local_change(&self, point: usize, direction: &[f64]) -> Vec<f64> {
        let nz = self.control.variables();
        let value = |k| self.maps.column(k).map(|(index, weight)| weight * direction[index]).sum();
        (point * nz..(point + 1) * nz).map(value).collect()
    }

    /// The bound's slack; `rows`: values of all rows at the variables z.
    fn slack(&self, bound: &Bound, z: &[f64], rows: &[f64]) -> f64 {
        let limit = self.limit(bound);
        match limit.bounded {
            Bounded::Below(variable) => z[variable] - limit.bound,
            Bounded::Above(variable) => limit.bound - z[variable],
            Bounded::Function(row) => rows[row] - limit.bound,
        }
    }

    fn bounds_of(&self, point: usize) -> Range<usize> {
        self.bound_starts[point]..self.bound_starts[point + 1]
    }
}

/// The collocation points: at each all equations, or those among values of states only.
fn points(control: &ControlProblem<'_>, scheme: &dyn Discretisation) -> Vec<Point> {
    let all: Arc<[usize]> = (0..control.equation_rows()).collect();
    let constraints: Arc<[usize]> = control.state_constraints().into();
    let point = |j: usize| {
        let complete = scheme.is_complete(j);
        let rows = if complete { all.clone() } else { constraints.clone() };
        Point { map: LocalMap::new(control, scheme, scheme.point(j)), rows, complete, stage: scheme.stage(j) }
    };
    (0..scheme.points().len()).map(point).collect()
}

impl Problem for Collocation<'_> {
    fn variables(&self) -> usize {
        self.units.len()
    }

    fn equalities(&self) -> usize {
        self.equality_pattern.rows
    }

    fn inequalities(&self) -> usize {
        self.bounds.len()
    }

    fn stages(&self) -> &[usize] {
        &self.stages.variables
    }

    fn constraint_stages(&self) -> [&[usize]; 2] {
        [&self.stages.equalities, &self.stages.inequalities]
    }

    fn residual_jacobian(&self) -> &Sparse {
        &self.objective.residual_jacobian
    }

    fn residual_data(&self) -> &[f64] {
        &self.objective.residual_data
    }

    fn term(&self) -> Option<&dyn ConvexTerm> {
        self.objective.term.as_ref().map(|term| term as &dyn ConvexTerm)
    }

    fn constraints(&self, x: &[f64], equalities: &mut [f64], inequalities: &mut [f64]) {
        for (row, (combination, constant)) in self.linear.iter().zip(&self.linear_constants).enumerate() {
            equalities[row] = evaluate(combination, x) - constant;
        }
        let mut residual = vec![0.0; self.control.rows()];
        for (j, Point { rows, .. }) in self.points.iter().enumerate() {
            let z = self.local(j, x);
            self.control.values(&z, &mut residual);
            rows.iter().enumerate().for_each(|(k, &row)| equalities[self.row_starts[j] + k] = residual[row]);
            self.bounds_of(j).for_each(|row| inequalities[row] = self.slack(&self.bounds[row], &z, &residual));
        }
    }

    /// Feasibility of the unscaled problem (the contract's): the largest of |eq. (1)| over total weight, |eq. (3)| as
    /// printed in normalised force, |Φ| in m or rad, |eq. (4)|·τ, bound violation, linear rows, and, in the stabilised form, the
    /// kinematic and velocity equations in m/s and rad/s.
    fn feasibility(&self, x: &[f64]) -> f64 {
        let linear = self.linear.iter().zip(&self.linear_constants);
        let mut worst: f64 = linear.map(|(row, constant)| (evaluate(row, x) - constant).abs()).fold(0.0, larger);
        let mut residual = vec![0.0; self.control.rows()];
        for (j, Point { rows, .. }) in self.points.iter().enumerate() {
            let z = self.local(j, x);
            self.control.printed_values(&z, &mut residual);
            worst = rows.iter().map(|&row| residual[row].abs()).fold(worst, larger);
            let slacks = self.bounds[self.bounds_of(j)].iter().map(|bound| -self.slack(bound, &z, &residual));
            worst = slacks.fold(worst, larger);
        }
        worst
    }

    fn patterns(&self) -> [&Sparse; 3] {
        [&self.equality_pattern, &self.inequality_pattern, &self.hessian_pattern]
    }

    fn jacobians(&self, x: &[f64], equalities: &mut Sparse, inequalities: &mut Sparse) {
        equalities.values.clone_from(&self.equality_pattern.values);
        inequalities.values.clone_from(&self.inequality_pattern.values);
        let mut local = vec![0.0; self.control.slope_pattern().len()];
        for j in 0..self.points.len() {
            self.control.slopes(&self.local(j, x), &mut local);
            add(&self.jacobian_scatter[j], &local, &mut equalities.values);
            add(&self.function_scatter[j], &local, &mut inequalities.values);
        }
    }

    fn hessian(&self, x: &[f64], multipliers: Multipliers<'_>, curvature: Curvature, out: &mut Sparse) {
        out.values.copy_from_slice(&self.gram);
        if let Some(term) = &self.objective.term {
            let curvatures: Vec<f64> = term.parts(x).iter().map(|part| part[2]).collect();
            add(&self.term_scatter, &curvatures, &mut out.values);
        }
        let mut local = vec![0.0; self.control.bend_pattern().len()];
        let mut factors = vec![0.0; self.control.rows()];
        for (j, Point { rows, .. }) in self.points.iter().enumerate() {
            factors.fill(0.0);
            let start = self.row_starts[j];
            rows.iter().enumerate().for_each(|(k, &row)| factors[row] = multipliers.equalities[start + k]);
            for row in self.bounds_of(j) {
                if let Bounded::Function(function) = self.limit(&self.bounds[row]).bounded {
                    factors[function] = -multipliers.inequalities[row];
                }
            }
            self.control.bends(&self.local(j, x), &factors, &mut local);
            if curvature == Curvature::Convex {
                self.control.convexify(&mut local);
            }
            add(&self.hessian_scatter[j], &local, &mut out.values);
        }
    }

    /// The weights that blocks give to steps in their variables: 1 for q (m, rad); for the muscles' w = 2.5 μ², as the
    /// objective does: w for activation, 10 w for fibre length, w/10 for excitation; see
    /// [`weigh`](crate::problem::block::Block::weigh).
    fn metric(&self, x: &[f64], out: &mut Sparse) {
        out.values.fill(0.0);
        let mut weights = vec![0.0; self.control.variables()];
        for j in 0..self.points.len() {
            self.control.weigh(&self.local(j, x), &mut weights);
            add(&self.metric_scatter[j], &weights, &mut out.values);
        }
    }
}
