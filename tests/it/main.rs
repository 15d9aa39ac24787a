//! All integration tests, in a single binary.

mod analytic;
mod architecture;
mod bad_input;
mod browser;
mod cli;
mod compare;
mod derivatives;
mod engine;
mod folders;
mod honest;
mod opensim;
mod other_readers;
mod output;
mod radau;
mod readmes;
mod recheck;
mod regularity;
mod report;
mod resume;
mod space;
mod spatial;
mod support;
mod sweeps;
mod uniqueness;
mod warm;
mod wrapping;
