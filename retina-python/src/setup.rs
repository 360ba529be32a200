//! Facility configurations.

use std::path::PathBuf;
use std::sync::Arc;

use pyo3::prelude::*;
use pyo3::types::PyDict;
use retina::geometry::{Pinhole, Setup};

use crate::errors::Failure;

/// A facility configuration, read and checked.
#[pyclass(name = "Setup", module = "retina._native", frozen)]
pub(crate) struct PySetup {
    pub(crate) setup: Arc<Setup>,
}

#[pymethods]
impl PySetup {
    /// Reads a setup from its file.
    #[staticmethod]
    fn read(path: PathBuf) -> PyResult<Self> {
        Ok(Self { setup: Arc::new(Setup::read(&path).map_err(Failure::from)?) })
    }

    /// Reads a setup from text; `name` names it in errors, and paths in it are relative to `name`.
    #[staticmethod]
    fn parse(text: &str, name: PathBuf) -> PyResult<Self> {
        Ok(Self { setup: Arc::new(Setup::parse(text, &name).map_err(Failure::from)?) })
    }

    /// A setup that ships; `None` where there is none of this name. The calibration that it names is not in the package.
    #[staticmethod]
    fn shipped(name: &str) -> PyResult<Option<Self>> {
        Ok(Setup::shipped(name.as_ref()).map(|setup| Self { setup: Arc::new(setup) }))
    }

    /// Everything that the setup states, by name.
    fn fields<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let setup = &self.setup;
        let (screen, camera) = (&setup.screen, &setup.camera);
        let out = PyDict::new(py);
        out.set_item("name", &setup.name)?;
        out.set_item("file", setup.file.display().to_string())?;
        out.set_item("screen_size_px", (screen.width_px, screen.height_px))?;
        out.set_item("screen_size_mm", (screen.width_mm, screen.height_mm))?;
        let nm = &screen.wavelength_nm;
        out.set_item("wavelength_nm", (nm.r, nm.g, nm.b))?;
        out.set_item("camera_size_px", (camera.width_px, camera.height_px))?;
        out.set_item("pixel_um", camera.pixel_um)?;
        out.set_item("focal_mm", camera.focal_mm)?;
        out.set_item("f_number", camera.f_number)?;
        out.set_item("bits", camera.bits)?;
        out.set_item("facility_pinhole", pinhole(&setup.facility_pinhole()))?;
        out.set_item("camera_pinhole", pinhole(&setup.camera_pinhole()))?;
        out.set_item("response_gamma", setup.response_gamma())?;
        out.set_item("brightest_magnitude", setup.brightest_magnitude())?;
        out.set_item("calibration_file", setup.calibration_path().map(|path| path.display().to_string()))?;
        Ok(out)
    }
}

/// f_x, f_y, c_x, c_y, width, height; px.
fn pinhole(of: &Pinhole) -> (f64, f64, f64, f64, u32, u32) {
    (of.fx_px, of.fy_px, of.cx_px, of.cy_px, of.width_px, of.height_px)
}
