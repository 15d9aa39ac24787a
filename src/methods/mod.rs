//! Inverse methods: which quantities, blocks, limits and goals make up the problem of a study.

pub mod actuators;
pub mod dynamic;
pub mod given_motion;
pub mod inverse_dynamics;
pub mod known;
pub mod muscle_force;
pub mod prediction;
pub mod prescribed;
pub mod static_optimisation;

use actuators::Actuation;
use muscle_force::MuscleForce;

use crate::model::Model;
use crate::model::mechanics::Motion;
use crate::nlp::polish::ACTIVE;
use crate::problem::{ControlProblem, QuantityId, Span};
use crate::transcription::collocation::Collocation;
use crate::transcription::scheme::{Combination, Discretisation};

/// The problem of an inverse method, and where its motion and its muscles are.
pub struct InverseProblem<'m> {
    pub model: &'m Model,
    pub control: ControlProblem<'m>,
    pub motion: MotionVariables,
    pub muscles: MuscleVariables,
    /// Of each muscle.
    pub forces: Vec<MuscleForce<'m>>,
    pub actuators: Vec<Drive<'m>>,
}

/// A reserve, or an actuator of the model, at a joint coordinate.
#[derive(Clone, Debug)]
pub struct Drive<'m> {
    pub own: Actuation<'m>,
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
    /// Whether all of it is known beforehand.
    pub is_given: bool,
    /// `None` where reactions are eliminated.
    pub reaction: Option<QuantityId>,
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

/// The muscles: quantities, variables at an instant, equations; a member each muscle. Spans of what a method does not have are
/// empty.
#[derive(Clone, Copy, Debug)]
pub struct MuscleVariables {
    pub activation: QuantityId,
    pub fibre_length: Option<QuantityId>,
    pub excitation: Option<QuantityId>,
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

impl MuscleVariables {
    /// Muscles whose activation is all there is of them.
    pub fn of_activations(activation: QuantityId, a: Span) -> Self {
        Self {
            activation,
            fibre_length: None,
            excitation: None,
            a,
            l: Span::EMPTY,
            l_rate: Span::EMPTY,
            a_rate: Span::EMPTY,
            u: Span::EMPTY,
            contraction: Span::EMPTY,
            activation_dynamics: Span::EMPTY,
            fibre_force: Span::EMPTY,
        }
    }
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

    /// What eq. (1) leaves to joint reactions at an instant, by coordinate: inertial forces less loads, passive moments, muscles
    /// and actuators, N or N m.
    pub fn generalised_forces(&self, z: &[f64]) -> Vec<f64> {
        let motion = &self.motion;
        let q = motion.all.of(z);
        let velocity = motion.rates.map_or(&[][..], |span| span.of(z));
        let (loads, _) = motion.loads.of(z).as_chunks::<3>();
        let moves = Motion { q, velocity, acceleration: motion.all_accelerations.of(z) };
        let mut forces = self.model.needed_forces(moves, loads);
        for force in &self.forces {
            let muscle = force.muscle();
            let mut path = muscle.path.buffer();
            muscle.path.length(q, false, &mut path);
            let tension = muscle.max_isometric_force * force.value(z);
            let slots = muscle.path.slots().iter().zip(&path.gradient);
            slots.for_each(|(&slot, gradient)| forces[slot] += tension * gradient);
        }
        for Drive { own, control, .. } in &self.actuators {
            let slopes = own.coordinate.slopes(q);
            let slots = slopes.slots.into_iter().zip(slopes.gradient);
            slots.for_each(|(slot, gradient)| forces[slot] -= own.moment * z[*control] * gradient);
        }
        forces
    }

    /// The points at which activations have values.
    pub fn points_with_activations(&self, problem: &Collocation<'_>) -> Vec<usize> {
        let is_state = self.control.quantity(self.muscles.activation).kind.is_state();
        (0..problem.points.len()).filter(|&j| is_state || problem.points[j].complete).collect()
    }

    /// Whether each muscle is idle: |a| ≤ 1e-8 at every collocation point.
    pub fn idle(&self, problem: &Collocation<'_>, x: &[f64]) -> Vec<bool> {
        let mut idle = vec![true; self.muscles.a.count];
        for point in self.points_with_activations(problem) {
            let z = problem.local(point, x);
            idle.iter_mut().zip(self.muscles.a.of(&z)).for_each(|(idle, a)| *idle &= a.abs() <= ACTIVE);
        }
        idle
    }

    /// The excitation of a muscle: an unknown, or what eq. (4) says; `None` without activation dynamics.
    pub fn excitation(&self, z: &[f64], m: usize) -> Option<f64> {
        let (a, rate) = (self.muscles.a.at(m), self.muscles.a_rate.get(m));
        let of_rate = || Some(self.model.muscles[m].excitation(z[a], z[rate?]));
        self.muscles.u.get(m).map(|u| z[u]).or_else(of_rate)
    }

    /// f_m of a muscle.
    pub fn fibre_force(&self, z: &[f64], muscle: usize) -> f64 {
        self.forces[muscle].value(z)
    }
}
