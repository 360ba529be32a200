//! The contact sheet: a folder's frames at a glance.

use std::fs;
use std::path::{Path, PathBuf};

use retina_files::{InputError, MOST_IMAGE_PIXELS, decode_image, read_bytes, write_atomic};

use crate::folder::Folder;
use crate::png_file::{PngShape, png_bytes};
use crate::{BatchError, digits};

/// Most frames on a sheet.
const MOST_FRAMES: usize = 36;
/// A frame with fewer lit pixels than this part is taken for one of points.
const SPARSE: f64 = 0.003;
/// Width of a frame on it, pixels.
const TILE_PX: usize = 320;
const GAP_PX: usize = 4;
const BACKGROUND: u8 = 40;
const INK: u8 = 170;

/// Writes `contact-sheet.png` into a folder of frames, at most 36 of them, evenly chosen; gives
/// its path.
///
/// # Errors
/// The folder holds no frames, or one that cannot be read.
pub fn contact_sheet(dir: &Path) -> Result<PathBuf, BatchError> {
    let present = frames_in(dir)?;
    let count = present.len().min(MOST_FRAMES);
    let chosen = (0..count).map(|k| if count == 1 { 0 } else { k * (present.len() - 1) / (count - 1) });
    let tiles: Vec<(usize, Tile)> = chosen
        .map(|k| {
            let (index, path) = &present[k];
            Ok((*index, read_tile(path)?))
        })
        .collect::<Result<_, InputError>>()?;
    let (tile_width, tile_height) =
        tiles.iter().fold((1, 1), |(w, h), (_, t)| (w.max(t.width), h.max(t.height)));
    let columns = (1..=count).find(|c| c * c >= count).unwrap_or(1);
    let rows = count.div_ceil(columns);
    let (step_x, step_y) = (tile_width + GAP_PX, tile_height + GAP_PX);
    let (width, height) = (columns * step_x + GAP_PX, rows * step_y + GAP_PX);
    let mut sheet = vec![BACKGROUND; width * height];
    for (place, (index, tile)) in tiles.iter().enumerate() {
        let (left, top) = (GAP_PX + place % columns * step_x, GAP_PX + place / columns * step_y);
        for y in 0..tile.height {
            let first = (top + y) * width + left;
            sheet[first..first + tile.width]
                .copy_from_slice(&tile.grey[y * tile.width..(y + 1) * tile.width]);
        }
        digits::draw(*index, 2, |x, y| {
            if x + 4 < tile_width && y + 4 < tile_height {
                sheet[(top + 4 + y) * width + left + 4 + x] = INK;
            }
        });
    }
    let path = dir.join("contact-sheet.png");
    let bytes = encode(&sheet, width, height)?;
    let _held = Folder::hold(dir);
    write_atomic(&path, &bytes).map_err(BatchError::write(&path))?;
    Ok(path)
}

/// Numbers and paths of the frames in a folder, rising.
fn frames_in(dir: &Path) -> Result<Vec<(usize, PathBuf)>, InputError> {
    let folder = dir.join("frames");
    let unreadable = |error: std::io::Error| {
        InputError::new(&folder, format!("cannot be read: {error}"))
            .expected("a folder that `retina render` wrote")
    };
    let mut present = Vec::new();
    for entry in fs::read_dir(&folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        let number = path.file_stem().and_then(|stem| stem.to_str()?.parse().ok());
        if let (Some(number), Some("png")) = (number, path.extension().and_then(|e| e.to_str())) {
            present.push((number, path));
        }
    }
    present.sort();
    if present.is_empty() {
        return Err(InputError::new(&folder, "holds no frames").expected("files such as 000000.png"));
    }
    Ok(present)
}

/// A frame of points: each area's brightest count, on a scale that shows the faint ones too.
fn brightened(grey: &[f64], from_width: usize, [width, height]: [usize; 2]) -> Vec<u8> {
    let from_height = grey.len() / from_width;
    let mut tile = vec![0; width * height];
    for (i, &value) in grey.iter().enumerate().filter(|(_, value)| **value > 0.0) {
        let (x, y) = (i % from_width * width / from_width, i / from_width * height / from_height);
        let shown = (255.0 * (value / 255.0).cbrt()).round() as u8;
        tile[y * width + x] = tile[y * width + x].max(shown);
    }
    tile
}

struct Tile {
    width: usize,
    height: usize,
    grey: Vec<u8>,
}

/// A frame averaged down to the width of a tile; narrower ones stay as they are. A frame of points
/// is [`brightened`] instead.
fn read_tile(path: &Path) -> Result<Tile, InputError> {
    let bytes = read_bytes(path)?;
    let formats = [image::ImageFormat::Png];
    let image = decode_image(path, "image", &bytes, &formats, MOST_IMAGE_PIXELS)?.into_rgb8();
    let (from_width, from_height) = (image.width() as usize, image.height() as usize);
    let width = from_width.min(TILE_PX);
    let height = (from_height * width / from_width).max(1);
    let grey: Vec<f64> =
        image.pixels().map(|pixel| pixel.0.iter().map(|&c| f64::from(c)).sum::<f64>() / 3.0).collect();
    // Rows first, then columns: the mean over an area parts into two means along a line.
    let mut narrow = vec![0.0; width * from_height];
    for y in 0..from_height {
        for x in 0..width {
            narrow[y * width + x] = mean(from_width, width, x, |k| grey[y * from_width + k]);
        }
    }
    let lit = grey.iter().filter(|&&value| value > 0.0).count();
    let grey = if lit as f64 > SPARSE * grey.len() as f64 {
        (0..width * height)
            .map(|i| mean(from_height, height, i / width, |k| narrow[k * width + i % width]).round() as u8)
            .collect()
    } else {
        brightened(&grey, from_width, [width, height])
    };
    Ok(Tile { width, height, grey })
}

/// Mean of `value` over the part `index` of `parts` equal parts of a line of `length` pixels.
fn mean(length: usize, parts: usize, index: usize, value: impl Fn(usize) -> f64) -> f64 {
    let step = length as f64 / parts as f64;
    let (from, to) = (index as f64 * step, (index + 1) as f64 * step);
    let last = (to.ceil() as usize).min(length);
    let covered = |k: usize| (to.min((k + 1) as f64) - from.max(k as f64)).max(0.0);
    (from as usize..last).map(|k| covered(k) * value(k)).sum::<f64>() / step
}

fn encode(sheet: &[u8], width: usize, height: usize) -> Result<Vec<u8>, BatchError> {
    let shape =
        PngShape { width_px: width as u32, height_px: height as u32, channels: 1, bits: 8, filtered: true };
    png_bytes("the contact sheet", shape, sheet, &[("schema", "retina.contact-sheet/1".to_string())])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn area_means_keep_the_sum() {
        let values: Vec<f64> = (0..17).map(|k| f64::from(k * k)).collect();
        let sum: f64 = (0..5).map(|part| mean(17, 5, part, |k| values[k])).sum();
        assert!((sum / 5.0 - values.iter().sum::<f64>() / 17.0).abs() < 1e-9);
        assert_eq!(mean(4, 2, 1, |k| k as f64), 2.5);
    }
}
