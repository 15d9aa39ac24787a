//! Reserves and actuators: what they carry, against closed forms; their ranks.

use rand::{RngExt, SeedableRng};
use sinew::internals::deadline::Deadline;
use sinew::internals::methods::prediction::{Setting, predict};
use sinew::internals::model::Model;
use sinew::internals::model::file::ModelFile;
use sinew::internals::nlp::iterate::Iterate;
use sinew::internals::nlp::regularity;
use sinew::internals::outcome::{Outcome, Status};
use sinew::internals::run::{RunOptions, run};
use sinew::internals::settings::{Bounds, RegularityMode, Scheme};
use sinew::internals::solve::solve;

use super::support::{folder, model, motion, muscle, prepare, root, settings};

/// The arm with a twentieth of its strength.
fn weak_arm() -> Model {
    let mut arm = model("arm.toml");
    arm.muscles.iter_mut().for_each(|muscle| muscle.max_isometric_force /= 20.0);
    arm
}

fn solved(model: &Model, reserves: f64) -> Outcome {
    let settings = settings(|s| {
        (s.scheme, s.stages, s.h, s.bounds) = (Scheme::Radau, 2, 0.05, Bounds::BothBoxed);
        (s.regularity, s.trajectories, s.reserves) = (RegularityMode::Optimum, true, reserves);
    });
    solve(model, &motion("arm_curl.csv", model), &settings, 21)
}

#[test]
fn a_weak_arm_tracks_its_motion_with_reserves_and_says_what_they_carry() {
    let arm = weak_arm();
    let (without, with) = (solved(&arm, 0.0), solved(&arm, 5.0));
    for outcome in [&without, &with] {
        assert_eq!(outcome.job.status, Status::Converged, "{:?}", outcome.job.error);
    }
    assert!(without.job.tracking_rms_m.unwrap() > 0.03 && without.reserves.is_empty());
    assert_eq!(without.job.actuator_effort, None);
    assert!(with.job.tracking_rms_m.unwrap() < 0.005, "{:?}", with.job.tracking_rms_m);
    assert!(with.job.actuator_effort.unwrap() > 0.0);
    assert_eq!(with.reserves.len(), 2);
    assert!(with.reserves.iter().all(|row| row.is_reserve && row.share.unwrap() > 0.5), "{:?}", with.reserves);
    assert!(with.job.warnings.as_ref().unwrap().contains("reserves"));
    let regularity = with.regularity.unwrap();
    assert_eq!((regularity.prediction_agrees, regularity.answer_unique), (Some(true), Some(true)));
}

/// The moment that the solution's motion needs at the elbow, by the forearm's balance of momentum about the elbow, and what
/// muscles and reserve make there.
#[test]
fn muscles_and_reserve_make_the_moment_of_inverse_dynamics() {
    let arm = weak_arm();
    let outcome = solved(&arm, 5.0);
    let at = |signal: &str, name: &str| -> Vec<(f64, f64)> {
        let rows = outcome.trajectories.iter().filter(|row| row.signal == signal && row.name == name);
        rows.map(|row| (row.time_s, row.value)).collect()
    };
    let planar = arm.planar().unwrap();
    let forearm = &planar.bodies[1];
    let reserve = at("actuator_moment_n_m", "reserve.elbow_angle");
    assert!(reserve.len() > 30);
    let [x, y, turn] = ["x", "y", "angle"].map(|axis| at("acceleration", &format!("{}.{axis}", forearm.name)));
    let angles = ["shoulder_angle", "elbow_angle"].map(|name| at("joint_coordinate", name));
    for (k, &(t, moment)) in reserve.iter().enumerate() {
        let angle = |joint: usize| angles[joint].iter().find(|(time, _)| *time == t).unwrap().1;
        let q = planar.assemble(&[Some(angle(0)), Some(angle(1))], None).unwrap();
        // About the elbow, at −(centre of mass) in the forearm's axes.
        let (sin, cos) = q[5].sin_cos();
        let [cx, cy] = forearm.centre_of_mass;
        let arm_to_centre = [cos * cx - sin * cy, sin * cx + cos * cy];
        let force = [forearm.mass * x[k].1, forearm.mass * (y[k].1 + 9.81)];
        let needed = forearm.inertia * turn[k].1 + arm_to_centre[0] * force[1] - arm_to_centre[1] * force[0];
        let muscles: f64 = (arm.muscles.iter())
            .map(|muscle| {
                let length = |e: f64| {
                    let q = planar.assemble(&[Some(angle(0)), Some(angle(1) + e)], None).unwrap();
                    let mut path = muscle.path.buffer();
                    muscle.path.length(&q, false, &mut path);
                    path.value
                };
                let force = at("force_n", &muscle.name).iter().find(|(time, _)| *time == t).unwrap().1;
                -force * (length(1e-6) - length(-1e-6)) / 2e-6
            })
            .sum();
        assert!((muscles + moment - needed).abs() < 1e-4, "{t} s: {muscles} + {moment} of {needed} N m");
    }
}

#[test]
fn ranks_count_reserves() {
    let arm = model("arm.toml");
    let table = motion("arm_curl.csv", &arm);
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(10);
    for (scheme, stages, mu) in
        [(Scheme::Midpoint, 1, 0.2), (Scheme::Radau, 1, 0.2), (Scheme::Radau, 2, 0.2), (Scheme::Radau, 1, 0.0)]
    {
        let settings = settings(|s| {
            (s.scheme, s.stages, s.mu, s.reserves) = (scheme, stages, mu, 5.0);
            s.bounds = if mu > 0.0 { Bounds::Both } else { Bounds::None };
        });
        let prepared = prepare(&arm, &table, &settings, 5);
        let (inverse, problem) = (&prepared.inverse, prepared.transcribe());
        let mut x = prepared.guess(Deadline::default()).unwrap();
        x.iter_mut().for_each(|v| *v += rng.random_range(-0.02..0.02));
        let places = prepared.scheme.coefficients();
        for m in 0..arm.muscles.len() {
            for k in 0..places.count(inverse.muscles.activation) {
                x[places.index(inverse.muscles.activation, k, m)] = rng.random_range(0.1..0.6);
                x[places.index(inverse.muscles.fibre_length.unwrap(), k, m)] = 1.0 + 0.002 * (k * k) as f64;
            }
        }
        let active: Vec<usize> =
            (0..problem.bounds.len()).filter(|_| mu > 0.0 && rng.random_range(0.0..1.0) < 0.2).collect();
        let iterate = Iterate::new(&problem, x);
        let predicted = predict(
            inverse,
            &problem,
            &iterate.x,
            &active,
            &Setting::new(inverse, problem.scheme, &prepared.measurement, &settings),
        );
        let found = regularity::analyse_dense(&problem, &iterate, &active).unwrap();
        let case = format!("{scheme:?}, {stages} stages, μ = {mu}");
        assert_eq!((Some(found.a.deficiency), Some(found.aj.deficiency)), (predicted.a, predicted.aj), "{case}");
    }
}

/// A motor that is strong and one that reaches its bound.
#[test]
fn actuators_of_a_model_keep_their_bounds() {
    let text = std::fs::read_to_string(root().join("data/models/arm.toml")).unwrap();
    let motor = |bound: f64| {
        let entry = format!(
            "\n[[actuator]]\nname = \"motor\"\ncoordinate = \"elbow_angle\"\noptimal_force = 2.0\n\
             max_control = {bound:?}\n"
        );
        let model = toml::from_str::<ModelFile>(&(text.clone() + &entry)).unwrap().check().unwrap();
        let outcome = solved(&model, 0.0);
        assert_eq!(outcome.job.status, Status::Converged, "{:?}", outcome.job.error);
        assert!(!outcome.reserves[0].is_reserve && outcome.reserves[0].actuator == "motor");
        let force = |name: &str| outcome.muscles[muscle(&model, name)].mean_force_n;
        (outcome.reserves[0].peak_moment_n_m.unwrap(), force("brachialis"))
    };
    let ((strong, relieved), (bounded, loaded)) = (motor(5.0), motor(0.02));
    assert!(strong > 0.1 && (bounded - 0.04).abs() < 1e-6, "{strong} {bounded}");
    assert!(relieved < loaded, "{relieved} {loaded}");
}

#[test]
fn mistakes_are_told_apart() {
    let study = |model: &str, line: &str| {
        let motion = if model == "arm" { "arm_curl" } else { "double_poling" };
        let text = format!(
            "name = \"s\"\nmodel = \"{{root}}/data/models/{model}.toml\"\n\
             motion = \"{{root}}/data/motions/{motion}.csv\"\n[base]\n{line}\n"
        );
        let folder = folder(&[("study.toml", &text)]);
        let error = sinew::internals::study::Study::load(&folder.path().join("study.toml")).unwrap_err();
        super::cli::said(error)
    };
    let range = "[sweep.grid]\nreserves = { from = 1.0, to = 5.0, count = 3 }";
    let text = format!(
        "name = \"s\"\nmodel = \"{{root}}/data/models/arm.toml\"\nmotion = \"{{root}}/data/motions/arm_curl.csv\"\n{range}\n"
    );
    assert_eq!(super::support::study(&folder(&[("study.toml", &text)])).1.jobs.len(), 3);
    assert!(study("arm", "[sweep.grid]\nreserves.elbow_angle = [0, 5]").contains("\"reserves.elbow_angle\""));
    let said = study("arm", "reserves = { elbow_angel = 2.0 }");
    assert!(said.contains("elbow_angel") && said.contains("elbow_angle"), "{said}");
    assert!(study("arm", "reserves = -1").contains("N m"));
    assert!(study("arm", "reserves = 5\nmu = 0").contains("arbitrary"));
    assert!(study("arm", "effort_power = 3\nbounds = \"excitation\"").contains("a ≥ 0"));
}

/// The reserves of neighbouring jobs differ, and with them the unknowns: functions are found by name.
#[test]
fn a_warm_start_from_other_reserves_finds_its_functions_by_name() {
    let text = |warm: &str| {
        format!(
            "name = \"s\"\nmodel = \"{{root}}/data/models/arm.toml\"\nmotion = \"{{root}}/data/motions/arm_curl.csv\"\n[base]\n\
             h = 0.1\nstages = 2\nregularity = \"off\"\nwarm_start = \"{warm}\"\n\"reserves.elbow_angle\" = 5.0\n\
             [sweep.grid]\n\"reserves.shoulder_angle\" = [0, 5, 0.5]\n"
        )
    };
    let objectives = |warm: &str| -> Vec<f64> {
        let folder = folder(&[("study.toml", &text(warm))]);
        let (_, study) = super::support::study(&folder);
        let out = folder.path().join("out");
        let options = RunOptions { out: out.clone(), threads: Some(1), ..RunOptions::default() };
        run(&study, &options, &false.into()).unwrap();
        let table = sinew::internals::tables::read("jobs", &out.join("jobs.parquet")).unwrap();
        (0..table.rows()).map(|row| table.number("objective", row).unwrap()).collect()
    };
    let (cold, warm) = (objectives("off"), objectives("neighbour"));
    assert_eq!(cold.len(), 3);
    assert!(cold.iter().zip(&warm).all(|(a, b)| (a / b - 1.0).abs() < 1e-6), "{cold:?} {warm:?}");
}

/// A crank has joints that close a loop, where no net moment belongs to one coordinate.
#[test]
fn a_reserve_whose_share_is_unknown_has_a_warning() {
    let model = model("pedal.toml");
    let settings = settings(|s| (s.scheme, s.stages, s.reserves) = (Scheme::Radau, 1, 1.0));
    let motion = motion("pedal_turn.csv", &model);
    let points = settings.points(motion.duration()).unwrap();
    let outcome = solve(&model, &motion, &settings, points);
    assert_eq!(outcome.job.status, Status::Converged, "{:?}", outcome.job.error);
    assert!(outcome.reserves.iter().all(|row| row.share.is_none()));
    assert!(outcome.job.remark.unwrap().contains("unknown share"));
}
