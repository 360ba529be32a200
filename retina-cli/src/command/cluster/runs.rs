//! `retina runs`.

use std::path::{Path, PathBuf};

use clap::CommandFactory as _;
use retina::cluster::Runs;
use retina_batch::Shard;
use retina_files::{InputError, nearest, write_atomic};
use serde_json::json;

use super::plan::own_command;
use crate::failure::Failure;
use crate::output::{print_json, tell};
use crate::progress::counter;

/// Runs stand in one file: a command, and the values that its names take.
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// File of runs, schema retina.runs/1.
    #[arg(value_name = "RUNS.toml")]
    file: PathBuf,
    /// Folder for the runs' own folders and the table of all of them. Runs that are done stay.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Make only the runs whose number is I modulo N, without the table.
    #[arg(long, value_name = "I/N", allow_hyphen_values = true)]
    shard: Option<Shard>,
    /// Make no run: write the table, and refuse if a run is missing.
    #[arg(long, conflicts_with = "shard")]
    collect: bool,
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

/// The command must be one of ours, and no runs again.
fn check_command(runs: &Runs) -> Result<(), InputError> {
    let first = runs.command().first().map_or("", String::as_str);
    let all = crate::Arguments::command();
    let error =
        |problem: &str| InputError::new(&runs.file, problem).at("key `command`").found(format!("`{first}`"));
    match all.find_subcommand(first) {
        Some(_) if first == "runs" => {
            Err(error("runs do not run runs").expected("another command of `retina`"))
        }
        Some(_) => Ok(()),
        None => {
            let names = all.get_subcommands().map(clap::Command::get_name);
            let near = nearest(first, names).map_or_else(
                || "`retina --help` lists them".to_owned(),
                |near| format!("did you mean `{near}`?"),
            );
            Err(error("`retina` has no such command").help(near))
        }
    }
}

/// Most failed runs that are named.
const MOST_NAMED: usize = 10;

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let runs = Runs::read(&arguments.file)?;
    check_command(&runs)?;
    let program = PathBuf::from(own_command());
    let mut made = retina::cluster::RunsDone::default();
    if !arguments.collect {
        let bar = counter(runs.count() as u64, "runs");
        let progress = &mut |done: usize, all: usize| crate::progress::advance(&bar, done, all);
        made = runs.run(&arguments.out, arguments.shard, &program, progress)?;
        bar.finish_and_clear();
    }
    let whole = arguments.shard.is_none();
    let (mut table, mut missing) = (None, 0);
    if whole {
        let (text, left) = runs.table(&arguments.out)?;
        missing = left;
        if arguments.collect && missing > 0 {
            return Err(InputError::new(&arguments.out, "runs are missing")
                .found(format!("{} of {} runs", runs.count() - missing, runs.count()))
                .expected("all of them")
                .help("make them by the same command without --collect, or by the plan's tasks; a run's stderr.txt says why it failed")
                .into());
        }
        let path = arguments.out.join("runs.csv");
        write_atomic(&path, text.as_bytes())
            .map_err(|error| InputError::new(&path, format!("cannot be written: {error}")))?;
        table = Some(path);
    }
    let there = if arguments.collect { runs.count() } else { made.skipped };
    tell!(
        "{} runs made, {} were there already, {} failed; {}",
        made.done,
        there,
        made.failed.len(),
        table.as_deref().unwrap_or(Path::new(&arguments.out)).display()
    );
    if arguments.json {
        print_json(&json!({
            "schema": "retina.runs-summary/1",
            "out": arguments.out,
            "table": table,
            "runs": runs.count(),
            "done": made.done,
            "skipped": there,
            "failed": made.failed,
            "missing": missing,
        }))?;
    }
    match made.failed.len() {
        0 => Ok(()),
        failed => {
            let named: Vec<String> = made.failed.iter().take(MOST_NAMED).map(usize::to_string).collect();
            let more = if failed > MOST_NAMED { ", ..." } else { "" };
            Err(Failure::new(format!(
                "{failed} runs failed: {}{more}; their stderr.txt in {} says why",
                named.join(", "),
                arguments.out.join("runs").display()
            )))
        }
    }
}
