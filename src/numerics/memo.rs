//! What a function has worked out, kept for the next call with the same arguments.

use std::collections::VecDeque;
use std::sync::{Mutex, PoisonError};

/// The last few results of a function that always gives the same for the same arguments; for all threads.
pub struct Memo<A, R> {
    known: Mutex<VecDeque<(A, R)>>,
}

const CAPACITY: usize = 32;

impl<A: PartialEq, R: Clone> Memo<A, R> {
    pub const fn new() -> Self {
        Self { known: Mutex::new(VecDeque::new()) }
    }

    /// The result for these arguments, worked out if it is not known.
    pub fn get(&self, arguments: A, work_out: impl FnOnce() -> R) -> R {
        let known = || self.known.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, result)) = known().iter().find(|(others, _)| *others == arguments) {
            return result.clone();
        }
        let result = work_out();
        let mut known = known();
        if known.len() == CAPACITY {
            known.pop_front();
        }
        known.push_back((arguments, result.clone()));
        result
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_worked_out_once_and_the_oldest_are_forgotten() {
        let memo = Memo::new();
        let mut worked_out = Vec::new();
        let mut square = |x: usize| {
            memo.get(x, || {
                worked_out.push(x);
                x * x
            })
        };
        assert_eq!([3, 3, 4].map(&mut square), [9, 9, 16]);
        (100..100 + CAPACITY - 1).for_each(|x| assert_eq!(square(x), x * x));
        assert_eq!([4, 3].map(&mut square), [16, 9]);
        assert_eq!(worked_out.iter().filter(|&&x| x == 3).count(), 2);
        assert_eq!(worked_out.iter().filter(|&&x| x == 4).count(), 1);
    }
}
