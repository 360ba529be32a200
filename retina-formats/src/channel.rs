//! Which sub-pixels of the display are lit.

use retina_radiometry::{DigitalCounts, ScreenResponse};

/// The lit sub-pixels: one colour, or all three at one count.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Channel {
    /// Red alone.
    R,
    /// Green alone.
    G,
    /// Blue alone.
    B,
    /// White: all three at the same count.
    #[default]
    W,
}

impl Channel {
    /// Red, green, blue, white.
    pub const ALL: [Self; 4] = [Self::R, Self::G, Self::B, Self::W];
    /// Red, green, blue.
    pub const COLOURS: [Self; 3] = [Self::R, Self::G, Self::B];

    /// As files name it: `r`, `g`, `b` or `w`.
    pub fn letter(self) -> &'static str {
        ["r", "g", "b", "w"][self as usize]
    }

    /// As people name it: red, green, blue, white.
    pub fn name(self) -> &'static str {
        ["red", "green", "blue", "white"][self as usize]
    }

    /// From its letter.
    pub fn from_letter(letter: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|channel| channel.letter() == letter)
    }

    /// The colours that are lit, as indices into red, green, blue.
    pub fn lit(self) -> std::ops::Range<usize> {
        match self {
            Self::W => 0..3,
            colour => colour as usize..colour as usize + 1,
        }
    }

    /// The digital counts of a pixel that shows this channel at `count`.
    pub fn counts(self, count: u8) -> DigitalCounts {
        let mut counts = [0; 3];
        counts[self.lit()].fill(count);
        counts
    }
}

/// L of a digital count: log10 of the irradiance of one pixel relative to white at 255. A single channel has its share
/// of white. Between whole counts the irradiance is interpolated linearly.
pub fn log10_irradiance(response: &ScreenResponse, channel: Channel, digital_count: f64) -> f64 {
    let of = |count: f64| response.irradiance_w_m2_nm(channel.counts(count as u8));
    let low = digital_count.floor().clamp(0.0, 255.0);
    let high = (low + 1.0).min(255.0);
    let irradiance = of(low) + (digital_count - low) * (of(high) - of(low));
    (irradiance / response.brightest_w_m2_nm()).log10()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_and_lit_colours() {
        for channel in Channel::ALL {
            assert_eq!(Channel::from_letter(channel.letter()), Some(channel));
        }
        assert_eq!(Channel::from_letter("x"), None);
        assert_eq!(Channel::G.counts(7), [0, 7, 0]);
        assert_eq!(Channel::W.counts(7), [7; 3]);
    }

    /// Squares of the count: white at half count has a quarter of the light, a channel a third of white.
    #[test]
    fn irradiance_relative_to_white_at_full_count() {
        let response = ScreenResponse::power_law(2.0, 0.0);
        assert!(log10_irradiance(&response, Channel::W, 255.0).abs() < 1e-12);
        assert!((log10_irradiance(&response, Channel::W, 51.0) - (0.04f64).log10()).abs() < 1e-12);
        assert!((log10_irradiance(&response, Channel::B, 255.0) + 3f64.log10()).abs() < 1e-12);
        // Halfway between 1 and 2 by irradiance: (1 + 4) / 2.
        let expected = (2.5 / 65_025.0f64).log10();
        assert!((log10_irradiance(&response, Channel::W, 1.5) - expected).abs() < 1e-12);
    }
}
