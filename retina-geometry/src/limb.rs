//! The outline of a sphere or ellipsoid in a pinhole image: an ellipse, in closed form.

use glam::{DMat2, DMat3, DVec2, DVec3};

use crate::Pinhole;

/// An ellipse in an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LimbEllipse {
    /// Centre, pixels.
    pub center_px: DVec2,
    /// Major and minor semi-axis, pixels.
    pub semi_axes_px: [f64; 2],
    /// Angle of the major axis from +x towards +y, rad, in (-pi/2, pi/2].
    pub angle_rad: f64,
}

/// Outline of the ellipsoid with semi-axes `semi_axes_m` along the body axes, centred at
/// `position_camera_m`, `camera_from_body` turning body axes into camera axes.
///
/// A line of sight d touches the ellipsoid (X - P)^T A (X - P) = 1 where
/// d^T [A P P^T A - (P^T A P - 1) A] d = 0; with d = K^-1 u this is a conic in the image
/// (Christian and Robinson 2016, eqs. for the horizon locus). `None` where the conic is not an
/// ellipse in front of the camera: the camera is inside, or the outline crosses its plane.
pub fn limb_ellipse(
    image: &Pinhole,
    position_camera_m: DVec3,
    camera_from_body: DMat3,
    semi_axes_m: DVec3,
) -> Option<LimbEllipse> {
    let p = position_camera_m;
    // Scaled by the largest semi-axis, so that the terms are of the order of one.
    let scale = semi_axes_m.max_element();
    let (p, axes) = (p / scale, semi_axes_m / scale);
    let a = camera_from_body * DMat3::from_diagonal((axes * axes).recip()) * camera_from_body.transpose();
    let ap = a * p;
    let depth = p.dot(ap) - 1.0;
    if p.z <= 0.0 || depth <= 0.0 {
        return None;
    }
    let outer = DMat3::from_cols(ap * ap.x, ap * ap.y, ap * ap.z);
    let cone = outer - a * depth;
    // u measured from the projected centre, in units of the focal length: keeps the digits.
    let origin = DVec2::new(p.x, p.y) / p.z;
    let shift = DMat3::from_cols(DVec3::X, DVec3::Y, DVec3::new(origin.x, origin.y, 1.0));
    let c = shift.transpose() * cone * shift;
    let quadratic = DMat2::from_cols(c.x_axis.truncate(), c.y_axis.truncate());
    let linear = DVec2::new(c.z_axis.x, c.z_axis.y);
    let determinant = quadratic.determinant();
    // The whole outline is in front of the camera exactly when the conic is an ellipse.
    if determinant <= 0.0 || quadratic.x_axis.x >= 0.0 {
        return None;
    }
    let center = -(quadratic.inverse() * linear);
    let level = c.z_axis.z + linear.dot(center);
    // In pixels: x = f_x * tangent-plane coordinate, so the quadratic form is divided by f_i f_j.
    let f = DVec2::new(image.fx_px, image.fy_px);
    let q = [
        -quadratic.x_axis.x / (level * f.x * f.x),
        -quadratic.x_axis.y / (level * f.x * f.y),
        -quadratic.y_axis.y / (level * f.y * f.y),
    ];
    let mean = (q[0] + q[2]) / 2.0;
    let radius = ((q[0] - q[2]) / 2.0).hypot(q[1]);
    let (small, large) = (mean - radius, mean + radius);
    if !(small > 0.0 && large.is_finite()) {
        return None;
    }
    // The eigenvector of the smaller eigenvalue is the major axis.
    let mut angle_rad = 0.5 * (-2.0 * q[1]).atan2(q[2] - q[0]);
    if angle_rad <= -std::f64::consts::FRAC_PI_2 {
        angle_rad += std::f64::consts::PI;
    }
    Some(LimbEllipse {
        center_px: image.pixel(origin + center),
        semi_axes_px: [1.0 / small.sqrt(), 1.0 / large.sqrt()],
        angle_rad,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    const IMAGE: Pinhole =
        Pinhole { fx_px: 5661.0, fy_px: 5400.0, cx_px: 900.0, cy_px: 610.0, width_px: 1920, height_px: 1200 };

    /// Distance of an image point from the ellipse's equation, dimensionless (0 on it).
    fn off(ellipse: &LimbEllipse, point: DVec2) -> f64 {
        let local = DVec2::from_angle(-ellipse.angle_rad).rotate(point - ellipse.center_px);
        (local / DVec2::from_array(ellipse.semi_axes_px)).length() - 1.0
    }

    #[test]
    fn centred_sphere_has_radius_f_tan_asin() {
        let (r, d) = (1_737_400.0, 4.0e7);
        let image = Pinhole { fy_px: 5661.0, ..IMAGE };
        let ellipse =
            limb_ellipse(&image, DVec3::new(0.0, 0.0, d), DMat3::IDENTITY, DVec3::splat(r)).unwrap();
        let expected = 5661.0 * (r / d).asin().tan();
        assert!((ellipse.semi_axes_px[0] - expected).abs() < 1e-9);
        assert!((ellipse.semi_axes_px[1] - expected).abs() < 1e-9);
    }

    #[test]
    fn every_tangent_ray_of_an_ellipsoid_lies_on_the_ellipse() {
        let rotation = DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -0.7, 1.1);
        let camera_from_body = DMat3::from_quat(rotation);
        let axes = DVec3::new(17_000.0, 8_000.0, 6_000.0);
        let p = DVec3::new(9_000.0, -15_000.0, 200_000.0);
        let ellipse = limb_ellipse(&IMAGE, p, camera_from_body, axes).unwrap();
        // Independent: in the space where the ellipsoid is the unit sphere, tangent points X obey
        // X . C = 1 for the camera at C.
        let to_unit = |v: DVec3| camera_from_body.transpose() * v / axes;
        let c = to_unit(-p);
        let (u, v) = c.normalize().any_orthonormal_pair();
        let height = 1.0 / c.length();
        for k in 0..16 {
            let angle = f64::from(k) * 0.4;
            let x =
                c.normalize() * height + (u * angle.cos() + v * angle.sin()) * (1.0 - height * height).sqrt();
            let point_camera = camera_from_body * (x * axes) + p;
            assert!(off(&ellipse, IMAGE.project(point_camera).unwrap()).abs() < 1e-10);
        }
        assert!(ellipse.semi_axes_px[0] >= ellipse.semi_axes_px[1]);
    }

    #[test]
    fn no_ellipse_from_inside_or_behind() {
        let sphere =
            |z: f64| limb_ellipse(&IMAGE, DVec3::new(0.0, 0.0, z), DMat3::IDENTITY, DVec3::splat(2.0));
        assert!(sphere(1.0).is_none() && sphere(-9.0).is_none() && sphere(9.0).is_some());
    }
}
