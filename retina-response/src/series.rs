//! Series that do not repeat: a meter that is set up anew reads a little more or less of the same light.
//!
//! Each series has a factor of its own, normal about 1. The scatter of these factors is told by moments (R. DerSimonian,
//! N. Laird, Controlled Clinical Trials 7, 1986, eq. 8) from what each series reads beside the response that is fitted to
//! all, and each factor is the better known the more its readings tell (C. R. Henderson, Biometrics 31, 1975). Response
//! and factors are fitted in turn. Channels that share series share their factors, which is the meter's scale and no
//! error of theirs. Channels that were measured in series of their own are known against each other to the mean of the
//! factors of these series.

use crate::channel::power_law;
use crate::readings::{PowerReadings, lit_counts};

/// How far series repeat.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeriesScatter {
    /// Series of the channels' readings.
    pub series: usize,
    /// Standard deviation of their factors; 0 where none shows; `None` where each channel has one series of its own.
    pub relative: Option<f64>,
    /// Standard deviation of each channel's light against the others', beside its readings' noise.
    pub channel_relative: [f64; 3],
}

const ROUNDS: usize = 8;
/// Factors that change by less are settled.
const SETTLED: f64 = 1e-5;
/// Standard deviations of chi-squared beyond which factors scatter.
const CLEARLY: f64 = 2.0;

/// What a series reads beside the response.
#[derive(Debug, Clone, Copy)]
struct Told {
    ln_factor: f64,
    variance: f64,
}

/// Gives every reading its series' factor; `None` where rows name no series, or a channel cannot be fitted (which its own
/// fit refuses with the reason).
pub(crate) fn settle(readings: &mut PowerReadings) -> Option<SeriesScatter> {
    let all = || readings.channels.iter().flatten().filter(|reading| reading.is_lit());
    let numbers: Option<Vec<usize>> = all().map(|reading| reading.series).collect();
    let series = 1 + numbers?.into_iter().max()?;
    let parts = parts(readings, series);
    let counted = |part: usize| parts.of_series.iter().filter(|own| **own == Some(part)).count();
    let free: usize = (0..parts.count).map(|part| counted(part).saturating_sub(1)).sum();
    let mut scatter = SeriesScatter {
        series: parts.of_series.iter().flatten().count(),
        relative: (free > 0).then_some(0.0),
        channel_relative: [0.0; 3],
    };
    if free == 0 {
        return Some(scatter);
    }
    let mut ln_factors = vec![0.0; series];
    for _ in 0..ROUNDS {
        let told = told(readings, &ln_factors)?;
        let variance = variance(&told, &parts, free);
        let factors = shrunk(&told, &parts, variance);
        let change = factors.iter().zip(&ln_factors).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        ln_factors = factors;
        for reading in readings.channels.iter_mut().flatten().chain(&mut readings.white) {
            let own = reading.series.and_then(|of| ln_factors.get(of));
            reading.gain = own.map_or(1.0, |ln_factor| ln_factor.exp());
        }
        scatter.relative = Some(variance.sqrt());
        if parts.count > 1 {
            // A scatter of few series is itself known to few degrees of freedom: Student's t for a normal.
            let student = free as f64 / (free as f64 - 2.0).max(0.5);
            scatter.channel_relative =
                parts.of_channel.map(|part| (student * variance / counted(part).max(1) as f64).sqrt());
        }
        if change < SETTLED {
            break;
        }
    }
    Some(scatter)
}

/// Series and channels that readings connect.
struct Parts {
    of_channel: [usize; 3],
    /// `None` for a series that has no lit reading of a channel.
    of_series: Vec<Option<usize>>,
    count: usize,
}

fn parts(readings: &PowerReadings, series: usize) -> Parts {
    let mut seen = vec![[false; 3]; series];
    for (channel, own) in readings.channels.iter().enumerate() {
        for of in own.iter().filter(|reading| reading.is_lit()).filter_map(|reading| reading.series) {
            seen[of][channel] = true;
        }
    }
    let mut of_channel = [0, 1, 2];
    for own in &seen {
        let joined: Vec<usize> = (0..3).filter(|c| own[*c]).map(|c| of_channel[c]).collect();
        if let Some(&least) = joined.iter().min() {
            of_channel = of_channel.map(|part| if joined.contains(&part) { least } else { part });
        }
    }
    let mut names = of_channel.to_vec();
    names.sort_unstable();
    names.dedup();
    let of_channel = of_channel.map(|part| names.iter().position(|name| *name == part).unwrap_or(0));
    let of_series = seen.iter().map(|own| (0..3).find(|c| own[*c]).map(|c| of_channel[c])).collect();
    Parts { of_channel, of_series, count: names.len() }
}

/// Each series' factor by the weighted median of its readings over the response; the variance is a mean's, times pi / 2.
fn told(readings: &PowerReadings, ln_factors: &[f64]) -> Option<Vec<Option<Told>>> {
    let mut ratios: Vec<Vec<(f64, f64)>> = vec![Vec::new(); ln_factors.len()];
    for own in &readings.channels {
        let (fit, sigma, _) = power_law(own, &lit_counts(own), &mut Vec::new())?;
        for (reading, sigma) in own.iter().zip(&sigma).filter(|(reading, _)| reading.is_lit()) {
            let light = fit.predicted(reading) - fit.zero;
            if let Some(of) = reading.series.filter(|_| light > 0.0) {
                ratios[of].push(((reading.irradiance_w_m2 - fit.zero) / light, (light / sigma).powi(2)));
            }
        }
    }
    let of_series = |(own, ln_factor): (Vec<(f64, f64)>, &f64)| {
        let weight: f64 = own.iter().map(|(_, weight)| weight).sum();
        let ratio = weighted_median(own)?;
        (ratio > 0.0).then(|| Told {
            ln_factor: ln_factor + ratio.ln(),
            variance: std::f64::consts::FRAC_PI_2 / weight,
        })
    };
    Some(ratios.into_iter().zip(ln_factors).map(of_series).collect())
}

/// The value with half of the weights at and below it.
fn weighted_median(mut values: Vec<(f64, f64)>) -> Option<f64> {
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = 0.5 * values.iter().map(|(_, weight)| weight).sum::<f64>();
    let mut below = 0.0;
    values
        .into_iter()
        .find(|(_, weight)| {
            below += weight;
            below >= half
        })
        .map(|(value, _)| value)
}

fn of_part<'t>(told: &'t [Option<Told>], parts: &'t Parts, part: usize) -> impl Iterator<Item = Told> + 't {
    told.iter()
        .zip(&parts.of_series)
        .filter(move |(_, own)| **own == Some(part))
        .filter_map(|(told, _)| *told)
}

/// Mean with weights 1 / (variance + that of the factors).
fn mean(told: &[Option<Told>], parts: &Parts, part: usize, variance: f64) -> f64 {
    let (mut sum, mut weights) = (0.0, 0.0);
    for one in of_part(told, parts, part) {
        let weight = 1.0 / (variance + one.variance);
        sum += weight * one.ln_factor;
        weights += weight;
    }
    if weights > 0.0 { sum / weights } else { 0.0 }
}

/// Variance of the factors, 0 where they do not scatter beyond what is told of each.
fn variance(told: &[Option<Told>], parts: &Parts, free: usize) -> f64 {
    let (mut spread, mut scale) = (0.0, 0.0);
    for part in 0..parts.count {
        let middle = mean(told, parts, part, 0.0);
        let (mut weights, mut squares) = (0.0, 0.0);
        for one in of_part(told, parts, part) {
            let weight = 1.0 / one.variance;
            spread += weight * (one.ln_factor - middle).powi(2);
            weights += weight;
            squares += weight * weight;
        }
        if weights > 0.0 {
            scale += weights - squares / weights;
        }
    }
    let free = free as f64;
    let clear = spread > free + CLEARLY * (2.0 * free).sqrt();
    if clear && scale > 0.0 { (spread - free) / scale } else { 0.0 }
}

/// Factors beside their part's mean, as far as their readings tell them from 1.
fn shrunk(told: &[Option<Told>], parts: &Parts, variance: f64) -> Vec<f64> {
    let means: Vec<f64> = (0..parts.count).map(|part| mean(told, parts, part, variance)).collect();
    told.iter()
        .zip(&parts.of_series)
        .map(|(told, part)| match (told, part) {
            (Some(one), Some(part)) if variance > 0.0 => {
                (one.ln_factor - means[*part]) * variance / (variance + one.variance)
            }
            _ => 0.0,
        })
        .collect()
}

/// What a user is told of it.
pub(crate) fn warning(scatter: &SeriesScatter) -> Option<String> {
    match scatter.relative {
        None if scatter.series > 1 => Some(
            "each channel was measured in one series of its own: how far series repeat is not known, so the channels' ratio \
             may be wrong by as much as that. Measure all channels in each series, or each in several"
                .to_owned(),
        ),
        _ => None,
    }
}
