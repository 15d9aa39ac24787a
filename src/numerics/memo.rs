//! A small cache of function results, keyed by the arguments.

use std::collections::VecDeque;
use std::sync::{Mutex, PoisonError};

/// The latest results of a pure function, shared by all threads.
pub struct Memo<A, R> {
    entries: Mutex<VecDeque<(A, R)>>,
}

/// Number of results kept.
const CAPACITY: usize = 32;

impl<A: PartialEq, R: Clone> Memo<A, R> {
    pub const fn new() -> Self {
        Self { entries: Mutex::new(VecDeque::new()) }
    }

    /// The result for these arguments: from the cache, or computed by `compute` and stored.
    pub fn get(&self, arguments: A, compute: impl FnOnce() -> R) -> R {
        let entries = || self.entries.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, result)) = entries().iter().find(|(stored, _)| *stored == arguments) {
            return result.clone();
        }
        let result = compute();
        let mut entries = entries();
        if entries.len() == CAPACITY {
            entries.pop_front();
        }
        entries.push_back((arguments, result.clone()));
        result
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_computed_once_and_the_oldest_are_evicted() {
        let memo = Memo::new();
        let mut computed = Vec::new();
        let mut square = |x: usize| {
            memo.get(x, || {
                computed.push(x);
                x * x
            })
        };
        assert_eq!([3, 3, 4].map(&mut square), [9, 9, 16]);
        (100..100 + CAPACITY - 1).for_each(|x| assert_eq!(square(x), x * x));
        assert_eq!([4, 3].map(&mut square), [16, 9]);
        assert_eq!(computed.iter().filter(|&&x| x == 3).count(), 2);
        assert_eq!(computed.iter().filter(|&&x| x == 4).count(), 1);
    }
}
