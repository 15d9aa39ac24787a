//! Makes tables from the finished jobs on disk, after a run and when shards are merged. This is done in parts, so that
//! the memory needed does not grow with the study.

use std::collections::BTreeMap;
use std::path::Path;

use super::folder::{FolderLock, check_ownership, table};
use super::manifest::{self, Manifest, file_hash};
use super::store::Store;
use crate::error::{Error, Result};
use crate::names::counted;
use crate::outcome::{Outcome, Status};
use crate::study::{Job, Study};
use crate::tables::Writer;
use crate::tables::schema::{self, Columns, ON_REQUEST, TABLES};
use crate::terminal::note;

/// Number of jobs held in memory at a time. They make one row group of each table.
const PART: usize = 4096;

/// How much of its study a folder contains.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Collected {
    pub jobs: usize,
    /// Finished jobs by status.
    pub counts: BTreeMap<Status, usize>,
}

impl Collected {
    pub fn finished(&self) -> usize {
        self.counts.values().sum()
    }

    pub fn failed(&self) -> usize {
        self.finished() - self.counts.get(&Status::Converged).copied().unwrap_or(0)
    }

    pub fn count(study: &Study, store: &Store) -> Self {
        let mut counts = BTreeMap::new();
        study.jobs.iter().filter_map(|job| store.get(&job.id)).for_each(|h| *counts.entry(h.status).or_default() += 1);
        Self { jobs: study.jobs.len(), counts }
    }
}

/// Writes all tables and the manifest from the finished jobs, in the order of the study.
pub fn write_tables(study: &Study, store: &mut Store, folder: &Path) -> Result<Collected> {
    // One writer at a time: a merge may coincide with another one, or with the end of a run.
    let _hold = FolderLock::take(folder)?;
    let columns = Columns::of(study);
    let file = |name: &str| table(folder, name);
    let provenance = manifest::provenance(study);
    let metadata = |table: &crate::tables::Table| {
        let units = table.columns.iter().map(|(name, _)| (name.clone(), schema::unit(table.name, name)));
        let units = units.filter(|(_, unit)| !unit.is_empty()).map(|(name, unit)| (name, unit.into()));
        let units = serde_json::Value::Object(units.collect());
        let mut metadata = provenance.clone();
        metadata.push(("sinew.units".to_owned(), units.to_string()));
        metadata
    };
    let empty = columns.tables(&[]);
    let mut writers: Vec<Writer> = empty.iter().map(|table| Writer::new(&file(table.name), metadata(table))).collect();
    let finished: Vec<&Job> = study.jobs.iter().filter(|job| store.get(&job.id).is_some()).collect();
    let parts: Vec<&[&Job]> = if finished.is_empty() { vec![&[]] } else { finished.chunks(PART).collect() };
    for part in parts {
        let mut outcomes: Vec<(&Job, Outcome)> = Vec::with_capacity(part.len());
        for job in part {
            // No table has the solution itself.
            let outcome = store.outcome(&job.id)?.map(|outcome| Outcome { solution: None, ..outcome });
            outcomes.extend(outcome.map(|outcome| (*job, outcome)));
        }
        let rows: Vec<(&Job, &Outcome)> = outcomes.iter().map(|(job, outcome)| (*job, outcome)).collect();
        for (table, writer) in columns.tables(&rows).iter().zip(&mut writers) {
            writer.append(table)?;
        }
    }
    let mut manifest = Manifest::of(study);
    for (name, writer) in TABLES.iter().zip(writers) {
        if writer.finish()? == 0 && ON_REQUEST.contains(name) {
            let path = file(name);
            std::fs::remove_file(&path).map_err(|e| Error::io("remove", &path, e))?;
            continue;
        }
        manifest.files.insert(format!("{name}.parquet"), file_hash(&file(name))?);
    }
    let collected = Collected::count(study, store);
    manifest.finished = collected.finished();
    manifest.write(folder)?;
    Ok(collected)
}

/// Makes the tables of a folder from all jobs that its shards have finished. May be repeated at any time.
///
/// # Errors
/// If the folder contains no plan, or its finished jobs cannot be read.
pub fn merge(folder: &Path) -> Result<(Study, Collected)> {
    let study = planned(folder)?;
    check_ownership(folder)?;
    let mut store = Store::read(folder)?;
    if !store.has_files() {
        let reason = "it contains no finished jobs (there is no finished….jsonl)";
        return Err(Error::table("merge", folder, reason));
    }
    if store.damaged > 0 {
        note(&format!("note: skipped {} in {}", counted(store.damaged, "damaged line"), folder.display()));
    }
    let collected = write_tables(&study, &mut store, folder)?;
    Ok((study, collected))
}

/// The study that a results folder was made for.
pub fn planned(folder: &Path) -> Result<Study> {
    if !folder.join(manifest::FILE).exists() {
        let reason =
            "it contains no manifest.json, so it is not a results folder; `sinew run STUDY --out DIR` creates one";
        return Err(Error::table("open", folder, reason));
    }
    Study::load(folder)
}
