//! `sinew report`: a results folder as one page, and its figures as files.

use std::path::{Path, PathBuf};

use super::{GOOD, print};
use crate::error::{Error, Result};
use crate::report::Report;

/// Figures go into this folder beside the page.
const FIGURES: &str = "figures";

pub fn report(dir: &Path, baseline: Option<&Path>, out: Option<PathBuf>, svg: bool, job: Option<u64>) -> Result<u8> {
    let report = Report::read(dir, baseline)?;
    let out = out.unwrap_or_else(|| dir.join("report.html"));
    let write = |path: &Path, text: &str| std::fs::write(path, text).map_err(|e| Error::io("write", path, e));
    let page = report.page()?;
    write(&out, &page)?;
    print(&format!("{} ({:.1} MB)", out.display(), page.len() as f64 / 1e6));
    if svg {
        let folder = out.with_file_name(FIGURES);
        let figures = report.figures(job)?;
        std::fs::create_dir_all(&folder).map_err(|e| Error::io("create", &folder, e))?;
        for (name, figure) in &figures {
            write(&folder.join(name), figure)?;
        }
        print(&format!("{} ({} figures)", folder.display(), figures.len()));
    }
    Ok(GOOD)
}
