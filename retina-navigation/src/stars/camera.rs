//! From detected points to lines of sight.

use glam::{DVec2, DVec3};
use retina_formats::Calibration;
use retina_geometry::{Pinhole, Setup};
use retina_image::LightPoint;

/// The camera as far as it is known before an image is solved.
#[derive(Debug, Clone)]
pub struct StarCamera {
    /// Nominal intrinsics; the focal length is refined by each solution.
    pub pinhole: Pinhole,
    /// Distortion that is taken off before anything else.
    pub calibration: Option<Calibration>,
    /// The image is a mirror image: x runs to the left.
    pub mirrored: bool,
}

/// A point of light with its line of sight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StarPoint {
    /// Centroid in the image, px.
    pub pixel: DVec2,
    /// Line of sight r = (x, y) on the tangent plane, by the nominal focal length.
    pub line_of_sight: DVec2,
    /// Standard deviation of the line of sight per axis, from the image's noise, rad.
    pub sigma_rad: f64,
    /// Light, any unit.
    pub flux: f64,
    /// Its brightest pixel is saturated: `flux` is a lower bound.
    pub saturated: bool,
    /// It stands on the edge of something bright, in its texture, or on a line of light.
    pub on_edge: bool,
}

impl StarPoint {
    /// As a mirror shows it: x runs the other way.
    pub fn flipped(&self) -> Self {
        Self { line_of_sight: DVec2::new(-self.line_of_sight.x, self.line_of_sight.y), ..*self }
    }
}

impl StarCamera {
    /// A setup's camera, C of the setup, with a calibration where the images still hold the distortion.
    pub fn from_setup(setup: &Setup, calibration: Option<Calibration>) -> Self {
        Self { pinhole: setup.camera_pinhole(), calibration, mirrored: false }
    }

    /// A camera of a horizontal field (full angle, rad) and an image size.
    pub fn from_field(horizontal_field_rad: f64, [width_px, height_px]: [u32; 2]) -> Self {
        let f_px = 0.5 * f64::from(width_px) / (0.5 * horizontal_field_rad).tan();
        let pinhole = Pinhole::centred(f_px, [width_px, height_px]);
        Self { pinhole, calibration: None, mirrored: false }
    }

    /// With pixels so many times as high as wide; the horizontal focal length stays.
    pub fn with_pixel_aspect(mut self, aspect: f64) -> Self {
        self.pinhole.fy_px = self.pinhole.fx_px / aspect;
        self
    }

    /// The larger of a pixel's two angles, rad.
    pub(crate) fn pixel_rad(&self) -> f64 {
        1.0 / self.pinhole.fx_px.min(self.pinhole.fy_px)
    }

    /// D^-1(C^-1 u): the line of sight of a pixel position; `None` where D cannot be inverted. A calibrated D^-1 is
    /// taken at its reference irradiance: what a point's light is in W m^-2 is not known before it is identified.
    pub fn line_of_sight(&self, pixel: DVec2) -> Option<DVec2> {
        let seen = self.pinhole.line_of_sight(pixel);
        let mut line_of_sight = match &self.calibration {
            None => seen,
            Some(Calibration { inverse: Some(inverse), .. }) => {
                inverse.undistort(seen, inverse.reference_log10_irradiance)
            }
            Some(calibration) => calibration.distortion.undistort(seen).ok()?,
        };
        if self.mirrored {
            line_of_sight.x = -line_of_sight.x;
        }
        Some(line_of_sight)
    }

    /// The pixel position of a line of sight; `None` where there is none.
    pub fn pixel(&self, line_of_sight: DVec2) -> Option<DVec2> {
        let sign = if self.mirrored { -1.0 } else { 1.0 };
        let focal = DVec2::new(sign * self.pinhole.fx_px, self.pinhole.fy_px);
        let mut pixel = self.pinhole.pixel(DVec2::new(sign * line_of_sight.x, line_of_sight.y));
        // Distortion is a few hundredths: each pass gains more than a digit.
        for _ in 0..20 {
            let off = (line_of_sight - self.line_of_sight(pixel)?) * focal;
            pixel += off;
            if off.length_squared() < 1e-16 {
                return Some(pixel);
            }
        }
        None
    }

    /// The points of a detection, brightest first; those without a line of sight are left out, and saturated ones that
    /// the image's edge cuts: their centroid is that of the part within.
    pub fn points(&self, detected: &[LightPoint]) -> Vec<StarPoint> {
        detected
            .iter()
            .filter_map(|point| {
                let pixel = DVec2::new(point.x_px, point.y_px);
                let usable = point.flux_dn > 0.0 && point.flux_dn.is_finite() && point.sigma_px.is_finite();
                let size = DVec2::new(f64::from(self.pinhole.width_px), f64::from(self.pinhole.height_px));
                let to_edge_px = pixel.min(size - pixel).min_element();
                let cut_by_edge = point.saturated && to_edge_px < point.saturation_reach_px;
                let line_of_sight = self.line_of_sight(pixel).filter(|_| usable && !cut_by_edge)?;
                let cut_px = if point.saturated { saturation_sigma_px(point) } else { 0.0 };
                Some(StarPoint {
                    pixel,
                    line_of_sight,
                    sigma_rad: point.sigma_px.hypot(cut_px) / self.pinhole.fx_px,
                    flux: point.flux_dn,
                    saturated: point.saturated,
                    on_edge: point.on_line || point.bright_surroundings >= EDGE_SURROUNDINGS,
                })
            })
            .collect()
    }

    /// Half the image's width and height on the tangent plane, and the tangent of half its diagonal.
    pub(crate) fn half_field(&self) -> (DVec2, f64) {
        let half = DVec2::new(
            0.5 * f64::from(self.pinhole.width_px) / self.pinhole.fx_px,
            0.5 * f64::from(self.pinhole.height_px) / self.pinhole.fy_px,
        );
        (half, half.length())
    }
}

/// Standard deviation per axis of what saturation adds to a centroid, px. It cuts a spot where it is not as round as
/// higher up: the cut's reach R times the spot's ellipticity e, and the way s from the cut's middle to the centroid, say
/// by how much: sigma^2 = 0.05^2 + (0.6 e R)^2 + (0.7 s)^2. The two factors and the floor were
/// fitted to 219 saturated planets on ideal images and on the bench.
fn saturation_sigma_px(point: &LightPoint) -> f64 {
    let ellipticity = point.ellipticity.unwrap_or(LARGE_ELLIPTICITY);
    let uneven_px = (0.6 * ellipticity * point.saturation_reach_px).hypot(0.7 * point.saturation_shift_px);
    uneven_px.hypot(0.05)
}

/// Share of a point's surroundings that is bright from which it stands on an edge: a straight one has a half, a
/// neighbouring star an eighth.
const EDGE_SURROUNDINGS: f64 = 0.25;

/// Taken where a spot has no shape: as large as spots at the field's edge have it.
const LARGE_ELLIPTICITY: f64 = 0.5;

/// The unit vector (camera frame) of a line of sight.
pub fn unit(line_of_sight: DVec2) -> DVec3 {
    line_of_sight.extend(1.0).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_saturation_adds_goes_by_the_cut() {
        let point = |x_px: f64, saturated: bool| LightPoint {
            x_px,
            y_px: 50.0,
            sigma_px: 0.01,
            flux_dn: 9.0,
            peak_dn: 1.0,
            saturated,
            saturation_shift_px: 0.1,
            saturation_reach_px: 4.0,
            blended: false,
            bright_surroundings: 0.0,
            on_line: false,
            width_px: None,
            ellipticity: Some(0.2),
            snr: 100.0,
        };
        let camera = StarCamera::from_field(0.2, [200, 100]);
        let points = camera.points(&[point(60.0, true), point(62.0, false)]);
        // tan(0.1) at the edge, 100 px from the middle: 0.00100335 rad a pixel. R = 4 px: the squares of 0.01 (noise), 0.05,
        // 0.48 and 0.07 add to 0.2379.
        assert!((points[0].sigma_rad / 0.001_003_35 - 0.4877).abs() < 1e-4);
        assert!((points[1].sigma_rad / 0.001_003_35 - 0.01).abs() < 1e-4);
        assert!((points[0].line_of_sight.x - -0.040_134).abs() < 1e-6);
        // A cut of 4 px radius, 3.5 px from the image's edge: part of it is outside.
        assert_eq!(camera.points(&[point(3.5, true), point(4.5, true), point(3.5, false)]).len(), 2);
    }
}
