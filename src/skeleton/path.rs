//! Length L of a muscle path in a pose, and its derivatives with respect to the joint coordinates q.
//!
//! The path is the shortest one through its points and around its surfaces. A contact slides on its surface without
//! changing the length to first order, so that only the straight parts contribute (envelope theorem):
//!
//! ```text
//! ∂L/∂q = Σ over straight parts  û·(∂b/∂q − ∂a/∂q)
//! ```
//!
//! A straight part runs from a to b in the direction of the unit vector û. Contacts are fixed to their surface's body.

use num_dual::Dual64;

use super::frame::{Frame, Vector, minus, norm, unit};
use super::function::Function;
use super::surface::Shape;
use super::wrapping::{PlacedSurface, touches};
use super::{Muscle, Skeleton};
use crate::numerics::Scalar;

/// Step of the central differences of a length, rad or m.
const DIFFERENCE_STEP: f64 = 1e-5;

/// A muscle path: its points, and the surfaces that it may wrap between them.
#[derive(Clone, Debug)]
pub struct MusclePath {
    pub points: Vec<PathPoint>,
    /// In the order in which they are placed on the path, see [`super::wrapping`].
    pub surfaces: Vec<Obstacle>,
}

/// A surface that a path may wrap.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Obstacle {
    /// Index of the surface.
    pub surface: usize,
    /// First and last part of the path that may wrap it; any if `None`. Part k lies between points k and k + 1.
    pub parts: Option<[usize; 2]>,
}

impl Obstacle {
    /// Translates `parts` to the first and last segment between the active points `active` (indices, increasing):
    /// `Some(None)` if any segment may wrap the surface, `None` if none is left.
    pub fn segments(&self, active: &[usize]) -> Option<Option<[usize; 2]>> {
        let Some([first, last]) = self.parts else { return Some(None) };
        let from = active.iter().position(|&point| point >= first)?;
        let to = active.iter().rposition(|&point| point <= last + 1)?;
        (from < to).then_some(Some([from, to - 1]))
    }
}

/// A path point. It is fixed to a body, apart from displacements driven by coordinates.
#[derive(Clone, Debug)]
pub struct PathPoint {
    pub body: usize,
    /// In the body's frame, m.
    pub point: Vector,
    /// Displacements added to `point`.
    pub moves: Vec<Move>,
    /// If given, the path passes through the point only while a coordinate (rad, m) is in the closed range.
    pub when: Option<(usize, [f64; 2])>,
}

/// Displacement of one component (0: x, 1: y, 2: z) of a point by a function (m) of a coordinate.
#[derive(Clone, Debug)]
pub struct Move {
    pub component: usize,
    pub coordinate: usize,
    pub by: Function,
}

impl PathPoint {
    /// Position in the body's frame in the pose `q`, m.
    pub fn local<T: Scalar>(&self, q: &[T]) -> [T; 3] {
        let mut local = self.point.map(T::from);
        for Move { component, coordinate, by } in &self.moves {
            local[*component] += by.at(q[*coordinate]);
        }
        local
    }

    /// True if the path passes through the point in the pose `q`.
    pub fn is_active(&self, q: &[f64]) -> bool {
        self.when.is_none_or(|(coordinate, [low, high])| (low..=high).contains(&q[coordinate]))
    }

    /// For a point that moves linearly with a single coordinate: the coordinate, the slope (m/rad), and the position at
    /// coordinate 0 (m). `None` for all other points.
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

/// An end of a straight part: a path point, or a point where the path meets or leaves a surface.
#[derive(Clone, Copy, Debug)]
enum Corner<'p> {
    Point(&'p PathPoint),
    /// A body, and a position in its frame.
    Contact(usize, Vector),
}

/// The course of a path in one pose.
pub struct Routed<'p> {
    /// m
    pub length: f64,
    /// Indices of the surfaces that it touches.
    pub touched: Vec<usize>,
    /// True if it touches a torus. The cylinder that replaces the torus moves with the path, so that the derivative
    /// must be taken by differences.
    pub through_torus: bool,
    /// Ends of each straight part.
    straight: Vec<(Corner<'p>, Corner<'p>)>,
}

impl MusclePath {
    /// The course of the path in the pose `q`, with the bodies at `frames`.
    pub fn route<'p>(&'p self, skeleton: &Skeleton, q: &[f64], frames: &[Frame<f64>]) -> Routed<'p> {
        let active: Vec<usize> = (0..self.points.len()).filter(|&i| self.points[i].is_active(q)).collect();
        let place = |&i: &usize| frames[self.points[i].body].point(&self.points[i].local(q));
        let places: Vec<Vector> = active.iter().map(place).collect();
        let mut routed = Routed { length: 0.0, touched: Vec::new(), straight: Vec::new(), through_torus: false };
        if active.len() < 2 {
            return routed;
        }
        let known: Vec<(usize, PlacedSurface<'_>)> = (self.surfaces.iter())
            .filter_map(|obstacle| {
                let segments = obstacle.segments(&active)?;
                let surface = &skeleton.surfaces[obstacle.surface];
                let frame = frames[surface.body] * surface.frame;
                Some((obstacle.surface, PlacedSurface { frame, shape: &surface.shape, segments }))
            })
            .collect();
        let (surfaces, placed): (Vec<usize>, Vec<PlacedSurface<'_>>) = known.into_iter().unzip();
        let touches = touches(&places, &placed, &[]);
        let mut touches = touches.iter().peekable();
        for (segment, pair) in active.windows(2).enumerate() {
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

/// A straight part of a path: the bodies at its ends, and those in the ground's frame (m).
pub struct StraightPart {
    pub bodies: [usize; 2],
    pub ends: [Vector; 2],
}

impl Routed<'_> {
    /// The straight parts, in the pose in which the path was routed.
    pub fn straight_parts(&self, frames: &[Frame<f64>], q: &[f64]) -> impl Iterator<Item = StraightPart> {
        let end = |corner: &Corner<'_>| match corner {
            Corner::Point(point) => (point.body, frames[point.body].point(&point.local(q))),
            Corner::Contact(body, x) => (*body, frames[*body].point(x)),
        };
        self.straight.iter().map(move |(from, to)| {
            let ((one, start), (other, stop)) = (end(from), end(to));
            StraightPart { bodies: [one, other], ends: [start, stop] }
        })
    }

    /// ∂L/∂q of one coordinate, m/rad (dimensionless for a displacement). The dual parts of `q` and `frames` are the
    /// derivatives with respect to that coordinate.
    pub fn slope(&self, q: &[Dual64], frames: &[Frame<Dual64>]) -> f64 {
        let place = |corner: &Corner<'_>| match corner {
            Corner::Point(point) => frames[point.body].point(&point.local(q)),
            Corner::Contact(body, x) => frames[*body].point(&x.map(Dual64::from)),
        };
        let part = |(from, to): &(Corner<'_>, Corner<'_>)| {
            let (a, b) = (place(from), place(to));
            let direction = unit(&[0, 1, 2].map(|i| b[i].re - a[i].re));
            (0..3).map(|i| direction[i] * (b[i].eps - a[i].eps)).sum::<f64>()
        };
        self.straight.iter().map(part).sum()
    }
}

impl Skeleton {
    /// Length (m) of each muscle and its moment arms −∂L/∂q (m for angles) for all coordinates, in the pose `q`.
    ///
    /// Coordinates that follow another one move with it. Their own moment arms are for a change of them alone.
    pub fn lengths_and_moment_arms(&self, q: &[f64]) -> Vec<(f64, Vec<f64>)> {
        let mut q = q.to_vec();
        self.follow(&mut q);
        let q = &q[..];
        let frames = self.frames(q);
        let routed: Vec<Routed<'_>> = self.muscles.iter().map(|m| m.path.route(self, q, &frames)).collect();
        let fitted = |muscle: &Muscle| muscle.length.as_ref().map(|length| length.of(q));
        let length = |(routed, muscle): (&Routed<'_>, &Muscle)| fitted(muscle).unwrap_or(routed.length);
        let mut found: Vec<(f64, Vec<f64>)> =
            routed.iter().zip(&self.muscles).map(|both| (length(both), Vec::new())).collect();
        for k in 0..q.len() {
            let mut seeded: Vec<Dual64> =
                q.iter().enumerate().map(|(i, &x)| Dual64::new(x, f64::from(i == k))).collect();
            if self.coordinates[k].follows.is_none() {
                self.follow(&mut seeded);
            }
            let frames = self.frames(&seeded);
            for ((routed, muscle), (_, arms)) in routed.iter().zip(&self.muscles).zip(&mut found) {
                arms.push(match (&muscle.length, routed.through_torus) {
                    (Some(length), _) => -length.of(&seeded).eps,
                    (None, false) => -routed.slope(&seeded, &frames),
                    (None, true) => -self.slope_by_differences(muscle, q, k),
                });
            }
        }
        found
    }

    /// ∂L/∂q of coordinate `k` by central differences. Coordinates that follow it move with it.
    fn slope_by_differences(&self, muscle: &Muscle, q: &[f64], k: usize) -> f64 {
        let length = |step: f64| {
            let mut q = q.to_vec();
            q[k] += step;
            if self.coordinates[k].follows.is_none() {
                self.follow(&mut q);
            }
            muscle.path.route(self, &q, &self.frames(&q)).length
        };
        (length(DIFFERENCE_STEP) - length(-DIFFERENCE_STEP)) / (2.0 * DIFFERENCE_STEP)
    }
}
