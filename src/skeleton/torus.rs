//! The way through the ring of a torus, after OpenSim: around a straight cylinder that stands in for the tube where the path comes nearest to
//! the ring, and takes the path on the side of the ring's middle. Unlike other surfaces the cylinder moves with the path.

use super::frame::{Frame, Vector, along, cross, dot, minus, unit};
use super::surface::{Shape, Side, Wrap};

/// Length of the cylinder, m: longer than any path.
const LENGTH: f64 = 10.0;
const STEPS: usize = 100;
const STILL: f64 = 1e-15;
/// m
const LONGEST_STEP: f64 = 0.1;

/// See [`Shape::wrap`].
pub fn around_torus(ring: f64, tube: f64, side: Option<Side>, a: &Vector, b: &Vector) -> Wrap {
    let Some(centre) = nearest_of_ring(ring, side, a, b) else { return Wrap::Missed };
    let x = unit(&centre.map(|x| -x));
    let y = [0.0, 0.0, -1.0];
    let z = cross(&x, &y);
    let frame = Frame { axes: [0, 1, 2].map(|i| [x[i], y[i], z[i]]), origin: centre };
    let inward = frame.inverse();
    let inner = Side { axis: 0, sign: 1.0 };
    let cylinder = Shape::Cylinder { radius: tube, side: Some(inner), length: LENGTH };
    match cylinder.wrap(&inward.point(a), &inward.point(b), None) {
        Wrap::Possible(contact) | Wrap::Certain(contact) => Wrap::Possible(contact.seen_from(&frame)),
        other => other,
    }
}

/// The point of the ring nearest to the line through a and b, from either end; with a side, that which the line passes on it.
fn nearest_of_ring(ring: f64, side: Option<Side>, a: &Vector, b: &Vector) -> Option<Vector> {
    let passes = [(a, b), (b, a)].map(|(from, to)| {
        let point = nearest_of_line(ring, from, to);
        let distance = (point[0].hypot(point[1]) - ring).hypot(point[2]);
        (distance, point)
    });
    let allowed = passes.iter().filter(|(_, point)| side.is_none_or(|side| side.holds(point)));
    let (_, point) = allowed.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let scale = ring / point[0].hypot(point[1]);
    scale.is_finite().then_some([point[0] * scale, point[1] * scale, 0.0])
}

/// Where the path is said to be nearest to the ring: a root of D′(u), D(u) = |x|² − 4 R ρ, with x = a + u n and ρ its distance from the axis,
/// by Newton's method on u from 0 on.
///
/// ERRATUM [OpenSim, `WrapTorus::calcCircleResids`]: the distance from the ring would be |x|² − 2 R ρ + R². The factor is kept: models were
/// made with it.
fn nearest_of_line(ring: f64, a: &Vector, b: &Vector) -> Vector {
    let n = unit(&minus(b, a));
    let (flat, mixed) = (n[0] * n[0] + n[1] * n[1], a[0] * n[0] + a[1] * n[1]);
    // Half of D′ and of D″.
    let slope_and_bend = |u: f64| {
        let rho = (flat * u * u + 2.0 * mixed * u + a[0] * a[0] + a[1] * a[1]).sqrt().max(f64::MIN_POSITIVE);
        let outward = flat * u + mixed;
        let slope = dot(a, &n) + u - 2.0 * ring * outward / rho;
        (slope, 1.0 - 2.0 * ring * (flat / rho - outward * outward / rho.powi(3)))
    };
    let mut u = 0.0;
    for _ in 0..STEPS {
        let (slope, bend) = slope_and_bend(u);
        let mut step = (-slope / bend).clamp(-LONGEST_STEP, LONGEST_STEP);
        while slope_and_bend(u + step).0.abs() > slope.abs() && step.abs() > STILL {
            step *= 0.5;
        }
        if step.is_nan() || step.abs() <= STILL {
            break;
        }
        u += step;
    }
    along(a, u, &n)
}
