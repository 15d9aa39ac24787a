//! The place of every coefficient in the decision vector. The only file that knows it.
//!
//! Coefficients are in blocks, banded in time: a block has one coefficient of every function that has one there, quantity by
//! quantity in the order of their declaration. Before the first block there may be initial values, derivative by derivative.

use std::ops::Range;

use crate::problem::QuantityId;

/// The coefficients of a quantity.
#[derive(Clone, Debug)]
pub struct Family {
    /// Number of functions.
    pub members: usize,
    /// The blocks that hold their coefficients; none of a given quantity.
    pub blocks: Range<usize>,
    /// Number of derivatives, from 0 on, of which initial values are unknowns.
    pub initial: usize,
}

#[derive(Clone, Debug)]
pub struct Coefficients {
    families: Vec<Family>,
    /// Start of each block, and the end of the last.
    starts: Vec<usize>,
}

impl Coefficients {
    pub fn new(families: Vec<Family>) -> Self {
        let initial: usize = families.iter().map(|family| family.initial * family.members).sum();
        let blocks = families.iter().map(|family| family.blocks.end).max().unwrap_or(0);
        let mut starts = vec![initial];
        for block in 0..blocks {
            let held = families.iter().filter(|family| family.blocks.contains(&block));
            starts.push(starts[block] + held.map(|family| family.members).sum::<usize>());
        }
        Self { families, starts }
    }

    /// Length of the decision vector.
    pub fn total(&self) -> usize {
        self.starts[self.starts.len() - 1]
    }

    /// Number of coefficients of each function of a quantity.
    pub fn count(&self, quantity: QuantityId) -> usize {
        self.families[quantity.0].blocks.len()
    }

    /// Number of functions of a quantity.
    pub fn members(&self, quantity: QuantityId) -> usize {
        self.families[quantity.0].members
    }

    /// Coefficient `k` of a function.
    pub fn index(&self, quantity: QuantityId, k: usize, member: usize) -> usize {
        let block = self.families[quantity.0].blocks.start + k;
        let before = self.families[..quantity.0].iter().filter(|family| family.blocks.contains(&block));
        self.starts[block] + before.map(|family| family.members).sum::<usize>() + member
    }

    /// The initial value of a derivative of a function.
    pub fn initial(&self, quantity: QuantityId, derivative: usize, member: usize) -> usize {
        let before = self.families[..quantity.0].iter().map(|family| family.initial * family.members);
        before.sum::<usize>() + derivative * self.families[quantity.0].members + member
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_place_is_taken_once() {
        let family = |members, blocks, initial| Family { members, blocks, initial };
        let families = [family(3, 0..7, 2), family(2, 0..6, 1), family(4, 0..0, 0), family(2, 0..5, 0)];
        let coefficients = Coefficients::new(families.to_vec());
        let mut places = Vec::new();
        for (id, family) in families.iter().enumerate() {
            let id = QuantityId(id);
            for member in 0..family.members {
                places.extend((0..family.initial).map(|d| coefficients.initial(id, d, member)));
                places.extend((0..coefficients.count(id)).map(|k| coefficients.index(id, k, member)));
            }
        }
        places.sort_unstable();
        assert_eq!(places, (0..coefficients.total()).collect::<Vec<_>>());
    }
}
