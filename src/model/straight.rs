//! Straight lines in the plane from the origin over via points to the insertion, and the length of any path.

use super::body::Place;
use crate::numerics::Scalar;

/// A path over two or more points of the plane.
#[derive(Clone, Debug)]
pub struct StraightPath {
    pub points: Vec<Place>,
    /// The body coordinates that the length depends on, increasing: three for each moving body.
    pub slots: Vec<usize>,
}

/// Length of a path with its derivatives over the path's slots: `gradient` has `slots` entries,
/// `hessian` is `slots × slots`, row by row.
#[derive(Clone, Debug)]
pub struct PathLength<T> {
    /// L_mt, m
    pub value: T,
    pub gradient: Vec<T>,
    pub hessian: Vec<T>,
}

impl StraightPath {
    pub fn new(points: Vec<Place>) -> Self {
        let mut bodies: Vec<usize> = points.iter().filter_map(Place::body).collect();
        bodies.sort_unstable();
        bodies.dedup();
        let slots = bodies.iter().flat_map(|body| [3 * body, 3 * body + 1, 3 * body + 2]).collect();
        Self { points, slots }
    }

    fn slot_of(&self, body: usize) -> usize {
        self.slots.partition_point(|&slot| slot < 3 * body)
    }

    /// Writes the length at `q` with first and, if asked, second derivatives.
    ///
    /// For one segment `ℓ = |d|`, `d = P₂ − P₁`, `n = d/ℓ`: `∂ℓ = n·∂d`, `∂²ℓ = (∂d·∂d − (n·∂d)(n·∂d))/ℓ + n·∂²d`.
    pub fn length<T: Scalar>(&self, q: &[T], second: bool, out: &mut PathLength<T>) {
        let (zero, one, size) = (T::from(0.0), T::from(1.0), self.slots.len());
        out.value = zero;
        out.gradient.fill(zero);
        out.hessian.fill(zero);
        for pair in self.points.windows(2) {
            if pair[0].body() == pair[1].body() && pair[0].body().is_some() {
                // Two points on one body: a constant length.
                let (a, b) = (pair[0].at(q).position, pair[1].at(q).position);
                out.value += ((b[0] - a[0]).powi(2) + (b[1] - a[1]).powi(2)).sqrt();
                continue;
            }
            let ends = [pair[0].at(q), pair[1].at(q)];
            let d = [ends[1].position[0] - ends[0].position[0], ends[1].position[1] - ends[0].position[1]];
            let length = (d[0] * d[0] + d[1] * d[1]).sqrt();
            let n = [d[0] / length, d[1] / length];
            out.value += length;
            // ∂d over (x, y, φ) of either end: −/+ (1, 0), (0, 1), P'.
            let mut place = [None; 6];
            let mut derivative = [[zero; 2]; 6];
            for end in 0..2 {
                let Some(body) = pair[end].body() else { continue };
                let sign = if end == 0 { -one } else { one };
                let first = ends[end].first;
                let columns = [[sign, zero], [zero, sign], [sign * first[0], sign * first[1]]];
                for (axis, column) in columns.into_iter().enumerate() {
                    place[3 * end + axis] = Some(self.slot_of(body) + axis);
                    derivative[3 * end + axis] = column;
                }
            }
            let along: [T; 6] = std::array::from_fn(|i| n[0] * derivative[i][0] + n[1] * derivative[i][1]);
            for i in 0..6 {
                let Some(row) = place[i] else { continue };
                out.gradient[row] += along[i];
                if !second {
                    continue;
                }
                for j in 0..6 {
                    let Some(column) = place[j] else { continue };
                    let dot = derivative[i][0] * derivative[j][0] + derivative[i][1] * derivative[j][1];
                    out.hessian[row * size + column] += (dot - along[i] * along[j]) / length;
                }
            }
            if second {
                for end in 0..2 {
                    if let Some(slot) = place[3 * end + 2] {
                        let sign = if end == 0 { -one } else { one };
                        let bend = ends[end].second;
                        out.hessian[slot * size + slot] += sign * (n[0] * bend[0] + n[1] * bend[1]);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use num_dual::Dual64;

    use super::*;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn gradient_and_hessian_agree_with_dual_numbers() {
        let path = StraightPath::new(vec![
            Place::Ground([0.02, 0.03]),
            Place::Body(2, [0.1, 0.02]),
            Place::Body(2, [0.0, 0.05]),
            Place::Body(0, [-0.2, 0.1]),
        ]);
        fn buffer<T: Scalar>() -> PathLength<T> {
            PathLength { value: T::from(0.0), gradient: vec![T::from(0.0); 6], hessian: vec![T::from(0.0); 36] }
        }
        assert_eq!(path.slots, [0, 1, 2, 6, 7, 8]);
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(2);
        for _ in 0..20 {
            let q: Vec<f64> = (0..9).map(|_| rng.random_range(-1.0..1.0)).collect();
            let mut exact = buffer();
            path.length(&q, true, &mut exact);
            for (i, &slot) in path.slots.iter().enumerate() {
                let mut dual: Vec<Dual64> = q.iter().map(|&x| Dual64::from(x)).collect();
                dual[slot] = dual[slot].derivative();
                let mut length = buffer();
                path.length(&dual, true, &mut length);
                assert!((length.value.eps - exact.gradient[i]).abs() < 1e-12);
                for j in 0..path.slots.len() {
                    assert!((length.gradient[j].eps - exact.hessian[i * 6 + j]).abs() < 1e-10);
                }
            }
        }
    }
}
