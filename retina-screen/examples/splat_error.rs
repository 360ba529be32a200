//! How far the barycentre and the magnitude of a splat are from what was wanted, over magnitude and
//! sub-pixel phase, as CSV on standard output; validation/splat_error.py draws it.
//!
//! `rounding_px` is what rounding each of three pixels by itself would leave, from the width of the
//! counts' steps there: sqrt(sum over pixels of (step / sqrt 12)^2 d^2) / total light, d their distance
//! from the wanted position. `three_roundings_px` is that done.

use glam::DVec2;
use retina_geometry::Pinhole;
use retina_radiometry::{ScreenResponse, irradiance_of_magnitude_w_m2_nm, magnitude_of_irradiance};
use retina_screen::PointPainter;

const PHASES: u32 = 16;

fn main() {
    let response = ScreenResponse::power_law(2.2, -1.44);
    let image =
        Pinhole { fx_px: 5661.2, fy_px: 5661.2, cx_px: 32.0, cy_px: 32.0, width_px: 64, height_px: 64 };
    let painter = PointPainter::new(image, None, response.clone());
    println!(
        "magnitude,phase_x_px,phase_y_px,position_error_px,magnitude_error,three_roundings_px,three_roundings_mag,rounding_px,pixels"
    );
    for step in 0..=46 {
        let magnitude = -3.0 + 0.25 * f64::from(step);
        let wanted = irradiance_of_magnitude_w_m2_nm(magnitude);
        for phase in 0..PHASES * PHASES {
            // Half-steps away from symmetry.
            let phase =
                (DVec2::new(f64::from(phase % PHASES), f64::from(phase / PHASES)) + 0.37) / f64::from(PHASES);
            let at = DVec2::splat(32.0) + phase;
            let mut counts = vec![0; 64 * 64];
            let Some(shown) = painter.draw(&mut counts, at, wanted) else { continue };
            let (rounded, rounded_magnitude, floor) = three_roundings(&response, phase, wanted);
            println!(
                "{magnitude},{},{},{:.6},{:.6},{rounded:.6},{rounded_magnitude:.6},{floor:.6},{}",
                phase.x,
                phase.y,
                shown.splat.displayed_px.distance(at),
                magnitude_of_irradiance(shown.splat.displayed_w_m2_nm) - magnitude,
                shown.splat.pixels.len()
            );
        }
    }
}

/// The errors of three counts rounded one by one (px, magnitudes), and the expected size of the first.
fn three_roundings(response: &ScreenResponse, phase: DVec2, wanted: f64) -> (f64, f64, f64) {
    let from_center = phase - 0.5;
    let shares = [1.0 - from_center.x.abs() - from_center.y.abs(), from_center.x.abs(), from_center.y.abs()];
    let places =
        [DVec2::ZERO, DVec2::new(from_center.x.signum(), 0.0), DVec2::new(0.0, from_center.y.signum())];
    let (mut flux, mut moment, mut variance) = (0.0, DVec2::ZERO, 0.0);
    for (share, place) in shares.into_iter().zip(places) {
        let count = response.nearest_count((share * wanted) as f32);
        let light = response.irradiance_w_m2_nm([count; 3]);
        flux += light;
        moment += light * (place - from_center);
        let (low, high) = (count.saturating_sub(1), count.saturating_add(1));
        let step = (response.irradiance_w_m2_nm([high; 3]) - response.irradiance_w_m2_nm([low; 3]))
            / f64::from(high - low);
        variance += step * step / 12.0 * (place - from_center).length_squared();
    }
    ((moment / flux).length(), -2.5 * (flux / wanted).log10(), variance.sqrt() / wanted)
}
