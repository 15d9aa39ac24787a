//! Joint coordinates: frames, inverse dynamics and its derivatives, against what works them out in another way.

use nalgebra::{Matrix3, Vector3};
use num_dual::{Dual2_64, Dual64};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use sinew::internals::error::SourceFile;
use sinew::internals::model::tree::Tree;
use sinew::internals::model::tree::dynamics::{Dynamics, LEVELS, Level, Load, Point, State};
use sinew::internals::skeleton::Skeleton;
use sinew::internals::skeleton::file::SkeletonFile;
use sinew::internals::skeleton::frame::Frame;
use sinew::internals::study::load_skeleton;

use super::support::{root, shared};

/// A moving base, a hinge with a spline, sliding by splines, a coordinate that follows another one, an ellipsoid, a weld.
const ODD: &str = r#"
name = "odd"
dimensions = 3
body = [
    { name = "base", mass = 3.0, centre_of_mass = [0.1, 0.02, -0.05], inertia = [0.05, 0.04, 0.03, 0.001, 0.002, -0.001] },
    { name = "shank", mass = 1.2, centre_of_mass = [0.0, -0.2, 0.01], inertia = [0.02, 0.003, 0.02, 0.0, 0.001, 0.0] },
    { name = "cap", mass = 0.1, centre_of_mass = [0.0, 0.0, 0.0], inertia = [1e-4, 1e-4, 1e-4, 0.0, 0.0, 0.0] },
    { name = "blade", mass = 0.5, centre_of_mass = [0.02, 0.0, 0.03], inertia = [2e-3, 1e-3, 2e-3, 1e-4, 0.0, 0.0] },
    { name = "lump", mass = 0.3, centre_of_mass = [0.0, 0.1, 0.0], inertia = [1e-3, 1e-3, 1e-3, 0.0, 0.0, 0.0] },
]
coordinate = [
    { name = "tx" }, { name = "tilt" }, { name = "list" },
    { name = "knee" },
    { name = "cap_angle", follows = { coordinate = "knee", by = { polynomial = [0.1, 0.4, -0.2, 0.1] } } },
    { name = "abduction" }, { name = "elevation" }, { name = "upward" }, { name = "winging" },
]

[[joint]]
name = "root"
kind = "axes"
parent = "ground"
child = "base"
translations = [{ coordinate = "tx", axis = [1.0, 0.0, 0.0] }]
rotations = [{ coordinate = "tilt", axis = [0.0, 0.0, 1.0] }, { coordinate = "list", axis = [1.0, 0.0, 0.0] }]

[[joint]]
name = "knee"
kind = "axes"
parent = "base"
child = "shank"
parent_point = [0.0, -0.4, 0.02]
parent_rotation = [0.1, 0.2, -0.1]
translations = [
    { coordinate = "knee", axis = [1.0, 0.0, 0.0], by = { spline = [[-3.0, 0.01], [-1.0, 0.02], [0.0, 0.005], [1.0, -0.01], [3.0, 0.0]] } },
    { coordinate = "knee", axis = [0.0, 1.0, 0.0], by = { polynomial = [0.0, 0.01, 0.02, -0.01] } },
]
rotations = [
    { coordinate = "knee", axis = [0.0, 0.1, 1.0] },
    { coordinate = "knee", axis = [1.0, 0.0, 0.0], by = { spline = [[-3.0, 0.1], [-1.0, 0.0], [0.0, 0.0], [1.0, 0.2], [3.0, 0.1]] } },
]

[[joint]]
name = "cap"
kind = "axes"
parent = "shank"
child = "cap"
rotations = [{ coordinate = "cap_angle", axis = [0.0, 0.0, 1.0] }]

[[joint]]
name = "slide"
kind = "ellipsoid"
parent = "base"
child = "blade"
radii = [0.1, 0.2, 0.15]
coordinates = ["abduction", "elevation", "upward", "winging"]
parent_point = [0.0, 0.3, 0.0]
child_point = [0.01, -0.02, 0.0]

[[joint]]
name = "glued"
kind = "weld"
parent = "blade"
child = "lump"
parent_point = [0.0, 0.05, 0.02]
"#;

fn skeleton(text: &str) -> Skeleton {
    toml::from_str::<SkeletonFile>(text).unwrap().check().unwrap()
}

fn skeletons() -> Vec<Skeleton> {
    let upper_limb = std::fs::read_to_string(root().join("data/models/upper_limb.toml")).unwrap();
    let mut all = vec![skeleton(ODD), skeleton(&upper_limb)];
    for file in [
        "walking/subject_walk_scaled.osim",
        "osim/field/rat_hindlimb.osim",
        "osim/field/das3.osim",
        "osim/field/mobl_arms_41.osim",
    ] {
        if let Some(path) = shared(file) {
            all.push(load_skeleton(&SourceFile::read(&path).unwrap()).unwrap().1);
        }
    }
    all
}

/// Values, speeds and accelerations of all coordinates, and virtual speeds; dependent ones follow.
struct Random {
    values: [Vec<f64>; 4],
}

impl Random {
    fn new(skeleton: &Skeleton, generator: &mut StdRng) -> Self {
        let pose = skeleton.default_pose();
        let n = pose.len();
        let mut values =
            [0.4, 1.0, 1.0, 1.0].map(|size| (0..n).map(|_| generator.random_range(-size..size)).collect::<Vec<f64>>());
        values[0].iter_mut().zip(&pose).for_each(|(q, default)| *q += default);
        Self { values }
    }

    fn state(&self) -> State<'_> {
        let [coordinates, speeds, accelerations, virtual_speeds] = &self.values;
        State { coordinates, speeds, accelerations, virtual_speeds }
    }
}

/// Some loads of both kinds, on every third link.
fn loads(tree: &Tree, generator: &mut StdRng) -> Vec<Load> {
    let mut vector = |size: f64| [0; 3].map(|_| generator.random_range(-size..size));
    let load = |link: usize| {
        let point = vector(0.3);
        let point = if link.is_multiple_of(2) { Point::OfLink(point) } else { Point::OfGround(point) };
        Load { link, point, force: vector(5.0), moment: vector(1.0) }
    };
    (0..tree.links.len()).step_by(3).map(load).collect()
}

fn axes<T: Copy>(frame: &Frame<T>, part: impl Fn(&T) -> f64) -> Matrix3<f64> {
    Matrix3::from_fn(|i, j| part(&frame.axes[i][j]))
}

/// The vector w of `w × = S`.
fn vector(s: Matrix3<f64>) -> Vector3<f64> {
    0.5 * Vector3::new(s[(2, 1)] - s[(1, 2)], s[(0, 2)] - s[(2, 0)], s[(1, 0)] - s[(0, 1)])
}

/// Generalised forces from the bodies' accelerations and partial velocities (Kane's equations), by dual numbers.
fn by_kane(skeleton: &Skeleton, random: &Random) -> Vec<f64> {
    let n = skeleton.coordinates.len();
    let [q, speeds, accelerations, _] = &random.values;
    let mut over_time: Vec<Dual2_64> = (0..n).map(|c| Dual2_64::new(q[c], speeds[c], accelerations[c])).collect();
    skeleton.follow(&mut over_time);
    let moving = skeleton.frames(&over_time);
    let mut forces = vec![0.0; n];
    for (c, force) in forces.iter_mut().enumerate().filter(|(c, _)| skeleton.coordinates[*c].follows.is_none()) {
        let mut seeded: Vec<Dual64> = q.iter().enumerate().map(|(k, q)| Dual64::new(*q, f64::from(k == c))).collect();
        skeleton.follow(&mut seeded);
        for ((body, frame), partial) in skeleton.bodies.iter().zip(&moving).zip(skeleton.frames(&seeded)) {
            let centre = frame.point(&body.centre_of_mass.map(Dual2_64::from));
            let slope = partial.point(&body.centre_of_mass.map(Dual64::from));
            let [xx, yy, zz, xy, xz, yz] = body.inertia;
            let own = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
            let [turned, rate, second] = [axes(frame, |x| x.re), axes(frame, |x| x.v1), axes(frame, |x| x.v2)];
            let spin = rate * turned.transpose();
            let omega = vector(spin);
            let change = vector(second * turned.transpose() + rate * rate.transpose());
            let inertia = turned * own * turned.transpose();
            let moment = inertia * change + omega.cross(&(inertia * omega));
            let partial_turn = vector(axes(&partial, |x| x.eps) * turned.transpose());
            *force += moment.dot(&partial_turn);
            *force += (0..3).map(|i| body.mass * (centre[i].v2 - skeleton.gravity[i]) * slope[i].eps).sum::<f64>();
        }
    }
    forces
}

#[test]
fn links_carry_the_bodies_of_the_skeleton() {
    let mut generator = StdRng::seed_from_u64(1);
    for skeleton in skeletons() {
        let tree = Tree::new(&skeleton);
        let random = Random::new(&skeleton, &mut generator);
        let mut pose = random.values[0].clone();
        skeleton.follow(&mut pose);
        let dynamics = Dynamics::new(&tree, random.state(), &[]);
        let links: Vec<&Frame<f64>> = dynamics.frames().collect();
        for (b, (expected, (link, inner))) in skeleton.frames(&pose).iter().zip(&tree.places).enumerate() {
            let found = link.map_or_else(Frame::identity, |link| *links[link]) * *inner;
            let pairs = expected.axes.iter().flatten().zip(found.axes.iter().flatten());
            for (one, other) in pairs.chain(expected.origin.iter().zip(&found.origin)) {
                assert!((one - other).abs() < 1e-12, "{}: {one} {other}", skeleton.bodies[b].name);
            }
        }
    }
}

#[test]
fn inverse_dynamics_is_that_of_kanes_equations() {
    let mut generator = StdRng::seed_from_u64(2);
    for skeleton in skeletons() {
        let tree = Tree::new(&skeleton);
        let random = Random::new(&skeleton, &mut generator);
        let found = Dynamics::new(&tree, random.state(), &[]).generalised_forces();
        let scale = found.iter().fold(1e-3f64, |a, f| a.max(f.abs()));
        for (c, (one, other)) in found.iter().zip(by_kane(&skeleton, &random)).enumerate() {
            assert!((one - other).abs() < 1e-11 * scale, "{}: {one} {other}", skeleton.coordinates[c].name);
        }
    }
}

/// A load does the virtual work of its force and moment.
#[test]
fn loads_do_their_virtual_work() {
    let mut generator = StdRng::seed_from_u64(3);
    let skeleton = skeleton(ODD);
    let tree = Tree::new(&skeleton);
    let random = Random::new(&skeleton, &mut generator);
    let loads = loads(&tree, &mut generator);
    let with = Dynamics::new(&tree, random.state(), &loads);
    let without = Dynamics::new(&tree, random.state(), &[]);
    let links: Vec<Frame<f64>> = without.frames().copied().collect();
    for c in 0..tree.coordinates {
        let h = 1e-6;
        let moved = |sign: f64| {
            let mut values = random.values.clone();
            values[0][c] += sign * h;
            let random = Random { values };
            Dynamics::new(&tree, random.state(), &[]).frames().copied().collect::<Vec<_>>()
        };
        let (low, high) = (moved(-1.0), moved(1.0));
        let work: f64 = (loads.iter())
            .map(|load| {
                let k = load.link;
                let point = match load.point {
                    Point::OfLink(point) => point,
                    Point::OfGround(point) => links[k].inverse().point(&point),
                };
                let (a, b) = (low[k].point(&point), high[k].point(&point));
                let turn =
                    vector((axes(&high[k], |x| *x) - axes(&low[k], |x| *x)) * axes(&links[k], |x| *x).transpose());
                let of_force: f64 = (0..3).map(|i| load.force[i] * (b[i] - a[i])).sum();
                (of_force + turn.dot(&Vector3::from(load.moment))) / (2.0 * h)
            })
            .sum();
        let found = without.generalised_forces()[c] - with.generalised_forces()[c];
        assert!((found - work).abs() < 1e-7, "{}: {found} {work}", skeleton.coordinates[c].name);
    }
}

/// First derivatives of the forces, and second ones of λᵀ forces, against central differences.
#[test]
fn derivatives_agree_with_differences() {
    let mut generator = StdRng::seed_from_u64(4);
    for skeleton in skeletons() {
        let tree = Tree::new(&skeleton);
        let random = Random::new(&skeleton, &mut generator);
        let loads = loads(&tree, &mut generator);
        let n = tree.coordinates;
        let index = |(level, c): (Level, usize)| level as usize * n + c;
        let all = |random: &Random| {
            let mut out = vec![0.0; 16 * n * n];
            let pairs: Vec<(Level, Level)> = LEVELS.iter().flat_map(|&p| LEVELS.map(|q| (p, q))).collect();
            let links = vec![true; tree.links.len()];
            Dynamics::new(&tree, random.state(), &loads)
                .second_derivatives(&links, &pairs, &mut |p, q, value| out[index(p) * 4 * n + index(q)] += value);
            out
        };
        let found = all(&random);
        let scale = found.iter().fold(1.0f64, |a, x| a.max(x.abs()));
        for level in 0..3 {
            for c in 0..n {
                let h = 1e-5;
                let moved = |sign: f64| {
                    let mut values = random.values.clone();
                    values[level][c] += sign * h;
                    Random { values }
                };
                let (low, high) = (moved(-1.0), moved(1.0));
                let forces = [&low, &high].map(|r| Dynamics::new(&tree, r.state(), &loads).generalised_forces());
                // λᵀ ∂forces/∂p is linear in λ: its slope comes from the mixed block at both ends.
                let (before, after) = (all(&low), all(&high));
                for row in 0..n {
                    let at = (3 * n + row) * 4 * n + level * n + c;
                    let slope = (forces[1][row] - forces[0][row]) / (2.0 * h);
                    assert!(
                        (found[at] - slope).abs() < 1e-6 * scale,
                        "{} {level} {c} {row}: {} {slope}",
                        skeleton.name,
                        found[at]
                    );
                    for other in 0..3 {
                        let gradient = |of: &[f64]| -> f64 {
                            (0..n).map(|k| random.values[3][k] * of[(3 * n + k) * 4 * n + other * n + row]).sum()
                        };
                        let bend = (gradient(&after) - gradient(&before)) / (2.0 * h);
                        let at = (other * n + row) * 4 * n + level * n + c;
                        assert!(
                            (found[at] - bend).abs() < 1e-5 * scale,
                            "{}: levels {other} {level} of {row} {c}: {} {bend}",
                            skeleton.name,
                            found[at]
                        );
                    }
                }
            }
        }
    }
}
