//! The equations of the thesis (Paper B) and what stands beside them, a file each.
//!
//! | file | equation | adds to |
//! |---|---|---|
//! | `equation_of_motion` | (1) without muscles and joints: inertia, gravity, external forces | (1) |
//! | `joints` | (2), and the joint reactions | (1), (2) |
//! | `stabilisation` | constraints on the velocity level (not in the thesis) | its own |
//! | `contraction` | (3), and the muscle's force | (1), (3) |
//! | `activation` | (4) | (4) |
//! | `excitation_range` | bounds on u of (4) without u | functions of limits |
//! | `force_actuator` | (1.3): a muscle that makes any force | (1) |
//! | `moment_balance` | (1) where the motion is given, (1.6) | (1) |
//! | `reserve` | moments that no muscle makes (not in the thesis) | (1) |

pub mod activation;
pub mod contraction;
pub mod equation_of_motion;
pub mod excitation_range;
pub mod force_actuator;
pub mod joints;
pub mod moment_balance;
pub mod passive;
pub mod reserve;
pub mod stabilisation;

use num_dual::Dual64;

/// x + ε d, with d continued by zeros.
fn along(x: &[f64], d: &[f64]) -> Vec<Dual64> {
    let d = d.iter().copied().chain(std::iter::repeat(0.0));
    x.iter().zip(d).map(|(&x, d)| Dual64::new(x, d)).collect()
}
