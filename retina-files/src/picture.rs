//! Images, within limits that are checked before a pixel is decoded.

use std::io::Cursor;
use std::path::Path;

use image::{DynamicImage, ImageFormat, ImageReader, Limits};

use crate::InputError;

/// Most pixels of an image of a camera or a screen: 16384 x 16384, the largest texture.
pub const MOST_IMAGE_PIXELS: u64 = 16_384 * 16_384;

/// Most pixels of one image by its file's size: a flat JPEG spends two bits on 64 pixels at least,
/// deflate (PNG, TIFF) shrinks 1032 to 1, with up to 8 pixels a byte. What claims more is lying.
fn pixels_that_fit(bytes: usize, format: ImageFormat) -> u64 {
    bytes as u64 * if format == ImageFormat::Jpeg { 256 } else { 8 * 1032 }
}

/// Decodes an image of one of `formats`, told by its content, of at most `max_pixels`.
///
/// The size is read and checked before any pixel is decoded, so that a small file cannot claim
/// gigabytes. `place` names the image within the file.
///
/// # Errors
/// Another format, a size beyond what is supported or what the file can hold, damaged pixels.
pub fn decode_image(
    path: &Path,
    place: &str,
    bytes: &[u8],
    formats: &[ImageFormat],
    max_pixels: u64,
) -> Result<DynamicImage, InputError> {
    let broken = |error: image::ImageError| {
        InputError::new(path, format!("the image does not decode: {error}"))
            .at(place)
            .help("save the image again")
    };
    let format = image::guess_format(bytes).ok().filter(|f| formats.contains(f)).ok_or_else(|| {
        InputError::new(path, "the image is of a kind that is not read here")
            .at(place)
            .expected(format!("{formats:?}"))
            .help("convert the image")
    })?;
    let reader = || ImageReader::with_format(Cursor::new(bytes), format);
    let (width, height) = reader().into_dimensions().map_err(broken)?;
    let pixels = u64::from(width) * u64::from(height);
    let max_pixels = max_pixels.min(pixels_that_fit(bytes.len(), format));
    if pixels > max_pixels || pixels == 0 {
        return Err(InputError::new(path, "the image has a size that cannot be taken")
            .at(place)
            .found(format!("{width} x {height} pixels"))
            .expected(format!(
                "1 to {max_pixels} pixels, by what is supported and what {} bytes can hold",
                bytes.len()
            ))
            .help("scale the image down, or save it again if it is damaged"));
    }
    let mut reader = reader();
    let mut limits = Limits::default();
    // 16 bytes a pixel (floating-point RGBA) for the picture, for the decoder's copy of it, and for a strip that holds all
    // of it.
    limits.max_alloc = Some(pixels * 48 + (1 << 20));
    reader.limits(limits);
    reader.decode().map_err(broken)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_small_file_that_claims_gigabytes_is_refused_before_it_is_decoded() {
        let mut png = Cursor::new(Vec::new());
        image::GrayImage::new(3, 2).write_to(&mut png, ImageFormat::Png).unwrap();
        let mut tiff = Cursor::new(Vec::new());
        image::GrayImage::new(3, 2).write_to(&mut tiff, ImageFormat::Tiff).unwrap();
        let read = |bytes: &[u8]| {
            let formats = [ImageFormat::Png, ImageFormat::Tiff];
            decode_image(Path::new("a.png"), "image", bytes, &formats, MOST_IMAGE_PIXELS)
        };
        let mut bytes = png.into_inner();
        assert_eq!(read(&bytes).unwrap().width(), 3);
        // Width and height of the PNG's header, and its checksum.
        bytes[16..24].copy_from_slice(&[0, 0, 0x3f, 0xff, 0, 0, 0x3f, 0xff]);
        let crc = crc32(&bytes[12..29]);
        bytes[29..33].copy_from_slice(&crc.to_be_bytes());
        let said = read(&bytes).unwrap_err().to_string();
        assert!(said.contains("a.png, image: the image has a size that cannot be taken"), "{said}");
        assert!(said.contains("16383 x 16383 pixels"), "{said}");
        // The entries of the TIFF's width and height, tags 256 and 257, whose value is the last four bytes.
        let mut bytes = tiff.into_inner();
        assert_eq!(read(&bytes).unwrap().width(), 3);
        for tag in [256u16, 257] {
            let entry = bytes
                .windows(4)
                .position(|w| w[..2] == tag.to_le_bytes() && (3..5).contains(&w[2]) && w[3] == 0);
            let at = entry.unwrap();
            bytes[at + 2..at + 12].copy_from_slice(&[4, 0, 1, 0, 0, 0, 0xff, 0xff, 0, 0]);
        }
        let said = read(&bytes).unwrap_err().to_string();
        assert!(said.contains("65535 x 65535 pixels"), "{said}");
    }

    /// A TIFF of 16-bit RGB samples in one strip, as `dcraw -4 -T` writes it.
    #[test]
    fn a_picture_in_one_strip_is_decoded() {
        let [width, height] = [1200u32, 800];
        let data: Vec<u8> = (0..width * height * 3).flat_map(|k| (k as u16).to_le_bytes()).collect();
        // Tag, kind (3: 16 bits, 4: 32 bits), count, value; the three bits per sample stand after the directory.
        let entries: [[u32; 4]; 9] = [
            [256, 4, 1, width],
            [257, 4, 1, height],
            [258, 3, 3, 122],
            [259, 3, 1, 1],
            [262, 3, 1, 2],
            [273, 4, 1, 128],
            [277, 3, 1, 3],
            [278, 4, 1, height],
            [279, 4, 1, data.len() as u32],
        ];
        let mut bytes = b"II*\0\x08\0\0\0\x09\0".to_vec();
        for [tag, kind, count, value] in entries {
            bytes.extend([tag as u16, kind as u16].map(u16::to_le_bytes).concat());
            bytes.extend([count, value].map(u32::to_le_bytes).concat());
        }
        bytes.extend([0u8; 4]);
        bytes.extend([16u16, 16, 16].map(u16::to_le_bytes).concat());
        assert_eq!(bytes.len(), 128);
        bytes.extend(&data);
        let picture =
            decode_image(Path::new("a.tif"), "image", &bytes, &[ImageFormat::Tiff], MOST_IMAGE_PIXELS)
                .unwrap();
        assert_eq!(picture.into_rgb16().get_pixel(7, 0).0, [21, 22, 23]);
    }

    /// The checksum of a PNG's chunks (ISO 3309).
    fn crc32(bytes: &[u8]) -> u32 {
        !bytes.iter().fold(!0u32, |crc, &byte| {
            (0..8)
                .fold(crc ^ u32::from(byte), |c, _| if c & 1 == 1 { 0xedb8_8320 ^ (c >> 1) } else { c >> 1 })
        })
    }
}
