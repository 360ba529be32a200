//! PNG files of whole numbers, with text chunks.

use crate::BatchError;

/// What the samples of a PNG are.
#[derive(Debug, Clone, Copy)]
pub struct PngShape {
    /// Width, pixels.
    pub width_px: u32,
    /// Height, pixels.
    pub height_px: u32,
    /// 1 (grey) or 3 (RGB).
    pub channels: usize,
    /// 8 or 16; samples of 16 bits come with the high byte first.
    pub bits: u32,
    /// Rows are filtered before they are compressed.
    pub filtered: bool,
}

/// A PNG's bytes, `texts` in its text chunks. `what` names it in an error.
///
/// # Errors
/// Samples that do not fill the shape, a text that a PNG cannot hold.
pub fn png_bytes(
    what: &str,
    shape: PngShape,
    samples: &[u8],
    texts: &[(&str, String)],
) -> Result<Vec<u8>, BatchError> {
    let write = || -> Result<Vec<u8>, png::EncodingError> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, shape.width_px, shape.height_px);
        let grey = shape.channels == 1;
        encoder.set_color(if grey { png::ColorType::Grayscale } else { png::ColorType::Rgb });
        encoder.set_depth(if shape.bits == 8 { png::BitDepth::Eight } else { png::BitDepth::Sixteen });
        encoder.set_compression(png::Compression::Fast);
        if !shape.filtered {
            encoder.set_filter(png::Filter::NoFilter);
        }
        for (key, text) in texts {
            encoder.add_text_chunk((*key).into(), text.clone())?;
        }
        let mut writer = encoder.write_header()?;
        writer.write_image_data(samples)?;
        writer.finish()?;
        Ok(bytes)
    };
    write().map_err(|error| BatchError::encode(what, &error))
}
