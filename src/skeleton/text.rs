//! Writes a spatial model as a TOML file that people can read and edit.

use toml::{Table, Value};

use super::file::SkeletonFile;

/// Maximum length of a line, bytes. Longer arrays of tables are written with one item per line.
const WIDTH: usize = 120;

/// The model as TOML, without default values. `comment` goes first, each line prefixed with `#`.
pub fn text(file: &SkeletonFile, comment: &str) -> String {
    let table = Table::try_from(file).expect("a model is plain data");
    let mut out: String = comment.lines().map(|line| format!("# {line}").trim_end().to_owned() + "\n").collect();
    let (entries, plain): (Vec<_>, Vec<_>) = table.iter().partition(|(_, value)| is_entries(value));
    for (key, value) in plain.iter().filter(|(_, value)| !value.is_table()) {
        out.push_str(&line(key, value));
    }
    for (key, value) in plain {
        if let Value::Table(table) = value {
            out.push_str(&format!("\n[{key}]\n"));
            table.iter().for_each(|(key, value)| out.push_str(&line(key, value)));
        }
    }
    for (key, value) in entries {
        for entry in value.as_array().into_iter().flatten().filter_map(Value::as_table) {
            out.push_str(&format!("\n[[{key}]]\n"));
            let written = entry.iter().filter(|(key, value)| !is_default(key, value));
            written.for_each(|(key, value)| out.push_str(&line(key, value)));
        }
    }
    out
}

/// True for an array of tables (`[[key]]`), also an empty one.
fn is_entries(value: &Value) -> bool {
    value.as_array().is_some_and(|items| items.first().is_none_or(Value::is_table))
}

fn line(key: &str, value: &Value) -> String {
    let value = tidy(value);
    let short = format!("{key} = {value}\n");
    match &value {
        Value::Array(items) if short.len() > WIDTH && items.iter().any(|item| !item.is_float()) => {
            let items: String = items.iter().map(|item| format!("    {item},\n")).collect();
            format!("{key} = [\n{items}]\n")
        }
        _ => short,
    }
}

/// Removes default values at any depth.
fn tidy(value: &Value) -> Value {
    match value {
        Value::Table(table) => {
            let kept = table.iter().filter(|(key, value)| !is_default(key, value));
            Value::Table(kept.map(|(key, value)| (key.clone(), tidy(value))).collect())
        }
        Value::Array(items) => Value::Array(items.iter().map(tidy).collect()),
        other => other.clone(),
    }
}

fn is_default(key: &str, value: &Value) -> bool {
    let zero = |value: &Value| value.as_float() == Some(0.0);
    match (key, value) {
        (
            "parent_point" | "parent_rotation" | "child_point" | "child_rotation" | "point" | "rotation",
            Value::Array(x),
        ) => x.iter().all(zero),
        ("default" | "pennation_angle", value) => zero(value),
        ("role", value) => value.as_str() == Some("free"),
        ("scale", value) => value.as_float() == Some(1.0),
        (_, Value::Boolean(value)) => !value,
        (_, Value::Array(items)) => items.is_empty(),
        _ => false,
    }
}
