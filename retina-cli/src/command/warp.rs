//! `retina warp`.

use std::path::PathBuf;

use retina_batch::warp_file;
use retina_formats::Calibration;
use retina_geometry::{Setup, WarpDirection};
use serde_json::json;

use crate::failure::Failure;
use crate::output::{print_json, tell};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// PNG or TIFF, grey or RGB, 8 or 16 bits; or EXR.
    image: PathBuf,
    /// The facility, schema retina.setup/1.
    #[arg(long)]
    setup: PathBuf,
    /// Its distortion, schema retina.calibration/1.
    #[arg(long)]
    calibration: PathBuf,
    /// Which image is corrected.
    #[arg(long, value_enum)]
    direction: Direction,
    /// The image to write; its extension says the format.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum Direction {
    /// The screen's image beforehand: digital counts, resampled as irradiance.
    Upstream,
    /// The camera's image afterwards: linear.
    Downstream,
}

pub(crate) fn run(arguments: Arguments) -> Result<(), Failure> {
    crate::check_target(&arguments.out)?;
    let setup = Setup::read(&arguments.setup)?;
    let calibration = Calibration::read(&arguments.calibration, &setup)?;
    let (direction, name) = match arguments.direction {
        Direction::Upstream => (WarpDirection::Upstream, "upstream"),
        Direction::Downstream => (WarpDirection::Downstream, "downstream"),
    };
    let report = warp_file(&arguments.image, &setup, &calibration, direction, &arguments.out)?;
    if report.outside_px > 0 {
        tell!("{} pixels read beyond the image's border, which is continued outwards", report.outside_px);
    }
    if report.clipped > 0 {
        tell!("warning: {} samples are beyond the file's range and were cut off", report.clipped);
    }
    for channel in &report.left_out {
        tell!("channel `{channel}` holds infinities or NaNs, cannot be interpolated and is left out");
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
