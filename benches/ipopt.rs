//! The same problems by IPOPT and by this solver, side by side: iterations and time, with the same functions and exact
//! derivatives, from the same start guess.
//!
//! `IPOPT=path/to/libipopt.so cargo bench --bench ipopt -- STUDY N …` solves every Nth job of each study. The library
//! comes, for example, with `pip install casadi`.

mod case;

use std::ffi::{CString, c_char, c_int, c_void};
use std::path::Path;
use std::time::Instant as Clock;

use case::Case;
use libloading::Library;
use sinew::internals::nlp::iterate::Iterate;
use sinew::internals::nlp::options::SqpOptions;
use sinew::internals::nlp::problem::{Curvature, Multipliers, Problem};
use sinew::internals::nlp::sqp;
use sinew::internals::nlp::termination::SqpStatus;
use sinew::internals::numerics::sparse::Sparse;
use sinew::internals::study::{Job, Study};

/// What IPOPT takes for no bound.
const INFINITE: f64 = 1e20;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|argument| !argument.starts_with("--")).collect();
    let Some(path) = std::env::var_os("IPOPT") else {
        println!("skipped: IPOPT, the path of libipopt.so, is not set");
        return;
    };
    // Safety: the library's initialisers are trusted.
    let library = unsafe { Library::new(&path) }.unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    println!("study job p unknowns | Sinew: status iterations factorisations seconds objective | IPOPT: the same");
    for pair in arguments.chunks(2) {
        let study = case::study(Path::new(&pair[0]));
        let every = pair.get(1).map_or(1, |every| every.parse().expect("a number of jobs"));
        study.jobs.iter().step_by(every).for_each(|job| compare(&library, study, job));
    }
}

fn compare(library: &Library, study: &'static Study, job: &'static Job) {
    let Some(Case { problem, start: guess }) = case::case(study, job) else { return };
    let clock = Clock::now();
    let own = sqp::solve(&problem, guess.clone(), SqpOptions::default());
    let own_s = clock.elapsed().as_secs_f64();
    let clock = Clock::now();
    let other = by_ipopt(library, &problem, guess);
    let other_s = clock.elapsed().as_secs_f64();
    println!(
        "{} {} {} {} | {} {} {} {own_s:.3} {:.8e} | {} {} {other_s:.3} {:.8e}",
        study.name,
        job.index,
        job.points,
        problem.variables(),
        if own.status == SqpStatus::Converged { "converged" } else { "failed" },
        own.iterations(),
        own.factorisations,
        own.iterate.objective,
        if other.status == 0 { "converged".to_owned() } else { format!("failed({})", other.status) },
        other.iterations,
        other.objective,
    );
}

struct Other {
    status: c_int,
    iterations: usize,
    objective: f64,
}

/// A problem as IPOPT sees it: inequalities on one variable are bounds, the others rows below the equalities.
struct Seen<'p> {
    problem: &'p dyn Problem,
    here: Iterate,
    hessian: Sparse,
    objective_hessian: Sparse,
    /// Inequalities that are rows.
    rows: Vec<usize>,
    iterations: usize,
}

type Function<T> = extern "C" fn(c_int, *const f64, bool, *mut f64, *mut c_void) -> T;
type Rows = extern "C" fn(c_int, *const f64, bool, c_int, *mut f64, *mut c_void) -> bool;
type Jacobian =
    extern "C" fn(c_int, *const f64, bool, c_int, c_int, *mut c_int, *mut c_int, *mut f64, *mut c_void) -> bool;
type Hessian = extern "C" fn(
    c_int,
    *const f64,
    bool,
    f64,
    c_int,
    *const f64,
    bool,
    c_int,
    *mut c_int,
    *mut c_int,
    *mut f64,
    *mut c_void,
) -> bool;
type Progress = extern "C" fn(c_int, c_int, f64, f64, f64, f64, f64, f64, f64, f64, c_int, *mut c_void) -> bool;
type Create = unsafe extern "C" fn(
    c_int,
    *const f64,
    *const f64,
    c_int,
    *const f64,
    *const f64,
    c_int,
    c_int,
    c_int,
    Function<bool>,
    Rows,
    Function<bool>,
    Jacobian,
    Hessian,
) -> *mut c_void;
type Solve =
    unsafe extern "C" fn(*mut c_void, *mut f64, *mut f64, *mut f64, *mut f64, *mut f64, *mut f64, *mut c_void) -> c_int;

fn by_ipopt(library: &Library, problem: &dyn Problem, mut x: Vec<f64>) -> Other {
    let here = Iterate::new(problem, x.clone());
    let (n, me) = (x.len(), here.equalities.len());
    let (mut low, mut high) = (vec![-INFINITE; n], vec![INFINITE; n]);
    let mut entries: Vec<Vec<(usize, f64)>> = vec![Vec::new(); here.inequalities.len()];
    for (row, column, slot) in here.inequality_jacobian.entries() {
        entries[row].push((column, here.inequality_jacobian.values[slot]));
    }
    let mut rows = Vec::new();
    for (row, terms) in entries.iter().enumerate() {
        match terms[..] {
            [(column, weight)] if weight > 0.0 => low[column] = x[column] - here.inequalities[row] / weight,
            [(column, weight)] => high[column] = x[column] - here.inequalities[row] / weight,
            _ => rows.push(row),
        }
    }
    let [_, _, pattern] = problem.patterns();
    let m = me + rows.len();
    let of_rows = rows.iter().map(|&row| entries[row].len()).sum::<usize>();
    let jacobian_entries = here.equality_jacobian.values.len() + of_rows;
    let hessian_entries = pattern.values.len();
    let (least, mut most) = (vec![0.0; m], vec![0.0; m]);
    most[me..].fill(INFINITE);
    let [hessian, objective_hessian] = [(); 2].map(|()| pattern.clone());
    let mut seen = Seen { problem, here, hessian, objective_hessian, rows, iterations: 0 };
    // Safety: the signatures are those of IpStdCInterface.h of IPOPT 3.14, and `seen` outlives the solve.
    unsafe {
        let create = library.get::<Create>(b"CreateIpoptProblem").unwrap();
        let text = library
            .get::<unsafe extern "C" fn(*mut c_void, *const c_char, *const c_char) -> bool>(b"AddIpoptStrOption")
            .unwrap();
        let integer = library
            .get::<unsafe extern "C" fn(*mut c_void, *const c_char, c_int) -> bool>(b"AddIpoptIntOption")
            .unwrap();
        let number =
            library.get::<unsafe extern "C" fn(*mut c_void, *const c_char, f64) -> bool>(b"AddIpoptNumOption").unwrap();
        let watch =
            library.get::<unsafe extern "C" fn(*mut c_void, Progress) -> bool>(b"SetIntermediateCallback").unwrap();
        let solve = library.get::<Solve>(b"IpoptSolve").unwrap();
        let free = library.get::<unsafe extern "C" fn(*mut c_void)>(b"FreeIpoptProblem").unwrap();
        let (n, m) = (n as c_int, m as c_int);
        let ipopt = create(
            n,
            low.as_ptr(),
            high.as_ptr(),
            m,
            least.as_ptr(),
            most.as_ptr(),
            jacobian_entries as c_int,
            hessian_entries as c_int,
            0,
            objective,
            constraints,
            gradient,
            jacobian,
            curvature,
        );
        let word = |word: &str| CString::new(word).unwrap();
        let verbose = std::env::var("IPOPT_PRINT").ok().and_then(|level| level.parse().ok()).unwrap_or(0);
        integer(ipopt, word("print_level").as_ptr(), verbose);
        integer(ipopt, word("max_iter").as_ptr(), 1000);
        number(ipopt, word("tol").as_ptr(), 1e-8);
        text(ipopt, word("sb").as_ptr(), word("yes").as_ptr());
        for option in std::env::var("IPOPT_OPTIONS").unwrap_or_default().split_whitespace() {
            let (key, value) = option.split_once('=').expect("key=value");
            match value.parse::<f64>() {
                Ok(value) => number(ipopt, word(key).as_ptr(), value),
                Err(_) => text(ipopt, word(key).as_ptr(), word(value).as_ptr()),
            };
        }
        watch(ipopt, progress);
        let mut found = 0.0;
        let nothing = std::ptr::null_mut();
        let user = (&raw mut seen).cast();
        let status = solve(ipopt, x.as_mut_ptr(), nothing, &mut found, nothing, nothing, nothing, user);
        free(ipopt);
        Other { status, iterations: seen.iterations, objective: found }
    }
}

/// What the callbacks are given, moved to x.
///
/// # Safety
/// `user` is a [`Seen`], x has as many entries as that has unknowns.
unsafe fn at<'s>(x: *const f64, user: *mut c_void) -> &'s mut Seen<'s> {
    let seen = unsafe { &mut *user.cast::<Seen<'s>>() };
    let x = unsafe { std::slice::from_raw_parts(x, seen.here.x.len()) };
    if x != &seen.here.x[..] {
        seen.here.x.copy_from_slice(x);
        seen.here.evaluate(seen.problem);
        seen.here.differentiate(seen.problem);
    }
    seen
}

extern "C" fn objective(_: c_int, x: *const f64, _: bool, out: *mut f64, user: *mut c_void) -> bool {
    unsafe { *out = at(x, user).here.objective };
    true
}

extern "C" fn gradient(n: c_int, x: *const f64, _: bool, out: *mut f64, user: *mut c_void) -> bool {
    unsafe { std::slice::from_raw_parts_mut(out, n as usize).copy_from_slice(&at(x, user).here.gradient) };
    true
}

extern "C" fn constraints(_: c_int, x: *const f64, _: bool, m: c_int, out: *mut f64, user: *mut c_void) -> bool {
    let (seen, out) = unsafe { (at(x, user), std::slice::from_raw_parts_mut(out, m as usize)) };
    let values = seen.here.equalities.iter().copied().chain(seen.rows.iter().map(|&row| seen.here.inequalities[row]));
    out.iter_mut().zip(values).for_each(|(out, value)| *out = value);
    true
}

extern "C" fn jacobian(
    _: c_int,
    x: *const f64,
    _: bool,
    _: c_int,
    count: c_int,
    rows: *mut c_int,
    columns: *mut c_int,
    values: *mut f64,
    user: *mut c_void,
) -> bool {
    let seen = unsafe { if x.is_null() { &mut *user.cast::<Seen<'_>>() } else { at(x, user) } };
    let me = seen.here.equalities.len();
    let mut places = vec![None; seen.here.inequalities.len()];
    seen.rows.iter().enumerate().for_each(|(k, &row)| places[row] = Some(me + k));
    let (of_equalities, of_rows) = (&seen.here.equality_jacobian, &seen.here.inequality_jacobian);
    let all = of_equalities
        .entries()
        .map(|(row, column, slot)| (row, column, of_equalities.values[slot]))
        .chain(of_rows.entries().filter_map(|(row, column, slot)| Some((places[row]?, column, of_rows.values[slot]))));
    for (k, (row, column, value)) in all.enumerate().take(count as usize) {
        unsafe {
            if values.is_null() {
                (*rows.add(k), *columns.add(k)) = (row as c_int, column as c_int);
            } else {
                *values.add(k) = value;
            }
        }
    }
    true
}

extern "C" fn curvature(
    _: c_int,
    x: *const f64,
    _: bool,
    factor: f64,
    m: c_int,
    multipliers: *const f64,
    _: bool,
    count: c_int,
    rows: *mut c_int,
    columns: *mut c_int,
    values: *mut f64,
    user: *mut c_void,
) -> bool {
    if values.is_null() {
        let seen = unsafe { &mut *user.cast::<Seen<'_>>() };
        for (k, (row, column, _)) in seen.hessian.entries().enumerate() {
            unsafe { (*rows.add(k), *columns.add(k)) = (row as c_int, column as c_int) };
        }
        return true;
    }
    let (seen, given) = unsafe { (at(x, user), std::slice::from_raw_parts(multipliers, m as usize)) };
    let me = seen.here.equalities.len();
    let mut nu = vec![0.0; seen.here.inequalities.len()];
    seen.rows.iter().zip(&given[me..]).for_each(|(&row, lambda)| nu[row] = -lambda);
    let lambda = Multipliers { equalities: &given[..me], inequalities: &nu };
    seen.problem.hessian(&seen.here.x, lambda, Curvature::Exact, &mut seen.hessian);
    let (no_lambda, no_nu) = (vec![0.0; me], vec![0.0; nu.len()]);
    let none = Multipliers { equalities: &no_lambda, inequalities: &no_nu };
    seen.problem.hessian(&seen.here.x, none, Curvature::Exact, &mut seen.objective_hessian);
    let out = unsafe { std::slice::from_raw_parts_mut(values, count as usize) };
    let both = seen.hessian.values.iter().zip(&seen.objective_hessian.values);
    out.iter_mut().zip(both).for_each(|(out, (h, f))| *out = h - (1.0 - factor) * f);
    true
}

extern "C" fn progress(
    _: c_int,
    iteration: c_int,
    _: f64,
    _: f64,
    _: f64,
    _: f64,
    _: f64,
    _: f64,
    _: f64,
    _: f64,
    _: c_int,
    user: *mut c_void,
) -> bool {
    unsafe { (*user.cast::<Seen<'_>>()).iterations = iteration as usize };
    true
}
