//! Photographs of ordinary cameras: JPEG and colour pictures as light.

use std::path::Path;

use image::ImageFormat;
use image::metadata::Orientation;
use retina_files::{InputError, read_bytes};

use crate::camera_image::srgb_light;
use crate::read::{Samples, decode, is_fits, of_bits};
use crate::{CameraImage, Exif, Steps, fits};

/// Luminance of linear red, green and blue of sRGB (ITU-R BT.709).
const LUMINANCE: [f32; 3] = [0.2126, 0.7152, 0.0722];

/// How a picture's samples stand for light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Coding {
    /// JPEG, and colour of 8 bits, are sRGB; all else is linear.
    #[default]
    ByKind,
    /// In proportion to it.
    Linear,
    /// By the sRGB curve (IEC 61966-2-1).
    Srgb,
}

/// How a photograph is taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PhotographOptions {
    /// Bits of the camera's digital numbers where they are linear; those of the file's samples where absent. A picture
    /// that is decoded has the full scale of its file.
    pub bits: Option<u32>,
    /// What the samples are.
    pub coding: Coding,
    /// Turned as its EXIF orientation says, as viewers show it; otherwise as the sensor has it.
    pub upright: bool,
}

/// A picture's light, and what the picture was.
#[derive(Debug, Clone, PartialEq)]
pub struct Photograph {
    /// Digital numbers, linear in light.
    pub image: CameraImage,
    /// It was a JPEG: what is faint and fine was left out of it.
    pub lossy: bool,
    /// It had colours, which a camera interpolates between its photosites.
    pub colour: bool,
    /// It was decoded from sRGB.
    pub linearised: bool,
    /// It had transparency, which is no light.
    pub alpha: bool,
    /// It was turned as its EXIF orientation says.
    pub turned: bool,
    /// What the camera wrote beside the picture.
    pub exif: Exif,
}

impl Photograph {
    /// Reads a PNG, TIFF, FITS or JPEG picture, grey or in colour. Colours become one value, their luminance
    /// (0.2126 R + 0.7152 G + 0.0722 B of linear channels). A pixel with a channel at full scale is at full scale.
    ///
    /// # Errors
    /// Not such a file, camera raw data, several pages, samples that are not finite or beyond the camera's bits.
    pub fn read(path: &Path, options: PhotographOptions) -> Result<Self, InputError> {
        let bytes = read_bytes(path)?;
        if is_fits(&bytes) {
            let (image, bits) = fits::read(path, &bytes)?;
            let image = of_bits(path, image, options.bits.or(bits))?;
            return Ok(Self {
                image,
                lossy: false,
                colour: false,
                linearised: false,
                alpha: false,
                turned: false,
                exif: Exif::default(),
            });
        }
        let exif = Exif::of(&bytes);
        let (mut picture, format) = decode(path, &bytes)?;
        let turn = exif.orientation.and_then(Orientation::from_exif).filter(|_| options.upright);
        let turned = turn.is_some_and(|turn| turn != Orientation::NoTransforms);
        if let Some(turn) = turn {
            picture.apply_orientation(turn);
        }
        let samples = Samples::of(picture);
        let lossy = format == ImageFormat::Jpeg;
        let colour = samples.colours() > 1;
        let alpha = samples.channels > samples.colours();
        let linearised = match options.coding {
            Coding::ByKind => lossy || (colour && samples.bits == Some(8)),
            Coding::Linear => false,
            Coding::Srgb => true,
        };
        let image = if linearised {
            decoded(path, samples)?
        } else {
            let bits = options.bits.or(samples.bits);
            let full_scale_dn = bits.map_or(f32::MAX, |bits| (2f64.powi(bits.min(32) as i32) - 1.0) as f32);
            of_bits(path, samples.into_image(|colours| grey(colours, full_scale_dn)), bits)?
        };
        Ok(Self { image, lossy, colour, linearised, alpha, turned, exif })
    }

    /// What was done with the picture, and what its camera says, in words.
    pub fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        let kind = match (self.lossy, self.colour) {
            (true, true) => "a JPEG in colour",
            (true, false) => "a grey JPEG",
            (false, true) => "a picture in colour",
            (false, false) => "a grey picture",
        };
        let mix = if self.colour { "; its luminance is taken" } else { "" };
        if self.linearised {
            notes.push(format!(
                "{kind}: linearised by the sRGB curve to 0..{}{mix}. A camera's own tone curve stays in it",
                self.image.full_scale_dn
            ));
        } else if self.lossy || self.colour {
            notes.push(format!("{kind}: its samples are taken as linear in light{mix}"));
        }
        if self.alpha {
            notes.push("its transparency (alpha) is ignored".to_owned());
        }
        match self.exif.orientation {
            Some(orientation) if self.turned => {
                notes.push(format!("turned by its EXIF orientation ({orientation}), as viewers show it"));
            }
            Some(orientation) if orientation != 1 => notes.push(format!(
                "its EXIF orientation ({orientation}) is not applied: the pixels stay where the file has them"
            )),
            _ => {}
        }
        notes.extend(self.exif.notes());
        notes
    }
}

/// The grey image of sRGB samples, in digital numbers up to the samples' full scale.
fn decoded(path: &Path, samples: Samples) -> Result<CameraImage, InputError> {
    let Some(bits) = samples.bits else {
        return Err(InputError::new(path, "floating-point samples have no sRGB coding")
            .expected("8 or 16 bits")
            .help("take the picture as linear"));
    };
    let full_scale_dn = (2f64.powi(bits as i32) - 1.0) as f32;
    // A table costs less than a power a sample, and rounds nothing.
    let light: Vec<f32> =
        (0..1u32 << bits).map(|value| full_scale_dn * srgb_light(value as f32 / full_scale_dn)).collect();
    let of = |sample: f32| light[sample as usize];
    let mut image = samples.into_image(|colours| match colours {
        [r, g, b] => grey(&[of(*r), of(*g), of(*b)], full_scale_dn),
        _ => of(colours[0]),
    });
    (image.full_scale_dn, image.steps) = (full_scale_dn, Steps::Srgb);
    Ok(image)
}

/// Luminance of linear channels; at full scale where one of them is.
fn grey(colours: &[f32], full_scale_dn: f32) -> f32 {
    if colours.len() == 1 {
        return colours[0];
    }
    match colours.iter().copied().fold(0.0, f32::max) {
        most if most >= full_scale_dn => most,
        _ => colours.iter().zip(LUMINANCE).map(|(value, weight)| value * weight).sum(),
    }
}
