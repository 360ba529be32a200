//! The camera of a limb measurement: pixels to lines of sight and back.

use glam::DVec2;
use retina_formats::Calibration;
use retina_geometry::Pinhole;

use crate::stars::{SkyFit, StarCamera};

/// What lies between a pixel's position and the line of sight.
#[derive(Debug, Clone)]
pub enum Mapping {
    /// Nothing but the pinhole: an ideal image, or one whose distortion was compensated upstream.
    Pinhole,
    /// A camera image that holds the facility's distortion: r = D^-1(C^-1 u).
    Downstream(Box<Calibration>),
    /// A screen image that was distorted beforehand (upstream): it shows r = D(K_f^-1 u).
    Screen(Box<Calibration>),
    /// The lens as the stars of the same image have it.
    Stars(Box<StarLens>),
}

/// A camera as it was known before, and what stars made of it: focal length, distortion, shape of the pixels.
#[derive(Debug, Clone)]
pub struct StarLens {
    camera: StarCamera,
    fit: SkyFit,
}

impl StarLens {
    /// The camera of an image that stars have solved.
    pub fn new(camera: StarCamera, fit: SkyFit) -> Self {
        Self { camera, fit }
    }

    /// The pinhole that this lens would be without its distortion.
    pub fn pinhole(camera: &StarCamera, fit: &SkyFit) -> Pinhole {
        let nominal = camera.pinhole;
        Pinhole {
            fx_px: nominal.fx_px * fit.focal_ratio,
            fy_px: nominal.fy_px * fit.focal_ratio * fit.aspect,
            ..nominal
        }
    }
}

/// Intrinsics and mapping.
#[derive(Debug, Clone)]
pub struct LimbCamera {
    /// C for camera images, K_f for screen images.
    pub pinhole: Pinhole,
    /// What else is between.
    pub mapping: Mapping,
}

impl LimbCamera {
    /// A pinhole.
    pub fn pinhole(pinhole: Pinhole) -> Self {
        Self { pinhole, mapping: Mapping::Pinhole }
    }

    /// Line of sight of an image position; `None` where D cannot be inverted. A calibrated D^-1 is taken at its
    /// reference irradiance: its dependence on irradiance is that of points, not of a resolved body.
    pub fn line_of_sight(&self, pixel: DVec2) -> Option<DVec2> {
        let seen = self.pinhole.line_of_sight(pixel);
        match &self.mapping {
            Mapping::Pinhole => Some(seen),
            Mapping::Downstream(calibration) => match &calibration.inverse {
                Some(inverse) => Some(inverse.undistort(seen, inverse.reference_log10_irradiance)),
                None => calibration.distortion.undistort(seen).ok(),
            },
            Mapping::Screen(calibration) => Some(calibration.distortion.distort(seen)),
            Mapping::Stars(lens) => Some(lens.fit.corrected(lens.camera.line_of_sight(pixel)?)),
        }
    }

    /// Image position of a line of sight; `None` where D cannot be inverted.
    pub fn pixel(&self, line_of_sight: DVec2) -> Option<DVec2> {
        let seen = match &self.mapping {
            Mapping::Stars(lens) => return lens.camera.pixel(lens.fit.distorted(line_of_sight)),
            Mapping::Pinhole => line_of_sight,
            Mapping::Downstream(calibration) => calibration.distortion.distort(line_of_sight),
            Mapping::Screen(calibration) => calibration.distortion.undistort(line_of_sight).ok()?,
        };
        Some(self.pinhole.pixel(seen))
    }
}
