//! Units of a formula's parts: what is added has to agree, what a function takes has none, and the whole is an error.

use super::{Formula, FormulaError, Function, Op};

/// A product of powers of symbols, sorted by symbol; none: a pure number. Symbols of one quantity (deg, arcsec) are not
/// converted: a formula's numbers are taken as they are.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Unit(Vec<(String, f64)>);

impl Unit {
    /// From text such as `arcsec / K`, `W m^-2`, `1 / s`.
    pub(crate) fn parse(text: &str) -> Result<Self, String> {
        let mut unit = Self::default();
        let mut sign = 1.0;
        let mut rest = text.trim();
        while let Some(first) = rest.chars().next() {
            if matches!(first, '*' | '/' | ' ') {
                if first != ' ' {
                    sign = if first == '/' { -1.0 } else { 1.0 };
                }
                rest = &rest[1..];
                continue;
            }
            let length = rest.find([' ', '*', '/', '^']).unwrap_or(rest.len());
            let (symbol, after) = rest.split_at(length);
            let (mut power, mut after) = (1.0, after);
            if let Some(exponent) = after.strip_prefix('^') {
                let length = exponent.find([' ', '*', '/']).unwrap_or(exponent.len());
                power = exponent[..length]
                    .parse()
                    .map_err(|_| format!("`{}` is no exponent of a unit", &exponent[..length]))?;
                after = &exponent[length..];
            }
            let symbol = match symbol {
                "C" | "degC" | "kelvin" => "K",
                "sec" => "s",
                "percent" => "%",
                other => other,
            };
            // A relative error is a pure number.
            if !["1", "relative"].contains(&symbol) {
                if !symbol.chars().all(|c| c.is_alphabetic() || c == '%' || c == '_') {
                    return Err(format!("`{symbol}` is no symbol of a unit"));
                }
                unit = unit.times(&Self(vec![(symbol.to_owned(), 1.0)]), sign * power);
            }
            sign = 1.0;
            rest = after;
        }
        Ok(unit)
    }

    /// That of a column, told by its name; `None` where nothing tells it.
    pub(crate) fn of_column(name: &str) -> Option<Self> {
        const PURE: [&str; 11] = [
            "x",
            "y",
            "r",
            "L",
            "F",
            "log10_irradiance",
            "ln_irradiance",
            "level",
            "lit",
            "row_load",
            "airmass",
        ];
        const ENDINGS: [(&str, &str); 13] = [
            ("_w_m2", "W m^-2"),
            ("_arcsec", "arcsec"),
            ("_deg", "deg"),
            ("_rad", "rad"),
            ("_px", "px"),
            ("_mag", "mag"),
            ("_mm", "mm"),
            ("_um", "um"),
            ("_nm", "nm"),
            ("_dn", "dn"),
            ("_s", "s"),
            ("_c", "K"),
            ("_m", "m"),
        ];
        if PURE.contains(&name) {
            return Some(Self::default());
        }
        let ending = ENDINGS.iter().find(|(ending, _)| name.ends_with(ending))?;
        Self::parse(ending.1).ok()
    }

    fn times(&self, other: &Self, power: f64) -> Self {
        let mut out = self.0.clone();
        for (symbol, exponent) in &other.0 {
            match out.iter_mut().find(|(s, _)| s == symbol) {
                Some((_, sum)) => *sum += power * exponent,
                None => out.push((symbol.clone(), power * exponent)),
            }
        }
        out.retain(|(_, exponent)| exponent.abs() > 1e-9);
        out.sort_by(|a, b| a.0.cmp(&b.0));
        Self(out)
    }

    pub(crate) fn is_pure(&self) -> bool {
        self.0.is_empty()
    }
}

impl std::fmt::Display for Unit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.is_pure() {
            return write!(f, "no unit");
        }
        // Those that multiply first.
        let (above, below): (Vec<_>, Vec<_>) = self.0.iter().partition(|(_, power)| *power > 0.0);
        for (k, (symbol, power)) in above.iter().chain(&below).enumerate() {
            let space = if k == 0 { "" } else { " " };
            if *power == 1.0 { write!(f, "{space}{symbol}")? } else { write!(f, "{space}{symbol}^{power}")? }
        }
        Ok(())
    }
}

/// What is known of a part's unit.
#[derive(Debug, Clone, PartialEq)]
enum Part {
    /// Nothing: it may have any.
    Any,
    /// A number without a unit; in a sum it takes the other's.
    Number(f64),
    /// A quantity; the factor is what numbers it was multiplied by, so that `deg * pi / 180` is an angle in rad.
    Of { unit: Unit, factor: f64 },
}

/// Whether a number is a factor of a formula's own, such as 2, 0.5 or pi. Others (600, 1800) may stand for quantities.
fn is_pure(value: f64) -> bool {
    (value.fract() == 0.0 && value.abs() <= 10.0)
        || [0.5, 0.25, 1.5, std::f64::consts::PI, 180.0].contains(&value.abs())
}

impl Formula {
    /// Whether the parts' units agree and the whole has the unit `wanted`; `columns` and `parameters` are theirs, `None`
    /// where it is not known.
    pub(crate) fn check_units(
        &self,
        columns: &[Option<Unit>],
        parameters: &[Option<Unit>],
        wanted: &Unit,
    ) -> Result<(), FormulaError> {
        let known = |unit: &Option<Unit>| match unit {
            Some(unit) => Part::Of { unit: unit.clone(), factor: 1.0 },
            None => Part::Any,
        };
        let mut stack: Vec<Part> = Vec::new();
        for (op, place) in self.ops.iter().zip(&self.places) {
            let wrong = |problem: String, help: &str| FormulaError {
                problem,
                help: Some(help.to_owned()),
                offset: place.start,
                length: place.len(),
            };
            let mut pop = || stack.pop().unwrap_or(Part::Any);
            let next = match op {
                Op::Number(value) => Part::Number(*value),
                Op::Unit(unit) => {
                    pop();
                    Part::Of { unit: unit.clone(), factor: 1.0 }
                }
                Op::Column(read) => known(&columns[read.column]),
                Op::Parameter(index) => known(&parameters[*index]),
                Op::Negate => pop(),
                Op::Call(function) => {
                    called(*function, &pop()).map_err(|(problem, help)| wrong(problem, help))?
                }
                Op::Add | Op::Subtract => {
                    let (b, a) = (pop(), pop());
                    match (a, b) {
                        (Part::Number(a), Part::Number(b)) => {
                            Part::Number(if *op == Op::Add { a + b } else { a - b })
                        }
                        (Part::Of { unit: a, .. }, Part::Of { unit: b, .. }) if a != b => {
                            return Err(wrong(
                                format!("{a} and {b} cannot be added"),
                                "are the parameters' units right? A unit that is left out fits everywhere",
                            ));
                        }
                        (Part::Of { unit, .. }, _) | (_, Part::Of { unit, .. }) => {
                            Part::Of { unit, factor: 1.0 }
                        }
                        _ => Part::Any,
                    }
                }
                Op::Multiply | Op::Divide => {
                    let (b, a) = (pop(), pop());
                    product(a, b, *op == Op::Divide)
                }
                Op::Power => {
                    let (b, a) = (pop(), pop());
                    match (a, b) {
                        (_, Part::Of { unit, .. }) if !unit.is_pure() => {
                            return Err(wrong(
                                format!("an exponent has no unit, and this one has {unit}"),
                                "divide it by a parameter of that unit",
                            ));
                        }
                        (Part::Number(a), Part::Number(b)) => Part::Number(a.powf(b)),
                        (Part::Of { unit, factor }, Part::Number(power)) => {
                            Part::Of { unit: Unit::default().times(&unit, power), factor: factor.powf(power) }
                        }
                        (Part::Of { unit, .. }, _) if !unit.is_pure() => {
                            return Err(wrong(
                                format!("a power of {unit} has a unit only where the exponent is a number"),
                                "divide the base by a parameter of its unit",
                            ));
                        }
                        (Part::Of { unit, .. }, _) => Part::Of { unit, factor: 1.0 },
                        _ => Part::Any,
                    }
                }
            };
            stack.push(next);
        }
        match stack.pop() {
            Some(Part::Of { unit, .. }) if unit != *wanted => {
                let end = self.places.iter().map(|p| p.end).max().unwrap_or(1);
                Err(FormulaError {
                    problem: format!("the formula gives {unit}, the effect is in {wanted}"),
                    help: Some(format!(
                        "give a parameter the unit that is missing ({}), or leave its unit out, which fits everywhere",
                        wanted.times(&unit, -1.0)
                    )),
                    offset: 0,
                    length: end,
                })
            }
            _ => Ok(()),
        }
    }
}

fn product(a: Part, b: Part, divided: bool) -> Part {
    let sign = if divided { -1.0 } else { 1.0 };
    match (a, b) {
        (Part::Number(a), Part::Number(b)) => Part::Number(a * b.powf(sign)),
        (Part::Of { unit, factor }, Part::Of { unit: other, factor: o }) => {
            Part::Of { unit: unit.times(&other, sign), factor: factor * o.powf(sign) }
        }
        (Part::Of { unit, factor }, Part::Number(n)) if is_pure(n) => {
            Part::Of { unit, factor: factor * n.powf(sign) }
        }
        (Part::Number(n), Part::Of { unit, factor }) if is_pure(n) => {
            Part::Of { unit: Unit::default().times(&unit, sign), factor: n * factor.powf(sign) }
        }
        _ => Part::Any,
    }
}

/// What a function gives; what it takes has no unit, or is an angle.
fn called(function: Function, argument: &Part) -> Result<Part, (String, &'static str)> {
    let pure = Part::Of { unit: Unit::default(), factor: 1.0 };
    let Part::Of { unit, factor } = argument else {
        let keeps = matches!(function, Function::Sqrt | Function::Abs);
        return Ok(if keeps { Part::Any } else { pure });
    };
    match function {
        Function::Abs => return Ok(argument.clone()),
        Function::Sqrt => {
            return Ok(Part::Of { unit: Unit::default().times(unit, 0.5), factor: factor.sqrt() });
        }
        Function::Step => return Ok(pure),
        Function::Sin | Function::Cos | Function::Tan => {
            let radians = *unit == Unit(vec![("rad".to_owned(), 1.0)]);
            let degrees = *unit == Unit(vec![("deg".to_owned(), 1.0)]);
            if radians || (degrees && (factor - 1f64.to_radians()).abs() < 1e-9) {
                return Ok(pure);
            }
            if degrees {
                return Err((
                    "an angle is taken in radians, and this one is in deg".to_owned(),
                    "multiply by pi / 180",
                ));
            }
        }
        Function::Tanh | Function::Exp | Function::Ln | Function::Log10 => {}
    }
    if unit.is_pure() {
        return Ok(pure);
    }
    Err((
        format!("a function takes a number without a unit, and this has {unit}"),
        "divide it by a parameter or a number of that unit, such as 600[s]",
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formula::parse;

    fn check(text: &str, a: &str, wanted: &str) -> Result<(), FormulaError> {
        let columns = ["x", "time_s", "temperature_c", "camera_roll_deg", "dose"];
        let formula = parse(text, &columns, &["a", "b"])?;
        let of = columns.map(Unit::of_column);
        let unit = |text: &str| Unit::parse(text).ok();
        formula.check_units(&of, &[unit(a), None], &unit(wanted).unwrap_or_default())
    }

    #[test]
    fn what_agrees_is_taken() {
        for (text, a) in [
            ("a * x", "arcsec"),
            ("a * (temperature_c - 20)", "arcsec / K"),
            ("a * time_s^2", "arcsec s^-2"),
            ("2 * pi * a * sin(camera_roll_deg * pi / 180)", "arcsec"),
            ("a * exp(-time_s / 600[s])", "arcsec"),
            // A number may stand for a quantity.
            ("a * exp(-time_s / 600)", "arcsec"),
            ("a * (time_s - 1800) / 1800", "arcsec"),
            ("a * sqrt(x^2 + x^2)", "arcsec"),
            // Of `dose` and `b` nothing is known.
            ("a * dose", "arcsec"),
            ("b * time_s * x", "arcsec"),
            ("a * step(time_s - 100[s])", "arcsec"),
            ("0", "arcsec"),
        ] {
            assert_eq!(check(text, a, "arcsec"), Ok(()), "{text}");
        }
    }

    #[test]
    fn what_does_not_is_pointed_at() {
        for (text, a, at, says) in [
            ("a * temperature_c", "arcsec", 0, "the formula gives K arcsec, the effect is in arcsec"),
            ("a * x + time_s", "arcsec", 6, "arcsec and s cannot be added"),
            ("a * exp(time_s)", "arcsec", 4, "and this has s"),
            ("a * sin(camera_roll_deg)", "arcsec", 4, "in radians"),
            ("a * x ^ time_s", "arcsec", 6, "an exponent has no unit"),
            ("a * x", "deg", 0, "the formula gives deg"),
            ("a * exp(-time_s / 600[K])", "arcsec", 4, "has s K^-1"),
        ] {
            let error = check(text, a, "arcsec").err().unwrap_or_else(|| panic!("{text} was taken"));
            assert!(error.offset == at && error.problem.contains(says), "{text}: {error:?}");
        }
        assert!(check("a * x / 3[s", "arcsec", "arcsec").is_err());
        assert!(Unit::parse("arcsec^x").is_err());
    }

    #[test]
    fn units_are_written_as_they_are_read() {
        assert_eq!(Unit::parse("arcsec / K").map(|u| u.to_string()), Ok("arcsec K^-1".into()));
        assert_eq!(Unit::parse("W m^-2"), Unit::parse("W / m^2"));
        assert_eq!(Unit::parse("1 / s").map(|u| u.to_string()), Ok("s^-1".into()));
    }
}
