//! Discs drawn by the area that they cover.

use glam::{DVec2, DVec3};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};
use retina_geometry::LimbEllipse;
use retina_image::CameraImage;

/// How many draws a test of chance takes: this many, or as many as `RETINA_SEEDS` says.
pub(crate) fn draws(usual: u64) -> u64 {
    std::env::var("RETINA_SEEDS").map_or(usual, |text| text.parse().unwrap())
}

/// How a disc is drawn.
#[derive(Clone, Copy)]
pub(crate) struct Disc {
    /// The limb.
    pub(crate) limb: LimbEllipse,
    /// Phase angle, rad: the terminator is the half ellipse at -cos(phase) of the limb.
    pub(crate) phase_rad: f64,
    /// Towards the Sun, rad from +x towards +y, in the space where the limb is a circle.
    pub(crate) sun_rad: f64,
    pub(crate) light_dn: f64,
    /// Standard deviation of the PSF, px.
    pub(crate) psf_px: f64,
    /// Brightness times (1 + shading (depth inside the limb in radii)^(1/2)).
    pub(crate) shading: f64,
    /// Brightness times the cosine of the Sun's angle of incidence.
    pub(crate) lambert: bool,
}

impl Disc {
    fn brightness(&self, at: DVec2) -> f64 {
        let local = DVec2::from_angle(-self.limb.angle_rad).rotate(at - self.limb.center_px)
            / DVec2::from_array(self.limb.semi_axes_px);
        let q = DVec2::from_angle(-self.sun_rad).rotate(local);
        let lit = q.length_squared() < 1.0 && q.x > -self.phase_rad.cos() * (1.0 - q.y * q.y).sqrt();
        let towards_us = (1.0 - q.length_squared()).max(0.0).sqrt();
        let cos_sun = q.x * self.phase_rad.sin() + towards_us * self.phase_rad.cos();
        let law = if self.lambert { cos_sun } else { 1.0 };
        if lit { law * (1.0 + self.shading * (1.0 - q.length()).sqrt()) } else { 0.0 }
    }

    /// Mean brightness over each pixel, then the PSF.
    pub(crate) fn draw(&self, size: [u32; 2]) -> CameraImage {
        const PARTS: usize = 24;
        let mut image = CameraImage::new(size[0], size[1], 4095.0);
        let (width, height) = (size[0] as usize, size[1] as usize);
        for row in 0..height {
            for column in 0..width {
                let corner = DVec2::new(column as f64, row as f64);
                let corners = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)]
                    .map(|(x, y)| self.brightness(corner + DVec2::new(x, y)) > 0.0);
                let middle = self.brightness(corner + 0.5);
                let mixed = corners.iter().any(|&lit| lit != (middle > 0.0));
                let mean = if mixed {
                    let mut sum = 0.0;
                    for i in 0..PARTS * PARTS {
                        let part = DVec2::new((i % PARTS) as f64 + 0.5, (i / PARTS) as f64 + 0.5);
                        sum += self.brightness(corner + part / PARTS as f64);
                    }
                    sum / (PARTS * PARTS) as f64
                } else {
                    middle
                };
                image.values[row * width + column] = (self.light_dn * mean) as f32;
            }
        }
        if self.psf_px > 0.0 {
            blur(&mut image, self.psf_px);
        }
        image
    }
}

/// A Gaussian, along rows and along columns.
fn blur(image: &mut CameraImage, sigma_px: f64) {
    let reach = (5.0 * sigma_px).ceil() as i64;
    let raw: Vec<f64> = (-reach..=reach).map(|k| (-0.5 * (k as f64 / sigma_px).powi(2)).exp()).collect();
    let sum: f64 = raw.iter().sum();
    let (width, height) = (image.width_px as i64, image.height_px as i64);
    for (dx, dy) in [(1, 0), (0, 1)] {
        let from = image.values.clone();
        for y in 0..height {
            for x in 0..width {
                let mut value = 0.0;
                for (k, weight) in (-reach..=reach).zip(&raw) {
                    let (sx, sy) = ((x + dx * k).clamp(0, width - 1), (y + dy * k).clamp(0, height - 1));
                    value += weight / sum * f64::from(from[(sy * width + sx) as usize]);
                }
                image.values[(y * width + x) as usize] = value as f32;
            }
        }
    }
}

/// Offset 60 DN, read noise, shot noise at 4 electrons a DN, rounding, saturation.
pub(crate) fn add_noise(image: &mut CameraImage, read_dn: f64, random: &mut ChaCha8Rng) {
    for value in &mut image.values {
        let draw: f64 = StandardNormal.sample(random);
        let light = f64::from(*value);
        let noise = (read_dn * read_dn + light / 4.0).sqrt() * draw;
        *value = (60.0 + light + noise).round().clamp(0.0, f64::from(image.full_scale_dn)) as f32;
    }
}

/// Mahalanobis distance squared.
pub(crate) fn distance_squared(covariance: glam::DMat3, error: DVec3) -> f64 {
    error.dot(covariance.inverse() * error)
}
