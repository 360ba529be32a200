//! `retina lab show`.

use std::path::{Path, PathBuf};

use retina::lab::{BenchScreen, PresentOptions, ScreenSpec, Sequence, open_screen, present};
use retina_files::InputError;
use serde_json::json;

use super::{interrupted, remark_on};
use crate::failure::Failure;
use crate::output::{print_json, tell};
use crate::progress::{advance, counter};
use crate::setup::read_setup;

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// What is shown: a pattern, frames, or a folder of PNG files.
    sequence: PathBuf,
    /// Facility, schema retina.setup/1.
    #[arg(long)]
    setup: PathBuf,
    /// Screen: x11:DISPLAY, x11:DISPLAY@OUTPUT, folder:DIR (another program shows its screen.png), or exec:COMMAND
    /// (shows the file in $RETINA_FRAME).
    #[arg(long, value_name = "SCREEN")]
    screen: String,
    /// Time that each frame is shown, s.
    #[arg(long, value_name = "S", default_value_t = 1.0)]
    each_s: f64,
    /// Show the sequence so many times; 0: until Ctrl-C.
    #[arg(long, value_name = "N", default_value_t = 1)]
    times: u32,
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let each_s = arguments.each_s;
    if !(0.001..=86_400.0).contains(&each_s) {
        return Err(InputError::new(Path::new("--each-s"), "is out of range")
            .found(each_s)
            .expected("0.001 to 86400 s")
            .into());
    }
    let spec: ScreenSpec = arguments.screen.parse()?;
    if spec == ScreenSpec::Bench {
        return Err(InputError::new(
            Path::new("--screen"),
            "the bench's own screen is seen by its own camera only",
        )
        .help("photograph it: `retina lab capture --screen bench --camera bench`")
        .into());
    }
    let setup = read_setup(&arguments.setup)?;
    let sequence = Sequence::read(&arguments.sequence, &setup)?;
    let stop = interrupted()?;
    let unseen = BenchScreen::new([setup.screen.width_px, setup.screen.height_px]);
    let mut screen = open_screen(&spec, &setup, None, &unseen)?;
    remark_on(screen.as_ref(), &arguments.screen);
    let times = (arguments.times > 0).then_some(arguments.times);
    let of = times.map_or(0, |times| times as usize * sequence.frames.len());
    let bar = counter(of as u64, "frames");
    let stop = || stop.load(std::sync::atomic::Ordering::Acquire);
    let options = PresentOptions { each_s, times };
    let done = present(&sequence, screen.as_mut(), options, &stop, |shown| {
        advance(&bar, shown, of.max(shown));
    });
    bar.finish_and_clear();
    let (done, verified) = (done?, screen.verifies());
    drop(screen);
    let ended = if done.stopped { ", then it was stopped" } else { "" };
    tell!("{} frames were shown, {} of them late{ended}; the screen is dark", done.frames, done.late);
    if arguments.json {
        print_json(&json!({
            "schema": "retina.lab-show/1",
            "frames": done.frames,
            "late": done.late,
            "stopped": done.stopped,
            "verified": verified,
        }))?;
    }
    Ok(())
}
