//! Inverse methods beside the thesis' own: each answer is checked by code that did not produce it.

use rand::{RngExt, SeedableRng};
use sinew::internals::curves::{ActivationDynamics, MuscleCurves};
use sinew::internals::deadline::Deadline;
use sinew::internals::methods::given_motion::{GivenMotion, Instant};
use sinew::internals::model::Model;
use sinew::internals::motion::MotionTable;
use sinew::internals::outcome::{MuscleRow, Outcome, Status};
use sinew::internals::recruitment::{Criterion as Recruited, Programme, Term};
use sinew::internals::settings::{
    Bounds, Criterion, EffortOf, EffortWeight, Initial, Method, MuscleDynamics, RegularityMode, Scheme, Settings,
};
use sinew::internals::solve::solve;
use sinew::internals::study::Study;

use super::cli::{one_line, said, sinew, text};
use super::support::{check_derivatives, folder, model, motion, prepare, random_instant, shared, study};

fn arm() -> (Model, MotionTable) {
    let model = model("arm.toml");
    let table = motion("arm_curl.csv", &model);
    (model, table)
}

/// Settings on the arm with h = 0.1.
fn with(change: impl FnOnce(&mut Settings)) -> Settings {
    let mut settings =
        Settings { h: 0.1, stages: 2, regularity: RegularityMode::Optimum, trajectories: true, ..Settings::default() };
    change(&mut settings);
    settings
}

const KINDS: [(Method, MuscleDynamics, EffortOf); 8] = [
    (Method::Dynamic, MuscleDynamics::Full, EffortOf::Activation),
    (Method::Dynamic, MuscleDynamics::Force, EffortOf::Activation),
    (Method::Static, MuscleDynamics::Full, EffortOf::Activation),
    (Method::Static, MuscleDynamics::Force, EffortOf::Force),
    (Method::Prescribed, MuscleDynamics::Full, EffortOf::Activation),
    (Method::Prescribed, MuscleDynamics::Full, EffortOf::Excitation),
    (Method::Prescribed, MuscleDynamics::RigidTendon, EffortOf::Excitation),
    (Method::Prescribed, MuscleDynamics::RigidTendon, EffortOf::Activation),
];

/// The model with curves of a family, and what goes with them: pennation, damping, activation dynamics, a physiological v_max.
fn with_curves(model: &Model, family: MuscleCurves) -> Model {
    let mut model = model.clone();
    for muscle in model.muscles.iter_mut().filter(|_| family != MuscleCurves::Thesis) {
        (muscle.pennation_angle, muscle.damping, muscle.max_shortening_velocity) = (0.3, 0.05, 10.0);
        muscle.activation.family = ActivationDynamics::DegrooteFregly2016;
        muscle.set_curves(family);
    }
    model
}

fn outcome_of(model: &Model, table: &MotionTable, settings: &Settings) -> Outcome {
    solve(model, table, settings, settings.points(table.duration()).unwrap())
}

fn signal(outcome: &Outcome, signal: &str, name: &str) -> Vec<(f64, f64)> {
    let rows = outcome.trajectories.iter().filter(|row| row.signal == signal && row.name == name);
    rows.map(|row| (row.time_s, row.value)).collect()
}

#[test]
fn equations_of_every_method_have_their_derivatives() {
    let (model, table) = arm();
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(5);
    let models: Vec<Model> = MuscleCurves::VARIANTS.iter().map(|&family| with_curves(&model, family)).collect();
    for (model, (method, dynamics, effort)) in models.iter().flat_map(|model| KINDS.map(|kind| (model, kind))) {
        let settings = with(|s| {
            (s.method, s.muscle_dynamics, s.effort_of) = (method, dynamics, effort);
            (s.bounds, s.min_activation) = (Bounds::BothBoxed, 0.02);
        });
        let prepared = prepare(model, &table, &settings, settings.points(table.duration()).unwrap());
        let control = &prepared.inverse.control;
        for t in [0.1, 0.37, 0.8] {
            let mut z = random_instant(&prepared.inverse, &mut rng);
            let given = control.given_at(t);
            z.iter_mut().zip(&given).filter(|(_, given)| **given != 0.0).for_each(|(z, given)| *z = *given);
            let multipliers: Vec<f64> = (0..control.rows()).map(|_| rng.random_range(-1.0..1.0)).collect();
            check_derivatives(control, &z, &multipliers, |_| true, (1e-6, 1e-5));
        }
    }
}

/// The loads of the static method hold in the dynamic method's equations of motion, with the joint reactions found afterwards.
#[test]
fn static_loads_satisfy_the_equations_of_motion() {
    let limb = "name = \"s\"\nmodel = \"{root}/data/models/upper_limb.toml\"\n\
        motion = \"{root}/data/motions/double_poling.csv\"\n[base]\n\"body.clavicle,scapula.role\" = \"GIRDLE\"\nh = 0.1\n\
        method = \"static\"\nmuscle_dynamics = \"force\"\nregularity = \"off\"\nreserves = 20.0\n";
    let pedal = "name = \"s\"\nmodel = \"{root}/data/models/pedal.toml\"\nmotion = \"{root}/data/motions/pedal_turn.csv\"\n\
        [base]\nh = 0.1\nmethod = \"static\"\nmuscle_dynamics = \"force\"\nregularity = \"off\"\n";
    for text in [limb.replace("GIRDLE", "fixed"), limb.replace("GIRDLE", "free"), pedal.to_owned()] {
        let (_, study) = study(&folder(&[("study.toml", &text)]));
        let job = &study.jobs[0];
        let model = study.model_of(job).unwrap();
        let prepared = prepare(&model, &study.motion, &job.settings, job.points);
        let problem = prepared.transcribe();
        let names = prepared.given.as_ref().unwrap().row_names();
        let labels = sinew::internals::methods::Labels { names, clock: 0.0 };
        let found =
            sinew::internals::methods::recruit(&prepared.inverse, &problem, &job.settings, labels, Deadline::default());
        let solved = sinew::internals::solution::Solution {
            inverse: &prepared.inverse,
            problem: &problem,
            measurement: &prepared.measurement,
            iterate: &found.iterate,
        };
        let dynamic = Settings { method: Method::Dynamic, mu: 0.1, ..job.settings.clone() };
        let other = prepare(&model, &study.motion, &dynamic, job.points);
        let (own, control) = (&prepared.inverse, &other.inverse.control);
        for j in [1, 4, problem.points.len() - 1] {
            let z = problem.local(j, &found.iterate.x);
            let mut w = control.given_at(problem.scheme.points()[j]);
            let place = |w: &mut [f64], to: std::ops::Range<usize>, from: &[f64]| w[to].copy_from_slice(from);
            let nq = own.motion.q.count;
            place(&mut w, other.inverse.motion.q.range(), &own.motion.all.of(&z)[..nq]);
            place(&mut w, other.inverse.motion.accelerations.range(), own.motion.accelerations.of(&z));
            if let (Some(to), Some(from)) = (other.inverse.motion.rates, own.motion.rates) {
                place(&mut w, to.range(), from.of(&z));
            }
            place(&mut w, other.inverse.muscles.a.range(), own.muscles.a.of(&z));
            for (to, from) in other.inverse.actuators.iter().zip(&own.actuators) {
                w[to.control] = z[from.control];
            }
            let reactions: Vec<f64> = solved.reactions(&z).iter().map(|r| r / model.weight()).collect();
            place(&mut w, other.inverse.motion.reactions.range(), &reactions);
            let mut residual = vec![0.0; control.rows()];
            control.printed_values(&w, &mut residual);
            for row in other.inverse.motion.equation.range() {
                assert!(residual[row].abs() < 1e-6, "{} {j} {row}: {}", model.name, residual[row]);
            }
        }
    }
}

#[test]
fn a_load_beyond_the_muscles_is_said_with_what_is_missing() {
    let text = "name = \"weak\"\nmodel = \"{root}/data/models/arm.toml\"\nmotion = \"{root}/data/motions/arm_curl.csv\"\n\
        [base]\nh = 0.1\nstages = 1\nmethod = \"static\"\nmuscle_dynamics = \"force\"\ntrajectories = true\n\
        [sweep.grid]\n\"muscle.*.max_isometric_force_scale\" = [0.08, 1.0]\n";
    let (_, study) = study(&folder(&[("study.toml", text)]));
    let solved: Vec<Outcome> = (study.jobs.iter())
        .map(|job| solve(&study.model_of(job).unwrap(), &study.motion, &job.settings, job.points))
        .collect();
    let (weak, strong) = (&solved[0], &solved[1]);
    assert_eq!((weak.job.status, strong.job.status), (Status::Infeasible, Status::Converged));
    let reason = weak.job.error.as_deref().unwrap();
    assert!(reason.contains("the muscles cannot make") && reason.contains("missing"), "{reason}");
    // The other instants are kept.
    let (some, all) = (signal(weak, "activation", "biceps"), signal(strong, "activation", "biceps"));
    assert!(!some.is_empty() && some.len() < all.len(), "{} of {}: {reason}", some.len(), all.len());
    let failed = format!("{} of {} instants have no answer", all.len() - some.len(), all.len());
    assert!(reason.contains(&failed), "{reason}");
    assert!(weak.regularity.is_none() && weak.muscles.iter().all(|row| row.mean_activation_low.is_none()));
}

/// Eq. (1.7) leaves the forces of force actuators open, eq. (1.8), with the sharing term, does not.
#[test]
fn force_actuators_are_unique_with_the_sharing_term_only() {
    let (model, table) = arm();
    for scheme in [Scheme::Radau, Scheme::Midpoint] {
        for (mu, is_unique) in [(0.0, false), (0.2, true)] {
            let settings = with(|s| {
                (s.scheme, s.mu, s.muscle_dynamics, s.bounds) = (scheme, mu, MuscleDynamics::Force, Bounds::BothBoxed);
            });
            let outcome = outcome_of(&model, &table, &settings);
            assert_eq!(outcome.job.status, Status::Converged, "{:?}", outcome.job.error);
            let row = outcome.regularity.unwrap();
            assert_eq!(row.loads_unique, Some(is_unique), "{scheme:?} {mu}");
            assert!(row.prediction_agrees != Some(false), "{row:?}");
            assert_eq!(row.aj.deficiency == 0, is_unique);
        }
    }
}

#[test]
fn where_activation_dynamics_do_not_matter_a_prescribed_motion_has_the_static_loads() {
    let (model, table) = arm();
    let solved = |method: Method| {
        let settings = with(|s| {
            // Excitations may be anything.
            (s.method, s.muscle_dynamics, s.bounds) = (method, MuscleDynamics::RigidTendon, Bounds::ActivationBoxed);
        });
        let outcome = outcome_of(&model, &table, &settings);
        assert_eq!(outcome.job.status, Status::Converged, "{:?}", outcome.job.error);
        outcome
    };
    let (instants, over_time) = (solved(Method::Static), solved(Method::Prescribed));
    assert!(over_time.job.mid_interval_error.is_some() && instants.job.mid_interval_error.is_none());
    for muscle in &model.muscles {
        let (one, other) = (signal(&instants, "force_n", &muscle.name), signal(&over_time, "force_n", &muscle.name));
        assert_eq!(one.len(), other.len());
        for ((t, a), (_, b)) in one.iter().zip(&other) {
            assert!((a - b).abs() < 1e-5 * (1.0 + a.abs()), "{} at {t}: {a} {b}", muscle.name);
        }
    }
}

/// A muscle whose effort weighs more carries less, and others more, by every method.
#[test]
fn a_muscle_with_a_larger_effort_weight_carries_less() {
    let (model, table) = arm();
    for method in [Method::Static, Method::Prescribed, Method::Dynamic] {
        let settings = with(|s| (s.method, s.bounds, s.regularity) = (method, Bounds::BothBoxed, RegularityMode::Off));
        let force = |weight: f64| {
            let mut model = model.clone();
            let biceps = model.muscles.iter_mut().find(|muscle| muscle.name == "biceps").unwrap();
            biceps.effort_weight = weight;
            let outcome = outcome_of(&model, &table, &settings);
            assert_eq!(outcome.job.status, Status::Converged);
            let of = |name: &str| outcome.muscles.iter().find(|row| row.muscle == name).unwrap().mean_force_n;
            [of("biceps"), of("brachialis")]
        };
        let ([biceps, brachialis], [less, more]) = (force(1.0), force(4.0));
        assert!(less < 0.8 * biceps && more > brachialis, "{method:?}: {biceps} {less}, {brachialis} {more}");
    }
}

/// The same budget may be spent at any time, not at each instant in proportion to its own effort.
#[test]
fn near_optimal_ranges_over_time_hold_those_of_the_instants() {
    let (model, table) = arm();
    let ranges = |method: Method, near_optimal: f64| -> Vec<[Option<f64>; 3]> {
        let settings = with(|s| {
            (s.method, s.muscle_dynamics, s.bounds) = (method, MuscleDynamics::RigidTendon, Bounds::ActivationBoxed);
            s.near_optimal = near_optimal;
        });
        let outcome = outcome_of(&model, &table, &settings);
        let of = |row: &MuscleRow| [row.mean_force_near_low_n, Some(row.mean_force_n), row.mean_force_near_high_n];
        outcome.muscles.iter().map(of).collect()
    };
    assert!(ranges(Method::Prescribed, 0.0).iter().all(|[low, _, high]| low.is_none() && high.is_none()));
    let (instants, over_time) = (ranges(Method::Static, 0.05), ranges(Method::Prescribed, 0.05));
    let mut compared = 0;
    for (muscle, (one, other)) in model.muscles.iter().zip(instants.into_iter().zip(over_time)) {
        let ([Some(low), Some(_), Some(high)], [Some(least), Some(mean), Some(most)]) = (one, other) else { continue };
        compared += 1;
        let width = high - low;
        assert!(least <= mean && mean <= most);
        let name = &muscle.name;
        assert!(least < low + 0.03 * width && most > high - 0.03 * width, "{name}: {least} {low} {high} {most}");
        assert!(most - least < 2.0 * width + 1e-3, "{name}: {least} to {most}, {low} to {high}");
    }
    assert!(compared >= 3, "{compared}");
}

/// With shorter and shorter tendons on the same fibres, elastic ones come to the answer of rigid ones.
#[test]
fn elastic_tendons_come_to_rigid_ones_as_they_stiffen() {
    let motion = "time_s,shoulder_deg,elbow_deg\n0,0,20\n0.1,2,25\n0.2,5,33\n0.3,8,40\n0.4,10,44\n";
    let effort = |tendon: f64, dynamics: &str| {
        let arm = super::fitted::ARM
            .replace("tendon_slack_length = 0.1", &format!("tendon_slack_length = {tendon}"))
            .replace("coefficients = [0.3,", &format!("coefficients = [{},", 0.1 + tendon));
        let text = format!(
            "name = \"s\"\nmodel = \"arm.toml\"\nmotion = \"m.csv\"\n[base]\nh = 0.05\nstages = 2\nmethod = \"prescribed\"\n\
             muscle_dynamics = \"{dynamics}\"\nbounds = \"both_boxed\"\nregularity = \"off\"\nreserves = 3.0\n"
        );
        let (_, study) = study(&folder(&[("study.toml", &text), ("m.csv", motion), ("arm.toml", &arm)]));
        let job = &study.jobs[0];
        let outcome = solve(&study.model, &study.motion, &job.settings, job.points);
        assert_eq!(outcome.job.status, Status::Converged, "{tendon} {:?}", outcome.job.error);
        outcome.job.effort.unwrap()
    };
    let rigid = effort(0.1, "rigid_tendon");
    assert!((effort(0.01, "rigid_tendon") / rigid - 1.0).abs() < 1e-9);
    let gaps = [0.1, 0.03, 0.003].map(|tendon| (effort(tendon, "full") / rigid - 1.0).abs());
    println!("{gaps:?}");
    assert!(gaps[1] < gaps[0] && gaps[2] < gaps[1] && gaps[2] < 0.02, "{gaps:?}");
}

#[test]
fn excitations_are_an_effort_too_and_activations_may_start_steady() {
    let (model, table) = arm();
    for (dynamics, initial) in
        [(MuscleDynamics::Full, Initial::Steady), (MuscleDynamics::RigidTendon, Initial::Equilibrium)]
    {
        let of = |effort: EffortOf| {
            let settings = with(|s| {
                (s.method, s.muscle_dynamics, s.effort_of) = (Method::Prescribed, dynamics, effort);
                (s.bounds, s.initial, s.regularity) = (Bounds::BothBoxed, initial, RegularityMode::Off);
                (s.h, s.trajectories) = (0.05, true);
            });
            let outcome = outcome_of(&model, &table, &settings);
            assert_eq!(outcome.job.status, Status::Converged, "{:?}", outcome.job.error);
            outcome
        };
        let (plain, excited) = (of(EffortOf::Activation), of(EffortOf::Excitation));
        // Each is best at its own.
        assert!(plain.job.effort.unwrap() < excited.job.effort.unwrap() * (1.0 + 1e-9));
        let use_of = |outcome: &Outcome| -> f64 {
            let squares = model.muscles.iter().flat_map(|muscle| signal(outcome, "excitation", &muscle.name));
            squares.map(|(_, u)| u * u).sum()
        };
        assert!(use_of(&excited) < use_of(&plain) * 1.001, "{} {}", use_of(&excited), use_of(&plain));
        for muscle in &model.muscles {
            for (t, u) in signal(&plain, "excitation", &muscle.name) {
                assert!((-1e-6..1.0 + 1e-6).contains(&u), "{} at {t}: {u}", muscle.name);
            }
        }
    }
}

#[test]
fn random_arms_are_solved_by_every_method_or_certified_infeasible() {
    let (model, table) = arm();
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(200);
    let (mut converged, mut infeasible, mut all) = (0, 0, 0);
    for round in 0..50 {
        let mut model = with_curves(&model, MuscleCurves::VARIANTS[round % 3]);
        for muscle in &mut model.muscles {
            muscle.max_isometric_force *= rng.random_range(0.3..3.0);
            muscle.optimal_fibre_length *= rng.random_range(0.9..1.1);
        }
        for (method, dynamics, criterion, power) in [
            (Method::Static, MuscleDynamics::Force, Criterion::Polynomial, [1.0, 2.0, 3.0, 5.0][round % 4]),
            (Method::Static, MuscleDynamics::RigidTendon, Criterion::Polynomial, [2.0, 3.0][round % 2]),
            (Method::Static, MuscleDynamics::Full, Criterion::Polynomial, 2.0),
            (Method::Static, MuscleDynamics::Force, Criterion::MinMax, 2.0),
            (Method::Prescribed, MuscleDynamics::RigidTendon, Criterion::Polynomial, 2.0),
            (Method::Prescribed, MuscleDynamics::Full, Criterion::Polynomial, 2.0),
            (Method::Dynamic, MuscleDynamics::Force, Criterion::Polynomial, 2.0),
            (Method::Dynamic, MuscleDynamics::RigidTendon, Criterion::Polynomial, 2.0),
        ] {
            let settings = with(|s| {
                (s.method, s.muscle_dynamics, s.criterion, s.effort_power) = (method, dynamics, criterion, power);
                (s.bounds, s.regularity, s.trajectories) = (Bounds::BothBoxed, RegularityMode::Off, false);
                // Activations need time, and there may be moments that muscles cannot make in time.
                s.reserves = if method == Method::Prescribed { 5.0 } else { 0.0 };
                s.effort_weight = [EffortWeight::None, EffortWeight::Volume, EffortWeight::MaxForce][round % 3];
            });
            let outcome = outcome_of(&model, &table, &settings);
            all += 1;
            match outcome.job.status {
                Status::Converged => converged += 1,
                Status::Infeasible if method == Method::Static => {
                    let reason = outcome.job.error.unwrap();
                    assert!(reason.contains("missing"), "{reason}");
                    infeasible += 1;
                }
                status => println!("{round} {method:?} {dynamics:?} {criterion:?}: {status:?} {:?}", outcome.job.error),
            }
        }
    }
    println!("{converged} converged and {infeasible} infeasible of {all}");
    assert!(100 * (converged + infeasible) >= 99 * all, "{converged} and {infeasible} of {all}");
}

#[test]
fn settings_that_a_method_does_not_have_are_refused_and_change_no_identity() {
    let load = |lines: &str| {
        let text = format!(
            "name = \"s\"\nmodel = \"{{root}}/data/models/arm.toml\"\nmotion = \"{{root}}/data/motions/arm_curl.csv\"\n{lines}\n"
        );
        let folder = folder(&[("study.toml", &text)]);
        Study::load(&folder.path().join("study.toml"))
    };
    for (lines, expected) in [
        ("[base]\ncriterion = \"min_max\"", vec!["base.criterion", "method = \"dynamic\""]),
        ("[base]\nmethod = \"static\"\nscheme = \"midpoint\"", vec!["base.scheme", "radau"]),
        ("[base]\neffort_power = 1", vec!["base.effort_power", "only with method = \"static\""]),
        ("[base]\nmethod = \"static\"\neffort_power = 1.5", vec!["1.5", "a power from 2 to 10"]),
        ("[base]\nmethod = \"static\"\nnoise_sd = 0.01", vec!["base.noise_sd", "accelerations"]),
        ("[base]\nmethod = \"prescribed\"\nmuscle_dynamics = \"force\"", vec!["set method = \"static\""]),
        ("[base]\nmethod = \"static\"\neffort_of = \"excitation\"", vec!["base.effort_of"]),
        ("[base]\ninitial = \"steady\"", vec!["base.initial"]),
        ("[base]\nmethod = \"statik\"", vec!["did you mean \"static\""]),
        ("[base]\nmin_activation = 2", vec!["from 0 to 0.5"]),
        ("[base]\npassive_forces = 1", vec!["true or false"]),
    ] {
        let found = said(load(lines).map(|_| ()).unwrap_err());
        expected.iter().for_each(|part| assert!(found.contains(part), "{lines}: `{part}` is not in {found}"));
    }
    // What a method ignores makes no further jobs.
    let study = load("[base]\nmethod = \"static\"\n[sweep.grid]\nmu = [0.1, 0.2, 0.4]").unwrap();
    assert_eq!(study.jobs.len(), 1);
    let reserves = load("[base]\nmethod = \"static\"\nreserves = 1.0\n\"reserves.elbow_angle\" = 50.0").unwrap();
    assert_eq!(reserves.jobs[0].settings.reserve("elbow_angle"), 50.0);
    assert_eq!(reserves.jobs[0].settings.reserve("shoulder_angle"), 1.0);
}

/// The walking trial at the instants of OpenSim's static optimisation.
struct Walk {
    study: Study,
    instants: Vec<f64>,
    muscles: Vec<String>,
    /// By instant and muscle: OpenSim's activation, and the strength by its curves, N.
    activations: Vec<Vec<f64>>,
    strengths: Vec<Vec<f64>>,
    muscles_with_strength: Vec<String>,
}

fn walk() -> Option<Walk> {
    let model = shared("walking/subject_walk_scaled.osim")?;
    let place = model.parent().unwrap().display();
    let residuals = ["tilt", "list", "rotation"].map(|axis| format!("\"reserves.pelvis_{axis}\" = 250.0\n")).concat();
    let text = format!(
        "name = \"walk\"\nmodel = \"{place}/subject_walk_scaled.osim\"\nmotion = \"{place}/coordinates.sto\"\n\
         loads = \"{place}/grf_walk.xml\"\nwindow = [0.48, 1.61]\n[base]\n\"body.*.role\" = \"free\"\nintervals = 57\n\
         \"coordinate.mtp_angle_*.locked\" = true\nstages = 2\nmethod = \"static\"\nmuscle_dynamics = \"rigid_tendon\"\nmin_activation = 0.01\nreserves = 1.0\n{residuals}\
         \"reserves.pelvis_tx\" = 50.0\n\"reserves.pelvis_ty\" = 50.0\n\"reserves.pelvis_tz\" = 50.0\nregularity = \"off\"\n"
    );
    let (_, study) = study(&folder(&[("study.toml", &text)]));
    let read = |name: &str| {
        let text = std::fs::read_to_string(model.with_file_name(name)).unwrap();
        let mut lines = text.lines();
        let names: Vec<String> = lines.next().unwrap().split(',').skip(1).map(str::to_owned).collect();
        let numbers = |line: &str| line.split(',').map(|x| x.parse().unwrap()).collect::<Vec<f64>>();
        (names, lines.map(numbers).collect::<Vec<Vec<f64>>>())
    };
    let (muscles, activations) = read("static_optimization_opensim.csv");
    let (muscles_with_strength, strengths) = read("active_strength_millard_opensim.csv");
    let values = |rows: &[Vec<f64>]| rows.iter().map(|row| row[1..].to_vec()).collect::<Vec<_>>();
    let instants = activations.iter().map(|row| row[0]).collect();
    Some(Walk {
        study,
        instants,
        muscles,
        muscles_with_strength,
        strengths: values(&strengths),
        activations: values(&activations),
    })
}

/// The programme of an instant with these strengths (N) by muscle of the model.
fn programme(model: &Model, given: &GivenMotion<'_>, instant: &Instant, strengths: &[f64]) -> Programme {
    let muscles = instant.arms.iter().zip(strengths);
    let muscles = muscles.map(|(arms, n)| arms.iter().map(|&(row, arm)| (row, n * arm)).collect());
    let columns: Vec<Vec<(usize, f64)>> = muscles.chain(instant.actuators.iter().cloned()).collect();
    let count = model.muscles.len();
    let term = |k: usize| match k.checked_sub(count) {
        None => Term { weight: 1.0, offset: 0.0, scale: 1.0, bounds: [0.01, 1.0], is_muscle: true },
        Some(k) => {
            let own = &given.actuation[k];
            Term { weight: own.weight, offset: 0.0, scale: 1.0, bounds: own.bounds, is_muscle: false }
        }
    };
    let terms = (0..columns.len()).map(term).collect();
    let (rows, right) = (instant.needed.len(), instant.needed.clone());
    Programme { rows, columns, right, terms, criterion: Recruited::Polynomial(2.0) }
}

#[test]
fn a_walking_trial_has_opensims_activations_where_strengths_are_opensims() {
    let Some(walk) = walk() else { return };
    let job = &walk.study.jobs[0];
    let model = walk.study.model_of(job).unwrap();
    let prepared = prepare(&model, &walk.study.motion, &job.settings, job.points);
    let given = prepared.given.as_ref().unwrap();
    let places_in = |names: &[String]| -> Vec<usize> {
        model.muscles.iter().map(|muscle| names.iter().position(|own| *own == muscle.name).unwrap()).collect()
    };
    let (places, with_strength) = (places_in(&walk.muscles), places_in(&walk.muscles_with_strength));
    let mut squares = vec![0.0; places.len()];
    let mut programmes = Vec::new();
    for (k, &time) in walk.instants.iter().enumerate() {
        let instant = given.at(time - 0.48);
        let strengths: Vec<f64> = with_strength.iter().map(|&m| walk.strengths[k][m]).collect();
        let programme = programme(&model, given, &instant, &strengths);
        let optimum = programme.solve(Deadline::default()).unwrap();
        for (m, &place) in places.iter().enumerate() {
            squares[m] += (optimum.x[m] - walk.activations[k][place]).powi(2) / walk.instants.len() as f64;
        }
        programmes.push((programme, optimum));
    }
    let rms: Vec<f64> = squares.iter().map(|square| square.sqrt()).collect();
    let worst = rms.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)).unwrap();
    println!("largest RMS difference of an activation: {:.4} of {}", worst.1, model.muscles[worst.0].name);
    assert!(*worst.1 < 0.005, "{} {}", worst.1, model.muscles[worst.0].name);

    // Near-optimal ranges hold the optima of disturbed criteria.
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(50);
    let (programme, optimum) = &programmes[40];
    let ranges = programme.ranges(optimum, 0.05, Deadline::default()).unwrap();
    let value = |x: &[f64]| programme.terms.iter().zip(x).map(|(term, x)| term.weight * x * x).sum::<f64>();
    let effort = programme.muscle_effort(2.0, &optimum.x);
    let mut inside = 0;
    for _ in 0..50 {
        let mut disturbed = programme.clone();
        let muscles = disturbed.terms.iter_mut().filter(|term| term.is_muscle);
        muscles.for_each(|term| term.weight *= rng.random_range(0.75..1.33));
        let other = disturbed.solve(Deadline::default()).unwrap();
        if value(&other.x) > optimum.value + 0.05 * effort {
            continue;
        }
        inside += 1;
        for (m, [low, high]) in ranges.iter().enumerate().take(places.len()) {
            assert!((low - 1e-6..=high + 1e-6).contains(&other.x[m]), "{m}: {} of {low} to {high}", other.x[m]);
        }
    }
    let wide = ranges.iter().take(places.len()).filter(|[low, high]| high - low > 0.02).count();
    println!("{inside} of 50 disturbed optima are within 5 %; {wide} of {} ranges are above 0.02", places.len());
    assert!(inside > 40 && wide > 30, "{inside} {wide}");
}

/// A signal between its points.
fn interpolated(signal: &[(f64, f64)], t: f64) -> f64 {
    let after = signal.partition_point(|point| point.0 < t).clamp(1, signal.len() - 1);
    let [(t0, a0), (t1, a1)] = [signal[after - 1], signal[after]];
    a0 + (a1 - a0) * (t - t0) / (t1 - t0)
}

fn rms(differences: impl Iterator<Item = f64>) -> f64 {
    let squares: Vec<f64> = differences.map(|difference| difference * difference).collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

/// OpenSim takes the force along the fibre for that along the tendon, and has other paths of gastrocnemius lateralis.
#[test]
fn a_walking_trial_with_millards_curves_is_near_opensims_static_optimisation() {
    let Some(walk) = walk() else { return };
    let job = &walk.study.jobs[0];
    let model = walk.study.model_of(job).unwrap();
    let settings = Settings {
        muscle_curves: Some(MuscleCurves::Millard2012),
        passive_forces: false,
        trajectories: true,
        ..job.settings.clone()
    };
    let outcome = solve(&model, &walk.study.motion, &settings, job.points);
    assert_eq!(outcome.job.status, Status::Converged, "{:?}", outcome.job.error);
    let mut all: Vec<(f64, &str)> = Vec::new();
    let is_muscle = |name: &str| model.muscles.iter().any(|muscle| muscle.name == name);
    for (place, name) in walk.muscles.iter().enumerate().filter(|(_, name)| is_muscle(name)) {
        let own = signal(&outcome, "activation", name);
        // The first instant of the job is one sixth of a mesh interval after that of the trial.
        let pairs = walk.instants.iter().zip(&walk.activations).skip(2);
        all.push((rms(pairs.map(|(&t, row)| interpolated(&own, t) - row[place])), name));
    }
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    println!("RMS differences of activations with millard_2012:");
    all.iter().for_each(|(rms, name)| println!("{name:14} {rms:.4}"));
    assert!(all[0].0 < 0.03 && all[all.len() / 2].0 < 0.005, "{:?}", &all[..3]);
}

/// OpenSim's path of these is shorter than the shortest one around either of their two cylinders alone.
fn passes_through_a_cylinder(muscle: &str) -> bool {
    muscle.starts_with("gaslat")
}

#[test]
fn lengths_of_a_walking_trial_are_opensims() {
    let Some(walk) = walk() else { return };
    let job = &walk.study.jobs[0];
    let model = walk.study.model_of(job).unwrap();
    let prepared = prepare(&model, &walk.study.motion, &job.settings, job.points);
    let given = prepared.given.as_ref().unwrap();
    let text = std::fs::read_to_string(shared("walking/lengths_and_moment_arms_opensim.csv").unwrap()).unwrap();
    let mut worst = 0.0f64;
    for line in text.lines().skip(1) {
        let cells: Vec<&str> = line.split(',').collect();
        let m = model.muscles.iter().position(|muscle| muscle.name == cells[1]).unwrap();
        let length = given.at(cells[0].parse::<f64>().unwrap() - 0.48).paths[m][0];
        let error = length - cells[2].parse::<f64>().unwrap();
        if passes_through_a_cylinder(cells[1]) {
            assert!((-1e-4..7e-3).contains(&error), "{line}: {error}");
        } else {
            worst = worst.max(error.abs());
        }
    }
    println!("largest difference of a length: {:.2} mm", 1e3 * worst);
    assert!(worst < 2e-4, "{worst}");
}

#[test]
fn strengths_by_millards_curves_are_opensims() {
    let Some(walk) = walk() else { return };
    let job = &walk.study.jobs[0];
    let model = walk.study.model_of(job).unwrap();
    let prepared = prepare(&model, &walk.study.motion, &job.settings, job.points);
    let given = prepared.given.as_ref().unwrap();
    let mut worst = (0.0, String::new());
    for (m, muscle) in model.muscles.iter().enumerate() {
        let mut muscle = muscle.clone();
        (muscle.rigid_tendon, muscle.damping) = (true, 0.0);
        muscle.set_curves(MuscleCurves::Millard2012);
        let place = walk.muscles_with_strength.iter().position(|name| *name == muscle.name).unwrap();
        let largest = walk.strengths.iter().fold(0.0f64, |largest, row| largest.max(row[place]));
        let errors = walk.instants.iter().enumerate().map(|(k, &time)| {
            let [length, rate] = given.at(time - 0.48).paths[m];
            let [none, full] = muscle.force_range(length, rate);
            // OpenSim's static optimisation takes the force along the fibre for that along the tendon.
            let sin = muscle.pennation_angle.sin() / muscle.fibre_length(length, 0.0);
            let strength = muscle.max_isometric_force * (full - none) / (1.0 - sin * sin).sqrt();
            strength - walk.strengths[k][place]
        });
        let share = rms(errors) / largest;
        if share > worst.0 && !passes_through_a_cylinder(&muscle.name) {
            worst = (share, muscle.name.clone());
        }
    }
    println!("largest RMS difference of a strength: {:.2} % of its peak, {}", 100.0 * worst.0, worst.1);
    assert!(worst.0 < 0.003, "{worst:?}");
}

/// The walking trial with paths fitted to those of OpenSim, and these settings.
fn fitted_walk(settings: &str) -> Option<Outcome> {
    let model = shared("walking/subject_walk_scaled.osim")?;
    let place = model.parent().unwrap().display();
    let study = format!(
        "name = \"walk\"\nmodel = \"walk.toml\"\nmotion = \"{place}/coordinates.sto\"\nloads = \"{place}/grf_walk.xml\"\n\
         window = [0.48, 1.61]\n[base]\n\"body.*.role\" = \"free\"\n\"coordinate.mtp_angle_*.locked\" = true\n\
         intervals = 57\nmethod = \"prescribed\"\npassive_forces = false\n\"muscle.*.active_width\" = 1.5\n\
         bounds = \"both_boxed\"\nregularity = \"off\"\ntrajectories = true\nreserves = 1.0\n\
         \"reserves.pelvis_tilt\" = 250.0\n\"reserves.pelvis_list\" = 250.0\n\"reserves.pelvis_rotation\" = 250.0\n\
         \"reserves.pelvis_tx\" = 50.0\n\"reserves.pelvis_ty\" = 50.0\n\"reserves.pelvis_tz\" = 50.0\n{settings}"
    );
    let folder = folder(&[("study.toml", &study)]);
    let paths = model.with_file_name("subject_walk_scaled_FunctionBasedPathSet.xml");
    let [model, paths] = [&model, &paths].map(|path| path.to_str().unwrap());
    let imported = sinew(&["import", model, "--paths", paths, "--out", "walk.toml"], folder.path());
    assert_eq!(imported.status.code(), Some(0), "{}", text_of(&imported));
    let study = Study::load(&folder.path().join("study.toml")).unwrap();
    let job = &study.jobs[0];
    let model = study.model_of(job).unwrap();
    assert_eq!(job.settings.min_activation, 0.01, "as the model has it");
    let outcome = solve(&model, &study.motion, &job.settings, job.points);
    assert_eq!(outcome.job.status, Status::Converged, "{:?}", outcome.job.error);
    Some(outcome)
}

/// MocoInverse has a mesh of 0.02 s and a coarser scheme. At its first instant alone it is far from all that follows.
#[test]
fn a_prescribed_walk_has_the_answer_of_moco_inverse() {
    let settings = "stages = 3\nmuscle_dynamics = \"rigid_tendon\"\neffort_of = \"excitation\"\ninitial = \"steady\"\n";
    let Some(outcome) = fitted_walk(settings) else { return };
    let text = std::fs::read_to_string(shared("walking/moco_inverse_rigid.csv").unwrap()).unwrap();
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let rows: Vec<Vec<f64>> =
        lines.map(|line| line.split(',').map(|x| x.parse().unwrap_or(f64::NAN)).collect()).collect();
    let mut all = Vec::new();
    for (column, name) in names.iter().enumerate() {
        let Some(muscle) = name.strip_suffix("/activation") else { continue };
        let own = signal(&outcome, "activation", muscle);
        let start = own[0].0;
        all.push(rms(rows[3..].iter().map(|row| interpolated(&own, row[0] - 0.48 + start) - row[column])));
    }
    all.sort_by(f64::total_cmp);
    let (effort, median, worst) = (outcome.job.control_effort.unwrap(), all[all.len() / 2], all[all.len() - 1]);
    println!("∫Σ control² = {effort:.4}; RMS of activations: median {median:.4}, largest {worst:.4}");
    assert!((effort / 1.588 - 1.0).abs() < 0.005, "{effort}");
    assert!(median < 0.005 && worst < 0.035, "{median} {worst}");
}

#[test]
fn a_prescribed_walk_with_elastic_tendons_converges() {
    let Some(outcome) = fitted_walk("stages = 2\n") else { return };
    let job = &outcome.job;
    assert!(job.feasibility.unwrap() < 1e-8 && job.stationarity.unwrap() < 1e-8);
    let soleus = |name: &str| signal(&outcome, name, "soleus_r");
    let (force, length) = (soleus("force_n"), soleus("fibre_length"));
    assert!(length.iter().all(|(_, l)| (0.4..1.6).contains(l)) && force.iter().all(|(_, f)| *f >= -1e-6));
    println!("effort with elastic tendons {:.4} after {} iterations", job.effort.unwrap(), job.iterations.unwrap());
}

#[test]
fn all_instants_of_a_walking_trial_are_solved_in_one_job() {
    let Some(walk) = walk() else { return };
    let job = &walk.study.jobs[0];
    let model = walk.study.model_of(job).unwrap();
    let outcome = solve(&model, &walk.study.motion, &job.settings, job.points);
    assert_eq!(outcome.job.status, Status::Converged, "{:?}", outcome.job.error);
    let (stationarity, feasibility) = (outcome.job.stationarity.unwrap(), outcome.job.feasibility.unwrap());
    assert!(stationarity < 1e-8 && feasibility < 1e-8, "{stationarity} {feasibility}");
    let hip = outcome.joints.iter().find(|row| row.joint == "hip_r").unwrap();
    assert!((2.0..7.0).contains(&hip.peak_force_bw.unwrap()), "{hip:?}");
}

#[test]
fn results_of_all_methods_are_tables_that_can_be_compared() {
    let study = "name = \"m\"\nmodel = \"{root}/data/models/arm.toml\"\nmotion = \"{root}/data/motions/arm_curl.csv\"\n\
        [base]\nh = 0.1\nstages = 2\nbounds = \"both_boxed\"\nregularity = \"optimum\"\nnear_optimal = 0.05\n\
        method = \"static\"\n[sweep.grid]\nmuscle_dynamics = [\"full\", \"rigid_tendon\", \"force\"]\neffort_power = [1, 2, 3]\n";
    let folder = folder(&[("study.toml", study)]);
    let run = |jobs: &str, out: &str| {
        let run = sinew(&["run", "study.toml", "--jobs", jobs, "--out", out], folder.path());
        assert_eq!(run.status.code(), Some(0), "{}", text_of(&run));
        sinew::internals::tables::read("muscles", &folder.path().join(out).join("muscles.parquet")).unwrap()
    };
    let (one, two) = (run("1", "one"), run("2", "two"));
    assert_eq!(format!("{:?}", one.columns), format!("{:?}", two.columns));
    let shown = one_line(&text(&sinew(&["show", "one", "--wide"], folder.path()).stdout));
    assert!(shown.contains("9 jobs finished: 9 converged") && shown.contains("answer"), "{shown}");
}

fn text_of(run: &std::process::Output) -> String {
    text(&run.stdout) + &text(&run.stderr)
}
