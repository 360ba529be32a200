//! A sequence on the virtual bench in this process: taken, interrupted, resumed.
#![allow(clippy::unwrap_used, reason = "a test may fail")]

use std::cell::Cell;
use std::path::Path;

use retina_calibration::geometry::{Pattern, PatternOptions, points_from_images};
use retina_campaign::{Facility, TemperatureProfile};
use retina_formats::TableKind;
use retina_geometry::Setup;
use retina_image::DetectOptions;
use retina_lab::{
    BenchCamera, BenchCameraOptions, BenchScreen, CameraSpec, CaptureOptions, LabCamera, LabError, Rig,
    ScreenView as _, Sequence, capture, open_camera,
};

fn bench() -> (Setup, BenchScreen, Box<dyn LabCamera>) {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/setups/wide-fov.toml");
    let setup = Setup::read(path.as_ref()).unwrap();
    let facility = Facility::new(&setup, &[], TableKind::Frames, 600.0, 5).unwrap();
    let screen = BenchScreen::new([setup.screen.width_px, setup.screen.height_px]);
    let options =
        BenchCameraOptions { temperature: TemperatureProfile::Constant, ..BenchCameraOptions::default() };
    let bench = BenchCamera::new(facility, Box::new(screen.clone()), options).unwrap();
    let camera = open_camera(&CameraSpec::Bench, setup.camera.bits, Some(bench)).unwrap();
    (setup, screen, camera)
}

fn rig<'a>(
    screen: &'a mut BenchScreen,
    camera: &'a mut Box<dyn LabCamera>,
    stop: &'a dyn Fn() -> bool,
) -> Rig<'a> {
    Rig { screen, camera: camera.as_mut(), settle_s: 0.0, gain_db: 0.0, stop }
}

fn sequence(setup: &Setup, folder: &Path) -> Sequence {
    let options =
        PatternOptions { points: 100, screens: Some(3), counts: vec![255, 200], ..PatternOptions::default() };
    Pattern::make(setup, &options).unwrap().write(folder, setup, 1).unwrap();
    Sequence::read(folder, setup).unwrap()
}

#[test]
fn an_interrupted_capture_goes_on_and_its_images_calibrate() {
    let dir = tempfile::tempdir().unwrap();
    let (setup, mut screen, mut camera) = bench();
    let sequence = sequence(&setup, &dir.path().join("pattern"));
    let options = CaptureOptions { repeats: 2, ..CaptureOptions::default() };
    let out = dir.path().join("out");
    let there = Cell::new(0);
    let stop = || there.get() == 4;
    let mut cut = rig(&mut screen, &mut camera, &stop);
    let cut = capture(&sequence, &mut cut, &options, &out, &mut |_, _| Ok(()), |done, _| there.set(done));
    assert!(matches!(cut, Err(LabError::Interrupted)));
    // An image whose line is not in the log, as a killed run leaves it, is taken again.
    std::fs::write(out.join("images/002-r0.png"), "torn").unwrap();
    let mut seen = Vec::new();
    let mut whole = rig(&mut screen, &mut camera, &|| false);
    let done =
        capture(&sequence, &mut whole, &options, &out, &mut |_, _| Ok(()), |done, of| seen.push((done, of)))
            .unwrap();
    assert_eq!((done.skipped, done.taken), (4, 2));
    assert_eq!((seen.first(), seen.last()), (Some(&(4, 6)), Some(&(6, 6))));
    assert!(screen.read().unwrap().counts.iter().all(|counts| *counts == [0; 3]), "the screen is not dark");
    let pattern = dir.path().join("pattern");
    let (table, images) =
        points_from_images(&out.join("images"), &pattern, &setup, &DetectOptions::default()).unwrap();
    assert_eq!(images.len(), 6);
    assert!(
        table.rows.len() > 500 && table.rows.iter().all(|row| row.exposure_s.is_some()),
        "{}",
        table.rows.len()
    );
    let saturated = table.rows.iter().filter(|row| row.saturated).count();
    assert_eq!(saturated, 0);
    let times: Vec<f64> = table.rows.iter().filter_map(|row| row.time_s).collect();
    assert!(times.is_sorted() && times[0] == 0.0);
    // The folder is of this sequence with these options.
    let other = CaptureOptions { repeats: 3, ..options };
    let refused = capture(
        &sequence,
        &mut rig(&mut screen, &mut camera, &|| false),
        &other,
        &out,
        &mut |_, _| Ok(()),
        |_, _| {},
    );
    assert!(refused.unwrap_err().to_string().contains("other options"));
}
