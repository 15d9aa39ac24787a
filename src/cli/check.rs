//! `sinew check`: mistakes in files, each with its place.

use std::path::Path;

use super::{BAD_INPUT, GOOD, print};
use crate::error::{Error, Result, SourceFile};
use crate::model::Model;
use crate::model::file::ModelFile;
use crate::motion::MotionTable;
use crate::opensim;
use crate::skeleton::Skeleton;
use crate::skeleton::file::SkeletonFile;
use crate::study::{Study, load_model};

pub fn check(files: &[std::path::PathBuf], model: Option<&Path>) -> Result<u8> {
    let model = match model {
        Some(path) => Some(load_model(&SourceFile::read(path)?)?.1),
        None => None,
    };
    let mut code = GOOD;
    for path in files {
        match check_one(path, model.as_ref()) {
            Ok(summary) => print(&format!("{}: {summary}", path.display())),
            Err(error) => {
                eprintln!("{:?}", miette::Report::new(error));
                code = BAD_INPUT;
            }
        }
    }
    Ok(code)
}

fn check_one(path: &Path, model: Option<&Model>) -> Result<String> {
    match path.extension().and_then(|e| e.to_str()) {
        Some("csv" | "mot" | "sto") => {
            let Some(model) = model else {
                let file = SourceFile::read(path)?;
                return Err(file.error(
                    None,
                    format!("{}: a motion can only be checked against a model", path.display()),
                    "",
                    Some("add --model MODEL.toml, or check the study that uses this motion".to_owned()),
                ));
            };
            let table = MotionTable::load(path, model)?;
            Ok(format!("motion, {} coordinate(s) at {} instants", table.columns.len(), table.time.len()))
        }
        Some("osim") => {
            let file = SourceFile::read(path)?;
            let imported = opensim::import(&file)?;
            let skeleton = imported.file.check().map_err(|issue| opensim::error(&file, &issue))?;
            let list = super::import::listed(&imported.notes);
            let list = if list.is_empty() { list } else { format!("\n{list}") };
            Ok(format!("OpenSim model, {}{list}", described(&skeleton)))
        }
        Some("toml") => {
            let file = SourceFile::read(path)?;
            let table: toml::Table = toml::from_str(&file.text).map_err(|e| file.toml_error(&e))?;
            if ["motion", "sweep", "base"].iter().any(|key| table.contains_key(*key)) {
                let study = Study::load(path)?;
                Ok(format!("study, {} job(s)", study.jobs.len()))
            } else if SkeletonFile::is_one(&table) {
                Ok(described(&SkeletonFile::load(&file)?))
            } else {
                let (_, model) = ModelFile::load(&file)?;
                Ok(format!("model, {} bodies and {} muscles", model.bodies(), model.muscles.len()))
            }
        }
        _ => Err(Error::Table {
            action: "check",
            path: path.to_owned(),
            reason:
                "a file to check is a study or model (.toml), an OpenSim model (.osim) or a motion (.csv, .mot, .sto)"
                    .to_owned(),
        }),
    }
}

fn described(model: &Skeleton) -> String {
    let (bodies, muscles) = (model.bodies.len(), model.muscles.len());
    let rigid = model.muscles.iter().filter(|muscle| muscle.rigid_tendon).map(|muscle| muscle.name.as_str());
    let rigid = rigid.collect::<Vec<_>>().join(", ");
    let rigid = if rigid.is_empty() { rigid } else { format!("; rigid tendons: {rigid}") };
    // Models that lengths can be had of are no less models.
    let study =
        model.check_study().err().map(|issue| format!("; no study: {}: {}", issue.path.join("."), issue.message));
    format!("spatial model, {bodies} bodies and {muscles} muscles{rigid}{}", study.unwrap_or_default())
}
