//! How far the mean force of each muscle could be otherwise at nearly the same cost, where instants depend on one another: by a
//! quadratic model at the optimum,
//!
//! ```text
//! least and largest  cᵀd    subject to    ∇fᵀd + ½ dᵀ∇²L d ≤ ε E*,   A d = 0,   d(x) + B d ≥ 0
//! ```
//!
//! c is the slope of the mean force, E* the muscles' part of f. An estimate: curvature of higher order is left out. Each end lies
//! on a curve of optima, of the model less t cᵀd: the t at which the model reaches the budget is found from the model's growth
//! with t².

use crate::nlp::curvature::Model;
use crate::nlp::iterate::Iterate;
use crate::nlp::kkt::Kkt;
use crate::nlp::options::SqpOptions;
use crate::nlp::state::State;
use crate::nlp::subproblem::interior_point::{self, Manner};
use crate::solution::Solution;

/// The budget is met to this share.
const ACCURACY: f64 = 0.02;
const MAX_STEPS: usize = 12;
/// A longer t that makes a range longer by less than this share ends it: bounds do.
const LITTLE: f64 = 1e-3;
/// Tolerance of the programmes.
const TOLERANCE: f64 = 1e-6;
/// Of the weight of the proximal term: the model must be convex with next to nothing of it.
const MOST_DAMPING: f64 = 1e-5;

/// How much smaller and how much larger the mean force of each muscle could be, N; `share`: ε. `None` where the model is not
/// strictly convex, a programme fails, or there is no effort.
pub fn changes(solution: &Solution<'_>, kkt: &mut Kkt, share: f64) -> Vec<Option<[f64; 2]>> {
    let options = SqpOptions::default();
    let here: Iterate = solution.iterate.clone();
    let gradient = here.gradient.clone();
    let mut state = State::new(kkt, solution.problem, here, options.progress);
    state.models.begin(&solution.iterate.x);
    let room = share * solution.muscle_cost();
    let mut search = Search { state, options, gradient, room };
    let of = |slope: &Vec<f64>| Some([search.end(slope, -1.0)?.min(0.0), search.end(slope, 1.0)?.max(0.0)]);
    solution.mean_force_gradients().iter().map(of).collect()
}

struct Search<'s> {
    state: State<'s>,
    options: SqpOptions,
    gradient: Vec<f64>,
    room: f64,
}

impl Search<'_> {
    /// cᵀd at one end of the range.
    fn end(&mut self, slope: &[f64], sign: f64) -> Option<f64> {
        let largest = |values: &[f64]| values.iter().fold(0.0f64, |a, v| a.max(v.abs()));
        if self.room.is_nan() || self.room <= 0.0 {
            return None;
        }
        if largest(slope) == 0.0 {
            return Some(0.0);
        }
        let mut t = 0.1 * largest(&self.gradient) / largest(slope);
        let (mut small, mut large): (Option<f64>, Option<f64>) = (None, None);
        // The longest within the budget.
        let mut inside: Option<f64> = None;
        for _ in 0..MAX_STEPS {
            let (cost, change) = self.tilted(slope, sign * t)?;
            let ratio = cost / self.room;
            let is_blocked = ratio < 1.0 && inside.is_some_and(|last| (change - last).abs() <= LITTLE * change.abs());
            if (ratio - 1.0).abs() <= ACCURACY || is_blocked {
                return Some(change);
            }
            if ratio < 1.0 {
                (small, inside) = (Some(t), Some(change));
            } else {
                large = Some(t);
            }
            let guess = t / ratio.clamp(1e-4, 1e4).sqrt();
            t = match (small, large) {
                (Some(small), Some(large)) if guess <= small || guess >= large => (small * large).sqrt(),
                _ => guess,
            };
        }
        // The budget lies at a corner: the inner side of it.
        inside
    }

    /// What d costs, and cᵀd, where the model less t cᵀd is least.
    fn tilted(&mut self, slope: &[f64], t: f64) -> Option<(f64, f64)> {
        let tilted = self.gradient.iter().zip(slope).map(|(g, c)| g - t * c);
        self.state.here.gradient = tilted.collect();
        let steps = self.options.interior_point.max_iterations;
        let manner = Manner { most: MOST_DAMPING, tolerance: TOLERANCE, steps, is_plain: true };
        let step = interior_point::solve(&mut self.state, &self.options, Model::Exact, 0.0, manner, &mut None).ok()?;
        let d = step.direction;
        let (hessian, _) = self.state.models.at(Model::Exact, &self.state.here);
        let mut product = vec![0.0; d.len()];
        hessian.add_symmetric_product(0.5, &d, &mut product);
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        Some((dot(&self.gradient, &d) + dot(&product, &d), dot(slope, &d)))
    }
}
