//! Documents and arrays on their way to Python and back.

use numpy::{PyArray2, PyArrayMethods as _, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use retina::glam::{DQuat, DVec3};
use retina::image::{CameraImage, Steps};
use serde_json::Value;

use crate::errors::Failure;

/// A JSON document as Python has it: dicts, lists, strings, numbers, `None`.
pub(crate) fn document(py: Python<'_>, value: &Value) -> PyResult<Py<PyAny>> {
    Ok(match value {
        Value::Null => py.None(),
        Value::Bool(flag) => flag.into_pyobject(py)?.to_owned().into_any().unbind(),
        Value::Number(number) => match (number.as_i64(), number.as_u64(), number.as_f64()) {
            (Some(whole), _, _) => whole.into_pyobject(py)?.into_any().unbind(),
            (None, Some(whole), _) => whole.into_pyobject(py)?.into_any().unbind(),
            (None, None, float) => float.into_pyobject(py)?.into_any().unbind(),
        },
        Value::String(text) => text.into_pyobject(py)?.into_any().unbind(),
        Value::Array(values) => {
            let list = PyList::empty(py);
            for value in values {
                list.append(document(py, value)?)?;
            }
            list.into_any().unbind()
        }
        Value::Object(fields) => {
            let dict = PyDict::new(py);
            for (key, value) in fields {
                dict.set_item(key, document(py, value)?)?;
            }
            dict.into_any().unbind()
        }
    })
}

/// An array of values row by row, without a copy.
pub(crate) fn image_array<T: numpy::Element>(
    py: Python<'_>,
    values: Vec<T>,
    [width_px, height_px]: [usize; 2],
) -> PyResult<Py<PyArray2<T>>> {
    Ok(numpy::PyArray1::from_vec(py, values).reshape([height_px, width_px])?.unbind())
}

/// A camera image from a 2-d array of uint8, uint16, float32 or float64: digital numbers, linear in light. Without
/// `bits`, whole numbers have the full scale of their type, and floating-point numbers have none.
pub(crate) fn camera_image(array: &Bound<'_, PyAny>, bits: Option<u32>) -> PyResult<CameraImage> {
    if let Some(bits) = bits.filter(|bits| !(1..=16).contains(bits)) {
        return Err(Failure::argument("bits", "is out of range", bits, "1 to 16").into());
    }
    let (values, [height_px, width_px], own_bits) = if let Ok(a) = array.extract::<PyReadonlyArray2<'_, u8>>()
    {
        (floats(&a, f32::from), shape(&a), Some(8))
    } else if let Ok(a) = array.extract::<PyReadonlyArray2<'_, u16>>() {
        (floats(&a, f32::from), shape(&a), Some(16))
    } else if let Ok(a) = array.extract::<PyReadonlyArray2<'_, f32>>() {
        (floats(&a, |value| value), shape(&a), None)
    } else if let Ok(a) = array.extract::<PyReadonlyArray2<'_, f64>>() {
        (floats(&a, |value| value as f32), shape(&a), None)
    } else {
        return Err(PyTypeError::new_err("an image is a 2-d array of uint8, uint16, float32 or float64"));
    };
    // Floating-point numbers may still be a camera's whole ones.
    let whole = own_bits.is_some() || values.iter().all(|&value| value as i32 as f32 == value);
    let steps = if whole { Steps::Whole } else { Steps::Fine };
    let size = [width_px, height_px].map(u32::try_from);
    let [Ok(width_px), Ok(height_px)] = size else {
        return Err(PyTypeError::new_err("the image has more than 2^32 rows or columns"));
    };
    let bits = bits.or(own_bits);
    let image = CameraImage::from_values("<image>".as_ref(), [width_px, height_px], values, steps, bits);
    Ok(image.map_err(Failure::from)?)
}

fn shape<T: numpy::Element>(array: &PyReadonlyArray2<'_, T>) -> [usize; 2] {
    use numpy::PyUntypedArrayMethods as _;
    [array.shape()[0], array.shape()[1]]
}

fn floats<T: numpy::Element + Copy>(array: &PyReadonlyArray2<'_, T>, of: impl Fn(T) -> f32) -> Vec<f32> {
    let view = array.as_array();
    match view.as_slice() {
        Some(values) => values.iter().map(|&value| of(value)).collect(),
        // Not row by row: a view of every other pixel, or columns first.
        None => view.iter().map(|&value| of(value)).collect(),
    }
}

/// Three finite numbers.
pub(crate) fn vector(name: &str, array: &PyReadonlyArray1<'_, f64>) -> PyResult<DVec3> {
    let values: Vec<f64> = array.as_array().iter().copied().collect();
    match values[..] {
        [x, y, z] if DVec3::new(x, y, z).is_finite() => Ok(DVec3::new(x, y, z)),
        _ => {
            Err(Failure::argument(name, "is no vector", format!("{values:?}"), "three finite numbers").into())
        }
    }
}

/// A rotation from a quaternion, scalar first, of any length above 0.
pub(crate) fn quaternion(name: &str, array: &PyReadonlyArray1<'_, f64>) -> PyResult<DQuat> {
    let values: Vec<f64> = array.as_array().iter().copied().collect();
    if let [w, x, y, z] = values[..] {
        let turn = DQuat::from_xyzw(x, y, z, w);
        if turn.is_finite() && turn.length() > 1e-6 {
            return Ok(turn.normalize());
        }
    }
    let expected = "four numbers w, x, y, z, not all 0";
    Err(Failure::argument(name, "is no rotation", format!("{values:?}"), expected).into())
}

/// A quaternion, scalar first.
pub(crate) fn scalar_first(q: DQuat) -> [f64; 4] {
    [q.w, q.x, q.y, q.z]
}
