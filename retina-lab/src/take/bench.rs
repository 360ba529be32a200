//! The virtual bench in this process.

use retina_gige::Shot;
use retina_image::{CameraImage, Steps};

use super::{CameraSettings, LabCamera, Taken};
use crate::{BenchCamera, LabError, Turns};

pub(super) struct InProcess {
    bench: BenchCamera,
    shot: Shot,
}

impl InProcess {
    pub(super) fn new(bench: BenchCamera) -> Self {
        let knobs = bench.info("").knobs.iter().map(|knob| knob.value).collect();
        Self { bench, shot: Shot { number: 0, exposure_s: 0.01, gain: 1.0, knobs } }
    }
}

impl LabCamera for InProcess {
    fn name(&self) -> String {
        self.bench.info("").model
    }

    fn set(&mut self, settings: &CameraSettings) -> Result<(), LabError> {
        let most_s = self.bench.info("").longest_exposure_s;
        if !(settings.exposure_s > 0.0 && settings.exposure_s <= most_s) {
            return Err(LabError::Camera {
                camera: self.name(),
                problem: format!("cannot expose for {} s; it can for up to {most_s} s", settings.exposure_s),
            });
        }
        self.shot.exposure_s = settings.exposure_s;
        self.shot.gain = 10f64.powf(settings.gain_db / 20.0);
        Ok(())
    }

    fn take(&mut self) -> Result<Taken, LabError> {
        let info = self.bench.info("");
        let (time_s, temperature_c) = self.bench.clock();
        let counts = self.bench.take(&self.shot)?;
        self.shot.number += 1;
        let image = CameraImage {
            width_px: info.width_px,
            height_px: info.height_px,
            values: counts.into_iter().map(f32::from).collect(),
            full_scale_dn: ((1u32 << info.bits) - 1) as f32,
            steps: Steps::Whole,
        };
        Ok(Taken {
            image,
            time_s,
            exposure_s: self.shot.exposure_s,
            temperature_c: Some(temperature_c),
            lost: 0,
        })
    }

    fn turn(&mut self, by: &Turns) -> Result<(), LabError> {
        self.shot.knobs = Turns::from_slice(&self.shot.knobs).and(by).values().to_vec();
        Ok(())
    }
}
