//! Ordinary images: the radiance factor on a linear or an sRGB scale, 8 or 16 bits.

/// How a value of 0..1 becomes a part of full scale.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transfer {
    /// In proportion.
    Linear,
    /// By the sRGB curve (IEC 61966-2-1).
    Srgb,
}

/// An image that is not shown in a facility: a stated part of full scale for I/F = 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlainDisplay {
    /// Value, as a part of full scale before the transfer curve, of I/F = 1 at radiance scale 1.
    pub gain: f64,
    /// The curve.
    pub transfer: Transfer,
    /// 8 or 16.
    pub bits: u8,
    /// 1 (grey) or 3 (equal channels).
    pub channels: u8,
}

/// Samples of a plain image.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PlainSamples {
    /// One sample a pixel, row by row.
    pub samples: Vec<u16>,
    /// Pixels beyond full scale by more than half a step.
    pub saturated_px: u64,
}

impl PlainDisplay {
    /// The largest sample.
    pub fn full_scale(&self) -> u16 {
        if self.bits == 16 { u16::MAX } else { 255 }
    }

    /// The radiance scale that shows `radiance_factor` at full scale.
    pub fn scale_for_brightest(&self, radiance_factor: f64) -> f64 {
        1.0 / (self.gain * radiance_factor)
    }

    /// Samples of an image of I/F.
    ///
    /// # Errors
    /// The number of pixels that are not finite.
    pub fn encode(&self, radiance_factor: &[f32], radiance_scale: f64) -> Result<PlainSamples, usize> {
        let not_finite = radiance_factor.iter().filter(|value| !value.is_finite()).count();
        if not_finite > 0 {
            return Err(not_finite);
        }
        let (factor, full) = (self.gain * radiance_scale, f64::from(self.full_scale()));
        let mut saturated_px = 0;
        let samples = radiance_factor
            .iter()
            .map(|&value| {
                let wanted = self.transfer.apply(f64::from(value) * factor) * full;
                saturated_px += u64::from(wanted > full + 0.5);
                wanted.round().clamp(0.0, full) as u16
            })
            .collect();
        Ok(PlainSamples { samples, saturated_px })
    }
}

impl Transfer {
    /// Part of full scale of a linear value; the sRGB curve is
    /// 12.92 v up to 0.0031308 and 1.055 v^(1 / 2.4) - 0.055 above.
    pub fn apply(self, value: f64) -> f64 {
        match self {
            Self::Srgb if value > 0.003_130_8 => 1.055 * value.powf(1.0 / 2.4) - 0.055,
            Self::Srgb => 12.92 * value,
            Self::Linear => value,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_follow_the_curve() {
        let display = PlainDisplay { gain: 2.0, transfer: Transfer::Srgb, bits: 8, channels: 3 };
        // sRGB of 0.5 is 0.7354 (188), of 0.001 is 0.01292 (3); IEC 61966-2-1's own formula by hand.
        let encoded = display.encode(&[0.25, 0.0005, 0.6, -0.1], 1.0).unwrap();
        assert_eq!(encoded.samples, [188, 3, 255, 0]);
        assert_eq!(encoded.saturated_px, 1);
        let linear = PlainDisplay { transfer: Transfer::Linear, bits: 16, ..display };
        assert_eq!(linear.encode(&[0.25], 1.0).unwrap().samples, [32_768]);
        assert_eq!(linear.encode(&[f32::NAN, 0.1], 1.0).unwrap_err(), 1);
        assert_eq!(linear.scale_for_brightest(0.25), 2.0);
    }
}
