//! Attitude from the stars of an image.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use retina::geometry::Setup;
use retina::image::{CameraImage, Coding, Exif, Photograph, PhotographOptions};
use retina::navigation::cameras::{ImageSolver, ImageSolverOptions, KnownCamera};
use retina::navigation::image::{ImageContext, ImageResult};
use retina::navigation::products::{annotated, wcs_header};
use retina::sky::observer::Observer;

use crate::calibrations::PyCalibration;
use crate::convert::{camera_image, document, vector};
use crate::ephemeris::PyEphemeris;
use crate::errors::{Failure, python_names};
use crate::points::usable;
use crate::setup::PySetup;
use crate::work;

/// Solves images of one camera. What it prepares for one image serves the next.
#[pyclass(name = "StarSolver", module = "retina._native", frozen)]
pub(crate) struct PyStarSolver {
    solver: Arc<Mutex<ImageSolver>>,
    setup: Option<Arc<Setup>>,
    aspect_given: bool,
}

#[pymethods]
impl PyStarSolver {
    #[new]
    #[pyo3(signature = (setup, calibration, field_rad, focal_slack, log10_bound, most_hypotheses, threshold_sigma, mirrored, pixel_aspect, tdb_s))]
    fn new(
        setup: Option<PyRef<'_, PySetup>>,
        calibration: Option<PyRef<'_, PyCalibration>>,
        field_rad: Option<(f64, f64)>,
        focal_slack: f64,
        log10_bound: f64,
        most_hypotheses: Option<usize>,
        threshold_sigma: f64,
        mirrored: bool,
        pixel_aspect: Option<f64>,
        tdb_s: Option<f64>,
    ) -> PyResult<Self> {
        let setup = setup.map(|setup| Arc::clone(&setup.setup));
        let known = match (&setup, field_rad) {
            (Some(setup), _) => {
                let calibration = calibration.map(|given| given.given.geometry(setup)).transpose();
                KnownCamera::Setup(
                    Box::new((**setup).clone()),
                    calibration.map_err(Failure::from)?.map(Box::new),
                )
            }
            (None, Some((least, greatest))) => KnownCamera::Field([least, greatest]),
            (None, None) => KnownCamera::Exif,
        };
        let default = ImageSolverOptions::default();
        let options = ImageSolverOptions {
            focal_slack,
            log10_bound,
            most_hypotheses: most_hypotheses.unwrap_or(default.most_hypotheses),
            threshold_sigma,
            mirrored,
            pixel_aspect,
            tdb_s,
        };
        let solver = Arc::new(Mutex::new(ImageSolver::new(known, options)));
        Ok(Self { solver, setup, aspect_given: pixel_aspect.is_some() })
    }

    /// Solves an image: an array, or a file's path. Gives what `navigate stars --json` says of it, with its stars.
    #[pyo3(signature = (image, bits, mask, observer, position_sigma_m))]
    fn solve<'py>(
        &self,
        py: Python<'py>,
        image: Bound<'py, PyAny>,
        bits: Option<u32>,
        mask: Option<PyReadonlyArray2<'py, bool>>,
        observer: Option<PyRef<'py, PyObserver>>,
        position_sigma_m: f64,
    ) -> PyResult<PyStarAnswer> {
        let bits = bits.or(self.setup.as_ref().map(|setup| setup.camera.bits));
        let picture = picture(py, &image, bits, self.setup.as_deref())?;
        let mask =
            mask.map(|mask| usable(&mask, [picture.image.width_px, picture.image.height_px])).transpose()?;
        let (in_field, square) = {
            let solver = self.solver.lock().unwrap_or_else(PoisonError::into_inner);
            (
                matches!(solver.known(), KnownCamera::Field(_)),
                matches!(solver.known(), KnownCamera::Setup(..)),
            )
        };
        let context = observer
            .map_or_else(ImageContext::default, |at| ImageContext::at(at.observer.clone(), position_sigma_m));
        let context = ImageContext {
            mask,
            find_pixel_aspect: !square && !self.aspect_given,
            field_given: in_field,
            aspect_given: self.aspect_given,
            ..context
        };
        let solver = Arc::clone(&self.solver);
        work::run(py, None, move |_| {
            let mut notes = picture.notes;
            let mut solver = solver.lock().unwrap_or_else(PoisonError::into_inner);
            let result = solver.solve(&picture.image, &picture.exif, &context, &mut notes)?;
            Ok(PyStarAnswer { result, image: picture.image, file: picture.file, notes })
        })
    }
}

/// Who looks: when, from where, and how fast they move.
#[pyclass(name = "Observer", module = "retina._native", frozen)]
pub(crate) struct PyObserver {
    pub(crate) observer: Observer,
}

#[pymethods]
impl PyObserver {
    #[new]
    #[pyo3(signature = (ephemeris, tdb_s, position_m, velocity_m_s))]
    fn new(
        ephemeris: PyRef<'_, PyEphemeris>,
        tdb_s: f64,
        position_m: PyReadonlyArray1<'_, f64>,
        velocity_m_s: Option<PyReadonlyArray1<'_, f64>>,
    ) -> PyResult<Self> {
        let position_m = vector("position_m", &position_m)?;
        let velocity_m_s = velocity_m_s.map(|array| vector("velocity_m_s", &array)).transpose()?;
        let observer = Observer::new(&ephemeris.ephemeris, tdb_s, position_m, velocity_m_s);
        Ok(Self { observer: observer.map_err(Failure::from)? })
    }
}

/// What an image gave, and the image itself for its picture.
#[pyclass(name = "StarAnswer", module = "retina._native", frozen)]
pub(crate) struct PyStarAnswer {
    result: ImageResult,
    image: CameraImage,
    file: String,
    notes: Vec<String>,
}

#[pymethods]
impl PyStarAnswer {
    /// What `navigate stars --json` says of the image, with its stars.
    fn document(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        let mut told = self.result.json(&self.file, true);
        if let Some(message) = told.get("message").and_then(|text| text.as_str()).map(python_names) {
            told["message"] = message.into();
        }
        told["notes"] = self.notes.clone().into();
        document(py, &told)
    }

    /// The image with stars, planets, names and coordinates, as SVG.
    fn svg(&self, py: Python<'_>, title: &str) -> String {
        py.detach(|| annotated(&self.result, &self.image, title).to_svg())
    }

    /// World coordinates as a FITS header (TAN-SIP); `None` where the image is not solved.
    fn wcs_header(&self) -> Option<Vec<u8>> {
        wcs_header(&self.result)
    }
}

/// An image and what is known of its file.
pub(crate) struct Picture {
    pub(crate) image: CameraImage,
    pub(crate) exif: Exif,
    pub(crate) linearised: bool,
    pub(crate) file: String,
    pub(crate) notes: Vec<String>,
}

/// An array, or a file's picture, of the size of the setup's camera where there is one.
pub(crate) fn picture(
    py: Python<'_>,
    image: &Bound<'_, PyAny>,
    bits: Option<u32>,
    setup: Option<&Setup>,
) -> PyResult<Picture> {
    let picture = match image.extract::<PathBuf>() {
        Ok(path) => {
            // A setup counts pixels as the sensor does, however a viewer turns them.
            let options = PhotographOptions { bits, coding: Coding::ByKind, upright: setup.is_none() };
            let read = py.detach(|| Photograph::read(&path, options)).map_err(Failure::from)?;
            Picture {
                notes: read.notes(),
                image: read.image,
                exif: read.exif,
                linearised: read.linearised,
                file: path.display().to_string(),
            }
        }
        Err(_) => Picture {
            image: camera_image(image, bits)?,
            exif: Exif::default(),
            linearised: false,
            file: "image".into(),
            notes: Vec::new(),
        },
    };
    if let Some(setup) = setup {
        let found = [picture.image.width_px, picture.image.height_px];
        let expected = [setup.camera.width_px, setup.camera.height_px];
        if found != expected {
            let [found, expected] = [found, expected].map(|[w, h]| format!("{w} x {h} pixels"));
            let problem = "does not have the size of the setup's camera";
            return Err(Failure::argument("image", problem, found, &expected).into());
        }
    }
    Ok(picture)
}
