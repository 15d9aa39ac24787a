//! A muscle whose length is a polynomial of joint coordinates instead of the way along a path.

use std::sync::Arc;

use num_dual::Dual64;

use super::linkage::Linkage;
use super::path::SpatialPath;
use crate::model::straight::PathLength;
use crate::model::tree::Drive;
use crate::numerics::Scalar;
use crate::skeleton::function::Function;
use crate::skeleton::polynomial::Polynomial;
use crate::skeleton::{Muscle, Skeleton};

#[derive(Clone, Debug)]
pub struct FittedPath {
    linkage: Arc<Linkage>,
    polynomial: Polynomial,
    /// What the polynomial is of, with the slot of each that moves by forces.
    arguments: Vec<(Drive, Option<usize>)>,
    /// Numbers of the coordinates that the length depends on and that move by forces, increasing.
    pub slots: Vec<usize>,
    /// Where the muscle runs, for drawings; it may have no points.
    pub drawn: SpatialPath,
}

impl FittedPath {
    /// The length of a muscle that has a polynomial.
    pub fn new(skeleton: &Skeleton, linkage: &Arc<Linkage>, muscle: &Muscle) -> Option<Self> {
        let polynomial = muscle.length.clone()?;
        let drive = |&c: &usize| Drive::by(skeleton, c, &Function::identity());
        let drives: Vec<Drive> = polynomial.coordinates.iter().map(drive).collect();
        let unknown = |drive: &Drive| linkage.free_number(drive.terms[0].0);
        let mut slots: Vec<usize> = drives.iter().filter_map(unknown).collect();
        slots.sort_unstable();
        slots.dedup();
        let placed = |drive: Drive| {
            let slot = unknown(&drive).and_then(|number| slots.binary_search(&number).ok());
            (drive, slot)
        };
        let arguments = drives.into_iter().map(placed).collect();
        let drawn = SpatialPath::new(skeleton, linkage, muscle);
        Some(Self { linkage: linkage.clone(), polynomial, arguments, slots, drawn })
    }

    /// The length and its derivatives over [`FittedPath::slots`] at all coordinates `q`.
    pub fn length<T: Scalar>(&self, q: &[T], out: &mut PathLength<T>) {
        let (coordinates, n) = (self.linkage.coordinates(q), self.slots.len());
        let inner: Vec<[T; 3]> =
            self.arguments.iter().map(|(drive, _)| drive.bent(drive.argument(&coordinates))).collect();
        let values: Vec<T> = inner.iter().map(|[value, ..]| *value).collect();
        let outer = self.polynomial.at(&values);
        out.value = outer.value;
        out.gradient.fill(T::zero());
        out.hessian.fill(T::zero());
        let slots = || self.arguments.iter().enumerate().filter_map(|(i, (_, slot))| Some((i, (*slot)?)));
        for (i, row) in slots() {
            out.gradient[row] += outer.slopes[i] * inner[i][1];
            out.hessian[row * n + row] += outer.slopes[i] * inner[i][2];
            for (j, column) in slots() {
                out.hessian[row * n + column] += outer.bends[i][j] * inner[i][1] * inner[j][1];
            }
        }
    }

    /// [`FittedPath::length`], with the directional derivatives along `direction` in the dual parts.
    pub fn length_along(&self, q: &[f64], direction: &[f64]) -> PathLength<Dual64> {
        let q: Vec<Dual64> = q.iter().zip(direction).map(|(&x, &d)| Dual64::new(x, d)).collect();
        let n = self.slots.len();
        let zero = Dual64::from(0.0);
        let mut out = PathLength { value: zero, gradient: vec![zero; n], hessian: vec![zero; n * n] };
        self.length(&q, &mut out);
        out
    }
}
