//! The virtual bench as a camera: it photographs a screen in its own time.

use std::sync::Arc;
use std::time::{Duration, Instant};

use retina_bench::{Bench, Exposure, ExposurePose, OpticsDetail, ScreenImage};
use retina_campaign::{Facility, TemperatureProfile};
use retina_gige::{CameraInfo, Imager, Knob, Shot};

use crate::{LabError, ScreenView, Screw, Turns};

/// Longest exposure, s.
const LONGEST_EXPOSURE_S: f64 = 60.0;

/// How a bench camera behaves.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BenchCameraOptions {
    /// The bench's temperature, from the camera's start on.
    pub temperature: TemperatureProfile,
    /// How finely its optics are tabulated.
    pub detail: OpticsDetail,
}

/// A setup with effects as a camera.
pub struct BenchCamera {
    facility: Facility,
    options: BenchCameraOptions,
    view: Box<dyn ScreenView>,
    bench: Bench,
    /// The turns of the screws that the bench was built with.
    turned: Turns,
    start: Instant,
    light: Option<Light>,
}

/// A screen, and how long it was seen, s.
type Look = (Arc<ScreenImage>, f64);

/// What the last exposure's screens made, for exposures of the same.
struct Light {
    screens: Vec<Look>,
    pose: ExposurePose,
    electrons: Vec<f32>,
}

impl Light {
    fn is_of(&self, screens: &[Look], pose: &ExposurePose) -> bool {
        let same = |((a, s), (b, t)): (&Look, &Look)| Arc::ptr_eq(a, b) && s == t;
        self.pose == *pose
            && self.screens.len() == screens.len()
            && self.screens.iter().zip(screens).all(same)
    }
}

impl BenchCamera {
    /// Builds the bench.
    ///
    /// # Errors
    /// Its optics cannot be traced.
    pub fn new(
        facility: Facility,
        view: Box<dyn ScreenView>,
        options: BenchCameraOptions,
    ) -> Result<Self, LabError> {
        let bench = facility.bench(options.detail)?;
        Ok(Self {
            facility,
            options,
            view,
            bench,
            turned: Turns::default(),
            start: Instant::now(),
            light: None,
        })
    }

    /// What the camera says of itself.
    pub fn info(&self, serial: &str) -> CameraInfo {
        let camera = &self.facility.setup.camera;
        let knob = |screw: Screw| Knob {
            name: screw.name(),
            meaning: screw.meaning().into(),
            unit: screw.unit().into(),
            range: [-screw.range(), screw.range()],
            value: 0.0,
        };
        CameraInfo {
            model: format!("virtual bench {}", self.facility.setup.name),
            serial: serial.into(),
            width_px: camera.width_px,
            height_px: camera.height_px,
            bits: camera.bits,
            offset_dn: self.facility.setup.noise.offset_dn.clamp(0.0, 65535.0) as u16,
            longest_exposure_s: LONGEST_EXPOSURE_S,
            knobs: Screw::ALL.into_iter().map(knob).collect(),
        }
    }

    /// The bench with its screws turned.
    fn turn(&mut self, turned: Turns) -> Result<(), LabError> {
        if self.turned == turned {
            return Ok(());
        }
        let mut facility = self.facility.clone();
        turned.apply(&mut facility.wrong);
        self.bench = facility.bench(self.options.detail)?;
        self.turned = turned;
        self.light = None;
        Ok(())
    }

    /// The screens that an exposure sees, and how long it sees each, s. The call lasts as long as the exposure.
    fn watch(&mut self, exposure_s: f64) -> Result<Vec<Look>, LabError> {
        let start = Instant::now();
        let mut screens: Vec<Look> = Vec::new();
        let mut seen_s = 0.0;
        while seen_s < exposure_s {
            let image = self.view.read()?;
            let until_s = (start.elapsed().as_secs_f64() + self.view.look_s()).min(exposure_s).max(seen_s);
            // What was read stands for the time from the last look on.
            let lasts_s = until_s - seen_s;
            match screens.last_mut() {
                Some((last, time_s)) if Arc::ptr_eq(last, &image) => *time_s += lasts_s,
                _ => screens.push((image, lasts_s)),
            }
            seen_s = until_s;
            let early_s = seen_s - start.elapsed().as_secs_f64();
            if early_s > 0.0 {
                std::thread::sleep(Duration::from_secs_f64(early_s));
            }
        }
        // One screen throughout: no sum of times that differs in its last digit from exposure to exposure.
        if let [(_, time_s)] = screens.as_mut_slice() {
            *time_s = exposure_s;
        }
        Ok(screens)
    }

    /// Time since the start, s, and temperature, degC.
    pub(crate) fn clock(&self) -> (f64, f64) {
        let time_s = self.start.elapsed().as_secs_f64();
        (time_s, self.options.temperature.at_c(time_s))
    }

    /// How the mount has moved: along the facility's axes, whatever the camera's roll and its screw.
    fn pose(&self, time_s: f64, temperature_c: f64, number: u64) -> ExposurePose {
        let screw_rad = self.turned.get(Screw::CameraRoll).to_radians();
        let (facility, focal_px) = (&self.facility, self.bench.camera().pinhole.fx_px);
        let roll_rad = facility.wrong.camera_roll_rad + screw_rad;
        facility.dynamics.pose(focal_px, roll_rad, time_s, temperature_c, facility.seed, number)
    }

    /// Digital counts of an exposure that begins now.
    pub(crate) fn take(&mut self, shot: &Shot) -> Result<Vec<u16>, LabError> {
        self.turn(Turns::from_slice(&shot.knobs))?;
        let (time_s, temperature_c) = self.clock();
        let screens = self.watch(shot.exposure_s)?;
        let pose = self.pose(time_s, temperature_c, shot.number);
        let exposure = |exposure_s: f64| Exposure { exposure_s, temperature_c, pose, frame: shot.number };
        let known = self.light.take().filter(|light| light.is_of(&screens, &pose));
        let light = match known {
            Some(light) => light,
            None => {
                let mut electrons: Vec<f32> = Vec::new();
                for (image, time_s) in &screens {
                    let part = self.bench.light_e(image, &exposure(*time_s))?;
                    if electrons.is_empty() {
                        electrons = part;
                    } else {
                        electrons.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
                    }
                }
                Light { screens, pose, electrons }
            }
        };
        self.bench.set_gain(shot.gain);
        let frame = self.bench.read(&light.electrons, &exposure(shot.exposure_s));
        self.light = Some(light);
        Ok(frame.dn)
    }
}

impl Imager for BenchCamera {
    fn expose(&mut self, shot: &Shot) -> Result<Vec<u16>, String> {
        self.take(shot).map_err(|error| error.to_string())
    }

    fn temperature_c(&self) -> f64 {
        self.clock().1
    }
}

#[cfg(test)]
mod tests;
