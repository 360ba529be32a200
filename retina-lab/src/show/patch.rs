//! A square of the screen for a photodiode, where the camera does not look: white and black in turn with each frame.

use std::fmt;
use std::path::Path;
use std::str::FromStr;

use retina_bench::ScreenImage;
use retina_files::InputError;
use retina_geometry::Setup;

use super::Screen;
use crate::LabError;

/// Room about the camera's field for its distortion and pointing, as a part of the field.
const ROOM: f64 = 0.05;

/// A square of the screen, pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Patch {
    /// Its first column and row.
    pub corner_px: [u32; 2],
    /// Its side.
    pub side_px: u32,
}

impl FromStr for Patch {
    type Err = InputError;

    /// `COLUMN,ROW,SIDE`.
    fn from_str(text: &str) -> Result<Self, InputError> {
        let numbers: Vec<Option<u32>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
        match numbers[..] {
            [Some(column), Some(row), Some(side_px)] if side_px > 0 => {
                Ok(Self { corner_px: [column, row], side_px })
            }
            _ => Err(InputError::new(Path::new("--patch"), "is no square of the screen")
                .found(format!("`{text}`"))
                .expected("COLUMN,ROW,SIDE in pixels, for example 0,0,64")),
        }
    }
}

impl fmt::Display for Patch {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(to, "{},{},{}", self.corner_px[0], self.corner_px[1], self.side_px)
    }
}

impl Patch {
    /// Refuses a square that is not on the screen, or that the camera sees.
    ///
    /// # Errors
    /// Says where the camera does not look.
    pub fn check(&self, setup: &Setup) -> Result<(), InputError> {
        let size_px = [setup.screen.width_px, setup.screen.height_px];
        let (screen, camera) = (setup.facility_pinhole(), setup.camera_pinhole());
        // The field's edges on the screen: half the camera's extent as a tangent, at the facility's focal length.
        let edges = |axis: usize| {
            let (extent_px, f_px, centre_px, focal_px) = [
                (camera.width_px, camera.fx_px, screen.cx_px, screen.fx_px),
                (camera.height_px, camera.fy_px, screen.cy_px, screen.fy_px),
            ][axis];
            let half_px = (1.0 + ROOM) * 0.5 * f64::from(extent_px) / f_px * focal_px;
            [centre_px - half_px, centre_px + half_px]
        };
        let edges = [edges(0), edges(1)];
        let own =
            [0, 1].map(|axis| [self.corner_px[axis], self.corner_px[axis].saturating_add(self.side_px)]);
        let error = |problem: &str| InputError::new(Path::new("--patch"), problem).found(self.to_string());
        if (0..2).any(|axis| own[axis][1] > size_px[axis]) {
            return Err(error("the square is not on the screen")
                .expected(format!("within {} x {} pixels", size_px[0], size_px[1])));
        }
        let seen = (0..2)
            .all(|axis| f64::from(own[axis][0]) < edges[axis][1] && f64::from(own[axis][1]) > edges[axis][0]);
        if !seen {
            return Ok(());
        }
        let free: Vec<String> = [("columns", 0), ("rows", 1)]
            .into_iter()
            .flat_map(|(what, axis)| {
                let (before, after) = (edges[axis][0].floor(), edges[axis][1].ceil());
                let before = (before >= 1.0).then(|| format!("{what} 0 to {}", before as u32 - 1));
                let last = size_px[axis] - 1;
                let after = (after <= f64::from(last)).then(|| format!("{what} {} to {last}", after as u32));
                [before, after].into_iter().flatten()
            })
            .collect();
        Err(error("the camera sees this square").expected(match free.is_empty() {
            true => "a screen with a margin: the camera's field covers all of this one".to_owned(),
            false => format!("a square within {}", free.join(", or ")),
        }))
    }
}

/// A screen with a patch.
pub(super) struct Patched {
    screen: Box<dyn Screen>,
    patch: Patch,
    /// Its count where it is white: the display's limits hold for it.
    white: u8,
    /// The patch is white in the last frame.
    lit: bool,
}

impl Patched {
    pub(super) fn new(screen: Box<dyn Screen>, patch: Patch, white: u8) -> Self {
        Self { screen, patch, white, lit: false }
    }
}

impl Screen for Patched {
    fn show(&mut self, image: &ScreenImage) -> Result<(), LabError> {
        // A dark screen is dark: at the end, and where darkness is measured.
        if image.counts.iter().all(|counts| *counts == [0; 3]) {
            self.lit = false;
            return self.screen.show(image);
        }
        self.lit = !self.lit;
        let mut painted = image.clone();
        let [left, top] = self.patch.corner_px;
        for row in top..(top + self.patch.side_px).min(image.height_px) {
            for column in left..(left + self.patch.side_px).min(image.width_px) {
                painted.set(column, row, [if self.lit { self.white } else { 0 }; 3]);
            }
        }
        self.screen.show(&painted)
    }

    fn hold(&mut self, for_s: f64) -> Result<bool, LabError> {
        self.screen.hold(for_s)
    }

    fn is_shown(&self) -> bool {
        self.screen.is_shown()
    }

    fn verifies(&self) -> bool {
        self.screen.verifies()
    }

    fn patch(&self) -> Option<bool> {
        Some(self.lit)
    }

    fn remarks(&self) -> Vec<String> {
        self.screen.remarks()
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may fail")]

    use super::*;
    use crate::{BenchScreen, ScreenView as _};

    #[test]
    fn the_patch_changes_with_each_frame_and_is_dark_with_the_screen() {
        let shown = BenchScreen::new([8, 4]);
        let mut screen = Patched::new(Box::new(shown.clone()), "5,1,2".parse().unwrap(), 255);
        let frame = ScreenImage::grey(8, 4, &[9; 32]);
        let at = |column: usize, row: usize| shown.clone().read().unwrap().counts[row * 8 + column][0];
        for (image, patch) in
            [(&frame, 255), (&frame, 0), (&frame, 255), (&ScreenImage::dark(8, 4), 0), (&frame, 255)]
        {
            screen.show(image).unwrap();
            assert_eq!((at(5, 1), at(6, 2)), (patch, patch));
            assert_eq!(
                (at(4, 1), at(7, 2), at(5, 3)),
                (image.counts[0][0], image.counts[0][0], image.counts[0][0])
            );
            assert_eq!(screen.patch(), Some(patch == 255));
        }
    }

    #[test]
    fn a_patch_that_the_camera_sees_is_refused() {
        let setup = Setup::shipped(Path::new("wide-fov")).unwrap();
        let checked = |text: &str| text.parse::<Patch>().and_then(|patch| patch.check(&setup));
        let size_px = [setup.screen.width_px, setup.screen.height_px];
        let seen = checked(&format!("{},{},10", size_px[0] / 2, size_px[1] / 2)).unwrap_err().to_string();
        assert!(seen.contains("the camera sees this square") && seen.contains("columns 0 to "), "{seen}");
        assert!(checked("0,100,32").is_ok());
        assert!(checked(&format!("{},0,32", size_px[0] - 32)).is_ok());
        let beyond = checked(&format!("{},0,33", size_px[0] - 32)).unwrap_err().to_string();
        assert!(beyond.contains("not on the screen"), "{beyond}");
        for wrong in ["", "1,2", "1,2,0", "a,b,c", "-1,0,5", "1,2,3,4"] {
            assert!(checked(wrong).is_err(), "{wrong}");
        }
    }
}
