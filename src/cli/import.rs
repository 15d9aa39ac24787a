//! `sinew import`: an OpenSim model as a model file.

use std::fs::OpenOptions;
use std::io::Write;
use std::path::{Path, PathBuf};

use super::{GOOD, print};
use crate::error::{Error, Result, SourceFile};
use crate::opensim::{self, Note};
use crate::skeleton::text::text;

pub fn import(model: &Path, out: Option<PathBuf>, strict: bool) -> Result<u8> {
    let source = SourceFile::read(model)?;
    let imported = opensim::import(&source)?;
    let list = listed(&imported.notes);
    let matter: Vec<Note> = imported.notes.iter().filter(|note| note.matters).cloned().collect();
    if strict && !matter.is_empty() {
        let message = format!("{}: {} thing(s) cannot be mapped:\n{}", model.display(), matter.len(), listed(&matter));
        let help = "without --strict the model is written all the same, and the list with it";
        return Err(source.error(None, message, "", Some(help.to_owned())));
    }
    let out = out.unwrap_or_else(|| PathBuf::from(model.file_stem().unwrap_or_default()).with_extension("toml"));
    let comment = comment(&source, &imported.notes);
    // Never over a file that is there.
    let mut written = OpenOptions::new().write(true).create_new(true).open(&out).map_err(|e| match e.kind() {
        std::io::ErrorKind::AlreadyExists => {
            Error::table("write", &out, "the file is there already; name another one with --out")
        }
        _ => Error::io("write", &out, e),
    })?;
    written.write_all(text(&imported.file, &comment).as_bytes()).map_err(|e| Error::io("write", &out, e))?;
    let file = &imported.file;
    print(&format!(
        "{}: {} bodies, {} coordinates, {} muscles, {} wrapping surfaces",
        out.display(),
        file.body.len(),
        file.coordinate.len(),
        file.muscle.len(),
        file.surface.len()
    ));
    if !imported.notes.is_empty() {
        print(&format!("Not mapped, and what it means:\n{list}"));
    }
    Ok(GOOD)
}

/// A line a note.
pub fn listed(notes: &[Note]) -> String {
    notes.iter().map(|note| format!("  {}: {}\n", note.what, note.lost)).collect::<String>().trim_end().to_owned()
}

fn comment(source: &SourceFile, notes: &[Note]) -> String {
    let mut comment = format!(
        "Imported from {} by sinew {}. m, kg, N, rad; frames as in OpenSim (x forward, y up, z right).\n",
        source.path.file_name().unwrap_or_default().to_string_lossy(),
        env!("CARGO_PKG_VERSION"),
    );
    if !notes.is_empty() {
        comment.push_str(&format!("\nNot mapped, and what it means:\n{}\n", listed(notes)));
    }
    comment
}
