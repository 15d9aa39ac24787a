//! Radau IIA collocation of the stabilised index-2 form (`scheme = "radau"`): damps what the midpoint rule lets ring.
//!
//! `p − 1` intervals of length h with s = 1, 2 or 3 points `t_k + c_i h` each, the right end included. Coordinates q, velocities v, fibre
//! lengths l and activations a are continuous polynomials of degree s on each interval, known by their values at t_1 and at every point;
//! reactions f_r, stabilisers η and excitations u are of degree s − 1, known at the points, and have no value at t_1.
//! (E. Hairer and G. Wanner, *Solving Ordinary Differential Equations II*, Springer 1996, IV.5 and VII.4.)
//!
//! At each point: all equations of [`super::instant`] in the form [`Form::Stabilised`]. At t_1: Φ = 0 and Φ_q v = 0 only, and of
//! a rigid tendon eq. (3) too, which then says where the fibre is. `initial = "equilibrium"` also l̇ = 0 at the first point of the other muscles: without it the initial fibre length acts only
//! through f_v within the first step, and the optimum drives it to saturation.
//!
//! Order of the decision vector, banded in time: `q v l a at t_1 | q v l a u f_r η at the first point | … | at the last`.

use super::collocation::{Combination, Layout, Point};
use super::instant::{Form, Instant};
use super::scheme::{Discretisation, Trajectory};

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
    equilibrium: bool,
    /// Muscles whose fibre length follows from the coordinates, at t_1 too.
    rigid: Vec<bool>,
    nq: usize,
    nm: usize,
    nc: usize,
}

/// The groups of unknowns of one point, in this order; the last three have none at t_1.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Group {
    Coordinate,
    Velocity,
    Length,
    Activation,
    Excitation,
    Reaction,
    Stabiliser,
}

impl Radau {
    /// `intervals` of equal length on `duration` seconds with `stages` points each; `equilibrium`: l̇ = 0 at the first point.
    pub fn new(instant: &Instant<'_>, intervals: usize, stages: usize, duration: f64, equilibrium: bool) -> Self {
        assert_eq!(instant.form, Form::Stabilised, "Radau collocation needs the stabilised form");
        let (c, weights) = tableau(stages);
        let h = duration / intervals as f64;
        let breakpoints: Vec<f64> = (0..=intervals).map(|k| k as f64 * h).collect();
        let mut points = vec![0.0];
        points.extend((0..intervals).flat_map(|k| c.iter().map(move |c| (k as f64 + c) * h).collect::<Vec<_>>()));
        let mut nodes = vec![0.0];
        nodes.extend(&c);
        let model = instant.model;
        Self {
            stages,
            h,
            breakpoints,
            points,
            nodes,
            weights,
            equilibrium,
            rigid: model.muscles.iter().map(|muscle| muscle.rigid_tendon).collect(),
            nq: model.coordinates(),
            nm: model.muscles.len(),
            nc: model.constraints(),
        }
    }

    /// Index of entry `i` of a group at point `k`, counted from t_1 = 0.
    fn index(&self, k: usize, group: Group, i: usize) -> usize {
        let states = 2 * (self.nq + self.nm);
        let block = states + self.nm + 2 * self.nc;
        let start = if k == 0 { 0 } else { states + (k - 1) * block };
        let offset = match group {
            Group::Coordinate => 0,
            Group::Velocity => self.nq,
            Group::Length => 2 * self.nq,
            Group::Activation => 2 * self.nq + self.nm,
            Group::Excitation => states,
            Group::Reaction => states + self.nm,
            Group::Stabiliser => states + self.nm + self.nc,
        };
        debug_assert!(k > 0 || offset < states, "{group:?} has no value at t_1");
        start + offset + i
    }

    /// The interval that holds `t`, and the place in it, 0 … 1. The end of an interval, a point of its own, belongs to it.
    fn place(&self, t: f64) -> (usize, f64) {
        let last = self.breakpoints.len() - 2;
        let k = self.breakpoints.partition_point(|&b| b < t).saturating_sub(1).min(last);
        (k, (t - self.breakpoints[k]) / self.h)
    }

    /// A continuous function, or a derivative, at a place in an interval.
    fn state(&self, (interval, at): (usize, f64), derivative: usize, group: Group, i: usize) -> Combination {
        let scale = self.h.powi(-(derivative as i32));
        let values = lagrange(&self.nodes, at, derivative);
        (values.into_iter().enumerate())
            .map(|(n, w)| (self.index(interval * self.stages + n, group, i), scale * w))
            .filter(|(_, w)| *w != 0.0)
            .collect()
    }

    /// A function without a value at t_1, at a place in an interval.
    fn control(&self, (interval, at): (usize, f64), group: Group, i: usize) -> Combination {
        let values = lagrange(&self.nodes[1..], at, 0);
        (values.into_iter().enumerate())
            .map(|(n, w)| (self.index(interval * self.stages + n + 1, group, i), w))
            .filter(|(_, w)| *w != 0.0)
            .collect()
    }

    /// The local variables at a place in an interval.
    fn local(&self, instant: &Instant<'_>, place: (usize, f64)) -> Vec<Combination> {
        let mut map = vec![Combination::new(); instant.variables()];
        for i in 0..self.nq {
            map[i] = self.state(place, 0, Group::Coordinate, i);
            map[instant.acceleration(i)] = self.state(place, 1, Group::Velocity, i);
            map[instant.velocity(i)] = self.state(place, 0, Group::Velocity, i);
            map[instant.rate(i)] = self.state(place, 1, Group::Coordinate, i);
        }
        for m in 0..self.nm {
            let at = instant.muscle(m);
            map[at] = self.state(place, 0, Group::Activation, m);
            map[at + 1] = self.state(place, 0, Group::Length, m);
            map[at + 2] = self.state(place, 1, Group::Length, m);
            map[at + 3] = self.state(place, 1, Group::Activation, m);
            map[at + 4] = self.control(place, Group::Excitation, m);
        }
        for c in 0..self.nc {
            map[instant.reaction(c)] = self.control(place, Group::Reaction, c);
            map[instant.stabiliser(c)] = self.control(place, Group::Stabiliser, c);
        }
        map
    }

    /// Interval and place of a point; t_1 is none.
    fn point(&self, j: usize) -> (usize, f64) {
        ((j - 1) / self.stages, self.nodes[(j - 1) % self.stages + 1])
    }
}

impl Discretisation for Radau {
    fn points(&self) -> &[f64] {
        &self.points
    }

    fn breakpoints(&self) -> &[f64] {
        &self.breakpoints
    }

    fn variables(&self) -> usize {
        self.index(self.points.len(), Group::Coordinate, 0)
    }

    fn layout(&self, instant: &Instant<'_>) -> Layout {
        let mut start = vec![Combination::new(); instant.variables()];
        for i in 0..self.nq {
            start[i] = vec![(self.index(0, Group::Coordinate, i), 1.0)];
            start[instant.velocity(i)] = vec![(self.index(0, Group::Velocity, i), 1.0)];
        }
        for m in 0..self.nm {
            start[instant.muscle(m)] = vec![(self.index(0, Group::Activation, m), 1.0)];
            start[instant.muscle(m) + 1] = vec![(self.index(0, Group::Length, m), 1.0)];
        }
        let [constraint, contraction, _] = instant.row_starts();
        let [_, velocity] = instant.stabilised_row_starts();
        let fibres = (0..self.nm).filter(|&m| self.rigid[m]).map(|m| contraction + m);
        let rows = (constraint..contraction).chain(fibres).chain(velocity..instant.equations()).collect();
        let mut points = vec![Point { map: start, rows, complete: false }];
        points.extend((1..self.points.len()).map(|j| {
            let rows = (0..instant.equations()).collect();
            Point { map: self.local(instant, self.point(j)), rows, complete: true }
        }));
        let linear = if self.equilibrium {
            // Scaled by h, to be of the size of a fibre length.
            let scaled = |m| self.state(self.point(1), 1, Group::Length, m).into_iter().map(|(i, w)| (i, w * self.h));
            (0..self.nm).filter(|&m| !self.rigid[m]).map(|m| scaled(m).collect()).collect()
        } else {
            Vec::new()
        };
        Layout { times: self.points.clone(), variables: self.variables(), points, linear }
    }

    fn local_at(&self, instant: &Instant<'_>, t: f64) -> Vec<Combination> {
        self.local(instant, self.place(t))
    }

    fn coordinate_at(&self, t: f64, derivative: usize, i: usize) -> Combination {
        match derivative {
            // The velocity of the first-order form is the better one.
            0 => self.state(self.place(t), 0, Group::Coordinate, i),
            _ => self.state(self.place(t), derivative - 1, Group::Velocity, i),
        }
    }

    fn activation_at(&self, t: f64, m: usize) -> Combination {
        self.state(self.place(t), 0, Group::Activation, m)
    }

    fn quadrature(&self) -> Vec<f64> {
        let mut weights = vec![0.0];
        weights.extend((1..self.breakpoints.len()).flat_map(|_| self.weights.iter().map(|b| b * self.h)));
        weights
    }

    fn state_coefficients(&self) -> usize {
        self.points.len()
    }

    fn length_index(&self, k: usize, m: usize) -> usize {
        self.index(k, Group::Length, m)
    }

    fn activation_index(&self, k: usize, m: usize) -> usize {
        self.index(k, Group::Activation, m)
    }

    fn control_coefficients(&self) -> usize {
        self.points.len() - 1
    }

    fn excitation_index(&self, j: usize, m: usize) -> usize {
        self.index(j + 1, Group::Excitation, m)
    }

    fn settle(&self, x: &mut [f64]) {
        if self.equilibrium {
            // The initial fibre length that gives l̇ = 0 at the first point.
            let slope = lagrange(&self.nodes, self.nodes[1], 1);
            for m in (0..self.nm).filter(|&m| !self.rigid[m]) {
                let rest: f64 = (1..slope.len()).map(|n| slope[n] * x[self.length_index(n, m)]).sum();
                x[self.length_index(0, m)] = -rest / slope[0];
            }
        }
    }

    fn compose(&self, functions: &dyn Trajectory) -> Vec<f64> {
        let mut x = vec![0.0; self.variables()];
        for (k, &t) in self.points.iter().enumerate() {
            for i in 0..self.nq {
                x[self.index(k, Group::Coordinate, i)] = functions.coordinate(t, 0, i);
                x[self.index(k, Group::Velocity, i)] = functions.coordinate(t, 1, i);
            }
            for m in 0..self.nm {
                x[self.length_index(k, m)] = functions.length(t, m);
                x[self.activation_index(k, m)] = functions.activation(t, m);
                if k > 0 {
                    x[self.index(k, Group::Excitation, m)] = functions.excitation(t, m);
                }
            }
            for c in 0..if k > 0 { self.nc } else { 0 } {
                x[self.index(k, Group::Reaction, c)] = functions.reaction(t, c);
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
