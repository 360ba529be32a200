//! Columns that follow others with a delay: coarse steps to search among, finer ones about a delay that was found.

use retina_diagnosis::{Dataset, lag_name};

use crate::columns::{Column, column};
use crate::form::Form;

/// Time itself, and how long light fell: nothing follows these with a delay.
const NEVER_FOLLOWED: [&str; 2] = ["time_s", "exposure_s"];
/// Most delays that are tried; each is so many times the one before.
const MOST_DELAYS: usize = 6;
const DELAY_STEP: f64 = 2.0;
/// Delays between two of these, where one of them was found.
const FINER: i32 = 8;

/// What follows a column with a delay.
pub(crate) fn delayed(data: &Dataset, source: &Column) -> Vec<Column> {
    if NEVER_FOLLOWED.contains(&source.name.as_str()) {
        return Vec::new();
    }
    delays_s(data, source).into_iter().filter_map(|tau_s| lagged(data, &source.name, tau_s)).collect()
}

fn lagged(data: &Dataset, source: &str, tau_s: f64) -> Option<Column> {
    column(data, lag_name(source, tau_s), Some((source.to_owned(), tau_s)))
}

/// Time constants with which something may follow a column: from two of its changes on, and as long as the table shows the
/// end of it.
fn delays_s(data: &Dataset, column: &Column) -> Vec<f64> {
    let (Some(times), Some(values)) = (data.covariate("time_s"), data.readable(&column.name)) else {
        return Vec::new();
    };
    let mut all: Vec<(f64, f64)> = times.values.iter().copied().zip(values).collect();
    if all.iter().any(|(time, value)| !time.is_finite() || !value.is_finite()) {
        return Vec::new();
    }
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    let changes = all.windows(2).filter(|pair| pair[1].1 != pair[0].1).count();
    let (Some(first), Some(last)) = (all.first(), all.last()) else { return Vec::new() };
    let span = last.0 - first.0;
    let shortest = 2.0 * span / changes.max(1) as f64;
    std::iter::successors(Some(shortest), |tau_s| Some(DELAY_STEP * tau_s))
        .take_while(|tau_s| *tau_s <= 0.25 * span)
        .take(MOST_DELAYS)
        .map(two_digits)
        .collect()
}

/// The columns with further ones behind them: delays about those that some forms have.
pub(crate) fn with_finer_delays<'f>(
    data: &Dataset,
    columns: &[Column],
    forms: impl Iterator<Item = &'f Form>,
) -> Vec<Column> {
    let mut out = columns.to_vec();
    for factor in forms.flat_map(|form| &form.factors) {
        let Some((source, tau_s)) = &columns[factor.column].follows else { continue };
        for step in (1 - FINER..FINER).filter(|step| *step != 0) {
            let tau_s = two_digits(tau_s * DELAY_STEP.powf(f64::from(step) / f64::from(FINER)));
            let is_known = |known: &Column| known.name == lag_name(source, tau_s);
            if !out.iter().any(is_known) {
                out.extend(lagged(data, source, tau_s));
            }
        }
    }
    out
}

/// Forms, and each that has a delay with all others behind the same column: only then is it known which ones the data do
/// not tell apart.
pub(crate) fn with_all_delays(forms: Vec<Form>, columns: &[Column]) -> Vec<Form> {
    let mut out = forms.clone();
    for form in &forms {
        for (k, factor) in form.factors.iter().enumerate() {
            let own = &columns[factor.column];
            if own.follows.is_none() {
                continue;
            }
            for (other, column) in columns.iter().enumerate() {
                let mut variant = form.clone();
                variant.factors[k].column = other;
                let delays = column.follows.is_some() && column.source() == own.source();
                if delays && !out.iter().any(|known| known.family() == variant.family()) {
                    out.push(variant);
                }
            }
        }
    }
    out
}

/// A value to two digits.
fn two_digits(value: f64) -> f64 {
    format!("{value:.1e}").parse().unwrap_or(value)
}
