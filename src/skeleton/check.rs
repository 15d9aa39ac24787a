//! Checks that the parts of a spatial model fit together.

use super::file::Checked;
use super::{Role, Skeleton};
use crate::error::Issue;

impl Skeleton {
    /// Checks that no body whose motion is given has a parent that moves by forces.
    pub(super) fn check_roles(&self) -> Checked<()> {
        for joint in &self.joints {
            let Some(parent) = joint.parent else { continue };
            let (parent, child) = (&self.bodies[parent], &self.bodies[joint.child]);
            if child.role != Role::Free && parent.role == Role::Free {
                let message = format!("its motion is known, but its parent `{}` moves by forces", parent.name);
                let help = "give the parent the role \"given\" too, or remove the role of this body";
                return Err(Issue::new(&["body", &child.name, "role"], message, help));
            }
        }
        Ok(())
    }
}
