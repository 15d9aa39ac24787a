//! The fronts of a pattern, in the order in which they are eliminated.

use std::collections::HashMap;
use std::ops::Range;

use super::front::{LANE, Lane};
use crate::numerics::sparse::Sparse;

/// Work of a front beside that of its pivots, in multiplications.
const FRONT: usize = 2000;

/// A front while the order of elimination is not known yet.
#[derive(Clone, Debug, Default)]
struct Draft {
    own: Vec<usize>,
    border: Vec<usize>,
    /// (row, column, slot in the matrix' values)
    entries: Vec<(usize, usize, usize)>,
}

/// The patterns of the dense fronts, each after those that it takes in. One after the other in memory, and as small as can be: a factorisation reads
/// them all.
#[derive(Clone, Debug, Default)]
pub struct Fronts {
    heads: Vec<Head>,
    unknowns: Vec<u32>,
    places: Vec<u16>,
    /// Length of all borders: where the places of the next front begin, which are known only when it is taken in.
    borders: usize,
    entries: Vec<Entry>,
}

/// Where a front begins in the lists, and how many are of a kind.
#[derive(Clone, Copy, Debug)]
struct Head {
    unknowns: u32,
    own: u32,
    places: u32,
    entries: u32,
    loose: u32,
    couplings: u32,
    takes: u32,
}

/// The pattern of a front.
#[derive(Clone, Copy, Debug)]
pub struct Pattern<'f> {
    /// Its own, then the border: later unknowns met so far, those first that are eliminated first.
    pub unknowns: &'f [u32],
    pub own: usize,
    /// Of the border in the front that takes this one in, among its unknowns: ascending.
    pub places: &'f [u16],
    /// How many fronts it takes in: those last that are not taken in yet.
    pub takes: usize,
    /// Row ≤ column.
    pub entries: &'f [Entry],
    /// Of the entries: diagonal ones of own unknowns that nothing may couple, and those that couple them.
    pub loose: &'f [Entry],
    pub couplings: &'f [Entry],
}

impl Fronts {
    pub fn len(&self) -> usize {
        self.heads.len()
    }

    pub fn get(&self, f: usize) -> Pattern<'_> {
        let head = self.heads[f];
        let (unknowns, places, entries) = match self.heads.get(f + 1) {
            Some(next) => (next.unknowns as usize, next.places as usize, next.entries as usize),
            None => (self.unknowns.len(), self.places.len(), self.entries.len()),
        };
        let entries = &self.entries[head.entries as usize..entries];
        let (loose, others) = entries.split_at(head.loose as usize);
        Pattern {
            unknowns: &self.unknowns[head.unknowns as usize..unknowns],
            own: head.own as usize,
            places: &self.places[head.places as usize..places],
            takes: head.takes as usize,
            entries,
            loose,
            couplings: &others[..head.couplings as usize],
        }
    }

    pub fn iter(&self) -> impl Iterator<Item = Pattern<'_>> {
        (0..self.len()).map(|f| self.get(f))
    }

    /// Bytes that a factorisation takes if no pivot is delayed: D Lᵀ, and the largest front with what it leaves.
    pub fn bytes(&self) -> usize {
        let lanes = |columns: usize| columns.div_ceil(LANE);
        let factors = |front: Pattern<'_>| (0..front.own).map(|i| lanes(front.unknowns.len() - i) + 1).sum::<usize>();
        let size = |front: Pattern<'_>| front.unknowns.len() * lanes(front.unknowns.len());
        let largest = self.iter().map(size).max().unwrap_or(0);
        (self.iter().map(factors).sum::<usize>() + 2 * largest) * size_of::<Lane>()
    }

    /// Adds a front with these entries by kind.
    fn add(&mut self, own: &[usize], border: &[usize], [loose, couplings, others]: [&[Entry]; 3], takes: usize) {
        self.heads.push(Head {
            unknowns: index(self.unknowns.len()),
            own: index(own.len()),
            places: index(self.borders),
            entries: index(self.entries.len()),
            loose: index(loose.len()),
            couplings: index(couplings.len()),
            takes: index(takes),
        });
        self.borders += border.len();
        self.unknowns.extend(own.iter().chain(border).map(|&i| index(i)));
        self.entries.extend([loose, couplings, others].into_iter().flatten());
    }
}

fn index(i: usize) -> u32 {
    u32::try_from(i).expect("fewer entries")
}

impl Pattern<'_> {
    pub fn border(&self) -> &[u32] {
        &self.unknowns[self.own..]
    }
}

/// An entry of the matrix: the places of its row and column among the unknowns of a front, and its slot in the matrix' values.
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    places: [u16; 2],
    slot: u32,
}

impl Entry {
    fn new(row: usize, column: usize, slot: usize) -> Self {
        Self { places: [narrow(row), narrow(column)], slot: index(slot) }
    }

    pub fn places(&self) -> [usize; 2] {
        self.places.map(usize::from)
    }

    pub fn slot(&self) -> usize {
        self.slot as usize
    }

    /// Its value in S K S, S being that of the front's unknowns.
    pub fn value(&self, values: &[f64], scale: &[f64]) -> f64 {
        let [of_row, of_column] = self.places().map(|place| scale[place]);
        values[self.slot()] * of_row * of_column
    }
}

fn narrow(place: usize) -> u16 {
    u16::try_from(place).expect("a dense front of no more unknowns than that")
}

/// The fronts of `matrix` (upper triangle); `stage[i]` is the stage of unknown i, counted from 0.
/// `equations` are unknowns with nothing on the diagonal, which are no pivots by themselves, `loose` ones that nothing may couple.
pub fn fronts(matrix: &Sparse, stage: &[usize], equations: Range<usize>, loose: Range<usize>) -> Fronts {
    let order = matrix.columns;
    let count = stage.iter().max().map_or(0, |last| last + 1);
    // From the last back: what a state follows from comes with it, so that it need not be delayed.
    let stage: Vec<usize> = stage.iter().map(|s| count - 1 - s).collect();
    // The first stage that meets each unknown is that of its earliest neighbour. Unknowns with few neighbours come first: they fill
    // in least.
    let mut met = stage.clone();
    let mut degree = vec![0; order];
    let mut by_stage = vec![Vec::new(); count];
    for (row, column, slot) in matrix.entries() {
        let earliest = stage[row].min(stage[column]);
        by_stage[earliest].push((row, column, slot));
        for i in [row, column] {
            met[i] = met[i].min(earliest);
            degree[i] += 1;
        }
    }
    let mut stages = vec![Draft::default(); count];
    for i in 0..order {
        stages[stage[i]].own.push(i);
        stages[met[i]..stage[i]].iter_mut().for_each(|s| s.border.push(i));
    }
    let mut analysis = Analysis { degree, met, equations, group: vec![None; order], best: HashMap::new() };
    let parted: Vec<Vec<Draft>> = stages
        .into_iter()
        .zip(by_stage)
        .enumerate()
        .map(|(s, (mut stage, entries))| {
            stage.own.sort_by_key(|&i| analysis.degree[i]);
            analysis.part(s, &Draft { entries, ..stage })
        })
        .collect();
    numbered(parted, order, loose)
}

/// From unknowns to places in the fronts, now that the order of elimination is known.
fn numbered(stages: Vec<Vec<Draft>>, order: usize, loose: Range<usize>) -> Fronts {
    let (mut rank, mut place) = (vec![0; order], vec![0; order]);
    let own = stages.iter().flatten().flat_map(|front| &front.own);
    own.enumerate().for_each(|(when, &i)| rank[i] = when);
    let mut fronts = Fronts::default();
    // Of the fronts that are not taken in yet.
    let mut waiting: Vec<Vec<usize>> = Vec::new();
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
                kinds[kind].push(Entry::new(row, column, slot));
            }
            // The last one takes in the others.
            let taken = if f + 1 == count { std::mem::take(&mut waiting) } else { Vec::new() };
            fronts.places.extend(taken.iter().flatten().map(|&i| narrow(place[i])));
            fronts.add(&own, &border, kinds.each_ref().map(Vec::as_slice), taken.len());
            waiting.push(border);
        }
    }
    fronts
}

/// What is known of each unknown.
struct Analysis {
    degree: Vec<usize>,
    /// The first stage that meets it.
    met: Vec<usize>,
    equations: Range<usize>,
    /// Its group, if it belongs to one, while its stage is looked at.
    group: Vec<Option<usize>>,
    /// How few neighbours were best (none: a stage in one) in stages of so many own unknowns, border unknowns and entries with these degrees.
    best: HashMap<(usize, usize, usize, Vec<usize>), Option<usize>>,
}

impl Analysis {
    /// Parts a stage into fronts of groups and, last, that of the rest: unknowns that no earlier stage has met and that have few
    /// neighbours, in groups that nothing couples to one another. How few is chosen by the work that is left, once for all stages alike.
    fn part(&mut self, s: usize, stage: &Draft) -> Vec<Draft> {
        let mut limits: Vec<usize> = stage.own.iter().filter(|&&i| self.met[i] == s).map(|&i| self.degree[i]).collect();
        limits.dedup();
        let kind = (stage.own.len(), stage.border.len(), stage.entries.len(), limits);
        if let Some(&limit) = self.best.get(&kind) {
            return limit.map_or_else(|| vec![stage.clone()], |limit| self.parted(s, stage, limit));
        }
        let (mut least, mut chosen) = (work(stage.own.len(), stage.border.len()), None);
        for &limit in &kind.3 {
            let groups = self.groups(s, stage, limit);
            let all = self.work(stage, groups);
            if all < least {
                (least, chosen) = (all, Some(limit));
            }
        }
        self.best.insert(kind, chosen);
        chosen.map_or_else(|| vec![stage.clone()], |limit| self.parted(s, stage, limit))
    }

    /// Numbers the connected groups of the unknowns with few neighbours, as they come; those without a pivot are none. Returns how many.
    fn groups(&mut self, s: usize, stage: &Draft, few: usize) -> usize {
        // Each points to one of its group that comes no later.
        let mut first: Vec<usize> = (0..stage.own.len()).collect();
        fn root(first: &mut [usize], mut at: usize) -> usize {
            while first[at] != at {
                first[at] = first[first[at]];
                at = first[at];
            }
            at
        }
        for (at, &i) in stage.own.iter().enumerate() {
            self.group[i] = (self.met[i] == s && self.degree[i] <= few).then_some(at);
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

    /// Work of the fronts of a stage parted into the groups that are set.
    fn work(&self, stage: &Draft, groups: usize) -> usize {
        let (mut own, mut border) = (vec![0; groups + 1], vec![0; groups + 1]);
        stage.own.iter().for_each(|&i| own[self.group[i].unwrap_or(groups)] += 1);
        let mut met: Vec<(usize, usize)> = self.borders(stage).collect();
        met.sort_unstable();
        met.dedup();
        met.iter().for_each(|&(group, _)| border[group] += 1);
        border[groups] = stage.border.len();
        own.iter().zip(&border).map(|(&own, &border)| work(own, border)).sum()
    }

    /// (group, unknown that it meets outside), as often as it does.
    fn borders<'a>(&'a self, stage: &'a Draft) -> impl Iterator<Item = (usize, usize)> + 'a {
        stage.entries.iter().filter_map(|&(i, j, _)| match (self.group[i], self.group[j]) {
            (Some(group), None) => Some((group, j)),
            (None, Some(group)) => Some((group, i)),
            _ => None,
        })
    }

    /// The fronts of a stage: the groups, and the rest.
    fn parted(&mut self, s: usize, stage: &Draft, few: usize) -> Vec<Draft> {
        let count = self.groups(s, stage, few);
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

/// Multiplications of the elimination of a front.
fn work(own: usize, border: usize) -> usize {
    FRONT + ((own + border).pow(3) - border.pow(3)) / 3
}
