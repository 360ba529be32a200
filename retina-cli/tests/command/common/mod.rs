//! A small scene in a folder of its own, and the command run on it.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use retina_model::{BuildSpec, build_body};

/// Focal length of the small screen, pixels.
pub(crate) const FOCAL_PX: f64 = 900.0;
/// Radius of the body, m; its disc has a radius of 40 px.
pub(crate) const RADIUS_M: f64 = 1000.0;
pub(crate) const DISTANCE_M: f64 = 22_500.0;
pub(crate) const AU_M: f64 = 149_597_870_700.0;

pub(crate) const SETUP: &str = r#"
schema = "retina.setup/1"
name = "small"
[screen]
width_px = 160
height_px = 100
width_mm = 1.6
height_mm = 1.0
bits = 8
[camera]
width_px = 120
height_px = 90
pixel_um = 5.0
focal_mm = 5.0
f_number = 2.8
bits = 12
[facility]
intrinsics = { fx_px = 900.0, fy_px = 900.0, cx_px = 80.0, cy_px = 50.0 }
[response]
gamma = 2.2
brightest_magnitude = -1.44
"#;

pub(crate) const CALIBRATION: &str = r#"
schema = "retina.calibration/1"
setup = "small"
[distortion]
terms = [
  [1, 0, 1.0, 0.0], [0, 1, 0.0, 1.0],
  [3, 0, 12.0, 0.0], [1, 2, 12.0, 0.0], [2, 1, 0.0, 12.0], [0, 3, 0.0, 12.0],
]
"#;

pub(crate) const SCENE: &str = r#"schema = "retina.scene/1"
setup = "setup.toml"
trajectory = "poses.csv"
radiance_scale = "auto"
[compensation]
mode = "none"
calibration = "calibration.toml"
[[body]]
name = "rock"
model = "rock.glb"
shading = "smooth"
photometry = { model = "lambert", normal_albedo = 0.12 }
"#;

/// A folder with `setup.toml`, `calibration.toml`, `poses.csv` (6 frames, phase 0 to 75 deg),
/// `rock.glb` and `scene.toml`.
pub(crate) struct Fixture {
    folder: tempfile::TempDir,
}

impl Fixture {
    pub(crate) fn new() -> Self {
        Self::with_frames(6)
    }

    pub(crate) fn with_frames(frames: usize) -> Self {
        let this = Self { folder: tempfile::tempdir().unwrap() };
        this.write("setup.toml", SETUP);
        this.write("calibration.toml", CALIBRATION);
        this.write("scene.toml", SCENE);
        this.write("poses.csv", &poses(frames));
        fs::write(this.path("rock.glb"), sphere(16)).unwrap();
        this
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, text: &str) {
        fs::write(self.path(name), text).unwrap();
    }

    /// Replaces text in a file; it must be there.
    pub(crate) fn edit(&self, name: &str, from: &str, to: &str) {
        let text = fs::read_to_string(self.path(name)).unwrap();
        assert!(text.contains(from), "{name} does not hold {from}");
        self.write(name, &text.replacen(from, to, 1));
    }

    /// `retina render scene.toml --out OUT --backend cpu` and further arguments.
    pub(crate) fn render(&self, out: &str, more: &[&str]) -> Output {
        self.render_command(out, more).output().unwrap()
    }

    pub(crate) fn render_command(&self, out: &str, more: &[&str]) -> Command {
        let mut command = retina();
        command.arg("render").arg(self.path("scene.toml")).arg("--out").arg(self.path(out));
        if !more.contains(&"--backend") {
            command.args(["--backend", "cpu"]);
        }
        command.args(more);
        command
    }
}

pub(crate) fn retina() -> Command {
    Command::new(env!("CARGO_BIN_EXE_retina"))
}

/// A sphere of [`RADIUS_M`].
pub(crate) fn sphere(cells: u32) -> Vec<u8> {
    let spec = BuildSpec {
        name: "rock".into(),
        radius_m: RADIUS_M,
        relief: None,
        albedo: None,
        cells,
        texels: 16,
        jpeg_quality: None,
        sources: Vec::new(),
        copyright: None,
    };
    build_body(&spec).unwrap().glb
}

pub(crate) const HEADER: &str = "time_s,camera_x_m,camera_y_m,camera_z_m,camera_from_inertial_w,camera_from_inertial_x,\
camera_from_inertial_y,camera_from_inertial_z,sun_x_m,sun_y_m,sun_z_m";

/// Camera on -z, looking along +z at the body at the origin; 15 deg more phase angle each frame,
/// 75 deg at most.
pub(crate) fn poses(frames: usize) -> String {
    let mut text = format!("# written by a test\n{HEADER}\n");
    for frame in 0..frames {
        let phase = phase_deg(frame).to_radians();
        text += &format!(
            "{},0,0,{},1,0,0,0,{},0,{}\n",
            frame * 60,
            -DISTANCE_M,
            AU_M * phase.sin(),
            -AU_M * phase.cos()
        );
    }
    text
}

pub(crate) fn phase_deg(frame: usize) -> f64 {
    15.0 * (frame % 6) as f64
}

pub(crate) fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

pub(crate) fn assert_done(output: &Output) {
    assert_eq!(output.status.code(), Some(0), "{}", stderr(output));
}

/// The JSON document on standard output. It fits its schema, if one ships.
pub(crate) fn json(output: &Output) -> serde_json::Value {
    assert_done(output);
    let document = serde_json::from_slice(&output.stdout).unwrap();
    assert_fits_its_schema(&document);
    document
}

/// Holds a document to a schema, and the schema to its own; the error says what does not fit.
pub(crate) fn fits(schema: &serde_json::Value, document: &serde_json::Value) -> Result<(), String> {
    let (mut schemas, mut compiler) = (boon::Schemas::new(), boon::Compiler::new());
    let place = "schema.json";
    compiler.add_resource(place, schema.clone()).map_err(|error| error.to_string())?;
    let compiled = compiler.compile(place, &mut schemas).map_err(|error| format!("{error:#}"))?;
    schemas.validate(document, compiled).map_err(|error| format!("{error:#}"))
}

/// Holds a document to the schema that ships for its key `schema`; says whether there is one.
pub(crate) fn assert_fits_its_schema(document: &serde_json::Value) -> bool {
    let own = |schema: &serde_json::Value| schema["properties"]["schema"]["const"] == document["schema"];
    let schemas =
        retina_assets::SCHEMAS.map(|(_, text)| serde_json::from_str::<serde_json::Value>(text).unwrap());
    let Some(schema) = schemas.iter().find(|schema| own(schema)) else { return false };
    let fits = fits(schema, document);
    assert!(fits.is_ok(), "{}: {fits:?}", document["schema"]);
    true
}

/// Exit code 2, and the message holds all of the words.
pub(crate) fn assert_refused(output: &Output, words: &[&str]) {
    let text = stderr(output);
    assert_eq!(output.status.code(), Some(2), "{text}");
    for word in words {
        assert!(text.contains(word), "`{word}` is not in:\n{text}");
    }
    // Under --json the error is a document, too.
    if !output.stdout.is_empty() {
        let document: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(document["schema"], "retina.error/1", "{document}");
        assert_fits_its_schema(&document);
        assert_eq!(document["exit_code"], 2);
    }
}

/// Every file of a folder by its path in it; the manifest's lines are sorted, as frames may finish
/// in any order.
pub(crate) fn contents(dir: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut all = BTreeMap::new();
    let mut folders = vec![dir.to_path_buf()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let mut bytes = fs::read(&path).unwrap();
            if path.ends_with("manifest.jsonl") {
                let text = String::from_utf8(bytes).unwrap();
                let mut lines: Vec<&str> = text.lines().collect();
                lines.sort_unstable();
                lines.dedup();
                bytes = lines.join("\n").into_bytes();
            }
            all.insert(path.strip_prefix(dir).unwrap().to_path_buf(), bytes);
        }
    }
    all
}

/// Grey counts of a screen image, row by row; all channels must be equal.
pub(crate) fn counts(path: &Path) -> Vec<u8> {
    let image = image::open(path).unwrap().into_rgb8();
    assert!(image.pixels().all(|p| p.0[0] == p.0[1] && p.0[1] == p.0[2]));
    image.pixels().map(|p| p.0[0]).collect()
}
