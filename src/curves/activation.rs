//! Activation dynamics: the rate ȧ = g(a, u) of an activation at an excitation.

use crate::names::{choices, defaults};
use crate::numerics::root::increasing_root;

choices! {
    /// How activations follow excitations.
    ActivationDynamics {
        /// Paper B, eq. (4): ȧ = (u − a)(u/τ_act + (1 − u)/τ_deact)
        Thesis = "thesis",
        /// De Groote et al. 2016, as OpenSim Moco has it: the time constants depend on a, and switch smoothly at u = a
        DegrooteFregly2016 = "degroote_fregly_2016",
    }
}

defaults!(ActivationDynamics::Thesis);

/// The activation dynamics of a muscle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ActivationLaw {
    pub family: ActivationDynamics,
    /// τ_act, s
    pub up: f64,
    /// τ_deact, s
    pub down: f64,
    /// b of [`ActivationDynamics::DegrooteFregly2016`]: how sharply it switches.
    pub steepness: f64,
}

/// A rate, 1/s, with its derivatives by a and u.
#[derive(Clone, Copy, Debug)]
pub struct ActivationRate {
    pub value: f64,
    /// By a, by u.
    pub slopes: [f64; 2],
    /// By a twice, by both, by u twice.
    pub bends: [f64; 3],
}

impl ActivationLaw {
    /// g(a, u)
    pub fn rate(&self, a: f64, u: f64) -> ActivationRate {
        match self.family {
            ActivationDynamics::Thesis => self.thesis(a, u),
            ActivationDynamics::DegrooteFregly2016 => self.degroote_fregly(a, u),
        }
    }

    fn thesis(&self, a: f64, u: f64) -> ActivationRate {
        let (up, down) = (1.0 / self.up, 1.0 / self.down);
        let (speed, more) = (u * up + (1.0 - u) * down, up - down);
        ActivationRate {
            value: (u - a) * speed,
            slopes: [-speed, speed + (u - a) * more],
            bends: [0.0, -more, 2.0 * more],
        }
    }

    /// `[(½ + f)/(τ_act s) + (½ − f) s/τ_deact] (u − a)`, f = ½ tanh(b (u − a)), s = ½ + 3/2 a.
    fn degroote_fregly(&self, a: f64, u: f64) -> ActivationRate {
        let (gap, [s, s1]) = (u - a, slowness(a));
        let tanh = (self.steepness * gap).tanh();
        let f = 0.5 * tanh;
        let f1 = 0.5 * self.steepness * (1.0 - tanh * tanh);
        let f2 = -2.0 * self.steepness * tanh * f1;
        let up = [1.0 / (self.up * s), -s1 / (self.up * s * s), 2.0 * s1 * s1 / (self.up * s.powi(3))];
        let down = [s / self.down, s1 / self.down];
        let (more, turn) = (up[0] - down[0], up[1] - down[1]);
        let speed = (0.5 + f) * up[0] + (0.5 - f) * down[0];
        let own = (0.5 + f) * up[1] + (0.5 - f) * down[1];
        let [by_a, by_u] = [own - f1 * more, f1 * more];
        let [aa, au, uu] = [f2 * more - 2.0 * f1 * turn + (0.5 + f) * up[2], f1 * turn - f2 * more, f2 * more];
        ActivationRate {
            value: speed * gap,
            slopes: [by_a * gap - speed, by_u * gap + speed],
            bends: [aa * gap - 2.0 * by_a, au * gap + by_a - by_u, uu * gap + 2.0 * by_u],
        }
    }

    /// The excitation that gives the rate `ȧ` at activation `a`, the one near `a` if there are several.
    pub fn excitation(&self, a: f64, rate: f64) -> f64 {
        let (up, down) = (1.0 / self.up, 1.0 / self.down);
        match self.family {
            ActivationDynamics::Thesis => {
                // (u − a)(down + (up − down) u) = rate
                let (p, q, r) = (up - down, down - a * (up - down), -a * down - rate);
                if p.abs() < 1e-9 * up {
                    return a + rate * self.up;
                }
                let discriminant = (q * q - 4.0 * p * r).max(0.0).sqrt();
                // The root that tends to a + rate/down as p → 0.
                2.0 * -r / (q + q.signum() * discriminant)
            }
            ActivationDynamics::DegrooteFregly2016 => {
                let [s, _] = slowness(a);
                // The rate is at least the slowest times the gap.
                let far = a + 1.1 * rate / (up / s).min(down * s);
                let precision = [4.0 * f64::EPSILON * rate.abs(), 1e-15];
                increasing_root([a.min(far), a.max(far)], 0.5 * (a + far), precision, |u| {
                    let found = self.rate(a, u);
                    [found.value - rate, found.slopes[1]]
                })
            }
        }
    }
}

/// ½ + 3/2 a with its slope; constant below a = −0.2, where no solution is, but an iterate may be.
fn slowness(a: f64) -> [f64; 2] {
    if a < -0.2 { [0.2, 0.0] } else { [0.5 + 1.5 * a, 1.5] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    fn laws() -> Vec<ActivationLaw> {
        let mut all = Vec::new();
        for family in [ActivationDynamics::Thesis, ActivationDynamics::DegrooteFregly2016] {
            for (up, down) in [(0.05, 0.12), (0.12, 0.12), (0.12, 0.05)] {
                all.extend([0.1, 10.0].map(|steepness| ActivationLaw { family, up, down, steepness }));
            }
        }
        all
    }

    #[test]
    fn derivatives_agree_with_differences() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(4);
        let step = 1e-6;
        for law in laws() {
            for _ in 0..50 {
                let (a, u) = (rng.random_range(0.0..1.0), rng.random_range(0.0..1.0));
                let here = law.rate(a, u);
                let [by_a, by_u] =
                    [(step, 0.0), (0.0, step)].map(|(da, du)| [law.rate(a - da, u - du), law.rate(a + da, u + du)]);
                let near = |pair: [f64; 2], found: f64| {
                    let difference = (pair[1] - pair[0]) / (2.0 * step);
                    assert!((difference - found).abs() < 1e-6 * (10.0 + found.abs()), "{law:?} {difference} {found}");
                };
                near(by_a.map(|rate| rate.value), here.slopes[0]);
                near(by_u.map(|rate| rate.value), here.slopes[1]);
                near(by_a.map(|rate| rate.slopes[0]), here.bends[0]);
                near(by_a.map(|rate| rate.slopes[1]), here.bends[1]);
                near(by_u.map(|rate| rate.slopes[1]), here.bends[2]);
            }
        }
    }

    #[test]
    fn excitation_inverts_the_rate() {
        for law in laws() {
            for (a, rate) in [(0.2, 0.5), (0.7, -1.0), (0.01, 0.0), (0.3, 2.0), (0.5, 0.0)] {
                let u = law.excitation(a, rate);
                assert!((law.rate(a, u).value - rate).abs() < 1e-10, "{law:?} {a} {rate} {u}");
            }
        }
    }
}
