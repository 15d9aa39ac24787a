//! Cost of a solve and of its parts. `cargo bench --bench solver -- [part of a name]`
//!
//! Uses the arm of Table 1 with the default scheme (Radau, 3 stages, about 20 p unknowns), bounds a ≥ 0 and μ = 0.2.
//! Parts are timed at the start guess: `evaluation` evaluates c, d, both Jacobians and ∇²L once, `factorisation`
//! factorises the KKT matrix once, `qp` solves one sub-problem by its active set, and `rank` counts both deficiencies.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use divan::{Bencher, black_box};
use sinew::internals::deadline::Deadline;
use sinew::internals::nlp::curvature::Model;
use sinew::internals::nlp::iterate::Iterate;
use sinew::internals::nlp::kkt::{Kkt, Rows};
use sinew::internals::nlp::options::SqpOptions;
use sinew::internals::nlp::problem::{Curvature, Problem};
use sinew::internals::nlp::regularity::RankCounter;
use sinew::internals::nlp::sqp;
use sinew::internals::nlp::state::State;
use sinew::internals::nlp::subproblem::active_set::{self, Ceiling};
use sinew::internals::nlp::subproblem::interior_point::{self, Manner};
use sinew::internals::nlp::subproblem::qp::QuadraticProgramme;
use sinew::internals::numerics::sparse::Sparse;
use sinew::internals::prepare::{Prepared, Task};
use sinew::internals::run::{RunOptions, run};
use sinew::internals::settings::RegularityMode;
use sinew::internals::solve::solve;
use sinew::internals::study::Study;
use sinew::internals::transcription::collocation::Collocation;

const POINTS: [usize; 6] = [6, 11, 51, 101, 501, 1001];
/// Values of δ used in turn: parts of the matrix that have not changed would not be factorised again.
const IN_TURN: [f64; 2] = [1e-2, 2e-2];

fn main() {
    divan::main();
}

fn study(name: &str) -> Study {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("studies").join(name);
    Study::load(&path).unwrap_or_else(|e| panic!("{:?}", miette::Report::new(e)))
}

/// Calls `then` with the job on `points` points.
fn with_job(points: usize, then: impl FnOnce(&Prepared<'_>)) {
    let study = study("mesh.toml");
    let settings = &study.jobs.iter().find(|job| job.points == points).expect("one of the mesh study").settings;
    let task = Task { model: &study.model, motion: &study.motion, settings, points };
    then(&Prepared::new(task, Deadline::default()).expect("a job of a shipped study"));
}

/// Calls `then` with the problem on `points` points and its start guess.
fn with_problem(points: usize, then: impl FnOnce(&Collocation<'_>, Vec<f64>)) {
    with_job(points, |job| then(&job.transcribe(), job.guess(Deadline::default()).unwrap()));
}

/// The exact Hessian and the metric at a point.
fn curvatures(problem: &Collocation<'_>, here: &Iterate) -> [Sparse; 2] {
    let [mut hessian, mut metric] = [0, 1].map(|_| problem.patterns()[2].clone());
    problem.hessian(&here.x, here.multipliers(), Curvature::Exact, &mut hessian);
    problem.metric(&here.x, &mut metric);
    [hessian, metric]
}

/// Transcription, start guess, SQP, polishing: everything except the ranks.
#[divan::bench(args = POINTS, sample_count = 3)]
fn whole_job(bencher: Bencher, points: usize) {
    let mut study = study("mesh.toml");
    let job = study.jobs.iter_mut().find(|job| job.points == points).unwrap();
    job.settings.regularity = RegularityMode::Off;
    let (settings, points) = (job.settings.clone(), job.points);
    bencher.bench_local(|| solve(&study.model, &study.motion, black_box(&settings), points));
}

#[divan::bench(args = POINTS, sample_count = 3)]
fn sqp_only(bencher: Bencher, points: usize) {
    with_problem(points, |problem, guess| {
        bencher.bench_local(|| sqp::solve(problem, guess.clone(), SqpOptions::default()).iterations());
    });
}

#[divan::bench(args = POINTS)]
fn evaluation(bencher: Bencher, points: usize) {
    with_problem(points, |problem, guess| {
        let mut here = Iterate::new(problem, guess);
        let mut hessian = problem.patterns()[2].clone();
        bencher.bench_local(|| {
            here.evaluate(problem);
            here.differentiate(problem);
            problem.hessian(&here.x, here.multipliers(), Curvature::Exact, &mut hessian);
        });
    });
}

#[divan::bench(args = POINTS)]
fn factorisation(bencher: Bencher, points: usize) {
    with_problem(points, |problem, guess| {
        let here = Iterate::new(problem, guess);
        let [hessian, metric] = curvatures(problem, &here);
        let mut kkt = Kkt::new(problem);
        let active = vec![false; here.inequalities.len()];
        let mut damping = IN_TURN[0];
        bencher.bench_local(|| {
            damping = IN_TURN[0] + IN_TURN[1] - damping;
            kkt.factorise(&here.system((&hessian, &metric), damping, Rows::Active(&active)))
        });
    });
}

/// One sub-problem at the solution, starting from the active set there.
#[divan::bench(args = POINTS, sample_count = 10)]
fn qp(bencher: Bencher, points: usize) {
    with_problem(points, |problem, guess| {
        let options = SqpOptions::default();
        let here = sqp::solve(problem, guess, options).iterate;
        let active = sinew::internals::nlp::polish::active(&here.inequalities);
        let mut kkt = Kkt::new(problem);
        let mut state = State::new(&mut kkt, problem, here, options.progress);
        let ceiling = Ceiling { most: options.damping.exact, is_in_doubt: false };
        let mut damping = IN_TURN[0];
        bencher.bench_local(|| {
            damping = IN_TURN[0] + IN_TURN[1] - damping;
            active_set::solve(&mut state, &options, 1e-4 * damping, ceiling, &active).is_ok()
        });
    });
}

/// The convex sub-problem at the start guess by the own interior point, to its end.
#[divan::bench(args = POINTS, sample_count = 5)]
fn convex_qp(bencher: Bencher, points: usize) {
    with_problem(points, |problem, guess| {
        let options = SqpOptions::default();
        let here = Iterate::new(problem, guess);
        let mut kkt = Kkt::new(problem);
        let mut state = State::new(&mut kkt, problem, here, options.progress);
        state.models.begin(&state.here.x.clone());
        let manner = Manner { most: 1.0, tolerance: 1e-9, steps: 40, is_plain: true };
        bencher.bench_local(|| {
            interior_point::solve(&mut state, &options, Model::GaussNewton, 1.0, manner, &mut None).is_ok()
        });
    });
}

/// The same by Clarabel.
#[divan::bench(args = POINTS, sample_count = 5)]
fn convex_qp_by_clarabel(bencher: Bencher, points: usize) {
    with_problem(points, |problem, guess| {
        let here = Iterate::new(problem, guess);
        let [mut hessian, metric] = curvatures(problem, &here);
        hessian.values.iter_mut().zip(&metric.values).for_each(|(h, d)| *h += d);
        let programme = QuadraticProgramme {
            hessian: &hessian,
            gradient: &here.gradient,
            equalities: &here.equality_jacobian,
            equality_values: &here.equalities,
            inequalities: &here.inequality_jacobian,
            inequality_values: &here.inequalities,
            deadline: Deadline::default(),
        };
        bencher.bench_local(|| programme.solve().is_ok());
    });
}

#[divan::bench(args = POINTS, sample_count = 3)]
fn rank(bencher: Bencher, points: usize) {
    with_problem(points, |problem, guess| {
        let here = Iterate::new(problem, guess);
        let mut counter = RankCounter::new(problem);
        bencher.bench_local(|| counter.deficiencies(&here, &[]));
    });
}

/// The sparsity patterns, and the position of each derivative in them.
#[divan::bench(args = POINTS, sample_count = 10)]
fn transcription(bencher: Bencher, points: usize) {
    with_job(points, |job| bencher.bench_local(|| job.transcribe()));
}

/// Elimination order of the KKT matrix.
#[divan::bench(args = POINTS, sample_count = 10)]
fn symbolic(bencher: Bencher, points: usize) {
    with_problem(points, |problem, _| {
        bencher.bench_local(|| Kkt::new(problem).order());
    });
}

#[divan::bench(args = POINTS, sample_count = 10)]
fn guess(bencher: Bencher, points: usize) {
    with_job(points, |job| bencher.bench_local(|| job.guess(Deadline::default())));
}

fn run_study(study: &Study, threads: usize) {
    let folder = tempfile::tempdir().unwrap();
    let options =
        RunOptions { out: folder.path().to_owned(), threads: Some(threads), fresh: true, ..RunOptions::default() };
    run(study, &options, &AtomicBool::new(false)).unwrap();
}

/// Table 1 as shipped: 12 jobs, ranks at every iteration.
#[divan::bench(sample_count = 3)]
fn table1(bencher: Bencher) {
    let study = study("table1.toml");
    bencher.bench_local(|| run_study(&study, 1));
}

/// The 12 jobs with ranks at the optimum only.
#[divan::bench(sample_count = 3)]
fn table1_ranks_at_optimum(bencher: Bencher) {
    let mut study = study("table1.toml");
    for job in &mut study.jobs {
        job.settings.regularity = RegularityMode::Optimum;
    }
    bencher.bench_local(|| run_study(&study, 1));
}

/// 1,000 jobs of the arm over μ at h = 0.1.
#[divan::bench(args = [1, 2], sample_count = 1)]
fn sweep_of_1000(bencher: Bencher, threads: usize) {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("data");
    let text = format!(
        "name = \"sweep\"\nmodel = \"{0}/models/arm.toml\"\nmotion = \"{0}/motions/arm_curl.csv\"\n\
         [base]\nh = 0.1\nregularity = \"optimum\"\n\
         [sweep.grid]\nmu = {{ from = 0.01, to = 10.0, count = 1000, scale = \"log\" }}\n",
        data.display()
    );
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sweep.toml");
    std::fs::write(&path, text).unwrap();
    let study = Study::load(&path).unwrap_or_else(|e| panic!("{:?}", miette::Report::new(e)));
    bencher.bench_local(|| run_study(&study, threads));
}
