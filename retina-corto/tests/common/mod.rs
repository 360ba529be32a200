//! A small scenario in a folder of its own.
#![allow(dead_code, unreachable_pub, reason = "each test binary uses its own part")]
#![allow(clippy::unwrap_used, reason = "a helper that fails fails its test")]

use std::fs;
use std::path::{Path, PathBuf};

use retina_corto::Scenario;
use retina_files::InputError;

pub const SCENE: &str = r#"{
  "camera_settings": {
    "fov": 20.0, "res_x": 64, "res_y": 48, "film_exposure": 0.5, "sensor": "BW",
    "K": "[[181.48, 0, 32], [0, 181.48, 24], [0, 0, 1]]",
    "clip_start": 0.1, "clip_end": 1000, "bit_encoding": "16", "viewtransform": "Raw"
  },
  "sun_settings": { "angle": 0.53, "energy": 4.0 },
  "body_settings": { "pass_index": 3 },
  "rendering_settings": { "engine": "CYCLES", "device": "CPU", "samples": 64, "preview_samples": 4 }
}"#;

pub const GEOMETRY: &str = r#"{
  "sun": { "position": [[0, 0, 1000], [0, 0, 1000]] },
  "camera": { "position": [[0, 0, 10], [0, 0, 12]], "orientation": [[1, 0, 0, 0], [1, 0, 0, 0]] },
  "body": { "position": [[0, 0, 0], [0.5, 0, 0]], "orientation": [[1, 0, 0, 0], [1, 0, 0, 0]] }
}"#;

/// A cube of edge 2 about the origin.
pub const CUBE: &str = "v 1 1 1\nv -1 1 1\nv -1 -1 1\nv 1 -1 1\nv 1 1 -1\nv -1 1 -1\nv -1 -1 -1\nv 1 -1 -1\n\
    f 1 2 3 4\nf 8 7 6 5\nf 1 4 8 5\nf 2 1 5 6\nf 3 2 6 7\nf 4 3 7 8\n";

pub struct Folder {
    folder: tempfile::TempDir,
}

impl Folder {
    /// scene/scene.json, geometry/geometry.json and body/shape/cube.obj.
    pub fn new() -> Self {
        let this = Self { folder: tempfile::tempdir().unwrap() };
        this.write("scene/scene.json", SCENE);
        this.write("geometry/geometry.json", GEOMETRY);
        this.write("body/shape/cube.obj", CUBE);
        this
    }

    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    pub fn file(&self, name: &str) -> PathBuf {
        self.path().join(name)
    }

    pub fn write(&self, name: &str, text: &str) {
        let path = self.file(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }

    /// Replaces text in a file; it must be there.
    pub fn edit(&self, name: &str, from: &str, to: &str) {
        let text = fs::read_to_string(self.file(name)).unwrap();
        assert!(text.contains(from), "{name} does not hold {from}");
        self.write(name, &text.replacen(from, to, 1));
    }

    pub fn read(&self) -> Result<Scenario, InputError> {
        Scenario::read(self.path(), None)
    }

    /// The text of the error that reading or loading gives.
    pub fn refusal(&self) -> String {
        let error = match self.read() {
            Err(error) => error,
            Ok(scenario) => scenario.scene(&retina_corto::Shown::Camera, true).unwrap_err(),
        };
        format!("{error} {}", error.help.clone().unwrap_or_default())
    }
}
