//! Where an elimination can go on if it differs from the last one only in later fronts: of an active set that changes in few rows much stays as it is.

use super::analysis::{Fronts, Pattern};
use super::front::LANE;
use super::{Factors, Rest, Work, ZERO};

/// There are so many times as many numbers of the factors as of the checkpoints.
const SPARSE: usize = 32;

#[derive(Clone, Debug, Default)]
pub struct Checkpoints {
    /// The entries of S K S of the fronts that have been eliminated, front by front.
    pub entries: Vec<f64>,
    /// The first `count` are of this elimination.
    all: Vec<Checkpoint>,
    count: usize,
}

/// The elimination as it stood when only one front waited to be taken in.
#[derive(Clone, Debug, Default)]
struct Checkpoint {
    /// How many fronts had been eliminated, and what was left of the last.
    fronts: usize,
    rest: Rest,
    entries: usize,
    /// Of the factors: fronts that have pivots, unknowns that nothing couples, and lanes.
    kept: [usize; 2],
    lanes: usize,
}

impl Checkpoints {
    /// Takes the elimination back to where nothing has changed before. Returns how many fronts need not be eliminated again.
    pub fn resume(
        &mut self,
        fronts: &Fronts,
        (values, scale): (&[f64], &[f64]),
        factors: &mut Factors,
        work: &mut Work,
    ) -> usize {
        let same = if factors.is_finite() { self.count_same(fronts, (values, scale), &mut work.scale) } else { 0 };
        self.count = self.all[..self.count].partition_point(|checkpoint| checkpoint.fronts <= same);
        factors.zeros = ZERO;
        let Some(last) = self.count.checked_sub(1).map(|last| &self.all[last]) else {
            self.entries.clear();
            factors.truncate(0, 0);
            work.waiting = 0;
            return 0;
        };
        self.entries.truncate(last.entries);
        factors.truncate(last.kept[0], last.kept[1]);
        work.rests[0].copy_from(&last.rest);
        work.waiting = 1;
        last.fronts
    }

    /// How many of the fronts have the entries that they had.
    fn count_same(&self, fronts: &Fronts, (values, scale): (&[f64], &[f64]), of_front: &mut Vec<f64>) -> usize {
        let mut before = self.entries.as_slice();
        let is_same = |pattern: &Pattern<'_>| {
            let Some((of_this, later)) = before.split_at_checked(pattern.entries.len()) else { return false };
            before = later;
            of_front.clear();
            of_front.extend(pattern.unknowns.iter().map(|&i| scale[i as usize]));
            pattern.entries.iter().zip(of_this).all(|(entry, value)| entry.value(values, of_front) == *value)
        };
        fronts.iter().take_while(is_same).count()
    }

    /// Keeps what is left after so many fronts, if it is time to.
    pub fn pass(&mut self, fronts: usize, factors: &Factors, waiting: &[Rest]) {
        let [rest] = waiting else { return };
        let lanes = factors.rows.len();
        let since = self.count.checked_sub(1).map_or(0, |last| self.all[last].lanes);
        if lanes - since < SPARSE * (rest.border.len() + rest.rows.len() / LANE) {
            return;
        }
        if self.all.len() == self.count {
            self.all.push(Checkpoint::default());
        }
        let checkpoint = &mut self.all[self.count];
        checkpoint.rest.copy_from(rest);
        (checkpoint.fronts, checkpoint.entries, checkpoint.lanes) = (fronts, self.entries.len(), lanes);
        checkpoint.kept = [factors.fronts.len(), factors.alone.len()];
        self.count += 1;
    }
}
