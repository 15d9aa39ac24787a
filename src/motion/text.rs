//! Tables as text: CSV files, and OpenSim's storage files (`.mot`, `.sto`). Names of columns, and rows with their lines.

use crate::error::{Error, Result, SourceFile};

/// A table of text fields.
#[derive(Clone, Debug, PartialEq)]
pub struct TextTable {
    /// Line of the names, from 1.
    pub line: usize,
    pub names: Vec<String>,
    pub rows: Vec<Row>,
    /// Whether a storage file says that angles are in degrees.
    pub in_degrees: Option<bool>,
    /// Columns that were ignored.
    pub notes: Vec<String>,
}

/// A row with its line, from 1.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    pub line: usize,
    pub fields: Vec<String>,
}

impl TextTable {
    /// Reads a CSV file: commas between columns, points in numbers, names in the first row, quotes where they are needed; lines that
    /// begin with `#` are comments.
    ///
    /// # Errors
    /// If it is written in another way, or a row has not a field for each column.
    pub fn csv(file: &SourceFile) -> Result<Self> {
        // Spreadsheets put a byte order mark first.
        let text = file.text.trim_start_matches('\u{feff}');
        let mut reader = csv::ReaderBuilder::new()
            .has_headers(false)
            .flexible(true)
            .trim(csv::Trim::All)
            .comment(Some(b'#'))
            .from_reader(text.as_bytes());
        let mut rows = Vec::new();
        for record in reader.records() {
            let record = record.map_err(|e| {
                let line = e.position().map_or(1, |position| position.line() as usize);
                at_line(file, line, e.to_string(), "a CSV file has commas between columns, and quotes in pairs")
            })?;
            let line = record.position().map_or(1, |position| position.line() as usize);
            rows.push(Row { line, fields: record.iter().map(str::to_owned).collect() });
        }
        let table = Self::of_rows(file, rows)?;
        let help = "save the file with commas between columns and points in numbers: 0.25, not 0,25";
        table.check_separator(file, &[(';', "semicolons"), ('\t', "tabs")], help)?;
        table.complete(file)
    }

    /// Refuses a table that is one column by its own separator, and several by another one.
    fn check_separator(&self, file: &SourceFile, others: &[(char, &str)], help: &str) -> Result<()> {
        let [name] = &self.names[..] else { return Ok(()) };
        let Some((separator, word)) = others.iter().find(|(c, _)| name.contains(*c)) else { return Ok(()) };
        let message = format!("the columns are separated by {word} (`{separator}`)").replace('\t', "\\t");
        Err(at_line(file, self.line, message, help))
    }

    /// Reads an OpenSim storage file: a header that ends with the line `endheader`, then names and rows.
    ///
    /// # Errors
    /// If the header lacks its end or says something that the table is not: another number of rows, above all, as of a file that was cut off.
    pub fn storage(file: &SourceFile) -> Result<Self> {
        let text = file.text.trim_start_matches('\u{feff}');
        let lines: Vec<&str> = text.lines().collect();
        let Some(end) = lines.iter().position(|line| line.trim().eq_ignore_ascii_case("endheader")) else {
            let help = "an OpenSim storage file has a header that ends with the line `endheader`";
            return Err(at_line(file, 1, "the header has no line `endheader`", help));
        };
        let mut in_degrees: Option<bool> = None;
        let mut count = None;
        for (i, line) in lines[..end].iter().enumerate() {
            let entry = line.split_once('=').or_else(|| line.trim().split_once(char::is_whitespace));
            let Some((key, value)) = entry.map(|(key, value)| (key.trim().to_ascii_lowercase(), value.trim())) else {
                continue;
            };
            match key.as_str() {
                "indegrees" => {
                    let found = yes_or_no(file, i + 1, value)?;
                    if in_degrees.is_some_and(|before| before != found) {
                        let help = "keep the one that holds";
                        return Err(at_line(file, i + 1, "inDegrees is there twice, as yes and as no", help));
                    }
                    in_degrees = Some(found);
                }
                "nrows" | "datarows" => count = value.parse::<usize>().ok().map(|count| (i + 1, count)),
                _ => {}
            }
        }
        let rows = lines.iter().enumerate().skip(end + 1).filter(|(_, line)| !line.trim().is_empty());
        let row = |(i, line): (usize, &&str)| Row {
            line: i + 1,
            fields: line.split_whitespace().map(str::to_owned).collect(),
        };
        let table = Self::of_rows(file, rows.map(row).collect())?;
        table.check_separator(
            file,
            &[(';', "semicolons"), (',', "commas")],
            "save the file with tabs or spaces between columns",
        )?;
        let mut table = table.complete(file)?;
        if let Some((line, count)) = count.filter(|(_, count)| *count != table.rows.len()) {
            let message = format!("the header says {count} rows, and there are {}", table.rows.len());
            let help = "is the file cut off? If not, mend the number in the header";
            return Err(at_line(file, line, message, help));
        }
        table.in_degrees = in_degrees;
        Ok(table)
    }

    fn of_rows(file: &SourceFile, mut rows: Vec<Row>) -> Result<Self> {
        if rows.is_empty() {
            let help = "the first row names the columns".to_owned();
            return Err(file.error(None, format!("{}: the file holds no table", file.path.display()), "", Some(help)));
        }
        let header = rows.remove(0);
        Ok(Self { line: header.line, names: header.fields, rows, in_degrees: None, notes: Vec::new() })
    }

    /// Takes out columns without a name that say nothing, and sees that each row has a field for each column.
    fn complete(mut self, file: &SourceFile) -> Result<Self> {
        // A separator at the end of a line makes an empty field.
        while self.names.last().is_some_and(String::is_empty) && self.rows.iter().all(|row| self.is_empty_at_end(row)) {
            self.names.pop();
        }
        for row in &mut self.rows {
            while row.fields.len() > self.names.len() && row.fields.last().is_some_and(String::is_empty) {
                row.fields.pop();
            }
            if row.fields.len() != self.names.len() {
                let message =
                    format!("line {}: {} fields under {} columns", row.line, row.fields.len(), self.names.len());
                let help = "each row has one field per column; decimals are written with a point";
                return Err(at_line(file, row.line, message, help));
            }
        }
        while let Some(column) = self.names.iter().position(String::is_empty) {
            if !self.counts_rows(column) {
                let message = format!("column {} has no name", column + 1);
                let help = "name it, or remove it; only an index that counts the rows may go without a name";
                return Err(at_line(file, self.line, message, help));
            }
            self.notes.push(format!("column {} has no name and counts the rows: ignored", column + 1));
            self.names.remove(column);
            self.rows.iter_mut().for_each(|row| {
                row.fields.remove(column);
            });
        }
        Ok(self)
    }

    fn is_empty_at_end(&self, row: &Row) -> bool {
        row.fields.len() < self.names.len() || row.fields[self.names.len() - 1].is_empty()
    }

    /// Whether a column is an index: whole numbers, each one more than that before.
    fn counts_rows(&self, column: usize) -> bool {
        let numbers: Option<Vec<i64>> = self.rows.iter().map(|row| row.fields[column].parse().ok()).collect();
        numbers.is_some_and(|numbers| numbers.windows(2).all(|pair| pair[1] == pair[0] + 1))
    }

    /// An error at the line of the names.
    pub fn error(&self, file: &SourceFile, message: impl Into<String>, help: &str) -> Error {
        at_line(file, self.line, message, help)
    }
}

fn yes_or_no(file: &SourceFile, line: usize, value: &str) -> Result<bool> {
    match value.to_ascii_lowercase().as_str() {
        "yes" => Ok(true),
        "no" => Ok(false),
        _ => Err(at_line(file, line, format!("inDegrees={value}"), "write inDegrees=yes or inDegrees=no")),
    }
}

/// An error at a line, from 1.
pub fn at_line(file: &SourceFile, line: usize, message: impl Into<String>, help: &str) -> Error {
    file.error(file.line_span(line), message, "here", Some(help.to_owned()))
}
