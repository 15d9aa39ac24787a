//! `manifest.json`: the plan, written before the first job starts, with the source texts it was made from; versions and
//! host; and, at the end of a run, the hash of each table. It suffices to run the study again (`sinew run
//! manifest.json`).

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json};

use crate::SOLVER;
use crate::error::as_text;
use crate::error::{Error, Result};
use crate::files::write_atomically;
use crate::settings::Value;
use crate::study::sources::Sources;
use crate::study::{Job, Study};
use crate::tables::{STUDY, schema};

pub const FILE: &str = "manifest.json";

#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Manifest {
    pub sinew: Versions,
    pub study: StudyPart,
    pub host: Host,
    /// Jobs with a result when this was written.
    pub finished: usize,
    /// Hash of each table, by file name.
    pub files: BTreeMap<String, String>,
    pub sources: Sources,
    /// Names of the swept axes.
    pub axes: Vec<String>,
    /// Settings of a job, except those that it overrides.
    pub base: Map<String, Json>,
    pub jobs: Vec<PlannedJob>,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Versions {
    pub version: String,
    pub solver: String,
    pub schema_version: u32,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct StudyPart {
    pub name: String,
    pub description: String,
    #[serde(serialize_with = "as_text")]
    pub file: PathBuf,
    /// Hash of all job ids in their order.
    pub hash: String,
    pub model: FilePart,
    pub motion: FilePart,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct FilePart {
    #[serde(serialize_with = "as_text")]
    pub file: PathBuf,
    pub hash: String,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Host {
    pub name: Option<String>,
    pub os: String,
    pub arch: String,
    pub threads: Option<usize>,
}

/// A job of the plan.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct PlannedJob {
    pub job_id: String,
    pub index: usize,
    /// Swept values in the order of the axes.
    pub swept: Vec<Option<Value>>,
    /// Settings that differ from the base.
    pub settings: Map<String, Json>,
    /// Changed numbers of the model, by path.
    pub model_changes: BTreeMap<String, Value>,
    pub points: usize,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub warm_start_from: Option<String>,
}

/// The settings as a JSON object.
pub fn fields(settings: &crate::settings::Settings) -> Map<String, Json> {
    match serde_json::to_value(settings) {
        // Defaults that are no part of a job's identity are left out there, but not here.
        Ok(Json::Object(mut map)) => {
            for name in crate::settings::NAMES {
                let value = settings.get(name).map(|value| serde_json::to_value(value).expect("plain data"));
                if let Some(value) = value.filter(|_| !map.contains_key(*name)) {
                    map.insert((*name).to_owned(), value);
                }
            }
            map.entry("reserves_at").or_insert_with(|| Json::Array(Vec::new()));
            map
        }
        _ => unreachable!("settings are a struct"),
    }
}

fn planned(job: &Job, base: &Map<String, Json>) -> PlannedJob {
    let mut settings = fields(&job.settings);
    settings.retain(|key, value| base.get(key) != Some(value));
    PlannedJob {
        job_id: job.id.clone(),
        index: job.index,
        swept: job.swept.clone(),
        settings,
        model_changes: job.changes.iter().map(|change| (change.path.clone(), change.value.clone())).collect(),
        points: job.points,
        warm_start_from: job.warm_start_from.clone(),
    }
}

impl Manifest {
    /// The manifest of a study before anything is solved.
    pub fn of(study: &Study) -> Self {
        let base = fields(&study.base);
        Self {
            sinew: Versions {
                version: env!("CARGO_PKG_VERSION").to_owned(),
                solver: SOLVER.to_owned(),
                schema_version: schema::VERSION,
            },
            study: StudyPart {
                name: study.name.clone(),
                description: study.description.clone(),
                file: study.sources.study.path.clone(),
                hash: study.hash(),
                model: FilePart { file: study.sources.model.path.clone(), hash: study.model_hash.clone() },
                motion: FilePart { file: study.sources.motion.path.clone(), hash: study.motion_hash.clone() },
            },
            host: Host {
                name: std::fs::read_to_string("/etc/hostname").map(|n| n.trim().to_owned()).ok(),
                os: std::env::consts::OS.to_owned(),
                arch: std::env::consts::ARCH.to_owned(),
                threads: std::thread::available_parallelism().map(usize::from).ok(),
            },
            finished: 0,
            files: BTreeMap::new(),
            sources: study.sources.clone(),
            axes: study.axes.clone(),
            jobs: study.jobs.iter().map(|job| planned(job, &base)).collect(),
            base,
        }
    }

    /// Reads the manifest of a results folder; `None` if there is none.
    ///
    /// # Errors
    /// If there is one that cannot be read.
    pub fn read(folder: &Path) -> Result<Option<Self>> {
        let path = folder.join(FILE);
        let bytes = match std::fs::read(&path) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(Error::io("read", &path, error)),
        };
        serde_json::from_slice(&bytes)
            .map(Some)
            .map_err(|e| Error::table("read", &path, format!("it is damaged, or from another version ({e})")))
    }

    /// The form for a baseline, the same on every machine: no jobs (they are in the table of jobs), no host name, no
    /// folders.
    pub fn portable(mut self) -> Self {
        self.jobs.clear();
        self.host.name = None;
        let study = &mut self.study;
        let sources = &mut self.sources;
        let of_loads = sources.loads.iter_mut().flat_map(|loads| [&mut loads.file.path, &mut loads.table.path]);
        let own = [&mut sources.study.path, &mut sources.model.path, &mut sources.motion.path];
        let named = [&mut study.file, &mut study.model.file, &mut study.motion.file];
        for path in named.into_iter().chain(own).chain(of_loads) {
            *path = path.file_name().map(PathBuf::from).unwrap_or_default();
        }
        self
    }

    /// Writes the manifest, whole or not at all.
    pub fn write(&self, folder: &Path) -> Result<()> {
        write_atomically(&folder.join(FILE), serde_json::to_vec(self).expect("a manifest is plain data"))
    }

    /// Files of a folder that differ from those recorded in the manifest.
    pub fn altered_files(&self, folder: &Path) -> Vec<String> {
        let same = |(name, hash): &(&String, &String)| file_hash(&folder.join(name)).is_ok_and(|found| found == **hash);
        self.files.iter().filter(|file| !same(file)).map(|(name, _)| name.clone()).collect()
    }
}

/// Hash of a file's bytes.
pub fn file_hash(path: &Path) -> Result<String> {
    let mut hasher = blake3::Hasher::new();
    let file = std::fs::File::open(path).map_err(|e| Error::io("read", path, e))?;
    hasher.update_reader(file).map_err(|e| Error::io("read", path, e))?;
    Ok(hasher.finalize().to_hex().to_string())
}

/// Key–value metadata of every Parquet file of a study.
pub fn provenance(study: &Study) -> Vec<(String, String)> {
    vec![
        ("sinew.version".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
        ("sinew.solver".to_owned(), SOLVER.to_owned()),
        ("sinew.schema_version".to_owned(), schema::VERSION.to_string()),
        (STUDY.to_owned(), study.name.clone()),
        ("sinew.study_hash".to_owned(), study.hash()),
        ("sinew.model_hash".to_owned(), study.model_hash.clone()),
        ("sinew.motion_hash".to_owned(), study.motion_hash.clone()),
    ]
}
