//! Results of a search over sampled models: how many numbers of Table 1 each model reproduces.

use std::collections::BTreeMap;

use super::ranks::printed;
use crate::cli::layout::{NOTHING_THERE, Sheet, wrapped};
use crate::table1::{THESIS, TableOne};
use crate::terminal::{heading, print as say};

/// Number of models listed, best first.
const BEST: usize = 5;

pub fn print(groups: &[TableOne]) {
    print_histogram(groups);
    print_cases(groups);
    let mut best: Vec<&TableOne> = groups.iter().collect();
    best.sort_by_key(|group| std::cmp::Reverse(group.matches()));
    say("");
    say(&heading("Best models, by case"));
    best.iter().take(BEST).for_each(|group| print_model(group));
}

fn print_histogram(groups: &[TableOne]) {
    let mut histogram = BTreeMap::<usize, usize>::new();
    groups.iter().for_each(|group| *histogram.entry(group.matches()).or_default() += 1);
    say("");
    say(&heading(&format!("{} sampled models, by how many of the 12 numbers of Table 1 they reproduce", groups.len())));
    let (matches, counts): (Vec<_>, Vec<_>) =
        histogram.iter().rev().map(|(matches, count)| (matches.to_string(), count.to_string())).unzip();
    let mut sheet = Sheet::default();
    sheet.number("numbers", 0, matches).number("models", 0, counts);
    sheet.print(true);
}

/// For each case, how often the converged jobs reproduce the thesis' numbers.
fn print_cases(groups: &[TableOne]) {
    let mut columns: [Vec<String>; 8] = Default::default();
    for (grid, bounds, a, aj) in THESIS {
        let key = (grid.to_owned(), bounds.to_owned());
        let found: Vec<(i64, i64)> =
            groups.iter().filter_map(|g| g.cells.get(&key).filter(|c| c.status == "converged")?.deficiencies).collect();
        let share = |count: usize| match found.len() {
            0 => NOTHING_THERE.to_owned(),
            total => format!("{:.1} %", 100.0 * count as f64 / total as f64),
        };
        let mut common = BTreeMap::<(i64, i64), usize>::new();
        found.iter().for_each(|pair| *common.entry(*pair).or_default() += 1);
        let mut common: Vec<_> = common.into_iter().collect();
        common.sort_by_key(|&(pair, count)| (std::cmp::Reverse(count), pair));
        let top: Vec<String> = (common.iter().take(3))
            .map(|((a, aj), count)| format!("{}/{} {}", printed(*a), printed(*aj), share(*count)))
            .collect();
        let cells = [
            format!("{grid}, {bounds}"),
            found.len().to_string(),
            printed(a),
            share(found.iter().filter(|f| f.0 == a).count()),
            printed(aj),
            share(found.iter().filter(|f| f.1 == aj).count()),
            share(found.iter().filter(|f| **f == (a, aj)).count()),
            top.join(", "),
        ];
        columns.iter_mut().zip(cells).for_each(|(column, cell)| column.push(cell));
    }
    say("");
    say(&heading("How often converged jobs reproduce the thesis' numbers"));
    let [case, converged, a, share_a, aj, share_aj, both, top] = columns;
    let mut sheet = Sheet::default();
    sheet.text("case", 0, case).number("converged", 2, converged).number("A", 0, a).number("share", 0, share_a);
    sheet.number("[Aᵀ Jᵀ]", 0, aj).number("share", 0, share_aj).number("both", 0, both);
    sheet.text("most common A/[Aᵀ Jᵀ]", 3, top);
    sheet.print(false);
}

fn print_model(group: &TableOne) {
    let others: Vec<String> = group.others.iter().map(|(name, value)| format!("{name} {value}")).collect();
    let case = |&(grid, bounds, ..): &(&str, &str, i64, i64)| {
        let cell = group.cells.get(&(grid.to_owned(), bounds.to_owned()));
        let found = cell.and_then(|c| c.deficiencies).map(|(a, aj)| format!("{}/{}", printed(a), printed(aj)));
        found.unwrap_or_else(|| NOTHING_THERE.to_owned())
    };
    let cells: Vec<String> = THESIS.iter().map(case).collect();
    say(&wrapped(&format!("{}: {} numbers, {}", others.join(", "), group.matches(), cells.join("  ")), "  "));
}
