//! The equations at one instant: equation of motion, joints, contraction, activation.
//!
//! Local variables, in this order (`nz = 2 nq + 5 nm + nc`):
//!
//! | symbol | what | count | unit |
//! |---|---|---|---|
//! | q | body coordinates | nq | m, rad |
//! | q̈ | their accelerations | nq | m/s², rad/s² |
//! | a, l, v, ȧ, u | activation, fibre length, its velocity, activation's rate, excitation; muscle by muscle | 5 nm | –, L_o, L_o/s, 1/s, – |
//! | f_r | joint reactions | nc | total weight W |
//!
//! The motion of bodies in space has the velocities q̇ in eq. (1), as `nq` more after f_r. The stabilised first-order form ([`Form::Stabilised`]) has q̈ = dv/dt of a velocity v of its own, and `2 nq + nc` more:
//!
//! | symbol | what | count | unit |
//! |---|---|---|---|
//! | v | body velocities | nq | m/s, rad/s |
//! | q̇ | rates of the body coordinates | nq | m/s, rad/s |
//! | η | multipliers of the stabilisation, zero but for the discretisation's error | nc | – |
//!
//! Equations, in this order (`nq + nc + 2 nm`), thesis Paper B:
//!
//! | eq. | residual | unit |
//! |---|---|---|
//! | (1) | `(M q̈ − g_ext + Σ F_o f_m ∂L_mt/∂q)/W + Φ_qᵀ f_r` | W |
//! | (2) | `Φ(q)` | m, rad |
//! | (3) | `l_t(q, l) − f_t⁻¹(f_m)`, `f_m = (f_pe(l) + a f_l(l) f_v(v)) cos θ` | strain |
//! | (4) | `τ (ȧ − (u − a)(u/τ_act + (1 − u)/τ_deact))`, τ the larger time | – |
//!
//! and in the stabilised form (`nq + nc` more) those of C. W. Gear, B. Leimkuhler and G. K. Gupta, *J. Comput. Appl. Math.*
//! 12–13, 1985, which lower the index of the constrained motion from 3 to 2:
//!
//! | eq. | residual | unit |
//! |---|---|---|
//! | kinematic | `q̇ − v − Φ_qᵀ η` | m/s, rad/s |
//! | velocity | `Φ_q v` | m/s, rad/s |
//!
//! DEPARTURE [thesis, Paper B, eq. 3]: the tendon curve is inverted and the fibre's force goes into eq. (1). Where
//! the force is positive that is an invertible row operation, so ranks are the same, and the stiff tendon no longer
//! spoils the conditioning.

use std::sync::Arc;

use nalgebra::{DMatrix, Matrix4};
use num_dual::Dual64;

use crate::model::Model;
use crate::model::mechanics::{Level, Motion};
use crate::motion::Surroundings;

/// Places of one muscle's local variables, from [`Instant::muscle`] on.
pub const ACTIVATION: usize = 0;
pub const LENGTH: usize = 1;
pub const VELOCITY: usize = 2;
pub const ACTIVATION_RATE: usize = 3;
pub const EXCITATION: usize = 4;
const PER_MUSCLE: usize = 5;

/// How the motion's second-order equations are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// In q, q̇, q̈ of one function q of time, as in the thesis.
    SecondOrder,
    /// In q and v, with the constraints on both levels (GGL).
    Stabilised,
}

/// The equations of a model at an instant, with exact first and second derivatives.
#[derive(Clone, Debug)]
pub struct Instant<'m> {
    pub model: &'m Model,
    pub form: Form,
    nq: usize,
    nc: usize,
    nm: usize,
    /// Whether velocities are local variables: those of the stabilised form, or of bodies in space.
    has_velocity: bool,
    /// W, N
    weight: f64,
    /// F_o/W
    strength: Vec<f64>,
    /// Coordinates of each joint constraint that are unknowns.
    constraint_slots: Vec<Vec<usize>>,
    surroundings: Arc<Surroundings>,
}

/// Coordinates and velocities of all bodies, those of given motion last, and the external forces.
struct Around {
    q: Vec<f64>,
    velocity: Vec<f64>,
    loads: Vec<[f64; 3]>,
}

/// Multipliers of the equations at one instant, and of the conditions `f_m ≥ 0` (empty where not imposed).
#[derive(Clone, Copy, Debug)]
pub struct InstantMultipliers<'a> {
    pub equations: &'a [f64],
    pub force: &'a [f64],
}

impl<'m> Instant<'m> {
    pub fn new(model: &'m Model, form: Form) -> Self {
        let weight = model.weight();
        Self {
            model,
            form,
            nq: model.coordinates(),
            nc: model.constraints(),
            nm: model.muscles.len(),
            has_velocity: form == Form::Stabilised || model.spatial().is_some(),
            weight,
            strength: model.muscles.iter().map(|m| m.max_isometric_force / weight).collect(),
            constraint_slots: model.mechanics.constraint_slots(),
            surroundings: Arc::new(Surroundings::constant(model)),
        }
    }

    /// The same with external forces and given bodies that move.
    pub fn within(self, surroundings: Arc<Surroundings>) -> Self {
        Self { surroundings, ..self }
    }

    pub fn surroundings(&self) -> &Arc<Surroundings> {
        &self.surroundings
    }

    fn around(&self, t: f64, z: &[f64]) -> Around {
        let (mut q, mut velocity) = (z[..self.nq].to_vec(), Vec::new());
        if self.has_velocity {
            velocity.extend_from_slice(&z[self.velocity(0)..self.velocity(0) + self.nq]);
        }
        let (given, rates) = self.surroundings.given(t);
        q.extend(given);
        velocity.extend(rates);
        Around { q, velocity, loads: self.surroundings.loads(t) }
    }

    /// All coordinates at z, those of given motion last.
    pub fn coordinates(&self, t: f64, z: &[f64]) -> Vec<f64> {
        self.around(t, z).q
    }

    fn motion<'a>(&self, around: &'a Around, z: &'a [f64]) -> Motion<'a> {
        let acceleration = &z[self.nq..2 * self.nq];
        Motion { q: &around.q, velocity: &around.velocity, acceleration }
    }

    /// The local variable of a body coordinate, its velocity or acceleration.
    fn place(&self, (level, i): (Level, usize)) -> usize {
        match level {
            Level::Coordinate => i,
            Level::Velocity => self.velocity(i),
            Level::Acceleration => self.acceleration(i),
        }
    }

    /// Number of local variables `nz`.
    pub fn variables(&self) -> usize {
        let velocity = if self.has_velocity { self.nq } else { 0 };
        let stabilised = if self.form == Form::Stabilised { self.nq + self.nc } else { 0 };
        2 * self.nq + PER_MUSCLE * self.nm + self.nc + velocity + stabilised
    }

    /// Number of equations.
    pub fn equations(&self) -> usize {
        let more = if self.form == Form::Stabilised { self.nq + self.nc } else { 0 };
        self.nq + self.nc + 2 * self.nm + more
    }

    pub fn acceleration(&self, coordinate: usize) -> usize {
        self.nq + coordinate
    }

    /// First of the five local variables of a muscle.
    pub fn muscle(&self, muscle: usize) -> usize {
        2 * self.nq + PER_MUSCLE * muscle
    }

    pub fn reaction(&self, constraint: usize) -> usize {
        2 * self.nq + PER_MUSCLE * self.nm + constraint
    }

    pub fn has_velocity(&self) -> bool {
        self.has_velocity
    }

    /// v of the stabilised form; q̇ of bodies in space.
    pub fn velocity(&self, coordinate: usize) -> usize {
        self.reaction(self.nc) + coordinate
    }

    /// q̇ of the stabilised form.
    pub fn rate(&self, coordinate: usize) -> usize {
        self.reaction(self.nc) + self.nq + coordinate
    }

    /// η of the stabilised form.
    pub fn stabiliser(&self, constraint: usize) -> usize {
        self.reaction(self.nc) + 2 * self.nq + constraint
    }

    /// First row of the kinematic and of the velocity equations of the stabilised form.
    pub fn stabilised_row_starts(&self) -> [usize; 2] {
        let kinematic = self.nq + self.nc + 2 * self.nm;
        [kinematic, kinematic + self.nq]
    }

    /// First row of Φ, of eq. (3) and of eq. (4); eq. (1) begins at 0.
    pub fn row_starts(&self) -> [usize; 3] {
        [self.nq, self.nq + self.nc, self.nq + self.nc + self.nm]
    }

    /// f_m of every muscle.
    pub fn fibre_force(&self, z: &[f64], muscle: usize) -> f64 {
        let at = self.muscle(muscle);
        self.model.muscles[muscle].fibre_force(z[at + ACTIVATION], z[at + LENGTH], z[at + VELOCITY]).value
    }

    /// How f_m changes along the direction `dz`.
    pub fn fibre_force_change(&self, z: &[f64], dz: &[f64], muscle: usize) -> f64 {
        let at = self.muscle(muscle);
        let force = self.model.muscles[muscle].fibre_force(z[at + ACTIVATION], z[at + LENGTH], z[at + VELOCITY]);
        force.gradient.iter().zip(&dz[at..at + 3]).map(|(g, d)| g * d).sum()
    }

    /// The derivative of eq. (3) of a muscle by its tendon's slack length, 1/m, and how that changes with the local variables.
    pub fn slope_by_slack(&self, t: f64, z: &[f64], muscle: usize) -> (f64, Vec<(usize, f64)>) {
        let at = self.muscle(muscle) + LENGTH;
        let muscle = &self.model.muscles[muscle];
        if muscle.rigid_tendon {
            return (-1.0 / muscle.length_unit(), Vec::new());
        }
        // (L_mt − l L_o cos θ)/L_s has the derivative −1/L_s times itself.
        let slack = muscle.tendon_slack_length;
        let mut path = muscle.path.buffer();
        muscle.path.length(&self.coordinates(t, z), false, &mut path);
        let square = slack * slack;
        let slots = muscle.path.slots().iter().zip(&path.gradient);
        let mut mixed: Vec<(usize, f64)> = slots.map(|(&slot, gradient)| (slot, -gradient / square)).collect();
        mixed.push((at, muscle.fibre_along_tendon() / square));
        (-(muscle.tendon_strain(path.value, z[at]) + 1.0) / slack, mixed)
    }

    /// The residuals of all equations at time t (s); see the module's table.
    pub fn residual(&self, t: f64, z: &[f64], out: &mut [f64]) {
        let nq = self.nq;
        let around = self.around(t, z);
        let [constraint_row, contraction_row, activation_row] = self.row_starts();
        self.model.mechanics.force(self.motion(&around, z), &around.loads, out);
        out[..nq].iter_mut().for_each(|force| *force /= self.weight);
        let stabilised = self.form == Form::Stabilised;
        let [kinematic_row, velocity_row] = self.stabilised_row_starts();
        if stabilised {
            for i in 0..nq {
                out[kinematic_row + i] = z[self.rate(i)] - z[self.velocity(i)];
            }
        }
        self.model.mechanics.constraint_functions(&around.q, |row, slots, value, gradient, _| {
            out[constraint_row + row] = value;
            let reaction = z[self.reaction(row)];
            if stabilised {
                out[velocity_row + row] = 0.0;
            }
            for (&coordinate, gradient) in slots.iter().zip(gradient) {
                if stabilised && coordinate < around.velocity.len() {
                    out[velocity_row + row] += around.velocity[coordinate] * gradient;
                }
                if coordinate < nq {
                    out[coordinate] += reaction * gradient;
                    if stabilised {
                        out[kinematic_row + coordinate] -= z[self.stabiliser(row)] * gradient;
                    }
                }
            }
        });
        for (m, muscle) in self.model.muscles.iter().enumerate() {
            let at = self.muscle(m);
            let (a, l, v, rate, u) =
                (z[at], z[at + LENGTH], z[at + VELOCITY], z[at + ACTIVATION_RATE], z[at + EXCITATION]);
            let mut path = muscle.path.buffer();
            muscle.path.length(&around.q, false, &mut path);
            let force = muscle.fibre_force(a, l, v).value;
            for (slot, gradient) in muscle.path.slots().iter().zip(&path.gradient) {
                out[*slot] += self.strength[m] * force * gradient;
            }
            out[contraction_row + m] = muscle.contraction(path.value, l, force).value;
            let time = muscle.activation_time.max(muscle.deactivation_time);
            out[activation_row + m] = time * muscle.activation_residual(a, rate, u).value;
        }
    }

    /// The local Jacobian, row by row (equations × nz), and that of f_m over (a, l, v), muscle by muscle.
    pub fn jacobian(&self, t: f64, z: &[f64], out: &mut [f64], force_gradient: &mut [[f64; 3]]) {
        let (nz, nq) = (self.variables(), self.nq);
        let around = self.around(t, z);
        let [constraint_row, contraction_row, activation_row] = self.row_starts();
        out.fill(0.0);
        self.model.mechanics.slopes(self.motion(&around, z), &around.loads, |row, level, i, value| {
            out[row * nz + self.place((level, i))] += value / self.weight;
        });
        let stabilised = self.form == Form::Stabilised;
        let [kinematic_row, velocity_row] = self.stabilised_row_starts();
        if stabilised {
            for i in 0..nq {
                out[(kinematic_row + i) * nz + self.rate(i)] = 1.0;
                out[(kinematic_row + i) * nz + self.velocity(i)] = -1.0;
            }
        }
        self.model.mechanics.constraint_functions(&around.q, |row, slots, _, gradient, hessian| {
            let reaction = z[self.reaction(row)];
            for (i, &coordinate) in slots.iter().enumerate() {
                let own = coordinate < nq;
                if own {
                    out[(constraint_row + row) * nz + coordinate] = gradient[i];
                    out[coordinate * nz + self.reaction(row)] = gradient[i];
                    if stabilised {
                        out[(kinematic_row + coordinate) * nz + self.stabiliser(row)] = -gradient[i];
                        out[(velocity_row + row) * nz + self.velocity(coordinate)] = gradient[i];
                    }
                }
                for (j, &other) in slots.iter().enumerate().filter(|(_, other)| **other < nq) {
                    let second = hessian[i * slots.len() + j];
                    if own {
                        out[coordinate * nz + other] += reaction * second;
                    }
                    if stabilised && own {
                        out[(kinematic_row + coordinate) * nz + other] -= z[self.stabiliser(row)] * second;
                    }
                    if stabilised && coordinate < around.velocity.len() {
                        out[(velocity_row + row) * nz + other] += around.velocity[coordinate] * second;
                    }
                }
            }
        });
        for (m, muscle) in self.model.muscles.iter().enumerate() {
            let at = self.muscle(m);
            let (a, l, v, rate, u) =
                (z[at], z[at + LENGTH], z[at + VELOCITY], z[at + ACTIVATION_RATE], z[at + EXCITATION]);
            let slots = muscle.path.slots();
            let mut path = muscle.path.buffer();
            muscle.path.length(&around.q, true, &mut path);
            let force = muscle.fibre_force(a, l, v);
            let stretch = muscle.contraction(path.value, l, force.value);
            force_gradient[m] = force.gradient;
            for (i, &coordinate) in slots.iter().enumerate() {
                for (j, &other) in slots.iter().enumerate() {
                    out[coordinate * nz + other] += self.strength[m] * force.value * path.hessian[i * slots.len() + j];
                }
                for (k, by) in force.gradient.iter().enumerate() {
                    out[coordinate * nz + at + k] += self.strength[m] * path.gradient[i] * by;
                }
                out[(contraction_row + m) * nz + coordinate] = path.gradient[i] * stretch.by_path;
            }
            let contraction = &mut out[(contraction_row + m) * nz..(contraction_row + m + 1) * nz];
            for (k, by) in force.gradient.iter().enumerate() {
                contraction[at + k] = stretch.by_force * by;
            }
            contraction[at + LENGTH] += stretch.by_length;
            let time = muscle.activation_time.max(muscle.deactivation_time);
            let activation = muscle.activation_residual(a, rate, u);
            let row = &mut out[(activation_row + m) * nz..(activation_row + m + 1) * nz];
            row[at + ACTIVATION] = time * activation.gradient[0];
            row[at + ACTIVATION_RATE] = time * activation.gradient[1];
            row[at + EXCITATION] = time * activation.gradient[2];
        }
    }

    /// The Hessian over z of `λᵀ (equations) − νᵀ f_m`, dense and symmetric (nz × nz).
    ///
    /// With `V(q) = f_rᵀ Φ + Σ (F_o/W) f_m L_mt`, eq. (1) is the mechanism's force and `∇V`, so V's part is `∇²(λ·∇V)`: the
    /// directional derivative of ∇²V along λ, of joints exact by dual numbers `q + ε λ`.
    pub fn hessian(&self, t: f64, z: &[f64], multipliers: InstantMultipliers<'_>, out: &mut [f64]) {
        let (nz, nq) = (self.variables(), self.nq);
        let around = self.around(t, z);
        let [constraint_row, contraction_row, activation_row] = self.row_starts();
        let lambda = multipliers.equations;
        out.fill(0.0);
        self.model.mechanics.bends(self.motion(&around, z), &around.loads, lambda, |row, column, value| {
            out[self.place(row) * nz + self.place(column)] += value / self.weight;
        });
        let mut direction = lambda[..nq].to_vec();
        direction.resize(around.q.len(), 0.0);
        let q = along(&around.q, &direction);
        self.model.mechanics.constraint_functions(&q, |row, slots, _, gradient, hessian| {
            let (reaction, weight) = (z[self.reaction(row)], lambda[constraint_row + row]);
            for (i, &coordinate) in slots.iter().enumerate().filter(|(_, slot)| **slot < nq) {
                let mixed = gradient[i].eps;
                out[coordinate * nz + self.reaction(row)] += mixed;
                out[self.reaction(row) * nz + coordinate] += mixed;
                for (j, &other) in slots.iter().enumerate().filter(|(_, slot)| **slot < nq) {
                    let second = hessian[i * slots.len() + j];
                    out[coordinate * nz + other] += reaction * second.eps + weight * second.re;
                }
            }
        });
        if self.form == Form::Stabilised {
            self.add_stabilised_hessian(&around, z, lambda, out);
        }
        for (m, muscle) in self.model.muscles.iter().enumerate() {
            let at = self.muscle(m);
            let (a, l, v) = (z[at], z[at + LENGTH], z[at + VELOCITY]);
            let slots = muscle.path.slots();
            let path = muscle.path.length_along(&around.q, &direction);
            let force = muscle.fibre_force(a, l, v);
            let stretch = muscle.contraction(path.value.re, l, force.value);
            let contraction = lambda[contraction_row + m];
            let pull = self.strength[m] * force.value;
            for (i, &coordinate) in slots.iter().enumerate() {
                for (j, &other) in slots.iter().enumerate() {
                    let second = path.hessian[i * slots.len() + j];
                    out[coordinate * nz + other] += pull * second.eps + contraction * stretch.by_path * second.re;
                }
                for (k, by) in force.gradient.iter().enumerate() {
                    let mixed = self.strength[m] * path.gradient[i].eps * by;
                    out[coordinate * nz + at + k] += mixed;
                    out[(at + k) * nz + coordinate] += mixed;
                }
            }
            // ω ∇²f_m − λ (f_t⁻¹)'' ∇f_m ∇f_mᵀ, with ω the sum of all factors of f_m.
            let omega = self.strength[m] * path.value.eps + contraction * stretch.by_force
                - multipliers.force.get(m).copied().unwrap_or(0.0);
            for i in 0..3 {
                for j in 0..3 {
                    out[(at + i) * nz + at + j] += omega * force.hessian[i][j]
                        + contraction * stretch.bent * force.gradient[i] * force.gradient[j];
                }
            }
            let time = muscle.activation_time.max(muscle.deactivation_time);
            let activation = muscle.activation_residual(a, z[at + ACTIVATION_RATE], z[at + EXCITATION]);
            let weight = time * lambda[activation_row + m];
            out[(at + ACTIVATION) * nz + at + EXCITATION] += weight * activation.mixed;
            out[(at + EXCITATION) * nz + at + ACTIVATION] += weight * activation.mixed;
            out[(at + EXCITATION) * nz + at + EXCITATION] += weight * activation.excitation;
        }
    }

    /// The part of `κᵀ (q̇ − v − Φ_qᵀ η) + γᵀ Φ_q v`: with `Φ_η = Σ η_c Φ_c` and `Φ_γ` alike that is `γ`'s directional derivative
    /// along v less `η`'s along κ.
    fn add_stabilised_hessian(&self, around: &Around, z: &[f64], lambda: &[f64], out: &mut [f64]) {
        let (nz, nq) = (self.variables(), self.nq);
        let [kinematic_row, velocity_row] = self.stabilised_row_starts();
        let mut kappa = lambda[kinematic_row..velocity_row].to_vec();
        kappa.resize(around.q.len(), 0.0);
        self.model.mechanics.constraint_functions(&along(&around.q, &kappa), |row, slots, _, gradient, hessian| {
            let eta = z[self.stabiliser(row)];
            for (i, &coordinate) in slots.iter().enumerate().filter(|(_, slot)| **slot < nq) {
                let mixed = gradient[i].eps;
                out[coordinate * nz + self.stabiliser(row)] -= mixed;
                out[self.stabiliser(row) * nz + coordinate] -= mixed;
                for (j, &other) in slots.iter().enumerate().filter(|(_, slot)| **slot < nq) {
                    out[coordinate * nz + other] -= eta * hessian[i * slots.len() + j].eps;
                }
            }
        });
        let moving = along(&around.q, &around.velocity);
        self.model.mechanics.constraint_functions(&moving, |row, slots, _, _, hessian| {
            let gamma = lambda[velocity_row + row];
            for (i, &coordinate) in slots.iter().enumerate().filter(|(_, slot)| **slot < nq) {
                for (j, &other) in slots.iter().enumerate().filter(|(_, slot)| **slot < nq) {
                    let second = hessian[i * slots.len() + j];
                    out[coordinate * nz + other] += gamma * second.eps;
                    let bend = gamma * second.re;
                    out[coordinate * nz + self.velocity(other)] += bend;
                    out[self.velocity(other) * nz + coordinate] += bend;
                }
            }
        });
    }

    /// Makes a local Hessian positive semidefinite: the blocks of the body coordinates and of each muscle keep their
    /// positive curvature only, what couples them is left out.
    pub fn convexify(&self, hessian: &mut [f64]) {
        let nz = self.variables();
        let mut convex = vec![0.0; nz * nz];
        let mut keep = |places: &[usize], values: &[f64], vectors: &[f64]| {
            for (value, vector) in
                values.iter().zip(vectors.chunks_exact(places.len())).filter(|(value, _)| **value > 0.0)
            {
                for (&row, in_row) in places.iter().zip(vector) {
                    for (&column, in_column) in places.iter().zip(vector) {
                        convex[row * nz + column] += value * in_row * in_column;
                    }
                }
            }
        };
        let body: Vec<usize> = (0..self.nq).collect();
        let eigen = DMatrix::from_fn(self.nq, self.nq, |i, j| hessian[i * nz + j]).symmetric_eigen();
        keep(&body, eigen.eigenvalues.as_slice(), eigen.eigenvectors.as_slice());
        for m in 0..self.nm {
            let places = [ACTIVATION, LENGTH, VELOCITY, EXCITATION].map(|variable| self.muscle(m) + variable);
            let eigen = Matrix4::from_fn(|i, j| hessian[places[i] * nz + places[j]]).symmetric_eigen();
            keep(&places, eigen.eigenvalues.as_slice(), eigen.eigenvectors.as_slice());
        }
        hessian.copy_from_slice(&convex);
    }

    /// Every (row, local variable) where the Jacobian can be non-zero.
    pub fn jacobian_pattern(&self) -> Vec<(usize, usize)> {
        let [constraint_row, contraction_row, activation_row] = self.row_starts();
        let [kinematic_row, velocity_row] = self.stabilised_row_starts();
        let slopes = self.model.mechanics.slope_pattern().into_iter();
        let mut pattern: Vec<(usize, usize)> = slopes.map(|(row, level, i)| (row, self.place((level, i)))).collect();
        pattern.extend(self.coordinate_pairs());
        for (row, slots) in self.constraint_slots.iter().enumerate() {
            for &coordinate in slots {
                pattern.push((constraint_row + row, coordinate));
                pattern.push((coordinate, self.reaction(row)));
                if self.form == Form::Stabilised {
                    pattern.push((kinematic_row + coordinate, self.stabiliser(row)));
                    pattern.push((velocity_row + row, self.velocity(coordinate)));
                    pattern.push((velocity_row + row, coordinate));
                    pattern.extend(slots.iter().map(|other| (kinematic_row + coordinate, *other)));
                }
            }
        }
        if self.form == Form::Stabilised {
            pattern.extend((0..self.nq).map(|i| (kinematic_row + i, self.rate(i))));
            pattern.extend((0..self.nq).map(|i| (kinematic_row + i, self.velocity(i))));
        }
        for (m, muscle) in self.model.muscles.iter().enumerate() {
            let at = self.muscle(m);
            for &coordinate in muscle.path.slots() {
                pattern.extend((0..3).map(|k| (coordinate, at + k)));
                pattern.push((contraction_row + m, coordinate));
            }
            pattern.extend((0..3).map(|k| (contraction_row + m, at + k)));
            pattern.extend([ACTIVATION, ACTIVATION_RATE, EXCITATION].map(|k| (activation_row + m, at + k)));
        }
        pattern.sort_unstable();
        pattern.dedup();
        pattern
    }

    /// Every ordered pair of local variables where the Hessian, exact or convexified, can be non-zero, and the diagonal.
    pub fn hessian_pattern(&self) -> Vec<(usize, usize)> {
        let mut pattern: Vec<(usize, usize)> = (0..self.nq).flat_map(|i| (0..self.nq).map(move |j| (i, j))).collect();
        pattern.extend((0..self.variables()).map(|i| (i, i)));
        let bends = self.model.mechanics.bend_pattern().into_iter();
        pattern.extend(bends.map(|(row, column)| (self.place(row), self.place(column))));
        let both = |pattern: &mut Vec<(usize, usize)>, i: usize, j: usize| pattern.extend([(i, j), (j, i)]);
        for (row, slots) in self.constraint_slots.iter().enumerate() {
            for &coordinate in slots {
                both(&mut pattern, coordinate, self.reaction(row));
                if self.form == Form::Stabilised {
                    both(&mut pattern, coordinate, self.stabiliser(row));
                    slots.iter().for_each(|&other| both(&mut pattern, coordinate, self.velocity(other)));
                }
            }
        }
        for (m, muscle) in self.model.muscles.iter().enumerate() {
            let at = self.muscle(m);
            for k in 0..3 {
                muscle.path.slots().iter().for_each(|&coordinate| both(&mut pattern, coordinate, at + k));
                (0..k).for_each(|other| both(&mut pattern, at + k, at + other));
            }
            [ACTIVATION, LENGTH, VELOCITY].iter().for_each(|k| both(&mut pattern, at + k, at + EXCITATION));
        }
        pattern.sort_unstable();
        pattern.dedup();
        pattern
    }

    /// Pairs of body coordinates that a joint or a muscle couples in ∇²V.
    fn coordinate_pairs(&self) -> Vec<(usize, usize)> {
        let mut pairs: Vec<(usize, usize)> = (0..self.nq).map(|i| (i, i)).collect();
        let mut couple = |slots: &[usize]| {
            for &i in slots {
                pairs.extend(slots.iter().map(|&j| (i, j)));
            }
        };
        self.constraint_slots.iter().for_each(|slots| couple(slots));
        self.model.muscles.iter().for_each(|muscle| couple(muscle.path.slots()));
        pairs.sort_unstable();
        pairs.dedup();
        pairs
    }

    /// How far eq. (3) is from holding as printed: |f_t(l_t) − f_m|, normalised force.
    pub fn printed_contraction_residual(&self, t: f64, z: &[f64], muscle: usize) -> f64 {
        let m = &self.model.muscles[muscle];
        let mut path = m.path.buffer();
        m.path.length(&self.coordinates(t, z), false, &mut path);
        m.printed_contraction(path.value, z[self.muscle(muscle) + LENGTH], self.fibre_force(z, muscle)).abs()
    }
}

/// x + ε d
fn along(x: &[f64], d: &[f64]) -> Vec<Dual64> {
    x.iter().zip(d).map(|(&x, &d)| Dual64::new(x, d)).collect()
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    /// A model with every kind of joint, a loop, via points, loads, unequal times.
    pub(crate) fn model() -> Model {
        let text = include_str!("../../tests/fixtures/everything.toml");
        let file: crate::model::file::ModelFile = toml::from_str(text).unwrap();
        file.check().unwrap()
    }

    pub(crate) fn random_instant(instant: &Instant<'_>, rng: &mut impl rand::Rng) -> Vec<f64> {
        let mut z: Vec<f64> = (0..instant.variables()).map(|_| rng.random_range(-0.5..0.5)).collect();
        for m in 0..instant.model.muscles.len() {
            let at = instant.muscle(m);
            z[at + ACTIVATION] = rng.random_range(0.02..1.0);
            z[at + LENGTH] = rng.random_range(0.6..1.3);
            z[at + EXCITATION] = rng.random_range(0.0..1.0);
        }
        z
    }

    #[test]
    fn jacobian_and_hessian_agree_with_differences_and_their_patterns() {
        for form in [Form::SecondOrder, Form::Stabilised] {
            check_derivatives(form);
        }
    }

    fn check_derivatives(form: Form) {
        let model = model();
        let instant = Instant::new(&model, form);
        let (nz, rows, nm) = (instant.variables(), instant.equations(), model.muscles.len());
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(4);
        let jacobian = |z: &[f64]| {
            let mut out = vec![0.0; rows * nz];
            let mut force = vec![[0.0; 3]; nm];
            instant.jacobian(0.0, z, &mut out, &mut force);
            (out, force)
        };
        for _ in 0..5 {
            let z = random_instant(&instant, &mut rng);
            let lambda: Vec<f64> = (0..rows).map(|_| rng.random_range(-1.0..1.0)).collect();
            let nu: Vec<f64> = (0..nm).map(|_| rng.random_range(0.0..1.0)).collect();
            let (exact, _) = jacobian(&z);
            let mut hessian = vec![0.0; nz * nz];
            instant.hessian(0.0, &z, InstantMultipliers { equations: &lambda, force: &nu }, &mut hessian);
            let (first, second) = (instant.jacobian_pattern(), instant.hessian_pattern());
            for j in 0..nz {
                let e = 1e-6;
                let shifted = |s: f64| {
                    let mut y = z.clone();
                    y[j] += s;
                    y
                };
                let (low, high) = (shifted(-e), shifted(e));
                let (mut c_low, mut c_high) = (vec![0.0; rows], vec![0.0; rows]);
                instant.residual(0.0, &low, &mut c_low);
                instant.residual(0.0, &high, &mut c_high);
                for i in 0..rows {
                    let difference = (c_high[i] - c_low[i]) / (2.0 * e);
                    let value = exact[i * nz + j];
                    assert!((difference - value).abs() < 1e-6 * (1.0 + value.abs()), "{i} {j} {difference} {value}");
                    assert!(value == 0.0 || first.contains(&(i, j)), "pattern misses {i} {j}");
                }
                let gradient = |(jacobian, force): (Vec<f64>, Vec<[f64; 3]>)| {
                    let mut g: Vec<f64> =
                        (0..nz).map(|k| (0..rows).map(|i| lambda[i] * jacobian[i * nz + k]).sum()).collect();
                    for m in 0..nm {
                        for k in 0..3 {
                            g[instant.muscle(m) + k] -= nu[m] * force[m][k];
                        }
                    }
                    g
                };
                let (g_low, g_high) = (gradient(jacobian(&low)), gradient(jacobian(&high)));
                for i in 0..nz {
                    let difference = (g_high[i] - g_low[i]) / (2.0 * e);
                    let value = hessian[i * nz + j];
                    assert!((difference - value).abs() < 2e-5 * (1.0 + value.abs()), "{i} {j} {difference} {value}");
                    assert!(value == 0.0 || second.contains(&(i, j)), "pattern misses {i} {j}");
                }
            }
        }
    }
}
