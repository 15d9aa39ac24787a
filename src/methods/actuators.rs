//! Actuators of the model, and reserves: what moves joint coordinates beside muscles.

use super::Drive;
use crate::model::{DrivenCoordinate, Model};
use crate::problem::goals::control_use;
use crate::problem::{Bounded, Builder, Goal, Kind, QuantityId, Span};
use crate::settings::Settings;

/// One of them.
#[derive(Clone, Debug)]
pub struct Actuation<'m> {
    /// Of a reserve `reserve.` and that of its coordinate.
    pub name: String,
    pub is_reserve: bool,
    pub coordinate: DrivenCoordinate<'m>,
    /// Of the coordinate, among all that may be driven.
    pub number: usize,
    /// Moment (N m) or force (N) at a control of 1.
    pub moment: f64,
    /// Bounds on its control.
    pub bounds: [f64; 2],
    /// Weight of its squared control relative to squared activations.
    pub weight: f64,
}

/// Those of the model first.
pub fn actuation<'m>(model: &'m Model, settings: &Settings) -> Vec<Actuation<'m>> {
    let coordinates = model.mechanics.driven_coordinates();
    let at = |coordinate: &str, name: String, moment: f64, is_reserve: bool| {
        let number = coordinates.iter().position(|known| known.name == coordinate).expect("checked with the model");
        let bounds = [f64::NEG_INFINITY, f64::INFINITY];
        let weight = if is_reserve { settings.reserve_weight } else { 1.0 };
        Actuation { name, is_reserve, coordinate: coordinates[number], number, moment, bounds, weight }
    };
    let own = model.actuators.iter().map(|own| Actuation {
        bounds: own.control,
        ..at(&own.coordinate, own.name.clone(), own.optimal_force, false)
    });
    let reserves = coordinates.iter().map(|coordinate| (coordinate.name, settings.reserve(coordinate.name)));
    // No name of the model has a point.
    let reserves = reserves
        .filter(|(_, moment)| *moment > 0.0)
        .map(|(name, moment)| at(name, format!("reserve.{name}"), moment, true));
    own.chain(reserves).collect()
}

/// Declares their controls, if there are any, with their bounds.
pub fn declare(problem: &mut Builder<'_>, all: &[Actuation<'_>]) -> Option<(QuantityId, Span)> {
    if all.is_empty() {
        return None;
    }
    let names = all.iter().map(|own| own.name.clone()).collect();
    let quantity = problem.quantity("actuator", names, Kind::Control);
    let controls = problem.read(quantity, 0);
    for (own, control) in all.iter().zip(controls.range()) {
        let limits = [("control", Bounded::Below(control)), ("control_upper", Bounded::Above(control))];
        for ((limit, bounded), bound) in limits.into_iter().zip(own.bounds).filter(|(_, bound)| bound.is_finite()) {
            problem.limit(limit, &own.name, bounded, bound);
        }
    }
    Some((quantity, controls))
}

/// What they are in a problem with these controls.
pub fn drives<'m>(all: Vec<Actuation<'m>>, declared: Option<(QuantityId, Span)>) -> Vec<Drive<'m>> {
    let Some((quantity, controls)) = declared else { return Vec::new() };
    all.into_iter().zip(controls.range()).map(|(own, control)| Drive { own, quantity, control }).collect()
}

/// Their part of the objective, `½ factor² Σ c r²` over `instants`: times (s) and weights.
pub fn use_of(drives: &[Drive<'_>], factor: f64, instants: &[(f64, f64)]) -> Option<Goal> {
    let first = drives.first()?;
    let weights: Vec<f64> = drives.iter().map(|drive| factor * drive.own.weight.sqrt()).collect();
    Some(control_use("reserve_use", first.quantity, &weights, instants))
}
