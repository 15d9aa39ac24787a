//! The joint coordinates of a spatial model: which of them move by forces, and where everything is in a pose.

use std::cell::RefCell;
use std::rc::Rc;
use std::sync::atomic::{AtomicU64, Ordering};

use nalgebra::DMatrix;

use crate::model::tree::pose::PlacedLink;
use crate::model::tree::{Link, Tree};
use crate::numerics::Scalar;
use crate::skeleton::ball::Ball;
use crate::skeleton::frame::Frame;
use crate::skeleton::{Role, Skeleton};

/// A tree of links, and who moves its coordinates.
#[derive(Clone, Debug)]
pub struct Linkage {
    pub tree: Tree,
    /// Coordinates of the tree that move by forces: the unknowns. In their order, with the angles of a ball joint in the
    /// place of its own coordinates.
    pub free: Vec<usize>,
    /// Coordinates whose motion is given, in the order in which they follow the unknowns.
    pub given: Vec<usize>,
    pub balls: Vec<Ball>,
    /// Of each link: whether it moves by forces itself.
    pub is_free: Vec<bool>,
    /// Values of all coordinates in the default pose, which locked ones keep.
    default: Vec<f64>,
    /// Of each coordinate of the tree: which of the free and given ones it is.
    number: Vec<Option<usize>>,
    /// Tells poses of this linkage from those of others.
    id: u64,
}

/// Everything that depends on the pose alone.
#[derive(Debug)]
pub struct Pose {
    /// Values of all coordinates of the tree; those that follow others, and a ball joint's own, are not up to date.
    pub coordinates: Vec<f64>,
    pub links: Vec<PlacedLink<f64>>,
}

/// Linkage, coordinates and pose.
type CachedPose = (u64, Vec<f64>, Rc<Pose>);

thread_local! {
    /// The last pose, because all muscles ask for the same one after another.
    static LAST: RefCell<Option<CachedPose>> = const { RefCell::new(None) };
}

impl Linkage {
    pub fn new(skeleton: &Skeleton) -> Self {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        let count = skeleton.coordinates.len();
        let mut moved_by_forces = vec![false; count];
        for joint in skeleton.joints.iter().filter(|joint| skeleton.bodies[joint.child].role == Role::Free) {
            joint.motion.coordinates().into_iter().for_each(|c| moved_by_forces[c] = true);
        }
        let moves = |c: &usize| skeleton.coordinates[*c].is_independent();
        let (mut free, given): (Vec<usize>, Vec<usize>) = (0..count).filter(moves).partition(|&c| moved_by_forces[c]);
        let balls = skeleton.balls();
        let tree = Tree::with_balls(skeleton, &balls);
        let mut default = skeleton.default_pose();
        for (k, ball) in balls.iter().enumerate() {
            for (i, c) in ball.coordinates.iter().enumerate() {
                free.iter_mut().filter(|free| *free == c).for_each(|free| *free = count + 3 * k + i);
            }
            let rotation = skeleton.joints[ball.joint].motion.frame(&default);
            default.extend(ball.angles(&rotation, [0.0; 3]));
        }
        let mut number = vec![None; tree.coordinates];
        free.iter().chain(&given).enumerate().for_each(|(i, &c)| number[c] = Some(i));
        let is_free = |link: &Link| link.drive.terms.iter().any(|&(c, _)| number[c].is_some_and(|i| i < free.len()));
        let is_free = tree.links.iter().map(is_free).collect();
        Self { tree, free, given, balls, is_free, default, number, id: NEXT.fetch_add(1, Ordering::Relaxed) }
    }

    /// The number of a coordinate of the tree among those that move by forces.
    pub fn free_number(&self, coordinate: usize) -> Option<usize> {
        self.number[coordinate].filter(|&i| i < self.free.len())
    }

    /// The number of a coordinate of the tree among the free and the given ones.
    pub fn number(&self, coordinate: usize) -> Option<usize> {
        self.number[coordinate]
    }

    /// Values of the free and the given coordinates in the default pose.
    pub fn default_coordinates(&self) -> Vec<f64> {
        self.free.iter().chain(&self.given).map(|&c| self.default[c]).collect()
    }

    /// Values of the tree's coordinates, from those of the free and the given ones. The given ones may be missing: they
    /// are then in their default pose.
    pub fn coordinates<T: Scalar>(&self, q: &[T]) -> Vec<T> {
        let mut all: Vec<T> = self.default.iter().map(|&x| T::from(x)).collect();
        self.free.iter().chain(&self.given).zip(q).for_each(|(&c, &value)| all[c] = value);
        all
    }

    /// The ball joint that has this coordinate of the skeleton as one of its own, and which of the three.
    pub fn ball_of(&self, coordinate: usize) -> Option<(usize, usize)> {
        let at = |ball: &Ball| ball.coordinates.iter().position(|&c| c == coordinate);
        self.balls.iter().enumerate().find_map(|(k, ball)| Some((k, at(ball)?)))
    }

    /// The coordinate of the tree that is the i-th angle of a ball joint.
    pub fn ball_angle(&self, ball: usize, i: usize) -> usize {
        self.tree.coordinates - 3 * (self.balls.len() - ball) + i
    }

    /// Coordinates of the skeleton that move by forces, in the order of the unknowns.
    pub fn moved(&self) -> Vec<usize> {
        let own = self.tree.coordinates - 3 * self.balls.len();
        let moved = |&c: &usize| if c < own { c } else { self.balls[(c - own) / 3].coordinates[(c - own) % 3] };
        self.free.iter().map(moved).collect()
    }

    /// Rates or accelerations of the tree's coordinates, from those of the free and the given ones.
    pub fn rates(&self, rates: &[f64]) -> Vec<f64> {
        let mut all = vec![0.0; self.number.len()];
        self.free.iter().chain(&self.given).zip(rates).for_each(|(&c, &rate)| all[c] = rate);
        all
    }

    pub fn pose(&self, q: &[f64]) -> Rc<Pose> {
        LAST.with_borrow_mut(|last| match last {
            Some((id, at, pose)) if *id == self.id && at == q => pose.clone(),
            _ => {
                let coordinates = self.coordinates(q);
                let pose = Rc::new(Pose { links: self.tree.pose(&coordinates), coordinates });
                *last = Some((self.id, q.to_vec(), pose.clone()));
                pose
            }
        })
    }

    /// The frames of all bodies.
    pub fn frames(&self, q: &[f64]) -> Vec<Frame<f64>> {
        let pose = self.pose(q);
        let frame = |&(link, inner): &(Option<usize>, Frame<f64>)| link.map_or(inner, |k| pose.links[k].frame * inner);
        self.tree.places.iter().map(frame).collect()
    }

    /// The links that carry a link, the outermost first, and the link itself.
    pub fn chain(&self, link: Option<usize>) -> Vec<usize> {
        let mut chain: Vec<usize> = std::iter::successors(link, |&k| self.tree.links[k].parent).collect();
        chain.reverse();
        chain
    }

    /// Whether forces move a body.
    pub fn moves(&self, body: usize) -> bool {
        self.chain(self.tree.places[body].0).into_iter().any(|link| self.is_free[link])
    }

    /// How far the coordinates that move by forces turn (rad) what they carry and move its centres of mass (m): the sum of
    /// ω_iᵀ ω_j + v_iᵀ v_j over links with mass.
    pub fn metric(&self, q: &[f64]) -> DMatrix<f64> {
        let (pose, n) = (self.pose(q), self.free.len());
        let mut metric = DMatrix::zeros(n, n);
        for (link, centre) in self.tree.centres_of_mass() {
            let centre = pose.links[link].frame.point(&centre);
            let mut moves: DMatrix<f64> = DMatrix::zeros(6, n);
            for carrier in self.chain(Some(link)) {
                let placed = &pose.links[carrier];
                for &(c, weight) in &self.tree.links[carrier].drive.terms {
                    let Some(i) = self.free_number(c) else { continue };
                    let both = placed.turn().into_iter().chain(placed.moves_point(&centre));
                    both.enumerate().for_each(|(axis, x)| moves[(axis, i)] += weight * placed.slope * x);
                }
            }
            metric += moves.tr_mul(&moves);
        }
        metric
    }
}
