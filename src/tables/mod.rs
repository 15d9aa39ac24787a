//! Results on disk: the columns (this is the only list of them), and Parquet files written by polars.
//!
//! Missing values are null, units are in the column names, and the file metadata contain the provenance.

mod axes;
mod column;
mod parquet;
pub mod schema;

pub use axes::unit as axis_unit;
pub use parquet::{STUDY, Writer, is_of_study, read};

/// The values of a column; `None` if missing.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    Number(Vec<Option<f64>>),
    Integer(Vec<Option<i64>>),
    Flag(Vec<Option<bool>>),
    Text(Vec<Option<String>>),
}

impl Values {
    pub fn len(&self) -> usize {
        match self {
            Values::Number(v) => v.len(),
            Values::Integer(v) => v.len(),
            Values::Flag(v) => v.len(),
            Values::Text(v) => v.len(),
        }
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// A named table of typed columns of the same length.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    pub name: &'static str,
    pub columns: Vec<(String, Values)>,
}

impl Table {
    pub fn rows(&self) -> usize {
        self.columns.first().map_or(0, |(_, values)| values.len())
    }

    pub fn column(&self, name: &str) -> Option<&Values> {
        self.columns.iter().find(|(column, _)| column == name).map(|(_, values)| values)
    }

    pub fn number(&self, name: &str, row: usize) -> Option<f64> {
        match self.column(name)? {
            Values::Number(values) => values[row],
            Values::Integer(values) => values[row].map(|v| v as f64),
            _ => None,
        }
    }

    pub fn integer(&self, name: &str, row: usize) -> Option<i64> {
        match self.column(name)? {
            Values::Integer(values) => values[row],
            _ => None,
        }
    }

    pub fn flag(&self, name: &str, row: usize) -> Option<bool> {
        match self.column(name)? {
            Values::Flag(values) => values[row],
            _ => None,
        }
    }

    pub fn text(&self, name: &str, row: usize) -> Option<&str> {
        match self.column(name)? {
            Values::Text(values) => values[row].as_deref(),
            _ => None,
        }
    }

    /// A value of any type as readable text.
    pub fn display(&self, name: &str, row: usize) -> Option<String> {
        match self.column(name)? {
            Values::Number(values) => values[row].map(|v| format!("{v}")),
            Values::Integer(values) => values[row].map(|v| v.to_string()),
            Values::Flag(values) => values[row].map(|v| v.to_string()),
            Values::Text(values) => values[row].clone(),
        }
    }
}
