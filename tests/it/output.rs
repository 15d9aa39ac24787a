//! Printing neither fails nor delays a run, even with real pipes, a full device, and signals.

use std::fs::OpenOptions;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use super::cli::text;
use super::support::folder;

/// Jobs that all fail immediately, each with a message.
const FAILING: &str = r#"
name = "failing"
model = "{root}/data/models/arm.toml"
motion = "{root}/data/motions/arm_curl.csv"
[base]
h = 0.5
stages = 1
regularity = "off"
max_iterations = 1
[sweep.grid]
mu = { from = 0.05, to = 0.5, count = 300 }
"#;

/// A few seconds of work.
const LONG: &str = r#"
name = "long"
model = "{root}/data/models/arm.toml"
motion = "{root}/data/motions/arm_curl.csv"
[base]
h = 0.02
stages = 1
[sweep.grid]
mu = { from = 0.05, to = 0.5, count = 100 }
"#;

fn command(at: &Path, out: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_sinew"));
    command.args(["run", "study.toml", "--out", out]).current_dir(at).stdout(Stdio::null()).stderr(Stdio::null());
    command
}

/// The exit code of a process that must end within a minute.
fn end(mut child: Child) -> Option<i32> {
    let begun = Instant::now();
    loop {
        if let Some(status) = child.try_wait().unwrap() {
            return status.code();
        }
        if begun.elapsed() > Duration::from_secs(60) {
            child.kill().unwrap();
            panic!("it does not end");
        }
        std::thread::sleep(Duration::from_millis(10));
    }
}

fn kept(at: &Path, out: &str) -> usize {
    std::fs::read_to_string(at.join(out).join("finished.jsonl")).map_or(0, |text| text.lines().count())
}

#[test]
fn a_reader_that_goes_away_loses_nothing() {
    let folder = folder(&[("study.toml", FAILING)]);
    let at = folder.path();
    let mut child = command(at, "head").stderr(Stdio::piped()).spawn().unwrap();
    let mut first = String::new();
    BufReader::new(child.stderr.take().unwrap()).read_line(&mut first).unwrap(); // and the pipe is closed
    assert!(first.contains("iteration_limit"), "{first}");
    assert_eq!((end(child), kept(at, "head")), (Some(1), 300));
    // Both output streams, as in `2>&1 | head -1`.
    let (reader, writer) = std::io::pipe().unwrap();
    let child = command(at, "both").stdout(writer.try_clone().unwrap()).stderr(writer).spawn().unwrap();
    BufReader::new(reader).read_line(&mut first).unwrap();
    assert_eq!((end(child), kept(at, "both")), (Some(1), 300));
}

#[test]
fn a_full_device_loses_nothing() {
    let Ok(full) = OpenOptions::new().write(true).open("/dev/full") else {
        eprintln!("SKIPPED: there is no /dev/full here");
        return;
    };
    let folder = folder(&[("study.toml", FAILING)]);
    let at = folder.path();
    let child = command(at, "stderr").stderr(full.try_clone().unwrap()).spawn().unwrap();
    assert_eq!((end(child), kept(at, "stderr")), (Some(1), 300));
    // A result that cannot be printed is an error, but what was computed is stored.
    let mut child = command(at, "stdout").stdout(full.try_clone().unwrap()).stderr(Stdio::piped()).spawn().unwrap();
    let said = std::io::read_to_string(child.stderr.take().unwrap()).unwrap();
    assert_eq!((end(child), kept(at, "stdout")), (Some(2), 300));
    assert!(said.contains("cannot write to standard output") && at.join("stdout/jobs.parquet").exists(), "{said}");
    for arguments in [&["show", "stdout"][..], &["--help"], &["schema"], &["status", "stdout"]] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_sinew"));
        command.args(arguments).current_dir(at).stdout(full.try_clone().unwrap()).stderr(full.try_clone().unwrap());
        assert_eq!(end(command.spawn().unwrap()), Some(2), "{arguments:?}");
    }
}

#[test]
fn a_pipe_that_nobody_reads_holds_up_nothing() {
    let folder = folder(&[("study.toml", FAILING)]);
    let at = folder.path();
    // A full pipe, so that a write to it blocks for ever.
    let (reader, writer) = std::io::pipe().unwrap();
    let mut filler = Command::new("sh").args(["-c", "yes"]).stdout(writer.try_clone().unwrap()).spawn().unwrap();
    std::thread::sleep(Duration::from_millis(300));
    let child = command(at, "stuck").stderr(writer).spawn().unwrap();
    assert_eq!((end(child), kept(at, "stuck")), (Some(1), 300));
    filler.kill().unwrap();
    filler.wait().unwrap();
    drop(reader);
}

#[test]
fn signals_stop_a_run_and_keep_what_is_finished() {
    let folder = folder(&[("study.toml", LONG)]);
    let at = folder.path();
    let kill = |child: &Child, signal: &str| {
        let done = Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
        assert!(done.success());
    };
    let wait_for_some = |out: &str| {
        let begun = Instant::now();
        while kept(at, out) < 2 {
            assert!(begun.elapsed() < Duration::from_secs(60), "nothing is finished");
            std::thread::sleep(Duration::from_millis(5));
        }
    };
    for signal in ["-HUP", "-TERM", "-INT"] {
        let out = signal.trim_start_matches('-');
        let child = command(at, out).spawn().unwrap();
        wait_for_some(out);
        kill(&child, signal);
        assert_eq!(end(child), Some(130), "{signal}");
        let finished = kept(at, out);
        assert!((2..100).contains(&finished), "{signal}: {finished}");
        assert!(at.join(out).join("jobs.parquet").exists(), "tables of what is finished");
    }
    // With `nohup`, closing the terminal must not matter.
    let child = Command::new("nohup")
        .args([env!("CARGO_BIN_EXE_sinew"), "run", "study.toml", "--out", "nohup"])
        .current_dir(at)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    wait_for_some("nohup");
    kill(&child, "-HUP");
    assert_eq!((end(child), kept(at, "nohup")), (Some(0), 100));
}

#[test]
fn no_name_reaches_the_terminal_as_a_command_to_it() {
    let model = std::fs::read_to_string(super::support::root().join("data/models/arm.toml")).unwrap();
    let folder = folder(&[("model.toml", &model.replace("biceps", r"\u001b[2J\u0007biceps"))]);
    let mut child = Command::new(env!("CARGO_BIN_EXE_sinew"))
        .args(["check", "model.toml"])
        .current_dir(folder.path())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut said = Vec::new();
    std::io::copy(&mut child.stderr.take().unwrap(), &mut said).unwrap();
    std::io::copy(&mut child.stdout.take().unwrap(), &mut said).unwrap();
    said.flush().unwrap();
    assert_eq!(end(child), Some(2));
    let said = text(&said);
    assert!(said.contains("␛[2J␇biceps") && !said.contains(['\u{1b}', '\u{7}']), "{said}");
}
