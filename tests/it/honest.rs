//! No silent errors: losses are reported, doubtful results have a warning, and jobs that have not converged have no
//! verdict.

use sinew::internals::error::SourceFile;
use sinew::internals::opensim::{Imported, Weight, import};
use sinew::internals::outcome::Status;
use sinew::internals::plausibility::WARNING_KINDS;
use sinew::internals::skeleton::file::ObstacleEntry;
use sinew::internals::solve::solve;
use sinew::internals::study::load_skeleton;
use sinew::internals::tables::{Table, read};

use super::cli::{said, sinew, text};
use super::support::{folder, root, study};

/// A forearm on a hinge with a muscle. `more` is added to the parts of the model, `forces` to its forces.
fn osim(more: &str, forces: &str, body: &str, joint: &str) -> String {
    format!(
        "<?xml version=\"1.0\"?>\n<OpenSimDocument Version=\"40000\"><Model name=\"m\">{more}
<BodySet><objects><Body name=\"fore\">{body}</Body></objects></BodySet>
<JointSet><objects>{joint}</objects></JointSet>
<ForceSet><objects>{}{forces}</objects></ForceSet></Model></OpenSimDocument>",
        muscle("flexor")
    )
}

const BODY: &str = "<mass>1.6</mass><mass_center>0 -0.17 0</mass_center><inertia>0.018 0.002 0.018 0 0 0</inertia>";
const HINGE: &str = "<PinJoint name=\"elbow\"><socket_parent_frame>/ground</socket_parent_frame>\
    <socket_child_frame>/bodyset/fore</socket_child_frame><coordinates><Coordinate name=\"elbow_angle\">\
    <range>0 2</range></Coordinate></coordinates></PinJoint>";

fn muscle(name: &str) -> String {
    format!(
        "<Thelen2003Muscle name=\"{name}\"><GeometryPath name=\"p\"><PathPointSet><objects>\
         <PathPoint name=\"a\"><socket_parent_frame>/ground</socket_parent_frame><location>0.03 0.3 0</location>\
         </PathPoint>\
         <PathPoint name=\"b\"><socket_parent_frame>/bodyset/fore</socket_parent_frame>\
         <location>0.015 -0.045 0</location></PathPoint>\
         </objects></PathPointSet></GeometryPath><max_isometric_force>600</max_isometric_force>\
         <optimal_fiber_length>0.13</optimal_fiber_length><tendon_slack_length>0.2</tendon_slack_length>\
         </Thelen2003Muscle>"
    )
}

fn imported(text: String) -> Imported {
    let file = SourceFile { path: "m.osim".into(), text };
    import(&file).unwrap_or_else(|e| panic!("{:?}", miette::Report::new(e)))
}

fn refused(text: String) -> String {
    let error = import(&SourceFile { path: "m.osim".into(), text }).map(|_| ()).expect_err("it is refused");
    said(error)
}

fn has_note(imported: &Imported, weight: Weight, what: &str, lost: &str) -> bool {
    imported.notes.iter().any(|note| note.weight == weight && note.what.contains(what) && note.lost.contains(lost))
}

#[test]
fn components_of_a_model_are_read_and_others_named() {
    let components = format!(
        "<components>{}<Body name=\"hand\">{BODY}</Body><WeldJoint name=\"wrist\">\
         <socket_parent_frame>/bodyset/fore</socket_parent_frame>\
         <socket_child_frame>/hand</socket_child_frame></WeldJoint><SmoothSphereHalfSpaceForce name=\"heel\"/>\
         <Gadget name=\"g\"/></components>",
        muscle("in_components")
    );
    let found = imported(osim(&components, "", BODY, HINGE));
    assert_eq!((found.file.muscle.len(), found.file.body.len(), found.file.joint.len()), (2, 2, 2));
    // Ground contact cannot be replaced by muscles; the most serious loss comes first.
    let heel = &found.notes[0];
    assert!(heel.weight == Weight::Lost && heel.what.contains("heel") && heel.lost.contains("ground"), "{heel:?}");
    assert!(!heel.lost.contains("compensate"));
    assert!(has_note(&found, Weight::Lost, "Gadget", "not supported"));
}

#[test]
fn what_opensim_writes_and_is_no_xml_is_read_all_the_same() {
    let plain = osim("", "", BODY, HINGE);
    let contact = "<HuntCrossleyForce name=\"foot\"><HuntCrossleyForce::ContactParametersSet><objects/>\
        </HuntCrossleyForce::ContactParametersSet></HuntCrossleyForce>";
    let found = imported(osim("", contact, BODY, HINGE));
    assert!(has_note(&found, Weight::Lost, "foot", "contact"));
    for (from, to) in
        [("<BodySet>", "<credits>Smith & Jones</credits><BodySet>"), ("<BodySet>", "<!-- one -- two --><BodySet>")]
    {
        assert_eq!(imported(plain.replace(from, to)).file.muscle.len(), 1, "{to}");
    }
    // Latin-1, which is not valid UTF-8.
    let folder = tempfile::tempdir().unwrap();
    let mut bytes = plain.replace("<BodySet>", "<credits>Mxller</credits><BodySet>").into_bytes();
    let at = bytes.windows(6).position(|w| w == b"Mxller").unwrap();
    bytes[at + 1] = 0xfc;
    std::fs::write(folder.path().join("m.osim"), bytes).unwrap();
    let read = import(&SourceFile::read(&folder.path().join("m.osim")).unwrap()).unwrap();
    assert!(read.file.source.unwrap().contains("Müller"));
}

#[test]
fn bodies_without_an_inertia_or_a_mass_are_mended_with_a_note() {
    for (body, lost) in [
        (
            "<mass>1.6</mass><mass_center>0 -0.17 0</mass_center><inertia>0 0 0 0 0 0</inertia>",
            "no inertia about x, y, z",
        ),
        (
            "<mass>1.6</mass><mass_center>0 -0.17 0</mass_center><inertia>0 0 0.018 0 0 0</inertia>",
            "no inertia about x, y",
        ),
        ("<mass>0</mass><mass_center>0 0 0</mass_center><inertia>0 0 0 0 0 0</inertia>", "no mass"),
        ("<mass_center>0 -0.17 0</mass_center><inertia>0.01 0.01 0.018 0 0 0</inertia>", "1 kg"),
    ] {
        let found = imported(osim("", "", body, HINGE));
        assert!(has_note(&found, Weight::Changed, "body fore", lost), "{lost}: {:?}", found.notes);
        assert!(found.file.check().unwrap().check_study().is_ok());
        assert!(found.file.body[0].inertia[2] > 0.0 && found.file.body[0].mass > 0.0);
    }
}

#[test]
fn joints_are_what_they_are_or_an_error_that_names_them() {
    let said = refused(osim("", "", BODY, &HINGE.replace("PinJoint", "EllipsoidJoint")));
    assert!(said.contains("EllipsoidJoint `elbow`") && said.contains("CustomJoint"), "{said}");
    // An empty function stands for the coordinate itself.
    let axis = |k: usize, name: &str, axis: &str| {
        let (coordinate, function) = if k == 2 {
            ("elbow_angle", "<function/>")
        } else {
            ("", "<function><Constant><value>0</value></Constant></function>")
        };
        format!(
            "<TransformAxis name=\"{name}\"><coordinates>{coordinate}</coordinates>\
             <axis>{axis}</axis>{function}</TransformAxis>"
        )
    };
    let names = ["rotation1", "rotation2", "rotation3", "translation1", "translation2", "translation3"];
    let directions = ["1 0 0", "0 1 0", "0 0 1", "1 0 0", "0 1 0", "0 0 1"];
    let axes: String = (0..6).map(|k| axis(k, names[k], directions[k])).collect();
    let custom = HINGE.replace("PinJoint", "CustomJoint").replace(
        "</coordinates></CustomJoint>",
        &format!("</coordinates><SpatialTransform>{axes}</SpatialTransform></CustomJoint>"),
    );
    let found = imported(osim("", "", BODY, &custom));
    assert_eq!(found.file.joint[0].rotations.len(), 1);
    assert!(found.file.joint[0].rotations[0].by.is_none());
    // Two joints with the same name.
    let twice = format!("<components><Body name=\"hand\">{BODY}</Body></components>");
    let second = HINGE
        .replace("/ground", "/bodyset/fore")
        .replace("/bodyset/fore</socket_child", "/hand</socket_child")
        .replace("elbow_angle", "wrist_angle");
    let found = imported(osim(&twice, "", BODY, &format!("{HINGE}{second}")));
    assert_eq!(found.file.joint.iter().map(|joint| joint.name.as_str()).collect::<Vec<_>>(), ["elbow", "elbow_2"]);
    assert!(has_note(&found, Weight::Remark, "joint elbow", "elbow_2"));
    // A pelvis with three planar coordinates is a floating base.
    let planar = "<PlanarJoint name=\"pelvis\"><socket_parent_frame>/ground</socket_parent_frame>\
        <socket_child_frame>/bodyset/fore</socket_child_frame><coordinates><Coordinate name=\"tilt\"/>\
        <Coordinate name=\"tx\"/><Coordinate name=\"ty\"/></coordinates></PlanarJoint>";
    let found = imported(osim("", "", BODY, planar));
    assert_eq!(found.file.body[0].role, sinew::internals::skeleton::Role::Given);
}

#[test]
fn numbers_that_a_muscle_lacks_are_those_of_opensim_and_a_path_has_a_length() {
    let lacking = osim("", "", BODY, HINGE)
        .replace("<tendon_slack_length>0.2</tendon_slack_length>", "")
        .replace("<max_isometric_force>600</max_isometric_force>", "");
    let found = imported(lacking);
    let flexor = &found.file.muscle[0];
    assert_eq!((flexor.tendon_slack_length, flexor.max_isometric_force), (0.2, 1000.0));
    assert!(has_note(&found, Weight::Changed, "flexor", "tendon_slack_length: 0.2 m"));
    let zero = osim("", "", BODY, HINGE).replace("<tendon_slack_length>0.2", "<tendon_slack_length>0");
    assert!(has_note(&imported(zero), Weight::Changed, "flexor", "rigid"));
    let nil = osim("", "", BODY, HINGE).replace(
        "/ground</socket_parent_frame><location>0.03 0.3 0",
        "/bodyset/fore</socket_parent_frame><location>0.015 -0.045 0",
    );
    assert!(refused(nil).contains("the path has zero length between them"));
}

/// References to wrapping objects, and to parts of a path by number, keep their meaning. What is switched off is not a
/// loss.
#[test]
fn what_is_mended_keeps_its_references() {
    let sphere =
        |name: &str, radius: f64| format!("<WrapSphere name=\"{name}\"><radius>{radius}</radius></WrapSphere>");
    let body = format!(
        "{BODY}<WrapObjectSet><objects>{}{}{}</objects></WrapObjectSet>",
        sphere("a", 0.01),
        sphere("a", 0.02),
        sphere("a_2", 0.03)
    );
    let wrap = "</PathPointSet><PathWrapSet><objects><PathWrap name=\"w\"><wrap_object>a_2</wrap_object>\
        <range>3 4</range></PathWrap></objects></PathWrapSet>";
    let point = |x: &str| {
        format!(
            "<PathPoint name=\"p\"><socket_parent_frame>/ground</socket_parent_frame><location>{x} 0.3 0</location>\
             </PathPoint>"
        )
    };
    // Four points, of which the first two coincide: the range refers to parts by their points.
    let model = osim("", "", &body, HINGE)
        .replace("<PathPoint name=\"a\">", &format!("{}{}<PathPoint name=\"a\">", point("0.05"), point("0.05")))
        .replace("</PathPointSet>", wrap);
    let found = imported(model);
    let flexor = &found.file.muscle[0];
    assert_eq!((flexor.path.len(), flexor.surfaces[0].surface()), (3, "a_2"));
    let named: Vec<(&str, Option<f64>)> = found.file.surface.iter().map(|s| (s.name.as_str(), s.radius)).collect();
    assert_eq!(named, [("a", Some(0.01)), ("a_3", Some(0.02)), ("a_2", Some(0.03))]);
    let renumbered = |first, last| {
        let mut parts = ObstacleEntry::Parts { name: "s".into(), parts: [first, last] };
        let left = parts.renumber(&[1, 4]);
        let ObstacleEntry::Parts { parts, .. } = parts else { unreachable!() };
        left.then_some(parts)
    };
    // Points 0 to 6, of which 1 and 4 repeat 0 and 3: parts 0 and 3 of parts 0 to 5 have no length.
    assert_eq!(
        [renumbered(0, 0), renumbered(0, 1), renumbered(1, 3), renumbered(2, 5)],
        [None, Some([0, 0]), Some([0, 1]), Some([1, 3])]
    );
    let off = "<CoordinateActuator name=\"reserve\"><appliesForce>false</appliesForce></CoordinateActuator>";
    assert!(has_note(&imported(osim("", off, BODY, HINGE)), Weight::Remark, "reserve", "disabled"));
}

const LIFT: &str =
    "inDegrees=yes\nlift\nnRows=5\nendheader\ntime\telbow_angle\n0\t10\n0.1\t20\n0.2\t30\n0.3\t40\n0.4\t50\n";

#[test]
fn what_a_model_loses_is_said_wherever_a_study_names_it() {
    let reserve = "<TorqueActuator name=\"reserve\"/>";
    let model = osim("", reserve, BODY, HINGE);
    let text_of_study = "name = 's'\nmodel = 'm.osim'\nmotion = 'lift.mot'\n[base]\nh = 0.1\nregularity = 'off'\n";
    let folder = folder(&[("m.osim", &model), ("lift.mot", LIFT), ("study.toml", text_of_study)]);
    for arguments in [&["check", "study.toml"][..], &["run", "study.toml"], &["check", "m.osim"], &["import", "m.osim"]]
    {
        let run = sinew(arguments, folder.path());
        let said = text(&run.stdout) + &text(&run.stderr);
        assert!(said.contains("TorqueActuator reserve"), "{arguments:?}: {said}");
    }
    // --strict concerns losses only.
    let strict = |model: &str| {
        std::fs::write(folder.path().join("n.osim"), model).unwrap();
        let _ = std::fs::remove_file(folder.path().join("n.toml"));
        sinew(&["import", "n.osim", "--strict"], folder.path()).status.code()
    };
    assert_eq!((strict(&model), strict(&osim("", "", BODY, HINGE))), (Some(2), Some(0)));
}

#[test]
fn limits_and_springs_are_imported_in_radians() {
    let forces = "<CoordinateLimitForce name=\"stop\"><coordinate>elbow_angle</coordinate>\
        <upper_stiffness>2</upper_stiffness><upper_limit>90</upper_limit><lower_stiffness>1</lower_stiffness>\
        <lower_limit>-10</lower_limit><damping>0.5</damping><transition>5</transition></CoordinateLimitForce>\
        <SpringGeneralizedForce name=\"stop\"><coordinate>elbow_angle</coordinate><stiffness>3</stiffness>\
        <rest_length>0.2</rest_length><viscosity>0.1</viscosity></SpringGeneralizedForce>";
    let model = load_skeleton(&SourceFile { path: "m.osim".into(), text: osim("", forces, BODY, HINGE) }).unwrap().1;
    let [stop, spring] = &model.passive[..] else { panic!("{:?}", model.passive) };
    let degree = 1f64.to_radians();
    assert_eq!(stop.entry.upper, Some(90.0 * degree));
    assert_eq!(stop.entry.lower, Some(-10.0 * degree));
    // Ten degrees beyond the limit.
    assert!((stop.entry.at(100.0 * degree, 0.0).value + 20.0).abs() < 1e-12);
    assert!((stop.entry.at(-20.0 * degree, 2.0 * degree).value - (10.0 - 1.0)).abs() < 1e-12);
    assert!((spring.entry.at(0.7, 2.0).value + 3.0 * 0.5 + 0.2).abs() < 1e-12 && spring.entry.name == "stop_2");
}

#[test]
fn a_study_in_which_nothing_moves_is_refused_and_given_muscles_stop_none() {
    let locked = HINGE.replace("<range>0 2</range>", "<locked>true</locked>");
    let skeleton = |text: String| load_skeleton(&SourceFile { path: "m.osim".into(), text }).unwrap().1;
    let issue = skeleton(osim("", "", BODY, &locked)).check_study().unwrap_err();
    assert!(issue.message.contains("nothing moves by forces"), "{issue:?}");
    let base = format!("<components><Body name=\"base\">{BODY}</Body></components>");
    let free = "<FreeJoint name=\"free\"><socket_parent_frame>/ground</socket_parent_frame>\
        <socket_child_frame>/base</socket_child_frame><coordinates><Coordinate name=\"c0\"/><Coordinate name=\"c1\"/>\
        <Coordinate name=\"c2\"/><Coordinate name=\"c3\"/><Coordinate name=\"c4\"/><Coordinate name=\"c5\"/>\
        </coordinates></FreeJoint>";
    let conditional = muscle("given").replace("/bodyset/fore", "/base").replace(
        "</objects></PathPointSet>",
        "<ConditionalPathPoint name=\"c\"><socket_parent_frame>/base</socket_parent_frame>\
         <location>0.1 0 0</location><socket_coordinate>/jointset/elbow/elbow_angle</socket_coordinate>\
         <range>0 1</range></ConditionalPathPoint></objects></PathPointSet>",
    );
    let model = skeleton(osim(&base, &conditional, BODY, &format!("{HINGE}{free}")));
    assert!(model.check_study().is_ok(), "{:?}", model.obstacles());
    let massless = "<mass>0</mass><mass_center>0 -0.17 0</mass_center><inertia>0 0 0 0 0 0</inertia>";
    let mut model = skeleton(osim("", "", BODY, HINGE));
    (model.bodies[0].mass, model.bodies[0].inertia) = (0.0, [0.0; 6]);
    let obstacles = model.obstacles();
    assert!(obstacles.len() == 1 && obstacles[0].message.contains("moves no mass"), "{obstacles:?}");
    // On import it gets a small one.
    assert!(skeleton(osim("", "", massless, HINGE)).check_study().is_ok());
}

#[test]
fn check_lists_all_mistakes_and_all_obstacles() {
    let arm = std::fs::read_to_string(root().join("data/models/arm.toml")).unwrap();
    let wrong = arm
        .replacen("mass = ", "mass = -", 1)
        .replacen("tendon_slack_length = ", "tendon_slack_length = -", 2)
        .replacen("[[muscle]]\n", "[[muscle]]\ncolour = 3\n", 2);
    let study = "name = 's'\nmodel = '{root}/data/models/arm.toml'\nmotion = '{root}/data/motions/arm_curl.csv'\n\
        [base]\nh = -1\nmue = 3\nbounds = 'all'\n";
    let folder = folder(&[("model.toml", &wrong), ("study.toml", study)]);
    let said = |file: &str| text(&sinew(&["check", file], folder.path()).stderr);
    assert_eq!(said("model.toml").matches("unknown field `colour`").count(), 2, "{}", said("model.toml"));
    std::fs::write(folder.path().join("model.toml"), wrong.replace("colour = 3\n", "")).unwrap();
    assert_eq!(said("model.toml").matches("must be a positive number").count(), 3, "{}", said("model.toml"));
    for mistake in ["base.h", "unknown setting `mue`", "found \"all\""] {
        assert!(said("study.toml").contains(mistake), "{mistake}: {}", said("study.toml"));
    }
    // Two joints that move nothing with a mass.
    let joint = |name: &str, body: &str| {
        format!(
            "[[body]]\nname = \"{body}\"\nmass = 0.0\ncentre_of_mass = [0.0, 0.0, 0.0]\ninertia = [0.0, 0.0, 0.0, 0.0, \
             0.0, 0.0]\n[[joint]]\nname = \"of_{body}\"\nkind = \"axes\"\nparent = \"ground\"\nchild = \"{body}\"\n\
             rotations = [{{ coordinate = \"{name}\", axis = [0.0, 0.0, 1.0] }}]\n[[coordinate]]\nname = \"{name}\"\n"
        )
    };
    let empty = format!("name = \"m\"\ndimensions = 3\n{}{}", joint("one", "a"), joint("two", "b"));
    std::fs::write(folder.path().join("empty.toml"), empty).unwrap();
    let listed = text(&sinew(&["check", "empty.toml"], folder.path()).stdout);
    for obstacle in ["coordinate.one", "coordinate.two"] {
        assert!(listed.contains(obstacle), "{obstacle}: {listed}");
    }
}

const ELBOW: &str = r#"
name = "elbow"
gravity = [0.0, -9.81]
[[body]]
name = "forearm"
mass = 1.6
centre_of_mass = [0.0, -0.17]
inertia = 0.018
[[joint]]
name = "elbow"
kind = "revolute"
parent = "ground"
parent_point = [0.0, -0.3]
child = "forearm"
child_point = [0.0, 0.0]
coordinate = "elbow_angle"
[[muscle]]
name = "flexor"
max_isometric_force = 800.0
optimal_fibre_length = 0.09
tendon_slack_length = 0.07
path = [{ body = "ground", point = [0.015, -0.15] }, { body = "forearm", point = [0.012, -0.03] }]
[[muscle]]
name = "extensor"
max_isometric_force = 900.0
optimal_fibre_length = 0.11
tendon_slack_length = 0.10
path = [{ body = "ground", point = [-0.02, -0.10] }, { body = "forearm", point = [-0.02, 0.02] }]
"#;

/// Flexion of the elbow from 10° to `to` in 0.8 s, as a storage file.
fn lift(to: f64) -> String {
    let mut text = "inDegrees=yes\nendheader\ntime elbow_angle\n".to_owned();
    for k in 0..=80 {
        let s = f64::from(k) / 80.0;
        let smooth = s * s * s * (10.0 - 15.0 * s + 6.0 * s * s);
        text.push_str(&format!("{} {}\n", 1.234 + 0.01 * f64::from(k), 10.0 + (to - 10.0) * smooth));
    }
    text
}

fn elbow_study(base: &str, sweep: &str, to: f64) -> tempfile::TempDir {
    let text = format!("name = 'lift'\nmodel = 'elbow.toml'\nmotion = 'lift.mot'\n[base]\nh = 0.1\n{base}\n{sweep}\n");
    folder(&[("elbow.toml", ELBOW), ("lift.mot", &lift(to)), ("study.toml", &text)])
}

/// Runs a study. Returns a function that reads its tables by name, and the terminal output.
fn run(folder: tempfile::TempDir) -> (impl Fn(&'static str) -> Table, String) {
    let done = sinew(&["run", "study.toml", "--out", "out", "--fresh"], folder.path());
    let said = text(&done.stdout) + &text(&done.stderr);
    let file = |folder: &tempfile::TempDir, name| folder.path().join("out").join(format!("{name}.parquet"));
    assert!(file(&folder, "jobs").exists(), "{said}");
    (move |name| read(name, &file(&folder, name)).unwrap(), said)
}

#[test]
fn only_converged_jobs_have_verdicts() {
    let (table, said) = run(elbow_study(
        "bounds = 'both_boxed'",
        "[sweep.grid]\nmax_iterations = [2, 300]\n[[ratio]]\nname = 'r'\nnumerator = 'flexor'\n\
         denominator = 'extensor'",
        80.0,
    ));
    let (regularity, muscles, ratios) = (table("regularity"), table("muscles"), table("ratios"));
    for verdict in ["unique", "multipliers_unique", "answer_unique", "loads_unique"] {
        assert_eq!((regularity.flag(verdict, 0), regularity.flag(verdict, 1).is_some()), (None, true), "{verdict}");
    }
    assert_eq!(regularity.text("null_space", 0), None);
    for table in [&regularity, &muscles, &ratios] {
        assert_eq!(table.text("status", 0), Some("iteration_limit"));
    }
    assert_eq!(
        (muscles.number("mean_activation_low", 0), muscles.number("mean_activation_low", 2).is_some()),
        (None, true)
    );
    let sensitivities = table("sensitivities");
    assert!((0..sensitivities.rows()).all(|row| sensitivities.text("job_id", row) == table("jobs").text("job_id", 1)));
    assert!(said.contains("job 0: iteration_limit"), "{said}");
}

/// Each kind of warning appears on a job that deserves it, and not on one that does not. Limits can be set.
#[test]
fn every_kind_of_warning_is_given_where_it_belongs() {
    let fine = run(elbow_study("bounds = 'both_boxed'", "", 80.0));
    assert_eq!(fine.0("jobs").text("warnings", 0), None, "{}", fine.1);
    let weak = "'muscle.*.max_isometric_force_scale' = 0.08";
    for (code, base, to) in [
        ("tracking", "mu = 0.05\nbounds = 'both_boxed'\n'muscle.*.max_isometric_force_scale' = 0.07", 80.0),
        ("saturated", &format!("mu = 0.05\nbounds = 'both_boxed'\n{weak}"), 80.0),
        ("saturated", &format!("mu = 0.05\nbounds = 'both'\n{weak}"), 80.0),
        ("passive", "bounds = 'both_boxed'\n'muscle.extensor.tendon_slack_length_scale' = 0.6", 80.0),
        (
            "overload",
            "bounds = 'both_boxed'\nwarn.overload = 0.8\n'muscle.extensor.tendon_slack_length_scale' = 0.3",
            80.0,
        ),
        ("fibre_length", "bounds = 'both_boxed'\n'muscle.flexor.tendon_slack_length_scale' = 2.2", 80.0),
        ("fast_motion", "'motion.elbow_angle_scale' = 57.3\nmax_iterations = 1", 80.0),
        ("mesh", "stages = 1\nh = 0.2\nbounds = 'both_boxed'", 110.0),
        ("fibre_velocity", "bounds = 'both_boxed'\nwarn.fibre_velocity = 0.1", 80.0),
        ("chatter", "bounds = 'both_boxed'\nwarn.chatter = 2", 80.0),
    ] {
        let (table, said) = run(elbow_study(&base.replace("h = 0.2", ""), "", to));
        let codes = table("jobs").text("warnings", 0).unwrap_or("").to_owned();
        assert!(codes.split(", ").any(|found| found == code), "{code}: found `{codes}`, {said}");
        assert!(
            said.contains(&format!("{code}: 1 job (0)")) && table("jobs").text("remark", 0).unwrap().contains(code)
        );
        assert!(WARNING_KINDS.iter().any(|kind| kind.code == code));
    }
    // With a limit of the user's own there is no warning.
    let quiet = run(elbow_study(
        &format!(
            "mu = 0.05\nbounds = 'both'\nwarn.saturated = 0.9\nwarn.mesh = 10\n{weak}\nwarn.tracking_deg = 1e3\n\
             warn.tracking_mm = 1e6"
        ),
        "",
        80.0,
    ));
    assert_eq!(
        quiet.0("jobs").text("warnings", 0),
        Some("saturated"),
        "activations above 1 are said whatever the limit"
    );
}

/// The estimated discretisation error is within a factor of three of the error that refinement shows.
#[test]
fn val_mesh_errors_are_those_that_refinement_shows() {
    let cases = [
        ("arm", "arm_curl.csv", "0.2", 1),
        ("arm", "arm_curl.csv", "0.1", 1),
        ("arm", "arm_curl.csv", "0.05", 1),
        ("arm", "arm_curl.csv", "0.2", 2),
        ("pedal", "pedal_turn.csv", "0.05", 1),
        ("pedal", "pedal_turn.csv", "0.025", 1),
    ];
    for (model, motion, h, stages) in cases {
        let head = format!(
            "name = 's'\nmodel = '{{root}}/data/models/{model}.toml'\nmotion = '{{root}}/data/motions/{motion}'\n\
             [base]\nregularity = 'off'\nmeasurement_ratio = 8\n"
        );
        let sweep = format!(
            "[[sweep.list]]\nh = {h}\nstages = {stages}\n[[sweep.list]]\nh = 0.025\nstages = 3\n\
             measurement_ratio = {}\n",
            (8.0 * 0.025 / h.parse::<f64>().unwrap()).max(1.0)
        );
        let folder = folder(&[("study.toml", &format!("{head}{}", sweep.replace(".0\n", "\n")))]);
        let (_, study) = study(&folder);
        let outcome = |k: usize| {
            let job = &study.jobs[k];
            solve(&study.model_of(job).unwrap(), &study.motion, &job.settings, job.points).job
        };
        let (coarse, fine) = (outcome(0), outcome(1));
        let (estimate, actual) = (coarse.effort_mesh_error.unwrap(), coarse.effort.unwrap() - fine.effort.unwrap());
        println!(
            "{model}, h = {h}, {stages} stage(s): effort {:.4}, error {actual:.5}, estimated {estimate:.5}",
            coarse.effort.unwrap()
        );
        // Within a factor of three, except where the error is almost zero.
        let is_small = estimate.abs().max(actual.abs()) < 0.02 * fine.effort.unwrap();
        let is_near = (1.0 / 3.0..3.0).contains(&(estimate / actual));
        assert!(is_near || is_small, "{model} {h} {stages}: {estimate} for {actual}");
    }
}

#[test]
fn the_default_is_three_stages_in_the_plane_and_one_in_space() {
    let planar = study(&elbow_study("", "", 80.0)).1;
    assert_eq!((planar.base.stages, planar.jobs[0].settings.stages), (3, 3));
    let folder = folder(&[
        ("m.osim", &osim("", "", BODY, HINGE)),
        ("lift.mot", LIFT),
        ("study.toml", "name = 's'\nmodel = 'm.osim'\nmotion = 'lift.mot'\n"),
    ]);
    assert_eq!(study(&folder).1.base.stages, 1);
}

/// A column that the model does not use is reported; a sweep of a locked coordinate is refused.
#[test]
fn locked_and_dependent_coordinates_are_named() {
    let second = HINGE
        .replace("/ground", "/bodyset/fore")
        .replace("/bodyset/fore</socket_child", "/hand</socket_child")
        .replace("elbow", "wrist");
    let locked = second.replace("<range>0 2</range>", "<locked>true</locked>");
    let hand = format!("<components><Body name=\"hand\">{BODY}</Body></components>");
    let text_of_study = "name = 's'\nmodel = 'm.osim'\nmotion = 'lift.mot'\n[base]\nh = 0.1\n";
    let motion = LIFT
        .replace("elbow_angle\n", "elbow_angle\twrist_angle\n")
        .replace("0\n0", "0\t7\n0")
        .replace("50\n", "50\t7\n");
    let folder = folder(&[
        ("m.osim", &osim(&hand, "", BODY, &format!("{HINGE}{locked}"))),
        ("lift.mot", &motion),
        ("study.toml", text_of_study),
    ]);
    let check = sinew(&["check", "study.toml"], folder.path());
    let said = text(&check.stdout) + &text(&check.stderr);
    assert!(said.contains("column `wrist_angle` is ignored") && said.contains("deviates by up to 7.0000°"), "{said}");
    let sweep = format!("{text_of_study}[sweep.grid]\n'motion.wrist_angle_offset_deg' = [0, 5]\n");
    std::fs::write(folder.path().join("study.toml"), sweep).unwrap();
    let refused = sinew(&["check", "study.toml"], folder.path());
    assert_eq!(refused.status.code(), Some(2));
    assert!(text(&refused.stderr).contains("`wrist_angle` is locked"), "{}", text(&refused.stderr));
}

#[test]
fn limits_of_time_and_memory_hold() {
    let arm = "name = 's'\nmodel = '{root}/data/models/arm.toml'\nmotion = '{root}/data/motions/arm_curl.csv'\n\
        [base]\nregularity = 'off'\n";
    let solved = |more: &str| {
        let folder = folder(&[("study.toml", &format!("{arm}{more}"))]);
        let (_, study) = study(&folder);
        let job = &study.jobs[0];
        let outcome = solve(&study.model, &study.motion, &job.settings, job.points);
        (
            outcome.job.status,
            outcome.job.error.unwrap_or_default(),
            outcome.job.remark.unwrap_or_default(),
            outcome.job.n_starts,
        )
    };
    // A job that needs too much memory is not started.
    for large in ["h = 0.00001", "h = 0.001\nmeasurement_ratio = 1000", "h = 0.02\nmemory_limit_mb = 25"] {
        let (status, error, ..) = solved(large);
        assert!(status == Status::Invalid && error.contains("MB, more than memory_limit_mb ="), "{large}: {error}");
    }
    assert_eq!(solved("h = 0.02\nmemory_limit_mb = 200\nmax_iterations = 1").0, Status::IterationLimit);
    // As many starts are made as the time allows, and this is reported. The limit also ends what precedes the first
    // start.
    let (_, _, remark, made) = solved("h = 0.1\nstarts = 100000\ntime_limit_s = 0.3");
    let made = made.unwrap();
    assert!((1..100_000).contains(&made) && remark.contains(&format!("{made} of 100000 starts were made")), "{remark}");
    for slow in ["h = 0.005\nmeasurement_ratio = 100", "h = 0.001"] {
        let (status, error, ..) = solved(&format!("{slow}\ntime_limit_s = 0.001"));
        assert!(status == Status::TimeLimit && error.contains("raise time_limit_s"), "{slow}: {error}");
    }
}

#[test]
fn a_planar_loop_refuses_a_motion_that_it_cannot_make() {
    // The knee does not move, which is impossible with a turning crank.
    let turn = std::fs::read_to_string(root().join("data/motions/pedal_turn.csv")).unwrap();
    let line = |line: &str| match line.starts_with("time") {
        true => format!("{line},knee_angle_deg\n"),
        false => format!("{line},-60.0\n"),
    };
    let still: String = turn.lines().filter(|line| !line.starts_with('#')).map(line).collect();
    let text = "name = 's'\nmodel = '{root}/data/models/pedal.toml'\nmotion = 'still.csv'\n[base]\nh = 0.1\n\
        regularity = 'off'\nmu = 0.1\n";
    let folder = folder(&[("study.toml", text), ("still.csv", &still)]);
    let refused = sinew::internals::study::Study::load(&folder.path().join("study.toml")).unwrap_err();
    let said = said(refused);
    assert!(said.contains("joints cannot follow") && said.contains("close"), "{said}");
    // The shipped motion closes the loop.
    let moved =
        super::support::folder(&[("study.toml", &text.replace("still.csv", "{root}/data/motions/pedal_turn.csv"))]);
    let (_, study) = super::support::study(&moved);
    let job = &study.jobs[0];
    assert_eq!(solve(&study.model, &study.motion, &job.settings, job.points).job.status, Status::Converged);
}
