//! The columns that laws are functions of.

use retina_diagnosis::{Dataset, unit_of_column};
use retina_formats::TableKind;

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
}

/// A column: its name in formulas, and how its values lie.
#[derive(Debug, Clone)]
pub(crate) struct Column {
    pub(crate) name: String,
    pub(crate) low: f64,
    pub(crate) high: f64,
    pub(crate) content: Content,
    /// Its unit, where it has one.
    pub(crate) unit: Option<String>,
}

/// More different values than this make laws of any shape possible.
const FEW: usize = 3;

impl Column {
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

    /// A value with its unit, as formulas write it.
    pub(crate) fn quantity(&self, value: f64) -> String {
        let value = rounded(value);
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
    format!("{value:.6e}").parse().unwrap_or(value)
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
}

/// The values of a column by its name in formulas.
fn values(data: &Dataset, name: &str) -> Vec<f64> {
    let of = |name: &str| data.covariate(name).map_or_else(Vec::new, |c| c.values.clone());
    match name {
        "F" => of("log10_irradiance").iter().map(|l| 10f64.powf(*l)).collect(),
        "L" => of("log10_irradiance"),
        name => of(name),
    }
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
    names.into_iter().filter_map(|name| column(data, name)).collect()
}

fn column(data: &Dataset, name: String) -> Option<Column> {
    let mut sorted = values(data, &name);
    let rows = sorted.len();
    sorted.retain(|value| value.is_finite());
    // In a table a value that is missing is not known, in an image a pixel of the sky has no angle.
    let enough = if data.kind == TableKind::Frames { sorted.len() > rows / 4 } else { sorted.len() == rows };
    sorted.sort_by(f64::total_cmp);
    let (low, high) = (rounded(*sorted.first()?), rounded(*sorted.last()?));
    if !enough || high <= low {
        return None;
    }
    sorted.dedup();
    let content = if name.contains("_phase_") {
        Content::Phase
    } else if sorted == [0.0, 1.0] {
        Content::Switch
    } else if sorted.len() <= FEW {
        Content::Few
    } else {
        Content::Number
    };
    let unit = unit_of_column(&name);
    Some(Column { name, low, high, content, unit })
}

impl Table {
    pub(crate) fn new(data: &Dataset, columns: &[Column]) -> Self {
        let of = |name: &str| data.covariate(name).map_or_else(Vec::new, |c| c.values.clone());
        let roll_rad = of("camera_roll_deg").iter().map(|deg| deg.to_radians()).collect();
        Self {
            rows: data.len(),
            components: data.components(),
            x: of("x"),
            y: of("y"),
            roll_rad,
            values: columns.iter().map(|column| values(data, &column.name)).collect(),
        }
    }

    /// Values of a column over the rows.
    pub(crate) fn column(&self, index: usize) -> &[f64] {
        &self.values[index]
    }
}
