//! FITS images. Sizes are checked here before fitsio-pure reads the file: it reckons with what a header claims.

use std::path::Path;

use fitsio_pure::hdu::{HduInfo, parse_fits};
use fitsio_pure::image::read_image_physical_f32;
use retina_files::{InputError, MOST_IMAGE_PIXELS};

use crate::{CameraImage, Steps};

/// Bytes of a block; headers and data fill whole ones (FITS standard 4.0, section 3).
const BLOCK_BYTES: usize = 2880;
/// Bytes of a card, a header's line.
const CARD_BYTES: usize = 80;
/// Most axes of an array (FITS standard 4.0, section 4.4.1.1).
const MOST_AXES: i64 = 999;

/// The first image of a file, and the bits of its samples where they are whole numbers.
pub(crate) fn read(path: &Path, bytes: &[u8]) -> Result<(CameraImage, Option<u32>), InputError> {
    check_sizes(path, bytes)?;
    let broken =
        |error: fitsio_pure::Error| InputError::new(path, format!("cannot be read as FITS: {error}"));
    let file = parse_fits(bytes).map_err(broken)?;
    let image_of = |info: &HduInfo| match info {
        HduInfo::Primary { bitpix, naxes } | HduInfo::Image { bitpix, naxes } if naxes.len() >= 2 => {
            Some((*bitpix, naxes.clone()))
        }
        _ => None,
    };
    let Some((unit, (bitpix, axes))) = file.iter().find_map(|unit| Some((unit, image_of(&unit.info)?)))
    else {
        return Err(InputError::new(path, "holds no image").expected("a FITS image of two axes"));
    };
    if axes[2..].iter().any(|&length| length != 1) {
        return Err(InputError::new(path, "is not one grey image")
            .found(format!("axes {axes:?}"))
            .expected("two axes")
            .help("save each exposure as a file of its own"));
    }
    let pixels = axes[0].saturating_mul(axes[1]);
    let side = |length: usize| u32::try_from(length).ok();
    let (Some(width_px), Some(height_px), 1..=MOST_IMAGE_PIXELS) =
        (side(axes[0]), side(axes[1]), pixels as u64)
    else {
        return Err(InputError::new(path, "the image has a size that cannot be taken")
            .at("NAXIS1, NAXIS2")
            .found(format!("{} x {} pixels", axes[0], axes[1]))
            .expected(format!("1 to {MOST_IMAGE_PIXELS} pixels")));
    };
    let values = read_image_physical_f32(bytes, unit).map_err(broken)?;
    if values.len() != pixels {
        return Err(InputError::new(path, "the image is cut short")
            .found(format!("{} pixels", values.len()))
            .expected(pixels));
    }
    let whole = values.iter().all(|value| value.fract() == 0.0);
    let steps = if whole { Steps::Whole } else { Steps::Fine };
    let bits = (bitpix > 0 && bitpix <= 16).then_some(bitpix as u32);
    Ok((CameraImage { width_px, height_px, values, full_scale_dn: f32::MAX, steps }, bits))
}

/// Refuses a file whose headers claim more data than it has, or sizes that are none.
fn check_sizes(path: &Path, bytes: &[u8]) -> Result<(), InputError> {
    let mut at = 0;
    while at < bytes.len() {
        let Some((header, data)) = header_at(bytes, at) else { return Ok(()) };
        let number = |key: &str, least: i64, most: i64, absent: i64| {
            let Some(text) = value_of(header, key) else { return Ok(absent) };
            let value = text.parse::<i64>().ok().filter(|value| (least..=most).contains(value));
            value.ok_or_else(|| {
                InputError::new(path, "a size of the FITS header is none")
                    .at(key)
                    .found(format!("`{text}`"))
                    .expected(format!("a whole number from {least} to {most}"))
            })
        };
        let bytes_each = number("BITPIX", -64, 64, 8)?.unsigned_abs() / 8;
        let axes = number("NAXIS", 0, MOST_AXES, 0)?;
        let most = bytes.len() as i64;
        let mut values = u64::from(axes > 0);
        for axis in 1..=axes {
            values = values.saturating_mul(number(&format!("NAXIS{axis}"), 0, most, 0)?.unsigned_abs());
        }
        let beside = number("PCOUNT", 0, most, 0)?.unsigned_abs();
        let groups = number("GCOUNT", 0, most, 1)?.unsigned_abs();
        let needed = values.saturating_add(beside).saturating_mul(groups).saturating_mul(bytes_each);
        let left = (bytes.len() - data) as u64;
        if needed > left {
            return Err(InputError::new(path, "the FITS file holds less than its header claims")
                .found(format!("{left} bytes of data"))
                .expected(format!("{needed} bytes"))
                .help("save or fetch the file again"));
        }
        at = data + (needed as usize).next_multiple_of(BLOCK_BYTES);
    }
    Ok(())
}

/// The header that begins there and where its data begin; `None` where there is none.
fn header_at(bytes: &[u8], at: usize) -> Option<(&[u8], usize)> {
    let rest = bytes.get(at..)?;
    let end = rest.chunks_exact(CARD_BYTES).position(|card| card.starts_with(b"END     "))? * CARD_BYTES;
    Some((&rest[..end], (at + (end + CARD_BYTES).next_multiple_of(BLOCK_BYTES)).min(bytes.len())))
}

/// The text of a key's value, without its comment.
fn value_of(header: &[u8], key: &str) -> Option<String> {
    let card = header.chunks_exact(CARD_BYTES).find(|card| card[..8].trim_ascii_end() == key.as_bytes())?;
    let value = card[8..].strip_prefix(b"=")?.split(|&byte| byte == b'/').next()?;
    Some(String::from_utf8_lossy(value.trim_ascii()).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file of one 8-bit image whose size is said by the cards given.
    fn file(cards: &[&str], data_bytes: usize) -> Vec<u8> {
        let mut bytes = Vec::new();
        for card in ["SIMPLE  =                    T"].iter().chain(cards).chain(&["END"]) {
            bytes.extend(format!("{card:<80}").bytes());
        }
        bytes.resize(bytes.len().next_multiple_of(BLOCK_BYTES), b' ');
        bytes.resize(bytes.len() + data_bytes.next_multiple_of(BLOCK_BYTES), 7);
        bytes
    }

    #[test]
    fn sizes_that_are_none_are_refused() {
        let read = |cards: &[&str]| read(Path::new("a.fits"), &file(cards, 6));
        let bits = "BITPIX  = 8";
        let (image, depth) = read(&[bits, "NAXIS   = 2", "NAXIS1  = 3 / columns", "NAXIS2  = 2"]).unwrap();
        assert_eq!((image.width_px, image.height_px, image.values[5], depth), (3, 2, 7.0, Some(8)));
        for (axes, x, y, said) in [
            ("2", "0", "2", "NAXIS1, NAXIS2: the image has a size that cannot be taken (found 0 x 2 pixels"),
            ("2", "3", "0", "found 3 x 0 pixels"),
            ("2", "-3", "2", "NAXIS1: a size of the FITS header is none (found `-3`"),
            ("2", "4000000000000000000", "2", "found `4000000000000000000`"),
            ("2", "5000", "5000", "holds less than its header claims (found 2880 bytes of data"),
            ("-1", "3", "2", "NAXIS: a size of the FITS header is none (found `-1`"),
            ("900000000000000000", "3", "2", "expected a whole number from 0 to 999"),
        ] {
            let cards = [("NAXIS", axes), ("NAXIS1", x), ("NAXIS2", y)].map(|(k, v)| format!("{k:<8}= {v}"));
            let error = read(&[bits, &cards[0], &cards[1], &cards[2]]).unwrap_err().to_string();
            assert!(error.contains(said), "{error}");
        }
    }
}
