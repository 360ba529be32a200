//! A user's own catalogue: one star a row.

use std::collections::HashMap;
use std::ops::RangeInclusive;
use std::path::Path;

use retina_files::{InputError, Table, nearest};

use super::{Star, StarId};

/// Epoch of the places where no column gives it, Julian year: that of Hipparcos.
const DEFAULT_EPOCH_JYEAR: f64 = 1991.25;
const REQUIRED: [&str; 8] =
    ["id", "ra_deg", "dec_deg", "pm_ra_mas_yr", "pm_dec_mas_yr", "parallax_mas", "v_mag", "b_v"];
const EPOCH: &str = "epoch_jyear";

pub(super) fn parse(path: &Path, text: &str) -> Result<Vec<Star>, InputError> {
    let table = Table::parse(path, text)?;
    let known = || REQUIRED.into_iter().chain([EPOCH]);
    if let Some(column) = table.columns().iter().find(|column| !known().any(|name| name == column.as_str())) {
        let error = InputError::new(path, format!("column `{column}` is not one of a star catalogue's"))
            .expected(known().collect::<Vec<_>>().join(", "));
        return Err(match nearest(column, known()) {
            Some(near) => error.help(format!("is `{near}` meant?")),
            None => error.help("remove the column"),
        });
    }
    table.require(&REQUIRED)?;
    if table.is_empty() {
        return Err(InputError::new(path, "holds no stars").expected("one row a star below the header"));
    }
    let mut first_lines = HashMap::new();
    let mut stars = Vec::with_capacity(table.len());
    for row in 0..table.len() {
        let id = table.text(row, "id");
        if id.is_empty() {
            return Err(InputError::new(path, "the cell is empty")
                .cell(table.line(row), "id")
                .expected("a name of the star"));
        }
        if let Some(first) = first_lines.insert(id.to_owned(), table.line(row)) {
            return Err(InputError::new(path, "the star is there twice")
                .cell(table.line(row), "id")
                .found(format!("`{id}`, as on line {first}"))
                .expected("each id once"));
        }
        stars.push(star(&table, row, id)?);
    }
    Ok(stars)
}

fn star(table: &Table, row: usize, id: &str) -> Result<Star, InputError> {
    let ra_deg = within(table, row, "ra_deg", -180.0..=360.0)?;
    let dec_deg = within(table, row, "dec_deg", -90.0..=90.0)?;
    let epoch_jyear =
        if table.has(EPOCH) { within(table, row, EPOCH, 1500.0..=2500.0)? } else { DEFAULT_EPOCH_JYEAR };
    let motion = [
        table.number(row, "pm_ra_mas_yr")?,
        table.number(row, "pm_dec_mas_yr")?,
        table.number(row, "parallax_mas")?,
    ];
    let id = StarId::Named(id.to_owned());
    Ok(Star {
        v_magnitude: table.number(row, "v_mag")?,
        b_v: table.number_or_empty(row, "b_v")?,
        ..Star::new(id, epoch_jyear, [ra_deg.to_radians(), dec_deg.to_radians()], motion)
    })
}

fn within(table: &Table, row: usize, column: &str, range: RangeInclusive<f64>) -> Result<f64, InputError> {
    let value = table.number(row, column)?;
    if range.contains(&value) {
        return Ok(value);
    }
    Err(InputError::new(table.file(), "the number is outside its range")
        .cell(table.line(row), column)
        .found(value.to_string())
        .expected(format!("{} to {}", range.start(), range.end())))
}
