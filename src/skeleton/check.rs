//! What a whole spatial model must be, beyond its parts: as a model, and as the model of a study.

use std::sync::Arc;

use super::file::Checked;
use super::surface::Shape;
use super::{Girdle, Motion, Muscle, Role, Skeleton};
use crate::error::Issue;
use crate::model::spatial::{Spatial, path::SLOTS};

impl Skeleton {
    /// Whether a study can have the model.
    ///
    /// # Errors
    /// The obstacles, as one issue at the place of the first.
    pub fn check_study(&self) -> Checked<()> {
        let obstacles = self.obstacles();
        let Some(first) = obstacles.first() else { return Ok(()) };
        if obstacles.len() == 1 {
            return Err(first.clone());
        }
        let lines = obstacles.iter().map(|issue| format!("\n  {}: {}", issue.path.join("."), issue.message));
        let message = format!("{} obstacles to a study:{}", obstacles.len(), lines.collect::<String>());
        let mut helps: Vec<&str> = obstacles.iter().filter_map(|issue| issue.help.as_deref()).collect();
        helps.dedup();
        Err(Issue { path: first.path.clone(), message, help: Some(helps.join("; ")) })
    }

    /// All that keeps the model from being that of a study: nothing that moves by forces; a joint with axes by functions, or a coordinate that
    /// follows another, where bodies move by forces; a body without mass that does; and in the path of a muscle that acts on one, a point
    /// that comes and goes or moves in other ways than in proportion to an elevation, or a torus. The other muscles' lengths need no derivatives.
    pub fn obstacles(&self) -> Vec<Issue> {
        let given = "give the body and those it hangs on the role \"given\" (their motion is then that of the motion file), or lock its coordinates";
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
            let message = "nothing moves by forces: each body's motion is given, or its coordinates are locked";
            let help = "unlock a coordinate, or leave out the role \"given\" of the bodies that the muscles move";
            found.push(Issue::new(&["body"], message, help));
            return found;
        }
        let spatial = Spatial::new(Arc::new(self.clone()), Girdle::Equilibrium);
        for body in spatial.bodies.iter().filter(|body| body.mass.is_nan() || body.mass <= 0.0) {
            let help = "give it a mass, weld it to a body that has one, or let it move as given";
            found.push(Issue::new(&["body", &body.name, "mass"], "a body that moves by forces has no mass", help));
        }
        for muscle in self.muscles.iter().filter(|muscle| spatial.is_moved_by(muscle)) {
            found.extend(self.obstacles_of_path(muscle));
            if found.is_empty() && spatial.path(muscle).slots.len() + 2 * muscle.path.surfaces.len() > SLOTS {
                let message = "the path depends on more than 25 bodies";
                found.push(Issue::new(&["muscle", &muscle.name, "path"], message, "divide the muscle"));
            }
        }
        found
    }

    /// Whether a body may move by forces, in some variant of the girdle.
    pub fn moves_by_forces(&self, body: usize) -> bool {
        self.bodies[body].role != Role::Given
    }

    fn obstacles_of_path(&self, muscle: &Muscle) -> Vec<Issue> {
        let place = ["muscle", muscle.name.as_str(), "path"];
        let mut found = Vec::new();
        if muscle.path.points.iter().any(|point| point.when.is_some()) {
            let message = "a point of the path comes and goes, and the length with it jumps";
            let help = "remove the point, or its `when`; a wrapping surface does the same without a jump";
            found.push(Issue::new(&place, message, help));
        }
        let smooth = |point: &super::path::PathPoint| {
            point.moves.is_empty() || point.in_proportion().is_some_and(|(c, ..)| self.elevation_joint(c).is_some())
        };
        if !muscle.path.points.iter().all(smooth) {
            let message = "a point moves in another way than in proportion to the second of a joint's three rotations";
            let help = "fix the point (leave out moves, x, y and z), or describe the way by a wrapping surface";
            found.push(Issue::new(&place, message, help));
        }
        let torus = muscle.path.surfaces.iter().map(|obstacle| &self.surfaces[obstacle.surface]);
        for surface in torus.filter(|surface| matches!(surface.shape, Shape::Torus { .. })) {
            let message = format!("`{}` is a torus, whose second derivatives are not supported", surface.name);
            let help = "replace it by a cylinder, or by a point that the path goes over";
            found.push(Issue::new(&place, message, help));
        }
        found
    }

    /// A body whose motion is given cannot hang on one that moves by forces.
    pub(super) fn check_roles(&self) -> Checked<()> {
        for joint in &self.joints {
            let Some(parent) = joint.parent else { continue };
            let (parent, child) = (&self.bodies[parent], &self.bodies[joint.child]);
            if child.role == Role::Given && parent.role != Role::Given {
                let message = format!("its motion is given, and `{}`, which it hangs on, moves by forces", parent.name);
                let help = "give that one the role \"given\" too, or leave out the role of this one";
                return Err(Issue::new(&["body", &child.name, "role"], message, help));
            }
        }
        Ok(())
    }
}
