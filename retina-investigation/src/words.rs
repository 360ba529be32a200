//! A form in words: what it does, and where such errors come from.

use retina_diagnosis::Dataset;
use serde::Deserialize;

use crate::columns::{Column, Content, Place, rounded};
use crate::direction::Direction;
use crate::form::{Factor, Form};
use crate::law::Law;

/// What a formula says.
#[derive(Debug, Clone, PartialEq)]
pub struct Words {
    /// One sentence for the direction and one for each law.
    pub says: Vec<String>,
    /// Columns that vary in the table and that the formula does not need.
    pub independent_of: Vec<String>,
    /// Where such errors come from, likeliest first.
    pub origins: Vec<Origin>,
}

/// A mechanism that makes errors of a form.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Origin {
    /// What it is.
    pub mechanism: String,
    /// How one sees whether it is that.
    pub check: String,
    /// What would show it directly.
    pub instrument: String,
    /// Columns it acts through; each has to be in the formula. `any` stands for any column.
    columns: Vec<String>,
    /// Directions it has, by their names; empty: any.
    #[serde(default)]
    directions: Vec<String>,
    /// Laws it follows, by their names; empty: any.
    #[serde(default)]
    laws: Vec<String>,
}

#[derive(Deserialize)]
struct Origins {
    origin: Vec<Origin>,
}

/// The list, as the project keeps it.
const ORIGINS: &str = include_str!("origins.toml");
/// The name in the list of what follows a column with a delay.
const DELAY: &str = "Delay";
/// Most origins that are named.
const MOST_ORIGINS: usize = 3;

/// All mechanisms.
fn origins() -> Vec<Origin> {
    // A test reads the list.
    toml::from_str::<Origins>(ORIGINS).map(|list| list.origin).unwrap_or_default()
}

/// A formula in words.
pub(crate) fn words(
    form: &Form,
    columns: &[Column],
    data: &Dataset,
    amplitudes: &[f64],
    strength: f64,
) -> Words {
    let unit = data.kind.unit();
    let mut says = vec![direction(form, amplitudes, unit, &Place::of(columns))];
    for factor in &form.factors {
        says.push(law(factor, &columns[factor.column]));
    }
    says.push(format!("Its rms beside the model is {strength:.2} of the noise."));
    let own = form.covariates(columns);
    let (alike, independent_of): (Vec<String>, Vec<String>) = data
        .screened_columns()
        .into_iter()
        .filter(|name| !own.iter().any(|o| o == name))
        .map(str::to_owned)
        .partition(|name| own.iter().any(|own| correlation(data, own, name).abs() >= ONE_COLUMN));
    if !alike.is_empty() {
        says.push(format!(
            "It may as well depend on {}: in these data each changes together with one of its own columns.",
            alike.join(", ")
        ));
    }
    let delayed = form.factors.iter().any(|factor| columns[factor.column].follows.is_some());
    Words { says, independent_of, origins: likely(form, &own, delayed) }
}

/// Columns with a correlation of this size are one, for what a formula says.
const ONE_COLUMN: f64 = 0.995;

/// Pearson's correlation of two columns over the rows that have both.
fn correlation(data: &Dataset, a: &str, b: &str) -> f64 {
    let of = |name: &str| data.covariate(name).map_or(&[][..], |covariate| covariate.values.as_slice());
    let both: Vec<(f64, f64)> = of(a)
        .iter()
        .copied()
        .zip(of(b).iter().copied())
        .filter(|(a, b)| a.is_finite() && b.is_finite())
        .collect();
    let count = both.len().max(1) as f64;
    let mean = both.iter().fold((0.0, 0.0), |sum, pair| (sum.0 + pair.0 / count, sum.1 + pair.1 / count));
    let (mut aa, mut bb, mut ab) = (0.0, 0.0, 0.0);
    for (a, b) in both {
        let (a, b) = (a - mean.0, b - mean.1);
        (aa, bb, ab) = (aa + a * a, bb + b * b, ab + a * b);
    }
    if aa > 0.0 && bb > 0.0 { ab / (aa * bb).sqrt() } else { 0.0 }
}

/// Mechanisms whose columns are in the formula; those that agree in direction and law first.
fn likely(form: &Form, own: &[String], delayed: bool) -> Vec<Origin> {
    let direction = format!("{:?}", form.direction.narrow());
    let mut laws: Vec<String> = form.factors.iter().map(|factor| format!("{:?}", factor.law)).collect();
    laws.extend(delayed.then(|| DELAY.to_owned()));
    // Fields of errors always depend on the place: a mechanism that names no place is one of the others.
    let others: Vec<&String> = own.iter().filter(|name| !["x", "y"].contains(&name.as_str())).collect();
    let mut fitting: Vec<(usize, Origin)> = origins()
        .into_iter()
        .filter_map(|origin| {
            let known = |name: &String| name == "any" || own.contains(name);
            let covers = others.iter().all(|own| origin.columns.iter().any(|c| c == *own || c == "any"));
            let directed = origin.directions.is_empty() || origin.directions.contains(&direction);
            let lawful = origin.laws.is_empty() || laws.iter().any(|law| origin.laws.contains(law));
            if !origin.columns.iter().all(known) || !covers || !directed {
                return None;
            }
            let general = usize::from(origin.columns.iter().any(|c| c == "any"));
            let named = usize::from(!origin.directions.is_empty()) + usize::from(!origin.laws.is_empty());
            Some((10 * general + 4 * usize::from(!lawful) + 2 - named, origin))
        })
        .collect();
    fitting.sort_by_key(|(distance, _)| *distance);
    fitting.into_iter().map(|(_, origin)| origin).take(MOST_ORIGINS).collect()
}

fn direction(form: &Form, amplitudes: &[f64], unit: &str, place: &Place) -> String {
    let size = amplitudes.iter().map(|a| a * a).sum::<f64>().sqrt();
    // Along a fixed direction the first two amplitudes tell it, whatever the law's sign.
    let angle = || match amplitudes {
        [x, y] => format!(", along {:.0} deg from x towards y", y.atan2(*x).to_degrees().rem_euclid(180.0)),
        _ => String::new(),
    };
    let centre = || {
        let skirts = if form.place.len() > 3 { " and with wide skirts beyond" } else { "" };
        format!(
            "the place ({:.2}, {:.2}), within {:.2} of half the width{skirts}",
            form.place[0], form.place[1], form.place[2]
        )
    };
    let px = |axis: usize| place.middle_px[axis] + place.half_px * form.place[axis];
    match form.direction {
        Direction::Glow | Direction::WideGlow => {
            let skirts = if form.place.len() > 3 { " and with wide skirts beyond" } else { "" };
            format!(
                "It is a value about pixel ({:.0}, {:.0}), within {:.0} px{skirts}, of {size:.3} {unit} in its middle where its laws are 1.",
                px(0),
                px(1),
                place.half_px * form.place[2]
            )
        }
        Direction::Fringes => {
            let (kx, ky) = (form.place[0], form.place[1]);
            format!(
                "It is a wave over the image of {:.1} px, across {:.0} deg from x towards y, of {size:.3} {unit} where its laws are 1.",
                std::f64::consts::TAU / kx.hypot(ky) * place.half_px,
                ky.atan2(kx).to_degrees()
            )
        }
        Direction::Value => {
            format!("It is a value of each reading, of {size:.3} {unit} where its laws are 1.")
        }
        Direction::Fixed => {
            format!("It shifts points in one and the same direction all over the field{}.", angle())
        }
        Direction::FixedInCamera => {
            format!("It shifts points the same way in axes that turn with the camera{}.", angle())
        }
        Direction::Radial => {
            "It moves points along the radius, in proportion to it: a change of scale.".to_owned()
        }
        Direction::Tangential => "It turns the field about the axis.".to_owned(),
        Direction::StretchX => "It stretches the field along x.".to_owned(),
        Direction::StretchY => "It stretches the field along y.".to_owned(),
        Direction::ShearX => "It moves points along x in proportion to y.".to_owned(),
        Direction::ShearY => "It moves points along y in proportion to x.".to_owned(),
        Direction::Anamorphic => "It stretches the field along one axis and squeezes it across.".to_owned(),
        Direction::Linear => "It is a linear change of the field: scale, turn, stretch or shear.".to_owned(),
        Direction::Tilted => "It is the field of a plane that tilts.".to_owned(),
        Direction::Prism => format!("It grows as the radius squared, the same way everywhere{}.", angle()),
        Direction::Dent | Direction::WideDent => {
            format!("It moves points away from, or towards, {}.", centre())
        }
        Direction::Swirl | Direction::WideSwirl => format!("It turns points about {}.", centre()),
        Direction::Spot | Direction::WideSpot => format!("It shifts points about {}{}.", centre(), angle()),
        Direction::Wave => {
            let (kx, ky) = (form.place[0], form.place[1]);
            format!(
                "It is a wave over the field of {:.3} of half the width, across {:.0} deg from x towards y.",
                std::f64::consts::TAU / kx.hypot(ky),
                ky.atan2(kx).to_degrees()
            )
        }
    }
}

fn law(factor: &Factor, column: &Column) -> String {
    let source = match column.source() {
        "F" => "the irradiance F",
        "r" => "the radius r",
        name => name,
    };
    let name = match &column.follows {
        None => source.to_owned(),
        Some((_, tau_s)) => format!("what follows {source} with a time constant of {} s", short(*tau_s)),
    };
    let of = |value: f64| {
        // A temperature is in degrees; its changes are in kelvin.
        let unit = if column.source() == "temperature_c" { Some("deg C") } else { column.unit.as_deref() };
        format!("{}{}", short(value), unit.map_or_else(String::new, |unit| format!(" {unit}")))
    };
    let shape = &factor.shape;
    match factor.law {
        Law::Linear if column.content == Content::Switch => format!("It is there where {name} is 1."),
        Law::Linear => format!("It is linear in {name}, and 0 at {}.", of(shape[0])),
        Law::Square => format!("It grows as the square of {name} from {}.", of(shape[0])),
        Law::Cubic => format!("It grows as the cube of {name} from {}.", of(shape[0])),
        Law::Power if shape[0] < 0.0 => {
            format!(
                "It falls with {name}, as its power {}: the darker or smaller, the larger.",
                short(shape[0])
            )
        }
        Law::Power if shape[0] < 0.8 => {
            format!("It grows slower than {name}, as its power {}.", short(shape[0]))
        }
        Law::Power if shape[0] <= 1.2 => format!("It grows in proportion to {name}."),
        Law::Power => format!("It grows faster than {name}, as its power {}.", short(shape[0])),
        Law::Logarithm => format!("It goes with the logarithm of {name}."),
        Law::Decay => format!("It dies away with {name}, by a factor e in {}.", of(shape[0])),
        Law::Growth => format!("It sets in towards large {name}, by a factor e in {}.", of(shape[0])),
        Law::Saturation => {
            format!("It grows with {name} and saturates: half of it is reached at {}.", of(shape[0]))
        }
        Law::Edge => {
            format!(
                "It goes from one value to another about {name} = {}, within {}.",
                of(shape[0]),
                of(shape[1])
            )
        }
        Law::Step => format!("It jumps at {name} = {}.", of(shape[0])),
        Law::Bump => format!("It is confined to {name} about {}, within {}.", of(shape[0]), of(shape[1])),
        Law::Periodic => format!("It repeats itself in {name} every {}.", of(shape[0])),
        Law::Hinge => format!("It sets in at {name} = {} and grows from there.", of(shape[0])),
        Law::Absolute => format!("It grows with {name} on both sides of {}.", of(shape[0])),
    }
}

/// A number to three digits.
pub(crate) fn short(value: f64) -> String {
    let size = value.abs();
    // 1e-4, the least p-value, is written out.
    if size != 0.0 && !(9.9e-5..1e6).contains(&size) {
        return format!("{value:.2e}");
    }
    let digits = if size == 0.0 { 0 } else { (2 - size.log10().floor() as i32).max(0) as usize };
    let text = format!("{:.*}", digits, rounded(value));
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_list_of_origins_is_read() {
        let list: Origins = toml::from_str(ORIGINS).unwrap();
        assert!(list.origin.len() >= 20);
        let mut laws: Vec<String> = Law::ALL.iter().map(|law| format!("{law:?}")).collect();
        laws.push(DELAY.to_owned());
        for origin in &list.origin {
            assert!(!origin.columns.is_empty(), "{}", origin.mechanism);
            assert!(origin.laws.iter().all(|law| laws.contains(law)), "{}", origin.mechanism);
        }
    }

    #[test]
    fn numbers_have_three_digits() {
        assert_eq!([0.012_345, 1.0, 123.456, 2.5e-7].map(short), ["0.0123", "1", "123", "2.50e-7"]);
    }
}
