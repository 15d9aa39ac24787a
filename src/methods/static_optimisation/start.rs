//! Where a problem with a given motion starts: the loads of each instant alone.

use crate::deadline::Deadline;
use crate::methods::InverseProblem;
use crate::methods::given_motion::{GivenMotion, Instant};
use crate::model::Model;
use crate::problem::QuantityId;
use crate::recruitment::{Criterion, Programme, Term};
use crate::settings::Settings;
use crate::transcription::scheme::{Discretisation, Trajectory};

/// Weight of a load that nothing carries, in units of the total weight, relative to an activation of 1.
const VIOLATION_PENALTY: f64 = 1e4;

/// The loads at one instant.
struct Loads {
    activations: Vec<f64>,
    /// Optimal fibre lengths.
    lengths: Vec<f64>,
    controls: Vec<f64>,
}

/// The loads at the points of a scheme.
struct Start<'s> {
    inverse: &'s InverseProblem<'s>,
    times: &'s [f64],
    loads: Vec<Loads>,
}

/// The decision vector from which to start; `None` if a programme fails or the deadline passes.
pub fn start(
    inverse: &InverseProblem<'_>,
    given: &GivenMotion<'_>,
    scheme: &dyn Discretisation,
    settings: &Settings,
    deadline: Deadline,
) -> Option<Vec<f64>> {
    let at = |&t: &f64| if deadline.passed() { None } else { loads(inverse.model, given, settings, &given.at(t)) };
    let loads = scheme.points().iter().map(at).collect::<Option<Vec<Loads>>>()?;
    let x = scheme.compose(&Start { inverse, times: scheme.points(), loads });
    x.iter().all(|v| v.is_finite()).then_some(x)
}

/// Σ a² and the squared controls at least, with what nothing carries at a high price.
fn loads(model: &Model, given: &GivenMotion<'_>, settings: &Settings, instant: &Instant) -> Option<Loads> {
    let weight = model.weight();
    let mut right: Vec<f64> = instant.needed.iter().map(|x| x / weight).collect();
    let ranges: Vec<[f64; 2]> = model
        .muscles
        .iter()
        .zip(&instant.paths)
        .map(|(muscle, [length, rate])| muscle.force_range(*length, *rate))
        .collect();
    let (mut columns, mut terms) = (Vec::new(), Vec::new());
    let free = [f64::NEG_INFINITY, f64::INFINITY];
    let term =
        |weight: f64, bounds: [f64; 2], is_muscle: bool| Term { weight, offset: 0.0, scale: 1.0, bounds, is_muscle };
    for ((muscle, arms), [passive, full]) in model.muscles.iter().zip(&instant.arms).zip(&ranges) {
        let unit = muscle.max_isometric_force / weight;
        arms.iter().for_each(|&(row, arm)| right[row] -= passive * unit * arm);
        columns.push(arms.iter().map(|&(row, arm)| (row, (full - passive).max(0.0) * unit * arm)).collect());
        terms.push(term(1.0, [settings.min_activation, 1.0], true));
    }
    for (actuator, own) in instant.actuators.iter().zip(&given.actuation) {
        columns.push(actuator.iter().map(|&(row, moment)| (row, moment / weight)).collect());
        terms.push(term(own.weight, own.bounds, false));
    }
    for row in 0..right.len() {
        columns.push(vec![(row, 1.0)]);
        terms.push(term(VIOLATION_PENALTY, free, false));
    }
    let programme = Programme { rows: right.len(), columns, right, terms, criterion: Criterion::Polynomial(2.0) };
    let optimum = programme.solve(Deadline::default()).ok()?;
    let (activations, rest) = optimum.x.split_at(model.muscles.len());
    let force = |(a, [passive, full]): (&f64, &[f64; 2])| (passive + a * (full - passive)).max(0.0);
    let forces = activations.iter().zip(&ranges).map(force);
    let lengths = model.muscles.iter().zip(&instant.paths).zip(forces);
    Some(Loads {
        lengths: lengths.map(|((muscle, path), force)| muscle.fibre_length(path[0], force)).collect(),
        activations: activations.to_vec(),
        controls: rest[..given.actuation.len()].to_vec(),
    })
}

impl Start<'_> {
    /// The excitation that goes with activations at the neighbouring points.
    fn excitation(&self, j: usize, m: usize) -> f64 {
        let (before, after) = (j.saturating_sub(1), (j + 1).min(self.times.len() - 1));
        let a = |j: usize| self.loads[j].activations[m];
        let rate = (a(after) - a(before)) / (self.times[after] - self.times[before]);
        self.inverse.model.muscles[m].excitation(a(j), rate).clamp(0.0, 1.0)
    }
}

impl Trajectory for Start<'_> {
    fn value(&self, t: f64, quantity: QuantityId, member: usize, _derivative: usize) -> f64 {
        let j = self.times.partition_point(|&time| time < t).min(self.times.len() - 1);
        let muscles = &self.inverse.muscles;
        let is_actuator = |id: QuantityId| self.inverse.actuators.first().is_some_and(|drive| drive.quantity == id);
        match quantity {
            id if id == muscles.activation => self.loads[j].activations[member],
            id if Some(id) == muscles.fibre_length => self.loads[j].lengths[member],
            id if Some(id) == muscles.excitation => self.excitation(j, member),
            id if is_actuator(id) => self.loads[j].controls[member],
            _ => 0.0,
        }
    }
}
