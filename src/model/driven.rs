//! A joint coordinate θ that actuators act on, as a function of the unknowns.

use super::joint::Joint;
use crate::numerics::Scalar;

#[derive(Clone, Copy, Debug)]
pub struct DrivenCoordinate<'m> {
    pub name: &'m str,
    pub is_angle: bool,
    how: How<'m>,
}

#[derive(Clone, Copy, Debug)]
enum How<'m> {
    /// Of a planar joint: a function of body coordinates.
    OfJoint(&'m Joint),
    /// It is an unknown itself.
    Unknown(usize),
}

/// ∂θ/∂q and, row by row, ∂²θ/∂q² over some unknowns.
#[derive(Clone, Debug)]
pub struct Slopes<T> {
    pub slots: Vec<usize>,
    pub gradient: Vec<T>,
    /// Empty if θ is linear.
    pub hessian: Vec<T>,
}

impl<'m> DrivenCoordinate<'m> {
    pub fn of_joint(joint: &'m Joint, name: &'m str) -> Self {
        Self { name, is_angle: joint.kind.is_angular(), how: How::OfJoint(joint) }
    }

    pub fn unknown(name: &'m str, is_angle: bool, number: usize) -> Self {
        Self { name, is_angle, how: How::Unknown(number) }
    }

    pub fn slopes<T: Scalar>(&self, q: &[T]) -> Slopes<T> {
        match self.how {
            How::Unknown(number) => Slopes { slots: vec![number], gradient: vec![T::from(1.0)], hessian: Vec::new() },
            How::OfJoint(joint) => {
                let angle = joint.coordinate_value(q);
                let of_bodies = joint.slots().into_iter().enumerate().filter_map(|(i, slot)| Some((i, slot?)));
                let (places, slots): (Vec<usize>, Vec<usize>) = of_bodies.unzip();
                let gradient = places.iter().map(|&i| angle.gradient[i]).collect();
                let hessian = places.iter().flat_map(|&i| places.iter().map(move |&j| angle.hessian[i][j]));
                Slopes { gradient, hessian: hessian.collect(), slots }
            }
        }
    }
}
