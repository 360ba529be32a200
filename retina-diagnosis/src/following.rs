//! Columns that follow another one with a delay, as a mount follows the temperature of the air.

use std::borrow::Cow;

use crate::data::Dataset;

/// `values` lagged by a first-order response of time constant `tau_s`, per row (K. Ogata, Modern Control Engineering,
/// sec. 5-2), in each campaign by itself; rows of one time share a value. Rows without a value or a time get NaN.
pub(crate) fn lagged(campaign: &[usize], time_s: &[f64], values: &[f64], tau_s: f64) -> Vec<f64> {
    let mut out = vec![f64::NAN; values.len()];
    for number in 0..=campaign.iter().copied().max().unwrap_or(0) {
        let known = |row: usize| !values[row].is_nan() && !time_s[row].is_nan();
        let rows: Vec<usize> =
            (0..values.len()).filter(|&row| campaign[row] == number && known(row)).collect();
        if !rows.is_empty() {
            lag(rows, time_s, values, tau_s, &mut out);
        }
    }
    out
}

fn lag(mut order: Vec<usize>, time_s: &[f64], values: &[f64], tau_s: f64, out: &mut [f64]) {
    order.sort_by(|&a, &b| time_s[a].total_cmp(&time_s[b]));
    let mut state = values[order[0]];
    let (mut last_time, mut last_value) = (time_s[order[0]], values[order[0]]);
    for row in order {
        let step = time_s[row] - last_time;
        if step > 0.0 {
            // Linear between readings: exact response to a ramp.
            let (decay, slope) = ((-step / tau_s).exp(), (values[row] - last_value) / step);
            let start = state - (last_value - slope * tau_s);
            state = values[row] - slope * tau_s + start * decay;
            (last_time, last_value) = (time_s[row], values[row]);
        }
        out[row] = state;
    }
}

/// The name under which formulas and one's own effects read a column that lags: `lag(temperature_c, 900[s])`.
pub fn lag_name(column: &str, tau_s: f64) -> String {
    format!("lag({column}, {tau_s}[s])")
}

/// Column and time constant of such a name.
pub(crate) fn of_lag_name(name: &str) -> Option<(&str, f64)> {
    let (column, tau) = name.strip_prefix("lag(")?.strip_suffix("[s])")?.rsplit_once(", ")?;
    tau.parse().ok().filter(|tau: &f64| *tau > 0.0 && tau.is_finite()).map(|tau| (column, tau))
}

/// Values of what one's own effects may read, by its name: a covariate, `L`, `F`, or one of these that lags.
///
/// # Errors
/// The data do not have it.
pub(crate) fn read_column<'a>(data: &'a Dataset, name: &str) -> Result<Cow<'a, [f64]>, String> {
    if let Some((column, tau_s)) = of_lag_name(name) {
        let values = read_column(data, column)?;
        let time_s = &data.covariate("time_s").ok_or("a lag needs the column `time_s`")?.values;
        if let Some(time) = two_at_once(&data.mounting, time_s, &values) {
            return Err(format!("`{column}` has several values at {time} s, so nothing can follow it"));
        }
        return Ok(Cow::Owned(lagged(&data.mounting, time_s, &values, tau_s)));
    }
    let covariate = |name: &str| data.covariate(name).map(|covariate| covariate.values.as_slice());
    match (name, covariate("log10_irradiance")) {
        ("L", Some(light)) => Ok(Cow::Borrowed(light)),
        ("F", Some(light)) => Ok(Cow::Owned(light.iter().map(|l| 10f64.powf(*l)).collect())),
        _ => covariate(name).map(Cow::Borrowed).ok_or_else(|| format!("there is no column `{name}`")),
    }
}

/// A time at which a campaign has two values.
fn two_at_once(campaign: &[usize], time_s: &[f64], values: &[f64]) -> Option<f64> {
    let mut all: Vec<(usize, f64, f64)> =
        (0..values.len()).map(|row| (campaign[row], time_s[row], values[row])).collect();
    all.retain(|(_, time, value)| !time.is_nan() && !value.is_nan());
    all.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let twice = all
        .windows(2)
        .find(|pair| pair[0].0 == pair[1].0 && pair[0].1 == pair[1].1 && pair[0].2 != pair[1].2);
    twice.map(|pair| pair[0].1)
}

#[cfg(test)]
mod tests {
    /// A ramp of slope 1 from rest lags by tau in the end: t - tau (1 - exp(-t / tau)) (Ogata, sec. 5-2); another campaign
    /// at the same times, which stands still, changes nothing. A row without a value is passed over.
    #[test]
    fn campaigns_lag_by_themselves() {
        let times: Vec<f64> = (0..200).map(|row| f64::from(row / 2)).collect();
        let campaign: Vec<usize> = (0..200).map(|row| row % 2).collect();
        let mut values: Vec<f64> = (0..200).map(|row| if row % 2 == 0 { times[row] } else { 7.0 }).collect();
        values[50] = f64::NAN;
        let lagged = super::lagged(&campaign, &times, &values, 10.0);
        for row in 0..200 {
            let t = times[row];
            let expected = if row % 2 == 0 { t - 10.0 * (1.0 - (-t / 10.0).exp()) } else { 7.0 };
            assert!((lagged[row] - expected).abs() < 1e-9 || row == 50, "{row}");
        }
        assert!(lagged[50].is_nan());
    }

    #[test]
    fn names_say_column_and_time() {
        let name = super::lag_name("temperature_c", 912.5);
        assert_eq!(name, "lag(temperature_c, 912.5[s])");
        assert_eq!(super::of_lag_name(&name), Some(("temperature_c", 912.5)));
        assert_eq!(super::of_lag_name("lag(temperature_c, 0[s])"), None);
        assert_eq!(super::of_lag_name("temperature_c"), None);
    }
}
