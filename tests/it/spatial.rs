//! Spatial models: frames, paths around surfaces, lengths and moment arms.

use std::collections::BTreeMap;

use rand::{RngExt, SeedableRng};
use sinew::internals::error::SourceFile;
use sinew::internals::skeleton::Skeleton;
use sinew::internals::skeleton::file::SkeletonFile;
use sinew::internals::skeleton::frame::{Vector, cross, dot, minus, norm, unit};
use sinew::internals::skeleton::surface::{Contact, Shape, Side};

use super::cli::{sinew, text};
use super::support::{folder, root, shared};

fn upper_limb() -> Skeleton {
    let path = root().join("data/models/upper_limb.toml");
    SkeletonFile::load(&SourceFile::read(&path).unwrap()).unwrap_or_else(|e| panic!("{:?}", miette::Report::new(e)))
}

fn total(contact: Option<Contact>, a: &Vector, b: &Vector) -> f64 {
    contact.map_or_else(|| norm(&minus(b, a)), |c| norm(&minus(&c.first, a)) + c.length + norm(&minus(b, &c.last)))
}

/// Pairs of points on either side of a body of size about 1, so that many paths touch it.
fn pairs(count: usize) -> Vec<(Vector, Vector)> {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(5);
    let mut point =
        |side: f64| [side * rng.random_range(1.2..3.0), rng.random_range(-0.9..0.9), rng.random_range(-0.9..0.9)];
    (0..count).map(|_| (point(-1.0), point(1.0))).collect()
}

#[test]
fn an_ellipsoid_of_equal_radii_is_a_sphere_and_a_long_one_a_cylinder() {
    let (sphere, ball) = (Shape::Sphere { radius: 1.0, side: None }, Shape::Ellipsoid { radii: [1.0; 3], side: None });
    let (cylinder, long) = (
        Shape::Cylinder { radius: 1.0, side: None, length: f64::INFINITY },
        Shape::Ellipsoid { radii: [1.0, 1.0, 400.0], side: None },
    );
    let mut touched = 0;
    for (a, b) in pairs(300) {
        let (one, other) = (sphere.contact(&a, &b), ball.contact(&a, &b));
        assert_eq!(one.is_some(), other.is_some(), "{a:?} {b:?}");
        if let (Some(one), Some(other)) = (one, other) {
            touched += 1;
            assert!((one.length - other.length).abs() < 1e-7 && norm(&minus(&one.first, &other.first)) < 1e-7);
        }
        let (one, other) = (total(cylinder.contact(&a, &b), &a, &b), total(long.contact(&a, &b), &a, &b));
        assert!((one - other).abs() < 1e-4 * one, "{one} {other}");
    }
    assert!(touched > 100, "{touched}");
}

#[test]
fn ways_around_an_ellipsoid_leave_it_along_its_tangents_and_are_shortest_nearby() {
    let radii = [0.7, 1.6, 0.9];
    let shape = Shape::Ellipsoid { radii, side: None };
    let onto = |x: &Vector| {
        let size = norm(&[0, 1, 2].map(|i| x[i] / radii[i]));
        x.map(|x| x / size)
    };
    for (a, b) in pairs(200) {
        let Some(contact) = shape.contact(&a, &b) else { continue };
        for (from, at) in [(a, contact.first), (b, contact.last)] {
            let value: f64 = (0..3).map(|i| (at[i] / radii[i]).powi(2)).sum();
            let normal = unit(&[0, 1, 2].map(|i| at[i] / (radii[i] * radii[i])));
            assert!((value - 1.0).abs() < 1e-8, "on the surface");
            assert!(dot(&normal, &minus(&at, &from)).abs() < 1e-8, "tangent to it");
        }
        // A fine polygon on the surface, through the two contacts and any third point near the middle, is not shorter.
        let own = total(Some(contact), &a, &b);
        let middle = onto(&[0, 1, 2].map(|i| 0.5 * (contact.first[i] + contact.last[i])));
        let sideways = unit(&cross(&minus(&contact.last, &contact.first), &middle));
        for shift in [-0.1, -0.03, 0.03, 0.1] {
            let other = onto(&[0, 1, 2].map(|i| middle[i] + shift * sideways[i]));
            let way = norm(&minus(&other, &a)).max(0.0) + norm(&minus(&b, &other));
            // (A straight line through the ellipsoid is shorter than this part can be: compare only lines that stay
            // outside.)
            let outside = |p: &Vector, q: &Vector| {
                (1..50).all(|k| {
                    let x = [0, 1, 2].map(|i| p[i] + f64::from(k) / 50.0 * (q[i] - p[i]));
                    (0..3).map(|i| (x[i] / radii[i]).powi(2)).sum::<f64>() >= 1.0
                })
            };
            if outside(&a, &other) && outside(&other, &b) {
                assert!(way >= own - 1e-9, "{way} {own}");
            }
        }
    }
}

#[test]
fn a_one_sided_cylinder_is_passed_on_its_side_only() {
    let on = |sign: f64| Shape::Cylinder { radius: 1.0, side: Some(Side { axis: 1, sign }), length: f64::INFINITY };
    // A line that passes above the axis without touching.
    let (a, b) = ([-3.0, 2.0, 0.0], [3.0, 2.0, 1.0]);
    assert_eq!(on(1.0).contact(&a, &b), None);
    let below = on(-1.0).contact(&a, &b).unwrap();
    assert!(below.first[1].max(below.last[1]) < 0.0, "it goes below");
    // The path is as long as the string on the developed surface.
    let across = 2.0 * (13.0f64 - 1.0).sqrt();
    let arc = std::f64::consts::TAU - 2.0 * (3.0f64.atan2(2.0)) - 2.0 * (1.0 / 13f64.sqrt()).acos();
    assert!((total(Some(below), &a, &b) - (across + arc).hypot(1.0)).abs() < 1e-12);
}

#[test]
fn moment_arms_are_the_slopes_of_lengths_and_lengths_do_not_jump() {
    let skeleton = upper_limb();
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(8);
    // Move the girdle only little: an insertion inside the thorax would have no path around it.
    let names = ["plane_elv", "shoulder_elv", "axial_rot", "elbow_flexion"];
    let (mut compared, mut changes) = (0, 0);
    for _ in 0..6 {
        // Sweep one coordinate in small steps from a random pose.
        let mut q = skeleton.default_pose();
        for name in names {
            q[skeleton.coordinate(name).unwrap()] += rng.random_range(-0.3..0.6);
        }
        let k = skeleton.coordinate(names[rng.random_range(0..4)]).unwrap();
        const STEP: f64 = 4e-3;
        let sweep: Vec<_> = (0..150)
            .map(|i| {
                let mut q = q.clone();
                q[k] += f64::from(i) * STEP;
                let frames = skeleton.frames(&q);
                let touched: Vec<_> =
                    skeleton.muscles.iter().map(|m| m.path.route(&skeleton, &q, &frames).touched).collect();
                (skeleton.lengths_and_moment_arms(&q), touched)
            })
            .collect();
        for m in 0..skeleton.muscles.len() {
            for pair in sweep.windows(2) {
                let ((old, old_touched), (new, new_touched)) = (&pair[0], &pair[1]);
                let change = new[m].0 - old[m].0;
                let slopes = -0.5 * STEP * (old[m].1[k] + new[m].1[k]);
                changes += usize::from(old_touched[m] != new_touched[m]);
                if skeleton.muscles[m].name.starts_with("Infraspinatus") {
                    continue; // its way around the humeral head changes sides, which is not smooth yet
                }
                // The error of the trapezoidal rule is of third order in the step, and of second order where contact
                // begins.
                let most = if old_touched[m] == new_touched[m] { 2e-6 } else { 8e-6 };
                assert!((change - slopes).abs() < most, "{}: {change} {slopes}", skeleton.muscles[m].name);
                compared += 1;
            }
        }
        // Compare with finite differences at the pose itself, for all coordinates.
        let exact = skeleton.lengths_and_moment_arms(&q);
        for k in 0..q.len() {
            let at = |by: f64| {
                let mut q = q.clone();
                q[k] += by;
                skeleton.lengths_and_moment_arms(&q)
            };
            let (up, down) = (at(1e-5), at(-1e-5));
            for m in 0..skeleton.muscles.len() {
                let difference = -(up[m].0 - down[m].0) / 2e-5;
                let size = exact[m].1[k].abs().max(0.01);
                assert!((difference - exact[m].1[k]).abs() < 1e-6 * size, "{} {}", skeleton.muscles[m].name, k);
            }
        }
    }
    assert!(compared > 30_000 && changes >= 10, "{compared} {changes}");
}

/// Largest length error (mm) and RMS error of the moment arms (mm) by muscle, over the poses where OpenSim has no jump.
fn against_opensim(sample: &str) -> BTreeMap<String, (f64, f64)> {
    let skeleton = upper_limb();
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).from_reader(sample.as_bytes());
    let header = reader.headers().unwrap().clone();
    let mut sums: BTreeMap<String, (f64, f64, f64)> = BTreeMap::new();
    for record in reader.records() {
        let record = record.unwrap();
        let field = |name: &str| &record[header.iter().position(|h| h == name).unwrap()];
        let number = |name: &str| field(name).parse::<f64>().unwrap();
        if field("smooth_ok") != "1" {
            continue;
        }
        let mut q = skeleton.default_pose();
        for (name, value) in header.iter().zip(&record) {
            if let Some(k) = name.strip_suffix("_deg").and_then(|name| skeleton.coordinate(name)) {
                q[k] = value.parse::<f64>().unwrap().to_radians();
            }
        }
        let m = skeleton.muscles.iter().position(|muscle| muscle.name == field("muscle")).unwrap();
        let (length, arms) = &skeleton.lengths_and_moment_arms(&q)[m];
        let entry = sums.entry(field("muscle").to_owned()).or_default();
        entry.0 = entry.0.max(1e3 * (length - number("length_m")).abs());
        for name in ["plane_elv", "shoulder_elv", "axial_rot", "elbow_flexion"] {
            let arm = arms[skeleton.coordinate(name).unwrap()];
            entry.1 += (1e3 * (arm - number(&format!("fd_{name}_m")))).powi(2);
            entry.2 += 1.0;
        }
    }
    sums.into_iter().map(|(name, (length, squares, n))| (name, (length, (squares / n).sqrt()))).collect()
}

/// Muscles whose path in OpenSim cuts through a surface in some poses, see the README.
const CUT_THROUGH: [&str; 3] = ["Infraspinatus_I", "Infraspinatus_S", "Subscapularis_S"];

fn within_limits(found: &BTreeMap<String, (f64, f64)>) {
    assert_eq!(found.len(), 36);
    for (name, (length, arm)) in found.iter().filter(|(name, _)| !CUT_THROUGH.contains(&name.as_str())) {
        assert!(*length <= 0.5 && *arm <= 1.0, "{name}: {length} mm, {arm} mm");
    }
}

#[test]
fn lengths_and_moment_arms_are_opensims_in_seven_poses() {
    within_limits(&against_opensim(&std::fs::read_to_string(root().join("data/upper_limb_sample.csv")).unwrap()));
}

#[test]
fn lengths_and_moment_arms_are_opensims_in_fifty_poses() {
    let Some(path) = shared("upper_limb/moment_arms_opensim_sample.csv") else { return };
    let found = against_opensim(&std::fs::read_to_string(path).unwrap());
    for (name, (length, arm)) in &found {
        eprintln!("{name:26} length within {length:6.3} mm, moment arms RMS {arm:6.3} mm");
    }
    within_limits(&found);
}

#[test]
fn the_command_reads_poses_and_writes_csv_and_parquet() {
    let poses = "note,shoulder_elv_deg,elbow_flexion_deg\na,30,90\nb,60,10\n";
    let folder = folder(&[("poses.csv", poses)]);
    let model = root().join("data/models/upper_limb.toml");
    let run =
        |arguments: &[&str]| sinew(&[&["moment-arms", model.to_str().unwrap()], arguments].concat(), folder.path());
    let plain = run(&["poses.csv"]);
    assert_eq!(plain.status.code(), Some(0), "{}", text(&plain.stderr));
    let table = text(&plain.stdout);
    assert!(table.starts_with("pose,muscle,length_m,moment_arm_") && table.lines().count() == 1 + 2 * 36);
    assert!(table.contains(",moment_arm_elbow_flexion_m"));
    assert_eq!(run(&["poses.csv", "--out", "a.csv"]).status.code(), Some(0));
    assert_eq!(std::fs::read_to_string(folder.path().join("a.csv")).unwrap().trim_end(), table.trim_end());
    assert_eq!(run(&["poses.csv", "--out", "a.parquet"]).status.code(), Some(0));
    let parquet = sinew::internals::tables::read("moment_arms", &folder.path().join("a.parquet")).unwrap();
    assert_eq!((parquet.rows(), parquet.integer("pose", 71)), (72, Some(1)));
    for (poses, says) in [
        ("shoulder_elev_deg\n1\n", "did you mean `shoulder_elv_deg`"),
        ("shoulder_elv_m\n1\n", "not a coordinate"),
        ("shoulder_elv_deg\nmany\n", "line 2"),
        ("shoulder_elv_deg\n1,2\n", "line 2"),
        ("a,b\n1,2\n", "no column is a coordinate"),
    ] {
        std::fs::write(folder.path().join("bad.csv"), poses).unwrap();
        let bad = run(&["bad.csv"]);
        assert_eq!(bad.status.code(), Some(2));
        assert!(text(&bad.stderr).contains(says), "{poses}: {}", text(&bad.stderr));
    }
    assert_eq!(run(&["poses.csv", "--out", "a.txt"]).status.code(), Some(2));
}

#[test]
fn mistakes_in_spatial_models_are_named() {
    let whole = std::fs::read_to_string(root().join("data/models/upper_limb.toml")).unwrap();
    for (from, to, says) in [
        ("mass = 20.866630056", "mass = -1.0", &["body.thorax.mass", "positive number (kg)"][..]),
        (
            "inertia = [1.014231276, 0.431566181,",
            "inertia = [1.0, -0.4,",
            &["body.thorax.inertia", "positive definite"],
        ),
        ("child = \"ulna\"", "child = \"unla\"", &["joint.elbow.child", "did you mean `ulna`"]),
        ("child = \"ulna\"", "child = \"scapula\"", &["is the child of two joints"]),
        ("parent = \"ulna\"", "parent = \"hand\"", &["is not connected to the ground"]),
        ("dimensions = 3", "dimensions = 2", &["dimensions", "found 2"]),
        ("name = \"pro_sup\"", "name = \"supination\"", &["there is no coordinate `pro_sup`"]),
        ("side = \"-y\"", "side = \"-z\"", &["found \"-z\"", "x, -x, y, -y"]),
        ("kind = \"sphere\"", "kind = \"spere\"", &["unknown variant `spere`", "did you mean `sphere`"]),
        ("surfaces = [\"TRI\"]", "surfaces = [{ name = \"TRI\", part = 9 }]", &["parts 0 to 3"]),
    ] {
        assert!(whole.contains(from), "{from}");
        let folder = folder(&[("model.toml", &whole.replacen(from, to, 1))]);
        let check = sinew(&["check", "model.toml"], folder.path());
        let message = text(&check.stderr).replace(['\n', '│'], " ").split_whitespace().collect::<Vec<_>>().join(" ");
        assert_eq!(check.status.code(), Some(2), "{to}");
        assert!(says.iter().all(|part| message.contains(part)), "{to}: {message}");
    }
}
