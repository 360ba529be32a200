//! Camera images from files.

use std::path::Path;

use image::{DynamicImage, ImageFormat};
use retina_files::{InputError, MOST_IMAGE_PIXELS, decode_image, read_bytes};

use crate::pages::tiff_pages;
use crate::raw_files::refuse_raw;
use crate::{CameraImage, Steps, fits};

/// How a file is taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ReadOptions {
    /// Bits of the camera's digital numbers; those of the file's samples where absent. Files of 16 bits hold the
    /// digital numbers as they are (0 to 4095 of a 12-bit camera), not scaled up.
    pub bits: Option<u32>,
    /// Colour images become the mean of their channels; otherwise they are refused.
    pub colour_to_grey: bool,
}

impl CameraImage {
    /// Reads a grey PNG (8, 16 bits), TIFF (8, 16 bits) or FITS image (any BITPIX, BZERO and BSCALE applied, first row
    /// of the file at the top) of digital numbers that are linear in light. Grey TIFF of floating-point numbers is refused. [`Photograph`](crate::Photograph) takes
    /// JPEG and colour.
    ///
    /// # Errors
    /// Not such a file, several pages, colour, samples that are not finite or beyond the camera's bits.
    pub fn read(path: &Path, options: ReadOptions) -> Result<Self, InputError> {
        let bytes = read_bytes(path)?;
        if is_fits(&bytes) {
            let (image, bits) = fits::read(path, &bytes)?;
            return of_bits(path, image, options.bits.or(bits));
        }
        let (picture, format) = decode(path, &bytes)?;
        if format == ImageFormat::Jpeg {
            return Err(InputError::new(path, "is a JPEG, which has lost the camera's counts")
                .expected("the camera's raw grey values: PNG, TIFF or FITS")
                .help("save raw counts: JPEG is coded for display, and detail as faint as its noise is left out of it"));
        }
        let samples = Samples::of(picture);
        if samples.channels > 1 && !options.colour_to_grey {
            return Err(InputError::new(path, "is a colour image")
                .found(format!("{} channels", samples.channels))
                .expected("one grey channel")
                .help("save the camera's raw grey values: colours are interpolated between photosites"));
        }
        let grey = |colours: &[f32]| colours.iter().sum::<f32>() / colours.len() as f32;
        let bits = samples.bits;
        of_bits(path, samples.into_image(grey), options.bits.or(bits))
    }
}

impl CameraImage {
    /// From digital numbers that are linear in light, row by row from the top; `name` names them in errors. Without
    /// `bits` they have no full scale, so that none is saturated.
    ///
    /// # Errors
    /// No pixels, or another number of values than pixels; a value that is not finite or beyond the camera's bits.
    pub fn from_values(
        name: &Path,
        [width_px, height_px]: [u32; 2],
        values: Vec<f32>,
        steps: Steps,
        bits: Option<u32>,
    ) -> Result<Self, InputError> {
        let pixels = width_px as usize * height_px as usize;
        if pixels == 0 || pixels != values.len() {
            return Err(InputError::new(name, "the image's size does not fit")
                .found(format!("{width_px} x {height_px} pixels, {} values", values.len()))
                .expected("at least one pixel, and a value for each"));
        }
        of_bits(name, Self { width_px, height_px, values, full_scale_dn: f32::MAX, steps }, bits)
    }
}

pub(crate) fn is_fits(bytes: &[u8]) -> bool {
    bytes.starts_with(b"SIMPLE  =")
}

/// The image with its full scale; without bits it has none.
pub(crate) fn of_bits(
    path: &Path,
    mut image: CameraImage,
    bits: Option<u32>,
) -> Result<CameraImage, InputError> {
    let width = image.width_px as usize;
    if let Some(at) = image.values.iter().position(|value| !value.is_finite()) {
        return Err(InputError::new(path, "a pixel is not finite")
            .at(format!("pixel ({}, {})", at % width, at / width))
            .found(image.values[at]));
    }
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

/// A picture of one page, and what its file is.
pub(crate) fn decode(path: &Path, bytes: &[u8]) -> Result<(DynamicImage, ImageFormat), InputError> {
    refuse_raw(path, bytes)?;
    let format = match image::guess_format(bytes) {
        Ok(format @ (ImageFormat::Png | ImageFormat::Tiff | ImageFormat::Jpeg)) => format,
        _ => {
            return Err(InputError::new(path, "is not a camera image")
                .expected("a PNG, TIFF or FITS image, or a JPEG where a photograph will do"));
        }
    };
    let pages = tiff_pages(bytes);
    if pages > 1 {
        return Err(InputError::new(path, "is not one image")
            .found(format!("a TIFF of {pages} pages"))
            .expected("one page")
            .help("save each exposure as a file of its own"));
    }
    Ok((decode_image(path, "image", bytes, &[format], MOST_IMAGE_PIXELS)?, format))
}

/// A picture's samples as its file has them.
pub(crate) struct Samples {
    size_px: [u32; 2],
    /// Of a pixel, alpha among them.
    pub(crate) channels: usize,
    /// Of a sample; none where it is a floating-point number.
    pub(crate) bits: Option<u32>,
    pub(crate) values: Vec<f32>,
}

impl Samples {
    pub(crate) fn of(picture: DynamicImage) -> Self {
        let size_px = [picture.width(), picture.height()];
        let channels = usize::from(picture.color().channel_count());
        let bytes = picture.as_bytes();
        let (values, bits) = match picture.color().bytes_per_pixel() as usize / channels {
            1 => (bytes.iter().map(|&v| f32::from(v)).collect(), Some(8)),
            2 => {
                let words = bytes.chunks_exact(2);
                (words.map(|v| f32::from(u16::from_ne_bytes([v[0], v[1]]))).collect(), Some(16))
            }
            _ => {
                let words = bytes.chunks_exact(4);
                (words.map(|v| f32::from_ne_bytes([v[0], v[1], v[2], v[3]])).collect(), None)
            }
        };
        Self { size_px, channels, bits, values }
    }

    /// Channels that are light: alpha (the second of two, the fourth of four) is none.
    pub(crate) fn colours(&self) -> usize {
        self.channels - usize::from(self.channels.is_multiple_of(2))
    }

    /// The grey image that this makes of each pixel's colours.
    pub(crate) fn into_image(self, grey: impl Fn(&[f32]) -> f32) -> CameraImage {
        let colours = self.colours();
        let [width_px, height_px] = self.size_px;
        let steps = if self.bits.is_some() { Steps::Whole } else { Steps::Fine };
        let values = self.values.chunks_exact(self.channels).map(|pixel| grey(&pixel[..colours])).collect();
        CameraImage { width_px, height_px, values, full_scale_dn: f32::MAX, steps }
    }
}
