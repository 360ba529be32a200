//! OpenEXR files of f32 channels.

use std::io::Cursor;
use std::path::Path;

use exr::prelude::*;
use retina_files::{InputError, read_bytes};

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

/// Reads all channels of a file's first layer as f32, and the attribute `retina`, if any.
///
/// # Errors
/// The file cannot be read, is no EXR, or holds no image.
pub fn read_exr(path: &Path) -> std::result::Result<(Channels, Option<String>), InputError> {
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(read_bytes(path)?))
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
}
