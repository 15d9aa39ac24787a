//! The forms of a sweep, using the shipped studies: each has the expected number of jobs, and all of them are solved.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::Command;
use std::sync::atomic::AtomicBool;

use sinew::internals::run::{Ended, RunOptions, run};
use sinew::internals::settings::Value;
use sinew::internals::study::{Job, Study};
use sinew::internals::tables::read;

use super::support::{SMALL, folder, root, study};

/// All shipped study files.
pub fn shipped() -> Vec<PathBuf> {
    let mut found: Vec<PathBuf> = ["studies", "studies/grammar"]
        .iter()
        .flat_map(|sub| std::fs::read_dir(root().join(sub)).unwrap())
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|e| e == "toml"))
        .collect();
    found.sort();
    found
}

fn load(name: &str) -> Study {
    Study::load(&root().join("studies").join(name)).unwrap_or_else(|e| panic!("{:?}", miette::Report::new(e)))
}

/// The swept values of a job, each as `name=value`.
fn words(study: &Study, job: &Job) -> String {
    let word = |(name, value): (&String, &Option<Value>)| {
        format!(
            "{}={}",
            name.split('.').next_back().unwrap(),
            value.as_ref().map_or("–".to_owned(), ToString::to_string)
        )
    };
    study.axes.iter().zip(&job.swept).map(word).collect::<Vec<_>>().join(" ")
}

#[test]
fn each_form_of_a_sweep_has_an_example_that_is_solved() {
    let expected = BTreeMap::from([
        ("conditions", 10),
        ("failure", 3),
        ("grid", 18),
        ("groups", 6),
        ("latin_hypercube", 10),
        ("list", 4),
        ("several", 8),
        ("sobol", 16),
        ("star", 11),
        ("wildcards", 5),
        ("zip", 3),
    ]);
    let out = folder(&[]);
    let mut seen = 0;
    for path in shipped().iter().filter(|path| path.parent().unwrap().ends_with("grammar")) {
        let name = path.file_stem().unwrap().to_str().unwrap();
        let study = load(&format!("grammar/{name}.toml"));
        assert_eq!(study.jobs.len(), expected[name], "{name}");
        let options = RunOptions { out: out.path().join(name), ..RunOptions::default() };
        let report = run(&study, &options, &AtomicBool::new(false)).unwrap();
        assert_eq!((report.failed, report.ended), (0, Ended::Complete), "{name}");
        seen += 1;
    }
    assert_eq!(seen, expected.len());
}

#[test]
fn sweeps_expand_as_they_say() {
    let zip = load("grammar/zip.toml");
    assert_eq!(zip.jobs.iter().map(|job| job.points).collect::<Vec<_>>(), [6, 6, 6]);

    let star = load("grammar/star.toml");
    let moved = |job: &Job| job.changes.len();
    assert_eq!(star.jobs.iter().map(moved).collect::<Vec<_>>(), [0, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1]);
    assert_eq!(star.jobs[3].swept[1], Some(Value::Number(0.95)), "what is not moved has its base value");
    assert_eq!(star.jobs[3].swept[0], Some(Value::Number(1.0)));

    let groups = load("grammar/groups.toml");
    assert_eq!(words(&groups, &groups.jobs[1]), "mass_scale=0.9 mass_scale=0.9 time_scale=2 h=0.4");
    let list = load("grammar/list.toml");
    assert_eq!(words(&list, &list.jobs[3]), "mu=0.2 bounds=both stages=3 max_isometric_force_scale=0.5");

    let several = load("grammar/several.toml");
    assert_eq!(several.repeated, 1, "mu = 0.2 with both bounds is of the first sweep already");
    let wildcards = load("grammar/wildcards.toml");
    let paths: Vec<&str> = wildcards.jobs[0].changes.iter().map(|change| change.path.as_str()).collect();
    assert_eq!(paths.len(), 5, "{paths:?}");
    let weaker: Vec<&str> = wildcards.jobs[3].changes.iter().map(|change| change.path.as_str()).collect();
    assert_eq!(weaker, ["muscle.biceps.max_isometric_force_scale", "muscle.brachialis.max_isometric_force_scale"]);
    assert_eq!(wildcards.ratios[0].numerator.0, ["biceps", "brachialis"]);
}

#[test]
fn load_ratios_are_those_of_the_loads() {
    let folder = folder(&[]);
    let study = load("grammar/wildcards.toml");
    run(&study, &RunOptions { out: folder.path().into(), ..RunOptions::default() }, &AtomicBool::new(false)).unwrap();
    let table = |name| read(name, &folder.path().join(format!("{name}.parquet"))).unwrap();
    let (ratios, muscles) = (table("ratios"), table("muscles"));
    assert_eq!(ratios.rows(), 5 * 4);
    let of = |job: &str, muscle: &str, column: &str| {
        let is =
            |row: &usize| muscles.text("job_id", *row) == Some(job) && muscles.text("muscle", *row) == Some(muscle);
        muscles.number(column, (0..muscles.rows()).find(is).unwrap()).unwrap()
    };
    for row in 0..ratios.rows() {
        let job = ratios.text("job_id", row).unwrap();
        let (column, members) = match ratios.text("measure", row).unwrap() {
            "mean_force" => ("mean_force_n", 1.0),
            "peak_force" => ("peak_force_n", 1.0),
            "impulse" => ("impulse_n_s", 1.0),
            "activation" => ("mean_activation", 2.0),
            other => panic!("{other}"),
        };
        let (up, down) = (of(job, "biceps", column) + of(job, "brachialis", column), of(job, "triceps", column));
        let expected = Some(up / members / down).filter(|ratio| ratio.is_finite());
        match (ratios.number("value", row), expected) {
            (Some(found), Some(expected)) => assert!((found - expected).abs() <= 1e-12 * expected.abs()),
            (found, expected) => assert_eq!(found, expected),
        }
    }
}

#[test]
fn a_job_is_the_same_however_it_is_written() {
    let ids = |sweep: &str| {
        let text = SMALL.replace("mu = [0.1, 0.2, 0.4]\nbounds = [\"activation\", \"both\"]", sweep);
        let folder = folder(&[("study.toml", &text)]);
        let mut ids: Vec<String> = study(&folder).1.jobs.into_iter().map(|job| job.id).collect();
        ids.sort();
        ids
    };
    let base = ids("mu = [0.2]");
    assert_eq!(base, ids("\"body.forearm.mass_scale\" = [1.0]"), "a factor of 1 changes nothing");
    assert_eq!(base, ids("\"motion.elbow_angle_offset_deg\" = [0.0]"));
    let order = ids("\"muscle.biceps.max_isometric_force_scale\" = [0.5]\n\"body.forearm.mass_scale\" = [1.1]");
    assert_eq!(order, ids("\"body.forearm.mass_scale\" = [1.1]\n\"muscle.biceps.max_isometric_force_scale\" = [0.5]"));
    assert_eq!(ids("mu = { from = 0.1, to = 0.7, count = 7 }"), ids("mu = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7]"));
    assert_ne!(base, ids("\"body.forearm.mass_scale\" = [1.1]"));
}

/// A study of the small arm with different sweeps.
fn swept(sweep: &str) -> Study {
    let (head, _) = SMALL.split_once("[sweep.grid]").unwrap();
    let folder = folder(&[("study.toml", &format!("{head}{sweep}"))]);
    study(&folder).1
}

#[test]
fn labels_are_what_a_job_has_and_conditions_look_at_that() {
    let study = swept(
        "[[sweep]]\ngrid.'muscle.*.max_isometric_force_scale' = [0.5]\n\
         [[sweep]]\ngrid.'muscle.biceps.max_isometric_force_scale' = [0.5, 0.75]",
    );
    let labels: Vec<_> = study.jobs.iter().map(|job| job.swept.clone()).collect();
    let number = |x| Some(Value::Number(x));
    assert_eq!(labels, [[number(0.5), number(0.5)], [None, number(0.5)], [None, number(0.75)]]);
    let study = swept(
        "[sweep.grid]\n'muscle.*.max_isometric_force_scale' = [0.5, 1.0]\n\
         [[sweep.exclude]]\n'muscle.biceps.max_isometric_force_scale' = 0.5",
    );
    assert_eq!(study.jobs.len(), 1);
    assert!(study.jobs[0].changes.is_empty());
    // A setting that the midpoint rule ignores does not make a second job.
    assert_eq!(swept("[sweep.grid]\nscheme = ['midpoint']\nstages = [1, 2, 3]").jobs.len(), 1);
    assert_eq!(
        swept("[sweep.grid]\nmeasurement_ratio = [3, 6]\n[[sweep.when]]\nmeasurement_ratio = 6").jobs[0].id,
        swept("[sweep.grid]\nmu = [0.2]").jobs[0].id
    );
}

#[test]
fn the_shipped_schema_is_that_of_the_types() {
    let shipped = std::fs::read_to_string(root().join("data/study.schema.json")).unwrap();
    let made = format!("{:#}\n", sinew::internals::study::file::schema());
    assert!(shipped == made, "run `sinew schema > data/study.schema.json`");
}

/// Validates every shipped study, and some invalid ones, with an independent implementation of JSON Schema.
const VALIDATE: &str = r#"
import json, sys, tomllib, jsonschema
schema = json.load(open(sys.argv[1]))
jsonschema.Draft202012Validator.check_schema(schema)
validator = jsonschema.Draft202012Validator(schema)
for path in sys.argv[2:]:
    errors = [e.message for e in validator.iter_errors(tomllib.load(open(path, "rb")))]
    assert not errors, (path, errors)
head = 'name = "a"\nmodel = "m"\nmotion = "n"\n'
for mistake in ['[bse]', '[base]\nmuu = 1', '[base]\nmu = "much"', '[base]\nscheme = "radu"', '[base]\nstages = 4',
                '[sweep.gird]\nmu = [1]', '[sweep.grid]\nmu = []', '[sweep.grid]\nmu = 1',
                '[sweep.grid]\nmu = { from = 1, to = 2 }', '[sweep.grid]\nbounds = ["bth"]',
                '[sweep.sample]\ncount = 3\nmu = { from = 1, to = 2 }',
                '[sweep.sample]\ncount = 3\nseed = 1\nmethod = "lhs"',
                '[[ratio]]\nname = "r"\nnumerator = "a"', '[sweep]\nwhen = [{ muu = 1 }]', 'on_failure = "cry"']:
    text = mistake + "\n" + head if mistake.startswith("on_") else head + mistake
    assert list(validator.iter_errors(tomllib.loads(text))), mistake
print("valid")
"#;

#[test]
fn editors_accept_the_shipped_studies_and_see_mistakes() {
    let there = Command::new("python3").args(["-c", "import jsonschema, tomllib"]).output();
    if !there.is_ok_and(|output| output.status.success()) {
        eprintln!("SKIPPED: editors_accept_the_shipped_studies: python3 (3.11) with jsonschema is not installed");
        return;
    }
    let schema = root().join("data/study.schema.json");
    let output = Command::new("python3").args(["-c", VALIDATE]).arg(schema).args(shipped()).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}
