//! Changes of a model's numbers by path: `muscle.triceps.tendon_slack_length`, or `…_scale` for a factor.

use serde::{Deserialize, Serialize};

use std::sync::Arc;

use super::settings::{Complaint, Girdle, Value, describe};
use crate::error::{Issue, nearest};
use crate::model::Model;
use crate::model::file::ModelFile;
use crate::skeleton::file::SkeletonFile;

/// One change of a model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModelChange {
    pub path: String,
    pub value: f64,
}

pub const GROUPS: [&str; 11] = [
    "body",
    "joint",
    "muscle",
    "muscles",
    "force",
    "gravity",
    "curves",
    "surface",
    "coordinate",
    "held_point",
    "abduction",
];

/// Whether a name of a study addresses the model and not a setting.
pub fn is_model_path(name: &str) -> bool {
    GROUPS.contains(&name.split('.').next().unwrap_or(""))
}

/// A path with each entry that has a name under it, and not under its number: one number, one path.
fn canonical(model: &toml::Table, path: &str) -> String {
    let mut place: Option<&toml::Value> = None;
    let mut keys: Vec<String> = Vec::new();
    for key in path.split('.') {
        let (plain, scale) = match place {
            // force.<name>_scale
            Some(toml::Value::Array(_)) => key.strip_suffix("_scale").map_or((key, ""), |plain| (plain, "_scale")),
            _ => (key, ""),
        };
        let next = if keys.is_empty() { model.get(key) } else { place.and_then(|place| child(place, plain)) };
        keys.push(match (place, next) {
            (Some(toml::Value::Array(items)), Some(next)) => {
                let index = items.iter().position(|item| std::ptr::eq(item, next)).expect("one of the items");
                format!("{}{scale}", name_of(index, next))
            }
            _ => key.to_owned(),
        });
        place = next;
    }
    keys.join(".")
}

/// The paths that `path` stands for: itself, or with `*` in it all that fit, in the order of the model file.
///
/// # Errors
/// If nothing fits.
pub fn matching(model: &toml::Table, path: &str) -> Result<Vec<String>, Complaint> {
    if !path.contains('*') {
        return Ok(vec![canonical(model, path)]);
    }
    let keys: Vec<&str> = path.split('.').collect();
    let mut found = vec![(Vec::new(), None::<&toml::Value>)];
    for (depth, key) in keys.iter().enumerate() {
        let pattern = wildmatch::WildMatch::new(key);
        let mut next = Vec::new();
        for (prefix, place) in found {
            let names: Vec<String> = match place {
                None => model.keys().cloned().collect(),
                Some(toml::Value::Table(table)) => table.keys().cloned().collect(),
                Some(toml::Value::Array(items)) => items.iter().enumerate().map(|(i, item)| name_of(i, item)).collect(),
                Some(_) => Vec::new(),
            };
            // The last key may be one that the file leaves to its default, or a factor.
            let fits: Vec<String> = match depth + 1 == keys.len() && !key.contains('*') {
                true => vec![(*key).to_owned()],
                false => names.iter().filter(|name| pattern.matches(name)).cloned().collect(),
            };
            for name in fits {
                let inner = match place {
                    None => model.get(&name),
                    Some(place) => child(place, &name),
                };
                let path: Vec<String> = prefix.iter().cloned().chain([name]).collect();
                next.push((path, inner));
            }
        }
        if next.is_empty() {
            let sofar = keys[..=depth].join(".");
            return Err(Complaint::new(
                format!("nothing in the model fits `{sofar}`"),
                "* stands for any letters of one name, such as muscle.*.tendon_slack_length_scale",
            ));
        }
        found = next;
    }
    Ok(found.into_iter().map(|(path, _)| path.join(".")).collect())
}

fn name_of(index: usize, item: &toml::Value) -> String {
    item.get("name").and_then(toml::Value::as_str).map_or(index.to_string(), str::to_owned)
}

fn child<'t>(place: &'t toml::Value, key: &str) -> Option<&'t toml::Value> {
    match place {
        toml::Value::Table(table) => table.get(key),
        toml::Value::Array(items) => items
            .iter()
            .find(|item| item.get("name").and_then(toml::Value::as_str) == Some(key))
            .or_else(|| key.parse::<usize>().ok().and_then(|i| items.get(i))),
        _ => None,
    }
}

/// The number at a path of the model; `None` for paths that the file leaves to their default.
pub fn number_at(model: &toml::Table, path: &str) -> Option<f64> {
    let mut keys = path.split('.');
    let mut place = model.get(keys.next()?)?;
    for key in keys {
        place = child(place, key)?;
    }
    Value::of(place)?.number()
}

impl ModelChange {
    pub fn new(path: &str, value: &Value) -> Result<Self, Complaint> {
        match value.number() {
            Some(value) if value.is_finite() => Ok(Self { path: path.to_owned(), value: value + 0.0 }), // no −0
            _ => Err(Complaint::new(format!("found {}", describe(value)), "a model's number must be a finite number")),
        }
    }

    /// Whether this multiplies a value instead of setting it.
    pub fn is_factor(&self) -> bool {
        self.path.ends_with("_scale")
    }

    /// Whether the model stays as it is.
    pub fn is_idle(&self, model: &toml::Table) -> bool {
        if self.is_factor() { self.value == 1.0 } else { number_at(model, &self.path) == Some(self.value) }
    }

    /// Changes the model file's table.
    ///
    /// # Errors
    /// If the path leads to no number; the help says where it broke off and what is there.
    pub fn apply(&self, table: &mut toml::Table) -> Result<(), Complaint> {
        let keys: Vec<&str> = self.path.split('.').collect();
        // force.<name>_scale scales force and moment together.
        if let ["force", name] = keys[..]
            && let Some(name) = name.strip_suffix("_scale")
        {
            // One that the motion has over time is scaled by its own factor.
            let place = table.get("force").and_then(|forces| child(forces, name));
            if place.is_some_and(|force| force.get("force").is_none()) {
                let scale = place.and_then(|force| force.get("scale")).and_then(Value::of).and_then(|v| v.number());
                let path = format!("force.{name}.scale");
                return Self { path, value: self.value * scale.unwrap_or(1.0) }.apply(table);
            }
            for key in ["force", "moment"] {
                let change = Self { path: format!("force.{name}.{key}_scale"), value: self.value };
                match change.apply(table) {
                    Err(_) if key == "moment" => {} // not in the file: zero
                    other => other?,
                }
            }
            return Ok(());
        }
        let mut place = toml::Value::Table(std::mem::take(table));
        let result = self.walk(&mut place, &keys);
        if let toml::Value::Table(changed) = place {
            *table = changed;
        }
        result
    }

    fn walk(&self, place: &mut toml::Value, keys: &[&str]) -> Result<(), Complaint> {
        let (key, rest) = keys.split_first().expect("split gives at least one key");
        match place {
            toml::Value::Table(table) => {
                if rest.is_empty() {
                    return self.set(table, key);
                }
                if table.contains_key(*key) {
                    return self.walk(table.get_mut(*key).expect("just found"), rest);
                }
                Err(self.lost(key, table.keys().map(String::as_str)))
            }
            toml::Value::Array(items) => {
                let named = items.iter().position(|item| item.get("name").and_then(toml::Value::as_str) == Some(key));
                let index = named.or_else(|| key.parse().ok().filter(|&i| i < items.len()));
                match index {
                    Some(i) if !rest.is_empty() => self.walk(&mut items[i], rest),
                    Some(i) if is_number(&items[i]) => {
                        items[i] = toml::Value::Float(self.value);
                        Ok(())
                    }
                    Some(_) => Err(Complaint::new(
                        format!("`{}` is no number of the model", self.path),
                        "go on with `.` and the key of a number",
                    )),
                    None => {
                        let names: Vec<String> = items.iter().enumerate().map(|(i, item)| name_of(i, item)).collect();
                        Err(self.lost(key, names.iter().map(String::as_str)))
                    }
                }
            }
            _ => Err(Complaint::new(format!("`{}` goes on after a number", self.path), "shorten the path")),
        }
    }

    fn set(&self, table: &mut toml::Table, key: &str) -> Result<(), Complaint> {
        if let Some(base) = key.strip_suffix("_scale")
            && !table.contains_key(key)
        {
            let value = match table.get_mut(base) {
                Some(value) => value,
                None => return Err(self.lost(base, table.keys().map(String::as_str))),
            };
            return scale(value, self.value).ok_or_else(|| {
                Complaint::new(
                    format!("`{base}` is no number and cannot be scaled"),
                    "scale numbers or lists of numbers",
                )
            });
        }
        match table.get(key) {
            Some(value) if !is_number(value) => {
                Err(Complaint::new(format!("`{}` is no number of the model", self.path), "only numbers can be changed"))
            }
            // A number left to its default in the file may be set; an unknown key fails when the model is checked.
            _ => {
                table.insert(key.to_owned(), toml::Value::Float(self.value));
                Ok(())
            }
        }
    }

    fn lost<'a>(&self, key: &str, there: impl Iterator<Item = &'a str>) -> Complaint {
        let there: Vec<&str> = there.collect();
        let near = nearest(key, there.iter().copied()).map(|n| format!("did you mean `{n}`? ")).unwrap_or_default();
        Complaint::new(
            format!("`{}`: the model has no `{key}` there", self.path),
            format!("{near}there is: {}", there.join(", ")),
        )
    }
}

fn is_number(value: &toml::Value) -> bool {
    matches!(value, toml::Value::Float(_) | toml::Value::Integer(_))
}

fn scale(value: &mut toml::Value, factor: f64) -> Option<()> {
    match value {
        toml::Value::Float(number) => *number *= factor,
        toml::Value::Integer(number) => *value = toml::Value::Float(*number as f64 * factor),
        toml::Value::Array(items) => items.iter_mut().try_for_each(|item| scale(item, factor))?,
        _ => return None,
    }
    Some(())
}

/// The model with these changes made.
///
/// # Errors
/// The first change that leads nowhere, or what is wrong with the changed model.
pub fn changed_model(table: &toml::Table, changes: &[ModelChange], girdle: Girdle) -> Result<Model, Complaint> {
    let mut table = table.clone();
    for change in changes {
        change.apply(&mut table)?;
    }
    let no_file = |e: toml::de::Error| Complaint::new(e.message().to_owned(), "check the path against the model file");
    let wrong = |i: Issue| Complaint::new(format!("{}: {}", i.path.join("."), i.message), i.help.unwrap_or_default());
    if SkeletonFile::is_one(&table) {
        let file: SkeletonFile = table.try_into().map_err(no_file)?;
        let skeleton = file.check().map_err(wrong)?;
        skeleton.check_study().map_err(wrong)?;
        return Ok(Model::of_skeleton(Arc::new(skeleton), girdle.into()));
    }
    let file: ModelFile = table.try_into().map_err(no_file)?;
    file.check().map_err(wrong)
}
