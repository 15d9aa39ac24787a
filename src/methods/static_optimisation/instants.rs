//! The instants of a static problem, one after the other.

use super::{InverseProblem, effort};
use crate::deadline::Deadline;
use crate::methods::muscle_force::{LinearForce, MuscleForce};
use crate::nlp::iterate::Iterate;
use crate::problem::Bounded;
use crate::recruitment::{self, Criterion, Failure, Optimum, Programme, Term, missing};
use crate::settings::{self, Settings};
use crate::transcription::collocation::Collocation;

/// Passive moments above this share of what is missing are named.
const PASSIVE_SHARE: f64 = 0.1;

/// The loads at all instants.
pub struct Recruited {
    pub verdict: Verdict,
    /// The answer with its multipliers; where an instant has none, activations are at their lower bounds.
    pub iterate: Iterate,
    /// Whether all answers are the only ones; see [`Optimum::is_unique`].
    pub is_unique: bool,
    /// Points without an answer.
    pub failed: Vec<usize>,
    /// Of all programmes.
    pub iterations: usize,
    /// The criterion over time, if all instants have an answer.
    pub value: Option<f64>,
    /// Smallest and largest mean force (N) of each muscle at nearly the same cost, if asked for.
    pub near_optimal: Option<Vec<[f64; 2]>>,
    /// Smallest and largest mean activation of each muscle over all answers that are as good, where they are not unique.
    pub faces: Option<Vec<[f64; 2]>>,
}

/// Whether all instants have an answer; if not, why.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Verdict {
    Solved,
    /// No forces carry the load.
    Infeasible(String),
    /// A programme could not be solved.
    Unsolved(String),
    /// There was no time.
    Late,
}

/// Where a variable of the programmes is.
struct Place {
    /// Among the variables at an instant.
    variable: usize,
    weight: f64,
    is_muscle: bool,
    bounds: [f64; 2],
}

/// What messages need.
pub struct Labels {
    /// The joint coordinate of each row, and whether it is an angle; see
    /// [`GivenMotion::row_names`](crate::methods::given_motion::GivenMotion::row_names).
    pub names: Option<Vec<(String, bool)>>,
    /// The start of the motion in the time of its file, s.
    pub clock: f64,
}

struct Solver<'s> {
    inverse: &'s InverseProblem<'s>,
    problem: &'s Collocation<'s>,
    settings: &'s Settings,
    labels: Labels,
    places: Vec<Place>,
    /// Which place a variable has, if any.
    place_of: Vec<Option<usize>>,
    deadline: Deadline,
}

/// Solves all instants.
pub fn recruit(
    inverse: &InverseProblem<'_>,
    problem: &Collocation<'_>,
    settings: &Settings,
    labels: Labels,
    deadline: Deadline,
) -> Recruited {
    let weights = settings.effort_weights(inverse.model);
    let muscle = |(m, weight): (usize, f64)| Place {
        variable: inverse.muscles.a.at(m),
        weight,
        is_muscle: true,
        bounds: [settings.min_activation, 1.0],
    };
    let muscles = weights.into_iter().enumerate().map(muscle);
    let actuators = inverse.actuators.iter().map(|drive| Place {
        variable: drive.control,
        weight: drive.own.weight,
        is_muscle: false,
        bounds: drive.own.bounds,
    });
    let places: Vec<Place> = muscles.chain(actuators).collect();
    let mut place_of = vec![None; inverse.control.variables()];
    places.iter().enumerate().for_each(|(k, place)| place_of[place.variable] = Some(k));
    Solver { inverse, problem, settings, labels, places, place_of, deadline }.solve()
}

impl Solver<'_> {
    fn solve(&self) -> Recruited {
        let quadrature = self.problem.scheme.quadrature();
        let complete: Vec<usize> =
            (0..self.problem.points.len()).filter(|&j| self.problem.points[j].complete).collect();
        let mut x = vec![0.0; self.problem.scheme.coefficients().total()];
        let mut found: Vec<(usize, Programme, Result<Optimum, Failure>)> = Vec::new();
        for &j in &complete {
            let programme = self.programme(j);
            let optimum = programme.solve(self.deadline);
            let least = || self.places.iter().map(|place| place.bounds[0].max(0.0)).collect();
            let values: Vec<f64> = optimum.as_ref().map_or_else(|_| least(), |optimum| optimum.x.clone());
            for (place, value) in self.places.iter().zip(&values) {
                // A control has an unknown of its own at each point.
                let map = &self.problem.points[j].map.combinations[place.variable];
                map.iter().filter(|(_, weight)| *weight != 0.0).for_each(|(index, weight)| x[*index] = value / weight);
            }
            found.push((j, programme, optimum));
        }
        let mut iterate = Iterate::new(self.problem, x);
        let mut optima = vec![None; self.problem.points.len()];
        found.iter().for_each(|(j, _, optimum)| optima[*j] = optimum.as_ref().ok());
        self.set_multipliers(&optima, &mut iterate);
        let failed: Vec<usize> = found.iter().filter(|(_, _, optimum)| optimum.is_err()).map(|(j, ..)| *j).collect();
        let solved = found.iter().filter_map(|(j, _, optimum)| Some((*j, optimum.as_ref().ok()?)));
        let is_unique = solved.clone().all(|(_, optimum)| optimum.is_unique);
        let iterations = solved.clone().map(|(_, optimum)| optimum.iterations).sum();
        let value = solved.map(|(j, optimum)| quadrature[j] * optimum.value).sum();
        let verdict = self.verdict(&found);
        let is_solved = verdict == Verdict::Solved;
        let asked = is_solved && self.settings.near_optimal > 0.0;
        let near_optimal = if asked { self.ranges(&found, self.settings.near_optimal, Self::force) } else { None };
        let is_open = is_solved
            && self.settings.regularity != settings::RegularityMode::Off
            && self.criterion() == Criterion::Polynomial(1.0);
        let faces = if is_open { self.ranges(&found, 0.0, |_, _, a| a) } else { None };
        let value = is_solved.then_some(value);
        Recruited { verdict, iterate, is_unique, failed, iterations, value, near_optimal, faces }
    }

    fn criterion(&self) -> Criterion {
        match self.settings.criterion {
            settings::Criterion::Polynomial => Criterion::Polynomial(self.settings.effort_power),
            settings::Criterion::MinMax => Criterion::MinMax,
        }
    }

    /// The programme at a point, from the equations there: they are linear.
    fn programme(&self, j: usize) -> Programme {
        let control = &self.inverse.control;
        let z = self.problem.points[j].map.constants.clone();
        let mut values = vec![0.0; control.rows()];
        control.values(&z, &mut values);
        let mut slopes = vec![0.0; control.slope_pattern().len()];
        control.slopes(&z, &mut slopes);
        let mut columns = vec![Vec::new(); self.places.len()];
        for (&(row, variable), &slope) in control.slope_pattern().iter().zip(&slopes) {
            if let Some(k) = self.place_of[variable].filter(|_| slope != 0.0) {
                columns[k].push((row, slope));
            }
        }
        let term = |(k, place): (usize, &Place)| {
            let [offset, scale] = match self.inverse.forces.get(k).filter(|_| place.is_muscle) {
                Some(force) => effort(force, self.settings.effort_of, &z),
                None => [0.0, 1.0],
            };
            Term { weight: place.weight, offset, scale, bounds: place.bounds, is_muscle: place.is_muscle }
        };
        Programme {
            rows: control.equation_rows(),
            columns,
            right: values.iter().map(|value| -value).collect(),
            terms: self.places.iter().enumerate().map(term).collect(),
            criterion: self.criterion(),
        }
    }

    /// The multipliers of the transcribed problem, in which an instant counts by its weight. `optima`: by point.
    fn set_multipliers(&self, optima: &[Option<&Optimum>], iterate: &mut Iterate) {
        let quadrature = self.problem.scheme.quadrature();
        for (row, (point, equation)) in self.problem.equality_names().into_iter().enumerate() {
            let Some((j, optimum)) = point.and_then(|j| Some((j, optima[j]?))) else { continue };
            iterate.equality_multipliers[row] = -quadrature[j] * optimum.multipliers[equation];
        }
        for (row, bound) in self.problem.bounds.iter().enumerate() {
            let Some(optimum) = optima[bound.point] else { continue };
            let (multipliers, variable) = match self.problem.limit(bound).bounded {
                Bounded::Below(variable) => (&optimum.lower, variable),
                Bounded::Above(variable) => (&optimum.upper, variable),
                Bounded::Function(_) => continue,
            };
            if let Some(k) = self.place_of[variable] {
                iterate.inequality_multipliers[row] = quadrature[bound.point] * multipliers[k];
            }
        }
    }

    fn verdict(&self, found: &[(usize, Programme, Result<Optimum, Failure>)]) -> Verdict {
        let failed: Vec<_> =
            found.iter().filter_map(|(j, p, optimum)| Some((*j, p, *optimum.as_ref().err()?))).collect();
        let times = self.problem.scheme.points();
        match failed.iter().find(|(_, _, why)| *why == Failure::Numerical) {
            _ if failed.is_empty() => return Verdict::Solved,
            _ if self.deadline.passed() => return Verdict::Late,
            Some((j, ..)) => {
                let time = times[*j] + self.labels.clock;
                return Verdict::Unsolved(format!("the programme at {time:.4} s could not be solved"));
            }
            None => {}
        }
        // The instant where most is missing.
        let mut worst: Option<(f64, String)> = None;
        for (j, programme, _) in &failed {
            let time = times[*j] + self.labels.clock;
            let Some(missing) = missing(programme) else { continue };
            let Some(row) = missing.largest() else { continue };
            if missing.is_none() {
                return Verdict::Unsolved(format!("the programme at {time:.4} s could not be solved"));
            }
            let size = missing.moments[row].abs();
            if worst.as_ref().is_none_or(|(most, _)| size > *most) {
                worst = Some((size, self.lack(*j, programme, row, &missing.moments)));
            }
        }
        let words = worst.map_or_else(|| "the muscles cannot carry the load".to_owned(), |(_, words)| words);
        let count = format!("{} of {} instants have no answer", failed.len(), found.len());
        Verdict::Infeasible(format!("{words}; {count}"))
    }

    /// What the muscles cannot do at a point, what is missing, and whose passive forces work against it, in words.
    fn lack(&self, j: usize, programme: &Programme, row: usize, missing: &[f64]) -> String {
        let (weight, time) = (self.inverse.model.weight(), self.problem.scheme.points()[j] + self.labels.clock);
        let passive = self.passive_moments(j, programme, row);
        let needed = programme.right[row] + passive.iter().map(|(_, moment)| moment).sum::<f64>();
        let against: Vec<&str> = passive
            .iter()
            .filter(|(_, moment)| moment * missing[row] < 0.0 && moment.abs() > PASSIVE_SHARE * missing[row].abs())
            .map(|(name, _)| *name)
            .collect();
        let passive = match against[..] {
            [] => String::new(),
            _ => format!(" (passive forces of {} work against it)", against.join(", ")),
        };
        match self.labels.names.as_ref().map(|names| &names[row]) {
            None => {
                let size = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>().sqrt();
                let share = 100.0 * size(missing) / size(&programme.right).max(f64::MIN_POSITIVE);
                format!("the muscles cannot carry the load at {time:.4} s: {share:.1} % of it are missing")
            }
            Some((name, is_angle)) => {
                let unit = if *is_angle { "N m" } else { "N" };
                let size = |x: f64| format!("{:.3} {unit}", x * weight);
                let (needed, missing) = (size(needed), size(missing[row]));
                format!("the muscles cannot make {needed} at `{name}` at {time:.4} s: {missing} are missing{passive}")
            }
        }
    }

    /// Muscles with passive moments in a row, in its unit.
    fn passive_moments(&self, j: usize, programme: &Programme, row: usize) -> Vec<(&str, f64)> {
        let z = &self.problem.points[j].map.constants;
        let muscles = self.inverse.model.muscles.iter().zip(&self.inverse.forces).zip(&programme.columns);
        let mut all = Vec::new();
        for ((muscle, force), column) in muscles {
            let MuscleForce::Linear(LinearForce { known: Some(known), .. }) = force else { continue };
            let Some((_, factor)) = column.iter().find(|(own, _)| *own == row) else { continue };
            let moment = factor * z[known.passive] / z[known.strength];
            if moment != 0.0 && moment.is_finite() {
                all.push((muscle.name.as_str(), moment));
            }
        }
        all
    }

    /// The force (N) of a muscle at a point, a being its activation.
    fn force(&self, (j, m): (usize, usize), a: f64) -> f64 {
        let mut z = self.problem.points[j].map.constants.clone();
        z[self.inverse.muscles.a.at(m)] = a;
        self.inverse.model.muscles[m].max_isometric_force * self.inverse.forces[m].value(&z)
    }

    /// Smallest and largest mean over time of what `of` says of a muscle at its smallest and largest activation.
    fn ranges(
        &self,
        found: &[(usize, Programme, Result<Optimum, Failure>)],
        share: f64,
        of: fn(&Self, (usize, usize), f64) -> f64,
    ) -> Option<Vec<[f64; 2]>> {
        let quadrature = self.problem.scheme.quadrature();
        let total: f64 = found.iter().map(|(j, ..)| quadrature[*j]).sum();
        let mut means = vec![[0.0; 2]; self.inverse.forces.len()];
        for (j, programme, optimum) in found {
            let ranges: recruitment::Ranges = programme.ranges(optimum.as_ref().ok()?, share, self.deadline).ok()?;
            for (m, mean) in means.iter_mut().enumerate() {
                for side in 0..2 {
                    mean[side] += quadrature[*j] / total * of(self, (*j, m), ranges[m][side]);
                }
            }
        }
        Some(means)
    }
}
