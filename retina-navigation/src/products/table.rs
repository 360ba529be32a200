//! The matched stars as CSV.

use std::fmt::Write as _;

use crate::image::ImageResult;

/// One matched star a row, brightest point first; the header alone where nothing is solved, which the command does not write.
pub fn matches_csv(result: &ImageResult) -> String {
    let mut text = String::from(
        "id,magnitude,ra_deg,dec_deg,camera_x_px,camera_y_px,residual_x_arcsec,residual_y_arcsec,flux_dn,saturated\n",
    );
    let Ok(solution) = &result.solution else { return text };
    for matched in &solution.matches {
        let point = &result.points[matched.point];
        let direction = matched.direction;
        let ra_deg = direction.y.atan2(direction.x).rem_euclid(std::f64::consts::TAU).to_degrees();
        let [x, y] = matched.residual_rad.to_array().map(|off| off.to_degrees() * 3600.0);
        // Writing into a string does not fail.
        let _ = writeln!(
            text,
            "{},{:.3},{ra_deg:.7},{:.7},{:.4},{:.4},{x:.3},{y:.3},{:.1},{}",
            matched.star.id,
            matched.magnitude,
            direction.z.clamp(-1.0, 1.0).asin().to_degrees(),
            point.pixel.x,
            point.pixel.y,
            point.flux,
            u8::from(point.saturated),
        );
    }
    text
}
