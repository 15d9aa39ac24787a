//! OpenSim models: fixtures of each file version with lengths derived by hand, the shared models against OpenSim's own
//! results, and untrusted input.

use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

use sinew::internals::error::SourceFile;
use sinew::internals::opensim::{Imported, import};
use sinew::internals::skeleton::Skeleton;
use sinew::internals::skeleton::file::SkeletonFile;
use sinew::internals::skeleton::text::text;

use super::cli::{sinew, text as text_of};
use super::support::shared;

fn fixture(name: &str) -> SourceFile {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/osim").join(name);
    SourceFile::read(&path).unwrap()
}

fn skeleton(imported: &Imported) -> Skeleton {
    imported.file.check().unwrap()
}

/// Length and moment arms (by coordinate) of a muscle, in the default pose except for some coordinates.
fn at(skeleton: &Skeleton, muscle: &str, pose: &[(&str, f64)]) -> (f64, Vec<f64>) {
    let mut q = skeleton.default_pose();
    pose.iter().for_each(|(name, value)| q[skeleton.coordinate(name).unwrap()] = *value);
    let index = skeleton.muscles.iter().position(|m| m.name == muscle).unwrap();
    skeleton.lengths_and_moment_arms(&q)[index].clone()
}

fn near(found: f64, expected: f64, what: &str) {
    assert!((found - expected).abs() < 1e-12 * (1.0 + expected.abs()), "{what}: {found}, by hand {expected}");
}

#[test]
fn every_version_of_the_format_is_the_same_arm() {
    let imported: Vec<Imported> =
        ["arm_v1.osim", "arm_v2.osim", "arm_v3.osim", "arm_v4.osim"].map(|name| import(&fixture(name)).unwrap()).into();
    let said = |imported: &Imported| {
        let text = text(&imported.file, "");
        text.lines().filter(|line| !line.starts_with("source")).map(str::to_owned).collect::<Vec<_>>()
    };
    for one in &imported {
        assert_eq!(said(one), said(&imported[3]));
        let arm = skeleton(one);
        let upper = &arm.bodies[0];
        assert_eq!((upper.mass, upper.centre_of_mass), (2.0, [0.0, -0.15, 0.0]));
        assert_eq!(upper.inertia, [0.02, 0.004, 0.021, 0.0001, 0.0, 0.0]);
        let flexor = &arm.muscles[0];
        assert_eq!((flexor.max_isometric_force, flexor.pennation_angle), (500.0, 0.2));
        assert_eq!((flexor.optimal_fibre_length, flexor.tendon_slack_length), (0.1, 0.15));
        let times = (flexor.fibre.activation.up, flexor.fibre.activation.down, flexor.max_shortening_velocity);
        assert_eq!(times, (0.012, 0.045, 9.0));
        for (shoulder, elbow) in [(0.1, 0.5), (-0.4, -0.5), (0.7, 1.3), (0.0, -1.1f64)] {
            let pose = [("shoulder_angle", shoulder), ("elbow_angle", elbow)];
            // Relative to the elbow: (0.03, 0.2) is fixed, (0.01, −0.05) rotates.
            let (sin, cos) = elbow.sin_cos();
            let way = [0.01 * cos + 0.05 * sin - 0.03, 0.01 * sin - 0.05 * cos - 0.2];
            let length = way[0].hypot(way[1]);
            let slope = (way[0] * (-0.01 * sin + 0.05 * cos) + way[1] * (0.01 * cos + 0.05 * sin)) / length;
            let (found, arms) = at(&arm, "flexor", &pose);
            near(found, length, "flexor");
            near(arms[0], 0.0, "flexor's arm at the shoulder");
            near(arms[1], -slope, "flexor's arm at the elbow");
            // Straight from the ground to the upper arm; then past the pulley, and around it when the elbow extends.
            let (sin, cos) = shoulder.sin_cos();
            let upper = (0.02 * cos + 0.1 * sin - 0.02).hypot(0.02 * sin - 0.1 * cos);
            let over = if elbow < 0.0 { 0.4 - 0.02 * elbow } else { 0.0 };
            let (found, arms) = at(&arm, "wrapped", &pose);
            if elbow < 0.0 {
                near(found, upper + over, "wrapped");
                near(arms[1], 0.02, "the pulley's radius");
            }
        }
    }
}

#[test]
fn every_kind_of_part_has_the_lengths_derived_by_hand() {
    let imported = import(&fixture("kinds_v4.osim")).unwrap();
    let model = skeleton(&imported);
    let pose = [
        ("s", 0.2),
        ("u1", 0.7),
        ("u2", -0.4),
        ("b1", 0.3),
        ("b2", -0.6),
        ("b3", 0.9),
        ("k", 0.8),
        ("knee_angle", 1.5),
        ("px", 0.3),
        ("py", -0.4),
        ("pr", 0.2),
        ("tx", 1.0),
        ("ty", 2.0),
        ("tz", 2.0),
        ("fx", 0.5),
    ];
    let phi = 0.1 + 0.5 * 1.5; // the rider follows the knee
    let expected = [
        ("of_slide", (0.2f64 * 0.2 + 1.0 + 0.16).sqrt()),
        ("of_universal", 1.0),
        ("across_universal", (2.0 + 2.0 * 0.7f64.sin() * 0.4f64.cos()).sqrt()),
        ("across_ball", (2.0 + 2.0 * 0.6f64.sin()).sqrt()),
        ("across_bent", (1.25 - (0.25 - 0.8f64).cos()).sqrt()),
        ("of_knee", 0.0225f64.hypot(0.03)),
        ("across_rider", 2.0 * (0.5f64 * phi).sin()),
        ("of_weld", 4.25f64.sqrt()),
        ("of_weld_frame", 2.0),
        ("of_plane", 0.5),
        ("of_free", 3.0),
        ("across_lock", 2.0 * 0.15f64.sin()),
        ("moving_line", 1.0 + 0.1 * phi),
        ("moving_curve", 1.0 + 0.1 * phi * phi),
        ("conditional", 2f64.sqrt()),
        // Around the tube (radius 0.1) through the ring (radius 0.2), from 0.1 outside the middle of the tube.
        ("over_torus", 1.0 + 0.1 * (TAU - 2.0 * 5f64.atan() - 2.0 * (0.1 / 0.26f64.sqrt()).acos())),
    ];
    for (muscle, length) in expected {
        near(at(&model, muscle, &pose).0, length, muscle);
    }
    // A dependent coordinate moves with the one it depends on.
    let knee = model.coordinate("knee_angle").unwrap();
    near(at(&model, "across_rider", &pose).1[knee], -0.5 * (0.5 * phi).cos(), "arm of the rider by the knee");
    near(at(&model, "moving_curve", &pose).1[knee], -0.1 * phi, "arm of the moving point by the knee");
    near(at(&model, "of_slide", &pose).1[0], -0.2 / 1.2f64.sqrt(), "arm of the slide");
    // The conditional point is part of the path from 0.2 to 1 rad of the rider.
    near(at(&model, "conditional", &[("knee_angle", 0.1)]).0, 1.0, "conditional, out of its range");
    // Two points at 0.5 from the centre of a sphere of radius 0.3, not quite on opposite sides.
    let d = 0.25f64 + 1e-6;
    let arc = 2.0 * 0.5f64.atan2(0.001) - 2.0 * (0.3 / d.sqrt()).acos();
    near(at(&model, "over_ball", &[]).0, 2.0 * (d - 0.09).sqrt() + 0.3 * arc, "over_ball");
    let muscle = |name: &str| model.muscles.iter().find(|muscle| muscle.name == name).unwrap();
    let schutte = muscle("across_ball");
    near(schutte.fibre.activation.up, 0.01, "Schutte1993");
    near(schutte.fibre.activation.down, 0.05, "Schutte1993");
    near(schutte.max_shortening_velocity, 10.0, "Schutte1993");
    assert!(muscle("across_universal").rigid_tendon && !schutte.rigid_tendon);
    let locked = &model.coordinates[model.coordinate("locked_angle").unwrap()];
    assert!(locked.locked && locked.default == 0.3);
    assert_eq!(model.held_points.len(), 1);
    assert_eq!(model.held_points[0].points, [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0]]);
    // All losses are reported.
    assert!(model.actuators.iter().any(|actuator| actuator.name == "reserve"));
    for name in ["idle", "disc", "asleep", "glue", "off", "floats"] {
        assert!(imported.notes.iter().any(|note| note.what.contains(name)), "{name} is not named");
    }
}

/// Import → file → load gives the same mechanics to the last digit.
fn goes_round(imported: &Imported) {
    let written = SourceFile { path: "model.toml".into(), text: text(&imported.file, "a comment\n\nof lines") };
    let (before, after) = (skeleton(imported), SkeletonFile::load(&written).unwrap());
    assert_eq!((&before.bodies, &before.gravity), (&after.bodies, &after.gravity));
    assert_eq!(format!("{:?}", before.joints), format!("{:?}", after.joints));
    assert_eq!(format!("{:?}", before.muscles), format!("{:?}", after.muscles));
    assert_eq!((&before.surfaces, &before.held_points), (&after.surfaces, &after.held_points));
    let mut q = before.default_pose();
    q.iter_mut().enumerate().for_each(|(k, q)| *q += 0.1 * (k as f64).sin());
    assert_eq!(before.lengths_and_moment_arms(&q), after.lengths_and_moment_arms(&q));
}

#[test]
fn what_is_imported_and_written_is_read_back() {
    for name in ["arm_v1.osim", "arm_v4.osim", "kinds_v4.osim"] {
        goes_round(&import(&fixture(name)).unwrap());
    }
}

#[test]
fn arm26_has_the_lengths_and_moment_arms_of_opensim() {
    let (Some(model), Some(sample)) = (shared("osim/arm26.osim"), shared("osim/arm26_moment_arms_opensim.csv")) else {
        return;
    };
    let source = SourceFile::read(&model).unwrap();
    let imported = import(&source).unwrap();
    goes_round(&imported);
    let committed = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/models/arm26.toml");
    let committed = SkeletonFile::load(&SourceFile::read(&committed).unwrap()).unwrap();
    // Shipped models have the thesis' curves and bound.
    let mut same = imported.file.clone();
    same.curves = Default::default();
    same.muscles.min_activation = 0.0;
    for muscle in &mut same.muscle {
        (muscle.passive_strain, muscle.tendon_strain) = (None, None);
    }
    assert_eq!(format!("{committed:?}"), format!("{:?}", same.check().unwrap()), "data/models/arm26.toml is stale");
    let coordinates = ["r_shoulder_elev", "r_elbow_flex"];
    let worst = worst_errors(&skeleton(&imported), &std::fs::read_to_string(sample).unwrap(), &coordinates);
    assert_eq!(worst.len(), 6);
    for (muscle, [length, arm]) in worst {
        assert!(length < 0.5e-3 && arm < 1e-3, "{muscle}: {length} m, {arm} m");
    }
}

#[test]
fn the_thoracoscapular_model_has_the_lengths_and_moment_arms_of_opensim() {
    let Some(model) = shared("osim/thoracoscapular_plus_elbow.osim") else { return };
    let Some(sample) = shared("upper_limb/moment_arms_opensim_sample.csv") else { return };
    let imported = import(&SourceFile::read(&model).unwrap()).unwrap();
    goes_round(&imported);
    let coordinates = ["plane_elv", "shoulder_elv", "axial_rot", "elbow_flexion"];
    let worst = worst_errors(&skeleton(&imported), &std::fs::read_to_string(sample).unwrap(), &coordinates);
    assert_eq!(worst.len(), 36);
    let missed: Vec<&str> =
        worst.iter().filter(|(_, [length, arm])| !(*length < 0.5e-3 && *arm < 1e-3)).map(|(m, _)| m.as_str()).collect();
    // In OpenSim, the paths of these three muscles cut through one of their two surfaces (README).
    assert_eq!(missed, ["Infraspinatus_I", "Infraspinatus_S", "Subscapularis_S"]);
}

/// By muscle: RMS error of the length, and the largest RMS error of a moment arm, over the rows in which OpenSim's path
/// does not jump.
fn worst_errors(model: &Skeleton, sample: &str, coordinates: &[&str]) -> Vec<(String, [f64; 2])> {
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).from_reader(sample.as_bytes());
    let header = reader.headers().unwrap().clone();
    let column = |name: &str| header.iter().position(|field| field == name).unwrap();
    let places: Vec<(usize, usize)> = (header.iter().enumerate())
        .filter_map(|(k, field)| Some((k, model.coordinate(field.strip_suffix("_deg")?)?)))
        .collect();
    let arms: Vec<(usize, usize)> =
        coordinates.iter().map(|c| (column(&format!("fd_{c}_m")), model.coordinate(c).unwrap())).collect();
    let mut sums: Vec<(String, f64, Vec<f64>, f64)> = Vec::new();
    let mut found: (String, Vec<(f64, Vec<f64>)>) = Default::default();
    for row in reader.records() {
        let row = row.unwrap();
        if &row[column("smooth_ok")] != "1" {
            continue;
        }
        let value = |k: usize| row[k].parse::<f64>().unwrap();
        if found.0 != row[0] {
            let mut q = model.default_pose();
            places.iter().for_each(|&(k, c)| q[c] = value(k).to_radians());
            found = (row[0].to_owned(), model.lengths_and_moment_arms(&q));
        }
        let muscle = &row[column("muscle")];
        let index = model.muscles.iter().position(|m| m.name == *muscle).unwrap();
        let at = sums.iter().position(|(name, ..)| name == muscle).unwrap_or_else(|| {
            sums.push((muscle.to_owned(), 0.0, vec![0.0; arms.len()], 0.0));
            sums.len() - 1
        });
        let (length, found) = &found.1[index];
        sums[at].1 += (length - value(column("length_m"))).powi(2);
        for (sum, &(k, c)) in sums[at].2.iter_mut().zip(&arms) {
            *sum += (found[c] - value(k)).powi(2);
        }
        sums[at].3 += 1.0;
    }
    let rms = |(name, length, arms, n): (String, f64, Vec<f64>, f64)| {
        let arm = arms.into_iter().fold(0.0, f64::max);
        (name, [(length / n).sqrt(), (arm / n).sqrt()])
    };
    sums.into_iter().map(rms).collect()
}

#[test]
fn untrusted_models_get_an_error_and_no_time() {
    let arm = fixture("arm_v4.osim").text;
    let laughs = "<!DOCTYPE a [<!ENTITY a \"ha\"><!ENTITY b \"&a;&a;&a;&a;\">]>";
    let nested = format!("{}{}", "<a>".repeat(200_000), "</a>".repeat(200_000));
    let multiplied = "<MultiplierFunction name=\"function\"><function>".repeat(5_000)
        + &"</function></MultiplierFunction>".repeat(5_000);
    let linear = "<LinearFunction name=\"function\"><coefficients> 1 0</coefficients></LinearFunction>";
    let garbage: String =
        (0..3_000_000u32).map(|i| char::from(b' ' + (i.wrapping_mul(2_654_435_761) >> 25) as u8 % 90)).collect();
    let circle = arm.replacen(
        "<socket_parent>/bodyset/upper</socket_parent>",
        "<socket_parent>/jointset/shoulder/upper_offset</socket_parent>",
        1,
    );
    let second = arm.find("<PathPoint name=\"flexor-P2\">").unwrap();
    let after = second + arm[second..].find("</PathPoint>").unwrap() + "</PathPoint>".len();
    let cases = [
        ("entities", format!("{laughs}<OpenSimDocument>&b;</OpenSimDocument>"), "DOCTYPE"),
        ("depth", nested, "a"),
        ("depth of functions", arm.replacen(linear, &multiplied, 1), "too deep"),
        ("garbage", garbage, "not valid XML"),
        ("many elements", format!("<Model>{}</Model>", "<a/>".repeat(1_500_000)), "million"),
        ("another document", "<html><body/></html>".to_owned(), "<Model>"),
        ("nothing", String::new(), "not valid XML"),
        ("a huge number", arm.replacen("0.02 0.004", "1e999 0.004", 1), "finite"),
        ("a number that is none", arm.replacen("<mass>2</mass>", "<mass>NaN</mass>", 1), "finite"),
        ("a word", arm.replacen("<mass>2</mass>", "<mass>two</mass>", 1), "`two`"),
        ("two numbers for one", arm.replacen("<mass>2</mass>", "<mass>2 3</mass>", 1), "1 number"),
        ("a negative mass", arm.replacen("<mass>2</mass>", "<mass>-2</mass>", 1), "mass"),
        (
            "a missing body",
            arm.replace("/bodyset/fore</socket_child_frame>", "/bodyset/four</socket_child_frame>"),
            "`/bodyset/four`",
        ),
        ("frames in a circle", circle, "circle"),
        (
            "bodies in a circle",
            arm.replacen("<socket_parent>/ground</socket_parent>", "<socket_parent>/bodyset/fore</socket_parent>", 1),
            "tree",
        ),
        (
            "a body on two joints",
            arm.replacen("/bodyset/fore</socket_child_frame>", "/bodyset/upper</socket_child_frame>", 1),
            "child of two joints",
        ),
        ("one point", format!("{}{}", &arm[..second], &arm[after..]), "fewer than two points"),
    ];
    let mut slow = Vec::new();
    for (what, text, expected) in cases {
        let start = std::time::Instant::now();
        let file = SourceFile { path: "model.osim".into(), text };
        let error = import(&file).map(|_| ()).expect_err(what);
        let said = format!("{error} {}", miette::Diagnostic::help(&error).map(|h| h.to_string()).unwrap_or_default());
        assert!(said.contains(expected), "{what}: {said}");
        if start.elapsed().as_secs_f64() > 1.0 {
            slow.push(what);
        }
    }
    assert!(slow.is_empty(), "more than a second: {slow:?}");
}

#[test]
fn the_command_writes_a_file_never_over_one_and_names_what_is_lost() {
    let folder = tempfile::tempdir().unwrap();
    let model = fixture("kinds_v4.osim").path;
    let run = |arguments: &[&str]| {
        let found = sinew(&[&["import", model.to_str().unwrap()], arguments].concat(), folder.path());
        (found.status.code(), text_of(&found.stdout), text_of(&found.stderr))
    };
    let (code, printed, _) = run(&[]);
    assert_eq!(code, Some(0));
    assert!(printed.contains("kinds_v4.toml: 10 bodies") && printed.contains("WeldConstraint"), "{printed}");
    let written = std::fs::read_to_string(folder.path().join("kinds_v4.toml")).unwrap();
    assert!(written.contains("BLAKE3") && written.contains("public domain") && written.contains("# "), "{written}");
    let (code, _, said) = run(&[]);
    assert!(code == Some(2) && said.contains("--out"), "{said}");
    let (code, _, said) = run(&["--strict", "--out", "strict.toml"]);
    assert!(
        code == Some(2) && said.contains("WeldConstraint") && !folder.path().join("strict.toml").exists(),
        "{said}"
    );
}

/// Elbow flexion of arm26 in both schemes: the motion is tracked within a degree, the loads are unique, and the peak
/// activations rank as in OpenSim's static optimisation.
#[test]
fn arm26_flexes_its_elbow_with_unique_loads() {
    let root = super::support::root().display();
    let study = "name = \"arm26\"\nmodel = \"{root}/data/models/arm26.toml\"\n\
        motion = \"{root}/data/motions/arm26_elbow_flexion.mot\"\n[base]\nh = 0.041666666666666664\n\
        bounds = \"both_boxed\"\nregularity = \"optimum\"\ntrajectories = true\n[sweep.list]\n";
    let study = study.replace("{root}", &root.to_string()).replace(
        "[sweep.list]\n",
        "[[sweep.list]]\nscheme = \"radau\"\nmu = 0.05\n[[sweep.list]]\nscheme = \"midpoint\"\nmu = 0.05\n",
    );
    let folder = super::support::folder(&[("study.toml", &study)]);
    let (_, study) = super::support::study(&folder);
    let published = super::support::root().join("data/arm26_static_optimization.csv");
    let mut published: Vec<(String, f64)> = csv::ReaderBuilder::new()
        .comment(Some(b'#'))
        .from_path(published)
        .unwrap()
        .records()
        .map(|row| row.map(|row| (row[0].to_owned(), row[1].parse().unwrap())).unwrap())
        .collect();
    published.sort_by(|a, b| b.1.total_cmp(&a.1));
    for (job, limit) in study.jobs.iter().zip([1.0, 2.0]) {
        assert_eq!(job.points, 25);
        let outcome = sinew::internals::solve::solve(&study.model, &study.motion, &job.settings, job.points);
        assert_eq!(outcome.job.status, sinew::internals::outcome::Status::Converged, "{:?}", outcome.job.error);
        assert_eq!(outcome.regularity.as_ref().unwrap().loads_unique, Some(true));
        for name in ["r_shoulder_elev", "r_elbow_flex"] {
            let of = |signal: &str| -> Vec<(f64, f64)> {
                let rows = outcome.trajectories.iter().filter(|row| row.signal == signal && row.name == name);
                rows.map(|row| (row.time_s, row.value)).collect()
            };
            let (found, measured) = (of("joint_coordinate"), of("measured_joint_coordinate"));
            assert_eq!(found.len(), 25);
            let squares = found.iter().map(|(t, x)| {
                let near = measured.iter().min_by(|a, b| (a.0 - t).abs().total_cmp(&(b.0 - t).abs())).unwrap();
                assert!((near.0 - t).abs() < 1e-9);
                (near.1 - x).powi(2)
            });
            let rms = (squares.sum::<f64>() / 25.0).sqrt().to_degrees();
            assert!(rms < limit, "{name}: {rms} degrees RMS");
        }
        let peak = |name: &str| outcome.muscles.iter().find(|row| row.muscle == name).unwrap().peak_activation;
        let order: Vec<f64> = published.iter().map(|(name, _)| peak(name)).collect();
        assert!(order[..5].windows(2).all(|pair| pair[0] > pair[1]), "{published:?} {order:?}");
    }
}

/// The joint coordinates that a job reports are those from which the motion was made.
#[test]
fn joint_coordinates_are_found_again() {
    let imported = import(&fixture("kinds_v4.osim")).unwrap();
    let model = skeleton(&imported);
    let mut q = model.default_pose();
    q.iter_mut().enumerate().for_each(|(k, q)| *q += 1.2 * (1.0 + k as f64).sin());
    for joint in &model.joints {
        for (coordinate, value) in joint.motion.coordinates_of(&joint.motion.frame(&q), &model.default_pose()) {
            let name = &model.coordinates[coordinate].name;
            assert!((value - q[coordinate]).abs() < 1e-9, "{name}: {value} for {}", q[coordinate]);
        }
    }
}

#[test]
fn what_a_study_cannot_have_is_pointed_at_and_what_a_path_lacks_is_named() {
    let mut still = fixture("arm_v4.osim");
    still.text = still.text.replace("<locked>false", "<locked>true");
    let error = sinew::internals::study::load_model(&still).map(|_| ()).unwrap_err();
    let said = super::cli::said(error);
    assert!(said.contains("arm_v4.osim:") && said.contains("nothing moves by forces"), "{said}");
    let mut source = fixture("arm_v4.osim");
    source.text = source.text.replace("<wrap_object>elbow_pulley", "<wrap_object>elbow_pully");
    let imported = import(&source).unwrap();
    assert!(imported.notes.iter().any(|note| note.what == "muscle wrapped" && note.lost.contains("elbow_pully")));
    // A body without mass needs one only where nothing beyond it has any.
    let mut lost = |from: &str, body: &str| {
        source.text = source.text.replacen(from, "<mass>0</mass>", 1);
        let imported = import(&source).unwrap();
        imported.notes.iter().any(|note| note.what == body && note.lost.contains("no mass"))
    };
    assert!(!lost("<mass>2</mass>", "body upper"));
    assert!(lost("<mass>1.5</mass>", "body fore"));
}
