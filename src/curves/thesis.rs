//! The curves of the thesis (Paper B eqs 8–11 and Figures 2 to 4).

use std::sync::LazyLock;

use super::{Curves, Jet};
use crate::numerics::cubic::{CubicSpline, Ends};

/// The thesis' curves with its force–velocity relation.
#[derive(Clone, Copy, Debug)]
pub struct Thesis(pub ForceVelocity);

impl Curves for Thesis {
    fn active_force_length(&self, l: f64) -> Jet {
        active_force_length(l)
    }

    fn passive_force_length(&self, l: f64) -> Jet {
        passive_force_length(l)
    }

    fn force_velocity(&self, v: f64) -> Jet {
        self.0.at(v)
    }

    fn bending_velocity(&self) -> f64 {
        self.0.shortening
    }

    fn tendon_force(&self, strain: f64) -> f64 {
        tendon_force(strain)
    }

    fn tendon_strain(&self, force: f64) -> Jet {
        tendon_strain(force)
    }

    fn keeps_thickness(&self) -> bool {
        false
    }
}

/// Parallel elastic force of the fibre at normalised length `l`: `exp(10 (l − 1)) / e⁵` (eq. 10).
pub fn passive_force_length(l: f64) -> Jet {
    let value = (10.0 * (l - 1.0) - 5.0).exp();
    Jet { value, first: 10.0 * value, second: 100.0 * value }
}

/// Active force–length points: normalised fibre length, normalised force.
///
/// Source: S. L. Delp, *Surgery simulation*, PhD thesis, Stanford 1990, as used by most musculoskeletal models
/// since (facts, no licence attached). The thesis plots the same shape in its Figure 2 without numbers.
pub const ACTIVE_FORCE_LENGTH: [(f64, f64); 13] = [
    (0.0, 0.0),
    (0.2, 0.0),
    (0.401, 0.0),
    (0.52725, 0.226667),
    (0.62875, 0.636667),
    (0.71875, 0.856667),
    (0.86125, 0.95),
    (1.045, 0.993333),
    (1.2175, 0.77),
    (1.43875, 0.246667),
    (1.61875, 0.0),
    (1.8, 0.0),
    (2.2, 0.0),
];

/// The part of the table that bounds or carries the curve.
static ACTIVE_SPLINE: LazyLock<CubicSpline> =
    LazyLock::new(|| CubicSpline::new(&ACTIVE_FORCE_LENGTH[2..=10], Ends::Flat));

/// Active force–length relation of the fibre: a cubic spline through [`ACTIVE_FORCE_LENGTH`] (Figure 2).
///
/// DEPARTURE [thesis, Paper B, Figure 2]: an interpolating spline through all 13 points swings below zero in the
/// flat outer spans. Ours is clamped to zero slope at 0.401 and 1.61875 and is zero outside: the same points, twice
/// continuously differentiable in between, never negative.
pub fn active_force_length(l: f64) -> Jet {
    let (low, high) = (ACTIVE_FORCE_LENGTH[2].0, ACTIVE_FORCE_LENGTH[10].0);
    if l <= low || l >= high {
        return Jet { value: 0.0, first: 0.0, second: 0.0 };
    }
    let [value, first, second] = ACTIVE_SPLINE.at(l);
    Jet { value, first, second }
}

/// Force–velocity relation (eqs 8, 9).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ForceVelocity {
    /// b3 of eq. (9): the force left at infinite shortening velocity, and the curvature.
    pub shortening: f64,
    /// The force at infinite lengthening velocity, 1.33 in eq. (8).
    ///
    /// ERRATUM [thesis, Paper B, Figure 3]: the figure's axis runs from 0.2 to 1.8 but eq. (8) gives 0.40 and 1.30 at
    /// v = ∓1; the equation is taken, the limit is a parameter.
    pub eccentric_limit: f64,
}

impl Default for ForceVelocity {
    fn default() -> Self {
        Self { shortening: 0.25, eccentric_limit: 1.33 }
    }
}

impl ForceVelocity {
    /// The relation at `v` = fibre velocity over maximum shortening velocity, negative when shortening.
    ///
    /// The literal form of eq. (8): slope `1/b3 − 1` on both sides of 0 (what "b4 is chosen to give a constant
    /// derivative" means) and never below b3. It is C¹; the second derivative jumps at 0.
    pub fn at(&self, v: f64) -> Jet {
        // (1 − k v/b) / (1 − v/b), with b = b3 = k on shortening, b = b4 and k = the limit on lengthening.
        let (b, k) = if v <= 0.0 {
            (self.shortening, self.shortening)
        } else {
            (-(self.eccentric_limit - 1.0) * self.shortening / (1.0 - self.shortening), self.eccentric_limit)
        };
        let down = 1.0 - v / b;
        let slope = (1.0 - k) / b;
        Jet { value: (1.0 - k * v / b) / down, first: slope / (down * down), second: 2.0 * slope / (b * down.powi(3)) }
    }
}

/// Normalised tendon force at strain `l` (eq. 11): a parabola, then a line; odd in `l`.
///
/// DEPARTURE [thesis, Paper B, eq. 11]: as printed the line is `37.5 l − 0.2375`, which jumps by 1e-5 in value and from 37.6
/// to 37.5 in slope where it meets the parabola at 0.0127; an optimum on the jump has no KKT point. The line goes on with
/// the parabola's own value and slope, which changes forces by less than 0.3 %.
///
/// DEPARTURE [thesis, Paper B, eq. 11]: the parabola `k l²` is `k l √(l² + ε²)`, ε = 1e-4: it has the slope k ε at 0 instead of none,
/// so that its inverse has no vertical tangent there. Forces change by less than 7.5e-6 of the maximum (2 mN of
/// 300 N). Below 0, where eq. (11) says 0, it goes on as an odd function; the solver keeps forces at or above 0.
pub fn tendon_force(l: f64) -> f64 {
    let size = l.abs();
    let force = if size < TOE_STRAIN {
        TOE_STIFFNESS * size * root(size, SOFT_STRAIN)
    } else {
        TOE_FORCE.value + TOE_FORCE.first * (size - TOE_STRAIN)
    };
    force.copysign(l)
}

/// √(a² + b²) of numbers far from over- and underflow.
fn root(a: f64, b: f64) -> f64 {
    (a * a + b * b).sqrt()
}

const TOE_STIFFNESS: f64 = 1480.3;
const TOE_STRAIN: f64 = 0.0127;
const SOFT_STRAIN: f64 = 1e-4;

/// Value and slope of the toe where the line takes over.
static TOE_FORCE: LazyLock<Jet> = LazyLock::new(|| {
    let root = root(TOE_STRAIN, SOFT_STRAIN);
    let first = TOE_STIFFNESS * (root + TOE_STRAIN * TOE_STRAIN / root);
    Jet { value: TOE_STIFFNESS * TOE_STRAIN * root, first, second: 0.0 }
});

/// Strain of the tendon that carries the normalised force `f`: the inverse of [`tendon_force`].
pub fn tendon_strain(f: f64) -> Jet {
    let size = f.abs();
    if size >= TOE_FORCE.value {
        let value = TOE_STRAIN + (size - TOE_FORCE.value) / TOE_FORCE.first;
        return Jet { value: value.copysign(f), first: 1.0 / TOE_FORCE.first, second: 0.0 };
    }
    // l² (l² + ε²) = F² with F = f/k: l = F √(2/(S + ε²)), S = √(ε⁴ + 4 F²).
    let (force, soft) = (f / TOE_STIFFNESS, SOFT_STRAIN * SOFT_STRAIN);
    let value = force * (2.0 / (root(soft, 2.0 * force) + soft)).sqrt();
    // f' = k (2 l² + ε²)/r and f'' = k l (2 l² + 3 ε²)/r³ with r = √(l² + ε²); the inverse's follow.
    let root = root(value, SOFT_STRAIN);
    let slope = TOE_STIFFNESS * (2.0 * value * value + soft) / root;
    let bend = TOE_STIFFNESS * value * (2.0 * value * value + 3.0 * soft) / root.powi(3);
    Jet { value, first: 1.0 / slope, second: -bend / slope.powi(3) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(curve: impl Fn(f64) -> Jet, points: &[f64], e: f64, tolerance: f64) {
        for &x in points {
            let (low, here, high) = (curve(x - e), curve(x), curve(x + e));
            let first = (high.value - low.value) / (2.0 * e);
            let second = (high.first - low.first) / (2.0 * e);
            assert!((first - here.first).abs() <= tolerance * (1.0 + here.first.abs()), "{x}: {first} {here:?}");
            assert!((second - here.second).abs() <= tolerance * (1.0 + here.second.abs()), "{x}: {second} {here:?}");
        }
    }

    #[test]
    fn derivatives_agree_with_differences() {
        check(passive_force_length, &[0.5, 0.9, 1.3], 1e-6, 1e-7);
        check(active_force_length, &[0.45, 0.6, 0.7, 0.8, 1.0, 1.3, 1.5, 1.7], 1e-6, 1e-6);
        check(|v| ForceVelocity::default().at(v), &[-3.0, -0.4, -0.01, 0.01, 0.2, 4.0], 1e-7, 1e-5);
        check(tendon_strain, &[1e-3, 0.1, 0.2, 0.3, 0.9], 1e-7, 1e-6);
        check(tendon_strain, &[1e-5, 1e-6, -2e-5, 0.0], 1e-9, 1e-4);
    }

    #[test]
    fn the_active_curve_passes_its_points_and_is_nowhere_negative() {
        for (l, f) in ACTIVE_FORCE_LENGTH {
            assert!((active_force_length(l).value - f).abs() < 1e-12);
        }
        assert!((0..=2200).all(|i| active_force_length(i as f64 * 1e-3).value >= 0.0));
    }

    #[test]
    fn the_force_velocity_curve_has_the_values_and_the_slope_of_the_print() {
        let curve = ForceVelocity::default();
        assert!((curve.at(-1.0).value - 0.4).abs() < 1e-12);
        assert!((curve.at(1.0).value - (1.0 + 1.33 / 0.11) / (1.0 + 1.0 / 0.11)).abs() < 1e-12);
        assert!((curve.at(0.0).first - 3.0).abs() < 1e-12);
        assert!((curve.at(1e-12).first - 3.0).abs() < 1e-9);
        assert!(curve.at(-1e6).value >= 0.25 && curve.at(1e6).value <= 1.33);
    }

    #[test]
    fn the_tendon_curve_is_inverted_and_near_the_print() {
        for f in [-0.3, -1e-5, 0.0, 1e-8, 1e-5, 0.01, TOE_FORCE.value, 0.5, 1.2] {
            assert!((tendon_force(tendon_strain(f).value) - f).abs() < 1e-15);
        }
        for i in 0..=127 {
            let l = i as f64 * 1e-4;
            assert!((tendon_force(l) - 1480.3 * l * l).abs() < 7.5e-6);
        }
        for l in [0.013, 0.02, 0.033] {
            assert!((tendon_force(l) / (37.5 * l - 0.2375) - 1.0).abs() < 3e-3);
        }
    }
}
