//! What an image shows besides an answer: the facts from which a refusal says what to try.

use retina_image::{CameraImage, DetectOptions, Detection};
use serde::Serialize;

use crate::stars::{Refusal, StarPoint};

/// What there was to be seen, by the first way to find points.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Seen {
    /// Points of light with a line of sight.
    pub points: usize,
    /// Of these, on the edge of something bright or in its texture.
    pub on_edges: usize,
    /// Single pixels that were taken for defects.
    pub hot_pixels: usize,
    /// Typical background, DN.
    pub background_dn: f64,
    /// Typical standard deviation of a dark pixel, DN.
    pub noise_dn: f64,
    /// Share of pixels at full scale.
    pub saturated_share: f64,
    /// Threshold of the points, standard deviations of the noise.
    pub threshold_sigma: f64,
    /// Ways to find points that were tried.
    pub attempts: usize,
    /// Shapes of pixels that were tried beside the camera's.
    pub pixel_aspects: usize,
}

/// From these shares on something is the reason.
const MANY_ON_EDGES: f64 = 0.5;
const MUCH_SATURATED: f64 = 0.05;
/// So few points hardly hold a sky.
const FEW_POINTS: usize = 8;
/// So many are mostly no stars.
const MANY_POINTS: usize = 3000;

impl Seen {
    pub(crate) fn of(
        image: &CameraImage,
        detection: &Detection,
        points: &[StarPoint],
        options: &DetectOptions,
    ) -> Self {
        let full = options.saturation_dn.unwrap_or(image.full_scale_dn);
        let saturated = image.values.iter().filter(|value| **value >= full).count();
        Self {
            points: points.len(),
            on_edges: points.iter().filter(|point| point.on_edge).count(),
            hot_pixels: detection.hot_pixels.len(),
            background_dn: detection.background_dn,
            noise_dn: detection.noise_dn,
            saturated_share: saturated as f64 / image.values.len().max(1) as f64,
            threshold_sigma: options.threshold_sigma,
            attempts: 1,
            pixel_aspects: 0,
        }
    }

    /// What was seen and what to try, in words.
    pub fn sentence(&self, refusal: &Refusal) -> String {
        let Self { points, on_edges, hot_pixels, background_dn, noise_dn, threshold_sigma, .. } = self;
        let mut seen = format!(
            "Seen: {points} points of light above {threshold_sigma} sigma of a noise of {noise_dn:.2} DN on \
             {background_dn:.1} DN"
        );
        if *on_edges > 0 {
            seen += &format!(", {on_edges} of them on edges of something bright");
        }
        if *hot_pixels > 0 {
            seen += &format!(", beside {hot_pixels} single pixels that were taken for defects");
        }
        if self.saturated_share >= MUCH_SATURATED {
            seen += &format!("; {:.0} % of the pixels are saturated", 100.0 * self.saturated_share);
        }
        let mut again = match self.attempts {
            0 | 1 => String::new(),
            more => format!("; {} other thresholds and backgrounds were tried", more - 1),
        };
        if self.pixel_aspects > 0 {
            again += &format!("; {} shapes of pixels were tried", self.pixel_aspects);
        }
        format!("{seen}{again}. {}", self.advice(refusal))
    }

    fn advice(&self, refusal: &Refusal) -> String {
        let clear = self.points - self.on_edges.min(self.points);
        match refusal {
            Refusal::FocalLength { .. } => "Give another field of view, or none".to_owned(),
            Refusal::Mirrored { .. } => "Flip the image, or say that it is mirrored".to_owned(),
            _ if self.saturated_share >= MUCH_SATURATED => {
                "Expose for a shorter time, or mask what is saturated (--mask)".to_owned()
            }
            _ if self.on_edges as f64 >= MANY_ON_EDGES * self.points as f64 && self.on_edges > FEW_POINTS => {
                "Mask the foreground (--mask)".to_owned()
            }
            _ if clear < FEW_POINTS => {
                "Expose for longer, lower --threshold-sigma, or take a wider field: so few stars prove nothing"
                    .to_owned()
            }
            _ if self.points > MANY_POINTS => {
                "Most of these are noise: raise --threshold-sigma, or subtract a dark frame (--dark)".to_owned()
            }
            _ => "Check the field of view, and whether the stars are \
                  points and not trails; the catalogue ends at V 8.4, so that a field of few degrees may show none \
                  of its stars"
                .to_owned(),
        }
    }
}
