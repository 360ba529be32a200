//! `retina lab capture`.

use std::path::PathBuf;

use retina::lab::{Rig, Sequence, Upcoming, capture};
use serde_json::json;

use super::DeviceArguments;
use super::monitor::{Limits, show};
use crate::failure::Failure;
use crate::output::{print_json, tell};
use crate::progress::{advance, counter};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// What is shown: a pattern, a round of `retina decide`, frames, or a folder of PNG files.
    sequence: PathBuf,
    #[command(flatten)]
    devices: DeviceArguments,
    /// Look at reference points before every Nth frame, as `retina lab monitor` does, into OUT/monitor.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    monitor_every: Option<u32>,
    #[command(flatten)]
    limits: Limits,
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
    let mut monitor = match arguments.monitor_every {
        None => None,
        Some(every) => Some((every, arguments.limits.open(&devices, &arguments.out.join("monitor"))?)),
    };
    let (mut frames, mut alarmed) = (0, 0);
    let mut before = |rig: &mut Rig<'_>, _: &Upcoming<'_>| {
        if let Some((every, monitor)) = monitor.as_mut().filter(|(every, _)| frames % *every == 0) {
            let reading = monitor.round(rig)?;
            alarmed += u32::from(!reading.alarms.is_empty());
            bar.suspend(|| show(monitor.readings().len(), &reading));
            frames %= *every;
        }
        frames += 1;
        Ok(())
    };
    let done = devices.with(|_, rig| {
        let progress = |done, of| advance(&bar, done, of);
        capture(&sequence, rig, &options, &arguments.out, &mut before, progress)
    });
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
    if alarmed > 0 {
        return Err(Failure::exceeded(format!("{alarmed} looks at the reference points raised an alarm")));
    }
    Ok(())
}
