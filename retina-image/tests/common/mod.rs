//! An imager for tests, independent of the crate: spots integrated over pixels, shot and read noise, whole numbers.
#![allow(dead_code, reason = "each test file uses a part of it")]

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use retina_image::CameraImage;

/// Pixel noise and offsets of the test camera.
pub(crate) struct Imager {
    /// Standard deviation of the read noise, DN.
    pub(crate) read_noise_dn: f64,
    /// Electrons per DN; 0: no shot noise.
    pub(crate) gain_e_per_dn: f64,
    /// Level and slopes per pixel along x and y, DN.
    pub(crate) ground_dn: [f64; 3],
}

pub(crate) fn random(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

/// A standard normal number (Box and Muller).
pub(crate) fn normal(random: &mut ChaCha8Rng) -> f64 {
    let u: f64 = 1.0 - random.random::<f64>();
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * random.random::<f64>()).cos()
}

/// Share of a Gaussian spot's light in a pixel, by the midpoints of 5 x 5 parts; `offset` = pixel centre - spot.
pub(crate) fn pixel_share(offset: [f64; 2], sigma: f64) -> f64 {
    let axis = |d: f64| {
        (0..5).map(|i| (-0.5 * ((d + (f64::from(i) - 2.0) / 5.0) / sigma).powi(2)).exp()).sum::<f64>() / 5.0
    };
    axis(offset[0]) * axis(offset[1]) / (std::f64::consts::TAU * sigma * sigma)
}

/// Adds a spot of some light to a plane of expected DN.
pub(crate) fn add_spot(plane: &mut [f64], width: usize, at: [f64; 2], flux_dn: f64, sigma: f64) {
    let height = plane.len() / width;
    let reach = 6.0 * sigma + 2.0;
    let span = |c: f64, size: usize| (c - reach).max(0.0) as usize..((c + reach).max(0.0) as usize).min(size);
    for y in span(at[1], height) {
        for x in span(at[0], width) {
            plane[y * width + x] +=
                flux_dn * pixel_share([x as f64 + 0.5 - at[0], y as f64 + 0.5 - at[1]], sigma);
        }
    }
}

impl Imager {
    /// The camera's image of a plane of expected light, DN.
    pub(crate) fn expose(&self, plane: &[f64], width: usize, random: &mut ChaCha8Rng) -> CameraImage {
        let mut image = CameraImage::new(width as u32, (plane.len() / width) as u32, 4095.0);
        for (at, (value, light)) in image.values.iter_mut().zip(plane).enumerate() {
            let (x, y) = ((at % width) as f64, (at / width) as f64);
            let shot = if self.gain_e_per_dn > 0.0 { light.max(0.0) / self.gain_e_per_dn } else { 0.0 };
            let sigma = (self.read_noise_dn.powi(2) + shot).sqrt();
            let [level, right, down] = self.ground_dn;
            let expected = light + level + right * x + down * y;
            *value = (expected + sigma * normal(random)).round().clamp(0.0, 4095.0) as f32;
        }
        image
    }
}
