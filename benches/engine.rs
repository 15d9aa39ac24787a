//! Cost of the engine around the solver: planning, running and opening the results of 100,000 jobs.
//!
//! `cargo bench --bench engine`

use std::path::Path;
use std::process::Command;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use sinew::internals::outcome::{Outcome, Status};
use sinew::internals::run::{RunOptions, run_with};
use sinew::internals::solve::solve;
use sinew::internals::study::Study;

const STUDY: &str = r#"
name = "big"
model = "{root}/data/models/arm.toml"
motion = "{root}/data/motions/arm_curl.csv"
[base]
h = 0.2
[sweep.grid]
mu = { from = 0.01, to = 1.0, count = 1000, scale = "log" }
"muscle.triceps.tendon_slack_length_scale" = { from = 0.9, to = 1.1, count = 100 }
[[ratio]]
name = "flexors"
numerator = "biceps"
denominator = "brachialis"
"#;

fn timed<T>(what: &str, work: impl FnOnce() -> T) -> (T, Duration) {
    let clock = Instant::now();
    let result = work();
    let elapsed = clock.elapsed();
    println!("{what:48} {:8.3} s   peak memory {} MB", elapsed.as_secs_f64(), peak_mb());
    (result, elapsed)
}

/// Largest resident memory of this process so far (Linux), MB.
fn peak_mb() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    line.and_then(|line| line.split_whitespace().next()?.parse::<u64>().ok()).unwrap_or(0) / 1024
}

fn main() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("study.toml");
    std::fs::write(&path, STUDY.replace("{root}", root.to_str().unwrap())).unwrap();

    let (study, _) = timed("plan 100,000 jobs", || Study::load(&path).unwrap());
    let jobs = study.jobs.len();
    // Each job gets a real outcome, so that lines and tables have realistic lengths.
    let job = &study.jobs[0];
    let whole = solve(&study.model_of(job).unwrap(), &study.motion, &job.settings, job.points);
    assert_eq!(whole.job.status, Status::Converged);
    let bare = Outcome { job: whole.job.clone(), ..Outcome::default() };
    for (name, outcome) in [("bare", bare), ("whole", whole)] {
        let out = folder.path().join(name);
        let options = RunOptions { out: out.clone(), ..RunOptions::default() };
        let run = |what: &str| {
            let stop = AtomicBool::new(false);
            timed(what, || run_with(&study, &options, &stop, &|_, _, _| (outcome.clone(), None)).unwrap())
        };
        let (report, elapsed) = run(&format!("run them, {name} outcomes, tables included"));
        assert_eq!(report.finished, jobs);
        println!("{:48} {:8.1} µs a job", "", elapsed.as_secs_f64() / jobs as f64 * 1e6);
        run("run again: nothing to do, tables anew");
        for command in ["status", "show"] {
            timed(&format!("sinew {command}"), || {
                let output = Command::new(env!("CARGO_BIN_EXE_sinew")).arg(command).arg(&out).output().unwrap();
                assert!(output.status.success());
            });
        }
        let size: u64 = std::fs::read_dir(&out).unwrap().map(|e| e.unwrap().metadata().unwrap().len()).sum();
        println!("{:48} {:8} MB on disk", "", size >> 20);
    }
}
