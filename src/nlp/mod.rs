//! Nonlinear least squares with constraints: the problem, its solution by SQP, and the ranks. Knows no muscles.
//!
//! The solver, in the order of its steps:
//!
//! ```text
//! sqp              the loop
//! termination        is it over?
//! curvature          the models of second derivatives at a point
//! damping            δ, the weight of the proximal term
//! subproblem         a quadratic programme, by one of several ways
//! globalisation      which step along its solution is taken
//! acceleration       going further than the step where Newton's method creeps
//! recovery           what is tried where no step is accepted; last of all the restoration of feasibility
//! trace              what each iteration did
//! options, presets   every number
//! ```
//!
//! Beside it: [`kkt`] (the linear systems), [`polish`] and [`regularity`] (ranks at a point).

pub mod acceleration;
pub mod curvature;
pub mod damping;
pub mod globalisation;
pub mod iterate;
pub mod kkt;
pub mod options;
pub mod polish;
pub mod presets;
pub mod problem;
pub mod recovery;
pub mod regularity;
pub mod restoration;
pub mod sqp;
pub mod state;
pub mod subproblem;
pub mod termination;
pub mod trace;
