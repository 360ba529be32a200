//! PNG of 16 bits: a file a frame, the radiance in whole numbers.

use retina_batch::{BatchError, PngShape, png_bytes};
use retina_files::InputError;
use serde_json::{Map, Value, json};

use crate::export::Writer;
use crate::frames::Frame;
use crate::out::Out;

/// The largest number of a sample.
const WHITE: f32 = 65_535.0;

/// Radiance over a frame's `full_scale_w_m2_sr_nm`, times 65535. The full scale is the least power of two that the frame's
/// brightest pixel does not exceed, so that frames of one sequence differ by exact factors.
#[derive(Default)]
pub(crate) struct Png16 {
    scales: Map<String, Value>,
}

impl Writer for Png16 {
    fn add(&mut self, out: &Out, frame: &Frame, _: bool) -> Result<(), BatchError> {
        let no_radiance = || {
            InputError::new(format!("frame {}", frame.index), "has no radiance to write in 16 bits").help(
                "render the scene with `radiance_exr = true` in `[output]`; the screen's own 8-bit PNG files are in frames/",
            )
        };
        let planes = frame.planes.as_ref().ok_or_else(no_radiance)?;
        let (_, radiance) = planes.channels.iter().find(|(name, _)| name == "Y").ok_or_else(no_radiance)?;
        let brightest = radiance.iter().copied().fold(0.0f32, f32::max);
        let full_scale = full_scale(brightest);
        let samples: Vec<u8> = radiance
            .iter()
            .flat_map(|value| ((value / full_scale * WHITE).round().clamp(0.0, WHITE) as u16).to_be_bytes())
            .collect();
        let name = format!("{:06}.png", frame.index);
        let shape = PngShape {
            width_px: planes.width_px as u32,
            height_px: planes.height_px as u32,
            channels: 1,
            bits: 16,
            filtered: true,
        };
        let text = ("full_scale_w_m2_sr_nm", format!("{full_scale:e}"));
        out.write(&name, &png_bytes(&name, shape, &samples, &[text])?)?;
        self.scales.insert(name, json!(f64::from(full_scale)));
        Ok(())
    }

    fn finish(&mut self, out: &Out) -> Result<(), BatchError> {
        out.write_json("scales.json", &json!({ "full_scale_w_m2_sr_nm": self.scales, "white": 65_535 }))
    }
}

/// The least power of two that is not below a value; 1 of darkness.
fn full_scale(brightest: f32) -> f32 {
    if brightest > 0.0 && brightest.is_finite() { brightest.log2().ceil().exp2() } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::full_scale;

    #[test]
    fn the_full_scale_is_a_power_of_two_at_or_above_the_brightest() {
        assert_eq!(
            [0.0, 1.0, 1.5, 0.3, 2f32.powi(-20)].map(full_scale),
            [1.0, 1.0, 2.0, 0.5, 2f32.powi(-20)]
        );
    }
}
