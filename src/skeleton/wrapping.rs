//! Finds which surfaces a path wraps, on which of its segments, and where it touches them.
//!
//! The segments are chosen as in OpenSim 4.6 (`GeometryPath::applyWrapObjects`), so that imported models keep their
//! lengths. Each surface in turn is taken off the path and placed again: on the first segment that must wrap it, or
//! else on the segment whose length it increases least. Passes over all surfaces are repeated until the length changes
//! by less than 0.5 mm, at most eight times.
//!
//! DEPARTURE [OpenSim 4.6, `GeometryPath::applyWrapObjects`]: OpenSim accepts the path at this point. Here the surfaces
//! stay on their segments while the contacts are iterated until none of them moves. The path is then taut, its length
//! is continuous, and its derivative follows from the envelope theorem.

use std::cell::RefCell;
use std::hash::{DefaultHasher, Hash, Hasher};

use super::frame::{Frame, Vector, minus, norm};
use super::surface::{Contact, Shape, Wrap};

/// A surface in a pose.
pub struct PlacedSurface<'s> {
    /// Frame of the surface in the ground's frame.
    pub frame: Frame<f64>,
    pub shape: &'s Shape,
    /// First and last segment that may wrap it; any segment if `None`.
    pub segments: Option<[usize; 2]>,
}

/// A surface that the path touches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// Index of the surface in the path's list.
    pub surface: usize,
    /// Index of the segment; segment 0 lies between the first two points.
    pub segment: usize,
    /// In the ground's frame.
    pub contact: Contact,
}

/// Maximum number of passes that place all surfaces.
const MAX_PASSES: usize = 8;
/// Placing ends when a pass changes the length by less than this, m.
const LENGTH_TOLERANCE: f64 = 5e-4;
/// Maximum number of sweeps over the contacts in [`PathSearch::settle`].
const MAX_SWEEPS: usize = 500;
/// The sweeps end when no contact moves by more than this, m.
const CONTACT_TOLERANCE: f64 = 1e-14;

/// Number of paths that each thread caches. The functions, Jacobian and Hessian of a problem need the same paths.
const CACHE_SIZE: usize = 1 << 13;

/// Key of a cached path (the bits of everything that it depends on), and the surfaces that it touches.
type CachedPath = (Vec<u64>, Vec<Touch>);

thread_local! {
    static PATHS: RefCell<Vec<Option<CachedPath>>> = RefCell::new(vec![None; CACHE_SIZE]);
}

/// The surfaces that the path through `points` (in the ground's frame, m) touches, in path order.
///
/// `near`: the touches of a path nearby as a starting guess, or empty.
pub fn touches(points: &[Vector], surfaces: &[PlacedSurface<'_>], near: &[Touch]) -> Vec<Touch> {
    if surfaces.is_empty() {
        return Vec::new();
    }
    // A path found from a starting guess is not cached: it is not requested again, and it differs by rounding from one
    // found without a guess.
    if !near.is_empty() {
        return PathSearch::new(points, surfaces).settled(near);
    }
    let of_surfaces = surfaces.iter().flat_map(|surface| {
        let [first, last] = surface.segments.map_or([f64::NAN; 2], |segments| segments.map(|s| s as f64));
        let frame = surface.frame.axes.into_iter().flatten().chain(surface.frame.origin);
        frame.chain(surface.shape.sizes()).chain([first, last])
    });
    let key: Vec<u64> = of_surfaces.chain(points.iter().flatten().copied()).map(f64::to_bits).collect();
    let mut hasher = DefaultHasher::new();
    key.hash(&mut hasher);
    let slot = hasher.finish() as usize % CACHE_SIZE;
    PATHS.with_borrow_mut(|paths| match &paths[slot] {
        Some((cached, touches)) if *cached == key => touches.clone(),
        _ => {
            let touches = PathSearch::new(points, surfaces).settled(&[]);
            paths[slot] = Some((key, touches.clone()));
            touches
        }
    })
}

/// State of the search for a taut path.
struct PathSearch<'p> {
    points: &'p [Vector],
    surfaces: &'p [PlacedSurface<'p>],
    /// Transform from the ground's frame to that of each surface.
    to_surface: Vec<Frame<f64>>,
    touches: Vec<Touch>,
}

impl<'p> PathSearch<'p> {
    fn new(points: &'p [Vector], surfaces: &'p [PlacedSurface<'p>]) -> Self {
        let to_surface = surfaces.iter().map(|surface| surface.frame.inverse()).collect();
        Self { points, surfaces, to_surface, touches: Vec::new() }
    }

    /// Places the surfaces, pulls the path taut, and returns its touches.
    fn settled(mut self, near: &[Touch]) -> Vec<Touch> {
        self.place_all(near);
        if self.surfaces.len() > 1 {
            self.settle();
            for _ in 0..MAX_PASSES {
                if !self.place_missed(near) {
                    break;
                }
                self.settle();
            }
        }
        self.touches
    }

    /// Places the surfaces that the path does not touch but should wrap now that it is taut. True if there was any.
    fn place_missed(&mut self, near: &[Touch]) -> bool {
        let before = self.touches.len();
        for surface in 0..self.surfaces.len() {
            if self.touches.iter().all(|touch| touch.surface != surface) {
                self.place(surface, near);
            }
        }
        self.touches.len() > before
    }

    /// Places all surfaces by OpenSim's rules.
    fn place_all(&mut self, near: &[Touch]) {
        let mut order: Vec<usize> = (0..self.surfaces.len()).collect();
        let passes = if order.len() == 1 { 1 } else { MAX_PASSES };
        let mut length = f64::INFINITY;
        for pass in 0..passes {
            // Relation of each surface to the segment tried last.
            let mut last: Vec<Wrap> = Vec::with_capacity(order.len());
            for &surface in &order {
                self.touches.retain(|touch| touch.surface != surface);
                last.push(self.place(surface, near));
            }
            let before = std::mem::replace(&mut length, self.length());
            if (length - before).abs() < LENGTH_TOLERANCE {
                break;
            }
            // The first surface was missed, and an end of the segment lies inside the second: try them in the opposite
            // order.
            if pass == 0 && order.len() > 1 && last[0] == Wrap::Missed && last[1] == Wrap::Inside {
                order.swap(0, 1);
                self.touches.retain(|touch| touch.surface != 0);
            }
        }
    }

    /// Places a surface on the first segment that must wrap it, or else on the segment whose length it increases least.
    /// Returns its relation to the segment tried last.
    fn place(&mut self, surface: usize, near: &[Touch]) -> Wrap {
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
                let detour = contact.path_length(&a, &b) - norm(&minus(&b, &a));
                let found = (detour, place, Touch { surface, segment, contact });
                if matches!(last, Wrap::Certain(_)) {
                    best = Some(found);
                    break 'segments;
                }
                if best.as_ref().is_none_or(|(least, ..)| detour < *least) {
                    best = Some(found);
                }
            }
        }
        if let Some((_, place, touch)) = best {
            self.touches.insert(place, touch);
        }
        last
    }

    /// Ends of the straight line on a segment between the touch before index `place` and the touch at index `next`.
    /// Where there is no such touch on the segment, the line ends at the path point.
    fn ends(&self, segment: usize, place: usize, next: usize) -> (Vector, Vector) {
        let here = |touch: &&Touch| touch.segment == segment;
        let before = place.checked_sub(1).map(|k| &self.touches[k]).filter(here);
        let after = self.touches.get(next).filter(here);
        let a = before.map_or(self.points[segment], |touch| touch.contact.last);
        let b = after.map_or(self.points[segment + 1], |touch| touch.contact.first);
        (a, b)
    }

    /// Relation of a surface to the line from `a` to `b`, all in the ground's frame.
    fn wrap(&self, surface: usize, a: &Vector, b: &Vector, near: Option<&Contact>) -> Wrap {
        let PlacedSurface { frame, shape, .. } = &self.surfaces[surface];
        let to_surface = &self.to_surface[surface];
        let near = near.map(|contact| contact.transformed(to_surface));
        shape.wrap(&to_surface.point(a), &to_surface.point(b), near.as_ref()).transformed(frame)
    }

    /// Recomputes each contact between its neighbours, in sweeps over the path, until none moves. Surfaces that lose
    /// contact are taken off the path.
    fn settle(&mut self) {
        for _ in 0..MAX_SWEEPS {
            let mut moved = 0.0f64;
            let mut k = 0;
            while k < self.touches.len() {
                let Touch { surface, segment, contact: old } = self.touches[k];
                let (a, b) = self.ends(segment, k, k + 1);
                match self.wrap(surface, &a, &b, Some(&old)) {
                    Wrap::Possible(new) | Wrap::Certain(new) => {
                        let shift = norm(&minus(&old.first, &new.first)).max(norm(&minus(&old.last, &new.last)));
                        moved = moved.max(shift);
                        self.touches[k].contact = new;
                        k += 1;
                    }
                    _ => {
                        moved = 1.0;
                        self.touches.remove(k);
                    }
                }
            }
            if moved <= CONTACT_TOLERANCE {
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
