//! A real photograph of the Moon (andrepiz/abram, CC BY-SA 4.0), which lies beside the repository in `../shared`, or
//! nowhere: then nothing is tested, and the test says so.

use std::path::{Path, PathBuf};

use retina_diagnosis::DiagnoseOptions;
use retina_frames::{FrameSet, FramesSource, diagnose_frames};
use retina_geometry::Setup;
use retina_sky::Trajectory;
use retina_sky::ephemeris::Ephemeris;
use retina_sky::planets::Planet;
use retina_sky::site::Site;
use retina_sky::time::parse_epoch;

const SETUP: &str = r#"
schema = "retina.setup/1"
name = "moon-25mm"
[screen]
width_px = 1920
height_px = 1200
width_mm = 18.7
height_mm = 11.75
bits = 8
wavelength_nm = { r = 605.0, g = 544.0, b = 475.0 }
[camera]
width_px = 2048
height_px = 1536
pixel_um = 3.45
focal_mm = 25.0
f_number = 4.0
bits = 8
[facility]
observed_rows_px = 1200
"#;

/// From a smooth Lambert sphere: the error of tiles left out falls at every step, the map and the law are among what is
/// found, and the outline is as large as the ephemeris has it (33.78 px in the capture's own data) for the nominal
/// focal length, within the 2 % by which a lens may differ.
#[test]
fn the_moon_is_explained_step_by_step() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let photo = root.join("../shared/data/real/moon_25mm/photo.png");
    if !photo.exists() {
        println!("skipped: {} is not there", photo.display());
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let absolute = |path: &Path| std::fs::canonicalize(path).unwrap();
    // The site and the time of capture.toml.
    let site = Site {
        latitude_rad: 45.848_510f64.to_radians(),
        longitude_rad: 8.381_019f64.to_radians(),
        altitude_m: 455.0,
    };
    let pose = site
        .looking_at(&Ephemeris::analytic(), Planet::Moon, parse_epoch("2023-12-22T19:21:25 UTC").unwrap())
        .unwrap();
    std::fs::write(path("site.csv"), Trajectory::new(Path::new("site"), vec![pose]).to_csv()).unwrap();
    std::fs::write(path("setup.toml"), SETUP).unwrap();
    let model = absolute(&root.join("assets/bodies/moon.glb"));
    let scene = format!(
        "schema = \"retina.scene/1\"\nsetup = \"setup.toml\"\ntrajectory = \"site.csv\"\nradiance_scale = 1.0\n\
         [[body]]\nname = \"moon\"\nmodel = {model:?}\n\
         photometry = {{ model = \"lambert\", normal_albedo = 0.12 }}\n[stars]\nfaintest_magnitude = 0.0\n"
    );
    std::fs::write(path("scene.toml"), scene).unwrap();
    let table = format!("scene,frame,start,measured\nscene.toml,0,smooth,{}\n", absolute(&photo).display());
    std::fs::write(path("frames.csv"), table).unwrap();

    let setup = Setup::read(&path("setup.toml")).unwrap();
    let files: [PathBuf; 1] = [path("frames.csv")];
    let mut set =
        FrameSet::read(&FramesSource { files: &files, setup: &setup, calibration: None, register: true })
            .unwrap();
    let (data, _, found) = diagnose_frames(&mut set, &[], &DiagnoseOptions { flips: 499, seed: 1 }).unwrap();
    for step in &found.steps {
        println!("{:.4} ({:.4}) DN  {:?}", step.heldout_rms, step.heldout_rms_unweighted, step.effects);
    }
    println!(
        "{:?} noise {:.4}, {} pixels, {} saturated",
        found.verdict,
        found.noise.floor(),
        data.len(),
        data.saturated
    );
    for candidate in found.candidates.iter().filter(|c| found.accepted.contains(&c.effect)) {
        println!("{} {:?}", candidate.effect, candidate.parameters);
    }
    println!("{}", data.notes.join("\n"));
    assert_eq!(data.saturated, 262);
    assert!(found.steps.windows(2).all(|pair| pair[1].heldout_rms < pair[0].heldout_rms));
    for effect in ["albedo_map", "photometric_function", "defocus"] {
        assert!(found.accepted.contains(&effect), "{effect}: {:?}", found.accepted);
    }
    let (first, last) = (found.steps[0].heldout_rms, found.steps[found.steps.len() - 1].heldout_rms);
    assert!(last < 0.25 * first, "{first} {last}");
    let svg = set.pictures();
    assert!(svg.matches("measured - predicted").count() == found.steps.len());
}
