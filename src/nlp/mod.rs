pub mod active_set;
pub mod filter;
pub mod iterate;
pub mod kkt;
pub mod problem;
pub mod qp;
pub mod sqp;
