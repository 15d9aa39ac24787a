use rand::{RngExt, SeedableRng};

use super::{Criterion, Failure, Programme, Term, missing};
use crate::deadline::Deadline;
use crate::nlp::subproblem::qp::QuadraticProgramme;
use crate::numerics::sparse::Sparse;

fn muscle(weight: f64) -> Term {
    Term { weight, offset: 0.0, scale: 1.0, bounds: [0.0, 1.0], is_muscle: true }
}

fn reserve() -> Term {
    Term { bounds: [f64::NEG_INFINITY, f64::INFINITY], is_muscle: false, ..muscle(1.0) }
}

/// Muscles with these moments at full activation against loads.
fn arm(columns: &[&[(usize, f64)]], right: &[f64], criterion: Criterion) -> Programme {
    Programme {
        rows: right.len(),
        columns: columns.iter().map(|column| column.to_vec()).collect(),
        right: right.to_vec(),
        terms: columns.iter().map(|_| muscle(1.0)).collect(),
        criterion,
    }
}

fn solved(programme: &Programme) -> Vec<f64> {
    let optimum = programme.solve(Deadline::default()).unwrap();
    assert_optimal(programme, &optimum);
    optimum.x
}

/// Checks the optimality conditions, of min/max the load and the bounds only.
fn assert_optimal(programme: &Programme, optimum: &super::Optimum) {
    let loads = programme.loads(&optimum.x);
    let scale = 1.0 + programme.right.iter().fold(0.0f64, |a, b| a.max(b.abs()));
    loads.iter().zip(&programme.right).for_each(|(a, b)| assert!((a - b).abs() < 1e-7 * scale, "{a} {b}"));
    let Criterion::Polynomial(power) = programme.criterion else { return };
    for (i, term) in programme.terms.iter().enumerate() {
        let x = optimum.x[i];
        assert!(x >= term.bounds[0] - 1e-9 && x <= term.bounds[1] + 1e-9);
        if power < 2.0 {
            continue;
        }
        let p = if term.is_muscle { power } else { 2.0 };
        let e = term.effort(x);
        let slope = term.weight * term.scale * p * e.abs().powf(p - 1.0) * e.signum();
        let pull: f64 = programme.columns[i].iter().map(|&(row, value)| value * optimum.multipliers[row]).sum();
        let left = slope - pull - optimum.lower[i] + optimum.upper[i];
        assert!(left.abs() < 1e-7 * (1.0 + slope.abs()), "{i}: {left}");
        assert!(optimum.lower[i] >= -1e-9 && optimum.upper[i] >= -1e-9);
        for (slack, z) in [(x - term.bounds[0], optimum.lower[i]), (term.bounds[1] - x, optimum.upper[i])] {
            assert!(!slack.is_finite() || (slack * z).abs() < 1e-8, "{i}: {slack} {z}");
        }
    }
}

fn close(found: &[f64], wanted: &[f64], tolerance: f64) {
    for (a, b) in found.iter().zip(wanted) {
        assert!((a - b).abs() < tolerance, "{found:?} {wanted:?}");
    }
}

#[test]
fn two_and_three_muscles_have_the_loads_of_closed_forms() {
    let (c1, c2, load) = (30.0, 20.0, 12.0);
    let two = |criterion| arm(&[&[(0, c1)], &[(0, c2)]], &[load], criterion);
    let square = c1 * c1 + c2 * c2;
    close(&solved(&two(Criterion::Polynomial(2.0))), &[load * c1 / square, load * c2 / square], 1e-12);
    let cubes = c1.powf(1.5) + c2.powf(1.5);
    close(&solved(&two(Criterion::Polynomial(3.0))), &[load * c1.sqrt() / cubes, load * c2.sqrt() / cubes], 1e-10);
    close(&solved(&two(Criterion::Polynomial(1.0))), &[load / c1, 0.0], 1e-8);
    close(&solved(&two(Criterion::MinMax)), &[load / (c1 + c2); 2], 1e-8);
    // An antagonist has nothing to do, whatever the criterion.
    for criterion in
        [Criterion::Polynomial(1.0), Criterion::Polynomial(2.0), Criterion::Polynomial(3.0), Criterion::MinMax]
    {
        let three = arm(&[&[(0, c1)], &[(0, c2)], &[(0, -25.0)]], &[load], criterion);
        let x = solved(&three);
        close(&x[..2], &solved(&two(criterion)), 1e-6);
        assert!(x[2].abs() < 1e-5, "{x:?}");
    }
    // The upper bound: the first muscle cannot do it alone.
    close(&solved(&arm(&[&[(0, c1)], &[(0, c2)]], &[40.0], Criterion::Polynomial(1.0))), &[1.0, 0.5], 1e-7);
    close(&solved(&arm(&[&[(0, c1)], &[(0, c2)]], &[49.0], Criterion::Polynomial(2.0))), &[1.0, 0.95], 1e-10);
}

#[test]
fn the_stages_of_min_max_end_where_nothing_can_be_lowered() {
    // The first joint needs more than the second, which two muscles of its own and a shared one can serve.
    let columns: [&[(usize, f64)]; 5] =
        [&[(0, 10.0)], &[(0, 10.0)], &[(0, 10.0), (1, 5.0)], &[(1, 10.0)], &[(1, 20.0)]];
    let programme = arm(&columns, &[24.0, 10.0], Criterion::MinMax);
    let optimum = programme.solve(Deadline::default()).unwrap();
    // All of the first at 24/30; then 10 − 5·0.8 by the other two: 6/30.
    close(&optimum.x, &[0.8, 0.8, 0.8, 0.2, 0.2], 1e-6);
    assert!((optimum.value - 0.8).abs() < 1e-7 && optimum.stages >= 2, "{optimum:?}");
    // A reserve beside the muscles costs its size.
    let mut with = arm(&[&[(0, 10.0)], &[(0, 1.0)]], &[12.0], Criterion::MinMax);
    with.terms[1] = reserve();
    close(&solved(&with), &[1.0, 2.0], 1e-6);
}

#[test]
fn efforts_with_offsets_and_weights_are_shared_as_their_slopes_say() {
    let mut programme = arm(&[&[(0, 10.0)], &[(0, 10.0)]], &[6.0], Criterion::Polynomial(2.0));
    programme.terms[0] = Term { weight: 2.0, offset: 0.1, scale: 0.5, ..programme.terms[0] };
    // 2·2·0.5 (0.1 + 0.5 a) = 2 b and a + b = 0.6.
    let a = (0.6 - 0.1) / 1.5;
    close(&solved(&programme), &[a, 0.6 - a], 1e-10);
}

#[test]
fn what_is_missing_is_said_and_certified() {
    let programme = arm(&[&[(0, 20.0)], &[(0, 9.0), (1, 4.0)]], &[41.0, 4.0], Criterion::Polynomial(2.0));
    for criterion in
        [Criterion::Polynomial(1.0), Criterion::Polynomial(2.0), Criterion::Polynomial(3.0), Criterion::MinMax]
    {
        let programme = Programme { criterion, ..programme.clone() };
        assert_eq!(programme.solve(Deadline::default()).unwrap_err(), Failure::Infeasible, "{criterion:?}");
    }
    let found = missing(&programme).unwrap();
    close(&found.moments, &[12.0, 0.0], 1e-6);
    assert!(!found.is_none() && found.largest() == Some(0) && (found.certificate - 1.0).abs() < 1e-6, "{found:?}");
    let can = missing(&Programme { right: vec![29.0, 4.0], ..programme }).unwrap();
    assert!(can.is_none(), "{can:?}");
}

/// Random muscles over some joints, with a reserve at the first.
fn random(rng: &mut impl RngExt, criterion: Criterion) -> Programme {
    let (rows, count) = (rng.random_range(1..6usize), rng.random_range(4..20usize));
    let mut columns: Vec<Vec<(usize, f64)>> = (0..count)
        .map(|_| {
            let first = rng.random_range(0..rows);
            (first..rows.min(first + 3)).map(|row| (row, rng.random_range(-40.0..40.0))).collect()
        })
        .collect();
    columns.push(vec![(0, 1.0)]);
    let mut terms: Vec<Term> = (0..count).map(|_| muscle(rng.random_range(0.3..3.0))).collect();
    terms.push(reserve());
    let mut programme = Programme { rows, columns, right: vec![0.0; rows], terms, criterion };
    // A load that some activations carry.
    let x: Vec<f64> = (0..=count).map(|_| rng.random_range(0.0..0.7)).collect();
    programme.right = programme.loads(&x);
    programme
}

#[test]
fn random_programmes_are_solved_and_squares_as_by_clarabel() {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(35);
    let (mut iterations, mut count) = (0, 0.0);
    for round in 0..300 {
        let power = [2.0, 3.0, 4.5, 10.0][round % 4];
        let programme = random(&mut rng, Criterion::Polynomial(power));
        let optimum =
            programme.solve(Deadline::default()).unwrap_or_else(|why| panic!("{round}: {why:?} {programme:?}"));
        assert_optimal(&programme, &optimum);
        iterations += optimum.iterations;
        count += 1.0;
        if power != 2.0 {
            continue;
        }
        let n = programme.terms.len();
        let diagonal: Vec<_> = programme.terms.iter().enumerate().map(|(i, term)| (i, i, 2.0 * term.weight)).collect();
        let columns = programme.columns.iter().enumerate();
        let entries: Vec<_> = columns.flat_map(|(i, column)| column.iter().map(move |&(row, v)| (row, i, v))).collect();
        let bounds: Vec<_> = (0..n - 1).flat_map(|i| [(2 * i, i, 1.0), (2 * i + 1, i, -1.0)]).collect();
        let other = QuadraticProgramme {
            hessian: &Sparse::from_triplets(n, n, &diagonal),
            gradient: &vec![0.0; n],
            equalities: &Sparse::from_triplets(programme.rows, n, &entries),
            equality_values: &programme.right.iter().map(|b| -b).collect::<Vec<f64>>(),
            inequalities: &Sparse::from_triplets(2 * n - 2, n, &bounds),
            inequality_values: &(0..2 * n - 2).map(|k| f64::from(u8::from(k % 2 == 1))).collect::<Vec<f64>>(),
            deadline: Deadline::default(),
        };
        close(&optimum.x, &other.solve().unwrap().step, 1e-6);
    }
    let mean = iterations as f64 / count;
    assert!(mean < 12.0, "{mean} iterations in the mean");
}

#[test]
fn ranges_are_those_of_a_closed_form_and_hold_what_is_nearly_optimal() {
    let (c1, c2, load, share) = (30.0, 20.0, 12.0, 0.05);
    let programme = arm(&[&[(0, c1)], &[(0, c2)]], &[load], Criterion::Polynomial(2.0));
    let optimum = programme.solve(Deadline::default()).unwrap();
    let ranges = programme.ranges(&optimum, share, Deadline::default()).unwrap();
    let size = (share * optimum.value / (c1 * c1 + c2 * c2)).sqrt();
    for (i, other) in [(0, c2), (1, c1)] {
        close(&ranges[i], &[optimum.x[i] - other * size, optimum.x[i] + other * size], 1e-4 * other * size);
    }
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(36);
    for round in 0..20 {
        let criterion =
            [Criterion::Polynomial(2.0), Criterion::Polynomial(3.0), Criterion::Polynomial(1.0), Criterion::MinMax];
        let criterion = criterion[round % 4];
        let programme = random(&mut rng, criterion);
        let optimum = programme.solve(Deadline::default()).unwrap();
        let ranges = programme.ranges(&optimum, share, Deadline::default()).unwrap();
        let value = |x: &[f64]| match criterion {
            Criterion::MinMax => programme.largest_effort(x) + x[x.len() - 1].abs(),
            Criterion::Polynomial(p) => {
                let last = x[x.len() - 1];
                programme.muscle_effort(p, x) + if p < 2.0 { last.abs() } else { last * last }
            }
        };
        let effort = match criterion {
            Criterion::MinMax => programme.largest_effort(&optimum.x),
            Criterion::Polynomial(p) => programme.muscle_effort(p, &optimum.x),
        };
        assert!((value(&optimum.x) - optimum.value).abs() < 1e-6 * (1.0 + optimum.value), "{criterion:?}");
        // Optima of disturbed criteria.
        let mut inside = 0;
        for _ in 0..20 {
            let mut disturbed = programme.clone();
            disturbed.terms.iter_mut().for_each(|term| term.weight *= rng.random_range(0.8..1.25));
            let Ok(other) = disturbed.solve(Deadline::default()) else { continue };
            if value(&other.x) <= optimum.value + share * effort {
                inside += 1;
                for (i, [low, high]) in ranges.iter().enumerate().take(ranges.len() - 1) {
                    assert!(
                        other.x[i] > low - 1e-4 && other.x[i] < high + 1e-4,
                        "{criterion:?} {i}: {low} {high} {}",
                        other.x[i]
                    );
                }
            }
        }
        let is_wide = ranges.iter().any(|[low, high]| high - low > 1e-3);
        assert!(is_wide && inside > 15, "{criterion:?}: {inside}");
    }
}
