//! `sinew plan`: what a study would do.

use std::path::Path;

use comfy_table::{Table, presets::NOTHING};

use super::{GOOD, print};
use crate::error::Result;
use crate::study::Study;

const FIRST: usize = 20;

pub fn plan(path: &Path, all: bool) -> Result<u8> {
    let study = Study::load(path)?;
    let model = &study.model;
    print(&format!("{}: {} job(s)", study.name, study.jobs.len()));
    if !study.description.is_empty() {
        print(&study.description);
    }
    print(&format!(
        "model  {} ({} bodies, {} joints, {} muscles)",
        study.model_path.display(),
        model.bodies.len(),
        model.joints.len(),
        model.muscles.len()
    ));
    print(&format!(
        "motion {} ({} instants, {} s)",
        study.motion_path.display(),
        study.motion.time.len(),
        study.motion.duration()
    ));
    let mut table = Table::new();
    table.load_preset(NOTHING);
    let axes = study.axes.iter().map(String::as_str);
    table.set_header(["job", "id"].into_iter().chain(axes).chain(["points"]));
    let shown = if all { study.jobs.len() } else { FIRST };
    for job in study.jobs.iter().take(shown) {
        let swept = job.swept.iter().map(|(_, value)| value.to_string());
        table.add_row([job.index.to_string(), job.id.clone()].into_iter().chain(swept).chain([job.points.to_string()]));
    }
    print(&table.trim_fmt());
    if study.jobs.len() > shown {
        print(&format!("… and {} more (--all lists them)", study.jobs.len() - shown));
    }
    Ok(GOOD)
}
