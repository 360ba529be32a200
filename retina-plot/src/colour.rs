//! Colours.

use std::fmt;

/// An sRGB colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Colour(pub u8, pub u8, pub u8);

impl Colour {
    /// Black.
    pub const BLACK: Self = Self(0, 0, 0);
    /// For text and axes.
    pub const INK: Self = Self(0x22, 0x22, 0x22);
    /// For grids and aids.
    pub const GREY: Self = Self(0x99, 0x99, 0x99);
    /// For grid lines.
    pub const PALE: Self = Self(0xe4, 0xe4, 0xe4);
}

impl fmt::Display for Colour {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "#{:02x}{:02x}{:02x}", self.0, self.1, self.2)
    }
}

/// The qualitative palette of M. Okabe and K. Ito, "Color Universal Design" (2008): blue, vermillion,
/// bluish green, orange, sky blue, reddish purple, black.
pub const PALETTE: [Colour; 7] = [
    Colour(0x00, 0x72, 0xb2),
    Colour(0xd5, 0x5e, 0x00),
    Colour(0x00, 0x9e, 0x73),
    Colour(0xe6, 0x9f, 0x00),
    Colour(0x56, 0xb4, 0xe9),
    Colour(0xcc, 0x79, 0xa7),
    Colour(0x00, 0x00, 0x00),
];

/// Nodes of the colour map viridis (S. van der Walt and N. Smith, CC0), at equal steps.
const VIRIDIS: [[u8; 3]; 9] = [
    [68, 1, 84],
    [71, 44, 122],
    [59, 81, 139],
    [44, 113, 142],
    [33, 144, 141],
    [39, 173, 129],
    [92, 200, 99],
    [170, 220, 50],
    [253, 231, 37],
];

/// Viridis at 0 to 1.
pub fn heat_colour(value: f64) -> Colour {
    between(&VIRIDIS, value)
}

/// At 0 to 1 between nodes at equal steps.
fn between(nodes: &[[u8; 3]], value: f64) -> Colour {
    let place = value.clamp(0.0, 1.0) * (nodes.len() - 1) as f64;
    let i = (place as usize).min(nodes.len() - 2);
    let t = place - i as f64;
    let mix = |k: usize| (f64::from(nodes[i][k]) * (1.0 - t) + f64::from(nodes[i + 1][k]) * t).round() as u8;
    Colour(mix(0), mix(1), mix(2))
}

/// Nodes of the diverging map PuOr reversed (C. Brewer, M. Harrower, ColorBrewer 2.0, Apache-2.0), which people with
/// colour-vision deficiency can read: purple below, orange above.
const DIVERGING: [[u8; 3]; 9] = [
    [84, 39, 136],
    [128, 115, 172],
    [178, 171, 210],
    [216, 218, 235],
    [247, 247, 247],
    [254, 224, 182],
    [253, 184, 99],
    [224, 130, 20],
    [179, 88, 6],
];

/// What the values of a heat map are shown by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ColourMap {
    /// Viridis.
    #[default]
    Sequential,
    /// Purple, white, orange: for values on both sides of the middle of their range.
    Diverging,
    /// Black to white, as a photograph.
    Grey,
}

impl ColourMap {
    /// The colour of 0 to 1.
    pub fn colour(self, value: f64) -> Colour {
        match self {
            Self::Sequential => heat_colour(value),
            Self::Diverging => between(&DIVERGING, value),
            Self::Grey => between(&[[0, 0, 0], [255, 255, 255]], value),
        }
    }
}

/// The place of a wavelength in the palette: violet to red as the eye names them, dark enough to print.
pub fn wavelength_colour(wavelength_nm: f64) -> Colour {
    match wavelength_nm {
        w if w < 430.0 => Colour(0x6a, 0x3d, 0x9a),
        w if w < 500.0 => PALETTE[0],
        w if w < 570.0 => PALETTE[2],
        w if w < 595.0 => PALETTE[3],
        w if w < 640.0 => PALETTE[1],
        _ => Colour(0xa5, 0x10, 0x1c),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Relative luminance of sRGB (IEC 61966-2-1).
    fn luminance(colour: Colour) -> f64 {
        let linear = |v: u8| {
            let v = f64::from(v) / 255.0;
            if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
        };
        0.2126 * linear(colour.0) + 0.7152 * linear(colour.1) + 0.0722 * linear(colour.2)
    }

    /// Zero is grey without a hue and the lightest; both sides darken alike and differ in hue, which is told by red
    /// against blue: no one who confuses red and green confuses them.
    #[test]
    fn signed_values_are_told_by_a_neutral_middle_and_two_hues() {
        let map = ColourMap::Diverging;
        let zero = map.colour(0.5);
        assert!(zero.0 == zero.1 && zero.1 == zero.2);
        for k in 1..=8 {
            let t = f64::from(k) / 16.0;
            let (below, above) = (map.colour(0.5 - t), map.colour(0.5 + t));
            assert!(below.2 > below.0 && above.0 > above.2, "{below} {above}");
            let (low, high) = (luminance(below), luminance(above));
            assert!(low < luminance(zero) && high < luminance(zero));
            assert!((low - high).abs() < 0.16, "{k}: {low} {high}");
        }
    }
}
