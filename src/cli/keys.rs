//! `sinew keys`: lists what a study can set and sweep: settings, or the numeric parameters of a model.

use std::path::Path;

use indexmap::IndexMap;

use super::arguments::{Format, Look};
use super::layout::print_definition;
use super::output::print_table;
use super::show::jobs::short;
use super::{GOOD, print};
use crate::error::{Error, Result, SourceFile};
use crate::reference::{self, FileKind, Key};
use crate::study::change::GROUPS;
use crate::study::{is_spatial, load_model, load_skeleton};
use crate::tables::{Table, Values, axis_unit};
use crate::terminal::heading;

/// Lists the settings, or the numeric parameters of `model`: one row per kind, or all keys that match `pattern`.
pub fn keys(model: Option<&Path>, pattern: Option<&str>, look: Look) -> Result<u8> {
    let Some(path) = model else {
        list_settings(look)?;
        return Ok(GOOD);
    };
    let file = SourceFile::read(path)?;
    let numbers = numbers(&file)?;
    let listed = match pattern {
        None => by_kind(&numbers),
        Some(pattern) => {
            let wild = wildmatch::WildMatch::new(pattern);
            let matching: Vec<&(String, f64)> = numbers.iter().filter(|(key, _)| wild.matches(key)).collect();
            if matching.is_empty() {
                let near = numbers.iter().find(|(key, _)| key.split('.').nth(1) == pattern.rsplit('.').next());
                let near = near.and_then(|(key, _)| key.split('.').next());
                let name = pattern.rsplit('.').next().unwrap_or_default();
                let near = near.map(|group| format!("did you mean '{group}.{name}.*'? ")).unwrap_or_default();
                let path = path.display();
                let reason = format!("no key matches `{pattern}`; {near}`sinew keys {path}` lists all kinds of keys");
                return Err(Error::table("list keys of", file.path.as_path(), reason));
            }
            one_by_one(&matching)
        }
    };
    print_table(&listed, look)?;
    if look.format == Format::Table && pattern.is_none() {
        print("");
        let path = path.display();
        print_definition(
            "",
            &format!(
                "A study can set each of these; with the suffix _scale, a factor on those that the model file gives. \
                 `sinew keys {path} 'muscle.*.path.*'` lists all keys that match the pattern."
            ),
        );
        print_definition("", "`sinew keys` without a model lists the settings and the changes of the motion.");
    }
    Ok(GOOD)
}

fn list_settings(look: Look) -> Result<()> {
    let keys = reference::settings();
    if look.format != Format::Table {
        return print_table(&reference::table(&keys, false), look);
    }
    print(&heading("Settings for [base] and sweeps (for the parameters of a model: sinew keys MODEL)"));
    for Key { name, value, default, meaning, .. } in &keys {
        let default = if default.is_empty() { String::new() } else { format!(" = {default}") };
        // The meaning already lists the allowed words.
        let value = if value.contains('"') { String::new() } else { format!(" ({value})") };
        print_definition(&format!("  {name}{default}"), &format!("{meaning}{value}"));
    }
    Ok(())
}

/// Every numeric parameter of a model that a study can set, by path and including defaults; then the changes of the
/// motion, with their neutral values.
fn numbers(file: &SourceFile) -> Result<Vec<(String, f64)>> {
    let is_spatial = is_spatial(file);
    let mut turns = Vec::new();
    let (table, coordinates): (_, Vec<(String, bool)>) = if is_spatial {
        let (table, skeleton) = load_skeleton(file)?;
        let free = skeleton.coordinates.iter().filter(|c| c.is_independent());
        turns.extend(skeleton.turns.iter().map(|turn| (format!("motion.{}_offset_deg", turn.name), 0.0)));
        (table, free.map(|c| (c.name.clone(), c.is_angle)).collect())
    } else {
        let (table, model) = load_model(file)?;
        let named = |(name, is_angle): (&str, bool)| (name.to_owned(), is_angle);
        let coordinates = model.mechanics.joint_coordinates().into_iter().map(named).collect();
        (table, coordinates)
    };
    let kind = if is_spatial { FileKind::SpatialModel } else { FileKind::PlanarModel };
    let mut found = Vec::new();
    for (name, value) in table.iter().filter(|(name, _)| GROUPS.contains(&name.as_str())) {
        collect(name, value, &mut found);
    }
    found.extend(defaults(kind, &table));
    found.sort_by_key(|(key, _)| GROUPS.iter().position(|group| key.split('.').next() == Some(group)));
    for (name, is_angle) in coordinates {
        let unit = if is_angle { "deg" } else { "m" };
        found.extend([(format!("motion.{name}_offset_{unit}"), 0.0), (format!("motion.{name}_scale"), 1.0)]);
    }
    found.extend(turns);
    Ok(found)
}

/// Collects all numbers in a value, by path. List entries are addressed by name, or by index if they have no name.
fn collect(path: &str, value: &toml::Value, found: &mut Vec<(String, f64)>) {
    match value {
        toml::Value::Integer(number) => found.push((path.to_owned(), *number as f64)),
        toml::Value::Float(number) => found.push((path.to_owned(), *number)),
        toml::Value::Table(table) => {
            table.iter().for_each(|(name, value)| collect(&format!("{path}.{name}"), value, found));
        }
        toml::Value::Array(items) => {
            for (index, item) in items.iter().enumerate() {
                let name = item.get("name").and_then(toml::Value::as_str).map_or(index.to_string(), str::to_owned);
                collect(&format!("{path}.{name}"), item, found);
            }
        }
        _ => {}
    }
}

/// Parameters of tables and of list entries that the file does not set, with their defaults.
fn defaults(kind: FileKind, model: &toml::Table) -> Vec<(String, f64)> {
    let mut found = Vec::new();
    for key in reference::keys(kind) {
        let (Ok(default), table) = (key.default.parse::<f64>(), key.table.trim_matches(['[', ']'])) else { continue };
        if !GROUPS.contains(&table) {
            continue;
        }
        match model.get(table) {
            Some(toml::Value::Array(entries)) => {
                for entry in entries.iter().filter(|entry| entry.get(&key.name).is_none()) {
                    if let Some(name) = entry.get("name").and_then(toml::Value::as_str) {
                        found.push((format!("{table}.{name}.{}", key.name), default));
                    }
                }
            }
            Some(set) if set.get(&key.name).is_some() => {}
            _ if key.table.starts_with("[[") => {}
            _ => found.push((format!("{table}.{}", key.name), default)),
        }
    }
    found
}

/// One row for all keys that differ only in names and indices, as a pattern that a study can use.
fn by_kind(numbers: &[(String, f64)]) -> Table {
    let mut kinds: IndexMap<String, Vec<f64>> = IndexMap::new();
    for (key, value) in numbers {
        let parts: Vec<&str> = key.split('.').collect();
        let is_named = parts.len() > 2 && parts[0] != "muscles" && parts[0] != "curves";
        let general = |(place, part): (usize, &&str)| {
            let is_index = place > 1 && part.bytes().all(|b| b.is_ascii_digit());
            if (place == 1 && is_named) || is_index { "*".to_owned() } else { (*part).to_owned() }
        };
        let kind = parts.iter().enumerate().map(general).collect::<Vec<String>>().join(".");
        kinds.entry(kind).or_default().push(*value);
    }
    let texts = |of: &dyn Fn(&str, &[f64]) -> String| {
        Values::Text(kinds.iter().map(|(key, values)| Some(of(key, values))).collect())
    };
    let range = |values: &[f64]| {
        let (low, high) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), &v| (l.min(v), h.max(v)));
        let [low, high] = [low, high].map(|number| short(&number.to_string()));
        if low == high { low } else { format!("{low} to {high}") }
    };
    let columns = vec![
        ("key".to_owned(), texts(&|key, _| key.to_owned())),
        ("value".to_owned(), texts(&|_, values| range(values))),
        ("unit".to_owned(), texts(&|key, _| axis_unit(key).to_owned())),
        ("numbers".to_owned(), Values::Integer(kinds.values().map(|values| Some(values.len() as i64)).collect())),
    ];
    Table { name: "keys", columns }
}

fn one_by_one(numbers: &[&(String, f64)]) -> Table {
    let columns = vec![
        ("key".to_owned(), Values::Text(numbers.iter().map(|(key, _)| Some(key.clone())).collect())),
        ("value".to_owned(), Values::Number(numbers.iter().map(|(_, value)| Some(*value)).collect())),
        ("unit".to_owned(), Values::Text(numbers.iter().map(|(key, _)| Some(axis_unit(key).to_owned())).collect())),
    ];
    Table { name: "keys", columns }
}
