//! Puts active bounds exactly on their value and restores the equalities, so that a rank can be taken: iterates with
//! a bound at 1e-9 instead of 0 miscount.

use super::iterate::Iterate;
use super::kkt::{Kkt, Rows};
use super::problem::Problem;

/// A bound is active when its slack is at most this, by value; weakly active bounds included.
pub const ACTIVE: f64 = 1e-8;
const EXACT: f64 = 1e-13;
const STEPS: usize = 8;

/// Which inequalities are active at `values` = d(x).
pub fn active(values: &[f64]) -> Vec<bool> {
    values.iter().map(|&slack| slack <= ACTIVE).collect()
}

/// The point next to `x` (least change) where `c = 0` and the `active` rows of d vanish, to 1e-13 of the largest
/// unknown (fibre lengths that alternate widely leave no more digits).
///
/// `kkt`: that of this problem. `None` if Newton's method on them does not get there.
pub fn polish(kkt: &mut Kkt, problem: &dyn Problem, x: &[f64], active: &[bool]) -> Option<Vec<f64>> {
    let [_, _, pattern] = problem.patterns();
    let mut identity = pattern.clone();
    for column in 0..identity.columns {
        for slot in identity.column_start[column]..identity.column_start[column + 1] {
            identity.values[slot] = if identity.row_index[slot] as usize == column { 1.0 } else { 0.0 };
        }
    }
    let mut here = Iterate::new(problem, x.to_vec());
    let mut solution = vec![0.0; kkt.order()];
    for _ in 0..STEPS {
        let right = here.onto_constraints(active);
        let size = right.iter().fold(0.0f64, |a, r| a.max(r.abs()));
        let largest = here.x.iter().fold(1.0f64, |a, x| a.max(x.abs()));
        if size <= EXACT * largest {
            return Some(here.x);
        }
        kkt.factorise(&here.system((&identity, &identity), 0.0, Rows::Active(active)))?;
        kkt.solve(&right, &mut solution);
        here.x.iter_mut().zip(&solution).for_each(|(x, d)| *x += d);
        here.evaluate(problem);
        here.differentiate(problem);
        if !here.is_finite() {
            return None;
        }
    }
    None
}
