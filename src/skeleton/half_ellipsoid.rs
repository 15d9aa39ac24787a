//! Guide point of a path that must stay on one half of an ellipsoid, after OpenSim 4.6 (`WrapEllipsoid`, method
//! "hybrid"). OpenSim's path lies in the plane through both ends and the guide, a point of the surface. Here the path
//! in that plane is the starting point of the search for a geodesic.
//!
//! If the line between the ends is nearly parallel to a coordinate axis, the guide is the surface point nearest to
//! where the line crosses the coordinate plane normal to that axis. If the line is not near any axis, the guide follows
//! from a mean over the part of the line inside. In between, the two are blended. A guide on the wrong half is
//! reflected to the other half, or, if it is the mean, moved to the border only.

use super::frame::{Vector, along, dot, minus, norm, unit};
use super::shape::Side;

/// Cosine of the angle between line and axis up to which the guide is the mean alone.
const MEAN_ALONE: f64 = 0.7073;
/// Cosine from which on the guide is the crossing alone.
const CROSSING_ALONE: f64 = 0.9;
/// The mean gains weight if the crossing is nearer to an end of the part inside than this fraction of that part.
const NEAR_END: f64 = 0.3;
/// Points over which the mean is taken.
const SAMPLES: usize = 32;

/// The guide for the line from a to b, which runs through the ellipsoid; `None` if it does not. Lengths are in units of
/// the mean radius.
pub fn guide(radii: &Vector, side: Side, a: &Vector, b: &Vector) -> Option<Vector> {
    let (enters, leaves) = inside(radii, a, b)?;
    let chord = minus(&leaves, &enters);
    let direction = unit(&chord);
    let axis = (0..3).max_by(|&i, &j| direction[i].abs().total_cmp(&direction[j].abs()))?;
    let crossing = -enters[axis] / chord[axis];
    let from_end = crossing.min(1.0 - crossing).clamp(0.0, NEAR_END) / NEAR_END;
    let mut cosine = direction[axis].abs();
    if cosine > MEAN_ALONE {
        cosine = MEAN_ALONE + from_end * (cosine - MEAN_ALONE);
    }
    let crossing_weight = ((cosine - MEAN_ALONE) / (CROSSING_ALONE - MEAN_ALONE)).clamp(0.0, 1.0);
    // Fallback for lines through the centre, which has no nearest point: the middle of the half.
    let top = if direction[side.axis].abs() < CROSSING_ALONE { side.axis } else { (side.axis + 1) % 3 };
    let pole = [0, 1, 2].map(|i| if i == top { side.sign * radii[i] } else { 0.0 });
    let at_crossing = || nearest(radii, &along(&enters, crossing, &chord), Some(axis)).unwrap_or(pole);
    let found = match crossing_weight {
        0.0 => mean(radii, &enters, &chord).unwrap_or(pole),
        1.0 => at_crossing(),
        weight => {
            let (crossing, mean) = (at_crossing(), mean(radii, &enters, &chord).unwrap_or(pole));
            nearest(radii, &[0, 1, 2].map(|i| weight * crossing[i] + (1.0 - weight) * mean[i]), None).unwrap_or(pole)
        }
    };
    if side.holds(&found) {
        return Some(found);
    }
    let mut mirrored = found;
    mirrored[side.axis] *= -crossing_weight;
    nearest(radii, &mirrored, None).or(Some(pole))
}

/// Points at which the line from a to b enters and leaves the ellipsoid; `None` if it misses.
fn inside(radii: &Vector, a: &Vector, b: &Vector) -> Option<(Vector, Vector)> {
    let over = |x: &Vector| [0, 1, 2].map(|i| x[i] / radii[i]);
    let (start, line) = (over(a), over(&minus(b, a)));
    let (square, mixed) = (dot(&line, &line), dot(&start, &line));
    let root = (mixed * mixed - square * (dot(&start, &start) - 1.0)).sqrt();
    let at = |share: f64| along(a, share, &minus(b, a));
    root.is_finite().then(|| (at((-mixed - root) / square), at((-mixed + root) / square)))
}

/// The surface point nearest to the middle of the part inside after a unit displacement in the mean direction from that
/// part to the surface. `None` if the directions cancel.
fn mean(radii: &Vector, enters: &Vector, chord: &Vector) -> Option<Vector> {
    let mut sum = [0.0; 3];
    for k in 0..SAMPLES {
        let x = along(enters, (k as f64 + 0.5) / SAMPLES as f64, chord);
        sum = along(&sum, 1.0, &unit(&minus(&nearest(radii, &x, None)?, &x)));
    }
    if norm(&sum) < 1e-9 {
        return None;
    }
    nearest(radii, &along(&along(enters, 0.5, chord), 1.0, &unit(&sum)), None)
}

/// The surface point nearest to x; with `in_plane`, nearest within the coordinate plane normal to that axis, in which x
/// lies. `None` if x is the centre.
///
/// The point is x_i r_i²/(t + r_i²). Newton's method finds t from below, where the function is convex.
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
