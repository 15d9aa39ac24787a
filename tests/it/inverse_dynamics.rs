//! `sinew inverse-dynamics`: against closed forms, against OpenSim, and with mistakes.

use std::f64::consts::PI;

use super::cli::{one_line, sinew, text};
use super::support::{folder, shared};

const PENDULUM: &str = r#"
name = "pendulum"
dimensions = 3

[[body]]
name = "rod"
mass = 2.0
centre_of_mass = [0.0, -0.4, 0.0]
inertia = [0.03, 0.01, 0.03, 0.0, 0.0, 0.0]

[[joint]]
name = "hinge"
kind = "axes"
parent = "ground"
child = "rod"
rotations = [{ coordinate = "angle", axis = [0.0, 0.0, 1.0] }]

[[coordinate]]
name = "angle"
"#;

/// A horizontal force at the rod's end, whose point is written once in the ground's frame and once in the rod's.
const LOADS: &str = r#"
table = "forces.csv"

[[external_load]]
name = "push"
body = "rod"
force = "push_"
point = "centre_"

[[external_load]]
name = "pull"
body = "rod"
point_in = "rod"
force = "push_"
point = "end_"
moment = "turn_"
"#;

pub fn angle(t: f64) -> [f64; 3] {
    let (size, rate) = (0.5, 2.0 * PI);
    [size * (rate * t).sin(), size * rate * (rate * t).cos(), -size * rate * rate * (rate * t).sin()]
}

/// The files of a pendulum that swings for a second, with forces over the first `until` seconds.
pub fn files(until: f64) -> [(&'static str, String); 4] {
    let time = |last: f64| (0..=(200.0 * last).round() as usize).map(|k| k as f64 / 200.0);
    let motion: String = time(1.0).map(|t| format!("{t},{}\n", angle(t)[0])).collect();
    let row = |t: f64| {
        // The force ends at 0.5 s, and its centre of pressure runs away.
        let force = if t < 0.5 { 10.0 * (2.0 * PI * t).sin().powi(2) } else { 0.0 };
        let [x, y] = if t < 0.5 { [0.8 * angle(t)[0].sin(), -0.8 * angle(t)[0].cos()] } else { [400.0 * t, 70.0] };
        format!("{t},{force},0,0,{x},{y},0,0,-0.8,0,0,0,1.5\n")
    };
    let forces: String = time(until).map(row).collect();
    let head = "time,push_x,push_y,push_z,centre_x,centre_y,centre_z,end_x,end_y,end_z,turn_x,turn_y,turn_z\n";
    [
        ("model.toml", PENDULUM.to_owned()),
        ("motion.csv", format!("time,angle_rad\n{motion}")),
        ("loads.toml", LOADS.to_owned()),
        ("forces.csv", format!("{head}{forces}")),
    ]
}

pub fn in_folder(files: &[(&str, String)]) -> tempfile::TempDir {
    folder(&files.iter().map(|(name, text)| (*name, text.as_str())).collect::<Vec<_>>())
}

#[test]
fn a_pendulum_needs_the_moment_of_the_closed_form() {
    let folder = in_folder(&files(1.0));
    let run = |more: &[&str]| {
        let run = sinew(&[&["inverse-dynamics", "model.toml", "motion.csv"], more].concat(), folder.path());
        assert_eq!(run.status.code(), Some(0), "{}", text(&run.stderr));
        text(&run.stdout)
    };
    let compare = |out: &str, with_loads: bool| {
        assert!(out.starts_with("time_s,angle_moment_n_m\n"), "{out}");
        for line in out.lines().skip(1) {
            let (t, moment) = line.split_once(',').unwrap();
            let (t, moment): (f64, f64) = (t.parse().unwrap(), moment.parse().unwrap());
            let [q, _, second] = angle(t);
            let swing = (0.03 + 2.0 * 0.16) * second + 2.0 * 9.81 * 0.4 * q.sin();
            let push = if t < 0.5 { 10.0 * (2.0 * PI * t).sin().powi(2) } else { 0.0 };
            // Both loads push at the end, and one turns.
            let expected = if with_loads { swing - 2.0 * push * 0.8 * q.cos() - 1.5 } else { swing };
            // A natural spline is wrong at its ends.
            if t > 0.05 && t < 0.95 {
                assert!((moment - expected).abs() < 5e-3, "{t}: {moment} {expected}");
            }
        }
    };
    compare(&run(&[]), false);
    compare(&run(&["--loads", "loads.toml"]), true);
    let window = run(&["--loads", "loads.toml", "--window", "0.2", "0.4"]);
    assert_eq!(window.lines().count(), 1 + 41);
    let said = one_line(&run(&["--loads", "loads.toml", "--out", "moments.parquet"]));
    assert!(
        said.contains("201 instants: moments.parquet") && said.contains("load push on rod: vertical force"),
        "{said}"
    );
    let table = sinew::internals::tables::read("inverse_dynamics", &folder.path().join("moments.parquet")).unwrap();
    assert_eq!(table.rows(), 201);
}

/// The pendulum as a planar model.
#[test]
fn a_planar_model_needs_the_same_moments() {
    let planar = r#"
        name = "planar pendulum"
        gravity = [0.0, -9.81]

        [[body]]
        name = "rod"
        mass = 2.0
        centre_of_mass = [0.0, -0.4]
        inertia = 0.03

        [[joint]]
        name = "hinge"
        kind = "revolute"
        parent = "ground"
        parent_point = [0.0, 0.0]
        child = "rod"
        child_point = [0.0, 0.0]
        coordinate = "angle"

        [[muscle]]
        name = "any"
        max_isometric_force = 100.0
        optimal_fibre_length = 0.2
        tendon_slack_length = 0.2
        path = [{ body = "ground", point = [0.1, 0.0] }, { body = "rod", point = [0.0, -0.3] }]
    "#;
    let folder = in_folder(&[&files(1.0)[..], &[("planar.toml", planar.to_owned())]].concat());
    let moments = |model: &str| {
        let run = sinew(&["inverse-dynamics", model, "motion.csv"], folder.path());
        assert_eq!(run.status.code(), Some(0), "{}", text(&run.stderr));
        text(&run.stdout)
    };
    let (plane, space) = (moments("planar.toml"), moments("model.toml"));
    assert_eq!(plane.lines().next(), space.lines().next());
    for (one, other) in plane.lines().zip(space.lines()).skip(1) {
        let value = |line: &str| line.split_once(',').unwrap().1.parse::<f64>().unwrap();
        let time: f64 = one.split_once(',').unwrap().0.parse().unwrap();
        // The spline goes through positions there and through angles here.
        if time > 0.1 && time < 0.9 {
            assert!((value(one) - value(other)).abs() < 5e-3, "{one} {other}");
        }
    }
    let loads = sinew(&["inverse-dynamics", "planar.toml", "motion.csv", "--loads", "loads.toml"], folder.path());
    assert_eq!(loads.status.code(), Some(2));
    assert!(one_line(&text(&loads.stderr)).contains("external loads need a spatial model"));
    let pedal = super::support::root().join("data/models/pedal.toml");
    let motion = super::support::root().join("data/motions");
    let motion =
        std::fs::read_dir(motion).unwrap().flatten().find(|f| f.file_name().to_str().unwrap().contains("pedal"));
    let motion = motion.unwrap().path();
    let looped = sinew(&["inverse-dynamics", pedal.to_str().unwrap(), motion.to_str().unwrap()], folder.path());
    assert_eq!(looped.status.code(), Some(2), "{}", text(&looped.stdout));
    assert!(one_line(&text(&looped.stderr)).contains("close a loop"), "{}", text(&looped.stderr));
}

/// OpenSim's own file of the same loads gives the same.
#[test]
fn external_loads_are_read_from_opensims_files() {
    let force = |name: &str, frame: &str, point: &str, more: &str| {
        format!(
            "<ExternalForce name=\"{name}\"><applied_to_body>/bodyset/rod</applied_to_body>\
             <force_expressed_in_body>ground</force_expressed_in_body>\
             <point_expressed_in_body>{frame}</point_expressed_in_body>\
             <force_identifier>push_</force_identifier><point_identifier>{point}</point_identifier>{more}</ExternalForce>"
        )
    };
    let turn = "<torque_identifier>turn_</torque_identifier>";
    let xml = format!(
        "<OpenSimDocument Version=\"40500\"><ExternalLoads name=\"loads\"><objects>{}{}</objects>\
         <datafile>forces.csv</datafile></ExternalLoads></OpenSimDocument>",
        force("push", "ground", "centre_", ""),
        force("pull", "/bodyset/rod", "end_", turn)
    );
    let folder = in_folder(&[&files(1.0)[..], &[("loads.xml", xml)]].concat());
    let with = |loads: &str| {
        let run = sinew(&["inverse-dynamics", "model.toml", "motion.csv", "--loads", loads], folder.path());
        assert_eq!(run.status.code(), Some(0), "{}", text(&run.stderr));
        text(&run.stdout)
    };
    assert_eq!(with("loads.xml"), with("loads.toml"));
}

#[test]
fn mistakes_in_loads_are_named() {
    let check = |files: &[(&str, String)], more: &[&str], says: &[&str]| {
        let folder = in_folder(files);
        let arguments = [&["inverse-dynamics", "model.toml", "motion.csv", "--loads", "loads.toml"], more].concat();
        let run = sinew(&arguments, folder.path());
        let error = one_line(&text(&run.stderr));
        assert_eq!(run.status.code(), Some(2), "{error}");
        says.iter().for_each(|says| assert!(error.contains(says), "{says}: {error}"));
    };
    let changed = |file: usize, from: &str, to: &str| {
        let mut files = files(1.0);
        assert!(files[file].1.contains(from));
        files[file].1 = files[file].1.replacen(from, to, 1);
        files
    };
    check(&changed(2, "body = \"rod\"", "body = \"rode\""), &[], &["no body of the model", "did you mean `rod`"]);
    check(&changed(2, "body = \"rod\"", "body = \"ground\""), &[], &["acts on the ground"]);
    check(
        &changed(2, "force = \"push_\"", "force = \"psh_\""),
        &[],
        &["no column `psh_x`", "the load `push` needs", "did you mean `push_x`"],
    );
    check(&changed(2, "force = ", "forc = "), &[], &["unknown field `forc`", "did you mean `force`"]);
    check(&changed(3, "\n0.005,", "\nfive,"), &[], &["line 3", "not a finite number"]);
    check(&changed(3, "\n0.005,", "\n0.0,"), &[], &["line 3", "not later"]);
    check(&files(0.6), &[], &["forces.csv", "known from 0 to 0.6 s", "--window 0 0.6"]);
    check(&files(1.0), &["--window", "0.5", "1.5"], &["not within", "from 0 to 1 s"]);
    check(&files(1.0), &["--window", "-1", "0.5"], &["not within", "from 0 to 1 s"]);
    check(&files(1.0), &["--window", "0.5", "0.2"], &["must end after it begins"]);
    check(&files(1.0), &["--window", "0.501", "0.502"], &["no instant from 0.501 to 0.502 s"]);
    check(&files(1.0), &["--smoothing", "90"], &["motion.csv", "200 instants per second", "at most"]);
    check(&files(1.0), &["--force-smoothing", "90"], &["forces.csv", "200 instants per second", "at most"]);
    check(&changed(2, "forces.csv", "force.csv"), &[], &["there is no file", "loads.toml:2"]);
    check(&changed(2, "body = \"rod\"\npoint_in", "body = \"rad\"\npoint_in"), &[], &["the load `pull`"]);
    let mut early = files(1.0);
    early[3].1 =
        early[3].1.lines().take(3).collect::<Vec<_>>().join("\n").replace("\n0,", "\n-9,").replace("\n0.005,", "\n-8,");
    check(&early, &[], &["no instants in common"]);
    let folder = in_folder(&files(1.0));
    let table = sinew(&["inverse-dynamics", "model.toml", "motion.csv", "--loads", "forces.csv"], folder.path());
    assert!(one_line(&text(&table.stderr)).contains("ExternalLoads file (.xml) or a .toml"), "{}", text(&table.stderr));
    let planar = std::fs::read_to_string(super::support::root().join("data/models/arm.toml")).unwrap();
    check(&changed(0, PENDULUM, &planar), &[], &["planar", "spatial model"]);
    check(&changed(2, "force = \"push_\"\npoint", "point"), &[], &["neither a force nor a moment"]);
}

/// The walking trial of OpenSim's Moco examples.
#[test]
fn the_moments_of_walking_are_opensims() {
    let (Some(model), Some(reference)) = (shared("walking/subject_walk_scaled.osim"), shared("walking/id_opensim.csv"))
    else {
        return;
    };
    let walking = model.parent().unwrap().to_owned();
    let arguments = ["inverse-dynamics", "subject_walk_scaled.osim", "coordinates.sto", "--loads", "grf_walk.xml"];
    let run = sinew(&[&arguments[..], &["--window", "0.48", "1.61"]].concat(), &walking);
    assert_eq!(run.status.code(), Some(0), "{}", text(&run.stderr));
    let read = |text: &str| {
        let mut lines = text.lines().map(|line| line.split(',').map(str::to_owned).collect::<Vec<_>>());
        let names = lines.next().unwrap();
        let rows: Vec<Vec<f64>> = lines.map(|row| row.iter().map(|x| x.parse().unwrap()).collect()).collect();
        (names, rows)
    };
    let (names, found) = read(&text(&run.stdout));
    let (wanted, reference) = read(&std::fs::read_to_string(reference).unwrap());
    for (column, name) in wanted.iter().enumerate().skip(1) {
        let own = names.iter().position(|own| own.trim_end_matches("_n_m").trim_end_matches("_n") == name).unwrap();
        let (mut sum, mut low, mut high) = (0.0, f64::INFINITY, f64::NEG_INFINITY);
        for row in &reference {
            let here = found.iter().min_by(|a, b| (a[0] - row[0]).abs().total_cmp(&(b[0] - row[0]).abs())).unwrap();
            sum += (here[own] - row[column]).powi(2);
            (low, high) = (f64::min(low, row[column]), f64::max(high, row[column]));
        }
        let rms = (sum / reference.len() as f64).sqrt();
        let limit = match name.starts_with("pelvis") {
            false => 0.003 * (high - low),
            true if name.ends_with("force") => 0.6,
            true => 0.5,
        };
        assert!(rms <= limit, "{name}: {rms} of {limit}");
    }
}

/// A rod that hangs still, with a muscle from the ground to its middle and a foot welded to its end.
const HANGING: &str = r#"
name = "hanging"
dimensions = 3

[[body]]
name = "rod"
mass = 2.0
centre_of_mass = [0.0, -0.4, 0.0]
inertia = [0.03, 0.01, 0.03, 0.0, 0.0, 0.0]

[[body]]
name = "foot"
mass = 0.5
centre_of_mass = [0.1, 0.0, 0.0]
inertia = [0.001, 0.001, 0.001, 0.0, 0.0, 0.0]

[[joint]]
name = "hinge"
kind = "axes"
parent = "ground"
child = "rod"
rotations = [{ coordinate = "angle", axis = [0.0, 0.0, 1.0] }]

[[joint]]
name = "glued"
kind = "weld"
parent = "rod"
child = "foot"
parent_point = [0.0, -0.8, 0.0]

[[coordinate]]
name = "angle"

[[muscle]]
name = "holder"
max_isometric_force = 100.0
optimal_fibre_length = 0.2
tendon_slack_length = 0.2
path = [{ body = "ground", point = [0.3, 0.0, 0.0] }, { body = "rod", point = [0.0, -0.4, 0.0] }]
"#;

#[test]
fn joints_carry_weight_and_muscles() {
    let row = |t: f64| format!("{t},0.5\n");
    let motion: String = (0..=10).map(|k| row(f64::from(k) / 10.0)).collect();
    let forces = "time,holder\n0,50\n1,50\n".to_owned();
    let files = [
        ("model.toml", HANGING.to_owned()),
        ("motion.csv", format!("time,angle_rad\n{motion}")),
        ("forces.csv", forces),
    ];
    let folder = in_folder(&files);
    let arguments = ["joint-loads", "model.toml", "motion.csv", "--muscle-forces", "forces.csv"];
    let run = sinew(&arguments, folder.path());
    assert_eq!(run.status.code(), Some(0), "{}", text(&run.stderr));
    let out = text(&run.stdout);
    let load = |joint: &str, frame: &str| -> Vec<f64> {
        let line = out.lines().find(|line| line.starts_with(&format!("0.5,{joint},")) && line.contains(frame)).unwrap();
        line.split(',').skip(5).map(|x| x.parse().unwrap()).collect()
    };
    // The muscle pulls the rod from its middle towards (0.3, 0).
    let (sin, cos) = 0.5f64.sin_cos();
    let pull = [0.3 - 0.4 * sin, 0.4 * cos];
    let pull = pull.map(|x| 50.0 * x / pull[0].hypot(pull[1]));
    let expected = [-pull[0], 2.5 * 9.81 - pull[1]];
    let hinge = load("hinge", ",ground,");
    assert!((hinge[0] - expected[0]).abs() < 1e-9 && (hinge[1] - expected[1]).abs() < 1e-9, "{hinge:?} {expected:?}");
    assert!(
        (hinge[6] - expected[0].hypot(expected[1])).abs() < 1e-9 && (hinge[7] - hinge[6] / (2.5 * 9.81)).abs() < 1e-9
    );
    // What no muscle makes about the axis passes through the joint, too: gravity less the muscle's moment.
    let gravity = 9.81 * (2.0 * 0.4 * sin + 0.5 * (0.8 * sin + 0.1 * cos));
    let of_muscle = 0.4 * sin * pull[1] + 0.4 * cos * pull[0];
    assert!((hinge[5] - (gravity - of_muscle)).abs() < 1e-9, "{hinge:?} {gravity} {of_muscle}");
    let glued = load("glued", ",child,");
    let weight = 0.5 * 9.81;
    assert!((glued[0] - weight * sin).abs() < 1e-9 && (glued[1] - weight * cos).abs() < 1e-9, "{glued:?}");
    assert!((glued[5] - weight * 0.1 * cos).abs() < 1e-9, "{glued:?}");
    for (from, to, says) in [
        ("holder", "holdr", &["no column is a muscle", "`holder`"][..]),
        ("\n1,50", "\n0.8,50", &["known from 0 to 0.8 s", "--window 0 0.8"]),
    ] {
        std::fs::write(folder.path().join("forces.csv"), files[2].1.replace(from, to)).unwrap();
        let bad = sinew(&arguments, folder.path());
        assert_eq!(bad.status.code(), Some(2));
        says.iter().for_each(|says| assert!(one_line(&text(&bad.stderr)).contains(says), "{}", text(&bad.stderr)));
    }
}

/// OpenSim's JointReaction of the same muscle forces: hips, knees and ankles within 0.3 % of the peak.
#[test]
fn the_joint_loads_of_walking_are_opensims() {
    let (Some(model), Some(reference)) =
        (shared("walking/subject_walk_scaled.osim"), shared("walking/joint_reaction_opensim.csv"))
    else {
        return;
    };
    let walking = model.parent().unwrap().to_owned();
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("joints.csv");
    let arguments = ["joint-loads", "subject_walk_scaled.osim", "coordinates.sto", "--loads", "grf_walk.xml"];
    let more = ["--muscle-forces", "static_optimization_forces_opensim.csv", "--window", "0.48", "1.61", "--out"];
    let run = sinew(&[&arguments[..], &more, &[out.to_str().unwrap()]].concat(), &walking);
    assert_eq!(run.status.code(), Some(0), "{}", text(&run.stderr));
    let found = std::fs::read_to_string(out).unwrap();
    let found: Vec<Vec<&str>> = found.lines().skip(1).map(|line| line.split(',').collect()).collect();
    let reference = std::fs::read_to_string(reference).unwrap();
    let names: Vec<&str> = reference.lines().next().unwrap().split(',').collect();
    let rows: Vec<Vec<f64>> =
        reference.lines().skip(1).map(|line| line.split(',').map(|x| x.parse().unwrap()).collect()).collect();
    for (column, name) in names.iter().enumerate().skip(1).step_by(6) {
        let joint = name.split("_on_").next().unwrap();
        let own: Vec<&Vec<&str>> = found.iter().filter(|row| row[1] == joint && row[4] == "child").collect();
        let (mut worst, mut peak) = (0.0f64, 0.0f64);
        for row in &rows {
            let time = |found: &Vec<&str>| (found[0].parse::<f64>().unwrap() - row[0]).abs();
            let here = own.iter().min_by(|a, b| time(a).total_cmp(&time(b))).unwrap();
            let off: f64 = (0..3).map(|i| (here[5 + i].parse::<f64>().unwrap() - row[column + i]).powi(2)).sum();
            worst = worst.max(off.sqrt());
            peak = peak.max((0..3).map(|i| row[column + i].powi(2)).sum::<f64>().sqrt());
        }
        eprintln!("{joint}: {worst:.1} N of {peak:.0} N");
        assert!(worst <= 0.003 * peak, "{joint}: {worst} of {peak}");
    }
}

/// The base of a gait model floats, so that an import takes its motion as given; it keeps its mass all the same.
#[test]
fn a_floating_base_has_its_mass() {
    let body = |name: &str, mass: f64, inertia: &str| {
        format!(
            "<Body name=\"{name}\"><mass>{mass}</mass><mass_center>0 0 0</mass_center><inertia>{inertia}</inertia></Body>"
        )
    };
    let model = format!(
        "<OpenSimDocument Version=\"40000\"><Model name=\"floating\"><gravity>0 -10 0</gravity><BodySet><objects>{}{}\
         </objects></BodySet><JointSet><objects>\
         <FreeJoint name=\"base\"><socket_parent_frame>/ground</socket_parent_frame>\
         <socket_child_frame>/bodyset/pelvis</socket_child_frame><coordinates>{}</coordinates></FreeJoint>\
         <PinJoint name=\"hip\"><socket_parent_frame>/bodyset/pelvis</socket_parent_frame>\
         <socket_child_frame>/bodyset/thigh</socket_child_frame><coordinates><Coordinate name=\"flexion\"/></coordinates>\
         </PinJoint></objects></JointSet></Model></OpenSimDocument>",
        body("pelvis", 11.0, "0 0 0 0 0 0"),
        body("thigh", 8.0, "0.1 0.1 0.1 0 0 0"),
        ["rx", "ry", "rz", "tx", "ty", "tz"].map(|name| format!("<Coordinate name=\"{name}\"/>")).concat()
    );
    let still: String = (0..=4).map(|k| format!("0.{k},0,0\n")).collect();
    let folder = in_folder(&[("model.osim", model), ("motion.csv", format!("time,ty_m,flexion_rad\n{still}"))]);
    let run = sinew(&["inverse-dynamics", "model.osim", "motion.csv", "--out", "out.csv"], folder.path());
    assert_eq!(run.status.code(), Some(0), "{}", text(&run.stderr));
    assert!(one_line(&text(&run.stdout)).contains("residuals of the floating base up to:"), "{}", text(&run.stdout));
    let out = std::fs::read_to_string(folder.path().join("out.csv")).unwrap();
    let column = out.lines().next().unwrap().split(',').position(|name| name == "ty_force_n").unwrap();
    let force: f64 = out.lines().nth(1).unwrap().split(',').nth(column).unwrap().parse().unwrap();
    assert!((force - 190.0).abs() < 1e-9, "{force}");
}
