//! Heat maps of many cells as images inside the drawing: a byte a cell before compression, where rectangles take sixty.

use crate::colour::ColourMap;
use crate::heat::HeatMap;

/// Shades beside the transparent one. Their number is odd: the middle of a diverging map is a shade of its own.
pub(crate) const SHADES: usize = 65;
/// Index of the cells that have no value.
const NONE: u8 = SHADES as u8;

/// A heat map as a PNG with a palette; its first row is the lowest. `None` where it has no cells.
pub(crate) fn png(map: &HeatMap, colours: ColourMap) -> Option<Vec<u8>> {
    let rows = map.values.len().checked_div(map.columns)?;
    if rows == 0 {
        return None;
    }
    let mut indices = Vec::with_capacity(map.values.len());
    for row in map.values[..rows * map.columns].chunks(map.columns).rev() {
        indices.extend(row.iter().map(|value| shade(*value, map.range)));
    }
    let colour = |index: usize| colours.colour(index as f64 / (SHADES - 1) as f64);
    let mut palette: Vec<u8> = (0..SHADES).map(colour).flat_map(|c| [c.0, c.1, c.2]).collect();
    palette.extend([255; 3]);
    let mut opacity = vec![255; SHADES];
    opacity.push(0);
    let mut bytes = Vec::new();
    let mut encoder =
        png::Encoder::new(&mut bytes, u32::try_from(map.columns).ok()?, u32::try_from(rows).ok()?);
    encoder.set_color(png::ColorType::Indexed);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::High);
    encoder.set_palette(palette);
    encoder.set_trns(opacity);
    let mut writer = encoder.write_header().ok()?;
    writer.write_image_data(&indices).ok()?;
    writer.finish().ok()?;
    Some(bytes)
}

/// The shade of a value in a range.
pub(crate) fn shade(value: f64, range: [f64; 2]) -> u8 {
    let t = (value - range[0]) / (range[1] - range[0]);
    if value.is_finite() { (t.clamp(0.0, 1.0) * (SHADES - 1) as f64).round() as u8 } else { NONE }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Read back by a decoder: the lowest row is the last, the range's ends are the map's, no value is transparent.
    #[test]
    fn a_picture_holds_its_cells() {
        let map = HeatMap {
            origin: [0.0; 2],
            pitch: [1.0; 2],
            columns: 2,
            values: vec![0.0, 1.0, f64::NAN, 2.0],
            range: [0.0, 2.0],
            label: String::new(),
        };
        let bytes = png(&map, ColourMap::Grey).unwrap();
        let mut decoder = png::Decoder::new(std::io::Cursor::new(bytes));
        decoder.set_transformations(png::Transformations::EXPAND);
        let mut reader = decoder.read_info().unwrap();
        let mut out = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut out).unwrap();
        assert_eq!((info.width, info.height, info.color_type), (2, 2, png::ColorType::Rgba));
        let ends = [ColourMap::Grey.colour(0.0), ColourMap::Grey.colour(1.0)];
        assert_eq!(out[3], 0);
        assert_eq!(&out[4..8], &[ends[1].0, ends[1].1, ends[1].2, 255]);
        assert_eq!(&out[8..12], &[ends[0].0, ends[0].1, ends[0].2, 255]);
    }
}
