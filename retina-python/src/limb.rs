//! A body's place from its limb.

use std::path::PathBuf;

use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use retina::geometry::Pinhole;
use retina::glam::{DMat3, DVec3};
use retina::image::CameraImage;
use retina::navigation::cameras::{ImageSolver, ImageSolverOptions, KnownCamera};
use retina::navigation::limb::{
    AmongStars, KnownBody, LimbAnswer, LimbCamera, LimbQuestion, Mapping, StarsEpoch,
};
use retina::navigation::products::limb_picture;
use retina::sky::ephemeris::Ephemeris;
use retina::sky::planets::{Planet, seen_planet};

use crate::calibrations::PyCalibration;
use crate::convert::{document, quaternion};
use crate::ephemeris::PyEphemeris;
use crate::errors::{Failure, python_names};
use crate::points::usable;
use crate::setup::PySetup;
use crate::stars::{PyObserver, picture};
use crate::work;

/// What is known of the body: a name or a mesh, or semi-axes.
#[derive(FromPyObject)]
pub(crate) enum BodyOf<'py> {
    Named(String),
    Axes(PyReadonlyArray1<'py, f64>),
}

/// What a photograph gave, and what it takes to draw it.
#[pyclass(name = "LimbAnswer", module = "retina._native", frozen)]
pub(crate) struct PyLimbAnswer {
    question: LimbQuestion,
    answer: LimbAnswer,
    /// With the stars beside it, where they were asked for.
    among: Option<AmongStars>,
    image: CameraImage,
    file: String,
    notes: Vec<String>,
}

/// What the stars beside a body take.
#[pyclass(name = "StarsBeside", module = "retina._native", frozen)]
pub(crate) struct PyStarsBeside {
    ephemeris: Ephemeris,
    tdb_s: Option<f64>,
}

#[pymethods]
impl PyStarsBeside {
    #[new]
    #[pyo3(signature = (ephemeris, tdb_s))]
    fn new(ephemeris: PyRef<'_, PyEphemeris>, tdb_s: Option<f64>) -> Self {
        Self { ephemeris: ephemeris.ephemeris.clone(), tdb_s }
    }
}

/// Measures a body's limb in an image.
#[pyfunction]
#[pyo3(signature = (image, setup, calibration, focal_px, field_rad, focal_sigma_share, body, camera_from_body, limb_height_m, limb_height_sigma_m, sun_angle_rad, observer, bits, silhouette, mask, stars))]
pub(crate) fn fit_limb<'py>(
    py: Python<'py>,
    image: Bound<'py, PyAny>,
    setup: Option<PyRef<'py, PySetup>>,
    calibration: Option<PyRef<'py, PyCalibration>>,
    focal_px: Option<f64>,
    field_rad: Option<f64>,
    focal_sigma_share: Option<f64>,
    body: BodyOf<'py>,
    camera_from_body: Option<PyReadonlyArray1<'py, f64>>,
    limb_height_m: Option<f64>,
    limb_height_sigma_m: Option<f64>,
    sun_angle_rad: Option<f64>,
    observer: Option<PyRef<'py, PyObserver>>,
    bits: Option<u32>,
    silhouette: Option<PathBuf>,
    mask: Option<PyReadonlyArray2<'py, bool>>,
    stars: Option<PyRef<'py, PyStarsBeside>>,
) -> PyResult<PyLimbAnswer> {
    let camera_from_body =
        camera_from_body.map(|turn| quaternion("camera_from_body", &turn)).transpose()?.map(DMat3::from_quat);
    let known = known_body(py, body, camera_from_body)?;
    let attitude_given =
        camera_from_body.is_some() || stars.as_ref().is_some_and(|stars| stars.tdb_s.is_some());
    let known = match silhouette {
        None => known,
        Some(mesh) if attitude_given => py.detach(|| known.with_silhouette(&mesh)).map_err(Failure::from)?,
        Some(mesh) => {
            let problem = "depends on the attitude, which is not known";
            let expected = "camera_from_body=, or stars=True with time=";
            return Err(Failure::argument("silhouette", problem, mesh.display(), expected).into());
        }
    };
    let known = known.with_given_limb(limb_height_m, limb_height_sigma_m);
    let expected = match (observer, known.planet) {
        (None, _) => None,
        (Some(observer), Some(planet)) => {
            let seen = seen_planet(&observer.observer, planet).map_err(Failure::from)?;
            let inside = || Failure::new("the camera is inside the body, or on it");
            Some(seen.ok_or_else(inside)?)
        }
        (Some(_), None) => {
            let expected = "\"moon\" or a planet, where a time and a place are given";
            return Err(Failure::argument(
                "body",
                "has no ephemeris",
                format!("\"{}\"", known.name),
                expected,
            )
            .into());
        }
    };
    let bits = bits.or(setup.as_ref().map(|setup| setup.setup.camera.bits));
    let picture = picture(py, &image, bits, setup.as_ref().map(|setup| &*setup.setup))?;
    let size = [picture.image.width_px, picture.image.height_px];
    let exif_focal_px = picture.exif.focal_px(size);
    let focal_px = focal_px.or(field_rad.map(|field_rad| 0.5 * f64::from(size[0]) / (0.5 * field_rad).tan()));
    let mut read_calibration = None;
    let (camera, usual_share) = match (&setup, focal_px, exif_focal_px) {
        (Some(setup), _, _) => {
            let mapping = match calibration {
                None => Mapping::Pinhole,
                Some(given) => {
                    let read = given.given.geometry(&setup.setup).map_err(Failure::from)?;
                    read_calibration = Some(read.clone());
                    Mapping::Downstream(Box::new(read))
                }
            };
            (LimbCamera { pinhole: setup.setup.camera_pinhole(), mapping }, LimbQuestion::FOCAL_SIGMA_SHARE)
        }
        (None, Some(focal_px), _) => {
            (LimbCamera::pinhole(Pinhole::centred(focal_px, size)), LimbQuestion::FOCAL_SIGMA_SHARE)
        }
        (None, None, Some(focal_px)) => {
            (LimbCamera::pinhole(Pinhole::centred(focal_px, size)), LimbQuestion::EXIF_FOCAL_SIGMA_SHARE)
        }
        (None, None, None) => {
            let problem = "is needed: the camera's focal length is not known";
            let expected = "setup=, focal_mm= with pixel_um=, fov_deg=, or a file with a 35-mm equivalent in its EXIF data";
            return Err(Failure::argument("setup", problem, "none", expected).into());
        }
    };
    let question = LimbQuestion {
        camera,
        focal_sigma_share: focal_sigma_share.unwrap_or(usual_share),
        body: known,
        sun_angle_rad,
        phase_rad: None,
        expected,
        tone_sigma_share: if picture.linearised { LimbQuestion::TONE_SIGMA_SHARE } else { 0.0 },
    };
    let mask = mask.map(|mask| usable(&mask, size)).transpose()?;
    let known = match (&setup, focal_px.is_some()) {
        (Some(setup), _) => {
            KnownCamera::Setup(Box::new((*setup.setup).clone()), read_calibration.map(Box::new))
        }
        (None, true) => {
            let half = 0.5 * f64::from(size[0]) / question.camera.pinhole.fx_px;
            KnownCamera::Field([2.0 * half.atan(); 2])
        }
        (None, false) => KnownCamera::Exif,
    };
    let beside = stars.map(|stars| (stars.ephemeris.clone(), stars.tdb_s));
    work::run(py, None, move |_| {
        let mut notes = picture.notes;
        let (question, answer, among) = match beside {
            Some((ephemeris, tdb_s)) => {
                let options = ImageSolverOptions { tdb_s, ..ImageSolverOptions::default() };
                let mut solver = ImageSolver::new(known, options);
                let epoch = tdb_s.map(|tdb_s| StarsEpoch { tdb_s, ephemeris: &ephemeris });
                let among = question
                    .solve_among_stars(
                        &picture.image,
                        &picture.exif,
                        mask.as_deref(),
                        &mut solver,
                        epoch,
                        &mut notes,
                    )
                    .map_err(|error| Failure::new(error.to_string()))?;
                (among.question.clone(), among.answer.clone(), Some(among))
            }
            None => {
                let seen = match &mask {
                    Some(mask) => picture.image.clone().seen_in(mask),
                    None => picture.image.clone(),
                };
                let answer = question.solve(&seen);
                (question, answer, None)
            }
        };
        notes.extend(question.doubts(&answer));
        Ok(PyLimbAnswer { question, answer, among, image: picture.image, file: picture.file, notes })
    })
}

fn known_body(py: Python<'_>, body: BodyOf<'_>, turn: Option<DMat3>) -> PyResult<KnownBody> {
    let known = match body {
        BodyOf::Axes(axes_m) => {
            let values: Vec<f64> = axes_m.as_array().iter().copied().collect();
            let axes_m = match values[..] {
                [radius_m] => DVec3::splat(radius_m),
                [a, b, c] => DVec3::new(a, b, c),
                _ => {
                    let expected = "a radius, or three semi-axes, m";
                    return Err(Failure::argument(
                        "body",
                        "is no ellipsoid",
                        format!("{values:?}"),
                        expected,
                    )
                    .into());
                }
            };
            KnownBody::ellipsoid("body", axes_m, turn)
        }
        BodyOf::Named(name) => match Planet::from_name(&name) {
            Some(planet) => KnownBody::planet(planet, turn),
            None if PathBuf::from(&name).extension().is_some() => {
                py.detach(|| KnownBody::mesh(&PathBuf::from(&name), turn))
            }
            None => {
                let expected = "\"moon\", a planet such as \"earth\", a mesh (.glb, .gltf, .obj, .icq, .bds), or semi-axes in m";
                return Err(Failure::argument("body", "is not known", format!("\"{name}\""), expected).into());
            }
        },
    };
    Ok(known.map_err(Failure::from)?)
}

#[pymethods]
impl PyLimbAnswer {
    /// What `navigate limb --json` says.
    fn document(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        let mut told = self.question.json(&self.answer);
        if let Some(message) = told.get("message").and_then(|text| text.as_str()).map(python_names) {
            told["message"] = message.into();
        }
        if let (Some(told), Some(among)) = (told.as_object_mut(), &self.among)
            && let serde_json::Value::Object(more) = among.json(&self.file)
        {
            told.extend(more);
        }
        told["file"] = self.file.clone().into();
        told["notes"] = self.notes.iter().map(|note| python_names(note)).collect();
        document(py, &told)
    }

    /// The limb's points in the order of the outline, as columns; none where the image is refused.
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let points = self.answer.sight.as_ref().map_or(&[][..], |sight| &sight.solution.points);
        let out = PyDict::new(py);
        out.set_item("x_px", PyArray1::from_iter(py, points.iter().map(|p| p.pixel.x)))?;
        out.set_item("y_px", PyArray1::from_iter(py, points.iter().map(|p| p.pixel.y)))?;
        out.set_item("sigma_px", PyArray1::from_iter(py, points.iter().map(|p| p.sigma_px)))?;
        out.set_item("residual_px", PyArray1::from_iter(py, points.iter().map(|p| p.residual_px)))?;
        out.set_item("used", PyArray1::from_iter(py, points.iter().map(|p| p.used)))?;
        Ok(out)
    }

    /// The image with the fitted outline, and the residuals along the limb, as SVG.
    fn svg(&self, py: Python<'_>, title: &str) -> String {
        py.detach(|| limb_picture(&self.answer, &self.image, title).to_svg())
    }
}
