//! Reads OpenSim's functions of one coordinate.

use super::document::Element;
use crate::error::Result;
use crate::skeleton::function::FunctionEntry;

/// Maximum nesting of functions.
const MAX_DEPTH: usize = 20;

/// Reads a function element; `None` if its kind is not supported.
///
/// # Errors
/// If a number is not valid, or functions are nested too deep.
pub fn function(element: Element<'_>) -> Result<Option<FunctionEntry>> {
    let (mut element, mut scale) = (element, 1.0);
    for _ in 0..MAX_DEPTH {
        if element.tag() != "MultiplierFunction" {
            return Ok(plain(element)?.map(|function| scaled(function, scale)));
        }
        scale *= element.number("scale")?.unwrap_or(1.0);
        let Some(inner) = element.child("function").and_then(|f| f.children().next()) else { return Ok(None) };
        element = inner;
    }
    Err(element.error("functions are nested too deep", "write the function itself"))
}

/// Reads the function `tag` of an element: the content of the child `<tag>` or, depending on the version, the child
/// named `tag`. `None` if it is absent or not supported.
///
/// # Errors
/// As for [`function`].
pub fn function_of(owner: Element<'_>, tag: &str) -> Result<Option<FunctionEntry>> {
    let held = owner.child(tag).and_then(|f| f.children().next());
    let found = held.or_else(|| owner.children().find(|child| child.name() == tag && child.tag() != tag));
    found.map_or(Ok(None), function)
}

/// Reads a function other than a `MultiplierFunction`.
fn plain(element: Element<'_>) -> Result<Option<FunctionEntry>> {
    let points = || -> Result<Vec<[f64; 2]>> {
        let (x, y) = (element.numbers("x")?.unwrap_or_default(), element.numbers("y")?.unwrap_or_default());
        if x.len() != y.len() {
            let message = format!("{} values of x, but {} of y", x.len(), y.len());
            return Err(element.error(message, "x and y must have the same number of values"));
        }
        Ok(x.into_iter().zip(y).map(|(x, y)| [x, y]).collect())
    };
    Ok(match element.tag() {
        "Constant" => Some(FunctionEntry::Polynomial(vec![element.number("value")?.unwrap_or(0.0)])),
        "LinearFunction" => {
            let [slope, offset] = element.vector("coefficients")?.unwrap_or([1.0, 0.0]);
            Some(FunctionEntry::Polynomial(vec![offset, slope]))
        }
        "PolynomialFunction" => {
            let mut coefficients = element.numbers("coefficients")?.unwrap_or_default();
            coefficients.reverse();
            Some(FunctionEntry::Polynomial(coefficients))
        }
        "SimmSpline" | "NaturalCubicSpline" | "NatCubicSpline" | "natCubicSpline" | "natCubicSpline2" => {
            Some(FunctionEntry::Spline(points()?))
        }
        "PiecewiseLinearFunction" => Some(FunctionEntry::Lines(points()?)),
        _ => None,
    })
}

/// The function times `scale`.
fn scaled(function: FunctionEntry, scale: f64) -> FunctionEntry {
    let points = |points: Vec<[f64; 2]>| points.into_iter().map(|[x, y]| [x, scale * y]).collect();
    match function {
        FunctionEntry::Polynomial(c) => FunctionEntry::Polynomial(c.into_iter().map(|c| scale * c).collect()),
        FunctionEntry::Spline(p) => FunctionEntry::Spline(points(p)),
        FunctionEntry::Lines(p) => FunctionEntry::Lines(points(p)),
    }
}
