//! Known functions of time that act on a model: external forces, and the motion of bodies whose motion is given.

use std::sync::Arc;

use super::external_loads::ExternalLoads;
use super::joint_motion::JointMotion;
use crate::model::Model;
use crate::numerics::cubic::CubicSpline;

/// External forces and given motion.
#[derive(Clone, Debug, Default)]
pub struct Surroundings {
    loads: Vec<Load>,
    /// External loads from a file.
    external: Option<Arc<ExternalLoads>>,
    /// Motion of a spatial model with given coordinates or loads from a file.
    motion: Option<Arc<JointMotion>>,
}

/// An external force in ground axes, N. In a planar model, the third component is the moment, N m.
#[derive(Clone, Debug)]
pub enum Load {
    Constant([f64; 3]),
    /// Splines of the components, and a scale factor.
    TimeVarying(Box<[CubicSpline; 3]>, f64),
}

impl Surroundings {
    /// The constant forces of the model, without given coordinates.
    pub fn constant(model: &Model) -> Self {
        let loads = model.mechanics.constant_loads().into_iter().map(Load::Constant).collect();
        Self { loads, external: None, motion: None }
    }

    pub fn new(loads: Vec<Load>, external: Option<Arc<ExternalLoads>>, motion: Option<Arc<JointMotion>>) -> Self {
        Self { loads, external, motion }
    }

    /// The external forces at time `t` (s), in the order of the model; loads from a file as a force and a moment about the
    /// ground's origin. Those that are given in the frame of a body act where the measured motion has it.
    pub fn loads(&self, t: f64) -> Vec<[f64; 3]> {
        let at = |load: &Load| match load {
            Load::Constant(force) => *force,
            Load::TimeVarying(splines, scale) => [0, 1, 2].map(|i| scale * splines[i].at(t)[0]),
        };
        let mut all: Vec<[f64; 3]> = self.loads.iter().map(at).collect();
        if let (Some(external), Some(motion)) = (&self.external, &self.motion) {
            let (time, frames) = (motion.clock(t), motion.frames(t));
            for load in &external.loads {
                let load = load.at(time, &frames);
                all.extend([load.force, load.moment_about_origin()]);
            }
        }
        all
    }

    /// Given coordinates, their rates and accelerations; empty if there are none.
    pub fn given(&self, t: f64) -> [Vec<f64>; 3] {
        self.motion.as_ref().map_or_else(Default::default, |motion| motion.given(t))
    }
}
