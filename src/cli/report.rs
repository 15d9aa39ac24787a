//! `sinew report`: a results folder as one page.

use std::path::{Path, PathBuf};

use super::{GOOD, print};
use crate::error::{Error, Result};

pub fn report(dir: &Path, baseline: Option<&Path>, out: Option<PathBuf>) -> Result<u8> {
    let page = crate::report::page(dir, baseline)?;
    let out = out.unwrap_or_else(|| dir.join("report.html"));
    std::fs::write(&out, &page).map_err(|e| Error::io("write", &out, e))?;
    print(&format!("{} ({:.1} MB)", out.display(), page.len() as f64 / 1e6));
    Ok(GOOD)
}
