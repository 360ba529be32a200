//! A pose's points, from positions, from an ideal camera or from the bench.

use glam::DVec2;
use rand_chacha::ChaCha8Rng;
use retina_bench::{Bench, BenchError, Exposure, OpticsDetail, ScreenImage};
use retina_campaign::{Facility, camera_image, saturation_dn};
use retina_formats::{TableKind, measured_or_power_law};
use retina_image::{DetectOptions, detect_points};
use retina_radiometry::irradiance_of_magnitude_w_m2_nm;
use retina_screen::PointPainter;

use super::scenario::{Images, Scenario};
use retina_navigation::stars::{StarCamera, StarPoint};
use retina_navigation::synthetic::Source;
use retina_navigation::synthetic::measured;

/// Takes the images of a scenario.
pub struct Photographer {
    scenario: Scenario,
    camera: StarCamera,
    bench: Option<(Facility, Bench, PointPainter)>,
    exposure_s: f64,
}

impl Photographer {
    /// Prepares camera and bench.
    ///
    /// # Errors
    /// The bench cannot be built.
    pub fn new(scenario: &Scenario) -> Result<Self, BenchError> {
        let setup = &scenario.setup;
        let camera = StarCamera::from_setup(setup, None);
        let mut exposure_s = 0.0;
        let bench = match scenario.images {
            Images::Points => None,
            Images::Ideal | Images::Bench => {
                // Nothing is wrong with it but what the setup itself says, the camera's jitter for one.
                let facility = Facility::new(setup, &[], TableKind::Points, f64::MAX, scenario.seed)?;
                let bench = facility.bench(OpticsDetail::default())?;
                let response = scenario.calibration.as_ref().map_or_else(
                    || measured_or_power_law(None, setup),
                    |calibration| calibration.screen_response(setup),
                );
                let distortion = scenario.calibration.as_ref().map(|c| c.distortion.clone());
                let inverse = scenario.calibration.as_ref().and_then(|c| c.inverse.clone());
                let painter =
                    PointPainter::new(setup.facility_pinhole(), distortion, response).with_inverse(inverse);
                // Share of a Gaussian spot's light in its brightest pixel.
                let share = 1.0 / (std::f64::consts::TAU * scenario.points.spot_sigma_px.powi(2));
                exposure_s = 0.6 * bench.sensor().full_well_e()
                    / (bench.star_e_s(scenario.exposure.full_magnitude) * share);
                Some((facility, bench, painter))
            }
        };
        Ok(Self { scenario: scenario.clone(), camera, bench, exposure_s })
    }

    /// The camera of the images.
    pub fn camera(&self) -> &StarCamera {
        &self.camera
    }

    /// Exposure time, s; zero where there are no pixels.
    pub fn exposure_s(&self) -> f64 {
        self.exposure_s
    }

    /// The points of sources, brightest first. `frame` numbers the exposure's noise.
    ///
    /// # Errors
    /// The bench refuses the screen image.
    pub fn points(
        &self,
        sources: &[Source],
        frame: u64,
        random: &mut ChaCha8Rng,
    ) -> Result<Vec<StarPoint>, BenchError> {
        let Some((facility, bench, painter)) = &self.bench else {
            let found = measured(sources, &self.camera.pinhole, &self.scenario.points, random);
            return Ok(found.into_iter().map(|(point, _)| point).collect());
        };
        let mut exposure = Exposure::new(self.exposure_s, frame);
        let photograph = match self.scenario.images {
            Images::Bench => {
                let focal_px = self.camera.pinhole.fx_px;
                exposure.pose = facility.dynamics.pose(
                    focal_px,
                    facility.wrong.camera_roll_rad,
                    0.0,
                    exposure.temperature_c,
                    facility.seed,
                    frame,
                );
                bench.expose(&screen(painter, sources, bench), &exposure)?
            }
            _ => bench.read(&self.light_e(sources, bench), &exposure),
        };
        let image = camera_image(bench, photograph);
        let options = DetectOptions {
            saturation_dn: Some(saturation_dn(bench)),
            gain_e_per_dn: Some(bench.sensor().gain_e_per_dn),
            ..DetectOptions::default()
        };
        Ok(self.camera.points(&detect_points(&image, &options).points))
    }

    /// Mean electrons of an image with Gaussian spots.
    fn light_e(&self, sources: &[Source], bench: &Bench) -> Vec<f32> {
        let camera = &self.camera.pinhole;
        let (width, height) = (camera.width_px as usize, camera.height_px as usize);
        let mut light = vec![0f32; width * height];
        let sigma = self.scenario.points.spot_sigma_px;
        let scale = 1.0 / (std::f64::consts::TAU * sigma * sigma);
        for source in sources {
            let at = camera.pixel(source.line_of_sight);
            // A star off the axis sees the pupil foreshortened.
            let foreshortened = 1.0 / (1.0 + source.line_of_sight.length_squared()).sqrt();
            let electrons = bench.star_e_s(source.magnitude) * self.exposure_s * foreshortened;
            // Where the flank is below a hundredth of an electron nothing is lost.
            let reach = sigma * (2.0 * (electrons * scale * 100.0).max(1.0).ln()).sqrt() + 1.0;
            let span = |v: f64, size: usize| {
                ((v - reach).max(0.0) as usize)..((v + reach).ceil().max(0.0) as usize).min(size)
            };
            for row in span(at.y, height) {
                for column in span(at.x, width) {
                    let off = DVec2::new(column as f64 + 0.5, row as f64 + 0.5) - at;
                    let share = scale * (-0.5 * off.length_squared() / (sigma * sigma)).exp();
                    light[row * width + column] += (electrons * share) as f32;
                }
            }
        }
        light
    }
}

/// The sources on the compensated screen, each where its own irradiance wants it; those fainter than the screen's
/// faintest count are dark.
fn screen(painter: &PointPainter, sources: &[Source], bench: &Bench) -> ScreenImage {
    let screen = &bench.setup().screen;
    let mut counts = vec![0u8; (screen.width_px * screen.height_px) as usize];
    for source in sources {
        let irradiance = irradiance_of_magnitude_w_m2_nm(source.magnitude);
        if let Some(at) = painter.screen_px(source.line_of_sight, irradiance)
            && painter.contains(at)
        {
            painter.draw(&mut counts, at, irradiance);
        }
    }
    ScreenImage::grey(screen.width_px, screen.height_px, &counts)
}
