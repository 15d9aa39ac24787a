//! The command line: one file per command.

mod arguments;
mod check;
mod compare;
mod describe;
mod export;
mod import;
mod inverse_dynamics;
mod joint_loads;
mod keys;
mod layout;
mod moment_arms;
mod movement;
mod new;
mod output;
mod plan;
mod rank;
mod report;
mod run;
mod schema;
mod show;
mod slurm;
mod status;

use std::io::IsTerminal;
use std::process::ExitCode;

use clap::{CommandFactory, Parser};

use crate::error::Result;
use crate::run::RunOptions;
use crate::terminal::{self, error, note, print};
use arguments::{Cli, Command};

/// Exit codes.
const GOOD: u8 = 0;
const FAILED_JOBS: u8 = 1;
const BAD_INPUT: u8 = 2;
const INTERRUPTED: u8 = 130;

/// Parses the arguments of the process and runs the command.
pub fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => return print_message(error),
    };
    terminal::speak((&cli.terminal).into());
    let is_colored = terminal::uses_color(std::io::stderr().is_terminal());
    // Fails only if there is a hook already.
    let _ = miette::set_hook(Box::new(move |_| Box::new(miette::MietteHandlerOpts::new().color(is_colored).build())));
    let code = run_command(cli.command).unwrap_or_else(|failure| {
        error(&format!("{:?}", miette::Report::new(failure)));
        BAD_INPUT
    });
    exit_code(code)
}

fn run_command(command: Command) -> Result<u8> {
    match command {
        Command::New { name, model, motion, loads, window } => {
            let window = window.map(|ends| [ends[0], ends[1]]);
            new::new(&name, model.zip(motion).map(|(model, motion)| new::Named { model, motion, loads, window }))
        }
        Command::Keys { model, pattern, look } => keys::keys(model.as_deref(), pattern.as_deref(), look),
        Command::Plan { study, out, all, look } => plan::plan(&study, out, all, look),
        Command::Run { study, out, jobs, fresh, failed, outdated, shard } => {
            let (out, threads) = (out.unwrap_or_default(), jobs.map(usize::from));
            run::run(&study, RunOptions { out, threads, fresh, failed, outdated, shard })
        }
        Command::Merge { dir } => run::merge(&dir),
        Command::Status { dir } => status::status(&dir),
        Command::Compare { dir, baseline, tolerance, json, junit, accept } => {
            compare::compare(&dir, &baseline, &compare::CompareOptions { tolerances: tolerance, json, junit, accept })
        }
        Command::Slurm(arguments) => slurm::slurm(&arguments),
        Command::Import { model, paths, out, strict } => import::import(&model, paths.as_deref(), out, strict),
        Command::InverseDynamics(arguments) => inverse_dynamics::run(&arguments),
        Command::JointLoads { movement, muscle_forces } => joint_loads::run(&movement, &muscle_forces),
        Command::MomentArms { model, poses, out } => moment_arms::moment_arms(&model, &poses, out.as_deref()),
        Command::Rank { dir, axis, reference, measure, out, look } => rank::rank(
            &dir,
            &rank::RankOptions { axis: &axis, reference: &reference, measure: &measure, out: out.as_deref(), look },
        ),
        Command::Report { dir, compare, out, svg, job } => report::report(&dir, compare.as_deref(), out, svg, job),
        Command::Schema { kind, keys } => schema::schema(kind, keys),
        Command::Show { dir, all, table, look } => show::show(&dir, all, table.as_deref(), look),
        Command::Describe { dir, table, look } => describe::describe(dir.as_deref(), table.as_deref(), look),
        Command::Export { dir, sto, csv: _, table, jobs, out } => {
            export::export(&dir, &export::ExportOptions { sto, table, jobs, out })
        }
        Command::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut Cli::command(), "sinew", &mut script);
            print(String::from_utf8_lossy(&script).trim_end());
            Ok(GOOD)
        }
        Command::Check { files, model } => check::check(&files, model.as_deref()),
    }
}

/// Prints clap's help, version or error message; returns the exit code.
fn print_message(message: clap::Error) -> ExitCode {
    let is_terminal =
        if message.use_stderr() { std::io::stderr().is_terminal() } else { std::io::stdout().is_terminal() };
    let text = if terminal::uses_color(is_terminal) {
        message.render().ansi().to_string()
    } else {
        message.render().to_string()
    };
    match message.use_stderr() {
        true => error(text.trim_end()),
        false => print(text.trim_end()),
    }
    exit_code(u8::try_from(message.exit_code()).unwrap_or(BAD_INPUT))
}

/// The exit code: `code`, or [`BAD_INPUT`] if standard output could not be written.
fn exit_code(code: u8) -> ExitCode {
    match terminal::failure() {
        None => ExitCode::from(code),
        Some(failure) => {
            error(&format!("cannot write to standard output: {failure}; finished jobs are kept in the results folder"));
            ExitCode::from(BAD_INPUT)
        }
    }
}
