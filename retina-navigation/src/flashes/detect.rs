//! Points of light on the night side.

use std::path::Path;

use glam::DVec2;
use retina_files::InputError;
use retina_image::{CameraImage, Centroid, DetectOptions, detect_matched_in, detect_points_in};
use serde::{Deserialize, Serialize};

use super::night::{BodyPose, Margins, night_mask};
use super::threshold::{SearchArea, threshold_sigma};
use crate::limb::LimbCamera;

/// How flashes are looked for.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FlashOptions {
    /// False detections that normal noise gives in a frame, at most: sets the threshold.
    pub false_alarms_per_frame: f64,
    /// See [`Margins::limb_px`].
    pub limb_margin_px: f64,
    /// See [`Margins::terminator_px`].
    pub terminator_margin_px: f64,
    /// Highest relief over its surroundings, over the body's radius.
    pub relief: f64,
    /// Side of the cells in which level and noise are found, px.
    pub mesh_px: usize,
}

impl FlashOptions {
    /// Refuses values that a detector cannot have; `path` is whom an error blames, `place` says where a key stands.
    ///
    /// # Errors
    /// A value out of its range.
    pub fn check(&self, path: &Path, place: impl Fn(&str) -> String) -> Result<(), InputError> {
        let margin = |value: f64| (0.0..1e4).contains(&value);
        for (key, value, fits, expected) in [
            (
                "false_alarms_per_frame",
                self.false_alarms_per_frame,
                (1e-12..=1e3).contains(&self.false_alarms_per_frame),
                "1e-12 to 1000",
            ),
            ("limb_margin_px", self.limb_margin_px, margin(self.limb_margin_px), "0 or more"),
            (
                "terminator_margin_px",
                self.terminator_margin_px,
                margin(self.terminator_margin_px),
                "0 or more",
            ),
            ("relief", self.relief, (0.0..1.0).contains(&self.relief), "0 to 1, of the radius"),
            ("mesh_px", self.mesh_px as f64, (16..=1024).contains(&self.mesh_px), "16 to 1024"),
        ] {
            if !fits {
                return Err(InputError::new(path, "the value does not fit")
                    .at(place(key))
                    .found(value)
                    .expected(expected));
            }
        }
        Ok(())
    }
}

impl Default for FlashOptions {
    fn default() -> Self {
        Self {
            false_alarms_per_frame: 0.01,
            limb_margin_px: 8.0,
            terminator_margin_px: 16.0,
            // The Moon's summits stand 8 km and less over what is before them (LOLA: -9.1 to 10.8 km in all).
            relief: 0.0046,
            mesh_px: 64,
        }
    }
}

/// Magnitude of one DN of a point's light over an image: spots differ, and a window of one width for all holds another
/// share of each.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ZeroPoint {
    /// In the image's middle.
    pub magnitude: f64,
    /// What is added in its corners; elsewhere times d, the square of the distance from the middle, 1 in the corners.
    pub corner_magnitude: f64,
    /// What is added in between, times d (1 - d): it grows faster near the middle where this is above 0.
    pub bend_magnitude: f64,
    /// Standard deviation of points' own zero points about this one.
    pub sigma_magnitude: f64,
}

impl ZeroPoint {
    /// The same everywhere, and exact.
    pub fn constant(magnitude: f64) -> Self {
        Self { magnitude, corner_magnitude: 0.0, bend_magnitude: 0.0, sigma_magnitude: 0.0 }
    }

    /// Squared distance from the middle of an image of a size, the corners' being one.
    pub fn distance2(px: DVec2, size_px: DVec2) -> f64 {
        (px - 0.5 * size_px).length_squared() / (0.25 * size_px.length_squared())
    }

    /// At a place of an image of a size.
    pub fn at(&self, px: DVec2, size_px: DVec2) -> f64 {
        self.at_distance2(Self::distance2(px, size_px))
    }

    /// At a [`Self::distance2`].
    pub fn at_distance2(&self, distance2: f64) -> f64 {
        self.magnitude + distance2 * (self.corner_magnitude + (1.0 - distance2) * self.bend_magnitude)
    }
}

/// What is known of an image's light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Light {
    /// Magnitude of one DN of a point's light; `None`: magnitudes are not known.
    pub zero_point: Option<ZeroPoint>,
    /// Electrons per DN: adds the light's own noise. `None`: it has none, as in a screen image.
    pub gain_e_per_dn: Option<f64>,
    /// What a point looks like.
    pub spot: Spot,
}

/// What a point of light looks like.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Spot {
    /// Some whole pixels of a screen, without noise.
    Pixels,
    /// A camera's spot of this standard deviation, px.
    Gaussian(f64),
}

/// A point of light on the night side.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Candidate {
    /// Centroid, px.
    pub px: [f64; 2],
    /// Its standard deviation per axis, px.
    pub sigma_px: f64,
    /// Planetocentric, on the reference ellipsoid, deg.
    pub latitude_deg: f64,
    /// East, deg.
    pub longitude_deg: f64,
    /// Light, DN.
    pub flux_dn: f64,
    /// Light over its standard deviation.
    pub snr: f64,
    /// V, mean over the exposure, where the zero point is known.
    pub magnitude: Option<f64>,
    /// Its standard deviation from the image's noise and the zero point's; `None` where there is no noise.
    pub sigma_magnitude: Option<f64>,
    /// A pixel of it is saturated.
    pub saturated: bool,
}

/// What a frame holds.
#[derive(Debug, Clone, PartialEq)]
pub struct NightSide {
    /// Its pixels, row by row.
    pub mask: Vec<bool>,
    /// How many they are.
    pub watched_px: usize,
    /// A detection's light stands out by so many standard deviations of normal noise: of sums matched to the camera's spot,
    /// of 3 x 3 pixels of a screen.
    pub threshold_sigma: f64,
    /// Typical level, DN.
    pub background_dn: f64,
    /// Typical noise of a pixel, DN.
    pub noise_dn: f64,
    /// What was found, the brightest first.
    pub candidates: Vec<Candidate>,
}

/// Looks for points of light on the night side of a body of known place.
pub fn detect_flashes(
    image: &CameraImage,
    camera: &LimbCamera,
    pose: &BodyPose,
    light: &Light,
    options: &FlashOptions,
) -> NightSide {
    let margins = Margins {
        limb_px: options.limb_margin_px,
        relief_m: options.relief * pose.semi_axes_m.min_element(),
        terminator_px: options.terminator_margin_px,
    };
    let mask = night_mask(camera, pose, &margins);
    let area = SearchArea::of(&mask, image.width_px as usize);
    let (watched_px, stated) = (area.pixels, options.false_alarms_per_frame);
    let (screen, spot_sigma_px) = match light.spot {
        Spot::Pixels => (true, SCREEN_SPOT_SIGMA_PX),
        Spot::Gaussian(sigma_px) => (false, sigma_px),
    };
    let threshold_sigma = if screen {
        threshold_sigma(watched_px, stated)
    } else {
        area.matched_threshold_sigma(stated, spot_sigma_px)
    };
    let mut night = NightSide {
        mask,
        watched_px,
        threshold_sigma,
        background_dn: 0.0,
        noise_dn: 0.0,
        candidates: Vec::new(),
    };
    if watched_px == 0 {
        return night;
    }
    let detect = DetectOptions {
        threshold_sigma,
        gain_e_per_dn: light.gain_e_per_dn,
        spot_sigma_px: Some(spot_sigma_px),
        centroid: if screen { Centroid::Moments } else { Centroid::Windowed },
        mesh_px: options.mesh_px,
        single_pixels: screen,
        ..DetectOptions::default()
    };
    let size_px = DVec2::new(f64::from(image.width_px), f64::from(image.height_px));
    let zero_sigma = light.zero_point.map_or(0.0, |zero| zero.sigma_magnitude);
    let found = if screen {
        detect_points_in(image, &night.mask, &detect)
    } else {
        detect_matched_in(image, &night.mask, &detect)
    };
    [night.background_dn, night.noise_dn] = [found.background_dn, found.noise_dn];
    night.candidates = found
        .points
        .iter()
        .filter_map(|point| {
            let px = DVec2::new(point.x_px, point.y_px);
            let sight = camera.line_of_sight(px)?;
            let place = pose.meet(sight)?.place_body_m;
            // A screen's pixel off the axis subtends less sky, and so sends less light.
            let share = if screen { (1.0 + sight.length_squared()).powf(-1.5) } else { 1.0 };
            let light_dn = point.flux_dn * share;
            let noisy = !screen && point.snr.is_finite() && point.snr > 0.0;
            Some(Candidate {
                px: px.to_array(),
                sigma_px: if screen { 0.0 } else { point.sigma_px },
                latitude_deg: (place.z / place.length()).asin().to_degrees(),
                longitude_deg: place.y.atan2(place.x).to_degrees(),
                flux_dn: light_dn,
                snr: point.snr,
                magnitude: light
                    .zero_point
                    .filter(|_| light_dn > 0.0)
                    .map(|zero| zero.at(px, size_px) - 2.5 * light_dn.log10()),
                sigma_magnitude: noisy.then(|| (2.5 / std::f64::consts::LN_10 / point.snr).hypot(zero_sigma)),
                saturated: point.saturated,
            })
        })
        .collect();
    night
}

/// A point on a screen is two or three adjacent pixels: half of this window's reach parts it from its neighbours.
const SCREEN_SPOT_SIGMA_PX: f64 = 0.6;
