//! Images of whole numbers: PNG and TIFF, grey or RGB, 8 or 16 bits.

use std::io::Cursor;
use std::path::Path;

use image::{DynamicImage, ExtendedColorType, ImageEncoder as _, ImageFormat};
use retina_files::{InputError, MOST_IMAGE_PIXELS, decode_image, read_bytes};

use crate::BatchError;
use crate::png_file::{PngShape, png_bytes};

/// An image of whole numbers, channels interleaved.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct IntegerImage {
    pub(crate) width_px: u32,
    pub(crate) height_px: u32,
    /// 1 or 3.
    pub(crate) channels: usize,
    /// 8 or 16.
    pub(crate) bits: u32,
    pub(crate) samples: Vec<u16>,
}

impl IntegerImage {
    pub(crate) fn read(path: &Path) -> Result<Self, InputError> {
        let bytes = read_bytes(path)?;
        let format = image::guess_format(&bytes).ok();
        let Some(format @ (ImageFormat::Png | ImageFormat::Tiff)) = format else {
            return Err(
                InputError::new(path, "is not an image that can be read").expected("a PNG, a TIFF or an EXR")
            );
        };
        let image = decode_image(path, "image", &bytes, &[format], MOST_IMAGE_PIXELS)?;
        let wide = |samples: Vec<u8>| samples.into_iter().map(u16::from).collect();
        let (width_px, height_px) = (image.width(), image.height());
        let (channels, bits, samples) = match image {
            DynamicImage::ImageLuma8(i) => (1, 8, wide(i.into_raw())),
            DynamicImage::ImageRgb8(i) => (3, 8, wide(i.into_raw())),
            DynamicImage::ImageLuma16(i) => (1, 16, i.into_raw()),
            DynamicImage::ImageRgb16(i) => (3, 16, i.into_raw()),
            other => {
                return Err(InputError::new(path, "holds pixels of a kind that does not do")
                    .found(format!("{:?}", other.color()))
                    .expected("grey or RGB of 8 or 16 bits, without transparency"));
            }
        };
        Ok(Self { width_px, height_px, channels, bits, samples })
    }

    /// One channel's samples.
    pub(crate) fn channel(&self, channel: usize) -> impl Iterator<Item = u16> {
        self.samples.iter().skip(channel).step_by(self.channels).copied()
    }

    pub(crate) fn largest(&self) -> f32 {
        if self.bits == 8 { 255.0 } else { 65_535.0 }
    }

    /// The file's bytes. `schema` goes into a text chunk of a PNG; a TIFF carries none.
    pub(crate) fn encode(&self, format: ImageFormat, schema: &str) -> Result<Vec<u8>, BatchError> {
        match format {
            ImageFormat::Png => {
                let Self { width_px, height_px, channels, bits, .. } = *self;
                let shape = PngShape { width_px, height_px, channels, bits, filtered: true };
                png_bytes("the PNG", shape, &self.bytes(u16::to_be_bytes), &[("schema", schema.to_string())])
            }
            _ => self.tiff().map_err(|error| BatchError::encode("the TIFF", &error)),
        }
    }

    fn bytes(&self, two: impl Fn(u16) -> [u8; 2]) -> Vec<u8> {
        if self.bits == 8 {
            self.samples.iter().map(|&sample| sample as u8).collect()
        } else {
            self.samples.iter().flat_map(|&sample| two(sample)).collect()
        }
    }

    fn tiff(&self) -> Result<Vec<u8>, image::ImageError> {
        let kind = match (self.channels, self.bits) {
            (1, 8) => ExtendedColorType::L8,
            (1, _) => ExtendedColorType::L16,
            (_, 8) => ExtendedColorType::Rgb8,
            _ => ExtendedColorType::Rgb16,
        };
        let mut out = Cursor::new(Vec::new());
        image::codecs::tiff::TiffEncoder::new(&mut out).write_image(
            &self.bytes(u16::to_ne_bytes),
            self.width_px,
            self.height_px,
            kind,
        )?;
        Ok(out.into_inner())
    }
}
