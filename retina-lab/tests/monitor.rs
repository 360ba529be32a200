//! Reference points of a bench whose camera moves.
#![allow(clippy::unwrap_used, reason = "a test may fail")]

use retina_campaign::{Facility, TemperatureProfile};
use retina_formats::TableKind;
use retina_geometry::Setup;
use retina_lab::{
    BenchCamera, BenchCameraOptions, BenchScreen, CameraSpec, Monitor, MonitorOptions, Rig, Screw, Turns,
    open_camera,
};

#[test]
fn a_camera_that_moves_raises_an_alarm() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/setups/wide-fov.toml");
    let setup = Setup::read(path.as_ref()).unwrap();
    let facility = Facility::new(&setup, &[], TableKind::Frames, 600.0, 5).unwrap();
    let mut screen = BenchScreen::new([setup.screen.width_px, setup.screen.height_px]);
    let options =
        BenchCameraOptions { temperature: TemperatureProfile::Constant, ..BenchCameraOptions::default() };
    let bench = BenchCamera::new(facility, Box::new(screen.clone()), options).unwrap();
    let mut camera = open_camera(&CameraSpec::Bench, setup.camera.bits, Some(bench)).unwrap();
    let mut rig =
        Rig { screen: &mut screen, camera: camera.as_mut(), settle_s: 0.0, gain_db: 0.0, stop: &|| false };
    let dir = tempfile::tempdir().unwrap();
    let open = |points: usize| {
        Monitor::open(&setup, None, MonitorOptions { points, ..MonitorOptions::default() }, dir.path())
    };
    let mut monitor = open(80).unwrap();
    for _ in 0..2 {
        let still = monitor.round(&mut rig).unwrap();
        assert!(still.alarms.is_empty() && still.rms_arcsec < 1.5, "{still:?}");
    }
    // The camera points 18 arcsec towards +x and rolls by 36 arcsec: the scene goes the other way.
    let mut turns = Turns::default();
    turns.set(Screw::CameraPointingX, 0.005);
    turns.set(Screw::CameraRoll, 0.01);
    rig.camera.turn(&turns).unwrap();
    // A later run goes on from the first round.
    drop(monitor);
    let mut monitor = open(80).unwrap();
    assert_eq!(monitor.readings().len(), 2);
    let moved = monitor.round(&mut rig).unwrap();
    let [x, y] = moved.boresight_arcsec;
    assert!((x + 18.0).abs() < 0.5 && y.abs() < 0.5, "{moved:?}");
    assert!((moved.roll_arcsec.abs() - 36.0).abs() < 3.0 && moved.left_arcsec < 1.5, "{moved:?}");
    assert_eq!(moved.alarms.len(), 1, "{:?}", moved.alarms);
    assert!(dir.path().join("monitor.svg").is_file());
    let others = open(60).err().unwrap().to_string();
    assert!(others.contains("other reference points"), "{others}");
}
