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

/// What maps the sky onto the image. With the pinhole's line of sight p = (x, y) of a direction and r = |p|,
///
/// q = (1 + k1 r^2 + k2 r^4 + k3 r^6) p + (2 p1 x y + p2 (r^2 + 2 x^2), p1 (r^2 + 2 y^2) + 2 p2 x y),
/// m = s (q.x, a q.y)
///
/// (Brown 1966, with the names of OpenCV); m is the measured line of sight by the nominal focal length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SkyFit {
    /// Attitude.
    pub camera_from_inertial: DQuat,
    /// s: true over nominal focal length.
    pub focal_ratio: f64,
    /// k1: radial distortion that the nominal camera does not know.
    pub k1: f64,
    /// k2, k3, p1, p2: higher radial distortion and what is not radial.
    pub higher: [f64; 4],
    /// a: how much larger the image's y is than nominal, beyond s.
    pub aspect: f64,
}

/// Three of the attitude, focal ratio, k1, k2, k3, p1, p2, aspect.
pub(crate) const COLUMNS: usize = 10;
/// Covariance of what is fitted, by columns; zero what is not fitted.
pub(crate) type Covariance = [[f64; COLUMNS]; COLUMNS];

/// How distortion is fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Distortion {
    /// Not at all.
    None,
    /// k1.
    Radial,
    /// k1, k2, k3, p1 and p2.
    Full,
}

/// Which of the camera's parameters are fitted besides the attitude and the focal length.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Free {
    pub(crate) distortion: Distortion,
    pub(crate) aspect: bool,
}

impl Free {
    fn columns(self) -> Vec<usize> {
        let last = match self.distortion {
            Distortion::None => 4,
            Distortion::Radial => 5,
            Distortion::Full => 9,
        };
        (0..last).chain(self.aspect.then_some(COLUMNS - 1)).collect()
    }

    pub(crate) fn parameters(self) -> usize {
        self.columns().len()
    }
}

impl SkyFit {
    /// An attitude and a focal ratio, without distortion.
    pub(crate) fn pinhole(camera_from_inertial: DQuat, focal_ratio: f64) -> Self {
        Self { camera_from_inertial, focal_ratio, k1: 0.0, higher: [0.0; 4], aspect: 1.0 }
    }

    /// The measured line of sight of a direction; `None` behind the camera.
    pub fn project(&self, direction: DVec3) -> Option<DVec2> {
        let v = self.camera_from_inertial * direction;
        // Beyond 80 deg from the boresight the tangent plane is of no use.
        (v.z > 0.17).then(|| self.distorted(v.truncate() / v.z))
    }

    /// The measured line of sight of a pinhole's.
    pub fn distorted(&self, p: DVec2) -> DVec2 {
        let q = p * self.radial(p) + self.sideways(p);
        DVec2::new(q.x, self.aspect * q.y) * self.focal_ratio
    }

    fn radial(&self, p: DVec2) -> f64 {
        let r2 = p.length_squared();
        1.0 + r2 * (self.k1 + r2 * (self.higher[0] + r2 * self.higher[1]))
    }

    fn sideways(&self, p: DVec2) -> DVec2 {
        let [_, _, p1, p2] = self.higher;
        let (r2, xy) = (p.length_squared(), 2.0 * p.x * p.y);
        DVec2::new(p1 * xy + p2 * (r2 + 2.0 * p.x * p.x), p1 * (r2 + 2.0 * p.y * p.y) + p2 * xy)
    }

    /// The pinhole's line of sight of a measured one.
    pub fn corrected(&self, measured: DVec2) -> DVec2 {
        let q = DVec2::new(measured.x, measured.y / self.aspect) / self.focal_ratio;
        let mut p = q;
        // Distortion is a few hundredths at most: each pass gains more than a digit.
        for _ in 0..30 {
            let next = (q - self.sideways(p)) / self.radial(p);
            let moved = next.distance_squared(p);
            p = next;
            if moved < 1e-26 {
                break;
            }
        }
        p
    }

    /// Improves the fit by Gauss-Newton steps; returns it with its covariance (attitude as a rotation vector along
    /// camera axes in rad), `None` where the stars do not determine it.
    pub(crate) fn refined(
        mut self,
        sightings: &[Sighting],
        free: Free,
        steps: usize,
    ) -> Option<(Self, Covariance)> {
        let columns = free.columns();
        let n = columns.len();
        let mut covariance = [[0.0; COLUMNS]; COLUMNS];
        for step in 0..steps {
            let mut normal = [[0.0f64; COLUMNS]; COLUMNS];
            let mut right = [0.0f64; COLUMNS];
            for sighting in sightings {
                let v = self.camera_from_inertial * sighting.direction;
                if v.z < 0.17 {
                    return None;
                }
                let p = v.truncate() / v.z;
                let error = sighting.measured - self.distorted(p);
                let weight = 1.0 / (sighting.sigma_rad * sighting.sigma_rad);
                for (row, error) in self.rows(p).iter().zip(error.to_array()) {
                    for (i, &column) in columns.iter().enumerate() {
                        let weighted = weight * row[column];
                        right[i] += weighted * error;
                        for (j, &other) in columns[..=i].iter().enumerate() {
                            normal[i][j] += weighted * row[other];
                        }
                    }
                }
            }
            // High powers of a small radius: columns of one size, lest rounding decide.
            let scale: [f64; COLUMNS] = std::array::from_fn(|i| normal[i][i].sqrt());
            if scale[..n].iter().any(|scale| !(scale.is_finite() && *scale > 0.0)) {
                return None;
            }
            let scaled = |i: usize, j: usize| normal[i.max(j)][i.min(j)] / (scale[i] * scale[j]);
            let llt = Mat::from_fn(n, n, scaled).llt(Side::Lower).ok()?;
            let solved = llt.solve(Mat::from_fn(n, 1, |i, _| right[i] / scale[i]));
            let mut change = [0.0; COLUMNS];
            for (i, &column) in columns.iter().enumerate() {
                change[column] = solved[(i, 0)] / scale[i];
            }
            let turn = DVec3::new(change[0], change[1], change[2]);
            if !(turn.is_finite() && turn.length() < 0.2) {
                return None;
            }
            self.camera_from_inertial =
                (DQuat::from_scaled_axis(turn) * self.camera_from_inertial).normalize();
            self.focal_ratio += change[3];
            self.k1 += change[4];
            for (value, change) in self.higher.iter_mut().zip(&change[5..9]) {
                *value += change;
            }
            self.aspect += change[9];
            if step + 1 == steps {
                let inverse = llt.solve(Mat::<f64>::identity(n, n));
                for (i, &column) in columns.iter().enumerate() {
                    for (j, &other) in columns.iter().enumerate() {
                        covariance[column][other] = inverse[(i, j)] / (scale[i] * scale[j]);
                    }
                }
            }
        }
        let sound = self.focal_ratio > 0.0 && self.focal_ratio.is_finite() && self.aspect > 0.0;
        sound.then_some((self, covariance))
    }

    /// Derivatives of the distorted line of sight by a rotation vector along camera axes, and by the other columns.
    pub(crate) fn rows(&self, p: DVec2) -> [[f64; COLUMNS]; 2] {
        let (x, y, r2) = (p.x, p.y, p.length_squared());
        let [k2, k3, p1, p2] = self.higher;
        let turn = [[-x * y, 1.0 + x * x, -y], [-(1.0 + y * y), x * y, x]];
        let radial = self.radial(p);
        // Twice the radial factor's derivative by r^2.
        let slope = 2.0 * (self.k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3));
        let by_x =
            [radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x, slope * x * y + 2.0 * (p1 * x + p2 * y)];
        let by_y =
            [slope * x * y + 2.0 * (p1 * x + p2 * y), radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x];
        let q = p * radial + self.sideways(p);
        let own = [
            [x * r2, x * r2 * r2, x * r2 * r2 * r2, 2.0 * x * y, r2 + 2.0 * x * x],
            [y * r2, y * r2 * r2, y * r2 * r2 * r2, r2 + 2.0 * y * y, 2.0 * x * y],
        ];
        let mut rows = [[0.0; COLUMNS]; 2];
        for (axis, row) in rows.iter_mut().enumerate() {
            let stretch = if axis == 0 { 1.0 } else { self.aspect };
            for column in 0..3 {
                let along = by_x[axis] * turn[0][column] + by_y[axis] * turn[1][column];
                row[column] = self.focal_ratio * stretch * along;
            }
            row[3] = stretch * q[axis];
            for (value, own) in row[4..9].iter_mut().zip(own[axis]) {
                *value = self.focal_ratio * stretch * own;
            }
        }
        rows[1][9] = self.focal_ratio * q.y;
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

    const RADIAL: Free = Free { distortion: Distortion::Radial, aspect: false };

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
                k1,
                ..SkyFit::pinhole(DQuat::from_scaled_axis(DVec3::new(0.3, -0.5, 1.0) * angle), s)
            };
            let turned = DQuat::from_scaled_axis(DVec3::new(off, -off, off)) * truth.camera_from_inertial;
            let start = SkyFit::pinhole(turned, 1.0);
            let seen = sightings(&truth, 30);
            let (found, _) = start.refined(&seen, RADIAL, 8).unwrap();
            prop_assert!((found.focal_ratio - s).abs() < 1e-9 && (found.k1 - k1).abs() < 1e-6);
            prop_assert!((found.camera_from_inertial * DVec3::ONE - truth.camera_from_inertial * DVec3::ONE).length() < 1e-9);
            let back = found.corrected(seen[3].measured);
            let v = truth.camera_from_inertial * seen[3].direction;
            prop_assert!((back - v.truncate() / v.z).length() < 1e-9);
            prop_assert!(found.residual(seen[5].measured, seen[5].direction).length() < 1e-8);
        }
    }

    #[test]
    fn brown_s_model_comes_back_and_is_inverted() {
        // OpenCV 5.0, projectPoints with k1 -0.2, k2 0.1, p1 0.004, p2 -0.003, k3 0.05 and focal length 1 at (0.3, -0.2).
        let opencv =
            SkyFit { k1: -0.2, higher: [0.1, 0.05, 0.004, -0.003], ..SkyFit::pinhole(DQuat::IDENTITY, 1.0) };
        let seen = opencv.project(DVec3::new(0.3, -0.2, 1.0)).unwrap();
        assert!(seen.distance(DVec2::new(0.291_329_955, -0.193_959_97)) < 1e-9, "{seen}");
        assert!(opencv.corrected(seen).distance(DVec2::new(0.3, -0.2)) < 1e-12);
        let truth = SkyFit { aspect: 1.03, focal_ratio: 0.98, ..opencv };
        let seen: Vec<Sighting> = sightings(&SkyFit::pinhole(DQuat::IDENTITY, 1.0), 120)
            .into_iter()
            .map(|s| Sighting { measured: truth.project(s.direction * 2.0).unwrap(), ..s })
            .collect();
        let free = Free { distortion: Distortion::Full, aspect: true };
        let (found, _) = SkyFit::pinhole(DQuat::IDENTITY, 1.0).refined(&seen, free, 20).unwrap();
        assert!((found.k1 + 0.2).abs() < 1e-4 && (found.aspect - 1.03).abs() < 1e-7, "{found:?}");
        assert!(
            (found.higher[2] - 0.004).abs() < 1e-7 && (found.higher[3] + 0.003).abs() < 1e-7,
            "{found:?}"
        );
    }

    #[test]
    fn the_derivatives_are_differences() {
        let fit = SkyFit {
            k1: -0.3,
            higher: [0.4, -0.7, 0.02, -0.03],
            aspect: 1.1,
            ..SkyFit::pinhole(DQuat::from_rotation_x(0.4), 1.02)
        };
        let p = DVec2::new(0.15, -0.09);
        let direction = fit.camera_from_inertial.inverse() * p.extend(1.0).normalize();
        let (rows, step) = (fit.rows(p), 1e-6);
        for column in 0..COLUMNS {
            let moved = |sign: f64| {
                let mut turn = DVec3::ZERO;
                let mut other = fit;
                match column {
                    3 => other.focal_ratio += sign * step,
                    4 => other.k1 += sign * step,
                    5..9 => other.higher[column - 5] += sign * step,
                    9 => other.aspect += sign * step,
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
        let start = SkyFit::pinhole(DQuat::IDENTITY, 1.0);
        let focal = Free { distortion: Distortion::None, aspect: false };
        let (_, covariance) = start.refined(&ring, focal, 2).unwrap();
        let [across, about] = [covariance[0][0], covariance[2][2]].map(f64::sqrt);
        // (1 + y^2) in the derivative: 1 % at r = 0.1.
        assert!((across / (sigma / (n as f64).sqrt()) - 1.0).abs() < 0.01, "{across}");
        assert!((about / (sigma / (n as f64).sqrt() / r) - 1.0).abs() < 1e-6, "{about}");
    }
}
