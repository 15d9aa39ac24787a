//! Files of external loads, and the tables that they name.

use std::ops::Range;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::error::{Result, SourceFile};
use crate::motion::external_loads::{ExternalLoads, LoadEntry, LoadsFile};
use crate::opensim;
use crate::skeleton::Skeleton;

/// A file of external loads, and the table with their columns.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct LoadSources {
    pub file: SourceFile,
    pub table: SourceFile,
}

/// What a file of loads says.
struct Said {
    entries: Vec<(LoadEntry, Range<usize>)>,
    table: (String, Range<usize>),
    off: Vec<String>,
}

impl LoadSources {
    /// Reads OpenSim's `.xml`, or our own `.toml`, and the table that it names.
    ///
    /// # Errors
    /// If a file is missing or not readable.
    pub fn read(path: &Path) -> Result<Self> {
        let file = SourceFile::read(path)?;
        let (name, place) = said(&file)?.table;
        let beside = path.parent().unwrap_or(Path::new(".")).join(&name);
        if !beside.exists() {
            let help = format!("the path is relative to {}", path.display());
            return Err(file.error(Some(place), format!("there is no file {}", beside.display()), "here", Some(help)));
        }
        let table = SourceFile::read(&beside)?;
        Ok(Self { file, table })
    }

    /// The loads on the bodies of a model, and the names of those that the file turns off.
    ///
    /// # Errors
    /// If a body or a column is missing, or a number is not finite.
    pub fn loads(&self, skeleton: &Skeleton, smoothing_hz: f64) -> Result<(ExternalLoads, Vec<String>)> {
        let Said { entries, off, .. } = said(&self.file)?;
        Ok((ExternalLoads::new(&self.file, &entries, &self.table, skeleton, smoothing_hz)?, off))
    }
}

fn said(file: &SourceFile) -> Result<Said> {
    let ending = file.path.extension().and_then(|ending| ending.to_str()).unwrap_or_default().to_ascii_lowercase();
    match ending.as_str() {
        "xml" => {
            let loads = opensim::external_loads::external_loads(file)?;
            Ok(Said { entries: loads.entries, table: loads.table, off: loads.off })
        }
        "toml" => {
            let loads: LoadsFile = toml::from_str(&file.text).map_err(|e| file.toml_error(&e))?;
            let entries = loads.external_load.into_iter().map(|entry| (entry.get_ref().clone(), entry.span()));
            let table = (loads.table.get_ref().clone(), loads.table.span());
            Ok(Said { entries: entries.collect(), table, off: Vec::new() })
        }
        _ => {
            let message = format!("{}: loads are an ExternalLoads file (.xml) or a .toml", file.path.display());
            let help = "a table of forces is named in such a file, which says what acts where: see \
                        `sinew inverse-dynamics --help`";
            Err(file.error(None, message, "", Some(help.to_owned())))
        }
    }
}
