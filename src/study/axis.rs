//! What sweeps are made of: points, places in the file, and the values of one axis.

use std::sync::Arc;

use indexmap::IndexMap;

use super::file::shown;
use crate::error::Issue;
use crate::settings::Value;

/// Largest number of jobs. A study with more is taken to be a mistake.
pub const MAX_JOBS: usize = 1_000_000;

const RANGE_KEYS: [&str; 4] = ["from", "to", "count", "scale"];

/// What a sweep sets for one job.
pub type SweepPoint = Vec<(Arc<str>, Value)>;

/// Name of the column that numbers the samples.
pub const SAMPLE: &str = "sample";

/// A place in the study file: the keys from the top.
pub type KeyPath = Vec<String>;

/// The points of a sweep, one per job, and the place of each swept name in the file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Expansion {
    pub points: Vec<SweepPoint>,
    pub axes: IndexMap<Arc<str>, KeyPath>,
}

/// A place within another one.
pub fn at(place: &[String], keys: &[&str]) -> KeyPath {
    place.iter().cloned().chain(keys.iter().map(|key| (*key).to_owned())).collect()
}

pub fn issue(path: KeyPath, message: impl Into<String>, help: impl Into<String>) -> Issue {
    Issue { path, message: message.into(), help: Some(help.into()) }
}

/// Refuses a name that cannot be swept.
pub fn check_name(name: &str, spec: &toml::Value, place: &[String]) -> Result<(), Issue> {
    if name == SAMPLE {
        let message = "the column `sample` numbers the samples";
        return Err(issue(place.to_vec(), message, "use [sweep.sample] with count and seed"));
    }
    check_quoted(name, spec, place)
}

/// Refuses `muscle.triceps.… =` without quotes, which TOML reads as nested tables.
pub fn check_quoted(name: &str, spec: &toml::Value, place: &[String]) -> Result<(), Issue> {
    let toml::Value::Table(inner) = spec else { return Ok(()) };
    let is_group = super::change::GROUPS.contains(&name) || ["motion", "warn", "tracking_weight"].contains(&name);
    // `reserves` is a setting, which may be a range, and a group.
    if is_group || (name == "reserves" && !inner.keys().any(|key| RANGE_KEYS.contains(&key.as_str()))) {
        let first = inner.keys().next().map_or("…", String::as_str);
        let more = if inner.values().next().is_some_and(toml::Value::is_table) { ".…" } else { "" };
        return Err(issue(
            place.to_vec(),
            format!("found the table `{name}`"),
            format!("quote the whole name: \"{name}.{first}{more}\" = […]"),
        ));
    }
    Ok(())
}

/// The values of one axis: a list, or a range.
pub fn values(name: &str, spec: &toml::Value, place: &[String]) -> Result<Vec<Value>, Issue> {
    let fail = |message: String, help: &str| issue(place.to_vec(), message, help);
    check_name(name, spec, place)?;
    match spec {
        toml::Value::Array(items) if items.is_empty() => {
            Err(fail("the axis has no values".into(), "give at least one value, or remove the axis"))
        }
        toml::Value::Array(items) => items
            .iter()
            .map(|item| {
                Value::of(item).ok_or_else(|| {
                    fail(format!("found {item}"), "an axis is a list of numbers, texts, or true/false values")
                })
            })
            .collect(),
        toml::Value::Table(table) => {
            for key in table.keys() {
                if !RANGE_KEYS.contains(&key.as_str()) {
                    return Err(issue(
                        at(place, &[key]),
                        format!("unknown key `{key}`"),
                        "a range has the keys from, to, count, and scale (\"linear\" or \"log\")",
                    ));
                }
            }
            let range = Range::new(table, place)?;
            let count = range.count.ok_or_else(|| {
                let found = table.get("count").map_or("no `count`".to_owned(), |found| format!("count = {found}"));
                let help = format!("give the number of values, from 1 to {MAX_JOBS}, such as count = 5");
                issue(place.to_vec(), format!("the range has {found}"), help)
            })?;
            Ok((0..count).map(|i| range.value(i, count)).collect())
        }
        other => Err(fail(
            format!("found the single value {}", shown(other)),
            "an axis is a list such as [0.1, 0.2] or a range { from = …, to = …, count = … }; fixed values belong in \
             [base]",
        )),
    }
}

/// `{ from = …, to = … }`, with `count` and `scale` where they apply.
#[derive(Clone, Debug)]
pub struct Range {
    from: f64,
    to: f64,
    log: bool,
    /// Both ends are whole numbers.
    whole: bool,
    count: Option<usize>,
}

impl Range {
    pub fn new(range: &toml::Table, place: &[String]) -> Result<Self, Issue> {
        let end = |key: &str| {
            range.get(key).and_then(|v| Value::of(v)?.number()).filter(|v| v.is_finite()).ok_or_else(|| {
                issue(place.to_vec(), format!("the range has no number `{key}`"), "give from = … and to = …")
            })
        };
        let (from, to) = (end("from")?, end("to")?);
        let log = match range.get("scale").map(toml::Value::as_str) {
            None | Some(Some("linear")) => false,
            Some(Some("log")) if from > 0.0 && to > 0.0 => true,
            Some(Some("log")) => {
                let message = format!("a log range from {from} to {to}");
                return Err(issue(at(place, &["scale"]), message, "both ends must be greater than 0"));
            }
            _ => return Err(issue(at(place, &["scale"]), "unknown scale", "scale is \"linear\" or \"log\"")),
        };
        let whole = !log && ["from", "to"].iter().all(|key| range.get(*key).is_some_and(toml::Value::is_integer));
        let count = range.get("count").and_then(toml::Value::as_integer).filter(|c| (1..=MAX_JOBS as i64).contains(c));
        Ok(Self { from, to, log, whole, count: count.map(|c| c as usize) })
    }

    /// The number at a fraction (from 0 to 1) of the range.
    pub fn share(&self, share: f64) -> f64 {
        match self.log {
            true => (self.from.ln() + share * (self.to.ln() - self.from.ln())).exp(),
            false => self.from + share * (self.to - self.from),
        }
    }

    /// Value `i` of `count`; both ends are exact.
    fn value(&self, i: usize, count: usize) -> Value {
        let inner = match i {
            0 => return self.end(self.from),
            _ if i + 1 == count => return self.end(self.to),
            _ if self.log => self.share(i as f64 / (count - 1) as f64),
            // Multiply first, so that whole steps are exact.
            _ => self.from + i as f64 * (self.to - self.from) / (count - 1) as f64,
        };
        // Rounded to 15 digits: 0.3, not 0.30000000000000004, and the same number whichever range it comes from.
        self.end(format!("{inner:.14e}").parse().expect("a formatted number"))
    }

    /// With whole ends, whole numbers remain integers: starts, seeds, ratios.
    fn end(&self, x: f64) -> Value {
        if self.whole && x.fract() == 0.0 { Value::Integer(x as i64) } else { Value::Number(x) }
    }
}
