//! What is said about a calibration: schema `retina.radiometry-calibration/1`, and a short text.

use retina_formats::wavelengths_nm;
use retina_geometry::Setup;
use serde_json::{Value, json};

use crate::channel::COVARIANCE_OF;
use crate::{Calibrated, ChannelResponse, Estimate, Shown, ShownLight, SpectralForm, Steps};

/// Half of the range about the faintest magnitude over which steps are told, mag.
const FAINT_RANGE_MAG: f64 = 0.5;
/// Jupiter in Fig. 8, brighter than one pixel of the paper's facility.
const PAPER_JUPITER_MAGNITUDE: f64 = -2.26;
/// The paper's efficiencies and bandwidth.
const PAPER: ([f64; 3], f64) = ([0.994, 0.979, 0.813], 417.0);

fn estimate(value: Estimate) -> Value {
    json!({ "value": value.value, "sigma": value.sigma })
}

fn steps(value: Option<Steps>) -> Value {
    value.map_or(Value::Null, |s| json!({ "median_mag": s.median_mag, "largest_mag": s.largest_mag }))
}

fn shown(value: Shown) -> Value {
    json!({ "counts": value.counts, "pixels": value.pixels, "magnitude": value.magnitude })
}

fn rises(values: &[f64]) -> bool {
    values.windows(2).all(|pair| pair[1] > pair[0])
}

fn pooled_rms(calibrated: &Calibrated) -> f64 {
    (calibrated.fits.iter().map(|fit| fit.rms_relative.powi(2)).sum::<f64>() / 3.0).sqrt()
}

fn channel(calibrated: &Calibrated, setup: &Setup, fit: &ChannelResponse) -> Value {
    let c = fit.channel as usize;
    let outliers: Vec<Value> = fit
        .outliers
        .iter()
        .map(|&(file, line)| json!({ "file": calibrated.readings.files[file].path, "line": line }))
        .collect();
    json!({
        "wavelength_nm": wavelengths_nm(setup)[c],
        "efficiency": calibrated.calibration.efficiency[c],
        "gamma": estimate(fit.gamma),
        "full_w_m2": estimate(fit.full_w_m2),
        "black": estimate(fit.black),
        "zero_w_m2": fit.zero_w_m2.map(estimate),
        "fall_off_at_largest_square": fit.fall_off.map(estimate),
        "covariance_of": COVARIANCE_OF[..fit.covariance.len()],
        "covariance": fit.covariance,
        "response": {
            "digital_count": (0..=255).collect::<Vec<u32>>(),
            "irradiance_w_m2": fit.irradiance_w_m2,
            "sigma_w_m2": fit.sigma_w_m2,
        },
        "knots": fit.knots,
        "monotone": rises(&fit.irradiance_w_m2),
        "rms_relative": fit.rms_relative,
        "noise": fit.noise.map(|n| json!({ "floor_w_m2": n.floor_w_m2, "proportional": n.proportional })),
        "readings": fit.readings,
        "outliers": outliers,
        "warnings": fit.warnings,
    })
}

/// The document of `--json`; `setup` is the one that the calibration is for.
pub fn json_document(calibrated: &Calibrated, setup: &Setup) -> Value {
    let calibration = &calibrated.calibration;
    let range = calibration.magnitude_range();
    let light = ShownLight::new(calibration);
    let spectral = SpectralForm::of(setup, calibration);
    let channels: serde_json::Map<String, Value> = calibrated
        .fits
        .iter()
        .map(|fit| (fit.channel.letter().to_owned(), channel(calibrated, setup, fit)))
        .collect();
    let (brighter, fainter) = (range.faintest - FAINT_RANGE_MAG, range.faintest + FAINT_RANGE_MAG);
    let stars: Vec<Value> = spectral
        .stars
        .iter()
        .map(|star| {
            json!({
                "spectrum": star.temperature_k.map_or("flat".to_owned(), |t| format!("blackbody {t} K")),
                "bandwidth_nm": star.bandwidth_nm,
                "difference_mag": star.difference_mag,
            })
        })
        .collect();
    let grey = |f: &dyn Fn([u8; 3]) -> f64| (0..=255u8).map(|b| f([b; 3])).collect::<Vec<f64>>();
    json!({
        "schema": "retina.radiometry-calibration/1",
        "setup": calibration.setup,
        "channels": channels,
        "magnitude_range": [range.brightest, range.faintest],
        "faintest_count": range.faintest_count,
        "monotone": calibrated.fits.iter().all(|fit| rises(&fit.irradiance_w_m2)),
        "rms_relative": pooled_rms(calibrated),
        "efficiency": calibration.efficiency,
        "bandwidth_nm": calibration.bandwidth_nm,
        "paper": { "efficiency": PAPER.0, "bandwidth_nm": PAPER.1 },
        "white": {
            "effective_w_m2": grey(&|c| calibration.effective_w_m2(c)),
            "effective_sigma_w_m2": grey(&|c| calibration.effective_sigma_w_m2(c)),
            // Counts 0 have no magnitude: null.
            "magnitude": grey(&|c| calibration.magnitude(c)),
        },
        "series": calibrated.series.map(|s| {
            json!({ "count": s.series, "relative_scatter": s.relative, "channel_relative_sigma": s.channel_relative })
        }),
        "additivity": calibrated.additivity.map(|a| {
            json!({ "white_over_sum": a.ratio, "sigma": a.sigma, "readings": a.readings })
        }),
        "steps_at_faintest": {
            "equal_counts": steps(light.grey_steps(brighter, fainter)),
            "mixtures": steps(light.mixed_steps(brighter, fainter)),
        },
        "examples": {
            "faintest_mixed": shown(light.mixed(range.faintest)),
            "jupiter": shown(light.pixels(PAPER_JUPITER_MAGNITUDE)),
        },
        "spectral": { "line_efficiency": spectral.line_efficiency, "stars": stars },
    })
}

/// A short text, a line each.
pub fn summary(calibrated: &Calibrated, setup: &Setup) -> Vec<String> {
    let calibration = &calibrated.calibration;
    let mut lines = Vec::new();
    for fit in &calibrated.fits {
        let zero = fit
            .zero_w_m2
            .map_or("not fitted".to_owned(), |z| format!("{:.2e} +- {:.1e} W m^-2", z.value, z.sigma));
        lines.push(format!(
            "{:5} gamma {:.4} +- {:.4}, full {:.4e} +- {:.1e} W m^-2, black {:.2e} +- {:.1e}, zero {zero}; \
             {} knots, rms {:.2} %, {} of {} readings set aside",
            fit.channel.name(),
            fit.gamma.value,
            fit.gamma.sigma,
            fit.full_w_m2.value,
            fit.full_w_m2.sigma,
            fit.black.value,
            fit.black.sigma,
            fit.knots,
            100.0 * fit.rms_relative,
            fit.outliers.len(),
            fit.readings,
        ));
    }
    let range = calibration.magnitude_range();
    lines.push(format!(
        "one pixel shows magnitudes {:.2} to {:.2} (equal counts 255 to {})",
        range.brightest, range.faintest, range.faintest_count
    ));
    let light = ShownLight::new(calibration);
    let (brighter, fainter) = (range.faintest - FAINT_RANGE_MAG, range.faintest + FAINT_RANGE_MAG);
    if let (Some(grey), Some(mixed)) =
        (light.grey_steps(brighter, fainter), light.mixed_steps(brighter, fainter))
    {
        lines.push(format!(
            "steps at the faint end: equal counts {:.3} mag (median), mixtures of channels {:.4} mag",
            grey.median_mag, mixed.median_mag
        ));
    }
    let [r, g, b] = calibration.efficiency;
    let ([pr, pg, pb], p) = PAPER;
    lines.push(format!(
        "efficiencies {r:.3}, {g:.3}, {b:.3}, bandwidth {:.1} nm (the paper's: {pr}, {pg}, {pb}, {p} nm)",
        calibration.bandwidth_nm
    ));
    let stars: Vec<String> = SpectralForm::of(setup, calibration)
        .stars
        .iter()
        .map(|s| {
            format!(
                "{} {:+.3}",
                s.temperature_k.map_or("flat".to_owned(), |t| format!("{t} K")),
                s.difference_mag
            )
        })
        .collect();
    lines.push(format!("shown minus true magnitude with full spectra (eq. 8): {}", stars.join(", ")));
    if let Some((count, relative)) = calibrated.series.and_then(|s| Some((s.series, s.relative?))) {
        lines.push(if relative > 0.0 {
            format!("{count} series repeat within {:.2} %: each has a factor of its own", 100.0 * relative)
        } else {
            format!("{count} series repeat within the noise of their readings")
        });
    }
    if let Some(a) = calibrated.additivity {
        lines.push(format!("white over r + g + b: {:.4} +- {:.4}", a.ratio, a.sigma));
    }
    lines
}
