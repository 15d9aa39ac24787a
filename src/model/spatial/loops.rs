//! Points of two bodies that are held together: three constraints Φ = Rᵀ (x_a − x_b) (m) over joint coordinates, in the
//! axes R of the last link that carries both. Only links further out change them.
//!
//! Each link j that carries a point moves it by ∂x/∂s_j; for a link i that carries j, or is j, the second derivative is
//! ∂²x/∂s_i ∂s_j = ω_i × ∂x/∂s_j (0 if i slides).

use super::linkage::Linkage;
use crate::model::mechanics::EachConstraint;
use crate::model::tree::pose::{PlacedLink, turned};
use crate::numerics::Scalar;
use crate::skeleton::HeldPoint;
use crate::skeleton::frame::Vector;

#[derive(Clone, Debug)]
pub struct Loop {
    pub name: String,
    bodies: [usize; 2],
    sides: [Side; 2],
    /// The last link that carries both.
    common: Option<usize>,
    /// Numbers of the coordinates that the functions depend on, free and given ones.
    slots: Vec<usize>,
}

#[derive(Clone, Debug)]
struct Side {
    link: Option<usize>,
    /// In the link's frame.
    point: Vector,
    /// Links that carry this point and not the other, with slots and weights of their drives.
    links: Vec<(usize, Vec<(usize, f64)>)>,
}

/// Constraints of a loop.
pub const ROWS: usize = 3;

impl Loop {
    /// `None` if no force moves one point against the other.
    pub fn new(linkage: &Linkage, held: &HeldPoint) -> Option<Self> {
        let places = held.bodies.map(|body| linkage.tree.places[body]);
        let [a, b] = places.map(|(link, _)| linkage.chain(link));
        let without = |one: &[usize], other: &[usize]| one.iter().filter(|l| !other.contains(l)).copied().collect();
        let own: [Vec<usize>; 2] = [without(&a, &b), without(&b, &a)];
        let numbers = |link: usize| {
            let terms = linkage.tree.links[link].drive.terms.iter();
            terms.filter_map(|&(c, weight)| Some((linkage.number(c)?, weight))).collect::<Vec<_>>()
        };
        let common = a.iter().rev().find(|link| b.contains(link)).copied();
        if !own.iter().flatten().any(|&link| linkage.is_free[link]) {
            return None;
        }
        let mut slots: Vec<usize> =
            own.iter().flatten().flat_map(|&link| numbers(link)).map(|(number, _)| number).collect();
        slots.sort_unstable();
        slots.dedup();
        let slot = |(number, weight)| (slots.binary_search(&number).expect("listed before"), weight);
        let sides = [0, 1].map(|side| Side {
            link: places[side].0,
            point: places[side].1.point(&held.points[side]),
            links: own[side].iter().map(|&link| (link, numbers(link).into_iter().map(slot).collect())).collect(),
        });
        Some(Self { name: held.name.clone(), bodies: held.bodies, sides, common, slots })
    }

    /// Hands the three functions to `each`, the first of which has the number `row`.
    pub fn functions<T: Scalar>(&self, links: &[PlacedLink<T>], row: usize, each: EachConstraint<'_, T>) {
        let (n, zero) = (self.slots.len(), T::from(0.0));
        let mut value = [zero; ROWS];
        let mut gradient = vec![zero; ROWS * n];
        let mut hessian = vec![zero; ROWS * n * n];
        for (side, sign) in self.sides.iter().zip([1.0, -1.0]) {
            let point = side.point.map(T::from);
            let point = side.link.map_or(point, |link| links[link].frame.point(&point));
            (0..ROWS).for_each(|i| value[i] += point[i] * sign);
            for (j, (link, terms)) in side.links.iter().enumerate() {
                let at = &links[*link];
                let moves = at.moves_point(&point).map(|x| x * sign);
                for &(slot, weight) in terms {
                    (0..ROWS).for_each(|i| gradient[i * n + slot] += moves[i] * at.slope * weight);
                }
                for (i, (carrier, of_carrier)) in side.links[..=j].iter().enumerate() {
                    let carrier = &links[*carrier];
                    let mut second = carrier.moves_direction(&moves).map(|x| x * carrier.slope * at.slope);
                    if i == j {
                        (0..ROWS).for_each(|axis| second[axis] += moves[axis] * at.bend);
                    }
                    for &(one, weight) in of_carrier {
                        for &(other, factor) in terms {
                            for axis in 0..ROWS {
                                let value = second[axis] * (weight * factor);
                                hessian[(axis * n + one) * n + other] += value;
                                if i != j {
                                    hessian[(axis * n + other) * n + one] += value;
                                }
                            }
                        }
                    }
                }
            }
        }
        if let Some(common) = self.common {
            let axes = links[common].frame.axes;
            turn_back(&axes, &mut value);
            turn_back(&axes, &mut gradient);
            turn_back(&axes, &mut hessian);
        }
        for i in 0..ROWS {
            each(row + i, &self.slots, value[i], &gradient[i * n..(i + 1) * n], &hessian[i * n * n..(i + 1) * n * n]);
        }
    }
}

impl Loop {
    /// Whether the functions depend on a coordinate.
    pub fn depends_on(&self, number: usize) -> bool {
        self.slots.contains(&number)
    }

    /// The forces (N) of a reaction, which acts against Φ, on the two bodies, with their points (m); in the ground's axes.
    pub fn forces(&self, links: &[PlacedLink<f64>], reaction: &Vector) -> [(usize, Vector, Vector); 2] {
        let force = self.common.map_or(*reaction, |common| turned(&links[common].frame, reaction));
        [(0, -1.0), (1, 1.0)].map(|(k, sign)| {
            let side = &self.sides[k];
            let point = side.link.map_or(side.point, |link| links[link].frame.point(&side.point));
            (self.bodies[k], point, force.map(|x| sign * x))
        })
    }
}

/// Turns vectors, given axis by axis, into these axes.
fn turn_back<T: Scalar>(axes: &[[T; 3]; 3], values: &mut [T]) {
    let n = values.len() / 3;
    for k in 0..n {
        let x = [0, 1, 2].map(|i| values[i * n + k]);
        (0..3).for_each(|j| values[j * n + k] = (0..3).map(|i| axes[i][j] * x[i]).sum());
    }
}
