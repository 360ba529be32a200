//! A facility with effects: each is set where it acts.

use std::path::Path;

use glam::DVec2;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use retina_bench::{Bench, BenchError, BenchOptions, Display, ExposurePose, Imperfections, OpticsDetail};
use retina_files::InputError;
use retina_formats::{EffectId, FramesEffect, PointsEffect, PowerEffect, TableKind};
use retina_geometry::Setup;

use crate::effects::Effect;

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
    /// The pose of an exposure; jitter depends on `seed` and its number alone. The mount belongs to the facility: its turns
    /// have the facility's axes, whatever the camera's roll about the boresight.
    pub fn pose(
        &self,
        focal_px: f64,
        camera_roll_rad: f64,
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
            focal_px * turn
        });
        let turned = DVec2::from_angle(camera_roll_rad).rotate(DVec2::from_array(shift));
        ExposurePose {
            shift_px: turned + DVec2::from_array(self.shift_px),
            roll_rad: self.roll_per_s * time_s,
            scale: 1.0 + self.focal_per_k * kelvin + self.scale,
        }
    }
}

/// What is wrong with the display's light and with the meter that reads it. All 0 or absent by default.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LightErrors {
    /// Exponent of the display's response; the setup's where absent.
    pub gamma: Option<f64>,
    /// Light at count 0 over light at 255; the setup's where absent.
    pub black_level: Option<f64>,
    /// Share of the light that is lost where the whole screen is lit.
    pub square_loading: f64,
    /// Light that a lit neighbour lends, of a pixel's own.
    pub pixel_crosstalk: f64,
    /// Rise of the light until the display is warm (time constant 20 min).
    pub self_heating: f64,
    /// Loss of light in 1000 hours of full white.
    pub ageing_per_1000_h: f64,
    /// The meter's reading in the dark, W.
    pub meter_zero_w: f64,
    /// Error of the meter's responsivity at red, green, blue.
    pub meter_by_channel: [f64; 3],
    /// Excess of the meter's reading at the brightest reading.
    pub meter_nonlinearity: f64,
    /// Loss of white against red + green + blue.
    pub channel_nonadditivity: f64,
    /// Factor on the readings of the last series, whose attenuator was not changed.
    pub attenuator_of_last_series: Option<f64>,
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
    /// What is wrong with the display's light and the power meter.
    pub light: LightErrors,
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
        table: TableKind,
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
            light: LightErrors::default(),
            display: Display::new(setup, seed),
            seed,
            effects: effects.to_vec(),
        };
        for effect in effects {
            let of = effect.kind.id.table();
            let shows = of == table || (table == TableKind::Frames && of == TableKind::Points);
            if !shows {
                return Err(InputError::new(
                    Path::new("--effect"),
                    "the effect does not show in this campaign",
                )
                .found(format!("`{}`", effect.text))
                .help(format!("it shows in campaigns of {}", of.name())));
            }
            facility.apply(effect);
        }
        Ok(facility)
    }

    fn apply(&mut self, effect: &Effect) {
        match effect.kind.id {
            EffectId::Points(id) => self.apply_to_points(id, effect.value(), effect.pair()),
            EffectId::Power(id) => self.apply_to_power(id, effect),
            EffectId::Frames(id) => self.apply_to_frames(id, effect.value(), effect.pair()),
            // `EffectKind::of` has none for them.
            EffectId::Phase(_) => {}
        }
    }

    fn apply_to_points(&mut self, effect: PointsEffect, value: f64, pair: [f64; 2]) {
        use PointsEffect as E;
        // tan at half the camera's width: u = 1 of the catalogue.
        let camera = &self.setup.camera;
        let u = f64::from(camera.width_px) * camera.pixel_um * 1e-3 / 2.0 / camera.focal_mm;
        let (wrong, dynamics) = (&mut self.wrong, &mut self.dynamics);
        match effect {
            E::ScreenTilt => wrong.screen.tilt_rad = pair,
            E::CameraPointing => wrong.pointing_rad = pair,
            // (p1 3 u^2, p2 u^2) at (u, 0).
            E::Decentering => wrong.objective.decentring = [pair[0] / (3.0 * u * u), pair[1] / (u * u)],
            E::OpticalCentre => {
                wrong.screen.shift_mm = [0, 1].map(|k| pair[k] * self.display.pitch_mm[k]);
            }
            E::ThinPrism => wrong.objective.prism = pair.map(|v| v / (u * u)),
            E::RadialHigherOrder => wrong.objective.radial_r4 = value / u.powi(5),
            E::ScreenBow => {
                let edge = u * self.setup.facility_pinhole().fx_px * self.display.pitch_mm[0];
                wrong.screen.bow_per_mm = pair.map(|v| v / (edge * edge));
            }
            E::FluxComa => wrong.objective.coma_mm = value / u,
            E::FluxShift => wrong.objective.coma_offset_mm = pair,
            E::BackgroundGradient => {
                wrong.stray_e_s = [pair[0].abs() + pair[1].abs(), pair[0], pair[1]];
            }
            E::LateralColour => wrong.objective.lateral_colour = value / u,
            E::ColourWedge => wrong.objective.wedge_rad = pair,
            E::SubpixelOffset => self.display.stripe_px = [-value, 0.0, value],
            E::ThermalBoresight => dynamics.boresight_per_k = pair,
            E::ThermalFocal => dynamics.focal_per_k = value,
            E::Drift => dynamics.drift_per_s = pair.map(|v| v / 3600.0),
            E::RollDrift => dynamics.roll_per_s = value / u / 3600.0,
            E::Knock => dynamics.knock = pair,
            E::CameraPixelPhase => wrong.pixel_fill = value,
            E::RowLoadingShift => self.display.row_loading_px = value,
            // `EffectKind::of` has none for it.
            E::ScreenPixelPhase => {}
        }
    }

    fn apply_to_frames(&mut self, effect: FramesEffect, value: f64, pair: [f64; 2]) {
        use FramesEffect as E;
        let (wrong, dynamics) = (&mut self.wrong, &mut self.dynamics);
        match effect {
            E::Defocus => wrong.screen.focus_mm = value,
            E::VeilingGlare => self.setup.optics.veiling_glare = value,
            E::Ghost => self.setup.optics.coating_reflectance = value,
            E::Vignetting => wrong.clear_fraction = value,
            E::DarkOffset => self.setup.noise.offset_dn += value,
            E::DetectorNonlinearity => wrong.nonlinearity = value,
            E::Saturation => self.setup.noise.full_well_e = value,
            E::Prnu => self.setup.noise.prnu = value,
            E::Mura => self.display.mura = value,
            E::ImageShift => dynamics.shift_px = pair,
            E::Roll => wrong.camera_roll_rad = value,
            E::Scale => dynamics.scale = value,
            // `EffectKind::of` has none for them.
            E::PhotometricFunction
            | E::AlbedoMap
            | E::Relief
            | E::TerrainShadow
            | E::FieldCurvature
            | E::Coma
            | E::Astigmatism
            | E::SourceSize => {}
        }
    }

    fn apply_to_power(&mut self, effect: PowerEffect, given: &Effect) {
        use PowerEffect as E;
        let (value, light) = (given.value(), &mut self.light);
        match effect {
            E::Gamma => light.gamma = Some(value),
            E::BlackLevel => light.black_level = Some(value),
            E::SquareLoading => light.square_loading = value,
            E::PixelCrosstalk => light.pixel_crosstalk = value,
            E::SelfHeating => light.self_heating = value,
            E::Ageing => light.ageing_per_1000_h = value,
            E::MeterZero => light.meter_zero_w = value,
            E::MeterWavelength => {
                light.meter_by_channel = [0, 1, 2].map(|c| given.values.get(c).copied().unwrap_or(0.0));
            }
            E::MeterNonlinearity => light.meter_nonlinearity = value,
            E::ChannelNonadditivity => light.channel_nonadditivity = value,
            E::AttenuatorNotChanged => light.attenuator_of_last_series = Some(value),
        }
    }

    /// The bench of this facility.
    ///
    /// # Errors
    /// As [`Bench::new`].
    pub fn bench(&self, detail: OpticsDetail) -> Result<Bench, BenchError> {
        let options = BenchOptions { wrong: self.wrong, seed: self.seed, detail, ..BenchOptions::default() };
        Bench::with_display(&self.setup, self.display.clone(), &options)
    }
}
