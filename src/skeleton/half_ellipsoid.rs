//! The plane in which a path is laid around an ellipsoid of which it may take one half only, after OpenSim (`WrapEllipsoid`, method
//! "hybrid", version 4.6): through both ends and a guide point of the surface. OpenSim's path stays in that plane; here it is where the search for a
//! geodesic begins.
//!
//! The guide is the point of the surface nearest to the line where the line crosses the coordinate plane most across it; where the line
//! is not near any axis, a mean over the part of the line inside, and a blend of both between. A guide on the wrong half is
//! turned over to the other half, the mean only as far as the border.

use super::frame::{Vector, along, dot, minus, norm, unit};
use super::surface::Side;

/// Cosine of the angle between line and axis up to which the mean counts alone, and from which on the crossing does.
const MEAN_ALONE: f64 = 0.7073;
const CROSSING_ALONE: f64 = 0.9;
/// Where the crossing is nearer to an end of the part inside than this share of it, the mean gets weight.
const NEAR_END: f64 = 0.3;
/// Points of the mean.
const SAMPLES: usize = 32;

/// The guide of the line from a to b, which runs through; all in units in which the mean radius is 1.
pub fn guide(radii: &Vector, side: Side, a: &Vector, b: &Vector) -> Option<Vector> {
    let (enters, leaves) = inside(radii, a, b)?;
    let way = minus(&leaves, &enters);
    let direction = unit(&way);
    let axis = (0..3).max_by(|&i, &j| direction[i].abs().total_cmp(&direction[j].abs()))?;
    let crossing = -enters[axis] / way[axis];
    let from_end = crossing.min(1.0 - crossing).clamp(0.0, NEAR_END) / NEAR_END;
    let mut cosine = direction[axis].abs();
    if cosine > MEAN_ALONE {
        cosine = MEAN_ALONE + from_end * (cosine - MEAN_ALONE);
    }
    let crossing_weight = ((cosine - MEAN_ALONE) / (CROSSING_ALONE - MEAN_ALONE)).clamp(0.0, 1.0);
    // Where a line through the centre has no nearest point, the middle of the half decides.
    let top = if direction[side.axis].abs() < CROSSING_ALONE { side.axis } else { (side.axis + 1) % 3 };
    let pole = [0, 1, 2].map(|i| if i == top { side.sign * radii[i] } else { 0.0 });
    let at_crossing = || nearest(radii, &along(&enters, crossing, &way), Some(axis)).unwrap_or(pole);
    let found = match crossing_weight {
        0.0 => mean(radii, &enters, &way).unwrap_or(pole),
        1.0 => at_crossing(),
        weight => {
            let (crossing, mean) = (at_crossing(), mean(radii, &enters, &way).unwrap_or(pole));
            nearest(radii, &[0, 1, 2].map(|i| weight * crossing[i] + (1.0 - weight) * mean[i]), None).unwrap_or(pole)
        }
    };
    if side.holds(&found) {
        return Some(found);
    }
    let mut turned = found;
    turned[side.axis] *= -crossing_weight;
    nearest(radii, &turned, None).or(Some(pole))
}

/// Where the line from a to b enters and leaves.
fn inside(radii: &Vector, a: &Vector, b: &Vector) -> Option<(Vector, Vector)> {
    let over = |x: &Vector| [0, 1, 2].map(|i| x[i] / radii[i]);
    let (start, way) = (over(a), over(&minus(b, a)));
    let (square, mixed) = (dot(&way, &way), dot(&start, &way));
    let root = (mixed * mixed - square * (dot(&start, &start) - 1.0)).sqrt();
    let at = |share: f64| along(a, share, &minus(b, a));
    root.is_finite().then(|| (at((-mixed - root) / square), at((-mixed + root) / square)))
}

/// The mean of the directions from the part of the line inside to the surface, laid on at its middle; none where they cancel.
fn mean(radii: &Vector, enters: &Vector, way: &Vector) -> Option<Vector> {
    let mut sum = [0.0; 3];
    for k in 0..SAMPLES {
        let x = along(enters, (k as f64 + 0.5) / SAMPLES as f64, way);
        sum = along(&sum, 1.0, &unit(&minus(&nearest(radii, &x, None)?, &x)));
    }
    if norm(&sum) < 1e-9 {
        return None;
    }
    nearest(radii, &along(&along(enters, 0.5, way), 1.0, &unit(&sum)), None)
}

/// The point of the surface nearest to x; within a coordinate plane if it is in that. x_i r_i²/(t + r_i²), t by Newton's method from below,
/// where the function is convex. None of the centre.
fn nearest(radii: &Vector, x: &Vector, in_plane: Option<usize>) -> Option<Vector> {
    let axes: Vec<usize> = (0..3).filter(|&i| in_plane != Some(i) && x[i] != 0.0).collect();
    if axes.is_empty() {
        return None;
    }
    let start = axes.iter().map(|&i| radii[i] * (x[i].abs() - radii[i])).fold(f64::NEG_INFINITY, f64::max);
    let mut t = start;
    for _ in 0..64 {
        let (mut value, mut slope) = (-1.0, 0.0);
        for &i in &axes {
            let term = radii[i] * x[i] / (t + radii[i] * radii[i]);
            value += term * term;
            slope -= 2.0 * term * term / (t + radii[i] * radii[i]);
        }
        let step = -value / slope;
        if step.is_nan() || step <= 1e-14 {
            break;
        }
        t += step;
    }
    let mut found = [0.0; 3];
    for i in axes {
        found[i] = x[i] * radii[i] * radii[i] / (t + radii[i] * radii[i]);
    }
    Some(found)
}
