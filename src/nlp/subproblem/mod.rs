//! The quadratic sub-problem, and the ways of solving it:
//!
//! ```text
//! min ∇fᵀ d + ½ dᵀ (H + δ D) d   s.t.  c + A d = 0,  d(x) + B d ≥ 0
//!
//!     1. H = ∇²L, by its active set, from the last one, if that has settled (active_set)
//!     2. else: H = ∇²L, by an interior point that goes on where the last one ended (interior_point)
//!     3. where that needs a large δ: H = ∇²L without its negative curvature, likewise, until the active set settles
//!     4. at first and where all else fails: H = JᵀJ, likewise, or by Clarabel (qp)
//! ```
//!
//! Far from a solution the convex Hessian is the better model: a δ that covers all negative curvature shortens every
//! step, leaving it out only those along it.

pub mod active_set;
pub mod interior_point;
pub mod portfolio;
pub mod qp;

use super::curvature::Model;

/// The step and multipliers of the sub-problem, and how they came about.
#[derive(Clone, Debug)]
pub struct Step {
    pub direction: Vec<f64>,
    pub equality_multipliers: Vec<f64>,
    pub inequality_multipliers: Vec<f64>,
    pub active: Vec<bool>,
    /// δ with which it was solved.
    pub damping: f64,
    pub way: Way,
    /// Whether it was solved to its end.
    pub quality: Quality,
    /// Whether the factorisation at hand is that of this step.
    pub has_factors: bool,
    /// Whether that was the first one tried: nothing had to change. Never of an interior point, whose factorisation is
    /// of another system.
    pub is_settled: bool,
    /// Iterations spent in Clarabel.
    pub qp_iterations: usize,
}

/// How a sub-problem was solved, and with which Hessian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    ActiveSet,
    InteriorPoint(Model),
    Clarabel,
}

impl Way {
    /// Whether an own way has left out negative curvature.
    pub fn is_convexified(self) -> bool {
        matches!(self, Self::InteriorPoint(Model::Convex | Model::GaussNewton))
    }

    /// Its name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::ActiveSet => "active_set",
            Self::InteriorPoint(Model::Exact) => "interior_point",
            Self::InteriorPoint(Model::Convex) => "interior_point_convex",
            Self::InteriorPoint(Model::GaussNewton) => "interior_point_gauss_newton",
            Self::Clarabel => "clarabel",
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quality {
    /// Broken off early.
    Rough,
    Full,
}

/// Why no step came out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoStep {
    /// The active set, or the interior point, did not settle.
    Unsettled,
    /// The largest δ allowed did not make the Hessian positive definite.
    TooCurved,
    /// No damping made the Hessian positive definite, or the linear system could not be solved.
    Singular,
    /// The linearised constraints contradict each other.
    Infeasible,
}
