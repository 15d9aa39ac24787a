//! Other people's files: a run overwrites and deletes only what a run has written.

use std::path::Path;

use super::cli::{sinew, text};
use super::support::{SMALL, folder};

/// Every file in a folder and its subfolders, with its bytes.
fn everything(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(everything(&path));
        } else {
            found.push((path.display().to_string(), std::fs::read(&path).unwrap_or_default()));
        }
    }
    found.sort();
    found
}

#[test]
fn a_run_does_not_write_over_what_no_run_has_written() {
    let folder = folder(&[("study.toml", SMALL)]);
    let at = folder.path();
    for name in ["manifest.json", "jobs.parquet", "muscles.parquet", "finished.jsonl", "finished.0-of-2.jsonl"] {
        let out = at.join(format!("with-{name}"));
        std::fs::create_dir(&out).unwrap();
        std::fs::write(out.join(name), "{\"name\": \"a diary\"}\n").unwrap();
        std::fs::write(out.join("notes.txt"), "mine").unwrap();
        let before = everything(&out);
        for more in [&["run"][..], &["run", "--fresh"], &["run", "--shard", "0/2"], &["slurm"]] {
            let (command, flags) = more.split_first().unwrap();
            let arguments = [&[command, "study.toml", "--out", out.to_str().unwrap()][..], flags].concat();
            let answer = sinew(&arguments, at);
            let said = text(&answer.stderr);
            assert!(answer.status.code() == Some(2) && said.contains(name), "{arguments:?}: {said}");
            assert!(everything(&out) == before, "{arguments:?}");
        }
    }
    // A run does not touch files with other names.
    let out = at.join("notes");
    std::fs::create_dir(&out).unwrap();
    for name in ["notes.txt", "finished.txt", "finished-notes.jsonl", "jobs.parquet.bak", "x.part"] {
        std::fs::write(out.join(name), "mine").unwrap();
    }
    let before = everything(&out);
    for more in [&[][..], &["--fresh"]] {
        assert!(sinew(&[&["run", "study.toml", "--out", "notes"][..], more].concat(), at).status.success());
        let after = everything(&out);
        assert!(before.iter().all(|file| after.contains(file)));
    }
}

#[test]
fn a_run_goes_through_no_link() {
    let folder = folder(&[("study.toml", SMALL)]);
    let at = folder.path();
    for name in ["manifest.json", "jobs.parquet", "finished.jsonl", ".tables.lock"] {
        let out = at.join(format!("to-{name}"));
        std::fs::create_dir(&out).unwrap();
        let precious = at.join(format!("precious-{name}"));
        std::fs::write(&precious, "precious").unwrap();
        std::os::unix::fs::symlink(&precious, out.join(name)).unwrap();
        for more in [&[][..], &["--fresh"]] {
            let answer = sinew(&[&["run", "study.toml", "--out", out.to_str().unwrap()][..], more].concat(), at);
            assert_eq!(answer.status.code(), Some(2), "{name}: {}", text(&answer.stderr));
        }
        assert_eq!(std::fs::read_to_string(&precious).unwrap(), "precious");
    }
    // A backup by hard links is not changed.
    assert!(sinew(&["run", "study.toml", "--out", "out"], at).status.success());
    std::fs::create_dir(at.join("backup")).unwrap();
    for entry in std::fs::read_dir(at.join("out")).unwrap() {
        let path = entry.unwrap().path();
        std::fs::hard_link(&path, at.join("backup").join(path.file_name().unwrap())).unwrap();
    }
    let before = everything(&at.join("backup"));
    assert!(sinew(&["run", "study.toml", "--out", "out", "--fresh"], at).status.success());
    assert!(everything(&at.join("backup")) == before);
}

#[test]
fn what_dead_runs_leave_behind_goes() {
    let folder = folder(&[("study.toml", SMALL)]);
    let at = folder.path();
    assert!(sinew(&["run", "study.toml", "--out", "out"], at).status.success());
    let part = at.join("out/jobs.parquet.4242.part");
    std::fs::write(&part, "half").unwrap();
    assert!(sinew(&["merge", "out"], at).status.success());
    assert!(!part.exists());
}

#[test]
fn no_garbage_becomes_a_baseline() {
    let folder = folder(&[("study.toml", SMALL)]);
    let at = folder.path();
    let accept = |dir: &str, base: &str| {
        let answer = sinew(&["compare", dir, base, "--accept"], at);
        (answer.status.code(), text(&answer.stderr))
    };
    assert!(sinew(&["run", "study.toml", "--out", "out"], at).status.success());
    let table = at.join("out/jobs.parquet");
    let good = std::fs::read(&table).unwrap();
    let refused = |why: &str| {
        let (code, said) = accept("out", "base");
        assert!(code == Some(2) && said.contains(why), "{said}");
        assert!(!at.join("base/jobs.parquet").exists());
    };
    std::fs::write(&table, "garbage").unwrap();
    refused("jobs.parquet is not the file");
    std::fs::write(&table, &good).unwrap();
    let manifest = std::fs::read(at.join("out/manifest.json")).unwrap();
    std::fs::remove_file(at.join("out/manifest.json")).unwrap();
    refused("no manifest.json");
    std::fs::write(at.join("out/manifest.json"), manifest).unwrap();
    // Refuses to overwrite other people's files.
    std::fs::create_dir(at.join("theirs")).unwrap();
    std::fs::write(at.join("theirs/jobs.parquet"), "theirs").unwrap();
    let (code, _) = accept("out", "theirs");
    assert_eq!(code, Some(2));
    assert_eq!(std::fs::read_to_string(at.join("theirs/jobs.parquet")).unwrap(), "theirs");
    assert_eq!(accept("out", "base"), (Some(0), String::new()));
    // An incomplete study.
    assert_eq!(sinew(&["run", "study.toml", "--out", "half", "--shard", "0/2"], at).status.code(), Some(0));
    sinew(&["merge", "half"], at);
    let (code, said) = accept("half", "base");
    assert!(code == Some(2) && said.contains("run the study to its end"), "{said}");
}

#[test]
fn a_page_of_somebody_else_stays() {
    let folder = folder(&[("study.toml", SMALL)]);
    let at = folder.path();
    assert!(sinew(&["run", "study.toml", "--out", "out"], at).status.success());
    std::fs::write(at.join("home.html"), "<html><title>My page</title></html>").unwrap();
    let answer = sinew(&["report", "out", "--out", "home.html"], at);
    assert_eq!(answer.status.code(), Some(2), "{}", text(&answer.stderr));
    // Writes into a pipe, which must not be read first.
    let piped = std::process::Command::new("timeout")
        .args(["20", "sh", "-c", "\"$0\" report out --out /dev/stdout | head -c 15", env!("CARGO_BIN_EXE_sinew")])
        .current_dir(at)
        .output()
        .unwrap();
    assert!(piped.status.success() && text(&piped.stdout) == "<!DOCTYPE html>", "{}", text(&piped.stdout));
    for _ in 0..2 {
        assert!(sinew(&["report", "out"], at).status.success(), "one's own is written again");
    }
}

#[test]
fn paths_need_not_be_utf_8() {
    use std::os::unix::ffi::OsStrExt;
    let folder = folder(&[("study.toml", SMALL)]);
    let at = folder.path();
    let odd = at.join(std::ffi::OsStr::from_bytes(b"caf\xe9 \xff"));
    std::fs::create_dir(&odd).unwrap();
    std::fs::copy(at.join("study.toml"), odd.join("study.toml")).unwrap();
    let command = |arguments: &[&std::ffi::OsStr]| {
        let answer = std::process::Command::new(env!("CARGO_BIN_EXE_sinew")).args(arguments).current_dir(at).output();
        let answer = answer.unwrap();
        assert!(!text(&answer.stderr).contains("panicked"), "{}", text(&answer.stderr));
        answer.status.code()
    };
    let word = std::ffi::OsStr::new;
    let (study, out) = (odd.join("study.toml"), odd.join("out"));
    let [study, out] = [study.as_os_str(), out.as_os_str()];
    assert_eq!(command(&[word("run"), study, word("--out"), out]), Some(0));
    for name in ["show", "status", "merge", "report"] {
        assert_eq!(command(&[word(name), out]), Some(0), "{name}");
    }
    assert_eq!(command(&[word("run"), out, word("--out"), word("again")]), Some(0), "from its manifest");
    assert_eq!(command(&[word("slurm"), study, word("--out"), out]), Some(2), "a script cannot name it");
}

#[test]
fn what_goes_into_scripts_of_slurm_is_one_line() {
    let folder = folder(&[("study.toml", SMALL)]);
    let at = folder.path();
    let evil = "x\n#SBATCH --wrap=evil";
    for arguments in [["--out", evil], ["--time", evil], ["--sbatch", evil], ["--out", "a\"b"]] {
        let answer = sinew(&[&["slurm", "study.toml"][..], &arguments].concat(), at);
        assert_eq!(answer.status.code(), Some(2), "{arguments:?}");
    }
    assert!(everything(at).iter().all(|(path, _)| !path.contains("slurm")), "nothing is written");
    assert!(sinew(&["slurm", "study.toml", "--out", "100% it's"], at).status.success());
    let script = std::fs::read_to_string(at.join("100% it's/slurm/array.sh")).unwrap();
    assert!(script.contains("/100%% it's/slurm/log/") && script.contains(r"100% it'\''s"), "{script}");
}
