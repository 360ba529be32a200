//! Effects that are Python functions.

use std::sync::{Arc, Mutex, PoisonError};

use numpy::{PyArray1, PyReadonlyArrayDyn};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use retina::diagnosis::{OwnEffect, OwnParameter};

use crate::errors::Failure;
use crate::work::Watch;

/// A Python function of columns and parameters.
pub(crate) struct PythonEffect {
    name: String,
    parameters: Vec<OwnParameter>,
    columns: Vec<String>,
    function: Py<PyAny>,
    /// Two components a row (points), or one.
    components: usize,
    watch: Watch,
    raised: Raised,
}

/// What a function raised first: the work is unwound, and this is raised again.
pub(crate) type Raised = Arc<Mutex<Option<PyErr>>>;

/// What Python gives of an effect: name, function, columns, and parameters as (name, start, unit).
pub(crate) type Description = (String, Py<PyAny>, Vec<String>, Vec<(String, f64, String)>);

impl PythonEffect {
    pub(crate) fn new(of: Description, components: usize, watch: &Watch, raised: &Raised) -> Self {
        let (name, function, columns, parameters) = of;
        let parameter = |(name, start, unit)| OwnParameter { name, start, unit };
        let parameters = parameters.into_iter().map(parameter).collect();
        let (watch, raised) = (watch.clone(), Arc::clone(raised));
        Self { name, parameters, columns, function, components, watch, raised }
    }

    /// The function's value in each row.
    fn call(&self, columns: &[Vec<f64>], rows: usize, parameters: &[f64]) -> PyResult<Vec<[f64; 2]>> {
        Python::attach(|py| {
            let arguments = PyDict::new(py);
            for (name, values) in self.columns.iter().zip(columns) {
                arguments.set_item(name, PyArray1::from_slice(py, values))?;
            }
            for (parameter, value) in self.parameters.iter().zip(parameters) {
                arguments.set_item(&parameter.name, value)?;
            }
            let result = self.function.bind(py).call((), Some(&arguments))?;
            if self.components == 1 {
                let values = self.column(py, &result, rows)?;
                return Ok(values.into_iter().map(|value| [value, 0.0]).collect());
            }
            let parts: Vec<Bound<'_, PyAny>> = result.try_iter()?.collect::<PyResult<_>>()?;
            let [x, y] = &parts[..] else {
                let text =
                    format!("effect `{}` gives {} values, not dx and dy in arcsec", self.name, parts.len());
                return Err(PyTypeError::new_err(text));
            };
            let (x, y) = (self.column(py, x, rows)?, self.column(py, y, rows)?);
            Ok(x.into_iter().zip(y).map(|(x, y)| [x, y]).collect())
        })
    }

    /// An array with a value a row, or one number for all.
    fn column(&self, py: Python<'_>, values: &Bound<'_, PyAny>, rows: usize) -> PyResult<Vec<f64>> {
        if let Ok(value) = values.extract::<f64>() {
            return Ok(vec![value; rows]);
        }
        let array = py.import("numpy")?.call_method1("asarray", (values, "float64"))?;
        let array: PyReadonlyArrayDyn<'_, f64> = array.extract()?;
        let array = array.as_array();
        if array.shape() != [rows] {
            let text = format!(
                "effect `{}` gives an array of shape {:?}, expected ({rows},)",
                self.name,
                array.shape()
            );
            return Err(PyTypeError::new_err(text));
        }
        Ok(array.iter().copied().collect())
    }

    fn called(&self, columns: &[Vec<f64>], rows: usize, parameters: &[f64]) -> Vec<[f64; 2]> {
        match self.call(columns, rows, parameters) {
            Ok(values) => values,
            Err(error) => {
                self.raised.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
                self.watch.abandon()
            }
        }
    }
}

impl OwnEffect for PythonEffect {
    fn name(&self) -> &str {
        &self.name
    }

    fn parameters(&self) -> &[OwnParameter] {
        &self.parameters
    }

    fn columns(&self) -> Vec<&str> {
        self.columns.iter().map(String::as_str).collect()
    }

    fn value(&self, columns: &[f64], parameters: &[f64]) -> [f64; 2] {
        let columns: Vec<Vec<f64>> = columns.iter().map(|&value| vec![value]).collect();
        self.called(&columns, 1, parameters)[0]
    }

    fn values_and_slopes(&self, columns: &[Vec<f64>], parameters: &[f64]) -> Vec<([f64; 2], Vec<[f64; 2]>)> {
        self.watch.check();
        let rows = columns.first().map_or(0, Vec::len);
        let values = self.called(columns, rows, parameters);
        let mut out: Vec<([f64; 2], Vec<[f64; 2]>)> =
            values.into_iter().map(|value| (value, Vec::with_capacity(parameters.len()))).collect();
        for k in 0..parameters.len() {
            let step = retina::diagnosis::difference_step(parameters[k]);
            let at = |sign: f64| {
                let mut moved = parameters.to_vec();
                moved[k] += sign * step;
                self.called(columns, rows, &moved)
            };
            let (above, below) = (at(1.0), at(-1.0));
            for ((_, slopes), (above, below)) in out.iter_mut().zip(above.iter().zip(&below)) {
                slopes.push([0, 1].map(|axis| (above[axis] - below[axis]) / (2.0 * step)));
            }
        }
        out
    }
}

/// What a function raised, where one did.
pub(crate) fn taken(raised: &Raised) -> Option<PyErr> {
    raised.lock().unwrap_or_else(PoisonError::into_inner).take()
}

/// The failure of work that a function's exception has unwound.
pub(crate) fn unwound() -> Failure {
    Failure::new("the function of an effect raised an exception")
}
