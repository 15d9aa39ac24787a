//! Initial guess by inverse dynamics (thesis, Paper B eqs 18–24).
//!
//! 1. Fit a spline to each measured coordinate, which gives q, q̇ and q̈ at every collocation point.
//! 2. For each muscle and point, compute the tendon forces at zero and at full activation, assuming zero tendon
//!    velocity (eqs 21, 22): `f_t = f_t0 + H a` (eqs 19, 20).
//! 3. At each point, solve `min ‖a‖²` subject to the equation of motion and `0 ≤ a ≤ 1` (eq. 23), by Clarabel.
//! 4. Compute fibre lengths from the tendon forces, fibre velocities from a spline through the lengths, activations
//!    from eq. (3) (the correction of eq. 24 for the tendon velocity), and excitations from eq. (4) solved for u.
//!
//! DEPARTURE [thesis, Paper B, eq. 23]: the reactions are unknowns of the programme, and the equation of motion may be
//! violated at a high penalty, so that there is a guess even if the muscles are too weak.
//! DEPARTURE [thesis, Paper B, eq. 24]: the tendon velocity comes from the splines through neighbouring points. Solving
//! eq. (24) for it point by point would invert the flat ends of the force–velocity curve.

use crate::deadline::Deadline;
use crate::methods::InverseProblem;
use crate::model::{Model, Musculotendon};
use crate::motion::Measurement;
use crate::nlp::subproblem::qp::QuadraticProgramme;
use crate::numerics::banded::SymmetricBand;
use crate::numerics::bspline::SplineSpace;
use crate::numerics::sparse::Sparse;
use crate::problem::QuantityId;
use crate::transcription::midpoint::mesh;
use crate::transcription::scheme::{Discretisation, Trajectory};

/// Penalty on violating the equation of motion by the total weight, relative to an activation of 1.
const VIOLATION_PENALTY: f64 = 1e4;
/// Weight of the second differences of spline coefficients; determines the alternating mode that p values leave free.
const SMOOTHING: f64 = 1e-3;

/// The initial guess as functions of time, for any scheme: splines through the results of inverse dynamics at `p`
/// equidistant instants.
pub struct Guess<'g> {
    inverse: &'g InverseProblem<'g>,
    times: Vec<f64>,
    coordinate: SplineSpace,
    state: SplineSpace,
    /// Spline coefficients by coordinate.
    coordinates: Vec<Vec<f64>>,
    /// Spline coefficients by muscle.
    lengths: Vec<Vec<f64>>,
    activations: Vec<Vec<f64>>,
    /// By instant, then reaction, in units of the total weight.
    reactions: Vec<Vec<f64>>,
    /// By instant, then actuator.
    controls: Vec<Vec<f64>>,
}

impl<'g> Guess<'g> {
    /// The guess from `points` instants. `None` if a fit or a quadratic programme fails (non-finite data), or the
    /// deadline passes.
    pub fn new(
        inverse: &'g InverseProblem<'g>,
        points: usize,
        measurement: &Measurement,
        deadline: Deadline,
    ) -> Option<Self> {
        let model = inverse.model;
        let (times, breakpoints) = mesh(points, measurement.times[measurement.times.len() - 1]);
        let [state, coordinate] = [1, 2].map(|degree| SplineSpace::new(degree, &breakpoints));
        let coordinates: Vec<Vec<f64>> = (0..model.mechanics.coordinates())
            .map(|i| {
                let data: Vec<f64> = measurement.coordinates.iter().map(|q| q[i]).collect();
                fit(&coordinate, &measurement.times, &data, 1e-9)
            })
            .collect::<Option<_>>()?;

        let mut lengths = vec![Vec::new(); model.muscles.len()];
        let mut forces = vec![Vec::new(); model.muscles.len()];
        let (mut reactions, mut controls) = (Vec::new(), Vec::new());
        for &t in &times {
            let at =
                |derivative| -> Vec<f64> { coordinates.iter().map(|c| coordinate.value(c, t, derivative)).collect() };
            let Loads { force, reaction, control } = distribute_load(inverse, t, [&at(0), &at(1), &at(2)], deadline)?;
            let q = inverse.all_coordinates(t, &at(0));
            for (m, muscle) in model.muscles.iter().enumerate() {
                let mut path = muscle.path.buffer();
                muscle.path.length(&q, false, &mut path);
                lengths[m].push(muscle.fibre_length(path.value, force[m].max(0.0)));
                forces[m].push(force[m]);
            }
            reactions.push(reaction);
            controls.push(control);
        }

        let (mut length_splines, mut activation_splines) = (Vec::new(), Vec::new());
        for (m, muscle) in model.muscles.iter().enumerate() {
            let length = fit(&state, &times, &lengths[m], SMOOTHING)?;
            let activations: Vec<f64> = times
                .iter()
                .zip(&forces[m])
                .map(|(&t, force)| {
                    let l = state.value(&length, t, 0);
                    muscle.activation_at(*force, l, state.value(&length, t, 1))
                })
                .collect();
            activation_splines.push(fit(&state, &times, &activations, SMOOTHING)?);
            length_splines.push(length);
        }
        let guess = Self {
            inverse,
            times,
            coordinate,
            state,
            coordinates,
            lengths: length_splines,
            activations: activation_splines,
            reactions,
            controls,
        };
        let coefficients = guess.coordinates.iter().chain(&guess.lengths).chain(&guess.activations);
        coefficients.chain(&guess.reactions).chain(&guess.controls).flatten().all(|v| v.is_finite()).then_some(guess)
    }
}

impl Guess<'_> {
    fn activation(&self, t: f64, m: usize) -> f64 {
        // The fitted coefficients may be slightly negative: clip them.
        let basis = self.state.basis(t, 0);
        basis.values.iter().zip(&self.activations[m][basis.first..]).map(|(b, c)| b * c.max(0.0)).sum()
    }

    fn excitation(&self, t: f64, m: usize) -> f64 {
        let spline = &self.activations[m];
        let (a, rate) = (self.state.value(spline, t, 0), self.state.value(spline, t, 1));
        self.inverse.model.muscles[m].excitation(a, rate).clamp(0.0, 1.0)
    }

    /// Between values at the instants.
    fn interpolated(&self, values: &[Vec<f64>], t: f64, i: usize) -> f64 {
        let after = self.times.partition_point(|&at| at < t).clamp(1, self.times.len() - 1);
        let share = (t - self.times[after - 1]) / (self.times[after] - self.times[after - 1]);
        (1.0 - share) * values[after - 1][i] + share * values[after][i]
    }
}

impl Trajectory for Guess<'_> {
    /// Quantities that inverse dynamics does not know are zero.
    fn value(&self, t: f64, quantity: QuantityId, member: usize, derivative: usize) -> f64 {
        let (motion, muscles) = (&self.inverse.motion, &self.inverse.muscles);
        if quantity == motion.coordinate {
            self.coordinate.value(&self.coordinates[member], t, derivative)
        } else if Some(quantity) == motion.velocity {
            self.coordinate.value(&self.coordinates[member], t, derivative + 1)
        } else if Some(quantity) == muscles.fibre_length {
            self.state.value(&self.lengths[member], t, 0)
        } else if quantity == muscles.activation {
            self.activation(t, member)
        } else if Some(quantity) == muscles.excitation {
            self.excitation(t, member)
        } else if Some(quantity) == motion.reaction {
            self.interpolated(&self.reactions, t, member)
        } else if self.inverse.actuators.first().is_some_and(|actuator| quantity == actuator.quantity) {
            self.interpolated(&self.controls, t, member)
        } else {
            0.0
        }
    }
}

/// The initial decision vector for a scheme with `points` instants (p). `None` as in [`Guess::new`].
pub fn initial_guess(
    inverse: &InverseProblem<'_>,
    scheme: &dyn Discretisation,
    points: usize,
    measurement: &Measurement,
    deadline: Deadline,
) -> Option<Vec<f64>> {
    let x = scheme.compose(&Guess::new(inverse, points, measurement, deadline)?);
    x.iter().all(|v| v.is_finite()).then_some(x)
}

/// Coefficients of the spline that fits `values` at `times` in the least-squares sense. The objective also contains
/// `smooth` times the sum of squared second differences of the coefficients. `None` if the system is singular.
pub fn fit(space: &SplineSpace, times: &[f64], values: &[f64], smooth: f64) -> Option<Vec<f64>> {
    let n = space.dimension();
    let mut matrix = SymmetricBand::new(n, space.degree().max(2));
    let mut right = vec![0.0; n];
    for (&t, value) in times.iter().zip(values) {
        let basis = space.basis(t, 0);
        matrix.add_outer(basis.first, &basis.values, 1.0);
        basis.values.iter().enumerate().for_each(|(i, b)| right[basis.first + i] += b * value);
    }
    for k in 0..n.saturating_sub(2) {
        matrix.add_outer(k, &[1.0, -2.0, 1.0], smooth);
    }
    matrix.solve(&mut right)?;
    Some(right)
}

/// The loads at one instant.
struct Loads {
    /// Normalised tendon forces.
    force: Vec<f64>,
    /// In units of the total weight.
    reaction: Vec<f64>,
    /// Of actuators.
    control: Vec<f64>,
}

/// The loads that minimise ‖a‖², and the squared controls of actuators, for the motion `[q, q̇, q̈]`. `None` if the
/// programme fails or the deadline passes.
fn distribute_load(
    inverse: &InverseProblem<'_>,
    t: f64,
    [q, velocity, acceleration]: [&[f64]; 3],
    deadline: Deadline,
) -> Option<Loads> {
    if deadline.passed() {
        return None;
    }
    let (model, motion) = (inverse.model, &inverse.motion);
    let (nq, nc, nm) = (model.mechanics.coordinates(), model.mechanics.constraints(), model.muscles.len());
    // The equation of motion is linear in the reactions and the tendon forces: assemble its coefficients.
    let mut z = inverse.control.given_at(t);
    z[motion.q.range()].copy_from_slice(q);
    z[motion.accelerations.range()].copy_from_slice(acceleration);
    if let Some(rates) = motion.rates {
        z[rates.range()][..nq].copy_from_slice(velocity);
    }
    let all = motion.all.of(&z);
    let bounds = tendon_force_range(model, all, velocity);
    let mut residual = vec![0.0; inverse.control.rows()];
    inverse.control.values(&z, &mut residual);
    let weight = model.weight();
    let mut columns: Vec<(usize, usize, f64)> = Vec::new();
    let mut unloaded = motion.equation.of(&residual).to_vec();
    for (m, muscle) in model.muscles.iter().enumerate() {
        let mut path = muscle.path.buffer();
        muscle.path.length(all, false, &mut path);
        let strength = muscle.max_isometric_force / weight;
        // The residual at z includes the passive force of a fibre of zero length; replace it by f_t0 + H a.
        let included = inverse.fibre_force(&z, m);
        let (low, high) = bounds[m];
        for (slot, gradient) in muscle.path.slots().iter().zip(&path.gradient) {
            unloaded[*slot] += strength * (low - included) * gradient;
            columns.push((*slot, m, strength * (high - low) * gradient));
        }
    }
    model.mechanics.constraint_functions(all, &mut |row, slots, _, gradient, _| {
        for (&coordinate, &gradient) in slots.iter().zip(gradient).filter(|(slot, _)| **slot < nq) {
            columns.push((coordinate, nm + row, gradient));
        }
    });
    (0..nq).for_each(|i| columns.push((i, nm + nc + i, 1.0)));
    let first = nm + nc + nq;
    for (k, actuator) in inverse.actuators.iter().enumerate() {
        let slopes = actuator.own.coordinate.slopes(all);
        let slots = slopes.slots.into_iter().zip(slopes.gradient);
        columns.extend(slots.map(|(slot, g)| (slot, first + k, -actuator.own.moment / weight * g)));
    }
    let n = first + inverse.actuators.len();
    let equalities = Sparse::from_triplets(nq, n, &columns);
    let mut diagonal: Vec<(usize, usize, f64)> = (0..nm).map(|m| (m, m, 1.0)).collect();
    diagonal.extend((nm..nm + nc).map(|i| (i, i, 1e-9)));
    diagonal.extend((nm + nc..first).map(|i| (i, i, VIOLATION_PENALTY)));
    diagonal
        .extend(inverse.actuators.iter().enumerate().map(|(k, actuator)| (first + k, first + k, actuator.own.weight)));
    let hessian = Sparse::from_triplets(n, n, &diagonal);
    let limits: Vec<(usize, usize, f64)> = (0..nm).flat_map(|m| [(m, m, 1.0), (nm + m, m, -1.0)]).collect();
    let inequalities = Sparse::from_triplets(2 * nm, n, &limits);
    let inequality_values: Vec<f64> = (0..2 * nm).map(|i| if i < nm { 0.0 } else { 1.0 }).collect();
    let solution = QuadraticProgramme {
        hessian: &hessian,
        gradient: &vec![0.0; n],
        equalities: &equalities,
        equality_values: &unloaded,
        inequalities: &inequalities,
        inequality_values: &inequality_values,
        deadline,
    }
    .solve()
    .ok()?;
    let forces = bounds.iter().zip(&solution.step).map(|((low, high), a)| low + (high - low) * a.clamp(0.0, 1.0));
    let controls = inverse.actuators.iter().zip(&solution.step[first..]);
    Some(Loads {
        force: forces.collect(),
        reaction: solution.step[nm..nm + nc].to_vec(),
        control: controls.map(|(actuator, r)| r.clamp(actuator.own.bounds[0], actuator.own.bounds[1])).collect(),
    })
}

/// (f_t0, f_t1) of each muscle: normalised tendon forces at zero and at full activation, for zero tendon velocity.
fn tendon_force_range(model: &Model, q: &[f64], velocity: &[f64]) -> Vec<(f64, f64)> {
    let of = |muscle: &Musculotendon| {
        let mut path = muscle.path.buffer();
        muscle.path.length(q, false, &mut path);
        let rate: f64 = muscle.path.slots().iter().zip(&path.gradient).map(|(&s, g)| g * velocity[s]).sum();
        let [low, high] = muscle.force_range(path.value, rate);
        (low, high)
    };
    model.muscles.iter().map(of).collect()
}
