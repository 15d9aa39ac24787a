//! The Hill musculotendon: a fibre (contractile and parallel elastic element) in series with a tendon,
//! at a constant pennation angle (thesis, Paper B eqs 3, 4, 6, 7 and Figure 1).

use super::path::Path;
use crate::curves::{ForceVelocity, Jet, active_force_length, passive_force_length, tendon_force, tendon_strain};

#[derive(Clone, Debug)]
pub struct Musculotendon {
    pub name: String,
    /// F_o, N
    pub max_isometric_force: f64,
    /// L_o, m
    pub optimal_fibre_length: f64,
    /// L_s, m
    pub tendon_slack_length: f64,
    /// θ, rad, constant during motion
    pub pennation_angle: f64,
    /// τ_act, s
    pub activation_time: f64,
    /// τ_deact, s
    pub deactivation_time: f64,
    /// Optimal fibre lengths a second. The thesis does not divide by one: 1; about 10 is physiological.
    pub max_shortening_velocity: f64,
    pub force_velocity: ForceVelocity,
    /// The tendon does not stretch: its length is L_s, whatever the force.
    pub rigid_tendon: bool,
    /// A stretched fibre has a passive force.
    pub has_passive_force: bool,
    pub path: Path,
}

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
    /// Its second derivative by f_m.
    pub bent: f64,
}

/// A function of (activation, its rate, excitation) with its derivatives; only (a, u) is curved.
#[derive(Clone, Copy, Debug)]
pub struct ActivationResidual {
    pub value: f64,
    /// By a, ȧ, u.
    pub gradient: [f64; 3],
    /// ∂²/∂a∂u and ∂²/∂u²; all others vanish.
    pub mixed: f64,
    pub excitation: f64,
}

impl Musculotendon {
    /// Normalised force of the fibre along the tendon, `f_m = (f_pe(l_m) + a f_l(l_m) f_v(l̇_m)) cos θ` (eq. 3).
    ///
    /// `length` is in optimal fibre lengths, `velocity` in those a second, negative when shortening.
    pub fn fibre_force(&self, activation: f64, length: f64, velocity: f64) -> FibreForce {
        let cos = self.pennation_angle.cos();
        let passive = self.passive_curve(length);
        let l = active_force_length(length);
        let rate = 1.0 / self.max_shortening_velocity;
        let v = self.force_velocity.at(velocity * rate);
        let (v1, v2) = (v.first * rate, v.second * rate * rate);
        let a = activation;
        let by_al = l.first * v.value;
        let by_av = l.value * v1;
        let by_lv = a * l.first * v1;
        FibreForce {
            value: cos * (passive.value + a * l.value * v.value),
            gradient: [cos * l.value * v.value, cos * (passive.first + a * by_al), cos * a * by_av],
            hessian: [
                [0.0, cos * by_al, cos * by_av],
                [cos * by_al, cos * (passive.second + a * l.second * v.value), cos * by_lv],
                [cos * by_av, cos * by_lv, cos * a * l.value * v2],
            ],
        }
    }

    /// The passive force–length relation, zero where there is no passive force.
    pub fn passive_curve(&self, length: f64) -> Jet {
        let nothing = Jet { value: 0.0, first: 0.0, second: 0.0 };
        if self.has_passive_force { passive_force_length(length) } else { nothing }
    }

    /// The passive part of the force at a fibre length (optimal fibre lengths), along the tendon, N.
    pub fn passive_force(&self, length: f64) -> f64 {
        self.max_isometric_force * self.pennation_angle.cos() * self.passive_curve(length).value
    }

    /// Eq. (3) as it is solved, and its slopes by the path's length and by f_m: `l_t − f_t⁻¹(f_m)`; of a rigid tendon
    /// `(L_mt − L_o l_m cos θ − L_s)/L_o`, which says where the fibre is and leaves f_m alone.
    pub fn contraction(&self, path_length: f64, fibre_length: f64, force: f64) -> Contraction {
        let unit = 1.0 / self.length_unit();
        let stretch = (path_length - self.fibre_along_tendon() * fibre_length - self.tendon_slack_length) * unit;
        let by_length = -self.fibre_along_tendon() * unit;
        if self.rigid_tendon {
            return Contraction { value: stretch, by_path: unit, by_length, by_force: 0.0, bent: 0.0 };
        }
        let strain = tendon_strain(force);
        let value = self.tendon_strain(path_length, fibre_length) - strain.value;
        Contraction { value, by_path: unit, by_length, by_force: -strain.first, bent: -strain.second }
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
        tendon_force(self.tendon_strain(path_length, fibre_length)) - force
    }

    /// Tendon strain `l_t = (L_mt − L_o l_m cos θ − L_s)/L_s` (eqs 6, 7) of a path of `path_length` metres.
    pub fn tendon_strain(&self, path_length: f64, fibre_length: f64) -> f64 {
        (path_length - self.fibre_along_tendon() * fibre_length) / self.tendon_slack_length - 1.0
    }

    /// `L_o cos θ`, m
    pub fn fibre_along_tendon(&self) -> f64 {
        self.optimal_fibre_length * self.pennation_angle.cos()
    }

    /// (f_t0, f_t1), eqs (21), (22): normalised tendon forces at zero and at full activation where path and fibre change at the
    /// same rate. `path_length` in m, `rate` in m/s.
    pub fn force_range(&self, path_length: f64, rate: f64) -> [f64; 2] {
        let v = rate / self.fibre_along_tendon();
        [0.0, 1.0].map(|a| {
            if self.rigid_tendon {
                return self.fibre_force(a, self.fibre_length(path_length, 0.0), v).value;
            }
            // The strain of the tendon decreases with l: bisect between zero and the length of the whole path.
            let (mut low, mut high) = (0.0, path_length / self.fibre_along_tendon());
            for _ in 0..60 {
                let l = 0.5 * (low + high);
                let force = self.fibre_force(a, l, v).value;
                if self.tendon_strain(path_length, l) > tendon_strain(force).value { low = l } else { high = l }
            }
            self.fibre_force(a, 0.5 * (low + high), v).value
        })
    }

    /// The length of the fibre (optimal fibre lengths) on a path of `path_length` metres whose tendon carries a normalised
    /// force.
    pub fn fibre_length(&self, path_length: f64, force: f64) -> f64 {
        let strain = if self.rigid_tendon { 0.0 } else { tendon_strain(force).value };
        (path_length - self.tendon_slack_length * (1.0 + strain)) / self.fibre_along_tendon()
    }

    /// `ȧ − (u − a)(u/τ_act + (1 − u)/τ_deact)` (eq. 4), 1/s.
    pub fn activation_residual(&self, a: f64, rate: f64, u: f64) -> ActivationResidual {
        let (up, down) = (1.0 / self.activation_time, 1.0 / self.deactivation_time);
        let speed = u * up + (1.0 - u) * down;
        ActivationResidual {
            value: rate - (u - a) * speed,
            gradient: [speed, 1.0, -speed - (u - a) * (up - down)],
            mixed: up - down,
            excitation: -2.0 * (up - down),
        }
    }

    /// The excitation that gives the rate `ȧ` at activation `a`: the root of eq. (4) near `a`.
    pub fn excitation(&self, a: f64, rate: f64) -> f64 {
        let (up, down) = (1.0 / self.activation_time, 1.0 / self.deactivation_time);
        // (u − a)(down + (up − down) u) = rate
        let (p, q, r) = (up - down, down - a * (up - down), -a * down - rate);
        if p.abs() < 1e-9 * up {
            return a + rate * self.activation_time;
        }
        let discriminant = (q * q - 4.0 * p * r).max(0.0).sqrt();
        // The root that tends to a + rate/down as p → 0.
        2.0 * -r / (q + q.signum() * discriminant)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    pub(crate) fn muscle() -> Musculotendon {
        Musculotendon {
            name: "m".into(),
            max_isometric_force: 300.0,
            optimal_fibre_length: 0.12,
            tendon_slack_length: 0.2,
            pennation_angle: 0.2,
            activation_time: 0.05,
            deactivation_time: 0.12,
            max_shortening_velocity: 2.0,
            force_velocity: ForceVelocity::default(),
            rigid_tendon: false,
            has_passive_force: true,
            path: Path::Straight(crate::model::path::StraightPath::new(vec![])),
        }
    }

    #[test]
    fn fibre_force_derivatives_agree_with_differences() {
        let muscle = muscle();
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        for _ in 0..100 {
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
                assert!(((high.value - low.value) / (2.0 * e) - here.gradient[i]).abs() < 1e-7);
                for j in 0..3 {
                    let difference = (high.gradient[j] - low.gradient[j]) / (2.0 * e);
                    assert!((difference - here.hessian[i][j]).abs() < 1e-5 * (1.0 + here.hessian[i][j].abs()));
                }
            }
        }
    }

    #[test]
    fn excitation_inverts_the_activation_equation() {
        let mut muscle = muscle();
        for (up, down) in [(0.05, 0.12), (0.12, 0.12), (0.12, 0.05)] {
            (muscle.activation_time, muscle.deactivation_time) = (up, down);
            for (a, rate) in [(0.2, 0.5), (0.7, -1.0), (0.01, 0.0), (0.3, 2.0)] {
                let u = muscle.excitation(a, rate);
                assert!(muscle.activation_residual(a, rate, u).value.abs() < 1e-10, "{up} {down} {a} {rate} {u}");
            }
        }
    }
}
