//! A screen and a camera whose delays are known.

use std::sync::{Arc, Mutex};

use retina_image::Steps;

use super::*;
use crate::{CameraSettings, LabCamera, Screen, Taken};

/// When the square appeared on the glass, and went.
type Glass = Arc<Mutex<Vec<(Instant, bool)>>>;

struct Slow {
    glass: Glass,
    after_s: f64,
}

impl Screen for Slow {
    fn show(&mut self, image: &ScreenImage) -> Result<(), LabError> {
        std::thread::sleep(Duration::from_millis(4));
        let lit = image.counts.iter().any(|counts| counts[0] > 0);
        let at = Instant::now() + Duration::from_secs_f64(self.after_s);
        self.glass.lock().unwrap().push((at, lit));
        Ok(())
    }

    fn verifies(&self) -> bool {
        false
    }
}

struct Late {
    glass: Glass,
    exposure_s: f64,
    before_s: f64,
    transfer_s: f64,
}

impl LabCamera for Late {
    fn name(&self) -> String {
        "late".into()
    }

    fn set(&mut self, settings: &CameraSettings) -> Result<(), LabError> {
        self.exposure_s = settings.exposure_s;
        Ok(())
    }

    fn take(&mut self) -> Result<Taken, LabError> {
        let nap = |seconds: f64| std::thread::sleep(Duration::from_secs_f64(seconds));
        nap(self.before_s);
        let start = Instant::now();
        nap(self.exposure_s);
        let end = start + Duration::from_secs_f64(self.exposure_s);
        nap(self.transfer_s);
        let (mut seen, mut since, mut lit) = (0.0, start, false);
        for &(at, next) in self.glass.lock().unwrap().iter() {
            let at = at.clamp(start, end);
            seen += if lit { (at - since).as_secs_f64() } else { 0.0 };
            (since, lit) = (at, next);
        }
        seen += if lit { (end - since).as_secs_f64() } else { 0.0 };
        let mut values = vec![100.0; 400];
        let lit = (2000.0 * seen / self.exposure_s) as f32;
        values[100..200].iter_mut().for_each(|value| *value += lit);
        let image =
            CameraImage { width_px: 20, height_px: 20, values, full_scale_dn: 4095.0, steps: Steps::Whole };
        Ok(Taken { image, time_s: 0.0, exposure_s: self.exposure_s, temperature_c: None, lost: 0 })
    }
}

#[test]
fn known_delays_are_found() {
    let glass = Glass::default();
    let mut screen = Slow { glass: Arc::clone(&glass), after_s: 0.020 };
    let mut camera = Late { glass, exposure_s: 0.0, before_s: 0.008, transfer_s: 0.030 };
    let mut rig =
        Rig { screen: &mut screen, camera: &mut camera, settle_s: 0.03, gain_db: 0.0, stop: &|| false };
    let options = LatencyOptions { trials: 15, exposure_s: 0.1, square_px: 8, most_count: 255 };
    let found = measure_latency(&mut rig, [32, 24], &options, |_, _| {}).unwrap();
    assert_eq!((found.trials.len(), found.digital_count), (15, 255));
    // A busy machine sleeps too long now and then, never too short: medians.
    let near = |median: f64, truth: f64| assert!((median - truth).abs() < 0.004, "{median} for {truth}");
    near(found.quantiles(|trial| trial.show_to_image_s).median, 0.050);
    near(found.quantiles(|trial| trial.camera_s).median, 0.038);
    near(found.quantiles(|trial| trial.settle_s).median, 0.012);
    near(found.quantiles(|trial| trial.show_s).median, 0.004);
}

#[test]
fn a_change_that_is_never_seen_is_told() {
    let glass = Glass::default();
    let mut screen = Slow { glass: Arc::clone(&glass), after_s: 0.1 };
    let mut camera = Late { glass, exposure_s: 0.0, before_s: 0.0, transfer_s: 0.0 };
    let mut rig =
        Rig { screen: &mut screen, camera: &mut camera, settle_s: 0.11, gain_db: 0.0, stop: &|| false };
    let options = LatencyOptions { trials: 5, exposure_s: 0.01, square_px: 8, most_count: 255 };
    let error = measure_latency(&mut rig, [32, 24], &options, |_, _| {}).unwrap_err().to_string();
    assert!(error.contains("longer --exposure-s"), "{error}");
}
