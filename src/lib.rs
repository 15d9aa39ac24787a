//! Sinew: parallel parameter studies of inverse musculoskeletal biomechanics.
//!
//! Given a measured motion, find the muscle excitations, activations, fibre lengths, joint reactions and the motion itself
//! such that the muscle-driven equations of motion hold and the motion is matched in the least-squares sense with a
//! load-sharing term; and say whether the answer is unique. Source of the method: M. Lund Ohlsson, *New methods for
//! movement technique development in cross-country skiing using mathematical models and simulation*, licentiate thesis 41,
//! Mid Sweden University 2009, Paper B.
//!
//! The map, from what the user says to what the user gets:
//!
//! ```text
//! study/          study file → axes → jobs; identity of a job. Pure.
//! model/          bodies, joints, musculotendons, paths: file → checked model; spatial/: Euler parameters, wrapped paths
//! skeleton/       a spatial model by its joint coordinates: frames, paths around surfaces, moment arms
//! opensim/        OpenSim's models, read as files of spatial models
//! motion/         joint coordinates over time: file → measured body coordinates
//! transcription/  (model, measurement, settings) → a sparse nonlinear problem
//! guess.rs        start guess by inverse dynamics
//! nlp/            SQP, active sets, regularity: knows no muscles
//! numerics/       splines, sparse matrices, ranks: knows no biomechanics
//! warm.rs         a solved problem as the start of another
//! solution.rs     a solved problem → loads, errors, functions of time
//! mesh_error.rs   how far effort and loads are off for the mesh
//! plausibility.rs warnings on what converged and should not be believed as it is
//! uniqueness.rs   how far an answer that is not unique may move; sensitivities
//! analysis.rs     the runs of a job → its rows
//! deadline.rs     when a job has to end
//! memory.rs       how much memory a job will take
//! solve.rs        one job → outcome, the pipeline on one screen. No disk, no printing.
//! outcome.rs      the rows that a job leaves
//! names.rs        what names may be
//! files.rs        files that are written whole or not at all
//! terminal.rs     the one place that prints, which cannot fail a run
//! run/            jobs in parallel, kept as they finish; shards, retries, manifest; why a job would run
//! tables/         the columns, Parquet
//! compare.rs      results against a baseline, from the tables alone
//! table1.rs       results beside the thesis' Table 1
//! report/         a page to look at, from the tables alone
//! cli/            one file a command
//! ```
//!
//! Invariants, tested in `tests/it/architecture.rs` and `engine.rs`: dependencies point one way (cli → run → tables, solve →
//! transcription → nlp, model → numerics); one door a crate (clarabel only in `nlp/qp.rs`, polars only in
//! `tables/parquet.rs`, rayon and indicatif only in `run/`, clap only in `cli/`); `solve` is a pure function; one thread a
//! solve; the same tables with 1 or N threads; a job that fails is a row with a status, `Err` is bad input or I/O.

// Index loops read like the formulas they are.
#![allow(clippy::needless_range_loop)]

/// Version of the solver that results carry, see `build.rs`.
pub const SOLVER: &str = env!("SINEW_SOLVER");

pub mod analysis;
pub mod cli;
pub mod compare;
pub mod deadline;
pub mod error;
pub mod files;
pub mod guess;
pub mod memory;
pub mod mesh_error;
pub mod model;
pub mod motion;
pub mod names;
pub mod nlp;
pub mod numerics;
pub mod opensim;
pub mod outcome;
pub mod plausibility;
pub mod reference;
pub mod report;
pub mod run;
pub mod skeleton;
pub mod solution;
pub mod solve;
pub mod study;
pub mod table1;
pub mod tables;
pub mod terminal;
pub mod transcription;
pub mod uniqueness;
pub mod warm;
