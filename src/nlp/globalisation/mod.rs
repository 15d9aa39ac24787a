//! Which step along the sub-problem's solution is taken.

pub mod correction;
pub mod filter;
pub mod line_search;
