//! Rank deficiencies in the layout of the thesis' Table 1.

use super::{Extent, Results};
use crate::cli::layout::{NOTHING_THERE, Sheet, wrapped};
use crate::table1::{Cell, TableOne, thesis};
use crate::terminal::{heading, print as say};

/// Number of tables shown without `--all`.
const FIRST: usize = 4;
const BOUNDS: [(&str, &str); 3] = [("activation", "a ≥ 0"), ("excitation", "u ≥ 0"), ("both", "u, a ≥ 0")];
const GRIDS: [(&str, &str); 2] =
    [("measurement", "load sharing at the measured instants"), ("collocation", "… at the collocation points")];

/// Prints the groups that have all six cases. The ranks of other groups are shown with their jobs.
pub fn print(results: &Results, groups: &[TableOne], extent: Extent) {
    let whole: Vec<&TableOne> = groups.iter().filter(|group| group.cells.len() >= 6).collect();
    let shown = if extent.all { whole.len() } else { FIRST.min(whole.len()) };
    for group in whole.iter().take(shown) {
        // Values shared by all tables are printed once, above the jobs.
        let differs = |other: &&(String, String)| whole.iter().any(|group| !group.others.contains(other));
        let others: Vec<String> =
            group.others.iter().filter(differs).map(|(name, value)| format!("{name} = {value}")).collect();
        // The thesis' numbers apply only to its own scheme.
        let is_thesis = group.cells.values().all(|cell| results.setting("scheme", cell.job) == "midpoint");
        print_group(group, &others.join(", "), is_thesis);
    }
    if shown < whole.len() {
        say(&format!("… and {} more such tables (--all shows them)", whole.len() - shown));
    }
}

/// A deficiency as the thesis prints it: 0, −1, …
pub fn printed(deficiency: i64) -> String {
    if deficiency > 0 { format!("−{deficiency}") } else { deficiency.to_string() }
}

fn print_group(group: &TableOne, others: &str, is_thesis: bool) {
    let title = if is_thesis { ", with the thesis' Table 1 in brackets" } else { "" };
    let others = if others.is_empty() { String::new() } else { format!(": {others}") };
    say("");
    say(&heading(&wrapped(&format!("Rank deficiencies{title}{others}"), "  ")));
    type PickRank = fn((i64, i64)) -> i64;
    let picks: [(&str, PickRank); 2] = [("A", |d| d.0), ("[Aᵀ Jᵀ]", |d| d.1)];
    let mut sheet = Sheet::default();
    let rows = || GRIDS.iter().flat_map(|grid| picks.map(|pick| (grid, pick)));
    sheet.text("", 0, rows().map(|((_, title), (name, _))| if name == "A" { *title } else { "" }.to_owned()).collect());
    sheet.text("", 0, rows().map(|(_, (name, _))| name.to_owned()).collect());
    for (bounds, title) in BOUNDS {
        let cell = |((grid, _), (_, pick)): (&(&str, &str), (&str, PickRank))| {
            let cell = group.cells.get(&((*grid).to_owned(), bounds.to_owned()));
            let printed = thesis(grid, bounds).filter(|_| is_thesis).map(pick);
            cell.map_or(NOTHING_THERE.to_owned(), |cell| shown(cell, printed, pick))
        };
        sheet.number(title, 0, rows().map(cell).collect());
    }
    sheet.print(true);
    if is_thesis {
        let (counted, predicted) = (group.matches(), group.predicted_matches());
        let text = format!(
            "{counted} of the thesis' 12 numbers agree as counted, {predicted} as predicted from the active bounds."
        );
        say(&wrapped(&text, ""));
    }
    if group.ambiguous() > 0 {
        say(&wrapped(
            &format!(
                "In {} of {} cases the singular values have no clear gap: the count depends on the tolerance \
                 (`ambiguous`).",
                group.ambiguous(),
                group.cells.len()
            ),
            "",
        ));
    }
}

/// The counted number, the thesis' in brackets, and the predicted one where it differs.
fn shown(cell: &Cell, thesis: Option<i64>, pick: fn((i64, i64)) -> i64) -> String {
    let found = match cell.deficiencies {
        Some(found) if cell.status == "converged" => printed(pick(found)),
        _ => cell.status.clone(),
    };
    let predicted = match (cell.deficiencies, cell.predicted) {
        (Some(found), Some(predicted)) if pick(found) != pick(predicted) => {
            format!(", predicted {}", printed(pick(predicted)))
        }
        _ => String::new(),
    };
    let thesis = thesis.map(|number| format!(" ({})", printed(number))).unwrap_or_default();
    format!("{found}{thesis}{predicted}")
}
