//! What an image shows besides an answer: the facts from which a refusal says what to try.

use retina_image::{CameraImage, DetectOptions, Detection};
use serde::Serialize;

use crate::image::ImageContext;
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
    /// All pixels that are searched have one value.
    pub constant: bool,
    /// Share of the pixels that the mask leaves out.
    pub masked_share: f64,
    /// The field of view was given, and may be wrong.
    pub field_given: bool,
    /// The shape of the pixels was given, and may be wrong.
    pub aspect_given: bool,
}

/// From these shares on something is the reason.
const MANY_ON_EDGES: f64 = 0.5;
const MUCH_SATURATED: f64 = 0.05;
/// So many single pixels are a camera's defects.
const MANY_HOT: usize = 20;
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
        context: &ImageContext,
    ) -> Self {
        let full = options.saturation_dn.unwrap_or(image.full_scale_dn);
        let saturated = image.count_from(full);
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
            constant: is_constant(image, context.mask.as_deref()),
            masked_share: context.mask.as_ref().map_or(0.0, |mask| {
                mask.iter().filter(|counts| !**counts).count() as f64 / mask.len().max(1) as f64
            }),
            field_given: context.field_given,
            aspect_given: context.aspect_given,
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
        if self.masked_share > 0.0 {
            again += &format!("; the mask leaves {:.1} % of the image", 100.0 * (1.0 - self.masked_share));
        }
        format!("{seen}{again}. {}{}", self.advice(refusal), self.doubts(refusal))
    }

    /// What was given and may be at fault.
    fn doubts(&self, refusal: &Refusal) -> String {
        if self.masked_share >= 1.0
            || self.constant
            || matches!(refusal, Refusal::FocalLength { .. } | Refusal::Mirrored { .. })
        {
            return String::new();
        }
        let given = [
            (self.field_given, "try without the field of view that was given (--fov-deg)"),
            (self.aspect_given, "check the shape of the pixels that was given (--pixel-aspect)"),
            (self.masked_share > 0.0, "check whether the mask (--mask) covers the stars"),
        ];
        let doubts: Vec<&str> = given.iter().filter(|(is, _)| *is).map(|(_, doubt)| *doubt).collect();
        if doubts.is_empty() { String::new() } else { format!("; {}", doubts.join("; ")) }
    }

    fn advice(&self, refusal: &Refusal) -> String {
        let clear = self.points - self.on_edges.min(self.points);
        match refusal {
            Refusal::FocalLength { .. } => "Give another field of view, or none".to_owned(),
            Refusal::Mirrored { .. } => "Flip the image, or say that it is mirrored".to_owned(),
            _ if self.masked_share >= 1.0 => {
                "The mask leaves nothing: its pixels count where they are not 0 (--mask)".to_owned()
            }
            _ if self.constant => "All pixels have one value: this is no exposure of a sky, or the dark frame (--dark) is \
                 the image itself"
                .to_owned(),
            _ if self.saturated_share >= MUCH_SATURATED => {
                "Expose for a shorter time, or mask what is saturated (--mask)".to_owned()
            }
            _ if self.on_edges as f64 >= MANY_ON_EDGES * self.points as f64 && self.on_edges > FEW_POINTS => {
                "Mask the foreground (--mask)".to_owned()
            }
            _ if self.hot_pixels > MANY_HOT && self.hot_pixels > self.points => {
                "Subtract a dark frame of the same exposure (--dark): most of what stands out are single pixels".to_owned()
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

/// Whether all pixels that count have one value.
fn is_constant(image: &CameraImage, mask: Option<&[bool]>) -> bool {
    let counts = |at: usize| mask.is_none_or(|mask| mask[at]);
    let mut values = image.values.iter().enumerate().filter(|(at, _)| counts(*at)).map(|(_, value)| *value);
    values.next().is_some_and(|first| values.all(|value| value == first))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn said(seen: Seen) -> String {
        seen.sentence(&Refusal::TooFewPoints { found: seen.points, needed: 5 })
    }

    #[test]
    fn advice_names_what_is_at_fault_and_not_the_exposure() {
        let seen = Seen { points: 2, threshold_sigma: 5.0, attempts: 3, ..Seen::default() };
        assert!(said(seen.clone()).contains("Expose for longer"));
        for (seen, word) in [
            (Seen { hot_pixels: 300, ..seen.clone() }, "Subtract a dark frame of the same exposure (--dark)"),
            (Seen { masked_share: 1.0, ..seen.clone() }, "The mask leaves nothing"),
            (Seen { constant: true, ..seen.clone() }, "All pixels have one value"),
        ] {
            let text = said(seen);
            assert!(text.contains(word) && !text.contains("Expose for longer"), "{text}");
        }
        for (seen, word) in [
            (Seen { field_given: true, ..seen.clone() }, "try without the field of view"),
            (Seen { aspect_given: true, ..seen.clone() }, "(--pixel-aspect)"),
            (Seen { masked_share: 0.25, ..seen.clone() }, "leaves 75.0 % of the image"),
        ] {
            assert!(said(seen.clone()).contains(word), "{}", said(seen));
        }
    }

    #[test]
    fn an_image_of_one_value_is_told_from_one_with_a_pixel_that_differs() {
        let mut image = CameraImage::new(4, 3, 255.0);
        assert!(is_constant(&image, None));
        image.values[5] = 1.0;
        assert!(!is_constant(&image, None));
        let mask: Vec<bool> = (0..12).map(|at| at != 5).collect();
        assert!(is_constant(&image, Some(&mask)) && !is_constant(&image, Some(&[false; 12])));
    }
}
