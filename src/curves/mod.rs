//! Families of normalised curves of a Hill musculotendon, each with its first two derivatives, and of activation
//! dynamics.

mod activation;
mod bezier;
mod degroote_fregly_2016;
mod millard_2012;
pub mod thesis;

use std::fmt::Debug;
use std::sync::Arc;

pub use activation::{ActivationDynamics, ActivationLaw};
pub use degroote_fregly_2016::DeGrooteFregly2016;
pub use millard_2012::{Millard2012, MillardParameters};
pub use thesis::{ForceVelocity, Thesis};

use crate::names::{choices, defaults};

/// A value with its first and second derivative.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Jet {
    pub value: f64,
    pub first: f64,
    pub second: f64,
}

/// The curves of a muscle. Lengths of fibres are in optimal fibre lengths, velocities in maximum shortening velocities (negative
/// when shortening), forces in maximum isometric forces.
pub trait Curves: Debug + Send + Sync {
    /// f_l
    fn active_force_length(&self, l: f64) -> Jet;

    /// f_pe
    fn passive_force_length(&self, l: f64) -> Jet;

    /// f_v
    fn force_velocity(&self, v: f64) -> Jet;

    /// The velocity on which f_v bends.
    fn bending_velocity(&self) -> f64;

    /// The tendon's force at a strain.
    fn tendon_force(&self, strain: f64) -> f64;

    /// Its strain at a force: the inverse.
    fn tendon_strain(&self, force: f64) -> Jet;

    /// Whether the muscle keeps its thickness, `l sin α = sin α_o`, and not its pennation angle.
    fn keeps_thickness(&self) -> bool;
}

choices! {
    /// Curves of the muscles.
    MuscleCurves {
        /// Paper B, eqs (8)–(11) and Figures 2 to 4; the pennation angle is constant
        Thesis = "thesis",
        /// De Groote et al. 2016, as OpenSim Moco has them; the thickness of a muscle is constant
        DegrooteFregly2016 = "degroote_fregly_2016",
        /// Millard et al. 2013 with the shape parameters of the model; the thickness of a muscle is constant
        Millard2012 = "millard_2012",
    }
}

defaults!(MuscleCurves::Thesis);

/// What shapes the curves of a muscle, in each family.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shape {
    /// `thesis`
    pub force_velocity: ForceVelocity,
    pub degroote: DeGrooteFregly2016,
    /// `millard_2012`
    pub millard: MillardParameters,
}

impl MuscleCurves {
    /// The curves of this family.
    pub fn with(self, shape: &Shape) -> Arc<dyn Curves> {
        match self {
            Self::Thesis => Arc::new(Thesis(shape.force_velocity)),
            Self::DegrooteFregly2016 => Arc::new(shape.degroote),
            Self::Millard2012 => Arc::new(Millard2012::new(&shape.millard)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compares the derivatives of a curve with differences, except next to `kinks`, where its second derivative jumps.
    fn check(curve: &dyn Fn(f64) -> Jet, [from, to]: [f64; 2], kinks: &[f64]) {
        let (step, count) = (1e-6, 337);
        for x in (0..=count).map(|i| from + (to - from) * f64::from(i) / f64::from(count)) {
            if kinks.iter().any(|kink| (x - kink).abs() < 3.0 * step) {
                continue;
            }
            let (low, here, high) = (curve(x - step), curve(x), curve(x + step));
            let first = (high.value - low.value) / (2.0 * step);
            let second = (high.first - low.first) / (2.0 * step);
            assert!((first - here.first).abs() <= 2e-6 * (1.0 + here.first.abs()), "{x}: {first} {here:?}");
            assert!((second - here.second).abs() <= 2e-5 * (1.0 + here.second.abs()), "{x}: {second} {here:?}");
        }
    }

    #[test]
    fn derivatives_agree_with_differences() {
        for &family in MuscleCurves::VARIANTS {
            let mut shape = Shape::default();
            shape.degroote.active_width = 1.3;
            let own = family.with(&shape);
            check(&|l| own.active_force_length(l), [0.3, 1.95], &[0.401, 1.61875]);
            check(&|l| own.passive_force_length(l), [0.4, 1.8], &[]);
            check(&|v| own.force_velocity(v), [-1.3, 1.3], &[0.0]);
            check(&|f| own.tendon_strain(f), [0.02, 1.4], &[0.2387]);
        }
    }

    #[test]
    fn tendon_curves_are_inverted() {
        for &family in MuscleCurves::VARIANTS {
            let own = family.with(&Shape::default());
            for force in [-0.3, -0.01, 0.0, 1e-6, 1e-3, 0.02, 0.1, 0.3, 0.7, 1.0, 1.5] {
                let strain = own.tendon_strain(force).value;
                assert!((own.tendon_force(strain) - force).abs() < 1e-11, "{family:?} {force} {strain}");
            }
        }
    }

    #[test]
    fn curves_are_normalised() {
        let published = [(MuscleCurves::DegrooteFregly2016, 0.6, 0.01), (MuscleCurves::Millard2012, 0.7, 1e-12)];
        for (family, passive_strain, tolerance) in published {
            let own = family.with(&Shape::default());
            assert!((own.active_force_length(1.0).value - 1.0).abs() < tolerance);
            assert!((own.passive_force_length(1.0 + passive_strain).value - 1.0).abs() < 1e-12);
            assert!((own.force_velocity(0.0).value - 1.0).abs() < 1e-5, "{family:?}");
            assert!((own.tendon_force(0.049) - 1.0).abs() < 1e-12);
            assert!(own.force_velocity(-1.0).value.abs() < 0.02 && own.force_velocity(1.0).value > 1.3);
        }
    }
}
