//! Camera images into files.

use std::path::Path;

use fitsio_pure::image::{ImageData, build_image_hdu};
use retina_files::{InputError, write_atomic};

use crate::CameraImage;

impl CameraImage {
    /// Writes what [`Self::png`] gives.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write_png(&self, path: &Path) -> Result<(), InputError> {
        let bytes =
            self.png().map_err(|error| InputError::new(path, format!("cannot be encoded: {error}")))?;
        store(path, &bytes)
    }

    /// A 16-bit grey PNG of the digital numbers as they are, rounded, not scaled up (0 to 4095 of a 12-bit camera).
    ///
    /// # Errors
    /// The image has no pixels.
    pub fn png(&self) -> Result<Vec<u8>, png::EncodingError> {
        let samples = self.values.iter().flat_map(|&value| {
            // A cast saturates at 0 and 65 535.
            (value.round() as u16).to_be_bytes()
        });
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width_px, self.height_px);
        encoder.set_color(png::ColorType::Grayscale);
        encoder.set_depth(png::BitDepth::Sixteen);
        encoder.set_compression(png::Compression::Fast);
        let samples: Vec<u8> = samples.collect();
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&samples)?;
        writer.finish()?;
        Ok(bytes)
    }

    /// As a grey PNG of 8 bits: the values over the range's end, for programs that read images as such.
    ///
    /// # Errors
    /// The image is not whole.
    pub fn png_of_8_bits(&self) -> Result<Vec<u8>, png::EncodingError> {
        let scale = 255.0 / self.full_scale_dn;
        let samples: Vec<u8> =
            self.values.iter().map(|value| (value * scale).round().clamp(0.0, 255.0) as u8).collect();
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width_px, self.height_px);
        encoder.set_color(png::ColorType::Grayscale);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::Fast);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&samples)?;
        writer.finish()?;
        Ok(bytes)
    }

    /// Writes a FITS image of 32-bit floats (BITPIX -32), first row of the file at the top.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write_fits(&self, path: &Path) -> Result<(), InputError> {
        let axes = [self.width_px as usize, self.height_px as usize];
        let bytes = build_image_hdu(-32, &axes, &ImageData::F32(self.values.clone()))
            .map_err(|error| InputError::new(path, format!("cannot be encoded: {error}")))?;
        store(path, &bytes)
    }
}

fn store(path: &Path, bytes: &[u8]) -> Result<(), InputError> {
    write_atomic(path, bytes).map_err(|error| InputError::new(path, format!("cannot be written: {error}")))
}
