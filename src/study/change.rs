//! Changes values of a model by path: `muscle.triceps.tendon_slack_length`, or `…_scale` for a factor, or
//! `body.scapula.role`.

use serde::{Deserialize, Serialize};

use std::sync::Arc;

use crate::error::{Issue, nearest};
use crate::model::Model;
use crate::model::file::ModelFile;
use crate::settings::{InvalidValue, Value, describe};
use crate::skeleton::file::SkeletonFile;

/// One change of a model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModelChange {
    pub path: String,
    pub value: Value,
}

/// Tables of numbers that all have defaults.
const OPTIONAL_TABLES: [&str; 2] = ["curves", "muscles"];

/// Top-level keys of model files whose numbers a study may change.
pub const GROUPS: [&str; 13] = [
    "actuator",
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
    "passive",
    "turn",
];

/// Whether a name in a study refers to the model rather than to a setting.
pub fn is_model_path(name: &str) -> bool {
    GROUPS.contains(&name.split('.').next().unwrap_or(""))
}

/// The canonical form of a path: list entries by name where they have one, not by index, so that each number has
/// exactly one path.
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

/// The paths that `path` stands for: itself, or all that match if it contains `*` or `,`, in the order of the model file.
///
/// # Errors
/// If nothing matches.
pub fn matching(model: &toml::Table, path: &str) -> Result<Vec<String>, InvalidValue> {
    if !path.contains(['*', ',']) {
        return Ok(vec![canonical(model, path)]);
    }
    let keys: Vec<&str> = path.split('.').collect();
    let mut found = vec![(Vec::new(), None::<&toml::Value>)];
    for (depth, key) in keys.iter().enumerate() {
        let patterns: Vec<wildmatch::WildMatch> = key.split(',').map(wildmatch::WildMatch::new).collect();
        let mut next = Vec::new();
        for (prefix, place) in found {
            let names: Vec<String> = match place {
                None => model.keys().cloned().collect(),
                Some(toml::Value::Table(table)) => table.keys().cloned().collect(),
                Some(toml::Value::Array(items)) => items.iter().enumerate().map(|(i, item)| name_of(i, item)).collect(),
                Some(_) => Vec::new(),
            };
            // The last key may be a factor, or a key that the file omits because it keeps the default.
            let fits: Vec<String> = match depth + 1 == keys.len() && !key.contains(['*', ',']) {
                true => vec![(*key).to_owned()],
                false => names.iter().filter(|name| patterns.iter().any(|p| p.matches(name))).cloned().collect(),
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
            let beginning = keys[..=depth].join(".");
            return Err(InvalidValue::new(
                format!("nothing in the model matches `{beginning}`"),
                "* matches any characters of one name, as in muscle.*.tendon_slack_length_scale; a comma separates names",
            ));
        }
        found = next;
    }
    Ok(found.into_iter().map(|(path, _)| path.join(".")).collect())
}

/// The name of a list entry, or its index if it has none.
fn name_of(index: usize, item: &toml::Value) -> String {
    item.get("name").and_then(toml::Value::as_str).map_or(index.to_string(), str::to_owned)
}

/// What a table or list contains under a key, name or index.
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

/// The number at a path of the model; `None` if the file omits it.
pub fn number_at(model: &toml::Table, path: &str) -> Option<f64> {
    value_at(model, path)?.number()
}

/// The value at a path of the model; `None` if the file omits it.
pub fn value_at(model: &toml::Table, path: &str) -> Option<Value> {
    let mut keys = path.split('.');
    let mut place = model.get(keys.next()?)?;
    for key in keys {
        place = child(place, key)?;
    }
    Value::of(place)
}

impl ModelChange {
    /// # Errors
    /// As [`ModelChange::check`].
    pub fn new(model: &toml::Table, path: &str, value: &Value) -> Result<Self, InvalidValue> {
        Self::check(model, path, value)?;
        let value = value.number().map_or_else(|| value.clone(), |number| Value::Number(number + 0.0)); // no −0
        Ok(Self { path: path.to_owned(), value })
    }

    /// Checks that a value is of the kind of the one in the model.
    ///
    /// # Errors
    /// If it is not, or not finite.
    pub fn check(model: &toml::Table, path: &str, value: &Value) -> Result<(), InvalidValue> {
        if path.ends_with(".name") || path.ends_with(".coordinate") {
            let help = "paths and motions address parts by these: change them in the model file";
            return Err(InvalidValue::new(format!("`{path}` is a name"), help));
        }
        let own = if path.ends_with("_scale") { Some(Value::Number(1.0)) } else { value_at(model, path) };
        let fits = match (value, &own) {
            (Value::Integer(_) | Value::Number(_), None | Some(Value::Integer(_) | Value::Number(_))) => {
                value.number().is_some_and(f64::is_finite)
            }
            (Value::Text(_), None | Some(Value::Text(_))) | (Value::Flag(_), None | Some(Value::Flag(_))) => true,
            _ => false,
        };
        let help = match own {
            Some(Value::Text(own)) => format!("give a text, such as \"{own}\""),
            Some(Value::Flag(_)) => "it must be true or false".to_owned(),
            _ => "give a finite number".to_owned(),
        };
        if fits { Ok(()) } else { Err(InvalidValue::new(format!("found {}", describe(value)), help)) }
    }

    /// Whether this multiplies a value instead of setting it.
    pub fn is_factor(&self) -> bool {
        self.path.ends_with("_scale")
    }

    /// Whether the change leaves the model as it is.
    pub fn has_no_effect(&self, model: &toml::Table) -> bool {
        match self.value.number() {
            Some(number) if self.is_factor() => number == 1.0,
            Some(number) => number_at(model, &self.path) == Some(number),
            None => value_at(model, &self.path).as_ref() == Some(&self.value),
        }
    }

    /// Applies the change to the table of the model file.
    ///
    /// # Errors
    /// If the path does not lead to a number. The help says where it fails and which keys are there.
    pub fn apply(&self, table: &mut toml::Table) -> Result<(), InvalidValue> {
        let factor = self.value.number().unwrap_or(1.0);
        let keys: Vec<&str> = self.path.split('.').collect();
        // force.<name>_scale scales force and moment together.
        if let ["force", name] = keys[..]
            && let Some(name) = name.strip_suffix("_scale")
        {
            // A force that the motion gives over time is scaled by its factor `scale`.
            let place = table.get("force").and_then(|forces| child(forces, name));
            if place.is_some_and(|force| force.get("force").is_none()) {
                let scale = place.and_then(|force| force.get("scale")).and_then(Value::of).and_then(|v| v.number());
                let path = format!("force.{name}.scale");
                return Self { path, value: Value::Number(factor * scale.unwrap_or(1.0)) }.apply(table);
            }
            for key in ["force", "moment"] {
                let change = Self { path: format!("force.{name}.{key}_scale"), value: Value::Number(factor) };
                match change.apply(table) {
                    Err(_) if key == "moment" => {} // zero if not in the file
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

    fn walk(&self, place: &mut toml::Value, keys: &[&str]) -> Result<(), InvalidValue> {
        let (key, rest) = keys.split_first().expect("split gives at least one key");
        match place {
            toml::Value::Table(table) => {
                if rest.is_empty() {
                    return self.set(table, key);
                }
                // A file may leave a whole table of these to the defaults.
                if OPTIONAL_TABLES.contains(key) && self.path.starts_with(key) {
                    table.entry(*key).or_insert_with(|| toml::Value::Table(toml::Table::new()));
                }
                if table.contains_key(*key) {
                    return self.walk(table.get_mut(*key).expect("just found"), rest);
                }
                Err(self.no_such_key(key, table.keys().map(String::as_str)))
            }
            toml::Value::Array(items) => {
                let named = items.iter().position(|item| item.get("name").and_then(toml::Value::as_str) == Some(key));
                let index = named.or_else(|| key.parse().ok().filter(|&i| i < items.len()));
                match index {
                    Some(i) if !rest.is_empty() => self.walk(&mut items[i], rest),
                    Some(i) if is_number(&items[i]) => {
                        items[i] = self.toml();
                        Ok(())
                    }
                    Some(_) => Err(InvalidValue::new(
                        format!("`{}` is not a numeric parameter of the model", self.path),
                        "continue the path with `.` and the key of a number",
                    )),
                    None => {
                        let names: Vec<String> = items.iter().enumerate().map(|(i, item)| name_of(i, item)).collect();
                        Err(self.no_such_key(key, names.iter().map(String::as_str)))
                    }
                }
            }
            _ => Err(InvalidValue::new(format!("`{}` continues past a value", self.path), "shorten the path")),
        }
    }

    fn set(&self, table: &mut toml::Table, key: &str) -> Result<(), InvalidValue> {
        if let Some(base) = key.strip_suffix("_scale")
            && !table.contains_key(key)
        {
            let value = match table.get_mut(base) {
                Some(value) => value,
                None => return Err(self.no_such_key(base, table.keys().map(String::as_str))),
            };
            return scale(value, self.value.number().unwrap_or(1.0)).ok_or_else(|| {
                InvalidValue::new(
                    format!("`{base}` is not a number and cannot be scaled"),
                    "only numbers and lists of numbers can be scaled",
                )
            });
        }
        match table.get(key) {
            Some(value) if Value::of(value).is_none() => Err(InvalidValue::new(
                format!("`{}` is a list or a table", self.path),
                "continue the path to a single value",
            )),
            // A value that the file omits may be set; an unknown key fails when the model is checked.
            _ => {
                table.insert(key.to_owned(), self.toml());
                Ok(())
            }
        }
    }

    fn toml(&self) -> toml::Value {
        match &self.value {
            Value::Text(text) => toml::Value::String(text.clone()),
            Value::Flag(flag) => toml::Value::Boolean(*flag),
            number => toml::Value::Float(number.number().unwrap_or(f64::NAN)),
        }
    }

    fn no_such_key<'a>(&self, key: &str, present: impl Iterator<Item = &'a str>) -> InvalidValue {
        let present: Vec<&str> = present.collect();
        let near = nearest(key, present.iter().copied()).map(|n| format!("did you mean `{n}`? ")).unwrap_or_default();
        InvalidValue::new(
            format!("`{}`: the model has no `{key}` there", self.path),
            format!("{near}available: {}", present.join(", ")),
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

/// The model with these changes applied.
///
/// # Errors
/// The first change that cannot be applied, or why the changed model is invalid.
pub fn changed_model(table: &toml::Table, changes: &[ModelChange]) -> Result<Model, InvalidValue> {
    let mut table = table.clone();
    for change in changes {
        change.apply(&mut table)?;
    }
    let unreadable =
        |e: toml::de::Error| InvalidValue::new(e.message().to_owned(), "check the path against the model file");
    let invalid =
        |i: Issue| InvalidValue::new(format!("{}: {}", i.path.join("."), i.message), i.help.unwrap_or_default());
    if SkeletonFile::is_spatial(&table) {
        let file: SkeletonFile = table.try_into().map_err(unreadable)?;
        let skeleton = file.check().map_err(invalid)?;
        skeleton.check_study().map_err(invalid)?;
        return Ok(Model::of_skeleton(Arc::new(skeleton)));
    }
    let file: ModelFile = table.try_into().map_err(unreadable)?;
    file.check().map_err(invalid)
}
