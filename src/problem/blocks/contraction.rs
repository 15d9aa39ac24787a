//! Eq. (3), the force balance of fibre and tendon, and the muscle's part of eq. (1) (thesis, Paper B):
//!
//! ```text
//! … + (F_o/W) f_m ∂L_mt/∂q = 0                               (1)
//! l_t(q, l) − f_t⁻¹(f_m) = 0                                 (3)
//! f_m = (f_pe(l) + a f_l(l) f_v(l̇) + β l̇) cos α
//! ```
//!
//! | symbol | meaning | unit |
//! |---|---|---|
//! | a | activation | – |
//! | l, l̇ | fibre length and its rate | optimal fibre lengths L_o; per s |
//! | l_t | tendon strain, `(L_mt(q) − L_o l cos α − L_s)/L_s`, eqs (6), (7) | – |
//! | L_mt | length of the path from origin to insertion | m |
//! | f_m | the fibre's force along the tendon | maximum isometric force F_o |
//!
//! A rigid tendon has `l_t = 0` for eq. (3), which then says where the fibre is.
//!
//! DEPARTURE [thesis, Paper B, eq. 3]: the tendon curve is inverted and the fibre's force goes into eq. (1). Where
//! the force is positive that is an invertible row operation, so ranks are the same, and the stiff tendon no longer
//! spoils the conditioning.

use std::sync::Arc;

use crate::model::Musculotendon;
use crate::model::musculotendon::FibreForce;
use crate::model::path::PathLength;
use crate::problem::block::{Block, Order, Sink};
use crate::problem::quantity::Span;

#[derive(Clone)]
pub struct Contraction<'m> {
    pub muscle: &'m Musculotendon,
    /// F_o/W
    pub strength: f64,
    pub way: Way,
    pub activation: usize,
    pub length: usize,
    pub velocity: usize,
    /// If it is an unknown.
    pub excitation: Option<usize>,
    pub row: usize,
    /// The row of f_m, which is a function for a limit.
    pub force_row: usize,
    /// Weight of a step in activation, relative to one in q.
    pub step_weight: f64,
}

/// Where the muscle runs.
#[derive(Clone)]
pub enum Way {
    /// Over coordinates that are unknown.
    Of {
        /// All coordinates, those of given motion last.
        coordinates: Span,
        /// Rows of eq. (1).
        motion: Span,
    },
    /// Where the motion is given: the length among the variables, and the rows of eq. (1) with the moment arms −∂L_mt/∂θ there.
    Known { length: usize, rows: Arc<[usize]>, arms: Span },
}

impl Contraction<'_> {
    /// f_m with its derivatives by a, l and l̇.
    pub fn fibre_force(&self, z: &[f64]) -> FibreForce {
        self.muscle.fibre_force(z[self.activation], z[self.length], z[self.velocity])
    }

    /// The slopes of f_m, by variable.
    pub fn fibre_force_slopes(&self, z: &[f64]) -> [(usize, f64); 3] {
        let (variables, force) = (self.fibre_variables(), self.fibre_force(z));
        [0, 1, 2].map(|i| (variables[i], force.gradient[i]))
    }

    /// a, l, l̇
    fn fibre_variables(&self) -> [usize; 3] {
        [self.activation, self.length, self.velocity]
    }

    /// The length of the path, m.
    fn path_length(&self, z: &[f64]) -> f64 {
        match &self.way {
            Way::Of { coordinates, .. } => self.path(coordinates.of(z), false).value,
            Way::Known { length, .. } => z[*length],
        }
    }

    fn path(&self, q: &[f64], second: bool) -> PathLength<f64> {
        let mut path = self.muscle.path.buffer();
        self.muscle.path.length(q, second, &mut path);
        path
    }

    /// The derivative of eq. (3) by the tendon's slack length, 1/m, and how that changes with the variables.
    pub fn slope_by_slack(&self, z: &[f64]) -> (f64, Vec<(usize, f64)>) {
        let muscle = self.muscle;
        if muscle.rigid_tendon {
            return (-1.0 / muscle.length_unit(), Vec::new());
        }
        // (L_mt − l L_o cos α)/L_s has the derivative −1/L_s times itself.
        let slack = muscle.tendon_slack_length;
        let square = slack * slack;
        let mut mixed: Vec<(usize, f64)> = Vec::new();
        if let Way::Of { coordinates, .. } = &self.way {
            let path = self.path(coordinates.of(z), false);
            let slots = muscle.path.slots().iter().zip(path.gradient);
            mixed.extend(slots.map(|(&slot, gradient)| (coordinates.at(slot), -gradient / square)));
        }
        mixed.push((self.length, muscle.along_tendon_by_length(z[self.length]) / square));
        (-(muscle.tendon_strain(self.path_length(z), z[self.length]) + 1.0) / slack, mixed)
    }

    fn add(&self, z: &[f64], out: &mut Sink<'_>) {
        let force = self.fibre_force(z);
        let length = match &self.way {
            Way::Of { coordinates, motion } => self.add_along(z, &force, (*coordinates, *motion), out),
            Way::Known { length, rows, arms } => {
                for (&row, arm) in rows.iter().zip(arms.of(z)) {
                    let pull = self.strength * arm;
                    out.value(row, pull * force.value);
                    for (variable, by) in self.fibre_variables().into_iter().zip(&force.gradient) {
                        out.slope(row, variable, pull * by);
                    }
                }
                z[*length]
            }
        };
        let stretch = self.muscle.contraction(length, z[self.length], force.value);
        out.value(self.row, stretch.value);
        out.value(self.force_row, force.value);
        for (variable, by) in self.fibre_variables().into_iter().zip(&force.gradient) {
            if !self.muscle.rigid_tendon {
                out.slope(self.row, variable, stretch.by_force * by);
            }
            out.slope(self.force_row, variable, *by);
        }
        out.slope(self.row, self.length, stretch.by_length);
    }

    /// The pull at unknown coordinates, and how eq. (3) depends on them; returns the length of the path.
    fn add_along(&self, z: &[f64], force: &FibreForce, (coordinates, motion): (Span, Span), out: &mut Sink<'_>) -> f64 {
        let slots = self.muscle.path.slots();
        let mut path = self.muscle.path.buffer();
        if !out.is_recording() {
            self.muscle.path.length(coordinates.of(z), out.wants(Order::Slopes), &mut path);
        }
        let stretch = self.muscle.contraction(path.value, z[self.length], force.value);
        for (i, &one) in slots.iter().enumerate() {
            out.value(motion.at(one), self.strength * force.value * path.gradient[i]);
            for j in 0..if out.wants(Order::Slopes) { slots.len() } else { 0 } {
                let bend = self.strength * force.value * path.hessian[i * slots.len() + j];
                out.slope(motion.at(one), coordinates.at(slots[j]), bend);
            }
            for (variable, by) in self.fibre_variables().into_iter().zip(&force.gradient) {
                out.slope(motion.at(one), variable, self.strength * path.gradient[i] * by);
            }
            out.slope(self.row, coordinates.at(one), path.gradient[i] * stretch.by_path);
        }
        path.value
    }

    /// With λ the multipliers of eq. (1) and φ, ν those of eq. (3) and of f_m: ω ∇²f_m + φ ∇²l_t − φ (f_t⁻¹)″ ∇f_m ∇f_mᵀ, ω the
    /// sum of all factors of f_m.
    fn bend(&self, z: &[f64], out: &mut Sink<'_>) {
        let force = self.fibre_force(z);
        let (pull, length) = match &self.way {
            Way::Of { coordinates, motion } => self.bend_along(z, &force, (*coordinates, *motion), out),
            Way::Known { length, rows, arms } => {
                let pulls = rows.iter().zip(arms.of(z)).map(|(&row, arm)| out.multiplier(row) * arm);
                (pulls.sum(), z[*length])
            }
        };
        let stretch = self.muscle.contraction(length, z[self.length], force.value);
        let contraction = out.multiplier(self.row);
        let omega = self.strength * pull + contraction * stretch.by_force + out.multiplier(self.force_row);
        for (i, one) in self.fibre_variables().into_iter().enumerate() {
            for (j, other) in self.fibre_variables().into_iter().enumerate().skip(i) {
                let by_force = stretch.bent_by_force * force.gradient[i] * force.gradient[j];
                out.bend(one, other, omega * force.hessian[i][j] + contraction * by_force);
            }
        }
        out.bend(self.length, self.length, contraction * stretch.bent_by_length);
    }

    /// The bends by unknown coordinates; returns λᵀ ∂L_mt/∂q, and the length of the path.
    fn bend_along(
        &self,
        z: &[f64],
        force: &FibreForce,
        (coordinates, motion): (Span, Span),
        out: &mut Sink<'_>,
    ) -> (f64, f64) {
        let slots = self.muscle.path.slots();
        let mut direction: Vec<f64> = motion.range().map(|row| out.multiplier(row)).collect();
        direction.resize(coordinates.count, 0.0);
        let path = if out.is_recording() {
            self.muscle.path.buffer()
        } else {
            self.muscle.path.length_along(coordinates.of(z), &direction)
        };
        let stretch = self.muscle.contraction(path.value.re, z[self.length], force.value);
        let contraction = out.multiplier(self.row);
        let pull = self.strength * force.value;
        for (i, &one) in slots.iter().enumerate() {
            for (j, &other) in slots.iter().enumerate().skip(i) {
                let second = path.hessian[i * slots.len() + j];
                let bend = pull * second.eps + contraction * stretch.by_path * second.re;
                out.bend(coordinates.at(one), coordinates.at(other), bend);
            }
            for (variable, by) in self.fibre_variables().into_iter().zip(&force.gradient) {
                out.bend(coordinates.at(one), variable, self.strength * path.gradient[i].eps * by);
            }
        }
        (path.value.eps, path.value.re)
    }
}

impl Block for Contraction<'_> {
    fn evaluate(&self, z: &[f64], out: &mut Sink<'_>) {
        if out.wants(Order::Bends) { self.bend(z, out) } else { self.add(z, out) }
    }

    /// The muscle's variables, with the excitation, which eq. (4) couples to the activation.
    fn convex_groups(&self) -> Vec<Vec<usize>> {
        vec![[self.activation, self.length, self.velocity].into_iter().chain(self.excitation).collect()]
    }

    /// A fibre velocity is measured against `b v_max + |l̇|`, b v_max being the scale on which the force–velocity curve bends.
    fn weigh(&self, z: &[f64], weights: &mut [f64]) {
        let bend = self.muscle.curves.bending_velocity() * self.muscle.max_shortening_velocity;
        let velocity = 1.0 / (bend + z[self.velocity].abs());
        weights[self.length] = 10.0 * self.step_weight;
        weights[self.velocity] = self.step_weight * velocity * velocity;
    }

    fn print(&self, z: &[f64], residuals: &mut [f64]) {
        let force = self.fibre_force(z).value;
        residuals[self.row] = self.muscle.printed_contraction(self.path_length(z), z[self.length], force);
    }
}
