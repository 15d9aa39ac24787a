//! The path of a muscle over joint coordinates: what it runs over, and its length with exact first and second
//! derivatives.
//!
//! Only links that carry some of the path's bodies and not all of them change its length. A path passes through a point
//! with a condition while a coordinate is in a range.
//!
//! DEPARTURE [OpenSim 4.6, `ConditionalPathPoint`]: at the ends of the range the length jumps; here the point comes and
//! goes over [`SWITCH_ANGLE`] or [`SWITCH_DISTANCE`], with the length a mean of those with and without it, whose weight
//! has three continuous derivatives.

mod course;
mod mover;

use std::sync::Arc;

use num_dual::Dual64;

use super::linkage::Linkage;
use crate::model::straight::PathLength;
use crate::skeleton::frame::{Frame, Vector};
use crate::skeleton::function::Function;
use crate::skeleton::surface::Shape;
use crate::skeleton::wrapping::Touch;
use crate::skeleton::{self, Skeleton, path};
pub use course::SLOTS;
use course::{Course, surfaces};
use mover::{Moved, Mover};

/// Size of the step along a direction in which third derivatives are taken by differences.
const STEP: f64 = 2e-6;
/// The width over which a point with a condition comes or goes, of a condition on an angle, rad.
pub const SWITCH_ANGLE: f64 = 5.0 * std::f64::consts::PI / 180.0;
/// The same of a condition on a displacement, m.
pub const SWITCH_DISTANCE: f64 = 5e-3;

#[derive(Clone, Debug)]
pub struct SpatialPath {
    linkage: Arc<Linkage>,
    points: Vec<PathPoint>,
    pub surfaces: Vec<Obstacle>,
    /// Numbers of the coordinates that the length depends on and that move by forces, increasing.
    pub slots: Vec<usize>,
    /// Links that change the length, with slots and weights of their drives.
    levers: Vec<Lever>,
}

#[derive(Clone, Debug)]
struct Lever {
    link: usize,
    terms: Vec<(usize, f64)>,
}

/// What carries a point or a surface.
#[derive(Clone, Debug)]
struct Carrier {
    link: Option<usize>,
    /// Levers among the links that carry it, the outermost first.
    levers: Vec<usize>,
}

#[derive(Clone, Debug)]
struct PathPoint {
    on: Carrier,
    /// In the link's frame, m.
    point: Vector,
    moves: Vec<Slide>,
    when: Option<Condition>,
    /// Its number in the model.
    number: usize,
}

/// A displacement of a point by a function of a coordinate.
#[derive(Clone, Debug)]
struct Slide {
    /// In the link's axes.
    direction: Vector,
    by: Mover,
}

/// The path passes through a point while a function of a coordinate is in a range.
#[derive(Clone, Debug)]
struct Condition {
    on: Mover,
    range: [f64; 2],
    width: f64,
}

/// A wrapping surface.
#[derive(Clone, Debug)]
pub struct Obstacle {
    on: Carrier,
    /// In the link's frame.
    frame: Frame<f64>,
    shape: Shape,
    of_model: path::Obstacle,
}

/// A set of points that the path passes through, with its weight: value, gradient and Hessian over the slots.
struct Share {
    active: Vec<usize>,
    weight: PathLength<f64>,
}

impl SpatialPath {
    pub fn new(skeleton: &Skeleton, linkage: &Arc<Linkage>, muscle: &skeleton::Muscle) -> Self {
        let path = &muscle.path;
        let place = |body: usize| linkage.tree.places[body];
        let point_bodies = path.points.iter().map(|point| point.body);
        let surface_bodies = path.surfaces.iter().map(|obstacle| skeleton.surfaces[obstacle.surface].body);
        let chains: Vec<Vec<usize>> = point_bodies.chain(surface_bodies).map(|b| linkage.chain(place(b).0)).collect();
        let carries_all = |link: &usize| chains.iter().all(|chain| chain.contains(link));
        let mut links: Vec<usize> = chains.iter().flatten().copied().filter(|link| !carries_all(link)).collect();
        links.sort_unstable();
        links.dedup();
        links.retain(|&link| linkage.is_free[link]);
        let mover = |m: &path::Move| Mover::new(skeleton, linkage, m.coordinate, &m.by);
        let condition = |c: usize| Mover::new(skeleton, linkage, c, &Function::identity());
        let moves = path.points.iter().flat_map(|point| &point.moves).map(mover);
        let movers = moves.chain(path.points.iter().filter_map(|point| point.when).map(|(c, _)| condition(c)));
        let of_movers = movers.flat_map(|mover| mover.coordinates().to_vec());
        let of_links = links.iter().flat_map(|&link| linkage.tree.links[link].drive.terms.iter().map(|(c, _)| *c));
        let mut slots: Vec<usize> = of_movers.chain(of_links).filter_map(|c| linkage.free_number(c)).collect();
        slots.sort_unstable();
        slots.dedup();
        let slot = |c: usize| slots.binary_search(&linkage.free_number(c)?).ok();
        let terms = |link: usize| {
            let terms = linkage.tree.links[link].drive.terms.iter();
            terms.filter_map(|&(c, weight)| Some((slot(c)?, weight))).collect()
        };
        let levers: Vec<Lever> = links.iter().map(|&link| Lever { link, terms: terms(link) }).collect();
        let carrier = |body: usize| {
            let link = place(body).0;
            let chain = linkage.chain(link);
            Carrier { link, levers: (0..links.len()).filter(|&k| chain.contains(&links[k])).collect() }
        };
        let slide = |frame: &Frame<f64>, moved: &path::Move| {
            let direction = [0, 1, 2].map(|i| frame.axes[i][moved.component]);
            Slide { direction, by: mover(moved).placed(slot) }
        };
        let when = |(coordinate, range): (usize, [f64; 2])| {
            let width = if skeleton.coordinates[coordinate].is_angle { SWITCH_ANGLE } else { SWITCH_DISTANCE };
            Condition { on: condition(coordinate).placed(slot), range, width }
        };
        let points = (path.points.iter().enumerate())
            .map(|(number, point)| {
                let frame = place(point.body).1;
                PathPoint {
                    on: carrier(point.body),
                    point: frame.point(&point.point),
                    moves: point.moves.iter().map(|moved| slide(&frame, moved)).collect(),
                    when: point.when.map(when),
                    number,
                }
            })
            .collect();
        let surfaces = (path.surfaces.iter())
            .map(|obstacle| {
                let surface = &skeleton.surfaces[obstacle.surface];
                let frame = place(surface.body).1 * surface.frame;
                Obstacle { on: carrier(surface.body), frame, shape: surface.shape.clone(), of_model: *obstacle }
            })
            .collect();
        Self { linkage: linkage.clone(), points, surfaces, slots, levers }
    }

    fn buffer(&self) -> PathLength<f64> {
        let n = self.slots.len();
        PathLength { value: 0.0, gradient: vec![0.0; n], hessian: vec![0.0; n * n] }
    }

    /// Where the path points are in the ground's frame, also those that the path does not pass through.
    pub fn positions(&self, q: &[f64]) -> Vec<Vector> {
        let pose = self.linkage.pose(q);
        (0..self.points.len()).map(|point| Course::position(self, &pose, point)).collect()
    }

    /// The length and its derivatives over [`SpatialPath::slots`]; `second` asks for the Hessian.
    /// Returns the surfaces that it touches.
    pub fn length(&self, q: &[f64], second: bool, out: &mut PathLength<f64>) -> Vec<usize> {
        surfaces(&self.length_near(q, second, &[], out))
    }

    /// [`SpatialPath::length`], sooner found from what the path touches in a pose nearby; returns what it touches.
    fn length_near(&self, q: &[f64], second: bool, near: &[Touch], out: &mut PathLength<f64>) -> Vec<Touch> {
        out.value = 0.0;
        out.gradient.fill(0.0);
        out.hessian.fill(0.0);
        let pose = self.linkage.pose(q);
        let mut shares = self.shares(&pose.coordinates);
        if shares.len() == 1 {
            let active = shares.remove(0).active;
            return Course::new(self, &pose, active, near).add_length(second, near, out);
        }
        let mut touched = Vec::new();
        for Share { active, weight } in shares {
            let mut length = self.buffer();
            touched = Course::new(self, &pose, active, near).add_length(second, near, &mut length);
            add_product(&weight, &length, out);
        }
        touched
    }

    /// The sets of points that the path passes through at these values of the skeleton's coordinates.
    fn shares(&self, coordinates: &[f64]) -> Vec<Share> {
        let mut weight = self.buffer();
        weight.value = 1.0;
        let mut shares = vec![Share { active: Vec::with_capacity(self.points.len()), weight }];
        for (k, point) in self.points.iter().enumerate() {
            let share = point.when.as_ref().map_or(ALWAYS, |when| when.share(coordinates));
            let mut others = Vec::new();
            if share.value < 1.0 {
                let [with, without] = [(0.0, 1.0), (1.0, -1.0)].map(|(start, factor)| {
                    let mut weight = self.buffer();
                    weight.value = start + factor * share.value;
                    share.gradient.iter().for_each(|&(i, slope)| weight.gradient[i] += factor * slope);
                    let n = self.slots.len();
                    share.hessian.iter().for_each(|&(i, j, bend)| weight.hessian[i * n + j] += factor * bend);
                    weight
                });
                for Share { active, weight } in &mut shares {
                    let mut other = self.buffer();
                    add_product(weight, &without, &mut other);
                    others.push(Share { active: active.clone(), weight: other });
                    let mut own = self.buffer();
                    add_product(weight, &with, &mut own);
                    *weight = own;
                }
            }
            if share.value > 0.0 {
                shares.iter_mut().for_each(|share| share.active.push(k));
                shares.extend(others);
            } else {
                shares = others;
            }
        }
        shares
    }

    /// The length and its derivatives, and in the dual parts how they change along `direction` (over all coordinates). The
    /// change of the Hessian, that is third derivatives, by differences; none where contact comes or goes on the way.
    pub fn length_along(&self, q: &[f64], direction: &[f64]) -> PathLength<Dual64> {
        let n = self.slots.len();
        let mut here = self.buffer();
        let touched = self.length_near(q, true, &[], &mut here);
        let way: Vec<f64> = self.slots.iter().map(|&slot| direction[slot]).collect();
        let change = |row: &[f64]| row.iter().zip(&way).map(|(x, d)| x * d).sum::<f64>();
        let size = way.iter().fold(0.0f64, |a, d| a.max(d.abs()));
        let mut third = vec![0.0; n * n];
        // Second derivatives through a torus are too rough to be differenced.
        let is_rough = touched.iter().any(|touch| matches!(self.surfaces[touch.surface].shape, Shape::Torus { .. }));
        if size > 0.0 && size.is_finite() && !is_rough {
            let e = STEP / size;
            let at = |e: f64| {
                let mut moved = q.to_vec();
                self.slots.iter().zip(&way).for_each(|(&slot, d)| moved[slot] += e * d);
                let mut there = self.buffer();
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

/// The share of a point without a condition.
const ALWAYS: Moved = Moved { value: 1.0, gradient: Vec::new(), hessian: Vec::new() };

impl Condition {
    /// How far the point takes part, from 0 to 1.
    fn share(&self, coordinates: &[f64]) -> Moved {
        let mut x = self.on.at(coordinates);
        let [low, high] = self.range;
        let (rising, falling) = (self.rise(x.value - low), self.rise(high - x.value));
        let slope = rising[1] * falling[0] - rising[0] * falling[1];
        let bend = rising[2] * falling[0] - 2.0 * rising[1] * falling[1] + rising[0] * falling[2];
        x.value = rising[0] * falling[0];
        let gradient = x.gradient.clone();
        let of = |slot: usize| gradient.iter().find(|(own, _)| *own == slot).map_or(0.0, |(_, slope)| *slope);
        x.hessian.iter_mut().for_each(|(i, j, second)| *second = bend * of(*i) * of(*j) + slope * *second);
        x.gradient.iter_mut().for_each(|(_, own)| *own *= slope);
        x
    }

    /// From 0 to 1 about x = 0.
    fn rise(&self, x: f64) -> [f64; 3] {
        let t = (x / self.width + 0.5).clamp(0.0, 1.0);
        let value = t.powi(4) * (35.0 + t * (-84.0 + t * (70.0 - 20.0 * t)));
        let slope = 140.0 * (t * (1.0 - t)).powi(3);
        let bend = 420.0 * (t * (1.0 - t)).powi(2) * (1.0 - 2.0 * t);
        [value, slope / self.width, bend / (self.width * self.width)]
    }
}

/// Adds a product of two functions.
fn add_product(a: &PathLength<f64>, b: &PathLength<f64>, out: &mut PathLength<f64>) {
    let n = out.gradient.len();
    out.value += a.value * b.value;
    for i in 0..n {
        out.gradient[i] += a.value * b.gradient[i] + a.gradient[i] * b.value;
        for j in 0..n {
            let at = i * n + j;
            let mixed = a.gradient[i] * b.gradient[j] + b.gradient[i] * a.gradient[j];
            out.hessian[at] += a.value * b.hessian[at] + a.hessian[at] * b.value + mixed;
        }
    }
}
