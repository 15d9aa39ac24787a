//! Invalid input files: each causes a message with place and remedy, exit code 2, and no panic.

use sinew::internals::error::SourceFile;
use sinew::internals::motion::MotionTable;

use super::cli::{one_line, sinew, text};
use super::support::{SMALL, folder, root};

struct Mistake {
    name: &'static str,
    study: String,
    model: Option<String>,
    motion: Option<(&'static str, String)>,
    /// What the message must contain: the place, what was found, the remedy.
    says: &'static [&'static str],
}

fn study(name: &'static str, from: &str, to: &str, says: &'static [&'static str]) -> Mistake {
    assert!(SMALL.contains(from), "{name}");
    let text = SMALL.replace(from, to);
    let text = if name.contains("several sweeps") { text.replace("both", "bth") } else { text };
    Mistake { name, study: text, model: None, motion: None, says }
}

fn model(name: &'static str, from: &str, to: &str, says: &'static [&'static str]) -> Mistake {
    let arm = std::fs::read_to_string(root().join("data/models/arm.toml")).unwrap();
    assert!(arm.contains(from), "{name}");
    let study = SMALL.replace("{root}/data/models/arm.toml", "arm.toml");
    Mistake { name, study, model: Some(arm.replacen(from, to, 1)), motion: None, says }
}

fn motion(name: &'static str, file: &'static str, text: &str, says: &'static [&'static str]) -> Mistake {
    let study = SMALL.replace("{root}/data/motions/arm_curl.csv", file);
    Mistake { name, study, model: None, motion: Some((file, text.to_owned())), says }
}

fn mistakes() -> Vec<Mistake> {
    let rows = "0.0,1,2\n0.5,1,2\n0.75,1,2\n1.0,1,2\n";
    vec![
        study("unknown key", "[base]\n", "[bse]\n", &["study.toml", "bse", "did you mean `base`"]),
        study(
            "unknown setting",
            "regularity",
            "regularty",
            &["study.toml:7", "regularty", "did you mean `regularity`"],
        ),
        study("wrong type", "h = 0.2", "h = \"small\"", &["base.h", "the text \"small\"", "positive time in seconds"]),
        study("unknown choice", "\"both\"", "\"bth\"", &["sweep.grid.bounds", "bth", "did you mean \"both\""]),
        study("empty axis", "[0.1, 0.2, 0.4]", "[]", &["sweep.grid.mu", "no value"]),
        study("h that does not divide", "h = 0.2", "h = 0.3", &["base.h", "does not divide", "0.25 s (4)"]),
        study(
            "unknown muscle",
            "mu = [",
            "\"muscle.trceps.tendon_slack_length_scale\" = [",
            &["sweep.grid.muscle.trceps", "no `trceps`", "did you mean `triceps`"],
        ),
        study(
            "a number out of range",
            "mu = [0.1",
            "\"muscle.triceps.tendon_slack_length_scale\" = [-0.1",
            &["tendon_slack_length", "found -", "must be a positive number (m)"],
        ),
        study(
            "a repeated value",
            "[0.1, 0.2, 0.4]",
            "[0.1, 0.1]",
            &["study.toml:9", "sweep.grid.mu", "0.1 occurs twice"],
        ),
        study(
            "an unquoted path",
            "mu = [",
            "muscle.triceps.tendon_slack_length_scale = [",
            &["sweep.grid.muscle", "quote the whole name"],
        ),
        study("far too many points", "h = 0.2", "h = 0.000001", &["base.h", "1000001 points", "larger h"]),
        study("no such model", "arm.toml", "amr.toml", &["study.toml:3", "does not exist", "arm.toml"]),
        study("broken TOML", "[base]", "[base", &["study.toml:5"]),
        study(
            "unknown coordinate",
            "mu = [",
            "\"motion.elbw_angle_scale\" = [",
            &["elbw_angle", "did you mean `elbow_angle`"],
        ),
        study(
            "a wildcard that fits nothing",
            "mu = [",
            "\"muscle.x*.optimal_fibre_length\" = [",
            &["nothing in the model matches `muscle.x*`"],
        ),
        study(
            "an unknown kind of sweep",
            "[sweep.grid]",
            "[sweep.gird]",
            &["study.toml:8", "unknown field `gird`", "did you mean `grid`"],
        ),
        study(
            "axes of a zip of two lengths",
            "[sweep.grid]",
            "[sweep.zip]",
            &["sweep.zip.bounds", "found 2 values, but `mu` has 3", "the same length"],
        ),
        study(
            "samples without a seed",
            "[sweep.grid]",
            "[sweep.sample]\ncount = 3\nmu = [1]\n[sweep.grid]",
            &["missing field `seed`", "add the key `seed`"],
        ),
        study(
            "an unknown way of sampling",
            "[sweep.grid]",
            "[sweep.sample]\ncount = 3\nseed = 1\nmethod = 'sobl'\nh = [0.2]\n[sweep.grid]",
            &["unknown variant `sobl`", "did you mean `sobol`"],
        ),
        study(
            "a log range through zero",
            "mu = [0.1, 0.2, 0.4]",
            "mu = { from = 0, to = 1, count = 3, scale = 'log' }",
            &["study.toml:9", "a log range from 0 to 1", "greater than 0"],
        ),
        study(
            "a range without count",
            "mu = [0.1, 0.2, 0.4]",
            "mu = { from = 0, to = 1 }",
            &["sweep.grid.mu", "no `count`", "count = 5"],
        ),
        study(
            "a billion jobs",
            "[sweep.grid]",
            "[sweep.grid]\nseed = { from = 1, to = 999999, count = 999999 }",
            &["the study has 5999994 jobs", "at most 1000000 are allowed"],
        ),
        study(
            "conditions that leave nothing",
            "[sweep.grid]",
            "[[sweep.exclude]]\nbounds = ['activation', 'both']\n[sweep.grid]",
            &["sweep.exclude", "leave no job"],
        ),
        study(
            "a condition on nothing",
            "[sweep.grid]",
            "[[sweep.when]]\nbound = 'both'\n[sweep.grid]",
            &["`bound`, which no job has", "did you mean `bounds`"],
        ),
        study(
            "an axis in two kinds",
            "[sweep.grid]",
            "[sweep.zip]\nmu = [1]\n[sweep.grid]",
            &["`mu` is swept twice", "once"],
        ),
        study(
            "a mistake in one of several sweeps",
            "[sweep.grid]",
            "[[sweep]]\n[sweep.grid]\nmu = [1]\n[[sweep]]\n[sweep.grid]",
            &["study.toml:14", "sweep.1.grid.bounds", "bth"],
        ),
        study(
            "a ratio of no muscle",
            "[base]",
            "[[ratio]]\nname = 'r'\nnumerator = 'bicep'\ndenominator = 'triceps'\n[base]",
            &["study.toml:7", "no muscle is called `bicep`", "did you mean `biceps`"],
        ),
        study(
            "an unknown measure",
            "[base]",
            "[[ratio]]\nname = 'r'\nnumerator = 'biceps'\ndenominator = 'triceps'\nmeasure = 'meanforce'\n[base]",
            &["unknown variant `meanforce`", "did you mean `mean_force`"],
        ),
        study(
            "two axes for one thing",
            "[sweep.grid]",
            "[sweep.zip]\n'muscle.*.optimal_fibre_length_scale' = [1.1]\n\
             'muscle.biceps.optimal_fibre_length_scale' = [1.2]\n[sweep.grid]",
            &["both set muscle.biceps.optimal_fibre_length", "[[sweep]]"],
        ),
        study(
            "a misspelt condition",
            "[sweep.grid]",
            "[[sweep.exclude]]\nbounds = 'bth'\n[sweep.grid]",
            &["sweep.exclude.0.bounds", "did you mean \"both\""],
        ),
        study(
            "a condition on what a group does not sweep",
            "[sweep.grid]",
            "[sweep.group.g]\ngrid = { stages = [1, 2] }\nexclude = [{ mu = 0.1 }]\n[sweep.grid]",
            &["`mu`, which is swept outside the group", "move the condition out of the group"],
        ),
        study(
            "an unquoted path in a sample",
            "[sweep.grid]",
            "[sweep.sample]\ncount = 3\nseed = 1\nmuscle.biceps.optimal_fibre_length = { from = 1, to = 2 }\n\
             [sweep.grid]",
            &["quote the whole name"],
        ),
        study(
            "an unknown policy",
            "name =",
            "on_failure = 'rety'\nname =",
            &["unknown variant `rety`", "did you mean `retry`"],
        ),
        model("unknown model key", "mass =", "mas =", &["arm.toml", "unknown field `mas`", "did you mean `mass`"]),
        model("negative mass", "mass = ", "mass = -", &["body.upper_arm.mass", "found -", "positive number (kg)"]),
        model("a spatial model", "name = ", "dimensions = 3\nname = ", &["arm.toml", "expected an array of length 3"]),
        model(
            "unknown body",
            "child = \"forearm\"",
            "child = \"forarm\"",
            &["joint.elbow.child", "did you mean `forearm`"],
        ),
        model(
            "missing key",
            "name = \"biceps\"\nmax_isometric_force",
            "name = \"biceps\"\nforce",
            &["arm.toml", "unknown field `force`"],
        ),
        motion("no time", "m.csv", &format!("t,shoulder_angle_deg,elbow_angle_deg\n{rows}"), &["m.csv:1", "`t`"]),
        motion(
            "no unit",
            "m.csv",
            &format!("time,shoulder_angle,elbow_angle_deg\n{rows}"),
            &["m.csv:1", "unit", "_deg or _rad"],
        ),
        motion(
            "missing column",
            "m.csv",
            "time,elbow_angle_deg\n0,1\n0.5,1\n0.7,1\n1,1\n",
            &["m.csv", "no column for shoulder_angle"],
        ),
        motion(
            "not a number",
            "m.csv",
            &format!("time,shoulder_angle_deg,elbow_angle_deg\n{}", rows.replace("0.5,1", "0.5,one")),
            &["line 3", "`one`"],
        ),
        motion(
            "time goes back",
            "m.csv",
            &format!("time,shoulder_angle_deg,elbow_angle_deg\n{}", rows.replace("0.75", "0.25")),
            &["line 4", "is not later than"],
        ),
        motion("no endheader", "m.mot", "inDegrees=yes\ntime elbow_angle\n0 1\n", &["m.mot:1", "endheader"]),
        motion(
            "a file cut in half",
            "m.mot",
            "nRows=5\ninDegrees=yes\nendheader\ntime elbow_angle shoulder_angle\n0 1 1\n1 1 1\n",
            &["m.mot:1", "the header declares 5 rows, but the table has 2", "truncated"],
        ),
        motion(
            "degrees and not",
            "m.mot",
            "inDegrees=no\ninDegrees=yes\nendheader\ntime elbow_angle shoulder_angle\n0 1 1\n",
            &["m.mot:2", "inDegrees is given twice"],
        ),
        motion(
            "semicolons in a storage file",
            "m.mot",
            "inDegrees=yes\nendheader\ntime;elbow_angle\n0;1\n",
            &["m.mot:3", "separated by semicolons"],
        ),
        study("a limit below 0", "[base]\n", "[base]\nwarn.saturated = -1\n", &["warn.saturated", "from 0 to"]),
        motion(
            "two columns of time",
            "m.csv",
            "time,time,shoulder_angle_deg,elbow_angle_deg\n0,0,1,2\n",
            &["m.csv:1", "several columns hold the time: 1 (`time`) and 2 (`time`)"],
        ),
        motion(
            "semicolons",
            "m.csv",
            "time;shoulder_angle_deg;elbow_angle_deg\n0;1,5;2\n",
            &["m.csv:1", "separated by semicolons (`;`)", "0.25, not 0,25"],
        ),
        motion(
            "decimal commas",
            "m.csv",
            "time,shoulder_angle_deg,elbow_angle_deg\n0,1,5,2\n",
            &["m.csv:2", "4 fields for 3 columns", "write decimals with a point"],
        ),
        motion(
            "quoted decimal commas",
            "m.csv",
            "time,shoulder_angle_deg,elbow_angle_deg\n0,\"1,5\",2\n",
            &["line 2", "`1,5`"],
        ),
        motion(
            "positions of markers",
            "m.trc",
            "PathFileType 4 (X/Y/Z) m.trc\n",
            &["holds marker positions", "inverse kinematics"],
        ),
        study(
            "an absolute value far from the model's own",
            "mu = [0.1",
            "\"muscle.triceps.max_isometric_force\" = [1.2",
            &["times the model's own value", "max_isometric_force_scale", "confirm = ["],
        ),
        study(
            "a filter above what the sampling has",
            "[sweep.grid]",
            "smoothing_hz = 50\n[sweep.grid]",
            &["smoothing_hz: 50 Hz", "100 instants per second", "38 Hz"],
        ),
        study(
            "one offset in two units",
            "[sweep.grid]",
            "\"motion.elbow_angle_offset_deg\" = 1\n\"motion.elbow_angle_offset_rad\" = 1\n[sweep.grid]",
            &["both set motion.elbow_angle_offset", "keep one of them"],
        ),
        study(
            "one number by a name and by its place",
            "[sweep.grid]",
            "\"muscle.2.max_isometric_force\" = 310\n\"muscle.biceps.max_isometric_force\" = 320\n[sweep.grid]",
            &["both set muscle.biceps.max_isometric_force"],
        ),
        study(
            "a list and a number in it",
            "[sweep.grid]",
            "[sweep.grid]\n\"muscle.biceps.path.0.point_scale\" = [1.0, 1.1]\n\
             \"muscle.biceps.path.0.point.0\" = [0.02, 0.03]",
            &["muscle.biceps.path.0.point_scale", "both set muscle.biceps.path.0.point.0"],
        ),
        study(
            "a name that confirms nothing",
            "name =",
            "confirm = [\"muscle.bizeps.max_isometric_force\"]\nname =",
            &["muscle.bizeps.max_isometric_force", "is not a numeric parameter of the model"],
        ),
        study(
            "one number absolute and by a factor",
            "[sweep.grid]",
            "[sweep.grid]\n\"muscle.triceps.max_isometric_force\" = [1200, 1300]\n\
             \"muscle.triceps.max_isometric_force_scale\" = [1, 1.1]",
            &["muscle.triceps.max_isometric_force", "_scale"],
        ),
        motion("no inDegrees", "m.sto", "name\nendheader\ntime elbow_angle\n0 1\n", &["m.sto:1", "inDegrees"]),
    ]
}

#[test]
fn each_mistake_gets_a_message_with_place_and_remedy() {
    for mistake in mistakes() {
        let folder = folder(&[("study.toml", &mistake.study)]);
        if let Some(model) = &mistake.model {
            std::fs::write(folder.path().join("arm.toml"), model).unwrap();
        }
        if let Some((file, motion)) = &mistake.motion {
            std::fs::write(folder.path().join(file), motion).unwrap();
        }
        let run = sinew(&["run", "study.toml"], folder.path());
        // Messages are wrapped and framed for readability: compare without the frame.
        let message: String = text(&run.stderr)
            .chars()
            .filter(|c| !"│╭╰─╯┬·×".contains(*c))
            .collect::<String>()
            .split_whitespace()
            .collect::<Vec<_>>()
            .join(" ");
        assert_eq!(run.status.code(), Some(2), "{}: {message}", mistake.name);
        assert!(!message.contains("panicked"), "{}: {message}", mistake.name);
        for part in mistake.says {
            assert!(message.contains(part), "{}: `{part}` is not in: {message}", mistake.name);
        }
        assert!(!folder.path().join("results").exists(), "{}: nothing is written", mistake.name);
    }
}

#[test]
fn opensim_tables_are_read_in_any_column_order() {
    let storage = "Coordinates\nversion=1\nnRows=5\nnColumns=4\ninDegrees=yes\nendheader\n\
                   time\telbow_angle\tpelvis_tilt\tshoulder_angle\n\
                   0\t10\t0\t-5\n0.25\t30\t0\t-5\n0.5\t50\t0\t-5\n0.75\t70\t0\t-5\n1.0\t90\t0\t-5\n";
    let mistake = motion("fine", "m.mot", storage, &[]);
    let folder = folder(&[("study.toml", &mistake.study), ("m.mot", storage)]);
    let plan = sinew(&["plan", "study.toml"], folder.path());
    assert_eq!(plan.status.code(), Some(0), "{}", text(&plan.stderr));
    assert!(text(&plan.stdout).contains("5 instants"));
}

/// What spreadsheets, pandas and OpenSim add to a table has no effect.
#[test]
fn tables_are_read_as_other_programs_write_them() {
    let plain = "time,shoulder_angle_deg,elbow_angle_deg\n1.25,1,10\n1.5,1,20\n1.75,1,30\n2.25,1,40\n";
    let rows = plain.lines().skip(1);
    let index: String = rows.clone().enumerate().map(|(k, row)| format!("{k},{row}\n")).collect();
    let trailing: String = plain.lines().map(|row| format!("{row},\n")).collect();
    let storage: String = rows.map(|row| row.replace(',', "\t") + "\n").collect();
    for (file, written) in [
        ("m.csv", plain.to_owned()),
        ("m.csv", format!("\u{feff}{plain}")),
        ("m.csv", plain.replace('\n', "\r\n")),
        ("m.csv", format!("# a comment\n{plain}")),
        (
            "m.csv",
            format!(
                "\"time\",\"shoulder_angle_deg\",\"elbow_angle_deg\"\n{}",
                plain.split_once('\n').unwrap().1.replace("1,10", "\"1\",\"10\"")
            ),
        ),
        ("m.csv", format!(",time,shoulder_angle_deg,elbow_angle_deg\n{index}")),
        ("m.csv", trailing),
        ("m.mot", format!("\u{feff}inDegrees=yes\nnRows=4\nendheader\ntime\tshoulder_angle\telbow_angle\n{storage}")),
    ] {
        let path = std::path::PathBuf::from(file);
        let model = super::support::model("arm.toml");
        let table = MotionTable::from_file(&SourceFile { path, text: written.clone() }, &model)
            .unwrap_or_else(|e| panic!("{written}: {:?}", miette::Report::new(e)));
        assert_eq!(table.time, [1.25, 1.5, 1.75, 2.25], "{written}");
        let elbow = table.column("elbow_angle").unwrap();
        assert!((elbow[3].to_degrees() - 40.0).abs() < 1e-12, "{written}");
    }
}

/// The tables keep the times of the motion file, and `check` shows what a motion contains.
#[test]
fn the_clock_of_the_file_is_kept() {
    let mut table = "time,shoulder_angle_deg,elbow_angle_deg\n".to_owned();
    (0..=40)
        .for_each(|k| table.push_str(&format!("{},-5,{}\n", 1.234 + 0.025 * f64::from(k), 10.0 + 2.0 * f64::from(k))));
    let mistake = motion("fine", "m.csv", &table, &[]);
    let folder = folder(&[
        (
            "study.toml",
            &mistake.study.replace("[0.1, 0.2, 0.4]", "[0.1]").replace("[base]", "[base]\ntrajectories = true"),
        ),
        ("m.csv", &table),
    ]);
    let check = text(&sinew(&["check", "study.toml"], folder.path()).stdout);
    assert!(check.contains("1.234") && check.contains("elbow_angle") && check.contains("80.0°/s"), "{check}");
    let run = sinew(&["run", "study.toml", "--out", "out"], folder.path());
    assert!(run.status.success(), "{}", text(&run.stderr));
    let trajectories =
        sinew::internals::tables::read("trajectories", &folder.path().join("out/trajectories.parquet")).unwrap();
    assert_eq!(trajectories.number("time_s", 0), Some(1.234));
}

#[test]
fn a_value_far_from_the_models_own_may_be_confirmed() {
    let path = "muscle.triceps.max_isometric_force";
    let study = SMALL.replace("mu = [0.1", &format!("\"{path}\" = [12000")).replace("0.2, 0.4", "13000");
    let code = |text: &str| sinew(&["plan", "study.toml"], folder(&[("study.toml", text)]).path()).status.code();
    assert_eq!(
        (code(&study), code(&study.replacen("name =", &format!("confirm = ['{path}']\nname ="), 1))),
        (Some(2), Some(0))
    );
}

/// A gap in a motion is interpolated and reported.
#[test]
fn a_gap_of_a_motion_is_named() {
    let mut table = "time,shoulder_angle_deg,elbow_angle_deg\n".to_owned();
    (0..=40)
        .filter(|k| !(8..30).contains(k))
        .for_each(|k| table.push_str(&format!("{},-5,{k}\n", 0.025 * f64::from(k))));
    let mistake = motion("fine", "m.csv", &table, &[]);
    let folder = folder(&[("study.toml", &mistake.study), ("m.csv", &table)]);
    let said = one_line(&text(&sinew(&["check", "study.toml"], folder.path()).stdout));
    assert!(said.contains("no measurements between 0.175 and 0.750 s (23 times the median step)"), "{said}");
}
