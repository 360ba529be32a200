//! Where bodies are, and when.

use std::path::PathBuf;

use numpy::{PyArray2, PyReadonlyArray1};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use retina::glam::DVec3;
use retina::sky::ephemeris::{Ephemeris, EphemerisError};
use retina::sky::observer::Observer;
use retina::sky::planets::{Planet, seen_planet};
use retina::sky::site::Site;
use retina::sky::time::{format_epoch_tdb, parse_epoch};

use crate::convert::{scalar_first, vector};
use crate::errors::Failure;
use crate::work;

/// Where bodies are taken from: analytical theories, or SPK kernels.
#[pyclass(name = "Ephemeris", module = "retina._native", frozen)]
pub(crate) struct PyEphemeris {
    pub(crate) ephemeris: Ephemeris,
}

fn planet(name: &str) -> PyResult<Planet> {
    Planet::from_name(name).ok_or_else(|| {
        let expected = Planet::ALL.map(Planet::name).join(", ");
        Failure::argument("body", "is not known", format!("\"{name}\""), &expected).into()
    })
}

#[pymethods]
impl PyEphemeris {
    #[new]
    fn new(py: Python<'_>, kernels: Vec<PathBuf>) -> PyResult<Self> {
        let ephemeris = py.detach(|| Ephemeris::read(&kernels)).map_err(Failure::from)?;
        Ok(Self { ephemeris })
    }

    /// `analytic`, or the kernels' names.
    fn name(&self) -> String {
        self.ephemeris.name()
    }

    /// Barycentric ICRF positions of a body, m, of shape (times, 3).
    fn positions_m<'py>(
        &self,
        py: Python<'py>,
        body: &str,
        tdb_s: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (ephemeris, body) = (self.ephemeris.clone(), body.to_owned());
        let times: Vec<f64> = tdb_s.as_array().to_vec();
        if body != "sun" && ephemeris.kernel_files().is_empty() {
            planet(&body)?;
        }
        let found = work::run(py, None, move |_| {
            let at = |&tdb_s: &f64| match Planet::from_name(&body) {
                Some(planet) => ephemeris.position_m(planet, tdb_s),
                None if body == "sun" => Ok(ephemeris.solar_system(tdb_s)?.sun.position_m),
                None => Ok(ephemeris.state(&body, tdb_s)?.position_m),
            };
            Ok(times.iter().map(at).collect::<Result<Vec<DVec3>, EphemerisError>>()?)
        })?;
        rows(py, found.iter().map(|place| place.to_array().to_vec()).collect(), 3)
    }

    /// Barycentric ICRF velocities, m/s, of shape (times, 3): of the Sun, the Earth, the Moon, or what kernels have.
    fn velocities_m_s<'py>(
        &self,
        py: Python<'py>,
        body: &str,
        tdb_s: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        if !["sun", "earth", "moon"].contains(&body) && self.ephemeris.kernel_files().is_empty() {
            let expected = "\"sun\", \"earth\" or \"moon\", or what a kernel has";
            return Err(
                Failure::argument("body", "has no velocity here", format!("\"{body}\""), expected).into()
            );
        }
        let (ephemeris, body) = (self.ephemeris.clone(), body.to_owned());
        let times: Vec<f64> = tdb_s.as_array().to_vec();
        let found = work::run(py, None, move |_| {
            let at = |&tdb_s: &f64| {
                let state = match body.as_str() {
                    "sun" => ephemeris.solar_system(tdb_s)?.sun,
                    "earth" => ephemeris.solar_system(tdb_s)?.earth,
                    "moon" => ephemeris.solar_system(tdb_s)?.moon,
                    other => ephemeris.state(other, tdb_s)?,
                };
                Ok(state.velocity_m_s)
            };
            Ok(times.iter().map(at).collect::<Result<Vec<DVec3>, EphemerisError>>()?)
        })?;
        rows(py, found.iter().map(|velocity| velocity.to_array().to_vec()).collect(), 3)
    }

    /// A body as an observer sees it, with light-time, deflection and, where a velocity is given, aberration.
    fn seen<'py>(
        &self,
        py: Python<'py>,
        body: &str,
        tdb_s: f64,
        position_m: PyReadonlyArray1<'py, f64>,
        velocity_m_s: Option<PyReadonlyArray1<'py, f64>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let velocity_m_s = velocity_m_s.map(|array| vector("velocity_m_s", &array)).transpose()?;
        let position_m = vector("position_m", &position_m)?;
        let observer =
            Observer::new(&self.ephemeris, tdb_s, position_m, velocity_m_s).map_err(Failure::from)?;
        let inside = || Failure::new("the observer is inside the body");
        let seen = seen_planet(&observer, planet(body)?).map_err(Failure::from)?.ok_or_else(inside)?;
        let out = PyDict::new(py);
        out.set_item("direction", seen.direction.to_array())?;
        out.set_item("distance_m", seen.distance_m)?;
        out.set_item("sun_distance_m", seen.sun_distance_m)?;
        out.set_item("phase_rad", seen.phase_angle_rad)?;
        out.set_item("angular_radius_rad", seen.angular_radius_rad)?;
        out.set_item("magnitude", seen.magnitude)?;
        out.set_item("magnitude_extrapolated", seen.magnitude_extrapolated)?;
        Ok(out)
    }

    /// Barycentric position (m) and velocity (m/s) of a place on the Earth.
    fn site(
        &self,
        tdb_s: f64,
        latitude_rad: f64,
        longitude_rad: f64,
        altitude_m: f64,
    ) -> PyResult<([f64; 3], [f64; 3])> {
        let site = Site { longitude_rad, latitude_rad, altitude_m };
        let (position_m, velocity_m_s) = site.state(&self.ephemeris, tdb_s).map_err(Failure::from)?;
        Ok((position_m.to_array(), velocity_m_s.to_array()))
    }

    /// Rotations from inertial to a body's axes at these times, scalar-first quaternions of shape (times, 4).
    fn orientations<'py>(
        &self,
        py: Python<'py>,
        body: &str,
        tdb_s: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let mut turned = Vec::new();
        for &tdb_s in tdb_s.as_array() {
            let Some(turn) = self.ephemeris.body_from_inertial(body, tdb_s).map_err(Failure::from)? else {
                let expected = "moon, earth, mars, saturn, uranus, or a body of a PCK kernel";
                return Err(
                    Failure::argument("body", "has no known axes", format!("\"{body}\""), expected).into()
                );
            };
            turned.push(scalar_first(turn).to_vec());
        }
        rows(py, turned, 4)
    }

    /// Rotations from inertial to the axes of a frame of the kernels, scalar-first quaternions of shape (times, 4).
    fn frame_turns<'py>(
        &self,
        py: Python<'py>,
        frame: &str,
        tdb_s: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let turn =
            |&tdb_s: &f64| Ok(scalar_first(self.ephemeris.frame_from_inertial(frame, tdb_s)?).to_vec());
        let turned: Result<Vec<Vec<f64>>, EphemerisError> = tdb_s.as_array().iter().map(turn).collect();
        rows(py, turned.map_err(Failure::from)?, 4)
    }

    /// What turns a body where it is a kernel.
    fn axes_source(&self, body: &str) -> Option<String> {
        self.ephemeris.axes_source(body)
    }

    /// A body's semi-axes by kernels, m.
    fn semi_axes_m(&self, body: &str) -> Option<[f64; 3]> {
        self.ephemeris.semi_axes_m(body).map(|axes_m| axes_m.to_array())
    }

    /// The first new Moon after an epoch, TDB seconds since J2000.
    fn next_new_moon_s(&self, after_tdb_s: f64) -> PyResult<f64> {
        Ok(self.ephemeris.next_new_moon_s(after_tdb_s).map_err(Failure::from)?)
    }
}

fn rows(py: Python<'_>, rows: Vec<Vec<f64>>, columns: usize) -> PyResult<Bound<'_, PyArray2<f64>>> {
    Ok(match rows.is_empty() {
        true => PyArray2::zeros(py, [0, columns], false),
        false => PyArray2::from_vec2(py, &rows)?,
    })
}

/// An epoch in ISO 8601 as TDB seconds since J2000.
#[pyfunction]
pub(crate) fn parse_time(text: &str) -> PyResult<f64> {
    Ok(parse_epoch(text).map_err(Failure::from)?)
}

/// TDB seconds since J2000 as an epoch.
#[pyfunction]
pub(crate) fn format_time(tdb_s: f64) -> String {
    format_epoch_tdb(tdb_s)
}
