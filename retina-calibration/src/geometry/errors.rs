//! Angular errors and their percentiles.

use glam::DVec2;

/// The percentiles that are reported.
pub(crate) const PERCENTILES: [u32; 6] = [50, 68, 90, 95, 96, 99];

/// Angular errors of lines of sight in two dimensions, arcsec.
#[derive(Debug, Clone, PartialEq)]
pub struct ErrorSummary {
    /// Number of points.
    pub points: usize,
    /// Root of the mean square of the angle.
    pub rms_arcsec: f64,
    /// 50, 68, 90, 95, 96 and 99 % of the points are within these.
    pub percentiles_arcsec: [f64; 6],
    /// Share of the points within 10 arcsec.
    pub fraction_within_10_arcsec: f64,
}

impl ErrorSummary {
    /// Of angles in arcsec.
    pub(crate) fn of(mut angles: Vec<f64>) -> Self {
        angles.sort_by(f64::total_cmp);
        let count = angles.len().max(1) as f64;
        let at = |percent: u32| {
            // The smallest angle that at least so many per cent of the points do not exceed.
            let place = (f64::from(percent) / 100.0 * count).ceil() as usize;
            angles.get(place.max(1) - 1).copied().unwrap_or(0.0)
        };
        Self {
            points: angles.len(),
            rms_arcsec: (angles.iter().map(|a| a * a).sum::<f64>() / count).sqrt(),
            percentiles_arcsec: PERCENTILES.map(at),
            fraction_within_10_arcsec: angles.iter().filter(|&&a| a <= 10.0).count() as f64 / count,
        }
    }
}

/// Great-circle angle between two lines of sight, arcsec; exact for small angles too.
pub(crate) fn angle_arcsec(a: DVec2, b: DVec2) -> f64 {
    let (a, b) = (a.extend(1.0), b.extend(1.0));
    a.cross(b).length().atan2(a.dot(b)).to_degrees() * 3600.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_and_angles() {
        let summary = ErrorSummary::of((1..=100).rev().map(f64::from).collect());
        assert_eq!(summary.percentiles_arcsec, [50.0, 68.0, 90.0, 95.0, 96.0, 99.0]);
        assert_eq!(summary.fraction_within_10_arcsec, 0.1);
        // 45 degrees between (0, 0, 1) and (1, 0, 1).
        assert!((angle_arcsec(DVec2::ZERO, DVec2::X) - 45.0 * 3600.0).abs() < 1e-9);
        assert!(
            (angle_arcsec(DVec2::ZERO, DVec2::new(1e-9, 0.0)) - 1e-9f64.to_degrees() * 3600.0).abs() < 1e-15
        );
    }
}
