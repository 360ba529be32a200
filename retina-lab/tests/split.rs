//! Light finer than the screen's counts, photographed on the virtual bench.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

use std::fs;
use std::path::Path;

use retina_campaign::{Facility, TemperatureProfile};
use retina_formats::{TableKind, measured_or_power_law};
use retina_geometry::Setup;
use retina_image::{CameraImage, ReadOptions};
use retina_lab::{
    BenchCamera, BenchCameraOptions, BenchScreen, CameraSpec, CaptureOptions, Rig, Sequence, SplitWriter,
    capture, open_camera, split,
};

/// Light of one square of the frame as a part of full light, and what the other is brighter by: a part of the screen's step
/// there, half of it.
const LIGHT: f32 = 1.5e-4;
const BRIGHTER: f32 = 0.1;
const SHARES: [f64; 3] = [0.85, 0.1, 0.05];
const SIDE_PX: usize = 90;

#[test]
fn a_difference_below_the_screens_step_is_in_the_photograph() {
    let setup = Setup::shipped(Path::new("wide-fov")).unwrap();
    let facility = Facility::new(&setup, &[], TableKind::Frames, 600.0, 5).unwrap();
    let size_px = [setup.screen.width_px, setup.screen.height_px];
    let [width, height] = size_px.map(|size| size as usize);
    // Two squares on either side of the middle, alike in the optics.
    let mut light = vec![0.0f32; width * height];
    let columns = [width / 2 - 60 - SIDE_PX, width / 2 + 60];
    for (number, left) in columns.into_iter().enumerate() {
        for row in height / 2 - SIDE_PX / 2..height / 2 + SIDE_PX / 2 {
            let value = LIGHT * (1.0 + BRIGHTER * number as f32);
            light[row * width + left..row * width + left + SIDE_PX].fill(value);
        }
    }
    let (screens, error) = split(&light, size_px, &measured_or_power_law(None, &setup), 255, &SHARES);
    assert!(error.relative_rms < 2e-2 && error.relative_rms_of_one > 5e-2, "{error:?}");
    let folder = tempfile::tempdir().unwrap();
    let plain = vec![LIGHT; light.len()].iter().zip(&light).map(|(l, own)| l.min(*own)).collect::<Vec<_>>();
    let mut writer = SplitWriter::new(&folder.path().join("split"), &setup, &SHARES).unwrap();
    // The same twice: once with two equal squares, whose ratio is the camera's own.
    for (name, image) in [("equal", &plain), ("brighter", &light)] {
        let (screens, _) = split(image, size_px, &measured_or_power_law(None, &setup), 255, &SHARES);
        writer.add(name, Path::new("light.png"), &screens).unwrap();
    }
    writer.finish().unwrap();
    fs::write(folder.path().join("split/light.png"), "named by split.csv, not read").unwrap();
    assert_eq!(screens.len(), 3);

    let mut screen = BenchScreen::new(size_px);
    let options =
        BenchCameraOptions { temperature: TemperatureProfile::Constant, ..BenchCameraOptions::default() };
    let bench = BenchCamera::new(facility, Box::new(screen.clone()), options).unwrap();
    let mut camera = open_camera(&CameraSpec::Bench, setup.camera.bits, Some(bench)).unwrap();
    let mut rig =
        Rig { screen: &mut screen, camera: camera.as_mut(), settle_s: 0.0, gain_db: 0.0, stop: &|| false };
    let sequence = Sequence::read(&folder.path().join("split"), &setup).unwrap();
    assert_eq!(sequence.frames.len(), 2);
    let options = CaptureOptions { exposures_s: vec![1.0], repeats: 2 };
    let out = folder.path().join("out");
    let taken = capture(&sequence, &mut rig, &options, &out, &mut |_, _| Ok(()), |_, _| {}).unwrap();
    assert_eq!(taken.taken, 4);
    // Light of the right half over that of the left one, all repeats together.
    let ratio = |name: &str| {
        let mut sums = [0.0f64; 2];
        for repeat in 0..2 {
            let read = ReadOptions { bits: Some(setup.camera.bits), colour_to_grey: false };
            let image = CameraImage::read(&out.join(format!("images/{name}-r{repeat}.png")), read).unwrap();
            // Hot pixels are brighter than any light here.
            let mut sorted = image.values.clone();
            sorted.sort_by(f32::total_cmp);
            let brightest = sorted[sorted.len() - 300];
            assert!(
                brightest > 0.05 * image.full_scale_dn && brightest < 0.98 * image.full_scale_dn,
                "{brightest}"
            );
            let half = image.width_px as usize / 2;
            for (at, value) in image.values.iter().enumerate() {
                if *value > 0.5 * brightest {
                    sums[usize::from(at % image.width_px as usize >= half)] += f64::from(*value);
                }
            }
        }
        sums[1] / sums[0]
    };
    let found = ratio("brighter") / ratio("equal") - 1.0;
    println!("brighter by {found:.5}");
    assert!((found - f64::from(BRIGHTER)).abs() < 0.02, "{found}");
    // How long each screen was there is in a table beside.
    let parts = fs::read_to_string(out.join("parts.csv")).unwrap();
    assert_eq!(parts.lines().count(), 13);
    for line in parts.lines().skip(1) {
        let cells: Vec<&str> = line.split(',').collect();
        let [share, shown_s] = [cells[2], cells[3]].map(|cell| cell.parse::<f64>().unwrap());
        assert!((shown_s - share).abs() < 0.1, "{line}");
    }
}
