//! `sinew slurm`: runs a study as a Slurm job array. The plan is frozen in the results folder, each array element
//! solves a shard of it, and a dependent job merges the results. All state is in the results folder: called again, it
//! submits only shards with missing jobs.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use super::{GOOD, print};
use crate::error::{Error, Result};
use crate::files::write_atomically;
use crate::names::counted;
use crate::run::store::Store;
use crate::run::{RunOptions, Shard, check_folder, default_folder, write_plan};
use crate::study::Study;
use crate::study::file::OnFailure;

/// Slurm's default of MaxArraySize.
const DEFAULT_MAX_ARRAY: usize = 1001;
const DEFAULT_SHARDS: usize = 16;
/// Time limit of Slurm's commands, which hang while a daemon is down.
const COMMAND_TIMEOUT: Duration = Duration::from_secs(60);

#[derive(clap::Args)]
pub struct Arguments {
    /// Study file (.toml)
    study: PathBuf,
    /// Results folder, shared by all nodes [default: results/<name of the study>]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Number of shards, one per array element [default: as in the previous call, or 16]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    shards: Option<u32>,
    /// Cores per array element, and jobs that it solves in parallel
    #[arg(long, value_name = "N", default_value_t = 1)]
    cpus: u16,
    /// Time limit of an array element, in the format of sbatch
    #[arg(long, value_name = "LIMIT", value_parser = one_line)]
    time: Option<String>,
    /// Another option for sbatch, such as --sbatch=--partition=long; can be repeated
    #[arg(long, value_name = "OPTION", allow_hyphen_values = true, value_parser = one_line)]
    sbatch: Vec<String>,
    /// Submit the scripts instead of only writing them
    #[arg(long)]
    submit: bool,
}

/// First lines of every script.
const BEGIN: &str = "#!/usr/bin/env bash\n# Written by `sinew slurm`.";

/// True if there is no such file, or if an earlier call wrote it.
fn is_replaceable(path: &Path) -> bool {
    std::fs::read(path)
        .map_or_else(|e| e.kind() == std::io::ErrorKind::NotFound, |content| content.starts_with(BEGIN.as_bytes()))
}

/// Rejects an option that would add lines to a script.
fn one_line(text: &str) -> std::result::Result<String, String> {
    match text.is_empty() || text.contains(char::is_control) {
        true => Err("it must not be empty or contain line breaks or other control characters".to_owned()),
        false => Ok(text.to_owned()),
    }
}

/// Rejects a path that cannot be written in a Slurm script.
fn check_path(path: &Path) -> Result<()> {
    let fits = path.to_str().is_some_and(|text| !text.contains(['"', '\\']) && !text.contains(char::is_control));
    let reason = "the path must be UTF-8 without \", \\, line breaks or other control characters; choose another --out";
    if fits { Ok(()) } else { Err(Error::table("write scripts for", path, reason)) }
}

pub fn slurm(arguments: &Arguments) -> Result<u8> {
    let study = Study::load(&arguments.study)?;
    let out = arguments.out.clone().unwrap_or_else(|| default_folder(&study));
    check_path(&std::path::absolute(&out).map_err(|e| Error::io("find", &out, e))?)?;
    let io = |action, path: &Path| {
        let path = path.to_owned();
        move |e| Error::io(action, &path, e)
    };
    std::fs::create_dir_all(&out).map_err(io("create", &out))?;
    let out = out.canonicalize().map_err(io("find", &out))?;
    check_path(&out)?;
    let folder = out.join("slurm");
    let shards = shards(arguments, &study, &folder);
    let options = RunOptions { out: out.clone(), shard: Some(Shard { index: 0, count: shards }), ..Default::default() };
    let existing = check_folder(&study, &RunOptions { shard: None, ..options.clone() })?;
    let (array, merge) = (folder.join("array.sh"), folder.join("merge.sh"));
    if let Some(other) = [&array, &merge].into_iter().find(|path| !is_replaceable(path)) {
        let reason = "it was not written by `sinew slurm`; choose another --out, or move it away";
        return Err(Error::table("overwrite", other, reason));
    }
    std::fs::create_dir_all(folder.join("log")).map_err(io("create", &folder))?;
    write_plan(&study, &options, existing, false)?;
    let missing = missing(&study, &Store::read(&out)?, shards);

    let sinew = std::env::current_exe().map_err(io("find", Path::new("sinew")))?;
    check_path(&sinew)?;
    write_atomically(&array, array_script(arguments, &study, &out, &sinew, shards))?;
    write_atomically(&merge, merge_script(arguments, &study, &out, &sinew))?;
    write_atomically(&folder.join("shards"), format!("{shards}\n"))?;
    print(&format!(
        "{}: {} in {}, scripts in {}",
        study.name,
        counted(study.jobs.len(), "job"),
        counted(shards, "shard"),
        folder.display()
    ));
    if missing.is_empty() {
        print(&format!("no jobs are missing: `sinew merge {}` writes the tables", out.display()));
        return Ok(GOOD);
    }
    let elements = ranges(&missing);
    if !arguments.submit {
        print("to submit, add --submit or run:");
        print(&format!("  job=$(sbatch --parsable --array={elements} {})", quoted(&array)));
        print(&format!("  sbatch --dependency=afterany:$job {}", quoted(&merge)));
        return Ok(GOOD);
    }
    let job = sbatch(&[&format!("--array={elements}")], &array)?;
    // afterany: the merge runs even if elements failed; it reports missing jobs itself.
    let after = sbatch(&[&format!("--dependency=afterany:{job}")], &merge)?;
    print(&format!(
        "submitted {} ({elements}) as job {job} and the merge as job {after}",
        counted(missing.len(), "shard")
    ));
    print(&format!(
        "`sinew status {}` shows progress; run this command again later to submit shards with missing jobs",
        out.display()
    ));
    Ok(GOOD)
}

/// Number of shards: as requested, or as in the previous call; at most one per block of jobs, and at most MaxArraySize.
fn shards(arguments: &Arguments, study: &Study, folder: &Path) -> usize {
    let before = std::fs::read_to_string(folder.join("shards")).ok().and_then(|text| text.trim().parse().ok());
    let wanted = arguments.shards.map(|n| n as usize).or(before).unwrap_or(DEFAULT_SHARDS);
    let config = output(Command::new("scontrol").args(["show", "config"])).unwrap_or_default();
    let line = config.lines().find_map(|line| line.trim().strip_prefix("MaxArraySize"));
    let most = line.and_then(|line| line.split('=').nth(1)?.trim().parse().ok()).unwrap_or(DEFAULT_MAX_ARRAY);
    let count = wanted.min(study.blocks().len()).min(most).max(1);
    if count < wanted {
        print(&format!(
            "using {} instead of {wanted}: the study has {}, and an array at most {most} elements",
            counted(count, "shard"),
            counted(study.blocks().len(), "job block")
        ));
    }
    count
}

/// Indices of the shards with jobs that have no result.
fn missing(study: &Study, store: &Store, shards: usize) -> BTreeSet<usize> {
    let blocks = study.blocks();
    let open = |(_, block): &(usize, &&[crate::study::Job])| block.iter().any(|job| store.get(&job.id).is_none());
    blocks.iter().enumerate().filter(open).map(|(i, _)| i % shards).collect()
}

/// Array indices as Slurm writes them, such as `0,2-5,7`.
fn ranges(numbers: &BTreeSet<usize>) -> String {
    let numbers: Vec<usize> = numbers.iter().copied().collect();
    let runs = numbers.chunk_by(|a, b| a + 1 == *b).map(|run| match run {
        [one] => one.to_string(),
        _ => format!("{}-{}", run[0], run[run.len() - 1]),
    });
    runs.collect::<Vec<_>>().join(",")
}

/// Quotes a path as one word for the shell.
fn quoted(path: &Path) -> String {
    format!("'{}'", path.display().to_string().replace('\'', r"'\''"))
}

fn directives(arguments: &Arguments, study: &Study, out: &Path, part: &str, log: &str) -> String {
    let mut lines = vec![
        BEGIN.to_owned(),
        format!("#SBATCH --job-name=sinew-{part}-{}", study.name),
        // In file names of Slurm, % begins a pattern.
        format!("#SBATCH --output=\"{}/slurm/log/{log}\"", out.display().to_string().replace('%', "%%")),
        "#SBATCH --open-mode=append".to_owned(),
        // If a node is lost, Slurm restarts the element, which continues with the missing jobs.
        "#SBATCH --requeue".to_owned(),
    ];
    lines.extend(arguments.sbatch.iter().map(|option| format!("#SBATCH {option}")));
    lines.join("\n")
}

fn array_script(arguments: &Arguments, study: &Study, out: &Path, sinew: &Path, shards: usize) -> String {
    let time = arguments.time.as_ref().map_or(String::new(), |limit| format!("#SBATCH --time={limit}\n"));
    format!(
        "{}\n#SBATCH --cpus-per-task={cpus}\n{time}\
         # Exit code 1 means that some jobs did not converge; this is not a failure of the array element.\n\
         {} run {} --out {} --jobs {cpus} --shard \"$SLURM_ARRAY_TASK_ID/{shards}\" || [ $? -eq 1 ]\n",
        directives(arguments, study, out, "shard", "shard-%a.log"),
        quoted(sinew),
        quoted(&out.join("manifest.json")),
        quoted(out),
        cpus = arguments.cpus,
    )
}

fn merge_script(arguments: &Arguments, study: &Study, out: &Path, sinew: &Path) -> String {
    let (sinew, manifest, out_word) = (quoted(sinew), quoted(&out.join("manifest.json")), quoted(out));
    let mut text = directives(arguments, study, out, "merge", "merge.log");
    text.push_str(&format!("\n{sinew} merge {out_word}\n"));
    if study.on_failure == OnFailure::Retry {
        text.push_str(&format!(
            "# When all jobs have finished, retry the failed ones by continuation.\n\
             {sinew} status {out_word} | head -n 1 | grep -q ', 0 to do$' && {sinew} run {manifest} --out {out_word}\n"
        ));
    }
    text
}

fn sbatch(options: &[&str], script: &Path) -> Result<String> {
    let mut command = Command::new("sbatch");
    command.arg("--parsable").args(options).arg(script);
    let id = output(&mut command).map_err(|reason| Error::table("submit", script, reason))?;
    // With several clusters, sbatch prints `id;cluster`.
    Ok(id.trim().split(';').next().unwrap_or_default().to_owned())
}

/// Runs a Slurm command and returns its standard output. Fails after [`COMMAND_TIMEOUT`].
fn output(command: &mut Command) -> std::result::Result<String, String> {
    let name = command.get_program().to_string_lossy().into_owned();
    let mut child = command
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(|e| format!("cannot run `{name}` ({e}); is this machine part of a Slurm cluster?"))?;
    let started = Instant::now();
    while child.try_wait().map_err(|e| e.to_string())?.is_none() {
        if started.elapsed() > COMMAND_TIMEOUT {
            let _ = child.kill();
            return Err(format!(
                "`{name}` does not respond; are the Slurm daemons running? (check with `scontrol ping`)"
            ));
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    let output = child.wait_with_output().map_err(|e| e.to_string())?;
    match output.status.success() {
        true => Ok(String::from_utf8_lossy(&output.stdout).into_owned()),
        false => Err(format!("`{name}` failed: {}", String::from_utf8_lossy(&output.stderr).trim())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn elements_are_written_as_ranges() {
        assert_eq!(ranges(&[0, 2, 3, 4, 7].into()), "0,2-4,7");
        assert_eq!(quoted(Path::new("/a b/it's")), r"'/a b/it'\''s'");
    }
}
