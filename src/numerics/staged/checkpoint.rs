//! States from which a factorisation can resume if only later fronts have changed since the previous one. An active-set
//! change in a few rows leaves most fronts as they were.

use super::analysis::{FrontPattern, Fronts};
use super::front::LANE;
use super::{Contribution, Factors, Work, ZERO};

/// A checkpoint is stored once the factors have grown by this many times its size since the previous one.
const FACTORS_PER_CHECKPOINT: usize = 32;

#[derive(Clone, Debug, Default)]
pub struct Checkpoints {
    /// Entries of S K S in the fronts eliminated so far, front by front.
    pub entries: Vec<f64>,
    /// The first `count` are valid; the others are memory to reuse.
    all: Vec<Checkpoint>,
    count: usize,
}

/// State of the elimination at a moment when only one contribution was pending.
#[derive(Clone, Debug, Default)]
struct Checkpoint {
    /// Number of fronts eliminated.
    fronts: usize,
    /// The contribution of the last of them.
    contribution: Contribution,
    /// Length of [`Checkpoints::entries`].
    entries: usize,
    /// Numbers of fronts with pivots, of uncoupled unknowns, and of lanes in the factors.
    kept: [usize; 2],
    lanes: usize,
}

impl Checkpoints {
    /// Rewinds the elimination to the last checkpoint before the first change. Returns the number of fronts that can be
    /// reused.
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
            work.pending = 0;
            return 0;
        };
        self.entries.truncate(last.entries);
        factors.truncate(last.kept[0], last.kept[1]);
        work.contributions[0].copy_from(&last.contribution);
        work.pending = 1;
        last.fronts
    }

    /// Number of leading fronts whose entries have not changed.
    fn count_same(&self, fronts: &Fronts, (values, scale): (&[f64], &[f64]), front_scale: &mut Vec<f64>) -> usize {
        let mut before = self.entries.as_slice();
        let is_same = |pattern: &FrontPattern<'_>| {
            let Some((old_entries, later)) = before.split_at_checked(pattern.entries.len()) else { return false };
            before = later;
            front_scale.clear();
            front_scale.extend(pattern.unknowns.iter().map(|&i| scale[i as usize]));
            pattern.entries.iter().zip(old_entries).all(|(entry, value)| entry.value(values, front_scale) == *value)
        };
        fronts.iter().take_while(is_same).count()
    }

    /// Stores a checkpoint after `fronts` fronts if only one contribution is pending and the factors have grown enough.
    pub fn record(&mut self, fronts: usize, factors: &Factors, pending: &[Contribution]) {
        let [contribution] = pending else { return };
        let lanes = factors.rows.len();
        let since = self.count.checked_sub(1).map_or(0, |last| self.all[last].lanes);
        if lanes - since < FACTORS_PER_CHECKPOINT * (contribution.border.len() + contribution.rows.len() / LANE) {
            return;
        }
        if self.all.len() == self.count {
            self.all.push(Checkpoint::default());
        }
        let checkpoint = &mut self.all[self.count];
        checkpoint.contribution.copy_from(contribution);
        (checkpoint.fronts, checkpoint.entries, checkpoint.lanes) = (fronts, self.entries.len(), lanes);
        checkpoint.kept = [factors.fronts.len(), factors.uncoupled.len()];
        self.count += 1;
    }
}
