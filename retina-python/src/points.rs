//! Points of light in a camera image.

use numpy::{PyArray1, PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use retina::image::{Centroid, DetectOptions, LightPoint, detect_points, detect_points_in};

use crate::convert::camera_image;
use crate::errors::Failure;
use crate::work;

/// Finds points of light and measures each. Gives a dict of columns, one value a point, brightest first, and a dict of
/// what the image is.
#[pyfunction]
#[pyo3(signature = (image, mask, bits, threshold_sigma, saturation_dn, gain_e_per_dn, spot_sigma_px, centroid, mesh_px, single_pixels))]
pub(crate) fn detect<'py>(
    py: Python<'py>,
    image: Bound<'py, PyAny>,
    mask: Option<PyReadonlyArray2<'py, bool>>,
    bits: Option<u32>,
    threshold_sigma: f64,
    saturation_dn: Option<f32>,
    gain_e_per_dn: Option<f64>,
    spot_sigma_px: Option<f64>,
    centroid: &str,
    mesh_px: usize,
    single_pixels: bool,
) -> PyResult<(Bound<'py, PyDict>, Bound<'py, PyDict>)> {
    for (name, value) in [
        ("threshold_sigma", Some(threshold_sigma)),
        ("gain_e_per_dn", gain_e_per_dn),
        ("spot_sigma_px", spot_sigma_px),
    ] {
        if let Some(value) = value.filter(|value| !(value.is_finite() && *value > 0.0)) {
            return Err(Failure::argument(name, "is out of range", value, "a number above 0").into());
        }
    }
    if !(4..=4096).contains(&mesh_px) {
        return Err(Failure::argument("mesh_px", "is out of range", mesh_px, "4 to 4096").into());
    }
    let centroid = match centroid {
        "windowed" => Centroid::Windowed,
        "moments" => Centroid::Moments,
        other => {
            let found = format!("\"{other}\"");
            return Err(
                Failure::argument("centroid", "is not known", found, "\"windowed\" or \"moments\"").into()
            );
        }
    };
    let options = DetectOptions {
        threshold_sigma,
        saturation_dn,
        gain_e_per_dn,
        spot_sigma_px,
        centroid,
        mesh_px,
        single_pixels,
    };
    let image = camera_image(&image, bits)?;
    let mask = mask.map(|mask| usable(&mask, [image.width_px, image.height_px])).transpose()?;
    let found = work::run(py, None, move |_| {
        Ok(match mask {
            Some(mask) => detect_points_in(&image, &mask, &options),
            None => detect_points(&image, &options),
        })
    })?;
    let columns = columns(py, &found.points)?;
    let about = PyDict::new(py);
    let hot: Vec<Vec<u64>> = found.hot_pixels.iter().map(|pixel| pixel.map(|k| k as u64).to_vec()).collect();
    let hot = match hot.is_empty() {
        true => PyArray2::zeros(py, [0, 2], false),
        false => PyArray2::from_vec2(py, &hot)?,
    };
    about.set_item("hot_pixels", hot)?;
    about.set_item("background_dn", found.background_dn)?;
    about.set_item("noise_dn", found.noise_dn)?;
    about.set_item("spot_sigma_px", found.spot_sigma_px)?;
    Ok((columns, about))
}

/// A mask row by row: true where points are looked for.
pub(crate) fn usable(mask: &PyReadonlyArray2<'_, bool>, size_px: [u32; 2]) -> PyResult<Vec<bool>> {
    use numpy::PyUntypedArrayMethods as _;
    let found = [mask.shape()[1], mask.shape()[0]];
    if found != size_px.map(|size| size as usize) {
        let found = format!("{} x {}", found[0], found[1]);
        let expected = format!("the image's {} x {} pixels", size_px[0], size_px[1]);
        return Err(Failure::argument("mask", "does not have the image's size", found, &expected).into());
    }
    Ok(mask.as_array().iter().copied().collect())
}

/// A column's name and its value of a point.
type Column<T> = (&'static str, fn(&LightPoint) -> T);

fn columns<'py>(py: Python<'py>, points: &[LightPoint]) -> PyResult<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    let numbers: [Column<f64>; 11] = [
        ("x_px", |p| p.x_px),
        ("y_px", |p| p.y_px),
        ("sigma_px", |p| p.sigma_px),
        ("flux_dn", |p| p.flux_dn),
        ("peak_dn", |p| p.peak_dn),
        ("snr", |p| p.snr),
        ("width_px", |p| p.width_px.unwrap_or(f64::NAN)),
        ("ellipticity", |p| p.ellipticity.unwrap_or(f64::NAN)),
        ("saturation_shift_px", |p| p.saturation_shift_px),
        ("saturation_reach_px", |p| p.saturation_reach_px),
        ("bright_surroundings", |p| p.bright_surroundings),
    ];
    for (name, of) in numbers {
        out.set_item(name, PyArray1::from_iter(py, points.iter().map(of)))?;
    }
    let flags: [Column<bool>; 3] =
        [("saturated", |p| p.saturated), ("blended", |p| p.blended), ("on_line", |p| p.on_line)];
    for (name, of) in flags {
        out.set_item(name, PyArray1::from_iter(py, points.iter().map(of)))?;
    }
    Ok(out)
}
