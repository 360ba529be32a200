//! Calibrations of a facility: held, fitted, written.

use std::path::PathBuf;

use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use retina::calibration::geometry::{
    self, CalibrateOptions, GeometryCalibration, calibrate, text_summary, to_json, write_calibration,
};
use retina::files::InputError;
use retina::formats::{CalibrationFile, MeasuredResponse, PointsTable};
use retina::geometry::Setup;
use retina::response::{Calibrated, PowerReadings, json_document, summary};
use retina::workbench::GivenCalibration;

use crate::convert::document;
use crate::errors::Failure;
use crate::setup::PySetup;
use crate::tables::TableOf;
use crate::work;

/// A calibration as it stands in its file.
#[pyclass(name = "Calibration", module = "retina._native", frozen)]
pub(crate) struct PyCalibration {
    pub(crate) given: GivenCalibration,
}

#[pymethods]
impl PyCalibration {
    /// Reads a calibration of a setup.
    #[staticmethod]
    fn read(path: PathBuf, setup: PyRef<'_, PySetup>) -> PyResult<Self> {
        Ok(Self { given: GivenCalibration::read(&path, &setup.setup).map_err(Failure::from)? })
    }

    /// The file's text.
    fn text(&self) -> String {
        self.given.file.text()
    }

    /// Writes it.
    fn write(&self, path: PathBuf) -> PyResult<()> {
        Ok(self.given.file.write(&path).map_err(Failure::from)?)
    }
}

/// A fit of the facility's geometry.
#[pyclass(name = "GeometryFit", module = "retina._native", frozen)]
pub(crate) struct PyGeometryFit {
    result: GeometryCalibration,
    table: PointsTable,
    setup: Setup,
    options: CalibrateOptions,
}

/// Calibrates the mapping between lines of sight and the screen.
#[pyfunction]
#[pyo3(signature = (table, setup, plain, reference_log10_irradiance, response))]
pub(crate) fn calibrate_geometry(
    py: Python<'_>,
    table: TableOf<'_>,
    setup: PyRef<'_, PySetup>,
    plain: bool,
    reference_log10_irradiance: Option<f64>,
    response: Option<PyRef<'_, PyCalibration>>,
) -> PyResult<PyGeometryFit> {
    let table = table.points()?;
    let setup = (*setup.setup).clone();
    let response = response.map(|given| measured(&given.given, &setup)).transpose().map_err(Failure::from)?;
    let options = CalibrateOptions { plain, form: None, reference_log10_irradiance, response };
    work::run(py, None, move |_| {
        let result = calibrate(&table, &setup, &options)?;
        Ok(PyGeometryFit { result, table, setup, options })
    })
}

fn measured(given: &GivenCalibration, setup: &Setup) -> Result<MeasuredResponse, InputError> {
    MeasuredResponse::of_file(&given.file, &given.path, setup)?.ok_or_else(|| {
        InputError::new(&given.path, "has no measured response")
            .expected("a table [response]")
            .help("make one with calibrate_radiometry")
    })
}

#[pymethods]
impl PyGeometryFit {
    /// What `calibrate geometry --json` says.
    fn document(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        document(py, &to_json(&self.result, &self.setup))
    }

    /// A short account.
    fn text(&self) -> String {
        text_summary(&self.result, &self.setup)
    }

    /// The fitted points, as columns: the table's row, residual, errors, and whether it is an outlier.
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let points = &self.result.points;
        let out = PyDict::new(py);
        out.set_item("row", PyArray1::from_iter(py, points.iter().map(|p| p.row as i64)))?;
        out.set_item("sight_x", PyArray1::from_iter(py, points.iter().map(|p| p.sight.x)))?;
        out.set_item("sight_y", PyArray1::from_iter(py, points.iter().map(|p| p.sight.y)))?;
        out.set_item("log10_irradiance", PyArray1::from_iter(py, points.iter().map(|p| p.log10_irradiance)))?;
        out.set_item("error_arcsec", PyArray1::from_iter(py, points.iter().map(|p| p.error_arcsec)))?;
        out.set_item("heldout_arcsec", PyArray1::from_iter(py, points.iter().map(|p| p.heldout_arcsec)))?;
        out.set_item("outlier", PyArray1::from_iter(py, points.iter().map(|p| p.outlier)))?;
        Ok(out)
    }

    /// The calibration, for whoever takes one.
    fn calibration(&self) -> PyCalibration {
        let mut file = CalibrationFile::new(&self.setup);
        file.response.clone_from(&self.result.response);
        self.result.store(&mut file);
        PyCalibration { given: GivenCalibration { file, path: PathBuf::from("<calibration>") } }
    }

    /// Writes it as `calibration.toml`, with its provenance; the response of a file that is there is kept.
    fn write(&self, path: PathBuf) -> PyResult<()> {
        Ok(write_calibration(&path, &self.result, &self.table, &self.setup).map_err(Failure::from)?)
    }

    /// Writes the page with its plots.
    fn write_report(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let written = py
            .detach(|| geometry::write_report(&path, &self.result, &self.table, &self.setup, &self.options));
        Ok(written.map_err(Failure::from)?)
    }

    /// Its plots, as SVG by name.
    fn figures<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let drawn = py.detach(|| {
            let plain = CalibrateOptions { plain: true, form: None, ..self.options.clone() };
            let plain = calibrate(&self.table, &self.setup, &plain)?;
            let figures = geometry::figures(&self.result, &plain);
            Ok::<_, InputError>(
                figures.into_iter().map(|(name, figure)| (name, figure.to_svg())).collect::<Vec<_>>(),
            )
        });
        let out = PyDict::new(py);
        for (name, svg) in drawn.map_err(Failure::from)? {
            out.set_item(name, svg)?;
        }
        Ok(out)
    }
}

/// A fit of the display's response.
#[pyclass(name = "RadiometryFit", module = "retina._native", frozen)]
pub(crate) struct PyRadiometryFit {
    calibrated: Calibrated,
    measured: Setup,
    setup: Setup,
}

/// Calibrates the display's response, for another magnification where `for_setup` is given.
#[pyfunction]
#[pyo3(signature = (table, setup, for_setup))]
pub(crate) fn calibrate_radiometry(
    py: Python<'_>,
    table: TableOf<'_>,
    setup: PyRef<'_, PySetup>,
    for_setup: Option<PyRef<'_, PySetup>>,
) -> PyResult<PyRadiometryFit> {
    let table = table.power()?;
    let measured = (*setup.setup).clone();
    let other = for_setup.map(|other| (*other.setup).clone());
    work::run(py, None, move |_| {
        table.check_setup(&measured)?;
        let mut calibrated = Calibrated::fit(&measured, PowerReadings::of(&table)?)?;
        if let Some(other) = &other {
            calibrated = calibrated.for_setup(&measured, other)?;
        }
        let setup = other.unwrap_or_else(|| measured.clone());
        Ok(PyRadiometryFit { calibrated, measured, setup })
    })
}

#[pymethods]
impl PyRadiometryFit {
    /// What `calibrate radiometry --json` says.
    fn document(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        document(py, &json_document(&self.calibrated, &self.setup))
    }

    /// A short account.
    fn text(&self) -> Vec<String> {
        summary(&self.calibrated, &self.setup)
    }

    /// The calibration, for whoever takes one.
    fn calibration(&self) -> PyResult<PyCalibration> {
        let path = PathBuf::from("<calibration>");
        let file = self.file(CalibrationFile::new(&self.setup), &path)?;
        Ok(PyCalibration { given: GivenCalibration { file, path } })
    }

    /// Writes it as `calibration.toml`; the other tables of a file that is there are kept.
    fn write(&self, path: PathBuf) -> PyResult<()> {
        let file = CalibrationFile::read_or_new(&path, &self.setup).map_err(Failure::from)?;
        Ok(self.file(file, &path)?.write(&path).map_err(Failure::from)?)
    }

    /// The figures of the response and of its magnitudes, as SVG.
    fn figures(&self, py: Python<'_>) -> [String; 2] {
        py.detach(|| retina::response::figures(&self.calibrated))
    }
}

impl PyRadiometryFit {
    fn file(&self, mut file: CalibrationFile, path: &std::path::Path) -> PyResult<CalibrationFile> {
        let record = self.calibrated.record(&self.measured);
        file.set_response(record, path, &self.setup).map_err(Failure::from)?;
        Ok(file)
    }
}
