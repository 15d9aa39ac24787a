//! The musculoskeletal model: rigid bodies and joints (in the plane as constraints on body coordinates, in space by joint
//! coordinates), musculotendons.
//!
//! What the user writes is a [`file::ModelFile`] (planar) or a [`crate::skeleton::file::SkeletonFile`] (spatial); what
//! the rest of the program sees is a checked [`Model`].

pub mod assembly;
pub mod body;
mod driven;
pub mod file;
pub mod joint;
pub mod mechanics;
pub mod musculotendon;
pub mod path;
pub mod planar;
pub mod spatial;
pub mod straight;
pub mod tree;

pub use body::Place;
pub use driven::DrivenCoordinate;
pub use joint::JointKind;
pub use mechanics::Mechanics;
pub use musculotendon::Musculotendon;
use std::sync::Arc;

use crate::entries::Actuator;
use crate::skeleton::Skeleton;
use mechanics::Motion;
use planar::Planar;
use spatial::Spatial;

/// A checked model.
#[derive(Clone, Debug)]
pub struct Model {
    pub name: String,
    pub mechanics: Arc<dyn Mechanics>,
    pub muscles: Vec<Musculotendon>,
    pub actuators: Vec<Actuator>,
    /// Lower bound of activations, unless a study sets `min_activation`.
    pub min_activation: f64,
}

impl Model {
    /// The model of a skeleton. Muscles that move nothing are left out.
    pub fn of_skeleton(skeleton: Arc<Skeleton>) -> Self {
        let spatial = Spatial::new(skeleton);
        let muscles = (spatial.skeleton.muscles.iter())
            .filter_map(|muscle| Some((muscle, spatial.path(muscle)?)))
            .map(|(muscle, path)| Musculotendon {
                name: muscle.name.clone(),
                max_isometric_force: muscle.max_isometric_force,
                optimal_fibre_length: muscle.optimal_fibre_length,
                tendon_slack_length: muscle.tendon_slack_length,
                pennation_angle: muscle.pennation_angle,
                activation: muscle.fibre.activation,
                max_shortening_velocity: muscle.max_shortening_velocity,
                damping: muscle.fibre.damping,
                effort_weight: muscle.fibre.effort_weight,
                shape: muscle.fibre.shape,
                curves: muscle.curves.with(&muscle.fibre.shape),
                rigid_tendon: muscle.rigid_tendon,
                has_passive_force: true,
                path,
            })
            .collect();
        let drives = |actuator: &&Actuator| {
            let coordinate = spatial.skeleton.coordinate(&actuator.coordinate);
            coordinate.is_some_and(|c| spatial.linkage.free_number(c).is_some())
        };
        let actuators = spatial.skeleton.actuators.iter().filter(drives).cloned().collect();
        let min_activation = spatial.skeleton.min_activation;
        Self { name: spatial.skeleton.name.clone(), min_activation, actuators, mechanics: Arc::new(spatial), muscles }
    }

    /// Inertial forces less gravity, external loads and passive moments, by coordinate that moves by forces, N or N m; see
    /// [`Mechanics::force`].
    pub fn needed_forces(&self, motion: Motion<'_>, loads: &[[f64; 3]]) -> Vec<f64> {
        let (q, velocity) = (motion.q, motion.velocity);
        let mut forces = vec![0.0; self.mechanics.coordinates()];
        self.mechanics.force(motion, loads, &mut forces);
        for (number, element) in self.spatial().iter().flat_map(|spatial| spatial.passive()) {
            forces[number] -= element.at(q[number], velocity[number]).value;
        }
        forces
    }

    /// The same model with external loads on bodies of its skeleton: names and bodies. A planar one has none.
    pub fn with_external(self, external: Vec<(String, usize)>) -> Self {
        match self.spatial() {
            Some(spatial) if !external.is_empty() => {
                let mut spatial = spatial.clone();
                spatial.external = external;
                Self { mechanics: Arc::new(spatial), ..self }
            }
            _ => self,
        }
    }

    /// The mechanism of a planar model, `None` of a spatial one.
    pub fn planar(&self) -> Option<&Planar> {
        self.mechanics.as_any().downcast_ref()
    }

    /// The mechanism of a spatial model, `None` of a planar one.
    pub fn spatial(&self) -> Option<&Spatial> {
        self.mechanics.as_any().downcast_ref()
    }

    /// Unknowns of a spatial model that neither a muscle nor an actuator nor a held point acts on; `has_reserve` of a name.
    pub fn undriven(&self, has_reserve: impl Fn(&str) -> bool) -> Vec<&str> {
        let Some(spatial) = self.spatial() else { return Vec::new() };
        let is_driven = |(number, name): (usize, &str)| {
            self.muscles.iter().any(|muscle| muscle.path.slots().contains(&number))
                || self.actuators.iter().any(|actuator| actuator.coordinate == name)
                || spatial.is_held(number)
                || has_reserve(name)
        };
        let names = self.mechanics.driven_coordinates().into_iter().map(|coordinate| coordinate.name).enumerate();
        names.filter(|coordinate| !is_driven(*coordinate)).map(|(_, name)| name).collect()
    }

    /// Total weight in newtons, the unit of forces inside the solver. Without gravity, one gravity is taken.
    pub fn weight(&self) -> f64 {
        let (mass, gravity) = self.mechanics.mass_and_gravity();
        mass * if gravity > 0.0 { gravity } else { 9.81 }
    }

    /// What a study may change in a motion: the joint coordinates, and the turns of a spatial model.
    pub fn motion_coordinates(&self) -> Vec<(&str, bool)> {
        let mut names = self.mechanics.joint_coordinates();
        names.extend(self.mechanics.turns().into_iter().map(|turn| (turn, true)));
        names
    }
}
