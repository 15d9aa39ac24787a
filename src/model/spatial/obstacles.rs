//! What keeps a study from using a spatial model.

use std::sync::Arc;

use super::Spatial;
use super::path::SLOTS;
use crate::error::Issue;
use crate::skeleton::path::PathPoint;
use crate::skeleton::surface::Shape;
use crate::skeleton::{Motion, Muscle, Role, Skeleton};

impl Skeleton {
    /// Checks that a study can use the model.
    ///
    /// # Errors
    /// All [obstacles](Self::obstacles) as one issue, located at the first.
    pub fn check_study(&self) -> Result<(), Issue> {
        let obstacles = self.obstacles();
        let Some(first) = obstacles.first() else { return Ok(()) };
        if obstacles.len() == 1 {
            return Err(first.clone());
        }
        let lines = obstacles.iter().map(|issue| format!("\n  {}: {}", issue.path.join("."), issue.message));
        let message =
            format!("a study cannot use this model, for {} reasons:{}", obstacles.len(), lines.collect::<String>());
        let mut helps: Vec<&str> = obstacles.iter().filter_map(|issue| issue.help.as_deref()).collect();
        helps.dedup();
        Err(Issue { path: first.path.clone(), message, help: Some(helps.join("; ")) })
    }

    /// Everything that keeps a study from using the model. A study needs a body that moves by forces, and does not
    /// support:
    ///
    /// - bodies that move by forces on joints with axes driven by functions, or with coordinates that follow others;
    /// - bodies that move by forces without mass;
    /// - muscles that act on bodies that move by forces, if their path has a conditional point, a moving point (unless
    ///   it moves in proportion to an elevation), a torus, or too many bodies and surfaces.
    ///
    /// Paths of other muscles are not restricted, because derivatives of their lengths are not needed.
    pub fn obstacles(&self) -> Vec<Issue> {
        let given = "give the body and all bodies between it and the ground the role \"given\" (they then move as the \
                     motion file says), or lock the coordinates of the joint";
        let mut found = Vec::new();
        let mut moving = 0;
        for joint in self.joints.iter().filter(|joint| self.moves_by_forces(joint.child) && !self.is_locked(joint)) {
            moving += 1;
            let place = ["joint", joint.name.as_str()];
            if let Motion::Axes { translations, rotations } = &joint.motion
                && !translations.iter().chain(rotations).all(|axis| axis.by.is_identity())
            {
                let message = "axes driven by functions are not supported for bodies that move by forces";
                found.push(Issue::new(&place, message, given));
            }
            let coordinates = joint.motion.coordinates();
            if let Some(&c) = coordinates.iter().find(|&&c| self.coordinates[c].follows.is_some()) {
                let name = &self.coordinates[c].name;
                let message = format!(
                    "`{name}` follows another coordinate, which is not supported for bodies that move by forces"
                );
                found.push(Issue::new(&place, message, given));
            }
        }
        if moving == 0 {
            let message = "nothing moves by forces: every body's motion is given, or its coordinates are locked";
            let help = "unlock a coordinate, or remove the role \"given\" from the bodies that the muscles move";
            found.push(Issue::new(&["body"], message, help));
            return found;
        }
        let spatial = Spatial::new(Arc::new(self.clone()));
        for body in spatial.bodies.iter().filter(|body| body.mass.is_nan() || body.mass <= 0.0) {
            let help = "give it a mass, weld it to a body that has one, or give it the role \"given\"";
            found.push(Issue::new(&["body", &body.name, "mass"], "the body moves by forces and has no mass", help));
        }
        for muscle in self.muscles.iter().filter(|muscle| spatial.is_moved_by(muscle)) {
            found.extend(self.obstacles_of_path(muscle));
            if found.is_empty() && spatial.path(muscle).slots.len() + 2 * muscle.path.surfaces.len() > SLOTS {
                let message = "the path depends on more than 25 bodies";
                found.push(Issue::new(&["muscle", &muscle.name, "path"], message, "split the muscle"));
            }
        }
        found
    }

    /// True if the body moves by forces.
    pub fn moves_by_forces(&self, body: usize) -> bool {
        self.bodies[body].role == Role::Free
    }

    /// Obstacles in the path of a muscle that acts on bodies that move by forces.
    fn obstacles_of_path(&self, muscle: &Muscle) -> Vec<Issue> {
        let place = ["muscle", muscle.name.as_str(), "path"];
        let mut found = Vec::new();
        if muscle.path.points.iter().any(|point| point.when.is_some()) {
            let message = "the path has a conditional point, at which its length jumps";
            let help = "remove the point or its `when`; a wrapping surface has the same effect without a jump";
            found.push(Issue::new(&place, message, help));
        }
        let smooth = |point: &PathPoint| {
            point.moves.is_empty() || point.in_proportion().is_some_and(|(c, ..)| self.elevation_joint(c).is_some())
        };
        if !muscle.path.points.iter().all(smooth) {
            let message = "a point moves, but not in proportion to the second of three rotations of a joint";
            let help = "fix the point (remove moves, x, y and z), or replace it by a wrapping surface";
            found.push(Issue::new(&place, message, help));
        }
        let torus = muscle.path.surfaces.iter().map(|obstacle| &self.surfaces[obstacle.surface]);
        for surface in torus.filter(|surface| matches!(surface.shape, Shape::Torus { .. })) {
            let message = format!("`{}` is a torus; second derivatives around a torus are not supported", surface.name);
            let help = "replace it by a cylinder or a path point";
            found.push(Issue::new(&place, message, help));
        }
        found
    }
}
