//! `retina export`.

use std::path::PathBuf;

use retina::export::{Exported, Format, Options, export};
use serde_json::json;

use crate::failure::Failure;
use crate::output::{print_json, tell};
use crate::progress::{advance, counter};

#[derive(Clone, Copy, clap::ValueEnum)]
enum FormatName {
    /// SPEED+: camera.json and lists of poses; one body.
    Speedplus,
    /// BOP, scene by scene: poses in mm, masks.
    Bop,
    /// Tar files of a thousand samples.
    Webdataset,
    /// COCO: masks, boxes, keypoints.
    Coco,
    /// A FITS file a frame, with world coordinates.
    Fits,
    /// A PNG of 16 bits a frame: its radiance.
    Png16,
}

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Folder of frames.
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Format to write.
    #[arg(long, value_enum)]
    format: FormatName,
    /// Folder for the data set; it must not be there yet.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Share of the frames that are for validation.
    #[arg(long, default_value_t = 0.2)]
    validation: f64,
    /// Seed of the split.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Licence that the data set states.
    #[arg(long, default_value = "not stated")]
    licence: String,
    /// Print the summary as a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let options = Options {
        format: match arguments.format {
            FormatName::Speedplus => Format::SpeedPlus,
            FormatName::Bop => Format::Bop,
            FormatName::Webdataset => Format::WebDataset,
            FormatName::Coco => Format::Coco,
            FormatName::Fits => Format::Fits,
            FormatName::Png16 => Format::Png16,
        },
        validation: arguments.validation,
        seed: arguments.seed,
        licence: arguments.licence.clone(),
    };
    let bar = counter(0, "frames");
    let made = export(&arguments.folder, &arguments.out, &options, &mut |done, all| {
        advance(&bar, done, all);
    });
    bar.finish_and_clear();
    let Exported { dir, training, validation, notes } = made?;
    for note in &notes {
        tell!("note: {note}");
    }
    match options.format {
        Format::Fits | Format::Png16 => tell!("{} frames; {}", training + validation, dir.display()),
        _ => tell!("{training} frames for training, {validation} for validation; {}", dir.display()),
    }
    if arguments.json {
        print_json(&json!({
            "schema": "retina.export/1",
            "dir": dir,
            "format": options.format.name(),
            "frames": { "training": training, "validation": validation },
            "notes": notes,
        }))?;
    }
    Ok(())
}
