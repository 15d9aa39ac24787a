//! Tables that fit the terminal: the least important columns are left out until the rest fits, and named below.

use comfy_table::{Attribute, Cell, CellAlignment, Color, Table as Grid, presets::NOTHING};
use textwrap::{WordSeparator, WordSplitter};
use unicode_width::UnicodeWidthStr;

use crate::terminal::{self, print};

/// A cell where there is no value.
pub const NOTHING_THERE: &str = "–";
/// Titles are broken into lines of about this many characters.
const TITLE: usize = 10;
/// Spaces around a column.
const MARGIN: usize = 2;

/// A column of a table.
struct Column {
    title: String,
    cells: Vec<String>,
    is_text: bool,
    /// Columns of the greatest number are left out first; 0 never.
    rank: u8,
    /// What is drawn in colour.
    color: fn(&str) -> Option<Color>,
}

/// A table in the making.
#[derive(Default)]
pub struct Sheet {
    columns: Vec<Column>,
}

impl Sheet {
    /// Adds a column of words. Those of the greatest `rank` are left out first; 0 stays.
    pub fn text(&mut self, title: impl Into<String>, rank: u8, cells: Vec<String>) -> &mut Self {
        self.add(title.into(), rank, cells, true)
    }

    /// Adds a column of numbers, aligned to the right.
    pub fn number(&mut self, title: impl Into<String>, rank: u8, cells: Vec<String>) -> &mut Self {
        self.add(title.into(), rank, cells, false)
    }

    /// Draws cells of the last column in the colours that `color` gives.
    pub fn colored(&mut self, color: fn(&str) -> Option<Color>) -> &mut Self {
        if let Some(column) = self.columns.last_mut() {
            column.color = color;
        }
        self
    }

    fn add(&mut self, title: String, rank: u8, cells: Vec<String>, is_text: bool) -> &mut Self {
        self.columns.push(Column { title, cells, is_text, rank, color: |_| None });
        self
    }

    /// Prints the table; `wide` for all columns.
    pub fn print(mut self, wide: bool) {
        let hidden = if wide { Vec::new() } else { self.fit(terminal::width()) };
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
        if !hidden.is_empty() {
            print(&wrapped(&format!("(--wide also shows: {})", hidden.join(", ")), "  "));
        }
    }

    /// Leaves out columns until the table is at most `width` characters wide; returns their titles.
    fn fit(&mut self, width: usize) -> Vec<String> {
        let mut hidden = Vec::new();
        while self.columns.iter().map(Column::width).sum::<usize>() > width + MARGIN {
            let least = self.columns.iter().enumerate().max_by_key(|(i, column)| (column.rank, *i));
            match least {
                Some((i, column)) if column.rank > 0 => hidden.insert(0, self.columns.remove(i).title),
                _ => break,
            }
        }
        hidden
    }
}

impl Column {
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

/// A text broken into lines of about `width` characters, after a `.`, a `_` or a space.
pub fn folded(name: &str, width: usize) -> String {
    let mut lines = vec![String::new()];
    for part in name.split_inclusive(['.', '_', ' ']) {
        let last = lines.last_mut().expect("there is a line");
        if last.is_empty() || last.width() + part.trim_end().width() <= width {
            last.push_str(part);
        } else {
            lines.push(part.to_owned());
        }
    }
    lines.iter().map(|line| line.trim_end()).collect::<Vec<_>>().join("\n")
}

/// A text in lines that fit the terminal, those after the first indented.
pub fn wrapped(text: &str, indent: &str) -> String {
    textwrap::fill(text, lines().subsequent_indent(indent))
}

/// Lines of the terminal's width, broken at spaces only.
fn lines<'a>() -> textwrap::Options<'a> {
    let options = textwrap::Options::new(terminal::width()).break_words(false);
    options.word_separator(WordSeparator::AsciiSpace).word_splitter(WordSplitter::NoHyphenation)
}

/// Prints what something is: a line of its own, then the explanation, indented.
pub fn print_definition(head: &str, explanation: &str) {
    if !head.is_empty() {
        print(head);
    }
    if !explanation.is_empty() {
        let indent = if head.is_empty() { "" } else { "      " };
        print(&textwrap::fill(explanation, lines().initial_indent(indent).subsequent_indent(indent)));
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
    fn names_are_folded_at_their_joints() {
        assert_eq!(
            folded("muscle.biceps.tendon_slack_length_scale", 14),
            "muscle.biceps.\ntendon_slack_\nlength_scale"
        );
        assert_eq!(folded("mu", 10), "mu");
    }

    #[test]
    fn the_least_important_columns_are_left_out_and_named() {
        let mut sheet = Sheet::default();
        sheet.text("job", 0, vec!["0".into()]).number("objective", 2, vec!["0.123456".into()]);
        sheet.number("seconds", 3, vec!["12.5".into()]);
        assert_eq!(sheet.fit(18), ["seconds"]);
        assert_eq!(sheet.columns.len(), 2);
        assert_eq!(sheet.fit(3), ["objective"], "the first stays, however narrow the terminal is");
        assert_eq!(sheet.columns.len(), 1);
    }
}
