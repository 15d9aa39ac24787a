//! What the equations of motion need to know of a mechanism, planar or spatial.

use super::planar::Planar;
use super::spatial::Spatial;
use crate::numerics::Scalar;

#[derive(Clone, Debug)]
pub enum Mechanics {
    Planar(Planar),
    Spatial(Spatial),
}

/// A body coordinate, its rate or its acceleration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    Coordinate,
    Velocity,
    Acceleration,
}

/// The motion of all bodies at an instant; velocities may be empty for a planar mechanism, whose equations have none.
#[derive(Clone, Copy, Debug)]
pub struct Motion<'a> {
    pub q: &'a [f64],
    pub velocity: &'a [f64],
    pub acceleration: &'a [f64],
}

macro_rules! either {
    ($self:expr, $mechanism:ident => $call:expr) => {
        match $self {
            Mechanics::Planar($mechanism) => $call,
            Mechanics::Spatial($mechanism) => $call,
        }
    };
}

impl Mechanics {
    /// Number of body coordinates nq that are unknowns.
    pub fn coordinates(&self) -> usize {
        either!(self, m => m.coordinates())
    }

    /// Number of joint constraints nc.
    pub fn constraints(&self) -> usize {
        either!(self, m => m.constraints())
    }

    /// Hands each constraint function to `each`: its row, its coordinates (`usize::MAX` for the ground, nq and more for bodies
    /// whose motion is given), value, gradient and Hessian over those. `q`: all coordinates, the given ones last.
    pub fn constraint_functions<T: Scalar>(&self, q: &[T], each: impl FnMut(usize, &[usize], T, &[T], &[T])) {
        either!(self, m => m.constraint_functions(q, each));
    }

    /// The coordinates of each constraint that are unknowns.
    pub fn constraint_slots(&self) -> Vec<Vec<usize>> {
        let nq = self.coordinates();
        let unknown = |slots: &[usize]| slots.iter().copied().filter(|&slot| slot < nq).collect::<Vec<_>>();
        match self {
            Mechanics::Planar(planar) => (planar.joints.iter())
                .flat_map(|joint| {
                    let slots = unknown(&joint.slots().map(|slot| slot.unwrap_or(usize::MAX)));
                    vec![slots; joint.kind.constraints()]
                })
                .collect(),
            Mechanics::Spatial(spatial) => {
                spatial.joints.iter().flat_map(|joint| vec![unknown(&joint.slots()); joint.constraints()]).collect()
            }
        }
    }

    /// Inertial forces less gravity and external forces, `M q̈ + (quadratic velocity terms) − g_ext`, N and N m.
    /// `loads`: each external force in the ground's axes (N), planar ones with their moment (N m) third.
    pub fn force(&self, motion: Motion<'_>, loads: &[[f64; 3]], out: &mut [f64]) {
        either!(self, m => m.force(motion, loads, out));
    }

    /// Hands the non-zero derivatives of [`Mechanics::force`] to `each`: row, by what, which of it, value.
    pub fn slopes(&self, motion: Motion<'_>, loads: &[[f64; 3]], each: impl FnMut(usize, Level, usize, f64)) {
        either!(self, m => m.slopes(motion, loads, each));
    }

    /// Hands the non-zero second derivatives of `λᵀ force` to `each`, both of a symmetric pair.
    pub fn bends(
        &self,
        motion: Motion<'_>,
        loads: &[[f64; 3]],
        lambda: &[f64],
        each: impl FnMut((Level, usize), (Level, usize), f64),
    ) {
        either!(self, m => m.bends(motion, loads, lambda, each));
    }

    /// Each body as a line over points in the ground frame (m), from the joints that hold it to those that it holds and the external forces
    /// on it; over its centre of mass where these are fewer than two. `q`: all coordinates.
    pub fn bones(&self, q: &[f64]) -> Vec<(&str, Vec<Vec<f64>>)> {
        either!(self, m => m.bones(q))
    }

    /// Everything that [`Mechanics::slopes`] can hand out.
    pub fn slope_pattern(&self) -> Vec<(usize, Level, usize)> {
        let nq = self.coordinates();
        match self {
            Mechanics::Planar(_) => {
                (0..nq).flat_map(|i| [Level::Coordinate, Level::Acceleration].map(|level| (i, level, i))).collect()
            }
            Mechanics::Spatial(_) => {
                use super::spatial::joint::PER_BODY;
                let mut pattern: Vec<(usize, Level, usize)> = (0..nq).map(|i| (i, Level::Acceleration, i)).collect();
                for i in (0..nq).filter(|i| i % PER_BODY >= 3) {
                    for j in i / PER_BODY * PER_BODY + 3..(i / PER_BODY + 1) * PER_BODY {
                        let levels = [Level::Coordinate, Level::Velocity, Level::Acceleration];
                        pattern.extend(levels.map(|level| (i, level, j)));
                    }
                }
                pattern
            }
        }
    }

    /// Every pair of [`Mechanics::bends`].
    pub fn bend_pattern(&self) -> Vec<((Level, usize), (Level, usize))> {
        use Level::{Acceleration, Coordinate, Velocity};
        let pairs: &[(Level, Level)] = match self {
            Mechanics::Planar(_) => &[(Coordinate, Coordinate)],
            Mechanics::Spatial(_) => &[
                (Coordinate, Coordinate),
                (Velocity, Velocity),
                (Velocity, Coordinate),
                (Coordinate, Velocity),
                (Acceleration, Coordinate),
                (Coordinate, Acceleration),
            ],
        };
        let places = self.slope_pattern().into_iter().filter(|(_, level, _)| *level == Coordinate);
        places.flat_map(|(i, _, j)| pairs.iter().map(move |&(a, b)| ((a, i), (b, j)))).collect()
    }
}

/// The line of a bone; see [`Mechanics::bones`].
pub(super) fn through(
    first: impl Iterator<Item = Vec<f64>>,
    centre: Vec<f64>,
    last: impl Iterator<Item = Vec<f64>>,
) -> Vec<Vec<f64>> {
    let (mut line, last): (Vec<_>, Vec<_>) = (first.collect(), last.collect());
    if line.len() + last.len() < 2 {
        line.push(centre);
    }
    line.extend(last);
    line
}
