//! Tables as data: what they are compared with, repeated rows, covariates.

use std::collections::hash_map::{DefaultHasher, Entry};
use std::collections::{HashMap, HashSet};
use std::hash::{Hash, Hasher as _};
use std::path::Path;

use retina_files::InputError;
use retina_formats::{
    Calibration, ExtraColumn, Measurements, RadiometricCalibration, SourceFile, stated_by_most,
};
use retina_geometry::{LensModel, Setup};

use super::{Covariate, Dataset, phase, points, power};

/// What is always fitted besides effects.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Baseline {
    /// Points: shift, linear terms and radial k1. Power: one gain. Phase: one magnitude of a Lambert sphere.
    Physical,
    /// Points: a polynomial of this degree on lines of sight.
    Polynomial(u32),
    /// Points under a calibration held fixed: shift, rotation and scale.
    Similarity,
    /// Points: focal lengths, principal point, coefficients and the camera's rotation, of a lens model.
    Lens(LensModel),
}

impl Baseline {
    /// From `physical`, `polynomial:N` or a lens model's name.
    ///
    /// # Errors
    /// Anything else, or a degree outside 1 to 7.
    pub fn parse(text: &str) -> Result<Self, InputError> {
        if text == "physical" {
            return Ok(Self::Physical);
        }
        if let Some(model) = LensModel::of_name(text) {
            return Ok(Self::Lens(model));
        }
        let degree = text.strip_prefix("polynomial:").and_then(|n| n.parse().ok());
        match degree {
            Some(degree @ 1..=7) => Ok(Self::Polynomial(degree)),
            _ => Err(InputError::new("--baseline", "is no baseline").found(format!("`{text}`")).expected(
                format!(
                    "`physical`, `polynomial:N` with N from 1 to 7, or a lens model: {}",
                    LensModel::ALL.map(LensModel::name).join(", ")
                ),
            )),
        }
    }
}

/// Measurements, and what they are compared with.
pub struct Source<'a> {
    /// The tables, read from files or made in memory.
    pub tables: &'a Measurements,
    /// The facility.
    pub setup: &'a Setup,
    /// A model held fixed, of points.
    pub calibration: Option<&'a Calibration>,
    /// A response held fixed, of power readings.
    pub response: Option<&'a RadiometricCalibration>,
    /// What is fitted without one.
    pub baseline: Baseline,
}

/// Fewest rows that anything can be said of.
const FEWEST_ROWS: usize = 12;

impl Dataset {
    /// Makes the tables ready to be explained.
    ///
    /// # Errors
    /// The tables were not measured with the setup, hold rows twice, or hold too few.
    pub fn new(source: &Source<'_>) -> Result<Self, InputError> {
        source.tables.check_setup(source.setup)?;
        let mut data = match source.tables {
            Measurements::Points(table) => points::read(source, table)?,
            Measurements::Power(table) => power::read(source, table)?,
            Measurements::Phase(table) => phase::read(source, table)?,
        };
        let files = source.tables.files();
        if data.len() < FEWEST_ROWS {
            return Err(InputError::new(first_file(files), "has too few rows to be explained")
                .found(format!("{} usable rows", data.len()))
                .expected(format!("at least {FEWEST_ROWS}")));
        }
        data.in_part = files.iter().any(|file| file.note.is_some());
        data.notes.extend(files.iter().filter_map(|file| file.note.clone()));
        Ok(data)
    }
}

/// The file that errors about the whole name.
pub(super) fn first_file(files: &[SourceFile]) -> &Path {
    files.first().map_or(Path::new("data"), |file| &file.path)
}

/// Rows that are the same as an earlier one in every cell, with that one. `cells` gives a row's cells as bits.
pub(super) fn repeated(rows: usize, cells: impl Fn(usize) -> Vec<u64>) -> Vec<(usize, usize)> {
    let mut seen: HashMap<u64, usize> = HashMap::new();
    let mut out = Vec::new();
    for row in 0..rows {
        let own = cells(row);
        let mut hasher = DefaultHasher::new();
        own.hash(&mut hasher);
        match seen.entry(hasher.finish()) {
            Entry::Vacant(entry) => {
                entry.insert(row);
            }
            Entry::Occupied(entry) => {
                let before = *entry.get();
                if cells(before) == own {
                    out.push((row, before));
                }
            }
        }
    }
    out
}

/// Bits of a text or of a number that may not be there.
pub(super) fn bits_of(value: impl Hash) -> u64 {
    let mut hasher = DefaultHasher::new();
    value.hash(&mut hasher);
    hasher.finish()
}

/// Numbers that may not be there, as bits.
pub(super) fn bits<const N: usize>(values: [Option<f64>; N]) -> [u64; N] {
    values.map(|value| value.map_or(u64::MAX, f64::to_bits))
}

/// A column that the schema names: its name and its value in a row of the table.
pub(super) type Named<'a> = (&'static str, &'a dyn Fn(usize) -> Option<f64>);

/// Numeric columns: their names, and their values in some rows of the table, NaN where a cell is empty.
fn numeric<'a>(
    rows: &'a [usize],
    named: &'a [Named<'a>],
    extra: &'a [ExtraColumn],
) -> impl Iterator<Item = (&'a str, Vec<f64>)> {
    let of_schema = named
        .iter()
        .map(|(name, value)| (*name, rows.iter().map(|&row| value(row).unwrap_or(f64::NAN)).collect()));
    let further = extra
        .iter()
        .map(|column| (column.name.as_str(), rows.iter().map(|&row| column.values[row]).collect()));
    of_schema.chain(further)
}

/// Share of the rows up to which the rows are left out where a column is empty; beyond it the column is.
const FEW_EMPTY: f64 = 0.05;

/// Takes rows out of the groups where they have no value of a column that nearly all others have. Notes tell them.
pub(super) fn leave_out_lacking<'g>(
    groups: impl Iterator<Item = &'g mut Vec<usize>>,
    named: &[Named<'_>],
    extra: &[ExtraColumn],
    notes: &mut Vec<String>,
) {
    let mut groups: Vec<&mut Vec<usize>> = groups.collect();
    let rows: Vec<usize> = groups.iter().flat_map(|rows| rows.iter().copied()).collect();
    let mut lacking = HashSet::new();
    for (name, values) in numeric(&rows, named, extra) {
        let empty: Vec<usize> = (0..rows.len()).filter(|&k| values[k].is_nan()).map(|k| rows[k]).collect();
        if !empty.is_empty() && empty.len() as f64 <= FEW_EMPTY * rows.len() as f64 {
            notes.push(format!("rows left out, since the column `{name}` is empty there: {}", empty.len()));
            lacking.extend(empty);
        }
    }
    groups.iter_mut().for_each(|rows| rows.retain(|row| !lacking.contains(row)));
}

/// Adds covariates that are made of a table's own.
///
/// # Errors
/// The table has a column of such a name.
pub(super) fn add_made(
    file: &Path,
    all: &mut Vec<Covariate>,
    made: Vec<Covariate>,
) -> Result<(), InputError> {
    let of_formulas = ["L", "F"];
    let taken = |name: &str| of_formulas.contains(&name) || made.iter().any(|own| own.name == name);
    if let Some(covariate) = all.iter().find(|covariate| taken(&covariate.name)) {
        return Err(InputError::new(file, "has a column with the name of a quantity that is made of others")
            .at(format!("column `{}`", covariate.name))
            .expected("another name: formulas and figures read this one")
            .help("rename the column"));
    }
    all.extend(made);
    Ok(())
}

/// Numeric columns as covariates: those that the schema names, then further ones. `rows` are rows of the table in the
/// data's order. A column with an empty cell is left out with a note.
pub(super) fn covariates(
    files: &[SourceFile],
    rows: &[usize],
    named: &[Named<'_>],
    extra: &[ExtraColumn],
    notes: &mut Vec<String>,
) -> Result<Vec<Covariate>, InputError> {
    let mut out = Vec::new();
    for (name, values) in numeric(rows, named, extra) {
        let empty = values.iter().filter(|value| value.is_nan()).count();
        if empty == 0 {
            out.push(Covariate { name: name.to_owned(), values });
        } else if empty < rows.len() {
            notes.push(format!("column `{name}` is empty in {empty} rows and is not used"));
        }
    }
    check_units(first_file(files), &out)?;
    Ok(out)
}

/// Standard deviations that rows state. Where only some do, a note says what becomes of the others.
pub(super) fn stated(
    column: &str,
    values: impl Iterator<Item = Option<f64>>,
    notes: &mut Vec<String>,
) -> Option<Vec<f64>> {
    let (stated, note) = stated_by_most(column, values);
    notes.extend(note);
    stated
}

/// Magnitudes that no such quantity has in its unit.
fn check_units(file: &Path, covariates: &[Covariate]) -> Result<(), InputError> {
    for covariate in covariates {
        let (low, high) = covariate.range();
        let wrong = |problem: &str, help: &str| {
            Err(InputError::new(file, problem.to_owned())
                .at(format!("column `{}`", covariate.name))
                .found(format!("values from {low} to {high}"))
                .help(help))
        };
        match covariate.name.as_str() {
            "temperature_c" if !(-273.15..=150.0).contains(&low) || high > 1000.0 => {
                return wrong("is no temperature of a laboratory in Celsius", "kelvin? subtract 273.15");
            }
            "time_s" if covariate.varies() && (high - low).abs() < 1e-2 => {
                return wrong("is no time of a campaign in seconds", "days? multiply by 86400");
            }
            "exposure_s" if low > 3600.0 || low <= 0.0 || high > 1e6 => {
                return wrong("is no exposure time in seconds", "milliseconds or microseconds? divide");
            }
            "square_px" if high > 1e4 => {
                return wrong("is no side of a square in pixels", "its area? give the side");
            }
            "row_load" if !(low >= 0.0 && high <= 1.0) => {
                return wrong("is no fraction", "give the lit fraction of the rows, 0 to 1, not per cent");
            }
            "airmass" if low < 0.99 => {
                return wrong(
                    "is no airmass",
                    "an airmass is at least 1; is this an elevation or a zenith angle?",
                );
            }
            _ => {}
        }
    }
    Ok(())
}
