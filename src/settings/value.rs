//! Values as written in a study file.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::error::nearest;

/// A value of a study file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Value {
    Flag(bool),
    Integer(i64),
    Number(f64),
    Text(String),
}

impl std::fmt::Display for Value {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Value::Flag(flag) => write!(f, "{flag}"),
            Value::Integer(number) => write!(f, "{number}"),
            Value::Number(number) => write!(f, "{number}"),
            Value::Text(text) => write!(f, "{text}"),
        }
    }
}

impl Value {
    pub fn number(&self) -> Option<f64> {
        match self {
            Value::Integer(number) => Some(*number as f64),
            Value::Number(number) => Some(*number),
            _ => None,
        }
    }

    /// `None` if the item is not a single value.
    pub fn of(item: &toml::Value) -> Option<Self> {
        match item {
            toml::Value::Boolean(flag) => Some(Value::Flag(*flag)),
            toml::Value::Integer(number) => Some(Value::Integer(*number)),
            toml::Value::Float(number) => Some(Value::Number(*number)),
            toml::Value::String(text) => Some(Value::Text(text.clone())),
            _ => None,
        }
    }

    /// True if both values are the same: 1 equals 1.0, and rounding errors in ranges are ignored.
    pub fn same(&self, other: &Self) -> bool {
        match (self.number(), other.number()) {
            (Some(a), Some(b)) => a == b || (a - b).abs() <= 1e-12 * a.abs().max(b.abs()),
            _ => self == other,
        }
    }
}

/// Why a value cannot be set, and what is allowed.
#[derive(Clone, Debug, PartialEq)]
pub struct InvalidValue {
    pub message: String,
    pub help: String,
}

impl InvalidValue {
    pub fn new(message: impl Into<String>, help: impl Into<String>) -> Self {
        Self { message: message.into(), help: help.into() }
    }
}

pub fn describe(value: &Value) -> String {
    match value {
        Value::Flag(flag) => format!("the value {flag}"),
        Value::Integer(number) => format!("the whole number {number}"),
        Value::Number(number) => format!("the number {number}"),
        Value::Text(text) => format!("the text \"{text}\""),
    }
}

pub(super) fn number(value: &Value, range: std::ops::RangeInclusive<f64>, allowed: &str) -> Result<f64, InvalidValue> {
    match value.number() {
        Some(number) if range.contains(&number) => Ok(number + 0.0), // no −0
        _ => Err(InvalidValue::new(format!("found {}", describe(value)), format!("it must be {allowed}"))),
    }
}

pub(super) fn flag(value: &Value) -> Result<bool, InvalidValue> {
    match value {
        Value::Flag(flag) => Ok(*flag),
        other => Err(InvalidValue::new(format!("found {}", describe(other)), "it must be true or false")),
    }
}

pub(super) fn integer(value: &Value, range: std::ops::RangeInclusive<i64>) -> Result<i64, InvalidValue> {
    match value {
        Value::Integer(number) if range.contains(number) => Ok(*number),
        _ => Err(InvalidValue::new(
            format!("found {}", describe(value)),
            format!("it must be a whole number from {} to {}", range.start(), range.end()),
        )),
    }
}

pub(super) fn choice<T>(value: &Value, allowed: &[&str], parse: impl Fn(&str) -> Option<T>) -> Result<T, InvalidValue> {
    let help = |found: &str| {
        let near = nearest(found, allowed.iter().copied()).map(|n| format!("did you mean \"{n}\"? "));
        format!("{}it must be one of: {}", near.unwrap_or_default(), allowed.join(", "))
    };
    match value {
        Value::Text(text) => parse(text).ok_or_else(|| InvalidValue::new(format!("found \"{text}\""), help(text))),
        other => Err(InvalidValue::new(format!("found {}", describe(other)), help(""))),
    }
}
