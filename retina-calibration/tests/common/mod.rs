//! A facility for tests, written apart from the crate: Brown's distortion about a centre of its own, coma that grows with
//! the light, noise that falls with it, exposures that jitter, and wrong matches.
#![allow(dead_code, reason = "each test file uses a part of it")]

pub(crate) mod response;

use std::path::Path;

use glam::DVec2;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use retina_formats::{PointRow, PointsTable};
use retina_geometry::Setup;

pub(crate) const ARCSEC: f64 = std::f64::consts::PI / 648_000.0;

pub(crate) fn wide() -> Setup {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/setups");
    Setup::read(&folder.join("wide-fov.toml")).unwrap()
}

pub(crate) struct Facility {
    pub(crate) k1: f64,
    /// Centre of the distortion, tangent plane of r_u.
    pub(crate) centre: DVec2,
    /// Outward walk of the brightest at r = 0.1, arcsec; quadratic in log10 of the light.
    pub(crate) coma_arcsec: f64,
    pub(crate) jitter_arcsec: f64,
    /// Noise per axis: bright limit and that at log10 irradiance -3, camera px.
    pub(crate) noise_px: [f64; 2],
    pub(crate) outliers: f64,
}

pub(crate) const LIKELY: Facility = Facility {
    k1: 0.35,
    centre: DVec2::new(1.5e-3, -1.0e-3),
    coma_arcsec: 12.0,
    jitter_arcsec: 0.8,
    noise_px: [0.03, 0.15],
    outliers: 0.03,
};

/// One without distortion: every polynomial form holds it exactly.
pub(crate) const SIMILARITY: Facility =
    Facility { k1: 0.0, coma_arcsec: 0.0, outliers: 0.0, centre: DVec2::ZERO, ..LIKELY };

pub(crate) fn normal(random: &mut ChaCha8Rng) -> f64 {
    let u: f64 = 1.0 - random.random::<f64>();
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * random.random::<f64>()).cos()
}

/// log10 of the contract's default response relative to full.
pub(crate) fn l_of(count: f64) -> f64 {
    2.2 * (count / 255.0).log10()
}

impl Facility {
    /// Where the camera receives what is shown at r_u.
    pub(crate) fn sight(&self, undistorted: DVec2, l: f64) -> DVec2 {
        let u = undistorted - self.centre;
        let r = self.centre + u * (1.0 + self.k1 * u.length_squared());
        let share = (1.0 + l / 3.3).clamp(0.0, 1.0);
        r + r * (self.coma_arcsec * ARCSEC / 0.1 * share * share)
    }

    pub(crate) fn noise_px(&self, l: f64) -> f64 {
        self.noise_px[0].hypot(self.noise_px[1] * 10f64.powf(0.5 * (-3.0 - l)))
    }

    pub(crate) fn table(
        &self,
        setup: &Setup,
        exposures: usize,
        per_exposure: usize,
        seed: u64,
    ) -> PointsTable {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let (facility, camera) = (setup.facility_pinhole(), setup.camera_pinhole());
        let (width, height) = (f64::from(camera.width_px), f64::from(camera.height_px));
        let mut table = PointsTable::default();
        let counts = [8.0, 11.0, 16.0, 23.0, 33.0, 47.0, 68.0, 98.0, 140.0, 195.0, 255.0];
        for image in 0..exposures {
            table.images.push(format!("{image:03}"));
            let jitter = DVec2::new(normal(&mut random), normal(&mut random)) * self.jitter_arcsec * ARCSEC;
            let mut taken = 0;
            while taken < per_exposure {
                let screen_px = DVec2::new(
                    (random.random::<f64>() * 1920.0).floor() + 0.5,
                    (random.random::<f64>() * 1200.0).floor() + 0.5,
                );
                let digital_count = counts[(random.random::<f64>() * 11.0) as usize];
                let l = l_of(digital_count);
                let seen = camera.pixel(self.sight(facility.line_of_sight(screen_px), l) + jitter);
                if !(seen.x > 0.0 && seen.x < width && seen.y > 0.0 && seen.y < height) {
                    continue;
                }
                taken += 1;
                let sigma = self.noise_px(l);
                let mut camera_px = seen + sigma * DVec2::new(normal(&mut random), normal(&mut random));
                if random.random::<f64>() < self.outliers {
                    camera_px = DVec2::new(random.random::<f64>() * width, random.random::<f64>() * height);
                }
                // Centroids are measured on the sensor.
                let camera_px = camera_px.clamp(DVec2::ZERO, DVec2::new(width, height));
                table.rows.push(PointRow {
                    line: table.rows.len() + 2,
                    ..PointRow::new(image, screen_px, digital_count, camera_px)
                });
            }
        }
        table
    }
}
