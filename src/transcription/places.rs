//! The points of a transcribed problem, its sparsity patterns, and the place of each derivative in them.

use std::sync::Arc;

use super::objective::Objective;
use super::scheme::{Combination, LocalMap};
use crate::numerics::sparse::{Pattern, Sparse};
use crate::problem::{Bounded, ControlProblem};

/// One collocation point.
#[derive(Clone, Debug)]
pub struct Point {
    pub map: LocalMap,
    /// Which equations hold here.
    pub rows: Arc<[usize]>,
    /// Whether every variable has a value here, or only values of states.
    pub complete: bool,
    /// See [`Discretisation::stage`](super::scheme::Discretisation::stage).
    pub stage: usize,
}

/// Which inequality a row is: a limit of the problem at a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bound {
    pub limit: usize,
    pub point: usize,
}

/// (local entry, slot in the sparse values, factor)
pub type Scatter = Vec<(u32, u32, f64)>;

/// The stage of each unknown, equality and inequality.
pub struct Stages {
    pub variables: Vec<usize>,
    pub equalities: Vec<usize>,
    pub inequalities: Vec<usize>,
}

/// ∂c/∂x with the linear rows filled in, and where the slopes of each point go.
pub fn equalities(
    control: &ControlProblem<'_>,
    points: &[Point],
    linear: &[Combination],
    row_starts: &[usize],
    n: usize,
) -> (Sparse, Vec<Scatter>) {
    // Entries of a point's Jacobian: (row of the whole, local entry, variable).
    let entries = |j: usize| {
        let mut places = vec![None; control.rows()];
        points[j].rows.iter().enumerate().for_each(|(k, &row)| places[row] = Some(row_starts[j] + k));
        let all = control.slope_pattern().iter().enumerate();
        all.filter_map(move |(entry, &(row, variable))| Some((places[row]?, entry, variable)))
    };
    let mut pattern = Pattern::new(row_starts[points.len()], n);
    for (row, combination) in linear.iter().enumerate() {
        combination.iter().for_each(|&(column, _)| pattern.add(row, column));
    }
    for (j, point) in points.iter().enumerate() {
        for (row, _, variable) in entries(j) {
            point.map.combinations[variable].iter().for_each(|&(column, _)| pattern.add(row, column));
        }
    }
    let mut matrix = pattern.build();
    for (row, combination) in linear.iter().enumerate() {
        combination.iter().for_each(|&(column, weight)| matrix.values[pattern.slot(row, column)] += weight);
    }
    let scatter = |j: usize| {
        let mut scatter = Scatter::new();
        for (row, entry, variable) in entries(j) {
            for &(column, weight) in &points[j].map.combinations[variable] {
                scatter.push((entry as u32, pattern.slot(row, column) as u32, weight));
            }
        }
        scatter
    };
    let scatters = (0..points.len()).map(scatter).collect();
    (matrix, scatters)
}

/// ∂d/∂x with the bounds on variables filled in, and where the slopes of functions go at each point.
pub fn inequalities(
    control: &ControlProblem<'_>,
    points: &[Point],
    bounds: &[Bound],
    n: usize,
) -> (Sparse, Vec<Scatter>) {
    // (local entry, variable) of a function.
    let slopes = |row: usize| {
        let entries = control.slope_pattern();
        let start = entries.partition_point(|entry| entry.0 < row);
        (start..entries.len()).take_while(move |&k| entries[k].0 == row).map(move |k| (k, entries[k].1))
    };
    let mut pattern = Pattern::new(bounds.len(), n);
    for (row, bound) in bounds.iter().enumerate() {
        let mut add = |variable: usize| {
            points[bound.point].map.combinations[variable].iter().for_each(|&(column, _)| pattern.add(row, column));
        };
        match control.limits[bound.limit].bounded {
            Bounded::Below(variable) | Bounded::Above(variable) => add(variable),
            Bounded::Function(function) => slopes(function).for_each(|(_, variable)| add(variable)),
        }
    }
    let mut matrix = pattern.build();
    let mut scatters = vec![Scatter::new(); points.len()];
    for (row, bound) in bounds.iter().enumerate() {
        let map = &points[bound.point].map.combinations;
        let (sign, variable) = match control.limits[bound.limit].bounded {
            Bounded::Below(variable) => (1.0, variable),
            Bounded::Above(variable) => (-1.0, variable),
            Bounded::Function(function) => {
                for (entry, variable) in slopes(function) {
                    let terms = map[variable].iter();
                    scatters[bound.point]
                        .extend(terms.map(|&(c, weight)| (entry as u32, pattern.slot(row, c) as u32, weight)));
                }
                continue;
            }
        };
        for &(column, weight) in &map[variable] {
            matrix.values[pattern.slot(row, column)] += sign * weight;
        }
    }
    (matrix, scatters)
}

pub struct Hessian {
    pub pattern: Sparse,
    /// JᵀJ in that pattern.
    pub gram: Vec<f64>,
    /// Where φ″ of each part of the objective's convex term goes.
    pub term: Scatter,
    /// Where the bends of each point go.
    pub scatter: Vec<Scatter>,
    /// The same of each variable with itself, by variable.
    pub metric: Vec<Scatter>,
}

pub fn hessian(control: &ControlProblem<'_>, points: &[Point], objective: &Objective) -> Hessian {
    let n = objective.residual_jacobian.columns;
    let gram_matrix = objective.residual_jacobian.gram();
    let parts = objective.term.as_ref().map_or_else(Vec::new, |term| rows_of(&term.functions));
    // Both orders of each pair of variables: (one, other, local entry), sorted.
    let pairs = control.bend_pattern().iter().enumerate();
    let mut ordered: Vec<(usize, usize, usize)> =
        pairs.flat_map(|(entry, &(i, j))| [(i, j, entry), (j, i, entry)]).collect();
    ordered.sort_unstable();
    ordered.dedup();
    let mut pattern = Pattern::new(n, n);
    gram_matrix.entries().for_each(|(row, column, _)| pattern.add(row, column));
    (0..n).for_each(|i| pattern.add(i, i));
    for row in &parts {
        row.iter().for_each(|&(i, _)| {
            row.iter().filter(|&&(j, _)| i <= j).for_each(|&(j, _)| pattern.add(i, j));
        });
    }
    for Point { map, .. } in points {
        for &(i, j, _) in &ordered {
            for &(row, _) in &map.combinations[i] {
                let columns = map.combinations[j].iter().filter(|&&(column, _)| row <= column);
                columns.for_each(|&(column, _)| pattern.add(row, column));
            }
        }
    }
    let matrix = pattern.build();
    let mut gram = vec![0.0; matrix.values.len()];
    for (row, column, slot) in gram_matrix.entries() {
        gram[pattern.slot(row, column)] = gram_matrix.values[slot];
    }
    let mut term = Scatter::new();
    for (k, row) in parts.iter().enumerate() {
        for &(i, weight) in row {
            let above = row.iter().filter(|&&(j, _)| i <= j);
            term.extend(above.map(|&(j, other)| (k as u32, pattern.slot(i, j) as u32, weight * other)));
        }
    }
    let (mut scatters, mut metrics) = (Vec::new(), Vec::new());
    for Point { map, .. } in points {
        let (mut scatter, mut metric) = (Scatter::new(), Scatter::new());
        for &(i, j, entry) in &ordered {
            for &(row, weight) in &map.combinations[i] {
                for &(column, other) in map.combinations[j].iter().filter(|&&(column, _)| row <= column) {
                    let slot = pattern.slot(row, column) as u32;
                    scatter.push((entry as u32, slot, weight * other));
                    if i == j {
                        metric.push((i as u32, slot, weight * other));
                    }
                }
            }
        }
        scatters.push(scatter);
        metrics.push(metric);
    }
    Hessian { pattern: matrix, gram, term, scatter: scatters, metric: metrics }
}

/// The entries of a matrix, row by row.
fn rows_of(matrix: &Sparse) -> Vec<Combination> {
    let mut rows = vec![Combination::new(); matrix.rows];
    matrix.entries().for_each(|(row, column, slot)| rows[row].push((column, matrix.values[slot])));
    rows
}

pub fn stages(points: &[Point], linear: &[Combination], bounds: &[Bound], n: usize) -> Stages {
    // Each unknown belongs to the first point that has it, where the equations say what it is.
    let mut variables = vec![0; n];
    for point in points.iter().rev() {
        point.map.combinations.iter().flatten().for_each(|&(i, _)| variables[i] = point.stage);
    }
    let first = |row: &Combination| row.iter().map(|&(i, _)| variables[i]).min().unwrap_or(0);
    let mut equalities: Vec<usize> = linear.iter().map(first).collect();
    for point in points {
        equalities.extend(std::iter::repeat_n(point.stage, point.rows.len()));
    }
    Stages { variables, equalities, inequalities: bounds.iter().map(|bound| points[bound.point].stage).collect() }
}

pub fn units(control: &ControlProblem<'_>, points: &[Point], n: usize) -> Vec<f64> {
    let mut units = vec![1.0; n];
    for read in &control.reads {
        let unit = control.quantity(read.quantity).unit;
        for Point { map, .. } in points.iter().filter(|_| unit != 1.0) {
            let terms = read.variables.range().flat_map(|variable| &map.combinations[variable]);
            terms.for_each(|&(index, _)| units[index] = unit);
        }
    }
    units
}

/// Adds local values, where a scatter says.
pub fn add(scatter: &Scatter, local: &[f64], values: &mut [f64]) {
    for &(entry, slot, weight) in scatter {
        values[slot as usize] += weight * local[entry as usize];
    }
}
