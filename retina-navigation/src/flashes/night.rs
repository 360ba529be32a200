//! The night side of a body in an image, from its known place and the Sun's.

use glam::{DMat3, DVec2, DVec3};
use rayon::prelude::*;
use retina_radiometry::{AU_M, sun_angular_radius_rad};

use crate::limb::LimbCamera;

/// Where a body is and how it is lit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyPose {
    /// Its centre, camera axes, m.
    pub position_camera_m: DVec3,
    /// Turns body axes into camera axes.
    pub camera_from_body: DMat3,
    /// Semi-axes of its ellipsoid, m.
    pub semi_axes_m: DVec3,
    /// Towards the Sun, camera axes, unit.
    pub sun_direction_camera: DVec3,
}

/// What is kept away from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Margins {
    /// From the limb, px: a star beside it, its spot and what is not known of the limb's height.
    pub limb_px: f64,
    /// Highest relief over its surroundings, m: beyond the terminator its summits are lit up to the angle from which a
    /// level surface no longer hides them.
    pub relief_m: f64,
    /// From what may be lit, px: the light's spread in the image.
    pub terminator_px: f64,
}

/// A place on the ellipsoid that a line of sight meets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Met {
    /// The place, body axes, m.
    pub place_body_m: DVec3,
    /// Cosine of the angle between the outward normal and the Sun.
    pub cos_incidence: f64,
    /// Distance of the line of sight from the centre over that of a line that grazes the ellipsoid.
    pub off_centre: f64,
}

impl BodyPose {
    /// Where a line of sight r = (x, y) meets the ellipsoid first.
    pub fn meet(&self, line_of_sight: DVec2) -> Option<Met> {
        let body_from_camera = self.camera_from_body.transpose();
        // In the space in which the ellipsoid is the unit sphere.
        let origin = body_from_camera * -self.position_camera_m / self.semi_axes_m;
        let direction = body_from_camera * line_of_sight.extend(1.0) / self.semi_axes_m;
        let square = direction.length_squared();
        let nearest = -origin.dot(direction) / square;
        let off_centre = (origin + direction * nearest).length();
        if off_centre >= 1.0 || nearest <= 0.0 {
            return None;
        }
        let unit = origin + direction * (nearest - ((1.0 - off_centre * off_centre) / square).sqrt());
        let normal = (unit / self.semi_axes_m).normalize();
        let sun_body = body_from_camera * self.sun_direction_camera;
        Some(Met { place_body_m: unit * self.semi_axes_m, cos_incidence: normal.dot(sun_body), off_centre })
    }

    /// Radius of its disc, px of a camera.
    fn radius_px(&self, camera: &LimbCamera) -> f64 {
        let radius_m = (self.semi_axes_m.x * self.semi_axes_m.y * self.semi_axes_m.z).cbrt();
        camera.pinhole.fx_px * radius_m / self.position_camera_m.length()
    }

    /// Greatest cosine of the incidence angle on a surface that is dark for certain. Relief of height h is lit up to
    /// acos(R / (R + h)) beyond the terminator of a sphere R, the Sun's radius further; a pixel stands for 1 / R_px.
    pub fn darkest_cos(&self, camera: &LimbCamera, margins: &Margins) -> f64 {
        let radius_m = self.semi_axes_m.min_element();
        let relief = (radius_m / (radius_m + margins.relief_m)).acos();
        let spread = margins.terminator_px / self.radius_px(camera);
        -(relief + sun_angular_radius_rad(AU_M) + spread).sin()
    }
}

/// Pixels between the places whose lines of sight are computed; between them they are linear. D bends by less than
/// 1e-6 px over so few.
const STEP_PX: usize = 16;

/// Of each pixel, row by row, whether it shows the night side within the margins. The spread of light in the image is
/// taken along the surface; where the terminator runs near the limb it is foreshortened, and the limb's margin holds.
pub fn night_mask(camera: &LimbCamera, pose: &BodyPose, margins: &Margins) -> Vec<bool> {
    let (width, height) = (camera.pinhole.width_px as usize, camera.pinhole.height_px as usize);
    let darkest = pose.darkest_cos(camera, margins);
    let inside = 1.0 - margins.limb_px / pose.radius_px(camera);
    let columns = width.div_ceil(STEP_PX) + 1;
    let sights: Vec<Option<DVec2>> = (0..columns * (height.div_ceil(STEP_PX) + 1))
        .into_par_iter()
        .map(|at| {
            let node = DVec2::new((at % columns * STEP_PX) as f64, (at / columns * STEP_PX) as f64);
            camera.line_of_sight(node)
        })
        .collect();
    let mut mask = vec![false; width * height];
    mask.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        let (above, down) = (y / STEP_PX, ((y % STEP_PX) as f64 + 0.5) / STEP_PX as f64);
        for (x, dark) in row.iter_mut().enumerate() {
            let (before, right) = (x / STEP_PX, ((x % STEP_PX) as f64 + 0.5) / STEP_PX as f64);
            let node = |c: usize, r: usize| sights[(above + r) * columns + before + c];
            let (Some(a), Some(b), Some(c), Some(d)) = (node(0, 0), node(1, 0), node(0, 1), node(1, 1))
            else {
                continue;
            };
            let sight = a.lerp(b, right).lerp(c.lerp(d, right), down);
            *dark =
                pose.meet(sight).is_some_and(|met| met.off_centre < inside && met.cos_incidence < darkest);
        }
    });
    mask
}

#[cfg(test)]
mod tests {
    use super::*;
    use retina_geometry::Pinhole;

    /// A Moon of 200 px radius on the boresight, so far away that there is no perspective; the Sun on the right, `phase`
    /// from behind the camera.
    fn half(phase_deg: f64) -> (LimbCamera, BodyPose) {
        let pinhole =
            Pinhole { fx_px: 1e7, fy_px: 1e7, cx_px: 256.0, cy_px: 256.0, width_px: 512, height_px: 512 };
        let (sin, cos) = phase_deg.to_radians().sin_cos();
        let pose = BodyPose {
            position_camera_m: DVec3::new(0.0, 0.0, 50_000.0 * 1_737_400.0),
            camera_from_body: DMat3::IDENTITY,
            semi_axes_m: DVec3::splat(1_737_400.0),
            sun_direction_camera: DVec3::new(sin, 0.0, -cos),
        };
        (LimbCamera::pinhole(pinhole), pose)
    }

    #[test]
    fn without_margins_the_night_is_its_share_of_the_disc() {
        // A disc at phase a is dark over (1 - cos a) / 2 of its area: 0.067, 0.5, 0.933.
        let margins = Margins { limb_px: 0.0, relief_m: 0.0, terminator_px: 0.0 };
        for phase_deg in [30f64, 90.0, 150.0] {
            let (camera, pose) = half(phase_deg);
            let dark = night_mask(&camera, &pose, &margins).iter().filter(|dark| **dark).count() as f64;
            let disc = std::f64::consts::PI * 200f64.powi(2);
            let expected = 0.5 * (1.0 - phase_deg.to_radians().cos());
            // The Sun's radius of 0.27 deg moves the terminator by 0.9 px over 400: 0.3 % of the disc.
            assert!((dark / disc - expected).abs() < 0.005, "{phase_deg} {}", dark / disc);
        }
    }

    #[test]
    fn margins_keep_away_from_limb_and_lit_summits() {
        let (camera, pose) = half(90.0);
        let margins = Margins { limb_px: 10.0, relief_m: 8000.0, terminator_px: 5.0 };
        let mask = night_mask(&camera, &pose, &margins);
        // acos(R / (R + 8 km)) = 5.49 deg, 0.27 deg of the Sun, 5 / 200 rad: 7.19 deg are 25.0 px from the middle.
        let middle: Vec<usize> = (0..512).filter(|x| mask[256 * 512 + x]).collect();
        assert!((middle[0] as f64 - (256.0 - 190.0)).abs() <= 1.5, "{}", middle[0]);
        assert!((*middle.last().unwrap() as f64 - (256.0 - 25.0)).abs() <= 1.5, "{middle:?}");
    }

    #[test]
    fn a_place_is_met_where_the_sphere_is() {
        let (_, pose) = half(90.0);
        // 100 px off the centre of a disc of 200 px: the sine of the angle at the centre is a half.
        let met = pose.meet(DVec2::new(1e-5, 0.0)).unwrap();
        assert!((met.place_body_m.length() / 1_737_400.0 - 1.0).abs() < 1e-9);
        assert!((met.place_body_m.x / 1_737_400.0 - 0.5).abs() < 1e-4 && met.place_body_m.z < 0.0);
        assert!((met.cos_incidence - met.place_body_m.x / 1_737_400.0).abs() < 1e-9);
        assert!(pose.meet(DVec2::new(2.01e-5, 0.0)).is_none());
    }
}
