//! Where paths wrap, and on which side: compares with lengths by hand, an independent test of tautness, and OpenSim's
//! own results.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::{PI, TAU};
use std::path::Path;

use rand::{RngExt, SeedableRng};
use sinew::internals::error::SourceFile;
use sinew::internals::skeleton::Skeleton;
use sinew::internals::skeleton::frame::{Frame, Vector, dot, minus, norm, unit};
use sinew::internals::skeleton::surface::{Contact, Shape, Side, Wrap};
use sinew::internals::skeleton::wrapping::{PlacedSurface, touches};
use sinew::internals::study::load_skeleton;

use super::cli::{sinew, text};
use super::support::{folder, root, shared};

fn total(contact: &Contact, a: &Vector, b: &Vector) -> f64 {
    norm(&minus(&contact.first, a)) + contact.length + norm(&minus(b, &contact.last))
}

fn side(axis: usize, sign: f64) -> Option<Side> {
    Some(Side { axis, sign })
}

/// Length of a string around a circle of radius r between points at distances d from the centre; the angle is at the
/// centre.
fn string(r: f64, d: [f64; 2], angle: f64) -> f64 {
    let free = d.map(|d| (d * d - r * r).sqrt());
    let arc = angle - (r / d[0]).acos() - (r / d[1]).acos();
    free[0] + free[1] + r * arc
}

#[test]
fn a_cylinder_with_a_side_is_wrapped_as_the_rules_of_its_table_say() {
    let on = |sign: f64| Shape::Cylinder { radius: 1.0, side: side(0, sign), length: f64::INFINITY };
    let far = 5f64.sqrt();
    // Both ends are on the given side, and the line misses: straight, not the long way round.
    assert_eq!(on(-1.0).wrap(&[-2.0, 1.0, 0.0], &[-2.0, -1.0, 0.0], None), Wrap::Missed);
    // The line runs through the cylinder: wrap on the given side, even if that is longer.
    let (a, b) = ([0.5, 2.0, 0.0], [0.5, -2.0, 0.0]);
    let contact = on(-1.0).contact(&a, &b).expect("it runs through");
    let d = 0.5f64.hypot(2.0);
    let angle = TAU - 2.0 * (2.0f64).atan2(0.5);
    assert!((total(&contact, &a, &b) - string(1.0, [d, d], angle)).abs() < 1e-12);
    assert!(contact.first[0] < 0.0 && contact.last[0] < 0.0);
    // An end is on the given side: it must wrap here.
    let (a, b) = ([-0.5, 2.0, 0.0], [2.0, -2.0, 0.0]);
    assert!(matches!(on(-1.0).wrap(&a, &b, None), Wrap::Certain(_)));
    // The line misses on the other side, with one end on this side: wrap, unless another segment has a shorter detour.
    let (a, b) = ([-0.5, 2.0, 0.0], [3.0, 0.5, 0.0]);
    assert!(matches!(on(-1.0).wrap(&a, &b, None), Wrap::Possible(_)), "{:?}", on(-1.0).wrap(&a, &b, None));
    // Neither end is on the given side: a loop around the axis, if necessary.
    let (a, b) = ([2.0, 1.0, 0.0], [2.0, -1.0, 0.0]);
    let Wrap::Possible(contact) = on(-1.0).wrap(&a, &b, None) else { panic!("it has to go around") };
    let around = string(1.0, [far, far], TAU - 2.0 * 1f64.atan2(2.0));
    assert!((total(&contact, &a, &b) - around).abs() < 1e-12);
    // An end is inside: there is no path.
    assert_eq!(on(1.0).wrap(&[0.5, 0.5, 0.0], &b, None), Wrap::Inside);
    // Beyond the ends of a short cylinder, the path is straight.
    let short = Shape::Cylinder { radius: 1.0, side: None, length: 1.0 };
    assert_eq!(short.wrap(&[-2.0, 0.1, 2.0], &[2.0, 0.1, 2.0], None), Wrap::Missed);
}

#[test]
fn a_sphere_and_an_ellipsoid_with_a_side_are_passed_on_it() {
    let (a, b) = ([-3.0, 0.2, 0.0], [3.0, 0.2, 0.0]);
    let d = 3f64.hypot(0.2);
    let angle = PI - 2.0 * 0.2f64.atan2(3.0);
    for (sign, angle) in [(1.0, angle), (-1.0, TAU - angle)] {
        let expected = string(1.0, [d, d], angle);
        let sphere = Shape::Sphere { radius: 1.0, side: side(1, sign) };
        let ball = Shape::Ellipsoid { radii: [1.0; 3], side: side(1, sign) };
        // Ends at y = 0.2 count as being on the side of +y, where the path on that side is the shorter one.
        for (shape, name) in [(&sphere, "sphere"), (&ball, "ball")] {
            let contact = shape.contact(&a, &b).expect("the line runs through");
            let found = total(&contact, &a, &b);
            assert!((found - expected).abs() < 1e-8, "{name} {sign}: {found}, by hand {expected}");
            assert!(sign * (contact.first[1] + contact.last[1]) > 0.0, "{name} {sign}");
        }
    }
    // A line that misses the sphere does not wrap, whatever the side.
    assert_eq!(
        Shape::Sphere { radius: 1.0, side: side(1, -1.0) }.wrap(&[-3.0, 1.5, 0.0], &[3.0, 1.5, 0.0], None),
        Wrap::Missed
    );
}

/// A line that is tangent within rounding stays straight, without a loop.
#[test]
fn a_tangent_of_a_cylinder_takes_no_loop() {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(4);
    for _ in 0..20_000 {
        let (sin, cos) = rng.random_range(0.0..TAU).sin_cos();
        let at = |t: f64| [cos - t * sin, sin + t * cos, 0.0];
        let (a, b) = (at(-rng.random_range(0.0..3.0)), at(rng.random_range(0.0..3.0)));
        for side in [None, side(0, if cos > 0.0 { 1.0 } else { -1.0 })] {
            let shape = Shape::Cylinder { radius: 1.0, side, length: f64::INFINITY };
            if let Wrap::Certain(contact) = shape.wrap(&a, &b, None) {
                assert!(total(&contact, &a, &b) < norm(&minus(&b, &a)) + 1e-6, "{side:?} {a:?} {b:?}");
            }
        }
    }
}

/// On a line through the centre, no side is nearer; the path takes the requested one.
#[test]
fn a_line_through_the_centre_of_an_ellipsoid_keeps_to_its_side() {
    let radii = [0.6, 0.8, 1.0];
    for (a, b) in
        [([-2.0, 0.0, 0.0], [2.0, 0.0, 0.0]), ([-2.0, 0.0, 0.5], [2.0, 0.0, -0.5]), ([0.0, 0.0, -2.0], [0.0, 0.0, 2.0])]
    {
        for sign in [-1.0, 1.0] {
            let shape = Shape::Ellipsoid { radii, side: side(1, sign) };
            let contact = shape.contact(&a, &b).expect("it runs through");
            assert!(sign * contact.first[1] > 0.1 && sign * contact.last[1] > 0.1, "{sign}: {contact:?}");
        }
    }
}

/// A path over three points around several surfaces cannot be shortened by moving its contacts, and cuts through none
/// of its surfaces.
#[test]
fn a_path_around_several_surfaces_is_taut() {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
    let mut around_two = 0;
    for _ in 0..400 {
        let mut place =
            |x: f64| Frame::placed([x, rng.random_range(-0.4..0.4), 0.0], [0.0, 0.0, rng.random_range(0.0..1.0)]);
        let frames = [place(-1.2), place(1.2)];
        let shapes = [
            Shape::Cylinder { radius: 0.7, side: None, length: f64::INFINITY },
            Shape::Cylinder { radius: 0.5, side: side(1, 1.0), length: f64::INFINITY },
        ];
        let surfaces: Vec<PlacedSurface<'_>> =
            frames.iter().zip(&shapes).map(|(&frame, shape)| PlacedSurface { frame, shape, segments: None }).collect();
        let mut point = |x: f64| [x, rng.random_range(-0.6..0.6), rng.random_range(-0.5..0.5)];
        let points = [point(-3.0), point(3.0)];
        let found = touches(&points, &surfaces, &[]);
        around_two += usize::from(found.len() == 2);
        let mut before = points[0];
        for (k, touch) in found.iter().enumerate() {
            let after = found.get(k + 1).map_or(points[1], |next| next.contact.first);
            let inward = frames[touch.surface].inverse();
            let [a, first, last, b] =
                [&before, &touch.contact.first, &touch.contact.last, &after].map(|x| inward.point(x));
            let radius = if touch.surface == 0 { 0.7 } else { 0.5 };
            for (end, contact) in [(a, first), (b, last)] {
                let normal = unit(&[contact[0], contact[1], 0.0]);
                assert!((contact[0].hypot(contact[1]) - radius).abs() < 1e-9, "on the surface");
                assert!(dot(&normal, &minus(&contact, &end)).abs() < 1e-9, "along its tangent");
            }
            // A helix continues the straight parts: their slope along the axis is the same.
            let slope = |x: &Vector, y: &Vector| (y[2] - x[2]) / (y[0] - x[0]).hypot(y[1] - x[1]);
            assert!((slope(&a, &first) - slope(&last, &b)).abs() < 1e-8, "{touch:?}");
            before = touch.contact.last;
        }
        // The straight part between both surfaces is outside both.
        if let [one, other] = &found[..] {
            for k in 1..20 {
                let x: Vector = std::array::from_fn(|i| {
                    one.contact.last[i] + f64::from(k) / 20.0 * (other.contact.first[i] - one.contact.last[i])
                });
                for (frame, radius) in frames.iter().zip([0.7, 0.5]) {
                    let inside = frame.inverse().point(&x);
                    assert!(inside[0].hypot(inside[1]) > radius - 1e-9);
                }
            }
        }
    }
    assert!(around_two > 100, "{around_two}");
}

/// A small OpenSim model: a muscle over three points on one body, with a cylinder that `wrap` describes.
fn model(points: [&str; 3], cylinder: &str, wrap: &str) -> Skeleton {
    let point = |(k, at): (usize, &&str)| {
        let body = if k == 2 { "/bodyset/b" } else { "/ground" };
        format!(
            "<PathPoint name=\"p{k}\"><socket_parent_frame>{body}</socket_parent_frame><location>{at}</location>\
             </PathPoint>"
        )
    };
    let points: String = points.iter().enumerate().map(point).collect();
    let text = format!(
        "<OpenSimDocument Version=\"40000\"><Model name=\"m\">
<Ground name=\"ground\"><WrapObjectSet name=\"w\"><objects><WrapCylinder name=\"c\">{cylinder}</WrapCylinder>\
</objects></WrapObjectSet></Ground>
<BodySet><objects><Body name=\"b\"><mass>1</mass><mass_center>0 0 0</mass_center><inertia>1 1 1 0 0 0</inertia>\
</Body></objects></BodySet>
<JointSet><objects><PinJoint name=\"j\"><socket_parent_frame>/ground</socket_parent_frame>\
<socket_child_frame>/bodyset/b</socket_child_frame>
<coordinates><Coordinate name=\"q\"/></coordinates></PinJoint></objects></JointSet>
<ForceSet><objects><Thelen2003Muscle name=\"m\"><GeometryPath name=\"p\"><PathPointSet><objects>{points}</objects>\
</PathPointSet>
<PathWrapSet><objects><PathWrap name=\"pw\"><wrap_object>c</wrap_object>{wrap}</PathWrap></objects></PathWrapSet>\
</GeometryPath></Thelen2003Muscle></objects></ForceSet>
</Model></OpenSimDocument>"
    );
    load_skeleton(&SourceFile { path: "m.osim".into(), text })
        .unwrap_or_else(|e| panic!("{:?}", miette::Report::new(e)))
        .1
}

fn length(model: &Skeleton) -> f64 {
    model.lengths_and_moment_arms(&model.default_pose())[0].0
}

#[test]
fn a_point_inside_a_surface_and_the_range_of_a_wrap_leave_out_their_segments_only() {
    let cylinder = "<quadrant>all</quadrant><radius>0.04</radius><length>1</length>";
    let any = "<range>-1 -1</range>";
    // The second segment runs through the cylinder: it wraps.
    let around = string(0.04, [0.1; 2], PI) + 0.1;
    let through = ["-0.1 0.1 0", "-0.1 0 0", "0.1 1e-9 0"];
    assert!((length(&model(through, cylinder, any)) - around).abs() < 1e-8);
    // It does not wrap if the cylinder is in the way of the first segment only.
    assert!((length(&model(through, cylinder, "<range>1 2</range>")) - 0.3).abs() < 1e-8);
    assert!((length(&model(through, cylinder, "<range>2 3</range>")) - around).abs() < 1e-8);
    // The middle point is inside: both segments end there, and are straight.
    let inside = ["-0.1 0 0", "0.01 0 0", "0.1 0 0"];
    assert!((length(&model(inside, cylinder, any)) - 0.2).abs() < 1e-12);
    // The first point is inside: the second segment wraps nevertheless.
    let first = ["-0.03 0 0", "-0.1 0 0", "0.1 1e-9 0"];
    assert!((length(&model(first, cylinder, any)) - (0.07 + string(0.04, [0.1; 2], PI))).abs() < 1e-8);
    // One side only, and both ends are on it: the length of the straight line, not of the path around the back.
    let on_side = "<quadrant>-x</quadrant><radius>0.04</radius><length>1</length>";
    assert!((length(&model(["-0.07 0.11 0", "-0.07 0.08 0", "-0.07 0.05 0"], on_side, any)) - 0.06).abs() < 1e-12);
}

#[test]
fn moment_arms_through_a_torus_are_the_slopes_of_lengths() {
    let text = std::fs::read_to_string(root().join("tests/fixtures/osim/kinds_v4.osim")).unwrap();
    let text = text.replace("<location>0.3 0 0.5</location>", "<location>0.3 0.02 0.5</location>");
    let moved = text.replacen(
        "<PathPoint name=\"a\"><socket_parent_frame>/ground</socket_parent_frame><location>0.3 0 -0.5</location>",
        "<PathPoint name=\"a\"><socket_parent_frame>/bodyset/slide</socket_parent_frame>\
         <location>0.3 0 -0.5</location>",
        1,
    );
    let file = SourceFile { path: "m.osim".into(), text: moved };
    let Ok((_, model)) = load_skeleton(&file) else { panic!("the fixture has a body `slide`") };
    let index = model.muscles.iter().position(|muscle| muscle.name == "over_torus").unwrap();
    let q = model.default_pose();
    let arms = model.lengths_and_moment_arms(&q)[index].1.clone();
    let mut largest = 0.0f64;
    for (k, arm) in arms.iter().enumerate().filter(|(k, _)| model.coordinates[*k].follows.is_none()) {
        let at = |e: f64| {
            let mut q = q.clone();
            q[k] += e;
            model.lengths_and_moment_arms(&q)[index].0
        };
        let slope = (at(1e-4) - at(-1e-4)) / 2e-4;
        assert!((slope + arm).abs() < 1e-6, "{}: {slope} {arm}", model.coordinates[k].name);
        largest = largest.max(slope.abs());
    }
    assert!(largest > 0.1, "it moves with something");
}

/// Rows of a CSV file by column.
pub fn csv(path: &Path) -> Vec<BTreeMap<String, String>> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let names = reader.headers().unwrap().clone();
    let row =
        |record: csv::StringRecord| names.iter().map(str::to_owned).zip(record.iter().map(str::to_owned)).collect();
    reader.records().map(|record| row(record.unwrap())).collect()
}

/// Four public models: lengths within 0.5 mm and moment arms within 1 mm of OpenSim's, except for the muscles in
/// `tests/opensim_differences.csv`, which gives the reason and both lengths of each.
#[test]
fn val_lengths_and_moment_arms_are_those_of_opensim_but_for_the_named_muscles() {
    let known: BTreeSet<(String, String)> = csv(&root().join("tests/opensim_differences.csv"))
        .into_iter()
        .map(|row| (row["model"].clone(), row["muscle"].clone()))
        .collect();
    for name in ["das3", "mobl_arms_41", "rat_hindlimb"] {
        let file = |ending: &str| shared(&format!("osim/field/{name}{ending}"));
        let (Some(model), Some(poses), Some(truth)) = (file(".osim"), file("_poses.csv"), file("_opensim.csv")) else {
            return;
        };
        compare(name, &model, &std::fs::read_to_string(poses).unwrap(), &csv(&truth), "pose", &known);
    }
    let (Some(model), Some(motion), Some(truth)) = (
        shared("walking/subject_walk_scaled.osim"),
        shared("walking/coordinates.sto"),
        shared("walking/lengths_and_moment_arms_opensim.csv"),
    ) else {
        return;
    };
    let truth = csv(&truth);
    compare("walking", &model, &poses_of(&std::fs::read_to_string(motion).unwrap(), &truth), &truth, "time_s", &known);
}

/// The poses of a motion at the instants of a table.
pub fn poses_of(motion: &str, truth: &[BTreeMap<String, String>]) -> String {
    let mut lines = motion.lines().skip_while(|line| *line != "endheader").skip(1);
    let names: Vec<&str> = lines.next().unwrap().split('\t').skip(1).map(|n| n.rsplit('/').nth(1).unwrap()).collect();
    let rows: Vec<Vec<&str>> = lines.map(|line| line.split('\t').collect()).collect();
    let kept: Vec<usize> = (0..names.len()).filter(|&k| !names[k].ends_with("_beta")).collect();
    let unit = |name: &str| if ["pelvis_tx", "pelvis_ty", "pelvis_tz"].contains(&name) { "m" } else { "rad" };
    let mut out = kept.iter().map(|&k| format!("{}_{}", names[k], unit(names[k]))).collect::<Vec<_>>().join(",");
    let mut times: Vec<f64> = truth.iter().map(|row| row["time_s"].parse().unwrap()).collect();
    times.dedup();
    for time in times {
        let row = rows.iter().find(|row| (row[0].parse::<f64>().unwrap() - time).abs() < 1e-6).unwrap();
        out.push('\n');
        out.push_str(&kept.iter().map(|&k| row[k + 1]).collect::<Vec<_>>().join(","));
    }
    out
}

fn compare(
    name: &str,
    model: &Path,
    poses: &str,
    truth: &[BTreeMap<String, String>],
    key: &str,
    known: &BTreeSet<(String, String)>,
) {
    let folder = folder(&[("poses.csv", poses)]);
    let run = sinew(&["moment-arms", model.to_str().unwrap(), "poses.csv", "--out", "arms.csv"], folder.path());
    assert_eq!(run.status.code(), Some(0), "{}", text(&run.stderr));
    let found: BTreeMap<(String, String), BTreeMap<String, String>> = csv(&folder.path().join("arms.csv"))
        .into_iter()
        .map(|row| ((row["pose"].clone(), row["muscle"].clone()), row))
        .collect();
    let mut keys: Vec<&String> = truth.iter().map(|row| &row[key]).collect();
    keys.dedup();
    let number = |text: &String| text.parse::<f64>().unwrap();
    let (mut muscles, mut off) = (BTreeSet::new(), BTreeSet::new());
    for row in truth {
        let pose = keys.iter().position(|known| **known == row[key]).unwrap();
        let own = &found[&(pose.to_string(), row["muscle"].clone())];
        let arm = |(column, value): (&String, &String)| {
            let coordinate = column.strip_prefix("fd_")?.strip_suffix("_m")?;
            Some((number(value) - number(own.get(&format!("moment_arm_{coordinate}_m"))?)).abs())
        };
        let arms = row.iter().filter_map(arm).fold(0.0, f64::max);
        let is_off = (number(&row["length_m"]) - number(&own["length_m"])).abs() > 5e-4 || arms > 1e-3;
        muscles.insert(row["muscle"].clone());
        if is_off {
            off.insert(row["muscle"].clone());
        }
    }
    println!("{name}: {} of {} muscles are off in some pose", off.len(), muscles.len());
    let unnamed: Vec<&String> =
        off.iter().filter(|muscle| !known.contains(&(name.to_owned(), (*muscle).clone()))).collect();
    assert!(unnamed.is_empty(), "{name}: {unnamed:?} differ from OpenSim and are not in tests/opensim_differences.csv");
}
