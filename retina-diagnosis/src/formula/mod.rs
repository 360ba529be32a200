//! Formulas over columns and parameters, with their derivatives by the parameters.

mod parse;
mod units;

use std::ops::Range;

pub use parse::column_text;
pub(crate) use parse::{FormulaError, parse};
pub(crate) use units::Unit;

/// A function of one argument.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Function {
    Sin,
    Cos,
    Tan,
    Tanh,
    Exp,
    Ln,
    Log10,
    Sqrt,
    Abs,
    Step,
}

pub(crate) const FUNCTIONS: [(&str, Function); 10] = [
    ("sin", Function::Sin),
    ("cos", Function::Cos),
    ("tan", Function::Tan),
    ("tanh", Function::Tanh),
    ("exp", Function::Exp),
    ("ln", Function::Ln),
    ("log10", Function::Log10),
    ("sqrt", Function::Sqrt),
    ("abs", Function::Abs),
    ("step", Function::Step),
];

/// What is done next; operands are taken off a stack.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Op {
    Number(f64),
    /// The number before it has this unit.
    Unit(Unit),
    Column(Read),
    Parameter(usize),
    Add,
    Subtract,
    Multiply,
    Divide,
    Power,
    Negate,
    Call(Function),
}

/// What is read of a table: a column as it is, or as something slow follows it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Read {
    /// Index of the column.
    pub(crate) column: usize,
    /// Time constant of what follows it; `None`: as it is.
    pub(crate) lag_s: Option<f64>,
}

/// A formula as a list of operations.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Formula {
    ops: Vec<Op>,
    /// For each operation: the bytes of the text that ask for it.
    places: Vec<Range<usize>>,
}

/// A value with its derivatives by the parameters.
#[derive(Clone)]
struct Dual {
    value: f64,
    slope: Vec<f64>,
}

impl Dual {
    fn chained(mut self, value: f64, factor: f64) -> Self {
        self.value = value;
        self.slope.iter_mut().for_each(|s| *s *= factor);
        self
    }

    fn combined(mut self, other: &Self, value: f64, own: f64, others: f64) -> Self {
        self.value = value;
        for (s, o) in self.slope.iter_mut().zip(&other.slope) {
            *s = own * *s + others * o;
        }
        self
    }
}

impl Formula {
    /// What it reads of the table.
    pub(crate) fn reads(&self) -> impl Iterator<Item = Read> {
        self.ops.iter().filter_map(|op| match op {
            Op::Column(read) => Some(*read),
            _ => None,
        })
    }

    /// Gives what it reads other indices; columns that lag are columns of their own then.
    pub(crate) fn renumber(&mut self, of: impl Fn(Read) -> usize) {
        for op in &mut self.ops {
            if let Op::Column(read) = op {
                *read = Read { column: of(*read), lag_s: None };
            }
        }
    }

    /// Value and derivatives by the parameters (forward differentiation: A. Griewank, A. Walther, Evaluating
    /// Derivatives, 2nd ed., ch. 3). `column` gives a value by its index.
    pub(crate) fn evaluate(&self, column: impl Fn(usize) -> f64, parameters: &[f64]) -> (f64, Vec<f64>) {
        let constant = |value| Dual { value, slope: vec![0.0; parameters.len()] };
        let mut stack: Vec<Dual> = Vec::new();
        for op in &self.ops {
            let next = match *op {
                Op::Number(value) => constant(value),
                Op::Unit(_) => continue,
                Op::Column(read) => constant(column(read.column)),
                Op::Parameter(index) => {
                    let mut dual = constant(parameters[index]);
                    dual.slope[index] = 1.0;
                    dual
                }
                Op::Negate => {
                    let a = pop(&mut stack);
                    let value = -a.value;
                    a.chained(value, -1.0)
                }
                Op::Call(function) => {
                    let a = pop(&mut stack);
                    let (value, slope) = call(function, a.value);
                    a.chained(value, slope)
                }
                Op::Add | Op::Subtract | Op::Multiply | Op::Divide | Op::Power => {
                    let (b, a) = (pop(&mut stack), pop(&mut stack));
                    let (value, own, others) = binary(op, a.value, b.value);
                    // 0 * infinity is none where a derivative is not asked for.
                    let others = if b.slope.iter().all(|s| *s == 0.0) { 0.0 } else { others };
                    a.combined(&b, value, own, others)
                }
            };
            stack.push(next);
        }
        let last = pop(&mut stack);
        (last.value, last.slope)
    }
}

/// The unit of a table's column, as formulas write it in brackets; `None` where it is a pure number or its name does not
/// tell.
pub fn unit_of_column(name: &str) -> Option<String> {
    Unit::of_column(name).filter(|unit| !unit.is_pure()).map(|unit| unit.to_string())
}

fn pop(stack: &mut Vec<Dual>) -> Dual {
    stack.pop().expect("the parser gives every operation its operands")
}

fn call(function: Function, a: f64) -> (f64, f64) {
    match function {
        Function::Sin => (a.sin(), a.cos()),
        Function::Cos => (a.cos(), -a.sin()),
        Function::Tan => (a.tan(), 1.0 + a.tan().powi(2)),
        Function::Tanh => (a.tanh(), 1.0 - a.tanh().powi(2)),
        Function::Exp => (a.exp(), a.exp()),
        Function::Ln => (a.ln(), 1.0 / a),
        Function::Log10 => (a.log10(), 1.0 / (a * std::f64::consts::LN_10)),
        Function::Sqrt => (a.sqrt(), 0.5 / a.sqrt()),
        Function::Abs => (a.abs(), a.signum()),
        Function::Step => (f64::from(u8::from(a > 0.0)), 0.0),
    }
}

/// Value, and its derivatives by the two operands.
fn binary(op: &Op, a: f64, b: f64) -> (f64, f64, f64) {
    match op {
        Op::Add => (a + b, 1.0, 1.0),
        Op::Subtract => (a - b, 1.0, -1.0),
        Op::Multiply => (a * b, b, a),
        Op::Divide => (a / b, 1.0 / b, -a / (b * b)),
        // a^0 is 1 and does not change with a, also at a = 0.
        _ if b == 0.0 => (1.0, 0.0, a.ln()),
        _ => (a.powf(b), b * a.powf(b - 1.0), a.powf(b) * a.ln()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(text: &str, columns: &[(&str, f64)], parameters: &[(&str, f64)]) -> (f64, Vec<f64>) {
        let c: Vec<&str> = columns.iter().map(|c| c.0).collect();
        let p: Vec<&str> = parameters.iter().map(|p| p.0).collect();
        let formula = parse(text, &c, &p).unwrap();
        let values: Vec<f64> = parameters.iter().map(|p| p.1).collect();
        formula.evaluate(|i| columns[i].1, &values)
    }

    /// Values and slopes by hand.
    #[test]
    fn values_and_derivatives() {
        assert_eq!(
            value("1 + 2 * 3 ^ 2 ^ 0.5 - -4 / 2", &[], &[]).0,
            1.0 + 2.0 * 3f64.powf(2f64.sqrt()) + 2.0
        );
        assert_eq!(value("-2 ^ 2", &[], &[]).0, -4.0);
        let (v, s) = value("a * exp(-t / tau)", &[("t", 2.0)], &[("a", 3.0), ("tau", 4.0)]);
        let e = (-0.5f64).exp();
        assert!((v - 3.0 * e).abs() < 1e-15 && (s[0] - e).abs() < 1e-15);
        assert!((s[1] - 3.0 * e * 2.0 / 16.0).abs() < 1e-15);
        let (v, s) = value("r ^ p", &[("r", 0.0)], &[("p", 2.0)]);
        assert!(
            v == 0.0 && s[0].is_nan(),
            "a power of 0 by its exponent has no derivative that a computer can tell"
        );
        assert_eq!(value("step(t - 1)", &[("t", 1.5)], &[]).0, 1.0);
    }

    #[test]
    fn a_lag_reads_a_column_with_a_time_constant() {
        let read = |text: &str| parse(text, &["temperature_c", "time_s"], &["a", "tau"]);
        let formula =
            read("a * lag( temperature_c , 9e2[s] ) + a * temperature_c + a * lag(time_s, 5)").unwrap();
        let reads: Vec<(usize, Option<f64>)> =
            formula.reads().map(|read| (read.column, read.lag_s)).collect();
        assert_eq!(reads, [(0, Some(900.0)), (0, None), (1, Some(5.0))]);
        for (text, offset) in [
            ("a * lag(temperature_c, tau)", 23),
            ("a * lag(temperature_c, 0[s])", 23),
            ("a * lag(temperature_c, 9[K])", 23),
            ("a * lag(temperature_c)", 21),
            ("a * lag(tau, 9[s])", 8),
            ("a * lag(temperature_c, 9[s]", 27),
        ] {
            assert_eq!(read(text).unwrap_err().offset, offset, "{text}");
        }
        assert!(parse("lag(x, 9[s])", &["x"], &[]).unwrap_err().problem.contains("time_s"));
    }

    /// Names that are no words, or those of functions, stand in backquotes.
    #[test]
    fn any_column_can_be_named() {
        for name in ["rel. humidity (%)", "exp", "2nd", "pi", "a, b", "lag"] {
            let text = column_text(name).unwrap();
            assert_eq!(text, format!("`{name}`"));
            let formula = parse(&format!("2 * {text}"), &[name, "time_s"], &[]).unwrap();
            assert_eq!(formula.evaluate(|_| 3.0, &[]).0, 6.0);
            let lagged = column_text(&crate::lag_name(name, 9.0)).unwrap();
            let reads = parse(&lagged, &[name, "time_s"], &[]).unwrap().reads().collect::<Vec<_>>();
            assert_eq!(reads, [Read { column: 0, lag_s: Some(9.0) }]);
        }
        assert_eq!(column_text("temperature_c").as_deref(), Some("temperature_c"));
        assert_eq!(column_text("a`b"), None);
        let wrong = |text: &str| parse(text, &["humidity"], &[]).unwrap_err();
        assert_eq!((wrong("1 + `humidty`").offset, wrong("1 + `humidty`").length), (4, 9));
        assert!(wrong("1 + `humidty`").help.unwrap().contains("`humidity`"));
        assert_eq!(wrong("1 + `humidity").offset, 4);
    }

    #[test]
    fn errors_point_at_the_character() {
        let at = |text: &str| parse(text, &["x"], &["a"]).unwrap_err();
        assert_eq!((at("a * (x + 1").offset, at("a * (x + 1").length), (10, 1));
        let unknown = at("a * xs");
        assert_eq!((unknown.offset, unknown.length), (4, 2));
        assert!(unknown.help.unwrap().contains("`x`"));
        assert_eq!(at("a * * x").offset, 4);
        assert_eq!(at("sin x").offset, 4);
        assert_eq!(at("2 x").offset, 2);
    }
}
