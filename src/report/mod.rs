//! `report.html`: shows a results folder as one self-contained page, made from the manifest and the tables alone.
//!
//! The page embeds the tables themselves (by column, gzip, base64), so every number on it equals the number in the
//! Parquet file. `page.js` draws them with the embedded Apache ECharts (`vendor/`, Apache 2.0). `figures.js` defines
//! the figures, for both the page and the SVG files.

mod data;
#[cfg(feature = "figures")]
pub mod svg;

use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD as BASE64;
use flate2::Compression;
use flate2::write::GzEncoder;
use serde_json::Value as Json;
use sha2::{Digest, Sha256};

use crate::error::{Error, Result};

const PAGE: &str = include_str!("page.html");
const STYLE: &str = include_str!("page.css");
const FIGURES: &str = include_str!("figures.js");
const SCRIPT: &str = include_str!("page.js");
const CHARTS: &str = include_str!("vendor/echarts.min.js");

/// The data of a report on a results folder.
pub struct Report<'a> {
    dir: &'a Path,
    data: Json,
}

impl<'a> Report<'a> {
    /// Reads a results folder, and the baseline to compare it with, if given.
    ///
    /// # Errors
    /// If the folder is not a results folder, or a table cannot be read.
    pub fn read(dir: &'a Path, baseline: Option<&Path>) -> Result<Self> {
        Ok(Self { dir, data: data::gather(dir, baseline)? })
    }

    /// The figures as SVG texts, by file name; see [`svg::figures`].
    ///
    /// # Errors
    /// If there is no job number `job`, or this build has no `figures` feature.
    pub fn figures(&self, job: Option<u64>) -> Result<BTreeMap<String, String>> {
        #[cfg(feature = "figures")]
        return svg::figures(self.dir, &self.data, job);
        #[cfg(not(feature = "figures"))]
        {
            let number = job.map(|job| format!(" (job {job})")).unwrap_or_default();
            let reason = format!("this build was made without the feature `figures`{number}; the page has them too");
            Err(Error::table("draw the figures of", self.dir, reason))
        }
    }

    /// The page as HTML.
    ///
    /// # Errors
    /// If the tables cannot be compressed.
    pub fn page(&self) -> Result<String> {
        let title = escape_html(self.data["study"]["name"].as_str().unwrap_or("Sinew"));
        let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
        let packed = serde_json::to_writer(&mut encoder, &self.data)
            .map_err(std::io::Error::from)
            .and_then(|()| encoder.flush())
            .and_then(|()| encoder.finish())
            .map_err(|e| Error::io("compress the tables of", self.dir, e))?;
        Ok(fill_template(&title, &BASE64.encode(packed)))
    }
}

fn fill_template(title: &str, packed: &str) -> String {
    // Only these scripts run, whatever a name contains, and nothing is fetched.
    let hashes = [CHARTS, FIGURES, SCRIPT]
        .map(|script| format!("'sha256-{}'", BASE64.encode(Sha256::digest(format!("\n{script}\n")))));
    let policy = format!(
        "default-src 'none'; script-src {}; style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'; \
         form-action 'none'",
        hashes.join(" ")
    );
    // A single pass: placeholders in inserted text are not expanded.
    let mut page = String::with_capacity(PAGE.len() + packed.len() + CHARTS.len());
    let mut rest = PAGE;
    while let Some((before, after)) = rest.split_once("{{") {
        let (name, after) = after.split_once("}}").unwrap_or((after, ""));
        page.push_str(before);
        page.push_str(match name {
            "policy" => &policy,
            "title" => title,
            "style" => STYLE,
            "charts" => CHARTS,
            "figures" => FIGURES,
            "script" => SCRIPT,
            "data" => packed,
            _ => "",
        });
        rest = after;
    }
    page.push_str(rest);
    page
}

fn escape_html(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}
