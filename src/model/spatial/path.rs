//! Length of a spatial muscle path over the coordinates of the free bodies, with exact first and second derivatives.
//!
//! The path is cut into pieces from its points over the surfaces it touches; where it goes from one surface to the next, a free point
//! on the straight part between them joins two pieces. Each piece's length has its derivatives over its two ends in the
//! surface's frame ([`crate::skeleton::surface::Shape::curvature`]); the chain rule takes them to body coordinates ([`Jet`]). A free point w stands where the
//! length is least, so it leaves the gradient alone and the Hessian by
//!
//! ```text
//! ∂²L/∂q² = L_qq − L_qw L_ww⁻¹ L_wq        w across the way only
//! ```
//!
//! Rotations are those of p/|p|, so that a length does not change with |p|, which only the constraints hold at 1.
//!
//! A shortest way is C¹: its second derivative jumps where contact comes or goes. The length here is softened there
//! ([`SpatialPath::length`]).

use nalgebra::{DMatrix, Matrix2};
use num_dual::Dual64;

use super::euler;
use super::jet::{Jet, dot};
use super::joint::{PER_BODY, Place};
use crate::model::straight::PathLength;
use crate::skeleton::frame::{Frame, Vector, along, minus, norm, unit};
use crate::skeleton::surface::{Contact, Shape, tangents};
use crate::skeleton::wrapping::{PlacedSurface, Touch, touches};

/// Size of the step along a direction in which third derivatives are taken by differences.
const STEP: f64 = 2e-6;
/// E_0: how much longer a contact makes a path at the end of its softening, m.
const SOFT_EXCESS: f64 = 2e-7;
/// Most slots of a path, two for each joint of two pieces among them; a study with a longer one is refused ([`Skeleton::obstacles`](crate::skeleton::Skeleton::obstacles)).
pub const SLOTS: usize = 192;
/// The second-order estimate of what a contact adds is looked at more closely below this times E_0.
const LIGHT: f64 = 4.0;

#[derive(Clone, Debug)]
pub struct SpatialPath {
    pub points: Vec<PathPoint>,
    pub surfaces: Vec<Obstacle>,
    /// Body coordinates that the length depends on, increasing: seven of each free body.
    pub slots: Vec<usize>,
}

#[derive(Clone, Debug)]
pub struct PathPoint {
    pub place: Place,
    /// The point is `place + slope θ` (m/rad).
    pub moves: Option<(Elevation, Vector)>,
}

/// The second of three rotations of a joint, θ, the first two about axes at right angles:
/// `a_1 · R a_3 = C cos(θ − δ)` with a_1 fixed in the parent and a_3 in the child. Singular at θ = δ.
#[derive(Clone, Copy, Debug)]
pub struct Elevation {
    pub parent: Option<usize>,
    pub child: Option<usize>,
    /// a_1 in the parent's and a_3 in the child's axes.
    pub axes: [Vector; 2],
    /// C, δ
    pub cosine: [f64; 2],
}

/// A wrapping surface.
#[derive(Clone, Debug)]
pub struct Obstacle {
    pub body: Option<usize>,
    /// From the body's centre of mass, in its axes.
    pub frame: Frame<f64>,
    pub shape: Shape,
    /// First and last of the parts of the path that it is in the way of.
    pub parts: Option<[usize; 2]>,
}

/// A piece of the path in one pose.
struct Piece {
    /// Number of a point, or of a joint of two pieces.
    from: End,
    to: End,
    touches: Option<(usize, Contact)>,
}

#[derive(Clone, Copy)]
enum End {
    Point(usize),
    /// Number, place and direction of the path there.
    Joint(usize, Vector, Vector),
}

fn surfaces(touched: &[Touch]) -> Vec<usize> {
    touched.iter().map(|touch| touch.surface).collect()
}

/// Of what a path touches, that on one of its parts.
fn of_part(touched: &[Touch], part: usize) -> &[Touch] {
    let from = touched.partition_point(|touch| touch.segment < part);
    &touched[from..touched.partition_point(|touch| touch.segment <= part)]
}

/// Frame of a body in the ground's; the ground itself for `None`.
pub fn frame_of(q: &[f64], body: Option<usize>) -> Frame<f64> {
    let Some(body) = body else { return Frame::identity() };
    let q = &q[PER_BODY * body..PER_BODY * (body + 1)];
    let columns = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|axis| euler::turn(&q[3..], axis));
    let axes = [0, 1, 2].map(|i| [columns[0][i], columns[1][i], columns[2][i]]);
    Frame { axes, origin: [q[0], q[1], q[2]] }
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
        crate::skeleton::frame::dot(&self.at, way)
    }

    fn slopes_along(&self, way: &Vector) -> [f64; N] {
        let [x, y, z] = &self.slopes;
        std::array::from_fn(|k| x[k] * way[0] + y[k] * way[1] + z[k] * way[2])
    }
}

impl Elevation {
    fn value(&self, q: &[f64]) -> f64 {
        let turned = |body: Option<usize>, axis| {
            body.map_or(axis, |b| euler::turn(&q[PER_BODY * b + 3..PER_BODY * (b + 1)], axis))
        };
        let [a, b] = [turned(self.parent, self.axes[0]), turned(self.child, self.axes[1])];
        let cosine = crate::skeleton::frame::dot(&a, &b) / self.cosine[0];
        self.cosine[1] + cosine.clamp(-1.0, 1.0).acos()
    }
}

impl SpatialPath {
    /// `free`: the number of bodies whose coordinates are unknowns; those after them are given.
    pub fn new(points: Vec<PathPoint>, surfaces: Vec<Obstacle>, free: usize) -> Self {
        let of_points = points.iter().flat_map(|p| {
            let by = p.moves.as_ref().map(|(by, _)| [by.parent, by.child]).unwrap_or_default();
            [p.place.body, by[0], by[1]]
        });
        let mut bodies: Vec<usize> =
            of_points.chain(surfaces.iter().map(|s| s.body)).flatten().filter(|&b| b < free).collect();
        bodies.sort_unstable();
        bodies.dedup();
        let slots = bodies.iter().flat_map(|b| (0..PER_BODY).map(move |i| PER_BODY * b + i)).collect();
        Self { points, surfaces, slots }
    }

    /// First slot of a free body, `None` for others.
    fn slot(&self, body: Option<usize>) -> Option<usize> {
        let first = PER_BODY * body?;
        self.slots.iter().position(|&slot| slot == first)
    }

    /// Of a path point, from its body's centre of mass in its axes.
    fn local(&self, point: usize, q: &[f64]) -> Vector {
        let PathPoint { place, moves } = &self.points[point];
        moves.as_ref().map_or(place.point, |(by, slope)| along(&place.point, by.value(q), slope))
    }

    /// Where a path point is, in the ground's frame.
    pub fn position(&self, point: usize, q: &[f64]) -> Vector {
        frame_of(q, self.points[point].place.body).point(&self.local(point, q))
    }

    /// The surfaces that the path touches, without one of those that it may; in the ground's frame.
    fn touched(&self, q: &[f64], without: Option<usize>, near: &[Touch]) -> Vec<Touch> {
        let known: Vec<usize> = (0..self.surfaces.len()).filter(|&s| Some(s) != without).collect();
        if known.is_empty() {
            return Vec::new();
        }
        let placed: Vec<PlacedSurface<'_>> = (known.iter().map(|&s| &self.surfaces[s]))
            .map(|surface| PlacedSurface {
                frame: frame_of(q, surface.body) * surface.frame,
                shape: &surface.shape,
                segments: surface.parts,
            })
            .collect();
        let number = |surface: usize| known.iter().position(|&s| s == surface);
        let near: Vec<Touch> =
            near.iter().filter_map(|touch| Some(Touch { surface: number(touch.surface)?, ..*touch })).collect();
        let points: Vec<Vector> = (0..self.points.len()).map(|point| self.position(point, q)).collect();
        let found = touches(&points, &placed, &near);
        found.into_iter().map(|touch| Touch { surface: known[touch.surface], ..touch }).collect()
    }

    /// The pieces of a part of the path around the surfaces that it touches.
    fn pieces(part: usize, touched: &[Touch]) -> Vec<Piece> {
        let (mut begin, last) = (End::Point(part), End::Point(part + 1));
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

    /// The length and its derivatives over [`SpatialPath::slots`], and the surfaces touched; `second` asks for the Hessian.
    ///
    /// DEPARTURE [geometry]: where a contact with a surface makes the path longer by no more than E_0, from B to B + E, the length is
    /// B + E_0 p(E/E_0) with p = 3 τ² − 3 τ³ + τ⁴. It then has three continuous derivatives where contact comes and goes, instead of
    /// one, and eq. (1), which has its slope, is smooth: an optimum that lies just there has a KKT point. Lengths change by less
    /// than 0.3 E_0 = 0.06 µm.
    pub fn length(&self, q: &[f64], second: bool, out: &mut PathLength<f64>) -> Vec<usize> {
        surfaces(&self.length_near(q, second, &[], out))
    }

    /// [`SpatialPath::length`], sooner found from what the path touches in a pose nearby.
    fn length_near(&self, q: &[f64], second: bool, near: &[Touch], out: &mut PathLength<f64>) -> Vec<Touch> {
        out.value = 0.0;
        out.gradient.fill(0.0);
        out.hessian.fill(0.0);
        let all = self.touched(q, None, near);
        for part in 0..self.points.len() - 1 {
            let touched = of_part(&all, part);
            let light = (touched.iter().map(|touch| touch.surface).zip(self.lightness(q, part, touched)))
                .min_by(|a, b| a.1.total_cmp(&b.1))
                .filter(|(_, excess)| *excess < LIGHT * SOFT_EXCESS);
            match light {
                None => self.add(q, &Self::pieces(part, touched), second, out),
                Some((surface, _)) => {
                    let n = self.slots.len();
                    let buffer = || PathLength { value: 0.0, gradient: vec![0.0; n], hessian: vec![0.0; n * n] };
                    let (mut with, mut without) = (buffer(), buffer());
                    self.add(q, &Self::pieces(part, touched), second, &mut with);
                    let others = self.touched(q, Some(surface), near);
                    self.add(q, &Self::pieces(part, of_part(&others, part)), second, &mut without);
                    add_softened(&with, &without, out);
                }
            }
        }
        all
    }

    /// About how much longer each contact makes a part of the path: to second order φ² d_a d_b/(2 (d_a + d_b)), with φ the angle that it
    /// turns the path by and d the ways from the contact before and to the one after.
    fn lightness(&self, q: &[f64], part: usize, touched: &[Touch]) -> Vec<f64> {
        if touched.is_empty() {
            return Vec::new();
        }
        let ends = [part, part + 1].map(|point| self.position(point, q));
        let one = |k: usize| {
            let contact = &touched[k].contact;
            let before = k.checked_sub(1).map_or(ends[0], |k| touched[k].contact.last);
            let after = touched.get(k + 1).map_or(ends[1], |next| next.contact.first);
            let (arriving, leaving) = (minus(&contact.first, &before), minus(&after, &contact.last));
            let (da, db) = (norm(&arriving) + contact.length, norm(&leaving) + contact.length);
            let turned = norm(&minus(&unit(&leaving), &unit(&arriving)));
            0.5 * turned * turned * da * db / (da + db)
        };
        (0..touched.len()).map(one).collect()
    }

    /// Adds a part of the path.
    fn add(&self, q: &[f64], pieces: &[Piece], second: bool, out: &mut PathLength<f64>) {
        if !second {
            return self.slope(q, pieces, out);
        }
        let joints = pieces.len() - 1;
        match self.slots.len() + 2 * joints {
            ..8 => self.bend::<8>(q, pieces, joints, out),
            8..=16 => self.bend::<16>(q, pieces, joints, out),
            17..=24 => self.bend::<24>(q, pieces, joints, out),
            25..=48 => self.bend::<48>(q, pieces, joints, out),
            49..=96 => self.bend::<96>(q, pieces, joints, out),
            _ => self.bend::<SLOTS>(q, pieces, joints, out),
        }
    }

    /// Value and gradient: contacts stay where they are on their bodies, and only the straight parts count.
    fn slope(&self, q: &[f64], pieces: &[Piece], out: &mut PathLength<f64>) {
        // The pull `way` on a point, given in the axes of its body.
        let mut pull = |body: Option<usize>, point: Vector, way: Vector| {
            let Some(at) = self.slot(body) else { return };
            let p = &q[self.slots[at] + 3..self.slots[at] + PER_BODY];
            (0..3).for_each(|i| out.gradient[at + i] += way[i]);
            for (k, column) in euler::turn_slopes(p, point).iter().enumerate() {
                out.gradient[at + 3 + k] += crate::skeleton::frame::dot(column, &way);
            }
        };
        let mut total = 0.0;
        let mut moved: Vec<(usize, Vector)> = Vec::new();
        for piece in pieces {
            let place = |end: End| match end {
                End::Point(point) => self.position(point, q),
                End::Joint(_, place, _) => place,
            };
            let (a, b) = (place(piece.from), place(piece.to));
            let mut straight = |from: (Option<End>, Vector), to: (Option<End>, Vector), surface: Option<usize>| {
                let way = minus(&to.1, &from.1);
                total += norm(&way);
                let way = unit(&way);
                for ((end, at), way) in [(from, way.map(|x| -x)), (to, way)] {
                    match (end, surface) {
                        (Some(End::Point(point)), _) => {
                            pull(self.points[point].place.body, self.local(point, q), way);
                            moved.push((point, way));
                        }
                        (Some(End::Joint(..)), _) => {}
                        (None, surface) => {
                            let body = self.surfaces[surface.expect("a contact is on a surface")].body;
                            pull(body, frame_of(q, body).inverse().point(&at), way);
                        }
                    }
                }
            };
            match &piece.touches {
                None => straight((Some(piece.from), a), (Some(piece.to), b), None),
                Some((surface, contact)) => {
                    straight((Some(piece.from), a), (None, contact.first), Some(*surface));
                    straight((None, contact.last), (Some(piece.to), b), Some(*surface));
                    total += contact.length;
                }
            }
        }
        out.value += total;
        for (point, way) in moved {
            let PathPoint { place, moves: Some((by, slope)) } = &self.points[point] else { continue };
            let along_slope = crate::skeleton::frame::dot(&way, &turned(q, place.body, *slope));
            let angle: [f64; SLOTS] = self.angle_slopes(by, q);
            (0..self.slots.len()).for_each(|i| out.gradient[i] += along_slope * angle[i]);
        }
    }

    /// Value, gradient and Hessian over the slots and two directions of each free point.
    fn bend<const N: usize>(&self, q: &[f64], pieces: &[Piece], joints: usize, out: &mut PathLength<f64>) {
        let (n, all) = (self.slots.len(), self.slots.len() + 2 * joints);
        assert!(all <= N, "a path over {} bodies and {joints} surfaces in a row", n / PER_BODY);
        let mut sum: Jet<f64, N> = Jet::constant(0.0);
        for piece in pieces {
            match &piece.touches {
                None => self.straight(piece, q, &mut sum),
                Some((surface, contact)) => self.wrapped(*surface, contact, piece, q, &mut sum),
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

    /// The moving coordinate as a jet.
    fn angle<const N: usize>(&self, by: &Elevation, q: &[f64]) -> Jet<f64, N> {
        let [c, offset] = by.cosine;
        let direction = |body: Option<usize>, x: Vector| match (body, self.slot(body)) {
            (Some(b), Some(at)) => euler::turned(&q[PER_BODY * b + 3..PER_BODY * (b + 1)], at + 3, x),
            _ => turned(q, body, x).map(Jet::constant),
        };
        let f = dot(&direction(by.parent, by.axes[0]), &direction(by.child, by.axes[1])).scaled(1.0 / c);
        let x = f.value.clamp(-1.0, 1.0);
        let sine = (1.0 - x * x).max(1e-16).sqrt();
        let mut angle = Jet::compose(x.acos(), &[-1.0 / sine], &[[-x / sine.powi(3)]], &[f]);
        angle.value += offset;
        angle
    }

    /// The slopes of [`SpatialPath::angle`].
    fn angle_slopes<const N: usize>(&self, by: &Elevation, q: &[f64]) -> [f64; N] {
        let u: Moving<N> = self.direction(by.parent, by.axes[0], q);
        let v: Moving<N> = self.direction(by.child, by.axes[1], q);
        let [c, _] = by.cosine;
        let x: f64 = ((0..3).map(|i| u.at[i] * v.at[i]).sum::<f64>() / c).clamp(-1.0, 1.0);
        let sine = (1.0 - x * x).max(1e-16).sqrt();
        let slope = |k: usize| (0..3).map(|i| u.slopes[i][k] * v.at[i] + u.at[i] * v.slopes[i][k]).sum::<f64>();
        std::array::from_fn(|k| -slope(k) / (c * sine))
    }

    /// A direction of a body, in the ground's axes.
    fn direction<const N: usize>(&self, body: Option<usize>, x: Vector, q: &[f64]) -> Moving<N> {
        let mut moving = Moving { at: turned(q, body, x), slopes: [[0.0; N]; 3] };
        if let (Some(body), Some(at)) = (body, self.slot(body)) {
            for (k, column) in euler::turn_slopes(&q[PER_BODY * body + 3..PER_BODY * (body + 1)], x).iter().enumerate()
            {
                (0..3).for_each(|i| moving.slopes[i][at + 3 + k] = column[i]);
            }
        }
        moving
    }

    /// A point of a body, in the ground's frame.
    fn fixed<const N: usize>(&self, body: Option<usize>, x: Vector, q: &[f64]) -> Moving<N> {
        let mut moving = self.direction(body, x, q);
        if let Some(body) = body {
            (0..3).for_each(|i| moving.at[i] += q[PER_BODY * body + i]);
        }
        if let Some(at) = self.slot(body) {
            (0..3).for_each(|i| moving.slopes[i][at + i] = 1.0);
        }
        moving
    }

    /// An end of a piece, in the ground's frame.
    fn end<const N: usize>(&self, end: End, q: &[f64]) -> Moving<N> {
        match end {
            End::Point(point) => {
                let PathPoint { place, moves } = &self.points[point];
                let mut moving = self.fixed(place.body, self.local(point, q), q);
                if let Some((by, slope)) = moves {
                    let (angle, slope) = (self.angle_slopes::<N>(by, q), turned(q, place.body, *slope));
                    for i in 0..3 {
                        (0..N).for_each(|k| moving.slopes[i][k] += slope[i] * angle[k]);
                    }
                }
                moving
            }
            End::Joint(k, place, way) => {
                let mut moving = Moving { at: place, slopes: [[0.0; N]; 3] };
                let (u, v) = tangents(&way);
                let first = self.slots.len() + 2 * k;
                for i in 0..3 {
                    (moving.slopes[i][first], moving.slopes[i][first + 1]) = (u[i], v[i]);
                }
                moving
            }
        }
    }

    /// Adds `pull · ∂²(A x)` of a direction of a body to a Hessian.
    fn add_turned<const N: usize>(
        &self,
        body: Option<usize>,
        x: Vector,
        pull: &Vector,
        q: &[f64],
        sum: &mut Jet<f64, N>,
    ) {
        let (Some(body), Some(at)) = (body, self.slot(body)) else { return };
        let bent = euler::turn_bend(&q[PER_BODY * body + 3..PER_BODY * (body + 1)], x, *pull);
        for k in 0..4 {
            (0..4).for_each(|l| sum.hessian[at + 3 + k][at + 3 + l] += bent[k][l]);
        }
    }

    /// Adds `pull · ∂²x` of an end x to a Hessian.
    fn add_end<const N: usize>(&self, end: End, pull: &Vector, q: &[f64], sum: &mut Jet<f64, N>) {
        let End::Point(point) = end else { return };
        let PathPoint { place, moves } = &self.points[point];
        self.add_turned(place.body, self.local(point, q), pull, q, sum);
        if let Some((by, slope)) = moves {
            let angle: Jet<f64, N> = self.angle(by, q);
            let slope: Moving<N> = self.direction(place.body, *slope, q);
            let (along, slopes) = (slope.along(pull), slope.slopes_along(pull));
            sum.add_product(&slopes, &angle.gradient);
            for a in 0..N {
                (0..N).for_each(|b| sum.hessian[a][b] += along * angle.hessian[a][b]);
            }
        }
    }

    /// Adds |b − a|.
    fn straight<const N: usize>(&self, piece: &Piece, q: &[f64], sum: &mut Jet<f64, N>) {
        let [a, b]: [Moving<N>; 2] = [piece.from, piece.to].map(|end| self.end(end, q));
        let way = b.minus(&a);
        let (length, t) = (norm(&way.at), unit(&way.at));
        let hessian = [0, 1, 2].map(|i| [0, 1, 2].map(|j| (f64::from(u8::from(i == j)) - t[i] * t[j]) / length));
        sum.add_function(length, &t, &hessian, &way.slopes);
        self.add_end(piece.from, &t.map(|x| -x), q, sum);
        self.add_end(piece.to, &t, q, sum);
    }

    /// Adds the length of a piece around a surface. It is a function of the ends in the surface's frame,
    /// a′ = Rᵀ w with w = a − c; of its slope g′ by a′ the second derivatives of a′ make, with g = R g′,
    ///
    /// ```text
    /// g′·∂²a′ = g·∂²w + ∂²g·w + ∂gᵀ ∂w + ∂wᵀ ∂g
    /// ```
    fn wrapped<const N: usize>(
        &self,
        surface: usize,
        contact: &Contact,
        piece: &Piece,
        q: &[f64],
        sum: &mut Jet<f64, N>,
    ) {
        let Obstacle { body, frame, shape, .. } = &self.surfaces[surface];
        let back = (frame_of(q, *body) * *frame).inverse();
        let centre: Moving<N> = self.fixed(*body, frame.origin, q);
        let axes: [Moving<N>; 3] = [0, 1, 2].map(|j| self.direction(*body, [0, 1, 2].map(|i| frame.axes[i][j]), q));
        // The way from the centre to an end, and that end in the surface's frame; of its body's own points nothing moves.
        let ends = [piece.from, piece.to].map(|end| match end {
            End::Point(k) if self.points[k].place.body == *body && self.points[k].moves.is_none() => {
                (None, Moving { at: frame.inverse().point(&self.points[k].place.point), slopes: [[0.0; N]; 3] })
            }
            _ => {
                let way = self.end(end, q).minus(&centre);
                let inside = Moving {
                    at: [0, 1, 2].map(|j| axes[j].along(&way.at)),
                    slopes: [0, 1, 2].map(|j| {
                        let (turned, moved) = (axes[j].slopes_along(&way.at), way.slopes_along(&axes[j].at));
                        std::array::from_fn(|k| turned[k] + moved[k])
                    }),
                };
                (Some(way), inside)
            }
        });
        let local = Contact { first: back.point(&contact.first), last: back.point(&contact.last), ..*contact };
        let [from, to] = [ends[0].1.at, ends[1].1.at];
        let value = norm(&minus(&local.first, &from)) + local.length + norm(&minus(&to, &local.last));
        let (gradient, hessian) = shape.curvature(&from, &to, &local);
        let slopes: [[f64; N]; 6] = std::array::from_fn(|i| ends[i / 3].1.slopes[i % 3]);
        sum.add_function(value, &gradient, &hessian, &slopes);
        for (k, end) in [piece.from, piece.to].into_iter().enumerate() {
            let Some(way) = &ends[k].0 else { continue };
            let inside: Vector = std::array::from_fn(|j| gradient[3 * k + j]);
            let of_body = [0, 1, 2].map(|i| crate::skeleton::frame::dot(&frame.axes[i], &inside));
            let pull: Moving<N> = self.direction(*body, of_body, q);
            self.add_end(end, &pull.at, q, sum);
            self.add_turned(*body, frame.origin, &pull.at.map(|x| -x), q, sum);
            self.add_turned(*body, of_body, &way.at, q, sum);
            (0..3).for_each(|i| sum.add_product(&pull.slopes[i], &way.slopes[i]));
        }
    }

    /// The length and its derivatives, and in the dual parts how they change along `direction` (over all coordinates). The change
    /// of the Hessian, that is third derivatives, by differences; none where contact comes or goes on the way.
    pub fn length_along(&self, q: &[f64], direction: &[f64]) -> PathLength<Dual64> {
        let n = self.slots.len();
        let buffer = || PathLength { value: 0.0, gradient: vec![0.0; n], hessian: vec![0.0; n * n] };
        let mut here = buffer();
        let touched = self.length_near(q, true, &[], &mut here);
        let way: Vec<f64> = self.slots.iter().map(|&slot| direction[slot]).collect();
        let change = |row: &[f64]| row.iter().zip(&way).map(|(x, d)| x * d).sum::<f64>();
        let size = way.iter().fold(0.0f64, |a, d| a.max(d.abs()));
        let mut third = vec![0.0; n * n];
        if size > 0.0 && size.is_finite() {
            let e = STEP / size;
            let at = |e: f64| {
                let mut moved = q.to_vec();
                self.slots.iter().zip(&way).for_each(|(&slot, d)| moved[slot] += e * d);
                let mut there = buffer();
                let touched_there = self.length_near(&moved, true, &touched, &mut there);
                (surfaces(&touched_there) == surfaces(&touched)).then_some(there.hessian)
            };
            if let (Some(up), Some(down)) = (at(e), at(-e)) {
                third.iter_mut().zip(up.iter().zip(down)).for_each(|(t, (up, down))| *t = (up - down) / (2.0 * e));
            }
        }
        PathLength {
            value: Dual64::new(here.value, change(&here.gradient)),
            gradient: (0..n)
                .map(|i| Dual64::new(here.gradient[i], change(&here.hessian[i * n..(i + 1) * n])))
                .collect(),
            hessian: here.hessian.iter().zip(third).map(|(&h, t)| Dual64::new(h, t)).collect(),
        }
    }
}

/// Adds B + E_0 p(E/E_0), see [`SpatialPath::length`].
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

/// A direction of a body in the ground's axes.
fn turned(q: &[f64], body: Option<usize>, x: Vector) -> Vector {
    body.map_or(x, |b| euler::turn(&q[PER_BODY * b + 3..PER_BODY * (b + 1)], x))
}
