//! The types of a study file. Serde reads them, and the JSON Schema for editors is generated from them.

use std::fmt;

use indexmap::IndexMap;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{Deserializer, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Serialize};

use super::change::GROUPS;
use crate::settings::{Settings, Value};

/// A Sinew study: a sweep over an inverse musculoskeletal problem.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Sinew study")]
pub struct StudyFile {
    /// Name of the study and of its results folder: letters, digits, -, _ and . only.
    #[schemars(regex(pattern = r"^[^.][\w.-]*$"))]
    pub name: String,
    /// A short description for readers of the results.
    #[serde(default)]
    pub description: String,
    /// Model file, relative to this file.
    pub model: String,
    /// Motion file (.csv, .mot, .sto), relative to this file.
    pub motion: String,
    /// File of external loads, such as ground reactions (.xml of OpenSim, .toml), relative to this file.
    pub loads: Option<String>,
    /// Cut-off frequency of the zero-lag Butterworth low-pass filter of external loads, Hz; 0 for no filter.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 1e6))]
    pub force_smoothing_hz: f64,
    /// Start and end of the part of the motion to solve, s; the whole motion if absent.
    pub window: Option<[f64; 2]>,
    /// The muscles to keep, by name; * matches any characters. All if absent.
    pub muscles: Option<OneOrMany<String>>,
    /// Fixed values.
    #[serde(default)]
    #[schemars(with = "FixedValues")]
    pub base: toml::Table,
    /// What varies. Several sweeps, as [[sweep]], follow one another; repeated jobs are omitted.
    #[serde(default)]
    pub sweep: OneOrMany<Sweep>,
    /// Load ratios to report.
    #[serde(default)]
    pub ratio: Vec<Ratio>,
    /// What to do when a job fails.
    #[serde(default)]
    pub on_failure: OnFailure,
    /// Numbers of the model whose values in the study may be more than ten times larger or smaller than the model's.
    #[serde(default)]
    pub confirm: Vec<String>,
}

/// Axes of several kinds, which multiply.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sweep {
    /// Seeded samples.
    pub sample: Option<Sample>,
    /// Named sweeps, which multiply with one another.
    #[serde(default)]
    #[schemars(with = "std::collections::BTreeMap<String, Sweep>")]
    pub group: IndexMap<String, Sweep>,
    /// Explicit jobs, one table each.
    #[serde(default)]
    #[schemars(with = "Jobs")]
    pub list: Vec<toml::Table>,
    /// Every combination; the first axis varies slowest.
    #[serde(default)]
    #[schemars(with = "Axes")]
    pub grid: Option<toml::Table>,
    /// The base, and each value of each axis on its own.
    #[serde(default)]
    #[schemars(with = "Axes")]
    pub star: Option<toml::Table>,
    /// Axes that vary together, all of the same length.
    #[serde(default)]
    #[schemars(with = "Axes")]
    pub zip: Option<toml::Table>,
    /// Keep only jobs that match all keys of one of these.
    #[serde(default)]
    #[schemars(with = "Conditions")]
    pub when: Vec<toml::Table>,
    /// Omit jobs that match all keys of one of these.
    #[serde(default)]
    #[schemars(with = "Conditions")]
    pub exclude: Vec<toml::Table>,
}

/// Seeded samples: each draws a value of every parameter from a range or a list.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[schemars(extend("additionalProperties" = false))]
pub struct Sample {
    /// Number of samples.
    #[schemars(range(min = 1, max = 1_000_000))]
    pub count: usize,
    /// Seed of the draws.
    #[schemars(range(min = 0))]
    pub seed: u64,
    /// How samples fill the space.
    #[serde(default)]
    pub method: Method,
    #[serde(flatten)]
    #[schemars(schema_with = "draws")]
    pub draws: toml::Table,
}

/// How samples fill the space.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Independent and uniform.
    #[default]
    Random,
    /// One sample in each of `count` equal parts of each range.
    LatinHypercube,
    /// Owen-scrambled Sobol' points: evenly spread in every projection.
    Sobol,
}

/// A load ratio: numerator over denominator, each a sum over one or more muscles.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Ratio {
    /// Name of the ratio.
    pub name: String,
    /// One or more muscles; * matches any characters.
    pub numerator: OneOrMany<String>,
    /// One or more muscles, as in the numerator.
    pub denominator: OneOrMany<String>,
    /// Measures to take the ratio of: `mean_force`, `peak_force`, `impulse`, `activation`.
    #[serde(default = "mean_force")]
    pub measure: OneOrMany<Measure>,
}

fn mean_force() -> OneOrMany<Measure> {
    OneOrMany(vec![Measure::MeanForce])
}

/// The quantity whose ratio is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Measure {
    MeanForce,
    /// For several muscles, the sum of their peaks.
    PeakForce,
    Impulse,
    /// Mean activation; for several muscles, the mean of their means.
    Activation,
}

impl Measure {
    pub fn name(self) -> &'static str {
        match self {
            Measure::MeanForce => "mean_force",
            Measure::PeakForce => "peak_force",
            Measure::Impulse => "impulse",
            Measure::Activation => "activation",
        }
    }
}

/// What a run does when a job fails.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum OnFailure {
    /// Record it as a row with a status and the reason, and continue with the others.
    #[default]
    Record,
    /// Start no further jobs.
    Stop,
    /// When all others are done, try again by continuation, in steps from the nearest solved job.
    Retry,
}

/// One item, or a list of items.
#[derive(Clone, Debug, PartialEq)]
pub struct OneOrMany<T>(pub Vec<T>);

impl<T> Default for OneOrMany<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<T: Serialize> Serialize for OneOrMany<T> {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.0.serialize(serializer)
    }
}

// Implemented by hand: an untagged enum would lose the place and cause of an error inside.
impl<'de, T: Deserialize<'de>> Deserialize<'de> for OneOrMany<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Either<T>(std::marker::PhantomData<T>);
        impl<'de, T: Deserialize<'de>> Visitor<'de> for Either<T> {
            type Value = OneOrMany<T>;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("one item or a list of items")
            }
            fn visit_str<E: serde::de::Error>(self, text: &str) -> Result<Self::Value, E> {
                T::deserialize(serde::de::value::StrDeserializer::new(text)).map(|one| OneOrMany(vec![one]))
            }
            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Self::Value, A::Error> {
                T::deserialize(MapAccessDeserializer::new(map)).map(|one| OneOrMany(vec![one]))
            }
            fn visit_seq<A: SeqAccess<'de>>(self, items: A) -> Result<Self::Value, A::Error> {
                Vec::deserialize(SeqAccessDeserializer::new(items)).map(OneOrMany)
            }
        }
        deserializer.deserialize_any(Either(std::marker::PhantomData))
    }
}

impl<T: JsonSchema> JsonSchema for OneOrMany<T> {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        format!("OneOrMany{}", T::schema_name()).into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let one = generator.subschema_for::<T>();
        json_schema!({ "anyOf": [one, { "type": "array", "items": one }] })
    }
}

/// Types for the schemas of tables whose keys are names that a study may set.
macro_rules! tables_of_names {
    ($($name:ident = $schema:ident),+) => {
        $(
            struct $name;
            impl JsonSchema for $name {
                fn schema_name() -> std::borrow::Cow<'static, str> {
                    stringify!($name).into()
                }
                fn json_schema(generator: &mut SchemaGenerator) -> Schema {
                    $schema(generator)
                }
            }
        )+
    };
}

tables_of_names!(FixedValues = fixed_values, Jobs = jobs, Axes = axes, Conditions = conditions);

/// The JSON Schema of a study file, for editors.
pub fn schema() -> serde_json::Value {
    schemars::schema_for!(StudyFile).to_value()
}

/// Schema of a table with every name that a study may set; `of` turns the schema of a value into that of its entry.
fn names(generator: &mut SchemaGenerator, of: impl Fn(&serde_json::Value) -> serde_json::Value) -> Schema {
    let settings = Settings::json_schema(generator).to_value();
    let mut properties = serde_json::Map::new();
    for (name, value) in settings["properties"].as_object().expect("settings are a struct") {
        let mut value = value.clone();
        let about = value.as_object_mut().map(|v| {
            v.remove("default");
            v.remove("description")
        });
        let mut property = of(&value);
        if let (Some(Some(about)), Some(property)) = (about, property.as_object_mut()) {
            property.insert("description".to_owned(), about);
        }
        properties.insert(name.clone(), property);
    }
    let number = of(&serde_json::json!({ "type": "number" }));
    // Roles and flags of a model, too.
    let any = of(&serde_json::json!({ "type": ["number", "string", "boolean"] }));
    let pattern = format!(r"^({})\..+$", GROUPS.join("|"));
    json_schema!({
        "type": "object",
        "properties": properties,
        "patternProperties": { pattern: any, r"^(motion|reserves|tracking_weight)\..+$": number },
        "additionalProperties": false,
    })
}

fn fixed_values(generator: &mut SchemaGenerator) -> Schema {
    let mut schema = names(generator, serde_json::Value::clone);
    // A path may be written as one quoted key or as nested tables.
    let pattern = format!("^({}|motion|tracking_weight)$", GROUPS.join("|"));
    if let Some(patterns) = schema.get_mut("patternProperties").and_then(serde_json::Value::as_object_mut) {
        patterns.insert(pattern, serde_json::json!({ "type": "object" }));
    }
    let properties = schema.get_mut("properties").and_then(serde_json::Value::as_object_mut);
    if let Some(reserves) = properties.and_then(|properties| properties.get_mut("reserves")) {
        *reserves = serde_json::json!({ "anyOf": [reserves.take(), { "type": "object" }] });
    }
    schema
}

fn jobs(generator: &mut SchemaGenerator) -> Schema {
    let job = names(generator, serde_json::Value::clone);
    json_schema!({ "type": "array", "items": job, "minItems": 1 })
}

fn range(keys: &[&str], required: &[&str]) -> serde_json::Value {
    let kind = |key: &str| match key {
        "count" => serde_json::json!({ "type": "integer", "minimum": 1, "maximum": 1_000_000 }),
        "scale" => serde_json::json!({ "enum": ["linear", "log"] }),
        _ => serde_json::json!({ "type": "number" }),
    };
    let properties: serde_json::Map<_, _> = keys.iter().map(|key| ((*key).to_owned(), kind(key))).collect();
    serde_json::json!({
        "type": "object",
        "properties": properties,
        "required": required,
        "additionalProperties": false,
    })
}

fn axes(generator: &mut SchemaGenerator) -> Schema {
    let range = range(&["from", "to", "count", "scale"], &["from", "to", "count"]);
    let mut schema = names(
        generator,
        |value| serde_json::json!({ "anyOf": [{ "type": "array", "items": value, "minItems": 1 }, range] }),
    );
    schema.insert("minProperties".to_owned(), 1.into());
    schema
}

fn draws(generator: &mut SchemaGenerator) -> Schema {
    let range = range(&["from", "to", "scale"], &["from", "to"]);
    let mut schema = names(
        generator,
        |value| serde_json::json!({ "anyOf": [{ "type": "array", "items": value, "minItems": 1 }, range] }),
    );
    // `count`, `seed` and `method` are in the same table; these are those of the samples, not the settings.
    schema.remove("additionalProperties");
    if let Some(properties) = schema.get_mut("properties").and_then(serde_json::Value::as_object_mut) {
        properties.remove("seed");
        properties.remove("method");
    }
    schema
}

fn conditions(generator: &mut SchemaGenerator) -> Schema {
    let range = range(&["from", "to"], &[]);
    let condition =
        names(generator, |value| serde_json::json!({ "anyOf": [value, { "type": "array", "items": value }, range] }));
    json_schema!({ "type": "array", "items": condition, "minItems": 1 })
}

/// A TOML value as shown in messages.
pub fn shown(value: &toml::Value) -> String {
    Value::of(value).map_or_else(|| value.to_string(), |value| value.to_string())
}
