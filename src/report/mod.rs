//! `report.html`: a results folder for people to look at, one page that needs nothing else. From manifest and tables alone.
//!
//! The page holds the tables themselves (columns, gzip, base64), so that every number in it is the number in the Parquet file; `page.js` draws
//! them with Apache ECharts, which is embedded (`vendor/`, Apache 2.0).

mod data;

use std::io::Write;
use std::path::Path;

use base64::Engine;
use flate2::Compression;
use flate2::write::GzEncoder;

use crate::error::{Error, Result};

const PAGE: &str = include_str!("page.html");
const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");
const CHARTS: &str = include_str!("vendor/echarts.min.js");

/// The page of a results folder, beside a baseline's if one is given.
///
/// # Errors
/// If the folder is none of results, or a table cannot be read.
pub fn page(dir: &Path, baseline: Option<&Path>) -> Result<String> {
    let data = data::gather(dir, baseline)?;
    let title = escaped(data["study"]["name"].as_str().unwrap_or("Sinew"));
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    let packed = serde_json::to_writer(&mut encoder, &data)
        .map_err(std::io::Error::from)
        .and_then(|()| encoder.flush())
        .and_then(|()| encoder.finish())
        .map_err(|e| Error::io("pack the tables of", dir, e))?;
    let packed = base64::engine::general_purpose::STANDARD.encode(packed);
    // One pass: what is put in is not looked at again.
    let mut page = String::with_capacity(PAGE.len() + packed.len() + CHARTS.len());
    let mut rest = PAGE;
    while let Some((before, after)) = rest.split_once("{{") {
        let (name, after) = after.split_once("}}").unwrap_or((after, ""));
        page.push_str(before);
        page.push_str(match name {
            "title" => &title,
            "style" => STYLE,
            "charts" => CHARTS,
            "script" => SCRIPT,
            "data" => &packed,
            _ => "",
        });
        rest = after;
    }
    page.push_str(rest);
    Ok(page)
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}
