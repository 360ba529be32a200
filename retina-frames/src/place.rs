//! Each row of a table: its image, its prediction, and where the one lies on the other.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DVec2;
use retina_diagnosis::MOST_PIXELS;
use retina_files::InputError;
use retina_formats::{FrameRow, Prediction};
use retina_geometry::Pinhole;
use retina_scene::Scene;

use crate::exr::ExrOrigin;
use crate::grid::Grid;
use crate::layers::Layers;
use crate::measured::{Bins, Measured};
use crate::model::{Sight, State};
use crate::register::{self, Lost};
use crate::scene::{SceneBody, SceneOrigin};
use crate::set::FramesSource;
use crate::window::{Pose, Window};

/// Scenes that were read, with what renders their bodies.
pub(crate) type Scenes = BTreeMap<PathBuf, (Scene, Arc<SceneBody>)>;

/// What is rendered, or read.
pub(crate) enum Origin {
    Scene(Box<SceneOrigin>),
    File(Box<ExrOrigin>),
}

impl Origin {
    pub(crate) fn outline(&self, camera: &Pinhole) -> Option<(DVec2, f64)> {
        match self {
            Self::Scene(scene) => scene.outline(camera),
            Self::File(file) => file.outline(camera),
        }
    }

    pub(crate) fn preview(&self, camera: &Pinhole, window: &Window, pose: &Pose) -> Grid {
        match self {
            Self::Scene(scene) => scene.preview(camera, window, pose),
            Self::File(file) => file.preview(camera, window, pose),
        }
    }

    /// The light with all that lies on the body, as the table has it.
    pub(crate) fn detail(&self, camera: &Pinhole, window: &Window) -> Grid {
        match self {
            Self::Scene(scene) => scene.detail(camera, window),
            Self::File(file) => file.preview(camera, window, &Pose::NOMINAL),
        }
    }

    /// Layers that are enough to be registered by.
    pub(crate) fn outlines(&self, camera: &Pinhole, window: &Window, pose: &Pose) -> Layers {
        match self {
            Self::Scene(scene) => scene.outlines(camera, window, pose),
            Self::File(file) => file.layers(camera, window, pose),
        }
    }

    pub(crate) fn layers(&self, camera: &Pinhole, window: &Window, pose: &Pose) -> Layers {
        match self {
            Self::Scene(scene) => scene.layers(camera, window, pose),
            Self::File(file) => file.layers(camera, window, pose),
        }
    }
}

/// Pixels beside the body that are looked at: part of its radius, and least and most, px.
const MARGIN: [f64; 3] = [0.35, 10.0, 80.0];
/// Cells in all images together.
const MOST_CELLS: usize = 700_000;
/// A row that was read.
pub(crate) struct Placed {
    pub(crate) origin: Origin,
    pub(crate) measured: Measured,
    pub(crate) name: String,
    pub(crate) pose: Pose,
    /// The predicted body's middle, px.
    pub(crate) middle: DVec2,
    /// Pixels: left, top, right, bottom.
    pub(crate) bounds: [usize; 4],
    /// By the table.
    pub(crate) exposure_s: Option<f64>,
}

/// Reads a row and finds its pose.
pub(crate) fn place(
    source: &FramesSource<'_>,
    camera: &Pinhole,
    file: &Path,
    row: &FrameRow,
    scenes: &mut Scenes,
    files: &mut Vec<PathBuf>,
) -> Result<Placed, InputError> {
    let measured = Measured::read(&row.measured, row.mask.as_deref(), source.setup)
        .map_err(|error| error.named_by(file, "measured"))?;
    let origin = match &row.prediction {
        Prediction::File(path) => {
            let exr = ExrOrigin::read(path, source.setup, source.calibration)
                .map_err(|error| error.named_by(file, "predicted"))?;
            files.push(exr.file().to_path_buf());
            Origin::File(Box::new(exr))
        }
        Prediction::Scene { file: path, frame, smooth } => {
            if source.calibration.is_some() {
                return Err(InputError::new("--calibration", "is for predictions on the screen")
                    .found(format!("{}, rendered as the camera sees it", path.display()))
                    .help("leave it out, or render the scene and give the EXR as `predicted`"));
            }
            if !scenes.contains_key(path) {
                let scene = Scene::read(path)?;
                let body = Arc::new(SceneBody::of(&scene)?);
                scenes.insert(path.clone(), (scene, body));
                files.push(path.clone());
            }
            let (scene, body) = &scenes[path];
            Origin::Scene(Box::new(SceneOrigin::new(scene, Arc::clone(body), *frame, *smooth)?))
        }
    };
    files.push(row.measured.clone());
    let at_row = |problem: &str| {
        InputError::new(file, problem).line(row.line).found(format!("{}", row.measured.display()))
    };
    let pose = if source.register {
        register::find(camera, &origin, &measured).map_err(|problem| match problem {
            Lost::Why(problem) => {
                at_row(problem).help("look at the scene, the mask, and which image belongs to which frame")
            }
            Lost::Mirrored(straight, flipped) => at_row("the image is mirrored")
                .found(format!("{}: correlation with the prediction {straight:.3} as it is, {flipped:.3} flipped left to right", row.measured.display()))
                .expected("an image as the camera sees it: x to the right, y down, east and west not exchanged")
                .help("flip the image left to right (at any roll that mends it), and look at how it was read out or exported"),
        })?
    } else {
        Pose::NOMINAL
    };
    let (middle, radius) = origin.outline(camera).ok_or_else(|| at_row("the prediction holds no light"))?;
    let seen = pose.to + glam::DMat2::from_angle(pose.roll_rad) * (middle - pose.from);
    let margin = (MARGIN[0] * radius).clamp(MARGIN[1], MARGIN[2]);
    let mut low = seen - radius - margin;
    let mut high = seen + radius + margin;
    if let Some(patch) = measured.patch().filter(|_| !source.register) {
        low = low.min(DVec2::new(patch.bounds[0], patch.bounds[1]) - margin);
        high = high.max(DVec2::new(patch.bounds[2], patch.bounds[3]) + margin);
    }
    let size = [measured.image.width_px as usize, measured.image.height_px as usize];
    let inside = |value: f64, most: usize| value.clamp(0.0, most as f64) as usize;
    let bounds = [
        inside(low.x.floor(), size[0]),
        inside(low.y.floor(), size[1]),
        inside(high.x.ceil(), size[0]),
        inside(high.y.ceil(), size[1]),
    ];
    if bounds[2] < bounds[0] + 8 || bounds[3] < bounds[1] + 8 {
        return Err(at_row("the predicted body lies outside the measured image")
            .help("look at the trajectory, or let the images be registered (--baseline physical)"));
    }
    let name = row.measured.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
    Ok(Placed { origin, measured, name, pose, middle, bounds, exposure_s: row.number("exposure_s") })
}

/// Windows of one bin size, so that all fit into a table.
pub(crate) fn windows(placed: &[Placed], notes: &mut Vec<String>) -> Vec<Window> {
    let area = |b: &[usize; 4], bin: usize| ((b[2] - b[0]) / bin) * ((b[3] - b[1]) / bin);
    let bins = |bin: usize| placed.iter().map(|frame| area(&frame.bounds, bin)).sum::<usize>();
    let bin = (1..).find(|&bin| bins(bin) <= MOST_PIXELS).unwrap_or(1);
    if bin > 1 {
        notes.push(format!(
            "{} pixels are taken in bins of {bin} x {bin}: what is finer is not seen; part the table, or mask what is not needed",
            bins(1)
        ));
    }
    let fine = [4, 3, 2].into_iter().find(|fine| bins(bin) * fine * fine <= MOST_CELLS).unwrap_or(2);
    placed
        .iter()
        .map(|frame| Window {
            left: frame.bounds[0],
            top: frame.bounds[1],
            columns: (frame.bounds[2] - frame.bounds[0]) / bin,
            rows: (frame.bounds[3] - frame.bounds[1]) / bin,
            bin,
            // A file's pixels are averages already: a second average over cells would blur them.
            fine: if matches!(frame.origin, Origin::File(_)) { 1 } else { fine },
        })
        .collect()
}

/// Gains from the light as a whole; no offset.
pub(crate) fn first_state(sights: &[Sight], bins: &[Bins]) -> State {
    let gain = sights
        .iter()
        .zip(bins)
        .map(|(sight, bins)| {
            let light = sight.layers.light.averaged(sight.window.fine);
            let (mut both, mut own) = (0.0, 0.0);
            for (at, light) in light.values.iter().enumerate().filter(|(at, _)| bins.valid[*at]) {
                both += f64::from(*light) * bins.values[at];
                own += f64::from(*light).powi(2);
            }
            if own > 0.0 && both > 0.0 { both / own } else { 1.0 }
        })
        .collect();
    State {
        gain,
        offset_dn: 0.0,
        shift_px: vec![DVec2::ZERO; sights.len()],
        roll_rad: 0.0,
        scale: 0.0,
        parts: Vec::new(),
    }
}
