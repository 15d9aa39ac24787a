//! Eq. (1), the equation of motion, without joints and muscles (thesis, Paper B):
//!
//! ```text
//! (M q̈ + quadratic velocity terms − g_ext)/W + … = 0
//! ```
//!
//! | symbol | meaning | unit |
//! |---|---|---|
//! | q, q̇, q̈ | coordinates and their derivatives | m, rad; per s; per s² |
//! | M | mass matrix | kg, kg m² |
//! | g_ext | gravity and external forces | N, N m |
//! | W | total weight, the unit of this equation | N |
//!
//! The quadratic velocity terms are those of joint coordinates in space; the thesis' planar bodies have none.

use crate::model::Mechanics;
use crate::model::mechanics::{Level, Motion};
use crate::problem::block::{Block, Order, Sink};
use crate::problem::quantity::Span;

pub struct EquationOfMotion<'m> {
    pub mechanics: &'m dyn Mechanics,
    /// W, N
    pub weight: f64,
    /// All coordinates, those of given motion last.
    pub coordinates: Span,
    /// Their rates, where the equation has them.
    pub velocities: Option<Span>,
    /// Their accelerations.
    pub accelerations: Span,
    /// Three components of each external force; see [`Mechanics::force`].
    pub loads: Span,
    pub rows: Span,
}

impl EquationOfMotion<'_> {
    fn place(&self, (level, i): (Level, usize)) -> usize {
        match level {
            Level::Coordinate => self.coordinates.at(i),
            Level::Velocity => self.velocities.expect("an equation with velocities has them").at(i),
            Level::Acceleration => self.accelerations.at(i),
        }
    }
}

impl Block for EquationOfMotion<'_> {
    fn evaluate(&self, z: &[f64], out: &mut Sink<'_>) {
        let motion = Motion {
            q: self.coordinates.of(z),
            velocity: self.velocities.map_or(&[], |span| span.of(z)),
            acceleration: self.accelerations.of(z),
        };
        let (loads, _) = self.loads.of(z).as_chunks::<3>();
        if out.wants(Order::Values) {
            let mut force = vec![0.0; self.rows.count];
            self.mechanics.force(motion, loads, &mut force);
            force.iter().enumerate().for_each(|(i, force)| out.value(self.rows.at(i), force / self.weight));
        } else if out.wants(Order::Slopes) {
            self.mechanics.slopes(motion, loads, &mut |row, level, i, value| {
                out.slope(self.rows.at(row), self.place((level, i)), value / self.weight);
            });
        } else {
            let lambda: Vec<f64> = self.rows.range().map(|row| out.multiplier(row)).collect();
            self.mechanics.bends(motion, loads, &lambda, &mut |one, other, value| {
                let (one, other) = (self.place(one), self.place(other));
                if one <= other {
                    out.bend(one, other, value / self.weight);
                }
            });
        }
    }

    fn convex_groups(&self) -> Vec<Vec<usize>> {
        vec![self.coordinates.range().take(self.rows.count).collect()]
    }

    fn weigh(&self, _z: &[f64], weights: &mut [f64]) {
        weights[self.coordinates.range()].fill(1.0);
    }
}
