//! The tables opened by another reader than the one that wrote them.

use std::process::Command;
use std::sync::atomic::AtomicBool;

use sinew::run::{RunOptions, run};

use super::support::{SMALL, folder, study};

const SCRIPT: &str = r#"
import sys, math
import pyarrow.parquet as pq
folder = sys.argv[1]
jobs = pq.read_table(folder + "/jobs.parquet").to_pydict()
assert len(jobs["job_id"]) == 6 and jobs["status"] == ["converged"] * 6, jobs["status"]
assert jobs["mu"] == [0.1, 0.1, 0.2, 0.2, 0.4, 0.4], jobs["mu"]
assert jobs["bounds"][:2] == ["activation", "both"]
assert jobs["error"] == [None] * 6
assert all(math.isfinite(v) for v in jobs["objective"])
muscles = pq.read_table(folder + "/muscles.parquet").to_pydict()
assert len(muscles["muscle"]) == 30 and set(map(type, muscles["idle"])) == {bool}
metadata = pq.read_metadata(folder + "/jobs.parquet").metadata
assert metadata[b"sinew.schema_version"] == b"3" and b"mu" in metadata[b"sinew.units"], metadata
column = pq.ParquetFile(folder + "/jobs.parquet").metadata.row_group(0).column(0)
assert column.compression == "ZSTD", column.compression
print("read back by pyarrow")
"#;

#[test]
fn pyarrow_reads_the_tables() {
    let there = Command::new("python3").args(["-c", "import pyarrow"]).output().is_ok_and(|o| o.status.success());
    if !there {
        eprintln!("SKIPPED: pyarrow_reads_the_tables: python3 with pyarrow is not installed (pip install pyarrow)");
        return;
    }
    let folder = folder(&[("study.toml", SMALL)]);
    let (_, study) = study(&folder);
    let out = folder.path().join("out");
    run(&study, &RunOptions { out: out.clone(), threads: Some(2), ..RunOptions::default() }, &AtomicBool::new(false))
        .unwrap();
    let output = Command::new("python3").args(["-c", SCRIPT]).arg(&out).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}
