//! The virtual bench, and campaigns on it.

use std::path::PathBuf;
use std::sync::Arc;

use numpy::{PyReadonlyArray2, PyReadonlyArray3};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use retina::bench::{Bench, Exposure, ExposurePose, OpticsDetail, ScreenImage};
use retina::campaign::{
    Effect, Facility, PointsOptions, PowerOptions, TemperatureProfile, known_effects, simulate_points,
    simulate_power, well_exposed_s,
};
use retina::formats::{Channel, Measurements, TableKind};
use retina::glam::DVec2;

use crate::convert::image_array;
use crate::errors::Failure;
use crate::setup::PySetup;
use crate::tables::{TableOf, columns_of};
use crate::work;

/// The virtual bench: screen image in, camera image out.
#[pyclass(name = "Bench", module = "retina._native", frozen)]
pub(crate) struct PyBench {
    bench: Arc<Bench>,
}

fn effects_of(texts: &[String]) -> Result<Vec<Effect>, Failure> {
    Ok(texts.iter().map(|text| Effect::parse(text)).collect::<Result<_, _>>()?)
}

fn detail_of(nodes: Option<(usize, usize)>, lines: Option<usize>) -> PyResult<OpticsDetail> {
    let default = OpticsDetail::default();
    let nodes = nodes.map_or(default.nodes, |(x, y)| [x, y]);
    if nodes.iter().any(|count| !(3..=99).contains(count)) {
        return Err(Failure::argument(
            "nodes",
            "is out of range",
            format!("{nodes:?}"),
            "3 to 99 along x and y",
        )
        .into());
    }
    let lines = lines.unwrap_or(default.lines);
    if ![1, 3, 5].contains(&lines) {
        return Err(Failure::argument("lines", "is out of range", lines, "1, 3 or 5").into());
    }
    Ok(OpticsDetail { nodes, lines, ..default })
}

#[pymethods]
impl PyBench {
    /// Traces the setup's optics and makes its screen and sensor, with effects such as `screen_tilt=0.1deg`.
    #[new]
    #[pyo3(signature = (setup, effects, seed, nodes, lines))]
    fn new(
        py: Python<'_>,
        setup: PyRef<'_, PySetup>,
        effects: Vec<String>,
        seed: u64,
        nodes: Option<(usize, usize)>,
        lines: Option<usize>,
    ) -> PyResult<Self> {
        let detail = detail_of(nodes, lines)?;
        let setup = (*setup.setup).clone();
        let bench = work::run(py, None, move |_| {
            let facility = Facility::new(&setup, &effects_of(&effects)?, TableKind::Frames, f64::MAX, seed)?;
            Ok(facility.bench(detail)?)
        })?;
        Ok(Self { bench: Arc::new(bench) })
    }

    /// The camera image of a screen image: digital numbers, and the exposure time, s.
    #[pyo3(signature = (screen, exposure_s, temperature_c, frame, shift_px, roll_rad))]
    fn expose<'py>(
        &self,
        py: Python<'py>,
        screen: Bound<'py, PyAny>,
        exposure_s: Option<f64>,
        temperature_c: f64,
        frame: u64,
        shift_px: (f64, f64),
        roll_rad: f64,
    ) -> PyResult<(Py<numpy::PyArray2<u16>>, f64)> {
        if let Some(value) = exposure_s.filter(|value| !(value.is_finite() && *value > 0.0)) {
            return Err(Failure::argument("exposure_s", "is out of range", value, "seconds above 0").into());
        }
        let screen = screen_image(&screen)?;
        let bench = Arc::clone(&self.bench);
        let (image, exposure_s) = work::run(py, None, move |_| {
            let exposure_s = match exposure_s {
                Some(exposure_s) => exposure_s,
                None => well_exposed_s(&bench, &screen)?.ok_or_else(|| {
                    Failure::argument(
                        "screen",
                        "is dark, so that no exposure time follows from it",
                        "no light",
                        "exposure_s",
                    )
                })?,
            };
            let pose = ExposurePose {
                shift_px: DVec2::new(shift_px.0, shift_px.1),
                roll_rad,
                ..ExposurePose::default()
            };
            let exposure = Exposure { exposure_s, temperature_c, pose, frame };
            Ok((bench.expose(&screen, &exposure)?, exposure_s))
        })?;
        let size = [image.width_px, image.height_px];
        Ok((image_array(py, image.dn, size)?, exposure_s))
    }

    /// Where a screen position lands on the sensor, px; `None` off the field.
    fn land_px(&self, x_px: f64, y_px: f64, channel: &str) -> PyResult<Option<(f64, f64)>> {
        let colour = channel_of(channel)?.lit();
        if colour.len() > 1 {
            return Err(Failure::argument("channel", "is no colour", channel, "\"r\", \"g\" or \"b\"").into());
        }
        let landed = self.bench.land_px([x_px, y_px], colour.start, &Exposure::new(1.0, 0));
        Ok(landed.map(|[x, y]| (x, y)))
    }

    /// Largest digital number, and electrons of a full well.
    fn sensor(&self) -> (u16, f64) {
        (self.bench.sensor().largest_dn(), self.bench.sensor().full_well_e())
    }
}

/// Counts of shape (height, width), equal in the channels, or (height, width, 3).
fn screen_image(array: &Bound<'_, PyAny>) -> PyResult<ScreenImage> {
    use numpy::PyUntypedArrayMethods as _;
    let size = |shape: &[usize]| {
        let large = || PyTypeError::new_err("the screen image has more than 2^32 rows or columns");
        Ok::<_, PyErr>((
            u32::try_from(shape[1]).map_err(|_| large())?,
            u32::try_from(shape[0]).map_err(|_| large())?,
        ))
    };
    if let Ok(grey) = array.extract::<PyReadonlyArray2<'_, u8>>() {
        let (width_px, height_px) = size(grey.shape())?;
        let counts: Vec<u8> = grey.as_array().iter().copied().collect();
        return Ok(ScreenImage::grey(width_px, height_px, &counts));
    }
    if let Ok(colour) = array.extract::<PyReadonlyArray3<'_, u8>>()
        && colour.shape()[2] == 3
    {
        let (width_px, height_px) = size(colour.shape())?;
        let values: Vec<u8> = colour.as_array().iter().copied().collect();
        let counts = values.chunks_exact(3).map(|rgb| [rgb[0], rgb[1], rgb[2]]).collect();
        return Ok(ScreenImage { width_px, height_px, counts });
    }
    Err(PyTypeError::new_err(
        "a screen image is an array of uint8, of shape (height, width) or (height, width, 3)",
    ))
}

fn channel_of(name: &str) -> PyResult<Channel> {
    Channel::from_letter(name).ok_or_else(|| {
        Failure::argument("channel", "is not known", format!("\"{name}\""), "\"r\", \"g\", \"b\" or \"w\"")
            .into()
    })
}

fn profile_of(name: &str) -> PyResult<TemperatureProfile> {
    Ok(match name {
        "constant" => TemperatureProfile::Constant,
        "warm-up" => TemperatureProfile::WarmUp,
        "cycle" => TemperatureProfile::Cycle,
        other => {
            let expected = "\"constant\", \"warm-up\" or \"cycle\"";
            return Err(
                Failure::argument("temperature", "is not known", format!("\"{other}\""), expected).into()
            );
        }
    })
}

/// Shows patterns of single pixels on the bench and measures their points.
#[pyfunction]
#[pyo3(signature = (setup, seed, effects, exposures, points, interval_s, temperature, exposure_s, channel, counts, nodes, lines, progress))]
pub(crate) fn simulate_points_table<'py>(
    py: Python<'py>,
    setup: PyRef<'py, PySetup>,
    seed: u64,
    effects: Vec<String>,
    exposures: usize,
    points: usize,
    interval_s: f64,
    temperature: &str,
    exposure_s: Option<f64>,
    channel: &str,
    counts: Vec<u8>,
    nodes: Option<(usize, usize)>,
    lines: Option<usize>,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    for (name, value, most) in [("exposures", exposures, 999), ("points", points, 5000)] {
        if !(1..=most).contains(&value) {
            return Err(Failure::argument(name, "is out of range", value, &format!("1 to {most}")).into());
        }
    }
    for (name, value) in [("interval_s", Some(interval_s)), ("exposure_s", exposure_s)] {
        if let Some(value) = value.filter(|value| !(value.is_finite() && *value > 0.0)) {
            return Err(Failure::argument(name, "is out of range", value, "seconds above 0").into());
        }
    }
    let options = PointsOptions {
        exposures,
        points,
        interval_s,
        temperature: profile_of(temperature)?,
        exposure_s,
        channel: channel_of(channel)?,
        counts,
        detail: detail_of(nodes, lines)?,
        ..PointsOptions::default()
    };
    let setup = (*setup.setup).clone();
    let text = work::run(py, progress.as_ref(), move |watch| {
        let effects = effects_of(&effects)?;
        let facility = Facility::new(&setup, &effects, TableKind::Points, options.length_s(), seed)?;
        let result = simulate_points(&facility, &options, None, |done| watch.report(done, exposures))?;
        Ok(result.table.text(&facility.setup))
    })?;
    columns_of(py, &text)
}

/// Reads a power meter in front of lit squares on the bench.
#[pyfunction]
#[pyo3(signature = (setup, seed, effects, series, counts, squares_px))]
pub(crate) fn simulate_power_table<'py>(
    py: Python<'py>,
    setup: PyRef<'py, PySetup>,
    seed: u64,
    effects: Vec<String>,
    series: usize,
    counts: Vec<u8>,
    squares_px: Option<Vec<u32>>,
) -> PyResult<Bound<'py, PyDict>> {
    if !(1..=1000).contains(&series) {
        return Err(Failure::argument("series", "is out of range", series, "1 to 1000").into());
    }
    let mut options = PowerOptions { series, ..PowerOptions::default() };
    if let Some(squares_px) = squares_px {
        options.squares_px = squares_px;
    }
    if !counts.is_empty() {
        options.counts = counts;
    }
    let setup = (*setup.setup).clone();
    let most = setup.screen.width_px.min(setup.screen.height_px);
    if let Some(found) = options.squares_px.iter().find(|square| **square > most) {
        let expected = format!("at most {most} pixels");
        return Err(
            Failure::argument("squares_px", "has a square larger than the screen", found, &expected).into()
        );
    }
    let text = work::run(py, None, move |_| {
        let facility = Facility::new(&setup, &effects_of(&effects)?, TableKind::Power, 0.0, seed)?;
        Ok(simulate_power(&facility, &options)?.text(&facility.setup))
    })?;
    columns_of(py, &text)
}

/// Writes a table with the setup's name in a comment.
#[pyfunction]
pub(crate) fn write_table(table: TableOf<'_>, path: PathBuf, setup: PyRef<'_, PySetup>) -> PyResult<()> {
    let tables = table.in_memory()?;
    tables.check_setup(&setup.setup).map_err(Failure::from)?;
    let written = match tables {
        Measurements::Points(table) => table.write(&path, &setup.setup),
        Measurements::Power(table) => table.write(&path, &setup.setup),
        Measurements::Phase(_) => {
            let expected = "a table of points or of power readings";
            return Err(Failure::argument(
                "table",
                "is no measurement of a facility",
                "a phase curve",
                expected,
            )
            .into());
        }
    };
    Ok(written.map_err(Failure::from)?)
}

/// What the bench takes as effects: id, table, unit, number of values, meaning.
#[pyfunction]
pub(crate) fn bench_effects() -> Vec<(&'static str, &'static str, &'static str, usize, &'static str)> {
    known_effects()
        .map(|kind| (kind.id.name(), kind.id.table().name(), kind.units[0].0, kind.values, kind.meaning))
        .collect()
}
