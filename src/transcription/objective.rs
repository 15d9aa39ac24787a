//! The objective: goals as rows over the unknowns.

use std::ops::Range;

use super::scheme::Discretisation;
use crate::nlp::problem::ConvexTerm;
use crate::numerics::sparse::Sparse;
use crate::problem::Goal;
use crate::problem::goals::{Sample, Shape};

/// The objective ½‖J x − b‖² + Σ φ_k.
pub struct Objective {
    pub(super) residual_jacobian: Sparse,
    pub(super) residual_data: Vec<f64>,
    /// The rows of J that belong to each goal.
    goals: Vec<(&'static str, Range<usize>)>,
    /// Goals that are no squares.
    pub(super) term: Option<Term>,
}

/// The goals that are no squares: K, and the shape and the sample of each of its rows.
pub(super) struct Term {
    pub(super) functions: Sparse,
    parts: Vec<(Shape, Sample)>,
}

impl ConvexTerm for Term {
    fn functions(&self) -> &Sparse {
        &self.functions
    }

    fn part(&self, k: usize, y: f64) -> [f64; 3] {
        let (shape, sample) = &self.parts[k];
        shape.at(y - sample.target).map(|value| sample.weight * value)
    }
}

impl Objective {
    pub(super) fn new(scheme: &dyn Discretisation, all: &[Goal]) -> Self {
        let (mut triplets, mut residual_data, mut goals) = (Vec::new(), Vec::new(), Vec::new());
        let (mut functions, mut parts) = (Vec::new(), Vec::new());
        for goal in all {
            let start = residual_data.len();
            for sample in &goal.samples {
                let of_member = |&(member, factor): &(usize, f64)| {
                    let own = scheme.at(sample.time, sample.quantity, member, 0).into_iter();
                    own.map(move |(i, weight)| (i, factor * weight))
                };
                let terms = sample.members.iter().flat_map(of_member);
                if goal.shape == Shape::Square {
                    let row = residual_data.len();
                    triplets.extend(terms.map(|(i, weight)| (row, i, sample.weight * weight)));
                    residual_data.push(sample.weight * sample.target);
                } else {
                    functions.extend(terms.map(|(i, weight)| (parts.len(), i, weight)));
                    parts.push((goal.shape, sample.clone()));
                }
            }
            goals.push((goal.name, start..residual_data.len()));
        }
        let n = scheme.coefficients().total();
        let term =
            (!parts.is_empty()).then(|| Term { functions: Sparse::from_triplets(parts.len(), n, &functions), parts });
        let residual_jacobian = Sparse::from_triplets(residual_data.len(), scheme.coefficients().total(), &triplets);
        Self { residual_jacobian, residual_data, goals, term }
    }

    /// The rows of J that belong to a goal.
    pub fn rows(&self, goal: &str) -> Range<usize> {
        self.goals.iter().find(|(name, _)| *name == goal).map_or(0..0, |(_, rows)| rows.clone())
    }
}
