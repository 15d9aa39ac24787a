//! The thesis' transcription: B-splines with exactly one collocation point in each span (`scheme = "midpoint"`).
//!
//! `p` collocation points `t_j = (j − 1) h`; breakpoints at the midpoints between neighbouring points, and the two ends:
//! `p` spans. A function of degree d has `p + d` coefficients: p equations at the points, and d initial values φ, which
//! are unknowns with equality rows of their own (thesis, Paper B eq. 13). Body coordinates have degree 2, fibre length
//! and activation 1, excitation and reactions 0 ("the same degree as its highest derivative").
//!
//! Order of the decision vector, which keeps the problem banded in time:
//!
//! ```text
//! φ = q, q̇, l, a at t_1 | span 1: q l a u f_r | span 2: q l a u f_r | … | span p | tail: q l a | q
//! ```
//!
//! with coefficient k of each spline in block k. Equalities: the initial values, then point by point eqs (1)–(4)
//! in the order of [`super::instant`].
//!
//! One point in the middle of a span is the implicit midpoint rule, which damps nothing: fibre velocities alternate
//! from point to point and do not converge with h. See the README.

use super::collocation::{Combination, Layout, Point, evaluate};
use super::instant::{Form, Instant};
use super::scheme::{Discretisation, Trajectory};
use crate::numerics::bspline::{Basis, SplineSpace};

/// The spline spaces and the place of every coefficient in the decision vector.
#[derive(Clone, Debug)]
pub struct Midpoint {
    /// Collocation points, s.
    pub points: Vec<f64>,
    pub coordinate: SplineSpace,
    /// Fibre length and activation.
    pub state: SplineSpace,
    /// Excitation and reactions.
    pub control: SplineSpace,
    breakpoints: Vec<f64>,
    nq: usize,
    nm: usize,
    nc: usize,
}

impl Midpoint {
    /// `points` collocation points, at least 2, on `duration` seconds.
    pub fn new(instant: &Instant<'_>, points: usize, duration: f64) -> Self {
        assert_eq!(instant.form, Form::SecondOrder, "the thesis' splines are of the second-order form");
        let h = duration / (points - 1) as f64;
        let times: Vec<f64> = (0..points).map(|j| j as f64 * h).collect();
        let breakpoints = breakpoints(&times);
        let model = instant.model;
        Self {
            points: times,
            coordinate: SplineSpace::new(2, &breakpoints),
            state: SplineSpace::new(1, &breakpoints),
            control: SplineSpace::new(0, &breakpoints),
            breakpoints,
            nq: model.coordinates(),
            nm: model.muscles.len(),
            nc: model.constraints(),
        }
    }

    fn initial_values(&self) -> usize {
        2 * (self.nq + self.nm)
    }

    fn block(&self) -> usize {
        self.nq + 3 * self.nm + self.nc
    }

    /// Start of block k: full blocks, then one with q l a, then one with q.
    fn block_start(&self, k: usize) -> usize {
        let p = self.points.len();
        let tail = if k > p { self.nq + 2 * self.nm } else { 0 };
        self.initial_values() + k.min(p) * self.block() + tail
    }

    pub fn coordinate_index(&self, k: usize, i: usize) -> usize {
        self.block_start(k) + i
    }

    pub fn reaction_index(&self, j: usize, c: usize) -> usize {
        self.block_start(j) + self.nq + 3 * self.nm + c
    }

    /// φ: initial body coordinates, velocities, fibre lengths and activations.
    pub fn initial_index(&self, which: Initial, i: usize) -> usize {
        match which {
            Initial::Coordinate => i,
            Initial::Velocity => self.nq + i,
            Initial::Length => 2 * self.nq + i,
            Initial::Activation => 2 * self.nq + self.nm + i,
        }
    }

    /// The rows `spline(t_1) − φ = 0`.
    fn initial_rows(&self) -> Vec<Combination> {
        let mut rows = Vec::new();
        let mut row = |basis: Basis, index: &dyn Fn(usize) -> usize, value: usize| {
            let mut entries = combine(&basis, index);
            entries.push((value, -1.0));
            rows.push(entries);
        };
        for (derivative, which) in [(0, Initial::Coordinate), (1, Initial::Velocity)] {
            for i in 0..self.nq {
                let value = self.initial_index(which, i);
                row(self.coordinate.basis(0.0, derivative), &|k| self.coordinate_index(k, i), value);
            }
        }
        for m in 0..self.nm {
            row(self.state.basis(0.0, 0), &|k| self.length_index(k, m), self.initial_index(Initial::Length, m));
        }
        for m in 0..self.nm {
            row(self.state.basis(0.0, 0), &|k| self.activation_index(k, m), self.initial_index(Initial::Activation, m));
        }
        rows
    }
}

fn combine(basis: &Basis, index: &dyn Fn(usize) -> usize) -> Combination {
    basis.values.iter().enumerate().map(|(i, &w)| (index(basis.first + i), w)).collect()
}

impl Discretisation for Midpoint {
    fn points(&self) -> &[f64] {
        &self.points
    }

    fn breakpoints(&self) -> &[f64] {
        &self.breakpoints
    }

    fn variables(&self) -> usize {
        self.block_start(self.points.len() + 1) + self.nq
    }

    fn layout(&self, instant: &Instant<'_>) -> Layout {
        let rows: Vec<usize> = (0..instant.equations()).collect();
        let point = |&t: &f64| Point { map: self.local_at(instant, t), rows: rows.clone(), complete: true };
        Layout {
            times: self.points.clone(),
            variables: self.variables(),
            points: self.points.iter().map(point).collect(),
            linear: self.initial_rows(),
        }
    }

    fn local_at(&self, instant: &Instant<'_>, t: f64) -> Vec<Combination> {
        let mut map = vec![Combination::new(); instant.variables()];
        for i in 0..self.nq {
            map[i] = self.coordinate_at(t, 0, i);
            map[instant.acceleration(i)] = self.coordinate_at(t, 2, i);
            if instant.has_velocity() {
                map[instant.velocity(i)] = self.coordinate_at(t, 1, i);
            }
        }
        let (value, rate) = (self.state.basis(t, 0), self.state.basis(t, 1));
        let control = self.control.basis(t, 0);
        for m in 0..self.nm {
            let at = instant.muscle(m);
            map[at] = combine(&value, &|k| self.activation_index(k, m));
            map[at + 1] = combine(&value, &|k| self.length_index(k, m));
            map[at + 2] = combine(&rate, &|k| self.length_index(k, m));
            map[at + 3] = combine(&rate, &|k| self.activation_index(k, m));
            map[at + 4] = combine(&control, &|j| self.excitation_index(j, m));
        }
        for c in 0..self.nc {
            map[instant.reaction(c)] = combine(&control, &|j| self.reaction_index(j, c));
        }
        map
    }

    fn coordinate_at(&self, t: f64, derivative: usize, i: usize) -> Combination {
        combine(&self.coordinate.basis(t, derivative), &|k| self.coordinate_index(k, i))
    }

    fn activation_at(&self, t: f64, m: usize) -> Combination {
        combine(&self.state.basis(t, 0), &|k| self.activation_index(k, m))
    }

    /// The trapezoidal rule.
    fn quadrature(&self) -> Vec<f64> {
        let n = self.points.len();
        let h = self.points[1] - self.points[0];
        (0..n).map(|j| if j == 0 || j == n - 1 { 0.5 * h } else { h }).collect()
    }

    fn state_coefficients(&self) -> usize {
        self.state.dimension()
    }

    fn length_index(&self, k: usize, m: usize) -> usize {
        self.block_start(k) + self.nq + m
    }

    fn activation_index(&self, k: usize, m: usize) -> usize {
        self.block_start(k) + self.nq + self.nm + m
    }

    fn control_coefficients(&self) -> usize {
        self.points.len()
    }

    fn excitation_index(&self, j: usize, m: usize) -> usize {
        self.block_start(j) + self.nq + 2 * self.nm + m
    }

    fn settle(&self, x: &mut [f64]) {
        for row in self.initial_rows() {
            let (value, _) = row[row.len() - 1];
            x[value] += evaluate(&row, x);
        }
    }

    /// By the blossom: the coefficient of a spline of degree 2 on the knots a, b is `f(m) − f″(m) (b − a)²/8`, m their middle.
    fn compose(&self, functions: &dyn Trajectory) -> Vec<f64> {
        let mut x = vec![0.0; self.variables()];
        let clamped = |k: usize| self.breakpoints[k.clamp(1, self.breakpoints.len()) - 1];
        for k in 0..self.coordinate.dimension() {
            let (a, b) = (clamped(k), clamped(k + 1));
            let middle = 0.5 * (a + b);
            for i in 0..self.nq {
                let bend = functions.coordinate(middle, 2, i) * (b - a).powi(2) / 8.0;
                x[self.coordinate_index(k, i)] = functions.coordinate(middle, 0, i) - bend;
            }
        }
        for (k, &t) in self.breakpoints.iter().enumerate() {
            for m in 0..self.nm {
                x[self.length_index(k, m)] = functions.length(t, m);
                x[self.activation_index(k, m)] = functions.activation(t, m);
            }
        }
        for (j, &t) in self.points.iter().enumerate() {
            (0..self.nm).for_each(|m| x[self.excitation_index(j, m)] = functions.excitation(t, m));
            (0..self.nc).for_each(|c| x[self.reaction_index(j, c)] = functions.reaction(t, c));
        }
        self.settle(&mut x);
        x
    }
}

/// The first point, the middles between neighbours, the last point.
fn breakpoints(points: &[f64]) -> Vec<f64> {
    let mut breakpoints = vec![points[0]];
    breakpoints.extend(points.windows(2).map(|w| 0.5 * (w[0] + w[1])));
    breakpoints.push(points[points.len() - 1]);
    breakpoints
}

/// The four groups of initial values φ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Initial {
    Coordinate,
    Velocity,
    Length,
    Activation,
}
