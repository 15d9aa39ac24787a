//! `dynamic`: the motion and the muscles over time together, eqs (1)–(4), (13), (16) and (26) of the thesis, Paper B.
//!
//! With `scheme = "midpoint"` in q, q̇ and q̈ of one function q of time, as in the thesis; with `radau` in q and v, with the
//! joints on the velocity level too.

use std::sync::Arc;

use super::{Drive, InverseProblem, MotionVariables, MuscleVariables};
use crate::model::Model;
use crate::motion::{Measurement, Surroundings};
use crate::problem::blocks::activation::Activation;
use crate::problem::blocks::contraction::Contraction;
use crate::problem::blocks::equation_of_motion::EquationOfMotion;
use crate::problem::blocks::joints::Joints;
use crate::problem::blocks::reserve::Reserve;
use crate::problem::blocks::stabilisation::Stabilisation;
use crate::problem::{Bounded, Builder, Goal, Kind, QuantityId, Span, goals};
use crate::settings::{BoundKind, Initial, LoadSharingGrid, Scheme, Settings};
use crate::transcription::scheme::{Discretisation, gauss};

/// The problem of a model with these settings.
pub fn dynamic<'m>(model: &'m Model, settings: &Settings, surroundings: &Arc<Surroundings>) -> InverseProblem<'m> {
    let mut problem = Builder::default();
    let quantities = Quantities::declare(&mut problem, model, settings.scheme, surroundings);
    let variables = Variables::read(&mut problem, &quantities, model);
    let equations = Equations::declare(&mut problem, &quantities, model);
    add_motion(&mut problem, model, &variables, &equations);
    let contractions = add_muscles(&mut problem, model, &variables, &equations, settings);
    let actuators = add_actuators(&mut problem, model, &variables, &equations, settings);
    add_limits(&mut problem, model, &variables, &equations, settings);
    if settings.initial == Initial::Equilibrium {
        // The fibre of a rigid tendon follows the coordinates.
        let elastic = model.muscles.iter().enumerate().filter(|(_, muscle)| !muscle.rigid_tendon);
        elastic.for_each(|(m, _)| problem.at_rest(quantities.fibre_length, m));
    }
    InverseProblem {
        model,
        control: problem.build(model.muscles.len()),
        motion: MotionVariables {
            coordinate: quantities.coordinate,
            velocity: quantities.velocity,
            q: variables.q,
            all: variables.all,
            rates: variables.velocities,
            accelerations: variables.accelerations,
            reaction: quantities.reaction,
            reactions: variables.reactions,
            equation: equations.motion,
            joints: equations.joints,
            joint_velocities: equations.stabilisation.map(|[_, velocity]| velocity),
        },
        muscles: MuscleVariables {
            activation: quantities.activation,
            fibre_length: quantities.fibre_length,
            excitation: quantities.excitation,
            a: variables.a,
            l: variables.l,
            l_rate: variables.l_rate,
            a_rate: variables.a_rate,
            u: variables.u,
            contraction: equations.contraction,
        },
        contractions,
        actuators,
    }
}

/// The quantities, in the order of the decision vector.
struct Quantities {
    coordinate: QuantityId,
    velocity: Option<QuantityId>,
    fibre_length: QuantityId,
    activation: QuantityId,
    excitation: QuantityId,
    reaction: QuantityId,
    stabiliser: Option<QuantityId>,
    given: QuantityId,
    load: QuantityId,
}

impl Quantities {
    fn declare<'m>(problem: &mut Builder<'m>, model: &Model, scheme: Scheme, surroundings: &Arc<Surroundings>) -> Self {
        let is_first_order = scheme == Scheme::Radau;
        let names = model.mechanics.body_coordinate_names();
        let muscles = || model.muscles.iter().map(|muscle| muscle.name.clone()).collect::<Vec<_>>();
        let constraints = model.constraint_names();
        let order = if is_first_order { 1 } else { 2 };
        let coordinate = problem.quantity("coordinate", names.clone(), Kind::State { order });
        let velocity = is_first_order.then(|| problem.quantity("velocity", names, Kind::State { order: 1 }));
        let fibre_length = problem.quantity("fibre_length", muscles(), Kind::State { order: 1 });
        let activation = problem.quantity("activation", muscles(), Kind::State { order: 1 });
        let excitation = problem.quantity("excitation", muscles(), Kind::Control);
        let reaction = problem.quantity_in("reaction", constraints.clone(), Kind::Algebraic, model.weight());
        let stabiliser = is_first_order.then(|| problem.quantity("stabiliser", constraints, Kind::Algebraic));
        let (bodies, forces) = (surroundings.clone(), surroundings.clone());
        let given =
            problem.given("given_coordinate", model.mechanics.given_coordinate_names(), move |t| bodies.given(t));
        let load = problem.given("load", model.mechanics.load_names(), move |t| (forces.loads(t).concat(), Vec::new()));
        Self { coordinate, velocity, fibre_length, activation, excitation, reaction, stabiliser, given, load }
    }
}

/// The variables at an instant.
struct Variables {
    q: Span,
    /// q with the given coordinates.
    all: Span,
    accelerations: Span,
    a: Span,
    l: Span,
    l_rate: Span,
    a_rate: Span,
    u: Span,
    reactions: Span,
    /// Of all bodies, where the equations have them.
    velocities: Option<Span>,
    /// q̇ and η of the first-order form.
    stabilisation: Option<[Span; 2]>,
    loads: Span,
}

impl Variables {
    fn read(problem: &mut Builder<'_>, quantities: &Quantities, model: &Model) -> Self {
        let q = problem.read(quantities.coordinate, 0);
        let all = q.and(problem.read(quantities.given, 0));
        let accelerations = match quantities.velocity {
            Some(velocity) => problem.read(velocity, 1),
            None => problem.read(quantities.coordinate, 2),
        };
        let [a, l] = [quantities.activation, quantities.fibre_length].map(|quantity| problem.read(quantity, 0));
        let [l_rate, a_rate] = [quantities.fibre_length, quantities.activation].map(|q| problem.read(q, 1));
        let u = problem.read(quantities.excitation, 0);
        let reactions = problem.read(quantities.reaction, 0);
        let of_bodies = match quantities.velocity {
            Some(velocity) => Some(problem.read(velocity, 0)),
            // The quadratic velocity terms of Euler parameters.
            None if model.spatial().is_some() => Some(problem.read(quantities.coordinate, 1)),
            None => None,
        };
        let velocities = of_bodies.map(|velocities| velocities.and(problem.read(quantities.given, 1)));
        let stabilisation =
            quantities.stabiliser.map(|eta| [problem.read(quantities.coordinate, 1), problem.read(eta, 0)]);
        let loads = problem.read(quantities.load, 0);
        Self { q, all, accelerations, a, l, l_rate, a_rate, u, reactions, velocities, stabilisation, loads }
    }
}

/// The equations, and f_m as a function for limits.
struct Equations {
    motion: Span,
    joints: Span,
    contraction: Span,
    activation: Span,
    /// q̇ = v + Φ_qᵀ η and Φ_q v = 0.
    stabilisation: Option<[Span; 2]>,
    fibre_force: Span,
}

impl Equations {
    fn declare(problem: &mut Builder<'_>, quantities: &Quantities, model: &Model) -> Self {
        let (nq, nc, nm) = (model.mechanics.coordinates(), model.mechanics.constraints(), model.muscles.len());
        Self {
            motion: problem.equation("motion", nq, true),
            joints: problem.equation("joints", nc, true),
            contraction: problem.equation("contraction", nm, true),
            activation: problem.equation("activation", nm, true),
            stabilisation: quantities
                .stabiliser
                .map(|_| [problem.equation("kinematic", nq, false), problem.equation("joint_velocity", nc, false)]),
            fibre_force: problem.equation("fibre_force", nm, false),
        }
    }
}

fn add_motion<'m>(problem: &mut Builder<'m>, model: &'m Model, variables: &Variables, equations: &Equations) {
    let mechanics = model.mechanics.as_ref();
    problem.block(EquationOfMotion {
        mechanics,
        weight: model.weight(),
        coordinates: variables.all,
        velocities: variables.velocities,
        accelerations: variables.accelerations,
        loads: variables.loads,
        rows: equations.motion,
    });
    problem.block(Joints {
        mechanics,
        coordinates: variables.all,
        reactions: variables.reactions,
        motion: equations.motion,
        rows: equations.joints,
    });
    let velocities = variables.velocities;
    if let (Some([rates, multipliers]), Some([kinematic_rows, velocity_rows]), Some(velocities)) =
        (variables.stabilisation, equations.stabilisation, velocities)
    {
        problem.block(Stabilisation {
            mechanics,
            coordinates: variables.all,
            rates,
            velocities,
            multipliers,
            kinematic_rows,
            velocity_rows,
        });
    }
}

fn add_muscles<'m>(
    problem: &mut Builder<'m>,
    model: &'m Model,
    variables: &Variables,
    equations: &Equations,
    settings: &Settings,
) -> Vec<Contraction<'m>> {
    let (step_weight, weight) = (step_weight(settings), model.weight());
    let mut contractions = Vec::new();
    for (m, muscle) in model.muscles.iter().enumerate() {
        let (activation, excitation) = (variables.a.at(m), variables.u.at(m));
        let contraction = Contraction {
            muscle,
            strength: muscle.max_isometric_force / weight,
            coordinates: variables.all,
            activation,
            length: variables.l.at(m),
            velocity: variables.l_rate.at(m),
            excitation,
            motion: equations.motion,
            row: equations.contraction.at(m),
            force_row: equations.fibre_force.at(m),
            step_weight,
        };
        let rate = variables.a_rate.at(m);
        problem.block(contraction);
        problem.block(Activation {
            muscle,
            activation,
            rate,
            excitation,
            row: equations.activation.at(m),
            step_weight,
        });
        contractions.push(contraction);
    }
    contractions
}

/// Actuators of the model, and reserves. They are one more quantity, if there are any.
fn add_actuators<'m>(
    problem: &mut Builder<'m>,
    model: &'m Model,
    variables: &Variables,
    equations: &Equations,
    settings: &Settings,
) -> Vec<Drive<'m>> {
    let Some(planar) = model.planar() else { return Vec::new() };
    let own = model.actuators.iter().map(|a| (a.coordinate.as_str(), a.name.as_str(), a.optimal_force, a.control, 1.0));
    let free = [f64::NEG_INFINITY, f64::INFINITY];
    let reserves = (planar.coordinates_of_joints())
        .map(|(_, name)| (name, name, settings.reserve(name), free, settings.reserve_weight))
        .filter(|(_, _, moment, ..)| *moment > 0.0);
    let all: Vec<_> = own.chain(reserves).collect();
    if all.is_empty() {
        return Vec::new();
    }
    let names = all.iter().map(|(_, name, ..)| (*name).to_owned()).collect();
    let quantity = problem.quantity("actuator", names, Kind::Control);
    let controls = problem.read(quantity, 0);
    let weight = model.weight();
    let mut drives = Vec::new();
    for (member, (coordinate, name, moment, bounds, cost)) in all.into_iter().enumerate() {
        let mut joints = planar.coordinates_of_joints().filter(|(_, known)| *known == coordinate);
        let (joint, _) = joints.next().expect("checked with the model");
        let control = controls.at(member);
        problem.block(Reserve {
            joint,
            strength: moment / weight,
            coordinates: variables.all,
            control,
            motion: equations.motion,
            step_weight: step_weight(settings),
        });
        let limits = [("control", Bounded::Below(control)), ("control_upper", Bounded::Above(control))];
        for ((limit, bounded), bound) in limits.into_iter().zip(bounds).filter(|(_, bound)| bound.is_finite()) {
            problem.limit(limit, name, bounded, bound);
        }
        let (name, is_reserve) = (name.to_owned(), member >= model.actuators.len());
        drives.push(Drive { name, is_reserve, joint, moment, bounds, weight: cost, quantity, member, control });
    }
    drives
}

/// Weight of a step in activation relative to one in q: as the objective weighs activations, but not too small.
fn step_weight(settings: &Settings) -> f64 {
    2.5 * settings.mu.max(1e-2).powi(2)
}

fn add_limits(
    problem: &mut Builder<'_>,
    model: &Model,
    variables: &Variables,
    equations: &Equations,
    settings: &Settings,
) {
    for kind in settings.bounds.kinds() {
        for (m, muscle) in model.muscles.iter().enumerate() {
            let (bounded, bound) = match kind {
                BoundKind::Activation => (Bounded::Below(variables.a.at(m)), 0.0),
                BoundKind::Excitation => (Bounded::Below(variables.u.at(m)), 0.0),
                BoundKind::ActivationUpper => (Bounded::Above(variables.a.at(m)), 1.0),
                BoundKind::ExcitationUpper => (Bounded::Above(variables.u.at(m)), 1.0),
                // No tendon pushes (eq. 11).
                BoundKind::Force => (Bounded::Function(equations.fibre_force.at(m)), 0.0),
            };
            problem.limit(kind.name(), &muscle.name, bounded, bound);
        }
    }
}

/// Where efforts are taken: times (s) and weights. Of the thesis' sum of squares the load-sharing grid with weights of 1; of
/// another power the instants and weights (s) of a quadrature.
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

/// The objective: tracking, and with μ > 0 effort.
pub fn goals(
    inverse: &InverseProblem<'_>,
    scheme: &dyn Discretisation,
    measurement: &Measurement,
    settings: &Settings,
) -> Vec<Goal> {
    let model = inverse.model;
    let weights: Vec<f64> = (0..model.mechanics.coordinates()).map(|i| model.mechanics.tracking_weight(i)).collect();
    let mut all =
        vec![goals::tracking(inverse.motion.coordinate, &measurement.times, &measurement.coordinates, &weights)];
    if settings.mu > 0.0 {
        let instants = effort_instants(scheme, measurement, settings);
        let (activation, muscles) = (inverse.muscles.activation, model.muscles.len());
        all.push(goals::effort(activation, muscles, &instants, settings.mu, settings.effort_power));
        if let Some(drive) = inverse.actuators.first() {
            let weights: Vec<f64> = inverse.actuators.iter().map(|drive| settings.mu * drive.weight.sqrt()).collect();
            all.push(goals::reserve_use(drive.quantity, &weights, &instants));
        }
    }
    all
}
