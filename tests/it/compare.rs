//! Baselines: exactly the differences are reported, with the corresponding exit code.

use std::path::Path;

use sinew::internals::tables::{Table, Values, Writer, read, schema};

use super::cli::{sinew, text};
use super::support::{SMALL, folder};

fn json(folder: &Path, arguments: &[&str]) -> (i32, serde_json::Value, String) {
    let arguments = [&["compare", "results/small", "base", "--json", "c.json", "--junit", "c.xml"], arguments].concat();
    let run = sinew(&arguments, folder);
    let found = std::fs::read(folder.join("c.json")).map(|bytes| serde_json::from_slice(&bytes).unwrap());
    (run.status.code().unwrap(), found.unwrap_or_default(), text(&run.stdout) + &text(&run.stderr))
}

/// Rewrites a table of a folder.
fn alter(folder: &Path, name: &'static str, change: impl FnOnce(&mut Table)) {
    let path = folder.join(format!("{name}.parquet"));
    let mut table = read(name, &path).unwrap();
    change(&mut table);
    let mut writer = Writer::new(&path, vec![(sinew::internals::tables::STUDY.to_owned(), "small".to_owned())]);
    writer.append(&table).unwrap();
    writer.finish().unwrap();
}

fn column<'t>(table: &'t mut Table, name: &str) -> &'t mut Values {
    &mut table.columns.iter_mut().find(|(column, _)| column == name).unwrap().1
}

#[test]
fn exactly_the_altered_cells_are_reported() {
    let folder = folder(&[("study.toml", SMALL)]);
    let at = folder.path();
    assert_eq!(sinew(&["run", "study.toml"], at).status.code(), Some(0));
    let accepted = sinew(&["compare", "results/small", "base", "--accept"], at);
    assert_eq!(accepted.status.code(), Some(0), "{}", text(&accepted.stderr));
    let names = ["jobs", "regularity", "muscles"];
    assert!(names.iter().all(|name| at.join(format!("base/{name}.parquet")).exists()));
    let manifest = std::fs::read_to_string(at.join("base/manifest.json")).unwrap();
    let here = [super::support::root(), at].map(|path| path.to_str().unwrap().to_owned() + "/study");
    assert!(
        manifest.contains("\"study.toml\"") && here.iter().all(|path| !manifest.contains(path)),
        "no folders in it"
    );
    let (code, found, _) = json(at, &[]);
    assert_eq!((code, &found["drift"]), (0, &false.into()));

    // One number, one rank, one flag, one text, one number within tolerance.
    alter(&at.join("base"), "muscles", |t| match (column(t, "mean_force_n"), 7) {
        (Values::Number(values), row) => values[row] = values[row].map(|v| v * 1.001 + 0.01),
        _ => unreachable!(),
    });
    alter(&at.join("base"), "regularity", |t| {
        let Values::Integer(ranks) = column(t, "deficiency_a") else { unreachable!() };
        ranks[2] = ranks[2].map(|d| d + 1);
        let Values::Flag(flags) = column(t, "loads_unique") else { unreachable!() };
        flags[4] = flags[4].map(|f| !f);
    });
    alter(&at.join("base"), "jobs", |t| {
        let Values::Number(objectives) = column(t, "objective") else { unreachable!() };
        objectives[0] = objectives[0].map(|v| v * (1.0 + 1e-8));
        objectives[5] = None;
    });
    let (code, found, shown) = json(at, &[]);
    assert_eq!(code, 1, "{shown}");
    assert_eq!(found["counts"]["changed_cells"], 4, "{found:#}");
    let mut cells: Vec<String> = Vec::new();
    for job in found["jobs"].as_array().unwrap() {
        for cell in job["cells"].as_array().unwrap() {
            let text = |key: &str| cell[key].as_str().unwrap_or("null").to_owned();
            cells.push(format!("{} {}[{}].{}", job["index"], text("table"), text("row"), text("column")));
        }
    }
    cells.sort();
    let muscle = read("muscles", &at.join("base/muscles.parquet")).unwrap().text("muscle", 7).unwrap().to_owned();
    let mut expected = vec![
        format!("1 muscles[{muscle}].mean_force_n"),
        "2 regularity[].deficiency_a".to_owned(),
        "4 regularity[].loads_unique".to_owned(),
        "5 jobs[].objective".to_owned(),
    ];
    expected.sort();
    assert_eq!(cells, expected);
    assert!(shown.contains("is not the file recorded in its manifest"), "a warning, no refusal: {shown}");
    let junit = std::fs::read_to_string(at.join("c.xml")).unwrap();
    assert!(junit.contains("tests=\"6\"") && junit.matches("<failure").count() == 4, "{junit}");

    // Tolerances by column, from the command line and from a file in the baseline.
    let (_, found, _) = json(at, &["--tolerance", "mean_force_n=0.1", "--tolerance", "objective=ignore"]);
    assert_eq!(found["counts"]["changed_cells"], 2);
    std::fs::write(at.join("base/tolerances.toml"), "\"jobs.objective\" = \"exact\"\nloads_unique = \"ignore\"\n")
        .unwrap();
    let (_, found, _) = json(at, &[]);
    assert_eq!(found["counts"]["changed_cells"], 4, "objective of job 0 for loads_unique: {found:#}");
    std::fs::write(at.join("base/tolerances.toml"), "objective = \"about\"\n").unwrap();
    let (code, _, shown) = json(at, &[]);
    assert!(code == 2 && shown.contains("tolerances.toml:1") && shown.contains("\"exact\""), "{shown}");
    std::fs::remove_file(at.join("base/tolerances.toml")).unwrap();

    let (code, ..) = json(at, &["--accept"]);
    assert_eq!(code, 0);
    assert_eq!(json(at, &[]).0, 0, "accepted");
    let report = std::fs::read_to_string(at.join("c.xml")).unwrap();
    assert!(report.contains("failures=\"0\""));
}

#[test]
fn jobs_that_are_new_missing_or_newly_failed_are_told_apart() {
    let folder = folder(&[("study.toml", SMALL)]);
    let at = folder.path();
    assert_eq!(sinew(&["run", "study.toml"], at).status.code(), Some(0));
    assert_eq!(sinew(&["compare", "results/small", "base", "--accept"], at).status.code(), Some(0));
    // mu = 0.4 is removed, 0.8 is added.
    std::fs::write(
        at.join("study.toml"),
        std::fs::read_to_string(at.join("study.toml")).unwrap().replace("0.4]", "0.8]"),
    )
    .unwrap();
    assert_eq!(sinew(&["run", "study.toml"], at).status.code(), Some(0));
    alter(&at.join("results/small"), "jobs", |t| {
        let Values::Text(status) = column(t, "status") else { unreachable!() };
        status[1] = Some("stalled".to_owned());
        let Values::Text(error) = column(t, "error") else { unreachable!() };
        error[1] = Some("by hand".to_owned());
    });
    let (code, found, shown) = json(at, &[]);
    assert_eq!(code, 1);
    let count = |class: &str| found["counts"][class].as_i64().unwrap();
    let counts = ["unchanged", "changed", "new", "missing", "newly_failed"].map(count);
    assert_eq!(counts, [3, 0, 2, 2, 1], "{shown}");
    assert!(
        shown.contains("newly failed: stalled") && shown.contains("by hand") && shown.contains("mu = 0.8"),
        "{shown}"
    );
}

#[test]
fn the_nightly_study_is_as_its_baseline() {
    let folder = folder(&[]);
    let path = |name: &str| super::support::root().join(name).to_str().unwrap().to_owned();
    let run = sinew(&["run", &path("studies/nightly.toml"), "--out", "nightly"], folder.path());
    assert_eq!(run.status.code(), Some(0), "{}", text(&run.stderr));
    let compare = sinew(&["compare", "nightly", &path("results/baselines/nightly")], folder.path());
    assert_eq!(compare.status.code(), Some(0), "{}", text(&compare.stdout));
}

#[test]
fn what_is_gone_is_drift_and_mistakes_are_refused() {
    let folder = folder(&[("study.toml", SMALL)]);
    let at = folder.path();
    assert_eq!(sinew(&["run", "study.toml"], at).status.code(), Some(0));
    let code = |arguments: &[&str]| {
        let run = sinew(&[&["compare"], arguments].concat(), at);
        let shown = (text(&run.stdout) + &text(&run.stderr)).replace(['│', '\n'], " ");
        (run.status.code().unwrap(), shown.split_whitespace().collect::<Vec<_>>().join(" "))
    };
    assert_eq!(code(&["nosuch", "base", "--accept"]).0, 2);
    assert!(!at.join("base").exists());
    assert_eq!(code(&["results/small", "results/small", "--accept"]).0, 2);
    assert_eq!(code(&["results/small", "base", "--accept"]).0, 0);
    for (tolerance, says) in
        [("nonsense=1e-4", "no table of the baseline"), ("mu=-1", "not a tolerance"), ("mu", "COLUMN=")]
    {
        let (code, shown) = code(&["results/small", "base", "--tolerance", tolerance]);
        assert!(code == 2 && shown.contains(says), "{tolerance}: {shown}");
    }
    for text in ["objective = { relatve = 0.1 }", "objective = -1.0", "objective = nan"] {
        std::fs::write(at.join("base/tolerances.toml"), text).unwrap();
        assert_eq!(code(&["results/small", "base"]).0, 2, "{text}");
    }
    std::fs::remove_file(at.join("base/tolerances.toml")).unwrap();
    // A given relative tolerance keeps the default absolute one.
    alter(&at.join("results/small"), "muscles", |t| {
        let Values::Number(values) = column(t, "min_force_n") else { unreachable!() };
        values[0] = values[0].map(|v| v + 1e-10);
    });
    assert_eq!(code(&["results/small", "base", "--tolerance", "min_force_n=1e-4"]).0, 0);
    alter(&at.join("results/small"), "jobs", |t| t.columns.retain(|(name, _)| name != "objective"));
    let (drift, shown) = code(&["results/small", "base"]);
    assert!(drift == 1 && shown.contains("the column jobs.objective is in the baseline only"), "{shown}");
    std::fs::remove_file(at.join("results/small/muscles.parquet")).unwrap();
    let (drift, shown) = code(&["results/small", "base", "--junit", "gone.xml"]);
    assert!(drift == 1 && shown.contains("the table muscles"), "{shown}");
    assert!(std::fs::read_to_string(at.join("gone.xml")).unwrap().contains("failures=\"2\""));
    std::fs::write(at.join("results/small/jobs.parquet"), b"PAR1 nothing PAR1").unwrap();
    assert_eq!(code(&["results/small", "base"]).0, 2, "a damaged file");
}

#[test]
fn other_columns_have_no_hidden_difference() {
    // Change each column in turn, in one row: the change is reported unless the column is ignored.
    let folder = folder(&[("study.toml", SMALL)]);
    let at = folder.path();
    assert_eq!(sinew(&["run", "study.toml"], at).status.code(), Some(0));
    assert_eq!(sinew(&["compare", "results/small", "base", "--accept"], at).status.code(), Some(0));
    let tolerances = sinew::internals::compare::Tolerances::read(&at.join("base"), &[]).unwrap();
    for name in ["jobs", "regularity", "muscles"] {
        let path = at.join(format!("base/{name}.parquet"));
        let kept = std::fs::read(&path).unwrap();
        let columns = read(name, &path).unwrap().columns;
        for (altered, _) in columns.iter().filter(|(column, _)| column != "job_id" && column != "muscle") {
            alter(&at.join("base"), name, |t| match column(t, altered) {
                Values::Number(v) => v[1] = Some(v[1].map_or(1.0, |x| 2.0 * x + 1.0)),
                Values::Integer(v) => v[1] = Some(v[1].map_or(1, |x| 2 * x + 10)),
                Values::Flag(v) => v[1] = v[1].map(|x| !x).or(Some(true)),
                Values::Text(v) => v[1] = Some("other".to_owned()),
            });
            let found =
                sinew::internals::compare::compare(&at.join("results/small"), &at.join("base"), &tolerances).unwrap();
            let ignored =
                schema::TIMINGS.contains(&altered.as_str()) || ["index", "error", "remark"].contains(&altered.as_str());
            assert_eq!(found.drifted(), !ignored, "{name}.{altered}");
            assert_eq!(found.counts()["changed_cells"], usize::from(!ignored), "{name}.{altered}");
            std::fs::write(&path, &kept).unwrap();
        }
    }
}
