//! A stroked font, so that a drawing's text does not depend on the fonts of a machine.
//!
//! Drawn for this project: plain sans-serif forms on a grid of 16 x 16 units, in which the baseline is at
//! 4, the top of small letters at 9, that of capitals at b (11), descenders reach to 1.

/// Character, width in units, and strokes parted by commas: points as two hexadecimal digits x and y, y
/// upwards. Ordered by character.
#[rustfmt::skip]
const GLYPHS: [(char, u8, &str); 102] = [
    (' ', 1, ""),
    ('!', 0, "0b 06,04 04"),
    ('"', 2, "0b 09,2b 29"),
    ('#', 4, "14 2b,34 4b,06 46,09 49"),
    ('$', 4, "4a 3b 1b 0a 09 18 37 46 45 34 14 05,2c 23"),
    ('%', 6, "04 6b,0a 1b 2a 19 0a,45 56 65 54 45"),
    ('&', 4, "44 09 0a 1b 2a 29 06 05 14 24 47"),
    ('\'', 0, "0b 09"),
    ('(', 1, "1c 0a 05 13"),
    (')', 1, "0c 1a 15 03"),
    ('*', 4, "2b 27,0a 48,4a 08"),
    ('+', 4, "07 47,29 25"),
    (',', 1, "14 02"),
    ('-', 3, "07 37"),
    ('.', 0, "04 04"),
    ('/', 3, "03 3c"),
    ('0', 4, "14 05 0a 1b 3b 4a 45 34 14"),
    ('1', 4, "19 3b 34"),
    ('2', 4, "0a 1b 3b 4a 48 04 44"),
    ('3', 4, "0a 1b 3b 4a 49 38 18,38 47 45 34 14 05"),
    ('4', 4, "34 3b 06 46"),
    ('5', 4, "4b 0b 08 38 47 45 34 14 05"),
    ('6', 4, "4a 3b 1b 0a 05 14 34 45 47 38 18 07"),
    ('7', 4, "0b 4b 14"),
    ('8', 4, "18 09 0a 1b 3b 4a 49 38 18 07 05 14 34 45 47 38"),
    ('9', 4, "05 14 34 45 4a 3b 1b 0a 08 17 37 48"),
    (':', 0, "04 04,08 08"),
    (';', 1, "14 02,18 18"),
    ('<', 4, "4a 07 44"),
    ('=', 4, "08 48,06 46"),
    ('>', 4, "0a 47 04"),
    ('?', 4, "0a 1b 3b 4a 49 27 26,24 24"),
    ('@', 6, "46 37 28 17 16 25 36 47 56 68 5b 1b 09 05 14 44"),
    ('A', 4, "04 2b 44,17 37"),
    ('B', 4, "04 0b 3b 4a 49 38 08,38 47 45 34 04"),
    ('C', 4, "4a 3b 1b 0a 05 14 34 45"),
    ('D', 4, "04 0b 2b 49 46 24 04"),
    ('E', 4, "4b 0b 04 44,08 38"),
    ('F', 4, "4b 0b 04,08 38"),
    ('G', 4, "4a 3b 1b 0a 05 14 34 45 47 27"),
    ('H', 4, "04 0b,44 4b,08 48"),
    ('I', 0, "04 0b"),
    ('J', 3, "3b 35 24 14 05"),
    ('K', 4, "04 0b,4b 07,18 44"),
    ('L', 4, "0b 04 44"),
    ('M', 6, "04 0b 36 6b 64"),
    ('N', 4, "04 0b 44 4b"),
    ('O', 4, "14 05 0a 1b 3b 4a 45 34 14"),
    ('P', 4, "04 0b 3b 4a 48 37 07"),
    ('Q', 4, "14 05 0a 1b 3b 4a 45 34 14,26 43"),
    ('R', 4, "04 0b 3b 4a 48 37 07,27 44"),
    ('S', 4, "4a 3b 1b 0a 09 18 37 46 45 34 14 05"),
    ('T', 4, "0b 4b,2b 24"),
    ('U', 4, "0b 05 14 34 45 4b"),
    ('V', 4, "0b 24 4b"),
    ('W', 6, "0b 24 3a 44 6b"),
    ('X', 4, "04 4b,0b 44"),
    ('Y', 4, "0b 28 4b,28 24"),
    ('Z', 4, "0b 4b 04 44"),
    ('[', 1, "1c 0c 03 13"),
    ('\\', 3, "0c 33"),
    (']', 1, "0c 1c 13 03"),
    ('^', 4, "09 2b 49"),
    ('_', 4, "03 43"),
    ('`', 1, "0b 1a"),
    ('a', 4, "08 19 39 48 44,47 17 06 05 14 34 45"),
    ('b', 4, "0b 04,08 19 39 48 45 34 14 05"),
    ('c', 4, "48 39 19 08 05 14 34 45"),
    ('d', 4, "4b 44,48 39 19 08 05 14 34 45"),
    ('e', 4, "07 47 48 39 19 08 05 14 34 45"),
    ('f', 3, "3b 2b 1a 14,09 39"),
    ('g', 4, "49 42 31 11 02,48 39 19 08 05 14 34 45"),
    ('h', 4, "0b 04,08 19 39 48 44"),
    ('i', 0, "04 09,0b 0b"),
    ('j', 1, "19 12 01,1b 1b"),
    ('k', 4, "0b 04,49 06,17 44"),
    ('l', 0, "0b 04"),
    ('m', 6, "04 09,08 19 29 38 34,38 49 59 68 64"),
    ('n', 4, "04 09,08 19 39 48 44"),
    ('o', 4, "14 05 08 19 39 48 45 34 14"),
    ('p', 4, "09 01,08 19 39 48 45 34 14 05"),
    ('q', 4, "49 41,48 39 19 08 05 14 34 45"),
    ('r', 3, "04 09,07 18 29 39"),
    ('s', 4, "48 39 19 08 17 36 45 34 14 05"),
    ('t', 3, "1b 15 24 34,09 39"),
    ('u', 4, "09 05 14 34 45,49 44"),
    ('v', 4, "09 24 49"),
    ('w', 6, "09 24 38 44 69"),
    ('x', 4, "04 49,09 44"),
    ('y', 4, "49 24 11 01,09 24"),
    ('z', 4, "09 49 04 44"),
    ('{', 2, "2c 1b 19 08 17 14 23"),
    ('|', 0, "02 0c"),
    ('}', 2, "0c 1b 19 28 17 14 03"),
    ('~', 4, "07 18 36 47"),
    ('\u{b0}', 2, "0a 1b 2a 19 0a"),
    ('\u{b2}', 2, "0a 1b 2a 08 28"),
    ('\u{b5}', 4, "09 01,05 14 34 45,49 44"),
    ('\u{b7}', 0, "07 07"),
    ('\u{d7}', 4, "05 49,09 45"),
    ('\u{3bc}', 4, "09 01,05 14 34 45,49 44"),
    ('\u{2212}', 4, "07 47"),
];

/// What stands for a character that the font does not have.
const UNKNOWN: (u8, &str) = (4, "04 0b 4b 44 04");
/// Space to the right of each character, units.
const SPACING: f64 = 1.9;
/// Height of capitals, em, as in the fonts that the SVG names.
const CAPITAL_EM: f64 = 0.72;
const CAPITAL_UNITS: f64 = 7.0;
const BASELINE: f64 = 4.0;
/// Width of a stroke, em.
pub(crate) const STROKE_EM: f64 = 0.085;

fn glyph(character: char) -> (u8, &'static str) {
    GLYPHS
        .binary_search_by_key(&character, |glyph| glyph.0)
        .map_or(UNKNOWN, |place| (GLYPHS[place].1, GLYPHS[place].2))
}

/// Width of a text set in this size, px.
pub(crate) fn width_px(text: &str, size_px: f64) -> f64 {
    let units: f64 = text.chars().map(|c| f64::from(glyph(c).0) + SPACING).sum();
    (units - SPACING).max(0.0) * size_px * CAPITAL_EM / CAPITAL_UNITS
}

/// The strokes of a text whose baseline begins at `at` (px, y downwards).
pub(crate) fn strokes(text: &str, at: [f64; 2], size_px: f64) -> Vec<Vec<[f64; 2]>> {
    let unit = size_px * CAPITAL_EM / CAPITAL_UNITS;
    let mut left = at[0];
    let mut found = Vec::new();
    for character in text.chars() {
        let (width, lines) = glyph(character);
        for line in lines.split(',').filter(|line| !line.is_empty()) {
            let point = |word: &str| {
                let digit =
                    |i: usize| word[i..=i].chars().next().and_then(|c| c.to_digit(16)).map_or(0.0, f64::from);
                [left + unit * digit(0), at[1] - unit * (digit(1) - BASELINE)]
            };
            found.push(line.split(' ').map(point).collect());
        }
        left += unit * (f64::from(width) + SPACING);
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The table is searched by bisection and its points are read as two digits: both must hold for all.
    #[test]
    fn the_table_is_ordered_whole_and_readable() {
        assert!(GLYPHS.windows(2).all(|pair| pair[0].0 < pair[1].0));
        for character in ' '..='~' {
            assert!(GLYPHS.iter().any(|glyph| glyph.0 == character), "{character:?}");
        }
        for (character, width, lines) in GLYPHS {
            for word in lines.split([',', ' ']).filter(|word| !word.is_empty()) {
                let digits: Vec<u32> = word.chars().filter_map(|c| c.to_digit(16)).collect();
                assert!(
                    digits.len() == 2 && digits[0] <= u32::from(width) && digits[1] <= 12,
                    "{character:?} {word}"
                );
            }
        }
    }

    /// An H of 7 units' height in a size of 10 px: 7.2 px high, 4 / 7 as wide.
    #[test]
    fn a_letter_has_its_size() {
        let lines = strokes("H", [100.0, 50.0], 10.0);
        let points: Vec<[f64; 2]> = lines.concat();
        let top = points.iter().map(|p| p[1]).fold(f64::INFINITY, f64::min);
        assert!((50.0 - top - 7.2).abs() < 1e-9, "{top}");
        assert!((width_px("H", 10.0) - 7.2 * 4.0 / 7.0).abs() < 1e-9);
        assert!(strokes("\u{1f600}", [0.0, 0.0], 10.0).len() == 1, "a box for what is not known");
    }
}
