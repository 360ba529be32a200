//! A bench camera in front of a screen that the test changes.

use std::sync::Mutex;

use retina_formats::TableKind;
use retina_geometry::Setup;

use super::*;

/// A screen whose images follow each other at given times after the first look.
struct Film {
    images: Vec<(f64, Arc<ScreenImage>)>,
    start: Arc<Mutex<Option<Instant>>>,
}

impl ScreenView for Film {
    fn read(&mut self) -> Result<Arc<ScreenImage>, LabError> {
        let elapsed_s = self.start.lock().unwrap().get_or_insert_with(Instant::now).elapsed().as_secs_f64();
        let shown = self.images.iter().rev().find(|(from_s, _)| *from_s <= elapsed_s);
        Ok(Arc::clone(&shown.unwrap().1))
    }
}

fn setup() -> Setup {
    let text = "schema = \"retina.setup/1\"\nname = \"small\"\n\
        [screen]\nwidth_px = 1920\nheight_px = 1200\nwidth_mm = 18.7\nheight_mm = 11.75\nbits = 8\n\
        wavelength_nm = { r = 605.0, g = 544.0, b = 475.0 }\n\
        [camera]\nwidth_px = 2048\nheight_px = 1536\npixel_um = 3.45\nfocal_mm = 25.0\nf_number = 2.8\nbits = 12\n\
        [facility]\nobserved_rows_px = 1200\n\
        [response]\ngamma = 2.2\nbrightest_magnitude = -1.44\n\
        [noise]\njitter_arcsec = 0.0\nhot_pixels = 0.0\n";
    Setup::parse(text, "setup.toml".as_ref()).unwrap()
}

fn point(column: u32, count: u8) -> Arc<ScreenImage> {
    let mut image = ScreenImage::dark(1920, 1200);
    image.set(column, 600, [count; 3]);
    Arc::new(image)
}

fn camera(images: Vec<(f64, Arc<ScreenImage>)>) -> BenchCamera {
    let facility = Facility::new(&setup(), &[], TableKind::Frames, 600.0, 1).unwrap();
    let view = Box::new(Film { images, start: Arc::default() });
    let options = BenchCameraOptions {
        temperature: TemperatureProfile::Constant,
        detail: OpticsDetail { nodes: [5, 3], lines: 1, half_px: 12 },
    };
    BenchCamera::new(facility, view, options).unwrap()
}

fn shot(exposure_s: f64) -> Shot {
    Shot { number: 3, exposure_s, gain: 1.0, knobs: vec![0.0; Screw::ALL.len()] }
}

/// Light of the spot in a range of columns: digital counts above their median within 8 px of the brightest.
fn light(dn: &[u16], columns: std::ops::Range<usize>) -> f64 {
    let inside = |i: &usize| columns.contains(&(i % 2048));
    let brightest = (0..dn.len()).filter(inside).max_by_key(|&i| dn[i]).unwrap();
    let (x, y) = (brightest % 2048, brightest / 2048);
    assert!(dn[brightest] < 3900, "saturated");
    let rows = (y - 8..=y + 8).flat_map(|y| &dn[y * 2048 + x - 8..=y * 2048 + x + 8]);
    rows.map(|&dn| f64::from(dn) - f64::from(dn_of_no_light())).sum()
}

fn dn_of_no_light() -> u16 {
    setup().noise.offset_dn as u16
}

#[test]
fn the_same_exposure_of_the_same_screen_has_the_same_bytes_and_gain_multiplies() {
    let mut camera = camera(vec![(0.0, point(960, 255))]);
    let first = camera.take(&shot(0.002)).unwrap();
    assert_eq!(first, camera.take(&shot(0.002)).unwrap());
    let twice = camera.take(&Shot { gain: 2.0, ..shot(0.002) }).unwrap();
    let [one, two] = [&first, &twice].map(|dn| light(dn, 800..1248));
    assert!(one > 500.0 && (two / one - 2.0).abs() < 0.2, "{one} {two}");
}

#[test]
fn screens_that_follow_each_other_within_an_exposure_share_its_light() {
    // The second image stands for three quarters of the exposure, as far as a busy machine looks in time.
    let mut camera = camera(vec![(0.0, point(760, 18)), (0.5, point(1160, 18))]);
    let dn = camera.take(&shot(2.0)).unwrap();
    let [first, second] = [light(&dn, 400..1024), light(&dn, 1024..1648)];
    assert!(first > 0.0 && (1.5..6.0).contains(&(second / first)), "{first} {second}");
}

#[test]
fn a_screw_moves_the_image() {
    let mut camera = camera(vec![(0.0, point(960, 255))]);
    let centre = |dn: &[u16]| {
        let weights: Vec<f64> = dn.iter().map(|&dn| f64::from(dn.saturating_sub(60))).collect();
        let sum: f64 = weights.iter().sum();
        weights.iter().enumerate().map(|(i, w)| w * (i % 2048) as f64).sum::<f64>() / sum
    };
    let before = centre(&camera.take(&shot(0.01)).unwrap());
    let mut turned = shot(0.01);
    turned.knobs[Screw::CameraPointingX as usize] = 0.1;
    let after = centre(&camera.take(&turned).unwrap());
    // The boresight goes to +x, so the image goes to -x, by f tan(angle).
    let expected = -25.0 / 3.45e-3 * 0.1f64.to_radians().tan();
    assert!((after - before - expected).abs() < 0.3, "{before} {after} {expected}");
    assert!((centre(&camera.take(&shot(0.01)).unwrap()) - before).abs() < 0.1);
}

#[test]
fn a_camera_rolled_by_its_screw_drifts_as_one_that_stands_rolled() {
    let mut camera = camera(vec![(0.0, point(960, 255))]);
    camera.facility.dynamics.drift_per_s = [1e-5, 0.0];
    camera.facility.wrong.camera_roll_rad = 10f64.to_radians();
    let stands = camera.pose(60.0, 20.0, 0);
    camera.facility.wrong.camera_roll_rad = 0.0;
    camera.turned.set(Screw::CameraRoll, 10.0);
    assert_eq!(camera.pose(60.0, 20.0, 0), stands);
    camera.turned.set(Screw::CameraRoll, 0.0);
    assert!((camera.pose(60.0, 20.0, 0).shift_px - stands.shift_px).length() > 0.5);
}
