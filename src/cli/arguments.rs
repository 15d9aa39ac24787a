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
  sinew new my_study                        write a commented study
  sinew run my_study.toml                   solve all jobs, print the tables
  sinew plan my_study.toml                  list the jobs without solving them
  sinew show results/my_study               print the tables again
  sinew report results/my_study             write a page of figures
  sinew keys my_model.osim                  what a study can vary
  sinew check my_study.toml my_model.toml   look for mistakes
  # Has anything changed?
  sinew compare results/nightly results/baselines/nightly

Exit code: 0 success, 1 some jobs failed or drift was found, 2 bad input, 130 interrupted.")]
pub struct Cli {
    #[command(subcommand)]
    pub command: Command,
    #[command(flatten)]
    pub terminal: Terminal,
}

/// Options of all commands.
#[derive(Args)]
pub struct Terminal {
    /// Colour the output; `auto` uses colour on a terminal unless NO_COLOR is set
    #[arg(long, global = true, value_name = "WHEN", default_value = "auto", help_heading = "Output")]
    pub color: ColorChoice,
    /// Print only errors and the last line
    #[arg(short, long, global = true, conflicts_with = "verbose", help_heading = "Output")]
    pub quiet: bool,
    /// Print a line for each finished job
    #[arg(short, long, global = true, help_heading = "Output")]
    pub verbose: bool,
}

/// A motion of a model, and where its table goes.
#[derive(Args)]
pub struct MovementArguments {
    /// Model (.toml, .osim)
    pub model: PathBuf,
    /// Joint coordinates over time (.csv, .mot, .sto)
    pub motion: PathBuf,
    /// External loads, such as ground reactions (.xml, .toml)
    #[arg(long, value_name = "FILE")]
    pub loads: Option<PathBuf>,
    /// Only these instants, s [default: the whole motion]
    #[arg(long, num_args = 2, value_names = ["FROM", "TO"], allow_negative_numbers = true)]
    pub window: Option<Vec<f64>>,
    /// Cut-off frequency of the low-pass on the coordinates, Hz; 0 for none
    #[arg(long, value_name = "HZ", default_value_t = 0.0, value_parser = frequency, allow_negative_numbers = true)]
    pub smoothing: f64,
    /// Cut-off frequency of the low-pass on the external loads, Hz; 0 for none
    #[arg(long, value_name = "HZ", default_value_t = 0.0, value_parser = frequency, allow_negative_numbers = true)]
    pub force_smoothing: f64,
    /// File to write, .csv or .parquet [default: CSV to the terminal]
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

/// Kinds of files with a schema.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SchemaKind {
    Study,
    /// Planar models
    Model,
    /// Spatial models
    SpatialModel,
}

/// How a table is printed.
#[derive(Args, Clone, Copy)]
pub struct Look {
    /// Print all columns, even if they do not fit the terminal
    #[arg(long)]
    pub wide: bool,
    /// Format of the table
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
  sinew new my_study   on the reference arm, written beside it
  sinew new my_study --model arm26.osim --motion curl.mot
  sinew new walk --model gait.osim --motion ik.sto --loads grf.xml --window 0.5 1.6

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
        /// External loads, such as ground reactions (.xml of OpenSim, .toml): all bodies then move by forces
        #[arg(long, value_name = "FILE", requires = "model")]
        loads: Option<PathBuf>,
        /// Part of the motion to solve, s
        #[arg(long, num_args = 2, value_names = ["FROM", "TO"], requires = "model", allow_negative_numbers = true)]
        window: Option<Vec<f64>>,
    },
    /// List what a study can set and sweep: its settings, or the numeric parameters of a model
    #[command(after_help = "Examples:
  sinew keys                                     settings with their defaults
  sinew keys arm26.osim   parameters of a model by kind, with values and units
  sinew keys arm26.osim 'muscle.BRA.*'           all keys that match
  sinew keys arm26.osim '*' --format csv > keys.csv")]
    Keys {
        /// Model (.toml, .osim); if omitted, the settings are listed
        model: Option<PathBuf>,
        /// List all keys that match; * stands for any characters
        pattern: Option<String>,
        #[command(flatten)]
        look: Look,
    },
    /// List the jobs of a study, and which of them a run would solve
    #[command(after_help = "Examples:
  sinew plan studies/table1.toml --all
  sinew plan studies/table1.toml --out /tmp/table1")]
    Plan {
        /// Study file (.toml), or the manifest.json of a run
        study: PathBuf,
        /// Results folder to check for finished jobs [default: results/<name of the study>]
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        /// List all jobs instead of the first 20
        #[arg(long)]
        all: bool,
        #[command(flatten)]
        look: Look,
    },
    /// Solve all jobs of a study, continuing where an earlier run stopped
    #[command(after_help = "Examples:
  sinew run studies/table1.toml
  sinew run studies/table1.toml --out /tmp/table1 --jobs 1
  sinew run studies/table1.toml --failed        also solve failed jobs again
  sinew run studies/table1.toml --fresh         discard earlier results first
  # Run a study again from its manifest
  sinew run results/table1 --out /tmp/again
  seq 0 3 | parallel --joblog log --resume-failed sinew run STUDY --shard {}/4; sinew merge results/NAME

Ctrl-C keeps all finished jobs; run the same command again to continue.")]
    Run {
        /// Study file (.toml), or the manifest.json of a run or its folder
        study: PathBuf,
        /// Results folder [default: results/<name of the study>]
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        /// Number of jobs to solve in parallel [default: one per core]
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
        jobs: Option<u16>,
        /// Discard existing results in the folder first
        #[arg(long)]
        fresh: bool,
        /// Solve failed jobs again
        #[arg(long)]
        failed: bool,
        /// Solve jobs again whose results come from another version of the solver
        #[arg(long)]
        outdated: bool,
        /// Solve only shard I of N (I from 0); `sinew merge` writes the tables once all shards have finished
        #[arg(long, value_name = "I/N", conflicts_with = "fresh")]
        shard: Option<Shard>,
    },
    /// Write the tables from the finished jobs of all shards; can be repeated at any time
    #[command(after_help = "Example:\n  sinew merge results/mu_sweep")]
    Merge {
        /// Results folder
        dir: PathBuf,
    },
    /// Show the progress of a run: counts, failures, time left
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
  # All columns equal, except times
  sinew compare results/one results/other --tolerance '*=exact'
  # Make these results the baseline
  sinew compare results/nightly results/baselines/nightly --accept

By default, ranks, statuses and counts must be equal and most numbers agree within a relative 1e-6. A file
tolerances.toml in the baseline can set other tolerances by column.")]
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
        /// Write a JUnit XML report with one test per job
        #[arg(long, value_name = "FILE")]
        junit: Option<PathBuf>,
        /// Make these results the baseline
        #[arg(long)]
        accept: bool,
    },
    /// Write (and submit) a Slurm job array for a study, followed by a merge job
    #[command(after_help = "Examples:
  sinew slurm studies/mu_sweep.toml --shards 50 --time 02:00:00
  sinew slurm studies/mu_sweep.toml --shards 50 --submit
  # Submit only shards with missing jobs
  sinew slurm studies/mu_sweep.toml --submit

The results folder must be on a file system that all nodes share.")]
    Slurm(slurm::Arguments),
    /// Print the JSON Schema of study or model files for editors, or a table of their keys
    #[command(after_help = "Examples:
  sinew schema > study.schema.json
  sinew schema spatial-model --keys")]
    Schema {
        /// Kind of file
        #[arg(default_value = "study")]
        kind: SchemaKind,
        /// Print the keys with their meaning as a Markdown table
        #[arg(long)]
        keys: bool,
    },
    /// Write a page of figures, DIR/report.html, for any browser; it needs no network
    #[command(after_help = "Examples:
  sinew report results/table1
  sinew report results/nightly --compare results/baselines/nightly
  sinew report results/mu_sweep --out mu_sweep.html
  sinew report results/arm26 --svg --job 2")]
    Report {
        /// Results folder
        dir: PathBuf,
        /// Show differences from a baseline, old and new values side by side
        #[arg(long, value_name = "BASELINE")]
        compare: Option<PathBuf>,
        /// File to write [default: report.html in the folder]
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
        /// Also write each figure as an SVG file to the folder `figures` beside the page
        #[arg(long)]
        svg: bool,
        /// Number of the job whose trajectories are drawn [default: the first converged job]
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
        /// Show all jobs instead of the first 24
        #[arg(long)]
        all: bool,
        /// Table to print with --format [default: jobs]
        #[arg(long, value_name = "NAME")]
        table: Option<String>,
        #[command(flatten)]
        look: Look,
    },
    /// Convert an OpenSim model (.osim, versions 1 to 4) to a model file, and list what is lost
    #[command(after_help = "Examples:
  sinew import arm26.osim                       writes arm26.toml
  sinew import arm26.osim --out models/arm.toml
  sinew import arm26.osim --strict              fails if anything is lost
  sinew import gait.osim --paths fitted.xml     lengths of muscles by polynomials (FunctionBasedPath)

A study can also use an .osim file directly as its model; `sinew check` lists what is lost.")]
    Import {
        /// OpenSim model (.osim)
        model: PathBuf,
        /// OpenSim file of function-based paths (.xml), whose lengths replace those along the paths
        #[arg(long, value_name = "FILE")]
        paths: Option<PathBuf>,
        /// File to write; never replaces an existing file [default: the model's name with .toml, in the current folder]
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
        /// Fail if anything is lost
        #[arg(long)]
        strict: bool,
    },
    /// Compute the net moment or force of each joint coordinate over a motion
    #[command(after_help = "Examples:
  sinew inverse-dynamics gait.osim walk_ik.mot --loads grf_walk.xml --smoothing 6 --out moments.csv
  sinew inverse-dynamics gait.osim walk_ik.mot --loads grf_walk.xml --window 0.48 1.61 > moments.csv

Inertial forces less gravity and loads, as in OpenSim's InverseDynamicsTool: what muscles, or
whatever else drives the coordinate, must make. Columns are <coordinate>_moment_n_m and
<coordinate>_force_n; rows are the instants of the motion. Loads are OpenSim's ExternalLoads (.xml),
or a .toml with `table = \"forces.mot\"` and [[external_load]] entries: name, body, force, point and
moment (prefixes of columns), force_in, point_in. External loads need a spatial model.")]
    InverseDynamics(MovementArguments),
    /// Compute the loads that joints carry in a motion with known muscle forces (joint contact loads)
    #[command(after_help = "Examples:
  sinew joint-loads gait.osim walk_ik.mot --loads grf_walk.xml --muscle-forces forces.sto --out joints.parquet

Force and moment on the child, at the origin of the joint's frame in the child, as in OpenSim's
JointReaction, in the axes of the ground, the parent and the child (column `frame`). FORCES has a
column for each muscle, in N. The model must be spatial.")]
    JointLoads {
        #[command(flatten)]
        movement: MovementArguments,
        /// Muscle forces over time (.sto, .mot, .csv), such as OpenSim's StaticOptimization_force.sto
        #[arg(long, value_name = "FORCES")]
        muscle_forces: PathBuf,
    },
    /// Compute lengths and moment arms of all muscles of a spatial model in given poses
    #[command(after_help = "Examples:
  sinew moment-arms data/models/upper_limb.toml poses.csv
  sinew moment-arms data/models/upper_limb.toml poses.csv --out arms.parquet

Each row of POSES is a pose; columns are joint coordinates such as shoulder_elv_deg. Coordinates without
a column keep their default. A moment arm is −∂L/∂q, in m; coordinates coupled to q move with it.")]
    MomentArms {
        /// Spatial model (.toml, .osim)
        model: PathBuf,
        /// Poses (.csv)
        poses: PathBuf,
        /// File to write, .csv or .parquet [default: CSV to the terminal]
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
    },
    /// Rank muscles by their response to a swept parameter, relative to a reference value
    #[command(after_help = "Examples:
  sinew rank results/pectoralis_slack --axis 'muscle.PectoralisMajor*.tendon_slack_length_scale' --reference 1
  sinew rank results/my_study --axis mu --reference 0.2 --measure mean_activation --out ranking.parquet")]
    Rank {
        /// Results folder
        dir: PathBuf,
        /// Swept parameter; a job is compared with the reference job that has the same values of all other parameters
        #[arg(long, value_name = "NAME")]
        axis: String,
        /// Value of the parameter in the reference job
        #[arg(long, value_name = "VALUE")]
        reference: String,
        /// Column of muscles.parquet to rank by
        #[arg(long, value_name = "COLUMN", default_value = "mean_force_n")]
        measure: String,
        /// File to write (.csv or .parquet), with all muscles [default: print the first ten of each job]
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
        #[command(flatten)]
        look: Look,
    },
    /// Explain every table and column, with units
    #[command(after_help = "Examples:
  sinew describe
  sinew describe results/table1 --table muscles
  sinew describe --format csv > columns.csv")]
    Describe {
        /// Results folder whose tables and swept columns to describe [default: all possible tables]
        dir: Option<PathBuf>,
        /// Describe only this table
        #[arg(long, value_name = "NAME")]
        table: Option<String>,
        #[command(flatten)]
        look: Look,
    },
    /// Write jobs as OpenSim storage files (.sto), or tables as CSV
    #[command(group = clap::ArgGroup::new("kind").required(true))]
    #[command(after_help = "Examples:
  # Coordinates, activations, forces of jobs 0 and 3
  sinew export results/arm26 --sto --jobs 0,3
  sinew export results/arm26 --csv                   all tables
  sinew export results/arm26 --csv --table muscles --out tables

Storage files require `trajectories = true` in the study. OpenSim (File, Load Motion) and other programs
can read them. Units are SI and radians; times are those of the motion file.")]
    Export {
        /// Results folder
        dir: PathBuf,
        /// Write storage files, one per job and signal
        #[arg(long, group = "kind")]
        sto: bool,
        /// Write CSV files, one per table
        #[arg(long, group = "kind")]
        csv: bool,
        /// Write only this table [default: all]
        #[arg(long, value_name = "NAME", requires = "csv")]
        table: Option<String>,
        /// Numbers of the jobs to write [default: all]
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
        /// Model to check motion files against
        #[arg(long, value_name = "FILE")]
        model: Option<PathBuf>,
    },
}

fn frequency(text: &str) -> Result<f64, String> {
    let hz = text.parse::<f64>().ok().filter(|hz| hz.is_finite() && *hz >= 0.0);
    hz.ok_or_else(|| "a frequency in Hz, at least 0".to_owned())
}
