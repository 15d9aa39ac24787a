//! A motion that is given: what it needs at each instant, and what muscles and actuators can do about it.
//!
//! ```text
//! Σ_m R_m F_m + Σ_k T_k r_k = τ(t)
//! ```
//!
//! τ is the inertial force of the (smoothed) motion less external loads and passive moments, R_m = −∂L_m/∂θ the moment arms. Where
//! joints are constraints between coordinates, both are projected on the motions that they allow, so that reactions do not
//! appear.

use std::sync::{Arc, Mutex, PoisonError};

use nalgebra::{DMatrix, DVector};

use super::actuators::Actuation;
use crate::deadline::Deadline;
use crate::model::mechanics::Motion;
use crate::model::{Mechanics, Model};
use crate::motion::{MeasurementError, MotionTable, Surroundings};
use crate::numerics::cubic::CubicSpline;
use crate::settings::Settings;

/// Singular values of Φ_q below this share of the largest count as 0.
const DEPENDENT: f64 = 1e-9;
/// Step of the differences over time of lengths of paths that given coordinates move, s.
const TIME_STEP: f64 = 1e-4;

/// A given motion of a model.
pub struct GivenMotion<'m> {
    model: &'m Model,
    surroundings: Arc<Surroundings>,
    /// Of the coordinates that move by forces.
    coordinates: Vec<CubicSpline>,
    /// Actuators and reserves.
    pub actuation: Vec<Actuation<'m>>,
    pub rows: Rows,
    /// The instant asked for last: several quantities are known by one.
    last: Mutex<Option<(f64, Arc<Instant>)>>,
}

/// The motions that equilibrium is stated for.
#[derive(Clone, Debug, PartialEq)]
pub enum Rows {
    /// Each coordinate.
    Coordinates,
    /// Of each joint coordinate alone.
    Joints,
    /// As many as the joints allow, where these close loops: orthonormal combinations of coordinates.
    Free(usize),
}

/// What is known at an instant.
#[derive(Clone, Debug)]
pub struct Instant {
    /// All coordinates with rates and accelerations, the given ones last.
    pub motion: [Vec<f64>; 3],
    /// As [`Mechanics::force`] wants them.
    pub loads: Vec<[f64; 3]>,
    /// τ, by row, N m or N.
    pub needed: Vec<f64>,
    /// R of each muscle: (row, m).
    pub arms: Vec<Vec<(usize, f64)>>,
    /// Length (m) of each path, and its rate (m/s).
    pub paths: Vec<[f64; 2]>,
    /// T of each actuator: (row, N m or N).
    pub actuators: Vec<Vec<(usize, f64)>>,
}

impl<'m> GivenMotion<'m> {
    /// # Errors
    /// If joints cannot be closed at some instant, or the deadline passes.
    pub fn new(
        model: &'m Model,
        table: &MotionTable,
        settings: &Settings,
        surroundings: Arc<Surroundings>,
        deadline: Deadline,
    ) -> Result<Self, MeasurementError> {
        let coordinates = settings.of_motion().followed(table, model, deadline)?;
        let start: Vec<f64> = coordinates.iter().map(|spline| spline.at(0.0)[0]).collect();
        let all: Vec<f64> = start.into_iter().chain(surroundings.given(0.0)[0].iter().copied()).collect();
        let actuation = super::actuators::actuation(model, settings);
        let rows = Rows::of(model.mechanics.as_ref(), &all);
        Ok(Self { model, surroundings, coordinates, actuation, rows, last: Mutex::new(None) })
    }

    /// Number of rows.
    pub fn count(&self) -> usize {
        match self.rows {
            Rows::Coordinates => self.model.mechanics.coordinates(),
            Rows::Joints => self.model.mechanics.driven_coordinates().len(),
            Rows::Free(count) => count,
        }
    }

    /// The joint coordinate of each row; `None` where rows are combinations of them.
    pub fn row_names(&self) -> Option<Vec<(String, bool)>> {
        let driven = self.model.mechanics.driven_coordinates();
        let names = driven.into_iter().map(|coordinate| (coordinate.name.to_owned(), coordinate.is_angle)).collect();
        (!matches!(self.rows, Rows::Free(_))).then_some(names)
    }

    /// Which rows a muscle may act in, the same ones at every instant.
    pub fn rows_of_muscle(&self, muscle: usize) -> Vec<usize> {
        match self.rows {
            Rows::Coordinates => self.model.muscles[muscle].path.slots().to_vec(),
            _ => (0..self.count()).collect(),
        }
    }

    /// The same of an actuator.
    pub fn rows_of_actuator(&self, actuator: usize) -> Vec<usize> {
        match self.rows {
            Rows::Free(count) => (0..count).collect(),
            _ => vec![self.actuation[actuator].number],
        }
    }

    /// What is known at a time since the start of the motion, s.
    pub fn at(&self, t: f64) -> Arc<Instant> {
        let last = || self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, instant)) = last().as_ref().filter(|(time, _)| *time == t) {
            return instant.clone();
        }
        let instant = Arc::new(self.instant(t));
        *last() = Some((t, instant.clone()));
        instant
    }

    fn instant(&self, t: f64) -> Instant {
        let (model, mechanics) = (self.model, self.model.mechanics.as_ref());
        let motion = self.motion(t);
        let [q, velocity, acceleration] = &motion;
        let loads = self.surroundings.loads(t);
        let force = model.needed_forces(Motion { q, velocity, acceleration }, &loads);
        let directions = self.rows.directions(mechanics, q);
        let project = |vector: &[(usize, f64)], rows: &[usize]| match &directions {
            None => vector.to_vec(),
            Some(along) => {
                let of_row = |&row: &usize| (row, vector.iter().map(|&(i, x)| along[(i, row)] * x).sum());
                rows.iter().map(of_row).collect::<Vec<_>>()
            }
        };
        let (mut arms, mut paths) = (Vec::new(), Vec::new());
        for (m, muscle) in model.muscles.iter().enumerate() {
            let mut path = muscle.path.buffer();
            muscle.path.length(q, false, &mut path);
            let slots = muscle.path.slots().iter().zip(&path.gradient);
            let rate = match self.given_rate(m, t) {
                Some(rate) => rate,
                None => slots.clone().map(|(&slot, gradient)| gradient * velocity[slot]).sum(),
            };
            let arm: Vec<(usize, f64)> = slots.map(|(&slot, gradient)| (slot, -gradient)).collect();
            arms.push(project(&arm, &self.rows_of_muscle(m)));
            paths.push([path.value, rate]);
        }
        let actuator = |(k, own): (usize, &Actuation<'_>)| {
            let slopes = own.coordinate.slopes(q);
            let moment: Vec<(usize, f64)> =
                slopes.slots.into_iter().zip(slopes.gradient).map(|(slot, g)| (slot, own.moment * g)).collect();
            project(&moment, &self.rows_of_actuator(k))
        };
        let actuators = self.actuation.iter().enumerate().map(actuator).collect();
        let force: Vec<(usize, f64)> = force.into_iter().enumerate().collect();
        let all: Vec<usize> = (0..self.count()).collect();
        let needed = project(&force, &all).into_iter().map(|(_, x)| x).collect();
        Instant { loads, needed, arms, paths, actuators, motion }
    }

    /// All coordinates, rates and accelerations.
    fn motion(&self, t: f64) -> [Vec<f64>; 3] {
        let given = self.surroundings.given(t);
        let own: Vec<[f64; 3]> = self.coordinates.iter().map(|spline| spline.at(t)).collect();
        [0, 1, 2].map(|level| own.iter().map(|x| x[level]).chain(given[level].iter().copied()).collect())
    }

    /// The rate of a path that given coordinates may move too: its slopes by those are not known.
    fn given_rate(&self, muscle: usize, t: f64) -> Option<f64> {
        if self.model.mechanics.given_coordinate_names().is_empty() {
            return None;
        }
        let path = &self.model.muscles[muscle].path;
        let length = |t: f64| {
            let mut out = path.buffer();
            path.length(&self.motion(t)[0], false, &mut out);
            out.value
        };
        Some((length(t + TIME_STEP) - length(t - TIME_STEP)) / (2.0 * TIME_STEP))
    }
}

impl Rows {
    fn of(mechanics: &dyn Mechanics, q: &[f64]) -> Self {
        if mechanics.constraints() == 0 {
            return Self::Coordinates;
        }
        match mechanics.coordinate_directions(q) {
            Some(_) => Self::Joints,
            None => {
                let (values, _) = spectrum(mechanics, q);
                let largest = values.max();
                Self::Free(values.iter().filter(|value| **value <= DEPENDENT * largest).count())
            }
        }
    }

    /// The motions, a column each; `None` if they are those of the coordinates.
    fn directions(&self, mechanics: &dyn Mechanics, q: &[f64]) -> Option<DMatrix<f64>> {
        match self {
            Self::Coordinates => None,
            Self::Joints => {
                let n = mechanics.driven_coordinates().len();
                let nothing = || DMatrix::from_element(mechanics.coordinates(), n, f64::NAN);
                Some(mechanics.coordinate_directions(q).unwrap_or_else(nothing))
            }
            Self::Free(count) => {
                let (values, vectors) = spectrum(mechanics, q);
                let mut order: Vec<usize> = (0..values.len()).collect();
                order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
                Some(vectors.select_columns(&order[..*count]))
            }
        }
    }
}

/// Singular values of Φ_q, and its right singular vectors.
fn spectrum(mechanics: &dyn Mechanics, q: &[f64]) -> (DVector<f64>, DMatrix<f64>) {
    let n = mechanics.coordinates();
    // Rows of zeros make it at least square, so that all vectors are there.
    let mut slopes = DMatrix::zeros(mechanics.constraints().max(n), n);
    mechanics.constraint_functions(q, &mut |row, slots, _, gradient, _| {
        let own = slots.iter().zip(gradient).filter(|(slot, _)| **slot < n);
        own.for_each(|(&slot, &slope)| slopes[(row, slot)] += slope);
    });
    let found = slopes.svd(false, true);
    (found.singular_values, found.v_t.expect("asked for").transpose())
}
