//! Rigid bodies in space: quantities that a motion without muscles must conserve, and derivatives of everything that a
//! spatial model adds.

use nalgebra::{Matrix3, Vector3};
use num_dual::Dual64;
use rand::{RngExt, SeedableRng};
use sinew::internals::deadline::Deadline;
use sinew::internals::model::Model;
use sinew::internals::model::spatial::Spatial;
use sinew::internals::skeleton::file::SkeletonFile;

use super::radau::forward;
use super::support::{check_derivatives, prepare};

fn model(text: &str) -> Model {
    let file: SkeletonFile = toml::from_str(text).unwrap();
    Model::of_skeleton(std::sync::Arc::new(file.check().unwrap()))
}

fn body(name: &str, centre: &str, inertia: &str) -> String {
    format!("[[body]]\nname = \"{name}\"\nmass = 1.5\ncentre_of_mass = {centre}\ninertia = {inertia}\n")
}

fn joint(name: &str, parent: &str, at: &str, child: &str, axes: &[(&str, &str)]) -> String {
    let rotations: Vec<String> =
        axes.iter().map(|(name, axis)| format!("{{ coordinate = \"{name}\", axis = {axis} }}")).collect();
    let coordinates: String = axes.iter().map(|(name, _)| format!("[[coordinate]]\nname = \"{name}\"\n")).collect();
    format!(
        "[[joint]]\nname = \"{name}\"\nkind = \"axes\"\nparent = \"{parent}\"\nchild = \"{child}\"\n\
         parent_point = {at}\nrotations = [{}]\n{coordinates}",
        rotations.join(", ")
    )
}

const HEAD: &str = "name = \"test\"\ndimensions = 3\n";
const LONG: &str = "[0.05, 0.01, 0.05, 0.0, 0.0, 0.0]";
const ODD: &str = "[0.03, 0.02, 0.04, 0.002, -0.003, 0.001]";

/// A body on a ball joint.
fn pendulum() -> Model {
    let ball = joint("ball", "ground", "[0.0, 0.0, 0.0]", "rod", &[("a", X), ("b", Y), ("c", Z)]);
    model(&[HEAD, &body("rod", "[0.0, -0.4, 0.0]", ODD), &ball].concat())
}

/// A symmetric top, standing on its tip.
fn top() -> Model {
    // It spins about the last axis: the second must not come near 90 degrees.
    let ball = joint("tip", "ground", "[0.0, 0.0, 0.0]", "top", &[("a", X), ("b", Z), ("c", Y)]);
    model(&[HEAD, &body("top", "[0.0, 0.2, 0.0]", LONG), &ball].concat())
}

/// A ball joint, followed by an oblique hinge.
fn double_pendulum() -> Model {
    let ball = joint("ball", "ground", "[0.1, 0.0, 0.0]", "upper", &[("a", X), ("b", Y), ("c", Z)]);
    let hinge = joint("hinge", "upper", "[0.0, -0.5, 0.0]", "lower", &[("d", "[0.3, 0.2, 1.0]")]);
    let bodies = [body("upper", "[0.0, -0.25, 0.0]", ODD), body("lower", "[0.02, -0.2, 0.0]", LONG)].concat();
    model(&[HEAD, &bodies, &ball, &hinge].concat())
}

/// A ball joint, followed by a hinge whose axis moves by functions of its angle.
fn spline_chain() -> Model {
    let ball = joint("ball", "ground", "[0.1, 0.0, 0.0]", "upper", &[("a", X), ("b", Y), ("c", Z)]);
    let knee = r#"
[[joint]]
name = "knee"
kind = "axes"
parent = "upper"
child = "lower"
parent_point = [0.0, -0.5, 0.0]
translations = [
    { coordinate = "d", axis = [1.0, 0.0, 0.0], by = { polynomial = [0.01, 0.05, -0.02, 0.01] } },
    { coordinate = "d", axis = [0.0, 1.0, 0.0], by = { spline = [[-9.0, 0.1], [-1.0, 0.0], [2.0, 0.05], [9.0, 0.2]] } },
]
rotations = [{ coordinate = "d", axis = [0.3, 0.2, 1.0] }]

[[coordinate]]
name = "d"
"#;
    let bodies = [body("upper", "[0.0, -0.25, 0.0]", ODD), body("lower", "[0.02, -0.2, 0.0]", LONG)].concat();
    model(&[HEAD, &bodies, &ball, knee].concat())
}

const X: &str = "[1.0, 0.0, 0.0]";
const Y: &str = "[0.0, 1.0, 0.0]";
const Z: &str = "[0.0, 0.0, 1.0]";

/// Energy (J), and the angular momentum about the vertical through the joint to the ground (N m s), from frames of the
/// skeleton with their rates in the dual parts.
fn conserved(model: &Model, state: &[f64], pivot: [f64; 3]) -> (f64, f64) {
    let skeleton = &model.spatial().unwrap().skeleton;
    let (q, v) = state.split_at(model.mechanics.coordinates());
    let moving: Vec<Dual64> = q.iter().zip(v).map(|(q, v)| Dual64::new(*q, *v)).collect();
    let (mut energy, mut momentum) = (0.0, 0.0);
    for (body, frame) in skeleton.bodies.iter().zip(skeleton.frames(&moving)).filter(|(body, _)| body.mass > 0.0) {
        let centre = frame.point(&body.centre_of_mass.map(Dual64::from));
        let (r, velocity) = (Vector3::from(centre.map(|x| x.re)), Vector3::from(centre.map(|x| x.eps)));
        let axes = Matrix3::from_fn(|i, j| frame.axes[i][j].re);
        let turning = Matrix3::from_fn(|i, j| frame.axes[i][j].eps) * axes.transpose();
        let omega = Vector3::new(turning[(2, 1)], turning[(0, 2)], turning[(1, 0)]);
        let [xx, yy, zz, xy, xz, yz] = body.inertia;
        let inertia = axes * Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz) * axes.transpose();
        energy += 0.5 * body.mass * velocity.norm_squared() + 0.5 * omega.dot(&(inertia * omega));
        energy += body.mass * 9.81 * r.y;
        momentum += ((r - Vector3::from(pivot)).cross(&velocity) * body.mass + inertia * omega).y;
    }
    (energy, momentum)
}

#[test]
fn pendulum_top_double_pendulum_and_a_spline_joint_conserve_energy_and_momentum_to_the_order_of_the_scheme() {
    let (pendulum, top, double, splines) = (pendulum(), top(), double_pendulum(), spline_chain());
    let cases = [
        ("pendulum", &pendulum, [[0.6, 0.2, -0.3], [0.5, 2.0, 0.4]].concat(), [0.0; 3]),
        ("top", &top, [[0.3, 0.0, 0.0], [0.2, 0.0, 20.0]].concat(), [0.0; 3]),
        ("double pendulum", &double, [[0.5, 0.1, 0.2, 0.4], [0.7, 1.2, 0.3, 1.5]].concat(), [0.1, 0.0, 0.0]),
        ("chain with a spline joint", &splines, [[0.5, 0.1, 0.2, 0.4], [0.7, 1.2, 0.3, 1.5]].concat(), [0.1, 0.0, 0.0]),
    ];
    for (name, model, start, pivot) in cases {
        let (energy, momentum) = conserved(model, &start, pivot);
        let duration = if name == "top" { 0.08 } else { 0.2 };
        for stages in 1..=3 {
            let counts: [usize; 3] = if stages == 3 { [2, 4, 8] } else { [16, 32, 64] };
            let errors = counts.map(|n| {
                let end = forward(model, n, stages, (0.0, duration), start.clone());
                let (e, m) = conserved(model, &end, pivot);
                [((e - energy) / energy.abs().max(1.0)).abs(), ((m - momentum) / momentum.abs().max(1.0)).abs()]
            });
            for (what, k) in [("energy", 0), ("momentum", 1)] {
                let error = errors.map(|e| e[k]);
                let order = (error[1] / error[2]).log2();
                println!("{name}, {stages} stage(s), {what}: {error:?}, order {order:.2}");
                let textbook = (2 * stages - 1) as f64;
                // At rounding level, the order cannot be observed.
                assert!(error[2] < 1e-11 || order > textbook - 0.4, "{name} {stages} {what} {error:?} {order}");
            }
            assert!(errors[2][0] < [2e-2, 1e-5, 1e-7][stages - 1], "{name}, {stages} stage(s): {errors:?}");
        }
    }
}

/// The unknowns of a pose; of a ball joint its angles.
fn unknowns(spatial: &Spatial, pose: &[f64]) -> Vec<f64> {
    let linkage = &spatial.linkage;
    let mut all = pose.to_vec();
    for ball in &linkage.balls {
        all.extend(ball.angles(&spatial.skeleton.joints[ball.joint].motion.frame(pose), [0.0; 3]));
    }
    linkage.free.iter().map(|&c| all[c]).collect()
}

#[test]
fn lengths_of_spatial_paths_have_their_derivatives() {
    let text = std::fs::read_to_string(super::support::root().join("data/models/upper_limb.toml")).unwrap();
    let file: SkeletonFile = toml::from_str(&text).unwrap();
    let skeleton = std::sync::Arc::new(file.check().unwrap());
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(31);
    let model = Model::of_skeleton(skeleton.clone());
    let spatial = model.spatial().unwrap();
    let mut compared = 0;
    for _ in 0..60 {
        let mut pose = skeleton.default_pose();
        for (name, value) in [("plane_elv", 0.4), ("shoulder_elv", 1.0), ("axial_rot", 0.3), ("elbow_flexion", 1.0)] {
            pose[skeleton.coordinate(name).unwrap()] = value + rng.random_range(-0.4..0.4);
        }
        let q = unknowns(spatial, &pose);
        for muscle in &model.muscles {
            let sinew::internals::model::path::Path::Spatial(path) = &muscle.path else { unreachable!() };
            let evaluate = |q: &[f64]| {
                let (mut exact, mut plain) = (muscle.path.buffer(), muscle.path.buffer());
                let touched = path.length(q, true, &mut exact);
                path.length(q, false, &mut plain);
                assert!((exact.value - plain.value).abs() < 1e-12);
                (exact, plain, touched)
            };
            let (exact, plain, touched) = evaluate(&q);
            let n = path.slots.len();
            for i in 0..n {
                let gap = (exact.gradient[i] - plain.gradient[i]).abs();
                assert!(gap < 1e-9, "{} {i}: {} {}", muscle.name, exact.gradient[i], plain.gradient[i]);
                let e = 1e-6;
                let shifted = |e: f64| {
                    let mut q = q.clone();
                    q[path.slots[i]] += e;
                    evaluate(&q)
                };
                let (up, down) = (shifted(e), shifted(-e));
                let slope = (up.0.value - down.0.value) / (2.0 * e);
                assert!((slope - exact.gradient[i]).abs() < 1e-6, "{} {i} {slope} {}", muscle.name, exact.gradient[i]);
                for j in 0..n {
                    let bend = (up.0.gradient[j] - down.0.gradient[j]) / (2.0 * e);
                    let size = 1.0 + exact.hessian[i * n + i].abs().max(exact.hessian[j * n + j].abs());
                    let value = exact.hessian[i * n + j];
                    assert!((bend - value).abs() < 1e-6 * size, "{} {i} {j} {bend} {value} {touched:?}", muscle.name);
                    compared += 1;
                }
            }
        }
    }
    assert!(compared > 10_000, "{compared}");
}

/// A hinge and a ball joint, with a path that has points which come and go and which move, one with the elevation of the ball,
/// and a path through a torus.
const ODD_PATHS: &str = r#"
name = "odd paths"
dimensions = 3
body = [
    { name = "upper", mass = 2.0, centre_of_mass = [0.0, -0.15, 0.0], inertia = [0.02, 0.005, 0.02, 0.0, 0.0, 0.0] },
    { name = "lower", mass = 1.0, centre_of_mass = [0.0, -0.15, 0.0], inertia = [0.01, 0.002, 0.01, 0.0, 0.0, 0.0] },
]
coordinate = [{ name = "plane" }, { name = "elevation" }, { name = "spin" }, { name = "elbow" }]

[[joint]]
name = "shoulder"
kind = "axes"
ball = true
parent = "ground"
child = "upper"
rotations = [
    { coordinate = "plane", axis = [0.0, 1.0, 0.0] },
    { coordinate = "elevation", axis = [-1.0, 0.0, 0.0] },
    { coordinate = "spin", axis = [-0.08, 0.99, -0.06] },
]

[[joint]]
name = "elbow"
kind = "axes"
parent = "upper"
child = "lower"
parent_point = [0.0, -0.3, 0.0]
rotations = [{ coordinate = "elbow", axis = [0.0, 0.1, 1.0] }]

[[surface]]
name = "ring"
kind = "torus"
body = "upper"
point = [0.03, -0.2, 0.0]
rotation = [1.5707963267948966, 0.0, 0.0]
ring_radius = 0.02
radius = 0.004

[[muscle]]
name = "switched"
max_isometric_force = 100.0
optimal_fibre_length = 0.1
tendon_slack_length = 0.1
path = [
    { body = "ground", point = [0.05, 0.02, 0.03], y = { coordinate = "elevation", by = { polynomial = [0.0, 0.01, 0.004] } } },
    { body = "upper", point = [0.04, -0.1, 0.01], x = { coordinate = "elbow", by = { polynomial = [0.0, 0.005, -0.003] } } },
    { body = "upper", point = [0.05, -0.28, 0.0], when = { coordinate = "elbow", range = [0.5, 3.0] } },
    { body = "lower", point = [0.02, -0.05, 0.01] },
]

[[muscle]]
name = "ringed"
max_isometric_force = 100.0
optimal_fibre_length = 0.1
tendon_slack_length = 0.1
path = [{ body = "ground", point = [0.15, 0.02, 0.05] }, { body = "lower", point = [0.03, -0.06, 0.03] }]
surfaces = ["ring"]
"#;

#[test]
fn points_that_move_come_and_go_and_tori_have_their_derivatives() {
    let model = model(ODD_PATHS);
    assert_eq!(model.mechanics.coordinate_names(), ["shoulder_1", "shoulder_2", "shoulder_3", "elbow"]);
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(33);
    let (mut compared, mut between, mut ringed) = (0, 0, 0);
    for round in 0..60 {
        let mut q: Vec<f64> = (0..4).map(|_| rng.random_range(-0.7..0.7)).collect();
        // The elevation is singular where the arm hangs.
        q[0] += if q[0] < 0.0 { -0.2 } else { 0.2 };
        q[3] = if round % 2 == 0 { rng.random_range(0.46..0.54) } else { rng.random_range(0.0..1.5) };
        for muscle in &model.muscles {
            let sinew::internals::model::path::Path::Spatial(path) = &muscle.path else { unreachable!() };
            let evaluate = |q: &[f64], second: bool| {
                let mut out = muscle.path.buffer();
                let touched = path.length(q, second, &mut out);
                (out, touched)
            };
            let (exact, touched) = evaluate(&q, true);
            between += usize::from(muscle.name == "switched" && (q[3] - 0.5).abs() < 0.04);
            ringed += usize::from(!touched.is_empty());
            let n = path.slots.len();
            for i in 0..n {
                let e = 1e-5;
                let shifted = |e: f64| {
                    let mut q = q.clone();
                    q[path.slots[i]] += e;
                    evaluate(&q, false)
                };
                let ((up, up_touched), (down, down_touched)) = (shifted(e), shifted(-e));
                if up_touched != touched || down_touched != touched {
                    continue;
                }
                let slope = (up.value - down.value) / (2.0 * e);
                assert!((slope - exact.gradient[i]).abs() < 1e-7, "{} {i} {slope} {}", muscle.name, exact.gradient[i]);
                for j in 0..n {
                    let bend = (up.gradient[j] - down.gradient[j]) / (2.0 * e);
                    let value = exact.hessian[i * n + j];
                    let size = 1.0 + exact.hessian.iter().fold(0.0f64, |a, h| a.max(h.abs()));
                    let sharp = if touched.is_empty() { 1e-6 } else { 1e-4 };
                    assert!((bend - value).abs() < sharp * size, "{} {i} {j} {bend} {value}", muscle.name);
                    compared += 1;
                }
            }
        }
    }
    assert!(compared > 1500 && between > 20 && ringed > 10, "{compared} {between} {ringed}");
}

/// Sixth-order central differences: positions in steps, and weights.
const STENCIL: [(f64, f64); 6] =
    [(-3.0, -1.0 / 60.0), (-2.0, 0.15), (-1.0, -0.75), (1.0, 0.75), (2.0, -0.15), (3.0, 1.0 / 60.0)];
/// Step as a fraction of the path from pose to pose.
const STEP: f64 = 3e-6;

/// The second derivative of a shortest path jumps where contact begins or ends; that of a study's paths does not.
#[test]
fn second_derivatives_go_on_where_contact_comes_and_goes() {
    let text = std::fs::read_to_string(super::support::root().join("data/models/upper_limb.toml")).unwrap();
    let file: SkeletonFile = toml::from_str(&text).unwrap();
    let skeleton = std::sync::Arc::new(file.check().unwrap());
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(32);
    let model = Model::of_skeleton(skeleton.clone());
    let spatial = model.spatial().unwrap();
    let mut random = || {
        let mut pose = skeleton.default_pose();
        for (name, value) in [("plane_elv", 0.4), ("shoulder_elv", 1.0), ("axial_rot", 0.3), ("elbow_flexion", 1.0)] {
            pose[skeleton.coordinate(name).unwrap()] = value + rng.random_range(-0.9..0.9);
        }
        unknowns(spatial, &pose)
    };
    let (mut passed, mut jumps, mut worst) = (0, 0, 0.0f64);
    for _ in 0..12 {
        let (from, to) = (random(), random());
        let at = |t: f64| -> Vec<f64> { from.iter().zip(&to).map(|(a, b)| a + t * (b - a)).collect() };
        for muscle in &model.muscles {
            let sinew::internals::model::path::Path::Spatial(path) = &muscle.path else { unreachable!() };
            let evaluate = |t: f64| {
                let mut out = muscle.path.buffer();
                let touched = path.length(&at(t), true, &mut out);
                (out, touched)
            };
            let (mut low, mut high) = (0.0, 1.0);
            let before = evaluate(low).1;
            if evaluate(high).1 == before {
                continue;
            }
            while high - low > 1e-8 {
                let middle = 0.5 * (low + high);
                *(if evaluate(middle).1 == before { &mut low } else { &mut high }) = middle;
            }
            let (a, b) = (evaluate(low - 1e-7).0, evaluate(high + 1e-7).0);
            // The infraspinatus has two surfaces: its path changes sides, and its length jumps (README).
            if (a.value - b.value).abs() > 1e-5 {
                jumps += 1;
                continue;
            }
            passed += 1;
            // A path around two surfaces is found by alternating between them, and is less accurate.
            let sharp = if path.surfaces.len() == 1 { 1e-4 } else { 1e-3 };
            let size = a.hessian.iter().fold(1.0f64, |size, h| size.max(h.abs()));
            let gap = a.hessian.iter().zip(&b.hessian).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(gap < sharp * size, "{}: the Hessian jumps by {gap} of {size}", muscle.name);
            // All the way across, the gradient is the derivative of the value, and the Hessian that of the gradient.
            let way: Vec<f64> = path.slots.iter().map(|&slot| to[slot] - from[slot]).collect();
            for offset in [-3e-3, -1e-3, -3e-4, -1e-4, -1e-5, 0.0, 1e-5, 1e-4, 3e-4, 1e-3, 3e-3] {
                let centre = 0.5 * (low + high) + offset;
                let here = evaluate(centre).0;
                let around = STENCIL.map(|(k, weight)| (evaluate(centre + k * STEP).0, weight / STEP));
                let slope: f64 = around.iter().map(|(there, weight)| weight * there.value).sum();
                let along: f64 = here.gradient.iter().zip(&way).map(|(g, d)| g * d).sum();
                assert!((slope - along).abs() < 1e-6, "{} {offset}: {slope} {along}", muscle.name);
                for (j, row) in here.hessian.chunks_exact(way.len()).enumerate() {
                    let bend: f64 = around.iter().map(|(there, weight)| weight * there.gradient[j]).sum();
                    let along: f64 = row.iter().zip(&way).map(|(h, d)| h * d).sum();
                    worst = worst.max((bend - along).abs() / size);
                    assert!((bend - along).abs() < 1e-6 * size, "{} {offset} {j}: {bend} {along}", muscle.name);
                }
            }
        }
    }
    println!("{passed} contacts, worst {worst:.1e}");
    assert!(passed > 30 && jumps < passed / 3, "{passed} contacts, {jumps} jumps");
}

/// The upper limb in double poling, as set up for a job.
fn poling(girdle: &str, more: &str) -> sinew::internals::study::Study {
    let root = super::support::root().display();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("study.toml");
    let text = format!(
        "name = \"poling\"\nmodel = \"{root}/data/models/upper_limb.toml\"\n\
         motion = \"{root}/data/motions/double_poling.csv\"\n[base]\n\"body.clavicle,scapula.role\" = \"{girdle}\"\nh = 0.1\n\
         regularity = \"off\"\nbounds = \"both_boxed\"\n{more}"
    );
    std::fs::write(&path, text).unwrap();
    sinew::internals::study::Study::load(&path).unwrap()
}

#[test]
fn equations_of_every_girdle_have_their_derivatives() {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(41);
    for girdle in ["fixed", "given", "free"] {
        let study = poling(girdle, "");
        let job = &study.jobs[0];
        let model = study.model_of(job).unwrap();
        let prepared = prepare(&model, &study.motion, &job.settings, job.points);
        let (inverse, measurement) = (&prepared.inverse, &prepared.measurement);
        let motion = &inverse.motion;
        let mut z: Vec<f64> = (0..inverse.control.variables()).map(|_| rng.random_range(-0.2..0.2)).collect();
        let given = inverse.control.given_at(measurement.times[5]);
        z.iter_mut().zip(&given).filter(|(_, given)| **given != 0.0).for_each(|(z, given)| *z = *given);
        for (at, q) in motion.q.range().zip(&measurement.coordinates[5]) {
            z[at] = q + rng.random_range(-0.005..0.005);
        }
        let muscles = &inverse.muscles;
        for (span, range) in [(muscles.a, 0.1..1.0), (muscles.l, 0.7..1.2), (muscles.u, 0.1..1.0)] {
            span.range().for_each(|at| z[at] = rng.random_range(range.clone()));
        }
        let mut multipliers: Vec<f64> = (0..inverse.control.rows()).map(|_| rng.random_range(-1.0..1.0)).collect();
        multipliers[inverse.control.equation_rows()..].fill(0.0);
        let (nq, first) = (motion.q.count, motion.reactions.start);
        let which = |j: usize| j < nq || j.is_multiple_of(7) || j >= first;
        // A path around two surfaces is found by alternating between them and is no more accurate than this;
        // `lengths_of_spatial_paths_…` tests with 1e-6. Third derivatives of wrapped paths are themselves finite differences.
        check_derivatives(&inverse.control, &z, &multipliers, which, (3e-5, 1e-4));
    }
}

#[test]
fn the_motion_of_the_upper_limb_satisfies_its_joints_and_is_solved() {
    use sinew::internals::solve::solve;
    for girdle in ["fixed", "given", "free"] {
        let study = poling(girdle, "\"motion.abduction_offset_deg\" = 12.0\ntrajectories = true\n");
        let job = &study.jobs[0];
        let model = study.model_of(job).unwrap();
        let measurement = job.settings.of_motion().measure(&study.motion, &model, 61, Deadline::default()).unwrap();
        let prepared = prepare(&model, &study.motion, &job.settings, job.points);
        let inverse = &prepared.inverse;
        let coordinates = |t: f64, q: &[f64]| {
            let mut all = inverse.motion.all.of(&inverse.control.given_at(t)).to_vec();
            all[..q.len()].copy_from_slice(q);
            all
        };
        for (t, q) in measurement.times.iter().zip(&measurement.coordinates) {
            let all = coordinates(*t, q);
            model.mechanics.constraint_functions(&all, &mut |row, _, value, _, _| {
                assert!(value.abs() < 1e-6, "{girdle}: constraint {row} is {value} at {t} s");
            });
        }
        // The requested abduction is reached, in addition to the 30 degrees of the motion.
        let reached = |q: &[f64]| {
            let spatial = model.spatial().unwrap();
            spatial.turns_reached(&spatial.linkage.frames(q))[0].1
        };
        let turned = reached(&coordinates(measurement.times[60], &measurement.coordinates[60]));
        let plain = poling(girdle, "");
        let before =
            plain.jobs[0].settings.of_motion().measure(&study.motion, &model, 61, Deadline::default()).unwrap();
        let without = reached(&coordinates(before.times[60], &before.coordinates[60]));
        assert!((turned - without - 12f64.to_radians()).abs() < 1e-6, "{girdle}: {turned} {without}");
        if girdle != "free" {
            let outcome = solve(&model, &study.motion, &job.settings, job.points);
            assert_eq!(
                outcome.job.status,
                sinew::internals::outcome::Status::Converged,
                "{girdle}: {:?}",
                outcome.job.error
            );
            assert!(outcome.job.max_activation.unwrap() <= 1.0 + 1e-9);
            assert!(outcome.job.tracking_rms_deg.unwrap() < 8.0, "{girdle}: {:?}", outcome.job.tracking_rms_deg);
            assert!(outcome.trajectories.iter().any(|row| row.name == "abduction"));
        }
    }
}

#[test]
fn mistakes_in_spatial_studies_are_named() {
    let root = super::support::root().display();
    let motion = std::fs::read_to_string(super::support::root().join("data/motions/double_poling.csv")).unwrap();
    let header = motion.lines().find(|line| line.starts_with("time")).unwrap();
    let drop_column = |name: &str| motion.replace(header, &header.replace(name, &format!("#{name}")));
    let at = header.split(',').position(|name| name == "clav_elev_deg").unwrap();
    // The clavicle is raised by 10 degrees, the scapula is not.
    let raised: String = motion
        .lines()
        .map(|line| {
            let mut fields: Vec<String> = line.split(',').map(str::to_owned).collect();
            if let Some(value) =
                fields.get(at).filter(|_| !line.starts_with(['#', 't'])).and_then(|f| f.parse::<f64>().ok())
            {
                fields[at] = (value + 10.0).to_string();
            }
            fields.join(",") + "\n"
        })
        .collect();
    let cases = [
        ("an old key", "girdle = \"free\"", motion.clone(), vec!["base.girdle", "role"]),
        ("an unknown role", "\"body.scapula.role\" = \"held\"", motion.clone(), vec!["role", "fixed"]),
        ("a scaled turn", "\"motion.abduction_scale\" = 2.0", motion.clone(), vec!["_offset_deg"]),
        (
            "a coordinate that is missing",
            "",
            motion.replace("elbow_flexion_deg", "elbow_flexio_deg"),
            vec!["elbow_flexio_deg", "did you mean `elbow_flexion`"],
        ),
        ("a force of two columns", "", drop_column("pole_z_n"), vec!["pole_z_n"]),
        ("a motion that tears the shoulder apart", "", raised, vec!["acromioclavicular", "mm apart"]),
        ("an unknown muscle", "\"muscle.TeresMayor.max_isometric_force\" = 3.0", motion, vec!["TeresMajor"]),
    ];
    for (what, line, motion, expected) in cases {
        let folder = super::support::folder(&[]);
        std::fs::write(folder.path().join("motion.csv"), motion).unwrap();
        let text = format!(
            "name = \"x\"\nmodel = \"{root}/data/models/upper_limb.toml\"\nmotion = \"motion.csv\"\n[base]\n{line}\n"
        );
        let study = folder.path().join("study.toml");
        std::fs::write(&study, text).unwrap();
        let output = super::cli::sinew(&["plan", study.to_str().unwrap()], folder.path());
        let said = super::cli::text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{what}: {said}");
        for part in expected {
            assert!(said.contains(part), "{what}: `{part}` is not in: {said}");
        }
    }
}

#[test]
fn muscles_are_ranked_by_their_answer_to_a_change() {
    let root = super::support::root().display();
    let folder = super::support::folder(&[]);
    let study = folder.path().join("study.toml");
    let text = format!(
        "name = \"x\"\nmodel = \"{root}/data/models/arm.toml\"\nmotion = \"{root}/data/motions/arm_curl.csv\"\n\
         [sweep.grid]\nmu = [0.2, 0.4]\n\"muscle.biceps.tendon_slack_length_scale\" = [1.0, 0.9]\n"
    );
    std::fs::write(&study, text).unwrap();
    let out = folder.path().join("out");
    let (study, out) = (study.to_str().unwrap(), out.to_str().unwrap());
    assert_eq!(super::cli::sinew(&["run", study, "--out", out], folder.path()).status.code(), Some(0));
    let csv = folder.path().join("ranking.csv");
    let axis = "muscle.biceps.tendon_slack_length_scale";
    let rank = |reference: &str| {
        super::cli::sinew(
            &["rank", out, "--axis", axis, "--reference", reference, "--out", csv.to_str().unwrap()],
            folder.path(),
        )
    };
    assert_eq!(rank("1").status.code(), Some(0));
    let table = std::fs::read_to_string(&csv).unwrap();
    let rows: Vec<Vec<&str>> = table.lines().map(|line| line.split(',').collect()).collect();
    let column = |name: &str| rows[0].iter().position(|head| *head == name).unwrap();
    assert_eq!(rows.len(), 1 + 2 * 5, "{table}");
    let change = |row: &[&str]| row[column("change_mean_force_n")].parse::<f64>().unwrap();
    for block in rows[1..].chunks(5) {
        assert!(block.windows(2).all(|w| change(&w[0]).abs() >= change(&w[1]).abs()), "{table}");
        let biceps = block.iter().find(|row| row[column("muscle")] == "biceps").unwrap();
        assert!(change(biceps).abs() > 0.0);
        for row in block {
            let [before, after] =
                ["reference_mean_force_n", "mean_force_n"].map(|name| row[column(name)].parse::<f64>().unwrap());
            assert!((after - before - change(row)).abs() < 1e-9);
        }
    }
    let refused = rank("0.5");
    assert_eq!(refused.status.code(), Some(2));
    assert!(super::cli::text(&refused.stderr).contains("its values: 0.9, 1"), "{}", super::cli::text(&refused.stderr));
}
