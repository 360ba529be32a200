//! The part of the camera's image that is looked at, and how a prediction is laid upon it.

use glam::{DMat2, DMat3, DVec2, DVec3};
use retina_geometry::Pinhole;

/// A window of the camera's image in bins of `bin` x `bin` pixels, each with `fine` x `fine` cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Window {
    /// First pixel.
    pub(crate) left: usize,
    pub(crate) top: usize,
    /// Bins across and down.
    pub(crate) columns: usize,
    pub(crate) rows: usize,
    /// Pixels along a bin's side.
    pub(crate) bin: usize,
    /// Cells along a bin's side.
    pub(crate) fine: usize,
}

impl Window {
    /// Cells a pixel.
    pub(crate) fn cells_per_px(&self) -> f64 {
        self.fine as f64 / self.bin as f64
    }

    /// Camera pixel position of a position in cells.
    pub(crate) fn px(&self, cell: DVec2) -> DVec2 {
        DVec2::new(self.left as f64, self.top as f64) + cell / self.cells_per_px()
    }

    /// Its middle, px.
    pub(crate) fn middle(&self) -> DVec2 {
        self.px(0.5 * DVec2::new((self.columns * self.fine) as f64, (self.rows * self.fine) as f64))
    }

    /// The pinhole of its cells.
    pub(crate) fn pinhole(&self, camera: &Pinhole) -> Pinhole {
        let scale = self.cells_per_px();
        Pinhole {
            fx_px: camera.fx_px * scale,
            fy_px: camera.fy_px * scale,
            cx_px: (camera.cx_px - self.left as f64) * scale,
            cy_px: (camera.cy_px - self.top as f64) * scale,
            width_px: (self.columns * self.fine) as u32,
            height_px: (self.rows * self.fine) as u32,
        }
    }
}

/// Where the prediction is laid: what is at `from` (camera px) is seen at `to`, turned by `roll_rad` (x towards y).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Pose {
    pub(crate) from: DVec2,
    pub(crate) to: DVec2,
    pub(crate) roll_rad: f64,
}

impl Pose {
    /// As the tables say.
    pub(crate) const NOMINAL: Self = Self { from: DVec2::ZERO, to: DVec2::ZERO, roll_rad: 0.0 };

    /// The predicted image's pixel position that is seen at `at`.
    pub(crate) fn source_px(&self, at: DVec2) -> DVec2 {
        self.from + DMat2::from_angle(-self.roll_rad) * (at - self.to)
    }

    /// The turn of the camera that does so: takes directions as predicted to directions as seen.
    pub(crate) fn rotation(&self, camera: &Pinhole) -> DMat3 {
        let ray = |px: DVec2| -> DVec3 { camera.line_of_sight(px).extend(1.0).normalize() };
        let (from, to) = (ray(self.from), ray(self.to));
        let axis = from.cross(to);
        let turn = if axis.length() > 0.0 {
            DMat3::from_axis_angle(axis.normalize(), axis.length().atan2(from.dot(to)))
        } else {
            DMat3::IDENTITY
        };
        DMat3::from_axis_angle(to, self.roll_rad) * turn
    }

    /// This one, then a small shift and roll about `middle`.
    pub(crate) fn then(&self, middle: DVec2, shift: DVec2, roll_rad: f64) -> Self {
        let to = middle + shift + DMat2::from_angle(roll_rad) * (self.to - middle);
        Self { from: self.from, to, roll_rad: self.roll_rad + roll_rad }
    }
}
