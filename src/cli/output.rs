//! Tables for other programs: CSV, JSON or Markdown on standard output, CSV or Parquet in a file.

use std::path::Path;

use super::arguments::{Format, Look};
use super::layout::{NOTHING_THERE, Sheet};
use crate::error::{Error, Result};
use crate::files::write_atomically;
use crate::names::is_formula;
use crate::tables::{Table, Values, Writer};
use crate::terminal::print;

/// Prints a table in the requested format.
pub fn print_table(table: &Table, look: Look) -> Result<()> {
    match look.format {
        Format::Table => sheet(table).print(look.wide),
        Format::Csv => print(csv(table)?.trim_end()),
        Format::Json => print(&json(table)),
        Format::Markdown => print(markdown(table).trim_end()),
    }
    Ok(())
}

/// The columns of a table in order; the rightmost ones are hidden first.
fn sheet(table: &Table) -> Sheet {
    let mut sheet = Sheet::default();
    for (place, (name, values)) in table.columns.iter().enumerate() {
        let cells = (0..table.rows()).map(|row| table.display(name, row).unwrap_or(NOTHING_THERE.to_owned())).collect();
        let rank = u8::try_from(place).unwrap_or(u8::MAX);
        match values {
            Values::Text(_) | Values::Flag(_) => sheet.text(name, rank, cells),
            _ => sheet.number(name, rank, cells),
        };
    }
    sheet
}

/// An array with one object per row, each on its own line.
fn json(table: &Table) -> String {
    let row = |row: usize| {
        let value = |(name, values): &(String, Values)| {
            let value = match values {
                Values::Number(v) => v[row].into(),
                Values::Integer(v) => v[row].into(),
                Values::Flag(v) => v[row].into(),
                Values::Text(v) => v[row].clone().into(),
            };
            (name.clone(), value)
        };
        serde_json::Value::Object(table.columns.iter().map(value).collect()).to_string()
    };
    let rows: Vec<String> = (0..table.rows()).map(row).collect();
    format!("[{}]", rows.join(",\n"))
}

fn markdown(table: &Table) -> String {
    let line = |cells: Vec<String>| format!("| {} |\n", cells.join(" | "));
    let escaped = |text: String| text.replace('|', "\\|").replace('\n', " ");
    let mut text = line(table.columns.iter().map(|(name, _)| escaped(name.clone())).collect());
    text.push_str(&format!("|{}\n", "---|".repeat(table.columns.len())));
    for row in 0..table.rows() {
        let cell = |(name, _): &(String, Values)| escaped(table.display(name, row).unwrap_or_default());
        text.push_str(&line(table.columns.iter().map(cell).collect()));
    }
    text
}

/// Writes a table as CSV or Parquet, depending on the file extension.
pub fn write_table(table: &Table, metadata: Vec<(String, String)>, path: &Path) -> Result<()> {
    match path.extension().and_then(|e| e.to_str()) {
        Some("csv") => write_atomically(path, csv(table)?),
        Some("parquet") => {
            let mut writer = Writer::new(path, metadata);
            writer.append(table)?;
            writer.finish().map(|_| ())
        }
        _ => Err(Error::table("write", path, "the name must end in .csv or .parquet")),
    }
}

/// Puts an apostrophe before text that spreadsheets would read as a formula.
fn without_formula(cell: String) -> String {
    let is_text = cell.parse::<f64>().is_err();
    if is_text && is_formula(&cell) { format!("'{cell}") } else { cell }
}

pub fn csv(table: &Table) -> Result<String> {
    let failed = |e: csv::Error| Error::table("write", Path::new("CSV"), e);
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(table.columns.iter().map(|(name, _)| without_formula(name.clone()))).map_err(failed)?;
    for row in 0..table.rows() {
        let fields =
            table.columns.iter().map(|(name, _)| without_formula(table.display(name, row).unwrap_or_default()));
        writer.write_record(fields).map_err(failed)?;
    }
    let bytes = writer.into_inner().map_err(|e| Error::table("write", Path::new("CSV"), e))?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}
