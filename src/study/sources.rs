//! The source texts of a study, read from files or from the manifest of a run.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::file::StudyFile;
use super::loads::LoadSources;
use crate::error::{Error, Result, SourceFile};

/// Study, model, motion and loads as they were read.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Sources {
    pub study: SourceFile,
    pub model: SourceFile,
    pub motion: SourceFile,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub loads: Option<LoadSources>,
}

/// The part of `manifest.json` from which a study can be made again.
#[derive(Deserialize)]
struct StoredSources {
    sources: Sources,
}

impl Sources {
    /// Reads a study file and the files it names, or the manifest of a results folder (or the folder).
    ///
    /// # Errors
    /// If a file cannot be read or parsed, with the place.
    pub fn read(path: &Path) -> Result<(Self, StudyFile)> {
        let manifest = if path.is_dir() { path.join("manifest.json") } else { path.to_owned() };
        if manifest.extension().is_some_and(|e| e == "json") {
            let file = SourceFile::read(&manifest)?;
            let stored: StoredSources = serde_json::from_str(&file.text).map_err(|e| {
                let help = "give a study (.toml), or the manifest.json of a results folder";
                file.error(
                    file.line_span(e.line()),
                    format!("this is not a manifest of Sinew: {e}"),
                    "here",
                    Some(help.into()),
                )
            })?;
            let study = parse(&stored.sources.study)?;
            return Ok((stored.sources, study));
        }
        let file = SourceFile::read(path)?;
        let study = parse(&file)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let model = named(&file, "model", &folder.join(&study.model))?;
        let motion = named(&file, "motion", &folder.join(&study.motion))?;
        let loads = study.loads.as_ref().map(|loads| {
            let path = folder.join(loads);
            // So that a missing file is shown in the study.
            named(&file, "loads", &path)?;
            LoadSources::read(&path)
        });
        Ok((Self { study: file, model, motion, loads: loads.transpose()? }, study))
    }
}

/// Parses the text of a study file.
///
/// # Errors
/// If it is not valid TOML, or has keys or types that a study does not have.
pub fn parse(file: &SourceFile) -> Result<StudyFile> {
    file.toml()
}

/// Reads a file that a study names. If it does not exist, the error points at the key.
fn named(study: &SourceFile, key: &str, path: &Path) -> Result<SourceFile> {
    SourceFile::read(path).map_err(|error| match &error {
        Error::Io { cause, .. } if cause.kind() == std::io::ErrorKind::NotFound => {
            let help = miette::Diagnostic::help(&error).map(|h| h.to_string());
            study.error(
                study.toml_span(&[key.to_owned()]),
                format!("the {key} file {} does not exist", path.display()),
                "named here, relative to the study file",
                help,
            )
        }
        _ => error,
    })
}
