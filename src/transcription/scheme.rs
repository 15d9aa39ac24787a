//! What every transcription provides, and functions of time that one can be filled from.

use super::collocation::{Combination, Layout};
use super::instant::Instant;

/// A finite-dimensional space of functions of time, and where the equations hold in it.
pub trait Discretisation: Send + Sync {
    /// All collocation points, s, the start of the motion first; see [`Layout`] for what holds at which.
    fn points(&self) -> &[f64];

    /// Ends of the polynomial pieces, s.
    fn breakpoints(&self) -> &[f64];

    /// Number of unknowns.
    fn variables(&self) -> usize;

    /// Points, equations and time blocks, for the assembly.
    fn layout(&self, instant: &Instant<'_>) -> Layout;

    /// The local variables of [`Instant`] at any time, each as a combination of the decision vector. Where a
    /// function jumps, its value to the left.
    fn local_at(&self, instant: &Instant<'_>, t: f64) -> Vec<Combination>;

    /// Body coordinate `i`, or a derivative.
    fn coordinate_at(&self, t: f64, derivative: usize, i: usize) -> Combination;

    /// Activation of muscle `m`.
    fn activation_at(&self, t: f64, m: usize) -> Combination;

    /// Weights that integrate, over the whole motion, a function known at [`Discretisation::points`] only, s. The weight of
    /// a point without a force is 0.
    fn quadrature(&self) -> Vec<f64>;

    /// Number of coefficients of a fibre length or an activation.
    fn state_coefficients(&self) -> usize;
    fn length_index(&self, k: usize, m: usize) -> usize;
    fn activation_index(&self, k: usize, m: usize) -> usize;

    /// Number of coefficients of an excitation or a reaction.
    fn control_coefficients(&self) -> usize;
    fn excitation_index(&self, j: usize, m: usize) -> usize;

    /// Makes the unknowns that are only names for values of the others agree with them.
    fn settle(&self, x: &mut [f64]);

    /// The decision vector nearest to given functions: exact for functions of the space.
    fn compose(&self, functions: &dyn Trajectory) -> Vec<f64>;
}

/// Functions of time that make up an answer: a start guess, or a solution on another mesh.
pub trait Trajectory {
    /// Body coordinate `i` (m, rad), or its first or second derivative.
    fn coordinate(&self, t: f64, derivative: usize, i: usize) -> f64;
    /// Fibre length, optimal fibre lengths.
    fn length(&self, t: f64, m: usize) -> f64;
    fn activation(&self, t: f64, m: usize) -> f64;
    fn excitation(&self, t: f64, m: usize) -> f64;
    /// Reaction `c`, total weights.
    fn reaction(&self, t: f64, c: usize) -> f64;
}
