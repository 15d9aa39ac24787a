//! What acts on a model over time and is no unknown: external forces, and the motion of bodies that is given.

use std::sync::Arc;

use super::joint_motion::JointMotion;
use crate::model::{Mechanics, Model};
use crate::numerics::cubic::CubicSpline;

#[derive(Clone, Debug, Default)]
pub struct Surroundings {
    loads: Vec<Load>,
    /// Of a spatial model with bodies whose motion is given.
    motion: Option<Arc<JointMotion>>,
}

/// An external force in the ground's axes, N; of a planar model with its moment (N m) third.
#[derive(Clone, Debug)]
pub enum Load {
    Constant([f64; 3]),
    OverTime(Box<[CubicSpline; 3]>, f64),
}

impl Surroundings {
    /// Constant forces, and bodies in no given motion.
    pub fn constant(model: &Model) -> Self {
        let loads = match &model.mechanics {
            Mechanics::Planar(planar) => {
                planar.forces.iter().map(|f| Load::Constant([f.force[0], f.force[1], f.moment])).collect()
            }
            Mechanics::Spatial(spatial) => {
                let constant = |f: &crate::skeleton::Force| f.force.unwrap_or_default().map(|x| x * f.scale);
                spatial.skeleton.forces.iter().map(|f| Load::Constant(constant(f))).collect()
            }
        };
        Self { loads, motion: None }
    }

    pub fn new(loads: Vec<Load>, motion: Option<Arc<JointMotion>>) -> Self {
        Self { loads, motion }
    }

    /// The external forces at a time, in the order of the model's.
    pub fn loads(&self, t: f64) -> Vec<[f64; 3]> {
        let at = |load: &Load| match load {
            Load::Constant(force) => *force,
            Load::OverTime(splines, scale) => [0, 1, 2].map(|i| scale * splines[i].at(t)[0]),
        };
        self.loads.iter().map(at).collect()
    }

    /// Coordinates of the bodies whose motion is given, and their rates.
    pub fn given(&self, t: f64) -> (Vec<f64>, Vec<f64>) {
        self.motion.as_ref().map_or_else(Default::default, |motion| motion.given(t))
    }
}
