//! Compares results with Table 1 of the thesis: which of its twelve numbers are reproduced.
//!
//! Source: M. Lund Ohlsson, licentiate thesis 41, Mid Sweden University 2009, Paper B, Table 1 (numbers only; printed
//! as negative there). The caption gives h = 0.1 and h = 0.2. However, an idle muscle adds p − 1 to the deficiency of
//! A, 5 at h = 0.2 and 10 at h = 0.1, so the numbers belong to h = 0.2.

use std::collections::BTreeMap;

use crate::tables::Table;

/// (load-sharing grid, bounds, deficiency of A, deficiency of [Aᵀ Jᵀ])
pub const THESIS: [(&str, &str, i64, i64); 6] = [
    ("measurement", "activation", 0, 1),
    ("measurement", "excitation", 0, 0),
    ("measurement", "both", 10, 2),
    ("collocation", "activation", 0, 6),
    ("collocation", "excitation", 0, 2),
    ("collocation", "both", 6, 1),
];

/// The deficiencies of A and [Aᵀ Jᵀ] in the thesis, if Table 1 has this case.
pub fn thesis(grid: &str, bounds: &str) -> Option<(i64, i64)> {
    THESIS.iter().find(|(g, b, ..)| *g == grid && *b == bounds).map(|&(_, _, a, aj)| (a, aj))
}

/// One case of Table 1 as computed.
#[derive(Clone, Debug, PartialEq)]
pub struct Cell {
    /// Row in the table of jobs.
    pub job: usize,
    pub status: String,
    /// Of A and [Aᵀ Jᵀ].
    pub deficiencies: Option<(i64, i64)>,
    /// The same, as predicted from the pattern of active bounds.
    pub predicted: Option<(i64, i64)>,
    /// Whether the singular values have no clear gap at the tolerance.
    pub ambiguous: bool,
}

/// The cases that share the values of all other axes, by (load-sharing grid, bounds).
#[derive(Clone, Debug, PartialEq)]
pub struct TableOne {
    pub others: Vec<(String, String)>,
    pub cells: BTreeMap<(String, String), Cell>,
}

impl TableOne {
    /// How many of the twelve numbers equal those of the thesis.
    pub fn matches(&self) -> usize {
        self.count(|cell| cell.deficiencies)
    }

    /// How many of the twelve predicted numbers equal those of the thesis.
    pub fn predicted_matches(&self) -> usize {
        self.count(|cell| cell.predicted)
    }

    /// Number of cases whose singular values have no clear gap at the tolerance, so that another tolerance would give
    /// other deficiencies.
    pub fn ambiguous(&self) -> usize {
        self.cells.values().filter(|cell| cell.ambiguous).count()
    }

    fn count(&self, pair: impl Fn(&Cell) -> Option<(i64, i64)>) -> usize {
        let matches_in_case = |&(grid, bounds, a, aj): &(&str, &str, i64, i64)| {
            let cell = self.cells.get(&(grid.to_owned(), bounds.to_owned()))?;
            let found = pair(cell).filter(|_| cell.status == "converged")?;
            Some(usize::from(found.0 == a) + usize::from(found.1 == aj))
        };
        THESIS.iter().filter_map(matches_in_case).sum()
    }
}

/// The groups of a study that sweeps `load_sharing_grid` and `bounds`, in job order; empty for other studies.
pub fn groups(jobs: &Table, regularity: &Table, axes: &[String]) -> Vec<TableOne> {
    let needed = ["load_sharing_grid", "bounds"];
    if !needed.iter().all(|name| axes.iter().any(|axis| axis == name)) {
        return Vec::new();
    }
    // In a sampled study, the number of the sample determines the other sampled columns.
    let sampled = axes.iter().any(|axis| axis == crate::study::axis::SAMPLE);
    let key = |axis: &String| !needed.contains(&axis.as_str()) && (!sampled || axis == "sample" || !axis.contains('.'));
    let rank_rows: BTreeMap<&str, usize> =
        (0..regularity.rows()).filter_map(|row| Some((regularity.text("job_id", row)?, row))).collect();
    let mut groups: Vec<TableOne> = Vec::new();
    let mut place: BTreeMap<Vec<(String, String)>, usize> = BTreeMap::new();
    for row in 0..jobs.rows() {
        let others: Vec<(String, String)> =
            axes.iter().filter(|a| key(a)).map(|a| (a.clone(), jobs.display(a, row).unwrap_or_default())).collect();
        let (Some(grid), Some(bounds), Some(id)) =
            (jobs.text("load_sharing_grid", row), jobs.text("bounds", row), jobs.text("job_id", row))
        else {
            continue;
        };
        let rank = rank_rows.get(id).copied();
        let pair = |a: &str, aj: &str| rank.and_then(|r| regularity.integer(a, r).zip(regularity.integer(aj, r)));
        let cell = Cell {
            job: row,
            status: jobs.text("status", row).unwrap_or_default().to_owned(),
            deficiencies: pair("deficiency_a", "deficiency_aj"),
            predicted: pair("predicted_deficiency_a", "predicted_deficiency_aj"),
            ambiguous: rank.and_then(|r| regularity.flag("ambiguous", r)).unwrap_or(false),
        };
        let at = *place.entry(others.clone()).or_insert_with(|| {
            groups.push(TableOne { others, cells: BTreeMap::new() });
            groups.len() - 1
        });
        groups[at].cells.insert((grid.to_owned(), bounds.to_owned()), cell);
    }
    groups
}
