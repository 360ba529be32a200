//! What is exported, and how.

use std::path::{Path, PathBuf};

use retina_batch::BatchError;
use retina_files::InputError;
use serde_json::{Value, json};

use crate::frames::{Frame, Frames, is_validation};
use crate::out::Out;
use crate::{bop, coco, fits, png16, speedplus, webdataset};

/// A format that others read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Of the SPEED+ data set (T. H. Park et al., IEEE Aerospace Conference 2022): `camera.json` and lists of poses.
    SpeedPlus,
    /// Of the BOP benchmark for 6D object pose, scene by scene, a thousand images each.
    Bop,
    /// Tar files of a thousand samples each.
    WebDataset,
    /// Of COCO: instances with masks, boxes and keypoints.
    Coco,
    /// A FITS file a frame, with world coordinates.
    Fits,
    /// A PNG of 16 bits a frame: its radiance.
    Png16,
}

impl Format {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::SpeedPlus => "speedplus",
            Self::Bop => "bop",
            Self::WebDataset => "webdataset",
            Self::Coco => "coco",
            Self::Fits => "fits",
            Self::Png16 => "png16",
        }
    }
}

/// What is asked of an export.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Which format.
    pub format: Format,
    /// Share of frames for validation, 0 to 1.
    pub validation: f64,
    /// Seed of the split.
    pub seed: u64,
    /// Licence that the data set states.
    pub licence: String,
}

/// What was exported.
#[derive(Debug, Clone, PartialEq)]
pub struct Exported {
    /// The folder.
    pub dir: PathBuf,
    /// Frames for training.
    pub training: usize,
    /// Frames for validation.
    pub validation: usize,
    /// What the user ought to know.
    pub notes: Vec<String>,
}

/// Writes one format, frame by frame.
pub(crate) trait Writer {
    /// Adds a frame.
    fn add(&mut self, out: &Out, frame: &Frame, is_validation: bool) -> Result<(), BatchError>;
    /// Writes what is known at the end.
    fn finish(&mut self, out: &Out) -> Result<(), BatchError>;
}

/// Exports the whole frames of a folder that `retina render` or `retina merge` wrote. `progress` hears how many are done,
/// of how many.
///
/// # Errors
/// The folder holds no frames; `out` is there already; a share out of range; frames that the format cannot hold; a file
/// cannot be read or written. `out` appears whole or not at all.
pub fn export(
    folder: &Path,
    out: &Path,
    options: &Options,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<Exported, BatchError> {
    if !(0.0..=1.0).contains(&options.validation) {
        return Err(InputError::new(Path::new("--validation"), "is no share")
            .found(options.validation)
            .expected("0 to 1")
            .into());
    }
    let frames = Frames::of(folder)?;
    let target = Out::new(out)?;
    let mut writer: Box<dyn Writer> = match options.format {
        Format::SpeedPlus => Box::new(speedplus::SpeedPlus::default()),
        Format::Bop => Box::new(bop::Bop::default()),
        Format::WebDataset => Box::new(webdataset::WebDataset::default()),
        Format::Coco => Box::new(coco::Coco::new(&options.licence)),
        Format::Fits => Box::new(fits::Fits),
        Format::Png16 => Box::new(png16::Png16::default()),
    };
    let mut notes = Vec::new();
    if frames.missing > 0 {
        notes.push(format!(
            "{} frames of the sequence are not there, and not in the data set",
            frames.missing
        ));
    }
    let mut validation = 0;
    for (done, index) in frames.indices.iter().enumerate() {
        progress(done, frames.indices.len());
        let frame = frames.read(*index)?;
        if done == 0 {
            notes.extend(first_notes(&frame, options.format));
        }
        let chosen = is_validation(*index, options.seed, options.validation);
        validation += usize::from(chosen);
        writer.add(&target, &frame, chosen)?;
    }
    writer.finish(&target)?;
    let training = frames.indices.len() - validation;
    target.write_json("export.json", &record(folder, options, training, validation, &notes))?;
    let dir = target.finish()?;
    Ok(Exported { dir, training, validation, notes })
}

fn first_notes(frame: &Frame, format: Format) -> Vec<String> {
    let mut notes = Vec::new();
    if frame.truth.compensation != "none" {
        notes.push(format!(
            "the frames hold the facility's compensation `{}`: places in pixels are those of the image without it. Render the \
             scene with compensation `none` for images of a pinhole camera",
            frame.truth.compensation
        ));
    }
    let has_mask =
        frame.planes.as_ref().is_some_and(|planes| planes.channels.iter().any(|(name, _)| name == "mask"));
    let has_masks = !matches!(format, Format::Fits | Format::Png16);
    if !frame.truth.bodies.is_empty() && has_masks && (!has_mask || frame.truth.bodies.len() > 1) {
        notes.push(
            "masks are the ellipses of the reference figures; a scene of one body with `layers = [\"mask\"]` gives its own \
             silhouette"
                .to_owned(),
        );
    }
    notes
}

fn record(folder: &Path, options: &Options, training: usize, validation: usize, notes: &[String]) -> Value {
    json!({
        "schema": "retina.export/1",
        "format": options.format.name(),
        "source": folder,
        "frames": { "training": training, "validation": validation },
        "split": { "validation": options.validation, "seed": options.seed },
        "licence": options.licence,
        "notes": notes,
    })
}
