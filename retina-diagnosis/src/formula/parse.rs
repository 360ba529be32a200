//! Text to operations, by precedence climbing; errors know their place.

use std::ops::Range;

use retina_files::nearest;

use super::units::Unit;
use crate::following::{lag_name, of_lag_name};

use super::{FUNCTIONS, Formula, Op, Read};

/// What does not fit, and where in the formula (bytes).
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct FormulaError {
    pub(crate) problem: String,
    pub(crate) help: Option<String>,
    pub(crate) offset: usize,
    pub(crate) length: usize,
}

struct Parser<'t> {
    text: &'t str,
    at: usize,
    columns: &'t [&'t str],
    parameters: &'t [&'t str],
    ops: Vec<Op>,
    places: Vec<Range<usize>>,
    depth: usize,
}

/// The function of a column that follows it with a delay: `lag(temperature_c, 900[s])`.
const LAG: &str = "lag";

/// What stands before and behind a column's name that could be read as something else: `` `rel. humidity` ``.
const QUOTE: char = '`';

/// Whether a column's name needs no quotes in formulas.
fn is_plain(name: &str) -> bool {
    let first = name.chars().next();
    let taken = |name: &str| name == LAG || name == "pi" || FUNCTIONS.iter().any(|(n, _)| *n == name);
    first.is_some_and(|c| c.is_alphabetic() || c == '_')
        && name.chars().all(|c| c.is_alphanumeric() || c == '_')
        && !taken(name)
}

/// A column's name as formulas write it; `None` of one that has a backquote itself.
pub fn column_text(name: &str) -> Option<String> {
    if let Some((column, tau_s)) = of_lag_name(name) {
        return Some(lag_name(&column_text(column)?, tau_s));
    }
    match is_plain(name) {
        true => Some(name.to_owned()),
        false => (!name.contains(QUOTE)).then(|| format!("{QUOTE}{name}{QUOTE}")),
    }
}

/// Deepest nesting: a limit that no honest formula meets keeps the stack whole.
const DEEPEST: usize = 100;

/// Parses a formula over columns and parameters.
pub(crate) fn parse(text: &str, columns: &[&str], parameters: &[&str]) -> Result<Formula, FormulaError> {
    let mut parser =
        Parser { text, at: 0, columns, parameters, ops: Vec::new(), places: Vec::new(), depth: 0 };
    parser.sum()?;
    match parser.peek() {
        None => Ok(Formula { ops: parser.ops, places: parser.places }),
        Some(_) => Err(parser.wrong("an operator is expected here", 1)),
    }
}

impl Parser<'_> {
    fn peek(&mut self) -> Option<char> {
        let rest = &self.text[self.at..];
        self.at += rest.len() - rest.trim_start().len();
        self.text[self.at..].chars().next()
    }

    fn push(&mut self, op: Op, place: Range<usize>) {
        self.ops.push(op);
        self.places.push(place);
    }

    /// Past a sign, and where it was.
    fn symbol(&mut self) -> Range<usize> {
        self.at += 1;
        self.at - 1..self.at
    }

    fn wrong(&self, problem: &str, length: usize) -> FormulaError {
        FormulaError { problem: problem.to_owned(), help: None, offset: self.at, length }
    }

    fn sum(&mut self) -> Result<(), FormulaError> {
        self.depth += 1;
        if self.depth > DEEPEST {
            return Err(self.wrong("the formula is nested too deeply", 1));
        }
        self.product()?;
        while let Some(sign @ ('+' | '-')) = self.peek() {
            let place = self.symbol();
            self.product()?;
            self.push(if sign == '+' { Op::Add } else { Op::Subtract }, place);
        }
        self.depth -= 1;
        Ok(())
    }

    fn product(&mut self) -> Result<(), FormulaError> {
        self.signed()?;
        while let Some(sign @ ('*' | '/')) = self.peek() {
            let place = self.symbol();
            self.signed()?;
            self.push(if sign == '*' { Op::Multiply } else { Op::Divide }, place);
        }
        Ok(())
    }

    /// -a ^ b is -(a ^ b).
    fn signed(&mut self) -> Result<(), FormulaError> {
        self.depth += 1;
        if self.depth > DEEPEST {
            return Err(self.wrong("the formula is nested too deeply", 1));
        }
        if self.peek() == Some('-') {
            let place = self.symbol();
            self.signed()?;
            self.push(Op::Negate, place);
        } else {
            self.operand()?;
            if self.peek() == Some('^') {
                let place = self.symbol();
                self.signed()?;
                self.push(Op::Power, place);
            }
        }
        self.depth -= 1;
        Ok(())
    }

    fn operand(&mut self) -> Result<(), FormulaError> {
        match self.peek() {
            Some('(') => {
                self.at += 1;
                self.sum()?;
                self.closed()
            }
            Some(c) if c.is_ascii_digit() || c == '.' => self.number(),
            Some(c) if c.is_alphabetic() || c == '_' => self.name(),
            Some(QUOTE) => {
                let (column, place) = self.column()?;
                self.push(Op::Column(Read { column, lag_s: None }), place);
                Ok(())
            }
            _ => Err(self.wrong("a number, a name or `(` is expected here", 1)),
        }
    }

    fn closed(&mut self) -> Result<(), FormulaError> {
        if self.peek() != Some(')') {
            return Err(self.wrong("`)` is expected here", 1));
        }
        self.at += 1;
        Ok(())
    }

    fn number(&mut self) -> Result<(), FormulaError> {
        let bytes = self.text.as_bytes();
        let mut end = self.at;
        while end < bytes.len() {
            let exponent =
                matches!(bytes[end], b'+' | b'-') && matches!(bytes[end - 1], b'e' | b'E') && end > self.at;
            if !(bytes[end].is_ascii_digit() || matches!(bytes[end], b'.' | b'e' | b'E') || exponent) {
                break;
            }
            end += 1;
        }
        let value: f64 = self.text[self.at..end]
            .parse()
            .ok()
            .filter(|v: &f64| v.is_finite())
            .ok_or_else(|| self.wrong("is not a finite number", end - self.at))?;
        let start = self.at;
        self.at = end;
        self.push(Op::Number(value), start..end);
        self.unit()
    }

    /// A unit in brackets behind a number.
    fn unit(&mut self) -> Result<(), FormulaError> {
        if !self.text[self.at..].starts_with('[') {
            return Ok(());
        }
        let start = self.at;
        let Some(length) = self.text[start..].find(']') else {
            return Err(self.wrong("`]` is missing behind the unit", self.text.len() - start));
        };
        let unit = Unit::parse(&self.text[start + 1..start + length])
            .map_err(|problem| self.wrong(&problem, length + 1))?;
        self.at = start + length + 1;
        self.push(Op::Unit(unit), start..start + length + 1);
        Ok(())
    }

    /// A column's name, in quotes or without, and its place.
    fn column(&mut self) -> Result<(usize, Range<usize>), FormulaError> {
        let rest = &self.text[self.at..];
        let (name, length) = match rest.strip_prefix(QUOTE) {
            Some(quoted) => {
                let Some(end) = quoted.find(QUOTE) else {
                    return Err(
                        self.wrong("a second backquote is missing behind the column's name", rest.len())
                    );
                };
                (&quoted[..end], end + 2 * QUOTE.len_utf8())
            }
            None => {
                let length = rest.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(rest.len());
                (&rest[..length], length)
            }
        };
        let Some(column) = self.columns.iter().position(|column| *column == name) else {
            let mut error = self.wrong(&format!("`{name}` is no column"), length.max(1));
            error.help = Some(match nearest(name, self.columns.iter().copied()) {
                Some(near) => format!("did you mean `{near}`?"),
                None => format!("columns here: {}", self.columns.join(", ")),
            });
            return Err(error);
        };
        let place = self.at..self.at + length;
        self.at += length;
        Ok((column, place))
    }

    fn name(&mut self) -> Result<(), FormulaError> {
        let rest = &self.text[self.at..];
        let length = rest.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(rest.len());
        let name = &rest[..length];
        let find = |names: &[&str]| names.iter().position(|n| *n == name);
        if let Some((_, function)) = FUNCTIONS.iter().find(|(n, _)| *n == name) {
            let place = self.at..self.at + length;
            self.at += length;
            if self.peek() != Some('(') {
                return Err(self.wrong("`(` is expected here: a function's argument", 1));
            }
            self.at += 1;
            self.sum()?;
            self.closed()?;
            self.push(Op::Call(*function), place);
            return Ok(());
        }
        if name == LAG && rest[length..].trim_start().starts_with('(') {
            return self.lag();
        }
        let op = match (find(self.parameters), find(self.columns)) {
            (Some(index), _) => Op::Parameter(index),
            (None, Some(column)) => Op::Column(Read { column, lag_s: None }),
            (None, None) if name == "pi" => Op::Number(std::f64::consts::PI),
            (None, None) => {
                let functions = FUNCTIONS.iter().map(|(n, _)| n).chain([&LAG]);
                let known = self.parameters.iter().chain(self.columns).chain(functions);
                let near = nearest(name, known.copied()).map(|near| format!("did you mean `{near}`?"));
                let all = || format!("columns here: {}", self.columns.join(", "));
                let mut error = self.wrong(&format!("`{name}` is neither a column nor a parameter"), length);
                error.help = Some(near.unwrap_or_else(all));
                return Err(error);
            }
        };
        self.push(op, self.at..self.at + length);
        self.at += length;
        Ok(())
    }

    /// A column and the time constant of what follows it. The time is a number: lagged values are made before a fit.
    fn lag(&mut self) -> Result<(), FormulaError> {
        let start = self.at;
        self.at += LAG.len();
        let expected = |mut error: FormulaError| {
            error.help = Some("such as lag(temperature_c, 900[s])".to_owned());
            error
        };
        self.peek();
        self.at += 1;
        self.peek();
        let (column, place) = self.column().map_err(|error| {
            expected(FormulaError {
                problem: "a column is expected here: what is followed".to_owned(),
                ..error
            })
        })?;
        if !self.columns.contains(&"time_s") {
            self.at = place.start;
            return Err(
                self.wrong("a lag needs the table's column `time_s`, which is not there", place.len())
            );
        }
        if self.peek() != Some(',') {
            return Err(expected(self.wrong("`,` is expected here, and a time constant behind it", 1)));
        }
        self.at += 1;
        let number = self.peek().is_some_and(|c| c.is_ascii_digit() || c == '.');
        let time = self.at;
        if !number {
            return Err(expected(self.wrong("a time constant is a number: it is not fitted", 1)));
        }
        let before = self.ops.len();
        self.number()?;
        let seconds = match &self.ops[before..] {
            [Op::Number(value)] => Some(*value),
            [Op::Number(value), Op::Unit(unit)] if *unit == Unit::of_column("time_s").unwrap_or_default() => {
                Some(*value)
            }
            _ => None,
        };
        self.ops.truncate(before);
        self.places.truncate(before);
        let Some(lag_s) = seconds.filter(|seconds| *seconds > 0.0) else {
            let length = self.at - time;
            self.at = time;
            return Err(expected(self.wrong("a time constant is above 0 and in s", length)));
        };
        self.closed()?;
        self.push(Op::Column(Read { column, lag_s: Some(lag_s) }), start..self.at);
        Ok(())
    }
}
