//! The limits of warnings.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Limits for the warnings: `warn.…` in a study.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Limits {
    /// Tracking error, RMS, degrees.
    pub tracking_deg: f64,
    /// Tracking error, RMS, mm.
    pub tracking_mm: f64,
    /// Fraction of the time with the activation at its upper bound.
    pub saturated: f64,
    /// Force relative to the maximum isometric force.
    pub overload: f64,
    /// Passive force relative to the maximum isometric force.
    pub passive: f64,
    /// Shortest fibre length, optimal fibre lengths.
    pub fibre_length_min: f64,
    /// Longest fibre length, optimal fibre lengths.
    pub fibre_length_max: f64,
    /// Rate of an angle, rad/s.
    pub speed_rad_s: f64,
    /// Rate of a displacement, m/s.
    pub speed_m_s: f64,
    /// Range of an angle, rad.
    pub turn_rad: f64,
    /// Estimated relative discretisation error of the effort and the mean forces.
    pub mesh: f64,
    /// Fibre velocity, optimal fibre lengths per second.
    pub fibre_velocity: f64,
    /// Peak of a reserve relative to that of the net joint moment.
    #[serde(skip_serializing_if = "is_default_share")]
    pub reserves: f64,
    /// Total variation of an excitation over twice its range.
    #[serde(skip_serializing_if = "are_default_swings")]
    pub chatter: f64,
}

const RESERVE_SHARE: f64 = 0.05;

/// The default is not part of a job's identity; otherwise the ids of older jobs would change.
fn is_default_share(share: &f64) -> bool {
    *share == RESERVE_SHARE
}

const SWINGS: f64 = 8.0;

fn are_default_swings(swings: &f64) -> bool {
    *swings == SWINGS
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            tracking_deg: 2.0,
            tracking_mm: 10.0,
            saturated: 0.1,
            overload: 1.5,
            passive: 0.2,
            fibre_length_min: 0.4,
            fibre_length_max: 1.6,
            speed_rad_s: 30.0,
            speed_m_s: 10.0,
            turn_rad: std::f64::consts::TAU,
            mesh: 0.05,
            fibre_velocity: 20.0,
            reserves: RESERVE_SHARE,
            chatter: SWINGS,
        }
    }
}

impl Limits {
    /// Names of the limits in a study, after `warn.`.
    pub const NAMES: [&str; 14] = [
        "tracking_deg",
        "tracking_mm",
        "saturated",
        "overload",
        "passive",
        "fibre_length_min",
        "fibre_length_max",
        "speed_rad_s",
        "speed_m_s",
        "turn_rad",
        "mesh",
        "fibre_velocity",
        "reserves",
        "chatter",
    ];

    /// The limit called `name`.
    pub fn named(&mut self, name: &str) -> Option<&mut f64> {
        Some(match name {
            "tracking_deg" => &mut self.tracking_deg,
            "tracking_mm" => &mut self.tracking_mm,
            "saturated" => &mut self.saturated,
            "overload" => &mut self.overload,
            "passive" => &mut self.passive,
            "fibre_length_min" => &mut self.fibre_length_min,
            "fibre_length_max" => &mut self.fibre_length_max,
            "speed_rad_s" => &mut self.speed_rad_s,
            "speed_m_s" => &mut self.speed_m_s,
            "turn_rad" => &mut self.turn_rad,
            "mesh" => &mut self.mesh,
            "fibre_velocity" => &mut self.fibre_velocity,
            "reserves" => &mut self.reserves,
            "chatter" => &mut self.chatter,
            _ => return None,
        })
    }

    pub fn are_default(&self) -> bool {
        *self == Self::default()
    }
}
