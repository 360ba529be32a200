//! Stars and planets on the screen.

use glam::DVec2;
use retina_geometry::{Distortion, InverseDistortion, Pinhole};
use retina_radiometry::ScreenResponse;

use crate::Splat;
use crate::splat::Ground;

/// Draws point sources into the counts of a screen image.
#[derive(Debug, Clone)]
pub struct PointPainter {
    response: ScreenResponse,
    image: Pinhole,
    distortion: Option<Distortion>,
    inverse: Option<InverseDistortion>,
}

/// A point source that is on the screen.
#[derive(Debug, Clone, PartialEq)]
pub struct Shown {
    /// The lit pixels, and the position and irradiance that they have by themselves.
    pub splat: Splat,
    /// Some of its pixels also carry other light.
    pub blended: bool,
}

impl PointPainter {
    /// For K_f, the distortion that is compensated beforehand, if any, and the screen's response.
    pub fn new(image: Pinhole, distortion: Option<Distortion>, response: ScreenResponse) -> Self {
        Self { response, image, distortion, inverse: None }
    }

    /// With the calibrated D^-1, which places each point by its own irradiance.
    pub fn with_inverse(self, inverse: Option<InverseDistortion>) -> Self {
        Self { inverse, ..self }
    }

    /// Where the screen shows a line of sight r of an irradiance (W m^-2 nm^-1 at the pupil): K_f D^-1(r), px; `None`
    /// where D has no inverse. A calibrated D^-1 takes the irradiance relative to a white pixel at full count, held
    /// within the range that was calibrated: fainter and brighter points are placed like those at its ends.
    pub fn screen_px(&self, line_of_sight: DVec2, irradiance_w_m2_nm: f64) -> Option<DVec2> {
        let undistorted = match (&self.distortion, &self.inverse) {
            (None, _) => line_of_sight,
            (Some(_), Some(inverse)) => {
                let relative = irradiance_w_m2_nm / self.response.brightest_w_m2_nm();
                inverse.undistort(line_of_sight, inverse.held(relative.log10()))
            }
            (Some(distortion), None) => distortion.undistort(line_of_sight).ok()?,
        };
        Some(self.image.pixel(undistorted))
    }

    /// Whether a position is on the screen.
    pub fn contains(&self, at_px: DVec2) -> bool {
        let size = DVec2::new(f64::from(self.image.width_px), f64::from(self.image.height_px));
        at_px.cmpge(DVec2::ZERO).all() && at_px.cmplt(size).all()
    }

    /// Solid angle of the pixel centred at `center_px`, one on the boresight without distortion = 1.
    ///
    /// r = D(K_f^-1 R), dOmega = det(dD/dr_u) / (f_x f_y) / (1 + |r|^2)^(3/2): a pixel of equal
    /// radiance sends that much less into the pupil, off axis.
    pub fn relative_sr(&self, center_px: DVec2) -> f64 {
        let undistorted = self.image.line_of_sight(center_px);
        let (sight, determinant) = match &self.distortion {
            None => (undistorted, 1.0),
            Some(d) => (d.distort(undistorted), d.jacobian(undistorted).determinant()),
        };
        determinant / (1.0 + sight.length_squared()).powf(1.5)
    }

    /// What an image of radiance (W m^-2 sr^-1 nm^-1, the screen's pixels) sends into the pupil as a whole,
    /// W m^-2 nm^-1: the sum of radiance times the pixels' solid angles.
    pub fn irradiance_w_m2_nm(&self, radiance: &[f32]) -> f64 {
        let width = self.image.width_px as usize;
        let light = |(at, &value): (usize, &f32)| {
            let center = DVec2::new((at % width) as f64 + 0.5, (at / width) as f64 + 0.5);
            f64::from(value) * self.relative_sr(center)
        };
        let lit = radiance.iter().enumerate().filter(|(_, value)| **value != 0.0);
        lit.map(light).sum::<f64>() * self.image.boresight_pixel_sr()
    }

    /// Adds a source of an irradiance (W m^-2 nm^-1 at the pupil) to a screen image's counts, where
    /// they are dark by counts of its own, where they are lit by the count nearest to the sum.
    /// `None`: it is off the screen, too dim for it, or lost in light that is there.
    pub fn draw(&self, counts: &mut [u8], at_px: DVec2, irradiance_w_m2_nm: f64) -> Option<Shown> {
        let Pinhole { width_px, height_px, .. } = self.image;
        let ground = Ground { response: &self.response, width_px, height_px };
        let splat = ground.splat(at_px, irradiance_w_m2_nm, |center| self.relative_sr(center))?;
        let (mut blended, mut seen) = (false, false);
        for lit in &splat.pixels {
            let count = &mut counts[lit.row as usize * width_px as usize + lit.column as usize];
            let before = *count;
            if before == 0 {
                *count = lit.count;
            } else {
                blended = true;
                let both = [before, lit.count].map(|b| self.response.irradiance_w_m2_nm([b; 3]));
                *count = self.response.nearest_count((both[0] + both[1]) as f32);
            }
            seen |= *count != before;
        }
        seen.then_some(Shown { splat, blended })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use retina_radiometry::irradiance_of_magnitude_w_m2_nm;

    fn wide() -> Pinhole {
        Pinhole { fx_px: 5661.2, fy_px: 5661.2, cx_px: 960.0, cy_px: 600.0, width_px: 1920, height_px: 1200 }
    }

    #[test]
    fn a_corner_pixel_subtends_less_sky() {
        // cos^3 of the angle off axis: tan = 1132.1 / 5661.2, so (1 + 0.03999)^-1.5 = 0.9429.
        let painter = PointPainter::new(wide(), None, ScreenResponse::power_law(2.2, -1.44));
        assert!((painter.relative_sr(DVec2::new(960.0, 600.0)) - 1.0).abs() < 1e-12);
        assert!((painter.relative_sr(DVec2::ZERO) - 0.9429).abs() < 1e-4);
    }

    #[test]
    fn solid_angles_under_distortion_are_those_of_the_pixels_quadrangles() {
        let distortion = Distortion::brown(0.4, 2e-3, -1e-3);
        let painter =
            PointPainter::new(wide(), Some(distortion.clone()), ScreenResponse::power_law(2.2, -1.44));
        for center in [DVec2::new(100.5, 90.5), DVec2::new(1800.5, 400.5)] {
            // The area of the quadrangle of unit vectors through the pixel's corners.
            let corner = |dx: f64, dy: f64| {
                let sight = distortion.distort(wide().line_of_sight(center + DVec2::new(dx, dy)));
                sight.extend(1.0).normalize()
            };
            let (a, b, c, d) = (corner(-0.5, -0.5), corner(0.5, -0.5), corner(0.5, 0.5), corner(-0.5, 0.5));
            let area = 0.5 * (c - a).cross(d - b).length() * 5661.2f64.powi(2);
            assert!((painter.relative_sr(center) / area - 1.0).abs() < 1e-5);
        }
    }

    #[test]
    fn a_point_is_placed_by_its_own_irradiance_within_the_calibrated_range() {
        // x gains 0.001 L; one pixel of the wide configuration is 1 / 5661.2, so 5.6612 px a decade.
        let inverse = InverseDistortion {
            rings: None,
            field: None,
            terms: vec![([1, 0, 0], DVec2::X), ([0, 1, 0], DVec2::Y), ([0, 0, 1], DVec2::new(1e-3, 0.0))],
            reference_log10_irradiance: 0.0,
            range_log10_irradiance: [-2.0, 0.0],
        };
        let response = ScreenResponse::power_law(2.2, -1.44);
        let full = response.brightest_w_m2_nm();
        let painter =
            PointPainter::new(wide(), Some(Distortion::identity()), response).with_inverse(Some(inverse));
        let x = |relative: f64| painter.screen_px(DVec2::ZERO, relative * full).unwrap().x - 960.0;
        for (relative, expected) in
            [(1.0, 0.0), (0.1, -5.6612), (1e-2, -11.3224), (1e-4, -11.3224), (10.0, 0.0)]
        {
            assert!((x(relative) - expected).abs() < 1e-9, "{relative}: {}", x(relative));
        }
    }

    #[test]
    fn two_stars_in_one_pixel_add_their_light() {
        let response = ScreenResponse::power_law(2.2, -1.44);
        let painter = PointPainter::new(wide(), None, response.clone());
        let mut counts = vec![0; 1920 * 1200];
        let at = DVec2::new(960.5, 600.5);
        let star = irradiance_of_magnitude_w_m2_nm(4.0);
        assert!(!painter.draw(&mut counts, at, star).unwrap().blended);
        assert!(painter.draw(&mut counts, at, star).unwrap().blended);
        let total: f64 = counts.iter().map(|&b| response.irradiance_w_m2_nm([b; 3])).sum();
        assert!((total / (2.0 * star) - 1.0).abs() < 0.05);
        // Full light has no room for it: nothing of it shows.
        counts.fill(255);
        assert!(painter.draw(&mut counts, at, star).is_none());
    }
}
