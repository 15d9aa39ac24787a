//! Length of a muscle's path in a pose, and its slopes by the joint coordinates.
//!
//! The path is the shortest that goes over its points and around its surfaces. Where it touches a surface it slides without
//! changing its length to first order, so only its straight parts count for the slope (the envelope theorem):
//!
//! ```text
//! ∂L/∂q = Σ over straight parts  û·(∂b/∂q − ∂a/∂q),   contacts moving with their surface's body
//! ```

use num_dual::Dual64;

use super::frame::{Frame, Vector, minus, norm, unit};
use super::function::Function;
use super::surface::Shape;
use super::wrapping::{Placed, touches};
use super::{Muscle, Skeleton};
use crate::numerics::Scalar;

/// Step of differences of lengths, rad or m.
const DIFFERENCE: f64 = 1e-5;

/// A muscle's way: points, and surfaces that may come between any two of them.
#[derive(Clone, Debug)]
pub struct MusclePath {
    pub points: Vec<PathPoint>,
    /// In the order in which they are put on the path, see [`super::wrapping`].
    pub surfaces: Vec<Obstacle>,
}

/// A surface in the way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Obstacle {
    /// Index of the surface.
    pub surface: usize,
    /// First and last of the parts of the path (from 0, between two points) that it is in the way of; any if `None`.
    pub parts: Option<[usize; 2]>,
}

impl Obstacle {
    /// First and last of the segments between the points `met` that it may be on, all for `Some(None)`; `None` if there is none.
    fn segments(&self, met: &[usize]) -> Option<Option<[usize; 2]>> {
        let Some([first, last]) = self.parts else { return Some(None) };
        let from = met.iter().position(|&point| point >= first)?;
        let to = met.iter().rposition(|&point| point <= last + 1)?;
        (from < to).then_some(Some([from, to - 1]))
    }
}

/// A point of a path, fixed to a body but for what it moves with coordinates.
#[derive(Clone, Debug)]
pub struct PathPoint {
    pub body: usize,
    /// In the body's frame, m.
    pub point: Vector,
    /// What is added to it.
    pub moves: Vec<Move>,
    /// The path goes over the point only while a coordinate (rad, m) is in a range, its ends included.
    pub when: Option<(usize, [f64; 2])>,
}

/// A component (0: x, 1: y, 2: z) of a point moves by a function (m) of a coordinate.
#[derive(Clone, Debug)]
pub struct Move {
    pub component: usize,
    pub coordinate: usize,
    pub by: Function,
}

impl PathPoint {
    /// In the body's frame, in a pose.
    pub fn local<T: Scalar>(&self, q: &[T]) -> [T; 3] {
        let mut local = self.point.map(T::from);
        for Move { component, coordinate, by } in &self.moves {
            local[*component] += by.at(q[*coordinate]);
        }
        local
    }

    /// Whether the path goes over it in a pose.
    pub fn is_met(&self, q: &[f64]) -> bool {
        self.when.is_none_or(|(coordinate, [low, high])| (low..=high).contains(&q[coordinate]))
    }

    /// The coordinate and the slopes (m/rad) of a point that moves in proportion to one coordinate, with where it is at 0.
    pub fn in_proportion(&self) -> Option<(usize, Vector, Vector)> {
        let coordinate = self.moves.first()?.coordinate;
        let (mut point, mut slope) = (self.point, [0.0; 3]);
        for moved in &self.moves {
            let [offset, factor] = moved.by.line().filter(|_| moved.coordinate == coordinate)?;
            point[moved.component] += offset;
            slope[moved.component] += factor;
        }
        Some((coordinate, slope, point))
    }
}

/// A corner of the path: one of its points, or where it comes to or leaves a surface.
#[derive(Clone, Copy, Debug)]
enum Corner<'p> {
    Point(&'p PathPoint),
    /// On a body, at a place of its frame.
    Contact(usize, Vector),
}

/// A path in one pose.
pub struct Routed<'p> {
    /// m
    pub length: f64,
    /// Indices of the surfaces that it touches.
    pub touched: Vec<usize>,
    /// Whether it touches a torus, which is no fixed surface: the slope is then that of differences.
    pub through_torus: bool,
    /// Ends of each straight part.
    straight: Vec<(Corner<'p>, Corner<'p>)>,
}

impl MusclePath {
    /// The way the path takes with the bodies where `frames` says.
    pub fn route<'p>(&'p self, skeleton: &Skeleton, q: &[f64], frames: &[Frame<f64>]) -> Routed<'p> {
        let met: Vec<usize> = (0..self.points.len()).filter(|&i| self.points[i].is_met(q)).collect();
        let place = |&i: &usize| frames[self.points[i].body].point(&self.points[i].local(q));
        let places: Vec<Vector> = met.iter().map(place).collect();
        let mut routed = Routed { length: 0.0, touched: Vec::new(), straight: Vec::new(), through_torus: false };
        if met.len() < 2 {
            return routed;
        }
        let known: Vec<(usize, Placed<'_>)> = (self.surfaces.iter())
            .filter_map(|obstacle| {
                let segments = obstacle.segments(&met)?;
                let surface = &skeleton.surfaces[obstacle.surface];
                let frame = frames[surface.body] * surface.frame;
                Some((obstacle.surface, Placed { frame, shape: &surface.shape, segments }))
            })
            .collect();
        let (surfaces, placed): (Vec<usize>, Vec<Placed<'_>>) = known.into_iter().unzip();
        let touches = touches(&places, &placed, &[]);
        let mut touches = touches.iter().peekable();
        for (segment, pair) in met.windows(2).enumerate() {
            let (mut from, mut place) = (Corner::Point(&self.points[pair[0]]), places[segment]);
            while let Some(touch) = touches.next_if(|touch| touch.segment == segment) {
                let surface = surfaces[touch.surface];
                let body = skeleton.surfaces[surface].body;
                let corner = |x: &Vector| Corner::Contact(body, frames[body].inverse().point(x));
                let contact = &touch.contact;
                routed.length += norm(&minus(&contact.first, &place)) + contact.length;
                routed.straight.push((from, corner(&contact.first)));
                routed.touched.push(surface);
                routed.through_torus |= matches!(skeleton.surfaces[surface].shape, Shape::Torus { .. });
                (from, place) = (corner(&contact.last), contact.last);
            }
            routed.length += norm(&minus(&places[segment + 1], &place));
            routed.straight.push((from, Corner::Point(&self.points[pair[1]])));
        }
        routed
    }
}

impl Routed<'_> {
    /// ∂L/∂q of one coordinate, m/rad (or 1), from the frames of the bodies at q + ε of that coordinate.
    pub fn slope(&self, q: &[Dual64], frames: &[Frame<Dual64>]) -> f64 {
        let place = |corner: &Corner<'_>| match corner {
            Corner::Point(point) => frames[point.body].point(&point.local(q)),
            Corner::Contact(body, x) => frames[*body].point(&x.map(Dual64::from)),
        };
        let part = |(from, to): &(Corner<'_>, Corner<'_>)| {
            let (a, b) = (place(from), place(to));
            let way = unit(&[0, 1, 2].map(|i| b[i].re - a[i].re));
            (0..3).map(|i| way[i] * (b[i].eps - a[i].eps)).sum::<f64>()
        };
        self.straight.iter().map(part).sum()
    }
}

impl Skeleton {
    /// Length of each muscle (m) and its moment arms −∂L/∂q by each coordinate (m for angles), in a pose. Coordinates that follow another
    /// one go with it; their own moment arms are those of the coordinate alone.
    pub fn lengths_and_moment_arms(&self, q: &[f64]) -> Vec<(f64, Vec<f64>)> {
        let mut q = q.to_vec();
        self.follow(&mut q);
        let q = &q[..];
        let frames = self.frames(q);
        let routed: Vec<Routed<'_>> = self.muscles.iter().map(|m| m.path.route(self, q, &frames)).collect();
        let mut found: Vec<(f64, Vec<f64>)> = routed.iter().map(|r| (r.length, Vec::new())).collect();
        for k in 0..q.len() {
            let mut seeded: Vec<Dual64> =
                q.iter().enumerate().map(|(i, &x)| Dual64::new(x, f64::from(i == k))).collect();
            if self.coordinates[k].follows.is_none() {
                self.follow(&mut seeded);
            }
            let frames = self.frames(&seeded);
            for ((routed, muscle), (_, arms)) in routed.iter().zip(&self.muscles).zip(&mut found) {
                arms.push(match routed.through_torus {
                    false => -routed.slope(&seeded, &frames),
                    true => -self.slope_by_differences(muscle, q, k),
                });
            }
        }
        found
    }

    /// ∂L/∂q of one coordinate, those that follow it going with it.
    fn slope_by_differences(&self, muscle: &Muscle, q: &[f64], k: usize) -> f64 {
        let length = |step: f64| {
            let mut q = q.to_vec();
            q[k] += step;
            if self.coordinates[k].follows.is_none() {
                self.follow(&mut q);
            }
            muscle.path.route(self, &q, &self.frames(&q)).length
        };
        (length(DIFFERENCE) - length(-DIFFERENCE)) / (2.0 * DIFFERENCE)
    }
}
