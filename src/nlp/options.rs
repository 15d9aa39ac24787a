//! Every number of the solver, by ingredient. None depends on the application: quantities are of the scaled problem,
//! and "error" is the largest of its three KKT residuals. The README shows what each ingredient is worth.

use serde::{Deserialize, Serialize};

use crate::deadline::Deadline;

/// Declares groups of options with their defaults.
macro_rules! options {
    ($($(#[$of_group:meta])* $group:ident { $($(#[$of_field:meta])* $field:ident: $type:ty = $default:expr,)* })*) => { $(
        $(#[$of_group])*
        #[derive(Clone, Copy, Debug, Serialize, Deserialize)]
        pub struct $group { $($(#[$of_field])* pub $field: $type,)* }

        impl Default for $group {
            fn default() -> Self {
                Self { $($field: $default,)* }
            }
        }
    )* };
}

options! {
    /// All options of a solve.
    SqpOptions {
        termination: Termination = Termination::default(),
        progress: ProgressOptions = ProgressOptions::default(),
        damping: DampingOptions = DampingOptions::default(),
        portfolio: PortfolioOptions = PortfolioOptions::default(),
        active_set: ActiveSetOptions = ActiveSetOptions::default(),
        interior_point: InteriorPointOptions = InteriorPointOptions::default(),
        filter: FilterOptions = FilterOptions::default(),
        line_search: LineSearchOptions = LineSearchOptions::default(),
        correction: CorrectionOptions = CorrectionOptions::default(),
        leap: LeapOptions = LeapOptions::default(),
        extension: ExtensionOptions = ExtensionOptions::default(),
        recovery: RecoveryOptions = RecoveryOptions::default(),
        restoration: RestorationOptions = RestorationOptions::default(),
        restart: RestartOptions = RestartOptions::default(),
    }

    /// When a solve is over.
    Termination {
        /// The error must come below this.
        tolerance: f64 = 1e-8,
        /// Iterations go on to this as long as they help.
        target: f64 = 9e-9,
        max_iterations: usize = 300,
        /// Idle iterations before an error within the tolerance is good enough.
        patience: usize = 30,
        /// Gives up as `TimeLimit` when this is past.
        #[serde(skip)]
        deadline: Deadline = Deadline::default(),
    }

    /// Idle iterations are those since the error last fell to a share of what it was.
    ProgressOptions {
        share: f64 = 0.5,
        /// After so many idle iterations what is usually done does not help.
        impatience: usize = 10,
    }

    /// δ, the weight of the proximal term in the Hessian.
    DampingOptions {
        first: f64 = 1e-2,
        /// Floor: however small, it keeps muscles that run away from running further than it takes.
        floor: f64 = 1e-13,
        /// Floor of an impatient solve, and the least that is raised.
        smallest: f64 = 1e-15,
        largest: f64 = 1e8,
        /// Largest δ with the exact Hessian, beyond which the convex one serves better.
        exact: f64 = 5e-4,
        /// The same for an impatient solve: the convex Hessian, however good far away, creeps here.
        stubborn: f64 = 1e-2,
        /// Without negative curvature δ starts no larger than this times the error, so that the last steps are
        /// Newton's.
        per_error: f64 = 3e-3,
        /// Factor after a full step that did not raise it.
        lower: f64 = 0.2,
        /// Factor against negative curvature.
        raise: f64 = 5.0,
        /// Factor after a refused step, or one that could not be computed; and the least δ then.
        retreat: f64 = 10.0,
        least_refused: f64 = 1e-10,
        least_failed: f64 = 1e-6,
        /// Range of δ beside JᵀJ.
        gauss_newton_least: f64 = 1e-2,
        gauss_newton_most: f64 = 1e6,
    }

    /// Which way of solving the sub-problem is tried.
    PortfolioOptions {
        /// Whether the active set of the last step is tried first.
        guesses: bool = true,
        /// Whether interior points are solved to their end, each from its own start.
        to_the_end: bool = false,
        /// Whether the convex Hessian is used.
        convex: bool = true,
        /// An active set that has changed by no more rows than these, or one of so many, has settled.
        nearly: usize = 2,
        few: usize = 200,
        /// Error above which what has been made convex stays so.
        far: f64 = 1.0,
        /// Error below which the exact Hessian is asked whether the active set has settled or not.
        at_hand: f64 = 1e-2,
        /// Tolerance of the convex sub-problem: this share of the error, and no more; of the exact one this share of its
        /// power 3/2.
        per_error: f64 = 1e-2,
        /// Steps of an interior point: far from a solution, in an impatient solve, and below the error `near`.
        steps: usize = 1,
        steps_idle: usize = 2,
        steps_near: usize = 20,
        near: f64 = 0.1,
    }

    /// The sub-problem by its active set.
    ActiveSetOptions {
        rounds: usize = 12,
        /// A linear system solved worse than this (relative) is one of contradicting constraints.
        accuracy: f64 = 1e-6,
        /// More wrong rows than these, one of so many, are too many when a round does not halve them; and at first one
        /// of so many.
        nearly: usize = 4,
        few: usize = 200,
        many: usize = 10,
        /// Rows may be wrong by this share of the error, and in any case by so much.
        per_error: f64 = 3e-2,
        rounding: f64 = 1e-10,
    }

    /// The sub-problem by an interior point.
    InteriorPointOptions {
        max_iterations: usize = 40,
        /// Fraction of the way to the boundary.
        to_boundary: f64 = 0.999,
        /// Tolerance of a sub-problem that is a model of the Lagrangian to second order, and of one that is not.
        fine: f64 = 1e-9,
        coarse: f64 = 1e-6,
        /// Gondzio's corrections: how many, by how much they aim further, what they must gain, the step long enough
        /// without them and the range of s ν, in its aim, that they leave alone.
        corrections: usize = 4,
        further_factor: f64 = 1.08,
        further: f64 = 0.08,
        gain: f64 = 0.01,
        long: f64 = 0.95,
        lowest_product: f64 = 0.1,
        highest_product: f64 = 10.0,
        /// The start: least slack, and multiplier in the gradient's size; how far the lowest comes above zero.
        least_slack: f64 = 1e-2,
        raise: f64 = 1.1,
        /// A start from the last sub-problem: its s ν is at least `drawn_back` E^1.5 in the gradient's size, E the
        /// error, and a multiplier makes no product further from that than by the factor `centred`.
        drawn_back: f64 = 3e-2,
        least_product: f64 = 1e-12,
        centred: f64 = 100.0,
    }

    /// The filter on (θ, f).
    FilterOptions {
        /// Share of θ by which either must improve.
        margin: f64 = 1e-5,
        /// Share of the predicted descent.
        armijo: f64 = 1e-4,
        /// θ after a step may be this times that before it, or times the error if that is larger: f is worth no more.
        wild: f64 = 100.0,
        /// θ is never more than this times the first, and below this times the first descent of f decides.
        ceiling: f64 = 1e2,
        floor: f64 = 1e-4,
    }

    /// Backtracking.
    LineSearchOptions {
        shorten: f64 = 0.5,
        smallest_fraction: f64 = 0.05,
        /// Error below which f and θ are only noise, and a full step that leaves less than this share of the error is
        /// taken.
        at_hand: f64 = 1e-2,
        share: f64 = 0.7,
    }

    /// Second-order corrections: how many, while each leaves no more than this share of θ.
    CorrectionOptions {
        most: usize = 4,
        share: f64 = 0.5,
    }

    /// The leap along almost flat directions.
    LeapOptions {
        /// Longest, in steps; below 1 there is none.
        longest: f64 = 64.0,
        /// How much longer the next one tried is.
        longer: f64 = 4.0,
        /// It must leave less than this share of the error that the one before has left; the best less than this of a
        /// plain step's.
        much: f64 = 0.5,
        better: f64 = 0.7,
        /// A plain step that leaves less than this share of the error is only corrected.
        fast: f64 = 0.5,
        corrections: usize = 3,
        /// Largest δ and error with which there is one.
        most_damping: f64 = 1e-3,
        below: f64 = 1.0,
    }

    /// The extension of steps kept short.
    ExtensionOptions {
        /// How often a step is made twice as long.
        doublings: usize = 16,
        /// A step that leaves more than this share of the error creeps.
        creeping: f64 = 0.4,
        /// Violation it may leave: this share of the error.
        violation: f64 = 0.1,
        /// δ below this shortens no step, nor does one where the error is above this.
        shortening: f64 = 1e-6,
        below: f64 = 1.0,
    }

    /// How often a step is tried at one point.
    RecoveryOptions {
        attempts: usize = 12,
    }

    /// The feasibility phase.
    RestorationOptions {
        max_steps: usize = 60,
        /// Share of the violation, in the Euclidean norm, that it must come down to.
        goal: f64 = 0.5,
        /// Weight of the proximal term, and its factors.
        damping: f64 = 1e-4,
        lower: f64 = 0.3,
        raise: f64 = 10.0,
        /// Where the model of the violation's half square falls by less than this share of it a point is stationary.
        stationary: f64 = 1e-9,
    }

    /// Another solve with another preset, where the first is stuck.
    RestartOptions {
        is_on: bool = true,
        /// Where fewer iterations than these are allowed there is none.
        least_iterations: usize = 40,
    }
}
