//! Symbolic analysis: the fronts of a sparsity pattern, in elimination order.

use std::collections::HashMap;
use std::ops::Range;

use super::front::{LANE, Lane};
use crate::numerics::sparse::Sparse;

/// Fixed overhead of a front, in multiplications.
const FRONT_OVERHEAD: usize = 2000;

/// A front before the elimination order is known.
#[derive(Clone, Debug, Default)]
struct Draft {
    own: Vec<usize>,
    border: Vec<usize>,
    /// (row, column, slot in the values of the matrix)
    entries: Vec<(usize, usize, usize)>,
}

/// Patterns of the dense fronts, children before parents. Stored contiguously and compactly, because every
/// factorisation reads them all.
#[derive(Clone, Debug, Default)]
pub struct Fronts {
    heads: Vec<Head>,
    unknowns: Vec<u32>,
    places: Vec<u16>,
    /// Total length of all borders so far, which is where the places of the next front begin. The places themselves are
    /// known only when its parent is numbered.
    borders: usize,
    entries: Vec<MatrixEntry>,
}

/// Where the data of a front begin in the lists of [`Fronts`], and the numbers of items of each kind.
#[derive(Clone, Copy, Debug)]
struct Head {
    unknowns: u32,
    own: u32,
    places: u32,
    entries: u32,
    loose: u32,
    couplings: u32,
    children: u32,
}

/// The pattern of a front.
#[derive(Clone, Copy, Debug)]
pub struct FrontPattern<'f> {
    /// Its own unknowns, then its border: later unknowns coupled so far, in elimination order.
    pub unknowns: &'f [u32],
    /// Number of its own unknowns.
    pub own: usize,
    /// Positions of the border unknowns among the unknowns of the parent front, ascending.
    pub places: &'f [u16],
    /// Number of child fronts: the latest ones whose contributions are still pending.
    pub children: usize,
    /// All entries, with row ≤ column.
    pub entries: &'f [MatrixEntry],
    /// Diagonal entries of own unknowns that may be uncoupled.
    pub loose: &'f [MatrixEntry],
    /// Entries that couple those unknowns to others.
    pub couplings: &'f [MatrixEntry],
}

impl Fronts {
    pub fn len(&self) -> usize {
        self.heads.len()
    }

    pub fn get(&self, f: usize) -> FrontPattern<'_> {
        let head = self.heads[f];
        let (unknowns, places, entries) = match self.heads.get(f + 1) {
            Some(next) => (next.unknowns as usize, next.places as usize, next.entries as usize),
            None => (self.unknowns.len(), self.places.len(), self.entries.len()),
        };
        let entries = &self.entries[head.entries as usize..entries];
        let (loose, others) = entries.split_at(head.loose as usize);
        FrontPattern {
            unknowns: &self.unknowns[head.unknowns as usize..unknowns],
            own: head.own as usize,
            places: &self.places[head.places as usize..places],
            children: head.children as usize,
            entries,
            loose,
            couplings: &others[..head.couplings as usize],
        }
    }

    pub fn iter(&self) -> impl Iterator<Item = FrontPattern<'_>> {
        (0..self.len()).map(|f| self.get(f))
    }

    /// Bytes that a factorisation needs if no pivot is delayed: D Lᵀ, plus the largest front and its contribution.
    pub fn bytes(&self) -> usize {
        let lanes = |columns: usize| columns.div_ceil(LANE);
        let factors =
            |front: FrontPattern<'_>| (0..front.own).map(|i| lanes(front.unknowns.len() - i) + 1).sum::<usize>();
        let size = |front: FrontPattern<'_>| front.unknowns.len() * lanes(front.unknowns.len());
        let largest = self.iter().map(size).max().unwrap_or(0);
        (self.iter().map(factors).sum::<usize>() + 2 * largest) * size_of::<Lane>()
    }

    /// Appends a front, with its entries grouped by kind.
    fn add(
        &mut self,
        own: &[usize],
        border: &[usize],
        [loose, couplings, others]: [&[MatrixEntry]; 3],
        children: usize,
    ) {
        self.heads.push(Head {
            unknowns: to_u32(self.unknowns.len()),
            own: to_u32(own.len()),
            places: to_u32(self.borders),
            entries: to_u32(self.entries.len()),
            loose: to_u32(loose.len()),
            couplings: to_u32(couplings.len()),
            children: to_u32(children),
        });
        self.borders += border.len();
        self.unknowns.extend(own.iter().chain(border).map(|&i| to_u32(i)));
        self.entries.extend([loose, couplings, others].into_iter().flatten());
    }
}

fn to_u32(i: usize) -> u32 {
    u32::try_from(i).expect("fewer than 2³² entries")
}

impl FrontPattern<'_> {
    pub fn border(&self) -> &[u32] {
        &self.unknowns[self.own..]
    }
}

/// An entry of the matrix: the positions of its row and column among the unknowns of a front, and its slot in the
/// values of the matrix.
#[derive(Clone, Copy, Debug)]
pub struct MatrixEntry {
    places: [u16; 2],
    slot: u32,
}

impl MatrixEntry {
    fn new(row: usize, column: usize, slot: usize) -> Self {
        Self { places: [to_u16(row), to_u16(column)], slot: to_u32(slot) }
    }

    pub fn places(&self) -> [usize; 2] {
        self.places.map(usize::from)
    }

    pub fn slot(&self) -> usize {
        self.slot as usize
    }

    /// Its value in S K S. `scale`: S of the front's unknowns.
    pub fn value(&self, values: &[f64], scale: &[f64]) -> f64 {
        let [row_scale, column_scale] = self.places().map(|place| scale[place]);
        values[self.slot()] * row_scale * column_scale
    }
}

fn to_u16(place: usize) -> u16 {
    u16::try_from(place).expect("fewer than 2¹⁶ unknowns in a front")
}

/// The fronts of `matrix` (upper triangle); `stage[i]` is the stage of unknown i, counted from 0. `equations` are
/// unknowns with a zero or negligible diagonal entry, which cannot be pivots on their own; `loose` ones may be
/// uncoupled.
pub fn fronts(matrix: &Sparse, stage: &[usize], equations: Range<usize>, loose: Range<usize>) -> Fronts {
    let order = matrix.columns;
    let count = stage.iter().max().map_or(0, |last| last + 1);
    // Eliminate from the last stage to the first: the equations that determine a state are then in the same front, and
    // the pivot need not be delayed.
    let stage: Vec<usize> = stage.iter().map(|s| count - 1 - s).collect();
    // An unknown enters the fronts at the stage of its earliest neighbour. Within a stage, unknowns of low degree are
    // eliminated first, as they cause the least fill-in.
    let mut entry_stage = stage.clone();
    let mut degree = vec![0; order];
    let mut by_stage = vec![Vec::new(); count];
    for (row, column, slot) in matrix.entries() {
        let earliest = stage[row].min(stage[column]);
        by_stage[earliest].push((row, column, slot));
        for i in [row, column] {
            entry_stage[i] = entry_stage[i].min(earliest);
            degree[i] += 1;
        }
    }
    let mut stages = vec![Draft::default(); count];
    for i in 0..order {
        stages[stage[i]].own.push(i);
        stages[entry_stage[i]..stage[i]].iter_mut().for_each(|s| s.border.push(i));
    }
    let mut analysis =
        Analysis { degree, entry_stage, equations, group: vec![None; order], best_limit: HashMap::new() };
    let stages: Vec<Vec<Draft>> = stages
        .into_iter()
        .zip(by_stage)
        .enumerate()
        .map(|(s, (mut stage, entries))| {
            stage.own.sort_by_key(|&i| analysis.degree[i]);
            analysis.split_stage(s, &Draft { entries, ..stage })
        })
        .collect();
    number_unknowns(stages, order, loose)
}

/// Converts unknowns to positions in the fronts, once the elimination order is known.
fn number_unknowns(stages: Vec<Vec<Draft>>, order: usize, loose: Range<usize>) -> Fronts {
    let (mut rank, mut place) = (vec![0; order], vec![0; order]);
    let own = stages.iter().flatten().flat_map(|front| &front.own);
    own.enumerate().for_each(|(when, &i)| rank[i] = when);
    let mut fronts = Fronts::default();
    // Borders of the fronts not yet assigned to a parent.
    let mut pending: Vec<Vec<usize>> = Vec::new();
    for stage in stages {
        let count = stage.len();
        for (f, Draft { own, mut border, entries }) in stage.into_iter().enumerate() {
            border.sort_unstable_by_key(|&i| rank[i]);
            own.iter().chain(&border).enumerate().for_each(|(at, &i)| place[i] = at);
            let is_loose = |&at: &usize| own.get(at).is_some_and(|i| loose.contains(i));
            let mut kinds = [const { Vec::new() }; 3];
            for (i, j, slot) in entries {
                let (row, column) = (place[i].min(place[j]), place[i].max(place[j]));
                let kind = if row == column && is_loose(&row) {
                    0
                } else if [row, column].iter().any(is_loose) {
                    1
                } else {
                    2
                };
                kinds[kind].push(MatrixEntry::new(row, column, slot));
            }
            // The last front of a stage is the parent of all pending ones.
            let child_borders = if f + 1 == count { std::mem::take(&mut pending) } else { Vec::new() };
            fronts.places.extend(child_borders.iter().flatten().map(|&i| to_u16(place[i])));
            fronts.add(&own, &border, kinds.each_ref().map(Vec::as_slice), child_borders.len());
            pending.push(border);
        }
    }
    fronts
}

/// Working data of the symbolic analysis, by unknown.
struct Analysis {
    degree: Vec<usize>,
    /// The stage at which it enters the fronts.
    entry_stage: Vec<usize>,
    equations: Range<usize>,
    /// Its group, if any, while its stage is being split.
    group: Vec<Option<usize>>,
    /// The cheapest degree limit (`None`: do not split the stage) by the stage's number of own unknowns, border
    /// unknowns and entries, and its candidate limits.
    best_limit: HashMap<(usize, usize, usize, Vec<usize>), Option<usize>>,
}

impl Analysis {
    /// Splits stage `s` into one front per group and, last, a front of the remaining unknowns. The groups are the
    /// connected components of the unknowns that enter at this stage and have at most a certain degree. The limit with
    /// the least elimination work is chosen, once for all stages of the same kind.
    fn split_stage(&mut self, s: usize, stage: &Draft) -> Vec<Draft> {
        let mut limits: Vec<usize> =
            stage.own.iter().filter(|&&i| self.entry_stage[i] == s).map(|&i| self.degree[i]).collect();
        limits.dedup();
        let kind = (stage.own.len(), stage.border.len(), stage.entries.len(), limits);
        if let Some(&limit) = self.best_limit.get(&kind) {
            return limit.map_or_else(|| vec![stage.clone()], |limit| self.split(s, stage, limit));
        }
        let (mut least, mut chosen) = (work(stage.own.len(), stage.border.len()), None);
        for &limit in &kind.3 {
            let groups = self.groups(s, stage, limit);
            let all = self.split_work(stage, groups);
            if all < least {
                (least, chosen) = (all, Some(limit));
            }
        }
        self.best_limit.insert(kind, chosen);
        chosen.map_or_else(|| vec![stage.clone()], |limit| self.split(s, stage, limit))
    }

    /// Numbers the connected components of the unknowns that enter at stage `s` and have degree ≤ `max_degree`, in
    /// order of first appearance. Components without a possible pivot are not groups. Returns the number of groups.
    fn groups(&mut self, s: usize, stage: &Draft, max_degree: usize) -> usize {
        // Union–find: each position points to one in its component that is not later.
        let mut first: Vec<usize> = (0..stage.own.len()).collect();
        fn root(first: &mut [usize], mut at: usize) -> usize {
            while first[at] != at {
                first[at] = first[first[at]];
                at = first[at];
            }
            at
        }
        for (at, &i) in stage.own.iter().enumerate() {
            self.group[i] = (self.entry_stage[i] == s && self.degree[i] <= max_degree).then_some(at);
        }
        for &(i, j, _) in &stage.entries {
            if let (Some(a), Some(b)) = (self.group[i], self.group[j])
                && a != b
            {
                let (a, b) = (root(&mut first, a), root(&mut first, b));
                first[a.max(b)] = a.min(b);
            }
        }
        let mut has_pivot = vec![false; stage.own.len()];
        for (at, &i) in stage.own.iter().enumerate() {
            if self.group[i].is_some() && !self.equations.contains(&i) {
                has_pivot[root(&mut first, at)] = true;
            }
        }
        let (mut number, mut count) = (vec![None; stage.own.len()], 0);
        for (at, &i) in stage.own.iter().enumerate() {
            let root = root(&mut first, at);
            if self.group[i].is_some() && has_pivot[root] && number[root].is_none() {
                number[root] = Some(count);
                count += 1;
            }
            self.group[i] = self.group[i].and(number[root]);
        }
        count
    }

    /// Work of eliminating a stage split into the current groups.
    fn split_work(&self, stage: &Draft, groups: usize) -> usize {
        let (mut own, mut border) = (vec![0; groups + 1], vec![0; groups + 1]);
        stage.own.iter().for_each(|&i| own[self.group[i].unwrap_or(groups)] += 1);
        let mut couplings: Vec<(usize, usize)> = self.borders(stage).collect();
        couplings.sort_unstable();
        couplings.dedup();
        couplings.iter().for_each(|&(group, _)| border[group] += 1);
        border[groups] = stage.border.len();
        own.iter().zip(&border).map(|(&own, &border)| work(own, border)).sum()
    }

    /// (group, unknown outside it that couples to it), once per coupling entry.
    fn borders<'a>(&'a self, stage: &'a Draft) -> impl Iterator<Item = (usize, usize)> + 'a {
        stage.entries.iter().filter_map(|&(i, j, _)| match (self.group[i], self.group[j]) {
            (Some(group), None) => Some((group, j)),
            (None, Some(group)) => Some((group, i)),
            _ => None,
        })
    }

    /// The fronts of a stage: one per group, then the one of the remaining unknowns.
    fn split(&mut self, s: usize, stage: &Draft, max_degree: usize) -> Vec<Draft> {
        let count = self.groups(s, stage, max_degree);
        let mut fronts = vec![Draft::default(); count + 1];
        for &i in &stage.own {
            fronts[self.group[i].unwrap_or(count)].own.push(i);
        }
        for &(i, j, slot) in &stage.entries {
            let front = self.group[i].or(self.group[j]).unwrap_or(count);
            fronts[front].entries.push((i, j, slot));
        }
        self.borders(stage).for_each(|(group, i)| fronts[group].border.push(i));
        for front in &mut fronts {
            front.border.sort_unstable();
            front.border.dedup();
        }
        fronts[count].border.clone_from(&stage.border);
        fronts
    }
}

/// Number of multiplications to eliminate a front, with its overhead.
fn work(own: usize, border: usize) -> usize {
    FRONT_OVERHEAD + ((own + border).pow(3) - border.pow(3)) / 3
}
