//! The musculoskeletal model: rigid bodies, joints as constraints on body coordinates, musculotendons.
//!
//! A planar body has the coordinates x, y (m) of its centre of mass and its angle φ (rad), so a model of
//! `nb` bodies has `nq = 3 nb` body coordinates, body after body. What the user writes is a [`file::ModelFile`];
//! what the rest of the program sees is a checked [`Model`].

pub mod assembly;
pub mod body;
pub mod curves;
pub mod file;
pub mod joint;
pub mod musculotendon;
pub mod path;

pub use body::{Body, ExternalForce, Place};
pub use joint::{Joint, JointKind};
pub use musculotendon::Musculotendon;

/// A checked planar model.
#[derive(Clone, Debug)]
pub struct Model {
    pub name: String,
    /// Gravitational acceleration, m/s².
    pub gravity: [f64; 2],
    pub bodies: Vec<Body>,
    pub joints: Vec<Joint>,
    pub muscles: Vec<Musculotendon>,
    pub forces: Vec<ExternalForce>,
}

impl Model {
    /// Number of body coordinates `nq`.
    pub fn coordinates(&self) -> usize {
        3 * self.bodies.len()
    }

    /// Number of joint constraints `nc`.
    pub fn constraints(&self) -> usize {
        self.joints.iter().map(|joint| joint.kind.constraints()).sum()
    }

    /// Total weight in newtons, the unit of forces inside the solver. Without gravity, one gravity is taken.
    pub fn weight(&self) -> f64 {
        let mass: f64 = self.bodies.iter().map(|body| body.mass).sum();
        let gravity = self.gravity[0].hypot(self.gravity[1]);
        mass * if gravity > 0.0 { gravity } else { 9.81 }
    }

    /// Diagonal of the mass matrix M: mass, mass, inertia of each body (kg, kg, kg m²).
    pub fn mass_diagonal(&self) -> Vec<f64> {
        self.bodies.iter().flat_map(|body| [body.mass, body.mass, body.inertia]).collect()
    }

    /// Names of the joint coordinates, in the order of the joints.
    pub fn joint_coordinates(&self) -> impl Iterator<Item = (&Joint, &str)> {
        self.joints.iter().filter_map(|joint| joint.coordinate.as_deref().map(|name| (joint, name)))
    }

    /// Names of the body coordinates, `upper_arm.x` and so on.
    pub fn body_coordinate_names(&self) -> Vec<String> {
        self.bodies.iter().flat_map(|body| ["x", "y", "angle"].map(|axis| format!("{}.{axis}", body.name))).collect()
    }
}
