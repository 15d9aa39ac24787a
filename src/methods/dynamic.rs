//! `dynamic`: the motion and the muscles over time together, eqs (1)–(4), (13), (16) and (26) of the thesis, Paper B.
//!
//! With `scheme = "midpoint"` in q, q̇ and q̈ of one function q of time, as in the thesis; with `radau` in q and v,
//! with the joints on the velocity level too.

use std::sync::Arc;

use super::{Drive, InverseProblem, MotionVariables, MuscleVariables, StabilisationVariables};
use crate::model::Model;
use crate::motion::{Measurement, Surroundings};
use crate::problem::blocks::activation::Activation;
use crate::problem::blocks::contraction::Contraction;
use crate::problem::blocks::equation_of_motion::EquationOfMotion;
use crate::problem::blocks::joints::Joints;
use crate::problem::blocks::passive::PassiveMoment;
use crate::problem::blocks::reserve::Reserve;
use crate::problem::blocks::stabilisation::Stabilisation;
use crate::problem::{Bounded, Builder, Goal, Kind, goals};
use crate::settings::{BoundKind, Initial, LoadSharingGrid, Scheme, Settings};
use crate::transcription::scheme::{Discretisation, gauss};

/// The problem of a model with these settings.
pub fn dynamic<'m>(model: &'m Model, settings: &Settings, surroundings: &Arc<Surroundings>) -> InverseProblem<'m> {
    let mut problem = Builder::default();
    let (motion, muscles) = declare(&mut problem, model, settings.scheme, surroundings);
    add_motion(&mut problem, model, &motion);
    let contractions = add_muscles(&mut problem, model, &motion, &muscles, settings);
    let actuators = add_actuators(&mut problem, model, &motion, settings);
    add_limits(&mut problem, model, &muscles, settings);
    if settings.initial == Initial::Equilibrium {
        // The fibre of a rigid tendon follows the coordinates.
        let elastic = model.muscles.iter().enumerate().filter(|(_, muscle)| !muscle.rigid_tendon);
        elastic.for_each(|(m, _)| problem.at_rest(muscles.fibre_length, m));
    }
    InverseProblem { model, control: problem.build(model.muscles.len()), motion, muscles, contractions, actuators }
}

/// Declares the quantities, in the order of the decision vector, the variables at an instant, and the equations.
fn declare<'m>(
    problem: &mut Builder<'m>,
    model: &Model,
    scheme: Scheme,
    surroundings: &Arc<Surroundings>,
) -> (MotionVariables, MuscleVariables) {
    let first_order = scheme == Scheme::Radau;
    let (names, constraints) = (model.mechanics.coordinate_names(), model.mechanics.reaction_names());
    let (nq, nc, nm) = (names.len(), constraints.len(), model.muscles.len());
    let muscles = || model.muscles.iter().map(|muscle| muscle.name.clone()).collect::<Vec<_>>();
    let state = |order| Kind::State { order };
    let coordinate = problem.quantity("coordinate", names.clone(), state(if first_order { 1 } else { 2 }));
    let velocity = first_order.then(|| problem.quantity("velocity", names, state(1)));
    let fibre_length = problem.quantity("fibre_length", muscles(), state(1));
    let activation = problem.quantity("activation", muscles(), state(1));
    let excitation = problem.quantity("excitation", muscles(), Kind::Control);
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
    let [a, l] = [activation, fibre_length].map(|quantity| problem.read(quantity, 0));
    let [l_rate, a_rate] = [fibre_length, activation].map(|quantity| problem.read(quantity, 1));
    let (u, reactions) = (problem.read(excitation, 0), problem.read(reaction, 0));
    let of_bodies = match velocity {
        Some(velocity) => Some((velocity, 0)),
        None => model.mechanics.has_velocity_terms().then_some((coordinate, 1)),
    };
    let rates = of_bodies.map(|(quantity, level)| problem.read(quantity, level).and(problem.read(given, 1)));
    let stabilising = stabiliser.map(|eta| (problem.read(coordinate, 1), problem.read(eta, 0)));
    let loads = problem.read(load, 0);

    let [equation, joints] = [("motion", nq), ("joints", nc)].map(|(name, rows)| problem.equation(name, rows, true));
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
        reaction,
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
) -> Vec<Contraction<'m>> {
    let (step_weight, weight) = (step_weight(settings), model.weight());
    let mut contractions = Vec::new();
    for (m, muscle) in model.muscles.iter().enumerate() {
        let (activation, excitation) = (muscles.a.at(m), muscles.u.at(m));
        let contraction = Contraction {
            muscle,
            strength: muscle.max_isometric_force / weight,
            coordinates: motion.all,
            activation,
            length: muscles.l.at(m),
            velocity: muscles.l_rate.at(m),
            excitation,
            motion: motion.equation,
            row: muscles.contraction.at(m),
            force_row: muscles.fibre_force.at(m),
            step_weight,
        };
        problem.block(contraction);
        let (rate, row) = (muscles.a_rate.at(m), muscles.activation_dynamics.at(m));
        problem.block(Activation { muscle, activation, rate, excitation, row, step_weight });
        contractions.push(contraction);
    }
    contractions
}

/// Actuators of the model, and reserves. They are one more quantity, if there are any.
fn add_actuators<'m>(
    problem: &mut Builder<'m>,
    model: &'m Model,
    motion: &MotionVariables,
    settings: &Settings,
) -> Vec<Drive<'m>> {
    let coordinates = model.mechanics.driven_coordinates();
    let own = model.actuators.iter().map(|a| (a.coordinate.as_str(), a.name.clone(), a.optimal_force, a.control, 1.0));
    let free = [f64::NEG_INFINITY, f64::INFINITY];
    let reserves = (coordinates.iter().map(|coordinate| coordinate.name))
        // No name of the model has a point.
        .map(|name| (name, format!("reserve.{name}"), settings.reserve(name), free, settings.reserve_weight))
        .filter(|(_, _, moment, ..)| *moment > 0.0);
    let all: Vec<_> = own.chain(reserves).collect();
    if all.is_empty() {
        return Vec::new();
    }
    let names = all.iter().map(|(_, name, ..)| name.clone()).collect();
    let quantity = problem.quantity("actuator", names, Kind::Control);
    let controls = problem.read(quantity, 0);
    let weight = model.weight();
    let mut drives = Vec::new();
    for (member, (coordinate, name, moment, bounds, cost)) in all.into_iter().enumerate() {
        let number = coordinates.iter().position(|known| known.name == coordinate).expect("checked with the model");
        let coordinate = coordinates[number];
        let control = controls.at(member);
        problem.block(Reserve {
            coordinate,
            strength: moment / weight,
            coordinates: motion.all,
            control,
            motion: motion.equation,
            step_weight: step_weight(settings),
        });
        let limits = [("control", Bounded::Below(control)), ("control_upper", Bounded::Above(control))];
        for ((limit, bounded), bound) in limits.into_iter().zip(bounds).filter(|(_, bound)| bound.is_finite()) {
            problem.limit(limit, &name, bounded, bound);
        }
        let is_reserve = member >= model.actuators.len();
        drives.push(Drive { name, is_reserve, coordinate, number, moment, bounds, weight: cost, quantity, control });
    }
    drives
}

/// Weight of a step in activation relative to one in q: as the objective weighs activations, but not too small.
fn step_weight(settings: &Settings) -> f64 {
    2.5 * settings.mu.max(1e-2).powi(2)
}

fn add_limits(problem: &mut Builder<'_>, model: &Model, muscles: &MuscleVariables, settings: &Settings) {
    for kind in settings.bounds.kinds() {
        for (m, muscle) in model.muscles.iter().enumerate() {
            let (bounded, bound) = match kind {
                BoundKind::Activation => (Bounded::Below(muscles.a.at(m)), 0.0),
                BoundKind::Excitation => (Bounded::Below(muscles.u.at(m)), 0.0),
                BoundKind::ActivationUpper => (Bounded::Above(muscles.a.at(m)), 1.0),
                BoundKind::ExcitationUpper => (Bounded::Above(muscles.u.at(m)), 1.0),
                // No tendon pushes (eq. 11).
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
        all.push(goals::effort(activation, muscles, &instants, settings.mu, settings.effort_power));
        if settings.excitation_weight > 0.0 {
            let weights = vec![settings.mu * settings.excitation_weight.sqrt(); muscles];
            let own = excitation_instants(scheme, &instants, settings);
            all.push(goals::control_use("excitation", inverse.muscles.excitation, &weights, &own));
        }
        if let Some(drive) = inverse.actuators.first() {
            let weights: Vec<f64> = inverse.actuators.iter().map(|drive| settings.mu * drive.weight.sqrt()).collect();
            all.push(goals::control_use("reserve_use", drive.quantity, &weights, &instants));
        }
    }
    all
}
