//! Forms: a direction times laws of columns, linear in amplitudes.

use std::fmt::Write as _;

use retina_formats::TableKind;

use crate::columns::{Column, PIXEL, Place, Table, Values, rounded};
use crate::direction::Direction;
use crate::law::{Law, Move};
use crate::rivals::sum;

/// A law of one of the columns, its shape parameters fixed.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Factor {
    pub(crate) column: usize,
    pub(crate) law: Law,
    pub(crate) shape: Vec<f64>,
}

/// A direction times laws.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Form {
    pub(crate) direction: Direction,
    /// Shape parameters of the direction.
    pub(crate) place: Vec<f64>,
    pub(crate) factors: Vec<Factor>,
}

/// What a form is apart from its shape parameters.
pub(crate) type Family = (Direction, Vec<(usize, Law)>);

impl Form {
    pub(crate) fn family(&self) -> Family {
        let mut laws: Vec<(usize, Law)> = self.factors.iter().map(|f| (f.column, f.law)).collect();
        laws.sort_unstable();
        (self.direction, laws)
    }

    /// Number of its linear amplitudes.
    pub(crate) fn width(&self) -> usize {
        self.factors.iter().fold(self.direction.width(), |width, factor| width * factor.law.width())
    }

    /// How much there is to say: amplitudes, places and laws.
    pub(crate) fn complexity(&self) -> usize {
        self.width() + self.place.len() + self.factors.iter().map(|factor| factor.law.cost()).sum::<usize>()
    }

    /// Number of its shape parameters.
    pub(crate) fn shapes(&self) -> usize {
        self.place.len() + self.factors.iter().map(|factor| factor.shape.len()).sum::<usize>()
    }

    /// Number of those that can make a difference: where a straight line alone multiplies what the baseline has, it may
    /// begin anywhere.
    pub(crate) fn free_shapes(&self) -> usize {
        match self.factors.as_slice() {
            [one] if one.law == Law::Linear && self.direction.in_baseline() => self.place.len(),
            _ => self.shapes(),
        }
    }

    /// Its columns over all components of the rows, one for each amplitude.
    pub(crate) fn evaluate(&self, table: &Table, columns: &[Column]) -> Values {
        let scalars = self.scalars(table, columns);
        if self.direction == Direction::Value {
            return scalars;
        }
        let field = table.field(self.direction, &self.place);
        if self.factors.is_empty() {
            return field.to_vec();
        }
        let times = |scalar: &[f64], of: &[f64]| -> Vec<f64> {
            let mut out = of.to_vec();
            match table.components {
                1 => out.iter_mut().zip(scalar).for_each(|(value, scalar)| *value *= scalar),
                n => out
                    .chunks_exact_mut(n)
                    .zip(scalar)
                    .for_each(|(row, scalar)| row.iter_mut().for_each(|value| *value *= scalar)),
            }
            out
        };
        scalars
            .iter()
            .flat_map(|scalar| field.iter().map(|of| times(scalar, of)).collect::<Vec<_>>())
            .collect()
    }

    /// The products of its laws over the rows: one, and twice as many with each periodic law.
    fn scalars(&self, table: &Table, columns: &[Column]) -> Values {
        let mut out = vec![vec![1.0; table.rows]];
        for factor in &self.factors {
            let laws = table.law(factor, &columns[factor.column]);
            let by = |scalar: &Vec<f64>, law: &Vec<f64>| scalar.iter().zip(law).map(|(s, l)| s * l).collect();
            out = laws
                .iter()
                .flat_map(|law| out.iter().map(|scalar| by(scalar, law)).collect::<Vec<_>>())
                .collect();
        }
        out
    }

    /// The vectors of its direction over all components of the rows, as large as with the law that has the largest
    /// amplitudes.
    pub(crate) fn along(&self, table: &Table, columns: &[Column], amplitudes: &[f64]) -> Vec<f64> {
        let alone = Self { factors: Vec::new(), ..self.clone() };
        let size = |of: &&[f64]| of.iter().map(|a| a * a).sum::<f64>();
        let largest = amplitudes.chunks(alone.width()).max_by(|a, b| size(a).total_cmp(&size(b)));
        sum(&alone.evaluate(table, columns), largest.into_iter().flatten().copied())
    }

    /// What it is a function of: its covariates, where something follows one with a delay that instead.
    pub(crate) fn reads(&self, columns: &[Column]) -> Vec<String> {
        let lagged = |name: &String| {
            let mut own = self.factors.iter().map(|factor| &columns[factor.column]);
            own.find(|column| column.follows.is_some() && column.source() == name).map(|c| c.name.clone())
        };
        self.covariates(columns).into_iter().map(|name| lagged(&name).unwrap_or(name)).collect()
    }

    /// All its shape parameters, one after the other.
    pub(crate) fn shape(&self) -> Vec<f64> {
        let factors = self.factors.iter().flat_map(|factor| &factor.shape);
        self.place.iter().chain(factors).copied().collect()
    }

    /// The same form with other shape parameters.
    pub(crate) fn with_shape(&self, shape: &[f64]) -> Self {
        let mut out = self.clone();
        let places = out.place.iter_mut();
        let all = places.chain(out.factors.iter_mut().flat_map(|factor| factor.shape.iter_mut()));
        all.zip(shape).for_each(|(to, from)| *to = *from);
        out
    }

    /// How a search moves each of its shape parameters.
    pub(crate) fn moves(&self, columns: &[Column]) -> Vec<Option<Move>> {
        let mut out: Vec<Option<Move>> = self.direction.moves().into_iter().map(Some).collect();
        for factor in &self.factors {
            let moves = factor.law.moves(&columns[factor.column]);
            out.extend((0..factor.shape.len()).map(|k| moves.get(k).copied()));
        }
        out
    }

    /// Whether its shape parameters are within what the columns can show.
    pub(crate) fn allowed(&self, columns: &[Column]) -> bool {
        self.direction.allows(&self.place)
            && self.factors.iter().all(|f| f.law.allows(&f.shape, &columns[f.column]))
    }

    /// Names of the columns it depends on, places among them.
    pub(crate) fn covariates(&self, columns: &[Column]) -> Vec<String> {
        let mut out: Vec<String> = Vec::new();
        let mut add = |name: &str| {
            if !out.iter().any(|known| known == name) {
                out.push(name.to_owned());
            }
        };
        for factor in &self.factors {
            match columns[factor.column].source() {
                "F" => add("log10_irradiance"),
                "r" => ["x", "y"].iter().for_each(|name| add(name)),
                name => add(name),
            }
        }
        match self.direction {
            Direction::Value | Direction::Fixed => {}
            Direction::FixedInCamera => add("camera_roll_deg"),
            Direction::Glow | Direction::WideGlow | Direction::Fringes => PIXEL.into_iter().for_each(add),
            Direction::StretchX | Direction::ShearY => add("x"),
            Direction::StretchY | Direction::ShearX => add("y"),
            _ => ["x", "y"].iter().for_each(|name| add(name)),
        }
        out
    }

    /// The form as a user's effect, the text of a TOML file, with these amplitudes to start from. Shape parameters are
    /// fitted where they are smooth and `frozen` does not hold them.
    pub(crate) fn effect(
        &self,
        columns: &[Column],
        kind: TableKind,
        name: &str,
        amplitudes: &[f64],
        frozen: &[bool],
    ) -> String {
        let unit = kind.unit();
        // A parameter has no column's name.
        let free = |mut name: String| {
            while columns.iter().any(|column| column.name == name) {
                name.push('_');
            }
            name
        };
        let amplitude_name = |number: usize| free(format!("amplitude_{number}"));
        let mut parameters = String::from("[parameters]\n");
        for (k, amplitude) in amplitudes.iter().enumerate() {
            let start = rounded(*amplitude);
            let _ = writeln!(
                parameters,
                "{} = {{ start = {start:?}, unit = \"{unit}\" }}",
                amplitude_name(k + 1)
            );
        }
        let mut at = 0;
        let mut texts_of =
            |shapes: &[crate::law::Shape], values: &[f64], column: Option<&Column>, suffix: &str| {
                let mut out = Vec::new();
                for (shape, value) in shapes.iter().zip(values) {
                    let held = frozen.get(at).copied().unwrap_or(false) || !shape.smooth;
                    at += 1;
                    let column = column.filter(|_| shape.has_unit);
                    if held {
                        out.push(column.map_or_else(|| plain(*value), |column| column.quantity(*value)));
                        continue;
                    }
                    let name = free(format!("{}{suffix}", shape.name));
                    let unit = column.and_then(|column| column.unit.clone()).unwrap_or_default();
                    let start = column.map_or_else(|| rounded(*value), |column| column.rounded(*value));
                    let _ = writeln!(parameters, "{name} = {{ start = {start:?}, unit = \"{unit}\" }}");
                    out.push(name);
                }
                out
            };
        let places = texts_of(self.direction.shapes(), &self.place, None, "");
        let vectors = self.direction.texts(&places, &Place::of(columns));
        let mut scalars = vec![Vec::<String>::new()];
        for (k, factor) in self.factors.iter().enumerate() {
            let column = &columns[factor.column];
            let suffix = if self.factors.len() > 1 { format!("_{}", k + 1) } else { String::new() };
            let shape = texts_of(factor.law.shapes(), &factor.shape, Some(column), &suffix);
            let laws = factor.law.text(&shape, column);
            scalars = laws
                .iter()
                .flat_map(|law| {
                    scalars.iter().map(|scalar| {
                        let mut scalar = scalar.clone();
                        scalar.push(law.clone());
                        scalar
                    })
                })
                .collect();
        }
        let keys: &[&str] = if kind == TableKind::Points { &["dx", "dy"] } else { &["value"] };
        let mut text = format!("name = \"{name}\"\nunit = \"{unit}\"\n");
        for (axis, key) in keys.iter().enumerate() {
            let mut terms = Vec::new();
            let mut amplitude = 0;
            for scalar in &scalars {
                for vector in &vectors {
                    amplitude += 1;
                    if vector[axis].is_empty() {
                        continue;
                    }
                    let own = amplitude_name(amplitude);
                    let others = std::iter::once(&vector[axis]).filter(|text| *text != "1").chain(scalar);
                    terms.push(std::iter::once(&own).chain(others).cloned().collect::<Vec<_>>().join(" * "));
                }
            }
            let sum = if terms.is_empty() { "0".to_owned() } else { terms.join(" + ") };
            let _ = writeln!(text, "{key} = \"{}\"", sum.replace('\\', "\\\\").replace('"', "\\\""));
        }
        text + &parameters
    }
}

/// A number as formulas write it.
fn plain(value: f64) -> String {
    let value = rounded(value);
    if value < 0.0 { format!("({value})") } else { format!("{value}") }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may fail")]

    use retina_diagnosis::AddedEffect;

    use super::*;
    use crate::campaign;
    use crate::columns::columns;

    /// Every law on every column it fits, at each shape that a search begins at, with every direction: the text that a
    /// user gets says what the search has evaluated.
    #[test]
    fn texts_say_what_forms_are() {
        let setup = campaign::setup();
        let text = campaign::Campaign::new(3).table(&setup, &|p| p.r);
        let rolled = |(k, line): (usize, &str)| match k {
            0 => format!("{line},camera_roll_deg\n"),
            k => format!("{line},{}\n", 90 * (k / 1000)),
        };
        let text: String = text.lines().enumerate().map(rolled).collect();
        let data = campaign::dataset(&setup, &text);
        let columns = columns(&data);
        let table = Table::new(&data, &columns);
        let mut forms: Vec<Form> = Vec::new();
        let shaped = Direction::shaped(TableKind::Points).iter().copied();
        for direction in Direction::PLAIN.into_iter().chain(shaped) {
            for place in direction.starts().into_iter().take(2) {
                let twin = direction.twin(&place);
                forms.push(Form { direction, place, factors: Vec::new() });
                forms.extend(twin.map(|(direction, place)| Form { direction, place, factors: Vec::new() }));
            }
        }
        let plain = forms.len();
        for (column, of) in columns.iter().enumerate() {
            for law in Law::ALL {
                for (k, shape) in law.starts(of).into_iter().enumerate() {
                    let (direction, place) = {
                        let other = &forms[(7 * column + k) % plain];
                        (other.direction, other.place.clone())
                    };
                    forms.push(Form { direction, place, factors: vec![Factor { column, law, shape }] });
                }
            }
        }
        assert!(Law::ALL.iter().all(|law| forms.iter().any(|f| f.factors.iter().any(|g| g.law == *law))));
        for form in forms {
            let of_each = form.evaluate(&table, &columns);
            let amplitudes: Vec<f64> = (0..form.width()).map(|k| 0.7 - 0.4 * k as f64).collect();
            for frozen in [true, false] {
                let text = form.effect(&columns, data.kind, "f", &amplitudes, &vec![frozen; form.shapes()]);
                let AddedEffect::Own(effect) = AddedEffect::of_text("f", &text, &data).unwrap() else {
                    unreachable!("a text is no id")
                };
                let names = effect.columns();
                let values: Vec<&[f64]> = names
                    .iter()
                    .map(|name| {
                        columns.iter().position(|c| c.name == *name).map_or(&table.x[..], |k| table.column(k))
                    })
                    .collect();
                let start: Vec<f64> = effect.parameters().iter().map(|p| p.start).collect();
                for row in (0..table.rows).step_by(97) {
                    let at: Vec<f64> = names
                        .iter()
                        .zip(&values)
                        .map(|(name, v)| match *name {
                            "y" => table.y[row],
                            "x" => table.x[row],
                            "camera_roll_deg" => table.roll_rad[row].to_degrees(),
                            _ => v[row],
                        })
                        .collect();
                    let said = effect.value(&at, &start);
                    for axis in 0..2 {
                        let own: f64 =
                            of_each.iter().zip(&amplitudes).map(|(c, a)| a * c[2 * row + axis]).sum();
                        let off = (said[axis] - own).abs();
                        // Texts have seven digits; a period's are multiplied by the number of its cycles.
                        let largest: f64 = amplitudes.iter().map(|a| a.abs()).sum();
                        assert!(
                            off <= 1e-4 * largest.max(1.0),
                            "{text}\nrow {row}: {said:?}, {own} evaluated"
                        );
                    }
                }
            }
        }
    }
}
