//! Campaigns with a hidden effect, made by forms that are not the catalogue's: lines of sight are moved by the physics
//! (a homography, a lens law, a lagged temperature), then noise, common shifts and outliers are put on.

#![allow(dead_code, reason = "each file of tests uses a part")]
#![allow(clippy::unwrap_used, reason = "a helper of tests alone")]

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use glam::DVec2;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};
use retina_diagnosis::{Baseline, Dataset, Source};
use retina_formats::Measurements;
use retina_geometry::Setup;

pub(crate) const ARCSEC: f64 = 1.0 / 206_264.806;

/// What an effect sees of a point.
pub(crate) struct Point {
    /// Line of sight, distorted.
    pub(crate) r: DVec2,
    pub(crate) camera_px: DVec2,
    pub(crate) screen_px: DVec2,
    /// Irradiance relative to full.
    pub(crate) f: f64,
    pub(crate) time_s: f64,
    pub(crate) temperature_c: f64,
    pub(crate) row_load: f64,
    /// 0, 1, 2, 3: r, g, b, w.
    pub(crate) channel: usize,
    pub(crate) count: f64,
    pub(crate) exposure: usize,
}

#[derive(Clone, Copy)]
pub(crate) struct Campaign {
    pub(crate) rows: usize,
    pub(crate) exposures: usize,
    pub(crate) noise_arcsec: f64,
    pub(crate) jitter_arcsec: f64,
    /// Noise grows by this much of itself to the middle of the left and right edge, with the square of the distance.
    pub(crate) edge: f64,
    pub(crate) outliers: f64,
    pub(crate) colours: bool,
    pub(crate) seed: u64,
}

impl Campaign {
    pub(crate) fn new(seed: u64) -> Self {
        Self {
            rows: 2000,
            exposures: 40,
            noise_arcsec: 1.5,
            jitter_arcsec: 0.45,
            edge: 0.0,
            outliers: 0.02,
            colours: false,
            seed,
        }
    }

    /// The campaign's table; `effect` gives the line of sight with the effect in.
    pub(crate) fn table(&self, setup: &Setup, effect: &dyn Fn(&Point) -> DVec2) -> String {
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        let (facility, camera) = (setup.facility_pinhole(), setup.camera_pinhole());
        let mut text = String::from(
            "image,screen_x_px,screen_y_px,digital_count,camera_x_px,camera_y_px,channel,time_s,temperature_c,row_load\n",
        );
        let normal = |random: &mut ChaCha8Rng| -> f64 { StandardNormal.sample(random) };
        let per = self.rows / self.exposures;
        let (mut temperature, mut chamber_phase) = (20.0, 0.0f64);
        for exposure in 0..self.exposures {
            let time_s = 90.0 * exposure as f64;
            chamber_phase += std::f64::consts::TAU / 17.0;
            temperature +=
                0.2 * (20.0 + 2.0 * chamber_phase.sin() - temperature) + 0.05 * normal(&mut random);
            let jitter = DVec2::new(normal(&mut random), normal(&mut random)) * self.jitter_arcsec;
            for _ in 0..per {
                let at = DVec2::new(
                    random.random_range(20.0..f64::from(camera.width_px) - 20.0),
                    random.random_range(20.0..f64::from(camera.height_px) - 20.0),
                );
                let u = camera.line_of_sight(at);
                let screen_px = facility.pixel(u);
                let count = [18.0, 32.0, 60.0, 110.0, 180.0, 255.0][random.random_range(0..6usize)];
                // A turned and shifted camera before a lens with k1 = 0.35.
                let turned = DVec2::from_angle(0.01).rotate(u * (1.0 + 0.35 * u.length_squared()));
                let r = turned * 1.002 + DVec2::new(3e-4, -2e-4);
                let channel = if self.colours { random.random_range(0..3usize) } else { 3 };
                let point = Point {
                    r,
                    camera_px: camera.pixel(r),
                    screen_px,
                    f: (count / 255.0f64).powf(2.2),
                    time_s,
                    temperature_c: temperature,
                    row_load: random.random_range(0.0..1.0),
                    channel,
                    count,
                    exposure,
                };
                let mut seen = effect(&point);
                let faint = 1.0 + 0.3 * (255.0 / count - 1.0).min(8.0) / 8.0;
                let half_width = 0.5 * f64::from(camera.width_px) / camera.fx_px;
                let outwards = 1.0 + self.edge * (u / half_width).length_squared();
                let mut off = DVec2::new(normal(&mut random), normal(&mut random))
                    * (self.noise_arcsec * faint * outwards);
                if random.random_range(0.0..1.0) < self.outliers {
                    off += DVec2::from_angle(random.random_range(0.0..std::f64::consts::TAU))
                        * random.random_range(15.0..200.0);
                }
                seen += (off + jitter) * ARCSEC;
                let px = camera.pixel(seen);
                let _ = writeln!(
                    text,
                    "e{exposure:03},{:.5},{:.5},{count},{:.6},{:.6},{},{time_s},{temperature:.4},{:.4}",
                    screen_px.x,
                    screen_px.y,
                    px.x,
                    px.y,
                    ["r", "g", "b", "w"][channel],
                    point.row_load
                );
            }
        }
        text
    }

    pub(crate) fn data(&self, setup: &Setup, effect: &dyn Fn(&Point) -> DVec2) -> Dataset {
        dataset(setup, &self.table(setup, effect))
    }
}

pub(crate) fn setup() -> Setup {
    Setup::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/setups/wide-fov.toml")).unwrap()
}

pub(crate) fn dataset(setup: &Setup, text: &str) -> Dataset {
    let folder = tempfile::tempdir().unwrap();
    let path: PathBuf = folder.path().join("table.csv");
    std::fs::write(&path, text).unwrap();
    let tables = Measurements::read(&[path]).unwrap();
    let source =
        Source { tables: &tables, setup, calibration: None, response: None, baseline: Baseline::Physical };
    Dataset::new(&source).unwrap()
}
