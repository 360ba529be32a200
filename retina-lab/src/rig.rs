//! A screen and a camera that work together.

use std::path::Path;
use std::time::{Duration, Instant};

use retina_bench::ScreenImage;
use retina_files::InputError;

use crate::{CameraSettings, LabCamera, LabError, Screen, Taken};

/// From the camera's order to the first of several screens, and after the last, s, beside the display's own time: what a
/// camera takes to begin.
const LEAD_S: f64 = 0.15;
/// A screen that is there for less is not shown exactly: two refreshes of 60 Hz, s.
const LEAST_SHOWN_S: f64 = 2.0 / 60.0;

/// A screen, the camera that looks at it, and how both are used.
pub struct Rig<'a> {
    /// The screen.
    pub screen: &'a mut dyn Screen,
    /// The camera.
    pub camera: &'a mut dyn LabCamera,
    /// Wait after a frame is shown, s: what the display takes to follow.
    pub settle_s: f64,
    /// Gain of the camera, dB.
    pub gain_db: f64,
    /// Whether the user wants an end; asked before each exposure.
    pub stop: &'a dyn Fn() -> bool,
}

impl Rig<'_> {
    /// Shows a frame and waits until the display has followed.
    ///
    /// # Errors
    /// The screen fails.
    pub fn show(&mut self, image: &ScreenImage) -> Result<(), LabError> {
        self.screen.show(image)?;
        self.settle();
        Ok(())
    }

    fn settle(&self) {
        std::thread::sleep(Duration::from_secs_f64(self.settle_s));
    }

    /// Takes an image of what is shown.
    ///
    /// # Errors
    /// The camera fails, the display's limits do not allow so long an exposure, or the user wants an end.
    pub fn take(&mut self, exposure_s: f64) -> Result<Taken, LabError> {
        self.go_on()?;
        self.camera.set(&CameraSettings { exposure_s, gain_db: self.gain_db })?;
        if self.screen.hold(exposure_s)? {
            self.settle();
        }
        let taken = self.camera.take()?;
        if self.screen.is_shown() {
            return Ok(taken);
        }
        Err(LabError::Camera {
            camera: self.camera.name(),
            problem: "took so long for its image that the display went dark within it (`screen.limits.longest_s`). \
                      Raise the limit"
                .into(),
        })
    }

    /// Takes an image in whose exposure several screens are shown one after the other, each for its share of `light_s`,
    /// between darkness: the camera's exposure is longer by what both ends need. Gives the image, whose exposure time is
    /// that in which light was shown, and how long each screen was there, s, as this program saw it.
    ///
    /// # Errors
    /// As [`Rig::take`]; the last screen was there longer than the exposure may have lasted.
    pub fn take_sum(
        &mut self,
        light_s: f64,
        screens: &[(ScreenImage, f64)],
    ) -> Result<(Taken, Vec<f64>), LabError> {
        self.go_on()?;
        let Some((first, _)) = screens.first() else { return Ok((self.take(light_s)?, Vec::new())) };
        let least = screens.iter().map(|(_, share)| *share).fold(1.0, f64::min);
        if least * light_s < LEAST_SHOWN_S {
            return Err(InputError::new(Path::new("--exposure-s"), "is too short for several screens")
                .found(format!("{light_s} s, of which one screen has {:.4} s", least * light_s))
                .expected(format!(
                    "{:.3} s or more: two refreshes of 60 Hz for each screen",
                    LEAST_SHOWN_S / least
                ))
                .help("show fainter light for longer, or split it into fewer screens")
                .into());
        }
        let dark = ScreenImage::dark(first.width_px, first.height_px);
        let lead_s = self.settle_s + LEAD_S;
        let exposure_s = light_s + 2.0 * lead_s;
        self.camera.set(&CameraSettings { exposure_s, gain_db: self.gain_db })?;
        self.show(&dark)?;
        let (screen, camera) = (&mut *self.screen, &mut *self.camera);
        let start = Instant::now();
        let (shown, taken) = std::thread::scope(|scope| {
            let show = scope.spawn(|| {
                std::thread::sleep(Duration::from_secs_f64(lead_s));
                let mut times = Vec::new();
                let mut due_s = 0.0;
                let mut first = None;
                for (image, share) in screens {
                    screen.show(image)?;
                    let now = Instant::now();
                    let begun = *first.get_or_insert(now);
                    times.push(now);
                    screen.hold(share * light_s)?;
                    due_s += share * light_s;
                    std::thread::sleep(
                        (begun + Duration::from_secs_f64(due_s)).saturating_duration_since(Instant::now()),
                    );
                }
                screen.show(&dark)?;
                times.push(Instant::now());
                Ok::<_, LabError>(times)
            });
            let taken = camera.take();
            (show.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)), taken)
        });
        let (times, mut taken) = (shown?, taken?);
        let problem = |problem: String| LabError::Camera { camera: self.camera.name(), problem };
        let over_s = times.last().map_or(0.0, |last| last.saturating_duration_since(start).as_secs_f64());
        if over_s > exposure_s {
            return Err(problem(format!(
                "may have closed before the last screen was over: {over_s:.3} s after the start of an exposure of \
                 {exposure_s:.3} s. Give a longer --settle-s, or a longer exposure"
            )));
        }
        if taken.lost > 0 {
            return Err(problem("lost an image; the next may have seen a part of the screens".into()));
        }
        let shown_s: Vec<f64> =
            times.windows(2).map(|pair| pair[1].saturating_duration_since(pair[0]).as_secs_f64()).collect();
        taken.exposure_s = shown_s.iter().sum();
        Ok((taken, shown_s))
    }

    /// Fails where the user wants an end.
    ///
    /// # Errors
    /// [`LabError::Interrupted`].
    pub fn go_on(&self) -> Result<(), LabError> {
        if (self.stop)() { Err(LabError::Interrupted) } else { Ok(()) }
    }
}
