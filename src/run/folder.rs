//! A results folder: which of its files are Sinew's own and may be overwritten or deleted. Nothing else is touched.

use std::fs::{File, OpenOptions};
use std::path::{Path, PathBuf};

use super::manifest::{self, Manifest};
use super::store::Store;
use crate::error::{Error, Result};
use crate::tables::{self, schema};

/// Lock file, held while tables and manifest are written.
const LOCK: &str = ".tables.lock";

/// The path of a table.
pub fn table(folder: &Path, name: &str) -> PathBuf {
    folder.join(format!("{name}.parquet"))
}

/// Checks the files that a run would overwrite, and returns the existing manifest.
///
/// # Errors
/// If a file with one of Sinew's names was not written by Sinew, or is a link.
pub fn check_ownership(folder: &Path) -> Result<Option<Manifest>> {
    let refuse = |path: &Path, reason: &str| {
        let help = "choose another --out, or move it away";
        Err(Error::table("write over", path, format!("{reason}; {help}")))
    };
    let tables: Vec<PathBuf> = schema::TABLES.iter().map(|name| table(folder, name)).collect();
    let finished = Store::paths(folder)?;
    for path in tables.iter().chain(&finished).chain(&[folder.join(manifest::FILE), folder.join(LOCK)]) {
        match path.symlink_metadata() {
            Ok(there) if there.is_symlink() => return refuse(path, "it is a symbolic link"),
            Ok(there) if !there.is_file() => return refuse(path, "it is not a regular file"),
            _ => {}
        }
    }
    let manifest = match Manifest::read(folder) {
        Ok(manifest) => manifest,
        Err(error) => {
            let reason = format!("it is not a manifest of this version ({error})");
            return refuse(&folder.join(manifest::FILE), &reason);
        }
    };
    if let Some(path) = tables.iter().find(|path| path.exists() && !tables::is_of_study(path)) {
        return refuse(path, "it was not written by Sinew");
    }
    if let (None, Some(path)) = (&manifest, finished.iter().find(|path| !Store::is_own(path))) {
        return refuse(path, "it was not written by Sinew");
    }
    Ok(manifest)
}

/// A lock on a folder's tables and manifest, released when dropped.
pub struct FolderLock {
    _lock: File,
}

impl FolderLock {
    /// Waits for the lock, and removes the partial files that dead processes have left behind.
    ///
    /// # Errors
    /// If the folder cannot be written.
    pub fn take(folder: &Path) -> Result<Self> {
        let failed = |e| Error::io("lock", folder, e);
        let lock = OpenOptions::new().create(true).append(true).open(folder.join(LOCK)).map_err(failed)?;
        // (Without locks, files still appear whole or not at all.)
        if lock.lock().is_ok() {
            for entry in std::fs::read_dir(folder).map_err(failed)?.flatten() {
                if is_partial(&entry.file_name().to_string_lossy()) {
                    let _ = std::fs::remove_file(entry.path());
                }
            }
        }
        Ok(Self { _lock: lock })
    }
}

/// Whether a file's name is that of a partial table, manifest or report: `NAME.PID.part`.
fn is_partial(name: &str) -> bool {
    let Some((file, process)) = name.strip_suffix(".part").and_then(|name| name.rsplit_once('.')) else { return false };
    let is_known = [manifest::FILE, "report.html"].contains(&file)
        || schema::TABLES.iter().any(|table| file == format!("{table}.parquet"));
    is_known && !process.is_empty() && process.bytes().all(|b| b.is_ascii_digit())
}
