//! Which surfaces a path wraps, between which of its points, and where it touches them.
//!
//! Where to wrap is decided as OpenSim decides it (`GeometryPath::applyWrapObjects`, version 4.6), so that imported models have the
//! lengths they have there: surface after surface is taken off the path and put on the segment that it makes longer by the least, or on the
//! first one that runs through it. That is repeated until the length changes by less than 0.5 mm, at most eight times.
//!
//! DEPARTURE [OpenSim]: there the path ends like that. Here the contacts then move until none of them changes, each surface staying on its
//! segment, so that the path is taut, its length continuous and its slope that of the envelope theorem.

use std::cell::RefCell;
use std::hash::{DefaultHasher, Hash, Hasher};

use super::frame::{Frame, Vector, minus, norm};
use super::surface::{Contact, Shape, Wrap};

/// A surface in a pose.
pub struct Placed<'s> {
    /// In the ground's frame.
    pub frame: Frame<f64>,
    pub shape: &'s Shape,
    /// First and last of the segments that it may be on.
    pub segments: Option<[usize; 2]>,
}

/// A surface that the path touches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// Index of the surface among those of the path.
    pub surface: usize,
    /// Index of the segment, from 0 between the first two points.
    pub segment: usize,
    /// In the ground's frame.
    pub contact: Contact,
}

/// Times that each surface is put anew where it makes the path longer by the least.
const PLACINGS: usize = 8;
/// Placing ends when the length changes by less than this, m.
const PLACED: f64 = 5e-4;
/// Rounds of looking at each contact again until all stand still, and what counts as still, m.
const ROUNDS: usize = 500;
const STILL: f64 = 1e-14;

/// Paths kept to be asked for again: functions, Jacobian and Hessian of a problem all want those of the same instant.
const KEPT: usize = 1 << 13;

/// All that a path depends on, to the last bit, and what it touches.
type Kept = (Vec<u64>, Vec<Touch>);

thread_local! {
    static PATHS: RefCell<Vec<Option<Kept>>> = RefCell::new(vec![None; KEPT]);
}

/// The surfaces that the path over `points` (in the ground's frame) touches, in its order. `near`: those of a path nearby, or nothing.
pub fn touches(points: &[Vector], surfaces: &[Placed<'_>], near: &[Touch]) -> Vec<Touch> {
    if surfaces.is_empty() {
        return Vec::new();
    }
    // A path found from one nearby is not asked for again, and differs by rounding from one found afresh: it is not kept.
    if !near.is_empty() {
        return Tracing::new(points, surfaces).settled(near);
    }
    let of_surfaces = surfaces.iter().flat_map(|surface| {
        let [first, last] = surface.segments.map_or([f64::NAN; 2], |segments| segments.map(|s| s as f64));
        let frame = surface.frame.axes.into_iter().flatten().chain(surface.frame.origin);
        frame.chain(surface.shape.sizes()).chain([first, last])
    });
    let key: Vec<u64> = of_surfaces.chain(points.iter().flatten().copied()).map(f64::to_bits).collect();
    let mut hasher = DefaultHasher::new();
    key.hash(&mut hasher);
    let slot = hasher.finish() as usize % KEPT;
    PATHS.with_borrow_mut(|paths| match &paths[slot] {
        Some((kept, touches)) if *kept == key => touches.clone(),
        _ => {
            let touches = Tracing::new(points, surfaces).settled(&[]);
            paths[slot] = Some((key, touches.clone()));
            touches
        }
    })
}

/// A path on its way to being taut.
struct Tracing<'p> {
    points: &'p [Vector],
    surfaces: &'p [Placed<'p>],
    /// From the ground's frame into that of each surface.
    inward: Vec<Frame<f64>>,
    touches: Vec<Touch>,
}

impl<'p> Tracing<'p> {
    fn new(points: &'p [Vector], surfaces: &'p [Placed<'p>]) -> Self {
        let inward = surfaces.iter().map(|surface| surface.frame.inverse()).collect();
        Self { points, surfaces, inward, touches: Vec::new() }
    }

    fn settled(mut self, near: &[Touch]) -> Vec<Touch> {
        self.place(near);
        if self.surfaces.len() > 1 {
            self.settle();
            for _ in 0..PLACINGS {
                if !self.put_missed(near) {
                    break;
                }
                self.settle();
            }
        }
        self.touches
    }

    /// Puts on the path what it runs through now that it is taut; says whether there was anything.
    fn put_missed(&mut self, near: &[Touch]) -> bool {
        let before = self.touches.len();
        for surface in 0..self.surfaces.len() {
            if self.touches.iter().all(|touch| touch.surface != surface) {
                self.put(surface, near);
            }
        }
        self.touches.len() > before
    }

    /// Puts each surface where it belongs.
    fn place(&mut self, near: &[Touch]) {
        let mut order: Vec<usize> = (0..self.surfaces.len()).collect();
        let placings = if order.len() == 1 { 1 } else { PLACINGS };
        let mut length = f64::INFINITY;
        for placing in 0..placings {
            let mut last: Vec<Wrap> = Vec::with_capacity(order.len());
            for &surface in &order {
                self.touches.retain(|touch| touch.surface != surface);
                last.push(self.put(surface, near));
            }
            let before = std::mem::replace(&mut length, self.length());
            if (length - before).abs() < PLACED {
                break;
            }
            // The first surface was not met, and the second has a point inside: the other way round the first may come first.
            if placing == 0 && order.len() > 1 && last[0] == Wrap::Missed && last[1] == Wrap::Inside {
                order.swap(0, 1);
                self.touches.retain(|touch| touch.surface != 0);
            }
        }
    }

    /// Puts a surface on the segment that runs through it, or that it makes longer by the least; says what it is to the segment looked at last.
    fn put(&mut self, surface: usize, near: &[Touch]) -> Wrap {
        let mut best: Option<(f64, usize, Touch)> = None;
        let mut last = Wrap::Missed;
        let near = near.iter().find(|touch| touch.surface == surface).map(|touch| &touch.contact);
        let [from, to] = self.surfaces[surface].segments.unwrap_or([0, self.points.len() - 2]);
        'segments: for segment in from..=to.min(self.points.len() - 2) {
            let first = self.touches.partition_point(|touch| touch.segment < segment);
            let after = self.touches.partition_point(|touch| touch.segment <= segment);
            for place in first..=after {
                let (a, b) = self.ends(segment, place, place);
                last = self.wrap(surface, &a, &b, near);
                let (Wrap::Possible(contact) | Wrap::Certain(contact)) = last else { continue };
                let longer = contact.path_length(&a, &b) - norm(&minus(&b, &a));
                let found = (longer, place, Touch { surface, segment, contact });
                if matches!(last, Wrap::Certain(_)) {
                    best = Some(found);
                    break 'segments;
                }
                if best.as_ref().is_none_or(|(least, ..)| longer < *least) {
                    best = Some(found);
                }
            }
        }
        if let Some((_, place, touch)) = best {
            self.touches.insert(place, touch);
        }
        last
    }

    /// Where the path leaves what lies before `place` among the touches and meets what lies at `next`, on a segment.
    fn ends(&self, segment: usize, place: usize, next: usize) -> (Vector, Vector) {
        let here = |touch: &&Touch| touch.segment == segment;
        let before = place.checked_sub(1).map(|k| &self.touches[k]).filter(here);
        let after = self.touches.get(next).filter(here);
        let a = before.map_or(self.points[segment], |touch| touch.contact.last);
        let b = after.map_or(self.points[segment + 1], |touch| touch.contact.first);
        (a, b)
    }

    fn wrap(&self, surface: usize, a: &Vector, b: &Vector, near: Option<&Contact>) -> Wrap {
        let Placed { frame, shape, .. } = &self.surfaces[surface];
        let inward = &self.inward[surface];
        let near = near.map(|contact| contact.seen_from(inward));
        shape.wrap(&inward.point(a), &inward.point(b), near.as_ref()).seen_from(frame)
    }

    /// Each contact between those it lies between, again and again until nothing moves.
    fn settle(&mut self) {
        for _ in 0..ROUNDS {
            let mut moved = 0.0f64;
            let mut k = 0;
            while k < self.touches.len() {
                let Touch { surface, segment, contact: old } = self.touches[k];
                let (a, b) = self.ends(segment, k, k + 1);
                match self.wrap(surface, &a, &b, Some(&old)) {
                    Wrap::Possible(new) | Wrap::Certain(new) => {
                        let apart = norm(&minus(&old.first, &new.first)).max(norm(&minus(&old.last, &new.last)));
                        moved = moved.max(apart);
                        self.touches[k].contact = new;
                        k += 1;
                    }
                    _ => {
                        moved = 1.0;
                        self.touches.remove(k);
                    }
                }
            }
            if moved <= STILL {
                break;
            }
        }
    }

    fn length(&self) -> f64 {
        let mut place = self.points[0];
        let mut length = 0.0;
        let mut touches = self.touches.iter().peekable();
        for (segment, end) in self.points[1..].iter().enumerate() {
            while let Some(Touch { contact, .. }) = touches.next_if(|touch| touch.segment == segment) {
                length += norm(&minus(&contact.first, &place)) + contact.length;
                place = contact.last;
            }
            length += norm(&minus(end, &place));
            place = *end;
        }
        length
    }
}
