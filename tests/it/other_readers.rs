//! Opens the tables with readers other than the library that wrote them.

use std::path::Path;
use std::process::Command;
use std::sync::atomic::AtomicBool;

use sinew::internals::run::{RunOptions, run};

use super::support::{SMALL, folder, root, study};

/// Tables of [`SMALL`], and of the same study with whole numbers for μ.
fn tables(folder: &tempfile::TempDir) -> [std::path::PathBuf; 2] {
    let whole = SMALL
        .replace("mu = [0.1, 0.2, 0.4]", "mu = [1, 2]")
        .replace("bounds = [\"activation\", \"both\"]", "bounds = [\"both\"]");
    assert_ne!(whole, SMALL);
    [SMALL.to_owned(), whole].map(|text| {
        std::fs::write(folder.path().join("study.toml"), text.replace("{root}", root().to_str().unwrap())).unwrap();
        let (_, study) = study(folder);
        let out = folder.path().join(format!("out{}", study.jobs.len()));
        let options = RunOptions { out: out.clone(), threads: Some(2), ..RunOptions::default() };
        run(&study, &options, &AtomicBool::new(false)).unwrap();
        out
    })
}

/// Uses the readers installed for python3, and then the oldest pyarrow if `.ci/install` has installed it.
#[test]
fn others_filter_sort_join_and_concatenate_the_tables() {
    let folder = folder(&[("study.toml", SMALL)]);
    let tables = tables(&folder);
    let oldest = root().join("target/oldest_readers");
    for (which, path) in [("newest", None), ("oldest", Some(oldest.as_path()))] {
        let python = || {
            let mut command = Command::new("python3");
            path.map(|path: &Path| command.env("PYTHONPATH", path));
            command
        };
        let there = python().args(["-c", "import pyarrow"]).output().is_ok_and(|o| o.status.success());
        if !there || path.is_some_and(|path| !path.exists()) {
            eprintln!("SKIPPED: the {which} pyarrow is not installed (.ci/install)");
            continue;
        }
        let output = python().arg(root().join("tests/it/other_readers.py")).args(&tables).output().unwrap();
        eprint!("{}", String::from_utf8_lossy(&output.stdout));
        assert!(output.status.success(), "{which}: {}", String::from_utf8_lossy(&output.stderr));
    }
}
