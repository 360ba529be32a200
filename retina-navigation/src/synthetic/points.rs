//! Points as a camera would measure them, without its pixels: positions with noise, the faint ones lost.

use glam::DVec2;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::Rng;
use rand_distr::{Distribution as _, StandardNormal};
use retina_geometry::Pinhole;
use serde::{Deserialize, Serialize};

use super::sky::Source;
use crate::stars::StarPoint;

/// How a camera measures points.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PointNoise {
    /// Magnitude whose signal-to-noise ratio is 5: half of such stars are found.
    pub limiting_magnitude: f64,
    /// Standard deviation of a spot, px.
    pub spot_sigma_px: f64,
    /// Centroid error per axis that does not depend on the light, px: facility, calibration, optics.
    pub systematic_px: f64,
    /// Points that are no stars, on average in an image: spikes and ghosts.
    pub false_points: f64,
    /// Brighter stars are saturated.
    pub saturation_magnitude: f64,
}

impl Default for PointNoise {
    /// The wide configuration: 10 arcsec in 96 % of cases (paper, Fig. 11) is 0.14 px of 28.5 arcsec per axis.
    fn default() -> Self {
        Self {
            limiting_magnitude: 6.5,
            spot_sigma_px: 0.9,
            systematic_px: 0.14,
            false_points: 2.0,
            saturation_magnitude: 1.0,
        }
    }
}

/// Electrons of a star at the limiting magnitude; the background's variance makes its signal-to-noise ratio 5.
const LIMIT_E: f64 = 100.0;
/// Signal-to-noise ratio from which a point is found.
const FOUND_SNR: f64 = 5.0;
/// Sources closer than this many standard deviations of a spot are measured as one.
const MERGED_SIGMAS: f64 = 3.0;

/// Measures sources (brightest first): the points, brightest first, and for each its source (`None`: false).
pub fn measured(
    sources: &[Source],
    camera: &Pinhole,
    noise: &PointNoise,
    random: &mut ChaCha8Rng,
) -> Vec<(StarPoint, Option<usize>)> {
    let normal = |random: &mut ChaCha8Rng| -> f64 { StandardNormal.sample(random) };
    let background_e2 = (LIMIT_E / FOUND_SNR).powi(2) - LIMIT_E;
    let mut spots: Vec<(DVec2, f64, Option<usize>, bool)> = Vec::new();
    for (at, source) in sources.iter().enumerate() {
        let light_e = LIMIT_E * 10f64.powf(0.4 * (noise.limiting_magnitude - source.magnitude));
        let pixel = camera.pixel(source.line_of_sight);
        let reach = MERGED_SIGMAS * noise.spot_sigma_px;
        // A fainter source beside one is swallowed: its light moves the brighter one's centroid.
        if let Some(spot) = spots.iter_mut().find(|spot| spot.0.distance(pixel) < reach) {
            let share = light_e / (spot.1 + light_e);
            spot.0 = spot.0.lerp(pixel, share);
            spot.1 += light_e;
        } else {
            spots.push((pixel, light_e, Some(at), source.magnitude < noise.saturation_magnitude));
        }
    }
    let false_count = {
        // Poisson by inversion.
        let (mut count, mut left) = (0, uniform(random));
        let mut term = (-noise.false_points).exp();
        while left > term && count < 1000 {
            left -= term;
            count += 1;
            term *= noise.false_points / f64::from(count);
        }
        count
    };
    for _ in 0..false_count {
        let pixel = DVec2::new(
            uniform(random) * f64::from(camera.width_px),
            uniform(random) * f64::from(camera.height_px),
        );
        // As many a magnitude brighter: a power law of slope -1 in light.
        spots.push((pixel, 1.2 * LIMIT_E / uniform(random).max(1e-3), None, false));
    }
    let mut points = Vec::new();
    for (pixel, light_e, source, saturated) in spots {
        let snr = light_e / (light_e + background_e2).sqrt();
        if snr + normal(random) < FOUND_SNR {
            continue;
        }
        let sigma_px = noise.spot_sigma_px / snr;
        let total_px = sigma_px.hypot(noise.systematic_px);
        let seen = pixel + DVec2::new(normal(random), normal(random)) * total_px;
        let flux = (light_e * (1.0 + normal(random) / snr)).max(1.0);
        points.push((
            StarPoint {
                pixel: seen,
                line_of_sight: camera.line_of_sight(seen),
                sigma_rad: sigma_px / camera.fx_px,
                flux,
                saturated,
                on_edge: false,
            },
            source,
        ));
    }
    points.sort_by(|a, b| b.0.flux.total_cmp(&a.0.flux));
    points
}

/// Uniform in 0 <= x < 1: 53 random bits.
pub fn uniform(random: &mut ChaCha8Rng) -> f64 {
    (random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
}
