//! `manifest.json`: the resolved plan, versions, host and the hash of each file.

use std::path::Path;

use serde_json::json;

use crate::error::{Error, Result};
use crate::study::Study;
use crate::tables::schema;

/// Key–value metadata of every Parquet file of a study.
pub fn provenance(study: &Study) -> Vec<(String, String)> {
    vec![
        ("sinew.version".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
        ("sinew.schema_version".to_owned(), schema::VERSION.to_string()),
        ("sinew.study".to_owned(), study.name.clone()),
        ("sinew.study_hash".to_owned(), study.hash()),
        ("sinew.model_hash".to_owned(), study.model_hash()),
    ]
}

pub fn write(study: &Study, finished: usize, files: &[(String, String)], path: &Path) -> Result<()> {
    let jobs: Vec<serde_json::Value> = study
        .jobs
        .iter()
        .map(|job| {
            json!({
                "job_id": job.id,
                "index": job.index,
                "settings": job.settings,
                "model_changes": job.changes,
                "swept": job.swept,
                "points": job.points,
            })
        })
        .collect();
    let manifest = json!({
        "sinew": { "version": env!("CARGO_PKG_VERSION"), "schema_version": schema::VERSION },
        "study": {
            "name": study.name,
            "description": study.description,
            "file": study.path,
            "hash": study.hash(),
            "model": { "file": study.model_path, "hash": study.model_hash() },
            "motion": { "file": study.motion_path, "hash": study.motion_hash() },
        },
        "host": {
            "name": std::fs::read_to_string("/etc/hostname").map(|n| n.trim().to_owned()).ok(),
            "os": std::env::consts::OS,
            "arch": std::env::consts::ARCH,
            "threads": std::thread::available_parallelism().map(usize::from).ok(),
        },
        "finished": finished,
        "files": files.iter().cloned().collect::<std::collections::BTreeMap<_, _>>(),
        "jobs": jobs,
    });
    let text = serde_json::to_string_pretty(&manifest).map_err(|e| Error::io("write", path, e.into()))?;
    let partial = path.with_extension("json.part");
    std::fs::write(&partial, text)
        .and_then(|()| std::fs::rename(&partial, path))
        .map_err(|e| Error::io("write", path, e))
}
