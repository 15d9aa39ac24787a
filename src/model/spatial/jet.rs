//! A number with its first and second derivatives over N slots.

#[derive(Clone, Copy, Debug)]
pub struct Jet<const N: usize> {
    pub value: f64,
    pub gradient: [f64; N],
    pub hessian: [[f64; N]; N],
}

impl<const N: usize> Jet<N> {
    pub fn constant(value: f64) -> Self {
        Self { value, gradient: [0.0; N], hessian: [[0.0; N]; N] }
    }

    /// Adds f(x), from the value, the gradient and the Hessian of f and the slopes of x: all but the part of second
    /// derivatives of x.
    pub fn add_function<const M: usize>(
        &mut self,
        value: f64,
        gradient: &[f64; M],
        hessian: &[[f64; M]; M],
        slopes: &[[f64; N]; M],
    ) {
        self.value += value;
        for i in 0..M {
            // Row i of H J, then its outer product with row i of J.
            let mut row = [0.0; N];
            for j in 0..M {
                for b in 0..N {
                    row[b] += hessian[i][j] * slopes[j][b];
                }
            }
            for a in 0..N {
                self.gradient[a] += gradient[i] * slopes[i][a];
                for b in 0..N {
                    self.hessian[a][b] += slopes[i][a] * row[b];
                }
            }
        }
    }

    /// Adds x yᵀ + y xᵀ to the Hessian.
    pub fn add_product(&mut self, x: &[f64; N], y: &[f64; N]) {
        for a in 0..N {
            for b in 0..N {
                self.hessian[a][b] += x[a] * y[b] + y[a] * x[b];
            }
        }
    }
}
