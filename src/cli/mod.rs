//! The command line: one file a command.

mod check;
mod compare;
mod import;
mod moment_arms;
mod plan;
mod rank;
mod report;
mod run;
mod show;
mod slurm;
mod status;

use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Parser, Subcommand};

use crate::error::{Error, Result};
use crate::files::write_whole;
use crate::names::is_formula;
use crate::run::{RunOptions, Shard};
use crate::tables::{Table, Writer};
use crate::terminal::{self, note, print};

/// Parallel parameter studies of inverse musculoskeletal biomechanics: muscle loads, and whether they are unique.
#[derive(Parser)]
#[command(name = "sinew", version, propagate_version = true, max_term_width = 110)]
#[command(after_help = "Examples:
  sinew run studies/table1.toml                 solve all jobs of a study, print the tables
  sinew plan studies/table1.toml                see the jobs without solving any
  sinew show results/table1                     print the tables of results again
  sinew check my_study.toml my_model.toml       look for mistakes
  sinew compare results/nightly results/baselines/nightly     has anything changed?

Exit code: 0 good, 1 some jobs failed or drift was found, 2 bad input, 130 interrupted.")]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// List the jobs of a study, and why each would be solved or not
    #[command(after_help = "Examples:
  sinew plan studies/table1.toml --all
  sinew plan studies/table1.toml --out /tmp/table1")]
    Plan {
        /// Study file (.toml), or the manifest.json of a run
        study: PathBuf,
        /// Results folder to look into [default: results/<name of the study>]
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        /// List every job, not only the first 20
        #[arg(long)]
        all: bool,
    },
    /// Solve all jobs of a study; goes on where an earlier run stopped
    #[command(after_help = "Examples:
  sinew run studies/table1.toml
  sinew run studies/table1.toml --out /tmp/table1 --jobs 1
  sinew run studies/table1.toml --failed        solve failed jobs again, nothing else
  sinew run studies/table1.toml --fresh         forget earlier results first
  sinew run results/table1 --out /tmp/again     the same study again, from its manifest alone
  seq 0 3 | parallel --joblog log --resume-failed sinew run STUDY --shard {}/4; sinew merge results/NAME

Ctrl-C keeps everything finished; run the same command again to go on.")]
    Run {
        /// Study file (.toml), or the manifest.json of a run or its folder
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
        /// Solve failed jobs again
        #[arg(long)]
        failed: bool,
        /// Solve jobs again that another version of the solver has finished
        #[arg(long)]
        outdated: bool,
        /// Only part I of N, I from 0; `sinew merge` makes the tables when all parts are there
        #[arg(long, value_name = "I/N", conflicts_with = "fresh")]
        shard: Option<Shard>,
    },
    /// Make the tables from what all shards have finished; may be repeated at any time
    #[command(after_help = "Example:\n  sinew merge results/mu_sweep")]
    Merge {
        /// Results folder
        dir: PathBuf,
    },
    /// How far a results folder is: counts, failures, time left
    #[command(after_help = "Example:\n  sinew status results/mu_sweep")]
    Status {
        /// Results folder
        dir: PathBuf,
    },
    /// Look for differences from a baseline, job by job; exit code 1 if there are any
    #[command(after_help = "Examples:
  sinew compare results/nightly results/baselines/nightly
  sinew compare results/nightly results/baselines/nightly --junit report.xml --json report.json
  sinew compare results/nightly results/baselines/nightly --tolerance mean_force_n=1e-4 --tolerance iterations=ignore
  sinew compare results/one results/other --tolerance '*=exact'           the same to the last digit, but for times
  sinew compare results/nightly results/baselines/nightly --accept       these are right from now on

Ranks, statuses and counts are exact, numbers to 1e-6; a file tolerances.toml in the baseline may say otherwise by column.")]
    Compare {
        /// Results folder
        dir: PathBuf,
        /// Folder of the baseline
        baseline: PathBuf,
        /// Relative tolerance of a column, or `exact`, or `ignore`
        #[arg(long, value_name = "COLUMN=TOLERANCE", value_parser = compare::tolerance)]
        tolerance: Vec<(String, crate::compare::Tolerance)>,
        /// Write the differences for programs
        #[arg(long, value_name = "FILE")]
        json: Option<PathBuf>,
        /// Write a test report (JUnit XML), a test a job
        #[arg(long, value_name = "FILE")]
        junit: Option<PathBuf>,
        /// Make these results the baseline
        #[arg(long)]
        accept: bool,
    },
    /// Write (and submit) a Slurm job array for a study, and the merge after it
    #[command(after_help = "Examples:
  sinew slurm studies/mu_sweep.toml --shards 50 --time 02:00:00
  sinew slurm studies/mu_sweep.toml --shards 50 --submit
  sinew slurm studies/mu_sweep.toml --submit                    again: only shards with something missing

The folder must be on a file system that all nodes share.")]
    Slurm(slurm::Arguments),
    /// Print the JSON Schema of study files, for editors
    #[command(after_help = "Example:\n  sinew schema > study.schema.json")]
    Schema,
    /// Write a page to look at: DIR/report.html, which opens anywhere and needs no network
    #[command(after_help = "Examples:
  sinew report results/table1
  sinew report results/nightly --compare results/baselines/nightly
  sinew report results/mu_sweep --out mu_sweep.html
  sinew report results/arm26 --svg --job 2")]
    Report {
        /// Results folder
        dir: PathBuf,
        /// Show what differs from a baseline, old and new values side by side
        #[arg(long, value_name = "BASELINE")]
        compare: Option<PathBuf>,
        /// File to write [default: report.html in the folder]
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
        /// Write the figures too, each an SVG file, into a folder `figures` beside the page
        #[arg(long)]
        svg: bool,
        /// Number of the job whose functions of time are drawn [default: the first that has converged]
        #[arg(long, value_name = "N", requires = "svg")]
        job: Option<u64>,
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
    /// Turn an OpenSim model (.osim, versions 1 to 4) into a model file, and say what could not be mapped
    #[command(after_help = "Examples:
  sinew import arm26.osim                       writes arm26.toml
  sinew import arm26.osim --out models/arm.toml
  sinew import arm26.osim --strict              an error if anything cannot be mapped

A study may also name an .osim file as its model, and sinew check lists what is not mapped.")]
    Import {
        /// OpenSim model (.osim)
        model: PathBuf,
        /// File to write, never over one that is there [default: the model's name with .toml, in this folder]
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
        /// An error if anything cannot be mapped
        #[arg(long)]
        strict: bool,
    },
    /// Lengths and moment arms of all muscles of a spatial model in given poses
    #[command(after_help = "Examples:
  sinew moment-arms data/models/upper_limb.toml poses.csv
  sinew moment-arms data/models/upper_limb.toml poses.csv --out arms.parquet

Poses are rows of joint coordinates, columns such as shoulder_elv_deg; coordinates without a column keep their default.
A moment arm is −∂L/∂q of one coordinate alone, in m.")]
    MomentArms {
        /// Spatial model (.toml, .osim)
        model: PathBuf,
        /// Poses (.csv)
        poses: PathBuf,
        /// File to write, .csv or .parquet [default: CSV to the terminal]
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
    },
    /// Rank the muscles by how much they answer a change, against the job of a reference value
    #[command(after_help = "Examples:
  sinew rank results/pectoralis_slack --axis 'muscle.PectoralisMajor*.tendon_slack_length_scale' --reference 1
  sinew rank results/mu_sweep --axis mu --reference 0.2 --measure mean_activation --out ranking.parquet")]
    Rank {
        /// Results folder
        dir: PathBuf,
        /// Swept name; jobs are compared that agree in all others
        #[arg(long, value_name = "NAME")]
        axis: String,
        /// Its value in the job that others are compared with
        #[arg(long, value_name = "VALUE")]
        reference: String,
        /// Column of muscles.parquet
        #[arg(long, value_name = "COLUMN", default_value = "mean_force_n")]
        measure: String,
        /// File to write, .csv or .parquet, all muscles [default: the first ten of each job, to the terminal]
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
    },
    /// Look for mistakes in study, model and motion files
    #[command(after_help = "Examples:
  sinew check studies/table1.toml
  sinew check data/models/arm.toml
  sinew check data/motions/arm_curl.csv --model data/models/arm.toml")]
    Check {
        /// Study (.toml), model (.toml, .osim) or motion (.csv, .mot, .sto) files
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
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => return answered(error),
    };
    let result: Result<u8> = match cli.command {
        Command::Plan { study, out, all } => plan::plan(&study, out, all),
        Command::Run { study, out, jobs, fresh, failed, outdated, shard } => {
            let (out, threads) = (out.unwrap_or_default(), jobs.map(usize::from));
            run::run(&study, RunOptions { out, threads, fresh, failed, outdated, shard })
        }
        Command::Merge { dir } => run::merge(&dir),
        Command::Status { dir } => status::status(&dir),
        Command::Compare { dir, baseline, tolerance, json, junit, accept } => {
            compare::compare(&dir, &baseline, &compare::Options { tolerances: tolerance, json, junit, accept })
        }
        Command::Slurm(arguments) => slurm::slurm(&arguments),
        Command::Import { model, out, strict } => import::import(&model, out, strict),
        Command::MomentArms { model, poses, out } => moment_arms::moment_arms(&model, &poses, out.as_deref()),
        Command::Rank { dir, axis, reference, measure, out } => rank::rank(
            &dir,
            &rank::Options { axis: &axis, reference: &reference, measure: &measure, out: out.as_deref() },
        ),
        Command::Report { dir, compare, out, svg, job } => report::report(&dir, compare.as_deref(), out, svg, job),
        Command::Schema => {
            print(&format!("{:#}", crate::study::file::schema()));
            Ok(GOOD)
        }
        Command::Show { dir, all } => show::show(&dir, all),
        Command::Check { files, model } => check::check(&files, model.as_deref()),
    };
    let code = result.unwrap_or_else(|error| {
        note(&format!("{:?}", miette::Report::new(error)));
        BAD_INPUT
    });
    ended(code)
}

/// Help, the version, or what is wrong with the arguments.
fn answered(error: clap::Error) -> ExitCode {
    let is_terminal =
        if error.use_stderr() { std::io::stderr().is_terminal() } else { std::io::stdout().is_terminal() };
    let text = if is_terminal { error.render().ansi().to_string() } else { error.render().to_string() };
    match error.use_stderr() {
        true => note(text.trim_end()),
        false => print(text.trim_end()),
    }
    ended(u8::try_from(error.exit_code()).unwrap_or(BAD_INPUT))
}

/// The exit code, unless the answer could not be printed.
fn ended(code: u8) -> ExitCode {
    match terminal::failure() {
        None => ExitCode::from(code),
        Some(error) => {
            note(&format!("cannot write to standard output: {error}; what was finished is kept in the results folder"));
            ExitCode::from(BAD_INPUT)
        }
    }
}

/// Writes a table to a file, by its ending CSV or Parquet (whose path comes back), or as CSV to the terminal.
fn write_table<'p>(table: &Table, metadata: Vec<(String, String)>, out: Option<&'p Path>) -> Result<Option<&'p Path>> {
    let Some(path) = out else {
        print(csv(table)?.trim_end());
        return Ok(None);
    };
    match path.extension().and_then(|e| e.to_str()) {
        Some("csv") => write_whole(path, csv(table)?)?,
        Some("parquet") => {
            let mut writer = Writer::new(path, metadata);
            writer.append(table)?;
            writer.finish()?;
        }
        _ => return Err(Error::table("write", path, "the file ends in .csv or .parquet")),
    }
    Ok(Some(path))
}

/// A cell that spreadsheets do not take for a formula.
fn no_formula(cell: String) -> String {
    let is_text = cell.parse::<f64>().is_err();
    if is_text && is_formula(&cell) { format!("'{cell}") } else { cell }
}

fn csv(table: &Table) -> Result<String> {
    let failed = |e: csv::Error| Error::table("write", Path::new("CSV"), e);
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(table.columns.iter().map(|(name, _)| no_formula(name.clone()))).map_err(failed)?;
    for row in 0..table.rows() {
        let fields = table.columns.iter().map(|(name, _)| no_formula(table.display(name, row).unwrap_or_default()));
        writer.write_record(fields).map_err(failed)?;
    }
    let bytes = writer.into_inner().map_err(|e| Error::table("write", Path::new("CSV"), e))?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}
