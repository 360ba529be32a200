//! The calibration against facilities whose truth is known.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

mod common;

use common::response::response;
use common::{ARCSEC, Facility, LIKELY, SIMILARITY, l_of, wide};
use glam::DVec2;
use retina_calibration::geometry::{CalibrateOptions, ModelForm, calibrate, to_json, write_calibration};
use retina_formats::{Calibration, CalibrationFile, Channel, PointsTable, log10_irradiance};
use retina_geometry::Setup;

/// Worst distance over the camera's field between what D^-1 says and the screen's true line of sight, arcsec.
fn worst_arcsec(facility: &Facility, setup: &Setup, read: &Calibration, count: f64) -> f64 {
    let inverse = read.inverse.as_ref().unwrap();
    let mut worst = 0.0f64;
    for row in 0..=10 {
        for column in 0..=10 {
            // Undistorted lines of sight that the camera sees, to 97 % of its field.
            let at = DVec2::new(f64::from(column) / 5.0 - 1.0, f64::from(row) / 5.0 - 1.0)
                * DVec2::new(0.1413, 0.106)
                * 0.97;
            let r = facility.sight(at, l_of(count));
            let camera = setup.camera_pinhole().pixel(r);
            if camera.x < 0.0 || camera.y < 0.0 || camera.x > 2048.0 || camera.y > 1536.0 {
                continue;
            }
            worst = worst.max((inverse.undistort(r, l_of(count)) - at).length() / ARCSEC);
        }
    }
    worst
}

fn calibrated(
    table: &PointsTable,
    options: &CalibrateOptions,
) -> (retina_calibration::geometry::GeometryCalibration, Calibration) {
    let setup = wide();
    let result = calibrate(table, &setup, options).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("calibration.toml");
    write_calibration(&path, &result, table, &setup).unwrap();
    (result, Calibration::read(&path, &setup).unwrap())
}

/// The camera is rolled about its middle: the mapping turns with it, and is as good.
#[test]
fn a_camera_may_be_rolled_by_any_angle() {
    let setup = wide();
    let middle = DVec2::new(1024.0, 768.0);
    for degrees in [-90.0f64, 60.0, 180.0] {
        let mut table = Facility { outliers: 0.0, ..LIKELY }.table(&setup, 20, 150, 3);
        for row in &mut table.rows {
            row.camera_px = middle + DVec2::from_angle(degrees.to_radians()).rotate(row.camera_px - middle);
        }
        let within = |px: DVec2| px.cmpge(DVec2::ZERO).all() && px.cmple(2.0 * middle).all();
        table.rows.retain(|row| within(row.camera_px));
        let result = calibrate(&table, &setup, &CalibrateOptions::default()).unwrap();
        assert!(result.direct.worst_arcsec < 0.01, "{degrees} deg");
        assert!(result.heldout.rms_arcsec < 4.0, "{degrees} deg: {}", result.heldout.rms_arcsec);
        let off = (result.physical.as_ref().unwrap().roll_rad + degrees.to_radians()).sin().abs();
        println!("{degrees} deg: off by {off:.1e}, left out {:.2} arcsec", result.heldout.rms_arcsec);
        assert!(off < 2e-4, "{degrees} deg: {off}");
    }
}

/// A hundred points bear a cubic, whatever their levels would need beside it. With fifty it is told that they do not. An
/// empty cell of `sigma_px` is told, and changes next to nothing.
#[test]
fn few_points_bear_the_lens_before_the_light() {
    let setup = wide();
    let facility = Facility { outliers: 0.0, coma_arcsec: 0.0, ..LIKELY };
    let result = calibrate(&facility.table(&setup, 8, 12, 4), &setup, &CalibrateOptions::default()).unwrap();
    assert!(result.form.degree >= 3 && result.warnings.is_empty(), "{:?}", result.form);
    let heldout = result.heldout.rms_arcsec;
    println!("left out {heldout} arcsec");
    assert!(heldout < 6.0, "{heldout}");
    let few = calibrate(&facility.table(&setup, 5, 10, 4), &setup, &CalibrateOptions::default()).unwrap();
    assert!(few.warnings.iter().any(|warning| warning.contains("at least 60 points")), "{:?}", few.warnings);

    let mut table = facility.table(&setup, 20, 100, 4);
    table.rows.iter_mut().for_each(|row| row.sigma_px = Some(facility.noise_px(l_of(row.digital_count))));
    let whole = calibrate(&table, &setup, &CalibrateOptions::default()).unwrap();
    table.rows[7].sigma_px = None;
    let one_empty = calibrate(&table, &setup, &CalibrateOptions::default()).unwrap();
    assert_eq!(one_empty.outliers, whole.outliers);
    assert!((one_empty.heldout.rms_arcsec / whole.heldout.rms_arcsec - 1.0).abs() < 0.01);
    assert!(one_empty.warnings.iter().any(|warning| warning.contains("1 of 2000 rows")));
}

#[test]
fn a_likely_facility_is_found_from_faint_to_bright() {
    let setup = wide();
    let table = LIKELY.table(&setup, 40, 200, 1);
    let (result, read) = calibrated(&table, &CalibrateOptions::default());
    print!("{}", retina_calibration::geometry::text_summary(&result, &setup));
    assert!(result.form.irradiance_power >= 2, "{:?}", result.form);
    for count in [16.0, 68.0, 255.0] {
        // Jitter of 0.8 arcsec over 40 exposures leaves 0.13 of the shift, the noise little more.
        let worst = worst_arcsec(&LIKELY, &setup, &read, count);
        println!("count {count}: worst {worst:.3} arcsec");
        assert!(worst < 0.8, "count {count}: {worst}");
    }
    // 3 % of 8000 points, of which a hundredth fall close to where they should.
    assert!((200..290).contains(&result.outliers), "{}", result.outliers);
    assert!((result.jitter_arcsec / 0.8 - 1.0).abs() < 0.3, "{}", result.jitter_arcsec);
    assert!(result.direct.worst_arcsec < 0.01);
    // What was written is what was found: D and D^-1 at the reference undo each other.
    let inverse = read.inverse.as_ref().unwrap();
    let u = DVec2::new(0.12, -0.08);
    let back = inverse.undistort(read.distortion.distort(u), inverse.reference_log10_irradiance);
    assert!((back - u).length() / ARCSEC < 0.01);
    let json = to_json(&result, &setup);
    assert_eq!(json["schema"], "retina.geometry-calibration/1");
    assert_eq!(json["covariance"].as_array().unwrap().len(), json["coefficients"].as_array().unwrap().len());
}

/// Points of a facility without and with a step of 0.8 px along the radius, about a point `aside_px` from the principal
/// point.
fn without_and_with_a_step(aside_px: DVec2) -> [PointsTable; 2] {
    let setup = wide();
    let smooth = Facility { coma_arcsec: 0.0, ..LIKELY }.table(&setup, 60, 300, 5);
    let pinhole = setup.camera_pinhole();
    let centre = DVec2::new(pinhole.cx_px, pinhole.cy_px) + aside_px;
    let mut stepped = smooth.clone();
    for row in &mut stepped.rows {
        let from = row.camera_px - centre;
        let r = from.length() / pinhole.fx_px;
        row.camera_px += 0.4 * ((r - 0.12) / 0.02).tanh() * from.normalize();
    }
    [smooth, stepped]
}

/// Lenses that are decentred have their rings about another point than the middle of their distortion.
#[test]
fn rings_stand_about_a_centre_of_their_own() {
    let setup = wide();
    let aside_px = DVec2::new(25.0, -12.0);
    let [smooth, result] = without_and_with_a_step(aside_px)
        .map(|table| calibrate(&table, &setup, &CalibrateOptions::default()).unwrap());
    let found_px = result.inverse.rings.as_ref().unwrap().rings.center * setup.camera_pinhole().fx_px;
    let [with, without] = [&result, &smooth].map(|found| found.heldout.rms_arcsec);
    println!("rings about {found_px}, {with} arcsec, {without} without the step");
    // The noise of these points leaves some 1.5 px.
    assert!((found_px - aside_px).length() < 4.0, "{found_px}");
    assert!(with < 1.02 * without, "{with} {without}");
}

/// A spot with coma is found beside the mean of its light by more than a pixel, and this steps up where it comes into focus.
/// Rings follow it, and what they do on the screen beyond the camera's field can still be inverted.
#[test]
fn a_sharp_ring_is_followed_and_the_mapping_inverts_over_the_whole_screen() {
    let setup = wide();
    let [smooth, table] = without_and_with_a_step(DVec2::ZERO);
    let smooth = calibrate(&smooth, &setup, &CalibrateOptions::default()).unwrap();
    let (result, read) = calibrated(&table, &CalibrateOptions::default());
    assert!(result.form.rings > 0, "{:?}", result.form);
    // A step of 0.8 px is 23 arcsec: nothing of it is left.
    let [with, without] = [&result, &smooth].map(|found| found.heldout.rms_arcsec);
    println!(
        "{:?}: {with} arcsec, {without} without the step, D within {}",
        result.form, result.direct.worst_arcsec
    );
    assert!(with < 1.02 * without, "{with} {without}");
    assert!(result.direct.worst_arcsec < 10.0, "{}", result.direct.worst_arcsec);
    let size = DVec2::new(f64::from(setup.screen.width_px), f64::from(setup.screen.height_px));
    for corner in [DVec2::ZERO, DVec2::new(size.x, 0.0), DVec2::new(0.0, size.y), size] {
        // The screen's corners, which no point was near to, are seen within some pixels of where K_f has them.
        let at = setup.facility_pinhole().line_of_sight(corner);
        let off = read.distortion.distort(at) - at;
        assert!(off.length() < 0.01, "{corner}: {off}");
    }
}

#[test]
fn the_centre_of_the_distortion_is_where_it_was_put() {
    let setup = wide();
    let facility = Facility { coma_arcsec: 0.0, ..LIKELY };
    let result =
        calibrate(&facility.table(&setup, 60, 300, 5), &setup, &CalibrateOptions::default()).unwrap();
    let physical = result.physical.unwrap();
    let off = physical.center_on_screen - facility.centre;
    println!("centre off by {:?} px, sigma {:?}", off * 5661.2, physical.center_sigma * 5661.2);
    assert!(off.x.abs() < 4.0 * physical.center_sigma.x && off.y.abs() < 4.0 * physical.center_sigma.y);
    // 0.5 px of the screen.
    assert!(physical.center_sigma.max_element() * 5661.2 < 0.5);
    // Series of the inverse of r = u (1 + k1 u^2): u = r (1 - k1 r^2 + 3 k1^2 r^4 - ...).
    assert!((physical.radial[0].0 + 0.35).abs() < 0.02, "{:?}", physical.radial);
    assert!(physical.roll_rad.abs() < 4.0 * physical.roll_sigma_rad);
}

#[test]
fn irradiance_enters_only_where_it_is_in_the_data() {
    let setup = wide();
    for seed in 0..5 {
        let table = Facility { coma_arcsec: 0.0, ..LIKELY }.table(&setup, 30, 150, 100 + seed);
        let result = calibrate(&table, &setup, &CalibrateOptions::default()).unwrap();
        assert_eq!(result.form.irradiance_power, 0, "{:?}", result.form);
        assert!((3..=5).contains(&result.form.degree), "{:?}", result.form);
    }
    // The paper's Fig. 10b: without the terms, the brightest are off by what the coma moves them.
    let table = LIKELY.table(&setup, 30, 150, 9);
    let with = calibrate(&table, &setup, &CalibrateOptions::default()).unwrap();
    let without =
        calibrate(&table, &setup, &CalibrateOptions { plain: true, ..CalibrateOptions::default() }).unwrap();
    assert!(without.heldout.rms_arcsec > 1.3 * with.heldout.rms_arcsec);
}

/// L is that of the display as it was measured: here (B / 255)^1.8, where the setup says 2.2.
#[test]
fn a_measured_response_says_how_bright_the_points_were() {
    let setup = wide();
    let table = LIKELY.table(&setup, 30, 150, 11);
    let options = CalibrateOptions { response: Some(response(&setup, 1.8)), ..CalibrateOptions::default() };
    let result = calibrate(&table, &setup, &options).unwrap();
    let [low, high] = result.inverse.range_log10_irradiance;
    let counts = || table.rows.iter().filter(|row| !row.saturated).map(|row| row.digital_count);
    let of = |count: f64| 1.8 * (count / 255.0).log10();
    assert!((low - of(counts().fold(f64::MAX, f64::min))).abs() < 1e-9);
    assert!((high - of(counts().fold(0.0, f64::max))).abs() < 1e-9);
    // The file holds the response, and every reader takes D^-1 by it.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("calibration.toml");
    write_calibration(&path, &result, &table, &setup).unwrap();
    let read = Calibration::read(&path, &setup).unwrap();
    let l = log10_irradiance(&read.screen_response(&setup), Channel::W, 51.0);
    assert!((l - of(51.0)).abs() < 1e-9, "{l}");
    // Writing again keeps it; a fit without it is refused, since its D^-1 would be read by the wrong light.
    let bytes = std::fs::read(&path).unwrap();
    write_calibration(&path, &result, &table, &setup).unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), bytes);
    let plain = calibrate(&table, &setup, &CalibrateOptions::default()).unwrap();
    let error = write_calibration(&path, &plain, &table, &setup).unwrap_err().to_string();
    assert!(error.contains("a response that the fit did not take"), "{error}");
    assert_eq!(std::fs::read(&path).unwrap(), bytes);
    // Nor may another response come later: the points' D^-1 depends on L.
    assert!(result.form.irradiance_power > 0, "{:?}", result.form);
    let mut file = CalibrationFile::read(&path, &setup).unwrap();
    let held = file.response.clone();
    let error = file.set_response(response(&setup, 2.2).record, &path, &setup).unwrap_err().to_string();
    assert!(error.contains("was fitted by another response"), "{error}");
    assert_eq!(file.response, held);
    file.set_response(response(&setup, 1.81).record, &path, &setup).unwrap();
}

#[test]
fn stated_intervals_hold_the_truth_as_often_as_they_say() {
    // D^-1 of this facility is exactly the fitted form: a similarity.
    let setup = wide();
    let facility = Facility { jitter_arcsec: 2.0, ..SIMILARITY };
    let form = ModelForm::plain(3);
    let options = CalibrateOptions { form: Some(form), plain: true, ..CalibrateOptions::default() };
    let (mut inside, mut total, mut constant) = (0, 0, 0);
    for seed in 0..400 {
        let result = calibrate(&facility.table(&setup, 24, 40, 1000 + seed), &setup, &options).unwrap();
        let n = result.inverse.columns();
        for (at, ([i, j, _], c)) in result.inverse.terms.iter().enumerate() {
            let truth =
                DVec2::new(f64::from(u8::from([*i, *j] == [1, 0])), f64::from(u8::from([*i, *j] == [0, 1])));
            for (axis, off) in (*c - truth).to_array().into_iter().enumerate() {
                let of = axis * n + at;
                let sigma = result.covariance[of * 2 * n + of].sqrt();
                // 90 % of a normal distribution.
                let within = usize::from(off.abs() < 1.644_854 * sigma);
                inside += within;
                // The shift is what exposures' jitter makes uncertain.
                constant += if i + j == 0 { within } else { 0 };
                total += 1;
            }
        }
    }
    let share = inside as f64 / total as f64;
    println!("90 % intervals hold {:.2} % of {total}", 100.0 * share);
    assert!((0.87..0.93).contains(&share), "{share}");
    let constant = constant as f64 / 800.0;
    println!("those of the shift hold {:.2} %", 100.0 * constant);
    assert!((0.86..0.94).contains(&constant), "{constant}");
}
