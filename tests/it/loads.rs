//! Studies of spatial models under external loads: against closed forms, against inverse dynamics, and with mistakes.

use std::f64::consts::PI;

use super::cli::{one_line, sinew, text};
use super::inverse_dynamics::{angle, files, in_folder};
use super::support::{folder, shared, study};
use sinew::internals::outcome::{Outcome, Status};
use sinew::internals::solve::solve;

const STUDY: &str = "name = \"s\"\nmodel = \"model.toml\"\nmotion = \"motion.csv\"\nloads = \"loads.toml\"\n\
    window = [0.2, 0.8]\n[base]\nintervals = 30\nstages = 3\nmu = 1e-5\nreserves = 50.0\nregularity = \"off\"\n\
    trajectories = true\n";

fn outcome(folder: &tempfile::TempDir) -> Outcome {
    let (_, study) = study(folder);
    let job = &study.jobs[0];
    let outcome = solve(&study.model_of(job).unwrap(), &study.motion, &job.settings, job.points);
    assert_eq!(outcome.job.status, Status::Converged, "{:?}", outcome.job.error);
    outcome
}

fn signal(outcome: &Outcome, signal: &str, name: &str) -> Vec<(f64, f64)> {
    let own = outcome.trajectories.iter().filter(|row| row.signal == signal && row.name == name);
    own.map(|row| (row.time_s, row.value)).collect()
}

/// The net moment and the force in the joint of a pendulum, pushed at its end in the ground's frame and in its own.
#[test]
fn a_pendulum_moves_under_loads_as_inverse_dynamics_says() {
    let mut files = files(1.0).to_vec();
    files.push(("study.toml", STUDY.to_owned()));
    let outcome = outcome(&in_folder(&files));
    assert!(outcome.job.tracking_rms_deg.unwrap() < 0.1 && outcome.job.tracking_rms_m.is_none());
    let push = |t: f64| if t < 0.5 { 10.0 * (2.0 * PI * t).sin().powi(2) } else { 0.0 };
    let moments = signal(&outcome, "net_moment_n_m", "angle");
    assert_eq!(moments.len(), 90);
    assert!(moments[0].0 > 0.2 && (moments[89].0 - 0.8).abs() < 1e-12);
    // Towards both ends fewer measured instants determine accelerations.
    for (t, moment) in moments.into_iter().filter(|(t, _)| (0.3..0.7).contains(t)) {
        let [q, _, second] = angle(t);
        let expected = (0.03 + 2.0 * 0.16) * second + 2.0 * 9.81 * 0.4 * q.sin() - 2.0 * push(t) * 0.8 * q.cos() - 1.5;
        assert!((moment - expected).abs() < 0.02, "{t}: {moment} {expected}");
    }
    let [x, y] = ["x", "y"].map(|axis| signal(&outcome, "joint_force_n", &format!("hinge.ground.{axis}")));
    for ((t, x), (_, y)) in x.into_iter().zip(y).filter(|((t, _), _)| (0.3..0.7).contains(t)) {
        let [q, rate, second] = angle(t);
        let along = [q.cos(), q.sin()].map(|c| 0.4 * second * c);
        let expected = [
            2.0 * (along[0] - 0.4 * rate * rate * q.sin()) - 2.0 * push(t),
            2.0 * (along[1] + 0.4 * rate * rate * q.cos() + 9.81),
        ];
        assert!((x - expected[0]).abs() < 0.1 && (y - expected[1]).abs() < 0.1, "{t}: {x} {y} {expected:?}");
    }
    let hinge = &outcome.joints[0];
    assert!(hinge.joint == "hinge" && hinge.peak_force_n > hinge.mean_force_n && hinge.mean_force_n > 5.0);
    let weights = hinge.peak_force_bw.unwrap() * 2.0 * 9.81;
    assert!((weights - hinge.peak_force_n).abs() < 1e-9);
}

/// The same pendulum with a spring, a damper and soft limits at its hinge.
#[test]
fn springs_dampers_and_limits_act_at_their_coordinates() {
    let mut files = files(1.0).to_vec();
    files[0].1 += "\n[[passive]]\nname = \"hinge\"\ncoordinate = \"angle\"\nstiffness = 3.0\nrest = 0.1\ndamping = 0.2\n\
        lower = -0.3\nlower_stiffness = 20.0\nupper = 0.3\nupper_stiffness = 30.0\ntransition = 0.1\nlimit_damping = 0.5\n";
    files.push(("study.toml", STUDY.to_owned()));
    let folder = in_folder(&files);
    let outcome = outcome(&folder);
    let (_, study) = study(&folder);
    let model = study.model_of(&study.jobs[0]).unwrap();
    let element = &model.spatial().unwrap().skeleton.passive[0].entry;
    let push = |t: f64| if t < 0.5 { 10.0 * (2.0 * PI * t).sin().powi(2) } else { 0.0 };
    for (t, moment) in signal(&outcome, "net_moment_n_m", "angle").into_iter().filter(|(t, _)| (0.3..0.7).contains(t)) {
        let [q, rate, second] = angle(t);
        let expected = (0.03 + 2.0 * 0.16) * second + 2.0 * 9.81 * 0.4 * q.sin() - 2.0 * push(t) * 0.8 * q.cos() - 1.5;
        let expected = expected - element.at(q, rate).value;
        assert!((moment - expected).abs() < 0.05, "{t}: {moment} {expected}");
    }
    let job = &study.jobs[0];
    let prepared = super::support::prepare(&model, &study.motion, &job.settings, job.points);
    let control = &prepared.inverse.control;
    for q in [-0.35, 0.1, 0.34, 0.6] {
        let mut z = vec![0.2; control.variables()];
        z[prepared.inverse.motion.q.at(0)] = q;
        let multipliers = vec![0.7; control.rows()];
        super::support::check_derivatives(control, &z, &multipliers, |_| true, (1e-5, 1e-4));
    }
}

#[test]
fn mistakes_in_windows_loads_and_drives_are_named() {
    let mut files = files(0.6).to_vec();
    files.push(("study.toml", STUDY.to_owned()));
    let folder = in_folder(&files);
    let said = |from: &str, to: &str| {
        assert!(STUDY.contains(from));
        std::fs::write(folder.path().join("study.toml"), STUDY.replace(from, to)).unwrap();
        let run = sinew(&["plan", "study.toml"], folder.path());
        (run.status.code(), one_line(&text(&run.stderr)))
    };
    for (from, to, expected) in [
        ("[0.2, 0.8]", "[0.2, 1.8]", vec!["study.toml:5", "within the motion, 0 to 1 s"]),
        ("[0.2, 0.8]", "[0.5, 0.5]", vec!["study.toml:5", "within the motion"]),
        ("[0.2, 0.8]", "[0.2, 0.8]", vec!["study.toml:4", "loads from 0 to 0.6 s", "window = [0.2, 0.6]"]),
        ("loads = \"loads.toml\"\n", "force_smoothing_hz = 6.0\n", vec!["study.toml:4", "no `loads` to smooth"]),
        (
            "window = [0.2, 0.8]\n[base]\nintervals = 30\nstages = 3\nmu = 1e-5\nreserves = 50.0\n",
            "window = [0.2, 0.5]\n[base]\n\"reserves.angel\" = 1.0\n",
            vec!["study.toml:7", "did you mean `angle`"],
        ),
        ("loads.toml", "missing.toml", vec!["study.toml:4", "missing.toml does not exist"]),
        ("[0.2, 0.8]\n", "[0.2, 0.5]\nmuscles = [\"none*\"]\n", vec!["study.toml:6", "no muscle matches `none*`"]),
        (
            "window = [0.2, 0.8]\n[base]\nintervals = 30\nstages = 3\nmu = 1e-5\nreserves = 50.0\n",
            "window = [0.2, 0.5]\n[base]\nintervals = 30\n",
            vec!["study.toml:2", "drives angle", "reserves.angle"],
        ),
        (
            "window = [0.2, 0.8]\n[base]\nintervals = 30",
            "window = [0.2, 0.5]\n[base]\nh = 0.07",
            vec!["study.toml:7", "`intervals` always does"],
        ),
    ] {
        let (code, said) = said(from, to);
        assert_eq!(code, Some(2), "{to}: {said}");
        expected.iter().for_each(|part| assert!(said.contains(part), "{to}: `{part}` is not in {said}"));
    }
    let planar =
        "name = \"s\"\nmodel = \"{root}/data/models/arm.toml\"\nmotion = \"{root}/data/motions/arm_curl.csv\"\n";
    let check = |more: &str| {
        let folder = super::support::folder(&[
            ("study.toml", &format!("{planar}{more}")),
            ("loads.toml", &files[2].1),
            ("forces.csv", &files[3].1),
        ]);
        let run = sinew(&["check", "study.toml"], folder.path());
        (run.status.code(), one_line(&(text(&run.stdout) + &text(&run.stderr))))
    };
    let (code, said) = check("loads = \"loads.toml\"\n");
    assert!(code == Some(2) && said.contains("need a spatial model"), "{said}");
    let (code, said) = check("muscles = [\"bisceps\"]\n");
    assert!(code == Some(2) && said.contains("no muscle matches `bisceps`") && said.contains("did you mean"), "{said}");
    assert_eq!(check("muscles = [\"biceps\", \"tri*\"]\n").0, Some(0));
}

/// Both legs of a gait model under their ground reactions, with reserves of 1 N m and 1 N.
#[test]
fn a_gait_model_walks_by_its_muscles_under_ground_reactions() {
    let Some(model) = shared("walking/subject_walk_scaled.osim") else { return };
    let place = model.parent().unwrap().display();
    let text = format!(
        "name = \"gait\"\nmodel = \"{place}/subject_walk_scaled.osim\"\nmotion = \"{place}/coordinates.sto\"\n\
         loads = \"{place}/grf_walk.xml\"\nwindow = [0.48, 1.61]\n[base]\n\"body.*.role\" = \"free\"\nintervals = 25\n\
         smoothing_hz = 6.0\nbounds = \"both_boxed\"\nmu = 0.1\nreserves = 1.0\nregularity = \"off\"\ntrajectories = true\n"
    );
    let outcome = outcome(&folder(&[("study.toml", &text)]));
    let (degrees, metres) = (outcome.job.tracking_rms_deg.unwrap(), outcome.job.tracking_rms_m.unwrap());
    println!("{degrees}°, {metres} m, {} iterations", outcome.job.iterations.unwrap());
    assert!(degrees < 2.0 && metres < 0.01, "{degrees}° {metres} m");
    for row in outcome.reserves.iter().filter(|row| row.is_reserve && !row.coordinate.starts_with("mtp")) {
        assert!(row.share.unwrap() < 0.05, "{row:?}");
    }
    for joint in ["hip_r", "hip_l", "walker_knee_r", "walker_knee_l", "ankle_r", "ankle_l"] {
        let row = outcome.joints.iter().find(|row| row.joint == joint).unwrap();
        let peak = row.peak_force_bw.unwrap();
        assert!((2.5..7.0).contains(&peak), "{joint}: {peak} body weights");
    }
    // The smoothed motion's own moments need not be those of the unsmoothed one, but come near them.
    let published = std::fs::read_to_string(model.with_file_name("id_opensim.csv")).unwrap();
    let mut rows = csv::ReaderBuilder::new().comment(Some(b'#')).from_reader(published.as_bytes());
    let head = rows.headers().unwrap().clone();
    let column = |name: &str| head.iter().position(|own| own.starts_with(name)).unwrap();
    let known: Vec<Vec<f64>> =
        rows.records().map(|row| row.unwrap().iter().map(|x| x.parse().unwrap()).collect()).collect();
    for coordinate in
        ["hip_flexion_r", "knee_angle_r", "ankle_angle_r", "hip_flexion_l", "knee_angle_l", "ankle_angle_l"]
    {
        let values = column(coordinate);
        let range = known.iter().map(|row| row[values]).fold(f64::NEG_INFINITY, f64::max)
            - known.iter().map(|row| row[values]).fold(f64::INFINITY, f64::min);
        let own = signal(&outcome, "net_moment_n_m", coordinate);
        let square: f64 = own
            .iter()
            .map(|(t, moment)| {
                let near = known.iter().min_by(|a, b| (a[0] - t).abs().total_cmp(&(b[0] - t).abs())).unwrap();
                (near[values] - moment).powi(2)
            })
            .sum();
        let rms = (square / own.len() as f64).sqrt();
        println!("{coordinate}: {rms:.2} N m of {range:.0}");
        assert!(rms < 0.12 * range, "{coordinate}: {rms} N m of {range}");
    }
}

/// Public models with all bodies free, 0.2 s about their default pose (the shoulder whose default pose tears it apart: about
/// one that closes it), with reserves.
#[test]
fn public_models_move_by_forces_about_their_default_pose() {
    let poling = std::fs::read_to_string(super::support::root().join("data/motions/double_poling.csv")).unwrap();
    let mut rows = poling.lines().filter(|line| !line.starts_with('#')).map(|line| line.split(',').collect::<Vec<_>>());
    let (head, first) = (rows.next().unwrap(), rows.next().unwrap());
    let closed = |name: &str| {
        let column = head.iter().position(|own| *own == format!("{name}_deg"))?;
        Some(first[column].parse::<f64>().unwrap().to_radians())
    };
    for file in [
        "osim/arm26.osim",
        "osim/thoracoscapular_plus_elbow.osim",
        "osim/field/das3.osim",
        "osim/field/mobl_arms_41.osim",
        "osim/field/rat_hindlimb.osim",
        "walking/subject_walk_scaled.osim",
    ] {
        let Some(path) = shared(file) else { return };
        let source = sinew::internals::error::SourceFile::read(&path).unwrap();
        let skeleton = sinew::internals::study::load_skeleton(&source).unwrap().1;
        let moved: Vec<_> = skeleton.coordinates.iter().filter(|c| !c.locked && c.follows.is_none()).collect();
        let unit = |is_angle: bool| if is_angle { "rad" } else { "m" };
        let names: Vec<String> = moved.iter().map(|c| format!("{}_{}", c.name, unit(c.is_angle))).collect();
        let is_closed = file.contains("thoraco");
        let row = |k: usize| {
            let t = 0.01 * k as f64;
            let sway = if is_closed { 0.0 } else { 0.005 * (10.0 * PI * t).sin() };
            let pose = moved.iter().map(|c| {
                let start = if is_closed { closed(&c.name).unwrap_or(c.default) } else { c.default };
                format!(",{}", start + sway)
            });
            format!("{t}{}\n", pose.collect::<String>())
        };
        let motion = format!("time,{}\n{}", names.join(","), (0..=20).map(row).collect::<String>());
        let text = format!(
            "name = \"s\"\nmodel = \"{}\"\nmotion = \"motion.csv\"\n[base]\n\"body.*.role\" = \"free\"\nintervals = 8\n\
             stages = 1\nmu = 0.1\nreserves = 100.0\nbounds = \"both_boxed\"\nregularity = \"off\"\npassive_forces = {}\n",
            path.display(),
            // By its own numbers some of the rat's fibres are stretched to seven times their optimal length.
            !file.contains("rat")
        );
        let outcome = outcome(&folder(&[("study.toml", &text), ("motion.csv", &motion)]));
        let degrees = outcome.job.tracking_rms_deg.unwrap();
        println!("{file}: {degrees:.3}°, {} iterations", outcome.job.iterations.unwrap());
        assert!(degrees < 2.0, "{file}: {degrees}°");
    }
}
