//! Campaigns against a calibration that was made from another campaign: its own error is no effect.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;
#[path = "../../retina-calibration/tests/common/response.rs"]
mod response;

use std::path::Path;
use std::sync::Arc;

use common::{ARCSEC, Campaign, Point, setup};
use glam::DVec2;
use retina_calibration::geometry::{CalibrateOptions, calibrate, write_calibration};
use retina_diagnosis::{
    AddedEffect, Baseline, Dataset, DiagnoseOptions, Diagnosis, Source, Verdict, compare, diagnose, fit,
    write_model,
};
use retina_formats::{Calibration, Measurements, PointsTable};
use retina_geometry::{
    COMAS_MM, ComaForm, ComaShifts, ComaTracer, RADIAL_KNOTS, RadialTable, Setup, SpotShifts,
};

/// A lens whose fifth and seventh orders a calibration of a few hundred points follows with a visible error.
fn lens(p: &Point) -> DVec2 {
    let u = p.r / 0.1413;
    p.r + u * (60.0 * u.length_squared().powi(2) - 25.0 * u.length_squared().powi(3)) * ARCSEC
}

/// A calibration from a campaign of 1000 points, as a file.
fn calibrated(folder: &Path, setup: &Setup, seed: u64) -> std::path::PathBuf {
    let mut campaign = Campaign::new(seed);
    campaign.rows = 1000;
    let table = folder.join("points.csv");
    std::fs::write(&table, campaign.table(setup, &lens)).unwrap();
    let table = PointsTable::read(&[table]).unwrap();
    let result = calibrate(&table, setup, &CalibrateOptions::default()).unwrap();
    let path = folder.join("calibration.toml");
    write_calibration(&path, &result, &table, setup).unwrap();
    path
}

fn against(
    setup: &Setup,
    calibration: &Path,
    seed: u64,
    flips: usize,
    effect: &dyn Fn(&Point) -> DVec2,
) -> Diagnosis {
    let data = data_against(setup, calibration, seed, effect);
    diagnose(&data, &[], &DiagnoseOptions { flips, seed: 1 })
}

fn data_against(setup: &Setup, calibration: &Path, seed: u64, effect: &dyn Fn(&Point) -> DVec2) -> Dataset {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("table.csv");
    std::fs::write(&path, Campaign::new(seed).table(setup, effect)).unwrap();
    let calibration = Calibration::read(calibration, setup).unwrap();
    let tables = Measurements::read(&[path]).unwrap();
    let source = Source {
        tables: &tables,
        setup,
        calibration: Some(&calibration),
        response: None,
        baseline: Baseline::Physical,
    };
    Dataset::new(&source).unwrap()
}

/// Lenses whose coma turns the field's edge the other way as it grows.
#[derive(Debug)]
struct Turning;

impl ComaTracer for Turning {
    fn coma_form(&self, coma_mm: f64) -> Option<ComaForm> {
        const HALF_TAN: f64 = 0.175;
        let table = |of: &dyn Fn(f64) -> f64| {
            let at = |k: usize| of(RadialTable::place(HALF_TAN, k + 1) / HALF_TAN);
            RadialTable::new(HALF_TAN, std::array::from_fn(at))
        };
        let grown = |rho: f64| 7.2e2 * coma_mm * rho.powi(4);
        let none = table(&|_| 0.0);
        Some(ComaForm {
            coma_mm,
            tangent_per_coma: table(&|rho| 0.18 - 0.48 * rho * rho + grown(rho)),
            coma_per_depth: none,
            beyond_proportion: table(&grown),
            round: [none; 4],
        })
    }
}

/// A coma that lies between those whose forms are known is traced anew: its value is that of the bench, and nothing else
/// is seen. By the nearest form it is a quarter too small.
#[test]
fn a_coma_between_those_traced_is_traced_anew() {
    let folder = tempfile::tempdir().unwrap();
    let setup = setup();
    let calibration = calibrated(folder.path(), &setup, 1);
    let lenses = SpotShifts {
        height_mm: [50.0, 0.0, 0.0],
        per_depth: [RadialTable { half_tan: 0.175, values: [-0.02; RADIAL_KNOTS] }; 4],
        coma: Some(ComaShifts {
            growing: COMAS_MM.map(|coma_mm| Turning.coma_form(coma_mm).unwrap()),
            tangent_per_even_coma: [RadialTable { half_tan: 0.175, values: [0.3; RADIAL_KNOTS] }; 2],
        }),
    };
    let coma_mm = 4.6e-4;
    let truth = Turning.coma_form(coma_mm).unwrap();
    let seen = |p: &Point| lens(p) + coma_mm / 0.1413 * truth.moved(lens(p), DVec2::ZERO);
    let data = data_against(&setup, &calibration, 32, &seen).with_spot_shifts(lenses);
    let options = DiagnoseOptions { flips: 999, seed: 1 };
    let coma_um = |found: &Diagnosis| found.physical[0].as_ref().map(|own| [own.value, own.sigma]);
    let nearest = diagnose(&data, &[], &options);
    println!("{:?} {:?} {:?}", nearest.accepted, coma_um(&nearest), nearest.unexplained.covariates);
    let found = diagnose(&data.with_coma_tracer(Arc::new(Turning)), &[], &options);
    println!("{:?} {:?} {:?}", found.accepted, coma_um(&found), found.unexplained.covariates);
    assert_eq!(found.accepted, ["flux_coma"]);
    assert!(found.unexplained.covariates.is_empty(), "{:?} {:?}", found.unexplained, found.notes);
    let [value, sigma] = coma_um(&found).unwrap();
    assert!((value - 0.46).abs() < 3.0 * sigma + 0.002, "{value} {sigma}");
    assert!(coma_um(&nearest).unwrap()[0] < 0.4, "{:?}", coma_um(&nearest));
}

/// Three calibrations, three campaigns without an effect for each: at most 2 alarms of 9 (a rate of 5 % gives more in
/// 1 %).
#[test]
fn the_calibrations_own_error_is_no_effect() {
    let setup = setup();
    let mut alarms = Vec::new();
    for c in 0..3 {
        let folder = tempfile::tempdir().unwrap();
        let path = calibrated(folder.path(), &setup, 500 + c);
        for seed in 0..3 {
            let found = against(&setup, &path, 600 + 10 * c + seed, 499, &lens);
            if found.verdict != Verdict::Adequate {
                alarms.push((c, seed, found.accepted, found.unexplained.covariates));
            }
        }
    }
    println!("{alarms:?}");
    assert!(alarms.len() <= 2, "{alarms:?}");
}

/// What is much larger than that error is named beside it.
#[test]
fn effects_beyond_the_calibrations_error_are_named() {
    let setup = setup();
    let folder = tempfile::tempdir().unwrap();
    let path = calibrated(folder.path(), &setup, 700);
    let tilt = DVec2::new(0.8, -0.6) * 8.0 * ARCSEC / (0.1413 * 0.1413);
    let found = against(&setup, &path, 701, 999, &|p| lens(p) / (1.0 + tilt.dot(p.r)));
    assert!(["screen_tilt", "camera_pointing"].iter().all(|id| found.indistinguishable.contains(id)));
    assert_eq!(found.verdict, Verdict::Confounded, "{:?}", found.unexplained);
    let knock = DVec2::new(3.0, 1.0) * ARCSEC;
    let found =
        against(&setup, &path, 702, 999, &|p| lens(p) + knock * f64::from(u8::from(p.exposure >= 23)));
    assert_eq!((found.verdict, found.accepted), (Verdict::Named, vec!["knock"]));
    let coma = |p: &Point| lens(p) + p.r / 0.1413 * 4.0 * ARCSEC * (p.f / (p.f + 0.15) - 0.5) * 2.0;
    let found = against(&setup, &path, 703, 999, &coma);
    assert_eq!((found.verdict, found.accepted), (Verdict::Named, vec!["flux_coma"]));
}

/// Lenses as built bow the image otherwise than the setup's do, by 5 % of a bow of 60 arcsec at the field's edge: that is
/// no further effect. A tilt that does more is found beside it.
#[test]
fn forms_of_lenses_as_built_are_no_further_effects() {
    let setup = setup();
    let folder = tempfile::tempdir().unwrap();
    let path = calibrated(folder.path(), &setup, 800);
    let bow = |p: &Point| {
        let DVec2 { x, y } = p.r / 0.1413;
        let r2 = x * x + y * y;
        let as_built = r2 * DVec2::new(0.5 * x * x - 0.4 * y, 0.6 * x * y - 0.3 * x + 0.4 * y * y * y);
        60.0 * ARCSEC * ((x * x - y * y) * DVec2::new(x, y) + 0.06 * as_built)
    };
    let alone = against(&setup, &path, 801, 999, &|p| lens(p) + bow(p));
    assert_eq!(alone.accepted, ["screen_bow"], "{:?}", alone.rivals);
    assert!(alone.unexplained.covariates.is_empty(), "{:?}", alone.unexplained);
    // The error without the bow is told without what its form may be off by.
    assert!(alone.steps[0].heldout_rms > 2.0 * alone.steps[1].heldout_rms, "{:?}", alone.steps);
    let tilt = DVec2::new(0.8, -0.6) * 15.0 * ARCSEC / (0.1413 * 0.1413);
    let both = against(&setup, &path, 802, 999, &|p| (lens(p) + bow(p)) / (1.0 + tilt.dot(p.r)));
    assert_eq!(both.accepted.len(), 2, "{:?} {:?}", both.accepted, both.unexplained);
    assert!(["screen_bow", "screen_tilt"].iter().all(|id| both.indistinguishable.contains(id)));
    // Beside the bow, which is much larger, the second one alone would not be significant.
    let p_value = |id: &&str| both.candidates.iter().find(|c| c.effect == *id).unwrap().p_value;
    assert!(both.accepted.iter().all(|id| p_value(id) <= 0.01), "{:?}", both.candidates);
}

/// The display follows (B / 255)^1.3, and coma moves bright points. A calibration that was made by this response is read
/// by it; by the setup's exponent 2.2 its D^-1 would be taken at the wrong irradiance. A model that is fitted on top keeps
/// response and covariance.
#[test]
fn a_calibration_is_read_by_its_own_response() {
    let setup = setup();
    let coma = |p: &Point| p.r + 20.0 * ARCSEC * (p.count / 255.0).log10() * 1.3 * p.r / 0.1413;
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, seed: u64, effect: &dyn Fn(&Point) -> DVec2| {
        let path = folder.path().join(name);
        std::fs::write(&path, Campaign::new(seed).table(&setup, effect)).unwrap();
        path
    };
    let table = PointsTable::read(&[write("first.csv", 5, &coma)]).unwrap();
    let measured = response::response(&setup, 1.3);
    let options = CalibrateOptions { response: Some(measured.clone()), ..CalibrateOptions::default() };
    let result = calibrate(&table, &setup, &options).unwrap();
    let path = folder.path().join("calibration.toml");
    write_calibration(&path, &result, &table, &setup).unwrap();
    let calibration = Calibration::read(&path, &setup).unwrap();

    let tables = Measurements::read(&[write("second.csv", 6, &coma)]).unwrap();
    let data = |tables: &Measurements, calibration: &Calibration| {
        Dataset::new(&Source {
            tables,
            setup: &setup,
            calibration: Some(calibration),
            response: None,
            baseline: Baseline::Physical,
        })
        .unwrap()
    };
    let rms = |calibration: &Calibration| compare(&data(&tables, calibration), &[]).rms;
    let (right, wrong) = (rms(&calibration), rms(&Calibration { response: None, ..calibration.clone() }));
    println!("by its own response {right:.3} arcsec, by the setup's {wrong:.3}");
    // Noise 1.5 and jitter 0.45 arcsec: 1.57, and the calibration's own error.
    assert!(right < 1.85 && wrong > 1.05 * right, "{right} {wrong}");

    let tilted = |p: &Point| coma(p) + 20.0 * ARCSEC * p.r.x / 0.1413 * p.r / 0.1413;
    let tables = Measurements::read(&[write("third.csv", 7, &tilted)]).unwrap();
    let found = data(&tables, &calibration);
    let added = [AddedEffect::read("screen_tilt", &found).unwrap()];
    let model = folder.path().join("model.toml");
    let Measurements::Points(points) = &tables else { panic!("points") };
    let fitted = fit(&found, &added).unwrap();
    write_model(&model, &found, &fitted, &added, &setup, points, Some(&calibration)).unwrap();
    let model = Calibration::read(&model, &setup).unwrap();
    assert_eq!(model.response, Some(measured));
    let covariance = model.covariance.as_ref().unwrap();
    assert!(covariance.iter().all(|value| value.is_finite()) && covariance[0] > 0.0);
    // It says how far the model is from the truth, in the middle and at the edge: both axes over a grid of places.
    let inverse = model.inverse.as_ref().unwrap();
    let side = inverse.columns();
    for reach in [0.2, 1.0] {
        let (mut squares, mut stated) = (0.0, 0.0);
        for i in 0..=6 {
            for j in 0..=6 {
                let u = reach * DVec2::new(0.045 * (f64::from(i) - 3.0), 0.033 * (f64::from(j) - 3.0));
                let turned = DVec2::from_angle(0.01).rotate(u * (1.0 + 0.35 * u.length_squared()));
                let point = Point {
                    r: turned * 1.002 + DVec2::new(3e-4, -2e-4),
                    camera_px: DVec2::ZERO,
                    screen_px: DVec2::ZERO,
                    f: 1.0,
                    time_s: 0.0,
                    temperature_c: 20.0,
                    row_load: 0.5,
                    channel: 3,
                    count: 100.0,
                    exposure: 0,
                };
                let at = tilted(&point);
                let l = 1.3 * (100.0f64 / 255.0).log10();
                let off = (inverse.undistort(at, l) - u) / ARCSEC;
                let mut values = vec![0.0; side];
                inverse.fill(at, l, &mut values);
                let term =
                    |i: usize, j: usize| values[i % side] * covariance[2 * side * i + j] * values[j % side];
                let variance = |axis: usize| -> f64 {
                    (0..side * side).map(|k| term(axis * side + k / side, axis * side + k % side)).sum()
                };
                squares += 0.5 * off.length_squared();
                stated += 0.5 * (variance(0) + variance(1)) / (ARCSEC * ARCSEC);
            }
        }
        let ratio = (squares / stated).sqrt();
        println!(
            "to {reach} of the field: {ratio:.2} of what is stated, {:.3} arcsec",
            (stated / 49.0).sqrt()
        );
        assert!((0.6..1.3).contains(&ratio), "{ratio}");
    }
    // The model stands for the tilted facility: on fresh points of it nothing but noise is left.
    let fresh = Measurements::read(&[write("fourth.csv", 8, &tilted)]).unwrap();
    let (with, without) = (data(&fresh, &model), data(&fresh, &calibration));
    let [with_rms, without_rms] = [&with, &without].map(|data| compare(data, &[]).rms);
    println!("the model leaves {with_rms:.3} arcsec, the calibration {without_rms:.3}");
    assert!(with_rms < 0.8 * without_rms, "{with_rms} {without_rms}");
}
