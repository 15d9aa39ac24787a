//! Every key of the files that users write, with its meaning. The keys come from the JSON Schemas, which are generated
//! from the types that read the files and from their doc comments.

use serde_json::Value as Json;

use crate::model::file::ModelFile;
use crate::settings::{Limits, NAMES, Settings, Value};
use crate::skeleton::file::SkeletonFile;
use crate::study::file;
use crate::tables::{Table, Values};

/// A key of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Key {
    /// The table that contains the key, such as `[[muscle]]`; empty at the top of the file.
    pub table: String,
    pub name: String,
    /// The allowed values: a type, a range, or a list of words.
    pub value: String,
    /// Empty where there is none; `required` if the key has to be given.
    pub default: String,
    pub meaning: String,
}

/// Kinds of files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileKind {
    Study,
    PlanarModel,
    SpatialModel,
}

/// The JSON Schema of a kind of file.
pub fn schema(kind: FileKind) -> Json {
    match kind {
        FileKind::Study => file::schema(),
        FileKind::PlanarModel => ModelFile::schema(),
        FileKind::SpatialModel => SkeletonFile::schema(),
    }
}

/// All keys of a kind of file, table by table. For the settings of a study, see [`settings`].
pub fn keys(kind: FileKind) -> Vec<Key> {
    let schema = schema(kind);
    let mut keys = Vec::new();
    add(&mut keys, &schema, &schema, "", 0);
    // Tables of a study whose keys are names that it sets have these besides, or instead.
    let is_name = |key: &Key| kind == FileKind::Study && !key.table.is_empty() && NAMES.contains(&key.name.as_str());
    keys.retain(|key| {
        !is_name(key) || (key.table == "[sweep.sample]" && ["seed", "method"].contains(&key.name.as_str()))
    });
    keys
}

/// What `[base]` and sweeps can set: settings, limits of warnings, changes of the motion, parameters of the model.
pub fn settings() -> Vec<Key> {
    let schema = schemars::schema_for!(Settings).to_value();
    let mut keys = Vec::new();
    add(&mut keys, &schema, &schema, "", 0);
    // Defaults that are no part of a job's identity are not in the schema.
    for key in keys.iter_mut().filter(|key| key.default.is_empty()) {
        key.default = match Settings::default().get(&key.name) {
            Some(Value::Number(number)) => number.to_string(),
            _ => String::new(),
        };
    }
    let limits = schemars::schema_for!(Limits).to_value();
    let mut warn = Vec::new();
    add(&mut warn, &limits, &limits, "", 0);
    keys.extend(warn.into_iter().map(|key| Key {
        name: format!("warn.{}", key.name),
        meaning: format!("limit of a warning: {}", lower_first(&key.meaning)),
        default:
            Settings::default().get(&format!("warn.{}", key.name)).map_or(String::new(), |value| value.to_string()),
        ..key
    }));
    let row = |name: &str, value: &str, default: &str, meaning: &str| Key {
        table: String::new(),
        name: name.to_owned(),
        value: value.to_owned(),
        default: default.to_owned(),
        meaning: meaning.to_owned(),
    };
    keys.extend([
        row("motion.time_scale", "number", "1", "factor on the time of the motion"),
        row(
            "motion.COORDINATE_offset_deg",
            "number",
            "0",
            "offset added to a coordinate of the motion; also `_rad`, `_m`",
        ),
        row("motion.COORDINATE_scale", "number", "1", "factor on a coordinate of the motion"),
        row(
            "motion.TURN_offset_deg",
            "number",
            "0",
            "turns the body of the model's `[[turn]]` called TURN about its axis",
        ),
        row(
            "reserves.COORDINATE",
            "number",
            "that of `reserves`",
            "the reserve at one joint coordinate, N m or N; 0 for none",
        ),
        row(
            "tracking_weight.COORDINATE",
            "number",
            "1",
            "weight of the squared distance of one coordinate that moves by forces from its measured motion",
        ),
        row("force.NAME_scale", "number", "1", "factor on an external force and its moment"),
        row(
            "PATH, PATH_scale",
            "number, text or flag",
            "the model's",
            "any value of the model but names, by path; a number as a value or as a factor",
        ),
    ]);
    keys
}

/// Maximum nesting of tables that are listed.
const MAX_DEPTH: usize = 4;

/// Adds the keys of an object in a schema, and of the tables nested in it.
fn add(keys: &mut Vec<Key>, root: &Json, object: &Json, table: &str, depth: usize) {
    let Some(properties) = object["properties"].as_object() else { return };
    let required = object["required"].as_array().map_or(&[][..], Vec::as_slice);
    let is_required = |name: &String| required.iter().any(|key| key == name);
    let mut inner: Vec<(String, Json)> = Vec::new();
    for (name, property) in properties {
        let within = tables_within(root, property);
        keys.push(Key {
            table: table.to_owned(),
            name: name.clone(),
            value: value_of(root, property),
            default: if is_required(name) { "required".to_owned() } else { default_of(property) },
            meaning: meaning_of(root, property),
        });
        if let Some((is_list, schema)) = within
            && depth < MAX_DEPTH
        {
            let path = [table.trim_matches(['[', ']']), name].join(".");
            let path = path.trim_start_matches('.');
            inner.push((if is_list { format!("[[{path}]]") } else { format!("[{path}]") }, schema));
        }
    }
    for (table, schema) in inner {
        if !keys.iter().any(|key| key.table == table) {
            add(keys, root, &schema, &table, depth + 1);
        }
    }
}

/// Follows a reference, and removes the `null` of optional keys.
fn resolved<'s>(root: &'s Json, schema: &'s Json) -> &'s Json {
    if let Some(path) = schema["$ref"].as_str() {
        return root.pointer(path.trim_start_matches('#')).unwrap_or(schema);
    }
    match schema["anyOf"].as_array().map(Vec::as_slice) {
        Some([one, null]) if null["type"] == "null" => resolved(root, one),
        _ => schema,
    }
}

/// The schema of a key that is a table or a list of tables, and whether it is a list.
fn tables_within(root: &Json, property: &Json) -> Option<(bool, Json)> {
    let schema = resolved(root, property);
    let is_table = |schema: &Json| schema["properties"].is_object();
    if is_table(schema) {
        return Some((false, schema.clone()));
    }
    let items = match schema["anyOf"].as_array() {
        Some(choices) => choices.iter().find(|choice| choice["type"] == "array").map(|list| &list["items"]),
        None => Some(&schema["items"]),
    };
    let item = resolved(root, items?);
    is_table(item).then(|| (true, item.clone()))
}

fn value_of(root: &Json, property: &Json) -> String {
    let schema = resolved(root, property);
    let words: Vec<String> = choices(schema).iter().map(|(word, _)| format!("\"{word}\"")).collect();
    if !words.is_empty() {
        return words.join(", ");
    }
    let forms = forms(schema);
    if !forms.is_empty() {
        return format!("table with one of {}", forms.join(", "));
    }
    let kind = match &schema["type"] {
        Json::Array(kinds) => kinds.iter().find(|kind| *kind != "null").and_then(Json::as_str),
        kind => kind.as_str(),
    };
    let of_items = |plural: &str| match (schema["minItems"].as_u64(), schema["maxItems"].as_u64()) {
        (Some(least), Some(most)) if least == most => format!("{least} {plural}"),
        _ => format!("list of {plural}"),
    };
    match kind {
        Some("string") => "text".to_owned(),
        Some("boolean") => "true or false".to_owned(),
        Some(kind @ ("number" | "integer")) => {
            let name = if kind == "integer" { "whole number" } else { "number" };
            match (schema["minimum"].as_f64(), schema["maximum"].as_f64()) {
                (Some(least), Some(most)) => format!("{name}, {least} to {most}"),
                (Some(least), None) => format!("{name}, at least {least}"),
                _ => name.to_owned(),
            }
        }
        Some("array") => {
            let item = resolved(root, &schema["items"]);
            match item["type"].as_str() {
                Some("number") => of_items("numbers"),
                Some("integer") => of_items("whole numbers"),
                Some("string") => of_items("strings"),
                Some("array") => "list of points".to_owned(),
                _ => "tables".to_owned(),
            }
        }
        Some("object") => "table".to_owned(),
        _ if schema["oneOf"].is_array() || schema["anyOf"].is_array() => "one value, or a list".to_owned(),
        _ => String::new(),
    }
}

/// The keys of which a table has exactly one, if it is such a table.
fn forms(schema: &Json) -> Vec<String> {
    let form = |choice: &Json| {
        let mut keys = choice["properties"].as_object()?.keys();
        let key = keys.next().filter(|_| keys.len() == 0)?;
        Some(format!("`{key}`"))
    };
    schema["oneOf"].as_array().map_or_else(Vec::new, |choices| choices.iter().filter_map(form).collect())
}

/// The allowed words of a key, with their meanings.
fn choices(schema: &Json) -> Vec<(String, String)> {
    let one = |choice: &Json| -> Vec<(String, String)> {
        let meaning = choice["description"].as_str().unwrap_or_default().replace('\n', " ");
        let words = choice["enum"].as_array().cloned().unwrap_or_else(|| vec![choice["const"].clone()]);
        words.iter().filter_map(|word| Some((word.as_str()?.to_owned(), meaning.clone()))).collect()
    };
    match schema["oneOf"].as_array() {
        Some(all) => all.iter().flat_map(one).collect(),
        None => one(&serde_json::json!({ "enum": schema["enum"] })),
    }
}

fn default_of(property: &Json) -> String {
    match &property["default"] {
        Json::Null => String::new(),
        Json::String(text) => format!("\"{text}\""),
        Json::Array(items) if items.is_empty() => String::new(),
        Json::Object(_) => String::new(),
        Json::Number(number) => number.as_f64().map_or_else(|| number.to_string(), |number| number.to_string()),
        other => other.to_string(),
    }
}

/// The meaning of a key: its own description, or else that of its type, and the meanings of the allowed words.
fn meaning_of(root: &Json, property: &Json) -> String {
    let schema = resolved(root, property);
    let own = property["description"].as_str().or_else(|| schema["description"].as_str()).unwrap_or_default();
    let mut meaning = own.replace('\n', " ");
    let words: Vec<String> = (choices(schema).into_iter())
        .filter(|(_, about)| !about.is_empty())
        .map(|(word, about)| format!("`{word}`: {}", about.trim_end_matches('.')))
        .collect();
    if !words.is_empty() {
        meaning = format!("{}. {}", meaning.trim_end_matches('.'), words.join("; "));
    }
    meaning
}

fn lower_first(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_lowercase().chain(letters).collect())
}

/// Keys as a printable table. `with_table` adds the column `in`, for files with several tables.
pub fn table(keys: &[Key], with_table: bool) -> Table {
    let column = |name: &str, of: fn(&Key) -> &String| {
        (name.to_owned(), Values::Text(keys.iter().map(|key| Some(of(key).clone())).collect()))
    };
    let mut columns = Vec::new();
    if with_table {
        columns.push(column("in", |key| &key.table));
    }
    columns.extend([
        column("key", |key| &key.name),
        column("default", |key| &key.default),
        column("value", |key| &key.value),
        column("meaning", |key| &key.meaning),
    ]);
    Table { name: "keys", columns }
}
