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

use super::collocation::{Combination, Layout};
use super::instant::Instant;
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
    nq: usize,
    nm: usize,
    nc: usize,
}

impl Midpoint {
    /// `points` collocation points, at least 2, on `duration` seconds.
    pub fn new(instant: &Instant<'_>, points: usize, duration: f64) -> Self {
        let h = duration / (points - 1) as f64;
        let times: Vec<f64> = (0..points).map(|j| j as f64 * h).collect();
        let breakpoints = breakpoints(&times);
        let model = instant.model;
        Self {
            points: times,
            coordinate: SplineSpace::new(2, &breakpoints),
            state: SplineSpace::new(1, &breakpoints),
            control: SplineSpace::new(0, &breakpoints),
            nq: model.coordinates(),
            nm: model.muscles.len(),
            nc: model.constraints(),
        }
    }

    /// Ends of the spans, s.
    pub fn breakpoints(&self) -> Vec<f64> {
        breakpoints(&self.points)
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

    /// Number of unknowns.
    pub fn variables(&self) -> usize {
        self.block_start(self.points.len() + 1) + self.nq
    }

    pub fn coordinate_index(&self, k: usize, i: usize) -> usize {
        self.block_start(k) + i
    }

    pub fn length_index(&self, k: usize, m: usize) -> usize {
        self.block_start(k) + self.nq + m
    }

    pub fn activation_index(&self, k: usize, m: usize) -> usize {
        self.block_start(k) + self.nq + self.nm + m
    }

    pub fn excitation_index(&self, j: usize, m: usize) -> usize {
        self.block_start(j) + self.nq + 2 * self.nm + m
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

    /// The linear maps from the decision vector that [`super::collocation`] assembles from.
    pub fn layout(&self, instant: &Instant<'_>) -> Layout {
        let combine = |basis: Basis, index: &dyn Fn(usize) -> usize| -> Combination {
            basis.values.iter().enumerate().map(|(i, &w)| (index(basis.first + i), w)).collect()
        };
        let mut points = Vec::new();
        for (j, &t) in self.points.iter().enumerate() {
            let mut map = vec![Combination::new(); instant.variables()];
            for i in 0..self.nq {
                map[i] = combine(self.coordinate.basis(t, 0), &|k| self.coordinate_index(k, i));
                map[instant.acceleration(i)] = combine(self.coordinate.basis(t, 2), &|k| self.coordinate_index(k, i));
            }
            for m in 0..self.nm {
                let at = instant.muscle(m);
                map[at] = combine(self.state.basis(t, 0), &|k| self.activation_index(k, m));
                map[at + 1] = combine(self.state.basis(t, 0), &|k| self.length_index(k, m));
                map[at + 2] = combine(self.state.basis(t, 1), &|k| self.length_index(k, m));
                map[at + 3] = combine(self.state.basis(t, 1), &|k| self.activation_index(k, m));
                map[at + 4] = vec![(self.excitation_index(j, m), 1.0)];
            }
            for c in 0..self.nc {
                map[instant.reaction(c)] = vec![(self.reaction_index(j, c), 1.0)];
            }
            points.push(map);
        }
        let mut initial = Vec::new();
        let mut row = |basis: Basis, index: &dyn Fn(usize) -> usize, value: usize| {
            let mut entries = combine(basis, index);
            entries.push((value, -1.0));
            initial.push(entries);
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
        // φ is a stage of its own; what follows the last full block belongs to its stage.
        let last = self.points.len() - 1;
        let stage = |i: usize| i.checked_sub(self.initial_values()).map_or(0, |i| 1 + (i / self.block()).min(last));
        let stages = (0..self.variables()).map(stage).collect();
        Layout { times: self.points.clone(), variables: self.variables(), stages, points, initial }
    }

    /// Body coordinate `i` (or a derivative) as a combination of the decision vector at time `t`.
    pub fn coordinate_at(&self, t: f64, derivative: usize, i: usize) -> Combination {
        let basis = self.coordinate.basis(t, derivative);
        basis.values.iter().enumerate().map(|(k, &w)| (self.coordinate_index(basis.first + k, i), w)).collect()
    }

    /// Activation of muscle `m` as a combination of the decision vector at time `t`.
    pub fn activation_at(&self, t: f64, m: usize) -> Combination {
        let basis = self.state.basis(t, 0);
        basis.values.iter().enumerate().map(|(k, &w)| (self.activation_index(basis.first + k, m), w)).collect()
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
