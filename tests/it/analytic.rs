//! Comparisons with closed-form solutions: pendulum, holding torque, activation step.

use nalgebra::{DMatrix, DVector};
use sinew::internals::methods::{InverseProblem, dynamic};
use sinew::internals::model::Model;
use sinew::internals::model::file::ModelFile;
use sinew::internals::motion::Surroundings;
use sinew::internals::numerics::bspline::SplineSpace;
use sinew::internals::transcription::midpoint::mesh;

use super::support::settings;

const PENDULUM: &str = r#"
name = "pendulum"
gravity = [0.0, -9.81]
[[body]]
name = "rod"
mass = 2.0
centre_of_mass = [0.0, -0.4]
inertia = 0.05
[[joint]]
name = "hinge"
kind = "revolute"
parent = "ground"
parent_point = [0.1, 0.2]
child = "rod"
child_point = [0.0, 0.0]
coordinate = "angle"
[[muscle]]
name = "puller"
max_isometric_force = 500.0
optimal_fibre_length = 0.1
tendon_slack_length = 0.2
path = [ { body = "ground", point = [-0.05, 0.3] }, { body = "rod", point = [-0.02, -0.15] } ]
"#;

fn pendulum() -> Model {
    toml::from_str::<ModelFile>(PENDULUM).unwrap().check().unwrap()
}

/// The thesis' problem of a model.
fn problem(model: &Model) -> InverseProblem<'_> {
    dynamic(model, &settings(|_| ()), &std::sync::Arc::new(Surroundings::constant(model)))
}

/// The smallest residual of eq. (1) over all reactions, in units of the weight.
fn residual_of_motion(inverse: &InverseProblem<'_>, z: &[f64]) -> f64 {
    let model = inverse.model;
    let (nq, nc) = (model.mechanics.coordinates(), model.mechanics.constraints());
    let motion = |z: &[f64]| {
        let mut out = vec![0.0; inverse.control.rows()];
        inverse.control.values(z, &mut out);
        DVector::from_row_slice(inverse.motion.equation.of(&out))
    };
    let rest = motion(z);
    let mut columns = DMatrix::zeros(nq, nc);
    for c in 0..nc {
        let mut unit = z.to_vec();
        unit[inverse.motion.reactions.at(c)] += 1.0;
        columns.set_column(c, &(motion(&unit) - &rest));
    }
    let reactions = columns.clone().svd(true, true).solve(&-&rest, 1e-12).unwrap();
    (rest + columns * reactions).amax()
}

/// z of the rod at an angle, with angular velocity and acceleration, and a negligible muscle force.
fn swinging(model: &Model, angle: f64, rate: f64, acceleration: f64) -> Vec<f64> {
    let inverse = problem(model);
    let q = model.planar().unwrap().assemble(&[Some(angle)], None).unwrap();
    let mut z = vec![0.0; inverse.control.variables()];
    z[inverse.motion.q.range()].copy_from_slice(&q);
    // Centre of mass at −0.4 along the rod: r = 0.4 (sin φ, −cos φ).
    let (sin, cos) = angle.sin_cos();
    z[inverse.motion.accelerations.at(0)] = 0.4 * (acceleration * cos - rate * rate * sin);
    z[inverse.motion.accelerations.at(1)] = 0.4 * (acceleration * sin + rate * rate * cos);
    z[inverse.motion.accelerations.at(2)] = acceleration;
    z[inverse.muscles.l.at(0)] = -5.0; // a fibre so short that its passive force is below 1e-28
    z
}

#[test]
fn the_pendulum_equation_follows_from_the_constraint_form() {
    let model = pendulum();
    let inverse = problem(&model);
    for (angle, rate) in [(0.3, 0.0), (-1.2, 2.0), (2.0, -3.0)] {
        // (I + m l²) φ̈ = −m g l sin φ
        let acceleration = -2.0 * 9.81 * 0.4 * f64::sin(angle) / (0.05 + 2.0 * 0.16);
        let z = swinging(&model, angle, rate, acceleration);
        assert!(residual_of_motion(&inverse, &z) < 1e-13);
        let wrong = swinging(&model, angle, rate, acceleration + 0.1);
        assert!(residual_of_motion(&inverse, &wrong) > 1e-5);
    }
}

#[test]
fn a_muscle_holds_the_rod_with_the_torque_of_its_moment_arm() {
    let model = pendulum();
    let inverse = problem(&model);
    let muscle = &model.muscles[0];
    let angle = -0.5;
    let length = |angle: f64| {
        let q = model.planar().unwrap().assemble(&[Some(angle)], None).unwrap();
        let mut path = muscle.path.buffer();
        muscle.path.length(&q, false, &mut path);
        path.value
    };
    let moment_arm = -(length(angle + 1e-6) - length(angle - 1e-6)) / 2e-6;
    // m g l sin φ = F r, where F is the fibre's force at rest: find the activation that gives it.
    let force = 2.0 * 9.81 * 0.4 * f64::sin(angle) / moment_arm;
    assert!(force > 0.0, "the muscle can only pull");
    let mut z = swinging(&model, angle, 0.0, 0.0);
    let at = inverse.muscles.a.at(0);
    z[inverse.muscles.l.at(0)] = 1.0;
    let passive = muscle.fibre_force(0.0, 1.0, 0.0).value;
    let full = muscle.fibre_force(1.0, 1.0, 0.0).value;
    z[at] = (force / muscle.max_isometric_force - passive) / (full - passive);
    assert!(residual_of_motion(&inverse, &z) < 1e-9);
    z[at] *= 1.1;
    assert!(residual_of_motion(&inverse, &z) > 1e-4);
}

#[test]
fn a_step_of_excitation_gives_the_exponential() {
    let mut muscle = pendulum().muscles.remove(0);
    (muscle.activation.up, muscle.activation.down) = (0.03, 0.08);
    for (u, a0, time) in [(1.0, 0.1, 0.03), (0.0, 0.8, 0.08)] {
        // a(t) = u + (a0 − u) exp(−t/τ): τ_act at full excitation, τ_deact without excitation.
        for i in 0..10 {
            let t = 0.02 * f64::from(i);
            let gap = (a0 - u) * f64::exp(-t / time);
            assert!((muscle.activation.rate(u + gap, u).value + gap / time).abs() < 1e-12);
        }
    }
}

#[test]
fn the_scheme_is_of_second_order_on_activation() {
    // ȧ = (u − a)/τ with u = sin², integrated on the scheme's own splines, against a fine solution.
    let u = |t: f64| (3.0 * t).sin().powi(2);
    let (tau, a0) = (0.12, 0.1);
    let fine = {
        let (n, mut a) = (200_000, a0);
        let h = 1.0 / f64::from(n);
        for i in 0..n {
            let t = f64::from(i) * h;
            let k1 = (u(t) - a) / tau;
            let k2 = (u(t + 0.5 * h) - a - 0.5 * h * k1) / tau;
            a += h * k2;
        }
        a
    };
    let error = |points: usize| {
        let (points, breakpoints) = mesh(points, 1.0);
        let space = SplineSpace::new(1, &breakpoints);
        let mut c = vec![0.0; space.dimension()];
        c[0] = a0;
        for t in points {
            let (value, rate) = (space.basis(t, 0), space.basis(t, 1));
            // rate·c = (u − value·c)/τ for the last coefficient of this span.
            let known = |b: &sinew::internals::numerics::bspline::Basis| b.values[0] * c[b.first];
            let right = u(t) / tau - known(&rate) - known(&value) / tau;
            c[value.first + 1] = right / (rate.values[1] + value.values[1] / tau);
        }
        (space.value(&c, 1.0, 0) - fine).abs()
    };
    let ratios = [error(41) / error(81), error(81) / error(161)];
    assert!(ratios.iter().all(|r| (3.0..5.5).contains(r)), "{ratios:?}");
}
