//! Camera images from files.

use std::path::Path;

use image::{DynamicImage, ImageFormat};
use retina_files::{InputError, MOST_IMAGE_PIXELS, decode_image, read_bytes};

use crate::pages::tiff_pages;
use crate::{CameraImage, fits};

/// How a file is taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ReadOptions {
    /// Bits of the camera's digital numbers; those of the file's samples where absent. Files of 16 bits hold the
    /// digital numbers as they are (0 to 4095 of a 12-bit camera), not scaled up.
    pub bits: Option<u32>,
    /// Colour images become the mean of their channels; otherwise they are refused.
    pub colour_to_grey: bool,
}

/// The problem of a colour image where a grey one is wanted.
pub const IS_COLOUR: &str = "is a colour image";

impl CameraImage {
    /// Reads a grey PNG (8, 16 bits), TIFF (8, 16 bits, f32) or FITS image (any BITPIX, BZERO and BSCALE applied, first
    /// row of the file at the top).
    ///
    /// # Errors
    /// Not such a file, several pages, colour, samples that are not finite or beyond the camera's bits.
    pub fn read(path: &Path, options: ReadOptions) -> Result<Self, InputError> {
        let bytes = read_bytes(path)?;
        let (mut image, file_bits) = if bytes.starts_with(b"SIMPLE  =") {
            fits::read(path, &bytes)?
        } else {
            from_raster(path, &bytes, options)?
        };
        let width = image.width_px as usize;
        if let Some(at) = image.values.iter().position(|value| !value.is_finite()) {
            return Err(InputError::new(path, "a pixel is not finite")
                .at(format!("pixel ({}, {})", at % width, at / width))
                .found(image.values[at]));
        }
        let bits = options.bits.or(file_bits);
        let Some(bits) = bits else {
            image.full_scale_dn = f32::MAX;
            return Ok(image);
        };
        image.full_scale_dn = (2f64.powi(bits.min(32) as i32) - 1.0) as f32;
        if let Some(at) = image.values.iter().position(|&value| value > image.full_scale_dn) {
            let shifted = image.values.iter().all(|v| (*v as u32).trailing_zeros() >= 16 - bits.min(16));
            let help = if shifted {
                "the samples were shifted up to fill 16 bits: save the digital numbers as the camera gives them"
            } else {
                "check `camera.bits` of the setup"
            };
            return Err(InputError::new(path, "a pixel is beyond the camera's digital numbers")
                .at(format!("pixel ({}, {})", at % width, at / width))
                .found(image.values[at])
                .expected(format!("at most {} ({bits} bits)", image.full_scale_dn))
                .help(help));
        }
        Ok(image)
    }
}

fn from_raster(
    path: &Path,
    bytes: &[u8],
    options: ReadOptions,
) -> Result<(CameraImage, Option<u32>), InputError> {
    let expected = "a PNG, TIFF or FITS image";
    let format = match image::guess_format(bytes) {
        Ok(format @ (ImageFormat::Png | ImageFormat::Tiff)) => format,
        _ => return Err(InputError::new(path, "is not a camera image").expected(expected)),
    };
    let pages = tiff_pages(bytes);
    if pages > 1 {
        return Err(InputError::new(path, "is not one image")
            .found(format!("a TIFF of {pages} pages"))
            .expected("one page")
            .help("save each exposure as a file of its own"));
    }
    let picture = decode_image(path, "image", bytes, &[format], MOST_IMAGE_PIXELS)?;
    let (width_px, height_px) = (picture.width(), picture.height());
    let channels = usize::from(picture.color().channel_count());
    if channels > 1 && !options.colour_to_grey {
        return Err(InputError::new(path, IS_COLOUR)
            .found(format!("{channels} channels"))
            .expected("one grey channel")
            .help("save the camera's raw grey values, or ask for the mean of the channels"));
    }
    let grey = |values: Vec<f32>| -> Vec<f32> {
        // Alpha (the second of two, the fourth of four channels) is no light.
        let colours = channels - usize::from(channels.is_multiple_of(2));
        values.chunks(channels).map(|pixel| pixel[..colours].iter().sum::<f32>() / colours as f32).collect()
    };
    let (values, bits) = match picture {
        DynamicImage::ImageLuma8(p) => (p.into_raw().into_iter().map(f32::from).collect(), Some(8)),
        DynamicImage::ImageLuma16(p) => (p.into_raw().into_iter().map(f32::from).collect(), Some(16)),
        picture => match picture.color().bytes_per_pixel() as usize / channels {
            1 => {
                let raw = picture.as_bytes().iter().map(|&v| f32::from(v)).collect();
                (grey(raw), Some(8))
            }
            2 => {
                let raw = picture.as_bytes().chunks(2).map(|v| f32::from(u16::from_ne_bytes([v[0], v[1]])));
                (grey(raw.collect()), Some(16))
            }
            _ => {
                let raw = picture.as_bytes().chunks(4).map(|v| f32::from_ne_bytes([v[0], v[1], v[2], v[3]]));
                (grey(raw.collect()), None)
            }
        },
    };
    Ok((CameraImage { width_px, height_px, values, full_scale_dn: f32::MAX }, bits))
}
