//! The program as a user sees it.

use std::path::Path;
use std::process::{Command, Output};

use super::support::{SMALL, folder, root};

pub fn sinew(arguments: &[&str], folder: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_sinew")).args(arguments).current_dir(folder).output().unwrap()
}

pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A text without its line breaks and the rule before each line, which depend on the terminal's width and on how long
/// the paths in it are.
pub fn one_line(text: &str) -> String {
    text.replace('│', " ").split_whitespace().collect::<Vec<&str>>().join(" ")
}

/// What a user reads of an error, on one line.
pub fn said(error: impl miette::Diagnostic + Send + Sync + 'static) -> String {
    one_line(&format!("{:?}", miette::Report::new(error)))
}

#[test]
fn a_study_is_planned_run_and_shown() {
    let folder = folder(&[("study.toml", SMALL)]);
    let plan = sinew(&["plan", "study.toml"], folder.path());
    assert_eq!(plan.status.code(), Some(0));
    assert!(text(&plan.stdout).contains("6 jobs"));

    let run = sinew(&["run", "study.toml", "--jobs", "2"], folder.path());
    assert_eq!(run.status.code(), Some(0), "{}", text(&run.stderr));
    assert!(text(&run.stdout).ends_with("6 of 6 jobs finished; results in results/small\n"));
    assert!(text(&run.stderr).contains("6/6 jobs"), "plain progress lines where there is no terminal");
    for name in ["jobs", "regularity", "iterations", "muscles", "spectrum"] {
        assert!(folder.path().join(format!("results/small/{name}.parquet")).exists(), "{name}");
    }
    assert!(!folder.path().join("results/small/trajectories.parquet").exists(), "only on request");
    let manifest: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.path().join("results/small/manifest.json")).unwrap()).unwrap();
    assert_eq!(manifest["jobs"].as_array().unwrap().len(), 6);
    let stored = manifest["files"]["jobs.parquet"].as_str().unwrap();
    let bytes = std::fs::read(folder.path().join("results/small/jobs.parquet")).unwrap();
    assert_eq!(stored, blake3::hash(&bytes).to_hex().as_str());

    let show = sinew(&["show", "results/small"], folder.path());
    assert_eq!(show.status.code(), Some(0));
    let shown = text(&show.stdout);
    assert!(shown.contains("6 converged") && shown.contains("triceps"), "{shown}");
}

#[test]
fn the_main_job_prints_table_1() {
    let folder = folder(&[]);
    let study = root().join("studies/table1.toml");
    let run = sinew(&["run", study.to_str().unwrap(), "--out", "out"], folder.path());
    assert_eq!(run.status.code(), Some(0), "{}", text(&run.stderr));
    let shown = text(&run.stdout);
    assert!(shown.contains("12 converged"));
    assert!(shown.contains("at the measured instants") && shown.contains("[Aᵀ Jᵀ]  −1 (−1)"));
    assert!(shown.contains("12 of the thesis' 12 numbers agree as counted, 12 as predicted"), "{shown}");
}

#[test]
fn failed_jobs_give_exit_code_1() {
    let text_of = SMALL.replace("[sweep.grid]", "max_iterations = 2\n[sweep.grid]");
    let folder = folder(&[("study.toml", &text_of)]);
    let run = sinew(&["run", "study.toml"], folder.path());
    assert_eq!(run.status.code(), Some(1));
    let shown = text(&run.stdout);
    assert!(shown.contains("6 iteration_limit") && one_line(&shown).contains("raise max_iterations"), "{shown}");
}

#[test]
fn shipped_files_check_clean() {
    let models = std::fs::read_dir(root().join("data/models")).unwrap().map(|entry| entry.unwrap().path());
    let paths = models.chain(super::sweeps::shipped());
    let files: Vec<String> = paths.map(|path| path.to_str().unwrap().to_owned()).collect();
    assert!(files.len() >= 5);
    let arguments: Vec<&str> = ["check"].into_iter().chain(files.iter().map(String::as_str)).collect();
    let check = sinew(&arguments, root());
    assert_eq!(check.status.code(), Some(0), "{}", text(&check.stderr));
}

#[test]
fn help_has_examples() {
    for command in [
        "plan",
        "run",
        "merge",
        "status",
        "show",
        "moment-arms",
        "inverse-dynamics",
        "joint-loads",
        "compare",
        "slurm",
        "schema",
        "check",
    ] {
        let help = sinew(&[command, "--help"], root());
        assert_eq!(help.status.code(), Some(0));
        assert!(text(&help.stdout).contains("Example"), "{command}");
    }
    assert_eq!(sinew(&["rum"], root()).status.code(), Some(2));
}
