//! Euler parameters p = (e_0, e), pᵀp = 1, and what a rigid body's inertia makes of them.
//!
//! ```text
//! A(p) s = (e_0² − e·e) s + 2 e (e·s) + 2 e_0 e × s        the rotation; quadratic in p
//! ω' = 2 L(p) ṗ,   L(p) = [ −e | e_0 I − ẽ ]               angular velocity in the body's axes
//! T = 2 ṗᵀ Lᵀ J L ṗ   ⇒   4 K(p,p) p̈ − 8 K(ṗ,ṗ) p = forces,   K(x, y) = L(x)ᵀ J L(y)
//! ```
//!
//! The second line of T is Lagrange's equation with L(ṗ)ṗ = 0 and L(x)y = −L(y)x. 4 K(p,p) has the null vector p: only with
//! the multiplier of pᵀp = 1 is p̈ determined. Source: P. E. Nikravesh, *Computer-Aided Analysis of Mechanical Systems*,
//! Prentice-Hall 1988, ch. 6 and 8 (the notation L, and G for the ground's axes).

use nalgebra::{Matrix3, Matrix3x4, Matrix4, Vector3, Vector4};

use super::jet::Jet;
use crate::numerics::Scalar;
use crate::skeleton::frame::dot;

fn cross<T: Scalar>(a: [T; 3], b: [f64; 3]) -> [T; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// A(p) s
pub fn rotate<T: Scalar>(p: &[T], s: [f64; 3]) -> [T; 3] {
    let e = [p[1], p[2], p[3]];
    let turned = cross(e, s);
    let along = e[0] * s[0] + e[1] * s[1] + e[2] * s[2];
    let keep = p[0] * p[0] - e[0] * e[0] - e[1] * e[1] - e[2] * e[2];
    [0, 1, 2].map(|i| keep * s[i] + e[i] * along * 2.0 + p[0] * turned[i] * 2.0)
}

/// ∂²(A(p) s)/∂p_i∂p_j: constant.
pub fn bend(i: usize, j: usize, s: [f64; 3]) -> [f64; 3] {
    let axis = |k: usize| [0, 1, 2].map(|i| f64::from(i + 1 == k));
    match (i, j) {
        (0, 0) => s.map(|s| 2.0 * s),
        (0, k) | (k, 0) => cross(axis(k), s).map(|x| 2.0 * x),
        (k, l) => {
            let same = f64::from(k == l);
            [0, 1, 2].map(|i| 2.0 * (axis(k)[i] * s[l - 1] + axis(l)[i] * s[k - 1] - same * s[i]))
        }
    }
}

/// The columns ∂(A(p) s)/∂p_k: linear in p.
pub fn slopes<T: Scalar>(p: &[T], s: [f64; 3]) -> [[T; 3]; 4] {
    [0, 1, 2, 3].map(|k| {
        let mut column = [T::from(0.0); 3];
        for (l, p) in p.iter().enumerate().take(4) {
            let bend = bend(k, l, s);
            (0..3).for_each(|i| column[i] += *p * bend[i]);
        }
        column
    })
}

/// A(p) s as jets, p in the slots from `at` on.
pub fn rotated<T: Scalar, const N: usize>(p: &[T], at: usize, s: [f64; 3]) -> [Jet<T, N>; 3] {
    let value = rotate(p, s);
    let mut out = [0, 1, 2].map(|i| Jet::constant(value[i]));
    for (k, column) in slopes(p, s).into_iter().enumerate() {
        for (i, jet) in out.iter_mut().enumerate() {
            jet.gradient[at + k] = column[i];
            for l in 0..4 {
                jet.hessian[at + k][at + l] = T::from(bend(k, l, s)[i]);
            }
        }
    }
    out
}

/// A(p) s / pᵀp: a rotation for any p.
pub fn turn(p: &[f64], s: [f64; 3]) -> [f64; 3] {
    let square: f64 = p.iter().map(|x| x * x).sum();
    rotate(p, s).map(|x| x / square)
}

/// The columns of [`turn`]'s derivative, `(∂A s/∂p_k − 2 p_k y)/pᵀp` with y the turned vector.
pub fn turn_slopes(p: &[f64], s: [f64; 3]) -> [[f64; 3]; 4] {
    let square: f64 = p.iter().map(|x| x * x).sum();
    let (y, columns) = (turn(p, s), slopes(p, s));
    [0, 1, 2, 3].map(|k| [0, 1, 2].map(|i| (columns[k][i] - 2.0 * p[k] * y[i]) / square))
}

/// `pull · ∂²y/∂p_k∂p_l` of [`turn`]'s y: `y_kl = (∂²A s/∂p_k∂p_l − 2 p_k y_l − 2 p_l y_k − 2 δ_kl y)/pᵀp`.
pub fn turn_bend(p: &[f64], s: [f64; 3], pull: [f64; 3]) -> [[f64; 4]; 4] {
    let square: f64 = p.iter().map(|x| x * x).sum();
    let along = |x: [f64; 3]| dot(&x, &pull);
    let (y, first) = (along(turn(p, s)), turn_slopes(p, s).map(along));
    let mut out = [[0.0; 4]; 4];
    for k in 0..4 {
        for l in 0..=k {
            let same = if k == l { 2.0 * y } else { 0.0 };
            out[k][l] = (along(bend(k, l, s)) - 2.0 * p[k] * first[l] - 2.0 * p[l] * first[k] - same) / square;
            out[l][k] = out[k][l];
        }
    }
    out
}

/// [`turn`] as jets, p in the slots from `at` on.
pub fn turned<const N: usize>(p: &[f64], at: usize, s: [f64; 3]) -> [Jet<f64, N>; 3] {
    let (value, slopes) = (turn(p, s), turn_slopes(p, s));
    [0, 1, 2].map(|i| {
        let mut jet = Jet::constant(value[i]);
        let bend = turn_bend(p, s, [0, 1, 2].map(|j| f64::from(u8::from(i == j))));
        for k in 0..4 {
            jet.gradient[at + k] = slopes[k][i];
            jet.hessian[at + k][at..at + 4].copy_from_slice(&bend[k]);
        }
        jet
    })
}

/// Euler parameters of a rotation matrix (rows), the sign with the largest entry positive.
pub fn of_axes<T: Scalar>(axes: &[[T; 3]; 3]) -> [T; 4] {
    let r = |i: usize, j: usize| axes[i][j];
    let trace = r(0, 0) + r(1, 1) + r(2, 2);
    // 4 e_i² of each; begin from the largest, which is far from 0.
    let squares = [trace, r(0, 0) * 2.0 - trace, r(1, 1) * 2.0 - trace, r(2, 2) * 2.0 - trace];
    let largest = (0..4).max_by(|&i, &j| squares[i].re().total_cmp(&squares[j].re())).expect("four parameters");
    let double = (squares[largest] + 1.0).sqrt();
    let share = |x: T| x / double * 0.5;
    let skew = [r(2, 1) - r(1, 2), r(0, 2) - r(2, 0), r(1, 0) - r(0, 1)];
    let sum = |i: usize, j: usize| r(i, j) + r(j, i);
    let half = double * 0.5;
    match largest {
        0 => [half, share(skew[0]), share(skew[1]), share(skew[2])],
        1 => [share(skew[0]), half, share(sum(0, 1)), share(sum(0, 2))],
        2 => [share(skew[1]), share(sum(0, 1)), half, share(sum(1, 2))],
        _ => [share(skew[2]), share(sum(0, 2)), share(sum(1, 2)), half],
    }
}

fn l(p: &Vector4<f64>) -> Matrix3x4<f64> {
    let [w, x, y, z] = [p[0], p[1], p[2], p[3]];
    Matrix3x4::new(-x, w, z, -y, -y, -z, w, x, -z, y, -x, w)
}

/// The matrix N(w) with L(d)ᵀ w = N(w) d.
fn n(w: &Vector3<f64>) -> Matrix4<f64> {
    let mut out = Matrix4::zeros();
    for k in 0..4 {
        let mut unit = Vector4::zeros();
        unit[k] = 1.0;
        out.set_column(k, &(l(&unit).transpose() * w));
    }
    out
}

/// The inertial force of one body's rotation and its derivatives, over p, ṗ and p̈.
pub struct Turning<'a> {
    /// About the centre of mass, in the body's axes, kg m².
    pub inertia: &'a Matrix3<f64>,
    pub p: Vector4<f64>,
    pub rate: Vector4<f64>,
    pub acceleration: Vector4<f64>,
}

/// Second derivatives of λᵀ(inertial force); the first index of a pair is the row.
pub struct TurningHessian {
    pub pp: Matrix4<f64>,
    pub rate_rate: Matrix4<f64>,
    pub rate_p: Matrix4<f64>,
    pub acceleration_p: Matrix4<f64>,
}

impl Turning<'_> {
    fn k(&self, x: &Vector4<f64>, y: &Vector4<f64>) -> Matrix4<f64> {
        l(x).transpose() * self.inertia * l(y)
    }

    /// 4 K(p,p) p̈ − 8 K(ṗ,ṗ) p
    pub fn force(&self) -> Vector4<f64> {
        self.k(&self.p, &self.p) * self.acceleration * 4.0 - self.k(&self.rate, &self.rate) * self.p * 8.0
    }

    /// Its derivatives by p, ṗ, p̈.
    pub fn slopes(&self) -> [Matrix4<f64>; 3] {
        let Self { inertia, p, rate, acceleration } = self;
        let by_p = (n(&(*inertia * l(p) * acceleration)) - self.k(p, acceleration)) * 4.0 - self.k(rate, rate) * 8.0;
        let by_rate = (self.k(rate, p) - n(&(*inertia * l(rate) * p))) * 8.0;
        [by_p, by_rate, self.k(p, p) * 4.0]
    }

    pub fn hessian(&self, lambda: &Vector4<f64>) -> TurningHessian {
        let Self { inertia, p, rate, acceleration } = self;
        let twice = |k: Matrix4<f64>| k + k.transpose();
        TurningHessian {
            pp: twice(self.k(lambda, acceleration)) * 4.0,
            rate_rate: twice(self.k(lambda, p)) * -8.0,
            rate_p: (n(&(*inertia * l(lambda) * rate)) - self.k(lambda, rate)) * -8.0,
            acceleration_p: (n(&(*inertia * l(p) * lambda)) - self.k(p, lambda)) * 4.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::skeleton::frame::Frame;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn euler_parameters_and_rotation_matrices_are_one_another() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(11);
        for _ in 0..200 {
            let axis = [0; 3].map(|_| rng.random_range(-1.0..1.0));
            let frame = Frame::rotation(axis, rng.random_range(-3.1..3.1));
            let p = of_axes(&frame.axes);
            assert!((p.iter().map(|x| x * x).sum::<f64>() - 1.0).abs() < 1e-14);
            let s = [0; 3].map(|_| rng.random_range(-1.0..1.0));
            let (a, b) = (rotate(&p, s), frame.point(&s));
            assert!((0..3).all(|i| (a[i] - b[i]).abs() < 1e-13));
            let columns = slopes(&p, s);
            for (k, column) in columns.iter().enumerate() {
                let shifted = |e: f64| {
                    let mut q = p;
                    q[k] += e;
                    rotate(&q, s)
                };
                let (up, down) = (shifted(1e-6), shifted(-1e-6));
                assert!((0..3).all(|i| ((up[i] - down[i]) / 2e-6 - column[i]).abs() < 1e-8));
            }
        }
    }

    #[test]
    fn inertial_forces_have_their_derivatives() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(12);
        let inertia = Matrix3::new(0.3, 0.02, -0.01, 0.02, 0.5, 0.03, -0.01, 0.03, 0.4);
        let mut random = || Vector4::from_fn(|_, _| rng.random_range(-1.0..1.0));
        let lambda = random();
        let at = [random(), random(), random()];
        let turning = |x: &[Vector4<f64>; 3]| Turning { inertia: &inertia, p: x[0], rate: x[1], acceleration: x[2] };
        let slopes = turning(&at).slopes();
        let hessian = turning(&at).hessian(&lambda);
        let zero = Matrix4::zeros();
        let exact = [
            [hessian.pp, hessian.rate_p.transpose(), hessian.acceleration_p.transpose()],
            [hessian.rate_p, hessian.rate_rate, zero],
            [hessian.acceleration_p, zero, zero],
        ];
        for kind in 0..3 {
            for k in 0..4 {
                let shifted = |e: f64| {
                    let mut y = at;
                    y[kind][k] += e;
                    y
                };
                let (up, down) = (shifted(1e-6), shifted(-1e-6));
                let slope = (turning(&up).force() - turning(&down).force()) / 2e-6;
                assert!((slope - slopes[kind].column(k)).amax() < 1e-8);
                for other in 0..3 {
                    let gradient = |x: &[Vector4<f64>; 3]| turning(x).slopes()[other].transpose() * lambda;
                    let bend = (gradient(&up) - gradient(&down)) / 2e-6;
                    assert!((bend - exact[other][kind].column(k)).amax() < 1e-8, "{other} {kind}");
                }
            }
        }
    }
}
