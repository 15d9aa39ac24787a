//! The Hill musculotendon: a fibre (contractile and parallel elastic element) in series with a tendon
//! (thesis, Paper B eqs 3, 4, 6, 7 and Figure 1), with the curves of a family.
//!
//! The pennation angle α is constant as in the thesis, or the muscle keeps its thickness, `l sin α = sin α_o`, as the curves have it.

use std::sync::Arc;

use super::path::Path;
use crate::curves::{ActivationLaw, Curves, Jet, MuscleCurves, Shape};

#[derive(Clone, Debug)]
pub struct Musculotendon {
    pub name: String,
    /// F_o, N
    pub max_isometric_force: f64,
    /// L_o, m
    pub optimal_fibre_length: f64,
    /// L_s, m
    pub tendon_slack_length: f64,
    /// α_o, rad: at the optimal fibre length
    pub pennation_angle: f64,
    pub activation: ActivationLaw,
    /// Optimal fibre lengths a second. The thesis does not divide by one: 1; about 10 is physiological.
    pub max_shortening_velocity: f64,
    /// β: force of a passive damper beside the fibre at the maximum shortening velocity, F_o. Not part of the passive force that
    /// [`Musculotendon::has_passive_force`] leaves out.
    pub damping: f64,
    /// Factor on the weight of its effort.
    pub effort_weight: f64,
    pub shape: Shape,
    pub curves: Arc<dyn Curves>,
    /// The tendon does not stretch: its length is L_s, whatever the force.
    pub rigid_tendon: bool,
    /// A stretched fibre has a passive force.
    pub has_passive_force: bool,
    pub path: Path,
}

/// cos α at which a muscle of constant thickness ends: the fibre is not shorter than there.
const LEAST_COS: f64 = 0.1;

/// A function of (activation, fibre length, fibre velocity) with its derivatives in that order.
#[derive(Clone, Copy, Debug)]
pub struct FibreForce {
    pub value: f64,
    pub gradient: [f64; 3],
    pub hessian: [[f64; 3]; 3],
}

/// Eq. (3) at an instant; see [`Musculotendon::contraction`].
#[derive(Clone, Copy, Debug)]
pub struct Contraction {
    pub value: f64,
    pub by_path: f64,
    pub by_length: f64,
    pub by_force: f64,
    /// Its second derivatives by the fibre's length and by f_m.
    pub bent_by_length: f64,
    pub bent_by_force: f64,
}

impl Musculotendon {
    /// Takes other curves.
    pub fn set_curves(&mut self, family: MuscleCurves) {
        self.curves = family.with(&self.shape);
    }

    /// Normalised force of the fibre along the tendon, `f_m = (f_pe(l_m) + a f_l(l_m) f_v(l̇_m) + β l̇_m) cos α` (eq. 3).
    ///
    /// `length` is in optimal fibre lengths, `velocity` in those a second, negative when shortening.
    pub fn fibre_force(&self, activation: f64, length: f64, velocity: f64) -> FibreForce {
        let a = activation;
        let cos = self.cos_pennation(length);
        let passive = self.passive_curve(length);
        let l = self.curves.active_force_length(length);
        let rate = 1.0 / self.max_shortening_velocity;
        let v = self.curves.force_velocity(velocity * rate);
        let (v1, v2) = (v.first * rate, v.second * rate * rate);
        // Of the force along the fibre.
        let value = passive.value + a * l.value * v.value + self.damping * velocity * rate;
        let by_l = passive.first + a * l.first * v.value;
        let by_v = a * l.value * v1 + self.damping * rate;
        let by_al = l.first * v.value * cos.value + l.value * v.value * cos.first;
        let by_av = l.value * v1 * cos.value;
        let by_lv = a * l.first * v1 * cos.value + by_v * cos.first;
        let by_ll = (passive.second + a * l.second * v.value) * cos.value + 2.0 * by_l * cos.first + value * cos.second;
        FibreForce {
            value: value * cos.value,
            gradient: [l.value * v.value * cos.value, by_l * cos.value + value * cos.first, by_v * cos.value],
            hessian: [[0.0, by_al, by_av], [by_al, by_ll, by_lv], [by_av, by_lv, a * l.value * v2 * cos.value]],
        }
    }

    /// The activation at which the fibre has a normalised force along the tendon, within [0, 1].
    pub fn activation_at(&self, force: f64, length: f64, velocity: f64) -> f64 {
        let passive = self.fibre_force(0.0, length, velocity);
        let active = passive.gradient[0].max(0.05 * self.cos_pennation(length).value);
        ((force - passive.value) / active).clamp(0.0, 1.0)
    }

    /// The passive force–length relation, zero where there is no passive force.
    pub fn passive_curve(&self, length: f64) -> Jet {
        if self.has_passive_force { self.curves.passive_force_length(length) } else { Jet::default() }
    }

    /// The passive part of the force at a fibre length (optimal fibre lengths), along the tendon, N.
    pub fn passive_force(&self, length: f64) -> f64 {
        self.max_isometric_force * self.cos_pennation(length).value * self.passive_curve(length).value
    }

    /// sin α_o, the thickness in L_o of a muscle that keeps it; `None` if it keeps its angle.
    fn thickness(&self) -> Option<f64> {
        (self.curves.keeps_thickness() && self.pennation_angle > 0.0).then(|| self.pennation_angle.sin())
    }

    /// Length of a fibre at [`LEAST_COS`].
    fn least_length(thickness: f64) -> f64 {
        thickness / (1.0 - LEAST_COS * LEAST_COS).sqrt()
    }

    /// cos α at a fibre length.
    fn cos_pennation(&self, length: f64) -> Jet {
        let Some(w) = self.thickness() else {
            return Jet { value: self.pennation_angle.cos(), ..Jet::default() };
        };
        if length <= Self::least_length(w) {
            return Jet { value: LEAST_COS, ..Jet::default() };
        }
        let sin = w / length;
        let cos = (1.0 - sin * sin).sqrt();
        let tangent = sin * sin / (length * cos);
        let second = -tangent * (3.0 + sin * sin / (cos * cos)) / length;
        Jet { value: cos, first: tangent, second }
    }

    /// Length of the fibre along the tendon, `l cos α`, optimal fibre lengths.
    ///
    /// DEPARTURE [constant thickness]: where the fibre would be shorter than at cos α = 0.1, the length goes on as a line, so that
    /// iterates are not lost. No solution lies there: the force of such a fibre is next to nothing.
    fn along_tendon(&self, length: f64) -> Jet {
        let Some(w) = self.thickness() else {
            let cos = self.pennation_angle.cos();
            return Jet { value: cos * length, first: cos, second: 0.0 };
        };
        let least = Self::least_length(w);
        if length <= least {
            return Jet {
                value: LEAST_COS * least + (length - least) / LEAST_COS,
                first: 1.0 / LEAST_COS,
                second: 0.0,
            };
        }
        let along = ((length - w) * (length + w)).sqrt();
        Jet { value: along, first: length / along, second: -w * w / along.powi(3) }
    }

    /// The fibre length at which `l cos α` is `along`, optimal fibre lengths.
    fn length_of(&self, along: f64) -> f64 {
        match self.thickness() {
            None => along / self.pennation_angle.cos(),
            Some(w) if along > LEAST_COS * Self::least_length(w) => along.hypot(w),
            Some(w) => Self::least_length(w) + LEAST_COS * (along - LEAST_COS * Self::least_length(w)),
        }
    }

    /// Eq. (3) as it is solved, and its slopes by the path's length and by f_m: `l_t − f_t⁻¹(f_m)`; of a rigid tendon
    /// `(L_mt − L_o l_m cos α − L_s)/L_o`, which says where the fibre is and leaves f_m alone.
    pub fn contraction(&self, path_length: f64, fibre_length: f64, force: f64) -> Contraction {
        let unit = 1.0 / self.length_unit();
        let along = self.along_tendon(fibre_length);
        let scale = -self.optimal_fibre_length * unit;
        let stretch = (path_length - self.tendon_slack_length) * unit + scale * along.value;
        let strain = if self.rigid_tendon { Jet::default() } else { self.curves.tendon_strain(force) };
        Contraction {
            value: stretch - strain.value,
            by_path: unit,
            by_length: scale * along.first,
            by_force: -strain.first,
            bent_by_length: scale * along.second,
            bent_by_force: -strain.second,
        }
    }

    /// What lengths are divided by in eq. (3), m.
    pub fn length_unit(&self) -> f64 {
        if self.rigid_tendon { self.optimal_fibre_length } else { self.tendon_slack_length }
    }

    /// How far eq. (3) is from holding as printed: `f_t(l_t) − f_m`, normalised force; of a rigid tendon as it is solved.
    pub fn printed_contraction(&self, path_length: f64, fibre_length: f64, force: f64) -> f64 {
        if self.rigid_tendon {
            return self.contraction(path_length, fibre_length, force).value;
        }
        self.curves.tendon_force(self.tendon_strain(path_length, fibre_length)) - force
    }

    /// Tendon strain `l_t = (L_mt − L_o l_m cos α − L_s)/L_s` (eqs 6, 7) of a path of `path_length` metres.
    pub fn tendon_strain(&self, path_length: f64, fibre_length: f64) -> f64 {
        (path_length - self.optimal_fibre_length * self.along_tendon(fibre_length).value) / self.tendon_slack_length
            - 1.0
    }

    /// The slope of `L_o l cos α` by the fibre's length, m.
    pub fn along_tendon_by_length(&self, fibre_length: f64) -> f64 {
        self.optimal_fibre_length * self.along_tendon(fibre_length).first
    }

    /// The fibre's velocity (optimal fibre lengths a second) where it changes with its path, whose length changes at `rate`, m/s.
    pub fn fibre_velocity(&self, fibre_length: f64, rate: f64) -> f64 {
        rate / self.along_tendon_by_length(fibre_length)
    }

    /// (f_t0, f_t1), eqs (21), (22): normalised tendon forces at zero and at full activation where path and fibre change at the
    /// same rate. `path_length` in m, `rate` in m/s.
    pub fn force_range(&self, path_length: f64, rate: f64) -> [f64; 2] {
        let force = |a: f64, length: f64| self.fibre_force(a, length, self.fibre_velocity(length, rate)).value;
        [0.0, 1.0].map(|a| {
            if self.rigid_tendon {
                return force(a, self.fibre_length(path_length, 0.0));
            }
            // The strain of the tendon decreases with l: bisect between zero and the length of the whole path.
            let (mut low, mut high) = (self.length_of(0.0), self.length_of(path_length / self.optimal_fibre_length));
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if self.contraction(path_length, middle, force(a, middle)).value > 0.0 {
                    low = middle;
                } else {
                    high = middle;
                }
            }
            force(a, 0.5 * (low + high))
        })
    }

    /// The length of the fibre (optimal fibre lengths) on a path of `path_length` metres whose tendon carries a normalised
    /// force.
    pub fn fibre_length(&self, path_length: f64, force: f64) -> f64 {
        let strain = if self.rigid_tendon { 0.0 } else { self.curves.tendon_strain(force).value };
        self.length_of((path_length - self.tendon_slack_length * (1.0 + strain)) / self.optimal_fibre_length)
    }

    /// The excitation that gives the rate `ȧ` at activation `a`.
    pub fn excitation(&self, a: f64, rate: f64) -> f64 {
        self.activation.excitation(a, rate)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::curves::ActivationDynamics;
    use rand::{RngExt, SeedableRng};

    pub(crate) fn muscle() -> Musculotendon {
        Musculotendon {
            name: "m".into(),
            max_isometric_force: 300.0,
            optimal_fibre_length: 0.12,
            tendon_slack_length: 0.2,
            pennation_angle: 0.2,
            activation: ActivationLaw { family: ActivationDynamics::Thesis, up: 0.05, down: 0.12, steepness: 0.1 },
            max_shortening_velocity: 2.0,
            damping: 0.03,
            effort_weight: 1.0,
            shape: Shape::default(),
            curves: MuscleCurves::Thesis.with(&Shape::default()),
            rigid_tendon: false,
            has_passive_force: true,
            path: Path::Straight(crate::model::path::StraightPath::new(vec![])),
        }
    }

    #[test]
    fn fibre_force_derivatives_agree_with_differences() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        for trial in 0..300 {
            let mut muscle = muscle();
            muscle.set_curves(MuscleCurves::VARIANTS[trial % 3]);
            let x = [rng.random_range(0.0..1.0), rng.random_range(0.5..1.5), rng.random_range(-2.0..2.0)];
            if f64::abs(x[2]) < 1e-3 {
                continue;
            }
            let here = muscle.fibre_force(x[0], x[1], x[2]);
            for i in 0..3 {
                let e = 1e-6;
                let shifted = |s: f64| {
                    let mut y = x;
                    y[i] += s;
                    muscle.fibre_force(y[0], y[1], y[2])
                };
                let (low, high) = (shifted(-e), shifted(e));
                assert!(((high.value - low.value) / (2.0 * e) - here.gradient[i]).abs() < 1e-6);
                for j in 0..3 {
                    let difference = (high.gradient[j] - low.gradient[j]) / (2.0 * e);
                    assert!((difference - here.hessian[i][j]).abs() < 1e-5 * (1.0 + here.hessian[i][j].abs()));
                }
            }
        }
    }

    #[test]
    fn eq_3_has_its_slopes_with_each_pennation() {
        for (family, rigid) in MuscleCurves::VARIANTS.iter().flat_map(|&family| [(family, false), (family, true)]) {
            let mut muscle = muscle();
            (muscle.pennation_angle, muscle.rigid_tendon) = (0.6, rigid);
            muscle.set_curves(family);
            let e = 1e-6;
            for (length, force) in [(0.55, 0.1), (0.7, 0.4), (1.0, 0.8), (1.3, 0.05)] {
                let at = |l: f64, f: f64| muscle.contraction(0.31, l, f);
                let (here, shorter, longer) = (at(length, force), at(length - e, force), at(length + e, force));
                assert!(((longer.value - shorter.value) / (2.0 * e) - here.by_length).abs() < 1e-7);
                assert!(((longer.by_length - shorter.by_length) / (2.0 * e) - here.bent_by_length).abs() < 1e-5);
                let (less, more) = (at(length, force - e), at(length, force + e));
                assert!(((more.value - less.value) / (2.0 * e) - here.by_force).abs() < 1e-6);
                assert!(((more.by_force - less.by_force) / (2.0 * e) - here.bent_by_force).abs() < 1e-3);
            }
        }
    }

    #[test]
    fn a_fibre_fills_what_its_tendon_leaves_with_each_pennation() {
        for &family in MuscleCurves::VARIANTS {
            let mut muscle = muscle();
            muscle.pennation_angle = 0.6;
            muscle.set_curves(family);
            for (path, force) in [(0.25, 0.0), (0.31, 0.3), (0.36, 0.9)] {
                let length = muscle.fibre_length(path, force);
                assert!(muscle.contraction(path, length, force).value.abs() < 1e-12);
                let [low, high] = muscle.force_range(path, 0.05);
                for (a, force) in [(0.0, low), (1.0, high)] {
                    let length = muscle.fibre_length(path, force);
                    let fibre = muscle.fibre_force(a, length, muscle.fibre_velocity(length, 0.05));
                    assert!((fibre.value - force).abs() < 1e-9, "{family:?} {path} {a}");
                }
            }
        }
    }
}
