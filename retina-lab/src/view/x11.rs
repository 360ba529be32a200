//! An X11 display as a screen: its root window, read back.

use std::sync::Arc;

use retina_bench::ScreenImage;

use super::ScreenView;
use crate::LabError;
use crate::x11::{Area, Display};

pub(crate) struct X11View {
    display: Display,
    area: Area,
    /// The last image, and the bytes it was read from.
    shown: Option<(Vec<u8>, Arc<ScreenImage>)>,
}

impl X11View {
    pub(crate) fn open(name: &str, size_px: [u32; 2]) -> Result<Self, LabError> {
        let display = Display::open(name)?;
        let [width, height] = display.size_px;
        if [width, height].map(u32::from) != size_px {
            return Err(display.broken(format!(
                "has {width} x {height} pixels; the setup's screen has {} x {}. Give the display the screen's mode",
                size_px[0], size_px[1]
            )));
        }
        Ok(Self { display, area: Area { left: 0, top: 0, width, height }, shown: None })
    }
}

impl ScreenView for X11View {
    fn read(&mut self) -> Result<Arc<ScreenImage>, LabError> {
        let bytes = self.display.shown(self.area)?;
        if let Some((known, image)) = &self.shown
            && *known == bytes
        {
            return Ok(Arc::clone(image));
        }
        let image = Arc::new(self.display.image(&bytes, self.area));
        self.shown = Some((bytes, Arc::clone(&image)));
        Ok(image)
    }
}
