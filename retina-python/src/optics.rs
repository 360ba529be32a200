//! Lens systems, traced exactly.

use std::path::PathBuf;
use std::sync::Arc;

use numpy::{PyArray1, PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use retina::optics::analysis::{self, PsfGridChoice, SpotOptions};
use retina::optics::paraxial::Paraxial;
use retina::optics::plot::{self, SpotRow};
use retina::optics::{
    Clipping, Launcher, Object, OpticalSystem, OpticsError, RayBatch, Tracer, read_system, shipped_designs,
};

use crate::convert::image_array;
use crate::errors::Failure;
use crate::work;

/// A lens system.
#[pyclass(name = "OpticalSystem", module = "retina._native", frozen)]
pub(crate) struct PyOpticalSystem {
    system: Arc<OpticalSystem>,
    clipping: Clipping,
}

/// Rays beyond the drawing's need would only hide each other.
const DRAWN: (usize, usize) = (10, 40);

#[pymethods]
impl PyOpticalSystem {
    /// Reads a prescription (.toml, .zmx), or takes a design that ships, by its name.
    #[staticmethod]
    #[pyo3(signature = (source, agf, clear_fraction, unclipped))]
    fn read(
        source: PathBuf,
        agf: Vec<PathBuf>,
        clear_fraction: Option<f64>,
        unclipped: bool,
    ) -> PyResult<Self> {
        let mut system = read_system(&source, &agf).map_err(Failure::from)?;
        if let Some(fraction) = clear_fraction {
            system.clear_fraction = fraction;
            system.check("--clear-fraction".as_ref()).map_err(Failure::from)?;
        }
        let clipping = if unclipped { Clipping::Off } else { Clipping::On };
        Ok(Self { system: Arc::new(system), clipping })
    }

    /// Names of the designs that ship.
    #[staticmethod]
    fn shipped() -> Vec<&'static str> {
        shipped_designs().collect()
    }

    /// What the system is.
    fn fields<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let system = &self.system;
        let out = PyDict::new(py);
        out.set_item("name", &system.name)?;
        let fields: Vec<Vec<f64>> = system.fields.iter().map(|field| field.at.to_vec()).collect();
        out.set_item("fields", PyArray2::from_vec2(py, &fields)?)?;
        out.set_item("infinite_object", matches!(system.object, Object::Infinity))?;
        let nm = system.wavelengths.iter().map(|wavelength| wavelength.nm);
        out.set_item("wavelengths_nm", PyArray1::from_iter(py, nm))?;
        out.set_item("primary_nm", system.primary_nm())?;
        out.set_item("clear_fraction", system.clear_fraction)?;
        let labels: Vec<&str> = system.surfaces.iter().map(|surface| surface.label.as_str()).collect();
        out.set_item("surfaces", labels)?;
        Ok(out)
    }

    /// First-order figures at the primary wavelength.
    fn first_order(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        let first = Paraxial::primary(&self.system).map_err(Failure::from)?.first_order();
        let told = serde_json::to_value(first).map_err(|error| Failure::new(error.to_string()))?;
        crate::convert::document(py, &told)
    }

    /// Traces rays of fields and pupil points, both of shape (rays, 2), to the image surface: where they land (mm, NaN
    /// where a ray is lost), their directions, their path lengths (mm), and why a ray was lost.
    #[pyo3(signature = (fields, pupils, wavelength_nm))]
    fn trace<'py>(
        &self,
        py: Python<'py>,
        fields: PyReadonlyArray2<'py, f64>,
        pupils: PyReadonlyArray2<'py, f64>,
        wavelength_nm: Option<f64>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let pairs = |name: &str, array: &PyReadonlyArray2<'py, f64>| -> PyResult<Vec<[f64; 2]>> {
            let array = array.as_array();
            if array.ncols() != 2 {
                let found = format!("shape {:?}", array.shape());
                return Err(
                    Failure::argument(name, "has no pairs", found, "an array of shape (rays, 2)").into()
                );
            }
            Ok(array.rows().into_iter().map(|row| [row[0], row[1]]).collect())
        };
        let (fields, pupils) = (pairs("field", &fields)?, pairs("pupil", &pupils)?);
        if fields.len() != pupils.len() {
            let found = format!("{} fields, {} pupil points", fields.len(), pupils.len());
            return Err(
                Failure::argument("pupil", "has another length than the fields", found, "as many").into()
            );
        }
        let (system, clipping) = (Arc::clone(&self.system), self.clipping);
        let (batch, lost) = work::run(py, None, move |_| {
            let tracer = Tracer::new(&system, wavelength_nm.unwrap_or(system.primary_nm()), clipping)?;
            let launcher = Launcher::new(&system)?;
            let mut batch = RayBatch::with_capacity(fields.len());
            for (at, (&field, &pupil)) in fields.iter().zip(&pupils).enumerate() {
                system.check_ray(format!("--ray {at}").as_ref(), field, pupil)?;
                batch.push(&launcher.ray(field, pupil)?);
            }
            tracer.trace_batch(&mut batch);
            let lost: Vec<Option<String>> =
                (0..batch.len()).map(|i| batch.failure(i).map(|failure| failure.to_string())).collect();
            Ok((batch, lost))
        })?;
        let arrived: Vec<bool> = (0..batch.len()).map(|i| batch.arrived(i)).collect();
        let seen = |values: &[f64]| {
            let kept = values.iter().zip(&arrived).map(|(&v, &there)| if there { v } else { f64::NAN });
            PyArray1::from_iter(py, kept)
        };
        let out = PyDict::new(py);
        for (name, values) in [
            ("x_mm", &batch.x_mm),
            ("y_mm", &batch.y_mm),
            ("z_mm", &batch.z_mm),
            ("l", &batch.l),
            ("m", &batch.m),
            ("n", &batch.n),
            ("path_mm", &batch.path_mm),
        ] {
            out.set_item(name, seen(values))?;
        }
        out.set_item("lost", PyList::new(py, lost)?)?;
        Ok(out)
    }

    /// One ray through all surfaces: a column a quantity, a value a surface.
    #[pyo3(signature = (field, pupil, wavelength_nm))]
    fn trace_ray<'py>(
        &self,
        py: Python<'py>,
        field: (f64, f64),
        pupil: (f64, f64),
        wavelength_nm: Option<f64>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let system = &self.system;
        let (field, pupil) = ([field.0, field.1], [pupil.0, pupil.1]);
        system.check_ray("--ray".as_ref(), field, pupil).map_err(Failure::from)?;
        let nm = wavelength_nm.unwrap_or(system.primary_nm());
        let tracer = Tracer::new(system, nm, self.clipping).map_err(Failure::from)?;
        let launcher = Launcher::new(system).map_err(Failure::from)?;
        let ray = launcher.ray(field, pupil).map_err(Failure::from)?;
        let crossings =
            tracer.trace(&ray).map_err(|failure| Failure::new(format!("{}: {failure}", system.name)))?;
        let out = PyDict::new(py);
        let vectors = |of: fn(&retina::optics::Crossing) -> retina::glam::DVec3| {
            let rows: Vec<Vec<f64>> =
                crossings.iter().map(|crossing| of(crossing).to_array().to_vec()).collect();
            PyArray2::from_vec2(py, &rows)
        };
        out.set_item("position_mm", vectors(|crossing| crossing.position_mm)?)?;
        out.set_item("direction", vectors(|crossing| crossing.direction)?)?;
        let angle = crossings.iter().map(|crossing| crossing.incidence_cos.min(1.0).acos());
        out.set_item("incidence_rad", PyArray1::from_iter(py, angle))?;
        out.set_item("path_mm", PyArray1::from_iter(py, crossings.iter().map(|crossing| crossing.path_mm)))?;
        Ok(out)
    }

    /// Spots of every field: figures by Gaussian quadrature, points for drawing, and the drawing.
    fn spots<'py>(&self, py: Python<'py>, rings: usize, arms: usize) -> PyResult<Bound<'py, PyDict>> {
        for (name, value, least, most) in [("rings", rings, 1, 200), ("arms", arms, 3, 1000)] {
            if !(least..=most).contains(&value) {
                return Err(
                    Failure::argument(name, "is out of range", value, &format!("{least} to {most}")).into()
                );
            }
        }
        let (system, clipping) = (Arc::clone(&self.system), self.clipping);
        let (figures, drawn) = work::run(py, None, move |_| {
            let figures = analysis::spots(&system, &SpotOptions { rings, arms, clipping })?;
            let drawn = analysis::spots(&system, &SpotOptions { rings: DRAWN.0, arms: DRAWN.1, clipping })?;
            Ok((figures, drawn))
        })?;
        let row = SpotRow { system: &self.system, points: &drawn, figures: &figures, scale: 1.0 };
        let out = PyDict::new(py);
        out.set_item("svg", plot::spots_figure("Spot diagrams", &[row]).to_svg())?;
        out.set_item("airy_radius_um", figures.airy_radius_um)?;
        let column =
            |of: fn(&analysis::FieldSpot) -> f64| PyArray1::from_iter(py, figures.fields.iter().map(of));
        let pairs = |of: fn(&analysis::FieldSpot) -> [f64; 2]| {
            let rows: Vec<Vec<f64>> = figures.fields.iter().map(|field| of(field).to_vec()).collect();
            PyArray2::from_vec2(py, &rows)
        };
        out.set_item("field", pairs(|field| field.field)?)?;
        out.set_item("centroid_mm", pairs(|field| field.centroid_mm)?)?;
        out.set_item("rms_um", column(|field| field.rms_um))?;
        out.set_item("largest_um", column(|field| field.largest_um))?;
        out.set_item("vignetted_fraction", column(|field| field.vignetted_fraction))?;
        let points = PyList::empty(py);
        for field in &figures.fields {
            let of_field = PyList::empty(py);
            for wave in &field.wavelengths {
                let rows: Vec<Vec<f64>> = wave.points_mm.iter().map(|point| point.to_vec()).collect();
                match rows.is_empty() {
                    true => of_field.append(PyArray2::<f64>::zeros(py, [0, 2], false))?,
                    false => of_field.append(PyArray2::from_vec2(py, &rows)?)?,
                }
            }
            points.append(of_field)?;
        }
        out.set_item("points_mm", points)?;
        Ok(out)
    }

    /// Polychromatic point spread functions of every field.
    #[pyo3(signature = (pupil, pixels, pitch_um))]
    fn psf<'py>(
        &self,
        py: Python<'py>,
        pupil: Option<usize>,
        pixels: Option<usize>,
        pitch_um: Option<f64>,
    ) -> PyResult<Bound<'py, PyDict>> {
        for (name, value) in [("pupil", pupil), ("pixels", pixels)] {
            if let Some(value) = value.filter(|value| !(8..=1024).contains(value)) {
                return Err(Failure::argument(name, "is out of range", value, "8 to 1024").into());
            }
        }
        if let Some(value) = pitch_um.filter(|value| !(value.is_finite() && *value > 0.0)) {
            return Err(Failure::argument("pitch_um", "is out of range", value, "a number above 0").into());
        }
        let (system, clipping) = (Arc::clone(&self.system), self.clipping);
        let choice = PsfGridChoice { pupil_side: pupil, side: pixels, pitch_um };
        let psfs = work::run(py, None, move |watch| {
            let grid = analysis::psf_grid(&system, choice, clipping)?;
            let one = |field: &retina::optics::Field| {
                watch.check();
                let (pupil, side, pitch_um) = (grid.pupil_side, grid.side, grid.pitch_um);
                analysis::psf_polychromatic(&system, field.at, pupil, side, pitch_um, clipping)
            };
            Ok(system.fields.iter().map(one).collect::<Result<Vec<_>, OpticsError>>()?)
        })?;
        let out = PyDict::new(py);
        out.set_item("svg", plot::psf_figure(&self.system, &psfs).to_svg())?;
        let (values, fields, energy) = (PyList::empty(py), PyList::empty(py), PyList::empty(py));
        let pitch_um = psfs.first().map_or([0.0; 2], |psf| psf.pitch_um);
        for psf in psfs {
            fields.append((psf.field[0], psf.field[1]))?;
            energy.append(psf.energy_on_grid)?;
            values.append(image_array(py, psf.values, [psf.side, psf.side])?)?;
        }
        out.set_item("field", fields)?;
        out.set_item("values", values)?;
        out.set_item("energy_on_grid", energy)?;
        out.set_item("pitch_um", (pitch_um[0], pitch_um[1]))?;
        Ok(out)
    }

    /// Polychromatic modulation transfer of every field.
    fn mtf<'py>(
        &self,
        py: Python<'py>,
        pupil: usize,
        highest_per_mm: f64,
        count: usize,
    ) -> PyResult<Bound<'py, PyDict>> {
        if !(8..=512).contains(&pupil) {
            return Err(Failure::argument("pupil", "is out of range", pupil, "8 to 512").into());
        }
        if !(1..=100_000).contains(&count) {
            return Err(Failure::argument("count", "is out of range", count, "1 to 100000").into());
        }
        if !(highest_per_mm.is_finite() && highest_per_mm > 0.0) {
            let expected = "a number above 0";
            return Err(
                Failure::argument("highest_per_mm", "is out of range", highest_per_mm, expected).into()
            );
        }
        let (system, clipping) = (Arc::clone(&self.system), self.clipping);
        let curves = work::run(py, None, move |watch| {
            let one = |field: &retina::optics::Field| {
                watch.check();
                analysis::mtf(&system, field.at, pupil, highest_per_mm, count, clipping)
            };
            Ok(system.fields.iter().map(one).collect::<Result<Vec<_>, OpticsError>>()?)
        })?;
        let out = PyDict::new(py);
        out.set_item("svg", plot::mtf_figure(&self.system, &curves).to_svg())?;
        let rows = |of: fn(&analysis::Mtf) -> &Vec<f64>| {
            PyArray2::from_vec2(py, &curves.iter().map(|curve| of(curve).clone()).collect::<Vec<_>>())
        };
        let fields: Vec<Vec<f64>> = curves.iter().map(|curve| curve.field.to_vec()).collect();
        out.set_item("field", PyArray2::from_vec2(py, &fields)?)?;
        let frequency = curves.first().map_or_else(Vec::new, |curve| curve.frequency_per_mm.clone());
        out.set_item("frequency_per_mm", PyArray1::from_vec(py, frequency))?;
        out.set_item("x", rows(|curve| &curve.x)?)?;
        out.set_item("y", rows(|curve| &curve.y)?)?;
        out.set_item("diffraction_limit", rows(|curve| &curve.diffraction_limit)?)?;
        Ok(out)
    }

    /// The layout, as SVG.
    fn layout_svg(&self, py: Python<'_>) -> PyResult<String> {
        let figure = py.detach(|| plot::layout_figure(&self.system.name, &[&self.system]));
        Ok(figure.map_err(Failure::from)?.to_svg())
    }
}
