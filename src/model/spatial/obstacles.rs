//! What keeps a study from using a spatial model.

use std::sync::Arc;

use super::Spatial;
use super::path::SLOTS;
use crate::error::Issue;
use crate::model::tree::Tree;
use crate::skeleton::{Muscle, Role, Skeleton};

/// A coordinate that moves less than this (kg, kg m²) moves no mass.
const NO_MASS: f64 = 1e-12;

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

    /// Everything that keeps a study from using the model. A study needs a coordinate that moves by forces, and does not
    /// support:
    ///
    /// - coordinates that move by forces, but no mass;
    /// - coordinates of a joint on an ellipsoid that follow others;
    /// - muscles that move something, if their path depends on too many coordinates.
    ///
    /// Paths of other muscles are not restricted, because derivatives of their lengths are not needed.
    pub fn obstacles(&self) -> Vec<Issue> {
        if let Some(coordinate) = Tree::unsupported(self) {
            let message = "a coordinate of a joint on an ellipsoid follows another one, which is not supported";
            return vec![Issue::new(&["coordinate", coordinate], message, "remove its `follows`")];
        }
        let spatial = Spatial::new(Arc::new(self.clone()));
        if spatial.linkage.free.is_empty() {
            let message = "nothing moves by forces: every body's motion is given, or its coordinates are locked";
            let help = "unlock a coordinate, or remove the role \"given\" from the bodies that the muscles move";
            return vec![Issue::new(&["body"], message, help)];
        }
        let mut found = Vec::new();
        let moved = spatial.linkage.moved();
        for (&c, _) in moved.iter().zip(spatial.inertias()).filter(|(_, inertia)| *inertia < NO_MASS) {
            let help = "give a mass to one of the bodies that it moves, give its body the role \"given\", or lock it";
            let place = ["coordinate", self.coordinates[c].name.as_str()];
            found.push(Issue::new(&place, "the coordinate moves by forces, but moves no mass", help));
        }
        found.extend(self.obstacles_of_balls(&spatial));
        for muscle in &self.muscles {
            let Some(path) = spatial.path(muscle) else { continue };
            found.extend(self.moves_with_ball(&spatial, muscle));
            if muscle.length.is_none() && path.slots().len() + 2 * muscle.path.surfaces.len() > SLOTS {
                let message = format!("the path depends on {} coordinates; at most {SLOTS}", path.slots().len());
                found.push(Issue::new(&["muscle", &muscle.name, "path"], message, "split the muscle"));
            }
        }
        found
    }

    /// Ball joints that cannot be one, and what acts at coordinates of those that are.
    fn obstacles_of_balls(&self, spatial: &Spatial) -> Vec<Issue> {
        let mut found = Vec::new();
        let is_ball = |number: usize| spatial.linkage.balls.iter().any(|ball| ball.joint == number);
        for (number, joint) in self.joints.iter().enumerate().filter(|(_, joint)| joint.ball) {
            let coordinates = joint.motion.coordinates();
            let moves = coordinates.iter().all(|&c| !self.coordinates[c].locked);
            if self.bodies[joint.child].role == Role::Free && moves && !is_ball(number) {
                let message = "the coordinates of a ball joint must drive nothing else and follow nothing";
                found.push(Issue::new(&["joint", &joint.name, "ball"], message, "remove `ball`"));
            }
        }
        let actuators = self.actuators.iter().map(|own| ("actuator", &own.name, self.coordinate(&own.coordinate)));
        let passive = self.passive.iter().map(|own| ("passive", &own.entry.name, Some(own.coordinate)));
        for (kind, name, coordinate) in actuators.chain(passive) {
            if coordinate.is_some_and(|c| spatial.linkage.ball_of(c).is_some()) {
                let help = "remove it, or `ball` of the joint";
                found.push(Issue::new(&[kind, name], "it acts at a coordinate of a ball joint", help));
            }
        }
        found
    }

    /// A point that moves or comes and goes, or a fitted length, with a coordinate of a ball joint that is no function of
    /// its angles.
    fn moves_with_ball(&self, spatial: &Spatial, muscle: &Muscle) -> Option<Issue> {
        let fitted = muscle.length.iter().flat_map(|length| length.coordinates.iter().copied());
        if let Some(c) = { fitted }.find(|&c| spatial.linkage.ball_of(c).is_some()) {
            let message = format!("the length depends on `{}`, a coordinate of a ball joint", self.coordinates[c].name);
            return Some(Issue::new(&["muscle", &muscle.name, "length"], message, "remove `ball` of the joint"));
        }
        let points = muscle.path.points.iter();
        let mut by = points.flat_map(|p| p.moves.iter().map(|m| m.coordinate).chain(p.when.map(|(c, _)| c)));
        let c = by.find(|&c| {
            let ball = spatial.linkage.ball_of(c);
            ball.is_some_and(|(k, i)| i != 1 || !spatial.linkage.balls[k].has_elevation())
        })?;
        let message = format!("a point moves with `{}`, a coordinate of a ball joint", self.coordinates[c].name);
        let help = "only points that move with its second rotation are supported; remove `ball`, or fix the point";
        Some(Issue::new(&["muscle", muscle.name.as_str(), "path"], message, help))
    }
}
