//! OpenSim's ExternalLoads files.

use super::document::{Element, parse};
use crate::error::{Result, SourceFile};
use crate::motion::external_loads::LoadEntry;

/// The loads of a file, each with the bytes where it stands, and the name of their data file.
pub type Loads = (Vec<(LoadEntry, Option<std::ops::Range<usize>>)>, String);

/// Reads an ExternalLoads file.
///
/// # Errors
/// If it is not one, a load names no body, or no data file is named, or several.
pub fn external_loads(file: &SourceFile) -> Result<Loads> {
    let document = parse(file)?;
    let root = Element { node: document.root_element(), file };
    let Some(set) = root.descendants("ExternalLoads").next() else {
        let help = "an OpenSim file of external loads has an <ExternalLoads> element";
        return Err(root.error("the file has no external loads", help));
    };
    let forces = set.objects(&["objects"]);
    let forces = if forces.is_empty() { set.children().collect() } else { forces };
    let mut loads = Vec::new();
    let mut tables: Vec<&str> = set.text("datafile").into_iter().filter(|name| *name != "Unassigned").collect();
    let is_common = !tables.is_empty();
    for force in forces.into_iter().filter(|force| force.tag() == "ExternalForce") {
        if !force.flag("isDisabled", false) && force.flag("appliesForce", true) {
            loads.push((entry(force)?, Some(force.node.range())));
            tables.extend(force.text("data_source_name").filter(|name| !is_common && *name != "Unassigned"));
        }
    }
    tables.dedup();
    match tables[..] {
        [table] => Ok((loads, table.to_owned())),
        [] => Err(set.error("no data file is named", "add <datafile>forces.mot</datafile>")),
        _ => {
            let help = "put the columns of all forces into one file and name it in <datafile>";
            Err(set.error(format!("several data files are named: {}", tables.join(", ")), help))
        }
    }
}

fn entry(force: Element<'_>) -> Result<LoadEntry> {
    // Version 4 may write /bodyset/calcn_r.
    let body = |tag: &str| force.text(tag).map(|path| path.rsplit('/').next().unwrap_or(path).to_owned());
    let prefix = |tag: &str| force.text(tag).filter(|name| *name != "Unassigned").map(str::to_owned);
    let Some(on) = body("applied_to_body") else {
        return Err(force.error("the force has no <applied_to_body>", "name the body that it acts on"));
    };
    let ground = || "ground".to_owned();
    Ok(LoadEntry {
        name: force.name().to_owned(),
        body: on,
        force_in: body("force_expressed_in_body").unwrap_or_else(ground),
        point_in: body("point_expressed_in_body").unwrap_or_else(ground),
        force: prefix("force_identifier"),
        point: prefix("point_identifier"),
        moment: prefix("torque_identifier"),
    })
}
