//! Sinew: parallel parameter studies of inverse musculoskeletal biomechanics.
//!
//! Given a measured motion, Sinew finds the muscle excitations, activations, fibre lengths, joint reactions and the
//! motion itself, such that the muscle-driven equations of motion hold and the measured motion is matched in the
//! least-squares sense, with a load-sharing term. It also determines whether the answer is unique. Source of the
//! method: M. Lund Ohlsson, *New methods for movement technique development in cross-country skiing using mathematical
//! models and simulation*, licentiate thesis 41, Mid Sweden University 2009, Paper B.
//!
//! The modules, from input to output:
//!
//! ```text
//! settings/       the settings of a job
//! study/          study file → axes → jobs; the identity of a job. Pure.
//! curves/         force–length, force–velocity and tendon curves
//! entries.rs      what files of planar and spatial models share
//! model/          bodies, joints, musculotendons, paths: file → checked model; tree/, spatial/: joint coordinates, wrapping
//! skeleton/       a spatial model in joint coordinates: frames, paths around surfaces, moment arms
//! opensim/        OpenSim models, converted to spatial model files
//! motion/         joint coordinates over time: file → measured coordinates
//! problem/        what is to be solved, in continuous time: quantities, equations (blocks/), limits, goals
//! methods/        which of these make up an inverse method
//! transcription/  problem, goals → a sparse nonlinear programme
//! guess.rs        start guess by inverse dynamics
//! nlp/            SQP, active sets, regularity; independent of muscles
//! numerics/       splines, sparse matrices, ranks; independent of biomechanics
//! prepare.rs      a job → inverse problem, scheme, measurement
//! starts.rs       what a job's solves start from
//! warm.rs         a solved problem as the start of another
//! solution/       a solved problem → loads, errors, functions of time
//! mesh_error.rs   estimated discretisation error of effort and loads
//! near_optimal.rs how far loads could be otherwise at nearly the same cost
//! plausibility.rs warnings about converged results that should not be trusted without checking
//! uniqueness.rs   how far an answer that is not unique may move; sensitivities
//! analysis.rs     the runs of a job → its rows
//! deadline.rs     time limit of a job
//! memory.rs       how much memory a job will take
//! solve.rs        one job → outcome, the whole pipeline. No disk access, no printing.
//! outcome.rs      the rows of a job
//! reference.rs    every key of the files that users write, with its meaning
//! names.rs        which names are allowed
//! files.rs        files that are written whole or not at all
//! terminal.rs     the only place that prints; a failed print never fails a run
//! run/            jobs in parallel, each stored as it finishes; shards, retries, manifest; why a job would run
//! tables/         the columns, Parquet
//! compare.rs      results against a baseline, from the tables alone
//! table1.rs       results next to the thesis' Table 1
//! report/         a page that shows the results, from the tables alone
//! cli/            one file per command
//! internals.rs    what tests and benchmarks may use
//! ```
//!
//! Invariants, tested in `tests/it/architecture.rs` and `engine.rs`: dependencies point one way (cli → run → tables,
//! solve → transcription → nlp, model → numerics). Some crates are used in one place only (clarabel in `nlp/qp.rs`,
//! polars in `tables/parquet.rs`, rayon and indicatif in `run/`, clap in `cli/`). `solve` is a pure function. A solve
//! uses one thread. The tables are the same with 1 or N threads. A job that fails becomes a row with a status; `Err`
//! means bad input or I/O.

// Index loops read like the formulas that they implement.
#![allow(clippy::needless_range_loop)]

/// Version of the solver, which is stored with results; see `build.rs`.
pub const SOLVER: &str = env!("SINEW_SOLVER");

mod analysis;
mod cli;
mod compare;
mod curves;
mod deadline;
mod entries;
mod error;
mod files;
mod guess;
pub mod internals;
mod memory;
mod mesh_error;
mod methods;
mod model;
mod motion;
mod names;
mod near_optimal;
mod nlp;
mod numerics;
mod opensim;
mod outcome;
mod plausibility;
mod prepare;
mod problem;
mod recruited;
mod recruitment;
mod reference;
mod report;
mod run;
mod settings;
mod skeleton;
mod solution;
mod solve;
mod starts;
mod study;
mod table1;
mod tables;
mod terminal;
mod transcription;
mod uniqueness;
mod warm;

pub use cli::main;
