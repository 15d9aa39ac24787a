//! From joint coordinates to body coordinates: the pose where the given joint coordinates and all joint
//! constraints hold.

use nalgebra::{DMatrix, DVector};

use super::joint::PairFunction;
use super::mechanics::Mechanics;
use super::planar::Planar;

/// The joints of a model cannot all be closed.
#[derive(Clone, Debug, PartialEq)]
pub struct CannotAssemble {
    /// max |Φ| at the best pose found, m or rad
    pub gap: f64,
    /// Names of the joints that stay open by a tenth of that gap or more.
    pub joints: Vec<String>,
    /// ‖Φ_qᵀ Φ‖/‖Φ‖ there: near zero certifies that no small change closes the gap.
    pub slope: f64,
}

const CLOSED: f64 = 1e-10;
const ITERATIONS: usize = 200;

impl Planar {
    /// Body coordinates (length `nq`) for the joint coordinates `given`, in the order of
    /// [`Planar::joint_coordinates`]; `None` is free (only sensible in a closed loop). `start` is a near pose.
    ///
    /// Levenberg–Marquardt on all conditions; if the measured coordinates contradict each other
    /// (a loop with noise), the nearest pose that closes the joints.
    ///
    /// # Errors
    /// [`CannotAssemble`] at a stationary point of ‖Φ‖² that is no zero.
    pub fn assemble(&self, given: &[Option<f64>], start: Option<&[f64]>) -> Result<Vec<f64>, CannotAssemble> {
        let mut q = match start {
            Some(q) => q.to_vec(),
            None => self.chain(given),
        };
        self.reduce(&mut q, Some(given));
        self.reduce(&mut q, None);
        let (value, jacobian) = self.conditions(&q, None);
        let gap = value.amax();
        if gap <= CLOSED {
            return Ok(q);
        }
        let mut row = 0;
        let mut joints = Vec::new();
        for joint in &self.joints {
            let rows = value.rows(row, joint.kind.constraints());
            if rows.amax() >= 0.1 * gap {
                joints.push(joint.name.clone());
            }
            row += joint.kind.constraints();
        }
        let slope = (jacobian.transpose() * &value).norm() / value.norm();
        Err(CannotAssemble { gap, joints, slope })
    }

    /// See [`Mechanics::coordinate_directions`].
    pub fn directions(&self, q: &[f64]) -> Option<DMatrix<f64>> {
        let count = self.coordinates_of_joints().count();
        let (_, jacobian) = self.conditions(q, Some(&vec![Some(0.0); count]));
        let constraints = self.constraints();
        let inverse = (jacobian.is_square()).then(|| jacobian.try_inverse())??;
        Some(inverse.columns(constraints, count).into_owned())
    }

    /// Levenberg–Marquardt on the conditions, in place, until they hold or cannot be reduced any more.
    fn reduce(&self, q: &mut Vec<f64>, given: Option<&[Option<f64>]>) {
        let (mut value, mut jacobian) = self.conditions(q, given);
        let mut damping = 1e-6;
        for _ in 0..ITERATIONS {
            if value.amax() <= 1e-14 || (jacobian.transpose() * &value).norm() <= 1e-9 * value.norm() {
                return;
            }
            let svd = jacobian.clone().svd(true, true);
            let (Some(u), Some(v_t)) = (&svd.u, &svd.v_t) else { return };
            let projected = u.transpose() * &value;
            loop {
                let scaled = projected
                    .zip_map(&svd.singular_values, |r, s| if s > 1e-11 { -r * s / (s * s + damping) } else { 0.0 });
                let step = v_t.transpose() * scaled;
                let trial: Vec<f64> = q.iter().zip(step.iter()).map(|(x, d)| x + d).collect();
                let (trial_value, trial_jacobian) = self.conditions(&trial, given);
                if trial_value.norm() < value.norm() {
                    (*q, value, jacobian) = (trial, trial_value, trial_jacobian);
                    damping *= 1e-2;
                    break;
                }
                damping = (10.0 * damping).max(1e-12);
                if damping > 1e6 {
                    return;
                }
            }
        }
    }

    /// Φ(q), and below it the given joint coordinates minus their values, with the Jacobian.
    fn conditions(&self, q: &[f64], given: Option<&[Option<f64>]>) -> (DVector<f64>, DMatrix<f64>) {
        let mut functions: Vec<(f64, [f64; 6], [Option<usize>; 6])> = Vec::new();
        let mut push =
            |f: &PairFunction<f64>, offset: f64, slots| functions.push((f.value - offset, f.gradient, slots));
        for joint in &self.joints {
            joint.constraints(q, |f| push(f, 0.0, joint.slots()));
        }
        if let Some(given) = given {
            for ((joint, _), value) in self.coordinates_of_joints().zip(given) {
                if let Some(value) = value {
                    push(&joint.coordinate_value(q), *value, joint.slots());
                }
            }
        }
        let mut jacobian = DMatrix::zeros(functions.len(), self.coordinates());
        let mut value = DVector::zeros(functions.len());
        for (row, (residual, gradient, slots)) in functions.iter().enumerate() {
            value[row] = *residual;
            for (slot, by) in slots.iter().zip(gradient) {
                if let Some(coordinate) = slot {
                    jacobian[(row, *coordinate)] = *by;
                }
            }
        }
        (value, jacobian)
    }

    /// A first pose: each joint places its child on its parent, from the ground outwards.
    fn chain(&self, given: &[Option<f64>]) -> Vec<f64> {
        let mut q = vec![0.0; self.coordinates()];
        let mut placed = vec![false; self.bodies.len()];
        let values: Vec<f64> = {
            let mut given = given.iter();
            self.joints
                .iter()
                .map(|j| j.coordinate.as_ref().and_then(|_| given.next().copied().flatten()).unwrap_or(0.0))
                .collect()
        };
        for _ in 0..self.bodies.len() {
            for (joint, value) in self.joints.iter().zip(&values) {
                let ready = joint.parent.body().is_none_or(|b| placed[b]);
                let Some(child) = joint.child.body().filter(|&b| ready && !placed[b]) else { continue };
                let parent_angle = joint.parent.body().map_or(0.0, |b| q[3 * b + 2]);
                let (turn, slide) = match joint.kind {
                    super::JointKind::Revolute { angle } => (angle + value, [0.0, 0.0]),
                    super::JointKind::Weld { angle } => (angle, [0.0, 0.0]),
                    super::JointKind::Prismatic { axis, angle } => {
                        (angle, super::body::rotate(parent_angle, axis.map(|a| a * value)))
                    }
                };
                q[3 * child + 2] = parent_angle + turn;
                let (target, offset) = (joint.parent.at(&q).position, joint.child.at(&q).position);
                q[3 * child] += target[0] + slide[0] - offset[0];
                q[3 * child + 1] += target[1] + slide[1] - offset[1];
                placed[child] = true;
            }
        }
        q
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_loop_is_closed_from_one_coordinate_and_a_broken_one_is_reported() {
        let text = include_str!("../../tests/fixtures/everything.toml");
        let file: crate::model::file::ModelFile = toml::from_str(text).unwrap();
        let model = file.check().unwrap().planar().unwrap().clone();
        let given = [Some(0.4), None, None];
        let q = model.assemble(&given, None).unwrap();
        for joint in &model.joints {
            joint.constraints(&q, |f| assert!(f.value.abs() < 1e-10));
        }
        let (main, _) = model.coordinates_of_joints().next().unwrap();
        assert!((main.coordinate_value(&q).value - 0.4).abs() < 1e-9);

        let text = text.replace("parent_point = [0.5, 0.0]", "parent_point = [0.01, 0.0]");
        let file: crate::model::file::ModelFile = toml::from_str(&text).unwrap();
        let mut broken = file.check().unwrap().planar().unwrap().clone();
        // A rail far out of reach of the short rod.
        if let crate::model::Place::Ground(point) = &mut broken.joints[2].parent {
            *point = [0.0, 3.0];
        }
        broken.joints[2].kind = super::super::JointKind::Prismatic { axis: [1.0, 0.0], angle: 0.0 };
        let failure = broken.assemble(&given, None).unwrap_err();
        assert!(failure.gap > 0.1 && failure.slope < 1e-3, "{failure:?}");
    }
}
