//! `retina warp`.

use std::path::PathBuf;

use retina_batch::warp_file;
use retina_formats::Calibration;
use retina_geometry::WarpDirection;
use serde_json::json;

use crate::failure::Failure;
use crate::output::{print_json, tell};
use crate::setup::read_setup;

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Image to warp: PNG or TIFF (grey or RGB, 8 or 16 bits), or EXR.
    image: PathBuf,
    /// Facility, schema retina.setup/1.
    #[arg(long)]
    setup: PathBuf,
    /// Calibration with the facility's distortion, schema retina.calibration/1.
    #[arg(long)]
    calibration: PathBuf,
    /// Which image to correct: the screen image before display, or the camera image afterwards.
    #[arg(long, value_enum)]
    direction: Direction,
    /// Image to write; the extension sets the format.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum Direction {
    /// The screen image, before display. Digital counts are resampled as irradiance.
    Upstream,
    /// The camera image, after exposure. Values are taken as linear.
    Downstream,
}

pub(crate) fn run(arguments: Arguments) -> Result<(), Failure> {
    crate::check_target(&arguments.out)?;
    let setup = read_setup(&arguments.setup)?;
    let calibration = Calibration::read(&arguments.calibration, &setup)?;
    let (direction, name) = match arguments.direction {
        Direction::Upstream => (WarpDirection::Upstream, "upstream"),
        Direction::Downstream => (WarpDirection::Downstream, "downstream"),
    };
    let report = warp_file(&arguments.image, &setup, &calibration, direction, &arguments.out)?;
    if report.outside_px > 0 {
        tell!(
            "{} pixels need values beyond the image's border; the image is extended outwards for them",
            report.outside_px
        );
    }
    if report.clipped > 0 {
        tell!("warning: {} samples were out of the file's range and were clipped", report.clipped);
    }
    for channel in &report.left_out {
        tell!("channel `{channel}` is left out: it holds infinities or NaNs, which cannot be interpolated");
    }
    if arguments.json {
        print_json(&json!({
            "schema": "retina.warp/1",
            "direction": name,
            "out": arguments.out,
            "width_px": report.width_px,
            "height_px": report.height_px,
            "channels": report.channels,
            "clipped": report.clipped,
            "outside_px": report.outside_px,
            "left_out": report.left_out,
        }))?;
    }
    Ok(())
}
