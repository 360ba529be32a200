//! `retina-benchmark`: makes, runs and scores the workbench's benchmark.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Parser;
use retina_benchmark::{
    Part as Shard, decide_pairs, generate, investigate_sets, run, score, score_investigated,
};
use retina_files::InputError;

/// The workbench's benchmark: tables with hidden effects, the workbench's answers, and how often they are right.
#[derive(Parser)]
#[command(version)]
struct Arguments {
    /// Folder of the sets, their sealed truth and the results.
    #[arg(long)]
    dir: PathBuf,
    /// Number of sets.
    #[arg(long, default_value_t = 400)]
    sets: usize,
    /// Seed of the sets.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Makes sets of this kind alone.
    ///
    /// `formula` and `formula-power` make other sets, with hidden formulas and without, on which `investigate` is asked
    /// and not `diagnose`. `decide` counts the exposures that it takes to decide between effects that
    /// look alike; --sets is then the number of campaigns for each pair and strength.
    #[arg(long, value_parser = ["null", "single", "outside", "pair", "confounded", "power", "phase", "formula", "formula-power", "decide"])]
    kind: Option<String>,
    /// The facility.
    #[arg(long, default_value = "assets/setups/wide-fov.toml")]
    setup: PathBuf,
    /// Runs the sets whose number is I modulo N alone, and does not score.
    ///
    /// Write the sets by --only generate, then run all shards into the same folder, on any machines, then
    /// --only score.
    #[arg(long, value_name = "I/N", allow_hyphen_values = true)]
    shard: Option<Shard>,
    /// Does this part alone; otherwise makes what is missing, runs what is open, and scores.
    #[arg(long, value_enum)]
    only: Option<Part>,
}

#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Part {
    /// Writes the sets and their truth.
    Generate,
    /// Runs the workbench on the sets that are not finished.
    Run,
    /// Opens the truth and writes results.json and results.md.
    Score,
}

fn main() -> ExitCode {
    match all(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error:?}");
            ExitCode::from(2)
        }
    }
}

fn all(arguments: &Arguments) -> Result<(), InputError> {
    let only = match (arguments.shard, arguments.only, arguments.kind.as_deref()) {
        (Some(_), _, Some("decide")) => {
            return Err(InputError::new(Path::new("--shard"), "`--kind decide` runs in one piece")
                .help("give each campaign of pairs a --seed and a --dir of its own"));
        }
        (Some(_), Some(Part::Generate | Part::Score), _) => {
            return Err(InputError::new(
                Path::new("--shard"),
                "sets are run in shards, and neither written nor scored",
            )
            .expected("--only run, or no --only"));
        }
        (Some(_), _, _) => Some(Part::Run),
        (None, only, _) => only,
    };
    let does = |part| only.is_none_or(|only| only == part);
    let progress = |done, total, left_s: f64| {
        eprintln!("{done} of {total} sets, {:.0} min {:02.0} s left", (left_s / 60.0).floor(), left_s % 60.0);
    };
    if arguments.kind.as_deref() == Some("decide") {
        let markdown =
            decide_pairs(&arguments.dir, &arguments.setup, arguments.sets, arguments.seed, progress)?;
        store(&arguments.dir.join("results.md"), &markdown)?;
        println!("{markdown}");
        return Ok(());
    }
    let sealed = arguments.dir.join("sealed").join("truth.jsonl");
    if does(Part::Generate) && (only.is_some() || !sealed.exists()) {
        let hash = generate(&arguments.dir, arguments.seed, arguments.sets, arguments.kind.as_deref())?;
        eprintln!("{} sets of seed {}, truth {hash}", arguments.sets, arguments.seed);
    }
    if arguments.kind.as_deref().is_some_and(|kind| kind.starts_with("formula")) {
        if does(Part::Run) {
            investigate_sets(&arguments.dir, &arguments.setup, arguments.shard, progress)?;
        }
        if does(Part::Score) {
            let (_, markdown) = score_investigated(&arguments.dir)?;
            store(&arguments.dir.join("results.md"), &markdown)?;
            println!("{markdown}");
        }
        return Ok(());
    }
    if does(Part::Run) {
        run(&arguments.dir, &arguments.setup, arguments.shard, progress)?;
    }
    if does(Part::Score) {
        let outcome = score(&arguments.dir)?;
        store(&arguments.dir.join("results.md"), &outcome.markdown)?;
        store(&arguments.dir.join("results.json"), &format!("{:#}\n", outcome.json))?;
        println!("{}", outcome.markdown);
    }
    Ok(())
}

fn store(path: &Path, text: &str) -> Result<(), InputError> {
    retina_files::write_atomic(path, text.as_bytes())
        .map_err(|error| InputError::new(path, format!("cannot be written: {error}")))
}
