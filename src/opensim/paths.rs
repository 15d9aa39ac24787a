//! OpenSim's function-based paths: lengths of muscles that were fitted by polynomials, in a model or in a file of their
//! own.

use super::document::{Element, parse};
use super::{Note, Notes};
use crate::error::{Issue, Result, SourceFile, nearest};
use crate::names::counted;
use crate::skeleton::file::SkeletonFile;
use crate::skeleton::polynomial::LengthEntry;

/// Reads a FunctionBasedPath of a muscle.
///
/// # Errors
/// If its length is no polynomial, or a number is not valid.
pub(super) fn length(path: Element<'_>, muscle: &str, notes: &mut Notes) -> Result<LengthEntry> {
    let help = "fit the length by a MultivariatePolynomialFunction";
    let Some(function) = path.child("length_function").and_then(|function| function.children().next()) else {
        return Err(path.error("the path has no <length_function>", help));
    };
    if function.tag() != "MultivariatePolynomialFunction" {
        return Err(function.error(format!("<{}> as the length of a path is not supported", function.tag()), help));
    }
    if ["moment_arm_functions", "lengthening_speed_function"].iter().any(|tag| path.child(tag).is_some()) {
        let lost = "its functions of moment arms and lengthening speed are ignored: those of the length are used";
        notes.changed(&format!("muscle {muscle}"), lost);
    }
    let order = function.number("order")?.unwrap_or(0.0);
    if order < 0.0 || order.fract() != 0.0 {
        return Err(function.error(format!("the order is {order}"), "give a whole number from 0 to 20"));
    }
    let order = order as usize;
    let coordinates = path.text("coordinate_paths").unwrap_or_default();
    let name = |path: &str| path.rsplit('/').next().unwrap_or(path).to_owned();
    Ok(LengthEntry {
        coordinates: coordinates.split_whitespace().map(name).collect(),
        order,
        coefficients: function.numbers("coefficients")?.unwrap_or_default(),
    })
}

/// Replaces lengths along paths by those of a file of function-based paths. Returns notes.
///
/// # Errors
/// If the file is not valid, or has a path of a muscle that the model does not have.
pub fn replace(file: &mut SkeletonFile, paths: &SourceFile) -> Result<Vec<Note>> {
    let document = parse(paths)?;
    let root = Element { node: document.root_element(), file: paths };
    let mut notes = Notes::default();
    let found: Vec<Element<'_>> = root.descendants("FunctionBasedPath").collect();
    if found.is_empty() {
        let help = "give a file as OpenSim's PolynomialPathFitter writes it";
        return Err(root.error("the file has no <FunctionBasedPath>", help));
    }
    for path in &found {
        let name = path.name().rsplit('/').next().unwrap_or_default();
        let Some(muscle) = file.muscle.iter().position(|muscle| muscle.name == name) else {
            let known = file.muscle.iter().map(|muscle| muscle.name.as_str());
            let near = nearest(name, known).map(|n| format!("did you mean `{n}`? ")).unwrap_or_default();
            let help = format!("{near}paths are named after muscles of the model");
            return Err(path.error(format!("the model has no muscle `{name}`"), &help));
        };
        file.muscle[muscle].length = Some(length(*path, name, &mut notes)?);
    }
    let others = file.muscle.iter().filter(|muscle| muscle.length.is_none()).count();
    if others > 0 {
        notes.remark("paths", format!("{} of the model keep theirs", counted(others, "muscle")));
    }
    let at_root = |issue: Issue| {
        root.error(format!("{}: {}", issue.path.join("."), issue.message), issue.help.as_deref().unwrap_or_default())
    };
    file.check().map_err(at_root)?;
    Ok(notes.0)
}
