//! No finished job is lost or corrupted: kills, full disks, shards, manifests, failures.

use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use rand::{RngExt, SeedableRng};
use sinew::internals::outcome::{Outcome, Status};
use sinew::internals::run::reasons::{Reason, reasons};
use sinew::internals::run::{Ended, RunOptions, Shard, collect, run, run_with, task};
use sinew::internals::solve::solve_from;
use sinew::internals::study::Study;
use sinew::internals::tables::read;

use super::cli::{sinew, text};
use super::engine::tables;
use super::support::{SMALL, folder, root, study};

/// Long enough for a kill to interrupt it: 36 jobs of about 40 ms.
const LONG: &str = r#"
name = "long"
model = "{root}/data/models/arm.toml"
motion = "{root}/data/motions/arm_curl.csv"
[base]
stages = 1
trajectories = true
[sweep.grid]
bounds = ["activation", "both", "excitation"]
mu = { from = 0.05, to = 0.5, count = 12 }
[[ratio]]
name = "flexors"
numerator = "biceps"
denominator = "brachialis"
"#;

fn begin(folder: &Path, out: &str) -> std::process::Child {
    Command::new(env!("CARGO_BIN_EXE_sinew"))
        .args(["run", "study.toml", "--jobs", "1", "--out", out])
        .current_dir(folder)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

#[test]
fn twenty_kills_at_any_instant_change_nothing() {
    const ROUNDS: usize = 21;
    let folder = folder(&[("study.toml", LONG)]);
    let at = folder.path();
    let clock = Instant::now();
    assert!(begin(at, "whole").wait().unwrap().success());
    let whole_run = clock.elapsed();
    let whole = tables(&at.join("whole"));
    assert_eq!(whole.len(), 9);
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(20);
    let finished =
        |out: &str| std::fs::read_to_string(at.join(out).join("finished.jsonl")).map_or(0, |t| t.lines().count());
    let mut interrupted_with = Vec::new();
    for round in 0..ROUNDS {
        // A random instant in each of `ROUNDS` equal parts of the run, so that the kills are spread over all of it.
        let out = format!("round{round}");
        let mut share = (round as f64 + rng.random::<f64>()) / ROUNDS as f64;
        let killed = loop {
            let _ = std::fs::remove_dir_all(at.join(&out));
            let mut child = begin(at, &out);
            std::thread::sleep(whole_run.mul_f64(share));
            child.kill().unwrap();
            if !child.wait().unwrap().success() {
                break finished(&out);
            }
            share *= 0.9; // the run ended before the kill: kill earlier
        };
        interrupted_with.push(killed);
        // Sometimes kill the continued run, too.
        if round % 3 == 0 {
            let mut child = begin(at, &out);
            std::thread::sleep(whole_run.mul_f64(0.3 * rng.random::<f64>()));
            child.kill().unwrap();
            child.wait().unwrap();
        }
        assert!(begin(at, &out).wait().unwrap().success(), "round {round}");
        assert!(tables(&at.join(&out)) == whole, "round {round}, killed with {killed} finished jobs");
    }
    eprintln!("killed with so many of 36 jobs finished: {interrupted_with:?}");
    let in_the_middle = interrupted_with.iter().filter(|&&n| n > 0 && n < 36).count();
    assert!(in_the_middle > ROUNDS / 2, "{interrupted_with:?}");
}

#[test]
fn a_full_disk_loses_nothing_that_is_finished() {
    let folder = folder(&[("study.toml", LONG)]);
    let at = folder.path();
    // Writes beyond this many KB per file fail, as on a full disk; the accompanying signal is ignored.
    let limited = |kb: usize| {
        let script =
            format!("trap '' XFSZ; ulimit -f {kb}; exec {} run study.toml --out out", env!("CARGO_BIN_EXE_sinew"));
        Command::new("bash").args(["-c", &script]).current_dir(at).output().unwrap()
    };
    let mut kept = 0;
    for kb in [200, 500] {
        let run = limited(kb);
        let message = text(&run.stderr);
        assert_eq!(run.status.code(), Some(2), "{message}");
        assert!(message.contains("finished.jsonl"), "{message}");
        let lines = std::fs::read_to_string(at.join("out/finished.jsonl")).unwrap();
        assert!(lines.lines().count() > kept && lines.ends_with('\n'), "whole lines only");
        kept = lines.lines().count();
    }
    assert_eq!(sinew(&["run", "study.toml", "--out", "out"], at).status.code(), Some(0));
    assert_eq!(sinew(&["run", "study.toml", "--out", "whole"], at).status.code(), Some(0));
    assert!(tables(&at.join("out")) == tables(&at.join("whole")));
}

#[test]
fn shards_in_any_order_merge_to_the_tables_of_one_run() {
    let text_of = LONG.replace("[sweep.grid]", "warm_start = 'neighbour'\n[sweep.grid]");
    let folder = folder(&[("study.toml", &text_of)]);
    let at = folder.path();
    assert_eq!(sinew(&["run", "study.toml", "--out", "whole"], at).status.code(), Some(0));
    let shard = |part: &str| sinew(&["run", "study.toml", "--out", "parts", "--shard", part], at);
    assert_eq!(shard("2/3").status.code(), Some(0));
    assert!(!at.join("parts/jobs.parquet").exists(), "merge makes the tables");
    let merge = || sinew(&["merge", "parts"], at);
    let early = merge();
    assert_eq!(early.status.code(), Some(1));
    assert!(text(&early.stdout).contains("24 jobs are missing"), "{}", text(&early.stdout));
    let status = sinew(&["status", "parts"], at);
    assert!(
        text(&status.stdout).contains("12 of 36 jobs finished (12 converged), 24 to do"),
        "{}",
        text(&status.stdout)
    );
    for part in ["0/3", "1/3", "1/3"] {
        assert_eq!(shard(part).status.code(), Some(0));
    }
    for _ in 0..2 {
        assert_eq!(merge().status.code(), Some(0), "again and again");
        assert!(tables(&at.join("parts")) == tables(&at.join("whole")));
    }
    std::fs::create_dir(at.join("base")).unwrap();
    assert_eq!(sinew(&["compare", "parts", "base", "--accept"], at).status.code(), Some(0));
    assert_eq!(sinew(&["merge", "base"], at).status.code(), Some(2), "a baseline is not written over");
    // A plan is fixed: shards of another plan are refused.
    std::fs::write(
        at.join("study.toml"),
        std::fs::read_to_string(at.join("study.toml")).unwrap().replace("0.5,", "0.6,"),
    )
    .unwrap();
    let other = shard("0/3");
    assert_eq!(other.status.code(), Some(2));
    assert!(text(&other.stderr).contains("plan was written for other jobs"), "{}", text(&other.stderr));
    assert_eq!(shard("3/3").status.code(), Some(2), "no such part");
}

#[test]
fn a_manifest_alone_runs_the_study_again() {
    let arm = std::fs::read_to_string(root().join("data/models/arm.toml")).unwrap();
    let folder =
        folder(&[("study.toml", &SMALL.replace("{root}/data/models/arm.toml", "arm.toml")), ("arm.toml", &arm)]);
    let at = folder.path();
    assert_eq!(sinew(&["run", "study.toml", "--out", "first"], at).status.code(), Some(0));
    std::fs::create_dir(at.join("elsewhere")).unwrap();
    std::fs::rename(at.join("first/manifest.json"), at.join("elsewhere/manifest.json")).unwrap();
    std::fs::remove_file(at.join("study.toml")).unwrap();
    std::fs::remove_file(at.join("arm.toml")).unwrap();
    let again = sinew(&["run", "elsewhere/manifest.json", "--out", "second"], at);
    assert_eq!(again.status.code(), Some(0), "{}", text(&again.stderr));
    assert!(tables(&at.join("first")) == tables(&at.join("second")));
    std::fs::write(at.join("broken.json"), "{ \"sources\": 3 }").unwrap();
    let broken = sinew(&["run", "broken.json"], at);
    assert_eq!(broken.status.code(), Some(2));
    assert!(text(&broken.stderr).contains("not a manifest of Sinew"), "{}", text(&broken.stderr));
}

/// Lines of finished jobs with their headers changed, as an older version wrote them: its hash covers only the outcome.
fn with_headers(lines: &str, from: &str, to: &str) -> String {
    let line = |line: &str| {
        let (header, outcome) = line.split_once(",\"outcome\":").unwrap();
        let check = &blake3::hash(outcome.strip_suffix('}').unwrap().as_bytes()).to_hex()[..16];
        let header = format!("{}\"check\":\"{check}\"", header.split("\"check\"").next().unwrap());
        format!("{},\"outcome\":{outcome}\n", header.replace(from, to))
    };
    lines.lines().map(line).collect()
}

#[test]
fn plan_says_why_each_job_would_run() {
    let folder = folder(&[("study.toml", SMALL)]);
    let at = folder.path();
    let write =
        |text: &str| std::fs::write(at.join("study.toml"), text.replace("{root}", root().to_str().unwrap())).unwrap();
    let plan = || text(&sinew(&["plan", "study.toml"], at).stdout);
    assert!(plan().contains("6 new"), "{}", plan());
    sinew(&["run", "study.toml"], at);
    assert!(plan().contains("6 done") && plan().contains("a run would solve 0 of them"));
    write(&SMALL.replace("h = 0.2", "h = 0.1").replace("0.4]", "0.8]"));
    let changed = plan();
    assert!(changed.contains("4 changed, 2 new"), "{changed}");
    assert!(changed.contains("changed: h 0.2 → 0.1"), "{changed}");
    let arm = std::fs::read_to_string(root().join("data/models/arm.toml")).unwrap();
    std::fs::write(at.join("arm.toml"), arm.replacen("mass = ", "mass = 1", 1)).unwrap();
    write(&SMALL.replace("{root}/data/models/arm.toml", "arm.toml"));
    assert!(plan().contains("changed: the model file"), "{}", plan());
    write(&SMALL.replace("[sweep.grid]", "max_iterations = 2\n[sweep.grid]"));
    sinew(&["run", "study.toml"], at);
    assert!(plan().contains("6 failed before") && plan().contains("iteration_limit"), "{}", plan());
    // Results of another solver are kept, shown, and recomputed only on request.
    write(SMALL);
    sinew(&["run", "study.toml"], at);
    let store = at.join("results/small/finished.jsonl");
    let lines = std::fs::read_to_string(&store).unwrap();
    std::fs::write(&store, with_headers(&lines, sinew::SOLVER, "0.0.1+old")).unwrap();
    assert!(plan().contains("6 done by another solver") && plan().contains("solver 0.0.1+old"), "{}", plan());
    let run = sinew(&["run", "study.toml"], at);
    assert!(text(&run.stderr).contains("results of 6 jobs are from solver 0.0.1+old"), "{}", text(&run.stderr));
    assert!(text(&run.stdout).contains("6 of them from an earlier run"));
    let run = sinew(&["run", "study.toml", "--outdated"], at);
    assert!(!text(&run.stdout).contains("from an earlier run"), "{}", text(&run.stdout));
    assert!(plan().contains("6 done\n"), "{}", plan());
}

#[test]
fn tables_of_an_earlier_run_are_not_taken_for_those_of_one_that_was_cut_off() {
    let folder = folder(&[("study.toml", LONG)]);
    let at = folder.path();
    assert!(begin(at, "out").wait().unwrap().success());
    let mut again = Command::new(env!("CARGO_BIN_EXE_sinew"))
        .args(["run", "study.toml", "--jobs", "1", "--out", "out", "--fresh"])
        .current_dir(at)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    while !std::fs::read_to_string(at.join("out/finished.jsonl")).is_ok_and(|t| (1..36).contains(&t.lines().count())) {
        std::thread::sleep(Duration::from_millis(1));
    }
    again.kill().unwrap();
    again.wait().unwrap();
    let compare = sinew(&["compare", "out", "out"], at);
    assert_eq!(compare.status.code(), Some(2), "{}", text(&compare.stdout));
    let show = sinew(&["show", "out"], at);
    assert!(show.status.code() == Some(2) && text(&show.stderr).contains("has not ended"), "{}", text(&show.stderr));
}

#[test]
fn merges_may_meet_and_damage_is_run_again() {
    let folder = folder(&[("study.toml", &LONG.replace("count = 12", "count = 4"))]);
    let at = folder.path();
    let shard = |part: &str| sinew(&["run", "study.toml", "--out", "out", "--shard", part], at).status.code();
    assert_eq!((shard("0/2"), shard("1/2")), (Some(0), Some(0)));
    for _ in 0..4 {
        let merge = || {
            Command::new(env!("CARGO_BIN_EXE_sinew"))
                .args(["merge", "out"])
                .current_dir(at)
                .stdout(Stdio::null())
                .spawn()
        };
        let both = [merge().unwrap(), merge().unwrap()];
        assert!(both.into_iter().all(|mut child| child.wait().unwrap().success()));
        assert_eq!(tables(&at.join("out")).len(), 9);
    }
    // Ratios that are declared later also appear in the tables of shards.
    let text_of = std::fs::read_to_string(at.join("study.toml")).unwrap();
    std::fs::write(at.join("study.toml"), text_of.replace("name = \"flexors\"", "name = \"others\"")).unwrap();
    assert_eq!(shard("0/2"), Some(0));
    sinew(&["merge", "out"], at);
    assert_eq!(read("ratios", &at.join("out/ratios.parquet")).unwrap().text("ratio", 0), Some("others"));
    // A changed byte in the middle of a file: every command detects it, and the job runs again.
    let path = at.join("out/finished.0-of-2.jsonl");
    let mut bytes = std::fs::read(&path).unwrap();
    let place = bytes.iter().position(|&b| b == b'\n').unwrap() - 50;
    bytes[place] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    assert!(text(&sinew(&["status", "out"], at).stdout).contains("1 to do"));
    assert!(text(&sinew(&["plan", "study.toml", "--out", "out"], at).stdout).contains("1 new"));
    let slurm = sinew(&["slurm", "study.toml", "--out", "out", "--shards", "2"], at);
    assert!(text(&slurm.stdout).contains("--array=0 "), "{}", text(&slurm.stdout));
    assert_eq!(shard("0/2"), Some(0));
    assert_eq!(sinew(&["merge", "out"], at).status.code(), Some(0));
    let other = std::fs::read_to_string(at.join("study.toml")).unwrap().replace("\"long\"", "\"other\"");
    std::fs::write(at.join("other.toml"), other).unwrap();
    assert_eq!(sinew(&["slurm", "other.toml", "--out", "out"], at).status.code(), Some(2), "another study's folder");
}

#[test]
fn another_study_is_not_written_over() {
    let folder = folder(&[("study.toml", SMALL), ("other.toml", &SMALL.replace("\"small\"", "\"other\""))]);
    let at = folder.path();
    assert_eq!(sinew(&["run", "study.toml", "--out", "out"], at).status.code(), Some(0));
    let other = sinew(&["run", "other.toml", "--out", "out"], at);
    assert_eq!(other.status.code(), Some(2));
    assert!(text(&other.stderr).contains("contains the study `small`"), "{}", text(&other.stderr));
    assert_eq!(sinew(&["run", "other.toml", "--out", "out", "--fresh"], at).status.code(), Some(0));
}

fn options(out: &Path) -> RunOptions {
    RunOptions { out: out.to_owned(), threads: Some(1), ..RunOptions::default() }
}

#[test]
fn a_study_may_stop_at_its_first_failure() {
    let folder = folder(&[("study.toml", &format!("on_failure = 'stop'\n{SMALL}"))]);
    let (_, study) = study(&folder);
    let out = folder.path().join("out");
    let fails = AtomicBool::new(true);
    let solver = |_: &Study, job: &sinew::internals::study::Job, _: Option<&_>| match job.index == 2
        && fails.load(Ordering::Relaxed)
    {
        true => (Outcome::failed(Status::Stalled, "by hand"), None),
        false => {
            let mut outcome = Outcome::failed(Status::Converged, "");
            outcome.job.error = None;
            (outcome, None)
        }
    };
    let first = run_with(&study, &options(&out), &AtomicBool::new(false), &solver).unwrap();
    assert_eq!((first.ended, first.finished, first.failed), (Ended::FirstFailure, 3, 1));
    let second = run_with(&study, &options(&out), &AtomicBool::new(false), &solver).unwrap();
    assert_eq!((second.finished, second.failed, second.ended), (6, 1, Ended::Complete), "again: on with the others");
    fails.store(false, Ordering::Relaxed);
    let calls = AtomicUsize::new(0);
    let counted = |study: &Study, job: &sinew::internals::study::Job, before: Option<&_>| {
        calls.fetch_add(1, Ordering::Relaxed);
        solver(study, job, before)
    };
    let again = RunOptions { failed: true, ..options(&out) };
    let third = run_with(&study, &again, &AtomicBool::new(false), &counted).unwrap();
    assert_eq!((third.finished, third.failed, calls.into_inner()), (6, 0, 1), "the failed one alone");
}

#[test]
fn failed_jobs_are_solved_by_continuation_in_steps() {
    // A solver that converges only from nearby: from a start at most 0.12 away in μ.
    let text = SMALL.replace("mu = [0.1, 0.2, 0.4]", "mu = [0.1, 0.2, 0.4, 5.0]").replace("\"activation\", ", "");
    let folder = folder(&[("study.toml", &format!("on_failure = 'retry'\n{text}"))]);
    let (_, study) = study(&folder);
    let out = folder.path().join("out");
    let seen = Mutex::new(Vec::new());
    let at = Mutex::new(f64::NAN);
    let solver =
        |study: &Study, job: &sinew::internals::study::Job, before: Option<&sinew::internals::warm::Answer>| {
            let mu = job.settings.mu;
            let from = *at.lock().unwrap();
            seen.lock().unwrap().push((mu, before.is_some()));
            if mu > 0.15 && (before.is_none() || (mu - from).abs() > 0.12) {
                return (Outcome::failed(Status::Stalled, "too far"), None);
            }
            *at.lock().unwrap() = mu;
            solve_from(task(study, job, &study.model_of(job).unwrap()), before)
        };
    let report = run_with(&study, &options(&out), &AtomicBool::new(false), &solver).unwrap();
    assert_eq!((report.finished, report.failed), (4, 1), "{seen:?}");
    let jobs = read("jobs", &out.join("jobs.parquet")).unwrap();
    assert_eq!(jobs.text("status", 2), Some("converged"), "0.1 → 0.14 → 0.2 → 0.28 → 0.4 in four steps");
    assert_eq!(jobs.text("warm_start_from", 2), Some(study.jobs[0].id.as_str()));
    assert!(
        jobs.text("remark", 2).unwrap().contains("continuation from job 0 in 4 steps"),
        "{:?}",
        jobs.text("remark", 2)
    );
    assert!(
        jobs.text("error", 3).unwrap().contains("continuation from job 0 did not help"),
        "{:?}",
        jobs.text("error", 3)
    );
    let before = seen.lock().unwrap().len();
    run_with(&study, &options(&out), &AtomicBool::new(false), &solver).unwrap();
    assert_eq!(seen.lock().unwrap().len(), before, "what was tried again is not tried a third time");
}

#[test]
fn a_time_limit_stops_the_job() {
    let text = SMALL
        .replace("h = 0.2\nregularity = \"optimum\"", "h = 0.002\nregularity = \"every_iteration\"\ntime_limit_s = 0.5")
        .replace("mu = [0.1, 0.2, 0.4]", "mu = [0.1]")
        .replace("bounds = [\"activation\", \"both\"]", "scheme = [\"midpoint\", \"radau\"]");
    let folder = folder(&[("study.toml", &text)]);
    let (_, study) = study(&folder);
    let out = folder.path().join("out");
    let clock = Instant::now();
    let report = run(&study, &options(&out), &AtomicBool::new(false)).unwrap();
    assert_eq!(report.failed, 2);
    let jobs = read("jobs", &out.join("jobs.parquet")).unwrap();
    assert!((0..2).all(|row| jobs.text("status", row) == Some("time_limit")));
    // Without the limit, these jobs take half a minute.
    assert!(clock.elapsed() < Duration::from_secs(8), "{:?}", clock.elapsed());
}

#[test]
fn merging_needs_no_solver_and_shards_cover_a_study_once() {
    let folder = folder(&[("study.toml", LONG)]);
    let (_, study) = study(&folder);
    let out = folder.path().join("out");
    let count = AtomicUsize::new(0);
    for index in 0..5 {
        let shard = Some(Shard { index, count: 5 });
        let solver = |_: &Study, _: &sinew::internals::study::Job, _: Option<&_>| {
            count.fetch_add(1, Ordering::Relaxed);
            (Outcome::failed(Status::Invalid, "not solved in this test"), None)
        };
        run_with(&study, &RunOptions { shard, ..options(&out) }, &AtomicBool::new(false), &solver).unwrap();
    }
    assert_eq!(count.into_inner(), 36);
    let (_, collected) = collect::merge(&out).unwrap();
    assert_eq!((collected.finished(), collected.failed(), collected.jobs), (36, 36, 36));
}

#[test]
fn more_shards_are_merged_than_files_may_be_open() {
    let folder = folder(&[("study.toml", SMALL)]);
    let at = folder.path();
    assert!(sinew(&["run", "study.toml", "--out", "whole"], at).status.success());
    std::fs::create_dir(at.join("many")).unwrap();
    std::fs::copy(at.join("whole/manifest.json"), at.join("many/manifest.json")).unwrap();
    let lines = std::fs::read_to_string(at.join("whole/finished.jsonl")).unwrap();
    const SHARDS: usize = 300;
    for shard in 0..SHARDS {
        let line = lines.lines().nth(shard).map_or(String::new(), |line| format!("{line}\n"));
        std::fs::write(at.join(format!("many/finished.{shard}-of-{SHARDS}.jsonl")), line).unwrap();
    }
    let merge = Command::new("sh")
        .args(["-c", "ulimit -n 64; exec \"$0\" merge many", env!("CARGO_BIN_EXE_sinew")])
        .current_dir(at)
        .output()
        .unwrap();
    assert_eq!(merge.status.code(), Some(0), "{}", text(&merge.stderr));
    assert!(tables(&at.join("many")) == tables(&at.join("whole")));
}

#[test]
fn a_line_of_absurd_length_is_damage() {
    let folder = folder(&[("study.toml", SMALL)]);
    let at = folder.path();
    assert!(sinew(&["run", "study.toml", "--out", "out"], at).status.success());
    let store = at.join("out/finished.jsonl");
    let whole = std::fs::read_to_string(&store).unwrap();
    let before = tables(&at.join("out"));
    let length = whole.split("\"length\":").nth(1).unwrap().split(',').next().unwrap();
    for absurd in
        ["18446744073709551615", "18446744073709551600", "9223372036854775807", "99999999999999999999999", "-1"]
    {
        std::fs::write(&store, whole.replacen(&format!("\"length\":{length}"), &format!("\"length\":{absurd}"), 1))
            .unwrap();
        let status = sinew(&["status", "out"], at);
        assert!(text(&status.stdout).contains("1 damaged line"), "{absurd}: {}", text(&status.stdout));
        let run = sinew(&["run", "study.toml", "--out", "out"], at);
        assert!(run.status.success() && tables(&at.join("out")) == before, "{absurd}: {}", text(&run.stderr));
    }
}

/// [`SMALL`] with other settings in place of its `regularity`.
fn small_with(settings: &str) -> String {
    SMALL.replace("regularity = \"optimum\"", settings).replace("{root}", root().to_str().unwrap())
}

/// Ranks and trajectories are added to solved jobs without solving again, and equal those of a run that computes them
/// from the start.
#[test]
fn a_solved_job_is_completed_not_solved_again() {
    let folder = folder(&[("study.toml", &small_with("regularity = \"off\""))]);
    let (path, bare) = study(&folder);
    let (out, whole) = (folder.path().join("out"), folder.path().join("whole"));
    run(&bare, &options(&out), &AtomicBool::new(false)).unwrap();
    std::fs::write(&path, small_with("regularity = \"optimum\"\ntrajectories = true")).unwrap();
    let full = Study::load(&path).unwrap();
    let all = reasons(&full, &out).unwrap();
    assert!(all.iter().all(|reason| *reason == Reason::Solved), "{all:?}");
    let report =
        run_with(&full, &options(&out), &AtomicBool::new(false), &|_, _, _| panic!("nothing to solve")).unwrap();
    assert_eq!((report.finished, report.failed), (full.jobs.len(), 0));
    run(&full, &options(&whole), &AtomicBool::new(false)).unwrap();
    // The work counts differ: the ranks come from other factorisations.
    let comparable = |out: &Path| {
        let mut tables = tables(out);
        tables[0].columns.retain(|(name, _)| name != "factorisations");
        tables
    };
    assert_eq!(comparable(&out), comparable(&whole));
    // Ranks at every iteration need the iterates.
    std::fs::write(&path, small_with("")).unwrap();
    let every = Study::load(&path).unwrap();
    assert!(!reasons(&every, &out).unwrap().contains(&Reason::Solved));
}

/// A job that was solved by continuation depends on its neighbours: it is not completed, but solved.
#[test]
fn a_job_solved_by_continuation_is_not_completed() {
    let folder = folder(&[("study.toml", &small_with("regularity = \"off\""))]);
    let (path, bare) = study(&folder);
    let out = folder.path().join("out");
    run(&bare, &options(&out), &AtomicBool::new(false)).unwrap();
    let store = out.join("finished.jsonl");
    let lines = std::fs::read_to_string(&store).unwrap();
    std::fs::write(&store, with_headers(&lines, "\"retried\":false", "\"retried\":true")).unwrap();
    std::fs::write(&path, small_with("regularity = \"optimum\"")).unwrap();
    let full = Study::load(&path).unwrap();
    assert!(!reasons(&full, &out).unwrap().contains(&Reason::Solved));
}
