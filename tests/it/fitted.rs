//! Muscles whose length is a polynomial of coordinates (function-based paths).

use rand::{RngExt, SeedableRng};
use sinew::internals::model::Model;
use sinew::internals::outcome::Status;
use sinew::internals::skeleton::file::SkeletonFile;
use sinew::internals::solve::solve;

use super::cli::{one_line, sinew, text};
use super::support::{folder, root, shared, study};

/// Two links in space and a muscle whose length is 0.3 − 0.02 x + 0.01 y + 0.05 x² + 0.03 x y − 0.04 y²; the third angle
/// follows the second.
pub const ARM: &str = r#"
name = "fitted arm"
dimensions = 3
body = [
    { name = "upper", mass = 2.0, centre_of_mass = [0.0, -0.15, 0.0], inertia = [0.02, 0.005, 0.02, 0.0, 0.0, 0.0] },
    { name = "lower", mass = 1.0, centre_of_mass = [0.0, -0.15, 0.0], inertia = [0.01, 0.002, 0.01, 0.0, 0.0, 0.0] },
]
coordinate = [
    { name = "shoulder" },
    { name = "elbow" },
    { name = "twist", follows = { coordinate = "elbow", by = { polynomial = [0.1, 0.4, -0.3] } } },
]
joint = [
    { name = "shoulder_joint", kind = "axes", parent = "ground", child = "upper", rotations = [
        { coordinate = "shoulder", axis = [0.0, 0.0, 1.0] },
    ] },
    { name = "elbow_joint", kind = "axes", parent = "upper", child = "lower", parent_point = [0.0, -0.3, 0.0], rotations = [
        { coordinate = "elbow", axis = [0.0, 0.0, 1.0] },
        { coordinate = "twist", axis = [0.0, 1.0, 0.0] },
    ] },
]

[[muscle]]
name = "of_two"
max_isometric_force = 100.0
optimal_fibre_length = 0.1
tendon_slack_length = 0.1
length = { coordinates = ["shoulder", "elbow"], order = 2, coefficients = [0.3, 0.01, -0.04, -0.02, 0.03, 0.05] }

[[muscle]]
name = "of_a_follower"
max_isometric_force = 100.0
optimal_fibre_length = 0.1
tendon_slack_length = 0.1
length = { coordinates = ["elbow", "twist"], order = 3, coefficients = [0.3, 0.01, -0.04, 0.02, -0.02, 0.03, 0.01, 0.05, 0.02, -0.03] }
"#;

#[test]
fn lengths_are_those_of_the_polynomial_and_have_their_derivatives() {
    let file: SkeletonFile = toml::from_str(ARM).unwrap();
    let skeleton = std::sync::Arc::new(file.check().unwrap());
    let model = Model::of_skeleton(skeleton.clone());
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(7);
    for _ in 0..20 {
        let q: [f64; 2] = [0, 1].map(|_| rng.random_range(-1.0..1.0));
        let direction: [f64; 2] = [0, 1].map(|_| rng.random_range(-1.0..1.0));
        let [x, y] = q;
        let by_hand = 0.3 - 0.02 * x + 0.01 * y + 0.05 * x * x + 0.03 * x * y - 0.04 * y * y;
        let arms = skeleton.lengths_and_moment_arms(&[x, y, 0.0]);
        assert!((arms[0].0 - by_hand).abs() < 1e-15);
        assert!((arms[0].1[0] - (0.02 - 0.1 * x - 0.03 * y)).abs() < 1e-14);
        for (muscle, (length, arms)) in model.muscles.iter().zip(&arms) {
            let at = |q: [f64; 2]| {
                let mut out = muscle.path.buffer();
                muscle.path.length(&q, true, &mut out);
                out
            };
            let (here, slots) = (at(q), muscle.path.slots());
            assert!((here.value - length).abs() < 1e-15, "{}", muscle.name);
            let along = muscle.path.length_along(&q, &direction);
            let e = 1e-5;
            let moved = |e: f64, direction: [f64; 2]| at([q[0] + e * direction[0], q[1] + e * direction[1]]);
            let (up, down) = (moved(e, direction), moved(-e, direction));
            let slope = |up: f64, down: f64| (up - down) / (2.0 * e);
            assert!((slope(up.value, down.value) - along.value.eps).abs() < 1e-9, "{}", muscle.name);
            for (i, &slot) in slots.iter().enumerate() {
                assert!((here.gradient[i] + arms[slot]).abs() < 1e-14, "{} {slot}", muscle.name);
                assert!((slope(up.gradient[i], down.gradient[i]) - along.gradient[i].eps).abs() < 1e-9);
                let mut unit = [0.0; 2];
                unit[slot] = 1.0;
                let (up, down) = (moved(e, unit), moved(-e, unit));
                for j in 0..slots.len() {
                    let bend = here.hessian[i * slots.len() + j];
                    assert!((slope(up.gradient[j], down.gradient[j]) - bend).abs() < 1e-9, "{} {i} {j}", muscle.name);
                }
            }
            for k in 0..here.hessian.len() {
                assert!((slope(up.hessian[k], down.hessian[k]) - along.hessian[k].eps).abs() < 1e-8, "{k}");
            }
        }
    }
}

#[test]
fn mistakes_in_a_polynomial_are_named() {
    let refused = |from: &str, to: &str| {
        let file: SkeletonFile = toml::from_str(&ARM.replacen(from, to, 1)).unwrap();
        let issue = file.check().unwrap_err();
        format!("{} {} {}", issue.path.join("."), issue.message, issue.help.unwrap_or_default())
    };
    let said = refused("coordinates = [\"shoulder\", \"elbow\"]", "coordinates = [\"shoulder\", \"elbw\"]");
    assert!(said.contains("muscle.of_two.length") && said.contains("did you mean `elbow`"), "{said}");
    let said = refused("0.03, 0.05]", "0.03]");
    assert!(said.contains("found 5 coefficients") && said.contains("has 6 terms"), "{said}");
    let said = refused("coordinates = [\"shoulder\", \"elbow\"]", "coordinates = [\"elbow\", \"elbow\"]");
    assert!(said.contains("named twice"), "{said}");
}

fn paths(muscle: &str, more: &str) -> String {
    format!(
        "<?xml version=\"1.0\"?><OpenSimDocument Version=\"40600\"><Set_FunctionBasedPath_><objects>\
         <FunctionBasedPath name=\"/forceset/{muscle}\">\
         <coordinate_paths>/jointset/a/shoulder_angle /jointset/b/elbow_angle</coordinate_paths>\
         <length_function><MultivariatePolynomialFunction><coefficients>0.38 -0.02 0.001{more}</coefficients>\
         <dimension>2</dimension><order>1</order></MultivariatePolynomialFunction></length_function>\
         </FunctionBasedPath></objects></Set_FunctionBasedPath_></OpenSimDocument>"
    )
}

#[test]
fn a_file_of_paths_replaces_lengths_and_a_path_of_the_model_itself_is_read() {
    let model = root().join("tests/fixtures/osim/arm_v4.osim");
    let own = std::fs::read_to_string(&model).unwrap();
    let set = paths("flexor", "");
    let path = &set[set.find("<FunctionBasedPath").unwrap()..set.find("</objects>").unwrap()];
    let (from, to) =
        (own.find("<GeometryPath").unwrap(), own.find("</GeometryPath>").unwrap() + "</GeometryPath>".len());
    let within = format!("{}<path>{path}</path>{}", &own[..from], &own[to..]);
    let folder = folder(&[
        ("set.xml", &set),
        ("unknown.xml", &paths("flexr", "")),
        ("long.xml", &paths("flexor", " 3")),
        ("within.osim", &within),
        ("poses.csv", "shoulder_angle_deg,elbow_angle_deg\n0,0\n20,40\n"),
    ]);
    let run = |arguments: &[&str]| {
        let run = sinew(arguments, folder.path());
        (run.status.code(), one_line(&(text(&run.stdout) + &text(&run.stderr))))
    };
    let model = model.to_str().unwrap();
    assert_eq!(run(&["import", model, "--paths", "set.xml", "--out", "set.toml"]).0, Some(0));
    let (code, said) = run(&["import", "within.osim", "--out", "within.toml"]);
    assert!(code == Some(0) && said.contains("no loads of joints are given"), "{said}");
    for file in ["set.toml", "within.toml"] {
        let (code, said) = run(&["moment-arms", file, "poses.csv"]);
        assert_eq!(code, Some(0), "{said}");
        let length = 0.38 + 0.001 * 20f64.to_radians() - 0.02 * 40f64.to_radians();
        let row = said.split(' ').find(|row| row.starts_with("1,flexor,")).unwrap();
        let numbers: Vec<f64> = row.split(',').skip(2).map(|x| x.parse().unwrap()).collect();
        assert!((numbers[0] - length).abs() < 1e-12, "{said}");
        assert!((numbers[1] + 0.001).abs() < 1e-12 && (numbers[2] - 0.02).abs() < 1e-12, "{said}");
    }
    let (code, said) = run(&["import", model, "--paths", "unknown.xml", "--out", "u.toml"]);
    assert!(code == Some(2) && said.contains("no muscle `flexr`") && said.contains("`flexor`"), "{said}");
    let (code, said) = run(&["import", model, "--paths", "long.xml", "--out", "l.toml"]);
    assert!(code == Some(2) && said.contains("found 4 coefficients"), "{said}");
}

/// The fitted muscles of the public walking model, against OpenSim's lengths along the paths.
#[test]
fn fitted_lengths_of_a_gait_model_are_near_those_along_its_paths() {
    let (Some(model), Some(paths), Some(truth)) = (
        shared("walking/subject_walk_scaled.osim"),
        shared("walking/subject_walk_scaled_FunctionBasedPathSet.xml"),
        shared("walking/lengths_and_moment_arms_opensim.csv"),
    ) else {
        return;
    };
    let motion = std::fs::read_to_string(shared("walking/coordinates.sto").unwrap()).unwrap();
    let truth = super::wrapping::csv(&truth);
    let folder = folder(&[("poses.csv", &super::wrapping::poses_of(&motion, &truth))]);
    let import = ["import", model.to_str().unwrap(), "--paths", paths.to_str().unwrap(), "--out", "fitted.toml"];
    assert_eq!(sinew(&import, folder.path()).status.code(), Some(0));
    let run = sinew(&["moment-arms", "fitted.toml", "poses.csv", "--out", "arms.csv"], folder.path());
    assert_eq!(run.status.code(), Some(0), "{}", text(&run.stderr));
    let found = super::wrapping::csv(&folder.path().join("arms.csv"));
    let (mut squares, mut worst, mut count) = (0.0, 0.0f64, 0);
    for (own, truth) in found.iter().zip(&truth) {
        assert_eq!(own["muscle"], truth["muscle"]);
        // These also cross the joint of the toes, which the fitted model has welded in another pose.
        if ["edl", "ehl", "fdl", "fhl"].iter().any(|toes| own["muscle"].starts_with(toes)) {
            continue;
        }
        let gap = own["length_m"].parse::<f64>().unwrap() - truth["length_m"].parse::<f64>().unwrap();
        squares += gap * gap;
        worst = worst.max(gap.abs());
        count += 1;
    }
    let rms = (squares / f64::from(count)).sqrt();
    println!("fitted lengths: {rms} m RMS, at most {worst} m, {count} rows");
    assert!(count == 24 * 72 && rms < 1e-3 && worst < 1e-2, "{rms} {worst}");
}

#[test]
fn a_study_moves_by_fitted_muscles() {
    let motion = "time_s,shoulder_deg,elbow_deg\n0,0,20\n0.1,2,25\n0.2,5,33\n0.3,8,40\n0.4,10,44\n";
    let text = "name = 's'\nmodel = 'arm.toml'\nmotion = 'm.csv'\n[base]\nh = 0.1\nmu = 0.1\nregularity = 'off'\n\
                reserves = 20.0\ntrajectories = true\n";
    let folder = folder(&[("study.toml", text), ("m.csv", motion), ("arm.toml", ARM)]);
    let (_, study) = study(&folder);
    let job = &study.jobs[0];
    let outcome = solve(&study.model, &study.motion, &job.settings, job.points);
    assert_eq!(outcome.job.status, Status::Converged, "{:?}", outcome.job.error);
    // Where a muscle pulls at the bones is unknown.
    assert!(outcome.joints.is_empty());
    assert!(outcome.muscles.iter().all(|row| row.mean_force_n.is_finite()));
}
