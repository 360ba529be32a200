//! A bench with a display that is wrong in several ways.
#![allow(clippy::unwrap_used, reason = "a test may fail")]

use std::time::Duration;

use retina_bench::ScreenImage;
use retina_campaign::{Effect, Facility, TemperatureProfile};
use retina_formats::TableKind;
use retina_geometry::Setup;
use retina_lab::{
    BenchCamera, BenchCameraOptions, BenchScreen, CameraSpec, Finding, Grade, LabError, Rig, Screen, check,
    open_camera,
};

/// A display that mirrors what it shows, bends its response, has pixels that are always dark or lit, and is late.
struct Wrong(BenchScreen);

impl Screen for Wrong {
    fn show(&mut self, image: &ScreenImage) -> Result<(), LabError> {
        let (width, mut shown) = (image.width_px as usize, image.clone());
        let bent: [u8; 256] =
            std::array::from_fn(|count| (255.0 * (count as f64 / 255.0).powf(1.15)).round() as u8);
        for row in shown.counts.chunks_mut(width) {
            row.reverse();
            for counts in row {
                *counts = counts.map(|count| bent[usize::from(count)]);
            }
        }
        for (x, y) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            shown.counts[(400 + y) * width + 600 + x] = [0; 3];
            shown.counts[(700 + y) * width + 1200 + x] = [255; 3];
        }
        let mut late = self.0.clone();
        std::thread::spawn(move || {
            std::thread::sleep(Duration::from_millis(100));
            late.show(&shown)
        });
        Ok(())
    }

    fn verifies(&self) -> bool {
        false
    }
}

#[test]
fn the_card_names_what_is_wrong() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/setups/wide-fov.toml");
    let setup = Setup::read(path.as_ref()).unwrap();
    let effects = [Effect::parse("optical_centre=20,0").unwrap()];
    let facility = Facility::new(&setup, &effects, TableKind::Frames, 600.0, 5).unwrap();
    let screen = BenchScreen::new([setup.screen.width_px, setup.screen.height_px]);
    let options =
        BenchCameraOptions { temperature: TemperatureProfile::Constant, ..BenchCameraOptions::default() };
    let bench = BenchCamera::new(facility, Box::new(screen.clone()), options).unwrap();
    let mut camera = open_camera(&CameraSpec::Bench, setup.camera.bits, Some(bench)).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let mut wrong = Wrong(screen);
    let mut rig =
        Rig { screen: &mut wrong, camera: camera.as_mut(), settle_s: 0.11, gain_db: 0.0, stop: &|| false };
    let card = check(&setup, &mut rig, dir.path(), |_, _| {}).unwrap();
    let of = |what: &str| -> &Finding { card.iter().find(|finding| finding.what == what).unwrap() };
    for (what, grade) in [
        ("dark level", Grade::Good),
        ("noise of the dark", Grade::Good),
        ("light on a dark screen", Grade::Look),
        ("dark specks", Grade::Look),
        ("dead camera pixels", Grade::Good),
        ("response of the screen", Grade::Look),
        ("response of the camera", Grade::Good),
        ("mirror", Grade::Bad),
        ("centring", Grade::Look),
        ("roll", Grade::Good),
        ("focus", Grade::Good),
        ("time to the glass", Grade::Bad),
    ] {
        let finding = of(what);
        assert_eq!(finding.grade, grade, "{finding:?}");
        assert_eq!(finding.mend.is_empty(), grade == Grade::Good, "{finding:?}");
    }
    let value = |what: &str, key: &str| of(what).values.iter().find(|value| value.0 == key).unwrap().1;
    assert_eq!(
        (value("light on a dark screen", "places"), value("dark specks", "places")),
        (1.0, 1.0),
        "{card:?}"
    );
    assert!((value("response of the screen", "gamma") - 2.2 * 1.15).abs() < 0.05);
    assert!((0.1..0.16).contains(&value("time to the glass", "wanted_settle_s")));
    for image in ["dark.png", "flat.png", "pattern.png"] {
        assert!(dir.path().join(image).is_file(), "{image}");
    }
}
