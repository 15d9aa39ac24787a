//! Where a muscle's force comes from.

use crate::model::Musculotendon;
use crate::problem::blocks::contraction::Contraction;

/// A muscle's force as a function of the variables at an instant.
#[derive(Clone)]
pub enum MuscleForce<'m> {
    /// Fibre and tendon over time, eq. (3).
    Contraction(Contraction<'m>),
    /// `s a + p`.
    Linear(LinearForce<'m>),
}

#[derive(Clone, Copy)]
pub struct LinearForce<'m> {
    pub muscle: &'m Musculotendon,
    pub activation: usize,
    /// s and p, normalised by F_o, among the variables; 1 and 0 if `None`.
    pub known: Option<HillLaw>,
}

/// What is known of a muscle at each time, as variables.
#[derive(Clone, Copy, Debug)]
pub struct HillLaw {
    pub strength: usize,
    pub passive: usize,
    /// Length (m) of the path, and its rate (m/s); `None` where the muscle has no fibre.
    pub path: Option<[usize; 2]>,
}

/// A fibre at an instant.
#[derive(Clone, Copy, Debug)]
pub struct Fibre {
    /// Optimal fibre lengths, and those a second.
    pub length: f64,
    pub velocity: f64,
}

impl<'m> MuscleForce<'m> {
    pub fn muscle(&self) -> &'m Musculotendon {
        match self {
            Self::Contraction(own) => own.muscle,
            Self::Linear(own) => own.muscle,
        }
    }

    /// f_m, normalised by F_o.
    pub fn value(&self, z: &[f64]) -> f64 {
        match self {
            Self::Contraction(own) => own.fibre_force(z).value,
            Self::Linear(own) => {
                let [strength, passive] = own.law(z);
                strength * z[own.activation] + passive
            }
        }
    }

    /// The slopes of f_m, by variable.
    pub fn slopes(&self, z: &[f64]) -> Vec<(usize, f64)> {
        match self {
            Self::Contraction(own) => own.fibre_force_slopes(z).to_vec(),
            Self::Linear(own) => vec![(own.activation, own.law(z)[0])],
        }
    }

    /// How f_m changes along the direction `dz`.
    pub fn change(&self, z: &[f64], dz: &[f64]) -> f64 {
        self.slopes(z).into_iter().map(|(variable, slope)| slope * dz[variable]).sum()
    }

    /// The fibre, if there is one.
    pub fn fibre(&self, z: &[f64]) -> Option<Fibre> {
        match self {
            Self::Contraction(own) => Some(Fibre { length: z[own.length], velocity: z[own.velocity] }),
            Self::Linear(own) => {
                let [path, rate] = own.known?.path?.map(|variable| z[variable]);
                let length = own.muscle.fibre_length(path, self.value(z).max(0.0));
                Some(Fibre { length, velocity: own.muscle.fibre_velocity(length, rate) })
            }
        }
    }

    /// The force of the stretched fibre, N.
    pub fn passive_force(&self, z: &[f64]) -> f64 {
        self.fibre(z).map_or(0.0, |fibre| self.muscle().passive_force(fibre.length))
    }

    /// Whether the muscle is left out, because it has no strength.
    pub fn is_left_out(&self, z: &[f64]) -> bool {
        matches!(self, Self::Linear(own) if own.law(z)[0] == 0.0)
    }
}

impl LinearForce<'_> {
    /// s and p.
    fn law(&self, z: &[f64]) -> [f64; 2] {
        self.known.map_or([1.0, 0.0], |known| [z[known.strength], z[known.passive]])
    }
}
