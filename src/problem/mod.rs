//! What is to be solved, in continuous time: an optimal-control problem of quantities, equations, limits and goals. Knows
//! no mesh.
//!
//! - A [`Quantity`] is a family of functions of time: states, controls, algebraic variables, given functions.
//! - The variables z at an instant are values and derivatives of quantities, in the order in which they are asked for.
//! - A [`Block`] reads variables and adds terms to equations, each of which is zero at the solution. `blocks/` has a file
//!   for each equation of the thesis.
//! - A [`Limit`] keeps variables, or functions of them, on one side of a bound.
//! - A [`Goal`] is a part of the objective, see `goals/`.
//!
//! `methods/` puts problems together; `transcription/` turns them into programmes for the solver.

pub mod block;
pub mod blocks;
pub mod goals;
pub mod quantity;

use nalgebra::{DMatrix, Matrix4};

use block::{Block, Order, Pattern};
pub use goals::Goal;
pub use quantity::{Kind, Quantity, QuantityId, Span};

/// Values of a given quantity and their first and second derivatives at a time (s), as far as they are read.
pub type Given = [Vec<f64>; 3];
type GivenFunction<'m> = Box<dyn Fn(f64) -> Given + Send + Sync + 'm>;

/// A family of equations, or of functions that a [`Limit`] bounds.
#[derive(Clone, Debug)]
pub struct Equation {
    pub name: &'static str,
    pub rows: Span,
    /// Whether it is one of the printed equations, and not there to stabilise the discretisation.
    pub is_printed: bool,
}

/// Variables at an instant: a derivative of a quantity.
#[derive(Clone, Copy, Debug)]
pub struct Read {
    pub quantity: QuantityId,
    pub derivative: usize,
    pub variables: Span,
}

/// What a [`Limit`] bounds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bounded {
    /// variable ≥ bound
    Below(usize),
    /// variable ≤ bound
    Above(usize),
    /// row ≥ 0
    Function(usize),
}

/// One inequality at each instant.
#[derive(Clone, Debug)]
pub struct Limit {
    /// As in the signal `bound_active`.
    pub name: &'static str,
    /// The muscle or coordinate that it belongs to.
    pub member: String,
    pub bounded: Bounded,
    pub bound: f64,
}

/// A condition at the start of the motion: a state has this rate, 1/s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AtStart {
    pub state: QuantityId,
    pub member: usize,
    pub rate: f64,
}

/// An optimal-control problem without its goals.
#[derive(Default)]
pub struct ControlProblem<'m> {
    pub quantities: Vec<Quantity>,
    pub reads: Vec<Read>,
    pub equations: Vec<Equation>,
    /// Functions that limits bound; their rows come after those of the equations.
    pub functions: usize,
    pub limits: Vec<Limit>,
    /// Conditions at the start of the motion.
    pub starts: Vec<AtStart>,
    given: Vec<(QuantityId, GivenFunction<'m>)>,
    blocks: Vec<Box<dyn Block + 'm>>,
    slopes: Pattern,
    bends: Pattern,
    /// Of each convex group: its size, and the places of its pairs in `bends`, row by row.
    convex_groups: Vec<(usize, Vec<usize>)>,
}

/// A [`ControlProblem`] while it is put together, without its patterns.
#[derive(Default)]
pub struct Builder<'m>(ControlProblem<'m>);

impl<'m> Builder<'m> {
    /// Declares a quantity, measured in SI units.
    pub fn quantity(&mut self, name: &'static str, members: Vec<String>, kind: Kind) -> QuantityId {
        self.quantity_in(name, members, kind, 1.0)
    }

    /// Declares a quantity, measured in a multiple of its SI unit.
    pub fn quantity_in(&mut self, name: &'static str, members: Vec<String>, kind: Kind, unit: f64) -> QuantityId {
        self.0.quantities.push(Quantity { name, members, kind, unit });
        QuantityId(self.0.quantities.len() - 1)
    }

    /// Declares functions known beforehand.
    pub fn given(
        &mut self,
        name: &'static str,
        members: Vec<String>,
        function: impl Fn(f64) -> Given + Send + Sync + 'm,
    ) -> QuantityId {
        let id = self.quantity(name, members, Kind::Given);
        self.0.given.push((id, Box::new(function)));
        id
    }

    /// The variables that hold a derivative of a quantity.
    pub fn read(&mut self, quantity: QuantityId, derivative: usize) -> Span {
        if let Some(read) = self.0.reads.iter().find(|r| r.quantity == quantity && r.derivative == derivative) {
            return read.variables;
        }
        let start = self.0.variables();
        let variables = Span { start, count: self.0.quantities[quantity.0].members.len() };
        self.0.reads.push(Read { quantity, derivative, variables });
        variables
    }

    /// Declares equations.
    pub fn equation(&mut self, name: &'static str, count: usize, is_printed: bool) -> Span {
        let start = self.0.rows();
        let rows = Span { start, count };
        self.0.equations.push(Equation { name, rows, is_printed });
        rows
    }

    pub fn block(&mut self, block: impl Block + 'm) {
        self.0.blocks.push(Box::new(block));
    }

    pub fn limit(&mut self, name: &'static str, member: &str, bounded: Bounded, bound: f64) {
        self.0.limits.push(Limit { name, member: member.to_owned(), bounded, bound });
    }

    pub fn at_start(&mut self, condition: AtStart) {
        self.0.starts.push(condition);
    }

    /// The problem; the last `functions` rows are functions for limits and not equations.
    pub fn build(self, functions: usize) -> ControlProblem<'m> {
        let problem = self.0;
        let (rows, variables) = (problem.rows(), problem.variables());
        let groups: Vec<Vec<usize>> = problem.blocks.iter().flat_map(|block| block.convex_groups()).collect();
        let pairs = groups
            .iter()
            .flat_map(|group| group.iter().flat_map(|&i| group.iter().filter(move |&&j| i <= j).map(move |&j| (i, j))));
        let sizes = (rows, variables);
        let slopes = Pattern::record(&problem.blocks, Order::Slopes, sizes, std::iter::empty());
        let diagonal = (0..variables).map(|i| (i, i));
        let bends = Pattern::record(&problem.blocks, Order::Bends, sizes, pairs.chain(diagonal));
        let place = |i: usize, j: usize| bends.place(i.min(j), i.max(j)).expect("groups are in the pattern");
        let places = |group: &Vec<usize>| group.iter().flat_map(|&i| group.iter().map(move |&j| place(i, j))).collect();
        let convex_groups = groups.iter().map(|group| (group.len(), places(group))).collect();
        ControlProblem { functions, slopes, bends, convex_groups, ..problem }
    }
}

impl ControlProblem<'_> {
    /// Number of variables z at an instant.
    pub fn variables(&self) -> usize {
        self.reads.last().map_or(0, |read| read.variables.range().end)
    }

    /// Number of rows: equations, then functions for limits.
    pub fn rows(&self) -> usize {
        self.equations.last().map_or(0, |equation| equation.rows.range().end)
    }

    /// Number of equations.
    pub fn equation_rows(&self) -> usize {
        self.rows() - self.functions
    }

    pub fn quantity(&self, id: QuantityId) -> &Quantity {
        &self.quantities[id.0]
    }

    /// Whether any function is known beforehand.
    pub fn has_given(&self) -> bool {
        self.given.iter().any(|(id, _)| !self.quantity(*id).members.is_empty())
    }

    /// Values and derivatives at time t (s) of the given quantities among the variables; all others are 0.
    pub fn given_at(&self, t: f64) -> Vec<f64> {
        let mut z = vec![0.0; self.variables()];
        for (id, function) in &self.given {
            let mut known = None;
            for read in self.reads.iter().filter(|read| read.quantity == *id) {
                let known = known.get_or_insert_with(|| function(t));
                z[read.variables.range()].copy_from_slice(&known[read.derivative]);
            }
        }
        z
    }

    /// The quantity and its derivative that a variable holds.
    pub fn read_of(&self, variable: usize) -> &Read {
        self.reads.iter().find(|read| read.variables.range().contains(&variable)).expect("a variable of the problem")
    }

    /// Whether a variable is the value of a state or given, so that it has a value at the start of the motion too.
    pub fn is_known_at_start(&self, variable: usize) -> bool {
        let read = self.read_of(variable);
        let kind = self.quantity(read.quantity).kind;
        kind == Kind::Given || (kind.is_state() && read.derivative == 0)
    }

    /// Equations among values of states alone: constraints that hold at the start of the motion too.
    pub fn state_constraints(&self) -> Vec<usize> {
        let is_known: Vec<bool> = (0..self.variables()).map(|variable| self.is_known_at_start(variable)).collect();
        let count = self.equation_rows();
        let mut constrains = vec![true; count];
        for &(row, variable) in self.slopes.entries.iter().filter(|(row, _)| *row < count) {
            constrains[row] &= is_known[variable];
        }
        (0..count).filter(|&row| constrains[row]).collect()
    }

    /// (row, variable) of each slope, sorted.
    pub fn slope_pattern(&self) -> &[(usize, usize)] {
        &self.slopes.entries
    }

    /// Pairs of variables, the smaller first, of each bend and of the diagonal, sorted.
    pub fn bend_pattern(&self) -> &[(usize, usize)] {
        &self.bends.entries
    }

    /// The values of all rows at z.
    pub fn values(&self, z: &[f64], out: &mut [f64]) {
        block::values(&self.blocks, z, out);
    }

    /// The residuals of all rows in the form in which they are printed.
    pub fn printed_values(&self, z: &[f64], out: &mut [f64]) {
        self.values(z, out);
        self.blocks.iter().for_each(|block| block.print(z, out));
    }

    /// First derivatives of all rows, in the order of [`ControlProblem::slope_pattern`].
    pub fn slopes(&self, z: &[f64], out: &mut [f64]) {
        self.slopes.replay(&self.blocks, Order::Slopes, z, &[], out);
    }

    /// Second derivatives of `multipliersᵀ rows`, in the order of [`ControlProblem::bend_pattern`].
    pub fn bends(&self, z: &[f64], multipliers: &[f64], out: &mut [f64]) {
        self.bends.replay(&self.blocks, Order::Bends, z, multipliers, out);
    }

    /// Makes second derivatives positive semidefinite: groups of variables keep their positive curvature only, what
    /// couples groups is left out.
    pub fn convexify(&self, bends: &mut [f64]) {
        let mut convex = vec![0.0; bends.len()];
        for (n, places) in &self.convex_groups {
            let mut keep = |values: &[f64], vectors: &[f64]| {
                for (value, vector) in values.iter().zip(vectors.chunks_exact(*n)).filter(|(value, _)| **value > 0.0) {
                    for i in 0..*n {
                        (i..*n).for_each(|j| convex[places[i * n + j]] += value * vector[i] * vector[j]);
                    }
                }
            };
            if *n == 4 {
                // Most groups are those of muscles: without allocation.
                let eigen = Matrix4::from_fn(|i, j| bends[places[i * 4 + j]]).symmetric_eigen();
                keep(eigen.eigenvalues.as_slice(), eigen.eigenvectors.as_slice());
            } else {
                let eigen = DMatrix::from_fn(*n, *n, |i, j| bends[places[i * n + j]]).symmetric_eigen();
                keep(eigen.eigenvalues.as_slice(), eigen.eigenvectors.as_slice());
            }
        }
        bends.copy_from_slice(&convex);
    }

    /// The weight of a step in each variable at z; see [`Block::weigh`].
    pub fn weigh(&self, z: &[f64], weights: &mut [f64]) {
        weights.fill(0.0);
        self.blocks.iter().for_each(|block| block.weigh(z, weights));
    }
}
