//! What a problem knows of a given motion at each instant, as variables: the moments needed, what muscles and actuators make of
//! them, and the lengths of paths.

use std::sync::Arc;

use super::MotionVariables;
use super::given_motion::{GivenMotion, Instant};
use crate::model::{Model, Musculotendon};
use crate::problem::blocks::moment_balance::Entry;
use crate::problem::{Builder, Span};

/// A muscle with less strength than this, of its maximum isometric force, is left out.
const NO_STRENGTH: f64 = 1e-3;

/// How muscles enter the balance of moments.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Law {
    /// Any force up to F_o: A has the moment at F_o.
    Force,
    /// `N a + P` of the motion's lengths and velocities: A has the moment of N, b lacks that of P.
    Hill,
    /// Not at all, their fibres being unknown: A has moment arms.
    Arms,
}

/// Where each known number is among the variables.
#[derive(Clone, Debug)]
pub struct Known {
    /// b, by row.
    pub needed: Span,
    /// The entries of A: of each muscle and each actuator, rows and places.
    pub muscles: Vec<(Arc<[usize]>, Span)>,
    pub actuators: Vec<(Arc<[usize]>, Span)>,
    /// By muscle, normalised by F_o.
    pub strength: Span,
    pub passive: Span,
    /// Length of the path, m, and its rate, m/s.
    pub path: Span,
    pub path_rate: Span,
}

impl Known {
    /// Declares all of it.
    pub fn declare<'m>(problem: &mut Builder<'m>, model: &'m Model, given: &Arc<GivenMotion<'m>>, law: Law) -> Self {
        let nm = model.muscles.len();
        let rows_of_muscles: Vec<Arc<[usize]>> = (0..nm).map(|m| given.rows_of_muscle(m).into()).collect();
        let rows_of_actuators: Vec<Arc<[usize]>> =
            (0..given.actuation.len()).map(|k| given.rows_of_actuator(k).into()).collect();
        let counts = [given.count()].into_iter();
        let entries = rows_of_muscles.iter().chain(&rows_of_actuators).map(|rows| rows.len());
        let counts: Vec<usize> = counts.chain(entries).chain([nm; 3]).collect();
        let members = (0..counts.iter().sum()).map(|k| format!("known.{k}")).collect();
        let (own, weight) = (given.clone(), model.weight());
        let quantity = problem.given("known", members, move |t| values(model, law, &own.at(t), weight));
        let (all, rates) = (problem.read(quantity, 0), problem.read(quantity, 1));
        let mut start = all.start;
        let mut next = |count: usize| {
            let span = Span { start, count };
            start += count;
            span
        };
        let needed = next(given.count());
        let mut placed = |rows: Vec<Arc<[usize]>>| {
            rows.into_iter().map(|rows| (rows.clone(), next(rows.len()))).collect::<Vec<(Arc<[usize]>, Span)>>()
        };
        let (muscles, actuators) = (placed(rows_of_muscles), placed(rows_of_actuators));
        let [strength, passive, path] = [(); 3].map(|()| next(nm));
        let path_rate = Span { start: path.start - all.start + rates.start, count: nm };
        Self { needed, muscles, actuators, strength, passive, path, path_rate }
    }

    /// The entries of A of muscles with these activations.
    pub fn of_muscles(&self, activations: Span) -> Vec<Entry> {
        entries(&self.muscles, activations)
    }

    /// The entries of A of actuators with these controls.
    pub fn of_actuators(&self, controls: Option<Span>) -> Vec<Entry> {
        controls.map_or_else(Vec::new, |controls| entries(&self.actuators, controls))
    }
}

fn entries(all: &[(Arc<[usize]>, Span)], controls: Span) -> Vec<Entry> {
    let of = |((rows, factors), control): (&(Arc<[usize]>, Span), usize)| {
        let pairs = rows.iter().zip(factors.range());
        pairs.map(|(&row, factor)| Entry { row, control, factor }).collect::<Vec<Entry>>()
    };
    all.iter().zip(controls.range()).flat_map(of).collect()
}

/// Strength and passive force of each muscle at an instant, normalised by F_o.
fn strengths(model: &Model, law: Law, instant: &Instant) -> Vec<[f64; 2]> {
    let of = |muscle: &Musculotendon, [length, rate]: [f64; 2]| {
        if law != Law::Hill {
            return [1.0, 0.0];
        }
        let [passive, full] = muscle.force_range(length, rate);
        let strength = full - passive;
        if strength.is_nan() || strength < NO_STRENGTH { [0.0, passive.max(0.0)] } else { [strength, passive] }
    };
    model.muscles.iter().zip(&instant.paths).map(|(muscle, path)| of(muscle, *path)).collect()
}

/// Values and rates.
fn values(model: &Model, law: Law, instant: &Instant, weight: f64) -> [Vec<f64>; 3] {
    let strengths = strengths(model, law, instant);
    let mut needed = instant.needed.clone();
    let mut factors = Vec::new();
    for ((muscle, arms), [strength, passive]) in model.muscles.iter().zip(&instant.arms).zip(&strengths) {
        for &(row, arm) in arms {
            let force = muscle.max_isometric_force * arm;
            needed[row] -= passive * force;
            factors.push(if law == Law::Arms { arm } else { strength * force / weight });
        }
    }
    let mut values: Vec<f64> = needed.iter().map(|x| x / weight).collect();
    values.extend(factors);
    values.extend(instant.actuators.iter().flatten().map(|(_, moment)| moment / weight));
    values.extend(strengths.iter().map(|law| law[0]));
    values.extend(strengths.iter().map(|law| law[1]));
    let mut rates = vec![0.0; values.len()];
    values.extend(instant.paths.iter().map(|path| path[0]));
    rates.extend(instant.paths.iter().map(|path| path[1]));
    [values, rates, Vec::new()]
}

/// The variables of a motion that is given.
pub fn motion<'m>(problem: &mut Builder<'m>, model: &Model, given: &Arc<GivenMotion<'m>>) -> MotionVariables {
    let mut names = model.mechanics.coordinate_names();
    let count = names.len();
    names.extend(model.mechanics.given_coordinate_names());
    let own = given.clone();
    let coordinate = problem.given("coordinate", names, move |t| own.at(t).motion.clone());
    let own = given.clone();
    let loads = move |t| [own.at(t).loads.concat(), Vec::new(), Vec::new()];
    let load = problem.given("load", model.mechanics.load_names(), loads);
    let all = problem.read(coordinate, 0);
    let [rates, accelerations] = [1, 2].map(|level| problem.read(coordinate, level));
    MotionVariables {
        coordinate,
        velocity: None,
        is_given: true,
        reaction: None,
        q: Span { start: all.start, count },
        all,
        rates: Some(rates),
        accelerations: Span { start: accelerations.start, count },
        all_accelerations: accelerations,
        reactions: Span::EMPTY,
        loads: problem.read(load, 0),
        equation: Span::EMPTY,
        joints: Span::EMPTY,
        stabilisation: None,
    }
}
