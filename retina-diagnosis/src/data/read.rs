//! Tables from files: which one it is, its rows in groups, its covariates.

use std::collections::HashMap;
use std::collections::hash_map::{DefaultHasher, Entry};
use std::hash::{Hash as _, Hasher as _};
use std::path::PathBuf;

use retina_files::{InputError, Table};
use retina_geometry::{Calibration, Setup};
use retina_response::RadiometricCalibration;

use super::{Covariate, Dataset, large, phase, points, power};

/// What is always fitted besides effects.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Baseline {
    /// Points: shift, linear terms and radial k1. Power: one gain. Phase: one magnitude of a Lambert sphere.
    Physical,
    /// Points: a polynomial of this degree on lines of sight.
    Polynomial(u32),
    /// Points under a calibration held fixed: shift, rotation and scale.
    Similarity,
}

impl Baseline {
    /// From `physical` or `polynomial:N`.
    ///
    /// # Errors
    /// Anything else, or a degree outside 1 to 7.
    pub fn parse(text: &str) -> Result<Self, InputError> {
        if text == "physical" {
            return Ok(Self::Physical);
        }
        let degree = text.strip_prefix("polynomial:").and_then(|n| n.parse().ok());
        match degree {
            Some(degree @ 1..=7) => Ok(Self::Polynomial(degree)),
            _ => Err(InputError::new("--baseline", "is no baseline")
                .found(format!("`{text}`"))
                .expected("`physical` or `polynomial:N` with N from 1 to 7")),
        }
    }
}

/// Where data come from and what they are compared with.
pub struct Source<'a> {
    /// The tables, all of one kind.
    pub files: &'a [PathBuf],
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
    /// Reads tables of one kind together.
    ///
    /// # Errors
    /// The columns are of no table, or of different ones; a cell does not fit; too few rows.
    pub fn read(source: &Source<'_>) -> Result<Self, InputError> {
        let parts: Vec<large::Part> =
            source.files.iter().map(|path| large::read(path)).collect::<Result<_, _>>()?;
        let in_part: Vec<String> = parts.iter().filter_map(|part| part.note.clone()).collect();
        let tables: Vec<Table> = parts.into_iter().map(|part| part.table).collect();
        let mut data = Self::of_tables(source, &tables)?;
        data.in_part = !in_part.is_empty();
        data.notes.extend(in_part);
        Ok(data)
    }

    /// The same from tables at hand.
    pub(crate) fn of_tables(source: &Source<'_>, tables: &[Table]) -> Result<Self, InputError> {
        let Some(first) = tables.first() else {
            return Err(InputError::new("--data", "names no table").expected("at least one file"));
        };
        let kind = Kind::of(first)?;
        for table in tables {
            if Kind::of(table)? != kind {
                return Err(InputError::new(table.file(), "is another kind of table than the first")
                    .found(format!("columns {}", table.columns().join(", ")))
                    .expected(format!("those of {}", first.file().display()))
                    .help("give tables of one kind in one command"));
            }
        }
        let repeated = repeated(tables);
        if let (Kind::Points, Some((place, before))) = (kind, repeated.first()) {
            let (table, earlier) = (&tables[place.table], &tables[before.table]);
            return Err(InputError::new(table.file(), "the row repeats another in every cell")
                .line(table.line(place.row))
                .found(format!("{} such rows in all", repeated.len()))
                .expected("each point of an exposure once")
                .help(format!(
                    "delete the copies; the first is line {} of {}",
                    earlier.line(before.row),
                    earlier.file().display()
                )));
        }
        let mut data = match kind {
            Kind::Points => points::read(source, tables)?,
            Kind::Power => power::read(source, tables)?,
            Kind::Phase => phase::read(source, tables)?,
        };
        if data.len() < FEWEST_ROWS {
            return Err(InputError::new(first.file(), "has too few rows to be explained")
                .found(format!("{} usable rows", data.len()))
                .expected(format!("at least {FEWEST_ROWS}")));
        }
        if !repeated.is_empty() {
            // A meter that rounds may well show the same twice.
            data.notes.push(format!("{} rows repeat others in every cell", repeated.len()));
        }
        Ok(data)
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Points,
    Power,
    Phase,
}

impl Kind {
    fn of(table: &Table) -> Result<Self, InputError> {
        if table.has("screen_x_px") || table.has("camera_x_px") {
            Ok(Self::Points)
        } else if table.has("irradiance_w_m2") {
            Ok(Self::Power)
        } else if table.has("phase_deg") {
            Ok(Self::Phase)
        } else if table.has("measured") {
            Err(InputError::new(
                table.file(),
                "is a table of frames, whose images have to be predicted first",
            )
            .expected("points, power or phase")
            .help("give tables of frames by themselves"))
        } else {
            Err(InputError::new(table.file(), "has the columns of no table that is known")
                .found(format!("columns {}", table.columns().join(", ")))
                .expected(
                    "camera_x_px (points), irradiance_w_m2 (power), phase_deg (phase) or measured (frames)",
                ))
        }
    }
}

/// A row of a file: which table and which row in it.
#[derive(Clone, Copy)]
pub(super) struct Place {
    pub(super) table: usize,
    pub(super) row: usize,
}

/// Rows that are the same as an earlier one in every cell, with that one.
fn repeated(tables: &[Table]) -> Vec<(Place, Place)> {
    let mut seen: HashMap<u64, Place> = HashMap::new();
    let mut out = Vec::new();
    let cells = |place: Place| {
        let table = &tables[place.table];
        table.columns().iter().map(move |column| table.text(place.row, column))
    };
    for (t, table) in tables.iter().enumerate() {
        for row in 0..table.len() {
            let place = Place { table: t, row };
            let mut hasher = DefaultHasher::new();
            cells(place).for_each(|cell| cell.hash(&mut hasher));
            match seen.entry(hasher.finish()) {
                Entry::Vacant(entry) => {
                    entry.insert(place);
                }
                Entry::Occupied(entry) => {
                    let before = *entry.get();
                    if cells(before).eq(cells(place)) && tables[before.table].columns() == table.columns() {
                        out.push((place, before));
                    }
                }
            }
        }
    }
    out
}

/// All numeric columns beside `not`, of rows in the data's order; a column with an empty cell is left out with a note.
pub(super) fn covariates(
    tables: &[Table],
    places: &[Place],
    not: &[&str],
    text: &[&str],
    notes: &mut Vec<String>,
) -> Result<Vec<Covariate>, InputError> {
    let mut names: Vec<&str> = Vec::new();
    for table in tables {
        for name in table.columns() {
            if !not.contains(&name.as_str())
                && !text.contains(&name.as_str())
                && !names.contains(&name.as_str())
            {
                names.push(name);
            }
        }
    }
    let mut out = Vec::new();
    for name in names {
        let mut values = Vec::with_capacity(places.len());
        let mut empty = 0;
        for place in places {
            match tables[place.table].number_or_empty(place.row, name)? {
                Some(value) => values.push(value),
                None => empty += 1,
            }
        }
        if empty == 0 {
            out.push(Covariate { name: name.to_owned(), values });
        } else if empty < places.len() {
            notes.push(format!("column `{name}` is empty in {empty} rows and is not used"));
        }
    }
    check_units(tables, &out)?;
    Ok(out)
}

/// Magnitudes that no such quantity has in its unit.
fn check_units(tables: &[Table], covariates: &[Covariate]) -> Result<(), InputError> {
    for covariate in covariates {
        let (low, high) = covariate.range();
        let wrong = |problem: &str, help: &str| {
            Err(InputError::new(tables[0].file(), problem.to_owned())
                .at(format!("column `{}`", covariate.name))
                .found(format!("values from {low} to {high}"))
                .help(help))
        };
        match covariate.name.as_str() {
            "temperature_c" if low > 150.0 || low < -273.15 || high > 1000.0 => {
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

/// Number of a cell with a range.
pub(super) fn number_in(
    table: &Table,
    row: usize,
    column: &str,
    range: std::ops::RangeInclusive<f64>,
    expected: &str,
) -> Result<f64, InputError> {
    let value = table.number(row, column)?;
    if range.contains(&value) {
        return Ok(value);
    }
    Err(InputError::new(table.file(), "the value is outside its range")
        .cell(table.line(row), column)
        .found(value)
        .expected(expected))
}

/// Channel of a cell as an index into r, g, b, w; white where the cell is empty.
pub(super) fn channel_of(table: &Table, row: usize) -> Result<u8, InputError> {
    match table.text(row, "channel") {
        "r" => Ok(0),
        "g" => Ok(1),
        "b" => Ok(2),
        "w" | "" => Ok(3),
        other => Err(InputError::new(table.file(), "is no channel")
            .cell(table.line(row), "channel")
            .found(format!("`{other}`"))
            .expected("r, g, b or w")),
    }
}
