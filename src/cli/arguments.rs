//! The arguments of the command line.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};

use super::{compare, slurm};
use crate::run::Shard;
use crate::terminal::{Color, Voice};

/// Parallel parameter studies of inverse musculoskeletal biomechanics: muscle loads, and whether they are unique.
#[derive(Parser)]
#[command(name = "sinew", version, propagate_version = true, max_term_width = 110)]
#[command(after_help = "Examples:
  sinew new my_study                            write a commented study to start from
  sinew run my_study.toml                       solve all its jobs, print the tables
  sinew plan my_study.toml                      list the jobs without solving any
  sinew show results/my_study                   print the tables again
  sinew report results/my_study                 write a page of figures
  sinew keys my_model.osim                      what a study can sweep
  sinew check my_study.toml my_model.toml       look for mistakes
  sinew compare results/nightly results/baselines/nightly     has anything changed?

Exit code: 0 success, 1 some jobs failed or drift was found, 2 bad input, 130 interrupted.")]
pub struct Cli {
    #[command(subcommand)]
    pub command: Command,
    #[command(flatten)]
    pub terminal: Terminal,
}

/// What every command takes.
#[derive(Args)]
pub struct Terminal {
    /// Colour the output: `auto` does so on a terminal unless NO_COLOR is set
    #[arg(long, global = true, value_name = "WHEN", default_value = "auto", help_heading = "Output")]
    pub color: ColorChoice,
    /// Print only errors and the last line
    #[arg(short, long, global = true, conflicts_with = "verbose", help_heading = "Output")]
    pub quiet: bool,
    /// Print more: a line for each finished job
    #[arg(short, long, global = true, help_heading = "Output")]
    pub verbose: bool,
}

/// Kinds of files that have a schema.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SchemaKind {
    Study,
    /// Models in the plane
    Model,
    /// Models in space
    SpatialModel,
}

/// How a table is printed.
#[derive(Args, Clone, Copy)]
pub struct Look {
    /// Print all columns, however wide the table gets
    #[arg(long)]
    pub wide: bool,
    /// Print the plain table, for programs
    #[arg(long, value_name = "FORMAT", default_value = "table")]
    pub format: Format,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ColorChoice {
    Auto,
    Always,
    Never,
}

impl From<&Terminal> for Voice {
    fn from(terminal: &Terminal) -> Self {
        let color = match terminal.color {
            ColorChoice::Auto => Color::Auto,
            ColorChoice::Always => Color::Always,
            ColorChoice::Never => Color::Never,
        };
        Self { color, quiet: terminal.quiet, verbose: terminal.verbose }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Format {
    /// Aligned columns that fit the terminal
    Table,
    Csv,
    Json,
    Markdown,
}

#[derive(Subcommand)]
pub enum Command {
    /// Write a commented study to start from
    #[command(after_help = "Examples:
  sinew new my_study                                           on the reference arm, written beside it
  sinew new my_study --model arm26.osim --motion curl.mot

Next: sinew run my_study.toml")]
    New {
        /// Name of the study; NAME.toml is written
        name: String,
        /// Model (.toml, .osim)
        #[arg(long, value_name = "FILE", requires = "motion")]
        model: Option<PathBuf>,
        /// Motion (.csv, .mot, .sto)
        #[arg(long, value_name = "FILE", requires = "model")]
        motion: Option<PathBuf>,
    },
    /// List what a study can set and sweep: its settings, or the numbers of a model
    #[command(after_help = "Examples:
  sinew keys                                     settings, with defaults
  sinew keys arm26.osim                          kinds of numbers of a model, with values and units
  sinew keys arm26.osim 'muscle.BRA.*'           each that fits
  sinew keys arm26.osim '*' --format csv > keys.csv")]
    Keys {
        /// Model (.toml, .osim); the settings of studies if left out
        model: Option<PathBuf>,
        /// List each key that fits; * stands for any letters
        pattern: Option<String>,
        #[command(flatten)]
        look: Look,
    },
    /// List the jobs of a study, and whether a run would solve each
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
        #[command(flatten)]
        look: Look,
    },
    /// Solve all jobs of a study, continuing where an earlier run stopped
    #[command(after_help = "Examples:
  sinew run studies/table1.toml
  sinew run studies/table1.toml --out /tmp/table1 --jobs 1
  sinew run studies/table1.toml --failed        solve failed jobs again
  sinew run studies/table1.toml --fresh         discard earlier results first
  sinew run results/table1 --out /tmp/again     the same study again, from its manifest alone
  seq 0 3 | parallel --joblog log --resume-failed sinew run STUDY --shard {}/4; sinew merge results/NAME

Ctrl-C keeps everything that is finished; run the same command again to continue.")]
    Run {
        /// Study file (.toml), or the manifest.json of a run or its folder
        study: PathBuf,
        /// Results folder [default: results/<name of the study>]
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        /// Number of jobs at a time [default: one per core]
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
        jobs: Option<u16>,
        /// Discard the results in the folder first
        #[arg(long)]
        fresh: bool,
        /// Solve failed jobs again
        #[arg(long)]
        failed: bool,
        /// Solve jobs again that another version of the solver solved
        #[arg(long)]
        outdated: bool,
        /// Solve only part I of N, I from 0; `sinew merge` makes the tables when all parts are finished
        #[arg(long, value_name = "I/N", conflicts_with = "fresh")]
        shard: Option<Shard>,
    },
    /// Make the tables from what all shards have finished; can be repeated at any time
    #[command(after_help = "Example:\n  sinew merge results/mu_sweep")]
    Merge {
        /// Results folder
        dir: PathBuf,
    },
    /// Show how far a run is: counts, failures, time left
    #[command(after_help = "Example:\n  sinew status results/mu_sweep")]
    Status {
        /// Results folder
        dir: PathBuf,
    },
    /// Compare results with a baseline, job by job; exit code 1 if they differ
    #[command(after_help = "Examples:
  sinew compare results/nightly results/baselines/nightly
  sinew compare results/nightly results/baselines/nightly --junit report.xml --json report.json
  sinew compare results/nightly results/baselines/nightly --tolerance mean_force_n=1e-4 --tolerance iterations=ignore
  sinew compare results/one results/other --tolerance '*=exact'           identical, times aside
  sinew compare results/nightly results/baselines/nightly --accept       make these the baseline

Ranks, statuses and counts are exact, numbers to 1e-6; a file tolerances.toml in the baseline may set others by column.")]
    Compare {
        /// Results folder
        dir: PathBuf,
        /// Folder of the baseline
        baseline: PathBuf,
        /// Relative tolerance of a column, or `exact`, or `ignore`
        #[arg(long, value_name = "COLUMN=TOLERANCE", value_parser = compare::tolerance)]
        tolerance: Vec<(String, crate::compare::Tolerance)>,
        /// Write the differences as JSON
        #[arg(long, value_name = "FILE")]
        json: Option<PathBuf>,
        /// Write a test report (JUnit XML), one test for each job
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
    /// Print the JSON Schema of study or model files, for editors; or their keys as a table
    #[command(after_help = "Examples:
  sinew schema > study.schema.json
  sinew schema spatial-model --keys")]
    Schema {
        /// Kind of file
        #[arg(default_value = "study")]
        kind: SchemaKind,
        /// Print the keys with their meaning, as Markdown
        #[arg(long)]
        keys: bool,
    },
    /// Write a page of figures, DIR/report.html, which opens in any browser without a network
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
    #[command(after_help = "Examples:
  sinew show results/table1
  sinew show results/abduction --all --wide | less -S
  sinew show results/abduction --table muscles --format csv > muscles.csv")]
    Show {
        /// Results folder
        dir: PathBuf,
        /// Every job, not only the first 24
        #[arg(long)]
        all: bool,
        /// Table to print with --format [default: jobs]
        #[arg(long, value_name = "NAME")]
        table: Option<String>,
        #[command(flatten)]
        look: Look,
    },
    /// Turn an OpenSim model (.osim, versions 1 to 4) into a model file, and list what is lost
    #[command(after_help = "Examples:
  sinew import arm26.osim                       writes arm26.toml
  sinew import arm26.osim --out models/arm.toml
  sinew import arm26.osim --strict              an error if anything is lost

A study may also name an .osim file as its model; sinew check lists what is lost.")]
    Import {
        /// OpenSim model (.osim)
        model: PathBuf,
        /// File to write; an existing one is never replaced [default: the model's name with .toml, in this folder]
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
        /// Fail if anything is lost
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
    /// Rank the muscles by how much they respond to a change, against the job of a reference value
    #[command(after_help = "Examples:
  sinew rank results/pectoralis_slack --axis 'muscle.PectoralisMajor*.tendon_slack_length_scale' --reference 1
  sinew rank results/mu_sweep --axis mu --reference 0.2 --measure mean_activation --out ranking.parquet")]
    Rank {
        /// Results folder
        dir: PathBuf,
        /// Swept name; compared are jobs that agree in all others
        #[arg(long, value_name = "NAME")]
        axis: String,
        /// Its value in the reference job
        #[arg(long, value_name = "VALUE")]
        reference: String,
        /// Column of muscles.parquet
        #[arg(long, value_name = "COLUMN", default_value = "mean_force_n")]
        measure: String,
        /// File to write, .csv or .parquet, all muscles [default: the first ten of each job, to the terminal]
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
        #[command(flatten)]
        look: Look,
    },
    /// Explain every table and column, with its unit
    #[command(after_help = "Examples:
  sinew describe
  sinew describe results/table1 --table muscles
  sinew describe --format csv > columns.csv")]
    Describe {
        /// Results folder, for its tables and swept names [default: all tables that there are]
        dir: Option<PathBuf>,
        /// One table
        #[arg(long, value_name = "NAME")]
        table: Option<String>,
        #[command(flatten)]
        look: Look,
    },
    /// Write jobs as OpenSim storage files (.sto), or tables as CSV
    #[command(group = clap::ArgGroup::new("kind").required(true))]
    #[command(after_help = "Examples:
  sinew export results/arm26 --sto --jobs 0,3        coordinates, activations, forces of jobs 0 and 3
  sinew export results/arm26 --csv                   all tables
  sinew export results/arm26 --csv --table muscles --out tables

Storage files need `trajectories = true` in the study. They open in OpenSim (File, Load Motion) and its readers; SI units,
radians, by the clock of the motion file.")]
    Export {
        /// Results folder
        dir: PathBuf,
        /// Storage files, one for each job and signal
        #[arg(long, group = "kind")]
        sto: bool,
        /// CSV files, one for each table
        #[arg(long, group = "kind")]
        csv: bool,
        /// One table [default: all]
        #[arg(long, value_name = "NAME", requires = "csv")]
        table: Option<String>,
        /// Numbers of jobs [default: all]
        #[arg(long, value_name = "N,…", value_delimiter = ',')]
        jobs: Vec<u64>,
        /// Folder to write to [default: DIR/export]
        #[arg(long, value_name = "FOLDER")]
        out: Option<PathBuf>,
    },
    /// Print a script that completes commands and options in a shell
    #[command(after_help = "Example:\n  sinew completions bash > ~/.local/share/bash-completion/completions/sinew")]
    Completions { shell: clap_complete::Shell },
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
