//! Whatever stands in a scene file, it is read or refused; nothing panics.

use proptest::prelude::*;
use retina_scene::Scene;

const SCENE: &str = r#"schema = "retina.scene/1"
setup = "setup.toml"
trajectory = { kind = "lumio-halo", frames = 3, step_s = 300.0 }
radiance_scale = "auto"
[compensation]
mode = "none"
[[body]]
name = "moon"
model = "moon.glb"
photometry = { model = "lunar-lambert", normal_albedo = 0.12, decay_deg = 60.0 }
[output]
layers = ["mask"]
"#;

const SETUP: &str = r#"schema = "retina.setup/1"
name = "fuzz"
[screen]
width_px = 64
height_px = 40
width_mm = 18.7
height_mm = 11.75
bits = 8
[camera]
width_px = 64
height_px = 48
pixel_um = 3.45
focal_mm = 50.0
f_number = 2.8
bits = 12
[facility]
observed_rows_px = 40
"#;

/// Reads a scene and a setup of these texts; the model file is missing, so no scene is accepted.
fn is_refused(scene: &[u8], setup: &[u8]) -> bool {
    let folder = tempfile::tempdir().expect("a temporary folder");
    std::fs::write(folder.path().join("scene.toml"), scene).expect("the scene is written");
    std::fs::write(folder.path().join("setup.toml"), setup).expect("the setup is written");
    Scene::read(folder.path().join("scene.toml")).is_err()
}

/// `text` with the bytes at `at` replaced.
fn spoiled(text: &str, at: usize, with: &[u8]) -> Vec<u8> {
    let at = at % text.len();
    let mut out = text.as_bytes()[..at].to_vec();
    out.extend(with);
    out.extend(text.as_bytes().iter().skip(at + with.len()));
    out
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn any_bytes_are_refused(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
        prop_assert!(is_refused(&bytes, SETUP.as_bytes()));
    }

    #[test]
    fn spoiled_scenes_are_refused(at in any::<usize>(), with in proptest::collection::vec(any::<u8>(), 1..6)) {
        prop_assert!(is_refused(&spoiled(SCENE, at, &with), SETUP.as_bytes()));
    }

    #[test]
    fn spoiled_setups_are_refused(at in any::<usize>(), with in "[-0-9a-z.=\\[\\]\"e]{1,5}") {
        prop_assert!(is_refused(SCENE.as_bytes(), &spoiled(SETUP, at, with.as_bytes())));
    }
}
