//! Nonlinear least squares with constraints: the problem trait, SQP, regularity. Knows no muscles.

pub mod active_set;
pub mod filter;
pub mod interior_point;
pub mod iterate;
pub mod kkt;
pub mod polish;
pub mod problem;
pub mod qp;
pub mod regularity;
pub mod sqp;
