//! `static`: the muscles' load sharing at each instant alone, where the motion is given (thesis, eq. 1.6; static optimisation,
//! inverse dynamics with muscle recruitment).
//!
//! ```text
//! minimise   Σ w e^p + Σ c r²     or    max e + Σ c |r|
//! subject to R(t) F + T r = τ(t),  F_m = N_m a_m + P_m,  a_min ≤ a ≤ 1
//! ```
//!
//! | `muscle_dynamics` | N | P |
//! |---|---|---|
//! | `force` | F_o | 0 |
//! | `rigid_tendon` | F_o f_l f_v cos α of the given motion | F_o (f_pe + β l̇) cos α |
//! | `full` | F_o (f_t1 − f_t0), eqs (19)–(22) | F_o f_t0 |
//!
//! `problem` is the problem as any other method has it, so that tables, ranks and checks are the same; `instants` solves it, an
//! instant after the other, by the programmes of `recruitment`.

mod instants;
pub mod start;

use std::f64::consts::SQRT_2;
use std::sync::Arc;

pub use instants::{Labels, Recruited, Verdict, recruit};

use super::given_motion::GivenMotion;
use super::known::{self, Known, Law};
use super::muscle_force::{HillLaw, LinearForce, MuscleForce};
use super::{InverseProblem, MuscleVariables, actuators};
use crate::model::Model;
use crate::problem::blocks::moment_balance::MomentBalance;
use crate::problem::goals::{Effort, Goal, integral};
use crate::problem::{Bounded, Builder, Kind, Span};
use crate::settings::{BoundKind, EffortOf, MuscleDynamics, Settings};
use crate::transcription::scheme::{Discretisation, quadrature};

/// The problem of a model whose motion is given.
pub fn problem<'m>(model: &'m Model, settings: &Settings, given: &Arc<GivenMotion<'m>>) -> InverseProblem<'m> {
    let mut problem = Builder::default();
    let mut motion = known::motion(&mut problem, model, given);
    let names = model.muscles.iter().map(|muscle| muscle.name.clone()).collect();
    let activation = problem.quantity("activation", names, Kind::Control);
    let a = problem.read(activation, 0);
    let actuation = given.actuation.clone();
    let declared = actuators::declare(&mut problem, &actuation);
    let has_fibre = settings.muscle_dynamics != MuscleDynamics::Force;
    let known = Known::declare(&mut problem, model, given, if has_fibre { Law::Hill } else { Law::Force });

    motion.equation = problem.equation("moments", given.count(), true);
    let mut entries = known.of_muscles(a);
    entries.extend(known.of_actuators(declared.map(|(_, controls)| controls)));
    problem.block(MomentBalance { rows: motion.equation, needed: known.needed, entries });
    let limits = [(BoundKind::Activation, settings.min_activation), (BoundKind::ActivationUpper, 1.0)];
    for (kind, bound) in limits {
        for (muscle, activation) in model.muscles.iter().zip(a.range()) {
            let is_lower = kind == BoundKind::Activation;
            let bounded = if is_lower { Bounded::Below(activation) } else { Bounded::Above(activation) };
            problem.limit(kind.name(), &muscle.name, bounded, bound);
        }
    }
    InverseProblem {
        model,
        motion,
        muscles: MuscleVariables::of_activations(activation, a),
        forces: linear_forces(model, a, &known, has_fibre),
        actuators: actuators::drives(actuation, declared),
        control: problem.build(0),
    }
}

/// The forces of muscles whose fibres follow the motion.
pub fn linear_forces<'m>(model: &'m Model, a: Span, known: &Known, has_fibre: bool) -> Vec<MuscleForce<'m>> {
    let force = |(m, muscle)| {
        let path = has_fibre.then(|| [known.path.at(m), known.path_rate.at(m)]);
        let known = HillLaw { strength: known.strength.at(m), passive: known.passive.at(m), path };
        MuscleForce::Linear(LinearForce { muscle, activation: a.at(m), known: Some(known) })
    };
    model.muscles.iter().enumerate().map(force).collect()
}

/// The criterion over time, where it is a sum of powers of at least 2: `∫ Σ w e^p dt + ∫ Σ c r² dt` by the weights of the scheme.
pub fn goals(inverse: &InverseProblem<'_>, scheme: &dyn Discretisation, settings: &Settings) -> Vec<Goal> {
    let instants = quadrature(scheme);
    let weights = settings.effort_weights(inverse.model);
    let efforts = instants.iter().flat_map(|&(time, instant)| {
        let z = inverse.control.given_at(time);
        let of = |(member, weight): (usize, &f64)| {
            let line = effort(&inverse.forces[member], settings.effort_of, &z);
            Effort { time, member, weight: weight * instant, line }
        };
        weights.iter().enumerate().map(of).collect::<Vec<Effort>>()
    });
    let own = integral(inverse.muscles.activation, settings.effort_power, efforts);
    [own].into_iter().chain(actuators::use_of(&inverse.actuators, SQRT_2, &instants)).collect()
}

/// o and s of a muscle's effort e = o + s a; z: what is known.
fn effort(force: &MuscleForce<'_>, of: EffortOf, z: &[f64]) -> [f64; 2] {
    let MuscleForce::Linear(LinearForce { known: Some(known), .. }) = force else { return [0.0, 1.0] };
    let (strength, passive) = (z[known.strength], z[known.passive]);
    match of {
        EffortOf::Force if strength > 0.0 && strength + passive > 0.0 => {
            [passive / (strength + passive), strength / (strength + passive)]
        }
        _ => [0.0, 1.0],
    }
}
