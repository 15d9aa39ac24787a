//! `sinew import`: converts an OpenSim model to a model file.

use std::path::{Path, PathBuf};

use super::{GOOD, note, print};
use crate::error::{Result, SourceFile};
use crate::files::write_new;
use crate::names::counted;
use crate::opensim::{self, Note, Weight};
use crate::skeleton::text::text;

pub fn import(model: &Path, paths: Option<&Path>, out: Option<PathBuf>, strict: bool) -> Result<u8> {
    let source = SourceFile::read(model)?;
    let mut imported = opensim::import(&source)?;
    if let Some(paths) = paths {
        let notes = opensim::paths::replace(&mut imported.file, &SourceFile::read(paths)?)?;
        imported.notes.extend(notes);
        imported.notes.sort_by_key(|note| note.weight);
    }
    let list = listed(&imported.notes);
    let lost = of_weight(&imported.notes, Weight::Lost);
    if strict && !lost.is_empty() {
        let message = format!("{}: {} lost:\n{}", model.display(), counted(lost.len(), "item"), listed(&lost));
        let help = "without --strict, the model is written anyway, with this list as a comment";
        return Err(source.error(None, message, "", Some(help.to_owned())));
    }
    let out = out.unwrap_or_else(|| PathBuf::from(model.file_stem().unwrap_or_default()).with_extension("toml"));
    let comment = comment(&source, &imported.notes);
    // Never overwrite a file.
    let exists = "the file already exists; choose another name with --out";
    write_new(&out, &text(&imported.file, &comment), exists)?;
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
        print(&list);
    }
    Ok(GOOD)
}

/// The notes, one per line, with a heading for each weight.
pub fn listed(notes: &[Note]) -> String {
    let mut out = String::new();
    for (weight, title) in [
        (Weight::Lost, "Lost, with an effect on results:"),
        (Weight::Changed, "Replaced:"),
        (Weight::Remark, "Without effect on results:"),
    ] {
        let mut lines = notes.iter().filter(|note| note.weight == weight).peekable();
        if lines.peek().is_some() {
            out.push_str(title);
            out.push('\n');
        }
        lines.for_each(|note| out.push_str(&format!("  {}: {}\n", note.what, note.lost)));
    }
    out.trim_end().to_owned()
}

fn of_weight(notes: &[Note], weight: Weight) -> Vec<Note> {
    notes.iter().filter(|note| note.weight == weight).cloned().collect()
}

/// Prints on standard error what is lost from an OpenSim model; nothing for other models.
pub fn say_lost(source: &SourceFile) -> Result<()> {
    if !opensim::is_osim(source) {
        return Ok(());
    }
    let notes = opensim::import(source)?.notes;
    let lost = of_weight(&notes, Weight::Lost);
    if !lost.is_empty() {
        let name = source.path.display();
        let mut message = format!("note: {name}: {}\n", listed(&lost));
        let others = notes.len() - lost.len();
        if others > 0 {
            message.push_str(&format!(
                "  and {}: `sinew check {name}` lists them\n",
                counted(others, "less important note")
            ));
        }
        note(message.trim_end());
    }
    Ok(())
}

fn comment(source: &SourceFile, notes: &[Note]) -> String {
    let mut comment = format!(
        "Imported from {} by sinew {}. m, kg, N, rad; frames as in OpenSim (x forward, y up, z right).\n",
        source.path.file_name().unwrap_or_default().to_string_lossy(),
        env!("CARGO_PKG_VERSION"),
    );
    if !notes.is_empty() {
        comment.push_str(&format!("\n{}\n", listed(notes)));
    }
    comment
}
