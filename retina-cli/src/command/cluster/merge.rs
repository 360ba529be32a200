//! `retina merge`.

use std::path::PathBuf;

use retina::cluster::Plan;
use retina_batch::{Merged, merge_shards};
use serde_json::json;

use crate::failure::Failure;
use crate::output::{print_json, tell};
use crate::progress::Reporter;

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Folders of frames of one scene: a plan, its shards, or what `retina render --shard` wrote.
    #[arg(value_name = "DIR", required = true)]
    folders: Vec<PathBuf>,
    /// Folder for all frames. Those that are already in it stay.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Join what is there although frames are missing.
    #[arg(long)]
    partial: bool,
    /// Print the summary as a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let mut folders = Vec::new();
    for folder in &arguments.folders {
        match Plan::read(folder)? {
            Some(plan) => folders.extend((0..plan.shards).map(|shard| folder.join(plan.shard_folder(shard)))),
            None => folders.push(folder.clone()),
        }
    }
    let mut reporter = Reporter::new();
    let merged = merge_shards(&folders, &arguments.out, arguments.partial, &mut reporter);
    reporter.clear();
    let Merged { dir, done, skipped, missing, contact_sheet } = merged?;
    tell!(
        "{done} frames joined, {skipped} were there already, {} are missing; {}",
        missing.len(),
        dir.display()
    );
    if arguments.json {
        print_json(&json!({
            "schema": "retina.merge/1",
            "dir": dir,
            "frames_done": done,
            "frames_skipped": skipped,
            "missing": missing,
            "contact_sheet": contact_sheet,
        }))?;
    }
    Ok(())
}
