//! The image of a frame: a facility's screen image, or an ordinary one.

use retina_geometry::Pinhole;
use retina_scene::{Display, DisplayedPoint, Scene, SeenFlash, ShownFlash, ShownPoint, SkyPoint};
use retina_screen::{Encoded, PlainDisplay, PointPainter, Quantisation, ScreenEncoder};

use crate::plan::Developed;
use crate::png_file::{PngShape, png_bytes};
use crate::{BatchError, stars};

/// Makes the image file of a frame from its light.
#[derive(Debug, Clone)]
pub(crate) struct Picture {
    width_px: u32,
    height_px: u32,
    display: Encoder,
}

#[derive(Debug, Clone)]
#[allow(clippy::large_enum_variant, reason = "one value in a run")]
enum Encoder {
    Screen { screen: ScreenEncoder, quantisation: Quantisation, points: Box<PointPainter> },
    Plain(PlainDisplay),
}

/// A frame's point sources, in the order in which they are drawn.
#[derive(Debug, Clone, Default)]
pub(crate) struct PointSources {
    pub(crate) sky: Vec<SkyPoint>,
    pub(crate) flashes: Vec<SeenFlash>,
}

/// A frame's image file.
pub(crate) struct Painted {
    pub(crate) png: Vec<u8>,
    pub(crate) saturated_px: u64,
    /// The point sources in it.
    pub(crate) stars: Vec<ShownPoint>,
    /// The flashes, those that are hidden among them.
    pub(crate) flashes: Vec<ShownFlash>,
    /// An unresolved body, shown as a point.
    pub(crate) body: Option<DisplayedPoint>,
}

impl Picture {
    pub(crate) fn of(scene: &Scene) -> Self {
        let Pinhole { width_px, height_px, .. } = scene.image;
        let display = match &scene.display {
            Display::Facility(setup) => {
                let screen = match &scene.response {
                    Some(response) => ScreenEncoder::with_response(setup, response.clone()),
                    None => ScreenEncoder::new(setup),
                };
                let response = screen.response().clone();
                let points = PointPainter::new(scene.image, scene.distortion.clone(), response)
                    .with_inverse(scene.inverse.clone());
                Encoder::Screen { screen, quantisation: scene.output.quantisation, points: Box::new(points) }
            }
            Display::Plain(plain) => Encoder::Plain(*plain),
        };
        Self { width_px, height_px, display }
    }

    /// The radiance scale that shows a pixel of this light just below saturation.
    pub(crate) fn scale_for_brightest(&self, light: f64) -> f64 {
        match &self.display {
            Encoder::Screen { screen, .. } => screen.scale_for_brightest(light),
            Encoder::Plain(plain) => plain.scale_for_brightest(light),
        }
    }

    /// The PNG of frame `index`, light and point sources; text chunks carry schema and frame.
    ///
    /// # Errors
    /// Light that is not finite, or a PNG that cannot be encoded.
    pub(crate) fn paint(
        &self,
        index: usize,
        developed: &Developed,
        sources: PointSources,
        radiance_scale: f64,
    ) -> Result<Painted, BatchError> {
        let not_finite = |pixels| BatchError::NotFinite { frame: index, pixels };
        let light = &developed.light[..];
        let (mut stars, mut flashes, mut body) = (Vec::new(), Vec::new(), None);
        let (schema, channels, bits, bytes, saturated_px) = match &self.display {
            Encoder::Screen { screen, quantisation, points } => {
                let mut encoded = if light.is_empty() || developed.photocentre_px.is_some() {
                    Encoded { counts: vec![0; (self.width_px * self.height_px) as usize], saturated_px: 0 }
                } else {
                    screen.encode(light, radiance_scale, *quantisation).map_err(not_finite)?
                };
                if let Some(at_px) = developed.photocentre_px {
                    let total = points.irradiance_w_m2_nm(light);
                    let pixels = light.iter().filter(|value| !value.is_finite()).count();
                    if !total.is_finite() {
                        return Err(not_finite(pixels));
                    }
                    body = stars::show(points, &mut encoded.counts, at_px, total * radiance_scale);
                }
                stars = stars::draw(points, &mut encoded.counts, sources.sky, radiance_scale);
                flashes = stars::draw_flashes(points, &mut encoded.counts, sources.flashes, radiance_scale);
                let rgb = equal_channels(&encoded.counts);
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
        // Filters help gradients; points on dark ground they only cost time.
        let filtered = !light.is_empty();
        let shape = PngShape { width_px: self.width_px, height_px: self.height_px, channels, bits, filtered };
        let texts = [("schema", schema.to_string()), ("frame", index.to_string())];
        let png = png_bytes(&format!("frame {index}"), shape, &bytes, &texts)?;
        Ok(Painted { png, saturated_px, stars, flashes, body })
    }
}

/// Each count three times.
fn equal_channels(counts: &[u8]) -> Vec<u8> {
    let mut rgb = vec![0; 3 * counts.len()];
    for (pixel, &count) in rgb.chunks_exact_mut(3).zip(counts) {
        if count > 0 {
            pixel.fill(count);
        }
    }
    rgb
}
