//! Reads CSV files and OpenSim storage files (`.mot`, `.sto`) as tables of text: column names, and rows with line
//! numbers.

use crate::error::{Error, Result, SourceFile};

/// A table of text fields. Each row has one field per column.
#[derive(Clone, Debug, PartialEq)]
pub struct TextTable {
    /// Line of the column names, counted from 1.
    pub line: usize,
    pub names: Vec<String>,
    pub rows: Vec<Row>,
    /// `inDegrees` in the header of a storage file.
    pub in_degrees: Option<bool>,
    /// Remarks on columns that were ignored.
    pub notes: Vec<String>,
}

/// A row and its line, counted from 1.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    pub line: usize,
    pub fields: Vec<String>,
}

impl TextTable {
    /// Reads a CSV file: comma-separated columns, decimal points, column names in the first row, fields quoted where
    /// necessary. Lines that begin with `#` are comments.
    ///
    /// # Errors
    /// If the file is not in this format, or a row does not have one field per column.
    pub fn csv(file: &SourceFile) -> Result<Self> {
        // Spreadsheets write a byte order mark.
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
                at_line(file, line, e.to_string(), "separate the columns with commas and close every quote")
            })?;
            let line = record.position().map_or(1, |position| position.line() as usize);
            rows.push(Row { line, fields: record.iter().map(str::to_owned).collect() });
        }
        let table = Self::from_rows(file, rows)?;
        let help = "separate the columns with commas and write decimals with a point: 0.25, not 0,25";
        table.check_separator(file, &[(';', "semicolons"), ('\t', "tabs")], help)?;
        table.checked(file)
    }

    /// Rejects a table with a single column whose name contains another separator.
    fn check_separator(&self, file: &SourceFile, others: &[(char, &str)], help: &str) -> Result<()> {
        let [name] = &self.names[..] else { return Ok(()) };
        let Some((separator, word)) = others.iter().find(|(c, _)| name.contains(*c)) else { return Ok(()) };
        let message = format!("the columns are separated by {word} (`{separator}`)").replace('\t', "\\t");
        Err(at_line(file, self.line, message, help))
    }

    /// Reads an OpenSim storage file: a header that ends with the line `endheader`, then names and rows.
    ///
    /// # Errors
    /// If the header has no end, contradicts itself, or declares another number of rows than there are (as in a
    /// truncated file), or a row does not have one field per column.
    pub fn storage(file: &SourceFile) -> Result<Self> {
        let text = file.text.trim_start_matches('\u{feff}');
        let lines: Vec<&str> = text.lines().collect();
        let Some(end) = lines.iter().position(|line| line.trim().eq_ignore_ascii_case("endheader")) else {
            let help = "an OpenSim storage file has a header that ends with the line `endheader`";
            return Err(at_line(file, 1, "the header has no `endheader` line", help));
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
                        let help = "keep the correct one";
                        return Err(at_line(file, i + 1, "inDegrees is given twice, as yes and as no", help));
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
        let table = Self::from_rows(file, rows.map(row).collect())?;
        table.check_separator(
            file,
            &[(';', "semicolons"), (',', "commas")],
            "separate the columns with tabs or spaces",
        )?;
        let mut table = table.checked(file)?;
        if let Some((line, count)) = count.filter(|(_, count)| *count != table.rows.len()) {
            let message = format!("the header declares {count} rows, but the table has {}", table.rows.len());
            let help = "check whether the file is truncated; if not, correct the number in the header";
            return Err(at_line(file, line, message, help));
        }
        table.in_degrees = in_degrees;
        Ok(table)
    }

    fn from_rows(file: &SourceFile, mut rows: Vec<Row>) -> Result<Self> {
        if rows.is_empty() {
            let help = "the first row names the columns".to_owned();
            return Err(file.error(
                None,
                format!("{}: the file contains no table", file.path.display()),
                "",
                Some(help),
            ));
        }
        let header = rows.remove(0);
        Ok(Self { line: header.line, names: header.fields, rows, in_degrees: None, notes: Vec::new() })
    }

    /// Removes unnamed columns that are empty or only number the rows, and checks that each row has one field per
    /// column.
    fn checked(mut self, file: &SourceFile) -> Result<Self> {
        // A trailing separator produces an empty field.
        while self.names.last().is_some_and(String::is_empty) && self.rows.iter().all(|row| self.is_empty_at_end(row)) {
            self.names.pop();
        }
        for row in &mut self.rows {
            while row.fields.len() > self.names.len() && row.fields.last().is_some_and(String::is_empty) {
                row.fields.pop();
            }
            if row.fields.len() != self.names.len() {
                let message =
                    format!("line {}: {} fields for {} columns", row.line, row.fields.len(), self.names.len());
                let help = "give one field per column in each row; write decimals with a point";
                return Err(at_line(file, row.line, message, help));
            }
        }
        while let Some(column) = self.names.iter().position(String::is_empty) {
            if !self.is_row_index(column) {
                let message = format!("column {} has no name", column + 1);
                let help = "name or remove the column; only a row index may be unnamed";
                return Err(at_line(file, self.line, message, help));
            }
            self.notes.push(format!("column {} is ignored: it has no name and only numbers the rows", column + 1));
            self.names.remove(column);
            self.rows.iter_mut().for_each(|row| {
                row.fields.remove(column);
            });
        }
        Ok(self)
    }

    /// Whether the row has no field, or an empty one, in the last column.
    fn is_empty_at_end(&self, row: &Row) -> bool {
        row.fields.len() < self.names.len() || row.fields[self.names.len() - 1].is_empty()
    }

    /// Whether a column is a row index: consecutive integers.
    fn is_row_index(&self, column: usize) -> bool {
        let numbers: Option<Vec<i64>> = self.rows.iter().map(|row| row.fields[column].parse().ok()).collect();
        numbers.is_some_and(|numbers| numbers.windows(2).all(|pair| pair[1] == pair[0] + 1))
    }

    /// An error at the line of the column names.
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

/// An error at a line, counted from 1.
pub fn at_line(file: &SourceFile, line: usize, message: impl Into<String>, help: &str) -> Error {
    file.error(file.line_span(line), message, "here", Some(help.to_owned()))
}
