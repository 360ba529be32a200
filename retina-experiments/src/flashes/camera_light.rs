//! The camera's zero point and spots, from points of known light on its bench.

use glam::{DMat3, DVec2, DVec3};
use retina_bench::{Bench, Exposure, ScreenImage};
use retina_campaign::{camera_image, saturation_dn};
use retina_files::InputError;
use retina_formats::Calibration;
use retina_image::{DetectOptions, LightPoint, detect_points};
use retina_radiometry::irradiance_of_magnitude_w_m2_nm;
use retina_screen::PointPainter;

use super::sequence::CameraLight;
use crate::experiment::ExperimentError;
use retina_navigation::flashes::ZeroPoint;

/// Places along each side at which the camera's light is measured.
const PLACES: [u32; 2] = [14, 9];
/// Their magnitude beyond that of a pixel at full count: three pixels show it, as they show a flash.
const FAINTER_MAG: f64 = 1.0;
/// The places stand anywhere in their pixels: multiples of this, the golden ratio's fraction, are spread evenly.
const GOLDEN: f64 = 0.618_034;
/// Share of the full well that the measured points' brightest pixel fills.
const POINT_SHARE: f64 = 0.6;
/// The width is measured with a window of this standard deviation first, px.
const FIRST_SPOT_SIGMA_PX: f64 = 1.0;

/// Zero point for an exposure time, and width of spots: points of known irradiance over the screen, shown as the screens
/// of the calibration show flashes, photographed once for a time in which they do not saturate.
///
/// # Errors
/// The bench refuses the screen, or the points are not found.
pub(super) fn camera_light(
    bench: &Bench,
    calibration: &Calibration,
    exposure_s: f64,
) -> Result<CameraLight, ExperimentError> {
    let setup = bench.setup();
    let [width, height] = [setup.screen.width_px, setup.screen.height_px];
    let magnitude = setup.brightest_magnitude() + FAINTER_MAG;
    // With the distortion: a screen's pixel that it makes larger sends more light, and flashes have so much lower counts.
    let distortion = Some(calibration.distortion.clone());
    let painter = PointPainter::new(setup.facility_pinhole(), distortion, calibration.screen_response(setup));
    let mut counts = vec![0; (width * height) as usize];
    for k in 0..PLACES[0] * PLACES[1] {
        let at = |index: u32, places: u32, size: u32, turn: f64| {
            let middle = (f64::from(index) + 0.5) * f64::from(size) / f64::from(places);
            middle.floor() + (f64::from(k + 1) * GOLDEN * turn).fract()
        };
        let place = DVec2::new(
            at(k % PLACES[0], PLACES[0], width, 1.0),
            at(k / PLACES[0], PLACES[1], height, GOLDEN),
        );
        painter.draw(&mut counts, place, irradiance_of_magnitude_w_m2_nm(magnitude));
    }
    let screen = ScreenImage::grey(width, height, &counts);
    let light = bench.light_e(&screen, &Exposure::new(1.0, 0))?;
    let peak_e = f64::from(light.iter().copied().fold(0.0, f32::max));
    let short_s = POINT_SHARE * bench.sensor().full_well_e() / peak_e;
    let exposure = Exposure::new(short_s, 0);
    let image = camera_image(bench, bench.read(&light_at(&light, short_s), &exposure));
    let options = |sigma_px: f64| DetectOptions {
        threshold_sigma: 20.0,
        spot_sigma_px: Some(sigma_px),
        saturation_dn: Some(saturation_dn(bench)),
        gain_e_per_dn: Some(bench.sensor().gain_e_per_dn),
        ..DetectOptions::default()
    };
    let whole =
        |points: Vec<LightPoint>| points.into_iter().filter(|point| !point.blended && !point.saturated);
    let mut widths: Vec<f64> = whole(detect_points(&image, &options(FIRST_SPOT_SIGMA_PX)).points)
        .filter_map(|p| p.width_px)
        .collect();
    widths.sort_by(f64::total_cmp);
    let missing = || {
        InputError::new(&setup.file, "the points that measure the camera's zero point are not seen")
            .expected("points on the screen within the camera's field")
    };
    let spot_sigma_px = *widths.get(widths.len() / 2).ok_or_else(missing)?;
    let size_px = DVec2::new(f64::from(image.width_px), f64::from(image.height_px));
    let measured: Vec<(f64, f64)> = whole(detect_points(&image, &options(spot_sigma_px)).points)
        .filter(|point| point.flux_dn > 0.0)
        .map(|point| {
            let zero = magnitude + 2.5 * (point.flux_dn * exposure_s / short_s).log10();
            (ZeroPoint::distance2(DVec2::new(point.x_px, point.y_px), size_px), zero)
        })
        .collect();
    let zero_point = zero_point_through(&measured).ok_or_else(missing)?;
    Ok(CameraLight { zero_point: Some(zero_point), spot_sigma_px })
}

/// The parabola of zero points over squared distances from the middle that leaves the least squares, and what it leaves;
/// `None` where their distances are too few.
fn zero_point_through(measured: &[(f64, f64)]) -> Option<ZeroPoint> {
    let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for &(distance2, zero) in measured {
        let row = DVec3::new(1.0, distance2, distance2 * (1.0 - distance2));
        normal += DMat3::from_cols(row * row.x, row * row.y, row * row.z);
        right += row * zero;
    }
    let count = measured.len() as f64;
    // Of unit-sized columns: far below what places over an image give, far above rounding.
    if measured.len() < 4 || normal.determinant() < 1e-9 * count.powi(3) {
        return None;
    }
    let [magnitude, corner_magnitude, bend_magnitude] = (normal.inverse() * right).to_array();
    let through = ZeroPoint { magnitude, corner_magnitude, bend_magnitude, sigma_magnitude: 0.0 };
    let squares: f64 =
        measured.iter().map(|&(distance2, zero)| (zero - through.at_distance2(distance2)).powi(2)).sum();
    Some(ZeroPoint { sigma_magnitude: (squares / (count - 3.0)).sqrt(), ..through })
}

/// Electrons of an exposure from those of one second.
fn light_at(light_e_s: &[f32], exposure_s: f64) -> Vec<f32> {
    light_e_s.iter().map(|light| light * exposure_s as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parabola_of_zero_points_is_found_with_its_scatter() {
        let truth = ZeroPoint {
            magnitude: 12.85,
            corner_magnitude: 0.15,
            bend_magnitude: 0.43,
            sigma_magnitude: 0.008,
        };
        let measured: Vec<(f64, f64)> = (0..40)
            .map(|k| {
                let distance2 = f64::from(k) / 40.0;
                let off = if k % 2 == 0 { 0.008 } else { -0.008 };
                (distance2, truth.at_distance2(distance2) + off)
            })
            .collect();
        let found = zero_point_through(&measured).unwrap();
        for distance2 in [0.0, 0.3, 0.6, 1.0] {
            // Three terms of 40 points that scatter by 0.008.
            assert!(
                (found.at_distance2(distance2) - truth.at_distance2(distance2)).abs() < 0.004,
                "{found:?}"
            );
        }
        assert!((found.sigma_magnitude / 0.008 - 1.0).abs() < 0.1, "{found:?}");
        assert_eq!(zero_point_through(&[(0.5, 12.0); 9]), None);
    }
}
