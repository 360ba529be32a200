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

/// A picture's samples, row by row.
pub(crate) enum PictureSamples {
    /// Digital counts of a screen, equal in its three channels.
    Counts(Vec<u8>),
    /// Of an ordinary image.
    Plain(Vec<u16>, PlainDisplay),
}

/// A frame's picture, and what is in it.
pub(crate) struct Painted {
    pub(crate) samples: PictureSamples,
    /// Whether a PNG's filters help: gradients, not points on dark ground, where they only cost time.
    pub(crate) filtered: bool,
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

    /// The picture of frame `index`: light and point sources.
    ///
    /// # Errors
    /// Light that is not finite.
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
        let (samples, saturated_px) = match &self.display {
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
                (PictureSamples::Counts(encoded.counts), encoded.saturated_px)
            }
            Encoder::Plain(plain) => {
                let encoded = plain.encode(light, radiance_scale).map_err(not_finite)?;
                (PictureSamples::Plain(encoded.samples, *plain), encoded.saturated_px)
            }
        };
        Ok(Painted { samples, filtered: !light.is_empty(), saturated_px, stars, flashes, body })
    }

    /// The PNG of frame `index`; text chunks carry schema and frame.
    ///
    /// # Errors
    /// It cannot be encoded.
    pub(crate) fn png(
        &self,
        index: usize,
        samples: &PictureSamples,
        filtered: bool,
    ) -> Result<Vec<u8>, BatchError> {
        match samples {
            PictureSamples::Counts(counts) => {
                screen_png(index, [self.width_px, self.height_px], counts, filtered)
            }
            PictureSamples::Plain(samples, plain) => {
                let channels = usize::from(plain.channels);
                let bytes = if plain.bits == 8 {
                    samples.iter().flat_map(|&s| std::iter::repeat_n(s as u8, channels)).collect()
                } else {
                    let bytes = |&s: &u16| std::iter::repeat_n(s.to_be_bytes(), channels).flatten();
                    samples.iter().flat_map(bytes).collect::<Vec<u8>>()
                };
                let bits = u32::from(plain.bits);
                let (width_px, height_px) = (self.width_px, self.height_px);
                let shape = PngShape { width_px, height_px, channels, bits, filtered };
                encoded(index, "retina.image/1", shape, &bytes)
            }
        }
    }
}

/// The PNG of a screen image, as a run writes it: its counts, equal in the three channels, row by row.
///
/// # Errors
/// It cannot be encoded.
pub fn screen_png(
    index: usize,
    [width_px, height_px]: [u32; 2],
    counts: &[u8],
    filtered: bool,
) -> Result<Vec<u8>, BatchError> {
    let shape = PngShape { width_px, height_px, channels: 3, bits: 8, filtered };
    encoded(index, "retina.screen/1", shape, &equal_channels(counts))
}

fn encoded(index: usize, schema: &str, shape: PngShape, bytes: &[u8]) -> Result<Vec<u8>, BatchError> {
    let texts = [("schema", schema.to_string()), ("frame", index.to_string())];
    png_bytes(&format!("frame {index}"), shape, bytes, &texts)
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
