//! A user's effect from a TOML file: formulas over the table's columns.

use std::path::{Path, PathBuf};

use retina_files::{InputError, Place, Snippet, parse_toml, read_text};
use retina_formats::TableKind;
use serde::Deserialize;
use toml::Spanned;

use crate::catalogue::effects;
use crate::data::{ARCSEC_PER_RAD, Dataset};
use crate::following::{lag_name, read_column};
use crate::formula::{Formula, Read, Unit, parse};
use crate::own::{OwnEffect, OwnParameter, readable_columns};

/// A user's effect.
#[derive(Debug, Clone)]
pub(crate) struct EffectOfFile {
    name: String,
    parameters: Vec<OwnParameter>,
    formulas: Vec<Formula>,
    /// The columns that the formulas read, as they number them.
    columns: Vec<String>,
    /// From the file's unit to the data's.
    scale: f64,
    file: PathBuf,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct EffectFile {
    name: String,
    unit: Spanned<String>,
    #[serde(default)]
    parameters: toml::Table,
    dx: Option<Spanned<String>>,
    dy: Option<Spanned<String>>,
    value: Option<Spanned<String>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ParameterFile {
    start: f64,
    #[serde(default)]
    unit: String,
}

impl EffectOfFile {
    /// Reads a file.
    ///
    /// # Errors
    /// It does not fit: keys, columns, units, formulas; told to the character.
    pub(crate) fn read(path: &Path, data: &Dataset) -> Result<Self, InputError> {
        Self::parse(path, &read_text(path)?, data)
    }

    /// From a file's text; the path names it in errors.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub(crate) fn parse(path: &Path, text: &str, data: &Dataset) -> Result<Self, InputError> {
        let file: EffectFile = parse_toml(path, text)?;
        let pointed = |span: std::ops::Range<usize>, problem: String| {
            let before = &text[..span.start.min(text.len())];
            let mut error = InputError::new(path, problem);
            error.place = Place::LineColumn(
                before.matches('\n').count() + 1,
                before.chars().rev().take_while(|c| *c != '\n').count() + 1,
            );
            error.snippet =
                Some(Snippet { text: text.to_owned(), offset: span.start, length: span.len().max(1) });
            error
        };
        if let Some(known) = effects(Some(data.kind)).iter().find(|effect| effect.name() == file.name) {
            return Err(InputError::new(path, "the catalogue has an effect of this name")
                .at("key `name`")
                .found(format!("`{}`", known.name()))
                .help(format!("give it another name, or use the catalogue's: --effect {}", known.name())));
        }
        let mut parameters = Vec::new();
        for (name, value) in &file.parameters {
            let parameter: ParameterFile = value.clone().try_into().map_err(|error: toml::de::Error| {
                InputError::new(path, error.message().to_owned())
                    .at(format!("key `parameters.{name}`"))
                    .expected("{ start = 1.0, unit = \"arcsec\" }")
            })?;
            if data.covariate(name).is_some() {
                return Err(InputError::new(path, "the parameter has a column's name")
                    .at(format!("key `parameters.{name}`"))
                    .help("give it another name"));
            }
            parameters.push(OwnParameter {
                name: name.clone(),
                start: parameter.start,
                unit: parameter.unit,
            });
        }
        let scale = match (data.kind, file.unit.get_ref().as_str()) {
            (TableKind::Points, "arcsec")
            | (TableKind::Power, "relative")
            | (TableKind::Phase, "mag")
            | (TableKind::Frames, "DN") => 1.0,
            (TableKind::Points, "rad") => ARCSEC_PER_RAD,
            (TableKind::Points, "mrad") => ARCSEC_PER_RAD * 1e-3,
            (TableKind::Points, "arcmin") => 60.0,
            (TableKind::Points, "deg") => 3600.0,
            (TableKind::Power, "percent") => 0.01,
            (kind, other) => {
                let expected =
                    ["arcsec, arcmin, deg, mrad or rad", "relative or percent", "mag", "DN"][kind as usize];
                return Err(pointed(file.unit.span(), format!("is no unit of errors in {}", kind.name()))
                    .found(format!("`{other}`"))
                    .expected(expected));
            }
        };
        let columns = readable_columns(data);
        let names: Vec<&str> = columns.iter().map(String::as_str).collect();
        let parameter_names: Vec<&str> = parameters.iter().map(|p| p.name.as_str()).collect();
        let given = match data.kind {
            TableKind::Points => [("dx", &file.dx), ("dy", &file.dy)].to_vec(),
            _ => vec![("value", &file.value)],
        };
        let column_units: Vec<Option<Unit>> = names.iter().map(|name| Unit::of_column(name)).collect();
        let mut parameter_units = Vec::new();
        for OwnParameter { name, unit, .. } in &parameters {
            let read = Unit::parse(unit).map_err(|problem| {
                InputError::new(path, problem).at(format!("key `parameters.{name}.unit`"))
            })?;
            parameter_units.push(Some(read).filter(|_| !unit.trim().is_empty()));
        }
        let wanted = Unit::parse(file.unit.get_ref()).unwrap_or_default();
        let mut formulas = Vec::new();
        for (key, formula) in given {
            let Some(formula) = formula else {
                return Err(InputError::new(path, format!("key `{key}` is missing"))
                    .expected(format!("a formula, {key} = \"...\""))
                    .help(if data.kind == TableKind::Points {
                        "points need `dx` and `dy`"
                    } else {
                        "this table needs `value`"
                    }));
            };
            let source = formula.get_ref();
            let checked = parse(source, &names, &parameter_names).and_then(|read| {
                read.check_units(&column_units, &parameter_units, &wanted)?;
                Ok(read)
            });
            formulas.push(checked.map_err(|error| {
                // The text begins after one quote, or three.
                let quotes = if text[formula.span()].starts_with("\"\"\"") { 3 } else { 1 };
                let start = formula.span().start + quotes + error.offset;
                let mut out =
                    pointed(start..start + error.length, format!("{} in the formula `{key}`", error.problem));
                out.help = error.help;
                out
            })?);
        }
        let name_of = |read: Read| match read.lag_s {
            None => columns[read.column].clone(),
            Some(lag_s) => lag_name(&columns[read.column], lag_s),
        };
        let mut reads: Vec<String> = formulas.iter().flat_map(Formula::reads).map(name_of).collect();
        reads.sort_unstable();
        reads.dedup();
        for name in &reads {
            read_column(data, name).map_err(|reason| {
                InputError::new(path, format!("a formula cannot read `{name}`: {reason}"))
            })?;
        }
        for formula in &mut formulas {
            formula.renumber(|read| reads.iter().position(|name| *name == name_of(read)).unwrap_or(0));
        }
        Ok(Self { name: file.name, parameters, formulas, columns: reads, scale, file: path.to_path_buf() })
    }
}

impl OwnEffect for EffectOfFile {
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
        self.value_and_slopes(columns, parameters).0
    }

    fn value_and_slopes(&self, columns: &[f64], parameters: &[f64]) -> ([f64; 2], Vec<[f64; 2]>) {
        let mut value = [0.0; 2];
        let mut slopes = vec![[0.0; 2]; parameters.len()];
        for (axis, formula) in self.formulas.iter().enumerate() {
            let (v, s) = formula.evaluate(|index| columns[index], parameters);
            value[axis] = self.scale * v;
            for (slope, s) in slopes.iter_mut().zip(s) {
                slope[axis] = self.scale * s;
            }
        }
        (value, slopes)
    }

    fn source(&self) -> &Path {
        &self.file
    }
}
