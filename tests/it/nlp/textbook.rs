//! Small problems with known answers, most of them from W. Hock and K. Schittkowski, *Test Examples for Nonlinear
//! Programming Codes*, Springer 1981 (HS and its number); derivatives by hyper-dual numbers.
//!
//! The solver's objective is a sum of squares of linear functions and a convex term. Other objectives become
//! constraints: `f = Σ F_i(x)²` is `Σ r_i²` with `r_i = F_i(x)`, any other is t with `t = f(x)`.

use nalgebra::{DMatrix, SymmetricEigen};
use num_dual::{DualNum, HyperDual64};
use sinew::internals::nlp::problem::{ConvexTerm, Curvature, Multipliers, Problem};
use sinew::internals::numerics::sparse::Sparse;

pub type N = HyperDual64;
pub type Function = fn(&[N]) -> N;

/// What is minimised.
pub enum Objective {
    Squares(Vec<Function>),
    Value(Function),
}
use Objective::{Squares, Value};

/// A problem and what is known of its answer.
pub struct Textbook {
    pub name: &'static str,
    objective: Objective,
    equalities: Vec<Function>,
    inequalities: Vec<Function>,
    pub start: Vec<f64>,
    /// Objective at the solution; several where there are several local ones.
    pub answers: Vec<f64>,
    /// There are no multipliers, or unbounded ones: a solve need not converge, but it ends near the answer.
    pub is_degenerate: bool,
    residual_jacobian: Sparse,
    residual_data: Vec<f64>,
    term: Option<Last>,
    patterns: [Sparse; 3],
    stages: [Vec<usize>; 3],
}

/// The convex term t, the last variable.
struct Last(Sparse);

impl ConvexTerm for Last {
    fn functions(&self) -> &Sparse {
        &self.0
    }
    fn part(&self, _: usize, y: f64) -> [f64; 3] {
        [y, 1.0, 0.0]
    }
}

impl Textbook {
    pub fn new(
        name: &'static str,
        objective: Objective,
        equalities: Vec<Function>,
        inequalities: Vec<Function>,
        start: &[f64],
        answers: &[f64],
    ) -> Self {
        let squares = match &objective {
            Squares(functions) => functions.len(),
            Value(_) => 0,
        };
        let new = squares.max(1);
        let (n, me, mi) = (start.len() + new, new + equalities.len(), inequalities.len());
        let dense = |rows: usize, upper: bool| {
            let all = (0..rows).flat_map(|i| (0..n).map(move |j| (i, j, 0.0))).filter(|(i, j, _)| !upper || i <= j);
            Sparse::from_triplets(rows, n, &all.collect::<Vec<_>>())
        };
        let of_squares: Vec<_> = (0..squares).map(|i| (i, start.len() + i, 2f64.sqrt())).collect();
        let term = (squares == 0).then(|| Last(Sparse::from_triplets(1, n, &[(0, n - 1, 1.0)])));
        let mut problem = Self {
            name,
            objective,
            equalities,
            inequalities,
            start: Vec::new(),
            answers: answers.to_vec(),
            is_degenerate: false,
            residual_jacobian: Sparse::from_triplets(squares, n, &of_squares),
            residual_data: vec![0.0; squares],
            term,
            patterns: [dense(me, false), dense(mi, false), dense(n, true)],
            stages: [vec![0; n], vec![0; me], vec![0; mi]],
        };
        problem.start = start.to_vec();
        let new = problem.new_variables(start);
        problem.start.extend(new);
        problem
    }

    fn degenerate(mut self) -> Self {
        self.is_degenerate = true;
        self
    }

    fn objective_functions(&self) -> &[Function] {
        match &self.objective {
            Squares(functions) => functions,
            Value(function) => std::slice::from_ref(function),
        }
    }

    /// r or t at x.
    fn new_variables(&self, x: &[f64]) -> Vec<f64> {
        let x: Vec<N> = x.iter().map(|&x| N::from_re(x)).collect();
        self.objective_functions().iter().map(|f| f(&x).re).collect()
    }

    /// Rows c: `new − F(x)`, then the equalities; rows d.
    fn rows(&self, x: &[N]) -> (Vec<N>, Vec<N>) {
        let functions = self.objective_functions();
        let (x, new) = x.split_at(x.len() - functions.len());
        let mut c: Vec<N> = functions.iter().zip(new).map(|(f, r)| *r - f(x)).collect();
        c.extend(self.equalities.iter().map(|f| f(x)));
        (c, self.inequalities.iter().map(|f| f(x)).collect())
    }

    fn rows_at(&self, x: &[f64], i: usize, j: usize) -> (Vec<N>, Vec<N>) {
        let mut x: Vec<N> = x.iter().map(|&x| N::from_re(x)).collect();
        (x[i].eps1, x[j].eps2) = (1.0, 1.0);
        self.rows(&x)
    }
}

impl Problem for Textbook {
    fn variables(&self) -> usize {
        self.start.len()
    }
    fn equalities(&self) -> usize {
        self.patterns[0].rows
    }
    fn inequalities(&self) -> usize {
        self.patterns[1].rows
    }
    fn residual_jacobian(&self) -> &Sparse {
        &self.residual_jacobian
    }
    fn residual_data(&self) -> &[f64] {
        &self.residual_data
    }
    fn term(&self) -> Option<&dyn ConvexTerm> {
        self.term.as_ref().map(|term| term as &dyn ConvexTerm)
    }
    fn stages(&self) -> &[usize] {
        &self.stages[0]
    }
    fn constraint_stages(&self) -> [&[usize]; 2] {
        [&self.stages[1], &self.stages[2]]
    }
    fn constraints(&self, x: &[f64], equalities: &mut [f64], inequalities: &mut [f64]) {
        let (c, d) = self.rows_at(x, 0, 0);
        equalities.iter_mut().zip(c).for_each(|(out, c)| *out = c.re);
        inequalities.iter_mut().zip(d).for_each(|(out, d)| *out = d.re);
    }
    fn feasibility(&self, x: &[f64]) -> f64 {
        let (c, d) = self.rows_at(x, 0, 0);
        c.iter().map(|c| c.re.abs()).chain(d.iter().map(|d| -d.re)).fold(0.0, f64::max)
    }
    fn patterns(&self) -> [&Sparse; 3] {
        let [a, b, c] = &self.patterns;
        [a, b, c]
    }
    fn jacobians(&self, x: &[f64], equalities: &mut Sparse, inequalities: &mut Sparse) {
        equalities.values.resize(self.patterns[0].values.len(), 0.0);
        inequalities.values.resize(self.patterns[1].values.len(), 0.0);
        for j in 0..x.len() {
            let (c, d) = self.rows_at(x, j, j);
            for (matrix, rows) in [(&mut *equalities, c), (&mut *inequalities, d)] {
                let places = matrix.column_start[j]..matrix.column_start[j + 1];
                places.for_each(|slot| matrix.values[slot] = rows[matrix.row_index[slot] as usize].eps1);
            }
        }
    }
    fn hessian(&self, x: &[f64], multipliers: Multipliers<'_>, curvature: Curvature, out: &mut Sparse) {
        let n = x.len();
        let mut dense = DMatrix::zeros(n, n);
        for i in 0..n {
            for j in i..n {
                let (c, d) = self.rows_at(x, i, j);
                let of_c: f64 = c.iter().zip(multipliers.equalities).map(|(c, l)| c.eps1eps2 * l).sum();
                let of_d: f64 = d.iter().zip(multipliers.inequalities).map(|(d, nu)| d.eps1eps2 * nu).sum();
                (dense[(i, j)], dense[(j, i)]) = (of_c - of_d, of_c - of_d);
            }
        }
        if curvature == Curvature::Convex {
            let mut eigen = SymmetricEigen::new(dense);
            eigen.eigenvalues.iter_mut().for_each(|value| *value = value.max(0.0));
            dense = eigen.recompose();
        }
        (0..self.residual_data.len()).for_each(|i| dense[(n - 1 - i, n - 1 - i)] += 2.0);
        let entries: Vec<_> = out.entries().collect();
        entries.into_iter().for_each(|(i, j, slot)| out.values[slot] = dense[(i, j)]);
    }
    fn metric(&self, _: &[f64], out: &mut Sparse) {
        let entries: Vec<_> = out.entries().collect();
        entries.into_iter().for_each(|(i, j, slot)| out.values[slot] = f64::from(u8::from(i == j)));
    }
}

fn banana(x: &[N]) -> N {
    (x[1] - x[0] * x[0]) * 10.0
}

fn to_one(x: &[N]) -> N {
    -x[0] + 1.0
}

fn rosenbrock(name: &'static str, inequalities: Vec<Function>, start: [f64; 2], answers: &[f64]) -> Textbook {
    Textbook::new(name, Squares(vec![banana, to_one]), vec![], inequalities, &start, answers)
}

/// All problems that have a solution.
pub fn all() -> Vec<Textbook> {
    let root = f64::sqrt;
    vec![
        rosenbrock("HS1", vec![|x| x[1] + 1.5], [-2.0, 1.0], &[0.0]),
        rosenbrock("HS2", vec![|x| x[1] - 1.5], [-2.0, 1.0], &[0.0504261879, 4.941229318]),
        Textbook::new(
            "HS3",
            Value(|x| x[1] + (x[1] - x[0]).powi(2) * 1e-5),
            vec![],
            vec![|x| x[1]],
            &[10.0, 1.0],
            &[0.0],
        ),
        Textbook::new(
            "HS4",
            Value(|x| (x[0] + 1.0).powi(3) / 3.0 + x[1]),
            vec![],
            vec![|x| x[0] - 1.0, |x| x[1]],
            &[1.125, 0.125],
            &[8.0 / 3.0],
        ),
        Textbook::new(
            "HS5",
            Value(|x| (x[0] + x[1]).sin() + (x[0] - x[1]).powi(2) - x[0] * 1.5 + x[1] * 2.5 + 1.0),
            vec![],
            vec![|x| x[0] + 1.5, |x| -x[0] + 4.0, |x| x[1] + 3.0, |x| -x[1] + 3.0],
            &[0.0, 0.0],
            &[
                -0.5 * root(3.0) - std::f64::consts::FRAC_PI_3,
                0.5 * root(3.0) + 1.0 - 4.0 * std::f64::consts::FRAC_PI_3,
            ],
        ),
        Textbook::new("HS6", Squares(vec![to_one]), vec![banana], vec![], &[-1.2, 1.0], &[0.0]),
        Textbook::new(
            "HS7",
            Value(|x| (x[0] * x[0] + 1.0).ln() - x[1]),
            vec![|x| (x[0] * x[0] + 1.0).powi(2) + x[1] * x[1] - 4.0],
            vec![],
            &[2.0, 2.0],
            &[-root(3.0)],
        ),
        Textbook::new(
            "HS8",
            Value(|x| x[0] * 0.0 - 1.0),
            vec![|x| x[0] * x[0] + x[1] * x[1] - 25.0, |x| x[0] * x[1] - 9.0],
            vec![],
            &[2.0, 1.0],
            &[-1.0],
        ),
        Textbook::new(
            "HS9",
            Value(|x| (x[0] * std::f64::consts::PI / 12.0).sin() * (x[1] * std::f64::consts::PI / 16.0).cos()),
            vec![|x| x[0] * 4.0 - x[1] * 3.0],
            vec![],
            &[0.0, 0.0],
            &[-0.5],
        ),
        Textbook::new(
            "HS10",
            Value(|x| x[0] - x[1]),
            vec![],
            vec![|x| -(x[0] * x[0]) * 3.0 + x[0] * x[1] * 2.0 - x[1] * x[1] + 1.0],
            &[-10.0, 10.0],
            &[-1.0],
        ),
        Textbook::new(
            "HS11",
            Value(|x| (x[0] - 5.0).powi(2) + x[1] * x[1] - 25.0),
            vec![],
            vec![|x| -(x[0] * x[0]) + x[1]],
            &[4.9, 0.1],
            &[-8.498464223],
        ),
        Textbook::new(
            "HS12",
            Value(|x| x[0] * x[0] * 0.5 + x[1] * x[1] - x[0] * x[1] - x[0] * 7.0 - x[1] * 7.0),
            vec![],
            vec![|x| -(x[0] * x[0]) * 4.0 - x[1] * x[1] + 25.0],
            &[0.0, 0.0],
            &[-30.0],
        ),
        // No constraint qualification holds at the solution: there are no multipliers.
        Textbook::new(
            "HS13",
            Squares(vec![|x| x[0] - 2.0, |x| x[1]]),
            vec![],
            vec![|x| (-x[0] + 1.0).powi(3) - x[1], |x| x[0], |x| x[1]],
            &[-2.0, -2.0],
            &[1.0],
        )
        .degenerate(),
        Textbook::new(
            "HS14",
            Squares(vec![|x| x[0] - 2.0, |x| x[1] - 1.0]),
            vec![|x| x[0] - x[1] * 2.0 + 1.0],
            vec![|x| -(x[0] * x[0]) * 0.25 - x[1] * x[1] + 1.0],
            &[2.0, 2.0],
            &[9.0 - 2.875 * root(7.0)],
        ),
        rosenbrock(
            "HS15",
            vec![|x| x[0] * x[1] - 1.0, |x| x[0] + x[1] * x[1], |x| -x[0] + 0.5],
            [-2.0, 1.0],
            &[306.5, 360.379767],
        ),
        rosenbrock(
            "HS16",
            vec![|x| x[0] + x[1] * x[1], |x| x[0] * x[0] + x[1], |x| x[0] + 0.5, |x| -x[0] + 0.5, |x| -x[1] + 1.0],
            [-2.0, 1.0],
            &[0.25, 3.9820575, 23.1446608],
        ),
        rosenbrock(
            "HS17",
            vec![|x| x[1] * x[1] - x[0], |x| x[0] * x[0] - x[1], |x| x[0] + 0.5, |x| -x[0] + 0.5, |x| -x[1] + 1.0],
            [-2.0, 1.0],
            &[1.0],
        ),
        Textbook::new(
            "HS18",
            Squares(vec![|x| x[0] * 0.1, |x| x[1]]),
            vec![],
            vec![
                |x| x[0] * x[1] - 25.0,
                |x| x[0] * x[0] + x[1] * x[1] - 25.0,
                |x| x[0] - 2.0,
                |x| -x[0] + 50.0,
                |x| x[1],
                |x| -x[1] + 50.0,
            ],
            &[2.0, 2.0],
            &[5.0],
        ),
        Textbook::new(
            "HS19",
            Value(|x| (x[0] - 10.0).powi(3) + (x[1] - 20.0).powi(3)),
            vec![],
            vec![
                |x| (x[0] - 5.0).powi(2) + (x[1] - 5.0).powi(2) - 100.0,
                |x| -(x[1] - 5.0).powi(2) - (x[0] - 6.0).powi(2) + 82.81,
                |x| x[0] - 13.0,
                |x| -x[0] + 100.0,
                |x| x[1],
                |x| -x[1] + 100.0,
            ],
            &[20.1, 5.84],
            &[-6961.813876],
        ),
        rosenbrock(
            "HS20",
            vec![
                |x| x[0] + x[1] * x[1],
                |x| x[0] * x[0] + x[1],
                |x| x[0] * x[0] + x[1] * x[1] - 1.0,
                |x| x[0] + 0.5,
                |x| -x[0] + 0.5,
            ],
            [-2.0, 1.0],
            &[81.5 - 25.0 * root(3.0), 40.19873],
        ),
        Textbook::new(
            "HS21",
            Squares(vec![|x| x[0] * 0.1, |x| x[1]]),
            vec![],
            vec![|x| x[0] * 10.0 - x[1] - 10.0, |x| x[0] - 2.0, |x| -x[0] + 50.0, |x| x[1] + 50.0, |x| -x[1] + 50.0],
            &[-1.0, -1.0],
            &[0.04],
        ),
        Textbook::new(
            "HS22",
            Squares(vec![|x| x[0] - 2.0, |x| x[1] - 1.0]),
            vec![],
            vec![|x| -x[0] - x[1] + 2.0, |x| -(x[0] * x[0]) + x[1]],
            &[2.0, 2.0],
            &[1.0],
        ),
        Textbook::new(
            "HS23",
            Squares(vec![|x| x[0], |x| x[1]]),
            vec![],
            vec![
                |x| x[0] + x[1] - 1.0,
                |x| x[0] * x[0] + x[1] * x[1] - 1.0,
                |x| x[0] * x[0] * 9.0 + x[1] * x[1] - 9.0,
                |x| x[0] * x[0] - x[1],
                |x| x[1] * x[1] - x[0],
            ],
            &[3.0, 1.0],
            &[2.0],
        ),
        Textbook::new(
            "HS24",
            Value(|x| ((x[0] - 3.0).powi(2) - 9.0) * x[1].powi(3) / (27.0 * 3f64.sqrt())),
            vec![],
            vec![
                |x| x[0] / 3f64.sqrt() - x[1],
                |x| x[0] + x[1] * 3f64.sqrt(),
                |x| -x[0] - x[1] * 3f64.sqrt() + 6.0,
                |x| x[0],
                |x| x[1],
            ],
            &[1.0, 0.5],
            &[-1.0],
        ),
        // The Hessian is singular at the solution: convergence is linear.
        Textbook::new(
            "HS26",
            Squares(vec![|x| x[0] - x[1], |x| (x[1] - x[2]).powi(2)]),
            vec![|x| (x[1] * x[1] + 1.0) * x[0] + x[2].powi(4) - 3.0],
            vec![],
            &[-2.6, 2.0, 2.0],
            &[0.0],
        ),
        Textbook::new(
            "HS27",
            Squares(vec![|x| (x[0] - 1.0) * 0.1, |x| x[1] - x[0] * x[0]]),
            vec![|x| x[0] + x[2] * x[2] + 1.0],
            vec![],
            &[2.0, 2.0, 2.0],
            &[0.04],
        ),
        Textbook::new(
            "HS28",
            Squares(vec![|x| x[0] + x[1], |x| x[1] + x[2]]),
            vec![|x| x[0] + x[1] * 2.0 + x[2] * 3.0 - 1.0],
            vec![],
            &[-4.0, 1.0, 1.0],
            &[0.0],
        ),
        Textbook::new(
            "HS29",
            Value(|x| -(x[0] * x[1] * x[2])),
            vec![],
            vec![|x| -(x[0] * x[0]) - x[1] * x[1] * 2.0 - x[2] * x[2] * 4.0 + 48.0],
            &[1.0, 1.0, 1.0],
            &[-16.0 * root(2.0)],
        ),
        Textbook::new(
            "HS30",
            Squares(vec![|x| x[0], |x| x[1], |x| x[2]]),
            vec![],
            vec![|x| x[0] * x[0] + x[1] * x[1] - 1.0, |x| x[0] - 1.0, |x| -x[0] + 10.0],
            &[1.0, 1.0, 1.0],
            &[1.0],
        ),
        Textbook::new(
            "HS32",
            Squares(vec![|x| x[0] + x[1] * 3.0 + x[2], |x| (x[0] - x[1]) * 2.0]),
            vec![|x| -x[0] - x[1] - x[2] + 1.0],
            vec![|x| x[1] * 6.0 + x[2] * 4.0 - x[0].powi(3) - 3.0, |x| x[0], |x| x[1], |x| x[2]],
            &[0.1, 0.7, 0.2],
            &[1.0],
        ),
        Textbook::new(
            "HS33",
            Value(|x| (x[0] - 1.0) * (x[0] - 2.0) * (x[0] - 3.0) + x[2]),
            vec![],
            vec![
                |x| x[2] * x[2] - x[1] * x[1] - x[0] * x[0],
                |x| x[0] * x[0] + x[1] * x[1] + x[2] * x[2] - 4.0,
                |x| x[0],
                |x| x[1],
                |x| x[2],
                |x| -x[2] + 5.0,
            ],
            &[0.0, 0.0, 3.0],
            &[root(2.0) - 6.0, -4.0],
        ),
        Textbook::new(
            "HS35",
            Value(|x| {
                let linear = x[0] * 8.0 + x[1] * 6.0 + x[2] * 4.0;
                let squares = x[0] * x[0] * 2.0 + x[1] * x[1] * 2.0 + x[2] * x[2];
                squares - linear + x[0] * x[1] * 2.0 + x[0] * x[2] * 2.0 + 9.0
            }),
            vec![],
            vec![|x| -x[0] - x[1] - x[2] * 2.0 + 3.0, |x| x[0], |x| x[1], |x| x[2]],
            &[0.5, 0.5, 0.5],
            &[1.0 / 9.0],
        ),
        Textbook::new(
            "HS37",
            Value(|x| -(x[0] * x[1] * x[2]) * 1e-2),
            vec![],
            vec![
                |x| -x[0] - x[1] * 2.0 - x[2] * 2.0 + 72.0,
                |x| x[0],
                |x| x[1],
                |x| x[2],
                |x| -x[0] + 42.0,
                |x| -x[1] + 42.0,
                |x| -x[2] + 42.0,
            ],
            &[10.0, 10.0, 10.0],
            &[-34.56],
        ),
        Textbook::new(
            "HS39",
            Value(|x| -x[0]),
            vec![|x| x[1] - x[0].powi(3) - x[2] * x[2], |x| x[0] * x[0] - x[1] - x[3] * x[3]],
            vec![],
            &[2.0, 2.0, 2.0, 2.0],
            &[-1.0],
        ),
        Textbook::new(
            "HS40",
            Value(|x| -(x[0] * x[1] * x[2] * x[3])),
            vec![|x| x[0].powi(3) + x[1] * x[1] - 1.0, |x| x[0] * x[0] * x[3] - x[2], |x| x[3] * x[3] - x[1]],
            vec![],
            &[0.8, 0.8, 0.8, 0.8],
            // At the other one the curve of feasible points has an inflection.
            &[-0.25, 0.0],
        ),
        Textbook::new(
            "HS42",
            Squares(vec![|x| x[0] - 1.0, |x| x[1] - 2.0, |x| x[2] - 3.0, |x| x[3] - 4.0]),
            vec![|x| x[0] - 2.0, |x| x[2] * x[2] + x[3] * x[3] - 2.0],
            vec![],
            &[1.0, 1.0, 1.0, 1.0],
            &[28.0 - 10.0 * root(2.0)],
        ),
        Textbook::new(
            "HS43",
            Value(|x| {
                let squares = x[0] * x[0] + x[1] * x[1] + x[2] * x[2] * 2.0 + x[3] * x[3];
                squares - x[0] * 5.0 - x[1] * 5.0 - x[2] * 21.0 + x[3] * 7.0
            }),
            vec![],
            vec![
                |x| {
                    let squares = x[0] * x[0] + x[1] * x[1] + x[2] * x[2] + x[3] * x[3];
                    -squares - x[0] + x[1] - x[2] + x[3] + 8.0
                },
                |x| {
                    let squares = x[0] * x[0] + x[1] * x[1] * 2.0 + x[2] * x[2] + x[3] * x[3] * 2.0;
                    -squares + x[0] + x[3] + 10.0
                },
                |x| -(x[0] * x[0]) * 2.0 - x[1] * x[1] - x[2] * x[2] - x[0] * 2.0 + x[1] + x[3] + 5.0,
            ],
            &[0.0, 0.0, 0.0, 0.0],
            &[-44.0],
        ),
        Textbook::new(
            "HS48",
            Squares(vec![|x| x[0] - 1.0, |x| x[1] - x[2], |x| x[3] - x[4]]),
            vec![|x| x[0] + x[1] + x[2] + x[3] + x[4] - 5.0, |x| x[2] - (x[3] + x[4]) * 2.0 + 3.0],
            vec![],
            &[3.0, 5.0, -3.0, 2.0, -2.0],
            &[0.0],
        ),
        Textbook::new(
            "HS71",
            Value(|x| x[0] * x[3] * (x[0] + x[1] + x[2]) + x[2]),
            vec![|x| x[0] * x[0] + x[1] * x[1] + x[2] * x[2] + x[3] * x[3] - 40.0],
            vec![
                |x| x[0] * x[1] * x[2] * x[3] - 25.0,
                |x| x[0] - 1.0,
                |x| x[1] - 1.0,
                |x| x[2] - 1.0,
                |x| x[3] - 1.0,
                |x| -x[0] + 5.0,
                |x| -x[1] + 5.0,
                |x| -x[2] + 5.0,
                |x| -x[3] + 5.0,
            ],
            &[1.0, 5.0, 5.0, 1.0],
            &[17.0140173],
        ),
        // On the circle a full step is refused by any merit function without a second-order correction (N. Maratos, PhD
        // thesis, 1978).
        Textbook::new(
            "Maratos",
            Value(|x| (x[0] * x[0] + x[1] * x[1] - 1.0) * 2.0 - x[0]),
            vec![|x| x[0] * x[0] + x[1] * x[1] - 1.0],
            vec![],
            &[0.6, 0.8],
            &[-1.0],
        ),
        // Interior-point methods that keep linearised constraints converge to an infeasible point here (A. Wächter and
        // L. T. Biegler, *Math. Program.* 88, 2000).
        Textbook::new(
            "Wächter–Biegler",
            Value(|x| x[0]),
            vec![|x| x[0] * x[0] - x[1] - 1.0, |x| x[0] - x[2] - 0.5],
            vec![|x| x[1], |x| x[2]],
            &[-2.0, 3.0, 1.0],
            &[1.0],
        ),
        // The same constraint three times: multipliers are not unique.
        Textbook::new(
            "dependent equalities",
            Squares(vec![|x| x[0] - 2.0, |x| x[1] - 1.0]),
            vec![|x| x[0] + x[1] - 1.0, |x| (x[0] + x[1]) * 2.0 - 2.0, |x| (x[0] + x[1]).powi(2) - 1.0],
            vec![],
            &[0.3, 0.4],
            &[2.0],
        ),
        Textbook::new(
            "dependent inequalities",
            Squares(vec![|x| x[0] + 1.0, |x| x[1] + 1.0]),
            vec![],
            vec![|x| x[0], |x| x[1], |x| x[0] + x[1], |x| x[0] * 2.0 + x[1]],
            &[1.0, 2.0],
            &[2.0],
        ),
        // Complementarity: its multipliers are unbounded.
        Textbook::new(
            "complementarity",
            Squares(vec![|x| x[0] - 1.0, |x| x[1] - 1.0]),
            vec![],
            vec![|x| x[0], |x| x[1], |x| -(x[0] * x[1])],
            &[0.6, 0.5],
            &[1.0, 2.0],
        )
        .degenerate(),
        // Singular Jacobian at the solution, which has no multipliers.
        Textbook::new(
            "no multipliers",
            Value(|x| x[0]),
            vec![|x| x[1] - x[0].powi(3) * 0.0 - x[0] * x[0] * x[0] * x[0], |x| x[1] + x[0] * x[0]],
            vec![],
            &[0.5, 0.2],
            &[0.0],
        )
        .degenerate(),
    ]
}

/// No point satisfies the constraints.
pub fn infeasible() -> Vec<Textbook> {
    vec![
        Textbook::new("x² = −1", Squares(vec![|x| x[0] - 1.0]), vec![|x| x[0] * x[0] + 1.0], vec![], &[2.0], &[]),
        Textbook::new(
            "a circle beside a line",
            Squares(vec![|x| x[0], |x| x[1]]),
            vec![|x| x[0] * x[0] + x[1] * x[1] - 1.0, |x| x[0] + x[1] - 4.0],
            vec![],
            &[1.0, 0.5],
            &[],
        ),
        Textbook::new(
            "bounds that cross",
            Squares(vec![|x| x[0]]),
            vec![],
            vec![|x| x[0] - 2.0, |x| -x[0] + 1.0],
            &[0.0],
            &[],
        ),
    ]
}
