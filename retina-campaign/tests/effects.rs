//! Every effect that the bench takes by id does something, each in its own way.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

use std::path::Path;
use std::sync::LazyLock;

use retina_bench::{Exposure, OpticsDetail, ScreenImage};
use retina_campaign::{
    Effect, EffectKind, Facility, PowerOptions, TemperatureProfile, known_effects, simulate_power,
};
use retina_formats::{EffectId, FramesEffect, PointsEffect, PowerEffect, TableKind};
use retina_geometry::Setup;

fn setup() -> Setup {
    Setup::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/setups/wide-fov.toml")).unwrap()
}

/// A size that nobody overlooks.
fn size(kind: &EffectKind) -> &'static str {
    match (kind.id, kind.units[0].0) {
        (EffectId::Power(PowerEffect::Gamma), _) => "2.5",
        (EffectId::Power(PowerEffect::AttenuatorNotChanged), _) => "3",
        // A campaign lasts minutes, the loss is stated for 1000 hours.
        (EffectId::Power(PowerEffect::Ageing), _) => "1000000%",
        (EffectId::Points(PointsEffect::SubpixelOffset), _) => "0.1px",
        (EffectId::Points(PointsEffect::ThermalFocal), _) => "500ppm/K",
        (EffectId::Frames(FramesEffect::Saturation), _) => "500e",
        (EffectId::Frames(FramesEffect::Defocus), _) => "0.5mm",
        (EffectId::Frames(FramesEffect::Ghost), _) => "0.3",
        (EffectId::Frames(FramesEffect::Vignetting), _) => "0.5",
        (_, "deg") => "0.5deg",
        (_, "arcsec") => "100arcsec,100arcsec",
        (_, "arcsec/h") => "100arcsec/h",
        (_, "arcsec/K") => "100arcsec/K",
        (_, "um") => "2um",
        (_, "px") => "3px",
        (_, "e/s") => "5000e/s",
        (_, "nW") => "100nW",
        (_, "DN") => "20DN",
        _ => "0.2",
    }
}

fn effect(kind: &EffectKind) -> Effect {
    let values: Vec<&str> = size(kind).split(',').take(kind.values).collect();
    Effect::parse(&format!("{}={}", kind.id.name(), values.join(","))).unwrap()
}

/// What the camera sees of points of all colours, a loaded row and a bright square, an hour into a campaign at 24 degC.
fn photograph(effects: &[Effect]) -> Vec<u16> {
    let setup = setup();
    let facility = Facility::new(&setup, effects, TableKind::Frames, 3600.0, 1).unwrap();
    let bench = facility.bench(OpticsDetail { nodes: [3, 3], lines: 3, half_px: 12 }).unwrap();
    let mut screen = ScreenImage::dark(setup.screen.width_px, setup.screen.height_px);
    for (k, counts) in [[255; 3], [255, 0, 0], [0, 255, 0], [0, 0, 255], [60; 3]].into_iter().enumerate() {
        screen.set(500 + 200 * k as u32, 300 + 130 * k as u32, counts);
    }
    for column in 300..900 {
        screen.set(column, 430, [40; 3]);
    }
    for at in 0..64 * 64 {
        screen.set(1300 + at % 64, 400 + at / 64, [255; 3]);
    }
    let pose = facility.dynamics.pose(bench.camera().pinhole.fx_px, 0.0, 3600.0, 24.0, 1, 0);
    let exposure = Exposure { exposure_s: 0.5 * bench_exposure_s(), temperature_c: 24.0, pose, frame: 0 };
    bench.expose(&screen, &exposure).unwrap().dn
}

/// The square's pixels are well exposed, without an effect that changes the sensor.
fn bench_exposure_s() -> f64 {
    static EXPOSURE_S: LazyLock<f64> = LazyLock::new(|| {
        let facility = Facility::new(&setup(), &[], TableKind::Frames, 3600.0, 1).unwrap();
        let bench = facility.bench(OpticsDetail { nodes: [3, 3], lines: 3, half_px: 12 }).unwrap();
        bench.sensor().full_well_e() / (6.0 * bench.sharpest_peak_e_s())
    });
    *EXPOSURE_S
}

#[test]
fn every_effect_on_images_changes_the_photograph() {
    let without = photograph(&[]);
    let mut seen: Vec<(&str, Vec<u16>)> = Vec::new();
    for kind in known_effects().filter(|kind| kind.id.table() != TableKind::Power) {
        let with = photograph(&[effect(&kind)]);
        let changed = with.iter().zip(&without).filter(|(a, b)| a.abs_diff(**b) > 3).count();
        println!("{:<24} {changed} pixels", kind.id.name());
        assert!(changed >= 5, "{} changes {changed} pixels", kind.id.name());
        for (other, image) in &seen {
            let pair = ["image_shift", "knock", "drift", "thermal_boresight"];
            let alike = pair.contains(other) && pair.contains(&kind.id.name());
            assert!(alike || *image != with, "{} does what {other} does", kind.id.name());
        }
        seen.push((kind.id.name(), with));
    }
    assert!(seen.len() > 30);
}

#[test]
fn every_effect_on_power_changes_the_readings() {
    let setup = setup();
    let options = PowerOptions {
        counts: vec![16, 64, 255],
        squares_px: vec![0, 100, 400],
        noise_w: 0.0,
        repeatability: 0.0,
        temperature: TemperatureProfile::WarmUp,
        ..PowerOptions::default()
    };
    let readings = |effects: &[Effect]| -> Vec<f64> {
        let facility = Facility::new(&setup, effects, TableKind::Power, 0.0, 1).unwrap();
        simulate_power(&facility, &options).unwrap().rows.iter().map(|row| row.irradiance_w_m2).collect()
    };
    let without = readings(&[]);
    let mut count = 0;
    for kind in known_effects().filter(|kind| kind.id.table() == TableKind::Power) {
        let with = readings(&[effect(&kind)]);
        let most = with.iter().zip(&without).map(|(a, b)| (a / b - 1.0).abs()).fold(0.0, f64::max);
        println!("{:<24} {most:.2e}", kind.id.name());
        assert!(most > 1e-5, "{} changes readings by {most:e} at most", kind.id.name());
        count += 1;
    }
    assert_eq!(count, PowerEffect::ALL.len());
}

/// The mount belongs to the facility. So a drift along x moves points as a shift of the screen's points along x does, however
/// the camera is turned about the boresight.
#[test]
fn a_drift_keeps_the_facilitys_axes_when_the_camera_is_turned() {
    let setup = setup();
    let drift = Effect::parse("drift=40arcsec/h").unwrap();
    let mut cosines = Vec::new();
    for roll_deg in [0.0f64, 90.0, -35.0] {
        let mut facility =
            Facility::new(&setup, std::slice::from_ref(&drift), TableKind::Points, 3600.0, 1).unwrap();
        facility.wrong.camera_roll_rad = roll_deg.to_radians();
        let bench = facility.bench(OpticsDetail { nodes: [3, 3], lines: 3, half_px: 12 }).unwrap();
        let focal_px = bench.camera().pinhole.fx_px;
        let land = |x: f64, time_s: f64| {
            let pose = facility.dynamics.pose(focal_px, roll_deg.to_radians(), time_s, 20.0, 1, 0);
            let exposure = Exposure { exposure_s: 0.01, temperature_c: 20.0, pose, frame: 0 };
            glam::DVec2::from_array(bench.land_px([x, 600.5], 1, &exposure).unwrap())
        };
        let (moved, along) = (land(960.5, 3600.0) - land(960.5, 0.0), land(970.5, 0.0) - land(960.5, 0.0));
        assert!(moved.length() > 1.0, "{moved}");
        cosines.push(moved.dot(along) / (moved.length() * along.length()));
    }
    assert!(cosines.iter().all(|own| (own - cosines[0]).abs() < 1e-3 && own.abs() > 0.999), "{cosines:?}");
}
