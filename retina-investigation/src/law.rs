//! Laws: functions of one column, each with up to two shape parameters that are no amplitudes.

use std::f64::consts::TAU;

use crate::columns::{Column, Content};

/// A function of a column u. Shape parameters have the column's unit, but for the power's exponent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Law {
    /// (u - u0) / H, H half the column's range.
    Linear,
    /// ((u - u0) / H)^2.
    Square,
    /// ((u - u0) / H)^3.
    Cubic,
    /// (u / U)^p of a column that is above 0, U its largest value, or 1 where the column has no unit.
    Power,
    /// ln(u / U).
    Logarithm,
    /// exp(-(u - u_least) / tau).
    Decay,
    /// exp((u - u_most) / tau).
    Growth,
    /// v / (v + s), v = u or, where u begins above 0, what it is above that.
    Saturation,
    /// tanh((u - u0) / w).
    Edge,
    /// 0 below u0, 1 above.
    Step,
    /// exp(-((u - u0) / w)^2).
    Bump,
    /// sin and cos of 2 pi u / P.
    Periodic,
    /// 0 below u0, (u - u0) / H above.
    Hinge,
    /// |u - u0| / H.
    Absolute,
}

/// How a search moves a shape parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Move {
    /// By a difference.
    By(f64),
    /// By a factor.
    Times(f64),
}

/// A law's shape parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Shape {
    pub(crate) name: &'static str,
    /// Whether it has the column's unit.
    pub(crate) has_unit: bool,
    /// Whether a formula has a derivative by it.
    pub(crate) smooth: bool,
}

const fn shape(name: &'static str) -> Shape {
    Shape { name, has_unit: true, smooth: true }
}

const PLACE: [Shape; 1] = [shape("place")];
const PLACE_WIDTH: [Shape; 2] = [shape("place"), shape("width")];
const EXPONENT: [Shape; 1] = [Shape { name: "exponent", has_unit: false, smooth: true }];
const JUMP: [Shape; 1] = [Shape { name: "place", has_unit: true, smooth: false }];
const CONSTANT: [Shape; 1] = [shape("constant")];
const PERIOD: [Shape; 1] = [shape("period")];
const HALF_AT: [Shape; 1] = [shape("half_at")];

impl Law {
    /// All laws.
    pub(crate) const ALL: [Self; 14] = [
        Self::Linear,
        Self::Square,
        Self::Cubic,
        Self::Power,
        Self::Logarithm,
        Self::Decay,
        Self::Growth,
        Self::Saturation,
        Self::Edge,
        Self::Step,
        Self::Bump,
        Self::Periodic,
        Self::Hinge,
        Self::Absolute,
    ];

    /// Its shape parameters.
    pub(crate) fn shapes(self) -> &'static [Shape] {
        match self {
            Self::Linear | Self::Square | Self::Cubic | Self::Hinge | Self::Absolute => &PLACE,
            Self::Power => &EXPONENT,
            Self::Logarithm => &[],
            Self::Decay | Self::Growth => &CONSTANT,
            Self::Saturation => &HALF_AT,
            Self::Edge | Self::Bump => &PLACE_WIDTH,
            Self::Step => &JUMP,
            Self::Periodic => &PERIOD,
        }
    }

    /// Its shape parameters at which a search begins; none where the law does not fit the column.
    pub(crate) fn starts(self, column: &Column) -> Vec<Vec<f64>> {
        let (low, half) = (column.low, column.half());
        let at = |share: f64| low + 2.0 * half * share;
        let one = |values: &[f64]| values.iter().map(|v| vec![*v]).collect::<Vec<_>>();
        let places = |shares: &[f64]| one(&shares.iter().map(|s| at(*s)).collect::<Vec<f64>>());
        match (column.content, self) {
            // A fraction of a pixel repeats itself; a colour is there or not.
            (Content::Phase, Self::Periodic) => one(&[1.0, 0.5, 1.0 / 3.0]),
            (Content::Switch, Self::Linear) => vec![Vec::new()],
            (Content::Phase | Content::Switch, _) => Vec::new(),
            (Content::Few, Self::Linear) => places(&[0.5]),
            (Content::Few, Self::Power) if low > 0.0 => one(&[-1.0, 1.0, 2.0]),
            // Delays are many, and a law of one more shape would fit what a shorter or longer delay does.
            (Content::Lagged, Self::Linear) => places(&[0.0, 0.5, 1.0]),
            (Content::Few | Content::Lagged, _) => Vec::new(),
            (Content::Number, law) => match law {
                Self::Linear => places(&[0.0, 0.5, 1.0]),
                Self::Square => places(&[0.0, 0.25, 0.5, 0.75, 1.0]),
                Self::Cubic => places(&[0.5]),
                // Zero of a temperature in Celsius is no zero of anything.
                Self::Power | Self::Logarithm | Self::Saturation if !column.has_zero() => Vec::new(),
                Self::Power if low >= 0.0 => {
                    let all = [-2.0, -1.0, -0.5, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0];
                    // Nothing has a negative power of 0.
                    one(if low > 1e-3 * column.high { &all } else { &all[3..] })
                }
                Self::Logarithm if low > 0.0 => vec![Vec::new()],
                Self::Decay | Self::Growth => one(&[0.1, 0.25, 0.6, 1.5].map(|s| s * half)),
                Self::Saturation if low >= 0.0 => one(&[0.01, 0.03, 0.1, 0.3, 1.0].map(|s| s * 2.0 * half)),
                Self::Edge | Self::Bump => [0.15, 0.3, 0.5, 0.7, 0.85]
                    .iter()
                    .flat_map(|p| [0.15, 0.45].map(|w| vec![at(*p), w * half]))
                    .collect(),
                Self::Step => (1..12).map(|k| vec![at(f64::from(k) / 12.0)]).collect(),
                Self::Periodic => (1..24).map(|k| vec![4.0 * half / f64::from(k + 1)]).collect(),
                Self::Hinge => places(&[0.2, 0.35, 0.5, 0.65, 0.8]),
                Self::Absolute => places(&[0.35, 0.5, 0.65]),
                Self::Power | Self::Logarithm | Self::Saturation => Vec::new(),
            },
        }
    }

    /// How a search moves its shape parameters at first.
    pub(crate) fn moves(self, column: &Column) -> Vec<Move> {
        let half = column.half();
        match self {
            Self::Linear | Self::Square | Self::Cubic | Self::Absolute | Self::Hinge => {
                vec![Move::By(0.2 * half)]
            }
            Self::Power => vec![Move::By(0.4)],
            Self::Logarithm => Vec::new(),
            Self::Decay | Self::Growth | Self::Saturation => vec![Move::Times(1.6)],
            Self::Edge | Self::Bump => vec![Move::By(0.15 * half), Move::Times(1.6)],
            Self::Step => vec![Move::By(0.1 * half)],
            Self::Periodic if column.content == Content::Phase => Vec::new(),
            Self::Periodic => vec![Move::Times(1.03)],
        }
    }

    /// Whether shape parameters are within what the column can show.
    pub(crate) fn allows(self, shape: &[f64], column: &Column) -> bool {
        if shape.is_empty() {
            return true;
        }
        let half = column.half();
        let inside = |place: f64| (column.low..=column.high).contains(&place);
        match self {
            Self::Linear | Self::Square | Self::Cubic => (shape[0] - column.middle()).abs() <= 3.0 * half,
            Self::Power => (-4.0..=8.0).contains(&shape[0]) && (shape[0] > 0.0 || column.low > 0.0),
            Self::Logarithm => true,
            Self::Decay | Self::Growth => (0.01 * half..=20.0 * half).contains(&shape[0]),
            Self::Saturation => (1e-4 * half..=20.0 * half).contains(&shape[0]),
            Self::Edge | Self::Bump => inside(shape[0]) && (0.02 * half..=2.0 * half).contains(&shape[1]),
            Self::Step | Self::Hinge | Self::Absolute => inside(shape[0]),
            // A swing faster than the groups is not told from another.
            Self::Periodic => {
                column.content == Content::Phase || (0.1 * half..=6.0 * half).contains(&shape[0])
            }
        }
    }

    /// How much it says beyond a straight line.
    pub(crate) fn cost(self) -> usize {
        match self {
            Self::Linear => 1,
            Self::Edge | Self::Bump | Self::Periodic => 3,
            _ => 2,
        }
    }

    /// Its columns: one, of a periodic law two.
    pub(crate) fn width(self) -> usize {
        if self == Self::Periodic { 2 } else { 1 }
    }

    /// Its values where the column is `u`; the second of a periodic law alone.
    pub(crate) fn value(self, u: f64, shape: &[f64], column: &Column) -> [f64; 2] {
        let half = column.half();
        let one = |value: f64| [value, 0.0];
        match self {
            Self::Linear => one((u - shape.first().unwrap_or(&0.0)) / column.unit_length()),
            Self::Square => one(((u - shape[0]) / half).powi(2)),
            Self::Cubic => one(((u - shape[0]) / half).powi(3)),
            Self::Power => one((u / column.reference()).powf(shape[0])),
            Self::Logarithm => one((u / column.reference()).ln()),
            Self::Decay => one((-(u - column.low) / shape[0]).exp()),
            Self::Growth => one(((u - column.high) / shape[0]).exp()),
            Self::Saturation => {
                let v = u - column.origin();
                one(v / (v + shape[0]))
            }
            Self::Edge => one(((u - shape[0]) / shape[1]).tanh()),
            Self::Step => one(f64::from(u8::from(u > shape[0]))),
            Self::Bump => one((-((u - shape[0]) / shape[1]).powi(2)).exp()),
            Self::Periodic => {
                let (sin, cos) = (TAU * (u - column.wave_origin()) / shape[0]).sin_cos();
                [sin, cos]
            }
            Self::Hinge => one((u - shape[0]).max(0.0) / half),
            Self::Absolute => one((u - shape[0]).abs() / half),
        }
    }

    /// The same as text; `shape` has the parameters' names, or their values with units.
    pub(crate) fn text(self, shape: &[String], column: &Column) -> Vec<String> {
        let u = &column.text;
        let half = column.quantity(column.half());
        let first = || shape.first().map_or("", String::as_str);
        let off = || format!("({u} - {})", first());
        let over_reference = || match column.reference() {
            1.0 => u.clone(),
            reference => format!("({u} / {})", column.quantity(reference)),
        };
        vec![match self {
            Self::Linear if column.content == Content::Switch => u.clone(),
            Self::Linear => format!("({} / {})", off(), column.quantity(column.unit_length())),
            Self::Square => format!("({} / {half})^2", off()),
            Self::Cubic => format!("({} / {half})^3", off()),
            Self::Power => format!("{}^{}", over_reference(), first()),
            Self::Logarithm => format!("ln({})", over_reference()),
            Self::Decay => format!("exp(-({u} - {}) / {})", column.quantity(column.low), first()),
            Self::Growth => format!("exp(({u} - {}) / {})", column.quantity(column.high), first()),
            Self::Saturation => {
                let v = match column.origin() {
                    0.0 => u.clone(),
                    origin => format!("({u} - {})", column.quantity(origin)),
                };
                format!("({v} / ({v} + {}))", first())
            }
            Self::Edge => format!("tanh({} / {})", off(), shape[1]),
            Self::Step => format!("step({u} - {})", first()),
            Self::Bump => format!("exp(-({} / {})^2)", off(), shape[1]),
            Self::Periodic => {
                let u = match column.wave_origin() {
                    0.0 => u.clone(),
                    origin => format!("({u} - {})", column.quantity(origin)),
                };
                return ["sin", "cos"].map(|f| format!("{f}(2 * pi * {u} / {})", first())).to_vec();
            }
            Self::Hinge => format!("(0.5 * ({} + abs({u} - {})) / {half})", off(), first()),
            Self::Absolute => format!("(abs({u} - {}) / {half})", first()),
        }]
    }
}
