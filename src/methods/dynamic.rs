//! `dynamic`: the motion and the muscles over time together, eqs (1)–(4), (13), (16) and (26) of the thesis, Paper B.
//!
//! With `muscle_dynamics = "force"` muscles make any force from 0 to F_o (eqs 1.3, 1.7, and with μ > 0 eq. 1.8).
//!
//! DEPARTURE [thesis, eq. 1.8]: effort is weighed by μ²/2 as in eq. (26), not by μ/2.
//!
//! With `scheme = "midpoint"` in q, q̇ and q̈ of one function q of time, as in the thesis; with `radau` in q and v,
//! with the joints on the velocity level too.

use std::sync::Arc;

use super::muscle_force::{LinearForce, MuscleForce};
use super::{Drive, InverseProblem, MotionVariables, MuscleVariables, StabilisationVariables, actuators};
use crate::model::Model;
use crate::motion::{Measurement, Surroundings};
use crate::problem::blocks::activation::Activation;
use crate::problem::blocks::contraction::{Contraction, Way};
use crate::problem::blocks::equation_of_motion::EquationOfMotion;
use crate::problem::blocks::force_actuator::ForceActuator;
use crate::problem::blocks::joints::Joints;
use crate::problem::blocks::passive::PassiveMoment;
use crate::problem::blocks::reserve::Reserve;
use crate::problem::blocks::stabilisation::Stabilisation;
use crate::problem::{AtStart, Bounded, Builder, Goal, Kind, Span, goals};
use crate::settings::{BoundKind, Bounds, Initial, LoadSharingGrid, MuscleDynamics, Scheme, Settings};
use crate::transcription::scheme::{Discretisation, gauss};

/// The problem of a model with these settings.
pub fn dynamic<'m>(model: &'m Model, settings: &Settings, surroundings: &Arc<Surroundings>) -> InverseProblem<'m> {
    let mut problem = Builder::default();
    let (motion, muscles) = declare(&mut problem, model, settings, surroundings);
    add_motion(&mut problem, model, &motion);
    let forces = add_muscles(&mut problem, model, &motion, &muscles, settings);
    let actuators = add_actuators(&mut problem, model, &motion, settings);
    add_limits(&mut problem, model, &muscles, settings);
    if let (Some(lengths), Initial::Equilibrium) = (muscles.fibre_length, settings.initial) {
        // The fibre of a rigid tendon follows the coordinates.
        let elastic = model.muscles.iter().enumerate().filter(|(_, muscle)| !muscle.rigid_tendon);
        elastic.for_each(|(member, _)| problem.at_start(AtStart { state: lengths, member, rate: 0.0 }));
    }
    let control = problem.build(muscles.fibre_force.count);
    InverseProblem { model, control, motion, muscles, forces, actuators }
}

/// Declares the quantities, in the order of the decision vector, the variables at an instant, and the equations.
fn declare<'m>(
    problem: &mut Builder<'m>,
    model: &Model,
    settings: &Settings,
    surroundings: &Arc<Surroundings>,
) -> (MotionVariables, MuscleVariables) {
    let first_order = settings.scheme == Scheme::Radau;
    let is_force = settings.muscle_dynamics == MuscleDynamics::Force;
    let (names, constraints) = (model.mechanics.coordinate_names(), model.mechanics.reaction_names());
    let (nq, nc, nm) = (names.len(), constraints.len(), model.muscles.len());
    let muscles = || model.muscles.iter().map(|muscle| muscle.name.clone()).collect::<Vec<_>>();
    let state = |order| Kind::State { order };
    let coordinate = problem.quantity("coordinate", names.clone(), state(if first_order { 1 } else { 2 }));
    let velocity = first_order.then(|| problem.quantity("velocity", names, state(1)));
    let fibre_length = (!is_force).then(|| problem.quantity("fibre_length", muscles(), state(1)));
    let activation = problem.quantity("activation", muscles(), if is_force { Kind::Control } else { state(1) });
    let excitation = (!is_force).then(|| problem.quantity("excitation", muscles(), Kind::Control));
    let reaction = problem.quantity_in("reaction", constraints.clone(), Kind::Algebraic, model.weight());
    let stabiliser = first_order.then(|| problem.quantity("stabiliser", constraints, Kind::Algebraic));
    let (bodies, forces) = (surroundings.clone(), surroundings.clone());
    let given_names = model.mechanics.given_coordinate_names();
    let given = problem.given("given_coordinate", given_names, move |t| bodies.given(t));
    let loads = move |t| [forces.loads(t).concat(), Vec::new(), Vec::new()];
    let load = problem.given("load", model.mechanics.load_names(), loads);

    let q = problem.read(coordinate, 0);
    let all = q.and(problem.read(given, 0));
    let accelerations = problem.read(velocity.unwrap_or(coordinate), if first_order { 1 } else { 2 });
    let all_accelerations = accelerations.and(problem.read(given, 2));
    let a = problem.read(activation, 0);
    let l = fibre_length.map_or(Span::EMPTY, |quantity| problem.read(quantity, 0));
    let [l_rate, a_rate] = [fibre_length, excitation.map(|_| activation)]
        .map(|quantity| quantity.map_or(Span::EMPTY, |quantity| problem.read(quantity, 1)));
    let u = excitation.map_or(Span::EMPTY, |quantity| problem.read(quantity, 0));
    let reactions = problem.read(reaction, 0);
    let of_bodies = match velocity {
        Some(velocity) => Some((velocity, 0)),
        None => model.mechanics.has_velocity_terms().then_some((coordinate, 1)),
    };
    let rates = of_bodies.map(|(quantity, level)| problem.read(quantity, level).and(problem.read(given, 1)));
    let stabilising = stabiliser.map(|eta| (problem.read(coordinate, 1), problem.read(eta, 0)));
    let loads = problem.read(load, 0);

    let [equation, joints] = [("motion", nq), ("joints", nc)].map(|(name, rows)| problem.equation(name, rows, true));
    let nm = if is_force { 0 } else { nm };
    let contraction = problem.equation("contraction", nm, true);
    let activation_dynamics = problem.equation("activation", nm, true);
    let stabilisation = stabilising.map(|(rates, multipliers)| StabilisationVariables {
        rates,
        multipliers,
        kinematic: problem.equation("kinematic", nq, false),
        joint_velocities: problem.equation("joint_velocity", nc, false),
    });
    let fibre_force = problem.equation("fibre_force", nm, false);
    let motion = MotionVariables {
        coordinate,
        velocity,
        is_given: false,
        reaction: Some(reaction),
        q,
        all,
        rates,
        accelerations,
        all_accelerations,
        reactions,
        loads,
        equation,
        joints,
        stabilisation,
    };
    let muscles = MuscleVariables {
        activation,
        fibre_length,
        excitation,
        a,
        l,
        l_rate,
        a_rate,
        u,
        contraction,
        activation_dynamics,
        fibre_force,
    };
    (motion, muscles)
}

fn add_motion<'m>(problem: &mut Builder<'m>, model: &'m Model, motion: &MotionVariables) {
    let mechanics = model.mechanics.as_ref();
    let coordinates = motion.all;
    problem.block(EquationOfMotion {
        mechanics,
        weight: model.weight(),
        coordinates,
        velocities: motion.rates,
        accelerations: motion.all_accelerations,
        loads: motion.loads,
        rows: motion.equation,
    });
    for (number, element) in model.spatial().iter().flat_map(|spatial| spatial.passive()) {
        let rates = motion.rates.expect("a spatial model has velocities");
        problem.block(PassiveMoment {
            element,
            unit: 1.0 / model.weight(),
            variables: [coordinates.at(number), rates.at(number)],
            row: motion.equation.at(number),
        });
    }
    let (reactions, rows) = (motion.reactions, motion.joints);
    problem.block(Joints { mechanics, coordinates, reactions, motion: motion.equation, rows });
    if let (Some(stabilisation), Some(velocities)) = (motion.stabilisation, motion.rates) {
        problem.block(Stabilisation {
            mechanics,
            coordinates,
            rates: stabilisation.rates,
            velocities,
            multipliers: stabilisation.multipliers,
            kinematic_rows: stabilisation.kinematic,
            velocity_rows: stabilisation.joint_velocities,
        });
    }
}

fn add_muscles<'m>(
    problem: &mut Builder<'m>,
    model: &'m Model,
    motion: &MotionVariables,
    muscles: &MuscleVariables,
    settings: &Settings,
) -> Vec<MuscleForce<'m>> {
    let (step_weight, weight) = (step_weight(settings), model.weight());
    let mut forces = Vec::new();
    for (m, muscle) in model.muscles.iter().enumerate() {
        let activation = muscles.a.at(m);
        if settings.muscle_dynamics == MuscleDynamics::Force {
            let strength = muscle.max_isometric_force / weight;
            let (coordinates, motion) = (motion.all, motion.equation);
            problem.block(ForceActuator { muscle, strength, coordinates, activation, motion, step_weight });
            forces.push(MuscleForce::Linear(LinearForce { muscle, activation, known: None }));
            continue;
        }
        let excitation = muscles.u.at(m);
        let contraction = Contraction {
            muscle,
            strength: muscle.max_isometric_force / weight,
            way: Way::Of { coordinates: motion.all, motion: motion.equation },
            activation,
            length: muscles.l.at(m),
            velocity: muscles.l_rate.at(m),
            excitation: Some(excitation),
            row: muscles.contraction.at(m),
            force_row: muscles.fibre_force.at(m),
            step_weight,
        };
        problem.block(contraction.clone());
        let (rate, row) = (muscles.a_rate.at(m), muscles.activation_dynamics.at(m));
        problem.block(Activation { muscle, activation, rate, excitation, row, step_weight });
        forces.push(MuscleForce::Contraction(contraction));
    }
    forces
}

/// Actuators of the model, and reserves. They are one more quantity, if there are any.
fn add_actuators<'m>(
    problem: &mut Builder<'m>,
    model: &'m Model,
    motion: &MotionVariables,
    settings: &Settings,
) -> Vec<Drive<'m>> {
    let all = actuators::actuation(model, settings);
    let declared = actuators::declare(problem, &all);
    let drives = actuators::drives(all, declared);
    for Drive { own, control, .. } in &drives {
        problem.block(Reserve {
            coordinate: own.coordinate,
            strength: own.moment / model.weight(),
            coordinates: motion.all,
            control: *control,
            motion: motion.equation,
            step_weight: step_weight(settings),
        });
    }
    drives
}

/// Weight of a step in activation relative to one in q: as the objective weighs activations, but not too small.
fn step_weight(settings: &Settings) -> f64 {
    2.5 * settings.mu.max(1e-2).powi(2)
}

fn add_limits(problem: &mut Builder<'_>, model: &Model, muscles: &MuscleVariables, settings: &Settings) {
    let least = settings.min_activation;
    // A force is always between 0 and F_o (eq. 1.3).
    let is_force = settings.muscle_dynamics == MuscleDynamics::Force;
    let kinds = if is_force { Bounds::ActivationBoxed.kinds() } else { settings.bounds.kinds() };
    for kind in kinds {
        for (m, muscle) in model.muscles.iter().enumerate() {
            let (bounded, bound) = match kind {
                BoundKind::Activation => (Bounded::Below(muscles.a.at(m)), least),
                BoundKind::Excitation => (Bounded::Below(muscles.u.at(m)), least),
                BoundKind::ActivationUpper => (Bounded::Above(muscles.a.at(m)), 1.0),
                BoundKind::ExcitationUpper => (Bounded::Above(muscles.u.at(m)), 1.0),
                // No tendon pushes (eq. 11); where a ≥ 0 only one with a damped fibre may, see the warning `pushing`.
                BoundKind::Force => (Bounded::Function(muscles.fibre_force.at(m)), 0.0),
            };
            problem.limit(kind.name(), &muscle.name, bounded, bound);
        }
    }
}

/// Where efforts are taken: times (s) and weights. Of the thesis' sum of squares the load-sharing grid with weights of
/// 1; of another power the instants and weights (s) of a quadrature.
pub fn effort_instants(scheme: &dyn Discretisation, measurement: &Measurement, settings: &Settings) -> Vec<(f64, f64)> {
    if settings.effort_power != 2.0 {
        return gauss(scheme.breakpoints()).collect();
    }
    let times = match settings.load_sharing_grid {
        LoadSharingGrid::Measurement => &measurement.times,
        LoadSharingGrid::Collocation => scheme.points(),
    };
    times.iter().map(|&t| (t, 1.0)).collect()
}

/// Where excitations are taken: the points at which they are unknowns, with the weights of the scheme's quadrature, in
/// all as much as the instants of the efforts.
fn excitation_instants(scheme: &dyn Discretisation, efforts: &[(f64, f64)], settings: &Settings) -> Vec<(f64, f64)> {
    let quadrature = scheme.quadrature();
    let duration: f64 = quadrature.iter().sum();
    let density = if settings.effort_power == 2.0 { efforts.len() as f64 / duration } else { 1.0 };
    let all = scheme.points().iter().zip(&quadrature).filter(|(_, weight)| **weight > 0.0);
    all.map(|(&t, weight)| (t, density * weight)).collect()
}

/// The objective: tracking, and with μ > 0 effort.
pub fn goals(
    inverse: &InverseProblem<'_>,
    scheme: &dyn Discretisation,
    measurement: &Measurement,
    settings: &Settings,
) -> Vec<Goal> {
    let model = inverse.model;
    let (times, measured) = (&measurement.times, &measurement.coordinates);
    let names = model.mechanics.coordinate_names();
    let scales: Vec<f64> = names.iter().map(|name| settings.tracking_weight(name).sqrt()).collect();
    let rows = times.iter().zip(measured).map(|(&t, q)| {
        let mut rows = model.mechanics.tracking_rows(&inverse.all_coordinates(t, q));
        rows.iter_mut().flatten().for_each(|(coordinate, factor)| *factor *= scales[*coordinate]);
        rows
    });
    let mut all = vec![goals::tracking(inverse.motion.coordinate, times, measured, rows.collect())];
    if settings.mu > 0.0 {
        let instants = effort_instants(scheme, measurement, settings);
        let (activation, muscles) = (inverse.muscles.activation, model.muscles.len());
        let weights = settings.effort_weights(model);
        all.push(goals::effort(activation, &weights, &instants, settings.mu, settings.effort_power));
        if let Some(excitation) = inverse.muscles.excitation.filter(|_| settings.excitation_weight > 0.0) {
            let weights = vec![settings.mu * settings.excitation_weight.sqrt(); muscles];
            let own = excitation_instants(scheme, &instants, settings);
            all.push(goals::control_use("excitation", excitation, &weights, &own));
        }
        all.extend(actuators::use_of(&inverse.actuators, settings.mu, &instants));
    }
    all
}
