//! Scenes rendered to frames in memory.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use retina::batch::{BackendChoice, FrameMaker, MadeFrame, PngShape, Scaling, png_bytes, screen_png};
use retina::files::{InputError, Place};
use retina::glam::DVec3;
use retina::render::Quality;
use retina::scene::{Given, Layer, Scene};
use retina::sky::{BodyPose, FramePose, Trajectory};

use crate::convert::{document, image_array, quaternion, vector};
use crate::errors::Failure;
use crate::setup::PySetup;
use crate::work;

/// A renderer that holds a scene.
#[pyclass(name = "FrameMaker", module = "retina._native", frozen)]
pub(crate) struct PyFrameMaker {
    maker: Arc<Mutex<FrameMaker>>,
    name: (String, String, String),
    fallback: Option<String>,
}

/// Another thread's panic leaves the renderer as it was between frames.
fn locked(maker: &Mutex<FrameMaker>) -> MutexGuard<'_, FrameMaker> {
    maker.lock().unwrap_or_else(PoisonError::into_inner)
}

#[pymethods]
impl PyFrameMaker {
    /// Opens a scene: a file's (`text` is `None`), or a document with a setup and a trajectory of one's own.
    #[staticmethod]
    #[pyo3(signature = (path, text, setup, trajectory, layers, backend, quality, scaling))]
    fn open(
        py: Python<'_>,
        path: PathBuf,
        text: Option<String>,
        setup: Option<PyRef<'_, PySetup>>,
        trajectory: Option<String>,
        layers: Option<Vec<String>>,
        backend: &str,
        quality: Option<&str>,
        scaling: Option<f64>,
    ) -> PyResult<Self> {
        let backend = backend_of(backend)?;
        let quality = quality.map(quality_of).transpose()?;
        let scaling = match scaling {
            None => Scaling::OfScene,
            Some(value) if value.is_nan() => Scaling::OfFrame,
            Some(value) if value > 0.0 && value.is_finite() => Scaling::Value(value),
            Some(value) => {
                return Err(Failure::argument(
                    "radiance_scale",
                    "is out of range",
                    value,
                    "a number above 0",
                )
                .into());
            }
        };
        let layers = layers.map(|names| names.iter().map(|name| layer_of(name)).collect()).transpose()?;
        let setup = setup.map(|setup| (*setup.setup).clone());
        let (maker, fallback) = work::run(py, None, move |_| {
            let given = Given { setup, trajectory_csv: trajectory };
            let mut scene = match text {
                Some(text) => Scene::parse(&path, &text, given).map_err(|error| of_document(error, &path))?,
                None => Scene::read_with(&path, given)?,
            };
            if let Some(layers) = layers {
                scene.output.layers = layers;
                scene.output.exr = !scene.output.layers.is_empty();
            }
            Ok(FrameMaker::open(scene, backend, quality, scaling)?)
        })?;
        let name = maker.name();
        let name = (name.backend.to_owned(), name.adapter.clone(), name.driver.clone());
        let fallback = fallback.map(|error| error.to_string());
        Ok(Self { maker: Arc::new(Mutex::new(maker)), name, fallback })
    }

    /// Number of frames of the scene's trajectory.
    fn frame_count(&self, py: Python<'_>) -> usize {
        py.detach(|| locked(&self.maker).scene().frame_count())
    }

    /// What the scene holds: its bodies' names, size, scale, compensation and the times of its frames.
    fn fields<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let (bodies, size_px, compensation, radiance_scale, times) = py.detach(|| {
            let maker = locked(&self.maker);
            let scene = maker.scene();
            let bodies: Vec<String> = scene.bodies.iter().map(|body| body.name.clone()).collect();
            let times: Vec<f64> = scene.trajectory.frames.iter().map(|frame| frame.time_s).collect();
            let size_px = (scene.image.width_px, scene.image.height_px);
            (bodies, size_px, scene.compensation.name(), maker.radiance_scale(), times)
        });
        let out = PyDict::new(py);
        out.set_item("bodies", bodies)?;
        out.set_item("size_px", size_px)?;
        out.set_item("compensation", compensation)?;
        out.set_item("radiance_scale", radiance_scale)?;
        out.set_item("time_s", numpy::PyArray1::from_vec(py, times))?;
        Ok(out)
    }

    /// Backend, adapter and driver, and why the GPU is not used where the choice was left open.
    fn adapter(&self) -> ((String, String, String), Option<String>) {
        (self.name.clone(), self.fallback.clone())
    }

    /// Frame `index` of the scene.
    fn frame<'py>(&self, py: Python<'py>, index: usize) -> PyResult<Bound<'py, PyDict>> {
        let maker = Arc::clone(&self.maker);
        let made = work::run(py, None, move |_| Ok(locked(&maker).frame(index)?))?;
        fields_of(py, made)
    }

    /// A frame of a pose of one's own. A body is a name, its position (m), its rotation from inertial axes, or `None`.
    #[pyo3(signature = (time_s, camera_position_m, camera_from_inertial, camera_velocity_m_s, sun_position_m, bodies))]
    fn pose<'py>(
        &self,
        py: Python<'py>,
        time_s: f64,
        camera_position_m: PyReadonlyArray1<'py, f64>,
        camera_from_inertial: PyReadonlyArray1<'py, f64>,
        camera_velocity_m_s: Option<PyReadonlyArray1<'py, f64>>,
        sun_position_m: Option<PyReadonlyArray1<'py, f64>>,
        bodies: Vec<(String, PyReadonlyArray1<'py, f64>, PyReadonlyArray1<'py, f64>)>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let optional = |name: &str, array: Option<PyReadonlyArray1<'py, f64>>| {
            array.map(|array| vector(name, &array)).transpose()
        };
        let mut places: BTreeMap<String, BodyPose> = BTreeMap::new();
        for (name, position_m, turn) in bodies {
            let position_m: DVec3 = vector(&format!("{name}.position_m"), &position_m)?;
            let body_from_inertial = quaternion(&format!("{name}.body_from_inertial"), &turn)?;
            places.insert(name, BodyPose { position_m, body_from_inertial });
        }
        let pose = FramePose {
            time_s,
            camera_position_m: vector("camera_position_m", &camera_position_m)?,
            camera_from_inertial: quaternion("camera_from_inertial", &camera_from_inertial)?,
            camera_velocity_m_s: optional("camera_velocity_m_s", camera_velocity_m_s)?,
            sun_position_m: optional("sun_position_m", sun_position_m)?,
            bodies: places,
        };
        let maker = Arc::clone(&self.maker);
        let made = work::run(py, None, move |_| Ok(locked(&maker).pose("<pose>", pose)?))?;
        fields_of(py, made)
    }

    /// The scene's trajectory as a table's text.
    fn trajectory_csv(&self, py: Python<'_>) -> String {
        py.detach(|| Trajectory::to_csv(&locked(&self.maker).scene().trajectory))
    }
}

/// An error about a document that was no file: its lines are nobody's.
fn of_document(mut error: InputError, path: &Path) -> InputError {
    if error.file == path {
        error.file = PathBuf::from("<source>");
        if matches!(error.place, Place::Line(_) | Place::LineColumn(..)) {
            error.place = Place::File;
        }
    }
    error
}

fn fields_of(py: Python<'_>, made: MadeFrame) -> PyResult<Bound<'_, PyDict>> {
    let size = made.size_px.map(|size| size as usize);
    let out = PyDict::new(py);
    out.set_item("index", made.frame.index)?;
    out.set_item("time_s", made.frame.time_s)?;
    out.set_item("counts", image_array(py, made.counts, size)?)?;
    out.set_item("radiance", image_array(py, made.radiance, size)?)?;
    let layers = PyDict::new(py);
    for (name, values) in made.layers {
        layers.set_item(name, image_array(py, values, size)?)?;
    }
    out.set_item("layers", layers)?;
    out.set_item("truth", document(py, &made.truth)?)?;
    out.set_item("radiance_scale", made.radiance_scale)?;
    out.set_item("saturated_px", made.saturated_px)?;
    out.set_item("png_filtered", made.png_filtered)?;
    Ok(out)
}

fn backend_of(name: &str) -> PyResult<BackendChoice> {
    Ok(match name {
        "auto" => BackendChoice::Auto,
        "gpu" => BackendChoice::Gpu,
        "native" => BackendChoice::Native,
        "cpu" => BackendChoice::Cpu,
        other => {
            let expected = "\"auto\", \"gpu\", \"native\" or \"cpu\"";
            return Err(Failure::argument("backend", "is not known", format!("\"{other}\""), expected).into());
        }
    })
}

fn quality_of(name: &str) -> PyResult<Quality> {
    Ok(match name {
        "draft" => Quality::Draft,
        "default" => Quality::Default,
        "best" => Quality::Best,
        other => {
            let expected = "\"draft\", \"default\" or \"best\"";
            return Err(Failure::argument("quality", "is not known", format!("\"{other}\""), expected).into());
        }
    })
}

fn layer_of(name: &str) -> PyResult<Layer> {
    Layer::from_name(name).ok_or_else(|| {
        let expected = Layer::ALL.map(Layer::name).join(", ");
        Failure::argument("layers", "there is no such layer", format!("\"{name}\""), &expected).into()
    })
}

/// The PNG that a run writes of a screen image.
#[pyfunction]
pub(crate) fn screen_png_bytes<'py>(
    py: Python<'py>,
    index: usize,
    counts: PyReadonlyArray2<'py, u8>,
    filtered: bool,
) -> PyResult<Bound<'py, PyBytes>> {
    let (values, size_px) = grey(&counts)?;
    let png = py.detach(|| screen_png(index, size_px, &values, filtered)).map_err(Failure::from)?;
    Ok(PyBytes::new(py, &png))
}

/// A grey PNG of 8 bits.
#[pyfunction]
pub(crate) fn grey_png_bytes<'py>(
    py: Python<'py>,
    values: PyReadonlyArray2<'py, u8>,
) -> PyResult<Bound<'py, PyBytes>> {
    let (values, [width_px, height_px]) = grey(&values)?;
    let shape = PngShape { width_px, height_px, channels: 1, bits: 8, filtered: true };
    let png = py.detach(|| png_bytes("image", shape, &values, &[])).map_err(Failure::from)?;
    Ok(PyBytes::new(py, &png))
}

fn grey(array: &PyReadonlyArray2<'_, u8>) -> PyResult<(Vec<u8>, [u32; 2])> {
    use numpy::PyUntypedArrayMethods as _;
    let size = [array.shape()[1], array.shape()[0]].map(u32::try_from);
    match size {
        [Ok(width_px), Ok(height_px)] if width_px > 0 && height_px > 0 => {
            Ok((array.as_array().iter().copied().collect(), [width_px, height_px]))
        }
        _ => Err(Failure::new("the image has no pixels, or more than 2^32 in a row or column").into()),
    }
}
