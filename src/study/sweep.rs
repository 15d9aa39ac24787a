//! Axes of a study and their expansion: pure and deterministic.
//!
//! ```toml
//! [sweep.grid]                                  # every combination; the first axis varies slowest
//! bounds = ["activation", "both"]
//! mu = { from = 0.01, to = 1.0, count = 5, scale = "log" }
//! [sweep.zip]                                   # axes that vary together, all of the same length
//! h = [0.2, 0.1]
//! max_iterations = [100, 200]
//! [sweep.star]                                  # the base, and each value of each axis on its own
//! "muscle.triceps.tendon_slack_length_scale" = [0.95, 1.05]
//! [[sweep.list]]                                # explicit jobs
//! mu = 0.3
//! [sweep.sample]                                # seeded: random, latin_hypercube or sobol
//! count = 100
//! seed = 7
//! "body.forearm.mass" = { from = 1.0, to = 2.0 }
//! [sweep.group.speed.zip]                       # a named sweep, multiplied with the rest
//! [[sweep.exclude]]                             # omit jobs that match all keys; [[sweep.when]] keeps only those
//! bounds = "both"
//! mu = { from = 0.5 }
//! ```
//!
//! Several kinds multiply. Samples vary slowest, then groups, list, grid, star and zip.

use std::sync::Arc;

use indexmap::IndexMap;

use super::axis::{Expansion, KeyPath, SweepPoint, at, check_name, check_quoted, issue, values};
use super::file::Sweep;
use super::sample::samples;
use crate::error::Issue;
use crate::settings::{InvalidValue, Value};

/// What conditions need from the study around the sweep.
pub struct SweepContext<'c> {
    /// The value of a name for a job at a point: from the point, a wildcard in it, or the base.
    pub value: &'c dyn Fn(&SweepPoint, &str) -> Option<Value>,
    /// Checks that a name may have a value.
    pub check: &'c dyn Fn(&str, &Value) -> Result<(), InvalidValue>,
}

/// Expands a sweep; an empty one is a single job.
///
/// # Errors
/// An [`Issue`] with the place of the faulty axis.
pub fn expand(sweep: &Sweep, place: &[String], context: &SweepContext<'_>) -> Result<Expansion, Issue> {
    let mut whole = Expansion { points: vec![Vec::new()], axes: IndexMap::new() };
    if let Some(sample) = &sweep.sample {
        whole = multiply(whole, samples(sample, &at(place, &["sample"]))?)?;
    }
    for (name, group) in &sweep.group {
        whole = multiply(whole, expand(group, &at(place, &["group", name]), context)?)?;
    }
    if !sweep.list.is_empty() {
        whole = multiply(whole, list(&sweep.list, &at(place, &["list"]))?)?;
    }
    if let Some(table) = &sweep.grid {
        for axis in distinct(axes(table, &at(place, &["grid"]))?)? {
            whole = multiply(whole, axis.expansion())?;
        }
    }
    if let Some(table) = &sweep.star {
        whole = multiply(whole, star(distinct(axes(table, &at(place, &["star"]))?)?))?;
    }
    if let Some(table) = &sweep.zip {
        whole = multiply(whole, zip(axes(table, &at(place, &["zip"]))?)?)?;
    }
    for (name, group) in &sweep.group {
        let own: Vec<&String> = group.when.iter().chain(&group.exclude).flat_map(toml::Table::keys).collect();
        let outside = |key: &&&String| {
            whole.axes.get(key.as_str()).is_some_and(|path| !path.starts_with(&at(place, &["group", name])))
        };
        if let Some(key) = own.iter().find(outside) {
            let message = format!("a condition on `{key}`, which is swept outside the group");
            let help = "move the condition out of the group, to [[sweep.when]] or [[sweep.exclude]]";
            return Err(issue(at(place, &["group", name]), message, help));
        }
    }
    for (patterns, keep, key) in [(&sweep.when, true, "when"), (&sweep.exclude, false, "exclude")] {
        if patterns.is_empty() {
            continue;
        }
        let patterns = (patterns.iter().enumerate())
            .map(|(i, table)| pattern(table, &at(place, &[key, &i.to_string()]), &whole, context))
            .collect::<Result<Vec<_>, _>>()?;
        whole.points.retain(|point| patterns.iter().any(|p| p.iter().all(|test| test.holds(point, context))) == keep);
        if whole.points.is_empty() {
            let help = "remove a condition, or widen it: `when` keeps jobs that match all keys of one of its tables, \
                        `exclude` omits them";
            return Err(issue(at(place, &[key]), "the conditions leave no jobs", help));
        }
    }
    Ok(whole)
}

fn multiply(left: Expansion, right: Expansion) -> Result<Expansion, Issue> {
    if let Some((name, path)) = right.axes.iter().find(|(name, _)| left.axes.contains_key(*name)) {
        return Err(issue(path.clone(), format!("`{name}` is swept twice"), "sweep each name once"));
    }
    let points = match (left.points.len(), right.points.len()) {
        (1, _) if left.points[0].is_empty() => right.points,
        (_, 1) if right.points[0].is_empty() => left.points,
        _ => {
            let joined = |a: &SweepPoint, b: &SweepPoint| {
                let mut point = Vec::with_capacity(a.len() + b.len());
                point.extend_from_slice(a);
                point.extend_from_slice(b);
                point
            };
            left.points.iter().flat_map(|a| right.points.iter().map(move |b| joined(a, b))).collect()
        }
    };
    Ok(Expansion { points, axes: left.axes.into_iter().chain(right.axes).collect() })
}

/// A swept name with its values.
pub struct SweepAxis {
    pub name: Arc<str>,
    pub place: KeyPath,
    pub values: Vec<Value>,
}

impl SweepAxis {
    fn expansion(self) -> Expansion {
        let points = self.values.into_iter().map(|value| vec![(Arc::clone(&self.name), value)]).collect();
        Expansion { points, axes: [(self.name, self.place)].into_iter().collect() }
    }
}

fn axes(table: &toml::Table, place: &[String]) -> Result<Vec<SweepAxis>, Issue> {
    if table.is_empty() {
        return Err(issue(
            place.to_vec(),
            "the sweep has no axes",
            "add an axis such as mu = [0.1, 0.2], or remove the sweep",
        ));
    }
    table
        .iter()
        .map(|(name, spec)| {
            let place = at(place, &[name]);
            Ok(SweepAxis { name: name.as_str().into(), values: values(name, spec, &place)?, place })
        })
        .collect()
}

/// Refuses an axis with a repeated value.
fn distinct(axes: Vec<SweepAxis>) -> Result<Vec<SweepAxis>, Issue> {
    for axis in &axes {
        let mut seen = std::collections::HashSet::new();
        if let Some(value) = axis.values.iter().find(|value| !seen.insert(value.to_string())) {
            let help = "remove the repeated value";
            return Err(issue(axis.place.clone(), format!("{value} occurs twice"), help));
        }
    }
    Ok(axes)
}

fn zip(axes: Vec<SweepAxis>) -> Result<Expansion, Issue> {
    let (first, length) = (Arc::clone(&axes[0].name), axes[0].values.len());
    if let Some(axis) = axes.iter().find(|axis| axis.values.len() != length) {
        return Err(issue(
            axis.place.clone(),
            format!("found {} values, but `{first}` has {length}", axis.values.len()),
            "the axes of a zip vary together: give all of them the same length, or use [sweep.grid]",
        ));
    }
    let points =
        (0..length).map(|i| axes.iter().map(|axis| (Arc::clone(&axis.name), axis.values[i].clone())).collect());
    Ok(Expansion {
        points: points.collect(),
        axes: axes.iter().map(|a| (Arc::clone(&a.name), a.place.clone())).collect(),
    })
}

fn star(axes: Vec<SweepAxis>) -> Expansion {
    let names = axes.iter().map(|axis| (Arc::clone(&axis.name), axis.place.clone())).collect();
    let arms = axes.into_iter().flat_map(|axis| axis.expansion().points);
    Expansion { points: std::iter::once(Vec::new()).chain(arms).collect(), axes: names }
}

fn list(jobs: &[toml::Table], place: &[String]) -> Result<Expansion, Issue> {
    let mut whole = Expansion::default();
    for (i, job) in jobs.iter().enumerate() {
        let mut point = SweepPoint::new();
        for (name, spec) in job {
            let place = at(place, &[&i.to_string(), name]);
            check_name(name, spec, &place)?;
            let value = Value::of(spec).ok_or_else(|| {
                issue(
                    place.clone(),
                    format!("found {spec}"),
                    "an entry of a list holds single values; lists of values belong in [sweep.grid]",
                )
            })?;
            let name: Arc<str> = name.as_str().into();
            whole.axes.entry(Arc::clone(&name)).or_insert(place);
            point.push((name, value));
        }
        if let Some(other) = whole.points.iter().position(|other| *other == point) {
            let message = format!("entries {other} and {i} of the list are identical");
            return Err(issue(at(place, &[&i.to_string()]), message, "remove one of them"));
        }
        whole.points.push(point);
    }
    Ok(whole)
}

/// The test of one key of a condition.
struct Test {
    name: String,
    allowed: Allowed,
}

enum Allowed {
    OneOf(Vec<Value>),
    Between(f64, f64),
}

impl Test {
    fn holds(&self, point: &SweepPoint, context: &SweepContext<'_>) -> bool {
        let Some(value) = (context.value)(point, &self.name) else { return false };
        match &self.allowed {
            Allowed::OneOf(values) => values.iter().any(|allowed| allowed.same(&value)),
            Allowed::Between(from, to) => value.number().is_some_and(|number| (*from..=*to).contains(&number)),
        }
    }
}

/// The tests of a condition, all of which must hold.
fn pattern(
    table: &toml::Table,
    place: &[String],
    sweep: &Expansion,
    context: &SweepContext<'_>,
) -> Result<Vec<Test>, Issue> {
    let test = |(name, spec): (&String, &toml::Value)| {
        let place = at(place, &[name]);
        check_quoted(name, spec, &place)?;
        if !sweep.axes.contains_key(name.as_str()) && (context.value)(&SweepPoint::new(), name).is_none() {
            let swept: Vec<&str> = sweep.axes.keys().map(|axis| &**axis).collect();
            let near = crate::error::nearest(name, swept.iter().copied()).map(|n| format!("did you mean `{n}`? "));
            let help = format!("{}swept here: {}", near.unwrap_or_default(), swept.join(", "));
            return Err(issue(place, format!("a condition on `{name}`, which no job has"), help));
        }
        let single = |spec: &toml::Value| {
            let help = "a condition is a value, a list of values, or a range { from = …, to = … }";
            let value = Value::of(spec).ok_or_else(|| issue(place.clone(), format!("found {spec}"), help))?;
            (context.check)(name, &value).map_err(|c| issue(place.clone(), c.message, c.help))?;
            Ok(value)
        };
        let allowed = match spec {
            toml::Value::Table(range) => {
                let end = |key: &str, open: f64| match range.get(key) {
                    None => Some(open),
                    Some(value) => Value::of(value)?.number(),
                };
                let known = !range.is_empty() && range.keys().all(|key| key == "from" || key == "to");
                match (end("from", f64::NEG_INFINITY), end("to", f64::INFINITY)) {
                    (Some(from), Some(to)) if known && from <= to => Allowed::Between(from, to),
                    _ => {
                        let help = "the range of a condition has from, to or both; its ends are included";
                        return Err(issue(place, format!("found {spec}"), help));
                    }
                }
            }
            toml::Value::Array(items) => Allowed::OneOf(items.iter().map(single).collect::<Result<_, Issue>>()?),
            other => Allowed::OneOf(vec![single(other)?]),
        };
        Ok(Test { name: name.clone(), allowed })
    };
    if table.is_empty() {
        return Err(issue(place.to_vec(), "the condition is empty", "add a key, such as bounds = \"both\""));
    }
    table.iter().map(test).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn expand_text(text: &str) -> Result<Vec<String>, String> {
        let sweep: Sweep = toml::from_str(text).map_err(|e| e.message().to_owned())?;
        let value = |point: &SweepPoint, name: &str| {
            let own = point.iter().find(|(n, _)| **n == *name).map(|(_, value)| value.clone());
            own.or((name == "stages").then_some(Value::Integer(1)))
        };
        let check = |name: &str, value: &Value| match (name, value.number()) {
            ("stages", None) => Err(InvalidValue::new("found a text", "a number")),
            _ => Ok(()),
        };
        let expansion = expand(&sweep, &["sweep".to_owned()], &SweepContext { value: &value, check: &check })
            .map_err(|i| format!("{:?} {}", i.path, i.message))?;
        let text = |p: &SweepPoint| p.iter().map(|(n, v)| format!("{n}{v}")).collect::<Vec<_>>().join(" ");
        Ok(expansion.points.iter().map(text).collect())
    }

    #[test]
    fn grid_times_zip_in_the_order_of_the_file() {
        let jobs = expand_text("[grid]\nb = [1, 2]\na = ['x', 'y']\n[zip]\nh = [0.2, 0.1]\ns = [5, 6]").unwrap();
        assert_eq!(jobs.len(), 8);
        assert_eq!(jobs[0], "b1 ax h0.2 s5");
        assert_eq!(jobs[1], "b1 ax h0.1 s6");
        assert_eq!(jobs[2], "b1 ay h0.2 s5");
        assert_eq!(jobs[7], "b2 ay h0.1 s6");
    }

    #[test]
    fn groups_multiply_and_a_star_moves_one_at_a_time() {
        let jobs = expand_text(
            "[group.one.zip]\na = [1, 2]\nb = [3, 4]\n[group.two]\nlist = [{ c = 5 }, { d = 6 }]\n\
             [star]\nx = [1]\ny = [2, 3]",
        )
        .unwrap();
        assert_eq!(jobs.len(), 2 * 2 * 4);
        assert_eq!(jobs[..5], ["a1 b3 c5", "a1 b3 c5 x1", "a1 b3 c5 y2", "a1 b3 c5 y3", "a1 b3 d6"]);
    }

    #[test]
    fn conditions_keep_or_leave_out() {
        let grid = "[grid]\na = [1, 2, 3]\nb = ['x', 'y']\n";
        assert_eq!(expand_text(&format!("{grid}[[when]]\na = [1, 2.0]\nb = 'x'")).unwrap(), ["a1 bx", "a2 bx"]);
        let jobs = expand_text(&format!("{grid}[[exclude]]\na = {{ from = 2 }}\n[[exclude]]\nb = 'y'")).unwrap();
        assert_eq!(jobs, ["a1 bx"]);
        assert_eq!(expand_text(&format!("{grid}[[when]]\nstages = 1\na = 3")).unwrap().len(), 2);
    }

    #[test]
    fn ranges_meet_their_ends() {
        let jobs = expand_text("[grid]\nmu = { from = 0.01, to = 1.0, count = 3, scale = 'log' }").unwrap();
        assert_eq!((jobs[0].as_str(), jobs[2].as_str()), ("mu0.01", "mu1"));
        assert_eq!(jobs[1], "mu0.1");
        let jobs = expand_text("[grid]\n'muscle.a.b' = { from = 1, to = 100, count = 100 }").unwrap();
        assert!(
            jobs.iter().enumerate().all(|(i, job)| *job == format!("muscle.a.b{}", i + 1)),
            "whole numbers stay whole"
        );
    }

    #[test]
    fn mistakes_are_named() {
        for (text, part) in [
            ("[grid]\nmu = []", "no value"),
            ("[grid]\nmu = 0.1", "single value"),
            ("[gird]\nmu = [1]", "unknown field `gird`"),
            ("[zip]\na = [1]\nb = [1, 2]", "2 values"),
            ("[grid]\nmu = { from = 0.0, to = 1.0, count = 3, scale = 'log' }", "log range"),
            ("[grid]\nmu = { from = 0.0, to = 1.0 }", "count"),
            ("[sample]\ncount = 3", "missing field `seed`"),
            ("[sample]\ncount = 3\nseed = 1\nmu = { from = 0.0, to = 1.0, scale = 'log' }", "log range"),
            ("[sample]\ncount = 3\nseed = 1\nmu = 0.1", "draw"),
            ("[grid]\nmu = [1]\n[group.a.zip]\nmu = [1]", "swept twice"),
            ("[grid]\na = [1]\n[[exclude]]\na = 1", "leave no job"),
            ("[grid]\nbounds = [1]\n[[when]]\nbound = 1", "which no job has"),
            ("[grid]\na = [1]\n[[when]]\na = { form = 1 }", "found { form = 1 }"),
            ("[grid]\na = [1]\n[[when]]\nstages = 'one'", "found a text"),
            ("[grid]\na = [1]\n[group.g]\ngrid = { b = [1] }\nwhen = [{ a = 1 }]", "no job has"),
            ("[grid]\nstages = [1]\n[group.g]\ngrid = { b = [1] }\nwhen = [{ stages = 1 }]", "swept outside the group"),
            ("[grid]\na = { from = 1, to = 2, count = -1 }", "count = -1"),
            ("[sample]\ncount = 3\nseed = 1\nsample = [1]", "numbers the samples"),
            ("[[list]]\na = 1\n[[list]]\na = 1", "entries 0 and 1"),
            ("[[list]]\na = [1]", "found [1]"),
            ("[grid]\na = [1, 2, 1.0]", "1 occurs twice"),
        ] {
            let message = expand_text(text).unwrap_err();
            assert!(message.contains(part), "{text}: {message}");
        }
    }
}
