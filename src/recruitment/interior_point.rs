//! Σ w e^p with p ≥ 2 by a primal-dual interior-point method.
//!
//! With slacks s = x − lower and t = upper − x, and φ″ + z/s + …, in short Θ, each step solves
//!
//! ```text
//! (A Θ⁻¹ Aᵀ) dy = b − A x − A Θ⁻¹ g,     dx = Θ⁻¹ (g + Aᵀ dy)
//! ```
//!
//! a dense system with a row for each coordinate, however many muscles there are. Afterwards the variables at bounds are put
//! exactly there, and Newton's method finds the others.
//!
//! Source: S. Mehrotra, *SIAM J. Optim.* 2, 1992 (predictor and corrector).

use super::cholesky::Cholesky;
use super::{Failure, Optimum, Programme, Term};

/// Residuals relative to the data at which the iteration ends.
const TOLERANCE: f64 = 1e-11;
/// Good enough where rounding allows no more.
const ACCEPTABLE: f64 = 1e-8;
const MAX_ITERATIONS: usize = 80;
/// Share of the way to the bounds that a step takes.
const TO_BOUNDS: f64 = 0.995;
/// The gap is not lowered while it is below this share of the other residuals.
const AHEAD: f64 = 1e-3;
/// Newton steps after the bounds are known.
const POLISHING_STEPS: usize = 12;
/// How far from its bounds a variable starts at least, as a share of their distance.
const INSIDE: f64 = 0.05;
/// The size of slopes is that at an effort not below this.
const LEAST_EFFORT: f64 = 1e-3;
/// Least curvature, relative to the weight: a power above 2 has none where the effort is 0.
const LEAST_CURVATURE: f64 = 1e-13;

/// A linear term, and a factor on the criterion, beside it: `factor Σ φ + tiltᵀ x`.
#[derive(Clone, Copy)]
pub struct Tilt {
    pub variable: usize,
    pub slope: f64,
    pub factor: f64,
}

/// The programme with rows and weights of the size of 1.
struct Scaled<'p> {
    programme: &'p Programme,
    power: f64,
    tilt: Option<Tilt>,
    /// Factor on each row.
    rows: Vec<f64>,
    /// Factor on the criterion.
    objective: f64,
    right: Vec<f64>,
}

/// x, y and z.
#[derive(Clone)]
struct Point {
    x: Vec<f64>,
    y: Vec<f64>,
    lower: Vec<f64>,
    upper: Vec<f64>,
}

/// Derivatives of the criterion, and what is left of the optimality conditions.
struct Residual {
    curvature: Vec<f64>,
    /// ∇f − Aᵀ y − z_lower + z_upper
    dual: Vec<f64>,
    /// A x − b
    primal: Vec<f64>,
    /// Mean product of slacks and multipliers.
    gap: f64,
    /// Largest of ∇L and A x − b relative to their scales, and of all.
    open: f64,
    size: f64,
}

/// The optimum of Σ w e^p, tilted if asked.
///
/// # Errors
/// If the iteration does not converge, as it cannot where no x carries the load.
pub fn minimise(programme: &Programme, power: f64, tilt: Option<Tilt>) -> Result<Optimum, Failure> {
    if power == 2.0 {
        return minimise_near(programme, power, tilt, None);
    }
    // The largest effort, on which the size of slopes of a higher power depends, is about that of squares.
    let squares = minimise_near(programme, 2.0, None, None)?;
    minimise_near(programme, power, tilt, Some(&squares))
}

/// The same from a point nearby.
///
/// # Errors
/// As for [`minimise`].
pub fn minimise_near(
    programme: &Programme,
    power: f64,
    tilt: Option<Tilt>,
    near: Option<&Optimum>,
) -> Result<Optimum, Failure> {
    let scaled = Scaled::new(programme, power, tilt, near);
    let mut point = scaled.start(near);
    let mut residual = scaled.residual(&point);
    let mut iterations = 0;
    while residual.size > TOLERANCE {
        iterations += 1;
        let step = scaled.step(&point, &residual);
        let mut share = TO_BOUNDS.max(1.0 - residual.gap) * scaled.room(&point, &step);
        let next = loop {
            let next = moved(&point, &step, share);
            let there = scaled.residual(&next);
            // The criterion's curvature changes on the way.
            if there.size < 2.0 * residual.size.max(1e-3) || share < 1e-3 {
                break (next, there);
            }
            share *= 0.5;
        };
        if !next.1.size.is_finite() || iterations > MAX_ITERATIONS {
            if residual.size <= ACCEPTABLE {
                break;
            }
            return Err(Failure::Numerical);
        }
        (point, residual) = next;
    }
    let polished = scaled.polished(&point).filter(|(_, size)| *size <= residual.size);
    Ok(scaled.optimum(polished.map_or(point, |(point, _)| point), iterations))
}

impl<'p> Scaled<'p> {
    fn new(programme: &'p Programme, power: f64, tilt: Option<Tilt>, near: Option<&Optimum>) -> Self {
        let mut rows = vec![0.0f64; programme.rows];
        for &(row, value) in programme.columns.iter().flatten() {
            rows[row] = rows[row].max(value.abs());
        }
        rows.iter_mut().for_each(|row| *row = if *row > 0.0 { 1.0 / *row } else { 1.0 });
        let factor = tilt.map_or(1.0, |tilt| tilt.factor);
        let effort = near.map_or(1.0, |near| programme.largest_effort(&near.x)).clamp(LEAST_EFFORT, 1.0);
        let muscles = programme.terms.iter().filter(|term| term.is_muscle);
        let largest = muscles.fold(0.0f64, |a, term| a.max(term.weight)) * factor * effort.powf(power - 1.0);
        let largest = largest.max(tilt.map_or(0.0, |tilt| tilt.slope.abs()));
        let objective = if largest > 0.0 { 1.0 / largest } else { 1.0 };
        let right = programme.right.iter().zip(&rows).map(|(b, row)| b * row).collect();
        Self { programme, power, tilt, rows, objective, right }
    }

    fn terms(&self) -> &[Term] {
        &self.programme.terms
    }

    /// φ′ and φ″.
    fn slopes(&self, i: usize, x: f64) -> [f64; 2] {
        let term = &self.terms()[i];
        let power = if term.is_muscle { self.power } else { 2.0 };
        let (e, s) = (term.effort(x), term.scale);
        let weight = term.weight * self.objective * self.tilt.map_or(1.0, |tilt| tilt.factor);
        let [first, second] = match power {
            2.0 => [2.0 * e, 2.0],
            p => [p * e.abs().powf(p - 1.0) * e.signum(), p * (p - 1.0) * e.abs().powf(p - 2.0)],
        };
        let tilted = self.tilt.filter(|tilt| tilt.variable == i).map_or(0.0, |tilt| tilt.slope * self.objective);
        [weight * s * first + tilted, (weight * s * s * second).max(LEAST_CURVATURE)]
    }

    fn start(&self, near: Option<&Optimum>) -> Point {
        let inside = |(i, term): (usize, &Term)| match (term.bounds, near) {
            ([low, high], Some(near)) if low.is_finite() && high.is_finite() => {
                let room = INSIDE * (high - low);
                near.x[i].clamp(low + room, high - room)
            }
            ([low, high], None) if low.is_finite() && high.is_finite() => 0.5 * (low + high),
            ([low, _], _) if low.is_finite() => low + 1.0,
            ([_, high], _) if high.is_finite() => high - 1.0,
            (_, near) => near.map_or(0.0, |near| near.x[i]),
        };
        let of = |bound: usize| {
            let has = |term: &Term| f64::from(u8::from(term.bounds[bound].is_finite()));
            self.terms().iter().map(has).collect::<Vec<f64>>()
        };
        let x = self.terms().iter().enumerate().map(inside).collect();
        Point { x, y: vec![0.0; self.rows.len()], lower: of(0), upper: of(1) }
    }

    /// Aᵀ y of a column.
    fn pull(&self, i: usize, y: &[f64]) -> f64 {
        self.programme.columns[i].iter().map(|&(row, value)| value * self.rows[row] * y[row]).sum()
    }

    fn slacks(&self, x: &[f64]) -> impl Iterator<Item = [f64; 2]> {
        self.terms().iter().zip(x).map(|(term, x)| [x - term.bounds[0], term.bounds[1] - x])
    }

    fn residual(&self, point: &Point) -> Residual {
        let n = point.x.len();
        let (mut curvature, mut dual) = (Vec::with_capacity(n), Vec::with_capacity(n));
        let mut scale = 1.0f64;
        for i in 0..n {
            let [first, second] = self.slopes(i, point.x[i]);
            curvature.push(second);
            dual.push(first - self.pull(i, &point.y) - point.lower[i] + point.upper[i]);
            scale = scale.max(first.abs());
        }
        let mut primal: Vec<f64> = self.right.iter().map(|b| -b).collect();
        for (column, x) in self.programme.columns.iter().zip(&point.x) {
            column.iter().for_each(|&(row, value)| primal[row] += value * self.rows[row] * x);
        }
        let products = self.products(point);
        let gap = products.iter().sum::<f64>() / products.len().max(1) as f64;
        let largest =
            |values: &[f64]| values.iter().fold(0.0f64, |a, v| if v.is_nan() { f64::NAN } else { a.max(v.abs()) });
        let load = 1.0 + largest(&self.right);
        let open = (largest(&dual) / scale).max(largest(&primal) / load);
        let size = open.max(largest(&products));
        let all_finite = dual.iter().chain(&primal).chain(&products).all(|v| v.is_finite());
        Residual { curvature, dual, primal, gap, open, size: if all_finite { size } else { f64::NAN } }
    }

    /// Slacks times multipliers.
    fn products(&self, point: &Point) -> Vec<f64> {
        let mut products = Vec::new();
        for ((i, slack), term) in self.slacks(&point.x).enumerate().zip(self.terms()) {
            for (bound, z) in [point.lower[i], point.upper[i]].into_iter().enumerate() {
                if term.bounds[bound].is_finite() {
                    products.push(slack[bound] * z);
                }
            }
        }
        products
    }

    /// Predictor and corrector.
    fn step(&self, point: &Point, residual: &Residual) -> Point {
        let n = point.x.len();
        let slacks: Vec<[f64; 2]> = self.slacks(&point.x).collect();
        let theta: Vec<f64> = (0..n)
            .map(|i| residual.curvature[i] + point.lower[i] / slacks[i][0] + point.upper[i] / slacks[i][1])
            .collect();
        let factors = self.normal_matrix(&theta);
        let zero = vec![[0.0; 2]; n];
        let predictor = self.direction(point, residual, &slacks, &theta, &factors, 0.0, &zero);
        let room = self.room(point, &predictor);
        let there = self.products(&moved(point, &predictor, room));
        let after = there.iter().sum::<f64>() / there.len().max(1) as f64;
        let centring = if residual.gap > 0.0 { (after / residual.gap).clamp(0.0, 1.0).powi(3) } else { 0.0 };
        // Slopes that bend need a gap that does not run ahead of them.
        let centring = if residual.gap < AHEAD * residual.open { 1.0 } else { centring };
        let product = |i: usize| [predictor.x[i] * predictor.lower[i], -predictor.x[i] * predictor.upper[i]];
        let corrections: Vec<[f64; 2]> = (0..n).map(product).collect();
        self.direction(point, residual, &slacks, &theta, &factors, centring * residual.gap, &corrections)
    }

    /// A Θ⁻¹ Aᵀ
    fn normal_matrix(&self, theta: &[f64]) -> Cholesky {
        let m = self.rows.len();
        let mut matrix = vec![0.0; m * m];
        for (column, theta) in self.programme.columns.iter().zip(theta) {
            for (k, &(row, value)) in column.iter().enumerate() {
                let left = value * self.rows[row] / theta;
                for &(other, value) in &column[..=k] {
                    let (i, j) = (row.max(other), row.min(other));
                    matrix[i * m + j] += left * value * self.rows[other];
                }
            }
        }
        Cholesky::new(m, matrix)
    }

    /// The Newton direction towards slack · z = target − correction.
    #[expect(clippy::too_many_arguments, reason = "the parts of one linear system")]
    fn direction(
        &self,
        point: &Point,
        residual: &Residual,
        slacks: &[[f64; 2]],
        theta: &[f64],
        factors: &Cholesky,
        target: f64,
        corrections: &[[f64; 2]],
    ) -> Point {
        let n = point.x.len();
        // What z would be, of an unmoved x.
        let wanted = |i: usize, bound: usize, z: f64| {
            let is_bounded = self.terms()[i].bounds[bound].is_finite();
            if is_bounded { (target - corrections[i][bound]) / slacks[i][bound] - z } else { 0.0 }
        };
        let pushes: Vec<[f64; 2]> =
            (0..n).map(|i| [wanted(i, 0, point.lower[i]), wanted(i, 1, point.upper[i])]).collect();
        let g: Vec<f64> = (0..n).map(|i| -residual.dual[i] + pushes[i][0] - pushes[i][1]).collect();
        let mut y: Vec<f64> = residual.primal.iter().map(|r| -r).collect();
        for (i, column) in self.programme.columns.iter().enumerate() {
            column.iter().for_each(|&(row, value)| y[row] -= value * self.rows[row] * g[i] / theta[i]);
        }
        factors.solve(&mut y);
        let x: Vec<f64> = (0..n).map(|i| (g[i] + self.pull(i, &y)) / theta[i]).collect();
        let lower = (0..n).map(|i| pushes[i][0] - point.lower[i] / slacks[i][0] * x[i]).collect();
        let upper = (0..n).map(|i| pushes[i][1] + point.upper[i] / slacks[i][1] * x[i]).collect();
        Point { x, y, lower, upper }
    }

    /// The longest step, at most 1, that leaves slacks and multipliers at or above 0.
    fn room(&self, point: &Point, step: &Point) -> f64 {
        let mut room = 1.0f64;
        let mut keep = |value: f64, change: f64| {
            if change < 0.0 {
                room = room.min(-value / change);
            }
        };
        for (i, slack) in self.slacks(&point.x).enumerate() {
            for (bound, sign) in [(0, 1.0), (1, -1.0)] {
                if self.terms()[i].bounds[bound].is_finite() {
                    keep(slack[bound], sign * step.x[i]);
                }
            }
            keep(point.lower[i], step.lower[i]);
            keep(point.upper[i], step.upper[i]);
        }
        room
    }

    /// The optimum with the variables at bounds exactly there, and its residual; `None` if the bounds are not clear.
    fn polished(&self, point: &Point) -> Option<(Point, f64)> {
        let n = point.x.len();
        let mut polished = point.clone();
        let mut is_free = vec![true; n];
        for (i, slack) in self.slacks(&point.x).enumerate() {
            for (bound, z) in [(0, point.lower[i]), (1, point.upper[i])] {
                if self.terms()[i].bounds[bound].is_finite() && z > slack[bound] {
                    (polished.x[i], is_free[i]) = (self.terms()[i].bounds[bound], false);
                }
            }
            if is_free[i] {
                (polished.lower[i], polished.upper[i]) = (0.0, 0.0);
            }
        }
        for _ in 0..POLISHING_STEPS {
            self.settle_bounds(&mut polished, &is_free);
            let residual = self.residual(&polished);
            let theta: Vec<f64> =
                (0..n).map(|i| if is_free[i] { residual.curvature[i] } else { f64::INFINITY }).collect();
            let factors = self.normal_matrix(&theta);
            let mut y: Vec<f64> = residual.primal.iter().map(|r| -r).collect();
            for (i, column) in self.programme.columns.iter().enumerate() {
                column.iter().for_each(|&(row, value)| y[row] += value * self.rows[row] * residual.dual[i] / theta[i]);
            }
            factors.solve(&mut y);
            for i in (0..n).filter(|&i| is_free[i]) {
                polished.x[i] += (self.pull(i, &y) - residual.dual[i]) / theta[i];
            }
            polished.y.iter_mut().zip(&y).for_each(|(y, dy)| *y += dy);
        }
        self.settle_bounds(&mut polished, &is_free);
        let inside = self.slacks(&polished.x).all(|slack| slack[0] >= 0.0 && slack[1] >= 0.0);
        let signs = polished.lower.iter().chain(&polished.upper).all(|z| *z >= 0.0);
        let residual = self.residual(&polished).size;
        (inside && signs && residual.is_finite()).then_some((polished, residual))
    }

    /// The multipliers of variables at bounds that leave nothing of the dual residual.
    fn settle_bounds(&self, point: &mut Point, is_free: &[bool]) {
        for i in (0..point.x.len()).filter(|&i| !is_free[i]) {
            let [first, _] = self.slopes(i, point.x[i]);
            let left = first - self.pull(i, &point.y);
            let at_lower = point.x[i] == self.terms()[i].bounds[0];
            (point.lower[i], point.upper[i]) = if at_lower { (left, 0.0) } else { (0.0, -left) };
        }
    }

    fn optimum(&self, point: Point, iterations: usize) -> Optimum {
        let unit = 1.0 / self.objective;
        let of = |values: Vec<f64>| values.into_iter().map(|z| unit * z).collect::<Vec<f64>>();
        let value = self.terms().iter().zip(&point.x).map(|(term, &x)| {
            let power = if term.is_muscle { self.power } else { 2.0 };
            term.weight * term.effort(x).abs().powf(power)
        });
        Optimum {
            value: value.sum(),
            multipliers: point.y.iter().zip(&self.rows).map(|(y, row)| unit * y * row).collect(),
            lower: of(point.lower),
            upper: of(point.upper),
            x: point.x,
            iterations,
            stages: 0,
            is_unique: true,
        }
    }
}

fn moved(point: &Point, step: &Point, share: f64) -> Point {
    let along = |a: &[f64], d: &[f64]| a.iter().zip(d).map(|(a, d)| a + share * d).collect();
    Point {
        x: along(&point.x, &step.x),
        y: along(&point.y, &step.y),
        lower: along(&point.lower, &step.lower),
        upper: along(&point.upper, &step.upper),
    }
}
