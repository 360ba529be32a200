//! Alignment of a bench whose misalignment the aligner is not told.

use retina_campaign::{Effect, Facility, TemperatureProfile};
use retina_formats::TableKind;
use retina_geometry::Setup;
use retina_lab::{
    AlignOptions, Aligner, BenchCamera, BenchCameraOptions, BenchScreen, CameraSpec, Screw, Turns,
    open_camera,
};

fn setup() -> Setup {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/setups/wide-fov.toml");
    Setup::read(path.as_ref()).unwrap()
}

#[test]
fn a_bench_is_aligned_in_four_rounds() {
    let setup = setup();
    let mut facility = Facility::new(&setup, &[] as &[Effect], TableKind::Frames, 600.0, 5).unwrap();
    let mut truth = Turns::default();
    for (screw, value) in [
        (Screw::ScreenTiltX, 0.3),
        (Screw::ScreenTiltY, -0.2),
        (Screw::ScreenShiftX, 0.2),
        (Screw::ScreenShiftY, -0.15),
        (Screw::ScreenFocus, 0.1),
        (Screw::CameraPointingX, 0.1),
        (Screw::CameraPointingY, 0.05),
        (Screw::CameraRoll, 0.4),
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
    let options = AlignOptions { settle_s: 0.0, ..AlignOptions::default() };
    let mut aligner = Aligner::new(&setup, options, dir.path()).unwrap();
    let mut turned = Turns::default();
    for round in 0..5 {
        let start = std::time::Instant::now();
        let found =
            aligner.round(&mut screen, camera.as_mut(), &turned, dir.path(), &|| false, |_, _| {}).unwrap();
        println!(
            "round {round}: {} points, width {:.3}, rms {:?}",
            found.points, found.width_px, found.rms_px
        );
        for (screw, estimate) in &found.screws {
            println!(
                "  {screw:?}: {:.4} +- {:.4}, truth {:.4}",
                estimate.value,
                estimate.sigma,
                truth.get(*screw)
            );
        }
        println!("  {:.1} s", start.elapsed().as_secs_f64());
        turned = found.turn;
        camera.turn(&turned).unwrap();
        truth = truth.and(&turned);
    }
}
