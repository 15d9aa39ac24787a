//! Passive moments (N m) or forces (N) at joint coordinates: springs, dampers and soft limits, such as ligaments.
//!
//! ```text
//! τ = −k (q − q_0) − b q̇  +  K_l S_l (q_l − q) − K_u S_u (q − q_u) − d (S_l + S_u) q̇
//! ```
//!
//! S rises from 0 at a limit to 1 a transition beyond it, as a polynomial of degree five. The first two terms are OpenSim's
//! SpringGeneralizedForce, the others its CoordinateLimitForce.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A passive moment or force at a joint coordinate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PassiveEntry {
    /// Name of the element.
    pub name: String,
    /// The joint coordinate that it acts at.
    pub coordinate: String,
    /// Stiffness of a spring, N m/rad or N/m.
    #[serde(default)]
    pub stiffness: f64,
    /// Where the spring is slack, rad or m.
    #[serde(default)]
    pub rest: f64,
    /// Damping, N m s/rad or N s/m.
    #[serde(default)]
    pub damping: f64,
    /// Lower limit, beyond which it pushes back, rad or m; none if absent.
    pub lower: Option<f64>,
    /// Upper limit; none if absent.
    pub upper: Option<f64>,
    /// Stiffness beyond the lower limit, N m/rad or N/m.
    #[serde(default)]
    pub lower_stiffness: f64,
    /// Stiffness beyond the upper limit.
    #[serde(default)]
    pub upper_stiffness: f64,
    /// How far beyond a limit stiffness and damping are complete, rad or m; the default is 5°, in rad.
    #[serde(default = "transition")]
    pub transition: f64,
    /// Damping beyond the limits, N m s/rad or N s/m.
    #[serde(default)]
    pub limit_damping: f64,
}

/// 5 degrees.
fn transition() -> f64 {
    5.0 * std::f64::consts::PI / 180.0
}

/// A checked passive element.
#[derive(Clone, Debug, PartialEq)]
pub struct Passive {
    /// Number of the coordinate.
    pub coordinate: usize,
    pub entry: PassiveEntry,
}

/// τ with its derivatives by q and q̇.
#[derive(Clone, Copy, Debug)]
pub struct PassiveForce {
    pub value: f64,
    pub gradient: [f64; 2],
    pub hessian: [[f64; 2]; 2],
}

impl PassiveEntry {
    pub fn at(&self, q: f64, rate: f64) -> PassiveForce {
        let mut force = PassiveForce {
            value: -self.stiffness * (q - self.rest) - self.damping * rate,
            gradient: [-self.stiffness, -self.damping],
            hessian: [[0.0; 2]; 2],
        };
        let limits = [(self.lower, -1.0, self.lower_stiffness), (self.upper, 1.0, self.upper_stiffness)];
        for (limit, sign, stiffness) in limits {
            let Some(limit) = limit else { continue };
            // How far beyond the limit.
            let beyond = sign * (q - limit);
            let [s, first, second] = self.rise(beyond);
            let pull = stiffness * s * beyond;
            let slope = stiffness * (first * beyond + s);
            let bend = stiffness * (second * beyond + 2.0 * first);
            let damping = self.limit_damping;
            force.value -= sign * pull + damping * s * rate;
            force.gradient[0] -= slope + damping * sign * first * rate;
            force.gradient[1] -= damping * s;
            force.hessian[0][0] -= sign * bend + damping * second * rate;
            force.hessian[0][1] -= damping * sign * first;
            force.hessian[1][0] -= damping * sign * first;
        }
        force
    }

    fn rise(&self, x: f64) -> [f64; 3] {
        let t = (x / self.transition).clamp(0.0, 1.0);
        let value = t * t * t * (10.0 + t * (6.0 * t - 15.0));
        let slope = 30.0 * (t * (1.0 - t)).powi(2) / self.transition;
        let bend = 60.0 * t * (1.0 - t) * (1.0 - 2.0 * t) / (self.transition * self.transition);
        [value, slope, bend]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_push_back_and_derivatives_are_those_of_differences() {
        let entry = PassiveEntry {
            name: "knee".into(),
            coordinate: "knee".into(),
            stiffness: 2.0,
            rest: 0.1,
            damping: 0.3,
            lower: Some(-0.2),
            upper: Some(1.0),
            lower_stiffness: 100.0,
            upper_stiffness: 200.0,
            transition: 0.2,
            limit_damping: 5.0,
        };
        let spring = |q: f64, rate: f64| -2.0 * (q - 0.1) - 0.3 * rate;
        assert_eq!(entry.at(0.5, 1.0).value, spring(0.5, 1.0));
        // Beyond the transition a limit is a spring.
        assert!((entry.at(1.5, 0.0).value - spring(1.5, 0.0) + 200.0 * 0.5).abs() < 1e-12);
        assert!((entry.at(-0.6, 1.0).value - spring(-0.6, 1.0) - 100.0 * 0.4 + 5.0).abs() < 1e-12);
        let h = 1e-6;
        for (q, rate) in [(-0.3, 0.7), (0.4, -0.2), (1.05, 1.3), (1.15, -2.0)] {
            let here = entry.at(q, rate);
            for k in 0..2 {
                let at = |s: f64| if k == 0 { entry.at(q + s, rate) } else { entry.at(q, rate + s) };
                let (low, high) = (at(-h), at(h));
                assert!(((high.value - low.value) / (2.0 * h) - here.gradient[k]).abs() < 1e-6);
                for i in 0..2 {
                    let bend = (high.gradient[i] - low.gradient[i]) / (2.0 * h);
                    assert!((bend - here.hessian[i][k]).abs() < 1e-4 * (1.0 + bend.abs()), "{q} {i} {k}");
                }
            }
        }
    }
}
