//! A Moon that the project's own renderer made, photographed with known noise: its map, its relief and its law are known
//! to be those of the scene, so that from a smooth sphere both have to come out as they are.

use std::path::{Path, PathBuf};

use glam::DMat3;
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, Normal};
use retina_diagnosis::{compare, fit, fit_page};
use retina_frames::{FrameSet, FramesSource};
use retina_geometry::Setup;
use retina_image::CameraImage;
use retina_render::{BodyState, CpuRenderer, CpuSampling, FrameState, Planes, Quality};
use retina_report::Section;
use retina_scene::Scene;
use retina_sky::Trajectory;
use retina_sky::ephemeris::Ephemeris;
use retina_sky::planets::Planet;
use retina_sky::site::Site;
use retina_sky::time::parse_epoch;

const WIDTH: u32 = 176;
const HEIGHT: u32 = 144;
const SETUP: &str = r#"
schema = "retina.setup/1"
name = "known-moon"
[screen]
width_px = 192
height_px = 120
width_mm = 1.87
height_mm = 1.175
bits = 8
wavelength_nm = { r = 605.0, g = 544.0, b = 475.0 }
[camera]
width_px = 176
height_px = 144
pixel_um = 3.45
focal_mm = 25.0
f_number = 4.0
bits = 8
[facility]
observed_rows_px = 120
"#;

/// The noise that is added, DN; rounding adds a twelfth to its square.
const NOISE_DN: f64 = 1.0;
const BRIGHTEST_DN: f64 = 200.0;
/// How the camera stands beside what the table says.
const ROLL_RAD: f64 = 0.1;
const SHIFT_PX: [f64; 2] = [6.3, -4.6];
/// Its focal length beside the setup's.
const FOCAL: f64 = 1.004;

struct Moon {
    folder: tempfile::TempDir,
}

impl Moon {
    fn new(seed: u64, mirrored: bool) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let site = Site {
            latitude_rad: 45.85f64.to_radians(),
            longitude_rad: 8.38f64.to_radians(),
            altitude_m: 455.0,
        };
        let pose = site
            .looking_at(&Ephemeris::analytic(), Planet::Moon, parse_epoch("2023-12-22T19:21:25 UTC").unwrap())
            .unwrap();
        std::fs::write(path("site.csv"), Trajectory::new(Path::new("site"), vec![pose]).to_csv()).unwrap();
        std::fs::write(path("setup.toml"), SETUP).unwrap();
        let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/bodies/moon.glb");
        let scene = format!(
            "schema = \"retina.scene/1\"\nsetup = \"setup.toml\"\ntrajectory = \"site.csv\"\nradiance_scale = 1.0\n\
             [[body]]\nname = \"moon\"\nmodel = {:?}\nshading = \"smooth\"\n\
             photometry = {{ model = \"lambert\", normal_albedo = 0.12 }}\n[stars]\nfaintest_magnitude = 0.0\n",
            std::fs::canonicalize(model).unwrap()
        );
        std::fs::write(path("scene.toml"), scene).unwrap();
        for start in ["smooth", "as-given"] {
            let table = format!("scene,frame,start,measured\nscene.toml,0,{start},photo.png\n");
            std::fs::write(path(&format!("{start}.csv")), table).unwrap();
        }
        let moon = Self { folder };
        moon.photograph(seed, mirrored);
        moon
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Rendered at full quality for the camera, turned and shifted, with noise.
    fn photograph(&self, seed: u64, mirrored: bool) {
        let scene = Scene::read(self.path("scene.toml")).unwrap();
        let setup = Setup::read(&self.path("setup.toml")).unwrap();
        let mut image = setup.camera_pinhole();
        image.cx_px += SHIFT_PX[0];
        image.cy_px += SHIFT_PX[1];
        image.fx_px *= FOCAL;
        image.fy_px *= FOCAL;
        let state = scene.frame(0).unwrap().bodies[0];
        let turn = DMat3::from_rotation_z(ROLL_RAD);
        let state = BodyState {
            position_camera_m: turn * state.position_camera_m,
            camera_from_body: turn * state.camera_from_body,
            ..state
        };
        let sampling = CpuSampling::from(Quality::Default);
        let renderer = CpuRenderer::new(scene.models().to_vec(), sampling, Planes::RadianceFactor);
        let rendered = renderer.render(&FrameState { image, distortion: None, bodies: vec![state] });
        let light = rendered.plane(1);
        let brightest = f64::from(light.iter().copied().fold(0.0, f32::max));
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let noise = Normal::new(0.0, NOISE_DN).unwrap();
        let mut out = CameraImage::new(WIDTH, HEIGHT, 255.0);
        for at in 0..light.len() {
            let (x, y) = (at % WIDTH as usize, at / WIDTH as usize);
            let from = if mirrored { y * WIDTH as usize + WIDTH as usize - 1 - x } else { at };
            let dn = 12.0 + BRIGHTEST_DN * f64::from(light[from]) / brightest + noise.sample(&mut random);
            out.values[at] = dn.round().clamp(0.0, 255.0) as f32;
        }
        out.write_png(&self.path("photo.png")).unwrap();
    }

    fn read(&self, start: &str) -> Result<FrameSet, retina_files::InputError> {
        let setup = Setup::read(&self.path("setup.toml")).unwrap();
        let files = [self.path(&format!("{start}.csv"))];
        FrameSet::read(&FramesSource { files: &files, setup: &setup, calibration: None, register: true })
    }
}

/// The map is that of the scene: power 1, contrast 1; the relief is, too. What is left is the noise.
#[test]
fn the_scenes_own_map_and_relief_come_out() {
    let moon = Moon::new(1, false);
    let mut set = moon.read("smooth").unwrap();
    let effects = ["albedo_map".to_owned(), "relief".to_owned()];
    let (data, added) = set.with_effects(&effects).unwrap();
    let found = fit(&data, &added).unwrap();
    for p in &found.parameters {
        println!("{} = {} {:?}", p.name, p.value, p.sigma);
    }
    println!("{:?} noise {}", found.steps, found.noise.floor());
    let value = |name: &str| found.parameters.iter().find(|p| p.name == name).unwrap().value;
    // The site looks at the Moon's middle: it is moved as the camera's is, and parameters and note say the same.
    for (name, truth, within) in [
        ("shift_x_px", SHIFT_PX[0], 0.02),
        ("shift_y_px", SHIFT_PX[1], 0.02),
        ("roll_rad", ROLL_RAD, 1e-3),
        ("scale_relative", FOCAL - 1.0, 3e-4),
    ] {
        assert!((value(name) - truth).abs() < within, "{name} {} for {truth}", value(name));
    }
    let note = data.notes.iter().find(|note| note.contains("is seen at")).unwrap();
    println!("{note}");
    assert_eq!(data.notes.iter().filter(|note| note.contains("times as large")).count(), 1);
    let told: f64 = note.split("scale_relative ").nth(1).unwrap().trim_end_matches(')').parse().unwrap();
    assert!((told - value("scale_relative")).abs() < 1e-4, "{told}");
    assert!(note.contains(&format!("{:.5} +- ", 1.0 + told)), "{note}");
    assert!((found.noise.floor() / 1.04 - 1.0).abs() < 0.05, "{}", found.noise.floor());
    assert_eq!(value("albedo_map.power"), 1.0);
    assert!((value("albedo_map.contrast") - 1.0).abs() < 0.05);
    assert!((value("relief.share") - 1.0).abs() < 0.1);
}

/// The noise is told as it is although most of the map is missing, and the sky has no angles.
#[test]
fn noise_and_covariates_do_not_depend_on_what_is_missing() {
    let moon = Moon::new(3, false);
    let data = moon.read("smooth").unwrap().dataset(false).unwrap();
    let found = compare(&data, &[]);
    println!("rms {} ({}) noise {}", found.rms, found.rms_unweighted, found.noise.floor());
    assert!(found.rms_unweighted > 5.0);
    let true_noise = (NOISE_DN * NOISE_DN + 1.0 / 12.0).sqrt();
    assert!((found.noise.floor() / true_noise - 1.0).abs() < 0.25, "{}", found.noise.floor());
    let of = |name: &str| &data.covariates.iter().find(|c| c.name == name).unwrap().values;
    let beside = of("limb_distance_px");
    for name in ["incidence_deg", "emission_deg", "longitude_deg", "latitude_deg"] {
        let absent = of(name).iter().filter(|v| v.is_nan()).count();
        assert!(absent > data.len() / 4 && absent < data.len(), "{name} {absent} of {}", data.len());
        for (value, beside) in of(name).iter().zip(beside) {
            assert!(value.is_nan() || *beside < 1.0, "{name} {value} {beside} px beside the body");
        }
    }
}

/// Images are drawn as images: three states are well below a page's megabyte, and so is the page.
#[test]
fn pictures_are_small() {
    let moon = Moon::new(4, false);
    let mut set = moon.read("smooth").unwrap();
    let (data, added) = set.with_effects(&["albedo_map".to_owned(), "relief".to_owned()]).unwrap();
    let svg = set.pictures();
    println!("{} bytes", svg.len());
    assert_eq!(svg.matches("data:image/png;base64,").count(), 7);
    assert!(svg.len() < 250_000, "{}", svg.len());
    let page = fit_page(&data, &added, &fit(&data, &added).unwrap());
    page.section(Section::new("Images").figure(&svg, "")).write(&moon.path("page.html")).unwrap();
    let bytes = std::fs::metadata(moon.path("page.html")).unwrap().len();
    println!("page {bytes} bytes");
    assert!(bytes < 1_000_000, "{bytes}");
    // A model that leaves nothing predicts what was measured.
    let perfect = set.pictures_of_fit("with everything", &vec![0.0; data.len()]);
    assert!(perfect.contains("with everything: predicted"));
    let pictures: Vec<&str> =
        perfect.split("data:image/png;base64,").skip(1).map(|png| &png[..2000]).collect();
    assert_eq!(pictures.len(), 9);
    assert_eq!(pictures[7], pictures[1]);
    assert_ne!(pictures[0], pictures[1]);
}

/// East and west exchanged: refused, with the mend; the smooth ball that registration begins with cannot tell.
#[test]
fn a_mirrored_photograph_is_refused() {
    let moon = Moon::new(2, true);
    for start in ["smooth", "as-given"] {
        let error = moon.read(start).err().unwrap();
        let said = format!("{error} | {:?} {:?}", error.found, error.help);
        println!("{said}");
        assert!(said.contains("the image is mirrored") && said.contains("flip the image"), "{said}");
    }
}
