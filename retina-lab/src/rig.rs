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

/// A screen that was there for so much longer or shorter than its time, s and as a part of it, did not follow.
const LATE_S: f64 = 0.06;
const LATE_SHARE: f64 = 0.1;
/// Trials of an image of several screens.
const MOST_SUMS: usize = 4;

/// One of several screens within an exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShownPart {
    /// How long it was there, s, as this program saw it.
    pub shown_s: f64,
    /// Whether the photodiode's patch was white in it.
    pub patch: Option<bool>,
}

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

    /// Refuses shares of an exposure that are too short for a display to show.
    ///
    /// # Errors
    /// Says how long the exposure must be.
    pub(crate) fn check_sum(light_s: f64, shares: impl Iterator<Item = f64>) -> Result<(), InputError> {
        let least = shares.fold(1.0, f64::min);
        if least * light_s >= LEAST_SHOWN_S {
            return Ok(());
        }
        Err(InputError::new(Path::new("--exposure-s"), "is too short for several screens")
            .found(format!("{light_s} s, of which one screen has {:.4} s", least * light_s))
            .expected(format!(
                "{:.3} s or more: two refreshes of 60 Hz for each screen",
                LEAST_SHOWN_S / least
            ))
            .help("give --exposure-s; show fainter light for longer, or split it into fewer screens"))
    }

    /// Takes an image in whose exposure several screens are shown one after the other, each for its share of `light_s`,
    /// between darkness: the camera's exposure is longer by what both ends need. Gives the image, whose exposure time is
    /// that in which light was shown, and what is known of each screen. Where one was not there for its time, the image is
    /// taken again.
    ///
    /// # Errors
    /// As [`Rig::take`]; the screens did not follow in four trials.
    pub fn take_sum(
        &mut self,
        light_s: f64,
        screens: &[(ScreenImage, f64)],
    ) -> Result<(Taken, Vec<ShownPart>), LabError> {
        let mut problem = String::new();
        for _ in 0..MOST_SUMS {
            let (taken, parts, over) = self.sum_once(light_s, screens)?;
            let late = parts.iter().zip(screens).position(|(part, (_, share))| {
                (part.shown_s - share * light_s).abs() > LATE_S.max(LATE_SHARE * share * light_s)
            });
            match (over, late) {
                (None, None) if taken.lost == 0 => return Ok((taken, parts)),
                (Some(over), _) => problem = over,
                (_, Some(at)) => {
                    problem = format!(
                        "saw screen {} for {:.3} s in the place of {:.3} s: the display does not follow",
                        at + 1,
                        parts[at].shown_s,
                        screens[at].1 * light_s
                    );
                }
                _ => problem = "lost an image; the next may have seen a part of the screens".into(),
            }
        }
        Err(LabError::Camera { camera: self.camera.name(), problem })
    }

    fn sum_once(
        &mut self,
        light_s: f64,
        screens: &[(ScreenImage, f64)],
    ) -> Result<(Taken, Vec<ShownPart>, Option<String>), LabError> {
        self.go_on()?;
        let Some((first, _)) = screens.first() else { return Ok((self.take(light_s)?, Vec::new(), None)) };
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
                    times.push((now, screen.patch()));
                    screen.hold(share * light_s)?;
                    due_s += share * light_s;
                    std::thread::sleep(
                        (begun + Duration::from_secs_f64(due_s)).saturating_duration_since(Instant::now()),
                    );
                }
                screen.show(&dark)?;
                times.push((Instant::now(), None));
                Ok::<_, LabError>(times)
            });
            let taken = camera.take();
            (show.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)), taken)
        });
        let (times, mut taken) = (shown?, taken?);
        let over_s =
            times.last().map_or(0.0, |(last, _)| last.saturating_duration_since(start).as_secs_f64());
        let over = (over_s > exposure_s).then(|| {
            format!(
                "may have closed before the last screen was over: {over_s:.3} s after the start of an exposure of \
                 {exposure_s:.3} s. Give a longer --settle-s, or a longer exposure"
            )
        });
        let part = |pair: &[(Instant, Option<bool>)]| ShownPart {
            shown_s: pair[1].0.saturating_duration_since(pair[0].0).as_secs_f64(),
            patch: pair[0].1,
        };
        let parts: Vec<ShownPart> = times.windows(2).map(part).collect();
        taken.exposure_s = parts.iter().map(|part| part.shown_s).sum();
        Ok((taken, parts, over))
    }

    /// Fails where the user wants an end.
    ///
    /// # Errors
    /// [`LabError::Interrupted`].
    pub fn go_on(&self) -> Result<(), LabError> {
        if (self.stop)() { Err(LabError::Interrupted) } else { Ok(()) }
    }
}
