//! The path through the ring of a torus, after OpenSim. A straight cylinder replaces the tube where the path comes
//! nearest to the ring; the path passes it on the side of the ring's middle. Unlike other surfaces, the cylinder moves
//! with the path.

use super::frame::{Frame, Vector, along, cross, dot, minus, unit};
use super::shape::{Shape, Side, Wrap};

/// Length of the cylinder, m: longer than any path.
const LENGTH: f64 = 10.0;
/// Maximum number of Newton iterations.
const MAX_ITERATIONS: usize = 100;
/// A Newton step no longer than this ends the iteration, m.
const STEP_TOLERANCE: f64 = 1e-15;
/// Longest Newton step, m.
const MAX_STEP: f64 = 0.1;

/// [`Shape::wrap`] for a torus.
pub fn around_torus(ring: f64, tube: f64, side: Option<Side>, a: &Vector, b: &Vector) -> Wrap {
    let Some(centre) = nearest_of_ring(ring, side, a, b) else { return Wrap::Missed };
    let x = unit(&centre.map(|x| -x));
    let y = [0.0, 0.0, -1.0];
    let z = cross(&x, &y);
    let frame = Frame { axes: [0, 1, 2].map(|i| [x[i], y[i], z[i]]), origin: centre };
    let to_cylinder = frame.inverse();
    let inner = Side { axis: 0, sign: 1.0 };
    let cylinder = Shape::Cylinder { radius: tube, side: Some(inner), length: LENGTH };
    match cylinder.wrap(&to_cylinder.point(a), &to_cylinder.point(b), None) {
        Wrap::Possible(contact) | Wrap::Certain(contact) => Wrap::Possible(contact.transformed(&frame)),
        other => other,
    }
}

/// The point of the ring nearest to the line through a and b. The search starts once from each end, and the nearer
/// result is used; with a side, only results on that side count. `None` if there is no such point.
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

/// The point of the line from a through b that OpenSim takes as nearest to the ring of radius R: a root of D′(u) with
/// D(u) = |x|² − 4 R ρ, x = a + u n, and ρ the distance of x from the axis. Newton's method on u starts from 0.
///
/// ERRATUM [OpenSim, `WrapTorus::calcCircleResids`]: the squared distance from the ring is |x|² − 2 R ρ + R². The
/// factor 4 is kept because models were made with it.
fn nearest_of_line(ring: f64, a: &Vector, b: &Vector) -> Vector {
    let n = unit(&minus(b, a));
    let (flat, mixed) = (n[0] * n[0] + n[1] * n[1], a[0] * n[0] + a[1] * n[1]);
    // Half of D′ and half of D″.
    let derivatives = |u: f64| {
        let rho = (flat * u * u + 2.0 * mixed * u + a[0] * a[0] + a[1] * a[1]).sqrt().max(f64::MIN_POSITIVE);
        let outward = flat * u + mixed;
        let slope = dot(a, &n) + u - 2.0 * ring * outward / rho;
        (slope, 1.0 - 2.0 * ring * (flat / rho - outward * outward / rho.powi(3)))
    };
    let mut u = 0.0;
    for _ in 0..MAX_ITERATIONS {
        let (slope, bend) = derivatives(u);
        let mut step = (-slope / bend).clamp(-MAX_STEP, MAX_STEP);
        while derivatives(u + step).0.abs() > slope.abs() && step.abs() > STEP_TOLERANCE {
            step *= 0.5;
        }
        if step.is_nan() || step.abs() <= STEP_TOLERANCE {
            break;
        }
        u += step;
    }
    along(a, u, &n)
}
