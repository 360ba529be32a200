//! Attitude, focal length and radial distortion from identified stars: weighted least squares.

use faer::linalg::solvers::Solve as _;
use faer::{Mat, Side};
use glam::{DQuat, DVec2, DVec3};

/// An identified star.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sighting {
    /// Measured line of sight, by the nominal focal length.
    pub(crate) measured: DVec2,
    /// Apparent direction, inertial axes.
    pub(crate) direction: DVec3,
    /// Standard deviation per axis, rad.
    pub(crate) sigma_rad: f64,
}

/// What maps the sky onto the image: m = s (1 + k1 |p|^2) p, where p is the pinhole's line of sight of a direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SkyFit {
    /// Attitude.
    pub camera_from_inertial: DQuat,
    /// s: true over nominal focal length.
    pub focal_ratio: f64,
    /// Radial distortion that the nominal camera does not know.
    pub k1: f64,
}

/// Covariance of what is fitted: three of the attitude, focal ratio, k1.
pub(crate) type Covariance = [[f64; 5]; 5];

/// Which of the camera's parameters are fitted besides the attitude.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Free {
    /// The focal length.
    Focal,
    /// And radial distortion.
    Radial,
}

impl Free {
    pub(crate) fn parameters(self) -> usize {
        match self {
            Self::Focal => 4,
            Self::Radial => 5,
        }
    }
}

impl SkyFit {
    /// The measured line of sight of a direction; `None` behind the camera.
    pub fn project(&self, direction: DVec3) -> Option<DVec2> {
        let v = self.camera_from_inertial * direction;
        // Beyond 80 deg from the boresight the tangent plane is of no use.
        (v.z > 0.17).then(|| self.distorted(v.truncate() / v.z))
    }

    fn distorted(&self, p: DVec2) -> DVec2 {
        p * (self.focal_ratio * (1.0 + self.k1 * p.length_squared()))
    }

    /// The pinhole's line of sight of a measured one.
    pub fn corrected(&self, measured: DVec2) -> DVec2 {
        let scaled = measured / self.focal_ratio;
        let mut p = scaled;
        // k1 |p|^2 is a few hundredths at most: each pass gains more than a digit.
        for _ in 0..12 {
            p = scaled / (1.0 + self.k1 * p.length_squared());
        }
        p
    }

    /// Improves the fit by Gauss-Newton steps; returns it with its covariance (attitude as a rotation vector along
    /// camera axes in rad, focal ratio, k1; zero what is not fitted), `None` where the stars do not determine it.
    pub(crate) fn refined(
        mut self,
        sightings: &[Sighting],
        free: Free,
        steps: usize,
    ) -> Option<(Self, Covariance)> {
        let n = free.parameters();
        let mut covariance = [[0.0; 5]; 5];
        for step in 0..steps {
            let (mut normal, mut right) = ([[0.0f64; 5]; 5], [0.0f64; 5]);
            for sighting in sightings {
                let v = self.camera_from_inertial * sighting.direction;
                if v.z < 0.17 {
                    return None;
                }
                let p = v.truncate() / v.z;
                let error = sighting.measured - self.distorted(p);
                let weight = 1.0 / (sighting.sigma_rad * sighting.sigma_rad);
                for (row, error) in self.rows(p).iter().zip(error.to_array()) {
                    for i in 0..n {
                        right[i] += weight * row[i] * error;
                        for j in 0..n {
                            normal[i][j] += weight * row[i] * row[j];
                        }
                    }
                }
            }
            let llt = Mat::from_fn(n, n, |i, j| normal[i][j]).llt(Side::Lower).ok()?;
            let change = llt.solve(Mat::from_fn(n, 1, |i, _| right[i]));
            let turn = DVec3::new(change[(0, 0)], change[(1, 0)], change[(2, 0)]);
            if !(turn.is_finite() && turn.length() < 0.2) {
                return None;
            }
            self.camera_from_inertial =
                (DQuat::from_scaled_axis(turn) * self.camera_from_inertial).normalize();
            self.focal_ratio += change[(3, 0)];
            if n > 4 {
                self.k1 += change[(4, 0)];
            }
            if step + 1 == steps {
                let inverse = llt.solve(Mat::<f64>::identity(n, n));
                for i in 0..n {
                    for j in 0..n {
                        covariance[i][j] = inverse[(i, j)];
                    }
                }
            }
        }
        (self.focal_ratio > 0.0 && self.focal_ratio.is_finite()).then_some((self, covariance))
    }

    /// Derivatives of the distorted line of sight by a rotation vector along camera axes, the focal ratio and k1.
    pub(crate) fn rows(&self, p: DVec2) -> [[f64; 5]; 2] {
        let (x, y, r2) = (p.x, p.y, p.length_squared());
        let turn = [[-x * y, 1.0 + x * x, -y], [-(1.0 + y * y), x * y, x]];
        let radial = 1.0 + self.k1 * r2;
        let mut rows = [[0.0; 5]; 2];
        for column in 0..3 {
            let d = [turn[0][column], turn[1][column]];
            let along = 2.0 * self.k1 * (x * d[0] + y * d[1]);
            rows[0][column] = self.focal_ratio * (radial * d[0] + along * x);
            rows[1][column] = self.focal_ratio * (radial * d[1] + along * y);
        }
        for (row, value) in rows.iter_mut().zip([x, y]) {
            row[3] = radial * value;
            row[4] = self.focal_ratio * r2 * value;
        }
        rows
    }

    /// The angle between a measured line of sight and a direction's, as a vector along x and y, rad.
    pub(crate) fn residual(&self, measured: DVec2, direction: DVec3) -> DVec2 {
        let v = self.camera_from_inertial * direction;
        let u = self.corrected(measured).extend(1.0).normalize();
        let across = (u - v * u.dot(v)).truncate();
        // The small angle's length is the great-circle one; its z part is shared out along it.
        let full = u.cross(v).length().atan2(u.dot(v));
        across.try_normalize().map_or(DVec2::ZERO, |d| d * full)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Sightings of a known camera: the oracle is the model's own definition, m = s (1 + k1 |p|^2) p.
    fn sightings(truth: &SkyFit, count: usize) -> Vec<Sighting> {
        let inertial_from_camera = truth.camera_from_inertial.inverse();
        (0..count)
            .map(|i| {
                let p = DVec2::new(((i * 37) % 19) as f64 - 9.0, ((i * 53) % 23) as f64 - 11.0) * 0.014;
                let m = p * truth.focal_ratio * (1.0 + truth.k1 * p.length_squared());
                let direction = inertial_from_camera * p.extend(1.0).normalize();
                Sighting { measured: m, direction, sigma_rad: 1e-5 }
            })
            .collect()
    }

    proptest! {
        #[test]
        fn a_known_camera_comes_back(angle in 0.0_f64..3.0, s in 0.97_f64..1.03, k1 in -0.2_f64..0.2, off in -0.01_f64..0.01) {
            let truth = SkyFit {
                camera_from_inertial: DQuat::from_scaled_axis(DVec3::new(0.3, -0.5, 1.0) * angle),
                focal_ratio: s,
                k1,
            };
            let start = SkyFit {
                camera_from_inertial: DQuat::from_scaled_axis(DVec3::new(off, -off, off)) * truth.camera_from_inertial,
                focal_ratio: 1.0,
                k1: 0.0,
            };
            let seen = sightings(&truth, 30);
            let (found, _) = start.refined(&seen, Free::Radial, 8).unwrap();
            prop_assert!((found.focal_ratio - s).abs() < 1e-9 && (found.k1 - k1).abs() < 1e-6);
            prop_assert!((found.camera_from_inertial * DVec3::ONE - truth.camera_from_inertial * DVec3::ONE).length() < 1e-9);
            let back = found.corrected(seen[3].measured);
            let v = truth.camera_from_inertial * seen[3].direction;
            prop_assert!((back - v.truncate() / v.z).length() < 1e-9);
            prop_assert!(found.residual(seen[5].measured, seen[5].direction).length() < 1e-8);
        }
    }

    #[test]
    fn the_derivatives_are_differences() {
        let fit = SkyFit { camera_from_inertial: DQuat::from_rotation_x(0.4), focal_ratio: 1.02, k1: -0.3 };
        let p = DVec2::new(0.15, -0.09);
        let direction = fit.camera_from_inertial.inverse() * p.extend(1.0).normalize();
        let (rows, step) = (fit.rows(p), 1e-6);
        for column in 0..5 {
            let moved = |sign: f64| {
                let mut turn = DVec3::ZERO;
                let mut other = fit;
                match column {
                    3 => other.focal_ratio += sign * step,
                    4 => other.k1 += sign * step,
                    axis => turn[axis] = sign * step,
                }
                other.camera_from_inertial = DQuat::from_scaled_axis(turn) * fit.camera_from_inertial;
                other.project(direction).unwrap()
            };
            let difference = (moved(1.0) - moved(-1.0)) / (2.0 * step);
            // Rounding: 1e-16 over the step.
            assert!((difference - DVec2::new(rows[0][column], rows[1][column])).length() < 1e-8, "{column}");
        }
    }

    #[test]
    fn about_boresight_is_worse_than_across_by_the_fields_half_width() {
        // n stars at radius r of the boresight, sigma each: cross-boresight variance sigma^2 / n, about-boresight
        // sigma^2 / (n r^2) (closed form for a ring, small angles).
        let (n, r, sigma) = (40, 0.1, 1e-5);
        let ring: Vec<Sighting> = (0..n)
            .map(|i| {
                let p = DVec2::from_angle(i as f64 / n as f64 * std::f64::consts::TAU) * r;
                Sighting { measured: p, direction: p.extend(1.0).normalize(), sigma_rad: sigma }
            })
            .collect();
        let start = SkyFit { camera_from_inertial: DQuat::IDENTITY, focal_ratio: 1.0, k1: 0.0 };
        let (_, covariance) = start.refined(&ring, Free::Focal, 2).unwrap();
        let [across, about] = [covariance[0][0], covariance[2][2]].map(f64::sqrt);
        // (1 + y^2) in the derivative: 1 % at r = 0.1.
        assert!((across / (sigma / (n as f64).sqrt()) - 1.0).abs() < 0.01, "{across}");
        assert!((about / (sigma / (n as f64).sqrt() / r) - 1.0).abs() < 1e-6, "{about}");
    }
}
