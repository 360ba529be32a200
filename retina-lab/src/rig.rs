//! A screen and a camera that work together.

use std::time::Duration;

use retina_bench::ScreenImage;

use crate::{CameraSettings, LabCamera, LabError, Screen, Taken};

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

    /// Fails where the user wants an end.
    ///
    /// # Errors
    /// [`LabError::Interrupted`].
    pub fn go_on(&self) -> Result<(), LabError> {
        if (self.stop)() { Err(LabError::Interrupted) } else { Ok(()) }
    }
}
