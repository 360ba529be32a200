//! The image of a frame: a facility's screen image, or an ordinary one.

use retina_geometry::Pinhole;
use retina_scene::{Display, Scene};
use retina_screen::{PlainDisplay, ScreenEncoder};

use crate::BatchError;
use crate::png_file::{PngShape, png_bytes};

/// Makes the image file of a frame from its light.
#[derive(Debug, Clone)]
pub(crate) struct Picture {
    width_px: u32,
    height_px: u32,
    display: Encoder,
}

#[derive(Debug, Clone)]
enum Encoder {
    Screen(ScreenEncoder),
    Plain(PlainDisplay),
}

/// A frame's image file.
pub(crate) struct Painted {
    pub(crate) png: Vec<u8>,
    pub(crate) saturated_px: u64,
}

impl Picture {
    pub(crate) fn of(scene: &Scene) -> Self {
        let Pinhole { width_px, height_px, .. } = scene.image;
        let display = match &scene.display {
            Display::Facility(setup) => Encoder::Screen(ScreenEncoder::new(setup)),
            Display::Plain(plain) => Encoder::Plain(*plain),
        };
        Self { width_px, height_px, display }
    }

    /// The radiance scale that shows a pixel of this light just below saturation.
    pub(crate) fn scale_for_brightest(&self, light: f64) -> f64 {
        match &self.display {
            Encoder::Screen(screen) => screen.scale_for_brightest(light),
            Encoder::Plain(plain) => plain.scale_for_brightest(light),
        }
    }

    /// The PNG of frame `index`; text chunks carry schema and frame.
    ///
    /// # Errors
    /// Light that is not finite, or a PNG that cannot be encoded.
    pub(crate) fn paint(
        &self,
        index: usize,
        light: &[f32],
        radiance_scale: f64,
    ) -> Result<Painted, BatchError> {
        let not_finite = |pixels| BatchError::NotFinite { frame: index, pixels };
        let (schema, channels, bits, bytes, saturated_px) = match &self.display {
            Encoder::Screen(screen) => {
                let encoded = screen.encode(light, radiance_scale).map_err(not_finite)?;
                let rgb = encoded.counts.iter().flat_map(|&count| [count; 3]).collect::<Vec<u8>>();
                ("retina.screen/1", 3, 8, rgb, encoded.saturated_px)
            }
            Encoder::Plain(plain) => {
                let encoded = plain.encode(light, radiance_scale).map_err(not_finite)?;
                let channels = usize::from(plain.channels);
                let bytes = if plain.bits == 8 {
                    encoded.samples.iter().flat_map(|&s| std::iter::repeat_n(s as u8, channels)).collect()
                } else {
                    let bytes = |&s: &u16| std::iter::repeat_n(s.to_be_bytes(), channels).flatten();
                    encoded.samples.iter().flat_map(bytes).collect::<Vec<u8>>()
                };
                ("retina.image/1", channels, u32::from(plain.bits), bytes, encoded.saturated_px)
            }
        };
        let shape = PngShape { width_px: self.width_px, height_px: self.height_px, channels, bits };
        let texts = [("schema", schema.to_string()), ("frame", index.to_string())];
        let png = png_bytes(&format!("frame {index}"), shape, &bytes, &texts)?;
        Ok(Painted { png, saturated_px })
    }
}
