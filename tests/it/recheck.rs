//! Checks a solution with code independent of the code that computed it.

use nalgebra::{DMatrix, DVector};
use num_dual::Dual64;
use sinew::internals::curves::{active_force_length, passive_force_length, tendon_force};
use sinew::internals::deadline::Deadline;
use sinew::internals::model::Model;
use sinew::internals::model::path::Path;
use sinew::internals::nlp::options::SqpOptions;
use sinew::internals::nlp::sqp;
use sinew::internals::nlp::termination::SqpStatus;
use sinew::internals::numerics::bspline::SplineSpace;
use sinew::internals::problem::QuantityId;
use sinew::internals::settings::Bounds;
use sinew::internals::transcription::coefficients::Coefficients;
use sinew::internals::transcription::midpoint::mesh;

use super::support::{model, motion, prepare, settings};

/// A solved arm curl: its decision vector, accessed by the names of the splines.
struct Solved {
    x: Vec<f64>,
    coefficients: Coefficients,
    coordinate: QuantityId,
    length: QuantityId,
    activation: QuantityId,
    excitation: QuantityId,
    /// Collocation points, s.
    points: Vec<f64>,
    /// By degree.
    spaces: [SplineSpace; 3],
}

fn solve(model: &Model, points: usize, bounds: Bounds) -> Solved {
    let table = motion("arm_curl.csv", model);
    let settings = settings(|s| s.bounds = bounds);
    let prepared = prepare(model, &table, &settings, points);
    let guess = prepared.guess(Deadline::default()).unwrap();
    let outcome = sqp::solve(&prepared.transcribe(), guess, SqpOptions::default());
    assert_eq!(outcome.status, SqpStatus::Converged);
    let (points, breakpoints) = mesh(points, table.duration());
    let (motion, muscles) = (&prepared.inverse.motion, &prepared.inverse.muscles);
    Solved {
        x: outcome.iterate.x,
        coefficients: prepared.scheme.coefficients().clone(),
        coordinate: motion.coordinate,
        length: muscles.fibre_length.unwrap(),
        activation: muscles.activation,
        excitation: muscles.excitation.unwrap(),
        points,
        spaces: [0, 1, 2].map(|degree| SplineSpace::new(degree, &breakpoints)),
    }
}

impl Solved {
    fn value(&self, quantity: QuantityId, i: usize, degree: usize, t: f64, derivative: usize) -> f64 {
        let coefficient = |k| self.x[self.coefficients.index(quantity, k, i)];
        let c: Vec<f64> = (0..self.spaces[degree].dimension()).map(coefficient).collect();
        self.spaces[degree].value(&c, t, derivative)
    }

    fn coordinate(&self, i: usize, t: f64, derivative: usize) -> f64 {
        self.value(self.coordinate, i, 2, t, derivative)
    }

    fn length(&self, m: usize, t: f64, derivative: usize) -> f64 {
        self.value(self.length, m, 1, t, derivative)
    }

    fn activation(&self, m: usize, t: f64, derivative: usize) -> f64 {
        self.value(self.activation, m, 1, t, derivative)
    }

    fn excitation(&self, m: usize, j: usize) -> f64 {
        self.x[self.coefficients.index(self.excitation, j, m)]
    }
}

/// Length of a muscle's path from the body coordinates, by elementary geometry.
fn path_length(model: &Model, muscle: usize, q: &[f64]) -> f64 {
    let point = |place: &sinew::internals::model::Place| match *place {
        sinew::internals::model::Place::Ground(p) => p,
        sinew::internals::model::Place::Body(b, [x, y]) => {
            let (sin, cos) = q[3 * b + 2].sin_cos();
            [q[3 * b] + cos * x - sin * y, q[3 * b + 1] + sin * x + cos * y]
        }
    };
    let Path::Straight(path) = &model.muscles[muscle].path else { panic!("a planar model") };
    let points: Vec<[f64; 2]> = path.points.iter().map(point).collect();
    points.windows(2).map(|w| (w[1][0] - w[0][0]).hypot(w[1][1] - w[0][1])).sum()
}

/// The force–velocity relation as printed in the paper, eqs (8) and (9).
fn printed_force_velocity(v: f64) -> f64 {
    let (b3, b4) = (0.25, -0.33 * 0.25 / 0.75);
    if v <= 0.0 { (1.0 - v) / (1.0 - v / b3) } else { (1.0 - 1.33 * v / b4) / (1.0 - v / b4) }
}

#[test]
fn the_equations_as_printed_hold_at_every_collocation_point() {
    let model = model("arm.toml");
    for bounds in [Bounds::Activation, Bounds::Excitation, Bounds::Both] {
        let solved = solve(&model, 6, bounds);
        for (j, &t) in solved.points.iter().enumerate() {
            let q: Vec<f64> = (0..6).map(|i| solved.coordinate(i, t, 0)).collect();
            // Joints: shoulder at the origin, elbow 0.30 m down the upper arm; points from the model file.
            let joint = |body: usize, point: [f64; 2]| {
                let com = model.planar().unwrap().bodies[body].centre_of_mass;
                let (sin, cos) = q[3 * body + 2].sin_cos();
                let s = [point[0] - com[0], point[1] - com[1]];
                [q[3 * body] + cos * s[0] - sin * s[1], q[3 * body + 1] + sin * s[0] + cos * s[1]]
            };
            let (shoulder, end, elbow) = (joint(0, [0.0, 0.0]), joint(0, [0.0, -0.3]), joint(1, [0.0, 0.0]));
            assert!(shoulder[0].abs().max(shoulder[1].abs()) < 1e-8);
            assert!((end[0] - elbow[0]).abs().max((end[1] - elbow[1]).abs()) < 1e-8);
            let mut motion: Vec<f64> = (0..6)
                .map(|i| {
                    let body = &model.planar().unwrap().bodies[i / 3];
                    let mass = if i % 3 == 2 { body.inertia } else { body.mass };
                    let gravity = if i % 3 == 1 { 9.81 * body.mass } else { 0.0 };
                    mass * solved.coordinate(i, t, 2) + gravity
                })
                .collect();
            for (m, muscle) in model.muscles.iter().enumerate() {
                let (l, v) = (solved.length(m, t, 0), solved.length(m, t, 1));
                let a = solved.activation(m, t, 0);
                let force =
                    passive_force_length(l).value + a * active_force_length(l).value * printed_force_velocity(v);
                let path = path_length(&model, m, &q);
                let strain = (path - muscle.optimal_fibre_length * l) / muscle.tendon_slack_length - 1.0;
                assert!((tendon_force(strain) - force).abs() < 1e-8, "contraction of {}", muscle.name);
                let u = solved.excitation(m, j);
                let rate = (u - a) * (u / 0.12 + (1.0 - u) / 0.12);
                assert!((solved.activation(m, t, 1) - rate).abs() < 1e-7, "activation of {}", muscle.name);
                for (i, row) in motion.iter_mut().enumerate() {
                    let e = 1e-6;
                    let shifted = |s: f64| {
                        let mut y = q.clone();
                        y[i] += s;
                        path_length(&model, m, &y)
                    };
                    *row += muscle.max_isometric_force * force * (shifted(e) - shifted(-e)) / (2.0 * e);
                }
            }
            // The reactions carry the remainder; their moments about the joints vanish.
            let forearm_at_elbow = [elbow[0] - q[3], elbow[1] - q[4]];
            let elbow_moment = motion[5] - (forearm_at_elbow[0] * motion[4] - forearm_at_elbow[1] * motion[3]);
            assert!(elbow_moment.abs() < 1e-5, "{bounds:?} elbow {elbow_moment}");
            let arm = |point: [f64; 2]| [point[0] - q[0], point[1] - q[1]];
            let (top, bottom) = (arm(shoulder), arm(end));
            let shoulder_force = [motion[0] + motion[3], motion[1] + motion[4]];
            let shoulder_moment = motion[2] + (bottom[0] * motion[4] - bottom[1] * motion[3])
                - (top[0] * shoulder_force[1] - top[1] * shoulder_force[0]);
            assert!(shoulder_moment.abs() < 1e-5, "{bounds:?} shoulder {shoulder_moment}");
        }
        // The splines start with φ.
        for m in 0..5 {
            let phi = solved.x[solved.coefficients.initial(solved.activation, 0, m)];
            assert!((phi - solved.activation(m, 0.0, 0)).abs() < 1e-9);
        }
    }
}

#[test]
fn activation_and_fibre_length_integrated_forward_show_the_gap_between_the_points() {
    // The scheme imposes the equations at the points only. Between them, activation satisfies its equation to the
    // scheme's order. Fibre length does not (the midpoint rule has no damping): the error is printed.
    let model = model("arm.toml");
    let mut activation_gaps = Vec::new();
    for points in [6, 11, 21] {
        let solved = solve(&model, points, Bounds::Both);
        let (mut activation_gap, mut length_gap) = (0.0f64, 0.0f64);
        let steps = 4000;
        let h = 1.0 / f64::from(steps);
        for (m, muscle) in model.muscles.iter().enumerate() {
            let mut a = solved.activation(m, 0.0, 0);
            let mut l = solved.length(m, 0.0, 0);
            for i in 0..steps {
                let t = (f64::from(i) + 0.5) * h;
                let u = solved.excitation(m, solved.spaces[0].basis(t, 0).first);
                a = (a + h * u / 0.12) / (1.0 + h / 0.12);
                // Implicit Euler on eq. (3) with the solution's motion and activation. The residual falls with l, so
                // bisect.
                let q: Vec<f64> = (0..6).map(|i| solved.coordinate(i, t, 0)).collect();
                let (path, active) = (path_length(&model, m, &q), solved.activation(m, t, 0));
                let (mut low, mut high) = (l - 0.2, l + 0.2);
                for _ in 0..50 {
                    let middle = 0.5 * (low + high);
                    let force = muscle.fibre_force(active, middle, (middle - l) / h).value;
                    if tendon_force(muscle.tendon_strain(path, middle)) > force { low = middle } else { high = middle }
                }
                l = 0.5 * (low + high);
                if i % 40 == 0 {
                    activation_gap = activation_gap.max((a - solved.activation(m, t, 0)).abs());
                    length_gap = length_gap.max((l - solved.length(m, t, 0)).abs());
                }
            }
        }
        println!("p = {points}: activation off by {activation_gap:.3}, fibre length by {length_gap:.3}");
        assert!(length_gap.is_finite());
        activation_gaps.push(activation_gap);
    }
    // Excitation is constant over a span and changes in steps: the error falls with the length of the span.
    assert!(activation_gaps[0] < 0.2, "{activation_gaps:?}");
    assert!(activation_gaps[2] < activation_gaps[0], "{activation_gaps:?}");
}

/// q̈ of the arm under given muscle forces (N); Lagrange multipliers with Baumgarte stabilisation hold the joints.
fn acceleration(model: &Model, q: &[f64], rate: &[f64], forces: &[f64]) -> Vec<f64> {
    let (nq, nc) = (model.mechanics.coordinates(), model.mechanics.constraints());
    let planar = model.planar().unwrap();
    let mut matrix = DMatrix::zeros(nq + nc, nq + nc);
    let mut right = DVector::zeros(nq + nc);
    for (i, mass) in planar.mass_diagonal().into_iter().enumerate() {
        matrix[(i, i)] = mass;
        right[i] = if i % 3 < 2 { mass * planar.gravity[i % 3] } else { 0.0 };
    }
    for (muscle, force) in model.muscles.iter().zip(forces) {
        let mut path = muscle.path.buffer();
        muscle.path.length(q, false, &mut path);
        muscle.path.slots().iter().zip(&path.gradient).for_each(|(&slot, g)| right[slot] -= force * g);
    }
    let moving: Vec<Dual64> = q.iter().zip(rate).map(|(&x, &v)| Dual64::new(x, v)).collect();
    let mut rows = Vec::new();
    planar.joints.iter().for_each(|joint| joint.constraints(&moving, |function| rows.push((joint.slots(), *function))));
    for (row, (slots, function)) in rows.into_iter().enumerate() {
        let stiffness = 20.0;
        right[nq + row] = -2.0 * stiffness * function.value.eps - stiffness * stiffness * function.value.re;
        for (slot, gradient) in slots.into_iter().zip(function.gradient) {
            if let Some(i) = slot {
                matrix[(i, nq + row)] = gradient.re;
                matrix[(nq + row, i)] = gradient.re;
                right[nq + row] -= gradient.eps * rate[i];
            }
        }
    }
    matrix.lu().solve(&right).expect("independent joints").as_slice()[..nq].to_vec()
}

#[test]
fn the_motion_integrated_forward_under_the_found_forces_stays_near_for_a_while() {
    let model = model("arm.toml");
    for points in [6, 11, 21] {
        let solved = solve(&model, points, Bounds::Both);
        let at_points: Vec<Vec<f64>> = solved
            .points
            .iter()
            .map(|&t| {
                let force = |m: usize| {
                    let muscle = &model.muscles[m];
                    let (a, l, v) = (solved.activation(m, t, 0), solved.length(m, t, 0), solved.length(m, t, 1));
                    muscle.max_isometric_force * muscle.fibre_force(a, l, v).value
                };
                (0..model.muscles.len()).map(force).collect()
            })
            .collect();
        let forces = |t: f64| -> Vec<f64> {
            let place = t * (points - 1) as f64;
            let j = (place as usize).min(points - 2);
            let share = place - j as f64;
            (0..model.muscles.len()).map(|m| (1.0 - share) * at_points[j][m] + share * at_points[j + 1][m]).collect()
        };
        let mut q: Vec<f64> = (0..6).map(|i| solved.coordinate(i, 0.0, 0)).collect();
        let mut v: Vec<f64> = (0..6).map(|i| solved.coordinate(i, 0.0, 1)).collect();
        let steps = 2000;
        let h = 1.0 / f64::from(steps);
        let mut gaps = [0.0f64; 2];
        for i in 0..steps {
            let t = f64::from(i) * h;
            let half = |x: &[f64], d: &[f64]| x.iter().zip(d).map(|(x, d)| x + 0.5 * h * d).collect::<Vec<f64>>();
            let (middle_q, middle_v) = (half(&q, &v), half(&v, &acceleration(&model, &q, &v, &forces(t))));
            let a = acceleration(&model, &middle_q, &middle_v, &forces(t + 0.5 * h));
            q.iter_mut().zip(&middle_v).for_each(|(x, d)| *x += h * d);
            v.iter_mut().zip(&a).for_each(|(x, d)| *x += h * d);
            let gap = (0..6).map(|k| (q[k] - solved.coordinate(k, t + h, 0)).abs()).fold(0.0, f64::max);
            gaps[usize::from(t >= 0.2)] = gaps[usize::from(t >= 0.2)].max(gap);
        }
        println!("p = {points}: motion off by {:.3} in the first 0.2 s, {:.3} after (m, rad)", gaps[0], gaps[1]);
        assert!(gaps[0] < 0.15 && gaps[1].is_finite(), "{gaps:?}");
    }
}
