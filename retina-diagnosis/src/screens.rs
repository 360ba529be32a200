//! Screens: what the errors still depend on, whatever the cause.

use rayon::prelude::*;
use retina_formats::TableKind;

use crate::data::Dataset;
use crate::flips::{Flips, p_values};
use crate::patterns::{LINEAR, TILTS, products};
use crate::score::{Frame, Score};

/// A screen and its score.
pub(crate) struct Screen {
    pub(crate) covariates: Vec<String>,
    pub(crate) score: Score,
}

/// Degree of the field's screen.
const FIELD_DEGREE: usize = 5;
/// Degree of the field's narrower screen: what is smooth shows more clearly among few columns.
const SMOOTH_DEGREE: usize = 3;
/// Half cycles over the ranks of time of what swings: shifts alone, beyond what the degrees above follow.
const SWINGS: std::ops::RangeInclusive<usize> = 4..=24;
/// Half cycles of the last band that is also tried linear in the place and as a keystone.
const SLOW: usize = 6;
/// Half cycles in a band; bands overlap by half.
const BAND: usize = 4;
/// Degree over the ranks of a covariate, for one and two components: the latter have four columns a degree.
const COVARIATE_DEGREE: [usize; 2] = [8, 4];
/// Most covariates of which pairs are screened.
const MOST_PAIRED: usize = 8;

/// Legendre's polynomials P_1, P_2, ... at a place.
fn polynomials(t: f64) -> impl Iterator<Item = f64> {
    let (mut now, mut next) = (1.0, t);
    (1u32..).map(move |n| {
        let n = f64::from(n);
        (now, next) = (next, ((2.0 * n + 1.0) * t * next - n * now) / (n + 1.0));
        now
    })
}

/// P_1..P_degree.
pub(crate) fn legendre(t: f64, degree: usize) -> Vec<f64> {
    polynomials(t).take(degree).collect()
}

/// Mid-ranks of values, -1 to 1: screens do not depend on how a covariate is scaled. Rows without a value have none.
pub(crate) fn ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).filter(|&row| !values[row].is_nan()).collect();
    order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
    let mut out = vec![f64::NAN; values.len()];
    let most = order.len().saturating_sub(1);
    let mut start = 0;
    while start < order.len() {
        let mut end = start + 1;
        while end < order.len() && values[order[end]] == values[order[start]] {
            end += 1;
        }
        let middle = 0.5 * (start + end - 1) as f64;
        for &row in &order[start..end] {
            out[row] = if most > 0 { 2.0 * middle / most as f64 - 1.0 } else { 0.0 };
        }
        start = end;
    }
    out
}

/// Names of the covariates that screens look at one by one: those that vary, without what another holds.
pub(crate) fn screened(data: &Dataset) -> Vec<&str> {
    const INNER: [&str; 9] = [
        "x",
        "y",
        "r",
        "camera_roll_deg",
        "lit",
        "per_irradiance",
        "ln_irradiance",
        "absolute_phase_deg",
        "level",
    ];
    let twice = if data.kind == TableKind::Points { "digital_count" } else { "" };
    data.covariates
        .iter()
        .filter(|c| c.varies() && !INNER.contains(&c.name.as_str()) && c.name != twice)
        .map(|c| c.name.as_str())
        .collect()
}

/// P_1..P_degree of values, a column each; rows without a value have 0.
fn legendre_columns(values: &[f64], degree: usize) -> Vec<Vec<f64>> {
    let mut out = vec![vec![0.0; values.len()]; degree];
    for (row, t) in values.iter().enumerate().filter(|(_, t)| !t.is_nan()) {
        out.iter_mut().zip(polynomials(*t)).for_each(|(column, value)| column[row] = value);
    }
    out
}

/// What a screen's columns are made of. A covariate is its number among those that are screened.
#[derive(Clone, Copy)]
enum Kind {
    /// Polynomials of a covariate, or harmonics of a phase.
    Covariate(usize),
    /// Polynomials over the field up to a degree.
    Field(usize),
    /// Swings in time of so many half cycles, first and last: of all points alike, or with the place.
    Swings(usize, usize),
    PlacedSwings(usize, usize),
    /// Polynomials over the field that change with a covariate.
    FieldTimes(usize),
    /// What is linear in the place and in a covariate.
    LinearTimes(usize),
    /// The product of two covariates.
    Product(usize, usize),
}

/// The screens of a table: what they are made of, and their columns where they are asked for.
struct Definitions<'d> {
    data: &'d Dataset,
    names: Vec<&'d str>,
    /// Ranks of each covariate.
    ranked: Vec<Vec<f64>>,
    /// P_0, P_1, ... of x and of y, for points.
    along: [Vec<Vec<f64>>; 2],
}

impl<'d> Definitions<'d> {
    fn of(data: &'d Dataset) -> Self {
        let names = screened(data);
        let ranked = names.par_iter().map(|name| ranks(data.values(name))).collect();
        let of_axis = |values: &[f64]| {
            let scaled: Vec<f64> = values.iter().map(|v| v / 1.3).collect();
            let mut out = vec![vec![1.0; values.len()]];
            out.extend(legendre_columns(&scaled, FIELD_DEGREE));
            out
        };
        let along = match data.kind.components() {
            1 => [Vec::new(), Vec::new()],
            _ => ["x", "y"].map(|axis| of_axis(data.values(axis))),
        };
        Self { data, names, ranked, along }
    }

    fn is_phase(&self, covariate: usize) -> bool {
        self.names[covariate].contains("_phase_")
    }

    fn kinds(&self) -> Vec<Kind> {
        let covariates = 0..self.names.len();
        let mut out: Vec<Kind> = covariates.clone().map(Kind::Covariate).collect();
        if self.data.kind.components() == 2 {
            out.extend([FIELD_DEGREE, SMOOTH_DEGREE].map(Kind::Field));
            if self.names.contains(&"time_s") {
                // A swing that is faster than every second group is not told from another.
                let most = (*SWINGS.end()).min(self.data.groups.len() / 2);
                let last = |first: usize| (first + BAND - 1).min(most);
                // A swing of any phase lies in a few neighbours: bands of these show it among few columns.
                let bands = (*SWINGS.start()..=most).step_by(BAND / 2);
                out.extend(bands.map(|first| Kind::Swings(first, last(first))));
                // Slow ones that are linear in the place, or a keystone.
                let slow = (1..=SLOW.min(most)).step_by(BAND / 2);
                out.extend(slow.map(|first| Kind::PlacedSwings(first, last(first))));
            }
            for covariate in covariates.filter(|&covariate| !self.is_phase(covariate)) {
                out.extend([Kind::FieldTimes(covariate), Kind::LinearTimes(covariate)]);
            }
        }
        for i in 0..self.names.len().min(MOST_PAIRED) {
            out.extend((0..i).map(|j| Kind::Product(i, j)));
        }
        out
    }

    /// Names of the columns that a screen is over.
    fn covariates(&self, kind: Kind) -> Vec<String> {
        let names: &[&str] = match kind {
            Kind::Covariate(k) | Kind::LinearTimes(k) => &[self.names[k]],
            Kind::Field(_) => &["x", "y"],
            Kind::Swings(..) => &["time_s"],
            Kind::PlacedSwings(..) => &["time_s", "x", "y"],
            Kind::FieldTimes(k) => &[self.names[k], "x", "y"],
            Kind::Product(i, j) => &[self.names[j], self.names[i]],
        };
        names.iter().map(|name| (*name).to_owned()).collect()
    }

    fn columns(&self, kind: Kind) -> Vec<Vec<f64>> {
        let on_axes = |values: Vec<f64>| on_axes(&values);
        match kind {
            Kind::Covariate(k) if self.is_phase(k) => {
                let harmonic = |harmonic: f64| {
                    let angles = self.data.values(self.names[k]).iter();
                    let angles: Vec<f64> = angles.map(|v| std::f64::consts::TAU * harmonic * v).collect();
                    [f64::sin, f64::cos].map(|of| angles.iter().copied().map(of).collect())
                };
                [1.0, 2.0, 3.0].into_iter().flat_map(harmonic).flat_map(on_axes).collect()
            }
            Kind::Covariate(k) => {
                let degree = COVARIATE_DEGREE[self.data.kind.components() - 1];
                let basis = legendre_columns(&self.ranked[k], degree);
                basis.iter().flat_map(|values| self.shaped(values)).collect()
            }
            Kind::Field(degree) => self.field(degree).flat_map(on_axes).collect(),
            Kind::Swings(first, last) => (first..=last).map(|k| self.swing(k)).flat_map(on_axes).collect(),
            Kind::PlacedSwings(first, last) => {
                let band: Vec<Vec<f64>> = (first..=last).map(|k| self.swing(k)).collect();
                products(self.data, &[&LINEAR[2..], &TILTS].concat(), &band)
            }
            Kind::FieldTimes(k) => {
                // The middle step sees what changes at once.
                let forms: [fn(f64) -> f64; 3] = [|t| t, |t| 1.5 * t * t - 0.5, f64::signum];
                let low: Vec<Vec<f64>> = self.field(3).collect();
                let times = |form: fn(f64) -> f64| {
                    let own: Vec<f64> = self.ranked[k].iter().map(|t| form(*t)).collect();
                    low.iter().map(|values| product(values, &own)).collect::<Vec<_>>()
                };
                forms.into_iter().flat_map(times).flat_map(on_axes).collect()
            }
            Kind::LinearTimes(k) => {
                let rank = &self.ranked[k];
                let placed = self.field(1).map(|values| product(&values, rank));
                std::iter::once(rank.clone()).chain(placed).flat_map(on_axes).collect()
            }
            Kind::Product(i, j) => {
                let both = |(a, b): (&f64, &f64)| if (a * b).is_nan() { 0.0 } else { a * b };
                let values: Vec<f64> = self.ranked[i].iter().zip(&self.ranked[j]).map(both).collect();
                self.shaped(&values)
            }
        }
    }

    /// A function of the row along each axis, and for points also along and across the radius.
    fn shaped(&self, values: &[f64]) -> Vec<Vec<f64>> {
        if self.data.kind.components() == 1 {
            return vec![values.to_vec()];
        }
        let (x, y) = (self.data.values("x"), self.data.values("y"));
        let make = |of: &dyn Fn(usize) -> [f64; 2]| (0..values.len()).flat_map(of).collect::<Vec<f64>>();
        vec![
            make(&|i| [values[i], 0.0]),
            make(&|i| [0.0, values[i]]),
            make(&|i| [x[i] * values[i], y[i] * values[i]]),
            make(&|i| [-y[i] * values[i], x[i] * values[i]]),
        ]
    }

    /// Products of polynomials of x and y, of degrees 1 to `degree` together.
    fn field(&self, degree: usize) -> impl Iterator<Item = Vec<f64>> {
        let [x, y] = &self.along;
        let of_total = move |total: usize| (0..=total).map(move |i| product(&x[i], &y[total - i]));
        (1..=degree).flat_map(of_total)
    }

    /// A cosine of so many half cycles over the ranks of time.
    fn swing(&self, half_cycles: usize) -> Vec<f64> {
        let Some(time) = self.names.iter().position(|name| *name == "time_s") else { return Vec::new() };
        let half_cycles = std::f64::consts::FRAC_PI_2 * half_cycles as f64;
        self.ranked[time].iter().map(|t| (half_cycles * (t + 1.0)).cos()).collect()
    }
}

fn product(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a * b).collect()
}

/// Values along x, and the same along y.
fn on_axes(values: &[f64]) -> [Vec<f64>; 2] {
    [values.iter().flat_map(|v| [*v, 0.0]).collect(), values.iter().flat_map(|v| [0.0, *v]).collect()]
}

/// Scores of all screens beside a frame's base.
pub(crate) fn screens(frame: &Frame<'_>) -> Vec<Screen> {
    let definitions = Definitions::of(frame.data);
    let kinds = definitions.kinds();
    let scores = frame.scores_of(&kinds, |kind| definitions.columns(*kind));
    kinds
        .into_iter()
        .zip(scores)
        .filter(|(_, score)| score.rank() > 0)
        .map(|(kind, score)| Screen { covariates: definitions.covariates(kind), score })
        .collect()
}

/// Columns of the screens over these covariates.
pub(crate) fn columns_of(data: &Dataset, covariates: &[String]) -> Vec<Vec<f64>> {
    let definitions = Definitions::of(data);
    let own = definitions.kinds().into_iter().filter(|kind| definitions.covariates(*kind) == covariates);
    own.flat_map(|kind| definitions.columns(kind)).collect()
}

/// p-values of screens, corrected for their number.
pub(crate) fn screen_p_values(screens: &[Screen], flips: &Flips) -> Vec<f64> {
    let scores: Vec<Vec<&Score>> = screens.iter().map(|screen| vec![&screen.score]).collect();
    p_values(&scores, flips)
}

#[cfg(test)]
mod tests {
    /// P_2(0.5) = -0.125, P_3(0.5) = -0.4375, P_4(0.5) = -0.2890625 (Abramowitz and Stegun, table 22.9).
    #[test]
    fn legendres_polynomials() {
        assert_eq!(super::legendre(0.5, 4), [0.5, -0.125, -0.4375, -0.289_062_5]);
    }
}
