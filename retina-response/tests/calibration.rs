//! From tables to `calibration.toml` and back, and what is made of it.

#![allow(clippy::unwrap_used, reason = "a test")]

mod common;

use std::path::{Path, PathBuf};

use common::{TRUTH, Truth, plan, readings, write_table};
use retina_formats::{Calibration, CalibrationFile, MeasuredResponse, RadiometricCalibration};
use retina_geometry::Setup;
use retina_radiometry::{ZERO_MAGNITUDE_W_M2_NM, irradiance_of_magnitude_w_m2_nm};
use retina_response::{
    Calibrated, PowerReadings, ShownLight, SpectralForm, json_document, report_page, summary,
};

fn setup(name: &str) -> Setup {
    Setup::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/setups").join(name)).unwrap()
}

/// Truths of red, green and blue: unequal in light, gamma and black.
fn truths() -> [Truth; 3] {
    [(2.1e-8, 2.23), (2.4e-8, 2.18), (1.4e-8, 2.2)].map(|(full_w_m2, gamma)| Truth {
        full_w_m2,
        gamma,
        black: 1e-5,
        ..TRUTH
    })
}

fn calibrated(folder: &Path) -> Calibrated {
    let table = folder.join("power.csv");
    let drawn: Vec<_> =
        truths().iter().enumerate().map(|(c, t)| readings(t, &plan(), c as u64, true)).collect();
    write_table(&table, [&drawn[0], &drawn[1], &drawn[2]]);
    Calibrated::fit(&setup("wide-fov.toml"), PowerReadings::read(&[table]).unwrap()).unwrap()
}

/// Eq. 10 with the truths, by hand, over the bandwidth; above the black.
fn true_light_w_m2_nm(calibration: &RadiometricCalibration, counts: [u8; 3]) -> f64 {
    let each = truths().into_iter().zip(counts).zip(calibration.efficiency);
    let sum: f64 = each.map(|((t, b), eta)| eta * (t.pixel_w_m2(usize::from(b)) - t.pixel_w_m2(0))).sum();
    sum / calibration.bandwidth_nm
}

#[test]
fn eq_10_holds_for_equal_counts_and_mixtures() {
    let folder = tempfile::tempdir().unwrap();
    let found = calibrated(folder.path()).calibration;
    // The paper's 0.994, 0.979, 0.813 and 417 nm come from its own reading of the sensor's curve.
    for (eta, paper) in found.efficiency.iter().zip([0.994, 0.979, 0.813]) {
        assert!((eta - paper).abs() < 0.02, "{eta}");
    }
    assert!((found.bandwidth_nm - 417.0).abs() < 2.0);
    for counts in [[255; 3], [255, 0, 0], [0, 200, 90], [60, 61, 62], [20; 3]] {
        let (is, is_so) = (found.irradiance_w_m2_nm(counts), true_light_w_m2_nm(&found, counts));
        assert!((is / is_so - 1.0).abs() < 0.01, "{counts:?}: {is} {is_so}");
        let magnitude = -2.5 * (is_so / ZERO_MAGNITUDE_W_M2_NM).log10();
        assert!((found.magnitude(counts) - magnitude).abs() < 0.01);
    }
    let range = found.magnitude_range();
    // White at full: eta . (2.1, 2.4, 1.4)e-8 over 416 nm is 1.35e-10 W m^-2 nm^-1, magnitude -1.42.
    assert!((range.brightest + 1.42).abs() < 0.02, "{range:?}");
    // Black is 1e-5 of full: 0.1 mag is a tenth of the light, where B = 255 (1.06e-4)^(1/2.2) = 3.98; noise of
    // 1e-7 W m^-2 on 640 000 pixels is far below. So 4 or, by the noise of black, 5.
    assert!((4..=5).contains(&range.faintest_count), "{range:?}");
    let screen = found.screen_response(Path::new("c.toml")).unwrap();
    for counts in [[255; 3], [12, 13, 14], [0; 3]] {
        assert!((screen.irradiance_w_m2_nm(counts) - found.irradiance_w_m2_nm(counts)).abs() < 1e-24);
    }
}

#[test]
fn magnitudes_become_counts_and_the_nearest_is_nearest() {
    let folder = tempfile::tempdir().unwrap();
    let found = calibrated(folder.path()).calibration;
    let light = ShownLight::new(&found);
    let mut worse = 0;
    for step in 0..95 {
        let magnitude = -1.4 + 0.1 * f64::from(step);
        let wanted = irradiance_of_magnitude_w_m2_nm(magnitude);
        let off = |counts: [u8; 3]| (found.irradiance_w_m2_nm(counts) - wanted).abs();
        let grey = light.grey(magnitude);
        let best = (1..=255u8).map(|b| off([b; 3])).fold(f64::MAX, f64::min);
        assert_eq!(off(grey.counts), best, "{magnitude}");
        // Exhaustive over triples within 3 counts of each other about the grey one.
        let mixed = light.mixed(magnitude);
        let near = |c: u8| c.saturating_sub(4)..=c.saturating_add(4);
        let mut least = f64::MAX;
        for r in near(grey.counts[0]) {
            for g in near(grey.counts[0]) {
                for b in near(grey.counts[0]) {
                    let (high, low) = (r.max(g).max(b), r.min(g).min(b));
                    if high - low <= 3 && high > 0 {
                        least = least.min(off([r, g, b]));
                    }
                }
            }
        }
        assert!(off(mixed.counts) <= least, "{magnitude}: {mixed:?}");
        worse += usize::from(off(mixed.counts) > off(grey.counts));
        assert!((found.magnitude(mixed.counts) - mixed.magnitude).abs() < 1e-12);
    }
    assert_eq!(worse, 0);
    // Jupiter of Fig. 8, -2.26: 10^(0.4 x 0.84) = 2.17 times the brightest pixel, so three.
    let jupiter = light.pixels(-2.26);
    assert_eq!(jupiter.pixels, 3);
    assert!((jupiter.magnitude + 2.26).abs() < 0.01, "{jupiter:?}");
    let (grey, mixed) = (light.grey_steps(7.5, 8.5).unwrap(), light.mixed_steps(7.5, 8.5).unwrap());
    assert!(mixed.median_mag < 0.1 * grey.median_mag, "{grey:?} {mixed:?}");
}

#[test]
fn the_file_is_read_back_and_keeps_what_it_held() {
    let folder = tempfile::tempdir().unwrap();
    let wide = setup("wide-fov.toml");
    let made = calibrated(folder.path());
    let path: PathBuf = folder.path().join("calibration.toml");
    let held = "schema = \"retina.calibration/1\"\nsetup = \"wide-fov\"\nsource = \"stars\"\n\
                [distortion]\nterms = [[1, 0, 1, 0], [0, 1, 0, 1], [3, 0, 1e-3, 0]]\n";
    std::fs::write(&path, held).unwrap();
    assert_eq!(RadiometricCalibration::read(&path, &wide).unwrap(), None);
    let stored = |made: &Calibrated, setup: &Setup| {
        CalibrationFile::read_or_new(&path, setup).map(|mut file| {
            file.response = Some(made.record(&wide));
            file
        })
    };
    stored(&made, &wide).unwrap().write(&path).unwrap();
    assert_eq!(RadiometricCalibration::read(&path, &wide).unwrap().unwrap(), made.calibration);
    assert!(MeasuredResponse::read(&path, &wide).unwrap().is_some());
    let geometry = Calibration::read(&path, &wide).unwrap();
    assert_eq!(geometry.source, "stars");
    // The same tables again give the same bytes.
    let text = std::fs::read_to_string(&path).unwrap();
    assert_eq!(stored(&made, &wide).unwrap().text(), text);
    assert!(text.contains("power.csv") && !text.contains(folder.path().to_str().unwrap()));

    let narrow = setup("narrow-fov.toml");
    let error = RadiometricCalibration::read(&path, &narrow).unwrap_err();
    assert!(error.to_string().contains("belongs to another setup"), "{error}");
    let other = made.for_setup(&wide, &narrow).unwrap();
    let error = stored(&other, &narrow).unwrap_err();
    assert!(error.to_string().contains("found `wide-fov`, expected `narrow-fov`"), "{error}");
    assert!(error.help.unwrap().contains("--for-setup"));
    let mut sensor = wide.clone();
    sensor.noise.quantum_efficiency = Some(vec![[400.0, 0.5], [800.0, 0.5]]);
    let error = RadiometricCalibration::read(&path, &sensor).unwrap_err();
    assert!(error.to_string().contains("another sensor"), "{error}");

    let broken = |from: &str, to: &str| {
        let path = folder.path().join("broken.toml");
        std::fs::write(&path, text.replacen(from, to, 1)).unwrap();
        RadiometricCalibration::read(&path, &wide).unwrap_err().to_string()
    };
    assert!(broken("irradiance_w_m2 = [", "irradiance_w_m2 = [1.0, ").contains("257 values"));
    assert!(broken("sigma_w_m2 = [", "sigma_w_m2 = [-1.0, ").contains("257 values"));
    assert!(
        broken("irradiance_w_m2 = [0.", "irradiance_w_m2 = [1.").contains("does not rise with the count")
    );
    assert!(broken("knots", "nodes").contains("unknown field `nodes`"));
    assert!(broken("retina.calibration/1", "retina.setup/1").contains("is not a calibration"));
}

/// Twice the focal length in pixels is a quarter of the light: 2.5 log10(4) = 1.505 mag, as between the paper's two configurations.
#[test]
fn another_magnification() {
    let folder = tempfile::tempdir().unwrap();
    let made = calibrated(folder.path());
    let (wide, narrow) = (setup("wide-fov.toml"), setup("narrow-fov.toml"));
    let other = made.for_setup(&wide, &narrow).unwrap();
    let shift = other.calibration.magnitude([200; 3]) - made.calibration.magnitude([200; 3]);
    assert!((shift - 1.505).abs() < 0.001, "{shift}");
    assert_eq!(other.calibration.setup, "narrow-fov");
    let relative = |c: &Calibrated| c.fits[0].full_w_m2.sigma / c.fits[0].full_w_m2.value;
    assert!((relative(&other) - relative(&made)).abs() < 1e-12);
    let mut display = narrow.clone();
    display.screen.width_mm *= 1.5;
    let error = made.for_setup(&wide, &display).unwrap_err();
    assert!(error.to_string().contains("another display"), "{error}");
}

/// With lines of no width and a flat spectrum eq. 8 is eq. 10.
#[test]
fn eq_8_becomes_eq_10() {
    let folder = tempfile::tempdir().unwrap();
    let found = calibrated(folder.path()).calibration;
    let mut narrow_lines = setup("wide-fov.toml");
    narrow_lines.optics.linewidth_nm = [0.0; 3];
    let form = SpectralForm::of(&narrow_lines, &found);
    assert_eq!(form.line_efficiency, found.efficiency);
    assert!(form.stars[0].difference_mag.abs() < 1e-12);
    // A sensor whose eta is a straight line sees a line's width not at all, where it lies inside.
    let mut straight = setup("wide-fov.toml");
    straight.noise.quantum_efficiency = Some(vec![[200.0, 0.5], [900.0, 0.5]]);
    let form = SpectralForm::of(&straight, &found);
    for (eta, nm) in form.line_efficiency.iter().zip([605.0, 544.0, 475.0]) {
        assert!((eta - nm / 900.0).abs() < 1e-6, "{eta}");
    }
}

#[test]
fn the_documents_say_what_was_found() {
    let folder = tempfile::tempdir().unwrap();
    let made = calibrated(folder.path());
    let wide = setup("wide-fov.toml");
    let json = json_document(&made, &wide);
    assert_eq!(json["schema"], "retina.radiometry-calibration/1");
    assert_eq!(json["monotone"], true);
    assert_eq!(json["channels"]["b"]["response"]["irradiance_w_m2"].as_array().unwrap().len(), 256);
    assert_eq!(json["magnitude_range"][0], made.calibration.magnitude_range().brightest);
    let lines = summary(&made, &wide);
    let page = report_page(&made, &lines).html();
    // One a panel: the channels, the light, the magnitudes.
    assert_eq!(page.matches("<svg").count(), 3);
    assert!(!page.contains("<script") && !page.contains("src=") && page.contains("blue"));
}

/// White readings 2 % below the sum of the channels are told as such.
#[test]
fn white_is_compared_with_its_channels() {
    let folder = tempfile::tempdir().unwrap();
    calibrated(folder.path());
    let table = folder.path().join("power.csv");
    let mut text = std::fs::read_to_string(&table).unwrap();
    for count in [60usize, 100, 140, 180, 220, 255] {
        let sum: f64 = truths().iter().map(|t| t.pixel_w_m2(count)).sum();
        text += &format!("w,{count},200,{},\n", 4e4 * 0.98 * sum + TRUTH.zero_w_m2);
    }
    std::fs::write(&table, text).unwrap();
    let found = Calibrated::fit(&setup("wide-fov.toml"), PowerReadings::read(&[table]).unwrap()).unwrap();
    let additivity = found.additivity.unwrap();
    assert_eq!(additivity.readings, 6);
    assert!((additivity.ratio - 0.98).abs() < 0.003, "{additivity:?}");
}
