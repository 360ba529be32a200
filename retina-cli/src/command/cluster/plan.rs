//! `retina plan`.

use std::ffi::OsStr;
use std::path::PathBuf;

use retina::cluster::{Format, Plan, Request};
use serde_json::json;

use crate::command::Rendering;
use crate::failure::Failure;
use crate::output::{print_json, tell};
use crate::progress::Reporter;

#[derive(Clone, Copy, clap::ValueEnum)]
enum FormatName {
    /// Job arrays of Slurm.
    Slurm,
    /// An array of HyperQueue.
    Hyperqueue,
    /// Rules of Snakemake, which has executors for many clusters.
    Snakemake,
    /// An indexed job of Kubernetes, and a container file.
    Kubernetes,
    /// This machine alone.
    Shell,
}

impl From<FormatName> for Format {
    fn from(name: FormatName) -> Self {
        match name {
            FormatName::Slurm => Self::Slurm,
            FormatName::Hyperqueue => Self::HyperQueue,
            FormatName::Snakemake => Self::Snakemake,
            FormatName::Kubernetes => Self::Kubernetes,
            FormatName::Shell => Self::Shell,
        }
    }
}

/// The renderer is the native one unless you ask for another: all machines then give the same bytes.
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Scene (retina.scene/1), campaign (retina.far-range/1, retina.full-disk/1, retina.flashes/1), or
    /// runs of a command (retina.runs/1).
    #[arg(value_name = "SCENE|CAMPAIGN|RUNS")]
    source: PathBuf,
    /// Number of shards: the tasks of the engine.
    #[arg(long, value_name = "N")]
    shards: usize,
    /// Engine that runs the tasks.
    #[arg(long, value_enum)]
    format: FormatName,
    /// Folder for the plan and for what its tasks make. All machines must see it under the same path.
    #[arg(long, value_name = "PLAN")]
    out: PathBuf,
    /// Processor cores that a task asks for.
    #[arg(long, value_name = "K", default_value_t = 4, value_parser = clap::value_parser!(u16).range(1..))]
    cpus: u16,
    /// The command `retina` on the machines that run the tasks [default: this one].
    #[arg(long, value_name = "PATH")]
    command: Option<String>,
    #[command(flatten)]
    rendering: Rendering,
    /// Print the plan as a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

/// This program, where it is the command; within Python it is the interpreter.
pub(super) fn own_command() -> String {
    let own = std::env::current_exe().ok().filter(|path| path.file_stem() == Some(OsStr::new("retina")));
    own.and_then(|path| path.to_str().map(str::to_owned)).unwrap_or_else(|| "retina".to_owned())
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let request = Request {
        source: arguments.source.clone(),
        shards: arguments.shards,
        format: arguments.format.into(),
        backend: arguments.rendering.backend.into(),
        quality: arguments.rendering.quality(),
        cpus: usize::from(arguments.cpus),
        command: arguments.command.clone().unwrap_or_else(own_command),
    };
    let mut reporter = Reporter::new();
    let made = Plan::make(&request, &arguments.out, &mut reporter);
    reporter.clear();
    let plan = made?;
    let (least, most) = (plan.items_of(plan.shards - 1), plan.items_of(0));
    let each = if least == most { most.to_string() } else { format!("{least} or {most}") };
    let dir = arguments.out.display();
    tell!(
        "{} {} in {} shards of {each}; run {dir}/submit.sh, and look by `retina status {dir}`",
        plan.items,
        plan.work.unit(),
        plan.shards
    );
    if arguments.json {
        let plan_json = serde_json::to_value(&plan).map_err(|error| Failure::new(error.to_string()))?;
        print_json(&json!({ "dir": arguments.out, "plan": plan_json }))?;
    }
    Ok(())
}
