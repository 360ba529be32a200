//! A bench whose misalignment the aligner is not told.
#![allow(clippy::unwrap_used, reason = "a test may fail")]

use retina_campaign::{Facility, TemperatureProfile};
use retina_formats::TableKind;
use retina_geometry::Setup;
use retina_lab::{
    AlignOptions, Aligner, BenchCamera, BenchCameraOptions, BenchScreen, CameraSpec, Rig, Screw, Turns,
    open_camera,
};

/// The screws' positions of a small misalignment in one round. (How a large one is turned away in three is in
/// VALIDATION.md: it takes minutes.)
#[test]
fn a_round_says_how_far_each_screw_is_off() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/setups/wide-fov.toml");
    let setup = Setup::read(path.as_ref()).unwrap();
    let mut facility = Facility::new(&setup, &[], TableKind::Frames, 600.0, 5).unwrap();
    let mut truth = Turns::default();
    for (screw, value) in [
        (Screw::ScreenTiltX, 0.06),
        (Screw::ScreenShiftY, -0.05),
        (Screw::ScreenFocus, 0.03),
        (Screw::CameraPointingX, 0.05),
        (Screw::CameraRoll, 0.1),
    ] {
        truth.set(screw, value);
    }
    truth.apply(&mut facility.wrong);
    let mut screen = BenchScreen::new([setup.screen.width_px, setup.screen.height_px]);
    let options =
        BenchCameraOptions { temperature: TemperatureProfile::Constant, ..BenchCameraOptions::default() };
    let bench = BenchCamera::new(facility, Box::new(screen.clone()), options).unwrap();
    let mut camera = open_camera(&CameraSpec::Bench, setup.camera.bits, Some(bench)).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let options = AlignOptions { exposures: 6, ..AlignOptions::default() };
    let mut aligner = Aligner::new(&setup, options, dir.path()).unwrap();
    let mut rig =
        Rig { screen: &mut screen, camera: camera.as_mut(), settle_s: 0.0, gain_db: 0.0, stop: &|| false };
    let found = aligner.round(&mut rig, &Turns::default(), dir.path(), |_, _| {}).unwrap();
    for (screw, estimate) in &found.screws {
        let error = estimate.value - truth.get(*screw);
        assert!(error.abs() < 0.03, "{screw:?}: {estimate:?}, truth {}", truth.get(*screw));
        assert_eq!(found.turn.get(*screw), -estimate.value);
    }
    let roll = found.screws[&Screw::CameraRoll].value;
    assert!((roll - 0.1).abs() < 0.002, "{roll}");
}
