//! The start guess by inverse dynamics (thesis, Paper B eqs 18–24).
//!
//! 1. Each measured body coordinate is fitted by its spline; that gives q, q̇, q̈ at every collocation point.
//! 2. Per muscle and point, the tendon forces at no and full activation, with the tendon's velocity taken as zero
//!    (eqs 21, 22): `f_t = f_t0 + H a` (eqs 19, 20).
//! 3. Per point, `min ‖a‖²` under the equation of motion and `0 ≤ a ≤ 1` (eq. 23), by Clarabel.
//! 4. Fibre lengths from the tendon forces, fibre velocities from their spline, activations from eq. (3) (eq. 24's
//!    correction for the tendon's velocity), excitations from eq. (4) solved backwards.
//!
//! DEPARTURE [thesis, Paper B, eq. 23]: the equation of motion is kept with the reactions as unknowns and may be missed at a high
//! price, so that a muscle that is too weak still gets a guess.
//! DEPARTURE [thesis, Paper B, eq. 24]: the tendon's velocity comes from the splines through neighbouring points; solving
//! eq. (24) for it point by point inverts the flat ends of the force–velocity curve.

use crate::model::Model;
use crate::model::curves::{active_force_length, passive_force_length, tendon_strain};
use crate::motion::Measurement;
use crate::nlp::qp::QuadraticProgramme;
use crate::numerics::banded::SymmetricBand;
use crate::numerics::bspline::SplineSpace;
use crate::numerics::sparse::Sparse;
use crate::transcription::instant::Instant;
use crate::transcription::midpoint::{Initial, Midpoint};

/// Price of missing the equation of motion by the total weight, against activations of one.
const MISS: f64 = 1e4;
/// Weight of second differences of spline coefficients: pins the alternating mode that p values leave free.
const SMOOTH: f64 = 1e-3;

/// The decision vector of the guess, or `None` where a fit or a programme failed (non-finite data).
pub fn start_guess(instant: &Instant<'_>, scheme: &Midpoint, measurement: &Measurement) -> Option<Vec<f64>> {
    let model = instant.model;
    let (nq, nc) = (model.coordinates(), model.constraints());
    let mut x = vec![0.0; scheme.variables()];

    let coordinates: Vec<Vec<f64>> = (0..nq)
        .map(|i| {
            let data: Vec<f64> = measurement.coordinates.iter().map(|q| q[i]).collect();
            fit(&scheme.coordinate, &measurement.times, &data, 1e-9)
        })
        .collect::<Option<_>>()?;
    for (i, coefficients) in coordinates.iter().enumerate() {
        coefficients.iter().enumerate().for_each(|(k, &c)| x[scheme.coordinate_index(k, i)] = c);
        x[scheme.initial_index(Initial::Coordinate, i)] = scheme.coordinate.value(coefficients, 0.0, 0);
        x[scheme.initial_index(Initial::Velocity, i)] = scheme.coordinate.value(coefficients, 0.0, 1);
    }

    let mut lengths = vec![Vec::new(); model.muscles.len()];
    let mut forces = vec![Vec::new(); model.muscles.len()];
    for (j, &t) in scheme.points.iter().enumerate() {
        let at = |derivative| -> Vec<f64> {
            coordinates.iter().map(|c| scheme.coordinate.value(c, t, derivative)).collect()
        };
        let (force, reaction) = share_load(instant, &at(0), &at(1), &at(2))?;
        for (m, muscle) in model.muscles.iter().enumerate() {
            let mut path = muscle.path.buffer();
            muscle.path.length(&at(0), false, &mut path);
            let along = path.value - muscle.tendon_slack_length * (1.0 + tendon_strain(force[m].max(0.0)).value);
            lengths[m].push(along / muscle.fibre_along_tendon());
            forces[m].push(force[m]);
        }
        (0..nc).for_each(|c| x[scheme.reaction_index(j, c)] = reaction[c]);
    }

    for (m, muscle) in model.muscles.iter().enumerate() {
        let length = fit(&scheme.state, &scheme.points, &lengths[m], SMOOTH)?;
        let activations: Vec<f64> = scheme
            .points
            .iter()
            .zip(&forces[m])
            .map(|(&t, force)| {
                let l = scheme.state.value(&length, t, 0);
                let v = scheme.state.value(&length, t, 1) / muscle.max_shortening_velocity;
                let active = active_force_length(l).value.max(0.05) * muscle.force_velocity.at(v).value;
                let passive = passive_force_length(l).value;
                ((force / muscle.pennation_angle.cos() - passive) / active).clamp(0.0, 1.0)
            })
            .collect();
        let activation = fit(&scheme.state, &scheme.points, &activations, SMOOTH)?;
        for (k, (&l, &a)) in length.iter().zip(&activation).enumerate() {
            x[scheme.length_index(k, m)] = l;
            x[scheme.activation_index(k, m)] = a.max(0.0);
        }
        x[scheme.initial_index(Initial::Length, m)] = length[0];
        x[scheme.initial_index(Initial::Activation, m)] = activation[0].max(0.0);
        for (j, &t) in scheme.points.iter().enumerate() {
            let (a, rate) = (scheme.state.value(&activation, t, 0), scheme.state.value(&activation, t, 1));
            x[scheme.excitation_index(j, m)] = muscle.excitation(a, rate).clamp(0.0, 1.0);
        }
    }
    x.iter().all(|v| v.is_finite()).then_some(x)
}

/// Least-squares spline coefficients for `values` at `times`, with `smooth` times the second differences of the
/// coefficients.
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

/// Normalised tendon forces and reactions (in total weights) of least activation at one instant.
fn share_load(
    instant: &Instant<'_>,
    q: &[f64],
    velocity: &[f64],
    acceleration: &[f64],
) -> Option<(Vec<f64>, Vec<f64>)> {
    let model = instant.model;
    let (nq, nc, nm) = (model.coordinates(), model.constraints(), model.muscles.len());
    let bounds = tendon_force_range(model, q, velocity);
    // The equation of motion is linear in reactions and in tendon forces: read it off at unit values.
    let mut z = vec![0.0; instant.variables()];
    z[..nq].copy_from_slice(q);
    (0..nq).for_each(|i| z[instant.acceleration(i)] = acceleration[i]);
    let mut rest = vec![0.0; instant.equations()];
    instant.residual(&z, &mut rest);
    let weight = model.weight();
    let mut columns: Vec<(usize, usize, f64)> = Vec::new();
    let mut unloaded = rest[..nq].to_vec();
    for (m, muscle) in model.muscles.iter().enumerate() {
        let mut path = muscle.path.buffer();
        muscle.path.length(q, false, &mut path);
        let strength = muscle.max_isometric_force / weight;
        // The residual at z holds the passive force of a fibre of no length; replace it by f_t0 + H a.
        let already = instant.fibre_force(&z, m);
        let (low, high) = bounds[m];
        for (slot, gradient) in muscle.path.slots.iter().zip(&path.gradient) {
            unloaded[*slot] += strength * (low - already) * gradient;
            columns.push((*slot, m, strength * (high - low) * gradient));
        }
    }
    let mut row = 0;
    for joint in &model.joints {
        for function in joint.constraints(q) {
            for (slot, gradient) in joint.slots().iter().zip(function.gradient) {
                if let Some(coordinate) = slot {
                    columns.push((*coordinate, nm + row, gradient));
                }
            }
            row += 1;
        }
    }
    (0..nq).for_each(|i| columns.push((i, nm + nc + i, 1.0)));
    let n = nm + nc + nq;
    let equalities = Sparse::from_triplets(nq, n, &columns);
    let mut diagonal: Vec<(usize, usize, f64)> = (0..nm).map(|m| (m, m, 1.0)).collect();
    diagonal.extend((nm..nm + nc).map(|i| (i, i, 1e-9)));
    diagonal.extend((nm + nc..n).map(|i| (i, i, MISS)));
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
    }
    .solve()
    .ok()?;
    let forces = bounds.iter().zip(&solution.step).map(|((low, high), a)| low + (high - low) * a.clamp(0.0, 1.0));
    Some((forces.collect(), solution.step[nm..nm + nc].to_vec()))
}

/// (f_t0, f_t1) of each muscle: tendon forces at no and at full activation with the tendon at rest.
fn tendon_force_range(model: &Model, q: &[f64], velocity: &[f64]) -> Vec<(f64, f64)> {
    model
        .muscles
        .iter()
        .map(|muscle| {
            let mut path = muscle.path.buffer();
            muscle.path.length(q, false, &mut path);
            let rate: f64 = muscle.path.slots.iter().zip(&path.gradient).map(|(&s, g)| g * velocity[s]).sum();
            let v = rate / muscle.fibre_along_tendon();
            let equilibrium = |a: f64| {
                // Falls with l: bisection between a fibre of no length and one as long as the whole path.
                let (mut low, mut high) = (0.0, path.value / muscle.fibre_along_tendon());
                for _ in 0..60 {
                    let l = 0.5 * (low + high);
                    let force = muscle.fibre_force(a, l, v).value;
                    if muscle.tendon_strain(path.value, l) > tendon_strain(force).value { low = l } else { high = l }
                }
                muscle.fibre_force(a, 0.5 * (low + high), v).value
            };
            (equilibrium(0.0), equilibrium(1.0))
        })
        .collect()
}
