//! A function of one joint coordinate that a path depends on, over the unknowns.

use crate::model::spatial::linkage::Linkage;
use crate::model::tree::Drive;
use crate::skeleton::Skeleton;
use crate::skeleton::ball::Ball;
use crate::skeleton::function::Function;

#[derive(Clone, Debug)]
pub struct Mover {
    how: How,
    /// Coordinates of the tree, at most two; and their slots, if they move by forces.
    coordinates: Vec<usize>,
    slots: Vec<Option<usize>>,
}

#[derive(Clone, Debug)]
enum How {
    OfCoordinate(Drive),
    /// Of the elevation of a ball joint, a function of two angles.
    OfElevation(Box<Ball>, Function),
}

/// A function of unknowns with its derivatives.
#[derive(Clone, Debug)]
pub struct Moved {
    pub value: f64,
    /// (slot, slope)
    pub gradient: Vec<(usize, f64)>,
    /// (slot, slot, second derivative), both of a symmetric pair.
    pub hessian: Vec<(usize, usize, f64)>,
}

impl Mover {
    /// By a function of a coordinate of the skeleton.
    pub fn new(skeleton: &Skeleton, linkage: &Linkage, coordinate: usize, by: &Function) -> Self {
        let (how, coordinates) = match linkage.ball_of(coordinate) {
            None => {
                let drive = Drive::by(skeleton, coordinate, by);
                let leader = drive.terms[0].0;
                (How::OfCoordinate(drive), vec![leader])
            }
            Some((k, _)) => {
                let angles = vec![linkage.ball_angle(k, 0), linkage.ball_angle(k, 1)];
                (How::OfElevation(Box::new(linkage.balls[k].clone()), by.clone()), angles)
            }
        };
        Self { how, slots: vec![None; coordinates.len()], coordinates }
    }

    pub fn coordinates(&self) -> &[usize] {
        &self.coordinates
    }

    /// Says which slot each coordinate has.
    pub fn placed(mut self, slot: impl Fn(usize) -> Option<usize>) -> Self {
        self.slots = self.coordinates.iter().map(|&c| slot(c)).collect();
        self
    }

    /// The value at these values of the tree's coordinates.
    pub fn value(&self, coordinates: &[f64]) -> f64 {
        match &self.how {
            How::OfCoordinate(drive) => drive.bent(drive.argument(coordinates))[0],
            How::OfElevation(ball, by) => by.at(self.elevation(ball, coordinates).value),
        }
    }

    pub fn at(&self, coordinates: &[f64]) -> Moved {
        let (value, gradient, hessian) = match &self.how {
            How::OfCoordinate(drive) => {
                let [value, slope, bend] = drive.bent(drive.argument(coordinates));
                (value, [slope, 0.0], [[bend, 0.0], [0.0, 0.0]])
            }
            How::OfElevation(ball, by) => {
                let inner = self.elevation(ball, coordinates);
                let [value, slope, bend, ..] = by.derivatives(inner.value);
                let [x, y] = inner.gradient;
                let second = |i: usize, j: usize| bend * [x, y][i] * [x, y][j] + slope * inner.hessian[i][j];
                (value, [slope * x, slope * y], [0, 1].map(|i| [0, 1].map(|j| second(i, j))))
            }
        };
        let slots = || self.slots.iter().enumerate().filter_map(|(i, slot)| Some((i, (*slot)?)));
        let pairs = slots().flat_map(|(i, one)| slots().map(move |(j, other)| (one, other, hessian[i][j])));
        Moved { value, gradient: slots().map(|(i, slot)| (slot, gradient[i])).collect(), hessian: pairs.collect() }
    }

    fn elevation(&self, ball: &Ball, coordinates: &[f64]) -> crate::skeleton::ball::OfAngles {
        let [alpha, beta] = [0, 1].map(|i| coordinates[self.coordinates[i]]);
        ball.elevation(alpha, beta).expect("checked with the study")
    }
}
