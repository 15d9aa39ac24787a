//! Commands for first steps: what they write and print, read back.

use std::path::Path;
use std::process::Command;

use sinew::internals::study::Study;
use sinew::internals::tables::{read, schema};

use super::cli::{sinew, text};
use super::support::{SMALL, folder, root, shared};

/// Runs in a terminal of a width: `script` gives the program one.
fn in_terminal(columns: usize, arguments: &str, at: &Path) -> Option<String> {
    let program = env!("CARGO_BIN_EXE_sinew");
    let command = format!("stty rows 50 cols {columns}; {program} {arguments}");
    let output = Command::new("script").args(["-qec", &command, "/dev/null"]).current_dir(at).output().ok()?;
    assert!(output.status.success(), "{arguments}: {}", text(&output.stdout));
    Some(text(&output.stdout).replace('\r', ""))
}

/// A line without its colours.
fn plain(line: &str) -> String {
    let mut parts = line.split("\x1b[");
    let first = parts.next().unwrap_or_default().to_owned();
    parts.fold(first, |all, part| all + part.split_once('m').map_or(part, |(_, rest)| rest))
}

#[test]
fn a_new_study_runs_as_it_is() {
    let folder = folder(&[]);
    let at = folder.path();
    let new = sinew(&["new", "mine"], at);
    assert_eq!(new.status.code(), Some(0), "{}", text(&new.stderr));
    let run = sinew(&["run", "mine.toml"], at);
    assert_eq!(run.status.code(), Some(0), "{}", text(&run.stderr));
    assert!(text(&run.stdout).ends_with("9 of 9 jobs finished; results in results/mine\n"), "{}", text(&run.stdout));
    // Every suggestion in its comments is a study too.
    let written = std::fs::read_to_string(at.join("mine.toml")).unwrap();
    let all = written.replace("\n# \"", "\n\"").replace("\n# [[ratio", "\n[[ratio");
    let all =
        ["name", "numerator", "denominator"].iter().fold(all, |t, k| t.replace(&format!("\n# {k}"), &format!("\n{k}")));
    assert_ne!(all, written);
    std::fs::write(at.join("all.toml"), all).unwrap();
    assert_eq!(Study::load(&at.join("all.toml")).unwrap().jobs.len(), 9 * 3 * 3);
    // Nothing is overwritten.
    let again = sinew(&["new", "mine"], at);
    assert_eq!(again.status.code(), Some(2));
    assert_eq!(std::fs::read_to_string(at.join("mine.toml")).unwrap(), written);
    std::fs::write(at.join("arm.toml"), "something else").unwrap();
    assert_eq!(sinew(&["new", "other"], at).status.code(), Some(2));
    assert_eq!(std::fs::read_to_string(at.join("arm.toml")).unwrap(), "something else");
}

#[test]
fn a_new_study_is_made_for_any_model_that_can_be_one() {
    let folder = folder(&[]);
    let at = folder.path();
    let file = |name: &str| root().join(name).to_str().unwrap().to_owned();
    for (name, model, motion) in [
        ("pedal", "data/models/pedal.toml", "data/motions/pedal_turn.csv"),
        ("arm26", "data/models/arm26.toml", "data/motions/arm26_elbow_flexion.mot"),
        ("limb", "data/models/upper_limb.toml", "data/motions/double_poling.csv"),
    ] {
        let new = sinew(&["new", name, "--model", &file(model), "--motion", &file(motion)], at);
        assert_eq!(new.status.code(), Some(0), "{}", text(&new.stderr));
        let study = Study::load(&at.join(format!("{name}.toml"))).unwrap();
        assert!(study.jobs.len() == 9 && study.jobs[0].points > 10);
    }
    // A study in another folder finds its files.
    std::fs::create_dir(at.join("inner")).unwrap();
    std::fs::copy(root().join("data/models/arm.toml"), at.join("m.toml")).unwrap();
    std::fs::copy(root().join("data/motions/arm_curl.csv"), at.join("inner/m.csv")).unwrap();
    let inner = sinew(&["new", "inner/mine", "--model", "m.toml", "--motion", "inner/m.csv"], at);
    assert_eq!(inner.status.code(), Some(0), "{}", text(&inner.stderr));
    assert_eq!(Study::load(&at.join("inner/mine.toml")).unwrap().jobs.len(), 9);
    // A name that cannot be one leaves nothing behind.
    std::fs::create_dir(at.join("empty")).unwrap();
    let odd = sinew(&["new", "two words"], &at.join("empty"));
    assert_eq!(odd.status.code(), Some(2));
    assert_eq!(std::fs::read_dir(at.join("empty")).unwrap().count(), 0);
    // A motion that does not fit leaves no study behind.
    let wrong = sinew(
        &["new", "wrong", "--model", &file("data/models/arm.toml"), "--motion", &file("data/motions/pedal_turn.csv")],
        at,
    );
    assert_eq!(wrong.status.code(), Some(2));
    assert!(!at.join("wrong.toml").exists());
}

/// Every key that `keys` lists can be set, and its value is the model's own: setting it is no change.
#[test]
fn keys_list_what_can_be_set() {
    let folder = folder(&[]);
    for (model, motion) in [
        ("arm.toml", "arm_curl.csv"),
        ("arm26.toml", "arm26_elbow_flexion.mot"),
        ("upper_limb.toml", "double_poling.csv"),
    ] {
        let path = root().join("data/models").join(model);
        let listed = sinew(&["keys", path.to_str().unwrap(), "*", "--format", "json"], root());
        let keys: Vec<serde_json::Value> = serde_json::from_slice(&listed.stdout).unwrap();
        assert!(keys.len() > 50, "{model}: {}", keys.len());
        let mut study = format!(
            "name = \"keys\"\nmodel = \"{}\"\nmotion = \"{}\"\n[base]\nh = 0.05\n",
            path.display(),
            root().join("data/motions").join(motion).display()
        );
        if model == "arm26.toml" {
            study = study.replace("h = 0.05", "h = 0.041666666666666664");
        }
        // Some are for bodies and coordinates that this motion does not move, and say so.
        for key in keys.iter().filter(|key| key["key"].as_str().is_some_and(|key| !key.starts_with("motion."))) {
            assert!(!key["unit"].as_str().unwrap().is_empty());
            study.push_str(&format!("\"{}\" = {:?}\n", key["key"].as_str().unwrap(), key["value"].as_f64().unwrap()));
        }
        let file = folder.path().join("study.toml");
        std::fs::write(&file, study).unwrap();
        let study = Study::load(&file).unwrap_or_else(|e| panic!("{model}: {:?}", miette::Report::new(e)));
        // Only numbers that the file leaves to their defaults are written down.
        for change in &study.jobs[0].changes {
            assert_eq!(study.model_number(&change.path), None, "{model}: {}", change.path);
        }
    }
    let none = sinew(&["keys", root().join("data/models/arm.toml").to_str().unwrap(), "nothing.*"], root());
    assert!(none.status.code() == Some(2) && text(&none.stderr).contains("no key"), "{}", text(&none.stderr));
}

#[test]
fn tables_are_described_and_exported() {
    let folder = folder(&[("study.toml", &SMALL.replace("[sweep.grid]", "trajectories = true\n[sweep.grid]"))]);
    let at = folder.path();
    assert_eq!(sinew(&["run", "study.toml", "--out", "out", "-q"], at).status.code(), Some(0));
    // Every column of every table that is there.
    let described = text(&sinew(&["describe", "out", "--format", "csv"], at).stdout);
    let lines: Vec<&str> = described.lines().skip(1).collect();
    let mut columns = 0;
    for name in schema::TABLES {
        let path = at.join(format!("out/{name}.parquet"));
        if !path.exists() {
            continue;
        }
        let table = read(name, &path).unwrap();
        columns += table.columns.len();
        for (column, _) in &table.columns {
            assert!(lines.iter().any(|line| line.starts_with(&format!("{name},{column},"))), "{name}.{column}");
        }
    }
    assert_eq!(lines.len(), columns);

    let export = |arguments: &[&str]| sinew(&[&["export", "out"], arguments].concat(), at);
    assert_eq!(export(&["--csv", "--table", "muscles", "--jobs", "1,4", "--out", "csv"]).status.code(), Some(0));
    let muscles = std::fs::read_to_string(at.join("csv/muscles.csv")).unwrap();
    assert_eq!(muscles.lines().count(), 1 + 2 * 5);
    assert_eq!(export(&["--csv"]).status.code(), Some(0));
    assert!(at.join("out/export/jobs.csv").exists() && !at.join("out/export/ratios.csv").exists());
    assert_eq!(export(&["--sto", "--jobs", "0"]).status.code(), Some(0));
    check_storage(at);
    for (arguments, said) in [
        (&["--csv", "--table", "muscle"][..], "did you mean `muscles`"),
        (&["--sto", "--jobs", "7"], "no finished job 7"),
        (&[], "--sto"),
    ] {
        let wrong = export(arguments);
        assert!(wrong.status.code() == Some(2) && text(&wrong.stderr).contains(said), "{}", text(&wrong.stderr));
    }
}

/// The exported coordinates are those of the table, to the last digit.
fn check_storage(at: &Path) {
    let storage = std::fs::read_to_string(at.join("out/export/job-0_coordinates.sto")).unwrap();
    let (head, body) = storage.split_once("endheader\n").unwrap();
    let rows: Vec<Vec<&str>> = body.lines().map(|line| line.split('\t').collect()).collect();
    assert!(head.contains(&format!("nRows={}\nnColumns={}\ninDegrees=no", rows.len() - 1, rows[0].len())), "{head}");
    assert_eq!(rows[0], ["time", "shoulder_angle", "elbow_angle"]);
    let table = read("trajectories", &at.join("out/trajectories.parquet")).unwrap();
    let job = read("jobs", &at.join("out/jobs.parquet")).unwrap().text("job_id", 0).unwrap().to_owned();
    let elbow: Vec<(f64, f64)> = (0..table.rows())
        .filter(|&row| table.text("job_id", row) == Some(&job))
        .filter(|&row| table.text("signal", row) == Some("joint_coordinate"))
        .filter(|&row| table.text("name", row) == Some("elbow_angle"))
        .map(|row| (table.number("time_s", row).unwrap(), table.number("value", row).unwrap()))
        .collect();
    let exported: Vec<(f64, f64)> =
        rows[1..].iter().map(|row| (row[0].parse().unwrap(), row[2].parse().unwrap())).collect();
    assert_eq!(exported, elbow);
}

/// OpenSim opens exported files, and knows the coordinates of its own model.
#[test]
fn val_opensim_opens_exported_files() {
    let package = root().join("target/opensim");
    let python = |code: &str, arguments: &[&Path]| {
        Command::new("python3").env("PYTHONPATH", &package).args(["-c", code]).args(arguments).output().unwrap()
    };
    if !python("import opensim", &[]).status.success() {
        eprintln!("SKIPPED: val_opensim_opens_exported_files: OpenSim is not installed (.ci/install)");
        return;
    }
    let folder = folder(&[]);
    let at = folder.path();
    let study = std::fs::read_to_string(root().join("studies/arm26.toml"))
        .unwrap()
        .replace("../data", root().join("data").to_str().unwrap());
    std::fs::write(at.join("arm26.toml"), study).unwrap();
    sinew(&["run", "arm26.toml", "--out", "out"], at);
    assert_eq!(sinew(&["export", "out", "--sto", "--jobs", "0"], at).status.code(), Some(0));
    let code = r"
import sys, opensim
folder, model = sys.argv[1], sys.argv[2]
for name, columns in [('coordinates', 2), ('activations', 6), ('forces', 6)]:
    table = opensim.TimeSeriesTable(f'{folder}/job-0_{name}.sto')
    assert table.getNumRows() > 10 and table.getNumColumns() == columns, (name, table.getColumnLabels())
labels = opensim.TimeSeriesTable(f'{folder}/job-0_coordinates.sto').getColumnLabels()
if model != '-':
    opensim.Logger.setLevelString('Off')
    arm = opensim.Model(model)
    state = arm.initSystem()
    assert all(arm.getCoordinateSet().contains(label) for label in labels), labels
    motion = opensim.Storage(f'{folder}/job-0_coordinates.sto')
    states = opensim.Storage()
    arm.formStateStorage(motion, states, False)
    assert states.getSize() == motion.getSize()
print('opened')
";
    let model = shared("osim/arm26.osim").unwrap_or_else(|| "-".into());
    let opened = python(code, &[&at.join("out/export"), &model]);
    assert!(opened.status.success(), "{}{}", text(&opened.stdout), text(&opened.stderr));
}

/// Tables fit the terminal, at 80 columns and at 200; without a terminal they are 80 wide.
#[test]
fn tables_fit_the_terminal() {
    let many = SMALL
        .replace("mu = [0.1, 0.2, 0.4]", "mu = [0.1, 0.2]\n\"muscle.triceps.max_isometric_force_scale\" = [0.9, 1.0]");
    let folder = folder(&[("study.toml", &many)]);
    let at = folder.path();
    assert_eq!(sinew(&["run", "study.toml", "--out", "out"], at).status.code(), Some(0));
    let widest = |shown: &str| shown.lines().map(|line| plain(line).chars().count()).max().unwrap_or(0);
    for arguments in ["show out", "plan study.toml --out out", "describe", "keys", "status out"] {
        let printed = sinew(&arguments.split(' ').collect::<Vec<&str>>(), at);
        assert!(printed.status.success() && printed.stdout.len() > 80, "{arguments}: {}", text(&printed.stderr));
        assert!(widest(&text(&printed.stdout)) <= 80, "{arguments}: {}", text(&printed.stdout));
        assert!(!text(&printed.stdout).contains('\x1b'), "{arguments}: no colour where there is no terminal");
        let Some(narrow) = in_terminal(80, arguments, at) else {
            eprintln!("SKIPPED in part: tables_fit_the_terminal: there is no `script`");
            continue;
        };
        assert!(widest(&narrow) <= 80, "{arguments}: {narrow}");
    }
    let wide = in_terminal(200, "show out", at).unwrap_or_default();
    if !wide.is_empty() {
        assert!(widest(&wide) > 80 && widest(&wide) <= 200 && wide.contains('\x1b'), "{wide}");
        let never = in_terminal(200, "show out --color never", at).unwrap();
        let trimmed = |shown: &str| shown.lines().map(|l| plain(l).trim_end().to_owned()).collect::<Vec<String>>();
        assert_eq!(trimmed(&never), trimmed(&wide));
    }
    let all = text(&sinew(&["show", "out", "--wide"], at).stdout);
    assert!(widest(&all) > 120 && all.contains("objective") && !all.contains("--wide also"), "{all}");
    let colored = text(&sinew(&["show", "out", "--color", "always"], at).stdout);
    assert!(colored.contains("\x1b[1m"));
    // Errors and help follow the same choice.
    let error = |color: &str| text(&sinew(&["show", "nothing", "--color", color], at).stderr);
    assert!(error("always").contains("\x1b[") && !error("auto").contains('␛') && !error("never").contains('␛'));
}

#[test]
fn one_table_is_printed_for_programs() {
    let folder = folder(&[("study.toml", SMALL)]);
    let at = folder.path();
    let run = sinew(&["run", "study.toml", "--out", "out", "-q"], at);
    assert_eq!(text(&run.stdout), "6 of 6 jobs finished; results in out\n");
    assert_eq!(text(&run.stderr), "");
    let verbose = sinew(&["run", "study.toml", "--out", "again", "-v"], at);
    assert_eq!(text(&verbose.stderr).matches(": converged").count(), 6, "{}", text(&verbose.stderr));
    let jobs = read("jobs", &at.join("out/jobs.parquet")).unwrap();
    let show = |arguments: &[&str]| text(&sinew(&[&["show", "out"], arguments].concat(), at).stdout);
    let json: Vec<serde_json::Value> = serde_json::from_str(&show(&["--format", "json"])).unwrap();
    assert_eq!(json.len(), 6);
    for (row, object) in json.iter().enumerate() {
        assert_eq!(object["objective"].as_f64(), jobs.number("objective", row));
        assert_eq!(object.as_object().unwrap().len(), jobs.columns.len());
    }
    let csv = show(&["--table", "muscles", "--format", "csv"]);
    assert!(csv.starts_with("job_id,status,muscle,") && csv.lines().count() == 1 + 6 * 5);
    assert!(show(&["--table", "regularity", "--format", "markdown"]).starts_with("| job_id | status |"));
    let wrong = sinew(&["show", "out", "--table", "muscle"], at);
    assert!(wrong.status.code() == Some(2) && text(&wrong.stderr).contains("did you mean `muscles`"));
    let plan: Vec<serde_json::Value> =
        serde_json::from_slice(&sinew(&["plan", "study.toml", "--out", "out", "--format", "json"], at).stdout).unwrap();
    assert!(plan.len() == 6 && plan.iter().all(|job| job["state"] == "done"));
    for shell in ["bash", "zsh", "fish"] {
        let script = text(&sinew(&["completions", shell], at).stdout);
        assert!(script.contains("sinew") && script.contains("moment-arms"), "{shell}");
    }
}
