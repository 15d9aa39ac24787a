//! Derivatives of the pieces of a path by the chain rule, from their ends in a surface's frame to joint coordinates.

use nalgebra::{DMatrix, Matrix2};

use super::{Course, End, Piece};
use crate::model::spatial::jet::Jet;
use crate::model::spatial::path::{Carrier, Obstacle, PathPoint};
use crate::model::straight::PathLength;
use crate::model::tree::pose::{PlacedLink, turned};
use crate::skeleton::frame::{Vector, dot, minus, norm, unit};
use crate::skeleton::surface::{Contact, Shape, tangents};

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

impl Course<'_> {
    /// Value and gradient: contacts stay where they are on their bodies, and only the straight parts count.
    pub(super) fn slope(&self, pieces: &[Piece], out: &mut PathLength<f64>) {
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
    pub(super) fn bend<const N: usize>(&self, pieces: &[Piece], joints: usize, out: &mut PathLength<f64>) {
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
