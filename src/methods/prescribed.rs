//! `prescribed`: the muscles over time, where the motion is given (physiological inverse approach).
//!
//! ```text
//! minimise   ∫ Σ w e^p + Σ c r² dt            e = a or u
//! subject to R(t) F + T r = τ(t),   eqs (3), (4),   bounds
//! ```
//!
//! Lengths, velocities, moment arms and τ are known. Where activations are the effort, excitations are no unknowns: linear
//! functions of a and ȧ keep them within their bounds (`blocks::excitation_range`). With `muscle_dynamics = "rigid_tendon"` the fibres are known too and the
//! moments are linear in a; with `full` the states are fibre length and activation. States are coupled in time within one muscle
//! only, and muscles with one another by the moments at one time only.
//!
//! Sources: C. Pipeleers et al., *J Biomech* 41, 2008; F. De Groote et al., *Ann Biomed Eng* 44, 2016 (the direct collocation of the
//! muscle redundancy problem).

use std::f64::consts::SQRT_2;
use std::sync::Arc;

use super::given_motion::GivenMotion;
use super::known::{self, Known, Law};
use super::muscle_force::MuscleForce;
use super::static_optimisation::linear_forces;
use super::{InverseProblem, MuscleVariables, actuators};
use crate::model::Model;
use crate::problem::blocks::activation::Activation;
use crate::problem::blocks::contraction::{Contraction, Way};
use crate::problem::blocks::excitation_range::ExcitationRange;
use crate::problem::blocks::moment_balance::MomentBalance;
use crate::problem::goals::{Effort, Goal, integral};
use crate::problem::{AtStart, Bounded, Builder, Kind, Span};
use crate::settings::{BoundKind, EffortOf, Initial, MuscleDynamics, Settings};
use crate::transcription::scheme::{Discretisation, quadrature};

/// Weight of a step in activation.
const STEP_WEIGHT: f64 = 1.0;

/// The problem of a model whose motion is given.
pub fn problem<'m>(model: &'m Model, settings: &Settings, given: &Arc<GivenMotion<'m>>) -> InverseProblem<'m> {
    let mut problem = Builder::default();
    let mut motion = known::motion(&mut problem, model, given);
    let is_elastic = settings.muscle_dynamics == MuscleDynamics::Full;
    let law = if is_elastic { Law::Arms } else { Law::Hill };
    let has_excitations = settings.effort_of == EffortOf::Excitation;
    let mut muscles = declare(&mut problem, model, is_elastic, has_excitations);
    let actuation = given.actuation.clone();
    let declared = actuators::declare(&mut problem, &actuation);
    let known = Known::declare(&mut problem, model, given, law);

    motion.equation = problem.equation("moments", given.count(), true);
    let elastic = if is_elastic { model.muscles.len() } else { 0 };
    muscles.contraction = problem.equation("contraction", elastic, true);
    let nm = model.muscles.len();
    muscles.activation_dynamics = problem.equation("activation", if has_excitations { nm } else { 0 }, true);
    muscles.fibre_force = problem.equation("fibre_force", elastic, false);
    let [lower, upper] = ["least_excitation", "greatest_excitation"]
        .map(|name| problem.equation(name, if has_excitations { 0 } else { nm }, false));
    let mut entries = known.of_actuators(declared.map(|(_, controls)| controls));
    if !is_elastic {
        entries.extend(known.of_muscles(muscles.a));
    }
    problem.block(MomentBalance { rows: motion.equation, needed: known.needed, entries });
    let forces = if is_elastic {
        contractions(&mut problem, model, &muscles, &known, motion.equation)
    } else {
        linear_forces(model, muscles.a, &known, true)
    };
    for (m, muscle) in model.muscles.iter().enumerate() {
        let (activation, rate, least) = (muscles.a.at(m), muscles.a_rate.at(m), settings.min_activation);
        match muscles.u.get(m) {
            Some(excitation) => {
                let (row, step_weight) = (muscles.activation_dynamics.at(m), STEP_WEIGHT);
                problem.block(Activation { muscle, activation, rate, excitation, row, step_weight });
            }
            None => {
                let rows = [lower.at(m), upper.at(m)];
                problem.block(ExcitationRange::new(muscle, least, [activation, rate], rows));
            }
        }
    }
    add_limits(&mut problem, model, &muscles, settings, [lower, upper]);
    add_start(&mut problem, model, &muscles, settings, given);
    InverseProblem {
        model,
        control: problem.build(elastic + lower.count + upper.count),
        motion,
        muscles,
        forces,
        actuators: actuators::drives(actuation, declared),
    }
}

/// The muscles' quantities and variables.
fn declare(problem: &mut Builder<'_>, model: &Model, is_elastic: bool, has_excitations: bool) -> MuscleVariables {
    let names = || model.muscles.iter().map(|muscle| muscle.name.clone()).collect::<Vec<String>>();
    let state = Kind::State { order: 1 };
    let fibre_length = is_elastic.then(|| problem.quantity("fibre_length", names(), state));
    let activation = problem.quantity("activation", names(), state);
    let excitation = has_excitations.then(|| problem.quantity("excitation", names(), Kind::Control));
    let a = problem.read(activation, 0);
    let [l, l_rate] = [0, 1].map(|level| fibre_length.map_or(Span::EMPTY, |quantity| problem.read(quantity, level)));
    MuscleVariables {
        fibre_length,
        excitation,
        l,
        l_rate,
        a_rate: problem.read(activation, 1),
        u: excitation.map_or(Span::EMPTY, |quantity| problem.read(quantity, 0)),
        ..MuscleVariables::of_activations(activation, a)
    }
}

/// Fibre and tendon of each muscle.
fn contractions<'m>(
    problem: &mut Builder<'m>,
    model: &'m Model,
    muscles: &MuscleVariables,
    known: &Known,
    moments: Span,
) -> Vec<MuscleForce<'m>> {
    let mut forces = Vec::new();
    for (m, muscle) in model.muscles.iter().enumerate() {
        let (rows, arms) = &known.muscles[m];
        let contraction = Contraction {
            muscle,
            strength: muscle.max_isometric_force / model.weight(),
            way: Way::Known {
                length: known.path.at(m),
                rows: rows.iter().map(|&row| moments.at(row)).collect(),
                arms: *arms,
            },
            activation: muscles.a.at(m),
            length: muscles.l.at(m),
            velocity: muscles.l_rate.at(m),
            excitation: muscles.u.get(m),
            row: muscles.contraction.at(m),
            force_row: muscles.fibre_force.at(m),
            step_weight: STEP_WEIGHT,
        };
        problem.block(contraction.clone());
        forces.push(MuscleForce::Contraction(contraction));
    }
    forces
}

/// `range`: rows of the functions that bound excitations where these are no unknowns.
fn add_limits(
    problem: &mut Builder<'_>,
    model: &Model,
    muscles: &MuscleVariables,
    settings: &Settings,
    range: [Span; 2],
) {
    let least = settings.min_activation;
    for kind in settings.bounds.kinds() {
        for (m, muscle) in model.muscles.iter().enumerate() {
            let function = |rows: Span| rows.get(m).map(|row| (Bounded::Function(row), 0.0));
            let limit = match (kind, muscles.u.get(m)) {
                (BoundKind::Activation, _) => Some((Bounded::Below(muscles.a.at(m)), least)),
                (BoundKind::ActivationUpper, _) => Some((Bounded::Above(muscles.a.at(m)), 1.0)),
                (BoundKind::Excitation, Some(u)) => Some((Bounded::Below(u), least)),
                (BoundKind::ExcitationUpper, Some(u)) => Some((Bounded::Above(u), 1.0)),
                (BoundKind::Excitation, None) => function(range[0]),
                (BoundKind::ExcitationUpper, None) => function(range[1]),
                (BoundKind::Force, _) => {
                    function(muscles.fibre_force).or(Some((Bounded::Below(muscles.a.at(m)), least)))
                }
            };
            if let Some((bounded, bound)) = limit {
                problem.limit(kind.name(), &muscle.name, bounded, bound);
            }
        }
    }
}

/// Conditions at the start: tendons keep their length, so that fibres go with the path.
fn add_start(
    problem: &mut Builder<'_>,
    model: &Model,
    muscles: &MuscleVariables,
    settings: &Settings,
    given: &GivenMotion<'_>,
) {
    if settings.initial == Initial::Free {
        return;
    }
    if let Some(state) = muscles.fibre_length {
        let paths = given.at(0.0).paths.clone();
        let elastic = model.muscles.iter().enumerate().filter(|(_, muscle)| !muscle.rigid_tendon);
        for (member, muscle) in elastic {
            let [path, rate] = paths[member];
            // cos α of an unloaded tendon.
            let rate = muscle.fibre_velocity(muscle.fibre_length(path, 0.0), rate);
            problem.at_start(AtStart { state, member, rate });
        }
    }
    // a = u where ȧ = 0.
    let steady = if settings.initial == Initial::Steady { model.muscles.len() } else { 0 };
    (0..steady).for_each(|member| problem.at_start(AtStart { state: muscles.activation, member, rate: 0.0 }));
}

/// The criterion over time, by the weights of the scheme.
pub fn goals(inverse: &InverseProblem<'_>, scheme: &dyn Discretisation, settings: &Settings) -> Vec<Goal> {
    let instants = quadrature(scheme);
    let weights = settings.effort_weights(inverse.model);
    let of = |(time, instant): (f64, f64), (member, weight): (usize, &f64)| Effort {
        time,
        member,
        weight: weight * instant,
        line: [0.0, 1.0],
    };
    let efforts = instants.iter().flat_map(|&at| weights.iter().enumerate().map(move |own| of(at, own)));
    // Excitations are unknowns where they are the effort.
    let quantity = inverse.muscles.excitation.unwrap_or(inverse.muscles.activation);
    let own = integral(quantity, settings.effort_power, efforts);
    [own].into_iter().chain(actuators::use_of(&inverse.actuators, SQRT_2, &instants)).collect()
}
