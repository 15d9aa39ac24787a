//! Inverse dynamics of a tree of links, with exact first and second derivatives.
//!
//! ```text
//! V_k = V_p + X_k ṡ_k,   A_k = A_p + X_k s̈_k + V_k × X_k ṡ_k,   W_k = W_p + X_k λ_k,   A_ground = −g     (p: the parent)
//! F_k = Σ_(i carried by k) I_i A_i + V_i ×* I_i V_i − φ_i,       X_k · F_k: the generalised force of link k
//! S   = Σ_i W_i · (I_i A_i + V_i ×* I_i V_i − φ_i) = λᵀ (generalised forces)
//! ```
//!
//! X_k: twist of a unit speed of link k; I_i, φ_i: inertia of the bodies on link i and the loads on them; W: twists of
//! virtual speeds λ. All derivatives follow from that of S. In the axes of link i its inertia does not change, and each
//! of the parameters s, ṡ, s̈, λ of a link k that carries it changes V_i by d, A_i by e + d × V_i and W_i by w, the same
//! for all i:
//!
//! ```text
//!      d             e                        w
//! s    V_p × X       A_p × X − d × V_p        W_p × X
//! ṡ    X             2 V_p × X
//! s̈                  X
//! λ                                           X
//! ```
//!
//! With N(V) d = I (d × V) + d ×* I V + V ×* I d, sums over all i that k carries, and h = Σ I W, n = Σ N(V)ᵀ W, the
//! derivative of S is `w·F + h·e + n·d`. For a parameter p of link k and a parameter q of the same link or one that
//! carries it the second derivative is
//!
//! ```text
//! w_p·(I e_q + N d_q) + w_q·(I e_p + N d_p) + h·(e_pq + d_p × d_q) + n·d_pq + w_pq·F + d_p·(K + Kᵀ) d_q,
//! K = Σ (W ×)ᵀ I,    p = s:  d_pq = d_q × X,  e_pq = e_q × X + 2 d_q × d_p,  w_pq = w_q × X;    p = ṡ:  e_pq = 2 d_q × X
//! ```
//!
//! Recursive Newton–Euler: Featherstone, *Rigid Body Dynamics Algorithms*, 2008, section 5.3. For derivatives of this
//! kind see S. Singh, R. P. Russell, P. M. Wensing, *IEEE Trans. Robotics* 39, 2023.

use nalgebra::{Matrix3, Matrix4, Matrix6, Vector3, Vector4};

use super::Tree;
use super::drive::Taylor;
use super::screw::{Screw, angular, cross, cross_wrench, crossing, crossing_into, linear, screw};
use crate::skeleton::frame::{Frame, Vector};

/// What S is a function of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    Coordinate,
    Speed,
    Acceleration,
    /// The virtual speed λ: derivatives with respect to it are the generalised forces.
    Virtual,
}

pub const LEVELS: [Level; 4] = [Level::Coordinate, Level::Speed, Level::Acceleration, Level::Virtual];

/// Receives a second derivative: level and coordinate, twice, and its value.
pub type EachPair<'e> = &'e mut dyn FnMut((Level, usize), (Level, usize), f64);

/// Values over all coordinates of a tree.
#[derive(Clone, Copy, Debug)]
pub struct State<'a> {
    /// rad or m
    pub coordinates: &'a [f64],
    pub speeds: &'a [f64],
    pub accelerations: &'a [f64],
    /// λ; may be empty for 0.
    pub virtual_speeds: &'a [f64],
}

/// A force (N) and a moment (N m) on a link, in the ground's axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Load {
    pub link: usize,
    pub point: Point,
    pub force: Vector,
    pub moment: Vector,
}

/// Where a force acts, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Point {
    /// A point of the link, in its frame.
    OfLink(Vector),
    /// A point of the ground, whatever part of the link is there.
    OfGround(Vector),
}

/// A link at one instant.
#[derive(Clone, Debug)]
struct At {
    frame: Frame<f64>,
    /// X
    axis: Screw,
    /// V, A, W of the parent, and of the link.
    before: [Screw; 3],
    twist: [Screw; 3],
    /// u, u̇, ü and λ of the drive, and its function.
    arguments: [f64; 4],
    drive: Taylor,
    sums: Sums,
}

/// Sums over what a link carries.
#[derive(Clone, Copy, Debug)]
struct Sums {
    /// F
    force: Screw,
    inertia: Matrix6<f64>,
    /// N
    gyroscopic: Matrix6<f64>,
    /// K + Kᵀ
    bilinear: Matrix6<f64>,
    /// h
    virtual_momentum: Screw,
    /// n
    virtual_gyroscopic: Screw,
    /// How the loads' negatives change in the link's axes, per twist of what carries it; that times W, and times W once
    /// more changed.
    load_change: Matrix6<f64>,
    virtual_load_change: Screw,
    virtual_load_bend: Matrix6<f64>,
}

/// A mechanism at one instant.
#[derive(Clone, Debug)]
pub struct Dynamics<'t> {
    tree: &'t Tree,
    links: Vec<At>,
}

/// d, e and w of a parameter, and the link's twist if it is a coordinate.
struct Change {
    d: Screw,
    e: Screw,
    w: Screw,
    moves: Screw,
}

impl<'t> Dynamics<'t> {
    pub fn new(tree: &'t Tree, state: State<'_>, loads: &[Load]) -> Self {
        let mut links: Vec<At> = Vec::with_capacity(tree.links.len());
        let [gx, gy, gz] = tree.gravity;
        let ground = [Screw::zeros(), Screw::new(0.0, 0.0, 0.0, -gx, -gy, -gz), Screw::zeros()];
        for link in &tree.links {
            let arguments = [state.coordinates, state.speeds, state.accelerations, state.virtual_speeds]
                .map(|values| if values.is_empty() { 0.0 } else { link.drive.argument(values) });
            let [u, rate, second, lambda] = arguments;
            let drive = link.drive.at(u);
            let (parent, before) = match link.parent {
                Some(parent) => (links[parent].frame, links[parent].twist),
                None => (Frame::identity(), ground),
            };
            let frame = parent * link.before * link.axis.frame(drive[0]);
            let axis = link.axis.twist(&frame);
            let [v, a, w] = before;
            let velocity = v + axis * (drive[1] * rate);
            let acceleration = drive[1] * second + drive[2] * rate * rate;
            let acceleration = a + axis * acceleration + cross(&velocity, &axis) * (drive[1] * rate);
            let virtual_twist = w + axis * (drive[1] * lambda);
            let inertia = link.mass.within(&frame).matrix();
            let twist = [velocity, acceleration, virtual_twist];
            let sums = Sums::of(&inertia, twist.each_ref());
            links.push(At { frame, axis, before, twist, arguments, drive, sums });
        }
        for load in loads {
            let At { frame, sums, twist, .. } = &mut links[load.link];
            sums.put_on(load, frame, &twist[2]);
        }
        for k in (0..links.len()).rev() {
            if let Some(parent) = tree.links[k].parent {
                let carried = links[k].sums;
                links[parent].sums.add(&carried);
            }
        }
        Self { tree, links }
    }

    /// The frame of each link in the ground.
    pub fn frames(&self) -> impl Iterator<Item = &Frame<f64>> {
        self.links.iter().map(|link| &link.frame)
    }

    /// Generalised forces (N m, N) that the motion needs beside the loads: inertial forces less gravity and loads.
    pub fn generalised_forces(&self) -> Vec<f64> {
        let mut forces = vec![0.0; self.tree.coordinates];
        for (link, at) in self.tree.links.iter().zip(&self.links) {
            let force = at.drive[1] * at.axis.dot(&at.sums.force);
            link.drive.terms.iter().for_each(|&(c, weight)| forces[c] += weight * force);
        }
        forces
    }

    /// V and A of each link.
    pub fn twists(&self) -> Vec<(Screw, Screw)> {
        self.links.iter().map(|at| (at.twist[0], at.twist[1])).collect()
    }

    /// Hands second derivatives of S to `each`, in parts that add up: by those pairs of levels that `pairs` lists, of the
    /// coordinates of the links that `links` says.
    pub fn second_derivatives(&self, links: &[bool], pairs: &[(Level, Level)], each: EachPair<'_>) {
        let changes: Vec<[Change; 4]> = self.links.iter().map(At::changes).collect();
        let jacobians: Vec<Matrix4<f64>> = self.links.iter().map(At::jacobian).collect();
        for k in (0..self.links.len()).filter(|&k| links[k]) {
            let at = &self.links[k];
            let receivers = at.receivers(&changes[k]);
            for j in std::iter::successors(Some(k), |&j| self.tree.links[j].parent).filter(|&j| links[j]) {
                let of_pair = Matrix4::from_fn(|p, q| receivers[p].applied_to(&changes[j][q]));
                let mut block = jacobians[k].transpose() * of_pair * jacobians[j];
                if j == k {
                    block += at.bend(&changes[k]);
                }
                self.hand_out(&block, (k, j), pairs, each);
            }
        }
    }

    /// The block of second derivatives by the drives' arguments of link k (rows) and link j, which carries it or is it.
    fn hand_out(&self, block: &Matrix4<f64>, (k, j): (usize, usize), pairs: &[(Level, Level)], each: EachPair<'_>) {
        for &(one, weight) in &self.tree.links[k].drive.terms {
            for &(other, factor) in &self.tree.links[j].drive.terms {
                let value = |p: Level, q: Level| weight * factor * block[(p as usize, q as usize)];
                for &(p, q) in pairs {
                    each((p, one), (q, other), value(p, q));
                    if j != k {
                        each((p, other), (q, one), value(q, p));
                    }
                }
            }
        }
    }
}

impl Sums {
    /// Of one link's bodies with twist V, acceleration A and virtual twist W.
    fn of(inertia: &Matrix6<f64>, [v, a, w]: [&Screw; 3]) -> Self {
        let momentum = inertia * v;
        let (crossing_v, half) = (crossing(v), crossing(w).transpose() * inertia);
        let gyroscopic = crossing_into(&momentum) - crossing_v.transpose() * inertia - inertia * crossing_v;
        Self {
            force: inertia * a + cross_wrench(v, &momentum),
            inertia: *inertia,
            gyroscopic,
            bilinear: half + half.transpose(),
            virtual_momentum: inertia * w,
            virtual_gyroscopic: gyroscopic.transpose() * w,
            load_change: Matrix6::zeros(),
            virtual_load_change: Screw::zeros(),
            virtual_load_bend: Matrix6::zeros(),
        }
    }

    /// A load on the link's bodies: −φ. In the axes of the link a wrench that is fixed in the ground changes by −X ×* φ,
    /// the force f at a point of the link by f × ω.
    fn put_on(&mut self, load: &Load, frame: &Frame<f64>, w: &Screw) {
        let (f, moment) = (Vector3::from(load.force), Vector3::from(load.moment));
        let point = match load.point {
            Point::OfLink(point) => Vector3::from(frame.point(&point)),
            Point::OfGround(point) => Vector3::from(point),
        };
        let wrench = screw(point.cross(&f) + moment, f);
        let (change, bend) = match load.point {
            Point::OfGround(_) => {
                let into = crossing_into(&wrench);
                (-into, -into * crossing(w))
            }
            Point::OfLink(_) => {
                let (turned, speed) = (angular(w), linear(w) + angular(w).cross(&point));
                let [mut change, mut bend] = [Matrix6::zeros(); 2];
                let of_moment = point.cross_matrix() * f.cross_matrix() + moment.cross_matrix();
                change.fixed_view_mut::<3, 3>(0, 0).copy_from(&of_moment);
                change.fixed_view_mut::<3, 3>(3, 0).copy_from(&f.cross_matrix());
                let power = speed.dot(&f) + turned.dot(&moment);
                let of_turns = speed * f.transpose() + turned * moment.transpose() - Matrix3::identity() * power;
                bend.fixed_view_mut::<3, 3>(0, 0).copy_from(&of_turns);
                (change, bend)
            }
        };
        self.force -= wrench;
        self.load_change -= change;
        self.virtual_load_change -= change.transpose() * w;
        self.virtual_load_bend -= bend;
    }

    fn add(&mut self, carried: &Self) {
        self.force += carried.force;
        self.inertia += carried.inertia;
        self.gyroscopic += carried.gyroscopic;
        self.bilinear += carried.bilinear;
        self.virtual_momentum += carried.virtual_momentum;
        self.virtual_gyroscopic += carried.virtual_gyroscopic;
        self.load_change += carried.load_change;
        self.virtual_load_change += carried.virtual_load_change;
        self.virtual_load_bend += carried.virtual_load_bend;
    }
}

/// The second derivatives of S by a parameter p and each q of a link above, as a linear function of q's change.
struct Receiver {
    d: Screw,
    e: Screw,
    w: Screw,
    moves: Screw,
}

impl Receiver {
    fn applied_to(&self, q: &Change) -> f64 {
        self.d.dot(&q.d) + self.e.dot(&q.e) + self.w.dot(&q.w) + self.moves.dot(&q.moves)
    }
}

impl At {
    /// The table at the head of the module, a line for each level.
    fn changes(&self) -> [Change; 4] {
        let (x, zero) = (self.axis, Screw::zeros());
        let [v, a, w] = &self.before;
        let d = cross(v, &x);
        let e = cross(a, &x) - cross(&d, v);
        [
            Change { d, e, w: cross(w, &x), moves: x },
            Change { d: x, e: d * 2.0, w: zero, moves: zero },
            Change { d: zero, e: x, w: zero, moves: zero },
            Change { d: zero, e: zero, w: x, moves: zero },
        ]
    }

    fn receivers(&self, changes: &[Change; 4]) -> [Receiver; 4] {
        let Sums { force, inertia, gyroscopic, bilinear, virtual_momentum, virtual_gyroscopic, .. } = &self.sums;
        let x = &self.axis;
        let mut receivers = [0, 1, 2, 3].map(|p| {
            let Change { d, e, w, moves } = &changes[p];
            Receiver {
                e: inertia * w,
                d: gyroscopic.transpose() * w + bilinear * d,
                w: inertia * e + gyroscopic * d + self.sums.load_change * moves,
                moves: self.sums.load_change.transpose() * w + self.sums.virtual_load_bend * moves,
            }
        });
        let momentum_turned = cross_wrench(x, virtual_momentum);
        let [of_coordinate, of_speed, ..] = &mut receivers;
        of_coordinate.e += momentum_turned;
        of_coordinate.d += cross_wrench(&changes[0].d, virtual_momentum) + cross_wrench(x, virtual_gyroscopic);
        of_coordinate.w += cross_wrench(x, force);
        of_speed.d += momentum_turned;
        receivers
    }

    /// ∂(s, ṡ, s̈, λ) by those of the drive's argument.
    fn jacobian(&self) -> Matrix4<f64> {
        let ([_, f1, f2, f3, _], [_, rate, second, lambda]) = (self.drive, self.arguments);
        Matrix4::new(
            f1,
            0.0,
            0.0,
            0.0,
            f2 * rate,
            f1,
            0.0,
            0.0,
            f2 * second + f3 * rate * rate,
            2.0 * f2 * rate,
            f1,
            0.0,
            f2 * lambda,
            0.0,
            0.0,
            f1,
        )
    }

    /// The part of the second derivatives by the drive's arguments that comes from the drive's curvature.
    fn bend(&self, changes: &[Change; 4]) -> Matrix4<f64> {
        let ([_, _, f2, f3, f4], [_, rate, second, lambda]) = (self.drive, self.arguments);
        let Sums { force, virtual_momentum, virtual_gyroscopic, virtual_load_change, .. } = &self.sums;
        let slope = |c: &Change| {
            c.w.dot(force) + c.e.dot(virtual_momentum) + c.d.dot(virtual_gyroscopic) + c.moves.dot(virtual_load_change)
        };
        let [s, v, a, l] = Vector4::from_fn(|p, _| slope(&changes[p])).into();
        let of_coordinate = s * f2 + v * f3 * rate + a * (f3 * second + f4 * rate * rate) + l * f3 * lambda;
        let mixed = v * f2 + a * 2.0 * f3 * rate;
        Matrix4::new(
            of_coordinate,
            mixed,
            a * f2,
            l * f2,
            mixed,
            2.0 * a * f2,
            0.0,
            0.0,
            a * f2,
            0.0,
            0.0,
            0.0,
            l * f2,
            0.0,
            0.0,
            0.0,
        )
    }
}
