//! The command line: one file a command.

mod check;
mod plan;
mod run;
mod show;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

use crate::error::Result;

/// Parallel parameter studies of inverse musculoskeletal biomechanics: muscle loads, and whether they are unique.
#[derive(Parser)]
#[command(name = "sinew", version, propagate_version = true, max_term_width = 110)]
#[command(after_help = "Examples:
  sinew run studies/table1.toml                 solve all jobs of a study, print the tables
  sinew plan studies/table1.toml                see the jobs without solving any
  sinew show results/table1                     print the tables of results again
  sinew check my_study.toml my_model.toml       look for mistakes

Exit code: 0 good, 1 some jobs failed, 2 bad input, 130 interrupted.")]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// List the jobs of a study without solving any
    #[command(after_help = "Example:\n  sinew plan studies/table1.toml --all")]
    Plan {
        /// Study file (.toml)
        study: PathBuf,
        /// List every job, not only the first 20
        #[arg(long)]
        all: bool,
    },
    /// Solve all jobs of a study; goes on where an earlier run stopped
    #[command(after_help = "Examples:
  sinew run studies/table1.toml
  sinew run studies/table1.toml --out /tmp/table1 --jobs 1
  sinew run studies/table1.toml --fresh         forget earlier results first

Ctrl-C keeps everything finished; run the same command again to go on.")]
    Run {
        /// Study file (.toml)
        study: PathBuf,
        /// Results folder [default: results/<name of the study>]
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        /// Jobs at a time [default: one a core]
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
        jobs: Option<u16>,
        /// Forget the results that the folder holds
        #[arg(long)]
        fresh: bool,
    },
    /// Print the tables of a results folder
    #[command(after_help = "Example:\n  sinew show results/table1 --all")]
    Show {
        /// Results folder
        dir: PathBuf,
        /// Every job, not only the first 24
        #[arg(long)]
        all: bool,
    },
    /// Look for mistakes in study, model and motion files
    #[command(after_help = "Examples:
  sinew check studies/table1.toml
  sinew check data/models/arm.toml
  sinew check data/motions/arm_curl.csv --model data/models/arm.toml")]
    Check {
        /// Study (.toml), model (.toml) or motion (.csv, .mot, .sto) files
        #[arg(required = true, value_name = "FILE")]
        files: Vec<PathBuf>,
        /// The model that motion files are for
        #[arg(long, value_name = "FILE")]
        model: Option<PathBuf>,
    },
}

/// Exit codes.
const GOOD: u8 = 0;
const FAILED_JOBS: u8 = 1;
const BAD_INPUT: u8 = 2;
const INTERRUPTED: u8 = 130;

/// Runs the program on the process' arguments.
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    let result: Result<u8> = match cli.command {
        Command::Plan { study, all } => plan::plan(&study, all),
        Command::Run { study, out, jobs, fresh } => run::run(&study, out, jobs.map(usize::from), fresh),
        Command::Show { dir, all } => show::show(&dir, all),
        Command::Check { files, model } => check::check(&files, model.as_deref()),
    };
    match result {
        Ok(code) => ExitCode::from(code),
        Err(error) => {
            eprintln!("{:?}", miette::Report::new(error));
            ExitCode::from(BAD_INPUT)
        }
    }
}

/// Prints without failing when the reader has gone (`sinew show … | head`).
fn print(text: &str) {
    use std::io::Write;
    let _ = writeln!(std::io::stdout(), "{text}");
}
