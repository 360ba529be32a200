//! Power readings and phase curves with a hidden effect.

use std::fmt::Write as _;

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};

use crate::algebra::{beside, rms};
use crate::forms::Nature;

/// Effects on power readings.
pub(crate) const POWER: [&str; 11] = [
    "gamma",
    "attenuator_not_changed",
    "meter_wavelength",
    "black_level",
    "square_loading",
    "self_heating",
    "meter_zero",
    "channel_nonadditivity",
    "pixel_crosstalk",
    "meter_nonlinearity",
    "ageing",
];
/// Effects on a phase curve.
pub(crate) const PHASE: [&str; 6] =
    ["phase_function", "opposition_surge", "extinction", "waxing_waning", "roughness", "lommel_seeliger"];
/// Relative noise of a reading, and of a magnitude.
pub(crate) const NOISE: f64 = 0.004;
const NOISE_MAG: f64 = 0.03;
pub(crate) const FULL_W_M2: f64 = 2.1e-9;

fn normal(random: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(random)
}

pub(crate) struct Reading {
    pub(crate) channel: usize,
    pub(crate) count: f64,
    pub(crate) side: f64,
    /// Nominal light.
    pub(crate) light: f64,
    pub(crate) series: usize,
    pub(crate) passed: f64,
    dose: f64,
    /// Of the air, where a table has them: -1 to 1.
    pub(crate) humidity: f64,
    pub(crate) warmth: f64,
}

pub(crate) fn shown(id: &str, nature: &Nature, a: f64, r: &Reading, brightest: f64) -> f64 {
    let level = r.count / 255.0;
    let share = if r.channel == 3 { 1.0 } else { 1.0 / 3.0 };
    let area = r.side * r.side * share;
    let channels = [0.9 * nature.along.x, -0.5, 0.8 * nature.along.y];
    match id {
        "gamma" => area * level.powf(2.2 + a),
        // Sub-pixels that are not lit are as black as those of other channels.
        "black_level" => area * level.powf(2.2) + r.side * r.side * a * (1.0 - share * level.powf(2.2)),
        "square_loading" => r.light / (1.0 + a * level * (r.side / 200.0).powf(1.3 + 0.7 * nature.shape)),
        "pixel_crosstalk" => r.light * (1.0 + a * (4.0 / r.side - 2.0 / (r.side * r.side))),
        "self_heating" => r.light * (1.0 - a * (1.0 - (-r.passed / (0.05 + 0.15 * nature.shape)).exp())),
        "ageing" => r.light * (-a * r.dose).exp(),
        "meter_zero" => r.light + a,
        "meter_wavelength" => match r.channel {
            3 => r.light * (1.0 + a * channels.iter().sum::<f64>() / 3.0),
            c => r.light * (1.0 + a * channels[c]),
        },
        "meter_nonlinearity" => r.light / (1.0 - a * r.light / brightest),
        "channel_nonadditivity" => r.light * (1.0 - if r.channel == 3 { a } else { 0.0 }),
        "attenuator_not_changed" => {
            let wrong = (nature.shape * 24.0) as usize;
            r.light * if r.series == wrong { 2.0 + 8.0 * nature.step } else { 1.0 }
        }
        _ => r.light,
    }
}

/// Readings of 24 series, nothing wrong with them.
pub(crate) fn readings() -> Vec<Reading> {
    let mut readings: Vec<Reading> = Vec::new();
    let mut dose = 0.0;
    for series in 0..24 {
        for channel in 0..4 {
            for count in [8.0f64, 24.0, 60.0, 120.0, 255.0] {
                let side = [20.0, 60.0, 100.0, 200.0][(series + count as usize / 8 + channel) % 4];
                let share = if channel == 3 { 1.0 } else { 1.0 / 3.0 };
                let level = count / 255.0;
                dose += level / 480.0;
                readings.push(Reading {
                    channel,
                    count,
                    side,
                    light: side * side * share * level.powf(2.2),
                    series,
                    passed: readings.len() as f64 / 480.0,
                    dose,
                    humidity: 0.0,
                    warmth: 0.0,
                });
            }
        }
    }
    readings
}

/// A table of readings; `strength` is the effect's rms beside one gain over the noise. The attenuator's factor is 2 to
/// 10, whatever the strength.
pub(crate) fn power(id: Option<&str>, strength: f64, nature: &Nature, seed: u64) -> String {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let readings = readings();
    let brightest = readings.iter().map(|r| r.light).fold(0.0, f64::max);
    let gain = vec![vec![1.0; readings.len()]];
    let ones = vec![1.0; readings.len()];
    let field = |a: f64| -> Vec<f64> {
        readings.iter().map(|r| shown(id.unwrap_or(""), nature, a, r, brightest) / r.light - 1.0).collect()
    };
    // Relative effects are as large as their amplitude; a zero is so of the faintest reading.
    let mut a = 0.01;
    for _ in 0..8 {
        a *= (strength * NOISE / rms(&beside(&gain, &field(a), &ones)).max(1e-12)).clamp(0.01, 100.0);
    }
    let mut text = String::from("channel,digital_count,square_px,irradiance_w_m2,series,time_s\n");
    let mut factor = 1.0;
    for (k, r) in readings.iter().enumerate() {
        if k % 20 == 0 {
            // The meter is set up anew for each series.
            factor = 1.0 + 0.001 * normal(&mut random);
        }
        let value =
            shown(id.unwrap_or(""), nature, a, r, brightest) * factor * (1.0 + NOISE * normal(&mut random));
        let _ = writeln!(
            text,
            "{},{},{},{:e},s{:02},{}",
            ["r", "g", "b", "w"][r.channel],
            r.count,
            r.side,
            value * FULL_W_M2,
            r.series,
            30 * k
        );
    }
    text
}

/// What a body's law adds to a Lambert sphere's magnitude.
fn added(id: &str, nature: &Nature, a: f64, phase: f64, airmass: f64) -> f64 {
    let alpha = phase.abs();
    match id {
        "phase_function" => {
            // Henyey and Greenstein's function, backward.
            let g = -0.1 - 0.3 * nature.shape;
            let of = |x: f64| (1.0 - g * g) / (1.0 + 2.0 * g * x.cos() + g * g).powf(1.5);
            -2.5 * a * (of(alpha) / of(0.0)).log10()
        }
        "opposition_surge" => {
            let h = 0.01 + 0.03 * nature.shape;
            -2.5 * (1.0 + a / (1.0 + (alpha / 2.0).tan() / h)).log10()
        }
        "roughness" => a * (alpha / 2.0).tan().powi(3),
        "waxing_waning" => a * (phase.sin() + 0.25 * (2.0 * phase).sin()),
        "extinction" => a * airmass,
        "lommel_seeliger" => {
            let half = (alpha / 2.0).max(1e-9);
            let seeliger = 1.0 + half.sin() * half.tan() * (half / 2.0).tan().ln();
            a * (-2.5 * seeliger.log10() - lambert(alpha))
        }
        _ => 0.0,
    }
}

fn lambert(alpha: f64) -> f64 {
    -2.5 * ((alpha.sin() + (std::f64::consts::PI - alpha) * alpha.cos()) / std::f64::consts::PI).log10()
}

/// A phase curve; `strength` is the effect's rms beside one zero point over the noise.
pub(crate) fn phase(id: Option<&str>, strength: f64, nature: &Nature, seed: u64) -> String {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut rows = Vec::new();
    for night in 0..30 {
        let from = random.random_range(-115.0..115.0f64);
        // Some nights lie near full.
        let from = if night % 6 == 0 { from * 0.04 } else { from };
        for _ in 0..6 {
            rows.push((night, from + random.random_range(-1.0..1.0), random.random_range(1.0..2.2f64)));
        }
    }
    let zero = vec![vec![1.0; rows.len()]];
    let ones = vec![1.0; rows.len()];
    let field = |a: f64| -> Vec<f64> {
        let of = |&(_, deg, airmass): &(i32, f64, f64)| {
            added(id.unwrap_or(""), nature, a, f64::to_radians(deg), airmass)
        };
        rows.iter().map(of).collect()
    };
    let mut a = 0.05;
    for _ in 0..8 {
        a *= (strength * NOISE_MAG / rms(&beside(&zero, &field(a), &ones)).max(1e-12)).clamp(0.01, 100.0);
    }
    let effect = field(a);
    let mut text = String::from("phase_deg,magnitude,night,airmass\n");
    let (mut last, mut shift) = (-1, 0.0);
    for (&(night, deg, airmass), effect) in rows.iter().zip(&effect) {
        if night != last {
            shift = 0.2 * NOISE_MAG * normal(&mut random);
            last = night;
        }
        let magnitude =
            -12.7 + lambert(deg.to_radians().abs()) + effect + shift + NOISE_MAG * normal(&mut random);
        let _ = writeln!(text, "{deg:.3},{magnitude:.5},n{night:02},{airmass:.3}");
    }
    text
}
