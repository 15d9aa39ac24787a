//! The length of a path over given points in one pose.
//!
//! The path is cut into pieces from its points over the surfaces it touches; where it goes from one surface to the next,
//! a free point on the straight part between them joins two pieces. Each piece's length has its derivatives over its two
//! ends in the surface's frame ([`crate::skeleton::surface::Shape::curvature`]); the chain rule takes them to joint
//! coordinates ([`Jet`]). A free point w stands where the length is least, so it leaves the gradient alone and the Hessian
//! by
//!
//! ```text
//! ∂²L/∂q² = L_qq − L_qw L_ww⁻¹ L_wq        w across the way only
//! ```
//!
//! A shortest way is C¹: its second derivative jumps where contact comes or goes. The length here is softened there
//! ([`Course::add_length`]).

use nalgebra::{DMatrix, Matrix2};

use super::{Carrier, Obstacle, PathPoint, SpatialPath};
use crate::model::spatial::jet::Jet;
use crate::model::spatial::linkage::Pose;
use crate::model::straight::PathLength;
use crate::model::tree::pose::{PlacedLink, turned};
use crate::skeleton::frame::{Frame, Vector, along, dot, minus, norm, unit};
use crate::skeleton::surface::{Contact, Shape, tangents};
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

/// A point or a direction in the ground's frame, with its slopes over N slots, axis by axis.
struct Moving<const N: usize> {
    at: Vector,
    slopes: [[f64; N]; 3],
}

impl<const N: usize> Moving<N> {
    fn minus(mut self, other: &Self) -> Self {
        for i in 0..3 {
            self.at[i] -= other.at[i];
            (0..N).for_each(|k| self.slopes[i][k] -= other.slopes[i][k]);
        }
        self
    }

    fn along(&self, way: &Vector) -> f64 {
        dot(&self.at, way)
    }

    fn slopes_along(&self, way: &Vector) -> [f64; N] {
        let [x, y, z] = &self.slopes;
        std::array::from_fn(|k| x[k] * way[0] + y[k] * way[1] + z[k] * way[2])
    }

    fn add(&mut self, slot: usize, factor: f64, way: &Vector) {
        (0..3).for_each(|i| self.slopes[i][slot] += factor * way[i]);
    }
}

/// How something that a link carries moves with it: a point or a direction.
type Movement = fn(&PlacedLink<f64>, &Vector) -> Vector;
const OF_POINT: Movement = PlacedLink::moves_point;
const OF_DIRECTION: Movement = PlacedLink::moves_direction;

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

    /// Value and gradient: contacts stay where they are on their bodies, and only the straight parts count.
    fn slope(&self, pieces: &[Piece], out: &mut PathLength<f64>) {
        for piece in pieces {
            let (from, to) = (piece.from.place(), piece.to.place());
            match &piece.touches {
                None => {
                    out.value += norm(&minus(&to, &from));
                    self.pull_end(piece.from, &unit(&minus(&from, &to)), out);
                    self.pull_end(piece.to, &unit(&minus(&to, &from)), out);
                }
                Some((surface, contact)) => {
                    let (arriving, leaving) = (minus(&contact.first, &from), minus(&to, &contact.last));
                    out.value += norm(&arriving) + contact.length + norm(&leaving);
                    let (arriving, leaving) = (unit(&arriving), unit(&leaving));
                    let Obstacle { on, frame, shape, .. } = &self.path.surfaces[*surface];
                    if let Shape::Torus { .. } = shape {
                        // Its contacts slide on what takes its place: pulls of the whole piece, on both sides of its ends.
                        let placed = self.frame(on) * *frame;
                        let [a, b] = [from, to].map(|x| placed.inverse().point(&x));
                        let gradient = shape.curvature(&a, &b, contact).0;
                        for (end, k) in [(piece.from, 0), (piece.to, 3)] {
                            let way = turned(&placed, &std::array::from_fn(|i| gradient[k + i]));
                            self.pull_end(end, &way, out);
                            self.pull(on, &end.place(), &way.map(|x| -x), out);
                        }
                        continue;
                    }
                    self.pull_end(piece.from, &arriving.map(|x| -x), out);
                    self.pull(on, &contact.first, &arriving, out);
                    self.pull(on, &contact.last, &leaving.map(|x| -x), out);
                    self.pull_end(piece.to, &leaving, out);
                }
            }
        }
    }

    /// Adds `way·∂x` of a carried point x.
    fn pull(&self, on: &Carrier, x: &Vector, way: &Vector, out: &mut PathLength<f64>) {
        for &k in &on.levers {
            let lever = &self.path.levers[k];
            let link = &self.pose.links[lever.link];
            let slope = dot(&link.moves_point(x), way) * link.slope;
            lever.terms.iter().for_each(|&(slot, weight)| out.gradient[slot] += weight * slope);
        }
    }

    fn pull_end(&self, end: End, way: &Vector, out: &mut PathLength<f64>) {
        let End::Point(point, x) = end else { return };
        let PathPoint { on, moves, .. } = &self.path.points[point];
        self.pull(on, &x, way, out);
        for slide in moves {
            let along = dot(&turned(&self.frame(on), &slide.direction), way);
            let moved = slide.by.at(&self.pose.coordinates);
            moved.gradient.into_iter().for_each(|(slot, slope)| out.gradient[slot] += slope * along);
        }
    }

    /// Value, gradient and Hessian over the slots and two directions of each free point.
    fn bend<const N: usize>(&self, pieces: &[Piece], joints: usize, out: &mut PathLength<f64>) {
        let n = self.path.slots.len();
        assert!(n + 2 * joints <= N, "a path over {n} coordinates and {joints} surfaces in a row");
        let mut sum: Jet<N> = Jet::constant(0.0);
        for piece in pieces {
            match &piece.touches {
                None => self.straight(piece, &mut sum),
                Some((surface, contact)) => self.wrapped(*surface, contact, piece, &mut sum),
            }
        }
        out.value += sum.value;
        out.gradient.iter_mut().zip(&sum.gradient).for_each(|(g, x)| *g += x);
        for i in 0..n {
            out.hessian[i * n..(i + 1) * n].iter_mut().zip(&sum.hessian[i]).for_each(|(h, x)| *h += x);
        }
        if joints == 0 {
            return;
        }
        let free = DMatrix::from_fn(2 * joints, 2 * joints, |i, j| sum.hessian[n + i][n + j]);
        let mixed = DMatrix::from_fn(2 * joints, n, |i, j| sum.hessian[n + i][j]);
        let solved = if joints == 1 {
            Matrix2::new(free[(0, 0)], free[(0, 1)], free[(1, 0)], free[(1, 1)])
                .try_inverse()
                .map(|inv| inv * &mixed)
                .map(|m| DMatrix::from_fn(2, n, |i, j| m[(i, j)]))
        } else {
            free.lu().solve(&mixed)
        };
        if let Some(solved) = solved {
            for i in 0..n {
                for j in 0..n {
                    out.hessian[i * n + j] -= (0..2 * joints).map(|k| mixed[(k, i)] * solved[(k, j)]).sum::<f64>();
                }
            }
        }
    }

    /// Something that is carried, x in the ground's frame.
    fn carried<const N: usize>(&self, on: &Carrier, x: Vector, moves: Movement) -> Moving<N> {
        let mut moving = Moving { at: x, slopes: [[0.0; N]; 3] };
        for &k in &on.levers {
            let lever = &self.path.levers[k];
            let link = &self.pose.links[lever.link];
            let way = moves(link, &x);
            lever.terms.iter().for_each(|&(slot, weight)| moving.add(slot, weight * link.slope, &way));
        }
        moving
    }

    /// A direction in the axes of what carries it.
    fn direction<const N: usize>(&self, on: &Carrier, x: &Vector) -> Moving<N> {
        self.carried(on, turned(&self.frame(on), x), OF_DIRECTION)
    }

    /// An end of a piece.
    fn end<const N: usize>(&self, end: End) -> Moving<N> {
        match end {
            End::Point(point, x) => {
                let PathPoint { on, moves, .. } = &self.path.points[point];
                let mut moving = self.carried(on, x, OF_POINT);
                for slide in moves {
                    let way = turned(&self.frame(on), &slide.direction);
                    let moved = slide.by.at(&self.pose.coordinates);
                    moved.gradient.into_iter().for_each(|(slot, slope)| moving.add(slot, slope, &way));
                }
                moving
            }
            End::Joint(k, place, way) => {
                let mut moving = Moving { at: place, slopes: [[0.0; N]; 3] };
                let (u, v) = tangents(&way);
                let first = self.path.slots.len() + 2 * k;
                moving.add(first, 1.0, &u);
                moving.add(first + 1, 1.0, &v);
                moving
            }
        }
    }

    /// Adds `pull·∂²x` of something that is carried to a Hessian: ∂²x/∂s_i ∂s_j = ω_i × ∂x/∂s_j, if i carries j or is j.
    fn add_carried<const N: usize>(&self, on: &Carrier, x: &Vector, moves: Movement, pull: &Vector, sum: &mut Jet<N>) {
        for (j, &k) in on.levers.iter().enumerate() {
            let lever = &self.path.levers[k];
            let link = &self.pose.links[lever.link];
            let way = moves(link, x);
            for (i, &carrier) in on.levers[..=j].iter().enumerate() {
                let carrier = &self.path.levers[carrier];
                let outer = &self.pose.links[carrier.link];
                let mut second = dot(&outer.moves_direction(&way), pull) * outer.slope * link.slope;
                if i == j {
                    second += dot(&way, pull) * link.bend;
                }
                for &(one, weight) in &carrier.terms {
                    for &(other, factor) in &lever.terms {
                        sum.hessian[one][other] += weight * factor * second;
                        if i != j {
                            sum.hessian[other][one] += weight * factor * second;
                        }
                    }
                }
            }
        }
    }

    /// Adds `pull·∂²x` of an end x to a Hessian.
    fn add_end<const N: usize>(&self, end: End, pull: &Vector, sum: &mut Jet<N>) {
        let End::Point(point, x) = end else { return };
        let PathPoint { on, moves, .. } = &self.path.points[point];
        self.add_carried(on, &x, OF_POINT, pull, sum);
        for slide in moves {
            let moved = slide.by.at(&self.pose.coordinates);
            let direction: Moving<N> = self.direction(on, &slide.direction);
            let mut slopes = [0.0; N];
            moved.gradient.into_iter().for_each(|(slot, slope)| slopes[slot] += slope);
            sum.add_product(&direction.slopes_along(pull), &slopes);
            let along = direction.along(pull);
            moved.hessian.into_iter().for_each(|(one, other, bend)| sum.hessian[one][other] += along * bend);
        }
    }

    /// Adds |b − a|.
    fn straight<const N: usize>(&self, piece: &Piece, sum: &mut Jet<N>) {
        let [a, b]: [Moving<N>; 2] = [piece.from, piece.to].map(|end| self.end(end));
        let way = b.minus(&a);
        let (length, t) = (norm(&way.at), unit(&way.at));
        if length == 0.0 {
            return;
        }
        let hessian = [0, 1, 2].map(|i| [0, 1, 2].map(|j| (f64::from(u8::from(i == j)) - t[i] * t[j]) / length));
        sum.add_function(length, &t, &hessian, &way.slopes);
        self.add_end(piece.from, &t.map(|x| -x), sum);
        self.add_end(piece.to, &t, sum);
    }

    /// Adds the length of a piece around a surface. It is a function of the ends in the surface's frame,
    /// a′ = Rᵀ w with w = a − c; of its slope g′ by a′ the second derivatives of a′ make, with g = R g′,
    ///
    /// ```text
    /// g′·∂²a′ = g·∂²w + ∂²g·w + ∂gᵀ ∂w + ∂wᵀ ∂g
    /// ```
    fn wrapped<const N: usize>(&self, surface: usize, contact: &Contact, piece: &Piece, sum: &mut Jet<N>) {
        let Obstacle { on, frame, shape, .. } = &self.path.surfaces[surface];
        let placed = self.frame(on) * *frame;
        let back = placed.inverse();
        let centre: Moving<N> = self.carried(on, placed.origin, OF_POINT);
        let column = |j: usize| [0, 1, 2].map(|i| placed.axes[i][j]);
        let axes: [Moving<N>; 3] = [0, 1, 2].map(|j| self.carried(on, column(j), OF_DIRECTION));
        // The way from the centre to an end, and that end in the surface's frame.
        let ends = [piece.from, piece.to].map(|end| {
            let way = self.end(end).minus(&centre);
            let inside = Moving {
                at: [0, 1, 2].map(|j| axes[j].along(&way.at)),
                slopes: [0, 1, 2].map(|j| {
                    let (turned, moved) = (axes[j].slopes_along(&way.at), way.slopes_along(&axes[j].at));
                    std::array::from_fn(|k| turned[k] + moved[k])
                }),
            };
            (way, inside)
        });
        let local = Contact { first: back.point(&contact.first), last: back.point(&contact.last), ..*contact };
        let [from, to] = [ends[0].1.at, ends[1].1.at];
        let value = norm(&minus(&local.first, &from)) + local.length + norm(&minus(&to, &local.last));
        let (gradient, hessian) = shape.curvature(&from, &to, &local);
        let slopes: [[f64; N]; 6] = std::array::from_fn(|i| ends[i / 3].1.slopes[i % 3]);
        sum.add_function(value, &gradient, &hessian, &slopes);
        for (k, end) in [piece.from, piece.to].into_iter().enumerate() {
            let (way, _): &(Moving<N>, _) = &ends[k];
            let inside: Vector = std::array::from_fn(|j| gradient[3 * k + j]);
            let pull: Moving<N> = self.carried(on, turned(&placed, &inside), OF_DIRECTION);
            self.add_end(end, &pull.at, sum);
            self.add_carried(on, &placed.origin, OF_POINT, &pull.at.map(|x| -x), sum);
            self.add_carried(on, &pull.at, OF_DIRECTION, &way.at, sum);
            (0..3).for_each(|i| sum.add_product(&pull.slopes[i], &way.slopes[i]));
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
