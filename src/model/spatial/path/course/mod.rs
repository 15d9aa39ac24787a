//! The length of a path over given points in one pose.
//!
//! The path is cut into pieces from its points over the surfaces it touches; where it goes from one surface to the next,
//! a free point on the straight part between them joins two pieces. Each piece's length has its derivatives over its two
//! ends in the surface's frame ([`crate::skeleton::surface::Shape::curvature`]); the chain rule takes them to joint
//! coordinates (see `derivatives`). A free point w stands where the length is least, so it leaves the gradient alone and the Hessian
//! by
//!
//! ```text
//! ∂²L/∂q² = L_qq − L_qw L_ww⁻¹ L_wq        w across the way only
//! ```
//!
//! A shortest way is C¹: its second derivative jumps where contact comes or goes. The length here is softened there
//! ([`Course::add_length`]).

mod derivatives;

use super::{Carrier, Obstacle, PathPoint, SpatialPath};
use crate::model::spatial::linkage::Pose;
use crate::model::straight::PathLength;
use crate::skeleton::frame::{Frame, Vector, along, minus, norm, unit};
use crate::skeleton::surface::Contact;
use crate::skeleton::wrapping::{PlacedSurface, Touch, touches};

/// E_0: how much longer a contact makes a path at the end of its softening, m.
const SOFT_EXCESS: f64 = 2e-7;
/// The second-order estimate of what a contact adds is looked at more closely below this times E_0.
const LIGHT: f64 = 4.0;
/// Most slots of a path, two for each joint of two pieces among them; a study with a longer one is refused
/// ([`Skeleton::obstacles`](crate::skeleton::Skeleton::obstacles)).
pub const SLOTS: usize = 96;

pub struct Course<'p> {
    path: &'p SpatialPath,
    pose: &'p Pose,
    /// Points that it passes through, and where they are in the ground's frame.
    active: Vec<usize>,
    places: Vec<Vector>,
    touched: Vec<Touch>,
}

/// A piece of the path.
struct Piece {
    from: End,
    to: End,
    touches: Option<(usize, Contact)>,
}

#[derive(Clone, Copy)]
enum End {
    /// Number of a point, and where it is.
    Point(usize, Vector),
    /// A joint of two pieces: its number, place and the direction of the path there.
    Joint(usize, Vector, Vector),
}

impl End {
    fn place(&self) -> Vector {
        let (Self::Point(_, place) | Self::Joint(_, place, _)) = self;
        *place
    }
}

pub fn surfaces(touched: &[Touch]) -> Vec<usize> {
    touched.iter().map(|touch| touch.surface).collect()
}

/// Of what a path touches, that on one of its parts.
fn of_part(touched: &[Touch], part: usize) -> &[Touch] {
    let from = touched.partition_point(|touch| touch.segment < part);
    &touched[from..touched.partition_point(|touch| touch.segment <= part)]
}

impl<'p> Course<'p> {
    pub fn new(path: &'p SpatialPath, pose: &'p Pose, active: Vec<usize>, near: &[Touch]) -> Self {
        let places = active.iter().map(|&point| Self::position(path, pose, point)).collect();
        let mut course = Self { path, pose, active, places, touched: Vec::new() };
        course.touched = course.find_touched(None, near);
        course
    }

    /// Where a path point is in the ground's frame.
    pub fn position(path: &SpatialPath, pose: &Pose, point: usize) -> Vector {
        let PathPoint { on, point, moves, .. } = &path.points[point];
        let local = moves
            .iter()
            .fold(*point, |local, slide| along(&local, slide.by.value(&pose.coordinates), &slide.direction));
        on.link.map_or(local, |link| pose.links[link].frame.point(&local))
    }

    fn frame(&self, on: &Carrier) -> Frame<f64> {
        on.link.map_or_else(Frame::identity, |link| self.pose.links[link].frame)
    }

    /// The surfaces that the path touches, without one of those that it may; in the ground's frame.
    fn find_touched(&self, without: Option<usize>, near: &[Touch]) -> Vec<Touch> {
        if self.active.len() < 2 {
            return Vec::new();
        }
        let numbers: Vec<usize> = self.active.iter().map(|&point| self.path.points[point].number).collect();
        let (known, placed): (Vec<usize>, Vec<PlacedSurface<'_>>) = (self.path.surfaces.iter().enumerate())
            .filter(|(s, _)| Some(*s) != without)
            .filter_map(|(s, Obstacle { on, frame, shape, of_model })| {
                let segments = of_model.segments(&numbers)?;
                Some((s, PlacedSurface { frame: self.frame(on) * *frame, shape, segments }))
            })
            .unzip();
        let number = |surface: usize| known.iter().position(|&s| s == surface);
        let near: Vec<Touch> =
            near.iter().filter_map(|touch| Some(Touch { surface: number(touch.surface)?, ..*touch })).collect();
        let found = touches(&self.places, &placed, &near);
        found.into_iter().map(|touch| Touch { surface: known[touch.surface], ..touch }).collect()
    }

    fn point(&self, k: usize) -> End {
        End::Point(self.active[k], self.places[k])
    }

    /// The pieces of a part of the path around the surfaces that it touches.
    fn pieces(&self, part: usize, touched: &[Touch]) -> Vec<Piece> {
        let (mut begin, last) = (self.point(part), self.point(part + 1));
        if touched.is_empty() {
            return vec![Piece { from: begin, to: last, touches: None }];
        }
        let piece = |(k, &Touch { surface, contact, .. }): (usize, &Touch)| {
            let to = touched.get(k + 1).map_or(last, |next| {
                let way = minus(&next.contact.first, &contact.last);
                End::Joint(k, along(&contact.last, 0.5, &way), unit(&way))
            });
            Piece { from: std::mem::replace(&mut begin, to), to, touches: Some((surface, contact)) }
        };
        touched.iter().enumerate().map(piece).collect()
    }

    /// Adds the length and its derivatives over the path's slots; returns what the path touches.
    ///
    /// DEPARTURE [geometry]: where a contact with a surface makes the path longer by no more than E_0, from B to B + E,
    /// the length is B + E_0 p(E/E_0) with p = 3 τ² − 3 τ³ + τ⁴. It then has three continuous derivatives where contact
    /// comes and goes, instead of one, and eq. (1), which has its slope, is smooth: an optimum that lies just there has a
    /// KKT point. Lengths change by less than 0.3 E_0 = 0.06 µm.
    pub fn add_length(self, second: bool, near: &[Touch], out: &mut PathLength<f64>) -> Vec<Touch> {
        for part in 0..self.active.len().saturating_sub(1) {
            let touched = of_part(&self.touched, part);
            let light = (touched.iter().map(|touch| touch.surface).zip(self.lightness(part, touched)))
                .min_by(|a, b| a.1.total_cmp(&b.1))
                .filter(|(_, excess)| *excess < LIGHT * SOFT_EXCESS);
            match light {
                None => self.add(&self.pieces(part, touched), second, out),
                Some((surface, _)) => {
                    let (mut with, mut without) = (self.path.buffer(), self.path.buffer());
                    self.add(&self.pieces(part, touched), second, &mut with);
                    let others = self.find_touched(Some(surface), near);
                    self.add(&self.pieces(part, of_part(&others, part)), second, &mut without);
                    add_softened(&with, &without, out);
                }
            }
        }
        self.touched
    }

    /// About how much longer each contact makes a part of the path: to second order φ² d_a d_b/(2 (d_a + d_b)), with φ the
    /// angle that it turns the path by and d the ways from the contact before and to the one after.
    fn lightness(&self, part: usize, touched: &[Touch]) -> Vec<f64> {
        let one = |k: usize| {
            let contact = &touched[k].contact;
            let before = k.checked_sub(1).map_or(self.places[part], |k| touched[k].contact.last);
            let after = touched.get(k + 1).map_or(self.places[part + 1], |next| next.contact.first);
            let (arriving, leaving) = (minus(&contact.first, &before), minus(&after, &contact.last));
            let (da, db) = (norm(&arriving) + contact.length, norm(&leaving) + contact.length);
            let turned = norm(&minus(&unit(&leaving), &unit(&arriving)));
            0.5 * turned * turned * da * db / (da + db)
        };
        (0..touched.len()).map(one).collect()
    }

    /// Adds a part of the path.
    fn add(&self, pieces: &[Piece], second: bool, out: &mut PathLength<f64>) {
        if !second {
            return self.slope(pieces, out);
        }
        let joints = pieces.len() - 1;
        match self.path.slots.len() + 2 * joints {
            ..4 => self.bend::<4>(pieces, joints, out),
            4..=8 => self.bend::<8>(pieces, joints, out),
            9..=16 => self.bend::<16>(pieces, joints, out),
            17..=32 => self.bend::<32>(pieces, joints, out),
            33..=64 => self.bend::<64>(pieces, joints, out),
            _ => self.bend::<SLOTS>(pieces, joints, out),
        }
    }
}

/// Adds B + E_0 p(E/E_0), see [`Course::add_length`].
fn add_softened(with: &PathLength<f64>, without: &PathLength<f64>, out: &mut PathLength<f64>) {
    let excess = (with.value - without.value).max(0.0);
    let t = excess / SOFT_EXCESS;
    let (p, slope, bend) = if t < 1.0 {
        (t * t * (3.0 + t * (t - 3.0)), t * (6.0 + t * (4.0 * t - 9.0)), 6.0 + t * (12.0 * t - 18.0))
    } else {
        (t, 1.0, 0.0)
    };
    let n = out.gradient.len();
    let change: Vec<f64> = with.gradient.iter().zip(&without.gradient).map(|(w, b)| w - b).collect();
    out.value += without.value + SOFT_EXCESS * p;
    for i in 0..n {
        out.gradient[i] += without.gradient[i] + slope * change[i];
        for j in 0..n {
            let at = i * n + j;
            let (base, more) = (without.hessian[at], with.hessian[at] - without.hessian[at]);
            out.hessian[at] += base + slope * more + bend / SOFT_EXCESS * change[i] * change[j];
        }
    }
}
