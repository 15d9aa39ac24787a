//! The engine around the solver: threads, panics, resumed runs, failures as rows.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use sinew::internals::outcome::{Outcome, Status};
use sinew::internals::run::{Ended, RunOptions, run, run_with, task};
use sinew::internals::solve::{solve, solve_from};
use sinew::internals::study::{Job, Study};
use sinew::internals::tables::{Table, Values, read, schema};
use sinew::internals::warm::Answer;

use super::support::{SMALL, folder, study};

/// All tables of a folder, without the columns of computing times.
pub fn tables(out: &std::path::Path) -> Vec<Table> {
    schema::TABLES
        .into_iter()
        .filter(|name| out.join(format!("{name}.parquet")).exists())
        .map(|name| {
            let mut table = read(name, &out.join(format!("{name}.parquet"))).unwrap();
            table.columns.retain(|(column, _)| !schema::TIMINGS.contains(&column.as_str()));
            table
        })
        .collect()
}

fn options(out: &std::path::Path, threads: usize) -> RunOptions {
    RunOptions { out: out.to_owned(), threads: Some(threads), ..RunOptions::default() }
}

#[test]
fn one_and_four_threads_give_identical_tables() {
    let folder = folder(&[("study.toml", &SMALL.replace("[sweep.grid]", "trajectories = true\n[sweep.grid]"))]);
    let (_, study) = study(&folder);
    let (one, four) = (folder.path().join("one"), folder.path().join("four"));
    run(&study, &options(&one, 1), &AtomicBool::new(false)).unwrap();
    run(&study, &options(&four, 4), &AtomicBool::new(false)).unwrap();
    let (one, four) = (tables(&one), tables(&four));
    assert_eq!(one.len(), 8);
    assert!(one.iter().all(|table| table.rows() > 0));
    assert_eq!(one, four);
}

#[test]
fn a_panic_is_a_row_and_the_others_go_on() {
    let folder = folder(&[("study.toml", SMALL)]);
    let (_, study) = study(&folder);
    let out = folder.path().join("out");
    let report = run_with(&study, &options(&out, 2), &AtomicBool::new(false), &|study, job, before| {
        assert!(job.index != 2, "job number {}", job.index);
        solve_from(task(study, job, &study.model_of(job).unwrap()), before)
    })
    .unwrap();
    assert_eq!((report.finished, report.failed), (6, 1));
    let jobs = read("jobs", &out.join("jobs.parquet")).unwrap();
    assert_eq!(jobs.text("status", 2), Some("panicked"));
    assert!(jobs.text("error", 2).unwrap().contains("job number 2"));
    assert_eq!(jobs.text("status", 3), Some("converged"));
}

#[test]
fn a_run_goes_on_where_it_was_cut_off() {
    let folder = folder(&[("study.toml", SMALL)]);
    let (_, study) = study(&folder);
    let (whole, cut) = (folder.path().join("whole"), folder.path().join("cut"));
    run(&study, &options(&whole, 1), &AtomicBool::new(false)).unwrap();

    // Stopped after two jobs, as by Ctrl-C.
    let (stop, done) = (AtomicBool::new(false), AtomicUsize::new(0));
    let count = |study: &Study, job: &Job, before: Option<&Answer>| {
        if done.fetch_add(1, Ordering::Relaxed) + 1 == 2 {
            stop.store(true, Ordering::Relaxed);
        }
        solve_from(task(study, job, &study.model_of(job).unwrap()), before)
    };
    let report = run_with(&study, &options(&cut, 1), &stop, &count).unwrap();
    assert_eq!((report.ended, report.finished), (Ended::Interrupted, 2));
    assert_eq!(read("jobs", &cut.join("jobs.parquet")).unwrap().rows(), 2);

    // The last line is cut in half, as by a kill: that job runs again, the other one is kept.
    let store = cut.join("finished.jsonl");
    let text = std::fs::read(&store).unwrap();
    std::fs::write(&store, &text[..text.len() - 100]).unwrap();
    let report = run(&study, &options(&cut, 2), &AtomicBool::new(false)).unwrap();
    assert_eq!((report.kept, report.finished, report.ended), (1, 6, Ended::Complete));
    assert_eq!(tables(&whole), tables(&cut));

    // Once more: nothing left to do.
    let report =
        run_with(&study, &options(&cut, 2), &AtomicBool::new(false), &|_, _, _| panic!("nothing to do")).unwrap();
    assert_eq!((report.kept, report.failed), (6, 0));
}

#[test]
fn failing_jobs_are_rows_with_a_status_and_a_reason() {
    // Three jobs: a normal one; one with only two SQP iterations; a loop of links that cannot close.
    let pedal = std::fs::read_to_string(super::support::root().join("data/models/pedal.toml")).unwrap();
    let text = r#"
name = "failures"
confirm = ["joint.pedal.child_point.0"]
model = "pedal.toml"
motion = "{root}/data/motions/pedal_turn.csv"
[base]
h = 0.2
[sweep.zip]
max_iterations = [300, 2, 300]
"joint.pedal.child_point.0" = [0.17, 0.17, 3.0]
"#;
    let folder = folder(&[("study.toml", text), ("pedal.toml", &pedal)]);
    let (_, study) = study(&folder);
    let out = folder.path().join("out");
    let report = run(&study, &options(&out, 2), &AtomicBool::new(false)).unwrap();
    assert_eq!((report.finished, report.failed), (3, 2));
    let jobs = read("jobs", &out.join("jobs.parquet")).unwrap();
    assert_eq!(jobs.text("status", 0), Some("converged"));
    assert_eq!(jobs.text("error", 0), None);
    assert_eq!(jobs.text("status", 1), Some("iteration_limit"));
    assert!(jobs.text("error", 1).unwrap().contains("2 SQP iterations"));
    assert_eq!(jobs.text("status", 2), Some("infeasible"));
    assert!(jobs.text("error", 2).unwrap().contains("pedal"), "{:?}", jobs.text("error", 2));
    assert_eq!(jobs.number("objective", 2), None, "missing is null");
}

#[test]
fn a_weak_muscle_is_no_failure_but_a_remark() {
    let text = r#"
name = "weak"
model = "{root}/data/models/arm.toml"
motion = "{root}/data/motions/arm_curl.csv"
[base]
h = 0.2
mu = 0.02
[sweep.zip]
"muscle.biceps.max_isometric_force_scale" = [0.1]
"muscle.brachialis.max_isometric_force_scale" = [0.1]
"#;
    let folder = folder(&[("study.toml", text)]);
    let (_, study) = study(&folder);
    let job = &study.jobs[0];
    let outcome = solve(&study.model_of(job).unwrap(), &study.motion, &job.settings, job.points);
    assert_eq!(outcome.job.status, Status::Converged, "{:?}", outcome.job.error);
    assert!(outcome.job.warnings.unwrap().contains("saturated"));
    let remark = outcome.job.remark.unwrap();
    assert!(["biceps", "brachialis"].iter().any(|muscle| remark.contains(muscle)), "{remark}");
}

#[test]
fn several_starts_keep_the_best() {
    let text = SMALL.replace("[sweep.grid]", "starts = 4\n[sweep.grid]");
    let folder = folder(&[("study.toml", &text)]);
    let (_, study) = study(&folder);
    let job = &study.jobs[3];
    let model = study.model_of(job).unwrap();
    let many = solve(&model, &study.motion, &job.settings, job.points);
    let mut single = job.settings.clone();
    single.starts = 1;
    let one = solve(&model, &study.motion, &single, job.points);
    assert!(many.job.objective.unwrap() <= one.job.objective.unwrap() * (1.0 + 1e-9));
    assert_eq!(many.job.n_starts, Some(4));
    assert!(many.job.n_distinct_optima.unwrap() >= 1);
    assert!(many.job.n_distinct_optima <= many.job.n_converged_starts);
    assert_eq!(many.optima.iter().map(|optimum| optimum.starts).sum::<i64>(), many.job.n_converged_starts.unwrap());
    assert!(many.optima.is_sorted_by(|a, b| a.objective <= b.objective));
    assert!(many.optima.iter().all(|optimum| optimum.deficiency_a.is_some()));
}

#[test]
fn job_ids_depend_on_content_only() {
    let renamed = SMALL.replace("\"small\"", "\"another\"").replace("[base]", "# a remark\n[base]");
    let changed = SMALL.replace("h = 0.2", "h = 0.1");
    let ids = |text: &str| {
        let folder = folder(&[("study.toml", text)]);
        study(&folder).1.jobs.iter().map(|job| job.id.clone()).collect::<Vec<_>>()
    };
    assert_eq!(ids(SMALL), ids(&renamed));
    assert!(ids(SMALL).iter().zip(ids(&changed)).all(|(a, b)| *a != b));
}

#[test]
fn missing_values_are_null_never_nan() {
    let folder = folder(&[("study.toml", SMALL)]);
    let (_, study) = study(&folder);
    let out = folder.path().join("out");
    run(&study, &options(&out, 2), &AtomicBool::new(false)).unwrap();
    for table in tables(&out) {
        for (name, values) in &table.columns {
            if let Values::Number(values) = values {
                assert!(values.iter().flatten().all(|v| v.is_finite()), "{} {name}", table.name);
            }
        }
    }
}

#[test]
fn a_swept_value_replaces_the_fixed_one() {
    let text = SMALL.replace(
        "[sweep.grid]",
        "\"muscle.triceps.max_isometric_force_scale\" = 1.2\n\"muscle.biceps.max_isometric_force\" = 500\n\
         [sweep.grid]\n\"muscle.triceps.max_isometric_force_scale\" = [0.5]\n\
         \"muscle.biceps.max_isometric_force\" = [100.0]",
    );
    let folder = folder(&[("study.toml", &text)]);
    let (_, study) = study(&folder);
    let model = study.model_of(&study.jobs[0]).unwrap();
    let strength = |name: &str| model.muscles.iter().find(|m| m.name == name).unwrap().max_isometric_force;
    assert_eq!((strength("triceps"), strength("biceps")), (150.0, 100.0), "300 N in the file");
}

/// The tables contain the swept value, so with a factor in the base they would not show the value that was used.
#[test]
fn one_number_is_set_in_one_way() {
    let (absolute, factor) = ("'muscle.biceps.max_isometric_force'", "'muscle.biceps.max_isometric_force_scale'");
    for (base, swept) in [
        (format!("{absolute} = 500"), format!("{factor} = [1.0, 2.0]")),
        (format!("{factor} = 2.0"), format!("{absolute} = [500]")),
        (format!("{absolute} = 500\n{factor} = 2.0"), String::new()),
    ] {
        let text = SMALL.replace("[sweep.grid]", &format!("{base}\n[sweep.grid]\n{swept}"));
        let folder = folder(&[("study.toml", &text)]);
        let error = Study::load(&folder.path().join("study.toml")).map(|_| ()).unwrap_err();
        assert!(error.to_string().contains("as a value and by a factor"), "{base}, {swept}: {error}");
    }
}

#[test]
fn neighbours_start_from_one_another_and_a_cut_off_block_ends_alike() {
    let text = SMALL.replace("h = 0.2", "h = 0.2\nwarm_start = 'neighbour'").replace(
        "mu = [0.1, 0.2, 0.4]\nbounds = [\"activation\", \"both\"]",
        "bounds = [\"activation\", \"both\"]\nmu = [0.1, 0.15, 0.2, 0.3]",
    );
    let folder = folder(&[("study.toml", &text)]);
    let (_, study) = study(&folder);
    let from = |i: usize| study.jobs[i].warm_start_from.as_deref();
    assert_eq!((from(0), from(1), from(4)), (None, Some(study.jobs[0].id.as_str()), None));
    let (whole, cut) = (folder.path().join("whole"), folder.path().join("cut"));
    run(&study, &options(&whole, 2), &AtomicBool::new(false)).unwrap();
    let jobs = read("jobs", &whole.join("jobs.parquet")).unwrap();
    assert_eq!(jobs.text("warm_start_from", 2), from(2));
    assert_eq!(jobs.text("warm_start_from", 4), None);
    let iterations = |i: usize| jobs.integer("iterations", i).unwrap();
    let warm: i64 = [1, 2, 3, 5, 6, 7].into_iter().map(iterations).sum();
    assert!(warm <= 6 * 6, "{warm} iterations in six warm starts");
    // Run the second half of each block again: the preceding answers are recomputed.
    std::fs::create_dir(&cut).unwrap();
    let lines = std::fs::read_to_string(whole.join("finished.jsonl")).unwrap();
    let is = |line: &str, i: usize| line.contains(&format!("\"job_id\":\"{}\"", study.jobs[i].id));
    let kept: Vec<&str> = lines.lines().filter(|line| [0, 1, 4].iter().any(|&i| is(line, i))).collect();
    let kept = kept.join("\n") + "\n";
    std::fs::write(cut.join("finished.jsonl"), kept).unwrap();
    let report = run(&study, &options(&cut, 1), &AtomicBool::new(false)).unwrap();
    assert_eq!((report.kept, report.finished), (3, 8));
    assert_eq!(tables(&whole), tables(&cut));
}

#[test]
fn two_runs_do_not_share_a_folder() {
    let folder = folder(&[("study.toml", SMALL)]);
    let (_, study) = study(&folder);
    let out = folder.path().join("out");
    let inner = std::sync::Mutex::new(None);
    run_with(&study, &options(&out, 1), &AtomicBool::new(false), &|study, job, _| {
        if job.index == 0 {
            let second = run(study, &options(&out, 1), &AtomicBool::new(false));
            *inner.lock().unwrap() = Some(second.unwrap_err().to_string());
        }
        (Outcome::failed(Status::Invalid, "not solved in this test"), None)
    })
    .unwrap();
    assert!(inner.into_inner().unwrap().unwrap().contains("another run is using"));
}
