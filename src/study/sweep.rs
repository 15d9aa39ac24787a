//! Axes of a study and their expansion: pure and deterministic.
//!
//! ```toml
//! [sweep.grid]                                  # every combination; the first axis turns slowest
//! bounds = ["activation", "both"]
//! mu = { from = 0.01, to = 1.0, count = 5, scale = "log" }
//! [sweep.zip]                                   # side by side: all of one length
//! h = [0.2, 0.1]
//! max_iterations = [100, 200]
//! [sweep.sample]                                # seeded, uniform and independent
//! count = 100
//! seed = 7
//! "body.forearm.mass" = { from = 1.0, to = 2.0 }   # or with scale = "log"
//! bounds = ["activation", "both"]               # any of these, equally likely
//! ```
//!
//! Where several are given they multiply: samples turn slowest, then the grid, then the zip.

use rand::{RngExt, SeedableRng};

use super::settings::Value;
use crate::error::{Issue, nearest};

/// (name, value) of everything swept, for one job.
pub type Assignment = Vec<(String, Value)>;

/// Name of the column that numbers the samples.
pub const SAMPLE: &str = "sample";

/// Expands `[sweep]`. Without one there is a single job.
///
/// # Errors
/// An [`Issue`] with the path of the axis at fault.
pub fn expand(sweep: &toml::Table) -> Result<Vec<Assignment>, Issue> {
    let mut jobs: Vec<Assignment> = vec![Vec::new()];
    for key in sweep.keys() {
        if !["grid", "zip", "sample"].contains(&key.as_str()) {
            let near = nearest(key, ["grid", "zip", "sample"]).map(|n| format!("did you mean `{n}`? "));
            return Err(Issue::new(
                &["sweep", key],
                format!("unknown kind of sweep `{key}`"),
                format!("{}kinds are: grid, zip, sample", near.unwrap_or_default()),
            ));
        }
    }
    if let Some(table) = table(sweep, "sample")? {
        jobs = multiply(jobs, samples(table)?);
    }
    if let Some(table) = table(sweep, "grid")? {
        for (name, spec) in table {
            let values = axis("grid", name, spec)?;
            jobs = multiply(jobs, values.into_iter().map(|value| vec![(name.clone(), value)]).collect());
        }
    }
    if let Some(table) = table(sweep, "zip")? {
        let axes =
            table.iter().map(|(name, spec)| Ok((name, axis("zip", name, spec)?))).collect::<Result<Vec<_>, _>>()?;
        let length = axes.first().map_or(0, |(_, values)| values.len());
        if let Some((name, values)) = axes.iter().find(|(_, values)| values.len() != length) {
            return Err(Issue::new(
                &["sweep", "zip", name],
                format!("{} values beside {length} of `{}`", values.len(), axes[0].0),
                "axes of a zip go side by side: give all the same length, or use [sweep.grid]",
            ));
        }
        let rows =
            (0..length).map(|i| axes.iter().map(|(name, values)| ((*name).clone(), values[i].clone())).collect());
        jobs = multiply(jobs, rows.collect());
    }
    Ok(jobs)
}

fn multiply(left: Vec<Assignment>, right: Vec<Assignment>) -> Vec<Assignment> {
    left.iter().flat_map(|a| right.iter().map(move |b| a.iter().chain(b).cloned().collect())).collect()
}

fn table<'t>(sweep: &'t toml::Table, kind: &str) -> Result<Option<&'t toml::Table>, Issue> {
    match sweep.get(kind) {
        None => Ok(None),
        Some(toml::Value::Table(table)) if !table.is_empty() => Ok(Some(table)),
        Some(toml::Value::Table(_)) => Err(Issue::new(
            &["sweep", kind],
            "the sweep has no axis",
            "add an axis such as mu = [0.1, 0.2], or remove it",
        )),
        Some(_) => Err(Issue::new(&["sweep", kind], "found a value", format!("write it as a table: [sweep.{kind}]"))),
    }
}

/// The values of one axis: a list, or a range.
fn axis(kind: &str, name: &str, spec: &toml::Value) -> Result<Vec<Value>, Issue> {
    let issue = |message: String, help: &str| Issue::new(&["sweep", kind, name], message, help);
    if name == SAMPLE {
        return Err(issue("`sample` numbers the samples".into(), "use [sweep.sample] with count and seed"));
    }
    if let (toml::Value::Table(inner), true) = (spec, super::change::is_model_path(name) || name == "motion") {
        let first = inner.keys().next().map_or("…", String::as_str);
        return Err(issue(
            format!("found the table `{name}`"),
            &format!("quote the whole name: \"{name}.{first}.…\" = […]"),
        ));
    }
    match spec {
        toml::Value::Array(items) if items.is_empty() => {
            Err(issue("the axis has no value".into(), "give at least one value, or remove the axis"))
        }
        toml::Value::Array(items) => items
            .iter()
            .map(|item| {
                value(item).ok_or_else(|| {
                    issue(format!("found {item}"), "an axis is a list of numbers, texts, or true and false")
                })
            })
            .collect(),
        toml::Value::Table(range) => {
            for key in range.keys() {
                if !["from", "to", "count", "scale"].contains(&key.as_str()) {
                    return Err(Issue::new(
                        &["sweep", kind, name, key],
                        format!("unknown key `{key}`"),
                        "a range has from, to, count, and scale = \"linear\" or \"log\"",
                    ));
                }
            }
            let (from, to) = ends(kind, name, range)?;
            let count = range.get("count").and_then(toml::Value::as_integer).filter(|c| (1..=1_000_000).contains(c));
            let Some(count) = count else {
                return Err(issue(
                    "the range has no `count` from 1 on".into(),
                    "say how many values, such as count = 5",
                ));
            };
            let log = match range.get("scale").map(toml::Value::as_str) {
                None | Some(Some("linear")) => false,
                Some(Some("log")) if from > 0.0 && to > 0.0 => true,
                Some(Some("log")) => {
                    return Err(issue(format!("a log range from {from} to {to}"), "both ends must be above 0"));
                }
                _ => return Err(issue("unknown scale".into(), "scale is \"linear\" or \"log\"")),
            };
            let at = |i: i64| {
                let share = if count == 1 { 0.0 } else { i as f64 / (count - 1) as f64 };
                match (i, log) {
                    (0, _) => from,
                    _ if i == count - 1 => to,
                    (_, true) => (from.ln() + share * (to.ln() - from.ln())).exp(),
                    (_, false) => from + share * (to - from),
                }
            };
            // Whole numbers between whole ends stay whole: starts, seeds, ratios.
            let whole = !log && ["from", "to"].iter().all(|key| range.get(*key).is_some_and(toml::Value::is_integer));
            let value = |x: f64| if whole && x.fract() == 0.0 { Value::Integer(x as i64) } else { Value::Number(x) };
            Ok((0..count).map(|i| value(at(i))).collect())
        }
        other => Err(issue(
            format!("found the single value {other}"),
            "an axis is a list such as [0.1, 0.2] or a range { from = …, to = …, count = … }; fixed values belong in [base]",
        )),
    }
}

fn ends(kind: &str, name: &str, range: &toml::Table) -> Result<(f64, f64), Issue> {
    let end = |key: &str| {
        range.get(key).and_then(|v| value(v)?.number()).filter(|v| v.is_finite()).ok_or_else(|| {
            Issue::new(&["sweep", kind, name], format!("the range has no number `{key}`"), "give from = … and to = …")
        })
    };
    Ok((end("from")?, end("to")?))
}

fn value(item: &toml::Value) -> Option<Value> {
    match item {
        toml::Value::Boolean(flag) => Some(Value::Flag(*flag)),
        toml::Value::Integer(number) => Some(Value::Integer(*number)),
        toml::Value::Float(number) => Some(Value::Number(*number)),
        toml::Value::String(text) => Some(Value::Text(text.clone())),
        _ => None,
    }
}

fn samples(table: &toml::Table) -> Result<Vec<Assignment>, Issue> {
    let integer = |key: &str, least: i64, most: i64| match table.get(key).and_then(toml::Value::as_integer) {
        Some(number) if (least..=most).contains(&number) => Ok(number),
        _ => Err(Issue::new(
            &["sweep", "sample", key],
            format!("`{key}` must be a whole number from {least} to {most}"),
            "samples are counted and seeded: count = 100, seed = 1",
        )),
    };
    let (count, seed) = (integer("count", 1, 1_000_000)?, integer("seed", 0, i64::MAX)?);
    let draws = table
        .iter()
        .filter(|(name, _)| !["count", "seed"].contains(&name.as_str()))
        .map(|(name, spec)| Ok((name, Draw::new(name, spec)?)))
        .collect::<Result<Vec<_>, Issue>>()?;
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed as u64);
    Ok((0..count)
        .map(|i| {
            let mut assignment = vec![(SAMPLE.to_owned(), Value::Integer(i))];
            assignment.extend(draws.iter().map(|(name, draw)| ((*name).clone(), draw.at(rng.random()))));
            assignment
        })
        .collect())
}

/// What a sampled parameter is drawn from.
enum Draw {
    Linear(f64, f64),
    Log(f64, f64),
    Choice(Vec<Value>),
}

impl Draw {
    fn new(name: &str, spec: &toml::Value) -> Result<Self, Issue> {
        match spec {
            toml::Value::Array(_) => Ok(Draw::Choice(axis("sample", name, spec)?)),
            toml::Value::Table(range) if range.keys().all(|k| ["from", "to", "scale"].contains(&k.as_str())) => {
                let (from, to) = ends("sample", name, range)?;
                match range.get("scale").map(toml::Value::as_str) {
                    None | Some(Some("linear")) => Ok(Draw::Linear(from, to)),
                    Some(Some("log")) if from > 0.0 && to > 0.0 => Ok(Draw::Log(from, to)),
                    _ => Err(Issue::new(
                        &["sweep", "sample", name, "scale"],
                        "no scale for this range",
                        "scale is \"linear\" or, with both ends above 0, \"log\"",
                    )),
                }
            }
            _ => Err(Issue::new(
                &["sweep", "sample", name],
                "nothing to draw from",
                "a sampled parameter is a range { from = …, to = … } (scale = \"log\" if you like) or a list of values",
            )),
        }
    }

    /// The value at a share from 0 to 1.
    fn at(&self, share: f64) -> Value {
        match self {
            Draw::Linear(from, to) => Value::Number(from + share * (to - from)),
            Draw::Log(from, to) => Value::Number((from.ln() + share * (to.ln() - from.ln())).exp()),
            Draw::Choice(values) => values[((share * values.len() as f64) as usize).min(values.len() - 1)].clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn expand_text(text: &str) -> Result<Vec<Assignment>, Issue> {
        expand(&toml::from_str(text).unwrap())
    }

    #[test]
    fn grid_times_zip_in_the_order_of_the_file() {
        let jobs = expand_text("[grid]\nb = [1, 2]\na = ['x', 'y']\n[zip]\nh = [0.2, 0.1]\ns = [5, 6]").unwrap();
        assert_eq!(jobs.len(), 8);
        let text: Vec<String> =
            jobs.iter().map(|j| j.iter().map(|(n, v)| format!("{n}{v}")).collect::<Vec<_>>().join(" ")).collect();
        assert_eq!(text[0], "b1 ax h0.2 s5");
        assert_eq!(text[1], "b1 ax h0.1 s6");
        assert_eq!(text[2], "b1 ay h0.2 s5");
        assert_eq!(text[7], "b2 ay h0.1 s6");
    }

    #[test]
    fn ranges_meet_their_ends() {
        let jobs = expand_text("[grid]\nmu = { from = 0.01, to = 1.0, count = 3, scale = 'log' }").unwrap();
        let values: Vec<f64> = jobs.iter().map(|j| j[0].1.number().unwrap()).collect();
        assert_eq!(values[0], 0.01);
        assert!((values[1] - 0.1).abs() < 1e-15);
        assert_eq!(values[2], 1.0);
    }

    #[test]
    fn samples_are_seeded() {
        let text = "[sample]\ncount = 3\nseed = 4\n'body.a.mass' = { from = 1.0, to = 2.0 }";
        let (one, two) = (expand_text(text).unwrap(), expand_text(text).unwrap());
        assert_eq!(one, two);
        assert_eq!(one.len(), 3);
        assert!(one.iter().all(|j| (1.0..2.0).contains(&j[1].1.number().unwrap())));
        assert_ne!(one[0][1], one[1][1]);
        let text = "[sample]\ncount = 60\nseed = 4\nmu = { from = 0.01, to = 1.0, scale = 'log' }\nb = ['x', 'y']";
        let jobs = expand_text(text).unwrap();
        let small = jobs.iter().filter(|j| j[1].1.number().unwrap() < 0.1).count();
        let x = jobs.iter().filter(|j| j[2].1 == Value::Text("x".into())).count();
        assert!((20..40).contains(&small) && (20..40).contains(&x), "{small} {x}");
    }

    #[test]
    fn mistakes_are_named() {
        for (text, part) in [
            ("[grid]\nmu = []", "no value"),
            ("[grid]\nmu = 0.1", "single value"),
            ("[gird]\nmu = [1]", "unknown kind"),
            ("[zip]\na = [1]\nb = [1, 2]", "2 values"),
            ("[grid]\nmu = { from = 0.0, to = 1.0, count = 3, scale = 'log' }", "log range"),
            ("[grid]\nmu = { from = 0.0, to = 1.0 }", "count"),
            ("[sample]\ncount = 3", "seed"),
            ("[sample]\ncount = 3\nseed = 1\nmu = { from = 0.0, to = 1.0, scale = 'log' }", "scale"),
            ("[sample]\ncount = 3\nseed = 1\nmu = 0.1", "draw"),
        ] {
            let issue = expand_text(text).unwrap_err();
            assert!(issue.message.contains(part), "{text}: {issue:?}");
        }
    }
}
