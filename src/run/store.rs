//! Finished jobs on disk, one JSON line each, appended and flushed as they finish.

use std::collections::HashMap;
use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::outcome::Outcome;
use crate::study::Study;

const FILE: &str = "finished.jsonl";

#[derive(Serialize, Deserialize)]
struct Line {
    job_id: String,
    version: String,
    outcome: Outcome,
}

pub struct Store {
    path: PathBuf,
    file: File,
    outcomes: HashMap<String, (String, Outcome)>,
}

impl Store {
    /// Opens the store of a results folder. Lines that cannot be read are passed over; a last one that was cut off (by a
    /// kill, by a full disk) is removed.
    pub fn open(folder: &Path, fresh: bool) -> Result<Self> {
        let path = folder.join(FILE);
        let mut file = OpenOptions::new()
            .create(true)
            .read(true)
            .write(true)
            .truncate(false)
            .open(&path)
            .map_err(|e| Error::io("open", &path, e))?;
        if file.try_lock().is_err() {
            let busy =
                std::io::Error::other("another run is at work in this folder; wait for it, or choose another --out");
            return Err(Error::io("open", &path, busy));
        }
        if fresh {
            file.set_len(0).map_err(|e| Error::io("empty", &path, e))?;
        }
        let mut text = Vec::new();
        file.read_to_end(&mut text).map_err(|e| Error::io("read", &path, e))?;
        let mut outcomes = HashMap::new();
        let (mut whole, mut damaged) = (0, 0);
        for line in text.split_inclusive(|&byte| byte == b'\n') {
            match serde_json::from_slice::<Line>(line) {
                Ok(read) if line.ends_with(b"\n") => {
                    outcomes.insert(read.job_id, (read.version, read.outcome));
                }
                _ => damaged += 1,
            }
            if line.ends_with(b"\n") {
                whole += line.len();
            }
        }
        if damaged > 0 {
            eprintln!("note: {} holds {damaged} damaged line(s): those jobs run again", path.display());
            // A last line that was cut off would spoil the next one.
            file.set_len(whole as u64).map_err(|e| Error::io("mend", &path, e))?;
        }
        file.seek(SeekFrom::Start(whole as u64)).map_err(|e| Error::io("open", &path, e))?;
        Ok(Self { path, file, outcomes })
    }

    pub fn get(&self, job_id: &str) -> Option<&Outcome> {
        self.outcomes.get(job_id).map(|(_, outcome)| outcome)
    }

    /// Writes a finished job to disk before it counts as finished.
    pub fn add(&mut self, job_id: &str, outcome: Outcome) -> Result<()> {
        let version = env!("CARGO_PKG_VERSION").to_owned();
        let line = Line { job_id: job_id.to_owned(), version: version.clone(), outcome };
        let mut text = serde_json::to_vec(&line).map_err(|e| Error::io("write", &self.path, e.into()))?;
        text.push(b'\n');
        self.file.write_all(&text).and_then(|()| self.file.flush()).map_err(|e| Error::io("write", &self.path, e))?;
        self.outcomes.insert(line.job_id, (version, line.outcome));
        Ok(())
    }

    /// A sentence if results of this study come from another version of the program.
    pub fn version_note(&self, study: &Study) -> Option<String> {
        let here = env!("CARGO_PKG_VERSION");
        let mut versions: Vec<&str> = study
            .jobs
            .iter()
            .filter_map(|job| self.outcomes.get(&job.id))
            .map(|(version, _)| version.as_str())
            .filter(|version| *version != here)
            .collect();
        let count = versions.len();
        versions.sort_unstable();
        versions.dedup();
        (count > 0).then(|| {
            format!(
                "{count} kept result(s) were computed by sinew {}; run with --fresh to renew them",
                versions.join(", ")
            )
        })
    }
}
