//! A column: its name, unit and meaning, and how to get its value from a row.

use super::{Table, Values};

/// How to get a column's value from a row.
enum Pick<R> {
    Number(fn(&R) -> Option<f64>),
    Integer(fn(&R) -> Option<i64>),
    Flag(fn(&R) -> Option<bool>),
    Text(fn(&R) -> Option<String>),
}

/// A column of a table whose rows are made from `R`.
pub struct Column<R> {
    pub about: ColumnInfo,
    pick: Pick<R>,
}

/// What a reader needs to know about a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ColumnInfo {
    pub name: &'static str,
    /// Its type in Parquet: `double`, `int64`, `boolean` or `string`.
    pub kind: &'static str,
    /// `1` for a dimensionless number; empty for counts, flags and texts.
    pub unit: &'static str,
    pub meaning: &'static str,
}

impl<R> Column<R> {
    fn new(name: &'static str, kind: &'static str, unit: &'static str, meaning: &'static str, pick: Pick<R>) -> Self {
        Self { about: ColumnInfo { name, kind, unit, meaning }, pick }
    }

    pub fn number(name: &'static str, unit: &'static str, meaning: &'static str, pick: fn(&R) -> Option<f64>) -> Self {
        Self::new(name, "double", unit, meaning, Pick::Number(pick))
    }

    pub fn integer(name: &'static str, meaning: &'static str, pick: fn(&R) -> Option<i64>) -> Self {
        Self::new(name, "int64", "", meaning, Pick::Integer(pick))
    }

    pub fn flag(name: &'static str, meaning: &'static str, pick: fn(&R) -> Option<bool>) -> Self {
        Self::new(name, "boolean", "", meaning, Pick::Flag(pick))
    }

    pub fn text(name: &'static str, meaning: &'static str, pick: fn(&R) -> Option<String>) -> Self {
        Self::new(name, "string", "", meaning, Pick::Text(pick))
    }

    fn values(&self, rows: &[R]) -> Values {
        match self.pick {
            Pick::Number(pick) => Values::Number(rows.iter().map(pick).collect()),
            Pick::Integer(pick) => Values::Integer(rows.iter().map(pick).collect()),
            Pick::Flag(pick) => Values::Flag(rows.iter().map(pick).collect()),
            Pick::Text(pick) => Values::Text(rows.iter().map(pick).collect()),
        }
    }
}

/// Makes a table from rows.
pub fn table<R>(name: &'static str, columns: &[Column<R>], rows: &[R]) -> Table {
    Table { name, columns: columns.iter().map(|column| (column.about.name.to_owned(), column.values(rows))).collect() }
}
