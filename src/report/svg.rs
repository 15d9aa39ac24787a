//! The figures of a report as SVG files: runs the page's own `figures.js` and charting library without a browser.

use std::collections::BTreeMap;
use std::path::Path;

use rquickjs::{CatchResultExt, CaughtError, Context, Ctx, Function, Runtime};
use serde_json::Value as Json;

use super::{CHARTS, FIGURES};
use crate::error::{Error, Result};

const DRIVER: &str = include_str!("svg.js");
/// Timers do nothing: the figures are not animated.
const NO_CLOCK: &str = "globalThis.setTimeout = () => 0; globalThis.clearTimeout = () => {};";

/// The SVG texts by file name. Functions of time are those of the job with number `job`, or by default of the first
/// converged job.
///
/// # Errors
/// If no job has the number `job`.
pub fn figures(dir: &Path, report: &Json, job: Option<u64>) -> Result<BTreeMap<String, String>> {
    let draw = || -> std::result::Result<BTreeMap<String, String>, String> {
        let runtime = Runtime::new().map_err(|e| e.to_string())?;
        let context = Context::full(&runtime).map_err(|e| e.to_string())?;
        context.with(|ctx| draw_all(&ctx, report, job).catch(&ctx).map_err(|e| message(&e)))
    };
    draw().map_err(|reason| Error::table("draw the figures of", dir, &reason))
}

/// Hash of the drawing code. It changes whenever the figures may change.
pub fn drawing_code_hash() -> String {
    let mut hasher = blake3::Hasher::new();
    for script in [CHARTS, FIGURES, DRIVER] {
        hasher.update(script.as_bytes());
    }
    hasher.finalize().to_hex()[..8].to_owned()
}

/// The message of a JavaScript exception, without its stack trace.
fn message(error: &CaughtError<'_>) -> String {
    match error {
        CaughtError::Exception(thrown) => thrown.message().unwrap_or_else(|| error.to_string()),
        _ => error.to_string(),
    }
}

fn draw_all<'js>(ctx: &Ctx<'js>, report: &Json, job: Option<u64>) -> rquickjs::Result<BTreeMap<String, String>> {
    for script in [NO_CLOCK, CHARTS, FIGURES, DRIVER] {
        ctx.eval::<(), _>(script)?;
    }
    let draw: Function<'js> = ctx.eval("sinewSvg")?;
    draw.call((ctx.json_parse(report.to_string())?, drawing_code_hash(), job))
}
