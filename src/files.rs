//! Writing of files, atomically or only where there is none; paths as text.

use std::io::Write;
use std::path::Path;

use crate::error::{Error, Result};

/// Writes a file atomically: it appears under its name only once all of it is on disk. Symbolic links are followed. A
/// target that is not a regular file, such as a pipe, is written directly.
///
/// # Errors
/// If the file cannot be written.
pub fn write_atomically(path: &Path, bytes: impl AsRef<[u8]>) -> Result<()> {
    let failed = |e| Error::io("write", path, e);
    let target = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    if target.metadata().is_ok_and(|there| !there.is_file()) {
        return std::fs::write(&target, bytes).map_err(failed);
    }
    let partial = partial(&target);
    let written = std::fs::File::create(&partial)
        .and_then(|mut file| file.write_all(bytes.as_ref()).and_then(|()| file.sync_all()))
        .and_then(|()| std::fs::rename(&partial, &target));
    written.map_err(|e| {
        let _ = std::fs::remove_file(&partial);
        failed(e)
    })
}

/// Writes a file that does not exist yet; `exists` says what to do if it does.
///
/// # Errors
/// If the file exists or cannot be written.
pub fn write_new(path: &Path, text: &str, exists: &str) -> Result<()> {
    let created = std::fs::OpenOptions::new().write(true).create_new(true).open(path);
    let mut file = created.map_err(|e| match e.kind() {
        std::io::ErrorKind::AlreadyExists => Error::table("write", path, exists),
        _ => Error::io("write", path, e),
    })?;
    file.write_all(text.as_bytes()).map_err(|e| Error::io("write", path, e))
}

/// The temporary name of a file while this process writes it.
pub fn partial(path: &Path) -> std::path::PathBuf {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(format!(".{}.part", std::process::id()));
    path.with_file_name(name)
}
