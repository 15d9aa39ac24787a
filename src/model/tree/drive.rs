//! What moves a link: a function of the joint coordinates, with its derivatives.

use crate::numerics::Scalar;
use crate::skeleton::Skeleton;
use crate::skeleton::function::Function;

/// `f(Σ weight · coordinate)`, f being the composition of `functions`, the innermost first.
#[derive(Clone, Debug)]
pub struct Drive {
    pub terms: Vec<(usize, f64)>,
    pub functions: Vec<Part>,
}

#[derive(Clone, Debug)]
pub enum Part {
    Function(Function),
    /// amplitude · sin(x + phase)
    Sine {
        amplitude: f64,
        phase: f64,
    },
}

/// A value and its first four derivatives.
pub type Taylor = [f64; 5];

impl Drive {
    /// By a coordinate itself.
    pub fn alone(coordinate: usize) -> Self {
        Self { terms: vec![(coordinate, 1.0)], functions: Vec::new() }
    }

    /// By a function of a coordinate, which may follow another one.
    pub fn by(skeleton: &Skeleton, coordinate: usize, function: &Function) -> Self {
        let follows = skeleton.coordinates[coordinate].follows.as_ref();
        let leader = follows.map_or(coordinate, |(leader, _)| *leader);
        let functions = follows.map(|(_, function)| function).into_iter().chain([function]);
        let functions = functions.filter(|f| !f.is_identity()).cloned().map(Part::Function).collect();
        Self { terms: vec![(leader, 1.0)], functions }
    }

    /// The inner argument u, of coordinates, speeds or accelerations alike.
    pub fn argument<T: Scalar>(&self, coordinates: &[T]) -> T {
        self.terms.iter().map(|&(c, weight)| coordinates[c] * weight).sum()
    }

    /// f, f′ and f″ at u.
    pub fn bent<T: Scalar>(&self, argument: T) -> [T; 3] {
        let [f0, f1, f2, f3, f4] = self.at(argument.re());
        // A real number has no infinitesimal part.
        let h = argument - argument.re();
        let from = |[a, b, c]: [f64; 3]| (h * (0.5 * c) + b) * h + a;
        [from([f0, f1, f2]), from([f1, f2, f3]), from([f2, f3, f4])]
    }

    /// f and its derivatives at u.
    pub fn at(&self, argument: f64) -> Taylor {
        let start = [argument, 1.0, 0.0, 0.0, 0.0];
        self.functions.iter().fold(start, |inner, part| composed(part.at(inner[0]), inner))
    }
}

impl Part {
    fn at(&self, x: f64) -> Taylor {
        match self {
            Self::Function(function) => function.derivatives(x),
            Self::Sine { amplitude, phase } => {
                let (sin, cos) = (x + phase).sin_cos();
                [sin, cos, -sin, -cos, sin].map(|y| amplitude * y)
            }
        }
    }
}

/// Derivatives of g(f(x)) (Faà di Bruno).
fn composed(g: Taylor, f: Taylor) -> Taylor {
    let [_, f1, f2, f3, f4] = f;
    let [g0, g1, g2, g3, g4] = g;
    [
        g0,
        g1 * f1,
        g2 * f1 * f1 + g1 * f2,
        g3 * f1.powi(3) + 3.0 * g2 * f1 * f2 + g1 * f3,
        g4 * f1.powi(4) + 6.0 * g3 * f1 * f1 * f2 + g2 * (3.0 * f2 * f2 + 4.0 * f1 * f3) + g1 * f4,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_of_compositions_are_those_of_differences() {
        let drive = Drive {
            terms: vec![(0, 1.0), (1, -1.0)],
            functions: vec![
                Part::Function(Function::Polynomial(vec![0.2, 0.7, -0.4, 0.3])),
                Part::Sine { amplitude: 1.3, phase: 0.4 },
            ],
        };
        assert!((drive.argument(&[0.9f64, 0.3]) - 0.6).abs() < 1e-15);
        let h = 1e-5;
        let (low, here, high) = (drive.at(0.6 - h), drive.at(0.6), drive.at(0.6 + h));
        for k in 0..4 {
            let difference = (high[k] - low[k]) / (2.0 * h);
            assert!((here[k + 1] - difference).abs() < 1e-8, "{k}: {} {difference}", here[k + 1]);
        }
    }
}
