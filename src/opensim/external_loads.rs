//! OpenSim's ExternalLoads files.

use std::ops::Range;

use super::document::{Element, parse};
use crate::error::{Result, SourceFile};
use crate::motion::external_loads::LoadEntry;

/// The external loads of a file.
pub struct Loads {
    /// Each with the bytes where it stands.
    pub entries: Vec<(LoadEntry, Range<usize>)>,
    /// The name of the data file, and where it stands.
    pub table: (String, Range<usize>),
    /// Names of loads that the file turns off.
    pub off: Vec<String>,
}

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
    let (mut entries, mut off) = (Vec::new(), Vec::new());
    let named = |element: Option<Element<'_>>| {
        let element = element?;
        let name = element.own_text().filter(|name| *name != "Unassigned")?;
        // Written on Windows, perhaps.
        Some((name.replace('\\', "/"), element.node.range()))
    };
    let mut tables: Vec<(String, Range<usize>)> = named(set.child("datafile")).into_iter().collect();
    let is_common = !tables.is_empty();
    for force in forces.into_iter().filter(|force| force.tag() == "ExternalForce") {
        if force.flag("isDisabled", false) || !force.flag("appliesForce", true) {
            off.push(force.name().to_owned());
            continue;
        }
        entries.push((entry(force)?, force.node.range()));
        tables.extend(named(force.child("data_source_name")).filter(|_| !is_common));
    }
    tables.dedup_by(|a, b| a.0 == b.0);
    match &tables[..] {
        [table] => Ok(Loads { entries, table: table.clone(), off }),
        [] => Err(set.error("no data file is named", "add <datafile>forces.mot</datafile>")),
        _ => {
            let help = "put the columns of all forces into one file and name it in <datafile>";
            let names: Vec<&str> = tables.iter().map(|(name, _)| name.as_str()).collect();
            Err(set.error(format!("several data files are named: {}", names.join(", ")), help))
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
