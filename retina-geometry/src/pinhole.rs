//! The pinhole camera: K and an image size.

use glam::{DVec2, DVec3};

/// Intrinsics of a pinhole image (paper, eq. 12), pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pinhole {
    /// Focal length along x, pixels.
    pub fx_px: f64,
    /// Focal length along y, pixels.
    pub fy_px: f64,
    /// Principal point x, pixels from the image's left edge.
    pub cx_px: f64,
    /// Principal point y, pixels from the image's top edge.
    pub cy_px: f64,
    /// Image width, pixels.
    pub width_px: u32,
    /// Image height, pixels.
    pub height_px: u32,
}

impl Pinhole {
    /// Square pixels, the optical centre in the middle of the image.
    pub fn centred(focal_px: f64, [width_px, height_px]: [u32; 2]) -> Self {
        Self {
            fx_px: focal_px,
            fy_px: focal_px,
            cx_px: f64::from(width_px) / 2.0,
            cy_px: f64::from(height_px) / 2.0,
            width_px,
            height_px,
        }
    }

    /// The line of sight (x, y) of a pixel position: K^-1 R (eq. 14).
    pub fn line_of_sight(&self, pixel: DVec2) -> DVec2 {
        DVec2::new((pixel.x - self.cx_px) / self.fx_px, (pixel.y - self.cy_px) / self.fy_px)
    }

    /// The pixel position of a line of sight: K r (eq. 11).
    pub fn pixel(&self, line_of_sight: DVec2) -> DVec2 {
        DVec2::new(self.fx_px * line_of_sight.x + self.cx_px, self.fy_px * line_of_sight.y + self.cy_px)
    }

    /// The pixel position of a point in the camera frame; `None` at or behind the camera's plane.
    pub fn project(&self, point_camera: DVec3) -> Option<DVec2> {
        (point_camera.z > 0.0)
            .then(|| self.pixel(DVec2::new(point_camera.x, point_camera.y) / point_camera.z))
    }

    /// Solid angle of a pixel on the boresight, 1 / (f_x f_y), sr.
    pub fn boresight_pixel_sr(&self) -> f64 {
        1.0 / (self.fx_px * self.fy_px)
    }

    /// The largest tan of the angle from the boresight over the image's corners.
    pub fn corner_tan(&self) -> f64 {
        let (w, h) = (f64::from(self.width_px), f64::from(self.height_px));
        [(0.0, 0.0), (w, 0.0), (0.0, h), (w, h)]
            .iter()
            .map(|&(x, y)| self.line_of_sight(DVec2::new(x, y)).length())
            .fold(0.0, f64::max)
    }
}
