//! Radau IIA collocation of the stabilised index-2 form (`scheme = "radau"`): damps what the midpoint rule lets ring.
//!
//! `p − 1` intervals of length h with s = 1, 2 or 3 points `t_k + c_i h` each, the right end included. States (coordinates q,
//! velocities v, fibre lengths l, activations a) are continuous polynomials of degree s on each interval, known by their
//! values at t_1 and at every point; controls and algebraic variables (excitations u, reactions f_r, stabilisers η) are of
//! degree s − 1, known at the points, and have no value at t_1.
//! (E. Hairer and G. Wanner, *Solving Ordinary Differential Equations II*, Springer 1996, IV.5 and VII.4.)
//!
//! At each point: all equations. At t_1: those among values of states only, Φ = 0 and Φ_q v = 0, and of a rigid tendon eq. (3)
//! too, which then says where the fibre is. `initial = "equilibrium"` also l̇ = 0 at the first point of the other muscles:
//! without it the initial fibre length acts only through f_v within the first step, and the optimum drives it to saturation.
//!
//! Order of the decision vector, banded in time: `q v l a at t_1 | q v l a u f_r η at the first point | … | at the last`.

use super::coefficients::{Coefficients, Family};
use super::scheme::{Combination, Discretisation, Place, Trajectory};
use crate::problem::{AtStart, ControlProblem, Kind, Quantity, QuantityId};

/// Points c_i and weights b_i of the Radau IIA formulas with 1, 2 and 3 stages.
pub fn tableau(stages: usize) -> (Vec<f64>, Vec<f64>) {
    let root = 6f64.sqrt();
    match stages {
        1 => (vec![1.0], vec![1.0]),
        2 => (vec![1.0 / 3.0, 1.0], vec![0.75, 0.25]),
        3 => (
            vec![(4.0 - root) / 10.0, (4.0 + root) / 10.0, 1.0],
            vec![(16.0 - root) / 36.0, (16.0 + root) / 36.0, 1.0 / 9.0],
        ),
        _ => panic!("Radau IIA with {stages} stages is not offered"),
    }
}

/// Values (or first or second derivatives) at `x` of the Lagrange polynomials on `nodes`.
pub fn lagrange(nodes: &[f64], x: f64, derivative: usize) -> Vec<f64> {
    let n = nodes.len();
    let product = |i: usize, skip: &[usize]| -> f64 {
        (0..n).filter(|j| *j != i && !skip.contains(j)).map(|j| x - nodes[j]).product()
    };
    (0..n)
        .map(|i| {
            let scale: f64 = (0..n).filter(|&j| j != i).map(|j| nodes[i] - nodes[j]).product();
            let others = || (0..n).filter(move |&j| j != i);
            let sum: f64 = match derivative {
                0 => product(i, &[]),
                1 => others().map(|j| product(i, &[j])).sum(),
                _ => others().flat_map(|j| others().filter(move |&k| k != j).map(move |k| product(i, &[j, k]))).sum(),
            };
            sum / scale
        })
        .collect()
}

#[derive(Clone, Debug)]
pub struct Radau {
    stages: usize,
    h: f64,
    /// Ends of the intervals, s.
    breakpoints: Vec<f64>,
    /// t_1 and every Radau point, s.
    points: Vec<f64>,
    /// 0 and c_i: the nodes of the continuous functions.
    nodes: Vec<f64>,
    weights: Vec<f64>,
    /// By quantity.
    kinds: Vec<Kind>,
    coefficients: Coefficients,
    starts: Vec<AtStart>,
}

impl Radau {
    /// `intervals` of equal length on `duration` seconds with `stages` points each.
    pub fn new(problem: &ControlProblem<'_>, intervals: usize, stages: usize, duration: f64) -> Self {
        let (c, weights) = tableau(stages);
        let h = duration / intervals as f64;
        let breakpoints: Vec<f64> = (0..=intervals).map(|k| k as f64 * h).collect();
        let mut points = vec![0.0];
        points.extend((0..intervals).flat_map(|k| c.iter().map(move |c| (k as f64 + c) * h).collect::<Vec<_>>()));
        let mut nodes = vec![0.0];
        nodes.extend(&c);
        let family = |quantity: &Quantity| Family {
            members: quantity.members.len(),
            blocks: match quantity.kind {
                Kind::State { order } => {
                    assert_eq!(order, 1, "{}: Radau collocation needs the first-order form", quantity.name);
                    0..points.len()
                }
                Kind::Control | Kind::Algebraic => 1..points.len(),
                Kind::Given => 0..0,
            },
            initial: 0,
        };
        Self {
            kinds: problem.quantities.iter().map(|quantity| quantity.kind).collect(),
            coefficients: Coefficients::new(problem.quantities.iter().map(family).collect()),
            starts: problem.starts.clone(),
            stages,
            h,
            breakpoints,
            points,
            nodes,
            weights,
        }
    }
}

impl Discretisation for Radau {
    fn points(&self) -> &[f64] {
        &self.points
    }

    fn breakpoints(&self) -> &[f64] {
        &self.breakpoints
    }

    fn coefficients(&self) -> &Coefficients {
        &self.coefficients
    }

    /// The end of an interval, a point of its own, belongs to it.
    fn place(&self, t: f64) -> Place {
        let last = self.breakpoints.len() - 2;
        let k = self.breakpoints.partition_point(|&b| b < t).saturating_sub(1).min(last);
        Place { time: t, piece: Some(k), share: (t - self.breakpoints[k]) / self.h }
    }

    fn point(&self, j: usize) -> Place {
        let time = self.points[j];
        if j == 0 {
            return Place { time, piece: None, share: 0.0 };
        }
        Place { time, piece: Some((j - 1) / self.stages), share: self.nodes[(j - 1) % self.stages + 1] }
    }

    fn stage(&self, point: usize) -> usize {
        self.point(point).piece.map_or(0, |interval| 1 + interval)
    }

    fn function(&self, place: Place, quantity: QuantityId, member: usize, derivative: usize) -> Combination {
        let is_state = self.kinds[quantity.0].is_state();
        let index = |k| self.coefficients.index(quantity, k, member);
        let Some(interval) = place.piece else {
            return if is_state && derivative == 0 { vec![(index(0), 1.0)] } else { Combination::new() };
        };
        let nodes = if is_state { &self.nodes[..] } else { &self.nodes[1..] };
        let scale = self.h.powi(-(derivative as i32));
        let values = lagrange(nodes, place.share, derivative);
        let terms = values.into_iter().enumerate().map(|(n, w)| (index(interval * self.stages + n), scale * w));
        terms.filter(|(_, w)| *w != 0.0).collect()
    }

    fn is_complete(&self, point: usize) -> bool {
        point > 0
    }

    fn quadrature(&self) -> Vec<f64> {
        let mut weights = vec![0.0];
        weights.extend((1..self.breakpoints.len()).flat_map(|_| self.weights.iter().map(|b| b * self.h)));
        weights
    }

    /// The rates at the first point of the functions that have one at the start; times h, to be of the size of a value.
    fn linear(&self) -> Vec<Combination> {
        let rate = |start: &AtStart| self.function(self.point(1), start.state, start.member, 1);
        self.starts.iter().map(|start| rate(start).into_iter().map(|(i, w)| (i, w * self.h)).collect()).collect()
    }

    fn linear_constants(&self) -> Vec<f64> {
        self.starts.iter().map(|start| start.rate * self.h).collect()
    }

    fn settle(&self, x: &mut [f64]) {
        let slope = lagrange(&self.nodes, self.nodes[1], 1);
        for start in &self.starts {
            let index = |n| self.coefficients.index(start.state, n, start.member);
            let rest: f64 = (1..slope.len()).map(|n| slope[n] * x[index(n)]).sum();
            x[index(0)] = (start.rate * self.h - rest) / slope[0];
        }
    }

    fn compose(&self, functions: &dyn Trajectory) -> Vec<f64> {
        let mut x = vec![0.0; self.coefficients.total()];
        for (id, kind) in self.kinds.iter().enumerate() {
            let (id, first) = (QuantityId(id), usize::from(!kind.is_state()));
            for k in 0..self.coefficients.count(id) {
                for member in 0..self.coefficients.members(id) {
                    let value = functions.value(self.points[first + k], id, member, 0);
                    x[self.coefficients.index(id, k, member)] = value;
                }
            }
        }
        self.settle(&mut x);
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_points_integrate_polynomials_to_the_order_of_the_formula() {
        for stages in 1..=3 {
            let (c, b) = tableau(stages);
            for power in 0..2 * stages - 1 {
                let sum: f64 = c.iter().zip(&b).map(|(c, b)| b * c.powi(power as i32)).sum();
                assert!((sum - 1.0 / (power + 1) as f64).abs() < 1e-15, "{stages} {power}");
            }
            assert_eq!(c[stages - 1], 1.0);
        }
    }

    #[test]
    fn lagrange_polynomials_reproduce_polynomials_and_their_derivatives() {
        let nodes = [0.0, 0.2, 0.7, 1.0];
        let f = |x: f64| [x.powi(3) - x, 3.0 * x * x - 1.0, 6.0 * x];
        for x in [0.0, 0.31, 1.0] {
            for derivative in 0..3 {
                let value: f64 =
                    lagrange(&nodes, x, derivative).iter().zip(nodes).map(|(w, node)| w * f(node)[0]).sum();
                assert!((value - f(x)[derivative]).abs() < 1e-12);
            }
        }
    }
}
