//! The assembled problem: instants at collocation points, tied to one decision vector by linear maps.
//!
//! Each scheme says how the local variables z of each point depend on the decision vector x: `z_j = B_j x`, with B_j sparse
//! and constant ([`Layout`]). Everything else follows:
//!
//! ```text
//! ∂c/∂x = [ linear rows ; G_1 B_1 ; … ; G_p B_p ]           G_j = ∂(equations)/∂z at point j
//! ∇²L   = JᵀJ + Σ_j B_jᵀ W_j B_j                             W_j = Hessian of λ_jᵀ equations − ν_jᵀ f_m
//! ```
//!
//! Patterns and the place of each product in them are worked out once.

use super::instant::{ACTIVATION, EXCITATION, Instant, InstantMultipliers, LENGTH, VELOCITY};
use crate::nlp::problem::{Curvature, Multipliers, Problem};
use crate::numerics::larger;
use crate::numerics::sparse::{Pattern, Sparse};

/// Σ weight · x[index]
pub type Combination = Vec<(usize, f64)>;

pub fn evaluate(combination: &Combination, x: &[f64]) -> f64 {
    combination.iter().map(|&(index, weight)| weight * x[index]).sum()
}

/// What a scheme provides.
#[derive(Clone, Debug)]
pub struct Layout {
    /// Collocation points, s.
    pub times: Vec<f64>,
    pub variables: usize,
    pub points: Vec<Point>,
    /// Linear equalities `Σ weight · x = 0`.
    pub linear: Vec<Combination>,
}

/// One collocation point.
#[derive(Clone, Debug)]
pub struct Point {
    /// Each local variable as a combination of x.
    pub map: Vec<Combination>,
    /// Which equations of [`Instant`] hold here.
    pub rows: Vec<usize>,
    /// Whether every local variable has a value here, or only q, v, a and l.
    pub complete: bool,
}

/// One inequality at one point; all are `≥ 0`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum BoundKind {
    /// a ≥ 0
    Activation,
    /// u ≥ 0
    Excitation,
    /// 1 − a ≥ 0
    ActivationUpper,
    /// 1 − u ≥ 0
    ExcitationUpper,
    /// f_m ≥ 0: where a ≥ 0 is not imposed, so that no tendon pushes (eq. 11).
    Force,
}

/// Which inequality a row is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bound {
    pub kind: BoundKind,
    pub muscle: usize,
    pub point: usize,
}

/// The rows of a transcribed problem by what they are, so that multipliers find their way to another mesh.
#[derive(Clone, Debug)]
pub struct Rows {
    /// Collocation points, s.
    pub times: Vec<f64>,
    /// (collocation point, equation of [`Instant`]), or (none, number of the linear row).
    pub equalities: Vec<(Option<usize>, usize)>,
    pub inequalities: Vec<Bound>,
}

/// (local entry, slot in the sparse values, factor)
type Scatter = Vec<(u32, u32, f64)>;

/// A transcribed problem. See the module.
#[derive(Clone, Debug)]
pub struct Collocation<'m> {
    pub instant: Instant<'m>,
    pub layout: Layout,
    pub bounds: Vec<Bound>,
    /// The maps of all points one after the other: a column each local variable.
    maps: Sparse,
    /// First equality and first inequality of each point, and the numbers of both.
    row_starts: Vec<usize>,
    bound_starts: Vec<usize>,
    /// The stage of each variable, equality and inequality: 0 for initial values, then the points.
    stages: Vec<usize>,
    equality_stages: Vec<usize>,
    inequality_stages: Vec<usize>,
    residual_jacobian: Sparse,
    residual_data: Vec<f64>,
    equality_pattern: Sparse,
    inequality_pattern: Sparse,
    hessian_pattern: Sparse,
    gram: Vec<f64>,
    jacobian_scatter: Vec<Scatter>,
    hessian_scatter: Vec<Scatter>,
    /// Of each local variable with itself: (local variable, slot, factor).
    metric_scatter: Vec<Scatter>,
    /// Slots of the force rows: point by point, muscle by muscle, (entry 0–2, slot, factor).
    force_scatter: Vec<Scatter>,
    /// Weight of a step in activation beside one in q, see [`Problem::metric`].
    activation_weight: f64,
    /// Factor of each variable's unit: X = unit · x. The weight W for reactions, else 1.
    pub units: Vec<f64>,
}

impl<'m> Collocation<'m> {
    /// `residual_rows`, `residual_data`: J and b of the objective. `kinds`: the inequalities imposed at every point.
    pub fn new(
        instant: Instant<'m>,
        layout: Layout,
        residual_rows: &[Combination],
        residual_data: Vec<f64>,
        kinds: &[BoundKind],
        activation_weight: f64,
    ) -> Self {
        let n = layout.variables;
        let triplets: Vec<(usize, usize, f64)> = residual_rows
            .iter()
            .enumerate()
            .flat_map(|(row, combination)| combination.iter().map(move |&(column, weight)| (row, column, weight)))
            .collect();
        let residual_jacobian = Sparse::from_triplets(residual_rows.len(), n, &triplets);

        let nz = instant.variables();
        let combinations = layout.points.iter().flat_map(|point| &point.map).enumerate();
        let triplets: Vec<(usize, usize, f64)> =
            combinations.flat_map(|(k, terms)| terms.iter().map(move |&(index, weight)| (index, k, weight))).collect();
        let maps = Sparse::from_triplets(n, nz * layout.points.len(), &triplets);
        let mut row_starts = vec![layout.linear.len()];
        for point in &layout.points {
            row_starts.push(row_starts[row_starts.len() - 1] + point.rows.len());
        }
        // Entries of a point's Jacobian: (row of the whole, local row, local variable).
        let local_jacobian = instant.jacobian_pattern();
        let entries = |j: usize| {
            let (start, point) = (row_starts[j], &layout.points[j]);
            let place = |row: usize| point.rows.iter().position(|&r| r == row).map(|k| start + k);
            let places: Vec<Option<usize>> = (0..instant.equations()).map(place).collect();
            local_jacobian.iter().filter_map(move |&(row, local)| Some((places[row]?, row, local)))
        };
        let mut equalities = Pattern::new(row_starts[layout.points.len()], n);
        for (row, combination) in layout.linear.iter().enumerate() {
            combination.iter().for_each(|&(column, _)| equalities.add(row, column));
        }
        for (j, point) in layout.points.iter().enumerate() {
            for (row, _, local) in entries(j) {
                point.map[local].iter().for_each(|&(column, _)| equalities.add(row, column));
            }
        }
        let mut equality_pattern = equalities.build();
        for (row, combination) in layout.linear.iter().enumerate() {
            for &(column, weight) in combination {
                equality_pattern.values[equalities.slot(row, column)] += weight;
            }
        }
        let jacobian_scatter = layout
            .points
            .iter()
            .enumerate()
            .map(|(j, point)| {
                let entry = |(place, row, local): (usize, usize, usize)| {
                    let equalities = &equalities;
                    point.map[local].iter().map(move |&(column, weight)| {
                        ((row * nz + local) as u32, equalities.slot(place, column) as u32, weight)
                    })
                };
                entries(j).flat_map(entry).collect()
            })
            .collect();

        let mut bounds = Vec::new();
        let mut bound_starts = vec![0];
        for (point, Point { complete, .. }) in layout.points.iter().enumerate() {
            for &kind in kinds {
                if *complete || matches!(kind, BoundKind::Activation | BoundKind::ActivationUpper) {
                    bounds.extend((0..instant.model.muscles.len()).map(|muscle| Bound { kind, muscle, point }));
                }
            }
            bound_starts.push(bounds.len());
        }
        let mut inequalities = Pattern::new(bounds.len(), n);
        let locals = |bound: &Bound| {
            let at = instant.muscle(bound.muscle);
            match bound.kind {
                BoundKind::Activation | BoundKind::ActivationUpper => vec![at + ACTIVATION],
                BoundKind::Excitation | BoundKind::ExcitationUpper => vec![at + EXCITATION],
                BoundKind::Force => vec![at + ACTIVATION, at + LENGTH, at + VELOCITY],
            }
        };
        for (row, bound) in bounds.iter().enumerate() {
            for local in locals(bound) {
                layout.points[bound.point].map[local].iter().for_each(|&(column, _)| inequalities.add(row, column));
            }
        }
        let mut inequality_pattern = inequalities.build();
        let mut force_scatter = vec![Scatter::new(); layout.points.len()];
        for (row, bound) in bounds.iter().enumerate() {
            let sign = match bound.kind {
                BoundKind::Activation | BoundKind::Excitation => 1.0,
                BoundKind::ActivationUpper | BoundKind::ExcitationUpper => -1.0,
                BoundKind::Force => {
                    for (k, local) in locals(bound).into_iter().enumerate() {
                        for &(column, weight) in &layout.points[bound.point].map[local] {
                            let slot = inequalities.slot(row, column) as u32;
                            force_scatter[bound.point].push(((3 * bound.muscle + k) as u32, slot, weight));
                        }
                    }
                    continue;
                }
            };
            for &(column, weight) in &layout.points[bound.point].map[locals(bound)[0]] {
                inequality_pattern.values[inequalities.slot(row, column)] += sign * weight;
            }
        }

        let gram_matrix = residual_jacobian.gram();
        let local_hessian = instant.hessian_pattern();
        let mut hessian = Pattern::new(n, n);
        gram_matrix.entries().for_each(|(row, column, _)| hessian.add(row, column));
        (0..n).for_each(|i| hessian.add(i, i));
        for Point { map, .. } in &layout.points {
            for &(i, j) in &local_hessian {
                for &(row, _) in &map[i] {
                    map[j].iter().filter(|&&(column, _)| row <= column).for_each(|&(c, _)| hessian.add(row, c));
                }
            }
        }
        let hessian_pattern = hessian.build();
        let mut gram = vec![0.0; hessian_pattern.values.len()];
        for (row, column, slot) in gram_matrix.entries() {
            gram[hessian.slot(row, column)] = gram_matrix.values[slot];
        }
        let hessian_scatter: Vec<Scatter> = layout
            .points
            .iter()
            .map(|Point { map, .. }| {
                let mut scatter = Scatter::new();
                for &(i, j) in &local_hessian {
                    for &(row, weight) in &map[i] {
                        for &(column, other) in map[j].iter().filter(|&&(column, _)| row <= column) {
                            let slot = hessian.slot(row, column) as u32;
                            scatter.push(((i * nz + j) as u32, slot, weight * other));
                        }
                    }
                }
                scatter
            })
            .collect();

        let with_itself = |&(entry, slot, weight): &(u32, u32, f64)| {
            let (i, j) = (entry / nz as u32, entry % nz as u32);
            (i == j).then_some((i, slot, weight))
        };
        let metric_scatter =
            hessian_scatter.iter().map(|scatter| scatter.iter().filter_map(with_itself).collect()).collect();

        // Each variable belongs to the first point that has it, where the equations say what it is.
        let mut stages = vec![0; n];
        for (k, point) in layout.points.iter().enumerate().rev() {
            point.map.iter().flatten().for_each(|&(i, _)| stages[i] = 1 + k);
        }
        let first = |row: &Combination| row.iter().map(|&(i, _)| stages[i]).min().unwrap_or(0);
        let mut equality_stages: Vec<usize> = layout.linear.iter().map(first).collect();
        for (k, point) in layout.points.iter().enumerate() {
            equality_stages.extend(std::iter::repeat_n(1 + k, point.rows.len()));
        }
        let inequality_stages = bounds.iter().map(|bound| 1 + bound.point).collect();

        let mut units = vec![1.0; n];
        let weight = instant.model.weight();
        for Point { map, .. } in &layout.points {
            for c in 0..instant.model.constraints() {
                map[instant.reaction(c)].iter().for_each(|&(index, _)| units[index] = weight);
            }
        }
        Self {
            instant,
            layout,
            bounds,
            maps,
            row_starts,
            bound_starts,
            stages,
            equality_stages,
            inequality_stages,
            residual_jacobian,
            residual_data,
            equality_pattern,
            inequality_pattern,
            hessian_pattern,
            gram,
            jacobian_scatter,
            hessian_scatter,
            metric_scatter,
            force_scatter,
            activation_weight,
            units,
        }
    }

    /// What each equality and inequality is: see [`Rows`].
    pub fn rows(&self) -> Rows {
        let linear = (0..self.layout.linear.len()).map(|row| (None, row));
        let points = self.layout.points.iter().enumerate();
        let equations = points.flat_map(|(j, point)| point.rows.iter().map(move |&row| (Some(j), row)));
        Rows {
            times: self.layout.times.clone(),
            equalities: linear.chain(equations).collect(),
            inequalities: self.bounds.clone(),
        }
    }

    /// Local variables z of a point.
    pub fn local(&self, point: usize, x: &[f64]) -> Vec<f64> {
        let nz = self.instant.variables();
        let value = |k| self.maps.column(k).map(|(index, weight)| weight * x[index]).sum();
        (point * nz..(point + 1) * nz).map(value).collect()
    }

    /// The bound's slack at x.
    fn slack(&self, bound: &Bound, z: &[f64]) -> f64 {
        let at = self.instant.muscle(bound.muscle);
        match bound.kind {
            BoundKind::Activation => z[at + ACTIVATION],
            BoundKind::Excitation => z[at + EXCITATION],
            BoundKind::ActivationUpper => 1.0 - z[at + ACTIVATION],
            BoundKind::ExcitationUpper => 1.0 - z[at + EXCITATION],
            BoundKind::Force => self.instant.fibre_force(z, bound.muscle),
        }
    }
}

impl Problem for Collocation<'_> {
    fn variables(&self) -> usize {
        self.layout.variables
    }

    fn equalities(&self) -> usize {
        self.equality_pattern.rows
    }

    fn inequalities(&self) -> usize {
        self.bounds.len()
    }

    fn stages(&self) -> &[usize] {
        &self.stages
    }

    fn constraint_stages(&self) -> [&[usize]; 2] {
        [&self.equality_stages, &self.inequality_stages]
    }

    fn residual_jacobian(&self) -> &Sparse {
        &self.residual_jacobian
    }

    fn residual_data(&self) -> &[f64] {
        &self.residual_data
    }

    fn constraints(&self, x: &[f64], equalities: &mut [f64], inequalities: &mut [f64]) {
        for (row, combination) in self.layout.linear.iter().enumerate() {
            equalities[row] = evaluate(combination, x);
        }
        let mut residual = vec![0.0; self.instant.equations()];
        for (point, Point { rows, .. }) in self.layout.points.iter().enumerate() {
            let z = self.local(point, x);
            self.instant.residual(self.layout.times[point], &z, &mut residual);
            rows.iter().enumerate().for_each(|(k, &row)| equalities[self.row_starts[point] + k] = residual[row]);
            for row in self.bound_starts[point]..self.bound_starts[point + 1] {
                inequalities[row] = self.slack(&self.bounds[row], &z);
            }
        }
    }

    /// Feasibility of the unscaled problem (the contract's): the largest of |eq. (1)| over total weight, |eq. (3)| as
    /// printed in normalised force, |Φ| in m or rad, |eq. (4)|·τ, bound violation, linear rows, and, in the stabilised form, the
    /// kinematic and velocity equations in m/s and rad/s.
    fn feasibility(&self, x: &[f64]) -> f64 {
        let mut worst: f64 = self.layout.linear.iter().map(|row| evaluate(row, x).abs()).fold(0.0, larger);
        let mut residual = vec![0.0; self.instant.equations()];
        let [_, contraction, activation] = self.instant.row_starts();
        for (point, Point { rows, .. }) in self.layout.points.iter().enumerate() {
            let z = self.local(point, x);
            self.instant.residual(self.layout.times[point], &z, &mut residual);
            for m in 0..activation - contraction {
                residual[contraction + m] = self.instant.printed_contraction_residual(self.layout.times[point], &z, m);
            }
            worst = rows.iter().map(|&row| residual[row].abs()).fold(worst, larger);
            for bound in &self.bounds[self.bound_starts[point]..self.bound_starts[point + 1]] {
                worst = larger(worst, -self.slack(bound, &z));
            }
        }
        worst
    }

    fn patterns(&self) -> [&Sparse; 3] {
        [&self.equality_pattern, &self.inequality_pattern, &self.hessian_pattern]
    }

    fn jacobians(&self, x: &[f64], equalities: &mut Sparse, inequalities: &mut Sparse) {
        let (nz, rows) = (self.instant.variables(), self.instant.equations());
        equalities.values.clone_from(&self.equality_pattern.values);
        inequalities.values.clone_from(&self.inequality_pattern.values);
        let mut local = vec![0.0; rows * nz];
        let mut force = vec![[0.0; 3]; self.instant.model.muscles.len()];
        for point in 0..self.layout.points.len() {
            self.instant.jacobian(self.layout.times[point], &self.local(point, x), &mut local, &mut force);
            for &(entry, slot, weight) in &self.jacobian_scatter[point] {
                equalities.values[slot as usize] += weight * local[entry as usize];
            }
            for &(entry, slot, weight) in &self.force_scatter[point] {
                inequalities.values[slot as usize] += weight * force[entry as usize / 3][entry as usize % 3];
            }
        }
    }

    fn hessian(&self, x: &[f64], multipliers: Multipliers<'_>, curvature: Curvature, out: &mut Sparse) {
        let nz = self.instant.variables();
        let mut equations = vec![0.0; self.instant.equations()];
        out.values.copy_from_slice(&self.gram);
        let mut local = vec![0.0; nz * nz];
        let mut force = vec![0.0; self.instant.model.muscles.len()];
        for (point, Point { rows, .. }) in self.layout.points.iter().enumerate() {
            force.fill(0.0);
            for row in self.bound_starts[point]..self.bound_starts[point + 1] {
                if self.bounds[row].kind == BoundKind::Force {
                    force[self.bounds[row].muscle] = multipliers.inequalities[row];
                }
            }
            equations.fill(0.0);
            let start = self.row_starts[point];
            rows.iter().enumerate().for_each(|(k, &row)| equations[row] = multipliers.equalities[start + k]);
            let z = self.local(point, x);
            let multipliers = InstantMultipliers { equations: &equations, force: &force };
            self.instant.hessian(self.layout.times[point], &z, multipliers, &mut local);
            if curvature == Curvature::Convex {
                self.instant.convexify(&mut local);
            }
            for &(entry, slot, weight) in &self.hessian_scatter[point] {
                out.values[slot as usize] += weight * local[entry as usize];
            }
        }
    }

    /// Weights of the local variables: 1 for q (m, rad); for the muscles' w = 2.5 μ², as the objective does: w for
    /// activation, 10 w for fibre length, w/10 for excitation; a fibre velocity is measured against `b3 v_max + |v|`, the scale
    /// on which the force–velocity curve bends.
    fn metric(&self, x: &[f64], out: &mut Sparse) {
        out.values.fill(0.0);
        let mut local = vec![0.0; self.instant.variables()];
        local[..self.instant.model.coordinates()].fill(1.0);
        for point in 0..self.layout.points.len() {
            let z = self.local(point, x);
            for (m, muscle) in self.instant.model.muscles.iter().enumerate() {
                let at = self.instant.muscle(m);
                let bend = muscle.force_velocity.shortening * muscle.max_shortening_velocity;
                let velocity = 1.0 / (bend + z[at + VELOCITY].abs());
                let w = self.activation_weight;
                let weights =
                    [(ACTIVATION, w), (LENGTH, 10.0 * w), (VELOCITY, w * velocity * velocity), (EXCITATION, 0.1 * w)];
                for (k, weight) in weights {
                    local[at + k] = weight;
                }
            }
            for &(entry, slot, weight) in &self.metric_scatter[point] {
                out.values[slot as usize] += weight * local[entry as usize];
            }
        }
    }
}
