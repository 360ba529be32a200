//! From a pattern through camera images to a calibration.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

mod common;

use common::{ARCSEC, Facility, LIKELY, l_of, normal, wide};
use glam::DVec2;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use retina_calibration::geometry::{
    CalibrateOptions, Pattern, PatternOptions, PatternScreen, calibrate, match_points, points_from_images,
};
use retina_geometry::Setup;
use retina_image::{CameraImage, DetectOptions, detect_points};

/// A 12-bit image of a screen: Gaussian spots of 1.6 px, the group's brightest at 2600 DN peak, read noise of 2.5 DN, a
/// sloping background, hot pixels.
fn photograph(facility: &Facility, setup: &Setup, screen: &PatternScreen, seed: u64) -> CameraImage {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let (k, c) = (setup.facility_pinhole(), setup.camera_pinhole());
    let mut image = CameraImage::new(c.width_px, c.height_px, 4095.0);
    let width = c.width_px as usize;
    let brightest = screen.points.iter().map(|p| p.digital_count).max().unwrap();
    let jitter = DVec2::new(normal(&mut random), normal(&mut random)) * facility.jitter_arcsec * ARCSEC;
    for point in &screen.points {
        let l = l_of(f64::from(point.digital_count));
        let peak = 2600.0 * 10f64.powf(l - l_of(f64::from(brightest)));
        let at = c.pixel(facility.sight(k.line_of_sight(point.screen_px()), l) + jitter);
        for y in (at.y - 9.0).max(0.0) as usize..((at.y + 10.0).max(0.0) as usize).min(c.height_px as usize) {
            for x in (at.x - 9.0).max(0.0) as usize..((at.x + 10.0).max(0.0) as usize).min(width) {
                let off = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - at;
                image.values[y * width + x] +=
                    (peak * (-off.length_squared() / (2.0 * 1.6 * 1.6)).exp()) as f32;
            }
        }
    }
    for (at, value) in image.values.iter_mut().enumerate() {
        let ground = 90.0 + 0.01 * (at % width) as f64 - 0.005 * (at / width) as f64;
        *value = (f64::from(*value) + ground + 2.5 * normal(&mut random)).round().clamp(0.0, 4095.0) as f32;
    }
    for _ in 0..40 {
        let at = (random.random::<f64>() * image.values.len() as f64) as usize;
        image.values[at] = 3000.0;
    }
    image
}

#[test]
fn a_campaign_of_images_calibrates_the_facility() {
    let setup = wide();
    let folder = tempfile::tempdir().unwrap();
    let options = PatternOptions { points: 300, screens: Some(6), ..PatternOptions::default() };
    let pattern = Pattern::make(&setup, &options).unwrap();
    pattern.write(folder.path(), &setup, options.seed).unwrap();
    let images = folder.path().join("images");
    std::fs::create_dir(&images).unwrap();
    for (i, screen) in pattern.screens.iter().enumerate() {
        let image = photograph(&LIKELY, &setup, screen, i as u64);
        if i % 2 == 0 {
            image.write_png(&images.join(format!("{i:03}.png"))).unwrap();
        } else {
            image.write_fits(&images.join(format!("{i:03}.fits"))).unwrap();
        }
    }
    let (table, reports) =
        points_from_images(&images, folder.path(), &setup, &DetectOptions::default()).unwrap();
    for report in &reports {
        println!("{report:?}");
        // The camera's field and the blends of a few points aside, all 300; 40 hot pixels are none of them.
        assert!(report.recognised.unwrap().0 >= 260 && report.detected <= 305);
    }
    let (k, c) = (setup.facility_pinhole(), setup.camera_pinhole());
    for row in &table.rows {
        let truth = c.pixel(LIKELY.sight(k.line_of_sight(row.screen_px), l_of(row.digital_count)));
        // Jitter of 0.8 arcsec is 0.03 px; no match is wrong.
        assert!((row.camera_px - truth).length() < 0.15 + 6.0 * row.sigma_px.unwrap(), "{row:?} {truth:?}");
    }
    let result = calibrate(&table, &setup, &CalibrateOptions::default()).unwrap();
    println!("rms {:.3} arcsec, 99 % {:.3}", result.errors.rms_arcsec, result.errors.percentiles_arcsec[5]);
    assert!(result.heldout.fraction_within_10_arcsec > 0.99);
    // As images.csv says: two exposures of one screen, and what was noted of them.
    std::fs::copy(images.join("000.png"), images.join("again.png")).unwrap();
    let list = |rows: &str| {
        let text = format!("image,screen,exposure_s,temperature_c,series\n{rows}");
        std::fs::write(images.join("images.csv"), text).unwrap();
    };
    for (rows, said) in [
        ("000.png,000.png,0.1,20.5,a\n000.png,000,0.1,21.0,a\n", "listed twice"),
        ("000.png,000.png,-0.1,20.5,a\n", "not positive"),
    ] {
        list(rows);
        let error =
            points_from_images(&images, folder.path(), &setup, &DetectOptions::default()).unwrap_err();
        assert!(error.to_string().contains(said), "{error}");
    }
    list("000.png,000.png,0.1,20.5,a\nagain.png,000,0.1,21.0,a\n");
    let (listed, _) = points_from_images(&images, folder.path(), &setup, &DetectOptions::default()).unwrap();
    assert_eq!(listed.images.len(), 2);
    assert_eq!(listed.rows[0].temperature_c, Some(20.5));
    assert_eq!(listed.rows[0].series.as_deref(), Some("a"));
    let path = folder.path().join("points.csv");
    listed.write(&path, &setup).unwrap();
    let read = retina_formats::PointsTable::read(&[path]).unwrap();
    assert_eq!(read.rows.len(), listed.rows.len());
    assert!((read.rows[7].camera_px - listed.rows[7].camera_px).length() < 1e-5);
    // Another pattern's images are refused as a whole.
    let other = tempfile::tempdir().unwrap();
    Pattern::make(&setup, &PatternOptions { seed: 9, ..options })
        .unwrap()
        .write(other.path(), &setup, 9)
        .unwrap();
    let error = points_from_images(&images, other.path(), &setup, &DetectOptions::default()).unwrap_err();
    assert!(error.to_string().contains("the pattern does not match the images"), "{error}");
}

#[test]
fn five_hundred_points_are_found_and_matched() {
    let setup = wide();
    let options = PatternOptions { points: 500, screens: Some(1), ..PatternOptions::default() };
    let pattern = Pattern::make(&setup, &options).unwrap();
    let image = photograph(&LIKELY, &setup, &pattern.screens[0], 1);
    let mut times_ms: Vec<[f64; 2]> = (0..9)
        .map(|_| {
            let start = std::time::Instant::now();
            let found = detect_points(&image, &DetectOptions::default());
            let detected = start.elapsed();
            let (rows, _) = match_points(0, 0, &pattern, &setup, &found.points);
            assert!(rows.len() > 430, "{}", rows.len());
            [detected, start.elapsed() - detected].map(|t| t.as_secs_f64() * 1e3)
        })
        .collect();
    times_ms.sort_by(|a, b| (a[0] + a[1]).total_cmp(&(b[0] + b[1])));
    println!("detected in {:.1} ms, matched in {:.1} ms (median of 9)", times_ms[4][0], times_ms[4][1]);
}
