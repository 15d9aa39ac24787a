//! `sinew describe`: explains each table and column, from the schema that the tables are written with.

use std::path::Path;

use super::arguments::{Format, Look};
use super::layout::print_definition;
use super::output::print_table;
use super::{GOOD, print};
use crate::error::{Error, Result};
use crate::plausibility::WARNING_KINDS;
use crate::run::folder;
use crate::tables::{self, Table, Values, axis_unit, schema};
use crate::terminal::heading;

/// A column to describe.
struct DescribedColumn {
    table: &'static str,
    column: String,
    kind: &'static str,
    unit: &'static str,
    meaning: String,
}

/// Describes all possible tables, or those of a results folder with its swept columns.
pub fn describe(dir: Option<&Path>, table: Option<&str>, look: Look) -> Result<u8> {
    let wanted = match table {
        None => schema::TABLES.to_vec(),
        Some(name) => {
            let place = dir.unwrap_or(Path::new("the tables"));
            vec![schema::named(name).map_err(|reason| Error::table("describe", place, reason))?]
        }
    };
    let mut entries = Vec::new();
    for name in wanted {
        match dir {
            None => entries.extend(known(name)),
            Some(dir) => entries.extend(of_folder(dir, name)?),
        }
    }
    if let (Some(dir), true) = (dir, entries.is_empty()) {
        let reason = match table {
            Some(table) => format!("the folder has no table `{table}`"),
            None => "the folder has no tables; `sinew run STUDY` writes them".to_owned(),
        };
        return Err(Error::table("describe", dir, reason));
    }
    match look.format {
        Format::Table => print_text(&entries),
        Format::Markdown => print_markdown(&entries),
        Format::Csv | Format::Json => print_table(&as_table(&entries), look)?,
    }
    Ok(GOOD)
}

fn known(name: &'static str) -> impl Iterator<Item = DescribedColumn> {
    schema::columns_of(name).into_iter().map(move |about| DescribedColumn {
        table: name,
        column: about.name.to_owned(),
        kind: about.kind,
        unit: about.unit,
        meaning: about.meaning.to_owned(),
    })
}

/// The columns of a table in a folder; empty if the folder does not have the table.
fn of_folder(dir: &Path, name: &'static str) -> Result<Vec<DescribedColumn>> {
    let path = folder::table(dir, name);
    if !path.exists() {
        return Ok(Vec::new());
    }
    let table = tables::read(name, &path)?;
    let mut about: Vec<DescribedColumn> = known(name).collect();
    let swept = |column: &str, values: &Values| DescribedColumn {
        table: name,
        column: column.to_owned(),
        kind: match values {
            Values::Number(_) => "double",
            Values::Integer(_) => "int64",
            Values::Flag(_) => "boolean",
            Values::Text(_) => "string",
        },
        unit: axis_unit(column),
        meaning: "swept by the study".to_owned(),
    };
    let describe = |(column, values): &(String, Values)| {
        let place = about.iter().position(|entry| entry.column == *column);
        place.map_or_else(|| swept(column, values), |place| about.swap_remove(place))
    };
    Ok(table.columns.iter().map(describe).collect())
}

fn print_text(entries: &[DescribedColumn]) {
    for of_table in entries.chunk_by(|a, b| a.table == b.table) {
        let name = of_table[0].table;
        print(&heading(&format!("{name}.parquet")));
        print_definition("", &format!("Each row is {}.", schema::row_of(name)));
        for DescribedColumn { column, kind, unit, meaning, .. } in of_table {
            let unit = if unit.is_empty() { String::new() } else { format!(", {unit}") };
            print_definition(&format!("  {column} ({kind}{unit})"), meaning);
        }
        print("");
    }
}

/// Prints a section per table.
fn print_markdown(entries: &[DescribedColumn]) {
    for of_table in entries.chunk_by(|a, b| a.table == b.table) {
        let name = of_table[0].table;
        print(&format!(
            "### {name}\n\nEach row is {}.\n\n| column | type | unit | meaning |\n|---|---|---|---|",
            schema::row_of(name)
        ));
        for DescribedColumn { column, kind, unit, meaning, .. } in of_table {
            print(&format!("| `{}` | {kind} | {unit} | {} |", column.replace('|', "\\|"), meaning.replace('|', "\\|")));
        }
        print("");
    }
    print("### Warnings\n\n| code | limit | what to do |\n|---|---|---|");
    for kind in &WARNING_KINDS {
        print(&format!("| `{}` | {} | {} |", kind.code, kind.limit, kind.remedy));
    }
}

fn as_table(entries: &[DescribedColumn]) -> Table {
    let column = |name: &str, of: fn(&DescribedColumn) -> String| {
        (name.to_owned(), Values::Text(entries.iter().map(|entry| Some(of(entry))).collect()))
    };
    let columns = vec![
        column("table", |e| e.table.to_owned()),
        column("column", |e| e.column.clone()),
        column("type", |e| e.kind.to_owned()),
        column("unit", |e| e.unit.to_owned()),
        column("meaning", |e| e.meaning.clone()),
    ];
    Table { name: "columns", columns }
}
