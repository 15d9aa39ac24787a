//! Inverse methods: which quantities, blocks, limits and goals make up the problem of a study.

pub mod dynamic;
pub mod inverse_dynamics;
pub mod prediction;

use crate::model::{DrivenCoordinate, Model};
use crate::nlp::polish::ACTIVE;
use crate::problem::blocks::contraction::Contraction;
use crate::problem::{ControlProblem, QuantityId, Span};
use crate::transcription::collocation::Collocation;
use crate::transcription::scheme::{Combination, Discretisation};

/// The problem of an inverse method, and where its motion and its muscles are.
pub struct InverseProblem<'m> {
    pub model: &'m Model,
    pub control: ControlProblem<'m>,
    pub motion: MotionVariables,
    pub muscles: MuscleVariables,
    /// Eq. (3) of each muscle.
    pub contractions: Vec<Contraction<'m>>,
    pub actuators: Vec<Drive<'m>>,
}

/// A reserve, or an actuator of the model, at a joint coordinate.
#[derive(Clone, Debug)]
pub struct Drive<'m> {
    /// Of a reserve `reserve.` and that of its coordinate.
    pub name: String,
    pub is_reserve: bool,
    /// The joint coordinate that it drives, and its number among all that may be driven.
    pub coordinate: DrivenCoordinate<'m>,
    pub number: usize,
    /// Moment (N m) or force (N) at a control of 1.
    pub moment: f64,
    /// Bounds on its control.
    pub bounds: [f64; 2],
    /// Weight of its squared control relative to squared activations.
    pub weight: f64,
    pub quantity: QuantityId,
    /// Its control among the variables.
    pub control: usize,
}

/// The motion: quantities, variables at an instant, equations.
#[derive(Clone, Copy, Debug)]
pub struct MotionVariables {
    pub coordinate: QuantityId,
    /// A velocity of its own, in the first-order form.
    pub velocity: Option<QuantityId>,
    pub reaction: QuantityId,
    /// q that moves by forces, and all of it, given coordinates last.
    pub q: Span,
    pub all: Span,
    /// q̇ of all coordinates, where the equations have it.
    pub rates: Option<Span>,
    pub accelerations: Span,
    /// With those of the given coordinates.
    pub all_accelerations: Span,
    pub reactions: Span,
    /// Three components of each external force.
    pub loads: Span,
    /// Eqs (1) and (2).
    pub equation: Span,
    pub joints: Span,
    /// The joints on the velocity level, in the first-order form.
    pub stabilisation: Option<StabilisationVariables>,
}

/// q̇ and η, and the equations q̇ = v + Φ_qᵀ η and Φ_q v = 0.
#[derive(Clone, Copy, Debug)]
pub struct StabilisationVariables {
    pub rates: Span,
    pub multipliers: Span,
    pub kinematic: Span,
    pub joint_velocities: Span,
}

/// The muscles: quantities, variables at an instant, equations; a member each muscle.
#[derive(Clone, Copy, Debug)]
pub struct MuscleVariables {
    pub activation: QuantityId,
    pub fibre_length: QuantityId,
    pub excitation: QuantityId,
    pub a: Span,
    pub l: Span,
    /// l̇, ȧ
    pub l_rate: Span,
    pub a_rate: Span,
    pub u: Span,
    /// Eqs (3) and (4), and f_m as a function for limits.
    pub contraction: Span,
    pub activation_dynamics: Span,
    pub fibre_force: Span,
}

impl InverseProblem<'_> {
    /// Coordinate `i`, or a derivative, at time t (s).
    pub fn coordinate_at(&self, scheme: &dyn Discretisation, t: f64, derivative: usize, i: usize) -> Combination {
        match self.motion.velocity {
            // The velocity of the first-order form is the better one.
            Some(velocity) if derivative > 0 => scheme.at(t, velocity, i, derivative - 1),
            _ => scheme.at(t, self.motion.coordinate, i, derivative),
        }
    }

    /// All coordinates at time t (s), those that move by forces being q.
    pub fn all_coordinates(&self, t: f64, q: &[f64]) -> Vec<f64> {
        let mut all = self.motion.all.of(&self.control.given_at(t)).to_vec();
        all[..q.len()].copy_from_slice(q);
        all
    }

    /// The activation of a muscle at time t (s).
    pub fn activation_at(&self, scheme: &dyn Discretisation, t: f64, muscle: usize) -> Combination {
        scheme.at(t, self.muscles.activation, muscle, 0)
    }

    /// Whether each muscle is idle: |a| ≤ 1e-8 at every collocation point.
    pub fn idle(&self, problem: &Collocation<'_>, x: &[f64]) -> Vec<bool> {
        let mut idle = vec![true; self.muscles.a.count];
        for point in 0..problem.points.len() {
            let z = problem.local(point, x);
            idle.iter_mut().zip(self.muscles.a.of(&z)).for_each(|(idle, a)| *idle &= a.abs() <= ACTIVE);
        }
        idle
    }

    /// f_m of a muscle.
    pub fn fibre_force(&self, z: &[f64], muscle: usize) -> f64 {
        self.contractions[muscle].fibre_force(z).value
    }
}
