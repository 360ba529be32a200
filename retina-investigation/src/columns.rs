//! The columns that laws are functions of.

use std::collections::HashMap;
use std::hash::Hash;
use std::sync::{Arc, PoisonError, RwLock};

use retina_diagnosis::{Dataset, column_text, unit_of_column};
use retina_formats::TableKind;

use crate::delays::delayed;
use crate::direction::Direction;
use crate::form::Factor;
use crate::law::Law;

/// What a column's values are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Content {
    /// Any numbers.
    Number,
    /// Two or three different numbers.
    Few,
    /// A fraction of a pixel.
    Phase,
    /// 0 or 1.
    Switch,
    /// Numbers that follow another column with a delay.
    Lagged,
}

/// A column: its name in formulas, and how its values lie.
#[derive(Debug, Clone)]
pub(crate) struct Column {
    pub(crate) name: String,
    /// The same as formulas write it.
    pub(crate) text: String,
    /// The column that it follows, and its time constant in seconds.
    pub(crate) follows: Option<(String, f64)>,
    pub(crate) low: f64,
    pub(crate) high: f64,
    pub(crate) content: Content,
    /// Its unit, where it has one.
    pub(crate) unit: Option<String>,
}

/// More different values than this make laws of any shape possible.
const FEW: usize = 3;

impl Column {
    /// The table's column that it is made of.
    pub(crate) fn source(&self) -> &str {
        self.follows.as_ref().map_or(&self.name, |(source, _)| source)
    }

    pub(crate) fn half(&self) -> f64 {
        0.5 * (self.high - self.low)
    }

    pub(crate) fn middle(&self) -> f64 {
        0.5 * (self.high + self.low)
    }

    /// What a straight line is counted in.
    pub(crate) fn unit_length(&self) -> f64 {
        if self.content == Content::Switch { 1.0 } else { self.half() }
    }

    /// What a power is counted in: its amplitude is that at this value.
    pub(crate) fn reference(&self) -> f64 {
        if self.unit.is_none() && self.high <= 2.0 { 1.0 } else { self.high }
    }

    /// Whether 0 means that there is none of it.
    pub(crate) fn has_zero(&self) -> bool {
        self.unit.as_deref() != Some("K")
    }

    /// Where saturation begins: 0, or where the column begins if that is far from 0.
    pub(crate) fn origin(&self) -> f64 {
        if self.low > 0.2 * self.high { self.low } else { 0.0 }
    }

    /// A value of it as formulas write it: a ten millionth of its range counts.
    pub(crate) fn rounded(&self, value: f64) -> f64 {
        rounded_for(value, self.high - self.low)
    }

    /// Where its waves begin: 0, or where the column begins if that is many times its range away from 0.
    pub(crate) fn wave_origin(&self) -> f64 {
        if self.low.abs() > 20.0 * self.half() { self.low } else { 0.0 }
    }

    /// A value with its unit, as formulas write it.
    pub(crate) fn quantity(&self, value: f64) -> String {
        let value = self.rounded(value);
        // A sign would be read as a subtraction.
        let number = if value < 0.0 { format!("({value})") } else { format!("{value}") };
        match &self.unit {
            Some(unit) if value < 0.0 => format!("(0[{unit}] - {}[{unit}])", -value),
            Some(unit) => format!("{number}[{unit}]"),
            None => number,
        }
    }
}

/// A value to seven digits: what a formula's constants are written to.
pub(crate) fn rounded(value: f64) -> f64 {
    rounded_for(value, value.abs())
}

/// A value to as many digits as seven of `size` are, where that is smaller.
fn rounded_for(value: f64, size: f64) -> f64 {
    let further = (value.abs() / size).log10().ceil();
    let digits = if further.is_finite() { 6 + further.clamp(0.0, 9.0) as usize } else { 6 };
    format!("{value:.digits$e}").parse().unwrap_or(value)
}

/// Columns of a pixel's place.
pub(crate) const PIXEL: [&str; 2] = ["camera_x_px", "camera_y_px"];

/// What x and y of a direction are.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Place {
    /// As formulas write them.
    pub(crate) texts: [String; 2],
    /// Of images: where they are 0, px.
    pub(crate) middle_px: [f64; 2],
    /// Of images: what they are counted in, px.
    pub(crate) half_px: f64,
}

impl Place {
    /// The columns x and y of points; of images the pixels' places about the middle of those that are looked at.
    pub(crate) fn of(columns: &[Column]) -> Self {
        let of = |name: &str| columns.iter().find(|column| column.name == name);
        let [Some(x), Some(y)] = PIXEL.map(of) else {
            return Self { texts: ["x", "y"].map(str::to_owned), middle_px: [0.0; 2], half_px: 1.0 };
        };
        let middle_px = [x, y].map(|column| rounded(column.middle()));
        let half_px = rounded(x.half().max(y.half()));
        let text = |column: &Column, middle: f64| {
            format!("(({} - {}) / {})", column.text, column.quantity(middle), column.quantity(half_px))
        };
        Self { texts: [text(x, middle_px[0]), text(y, middle_px[1])], middle_px, half_px }
    }
}

/// A table as forms read it: places and columns over its rows.
pub(crate) struct Table {
    pub(crate) rows: usize,
    pub(crate) components: usize,
    pub(crate) x: Vec<f64>,
    pub(crate) y: Vec<f64>,
    /// Turn of the camera in the facility's axes, rad.
    pub(crate) roll_rad: Vec<f64>,
    values: Vec<Vec<f64>>,
    laws: Evaluated<LawKey>,
    fields: Evaluated<FieldKey>,
}

/// What was evaluated over the rows once: a search asks for the same laws and fields in many forms.
struct Evaluated<K>(RwLock<HashMap<K, Arc<Values>>>);

/// Some columns over the rows.
pub(crate) type Values = Vec<Vec<f64>>;
/// Column, law, and the bits of its shape.
type LawKey = (usize, Law, [u64; 2]);
/// Direction, and the bits of its shape.
type FieldKey = (Direction, [u64; 4]);

/// Numbers that are kept of all laws, and of all fields, at most.
const MOST_KEPT: usize = 24_000_000;

impl<K> Default for Evaluated<K> {
    fn default() -> Self {
        Self(RwLock::default())
    }
}

impl<K: Eq + Hash> Evaluated<K> {
    fn get(&self, key: K, evaluate: impl FnOnce() -> Values) -> Arc<Values> {
        if let Some(known) = self.0.read().unwrap_or_else(PoisonError::into_inner).get(&key) {
            return Arc::clone(known);
        }
        let values = Arc::new(evaluate());
        let size = values.iter().map(Vec::len).sum::<usize>();
        let mut known = self.0.write().unwrap_or_else(PoisonError::into_inner);
        if (known.len() + 1) * size <= MOST_KEPT {
            known.insert(key, Arc::clone(&values));
        }
        values
    }
}

/// The bits of shape parameters.
fn bits<const N: usize>(shape: &[f64]) -> [u64; N] {
    std::array::from_fn(|k| shape.get(k).map_or(0, |value| value.to_bits()))
}

/// The columns of a table that laws may be functions of. Light is F, the irradiance: its logarithm is a law.
pub(crate) fn columns(data: &Dataset) -> Vec<Column> {
    let mut names: Vec<String> = Vec::new();
    if data.components() == 2 {
        names.extend(["x", "y", "r"].map(str::to_owned));
    }
    for name in data.screened_columns() {
        names.push(if name == "log10_irradiance" { "F".to_owned() } else { name.to_owned() });
    }
    let own: Vec<Column> = names.into_iter().filter_map(|name| column(data, name, None)).collect();
    let numbers = own.iter().filter(|column| column.content == Content::Number);
    let lagged: Vec<Column> = numbers.flat_map(|column| delayed(data, column)).collect();
    own.into_iter().chain(lagged).collect()
}

/// A column, or what follows one with a delay; none that does not vary, or has no text.
pub(crate) fn column(data: &Dataset, name: String, follows: Option<(String, f64)>) -> Option<Column> {
    let mut sorted = data.readable(&name)?;
    let rows = sorted.len();
    sorted.retain(|value| value.is_finite());
    // In a table a value that is missing is not known, in an image a pixel of the sky has no angle.
    let enough = if data.kind == TableKind::Frames { sorted.len() > rows / 4 } else { sorted.len() == rows };
    sorted.sort_by(f64::total_cmp);
    let (first, last) = (*sorted.first()?, *sorted.last()?);
    let [low, high] = [first, last].map(|value| rounded_for(value, last - first));
    if !enough || high <= low {
        return None;
    }
    sorted.dedup();
    let content = if follows.is_some() {
        Content::Lagged
    } else if name.contains("_phase_") {
        Content::Phase
    } else if sorted == [0.0, 1.0] {
        Content::Switch
    } else if sorted.len() <= FEW {
        Content::Few
    } else {
        Content::Number
    };
    let unit = unit_of_column(follows.as_ref().map_or(&name, |(source, _)| source));
    let text = column_text(&name)?;
    Some(Column { name, text, follows, low, high, content, unit })
}

impl Table {
    pub(crate) fn new(data: &Dataset, columns: &[Column]) -> Self {
        let of = |name: &str| data.covariate(name).map_or_else(Vec::new, |c| c.values.clone());
        let roll_rad = of("camera_roll_deg").iter().map(|deg| deg.to_radians()).collect();
        let place = Place::of(columns);
        let names = if data.kind == TableKind::Frames { PIXEL } else { ["x", "y"] };
        let [x, y] = [0, 1].map(|axis| {
            let about = |value: &f64| (value - place.middle_px[axis]) / place.half_px;
            of(names[axis]).iter().map(about).collect()
        });
        Self {
            rows: data.len(),
            components: data.components(),
            x,
            y,
            roll_rad,
            laws: Evaluated::default(),
            fields: Evaluated::default(),
            values: columns.iter().map(|column| data.readable(&column.name).unwrap_or_default()).collect(),
        }
    }

    /// Some of its rows. What lags is what it was with all of them.
    pub(crate) fn of_rows(&self, rows: &[usize]) -> Self {
        let of = |values: &Vec<f64>| rows.iter().filter_map(|&row| values.get(row).copied()).collect();
        Self {
            rows: rows.len(),
            components: self.components,
            x: of(&self.x),
            y: of(&self.y),
            roll_rad: of(&self.roll_rad),
            laws: Evaluated::default(),
            fields: Evaluated::default(),
            values: self.values.iter().map(of).collect(),
        }
    }

    /// A law of a column over the rows. Where the column has no value the law is 0.
    pub(crate) fn law(&self, factor: &Factor, column: &Column) -> Arc<Values> {
        self.laws.get((factor.column, factor.law, bits(&factor.shape)), || {
            let mut values = vec![vec![0.0; self.rows]; factor.law.width()];
            for (row, &u) in self.values[factor.column].iter().enumerate().filter(|(_, u)| !u.is_nan()) {
                let of_row = factor.law.value(u, &factor.shape, column);
                values.iter_mut().zip(of_row).for_each(|(column, value)| column[row] = value);
            }
            values
        })
    }

    /// A direction over all components of the rows, one column for each amplitude.
    pub(crate) fn field(&self, direction: Direction, place: &[f64]) -> Arc<Values> {
        self.fields.get((direction, bits(place)), || {
            let n = self.components;
            let mut values = vec![Vec::with_capacity(n * self.rows); direction.width()];
            let mut vectors: Vec<[f64; 2]> = Vec::new();
            for row in 0..self.rows {
                direction.vectors(self, row, place, &mut vectors);
                for (column, vector) in values.iter_mut().zip(&vectors) {
                    column.extend_from_slice(&vector[..n]);
                }
            }
            values
        })
    }

    /// Values of a column over the rows.
    pub(crate) fn column(&self, index: usize) -> &[f64] {
        &self.values[index]
    }
}
