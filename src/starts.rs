//! What a job's solves start from, and the solves.

use rand::{RngExt, SeedableRng};

use crate::analysis::Runs;
use crate::methods::InverseProblem;
use crate::nlp::iterate::Iterate;
use crate::nlp::kkt::Kkt;
use crate::nlp::options::SqpOptions;
use crate::nlp::polish::active;
use crate::nlp::sqp::{Start, solve_with};
use crate::outcome::{SolutionPoint, Status};
use crate::settings::Settings;
use crate::transcription::collocation::Collocation;
use crate::transcription::scheme::Discretisation;

/// The start guess, if it is finite and there is time for it.
type GuessFunction<'s> = &'s dyn Fn() -> Option<Vec<f64>>;

/// The starts of a job: a warm one if there is one, and disturbed start guesses.
pub struct Starts<'s> {
    inverse: &'s InverseProblem<'s>,
    problem: &'s Collocation<'s>,
    settings: &'s Settings,
    warm: Option<Start>,
    /// `None` where the warm start is the only one.
    first: Option<Vec<f64>>,
    guess: GuessFunction<'s>,
}

impl<'s> Starts<'s> {
    /// # Errors
    /// If the start guess is needed and there is none.
    pub fn new(
        warm: Option<Start>,
        guess: GuessFunction<'s>,
        inverse: &'s InverseProblem<'s>,
        problem: &'s Collocation<'s>,
        settings: &'s Settings,
    ) -> Result<Self, (Status, String)> {
        let is_alone = warm.is_some() && settings.starts == 1;
        let first = if is_alone { None } else { guess() };
        if first.is_none() && !is_alone {
            let reason = "the start guess by inverse dynamics is not finite: look at what `sinew run` warns of with method = \
                          \"static\", such as fibres far from their optimal length; passive_forces = false leaves those out";
            return Err((Status::NonFinite, reason.to_owned()));
        }
        Ok(Self { inverse, problem, settings, warm, first, guess })
    }

    fn disturbed(&self, guess: &[f64], k: usize) -> Vec<f64> {
        let (seed, k) = (self.settings.seed, self.settings.first_start + k);
        disturb(guess, self.problem.scheme, self.inverse, seed, k)
    }

    /// Solves from each start, as far as the time limit allows. If a warm start and all others fail, the start guess is
    /// tried.
    pub fn solve(mut self, kkt: &mut Kkt, options: SqpOptions) -> Runs {
        let warm = self.warm.take();
        let is_warm = warm.is_some();
        let cold = (usize::from(is_warm)..self.settings.starts)
            .filter_map(|k| Some(Start::from(self.disturbed(self.first.as_ref()?, k))));
        let mut starts = warm.into_iter().chain(cold);
        let first = starts.next().expect("there is a start");
        let (inverse, problem) = (self.inverse, self.problem);
        let mut runs = Runs::of(solve_with(kkt, problem, first, options), inverse, problem);
        while !options.termination.deadline.passed()
            && let Some(start) = starts.next()
        {
            runs.add(solve_with(kkt, problem, start, options), inverse, problem);
        }
        if is_warm
            && !options.termination.deadline.passed()
            && runs.converged == 0
            && let Some(guess) = (self.guess)()
        {
            runs.add(solve_with(kkt, problem, self.disturbed(&guess, 0), options), inverse, problem);
        }
        runs
    }
}

/// A start at the solution of the same problem.
pub fn start_at(solution: &SolutionPoint, problem: &Collocation<'_>) -> Start {
    let active = active(&Iterate::new(problem, solution.x.clone()).inequalities);
    let (lambda, nu) = (solution.equality_multipliers.clone(), solution.inequality_multipliers.clone());
    Start { x: solution.x.clone(), multipliers: Some((lambda, nu, active)) }
}

/// Start k. For k = 0 this is the guess itself. Otherwise a random alternation is added to its fibre lengths, and its
/// activations get a random factor and offset, seeded by (seed, k).
pub fn disturb(
    guess: &[f64],
    scheme: &dyn Discretisation,
    inverse: &InverseProblem<'_>,
    seed: u64,
    k: usize,
) -> Vec<f64> {
    let mut x = guess.to_vec();
    if k == 0 {
        return x;
    }
    let (muscles, coefficients) = (&inverse.muscles, scheme.coefficients());
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(k as u64);
    for m in 0..muscles.a.count {
        let alternation: f64 = rng.random_range(-0.05..0.05);
        let (factor, offset): (f64, f64) = (rng.random_range(0.2..2.0), rng.random_range(0.0..0.15));
        for c in 0..coefficients.count(muscles.activation) {
            let sign = if c % 2 == 0 { 1.0 } else { -1.0 };
            let shift = sign * alternation + rng.random_range(-0.02..0.02);
            if let Some(length) = muscles.fibre_length {
                x[coefficients.index(length, c, m)] += shift;
            }
            let a = &mut x[coefficients.index(muscles.activation, c, m)];
            *a = (factor * *a + offset + rng.random_range(-0.05..0.05)).clamp(0.0, 1.0);
        }
        for j in 0..muscles.excitation.map_or(0, |excitation| coefficients.count(excitation)) {
            let excitation = muscles.excitation.expect("counted");
            x[coefficients.index(excitation, j, m)] = x[coefficients.index(muscles.activation, j, m)];
        }
    }
    scheme.settle(&mut x);
    x
}
