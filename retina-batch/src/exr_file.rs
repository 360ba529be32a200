//! OpenEXR files of f32 channels.

use std::io::Cursor;
use std::path::Path;

use exr::meta::MetaData;
use exr::prelude::*;
use retina_files::{InputError, MOST_IMAGE_PIXELS, read_bytes};

use crate::BatchError;

/// An image of named channels, row by row.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Channels {
    /// Width, pixels.
    pub width_px: usize,
    /// Height, pixels.
    pub height_px: usize,
    /// Name and values of each.
    pub channels: Vec<(String, Vec<f32>)>,
}

/// The file's bytes, the same for the same input. `metadata` becomes one text attribute `retina`:
/// with more than one, their order in the file would not be fixed.
pub fn write_exr(image: Channels, metadata: &str) -> std::result::Result<Vec<u8>, BatchError> {
    let list = image
        .channels
        .into_iter()
        .map(|(name, values)| AnyChannel {
            name: name.as_str().into(),
            sample_data: FlatSamples::F32(values),
            quantize_linearly: false,
            sampling: Vec2(1, 1),
        })
        .collect();
    let mut attributes = LayerAttributes::default();
    attributes.other.insert("retina".into(), AttributeValue::Text(metadata.into()));
    let encoding = Encoding {
        compression: Compression::ZIP16,
        blocks: Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let layer = Layer::new((image.width_px, image.height_px), attributes, encoding, AnyChannels::sort(list));
    let mut bytes = Cursor::new(Vec::new());
    Image::from_layer(layer)
        .write()
        .non_parallel()
        .to_buffered(&mut bytes)
        .map_err(|error| BatchError::encode("an EXR", &error))?;
    Ok(bytes.into_inner())
}

/// Most times that a file's pixels, uncompressed, are larger than the file: deflate shrinks 1032 to 1.
const MOST_SHRUNK: u64 = 2000;

/// Refuses sizes that cannot be before any pixel has its place in memory.
fn check_sizes(path: &Path, bytes: &[u8]) -> std::result::Result<(), InputError> {
    let broken = |error| InputError::new(path, format!("is not a readable EXR: {error}"));
    for header in MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(broken)?.headers {
        let (width, height) = (header.layer_size.width() as u64, header.layer_size.height() as u64);
        let pixels = width.saturating_mul(height);
        let bytes_each: u64 =
            header.channels.list.iter().map(|channel| channel.sample_type.bytes_per_sample() as u64).sum();
        let held = (bytes.len() as u64).saturating_mul(MOST_SHRUNK);
        if !(1..=MOST_IMAGE_PIXELS).contains(&pixels) || pixels.saturating_mul(bytes_each.max(1)) > held {
            return Err(InputError::new(path, "the image has a size that cannot be taken")
                .at("attribute `dataWindow`")
                .found(format!("{width} x {height} pixels of {bytes_each} bytes in {} bytes", bytes.len()))
                .expected(format!("1 to {MOST_IMAGE_PIXELS} pixels, and no more than the file can hold"))
                .help("save the image again"));
        }
    }
    Ok(())
}

/// Reads all channels of a file's first layer as f32, and the attribute `retina`, if any.
///
/// # Errors
/// The file cannot be read, is no EXR, claims more pixels than it can hold, or holds no image.
pub fn read_exr(path: &Path) -> std::result::Result<(Channels, Option<String>), InputError> {
    let bytes = read_bytes(path)?;
    check_sizes(path, &bytes)?;
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))
        .map_err(|error| InputError::new(path, format!("is not a readable EXR: {error}")))?;
    let layer = image.layer_data;
    let metadata = layer.attributes.other.get(&Text::from("retina")).and_then(|value| match value {
        AttributeValue::Text(text) => Some(text.to_string()),
        _ => None,
    });
    let channels = layer
        .channel_data
        .list
        .iter()
        .map(|channel| (channel.name.to_string(), channel.sample_data.values_as_f32().collect()))
        .collect();
    Ok((Channels { width_px: layer.size.width(), height_px: layer.size.height(), channels }, metadata))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_and_the_bytes_are_the_same_each_time() {
        let image = Channels {
            width_px: 37,
            height_px: 21,
            channels: vec![
                (
                    "depth".into(),
                    (0..777).map(|i| if i % 5 == 0 { f32::INFINITY } else { i as f32 * 1.7 }).collect(),
                ),
                ("normal.x".into(), (0..777).map(|i| -(i as f32)).collect()),
            ],
        };
        let bytes = write_exr(image.clone(), "{\"a\":1}").unwrap();
        assert_eq!(bytes, write_exr(image.clone(), "{\"a\":1}").unwrap());
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        std::fs::write(&path, &bytes).unwrap();
        assert_eq!(read_exr(&path).unwrap(), (image, Some("{\"a\":1}".into())));
        std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
        assert!(read_exr(&path).unwrap_err().to_string().contains("a.exr"));
    }

    #[test]
    fn a_window_far_off_is_refused_before_memory_is_taken() {
        let image = Channels { width_px: 3, height_px: 2, channels: vec![("Y".into(), vec![0.5; 6])] };
        let bytes = write_exr(image, "").unwrap();
        let name = b"dataWindow\0box2i\0";
        let at = bytes.windows(name.len()).position(|w| w == name).unwrap() + name.len() + 4;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("far.exr");
        // Left, top, right and bottom of the window.
        for (window, size) in [
            ([-90_000, -90_000, 90_000, 90_000], "180001 x 180001 pixels"),
            ([0, 0, 15_999, 15_999], "16000 x 16000 pixels of 4 bytes in"),
            ([0, 0, i32::MAX, i32::MAX], ""),
            ([i32::MIN, i32::MIN, i32::MAX, i32::MAX], ""),
        ] {
            let mut far = bytes.clone();
            for (k, edge) in window.into_iter().enumerate() {
                far[at + 4 * k..at + 4 * k + 4].copy_from_slice(&i32::to_le_bytes(edge));
            }
            std::fs::write(&path, far).unwrap();
            let said = read_exr(&path).unwrap_err().to_string();
            assert!(said.contains("far.exr") && said.contains(size), "{said}");
        }
    }
}
