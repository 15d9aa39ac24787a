//! Inverse dynamics without muscles: the net moment or force of each joint coordinate over a measured motion; and what
//! joints carry where the muscle forces are known.

pub mod joint_loads;
pub mod planar;
pub mod spatial;

/// Net moment (N m) or force (N) of a joint coordinate over time.
#[derive(Clone, Debug)]
pub struct NetForce {
    /// The coordinate, and whether it is an angle.
    pub coordinate: String,
    pub is_angle: bool,
    /// Whether it is a residual of a floating base.
    pub is_residual: bool,
    /// One for each instant.
    pub values: Vec<f64>,
}
