//! Tables that fit the terminal: the least important columns are hidden until the rest fits, and listed below.

use comfy_table::{Attribute, Cell, CellAlignment, Color, Table as Grid, presets::NOTHING};
use textwrap::{WordSeparator, WordSplitter};
use unicode_width::UnicodeWidthStr;

use crate::terminal::{self, print};

/// Placeholder for a missing value.
pub const NOTHING_THERE: &str = "–";
/// Titles are wrapped at about this many characters, or at the width of the cells if that is larger.
const TITLE: usize = 10;
/// Spaces between two columns.
const MARGIN: usize = 2;

/// A column of a table.
struct SheetColumn {
    title: String,
    cells: Vec<String>,
    is_text: bool,
    /// Columns with the highest rank are hidden first; rank 0 is always shown.
    rank: u8,
    /// The colour of a cell, if any.
    color: fn(&str) -> Option<Color>,
}

/// A table for the terminal, built column by column.
#[derive(Default)]
pub struct Sheet {
    columns: Vec<SheetColumn>,
}

impl Sheet {
    /// Adds a text column. Columns with the highest `rank` are hidden first; rank 0 is always shown.
    pub fn text(&mut self, title: impl Into<String>, rank: u8, cells: Vec<String>) -> &mut Self {
        self.add(title.into(), rank, cells, true)
    }

    /// Adds a right-aligned column of numbers. For `rank`, see [`Sheet::text`].
    pub fn number(&mut self, title: impl Into<String>, rank: u8, cells: Vec<String>) -> &mut Self {
        self.add(title.into(), rank, cells, false)
    }

    /// Colours the cells of the last column by `color`.
    pub fn colored(&mut self, color: fn(&str) -> Option<Color>) -> &mut Self {
        if let Some(column) = self.columns.last_mut() {
            column.color = color;
        }
        self
    }

    fn add(&mut self, title: String, rank: u8, cells: Vec<String>, is_text: bool) -> &mut Self {
        self.columns.push(SheetColumn { title, cells, is_text, rank, color: |_| None });
        self
    }

    /// Prints the table and the names of the columns that do not fit; with `wide`, all columns.
    pub fn print(mut self, wide: bool) {
        let hidden = if wide { Vec::new() } else { self.fit(terminal::width()) };
        self.draw();
        if !hidden.is_empty() {
            print(&wrapped(&format!("(--wide also shows: {})", hidden.join(", ")), "  "));
        }
    }

    /// Prints as much of the table as fits; returns the number of columns that do not.
    pub fn print_fitting(mut self, wide: bool) -> usize {
        let hidden = if wide { 0 } else { self.fit(terminal::width()).len() };
        self.draw();
        hidden
    }

    fn draw(&self) {
        let mut grid = Grid::new();
        grid.load_preset(NOTHING).set_style(comfy_table::TableComponent::VerticalLines, ' ');
        if terminal::is_colored() {
            grid.enforce_styling()
        } else {
            grid.force_no_tty()
        };
        grid.set_header(self.columns.iter().map(|column| Cell::new(column.header()).add_attribute(Attribute::Bold)));
        for (i, column) in self.columns.iter().enumerate() {
            if let Some(drawn) = grid.column_mut(i) {
                drawn.set_padding((u16::from(i > 0), 0));
                drawn.set_cell_alignment(if column.is_text { CellAlignment::Left } else { CellAlignment::Right });
            }
        }
        for row in 0..self.columns.first().map_or(0, |column| column.cells.len()) {
            grid.add_row(self.columns.iter().map(|column| {
                let text = &column.cells[row];
                let cell = Cell::new(text);
                (column.color)(text).map_or(cell.clone(), |color| cell.fg(color))
            }));
        }
        print(&grid.trim_fmt());
    }

    /// Hides columns until the table is at most `width` characters wide; returns the hidden titles.
    fn fit(&mut self, width: usize) -> Vec<String> {
        let mut hidden = Vec::new();
        let mut widths: Vec<usize> = self.columns.iter().map(SheetColumn::width).collect();
        while widths.iter().sum::<usize>() > width + MARGIN {
            let least_important = self.columns.iter().enumerate().max_by_key(|(i, column)| (column.rank, *i));
            match least_important {
                Some((i, column)) if column.rank > 0 => {
                    widths.remove(i);
                    hidden.insert(0, self.columns.remove(i).title);
                }
                _ => break,
            }
        }
        hidden
    }
}

impl SheetColumn {
    fn cells_width(&self) -> usize {
        self.cells.iter().map(|cell| cell.lines().map(UnicodeWidthStr::width).max().unwrap_or(0)).max().unwrap_or(0)
    }

    fn header(&self) -> String {
        folded(&self.title, self.cells_width().max(TITLE))
    }

    fn width(&self) -> usize {
        let header = self.header();
        let header = header.lines().map(UnicodeWidthStr::width).max().unwrap_or(0);
        header.max(self.cells_width()) + MARGIN
    }
}

/// Wraps a text to lines of about `width` characters, breaking after `.` (not within a number), `_` or a space.
pub fn folded(name: &str, width: usize) -> String {
    let mut lines = vec![String::new()];
    for part in name.split_inclusive(['.', '_', ' ']) {
        let last = lines.last_mut().expect("at least one line");
        let is_number = last.ends_with('.') && part.starts_with(|c: char| c.is_ascii_digit());
        if last.is_empty() || is_number || last.width() + part.trim_end().width() <= width {
            last.push_str(part);
        } else {
            lines.push(part.to_owned());
        }
    }
    lines.iter().map(|line| line.trim_end()).collect::<Vec<_>>().join("\n")
}

/// Wraps a text to the width of the terminal. All lines after the first begin with `indent`.
pub fn wrapped(text: &str, indent: &str) -> String {
    textwrap::fill(text, wrap_options().subsequent_indent(indent))
}

/// Wraps at the width of the terminal, at spaces only.
fn wrap_options<'a>() -> textwrap::Options<'a> {
    let options = textwrap::Options::new(terminal::width()).break_words(false);
    options.word_separator(WordSeparator::AsciiSpace).word_splitter(WordSplitter::NoHyphenation)
}

/// Prints `head` on its own line, then the explanation, indented. Empty parts are omitted.
pub fn print_definition(head: &str, explanation: &str) {
    if !head.is_empty() {
        print(head);
    }
    if !explanation.is_empty() {
        let indent = if head.is_empty() { "" } else { "      " };
        print(&textwrap::fill(explanation, wrap_options().initial_indent(indent).subsequent_indent(indent)));
    }
}

/// The colour of a job's status.
pub fn of_status(status: &str) -> Option<Color> {
    (status != "converged").then_some(Color::Red)
}

/// The colour of warnings.
pub fn of_warning(text: &str) -> Option<Color> {
    (!text.is_empty()).then_some(Color::Yellow)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_names_are_wrapped_after_separators() {
        assert_eq!(
            folded("muscle.biceps.tendon_slack_length_scale", 14),
            "muscle.biceps.\ntendon_slack_\nlength_scale"
        );
        assert_eq!(folded("mu", 10), "mu");
        assert_eq!(folded("mu = 0.25", 6), "mu =\n0.25");
    }

    #[test]
    fn the_least_important_columns_are_hidden_and_listed() {
        let mut sheet = Sheet::default();
        sheet.text("job", 0, vec!["0".into()]).number("objective", 2, vec!["0.123456".into()]);
        sheet.number("seconds", 3, vec!["12.5".into()]);
        assert_eq!(sheet.fit(18), ["seconds"]);
        assert_eq!(sheet.columns.len(), 2);
        assert_eq!(sheet.fit(3), ["objective"], "a column of rank 0 stays at any width");
        assert_eq!(sheet.columns.len(), 1);
    }
}
