//! A facility with effects: each is set where it acts.

use std::path::Path;

use glam::DVec2;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use retina_bench::{Bench, BenchError, BenchOptions, Display, ExposurePose, Imperfections, OpticsDetail};
use retina_files::InputError;
use retina_geometry::Setup;

use crate::effects::{Effect, Table};

/// How the bench's temperature runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TemperatureProfile {
    /// 20 degC throughout.
    Constant,
    /// From 20 degC towards 24, time constant an hour.
    #[default]
    WarmUp,
    /// 20 degC and 2 K up and down with a period of 90 minutes.
    Cycle,
}

impl TemperatureProfile {
    /// Temperature at a time, degC.
    pub fn at_c(self, time_s: f64) -> f64 {
        match self {
            Self::Constant => 20.0,
            Self::WarmUp => 20.0 + 4.0 * (1.0 - (-time_s / 3600.0).exp()),
            Self::Cycle => 20.0 + 2.0 * (std::f64::consts::TAU * time_s / 5400.0).sin(),
        }
    }
}

/// What changes from exposure to exposure.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Dynamics {
    /// Turn of the camera's mount for a kelvin above 20 degC, rad.
    pub boresight_per_k: [f64; 2],
    /// Relative change of the focal length for a kelvin.
    pub focal_per_k: f64,
    /// Turn of the boresight in a second, rad.
    pub drift_per_s: [f64; 2],
    /// Roll in a second, rad.
    pub roll_per_s: f64,
    /// A step of the boresight at `knock_at_s`, rad.
    pub knock: [f64; 2],
    /// When.
    pub knock_at_s: f64,
    /// Standard deviation of the boresight from exposure to exposure, rad an axis.
    pub jitter: f64,
    /// Constant shift of the image, camera px.
    pub shift_px: [f64; 2],
    /// Relative change of the focal length.
    pub scale: f64,
}

impl Dynamics {
    /// The pose of an exposure; jitter depends on `seed` and its number alone.
    pub fn pose(
        &self,
        focal_px: f64,
        time_s: f64,
        temperature_c: f64,
        seed: u64,
        frame: u64,
    ) -> ExposurePose {
        let mut random = ChaCha8Rng::seed_from_u64(seed ^ 0x6a69_7474_6572);
        random.set_stream(frame);
        let kelvin = temperature_c - 20.0;
        let shift = [0, 1].map(|k| {
            let jitter: f64 = StandardNormal.sample(&mut random);
            let knocked = if time_s >= self.knock_at_s { self.knock[k] } else { 0.0 };
            let turn = self.boresight_per_k[k] * kelvin
                + self.drift_per_s[k] * time_s
                + knocked
                + self.jitter * jitter;
            focal_px * turn + self.shift_px[k]
        });
        ExposurePose {
            shift_px: DVec2::from_array(shift),
            roll_rad: self.roll_per_s * time_s,
            scale: 1.0 + self.focal_per_k * kelvin + self.scale,
        }
    }
}

/// A setup with effects.
#[derive(Debug, Clone)]
pub struct Facility {
    /// The setup, its optics and noise as the effects leave them.
    pub setup: Setup,
    /// What is wrong with the bench.
    pub wrong: Imperfections,
    /// What changes in time.
    pub dynamics: Dynamics,
    /// The display.
    pub display: Display,
    /// Seed of patterns and noise.
    pub seed: u64,
    /// The effects.
    pub effects: Vec<Effect>,
}

impl Facility {
    /// A facility with these effects; a campaign of `length_s` knocks half way through.
    ///
    /// # Errors
    /// An effect that does not show in `table`, or a size out of its range.
    pub fn new(
        setup: &Setup,
        effects: &[Effect],
        table: Table,
        length_s: f64,
        seed: u64,
    ) -> Result<Self, InputError> {
        let mut facility = Self {
            setup: setup.clone(),
            wrong: Imperfections::default(),
            dynamics: Dynamics {
                jitter: (setup.noise.jitter_arcsec / 3600.0).to_radians(),
                knock_at_s: length_s / 2.0,
                ..Dynamics::default()
            },
            display: Display::new(setup, seed),
            seed,
            effects: effects.to_vec(),
        };
        for effect in effects {
            let shows = match table {
                Table::Power => effect.kind.table == Table::Power,
                Table::Points => effect.kind.table == Table::Points,
                Table::Frames => effect.kind.table != Table::Power,
            };
            if !shows {
                return Err(InputError::new(
                    Path::new("--effect"),
                    "the effect does not show in this campaign",
                )
                .found(format!("`{}`", effect.text))
                .help(format!("it shows in {:?} campaigns", effect.kind.table).to_lowercase()));
            }
            facility.apply(effect);
        }
        Ok(facility)
    }

    fn apply(&mut self, effect: &Effect) {
        // tan at half the camera's width: u = 1 of the catalogue.
        let camera = &self.setup.camera;
        let u = f64::from(camera.width_px) * camera.pixel_um * 1e-3 / 2.0 / camera.focal_mm;
        let (value, pair) = (effect.value(), effect.pair());
        let (wrong, dynamics) = (&mut self.wrong, &mut self.dynamics);
        match effect.kind.id {
            "screen_tilt" => wrong.screen.tilt_rad = pair,
            "camera_pointing" => wrong.pointing_rad = pair,
            // (p1 3 u^2, p2 u^2) at (u, 0).
            "decentering" => wrong.objective.decentring = [pair[0] / (3.0 * u * u), pair[1] / (u * u)],
            "optical_centre" => {
                wrong.screen.shift_mm = [0, 1].map(|k| pair[k] * self.display.pitch_mm[k]);
            }
            "thin_prism" => wrong.objective.prism = pair.map(|v| v / (u * u)),
            "radial_higher_order" => wrong.objective.radial_r4 = value / u.powi(5),
            "screen_bow" => {
                let edge = self.setup.screen.height_mm / 2.0 * f64::from(camera.width_px)
                    / f64::from(camera.height_px);
                wrong.screen.bow_per_mm = pair.map(|v| v / (edge * edge));
            }
            "flux_coma" => wrong.objective.coma_mm = value / u,
            "flux_shift" => wrong.objective.coma_offset_mm = pair,
            "background_gradient" => {
                wrong.stray_e_s = [pair[0].abs() + pair[1].abs(), pair[0], pair[1]];
            }
            "lateral_colour" => wrong.objective.lateral_colour = value / u,
            "colour_wedge" => wrong.objective.wedge_rad = pair,
            "subpixel_offset" => self.display.stripe_px = [-value, 0.0, value],
            "thermal_boresight" => dynamics.boresight_per_k = pair,
            "thermal_focal" => dynamics.focal_per_k = value,
            "drift" => dynamics.drift_per_s = pair.map(|v| v / 3600.0),
            "roll_drift" => dynamics.roll_per_s = value / u / 3600.0,
            "knock" => dynamics.knock = pair,
            "camera_pixel_phase" => wrong.pixel_fill = value,
            "row_loading_shift" => self.display.row_loading_px = value,
            "defocus" => wrong.screen.focus_mm = value,
            "veiling_glare" => self.setup.optics.veiling_glare = value,
            "ghost" => self.setup.optics.coating_reflectance = value,
            "dark_offset" => self.setup.noise.offset_dn += value,
            "detector_nonlinearity" => wrong.nonlinearity = value,
            "saturation" => self.setup.noise.full_well_e = value,
            "prnu" => self.setup.noise.prnu = value,
            "mura" => self.display.mura = value,
            "image_shift" => dynamics.shift_px = pair,
            "roll" => wrong.camera_roll_rad = value,
            "scale" => dynamics.scale = value,
            "vignetting" => wrong.clear_fraction = value,
            // Effects of power readings act in `simulate_power`.
            _ => {}
        }
    }

    /// The bench of this facility.
    ///
    /// # Errors
    /// As [`Bench::new`].
    pub fn bench(&self, detail: OpticsDetail) -> Result<Bench, BenchError> {
        let options = BenchOptions { wrong: self.wrong, seed: self.seed, detail };
        Bench::with_display(&self.setup, self.display.clone(), &options)
    }

    /// The first value of an effect, if it is on.
    pub fn effect(&self, id: &str) -> Option<&Effect> {
        self.effects.iter().find(|effect| effect.kind.id == id)
    }
}
