//! What a solved image says, and why one is refused.

use glam::{DMat3, DQuat, DVec2, DVec3};
use retina_sky::catalogue::Star;
use thiserror::Error;

use super::fit::SkyFit;

/// A point that is a star of the catalogue.
#[derive(Debug, Clone, Copy)]
pub struct StarMatch {
    /// Index of the point, in the order given to the solver.
    pub point: usize,
    /// The star; the brightest where several are seen as one.
    pub star: &'static Star,
    /// V, of all that are seen as one.
    pub magnitude: f64,
    /// Its apparent direction: unit vector along inertial axes.
    pub direction: DVec3,
    /// Measured less expected line of sight, rad, along the image's x and y; its length is the great-circle angle.
    pub residual_rad: DVec2,
}

/// A solved image.
#[derive(Debug, Clone)]
pub struct StarSolution {
    /// Attitude, focal ratio and radial distortion.
    pub fit: SkyFit,
    /// Covariance of the attitude: a rotation vector along camera axes, rad^2. Focal length and distortion are
    /// fitted with it.
    pub attitude_covariance_rad2: DMat3,
    /// Standard deviation of the focal ratio.
    pub focal_ratio_sigma: f64,
    /// Standard deviation of k1; `None` where it was not fitted, being within its noise.
    pub k1_sigma: Option<f64>,
    /// Standard deviations of k2, k3, p1 and p2; `None` where k1 or nothing was enough.
    pub higher_sigma: Option<[f64; 4]>,
    /// Standard deviation of the pixels' aspect; `None` where it was given.
    pub aspect_sigma: Option<f64>,
    /// The stars.
    pub matches: Vec<StarMatch>,
    /// Root mean square of the residuals' lengths, rad.
    pub rms_rad: f64,
    /// Standard deviation per axis of what the points' own noise does not explain, rad: catalogue, distortion, blends.
    pub excess_sigma_rad: f64,
    /// log10 of a bound on the chance that this answer is a coincidence, over all hypotheses that were looked at.
    pub log10_false_probability: f64,
    /// Magnitude of a point of flux 1; `None` where all stars are saturated.
    pub zero_point_magnitude: Option<f64>,
    /// Patterns of stars that were looked at.
    pub hypotheses: usize,
    /// The image is a mirror image: all of this is of its points flipped left to right ([`StarPoint::flipped`]).
    ///
    /// [`StarPoint::flipped`]: super::StarPoint::flipped
    pub mirrored: bool,
}

impl StarSolution {
    /// The attitude.
    pub fn camera_from_inertial(&self) -> DQuat {
        self.fit.camera_from_inertial
    }

    /// Right ascension and declination of the boresight and roll: the angle from celestial north to the image's up,
    /// positive towards east; rad.
    pub fn ra_dec_roll_rad(&self) -> [f64; 3] {
        ra_dec_roll_rad(self.fit.camera_from_inertial)
    }

    /// The inertial unit vector of a measured line of sight.
    pub fn inertial_direction(&self, line_of_sight: DVec2) -> DVec3 {
        self.fit.camera_from_inertial.inverse() * self.fit.corrected(line_of_sight).extend(1.0).normalize()
    }
}

/// Right ascension (0 to 2 pi), declination and roll of an attitude, rad. At a pole roll is counted from the meridian
/// of right ascension 0.
pub fn ra_dec_roll_rad(camera_from_inertial: DQuat) -> [f64; 3] {
    let inertial_from_camera = camera_from_inertial.inverse();
    let boresight = inertial_from_camera * DVec3::Z;
    let up = inertial_from_camera * -DVec3::Y;
    let ra = boresight.y.atan2(boresight.x).rem_euclid(std::f64::consts::TAU);
    let dec = boresight.z.clamp(-1.0, 1.0).asin();
    let east = DVec3::new(-ra.sin(), ra.cos(), 0.0);
    let north = boresight.cross(east);
    [ra, dec, up.dot(east).atan2(up.dot(north))]
}

/// Why an image has no answer.
#[derive(Debug, Clone, Error)]
pub enum Refusal {
    /// Too little to go by.
    #[error("only {found} separate points of light were found, {needed} at least are needed")]
    TooFewPoints {
        /// Points that stand apart.
        found: usize,
        /// Fewest that are tried.
        needed: usize,
    },
    /// Nothing fitted well enough.
    #[error("{}", no_match(*.hypotheses, *.log10_best, *.log10_bound, *.stopped))]
    NoMatch {
        /// Patterns of stars that were looked at.
        hypotheses: usize,
        /// log10 of the best hypothesis' chance, over all of them.
        log10_best: f64,
        /// log10 of the bound.
        log10_bound: f64,
        /// The search ended at its limit ([`SolverOptions::most_hypotheses`](super::SolverOptions)), not at its end.
        stopped: bool,
    },
    /// The stars are there, at a focal length that was ruled out.
    #[error(
        "the stars fit at a focal length {percent:+.2} % off, and {:+.2} to {:+.2} % was allowed: check the camera's focal length, or allow more",
        100.0 * (.allowed[0] - 1.0), 100.0 * (.allowed[1] - 1.0)
    )]
    FocalLength {
        /// How far off, per cent.
        percent: f64,
        /// Least and greatest focal length over the camera's that were allowed.
        allowed: [f64; 2],
    },
    /// The stars are there, seen in a mirror.
    #[error(
        "the image is mirrored left to right (or was said to be, and is not): flipped it fits {} stars about right ascension {:.3} deg, declination {:.3} deg",
        .flipped.matches.len(), .flipped.ra_dec_roll_rad()[0].to_degrees(), .flipped.ra_dec_roll_rad()[1].to_degrees()
    )]
    Mirrored {
        /// The answer for the image flipped.
        flipped: Box<StarSolution>,
    },
}

fn no_match(hypotheses: usize, log10_best: f64, log10_bound: f64, stopped: bool) -> String {
    let why = match hypotheses {
        0 => "no four of them have the shape of four stars of the catalogue".to_owned(),
        _ => format!(
            "of {hypotheses} hypotheses the best might be a coincidence with probability 10^{log10_best:.1}, the bound is \
             10^{log10_bound:.1}"
        ),
    };
    let limit = if stopped { "; the search stopped at that number, which is its limit" } else { "" };
    format!("no attitude explains the points: {why}{limit}")
}

impl Refusal {
    /// A word for machines: `too_few_points`, `no_match`, `focal_length` or `mirrored`.
    pub fn reason(&self) -> &'static str {
        match self {
            Self::TooFewPoints { .. } => "too_few_points",
            Self::NoMatch { .. } => "no_match",
            Self::FocalLength { .. } => "focal_length",
            Self::Mirrored { .. } => "mirrored",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roll_is_counted_from_north_to_east() {
        // Boresight at right ascension 90 deg on the equator: north is +z, east is -x. With the image's up along
        // north, right is west (+x): camera x = +X, y = -Z, z = +Y.
        let upright = DQuat::from_mat3(&DMat3::from_cols(DVec3::X, -DVec3::Z, DVec3::Y).transpose());
        let [ra, dec, roll] = ra_dec_roll_rad(upright);
        assert!((ra.to_degrees() - 90.0).abs() < 1e-9 && dec.abs() < 1e-12 && roll.abs() < 1e-9);
        // Up towards east (-X): x = right = east turned on to south... right = up x boresight seen from behind = z cross.
        let up = -DVec3::X;
        let right = DVec3::Y.cross(up);
        let turned = DQuat::from_mat3(&DMat3::from_cols(right, -up, DVec3::Y).transpose());
        assert!((ra_dec_roll_rad(turned)[2].to_degrees() - 90.0).abs() < 1e-9);
    }
}
