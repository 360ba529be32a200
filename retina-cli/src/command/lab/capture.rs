//! `retina lab capture`.

use std::path::PathBuf;

use retina::lab::{Sequence, capture};
use serde_json::json;

use super::DeviceArguments;
use crate::failure::Failure;
use crate::output::{print_json, tell};
use crate::progress::{advance, counter};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// What is shown: a pattern, a round of `retina decide`, frames, or a folder of PNG files.
    sequence: PathBuf,
    #[command(flatten)]
    devices: DeviceArguments,
    /// Folder for images/, the table that lists them, and captures.csv.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let mut devices = arguments.devices.open()?;
    let sequence = Sequence::read(&arguments.sequence, &devices.setup)?;
    tell!("{} frames on {} for {}", sequence.frames.len(), arguments.devices.screen, devices.camera.name());
    let bar = counter(0, "images");
    let options = devices.capture.clone();
    let done = devices
        .with(|_, rig| capture(&sequence, rig, &options, &arguments.out, |done, of| advance(&bar, done, of)));
    bar.finish_and_clear();
    let done = done?;
    tell!(
        "{}: {} images taken, {} were there, {} taken again because they came torn or not at all",
        done.table.display(),
        done.taken,
        done.skipped,
        done.lost
    );
    if arguments.json {
        print_json(&json!({
            "schema": "retina.lab-capture/1",
            "table": done.table,
            "taken": done.taken,
            "skipped": done.skipped,
            "lost": done.lost,
            "exposures_s": done.exposures_s,
            "verified": devices.screen.verifies(),
        }))?;
    }
    Ok(())
}
