//! `sinew report`: writes a results folder as one HTML page, and its figures as SVG files.

use std::io::Read;
use std::path::{Path, PathBuf};

use super::{GOOD, print};
use crate::error::{Error, Result};
use crate::files::write_atomically;
use crate::names::counted;
use crate::report::Report;

/// Folder of the figures, beside the page.
const FIGURES: &str = "figures";

/// Refuses to overwrite a file that is not a report of Sinew.
fn is_replaceable(out: &Path) -> Result<()> {
    let mut begin = Vec::new();
    // A pipe or a device contains no page, and reading it would block.
    if out.is_file() {
        let read = std::fs::File::open(out).and_then(|file| file.take(4096).read_to_end(&mut begin));
        read.map_err(|e| Error::io("read", out, e))?;
    }
    let is_own = |mark: &[u8]| begin.windows(mark.len()).any(|window| window == mark);
    if begin.is_empty() || is_own(b"content=\"Sinew\"") || is_own(b" \xe2\x80\x93 Sinew</title>") {
        return Ok(());
    }
    Err(Error::table("overwrite", out, "it is not a report of Sinew; choose another --out, or move it away"))
}

pub fn report(dir: &Path, baseline: Option<&Path>, out: Option<PathBuf>, svg: bool, job: Option<u64>) -> Result<u8> {
    let report = Report::read(dir, baseline)?;
    let out = out.unwrap_or_else(|| dir.join("report.html"));
    is_replaceable(&out)?;
    let page = report.page()?;
    write_atomically(&out, &page)?;
    print(&format!("{} ({:.1} MB)", out.display(), page.len() as f64 / 1e6));
    if svg {
        let folder = out.with_file_name(FIGURES);
        let figures = report.figures(job)?;
        std::fs::create_dir_all(&folder).map_err(|e| Error::io("create", &folder, e))?;
        for (name, figure) in &figures {
            write_atomically(&folder.join(name), figure)?;
        }
        print(&format!("{} ({})", folder.display(), counted(figures.len(), "figure")));
    }
    Ok(GOOD)
}
