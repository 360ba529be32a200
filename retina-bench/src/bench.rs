//! Screen, optics and camera together.

use glam::DVec3;
use once_cell::race::OnceBox;
use rayon::prelude::*;
use retina_files::InputError;
use retina_geometry::Setup;
use retina_optics::OpticalSystem;
use retina_radiometry::irradiance_of_magnitude_w_m2_nm;

use crate::buffers::Buffers;
use crate::display::lit;
use crate::light::{Focused, Light};
use crate::optics::{
    BenchOptics, CameraPose, ExposurePose, Landed, OpticsDetail, PointImage, SceneLight, Shown, Source,
    Stray, channel_lines, facility_system,
};
use crate::sensor::Rows;
use crate::{BenchError, Display, GroupOffset, Imperfections, ScreenImage, Sensor};

/// More lit pixels than these are a scene and go through Fourier transforms.
const MOST_PIXELS: usize = 10_000;

/// How a bench is built.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BenchOptions {
    /// What is wrong with it.
    pub wrong: Imperfections,
    /// Seed of its fixed patterns and its noise.
    pub seed: u64,
    /// How finely its optics are tabulated.
    pub detail: OpticsDetail,
    /// What of the image of a point is modelled.
    pub point_image: PointImage,
}

/// One exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exposure {
    /// Its length, s.
    pub exposure_s: f64,
    /// Temperature of the bench, degC.
    pub temperature_c: f64,
    /// How the camera has moved.
    pub pose: ExposurePose,
    /// Its number: two exposures of one number have the same noise.
    pub frame: u64,
}

impl Exposure {
    /// At 20 degC, nothing moved.
    pub fn new(exposure_s: f64, frame: u64) -> Self {
        Self { exposure_s, temperature_c: 20.0, pose: ExposurePose::default(), frame }
    }
}

/// What the camera returns.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraFrame {
    /// Width, pixels.
    pub width_px: usize,
    /// Height, pixels.
    pub height_px: usize,
    /// Digital numbers, row by row.
    pub dn: Vec<u16>,
}

/// The virtual bench.
pub struct Bench {
    setup: Setup,
    display: Display,
    optics: BenchOptics,
    sensor: Sensor,
    /// Electrons a second that a sub-pixel at count 255 on the axis makes, by channel.
    full_e_s: [f64; 3],
    /// The display's pattern, made for the first scene.
    mura: OnceBox<Option<Vec<[f32; 3]>>>,
    buffers: Buffers,
    seed: u64,
}

impl Bench {
    /// Traces the setup's optics and makes its screen and sensor.
    ///
    /// # Errors
    /// The setup's prescription does not fit, or the optics cannot be traced.
    pub fn new(setup: &Setup, options: &BenchOptions) -> Result<Self, BenchError> {
        let display = Display::new(setup, options.seed);
        Self::with_display(setup, display, options)
    }

    /// As [`Bench::new`], with a display of one's own.
    ///
    /// # Errors
    /// As [`Bench::new`].
    pub fn with_display(setup: &Setup, display: Display, options: &BenchOptions) -> Result<Self, BenchError> {
        let sensor = Sensor::new(setup, &options.wrong, options.seed);
        let mut system = facility_system(setup)?;
        if options.wrong.clear_fraction > 0.0 {
            system.clear_fraction = options.wrong.clear_fraction;
        }
        if options.wrong.relay != GroupOffset::default() {
            move_group(&mut system, "relay", &options.wrong.relay)?;
        }
        let lines = channel_lines(setup, sensor.efficiency(), options.detail.lines);
        let optics = BenchOptics::new(
            &system,
            setup,
            &display,
            &options.wrong,
            &lines,
            options.detail,
            options.point_image,
        )?;
        // Eq. 10: the effective irradiance of a white pixel, a third from each channel.
        let white =
            irradiance_of_magnitude_w_m2_nm(setup.brightest_magnitude()) * sensor.efficiency().bandwidth_nm();
        let each = white / 3.0 * pupil_area_m2(setup) * sensor.efficiency().electrons_per_joule();
        Ok(Self {
            setup: setup.clone(),
            display,
            optics,
            sensor,
            full_e_s: [each; 3],
            mura: OnceBox::new(),
            buffers: Buffers::default(),
            seed: options.seed,
        })
    }

    /// The setup it was made for.
    pub fn setup(&self) -> &Setup {
        &self.setup
    }

    /// Its display.
    pub fn display(&self) -> &Display {
        &self.display
    }

    /// Its optics.
    pub fn optics(&self) -> &BenchOptics {
        &self.optics
    }

    /// Its sensor.
    pub fn sensor(&self) -> &Sensor {
        &self.sensor
    }

    /// Sets the sensor's gain: `factor` times the setup's digital numbers for the same charge.
    pub fn set_gain(&mut self, factor: f64) {
        self.sensor.set_gain(factor);
    }

    /// Electrons a second in the brightest pixel of one channel's sub-pixel at count 255, where the optics
    /// are sharpest.
    pub fn sharpest_peak_e_s(&self) -> f64 {
        self.optics.sharpest_share() * self.full_e_s.iter().copied().fold(0.0, f64::max)
    }

    /// Electrons a second that a sub-pixel at count 255 on the axis makes, by channel.
    pub fn full_e_s(&self) -> [f64; 3] {
        self.full_e_s
    }

    /// The camera as it stands.
    pub fn camera(&self) -> &CameraPose {
        self.optics.camera()
    }

    /// Electrons a second that a star of this magnitude makes in the camera without the facility (eqs. 7 and
    /// 8, flat spectrum).
    pub fn star_e_s(&self, magnitude: f64) -> f64 {
        let efficiency = self.sensor.efficiency();
        irradiance_of_magnitude_w_m2_nm(magnitude)
            * efficiency.bandwidth_nm()
            * pupil_area_m2(&self.setup)
            * efficiency.electrons_per_joule()
    }

    /// Mean electrons of each pixel that the screen's light makes.
    ///
    /// # Errors
    /// The image has another size than the screen.
    pub fn light_e(&self, screen: &ScreenImage, exposure: &Exposure) -> Result<Vec<f32>, BenchError> {
        Ok(self.landed_e(self.landed(screen, exposure)?, exposure))
    }

    /// As [`Bench::light_e`], of light that has landed.
    pub fn landed_e(&self, landed: Landed, exposure: &Exposure) -> Vec<f32> {
        self.image_of(self.light(landed, exposure))
    }

    /// As [`Bench::light_e`], of light that has landed, without ghosts and veiling glare.
    pub fn focused_e(&self, landed: &Landed, exposure: &Exposure) -> Vec<f32> {
        self.image_of(Light { focused: self.focused(landed, exposure), stray: Stray::Even(0.0) })
    }

    fn image_of(&self, light: Light) -> Vec<f32> {
        let width = self.setup.camera.width_px as usize;
        let mut image = self.buffers.take(width * self.setup.camera.height_px as usize);
        let rows = image.par_chunks_exact_mut(width).enumerate();
        rows.for_each_init(Vec::new, |line, (y, row)| light.row(y, row, line));
        self.recycle(light);
        image
    }

    /// Light that has landed, on the sensor.
    fn light(&self, landed: Landed, exposure: &Exposure) -> Light {
        let (focused, stray) = (self.focused(&landed, exposure), self.optics.stray(&landed));
        if let Landed::Scene(light) = landed {
            light.planes.into_iter().for_each(|plane| self.buffers.give_back(plane));
        }
        Light { focused, stray }
    }

    fn focused(&self, landed: &Landed, exposure: &Exposure) -> Focused {
        let black = self.black_e(exposure);
        let patches = match landed {
            Landed::Points(sources) => self.optics.spots(sources).ok_or(sources),
            Landed::Scene(light) => Ok(self.optics.tiles(light, &self.buffers)),
        };
        match patches {
            Ok(patches) => Focused::Patches { black, patches },
            Err(sources) => {
                let size = self.setup.camera.width_px as usize * self.setup.camera.height_px as usize;
                let mut image = self.buffers.take(size);
                image.par_chunks_mut(1 << 16).for_each(|part| part.fill(black));
                self.optics.add_points(&mut image, sources);
                Focused::Image(image)
            }
        }
    }

    /// Keeps the memory of a light that is done with.
    fn recycle(&self, light: Light) {
        match light.focused {
            Focused::Image(image) => self.buffers.give_back(image),
            Focused::Patches { patches, .. } => {
                patches.into_buffers().for_each(|buffer| self.buffers.give_back(buffer));
            }
        }
    }

    /// A screen image's light where it lands in an exposure.
    ///
    /// # Errors
    /// The image has another size than the screen.
    pub fn landed(&self, screen: &ScreenImage, exposure: &Exposure) -> Result<Landed, BenchError> {
        let lit = |counts: &[[u8; 3]]| lit(counts).count();
        if screen.counts.par_chunks(1 << 16).map(lit).sum::<usize>() <= MOST_PIXELS {
            return self.sources(screen, exposure).map(Landed::Points);
        }
        self.scene(screen, exposure).map(Landed::Scene)
    }

    /// All light of a screen image on the grid of camera pixels.
    fn scene(&self, screen: &ScreenImage, exposure: &Exposure) -> Result<SceneLight, BenchError> {
        self.display.check_size(screen)?;
        let mura = self.mura.get_or_init(|| Box::new(self.display.patterns())).as_deref();
        let full_electrons = self.full_e_s.map(|e| e * exposure.exposure_s);
        let shown = Shown { display: &self.display, screen, mura, full_electrons };
        Ok(self.optics.scene(shown, &exposure.pose, &self.buffers))
    }

    /// Electrons a camera pixel of the screen's black, whose pixels are smaller than the camera's spots: it is even.
    fn black_e(&self, exposure: &Exposure) -> f32 {
        let k = self.setup.facility_pinhole();
        let camera = &self.optics.camera().pinhole;
        let screen_pixels = (k.fx_px * k.fy_px) / (camera.fx_px * camera.fy_px);
        let black_e_s = self.display.black * self.full_e_s.iter().sum::<f64>() * screen_pixels;
        (black_e_s * exposure.exposure_s) as f32
    }

    /// The camera image of a screen image.
    ///
    /// # Errors
    /// The image has another size than the screen.
    pub fn expose(&self, screen: &ScreenImage, exposure: &Exposure) -> Result<CameraFrame, BenchError> {
        let light = self.light(self.landed(screen, exposure)?, exposure);
        let frame = self.read_rows(&|y, row, line| light.row(y, row, line), exposure);
        self.recycle(light);
        Ok(frame)
    }

    /// Digital numbers of an image of mean electrons.
    pub fn read(&self, light_e: &[f32], exposure: &Exposure) -> CameraFrame {
        let copy = |y: usize, row: &mut [f32], _: &mut Vec<f32>| {
            row.copy_from_slice(&light_e[y * row.len()..(y + 1) * row.len()]);
        };
        self.read_rows(&copy, exposure)
    }

    fn read_rows(&self, light_e: &Rows<'_>, exposure: &Exposure) -> CameraFrame {
        CameraFrame {
            width_px: self.setup.camera.width_px as usize,
            height_px: self.setup.camera.height_px as usize,
            dn: self.sensor.read(
                light_e,
                exposure.exposure_s,
                exposure.temperature_c,
                self.seed,
                exposure.frame,
            ),
        }
    }

    /// Where a screen position (px) lands on the sensor in an exposure, without noise; `None` off the field.
    pub fn land_px(&self, screen_px: [f64; 2], channel: usize, exposure: &Exposure) -> Option<[f64; 2]> {
        let (at, _) = self.optics.land(self.display.mm(screen_px), channel)?;
        Some(exposure.pose.apply(at, self.optics.camera()).to_array())
    }

    /// Lit sub-pixels of a screen image, each as light on the sensor. [`Bench::landed`] is the quicker way for scenes.
    ///
    /// # Errors
    /// The image has another size than the screen.
    pub fn sources(&self, screen: &ScreenImage, exposure: &Exposure) -> Result<Vec<Source>, BenchError> {
        let lit = self.display.sub_pixels(screen)?;
        let full = self.full_e_s.map(|e| e * exposure.exposure_s);
        Ok(self.optics.sources(&self.display, &lit, &exposure.pose, full))
    }
}

/// Area of the camera's entrance pupil, m^2.
/// Of the camera, from focal length and f-number.
pub(crate) fn pupil_area_m2(setup: &Setup) -> f64 {
    let diameter_m = setup.camera.focal_mm * 1e-3 / setup.camera.f_number;
    std::f64::consts::PI / 4.0 * diameter_m * diameter_m
}

/// Moves a group of lenses, beside where its prescription has it.
fn move_group(system: &mut OpticalSystem, name: &str, by: &GroupOffset) -> Result<(), BenchError> {
    let found = system.groups.iter().map(|group| group.name.clone()).collect::<Vec<_>>().join(", ");
    let Some(group) = system.group_mut(name) else {
        return Err(InputError::new("the prescription", "has no group of lenses of this name")
            .found(format!("groups: {found}"))
            .expected(format!("a group `{name}`"))
            .help("name the surfaces' groups in the prescription")
            .into());
    };
    group.decentre_mm += DVec3::new(by.shift_mm[0], by.shift_mm[1], 0.0);
    group.tilt_rad += DVec3::new(by.tilt_rad[0], by.tilt_rad[1], 0.0);
    Ok(())
}

#[cfg(test)]
mod tests;
