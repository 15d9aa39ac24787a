//! What every transcription provides: a finite-dimensional space of functions of time, and where the equations hold in it.

use super::coefficients::Coefficients;
use crate::problem::{ControlProblem, Kind, QuantityId};

/// Σ weight · x[index]
pub type Combination = Vec<(usize, f64)>;

pub fn evaluate(combination: &Combination, x: &[f64]) -> f64 {
    combination.iter().map(|&(index, weight)| weight * x[index]).sum()
}

/// Four-point Gauss quadrature on each polynomial piece, exact up to degree 7: instants and weights, s.
pub fn gauss(breakpoints: &[f64]) -> impl Iterator<Item = (f64, f64)> {
    let (near, far) = (0.339_981_043_584_856_3, 0.861_136_311_594_052_6);
    let rule = [(near, 0.652_145_154_862_546_1), (far, 0.347_854_845_137_453_9)];
    breakpoints.windows(2).flat_map(move |w| {
        let (middle, half) = (0.5 * (w[0] + w[1]), 0.5 * (w[1] - w[0]));
        rule.into_iter().flat_map(move |(x, b)| [(middle - half * x, half * b), (middle + half * x, half * b)])
    })
}

/// Times (s) and weights (s) of the points at which every function has a value.
pub fn quadrature(scheme: &dyn Discretisation) -> Vec<(f64, f64)> {
    scheme.points().iter().copied().zip(scheme.quadrature()).filter(|(_, weight)| *weight > 0.0).collect()
}

/// A time, and where it is among the polynomial pieces.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    /// s
    pub time: f64,
    /// `None` at the start of the motion, where some schemes have values of states only.
    pub piece: Option<usize>,
    /// 0 … 1 within the piece.
    pub share: f64,
}

/// A space of functions.
pub trait Discretisation: Send + Sync {
    /// All collocation points, s, the start of the motion first.
    fn points(&self) -> &[f64];

    /// Ends of the polynomial pieces, s.
    fn breakpoints(&self) -> &[f64];

    fn coefficients(&self) -> &Coefficients;

    /// The place of a time; where a function jumps, its value to the left.
    fn place(&self, t: f64) -> Place;

    /// The place of a collocation point.
    fn point(&self, j: usize) -> Place;

    /// Which points are one stage to the linear algebra: those of one interval, so that what belongs to one muscle is eliminated
    /// together.
    fn stage(&self, point: usize) -> usize;

    /// A derivative of a function that is not given, as a combination of the decision vector. Empty where it has no value.
    fn function(&self, place: Place, quantity: QuantityId, member: usize, derivative: usize) -> Combination;

    /// Whether all equations hold at a point; else those among values of states only.
    fn is_complete(&self, point: usize) -> bool;

    /// Weights that integrate, over the whole motion, a function known at [`Discretisation::points`] only, s. The weight of
    /// a point without a force is 0.
    fn quadrature(&self) -> Vec<f64>;

    /// Linear equalities `Σ weight · x = constant`.
    fn linear(&self) -> Vec<Combination>;

    /// Their constants.
    fn linear_constants(&self) -> Vec<f64> {
        vec![0.0; self.linear().len()]
    }

    /// Makes the unknowns that are only names for values of the others agree with them.
    fn settle(&self, x: &mut [f64]);

    /// The decision vector nearest to given functions: exact for functions of the space.
    fn compose(&self, functions: &dyn Trajectory) -> Vec<f64>;

    /// A derivative of a function at any time.
    fn at(&self, t: f64, quantity: QuantityId, member: usize, derivative: usize) -> Combination {
        self.function(self.place(t), quantity, member, derivative)
    }
}

/// Functions of time that make up an answer: a start guess, or a solution on another mesh.
pub trait Trajectory {
    /// A function, or its first or second derivative, in the units of the problem.
    fn value(&self, t: f64, quantity: QuantityId, member: usize, derivative: usize) -> f64;
}

/// The variables at a place: z = B x + b.
#[derive(Clone, Debug)]
pub struct LocalMap {
    /// B, a row for each variable.
    pub combinations: Vec<Combination>,
    /// b, zero but for given quantities; empty if there are none.
    pub constants: Vec<f64>,
}

impl LocalMap {
    pub fn new(problem: &ControlProblem<'_>, scheme: &dyn Discretisation, place: Place) -> Self {
        let mut combinations = vec![Combination::new(); problem.variables()];
        for read in problem.reads.iter().filter(|read| problem.quantity(read.quantity).kind != Kind::Given) {
            for (member, variable) in read.variables.range().enumerate() {
                combinations[variable] = scheme.function(place, read.quantity, member, read.derivative);
            }
        }
        let constants = if problem.has_given() { problem.given_at(place.time) } else { Vec::new() };
        Self { combinations, constants }
    }

    /// z
    pub fn apply(&self, x: &[f64]) -> Vec<f64> {
        let mut z: Vec<f64> = self.combinations.iter().map(|row| evaluate(row, x)).collect();
        z.iter_mut().zip(&self.constants).for_each(|(z, b)| *z += b);
        z
    }
}
