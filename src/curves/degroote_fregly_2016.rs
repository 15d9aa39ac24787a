//! The curves of F. De Groote, A. Kinney, A. Rao and B. Fregly, *Ann Biomed Eng* 44:2922–2936, 2016, with the constants of OpenSim's
//! `DeGrooteFregly2016Muscle` (Apache 2.0), which are the published ones but for f_l's last term and for f_v, put through
//! f_v(−1) = 0 and f_v(0) = 1.

use super::{Curves, Jet};

/// b1 to b4 of the three terms of `f_l = Σ b1 exp(−½ (l − b2)²/(b3 + b4 l)²)`.
const ACTIVE: [[f64; 4]; 3] =
    [[0.815067, 1.055033, 0.162385, 0.063303], [0.433005, 0.716775, -0.029947, 0.200357], [0.1, 1.0, 0.353553, 0.0]];
/// d1 to d4 of `f_v = d1 ln(d2 v + d3 + √((d2 v + d3)² + 1)) + d4`.
const VELOCITY: [f64; 4] = [-0.3211346127989808, -8.149, -0.374, 0.8825327733249912];
const PASSIVE_EXPONENT: f64 = 4.0;
/// Length at which the passive force is 0.
const LEAST_LENGTH: f64 = 0.2;
/// c1, and c3 = c1 c2^0 of `f_t = c1 exp(k (l_t − 1)) − c1`.
const TENDON: f64 = 0.2;
/// Below this force the inverse is a parabola, as the tendon cannot push by more than c1.
const SLACK: f64 = -0.1;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeGrooteFregly2016 {
    /// Width of f_l relative to the published one: l → 1 + (l − 1)/width.
    pub active_width: f64,
    /// Strain of the fibre at a passive force of 1.
    pub passive_strain: f64,
    /// Strain of the tendon at a force of 1.
    pub tendon_strain: f64,
}

impl Default for DeGrooteFregly2016 {
    fn default() -> Self {
        Self { active_width: 1.0, passive_strain: 0.6, tendon_strain: 0.049 }
    }
}

impl DeGrooteFregly2016 {
    /// k of f_t
    fn tendon_stiffness(&self) -> f64 {
        (1.0 + 1.0 / TENDON).ln() / self.tendon_strain
    }

    fn strain(&self, force: f64) -> Jet {
        let (unit, x) = (1.0 / self.tendon_stiffness(), TENDON + force);
        Jet { value: unit * (force / TENDON).ln_1p(), first: unit / x, second: -unit / (x * x) }
    }
}

impl Curves for DeGrooteFregly2016 {
    fn active_force_length(&self, l: f64) -> Jet {
        let width = 1.0 / self.active_width;
        let l = 1.0 + (l - 1.0) * width;
        let mut sum = Jet::default();
        for [b1, b2, b3, b4] in ACTIVE {
            let down = b3 + b4 * l;
            let r = (l - b2) / down;
            if r.is_nan() || r.abs() > 30.0 {
                continue;
            }
            let (slope, bend) = ((b3 + b4 * b2) / (down * down), -2.0 * b4 * (b3 + b4 * b2) / down.powi(3));
            let value = b1 * (-0.5 * r * r).exp();
            sum.value += value;
            sum.first -= value * r * slope;
            sum.second += value * ((r * slope).powi(2) - slope * slope - r * bend);
        }
        Jet { value: sum.value, first: sum.first * width, second: sum.second * width * width }
    }

    fn passive_force_length(&self, l: f64) -> Jet {
        let rate = PASSIVE_EXPONENT / self.passive_strain;
        let offset = ((LEAST_LENGTH - 1.0) * rate).exp();
        let scale = 1.0 / (PASSIVE_EXPONENT.exp() - offset);
        let power = ((l - 1.0) * rate).exp();
        Jet { value: scale * (power - offset), first: scale * rate * power, second: scale * rate * rate * power }
    }

    fn force_velocity(&self, v: f64) -> Jet {
        let [d1, d2, d3, d4] = VELOCITY;
        let w = d2 * v + d3;
        let root = (1.0 + w * w).sqrt();
        Jet { value: d1 * w.asinh() + d4, first: d1 * d2 / root, second: -d1 * d2 * d2 * w / root.powi(3) }
    }

    fn bending_velocity(&self) -> f64 {
        -1.0 / VELOCITY[1]
    }

    fn tendon_force(&self, strain: f64) -> f64 {
        let toe = self.strain(SLACK);
        if strain >= toe.value {
            return TENDON * ((self.tendon_stiffness() * strain).exp() - 1.0);
        }
        // strain = toe + first (f − SLACK) + second/2 (f − SLACK)², second < 0
        let below = strain - toe.value;
        SLACK + 2.0 * below / (toe.first + (toe.first * toe.first + 2.0 * toe.second * below).sqrt())
    }

    /// DEPARTURE [De Groote 2016]: below −0.1 the strain goes on as a parabola, because the tendon's force never falls to −0.2 and
    /// an iterate may.
    fn tendon_strain(&self, force: f64) -> Jet {
        if force >= SLACK {
            return self.strain(force);
        }
        let (toe, below) = (self.strain(SLACK), force - SLACK);
        Jet {
            value: toe.value + below * (toe.first + 0.5 * toe.second * below),
            first: toe.first + toe.second * below,
            second: toe.second,
        }
    }

    fn keeps_thickness(&self) -> bool {
        true
    }
}
