//! What a whole spatial model must be, beyond its parts: as a model, and as the model of a study.

use std::sync::Arc;

use super::file::Checked;
use super::{Girdle, Motion, Role, Skeleton};
use crate::error::Issue;
use crate::model::spatial::Spatial;

impl Skeleton {
    /// What lengths and moment arms can be had of, but no study.
    ///
    /// # Errors
    /// The first thing that a study cannot have: a joint with axes by functions, or a coordinate that follows another, where bodies move by
    /// forces; a body without mass that does; a point that comes and goes, or moves in other ways than in proportion to an elevation.
    pub fn check_study(&self) -> Checked<()> {
        let moves = |body: Option<usize>| body.is_some_and(|b| self.bodies[b].role != Role::Given);
        let given = "give the body and those it hangs on the role \"given\" (their motion is then that of the motion file), or lock its coordinates";
        for joint in self.joints.iter().filter(|joint| moves(Some(joint.child)) && !self.is_locked(joint)) {
            let place = ["joint", joint.name.as_str()];
            if let Motion::Axes { translations, rotations } = &joint.motion
                && !translations.iter().chain(rotations).all(|axis| axis.by.is_identity())
            {
                let message =
                    "an axis goes `by` a function of its coordinate, which a study has only where motion is given";
                return Err(Issue::new(&place, message, given));
            }
            let coordinates = joint.motion.coordinates();
            if let Some(&c) = coordinates.iter().find(|&&c| self.coordinates[c].follows.is_some()) {
                let name = &self.coordinates[c].name;
                let message =
                    format!("`{name}` follows another coordinate, which a study has only where motion is given");
                return Err(Issue::new(&place, message, given));
            }
        }
        let spatial = Spatial::new(Arc::new(self.clone()), Girdle::Equilibrium);
        if let Some(body) = spatial.bodies.iter().find(|body| body.mass.is_nan() || body.mass <= 0.0) {
            let help = "give it a mass, weld it to a body that has one, or let it move as given";
            return Err(Issue::new(&["body", &body.name, "mass"], "a body that moves by forces has no mass", help));
        }
        for muscle in &self.muscles {
            let place = ["muscle", muscle.name.as_str(), "path"];
            for point in &muscle.path.points {
                if point.when.is_some() {
                    let message = "a point of the path comes and goes, and the length with it jumps";
                    let help = "remove the point, or its `when`; a wrapping surface does the same without a jump";
                    return Err(Issue::new(&place, message, help));
                }
                let smooth = point.moves.is_empty()
                    || point.in_proportion().is_some_and(|(c, ..)| self.elevation_joint(c).is_some());
                if !smooth {
                    let message =
                        "a point moves in another way than in proportion to the second of a joint's three rotations";
                    let help = "fix the point (leave moves, x, y, z away), or describe the way by a wrapping surface";
                    return Err(Issue::new(&place, message, help));
                }
            }
        }
        Ok(())
    }

    /// A body whose motion is given cannot hang on one that moves by forces.
    pub(super) fn check_roles(&self) -> Checked<()> {
        for joint in &self.joints {
            let Some(parent) = joint.parent else { continue };
            let (parent, child) = (&self.bodies[parent], &self.bodies[joint.child]);
            if child.role == Role::Given && parent.role != Role::Given {
                let message = format!("its motion is given, and `{}`, which it hangs on, moves by forces", parent.name);
                let help = "give that one the role \"given\" too, or leave the role of this one away";
                return Err(Issue::new(&["body", &child.name, "role"], message, help));
            }
        }
        Ok(())
    }

    /// A point of a path inside one of its own surfaces, on the same body, can never get around it.
    pub(super) fn check_paths(&self) -> Checked<()> {
        for muscle in &self.muscles {
            for obstacle in &muscle.path.surfaces {
                let surface = &self.surfaces[obstacle.surface];
                let own =
                    muscle.path.points.iter().filter(|point| point.body == surface.body && point.moves.is_empty());
                for point in own {
                    let x = surface.frame.inverse().point(&point.point);
                    if surface.shape.holds(&x) {
                        let message = format!("the point {:?} is inside the surface `{}`", point.point, surface.name);
                        let help = "move the point out, make the surface smaller, or take it off this path";
                        return Err(Issue::new(&["muscle", &muscle.name, "path"], message, help));
                    }
                }
            }
        }
        Ok(())
    }
}
