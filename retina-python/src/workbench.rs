//! The workbench: what a model leaves unexplained, and which effect explains it.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use retina::diagnosis::{
    AddedEffect, Comparison, Dataset, DiagnoseOptions, Diagnosis, Fit, check_effects, compare, compare_json,
    compare_page, compare_text, diagnose, diagnose_json, diagnose_page, diagnose_text, effects, effects_json,
    figure_svg, fit, fit_json, fit_page, fit_text, predictions_text, signature_svgs, unexplained_shapes,
    write_model,
};
use retina::files::{InputError, nearest};
use retina::formats::{Measurements, TableKind};
use retina::frames::{PICTURES_CAPTION, diagnose_frames};
use retina::investigation::{
    Investigation, Options, investigate as look_for_formulas, investigation_json, investigation_page,
    investigation_text,
};
use retina::report::{Page, Section};
use retina::workbench::{
    GivenEffect, Input, TableMaterial, added_effects, frame_effects, investigate_frames, pictures_of,
};
use serde_json::Value;

use crate::calibrations::PyCalibration;
use crate::convert::document;
use crate::errors::Failure;
use crate::own_effect::{Description, PythonEffect, Raised, taken, unwound};
use crate::setup::PySetup;
use crate::tables::{TableOf, columns_of};
use crate::work::{self, Watch};

/// An effect: an id or a file, or a Python function.
#[derive(FromPyObject)]
pub(crate) enum EffectOf {
    Text(String),
    Function(Description),
}

/// What was compared, diagnosed, fitted or investigated.
enum Found {
    Comparison(Box<Comparison>),
    Diagnosis(Box<Diagnosis>),
    Fit(Box<Fit>),
    Investigation(Box<Investigation>),
}

/// How it is done.
struct Asked {
    diagnose: DiagnoseOptions,
    investigate: Options,
}

/// A result of the workbench with what it is about.
#[pyclass(name = "Findings", module = "retina._native", frozen)]
pub(crate) struct PyFindings {
    found: Found,
    data: Dataset,
    added: Vec<AddedEffect>,
    /// Tables alone; `None` of frames.
    material: Option<TableMaterial>,
    /// Predicted and measured images, of frames.
    pictures: Option<String>,
    raised: Raised,
}

/// Compares (`compare`), diagnoses (`diagnose`), fits (`fit`) or looks for formulas (`investigate`).
#[pyfunction]
#[pyo3(signature = (what, setup, table, calibration, effects, baseline, flips, seed, terms))]
pub(crate) fn investigate(
    py: Python<'_>,
    what: &str,
    setup: PyRef<'_, PySetup>,
    table: TableOf<'_>,
    calibration: Option<PyRef<'_, PyCalibration>>,
    effects: Vec<EffectOf>,
    baseline: String,
    flips: usize,
    seed: u64,
    terms: usize,
) -> PyResult<PyFindings> {
    if !(199..=99_999).contains(&flips) {
        return Err(Failure::argument("flips", "is out of range", flips, "199 to 99999").into());
    }
    if !(1..=8).contains(&terms) {
        return Err(Failure::argument("terms", "is out of range", terms, "1 to 8").into());
    }
    let input = Input {
        setup: (*setup.setup).clone(),
        measured: table.measured()?,
        calibration: calibration.map(|given| given.given.clone()),
        baseline,
    };
    let what = what.to_owned();
    let raised = Raised::default();
    let kept = Arc::clone(&raised);
    let options =
        Asked { diagnose: DiagnoseOptions { flips, seed }, investigate: Options { seed, most_terms: terms } };
    let result = work::run(py, None, move |watch| found(&what, input, effects, &options, watch, kept));
    match taken(&raised) {
        Some(error) => Err(error),
        None => result,
    }
}

fn found(
    what: &str,
    input: Input,
    effects: Vec<EffectOf>,
    options: &Asked,
    watch: &Watch,
    raised: Raised,
) -> Result<PyFindings, Failure> {
    if let Some(mut set) = input.frames()? {
        let given = given_effects(effects, 1, watch, &raised);
        let texts = frame_effects(&given)?;
        let (data, added, found) = match what {
            "diagnose" => {
                let (data, added, found) = diagnose_frames(&mut set, &texts, &options.diagnose)?;
                (data, added, Found::Diagnosis(Box::new(found)))
            }
            "investigate" => {
                let (data, found) =
                    investigate_frames(&mut set, &texts, &options.investigate, &|_, _| watch.check())?;
                let added = found.model.clone();
                (data, added, Found::Investigation(Box::new(found)))
            }
            _ => {
                let (data, added) = set.with_effects(&texts)?;
                check_effects(&data, &added)?;
                let found = of_table(what, &data, &added, options, watch)?;
                (data, added, found)
            }
        };
        let pictures = Some(match &found {
            Found::Investigation(found) => pictures_of(&set, found),
            _ => set.pictures(),
        });
        return Ok(PyFindings { found, data, added, material: None, pictures, raised });
    }
    let material = input.table()?;
    let components = material.tables.kind().components();
    let added = added_effects(&given_effects(effects, components, watch, &raised), &material.data)?;
    let found = of_table(what, &material.data, &added, options, watch)?;
    let data = material.data.clone();
    Ok(PyFindings { found, data, added, material: Some(material), pictures: None, raised })
}

fn given_effects(
    effects: Vec<EffectOf>,
    components: usize,
    watch: &Watch,
    raised: &Raised,
) -> Vec<GivenEffect> {
    let of = |effect| match effect {
        EffectOf::Text(text) => GivenEffect::Text(text),
        EffectOf::Function(description) => {
            GivenEffect::Own(Arc::new(PythonEffect::new(description, components, watch, raised)))
        }
    };
    effects.into_iter().map(of).collect()
}

fn of_table(
    what: &str,
    data: &Dataset,
    added: &[AddedEffect],
    options: &Asked,
    watch: &Watch,
) -> Result<Found, Failure> {
    Ok(match what {
        "compare" => {
            let result = compare(data, added);
            if !(result.rms.is_finite() && result.rms_unweighted.is_finite()) {
                return Err(InputError::new(Path::new("<table>"), "the errors have no finite size")
                    .found(format!("{} rms, {} unweighted", result.rms, result.rms_unweighted))
                    .help("look for measurements, or their uncertainties, that are larger than any can be")
                    .into());
            }
            Found::Comparison(Box::new(result))
        }
        "diagnose" => Found::Diagnosis(Box::new(diagnose(data, added, &options.diagnose))),
        "investigate" => {
            let found = look_for_formulas(data, added, &options.investigate, &|_, _| watch.check())?;
            Found::Investigation(Box::new(found))
        }
        _ => Found::Fit(Box::new(fit(data, added)?)),
    })
}

#[pymethods]
impl PyFindings {
    /// What the command's `--json` says.
    fn document(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        let told: Value = match &self.found {
            Found::Comparison(result) => compare_json(&self.data, result),
            Found::Diagnosis(result) => diagnose_json(&self.data, result),
            Found::Fit(result) => fit_json(&self.data, result),
            Found::Investigation(result) => investigation_json(&self.data, result, None),
        };
        document(py, &told)
    }

    /// What the command prints.
    fn text(&self) -> Vec<String> {
        match &self.found {
            Found::Comparison(result) => compare_text(&self.data, result),
            Found::Diagnosis(result) => diagnose_text(&self.data, result),
            Found::Fit(result) => fit_text(&self.data, result),
            Found::Investigation(result) => investigation_text(&self.data, result),
        }
    }

    /// The model's errors over the field and against the columns, as SVG; of frames, the images.
    fn svg(&self, py: Python<'_>) -> PyResult<String> {
        self.drawn(py, || Ok(self.pictures.clone().unwrap_or_else(|| figure_svg(&self.data, &self.added))))
    }

    /// The command's report page.
    fn html(&self, py: Python<'_>) -> PyResult<String> {
        self.drawn(py, || self.page().map(|page| page.html()))
    }

    /// Writes the command's report page.
    fn write_report(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        self.drawn(py, || self.page()?.write(&path))
    }

    /// Baseline, effect and error of each row of a fit, as columns; of points beside where they were seen.
    fn predictions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let Found::Fit(result) = &self.found else {
            return Err(Failure::new("only a fit has predictions").into());
        };
        let text = py.detach(|| predictions_text(Path::new("<predictions>"), &self.data, result));
        let columns = columns_of(py, &text.map_err(Failure::from)?)?;
        if let Some(Measurements::Points(table)) = self.material.as_ref().map(|material| &material.tables) {
            let column = |axis: usize| table.rows.iter().map(|row| row.camera_px[axis]).collect::<Vec<f64>>();
            columns.set_item("camera_x_px", PyArray1::from_vec(py, column(0)))?;
            columns.set_item("camera_y_px", PyArray1::from_vec(py, column(1)))?;
        }
        Ok(columns)
    }

    /// Writes the model of a fit as a calibration, and gives how far its polynomials are from the model, arcsec rms.
    fn write_model(&self, py: Python<'_>, path: PathBuf) -> PyResult<f64> {
        let (Found::Fit(result), Some(material)) = (&self.found, &self.material) else {
            return Err(Failure::new("only a fit of points is a calibration").into());
        };
        let Measurements::Points(table) = &material.tables else {
            let found = format!("a table of {}", material.tables.kind().name());
            return Err(Failure::argument(
                "table",
                "gives no geometric calibration",
                found,
                "a table of points",
            )
            .into());
        };
        let held = material.calibration.as_ref();
        self.drawn(py, || write_model(&path, &self.data, result, &self.added, &material.setup, table, held))
    }
}

impl PyFindings {
    fn page(&self) -> Result<Page, InputError> {
        let page = match &self.found {
            Found::Comparison(result) => compare_page(&self.data, &self.added, result),
            Found::Diagnosis(result) => {
                // What frames' pixels share was found with the accepted effects in the data.
                let left = match self.pictures {
                    Some(_) => Diagnosis { accepted: Vec::new(), ..(**result).clone() },
                    None => (**result).clone(),
                };
                let shapes = unexplained_shapes(&self.data, &self.added, &left)?;
                diagnose_page(&self.data, &self.added, result, &shapes)
            }
            Found::Fit(result) => fit_page(&self.data, &self.added, result),
            Found::Investigation(result) => investigation_page(&self.data, result),
        };
        Ok(match &self.pictures {
            Some(svg) => page.after_card(Section::new("Images").figure(svg, PICTURES_CAPTION)),
            None => page,
        })
    }

    /// Work that may call an effect's function.
    fn drawn<T: Send>(
        &self,
        py: Python<'_>,
        draw: impl FnOnce() -> Result<T, InputError> + Send,
    ) -> PyResult<T> {
        // A function's exception unwinds; nothing is left half-changed, as `draw` only reads.
        let result = py.detach(|| std::panic::catch_unwind(std::panic::AssertUnwindSafe(draw)));
        match (taken(&self.raised), result) {
            (Some(error), _) => Err(error),
            (None, Ok(result)) => Ok(result.map_err(Failure::from)?),
            (None, Err(panic)) if work::is_abandoned(&panic) => Err(unwound().into()),
            (None, Err(panic)) => std::panic::resume_unwind(panic),
        }
    }
}

/// The catalogue, as `retina effects --json` lists it.
#[pyfunction]
#[pyo3(signature = (table))]
pub(crate) fn effect_list(py: Python<'_>, table: Option<&str>) -> PyResult<Py<PyAny>> {
    let kinds = [TableKind::Points, TableKind::Power, TableKind::Phase, TableKind::Frames];
    let kind = match table {
        None => None,
        Some(name) => Some(kinds.into_iter().find(|kind| kind.name() == name).ok_or_else(|| {
            let expected = kinds.map(TableKind::name).join(", ");
            PyErr::from(Failure::argument("table", "is no kind of table", format!("\"{name}\""), &expected))
        })?),
    };
    document(py, &effects_json(&effects(kind))["effects"])
}

/// The signature of an effect, as SVGs; none where it has no figure.
#[pyfunction]
pub(crate) fn effect_svgs(py: Python<'_>, name: &str) -> PyResult<Vec<String>> {
    let list = effects(None);
    let Some(effect) = list.iter().find(|effect| effect.name() == name) else {
        let near = nearest(name, list.iter().map(|effect| effect.name()));
        let expected = near.map_or("an id that effects() lists".into(), |near| format!("`{near}`?"));
        return Err(Failure::argument(
            "name",
            "is no effect of the catalogue",
            format!("`{name}`"),
            &expected,
        )
        .into());
    };
    Ok(py.detach(|| signature_svgs(effect)).map_err(Failure::from)?.unwrap_or_default())
}
