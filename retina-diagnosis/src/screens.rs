//! Screens: what the errors still depend on, whatever the cause.

use crate::data::Dataset;
use crate::flips::{Flips, p_values};
use crate::patterns::{LINEAR, TILTS, products};
use crate::score::{Frame, Score};
use retina_formats::TableKind;

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

/// Legendre's polynomials P_1..P_degree.
pub(crate) fn legendre(t: f64, degree: usize) -> Vec<f64> {
    let (mut before, mut now) = (1.0, t);
    let mut out = vec![t];
    for n in 1..degree {
        let n = n as f64;
        let next = ((2.0 * n + 1.0) * t * now - n * before) / (n + 1.0);
        (before, now) = (now, next);
        out.push(now);
    }
    out
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

/// Every screen's columns.
fn definitions(data: &Dataset) -> Vec<(Vec<String>, Vec<Vec<f64>>)> {
    let n = data.kind.components();
    let (x, y) = (data.values("x"), data.values("y"));
    let rows = data.len();
    let degree = COVARIATE_DEGREE[n - 1];
    // A function of the row along each axis, and for points also along and across the radius.
    let shaped = |values: &[f64]| -> Vec<Vec<f64>> {
        if n == 1 {
            return vec![values.to_vec()];
        }
        let make = |of: &dyn Fn(usize) -> [f64; 2]| (0..rows).flat_map(of).collect::<Vec<f64>>();
        vec![
            make(&|i| [values[i], 0.0]),
            make(&|i| [0.0, values[i]]),
            make(&|i| [x[i] * values[i], y[i] * values[i]]),
            make(&|i| [-y[i] * values[i], x[i] * values[i]]),
        ]
    };
    let on_axes = |values: &[f64]| -> [Vec<f64>; 2] {
        [values.iter().flat_map(|v| [*v, 0.0]).collect(), values.iter().flat_map(|v| [0.0, *v]).collect()]
    };
    let names = screened(data);
    let ranked: Vec<Vec<f64>> = names.iter().map(|name| ranks(data.values(name))).collect();
    let mut out = Vec::new();
    for (name, rank) in names.iter().zip(&ranked) {
        let mut columns = Vec::new();
        if name.contains("_phase_") {
            for harmonic in [1.0, 2.0, 3.0] {
                let angle = |v: &f64| std::f64::consts::TAU * harmonic * v;
                for values in [
                    data.values(name).iter().map(|v| angle(v).sin()).collect::<Vec<f64>>(),
                    data.values(name).iter().map(|v| angle(v).cos()).collect(),
                ] {
                    columns.extend(on_axes(&values));
                }
            }
        } else {
            let of = |t: &f64| if t.is_nan() { vec![0.0; degree] } else { legendre(*t, degree) };
            let basis: Vec<Vec<f64>> = rank.iter().map(of).collect();
            for k in 0..degree {
                columns.extend(shaped(&basis.iter().map(|b| b[k]).collect::<Vec<f64>>()));
            }
        }
        out.push((vec![(*name).to_owned()], columns));
    }
    if n == 2 {
        let of = |values: &[f64]| -> Vec<Vec<f64>> {
            values.iter().map(|v| [vec![1.0], legendre(v / 1.3, FIELD_DEGREE)].concat()).collect()
        };
        let (px, py) = (of(x), of(y));
        let field = |degree: usize| -> Vec<Vec<f64>> {
            let mut out = Vec::new();
            for total in 1..=degree {
                for i in 0..=total {
                    out.push((0..rows).map(|row| px[row][i] * py[row][total - i]).collect());
                }
            }
            out
        };
        for degree in [FIELD_DEGREE, SMOOTH_DEGREE] {
            out.push((vec!["x".into(), "y".into()], field(degree).iter().flat_map(|v| on_axes(v)).collect()));
        }
        if let Some(at) = names.iter().position(|name| *name == "time_s") {
            // A swing that is faster than every second group is not told from another.
            let most = (*SWINGS.end()).min(data.groups.len() / 2);
            let swing = |k: usize| -> Vec<f64> {
                let half_cycles = std::f64::consts::FRAC_PI_2 * k as f64;
                ranked[at].iter().map(|t| (half_cycles * (t + 1.0)).cos()).collect()
            };
            // A swing of any phase lies in a few neighbours: bands of these show it among few columns.
            for first in (*SWINGS.start()..=most).step_by(BAND / 2) {
                let columns = (first..=(first + BAND - 1).min(most)).flat_map(|k| on_axes(&swing(k)));
                out.push((vec!["time_s".to_owned()], columns.collect()));
            }
            // Slow ones that are linear in the place, or a keystone.
            let patterns = [&LINEAR[2..], &TILTS].concat();
            for first in (1..=SLOW.min(most)).step_by(BAND / 2) {
                let band: Vec<Vec<f64>> = (first..=(first + BAND - 1).min(most)).map(swing).collect();
                out.push((
                    vec!["time_s".to_owned(), "x".into(), "y".into()],
                    products(data, &patterns, &band),
                ));
            }
        }
        let low = field(3);
        for (name, rank) in names.iter().zip(&ranked) {
            if name.contains("_phase_") {
                continue;
            }
            let mut columns = Vec::new();
            // The middle step sees what changes at once.
            let forms: [fn(f64) -> f64; 3] = [|t| t, |t| 1.5 * t * t - 0.5, f64::signum];
            for form in forms {
                for values in &low {
                    let product: Vec<f64> = values.iter().zip(rank).map(|(v, t)| v * form(*t)).collect();
                    columns.extend(on_axes(&product));
                }
            }
            out.push((vec![(*name).to_owned(), "x".into(), "y".into()], columns));
            // Terms linear in the place and in the rank alone.
            let linear = |values: &[f64]| values.iter().zip(rank).map(|(v, t)| v * t).collect::<Vec<f64>>();
            let places = field(1);
            let columns = std::iter::once(rank.clone()).chain(places.iter().map(|v| linear(v)));
            out.push((vec![(*name).to_owned()], columns.flat_map(|v| on_axes(&v)).collect()));
        }
    }
    for i in 0..names.len().min(MOST_PAIRED) {
        for j in 0..i {
            let both = |(a, b): (&f64, &f64)| if (a * b).is_nan() { 0.0 } else { a * b };
            let product: Vec<f64> = ranked[i].iter().zip(&ranked[j]).map(both).collect();
            out.push((vec![names[j].to_owned(), names[i].to_owned()], shaped(&product)));
        }
    }
    out
}

/// Scores of all screens beside a frame's base.
pub(crate) fn screens(frame: &Frame<'_>) -> Vec<Screen> {
    let (names, columns): (Vec<_>, Vec<_>) = definitions(frame.data).into_iter().unzip();
    let scores = frame.scores(&columns);
    names
        .into_iter()
        .zip(scores)
        .filter(|(_, score)| score.rank() > 0)
        .map(|(covariates, score)| Screen { covariates, score })
        .collect()
}

/// Columns of the screens over these covariates.
pub(crate) fn columns_of(data: &Dataset, covariates: &[String]) -> Vec<Vec<f64>> {
    definitions(data)
        .into_iter()
        .filter(|(names, _)| names == covariates)
        .flat_map(|(_, columns)| columns)
        .collect()
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
