//! The musculoskeletal model: rigid bodies, joints as constraints on body coordinates, musculotendons.
//!
//! What the user writes is a [`file::ModelFile`] (planar) or a [`crate::skeleton::file::SkeletonFile`] (spatial); what
//! the rest of the program sees is a checked [`Model`].

pub mod assembly;
pub mod body;
pub mod file;
pub mod joint;
pub mod mechanics;
pub mod musculotendon;
pub mod path;
pub mod planar;
pub mod spatial;
pub mod straight;

pub use body::{Body, ExternalForce, Place};
pub use joint::{Joint, JointKind};
pub use mechanics::Mechanics;
pub use musculotendon::Musculotendon;
use std::sync::Arc;

use crate::entries::Actuator;
use crate::skeleton::Skeleton;
use path::Path;
use planar::Planar;
use spatial::Spatial;

/// Names of the coordinates of a body in space: position and Euler parameters.
const SPATIAL_AXES: [&str; 7] = ["x", "y", "z", "e0", "e1", "e2", "e3"];

/// A checked model.
#[derive(Clone, Debug)]
pub struct Model {
    pub name: String,
    pub mechanics: Mechanics,
    pub muscles: Vec<Musculotendon>,
    pub actuators: Vec<Actuator>,
}

impl Model {
    /// The model of a skeleton. Muscles that move no body with equations are left out: they act on nothing.
    pub fn of_skeleton(skeleton: Arc<Skeleton>) -> Self {
        let spatial = Spatial::new(skeleton);
        let muscles = (spatial.skeleton.muscles.iter())
            .filter(|muscle| spatial.is_moved_by(muscle))
            .map(|muscle| Musculotendon {
                name: muscle.name.clone(),
                max_isometric_force: muscle.max_isometric_force,
                optimal_fibre_length: muscle.optimal_fibre_length,
                tendon_slack_length: muscle.tendon_slack_length,
                pennation_angle: muscle.pennation_angle,
                activation_time: muscle.activation_time,
                deactivation_time: muscle.deactivation_time,
                max_shortening_velocity: muscle.max_shortening_velocity,
                force_velocity: muscle.force_velocity,
                rigid_tendon: muscle.rigid_tendon,
                path: Path::Spatial(spatial.path(muscle)),
            })
            .collect();
        Self {
            name: spatial.skeleton.name.clone(),
            mechanics: Mechanics::Spatial(spatial),
            muscles,
            actuators: Vec::new(),
        }
    }

    /// Number of body coordinates `nq`.
    pub fn coordinates(&self) -> usize {
        self.mechanics.coordinates()
    }

    /// Number of joint constraints `nc`.
    pub fn constraints(&self) -> usize {
        self.mechanics.constraints()
    }

    /// The mechanism of a planar model, `None` of a spatial one.
    pub fn planar(&self) -> Option<&Planar> {
        match &self.mechanics {
            Mechanics::Planar(planar) => Some(planar),
            Mechanics::Spatial(_) => None,
        }
    }

    /// The mechanism of a spatial model, `None` of a planar one.
    pub fn spatial(&self) -> Option<&Spatial> {
        match &self.mechanics {
            Mechanics::Planar(_) => None,
            Mechanics::Spatial(spatial) => Some(spatial),
        }
    }

    /// Total weight in newtons, the unit of forces inside the solver. Without gravity, one gravity is taken.
    pub fn weight(&self) -> f64 {
        let (mass, gravity): (f64, f64) = match &self.mechanics {
            Mechanics::Planar(planar) => {
                (planar.bodies.iter().map(|body| body.mass).sum(), planar.gravity[0].hypot(planar.gravity[1]))
            }
            Mechanics::Spatial(spatial) => {
                (spatial.bodies.iter().map(|body| body.mass).sum(), crate::skeleton::frame::norm(&spatial.gravity))
            }
        };
        mass * if gravity > 0.0 { gravity } else { 9.81 }
    }

    pub fn bodies(&self) -> usize {
        match &self.mechanics {
            Mechanics::Planar(planar) => planar.bodies.len(),
            Mechanics::Spatial(spatial) => spatial.bodies.len(),
        }
    }

    pub fn joints(&self) -> usize {
        match &self.mechanics {
            Mechanics::Planar(planar) => planar.joints.len(),
            Mechanics::Spatial(spatial) => spatial.joints.iter().filter(|joint| !joint.is_normal()).count(),
        }
    }

    /// The joint coordinates by name, and whether each is an angle.
    pub fn joint_coordinates(&self) -> Vec<(&str, bool)> {
        match &self.mechanics {
            Mechanics::Planar(planar) => {
                planar.joint_coordinates().map(|(joint, name)| (name, joint.kind.is_angular())).collect()
            }
            Mechanics::Spatial(spatial) => {
                spatial.skeleton.coordinates.iter().map(|c| (c.name.as_str(), c.is_angle)).collect()
            }
        }
    }

    /// Weight of a body coordinate in the tracking term: 1, but 2 for an Euler parameter, whose change is half the angle turned.
    pub fn tracking_weight(&self, coordinate: usize) -> f64 {
        match &self.mechanics {
            Mechanics::Spatial(_) if coordinate % spatial::joint::PER_BODY >= 3 => 2.0,
            _ => 1.0,
        }
    }

    /// Coordinates of a body, and how many of them are positions (m).
    pub fn per_body(&self) -> (usize, usize) {
        match &self.mechanics {
            Mechanics::Planar(_) => (3, 2),
            Mechanics::Spatial(_) => (spatial::joint::PER_BODY, 3),
        }
    }

    /// Values of the joint coordinates (rad, m) at all coordinates `q`, of a spatial model those that move by forces and its turns. `near`: values before, from which those of a spatial model are found, and which are brought up to date.
    pub fn joint_coordinate_values(&self, q: &[f64], near: &mut Vec<f64>) -> Vec<(&str, f64)> {
        match &self.mechanics {
            Mechanics::Planar(planar) => {
                planar.joint_coordinates().map(|(joint, name)| (name, joint.coordinate_value(q).value)).collect()
            }
            Mechanics::Spatial(spatial) => {
                if near.is_empty() {
                    *near = spatial.skeleton.default_pose();
                }
                let found = spatial.joint_coordinates(q, near);
                found.iter().for_each(|&(c, value)| near[c] = value);
                let named = found.iter().map(|&(c, value)| (spatial.skeleton.coordinates[c].name.as_str(), value));
                named.chain(spatial.turns_reached(q)).collect()
            }
        }
    }

    /// Name of the reaction of each constraint, `joint.0` and so on; `None` for pᵀp = 1, which has no reaction.
    pub fn reaction_names(&self) -> Vec<Option<String>> {
        let each = |name: &str, count: usize, real: bool| {
            (0..count).map(|k| real.then(|| format!("{name}.{k}"))).collect::<Vec<_>>()
        };
        match &self.mechanics {
            Mechanics::Planar(planar) => {
                planar.joints.iter().flat_map(|joint| each(&joint.name, joint.kind.constraints(), true)).collect()
            }
            Mechanics::Spatial(spatial) => (spatial.joints.iter())
                .flat_map(|joint| each(&joint.name, joint.constraints(), !joint.is_normal()))
                .collect(),
        }
    }

    /// Name of each constraint: that of its reaction, if it has one.
    pub fn constraint_names(&self) -> Vec<String> {
        self.reaction_names().into_iter().map(|name| name.unwrap_or_else(|| "normal".to_owned())).collect()
    }

    /// Names of the coordinates of bodies whose motion is given.
    pub fn given_coordinate_names(&self) -> Vec<String> {
        self.spatial().map_or_else(Vec::new, |spatial| {
            let bodies = spatial.given.iter().map(|&body| spatial.skeleton.bodies[body].name.as_str());
            bodies.flat_map(|name| SPATIAL_AXES.map(|axis| format!("{name}.{axis}"))).collect()
        })
    }

    /// Names of the components of the external forces: three each; of a planar one the third is its moment.
    pub fn load_names(&self) -> Vec<String> {
        let forces: Vec<&str> = match &self.mechanics {
            Mechanics::Planar(planar) => planar.forces.iter().map(|force| force.name.as_str()).collect(),
            Mechanics::Spatial(spatial) => spatial.skeleton.forces.iter().map(|force| force.name.as_str()).collect(),
        };
        forces.iter().flat_map(|name| (0..3).map(move |k| format!("{name}.{k}"))).collect()
    }

    /// External forces that the motion file must have over time.
    pub fn measured_forces(&self) -> Vec<&str> {
        let Mechanics::Spatial(spatial) = &self.mechanics else { return Vec::new() };
        spatial.skeleton.forces.iter().filter(|f| f.force.is_none()).map(|f| f.name.as_str()).collect()
    }

    /// What a study may change in a motion: the joint coordinates, and the turns of a spatial model.
    pub fn motion_coordinates(&self) -> Vec<(&str, bool)> {
        let mut names = self.joint_coordinates();
        let turns = self.spatial().map_or(&[][..], |spatial| &spatial.skeleton.turns);
        names.extend(turns.iter().map(|turn| (turn.name.as_str(), true)));
        names
    }

    /// Joint coordinates that stay as they are whatever the motion says, with why.
    pub fn unmoved_coordinates(&self) -> Vec<(String, &'static str)> {
        let Some(spatial) = self.spatial() else { return Vec::new() };
        let why = |coordinate: &crate::skeleton::Coordinate| match (coordinate.locked, &coordinate.follows) {
            (true, _) => Some("is locked in the model"),
            (_, Some(_)) => Some("follows another coordinate of the model"),
            _ => None,
        };
        let coordinates = spatial.skeleton.coordinates.iter();
        coordinates.filter_map(|coordinate| Some((coordinate.name.clone(), why(coordinate)?))).collect()
    }

    /// Names of the body coordinates, `upper_arm.x` and so on.
    pub fn body_coordinate_names(&self) -> Vec<String> {
        let each = |name: &str, axes: &[&str]| axes.iter().map(|axis| format!("{name}.{axis}")).collect::<Vec<_>>();
        match &self.mechanics {
            Mechanics::Planar(planar) => {
                planar.bodies.iter().flat_map(|body| each(&body.name, &["x", "y", "angle"])).collect()
            }
            Mechanics::Spatial(spatial) => {
                spatial.bodies.iter().flat_map(|body| each(&body.name, &SPATIAL_AXES)).collect()
            }
        }
    }
}
