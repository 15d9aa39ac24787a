//! Polynomials of several joint coordinates, to which lengths of muscle paths are fitted beforehand.
//!
//! Source of the form: `MultivariatePolynomialFunction` of OpenSim 4.5, as in its FunctionBasedPath.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::error::{Issue, nearest};
use crate::numerics::Scalar;

/// The largest number of coordinates, as in OpenSim.
const MAX_COORDINATES: usize = 6;
/// The largest order.
const MAX_ORDER: usize = 20;

/// The length of a muscle as a polynomial of coordinates.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LengthEntry {
    /// The coordinates, at most six.
    pub coordinates: Vec<String>,
    /// The largest sum of the exponents in a term.
    pub order: usize,
    /// A coefficient for each term, m, in ascending powers, those of the last coordinate changing first.
    pub coefficients: Vec<f64>,
}

/// A checked polynomial.
#[derive(Clone, Debug)]
pub struct Polynomial {
    /// Indices of its coordinates.
    pub coordinates: Vec<usize>,
    terms: Vec<Term>,
}

#[derive(Clone, Copy, Debug)]
struct Term {
    exponents: [usize; MAX_COORDINATES],
    /// m
    coefficient: f64,
}

impl LengthEntry {
    /// Checks the polynomial of a model with `known` coordinates; `place` is its path in the model file.
    ///
    /// # Errors
    /// If a coordinate is unknown or named twice, or the number of coefficients is not that of the terms.
    pub fn check(&self, known: &[&str], place: &[&str]) -> Result<Polynomial, Issue> {
        let n = self.coordinates.len();
        if !(1..=MAX_COORDINATES).contains(&n) {
            return Err(Issue::new(place, format!("{n} coordinates"), "give 1 to 6 coordinates"));
        }
        if self.order > MAX_ORDER {
            return Err(Issue::new(place, format!("the order is {}", self.order), "orders up to 20 are supported"));
        }
        let mut coordinates = Vec::new();
        for name in &self.coordinates {
            let Some(index) = known.iter().position(|own| own == name) else {
                let near =
                    nearest(name, known.iter().copied()).map(|n| format!("did you mean `{n}`? ")).unwrap_or_default();
                let help = format!("{near}give coordinates of the model");
                return Err(Issue::new(place, format!("there is no coordinate `{name}`"), help));
            };
            if coordinates.contains(&index) {
                return Err(Issue::new(place, format!("`{name}` is named twice"), "name each coordinate once"));
            }
            coordinates.push(index);
        }
        let all = exponents(n, self.order);
        if all.len() != self.coefficients.len() || !self.coefficients.iter().all(|c| c.is_finite()) {
            let message = format!("found {} coefficients, or one that is not finite", self.coefficients.len());
            let help = format!("a polynomial of order {} in {n} coordinates has {} terms", self.order, all.len());
            return Err(Issue::new(place, message, help));
        }
        let terms = all.into_iter().zip(&self.coefficients).filter(|(_, coefficient)| **coefficient != 0.0);
        let terms = terms.map(|(exponents, &coefficient)| Term { exponents, coefficient }).collect();
        Ok(Polynomial { coordinates, terms })
    }
}

/// The exponents of all terms of `n` coordinates whose sum is at most `order`, the last changing first.
fn exponents(n: usize, order: usize) -> Vec<[usize; MAX_COORDINATES]> {
    let mut all = vec![[0; MAX_COORDINATES]];
    for i in 0..n {
        let longer = |before: &[usize; MAX_COORDINATES]| {
            let (before, left) = (*before, order - before.iter().sum::<usize>());
            (0..=left).map(move |exponent| {
                let mut exponents = before;
                exponents[i] = exponent;
                exponents
            })
        };
        all = all.iter().flat_map(longer).collect();
    }
    all
}

/// A polynomial with its first and second derivatives by its own coordinates, m.
pub struct Bent<T> {
    pub value: T,
    pub slopes: [T; MAX_COORDINATES],
    pub bends: [[T; MAX_COORDINATES]; MAX_COORDINATES],
}

impl Polynomial {
    /// The length (m) at values of all coordinates of the model.
    pub fn of<T: Scalar>(&self, coordinates: &[T]) -> T {
        let x: Vec<T> = self.coordinates.iter().map(|&c| coordinates[c]).collect();
        self.at(&x).value
    }

    /// Value and derivatives at values `x` of its coordinates.
    pub fn at<T: Scalar>(&self, x: &[T]) -> Bent<T> {
        let zero = T::zero();
        let mut out = Bent { value: zero, slopes: [zero; MAX_COORDINATES], bends: [[zero; MAX_COORDINATES]; 6] };
        let n = x.len();
        for Term { exponents, coefficient } in &self.terms {
            // The product of all powers, with the derivative taken as often as `taken` says.
            let product = |taken: [usize; MAX_COORDINATES]| {
                (0..n).fold(T::from(*coefficient), |product, i| {
                    let (e, times) = (exponents[i], taken[i]);
                    if times > e {
                        return zero;
                    }
                    let factor: usize = (e - times + 1..=e).product();
                    product * x[i].powi((e - times) as i32) * factor as f64
                })
            };
            out.value += product([0; MAX_COORDINATES]);
            for i in (0..n).filter(|&i| exponents[i] > 0) {
                let mut taken = [0; MAX_COORDINATES];
                taken[i] += 1;
                out.slopes[i] += product(taken);
                for j in (0..n).filter(|&j| exponents[j] > 0) {
                    let mut taken = taken;
                    taken[j] += 1;
                    out.bends[i][j] += product(taken);
                }
            }
        }
        out
    }
}
