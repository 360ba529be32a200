//! `retina lab split`.

use std::path::{Path, PathBuf};

use retina::lab::{SplitError, SplitWriter, check_shares, read_light, split};
use retina_campaign::screens_of;
use retina_files::InputError;
use retina_formats::{MeasuredResponse, measured_or_power_law};
use serde_json::json;

use crate::failure::Failure;
use crate::output::{print_json, tell};
use crate::progress::counter;
use crate::setup::read_setup;

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Folder of linear images: grey PNG files of 16 bits, as `retina export --format png16` writes them, of the screen's
    /// size.
    #[arg(value_name = "IMAGES")]
    images: PathBuf,
    /// Facility, schema retina.setup/1.
    #[arg(long)]
    setup: PathBuf,
    /// Calibration of the facility, beside which the screen's measured response stands [default: the setup's own, else its
    /// power law].
    #[arg(long, value_name = "FILE")]
    calibration: Option<PathBuf>,
    /// Share of the time that each screen is shown, falling, together 1.
    #[arg(long, value_name = "SHARES", value_delimiter = ',', default_values_t = [0.9, 0.1])]
    shares: Vec<f64>,
    /// Number in the images that stands for the full light: count 255 all the time.
    #[arg(long, value_name = "NUMBER", default_value_t = 65535.0)]
    full: f64,
    /// Folder for screens/ and split.csv; `retina lab capture` takes it.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    check_shares(&arguments.shares)?;
    if !(arguments.full > 0.0 && arguments.full.is_finite()) {
        return Err(InputError::new(Path::new("--full"), "is no number of full light")
            .found(arguments.full)
            .expected("a number above 0")
            .into());
    }
    let setup = read_setup(&arguments.setup)?;
    let measured = match &arguments.calibration {
        None => match setup.calibration_path() {
            Some(own) => MeasuredResponse::read(&own, &setup)?.map(|measured| measured.curve),
            None => None,
        },
        Some(path) => {
            let found = MeasuredResponse::read(path, &setup)?.map(|measured| measured.curve);
            Some(found.ok_or_else(|| {
                InputError::new(path, "has no response of the screen beside it")
                    .help("measure it by `retina calibrate radiometry`, or leave --calibration out")
            })?)
        }
    };
    let response = measured.unwrap_or_else(|| measured_or_power_law(None, &setup));
    let size_px = [setup.screen.width_px, setup.screen.height_px];
    let most_count = setup.screen.limits.most_count;
    let images = screens_of(&arguments.images)
        .map_err(|error| error.expected("linear images: PNG files of 16 bits, grey"))?;
    // All are read before anything is written.
    for image in &images {
        read_light(image, size_px, arguments.full)?;
    }
    let mut writer = SplitWriter::new(&arguments.out, &setup, &arguments.shares)?;
    let bar = counter(images.len() as u64, "frames");
    let mut worst = SplitError { clipped: 0, largest: 0.0, relative_rms: 0.0, relative_rms_of_one: 0.0 };
    for (done, image) in images.iter().enumerate() {
        let (name, light) = read_light(image, size_px, arguments.full)?;
        let (screens, error) = split(&light, size_px, &response, most_count, &arguments.shares);
        writer.add(&name, image, &screens)?;
        worst = SplitError {
            clipped: worst.clipped + error.clipped,
            largest: worst.largest.max(error.largest),
            relative_rms: worst.relative_rms.max(error.relative_rms),
            relative_rms_of_one: worst.relative_rms_of_one.max(error.relative_rms_of_one),
        };
        bar.set_position(done as u64 + 1);
    }
    let table = writer.finish()?;
    bar.finish_and_clear();
    tell!(
        "{}: {} frames in {} screens each; the light is off by {:.1e} of full light at most, and by {:.1e} of its own RMS \
         ({:.1e} with one screen)",
        table.display(),
        images.len(),
        arguments.shares.len(),
        worst.largest,
        worst.relative_rms,
        worst.relative_rms_of_one
    );
    if worst.clipped > 0 {
        tell!(
            "warning: {} pixels are brighter than count {most_count} all the time, and are shown fainter: give a larger --full",
            worst.clipped
        );
    }
    if arguments.json {
        print_json(&json!({
            "schema": "retina.lab-split/1",
            "table": table,
            "frames": images.len(),
            "shares": arguments.shares,
            "clipped_px": worst.clipped,
            "largest_error": worst.largest,
            "relative_rms": worst.relative_rms,
            "relative_rms_of_one": worst.relative_rms_of_one,
        }))?;
    }
    Ok(())
}
