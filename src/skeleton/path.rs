//! Length of a muscle's path in a pose, and its slopes by the joint coordinates.
//!
//! The path is the shortest that goes over its points and around its surfaces. Where it touches a surface it slides without
//! changing its length to first order, so only its straight parts count for the slope (the envelope theorem):
//!
//! ```text
//! ∂L/∂q = Σ over straight parts  û·(∂b/∂q − ∂a/∂q),   contacts moving with their surface's body
//! ```

use std::cell::RefCell;
use std::hash::{DefaultHasher, Hash, Hasher};

use num_dual::Dual64;

use super::Skeleton;
use super::frame::{Frame, Vector, minus, norm, unit};
use super::function::Function;
use super::surface::{Contact, Shape};
use crate::numerics::Scalar;

/// A muscle's way: points, and surfaces that may come between any two of them.
#[derive(Clone, Debug)]
pub struct MusclePath {
    pub points: Vec<PathPoint>,
    /// In the order in which the path meets them.
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
    /// Whether it is in the way between these two points of the path.
    pub fn meets(&self, from: usize, to: usize) -> bool {
        self.parts.is_none_or(|[first, last]| first <= from && to <= last + 1)
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

/// Paths kept to be asked for again: functions, Jacobian and Hessian of a problem all want those of the same instant.
const KEPT: usize = 1 << 13;

/// All that the contacts depend on, to the last bit, and the contacts.
type Kept = (Vec<u64>, Vec<Option<Contact>>);

thread_local! {
    static WAYS: RefCell<Vec<Option<Kept>>> = RefCell::new(vec![None; KEPT]);
}

/// A path in one pose.
pub struct Routed<'p> {
    /// m
    pub length: f64,
    /// Indices of the surfaces that it touches.
    pub touched: Vec<usize>,
    /// Ends of each straight part.
    straight: Vec<(Corner<'p>, Corner<'p>)>,
}

/// Rounds of looking at each surface again until contacts stand still.
const ROUNDS: usize = 500;
const STILL: f64 = 1e-14;

impl MusclePath {
    /// The way the path takes with the bodies where `frames` says.
    pub fn route<'p>(&'p self, skeleton: &Skeleton, q: &[f64], frames: &[Frame<f64>]) -> Routed<'p> {
        let mut routed = Routed { length: 0.0, touched: Vec::new(), straight: Vec::new() };
        let at = |point: &PathPoint| frames[point.body].point(&point.local(q));
        let met: Vec<usize> = (0..self.points.len()).filter(|&i| self.points[i].is_met(q)).collect();
        for pair in met.windows(2) {
            let ends = [&self.points[pair[0]], &self.points[pair[1]]];
            let (a, b) = (at(ends[0]), at(ends[1]));
            let met = self.surfaces.iter().filter(|obstacle| obstacle.meets(pair[0], pair[1]));
            let surfaces: Vec<usize> = met.map(|obstacle| obstacle.surface).collect();
            let places: Vec<(Frame<f64>, &Shape)> = (surfaces.iter().map(|&s| &skeleton.surfaces[s]))
                .map(|surface| (frames[surface.body] * surface.frame, &surface.shape))
                .collect();
            let contacts = contacts(&places, &a, &b, &[]);
            let (mut from, mut place) = (Corner::Point(ends[0]), a);
            for (&surface, contact) in surfaces.iter().zip(&contacts) {
                let Some(contact) = contact else { continue };
                let body = skeleton.surfaces[surface].body;
                let corner = |x: &Vector| Corner::Contact(body, frames[body].inverse().point(x));
                routed.length += norm(&minus(&contact.first, &place)) + contact.length;
                routed.straight.push((from, corner(&contact.first)));
                routed.touched.push(surface);
                (from, place) = (corner(&contact.last), contact.last);
            }
            routed.length += norm(&minus(&b, &place));
            routed.straight.push((from, Corner::Point(ends[1])));
        }
        routed
    }
}

/// Contacts with all surfaces between two points, in the ground's frame, from where each surface is. `near`: the contacts of a
/// path nearby, one a surface, or nothing.
pub fn contacts(
    places: &[(Frame<f64>, &Shape)],
    a: &Vector,
    b: &Vector,
    near: &[Option<Contact>],
) -> Vec<Option<Contact>> {
    // A path found from one nearby is not asked for again, and differs by rounding from one found afresh: it is not kept.
    if !near.is_empty() {
        return settle(places, a, b, near.to_vec());
    }
    let of_places = places
        .iter()
        .flat_map(|(frame, shape)| frame.axes.into_iter().flatten().chain(frame.origin).chain(shape.sizes()));
    let key: Vec<u64> = of_places.chain(*a).chain(*b).map(f64::to_bits).collect();
    let mut hasher = DefaultHasher::new();
    key.hash(&mut hasher);
    let slot = hasher.finish() as usize % KEPT;
    WAYS.with_borrow_mut(|ways| match &ways[slot] {
        Some((kept, contacts)) if *kept == key => contacts.clone(),
        _ => {
            let contacts = settle(places, a, b, vec![None; places.len()]);
            ways[slot] = Some((key, contacts.clone()));
            contacts
        }
    })
}

/// Each contact between those it lies between, again and again until nothing moves.
fn settle(
    places: &[(Frame<f64>, &Shape)],
    a: &Vector,
    b: &Vector,
    mut contacts: Vec<Option<Contact>>,
) -> Vec<Option<Contact>> {
    for _ in 0..ROUNDS {
        let mut moved = 0.0f64;
        for (k, (place, shape)) in places.iter().enumerate() {
            let before = contacts[..k].iter().rev().flatten().next().map_or(*a, |contact| contact.last);
            let after = contacts[k + 1..].iter().flatten().next().map_or(*b, |contact| contact.first);
            let inside = place.inverse();
            let seen_from = |frame: &Frame<f64>, contact: Contact| Contact {
                first: frame.point(&contact.first),
                last: frame.point(&contact.last),
                ..contact
            };
            let near = contacts[k].map(|contact| seen_from(&inside, contact));
            let found = shape.contact_near(&inside.point(&before), &inside.point(&after), near.as_ref());
            let found = found.map(|contact| seen_from(place, contact));
            let apart = |old: &Contact, new: &Contact| {
                norm(&minus(&old.first, &new.first)).max(norm(&minus(&old.last, &new.last)))
            };
            moved = moved.max(match (&contacts[k], &found) {
                (Some(old), Some(new)) => apart(old, new),
                (None, None) => 0.0,
                _ => 1.0,
            });
            contacts[k] = found;
        }
        if moved <= STILL || places.len() == 1 {
            break;
        }
    }
    contacts
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
            for (routed, (_, arms)) in routed.iter().zip(&mut found) {
                arms.push(-routed.slope(&seeded, &frames));
            }
        }
        found
    }
}
