//! The curves of M. Millard, T. Uchida, A. Seth and S. Delp, *J Biomech Eng* 135:021005, 2013, with the shape parameters and their
//! defaults of OpenSim's `Millard2012EquilibriumMuscle` with damping (Apache 2.0).

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::bezier::{BezierCurve, knot};
use super::{Curves, Jet};
use crate::numerics::root::increasing_root;

/// What shapes the curves of a muscle (`millard_2012`).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MillardParameters {
    /// Fibre length at which the steep ascending limb of f_l begins.
    pub min_active_length: f64,
    /// Fibre length at which the shallow ascending limb begins.
    pub transition_length: f64,
    /// Fibre length at which the descending limb ends.
    pub max_active_length: f64,
    /// Slope of the shallow ascending limb.
    pub ascending_slope: f64,
    /// Slope of f_v at rest.
    pub isometric_slope: f64,
    /// Slope of f_v just below the maximum shortening velocity.
    pub concentric_slope: f64,
    /// Slope of f_v just below the maximum lengthening velocity.
    pub eccentric_slope: f64,
    /// f_v at the maximum lengthening velocity.
    pub eccentric_limit: f64,
    /// Strain of the fibre at which its passive force begins.
    pub passive_strain_at_zero: f64,
    /// Strain of the fibre at a passive force of 1.
    pub passive_strain_at_one: f64,
    /// Strain of the tendon at a force of 1.
    pub tendon_strain_at_one: f64,
}

impl Default for MillardParameters {
    fn default() -> Self {
        Self {
            min_active_length: 0.4441,
            transition_length: 0.73,
            max_active_length: 1.8123,
            ascending_slope: 0.8616,
            isometric_slope: 5.0,
            concentric_slope: 0.25,
            eccentric_slope: 0.15,
            eccentric_limit: 1.4,
            passive_strain_at_zero: 0.0,
            passive_strain_at_one: 0.7,
            tendon_strain_at_one: 0.049,
        }
    }
}

impl MillardParameters {
    /// What is wrong with them, if they do not shape curves that rise and fall once.
    pub fn defect(&self) -> Option<String> {
        let (least, most) = (self.min_active_length, self.max_active_length);
        let found = |what: &str| Some(format!("{what}: found {self:?}"));
        let slopes = [self.ascending_slope, self.isometric_slope, self.concentric_slope, self.eccentric_slope];
        let shoulder = 1.0 - self.ascending_slope * (0.95 - self.transition_length);
        if !slopes.iter().all(|slope| *slope > 0.0 && slope.is_finite()) || shoulder.is_nan() || shoulder <= 0.0 {
            return found("slopes must be positive, and ascending_slope so small that the limb does not fall below 0");
        }
        if !(0.0 <= least && least < self.transition_length && self.transition_length < 0.95 && most > 1.15) {
            return found("min_active_length < transition_length < 0.95 and max_active_length > 1.15 do not hold");
        }
        if !(self.passive_strain_at_zero < self.passive_strain_at_one && self.passive_strain_at_zero > -1.0) {
            return found("-1 < passive_strain_at_zero < passive_strain_at_one does not hold");
        }
        if !(self.tendon_strain_at_one > 0.0 && self.eccentric_limit > 1.0) {
            return found("tendon_strain_at_one > 0 and eccentric_limit > 1 do not hold");
        }
        let own = Millard2012::new(self);
        let curves = [("f_l", &own.active), ("f_pe", &own.passive), ("f_v", &own.velocity), ("tendon", &own.tendon)];
        let bent = curves.iter().find(|(_, curve)| !curve.is_function());
        bent.and_then(|(name, _)| found(&format!("the curve {name} does not go forward")))
    }
}

/// Slope of the tendon curve at a force of 1, of `1/strain`.
const TENDON_STIFFNESS: f64 = 1.375;
/// Force at which the tendon's toe ends.
const TOE_FORCE: f64 = 2.0 / 3.0;
/// Slope added to the tendon curve at strain 0; see [`Millard2012::tendon_strain`].
const SLACK_SLOPE: f64 = 0.1;

#[derive(Clone, Debug)]
pub struct Millard2012 {
    active: BezierCurve,
    passive: BezierCurve,
    velocity: BezierCurve,
    tendon: BezierCurve,
    tendon_strain_at_one: f64,
}

impl Millard2012 {
    pub fn new(shape: &MillardParameters) -> Self {
        Self {
            active: active(shape),
            passive: passive(shape),
            velocity: velocity(shape),
            tendon: tendon(shape.tendon_strain_at_one),
            tendon_strain_at_one: shape.tendon_strain_at_one,
        }
    }
}

/// f_l: up steeply, up along the shallow limb, over the top, down.
fn active(shape: &MillardParameters) -> BezierCurve {
    let MillardParameters { min_active_length: x0, transition_length: x1, max_active_length: x3, .. } = *shape;
    let (top, half) = (1.0, 0.05);
    let shoulder = top - half;
    let y1 = 1.0 - shape.ascending_slope * (shoulder - x1);
    let steep = knot(0.5 * (x0 + x1), 0.5 * y1, 1.25 * y1 / (x1 - x0));
    let shallow = knot(0.5 * (x1 + shoulder), 0.5 * (1.0 + y1), shape.ascending_slope);
    let falling = knot(0.5 * (top + half + x3), 0.5, -1.0 / (x3 - half - top - half));
    BezierCurve::new(
        vec![knot(x0, 0.0, 0.0), steep, shallow, knot(top, 1.0, 0.0), falling, knot(x3, 0.0, 0.0)],
        &[1.0; 5],
    )
}

/// f_pe: a corner, and on to force 1 ever more steeply.
fn passive(shape: &MillardParameters) -> BezierCurve {
    let (zero, one) = (1.0 + shape.passive_strain_at_zero, 1.0 + shape.passive_strain_at_one);
    let stiffness = 2.0 / (one - zero);
    let low = 0.2;
    let width = (0.1 / stiffness).min(0.1 * (one - zero));
    let corner = knot(zero + width, 0.5 * low * width, low);
    BezierCurve::new(vec![knot(zero, 0.0, 0.0), corner, knot(one, 1.0, stiffness)], &[0.75; 2])
}

/// f_v: flat at both ends, where damping does the rest.
fn velocity(shape: &MillardParameters) -> BezierCurve {
    let near = 0.1;
    let concentric = knot(-1.0 + near, 0.5 * shape.concentric_slope * near, shape.concentric_slope);
    let eccentric = knot(1.0 - near, shape.eccentric_limit - 0.5 * shape.eccentric_slope * near, shape.eccentric_slope);
    let ends = [knot(-1.0, 0.0, 0.0), knot(1.0, shape.eccentric_limit, 0.0)];
    BezierCurve::new(
        vec![ends[0], concentric, knot(0.0, 1.0, shape.isometric_slope), eccentric, ends[1]],
        &[0.6, 0.6, 0.9, 0.9],
    )
}

/// A toe, then a line; over strain.
fn tendon(one: f64) -> BezierCurve {
    let stiffness = TENDON_STIFFNESS / one;
    let on_line = |force: f64| one + (force - 1.0) / stiffness;
    let (toe, middle) = (on_line(TOE_FORCE), on_line(0.5 * TOE_FORCE));
    let foot = 0.1 * toe;
    let slope = 0.5 * TOE_FORCE / (middle - foot);
    let control = 0.5 * (foot + middle);
    let corner = knot(control, slope * (control - foot), slope);
    BezierCurve::new(vec![knot(0.0, 0.0, 0.0), corner, knot(toe, TOE_FORCE, stiffness)], &[0.5; 2])
}

impl Curves for Millard2012 {
    fn active_force_length(&self, l: f64) -> Jet {
        self.active.at(l)
    }

    fn passive_force_length(&self, l: f64) -> Jet {
        self.passive.at(l)
    }

    fn force_velocity(&self, v: f64) -> Jet {
        self.velocity.at(v)
    }

    fn bending_velocity(&self) -> f64 {
        0.2
    }

    fn tendon_force(&self, strain: f64) -> f64 {
        let plain = self.tendon.at(strain).value;
        // f = plain + c (strain − f strain₁)
        (plain + SLACK_SLOPE * strain) / (1.0 + SLACK_SLOPE * self.tendon_strain_at_one)
    }

    /// DEPARTURE [Millard 2013]: the curve starts with slope 0, so that its inverse has a vertical tangent there. A line of slope 0.1
    /// is added, and taken away again in proportion to the force: it keeps force 1 at its strain, and changes others by at most
    /// 0.002.
    fn tendon_strain(&self, force: f64) -> Jet {
        let one = self.tendon_strain_at_one;
        let sum = (1.0 + SLACK_SLOPE * one) * force;
        let strain = if sum <= 0.0 { sum / SLACK_SLOPE } else { self.solve(sum) };
        let plain = self.tendon.at(strain);
        let slope = (plain.first + SLACK_SLOPE) / (1.0 + SLACK_SLOPE * one);
        let bend = plain.second / (1.0 + SLACK_SLOPE * one);
        Jet { value: strain, first: 1.0 / slope, second: -bend / slope.powi(3) }
    }

    fn keeps_thickness(&self) -> bool {
        true
    }
}

impl Millard2012 {
    /// The strain at which plain curve and line add up to `sum` > 0: between 0 and that of the plain curve alone.
    fn solve(&self, sum: f64) -> f64 {
        let most = self.tendon.inverse(sum).min(sum / SLACK_SLOPE);
        increasing_root([0.0, most], most, [4.0 * f64::EPSILON * sum, f64::EPSILON * most], |strain| {
            let plain = self.tendon.at(strain);
            [plain.value + SLACK_SLOPE * strain - sum, plain.first + SLACK_SLOPE]
        })
    }
}
