//! A camera image: grey digital numbers.

use rayon::prelude::*;

/// A grey image as the camera gave it: digital numbers (DN), row by row, linear in light.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraImage {
    /// Width, pixels.
    pub width_px: u32,
    /// Height, pixels.
    pub height_px: u32,
    /// `width_px * height_px` digital numbers, row by row from the top.
    pub values: Vec<f32>,
    /// The largest digital number that the camera can give, 4095 for 12 bits.
    pub full_scale_dn: f32,
    /// What the values were rounded to.
    pub steps: Steps,
}

/// The steps of an image's digital numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Steps {
    /// Whole numbers.
    Whole,
    /// Whole numbers of the sRGB coding, made linear: steps that grow with the light.
    Srgb,
    /// Floating point: none that matter.
    Fine,
}

impl CameraImage {
    /// A dark image of whole digital numbers.
    pub fn new(width_px: u32, height_px: u32, full_scale_dn: f32) -> Self {
        let values = vec![0.0; width_px as usize * height_px as usize];
        Self { width_px, height_px, values, full_scale_dn, steps: Steps::Whole }
    }

    /// One row, left to right.
    pub fn row(&self, row: usize) -> &[f32] {
        let width = self.width_px as usize;
        &self.values[row * width..(row + 1) * width]
    }

    /// The digital number of a pixel; the place must be inside.
    pub fn at(&self, column: usize, row: usize) -> f32 {
        self.values[row * self.width_px as usize + column]
    }

    /// Number of pixels that have a digital number or more.
    pub fn count_from(&self, dn: f32) -> usize {
        // In parts that 32 bits count: several pixels at a time, which a check of each sum for overflow would prevent.
        let of_part = |part: &[f32]| {
            let mut count = 0u32;
            for &value in part {
                count = count.wrapping_add(u32::from(value >= dn));
            }
            count as usize
        };
        self.values.par_chunks(1 << 16).map(of_part).sum()
    }

    /// Distance of neighbouring digital numbers at a level, DN.
    pub(crate) fn step_dn(&self, level_dn: f32) -> f32 {
        match self.steps {
            Steps::Whole => 1.0,
            Steps::Srgb => srgb_slope(level_dn / self.full_scale_dn),
            Steps::Fine => 0.0,
        }
    }
}

/// Light of an sRGB value, both 0 to 1 (IEC 61966-2-1).
pub(crate) fn srgb_light(value: f32) -> f32 {
    if value <= 0.040_45 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

/// Slope of [`srgb_light`] where it has this light.
fn srgb_slope(light: f32) -> f32 {
    if light <= 0.003_130_8 { 1.0 / 12.92 } else { 2.4 / 1.055 * light.powf(1.4 / 2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_are_counted_in_all_parts() {
        let mut image = CameraImage::new(701, 300, 255.0);
        image.values.iter_mut().step_by(7).for_each(|value| *value = 200.0);
        image.values[3] = 199.5;
        assert_eq!([200.0, 199.5, 0.0, 201.0].map(|dn| image.count_from(dn)), [30_043, 30_044, 210_300, 0]);
    }

    #[test]
    fn srgb_is_decoded_and_its_steps_are_its_differences() {
        // 128 of 255: 0.215 861 by the standard's formula.
        assert!((srgb_light(128.0 / 255.0) - 0.215_861).abs() < 1e-5);
        assert_eq!([srgb_light(0.0), srgb_light(1.0)], [0.0, 1.0]);
        let image = CameraImage { steps: Steps::Srgb, ..CameraImage::new(1, 1, 255.0) };
        for value in [3.0f32, 60.0, 128.0, 250.0] {
            let light = |v: f32| 255.0 * srgb_light(v / 255.0);
            let step = 0.5 * (light(value + 1.0) - light(value - 1.0));
            assert!((image.step_dn(light(value)) / step - 1.0).abs() < 1e-2, "{value}");
        }
    }
}
