//! The response of one channel, from its readings.

use retina_files::InputError;
use retina_formats::{Channel, ChannelCurve, SourceFile};

use crate::fit::power_law_start;
use crate::fit::{Constants, Fit, quadratic};
use crate::knots::choose;
use crate::monotone::falls;
use crate::noise::{self, Noise};
use crate::readings::{Reading, lit_counts};
use crate::spline::{Basis, COUNTS};

/// A value and its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The value.
    pub value: f64,
    /// One standard deviation.
    pub sigma: f64,
}

/// The response of one channel with its uncertainty.
#[derive(Debug, Clone)]
pub struct ChannelResponse {
    /// Which.
    pub channel: Channel,
    /// A pixel's irradiance at the pupil at each count, W m^-2; never negative, rising.
    pub irradiance_w_m2: Vec<f64>,
    /// Standard deviation of each, W m^-2, without the meter's own scale.
    pub sigma_w_m2: Vec<f64>,
    /// gamma of the power law that fits best.
    pub gamma: Estimate,
    /// A pixel's irradiance at count 255, W m^-2.
    pub full_w_m2: Estimate,
    /// A pixel's light at count 0 over that at 255; below 0 only within its uncertainty.
    pub black: Estimate,
    /// The meter's reading where no square is lit, W m^-2; absent where the readings cannot tell it.
    pub zero_w_m2: Option<Estimate>,
    /// Part of its light that the largest square loses to the optics' fall-off; absent where fewer than three sizes of
    /// squares were measured.
    pub fall_off: Option<Estimate>,
    /// Covariance of ln(lit part at 255), gamma, the light at count 0, and the zero (where it is fitted), of the power law.
    pub covariance: Vec<Vec<f64>>,
    /// Knots of ln I over ln B; 2 is the power law.
    pub knots: usize,
    /// The noise as estimated, where readings came without their own.
    pub noise: Option<Noise>,
    /// Readings that were given.
    pub readings: usize,
    /// Those that took no part: file's index and line.
    pub outliers: Vec<(usize, usize)>,
    /// Rms of (reading - fit) / fit over the lit readings whose noise is below a tenth of their light.
    pub rms_relative: f64,
    /// For Fig. 6: count, a pixel's irradiance, its standard deviation; those that took part.
    pub measured: Vec<(usize, f64, f64)>,
    /// What the user should know.
    pub warnings: Vec<String>,
}

/// What the rows of a power law's covariance are, as files name them; the last only where it was fitted.
pub(crate) const COVARIANCE_OF: [&str; 4] = ["ln_lit_full_w_m2", "gamma", "dark_w_m2", "zero_w_m2"];

/// gamma, black and zero that correlate beyond this are one unknown in all but name.
const INSEPARABLE: f64 = 0.98;
/// A dark reading this many sigmas above the zero shows light.
const DARK_SIGMAS: f64 = 10.0;
/// A reading this many sigmas below the zero is negative light.
const NEGATIVE_SIGMAS: f64 = 5.0;
/// Relative noise from which a reading says nothing about relative errors.
const FAINT: f64 = 0.1;

impl ChannelResponse {
    /// Fits the readings of a channel.
    ///
    /// # Errors
    /// Readings that no rising response explains: negative, light in the dark, falling with the count.
    pub fn fit(channel: Channel, readings: &[Reading], files: &[SourceFile]) -> Result<Self, InputError> {
        let name = channel.name();
        let at = |reading: &Reading, problem: String| {
            let (file, line) = reading.place;
            InputError::new(&files[file].path, problem).cell(line, "irradiance_w_m2")
        };
        refuse_early(channel, readings, &at)?;
        let counts = lit_counts(readings);
        let unexplained = || {
            let first = &readings[0];
            at(first, format!("no response that rises with the count explains the {name} channel's readings"))
                .help("are counts and channels in the right rows, and is the meter's dark value subtracted only once?")
        };
        let mut warnings = Vec::new();
        let (power_law, sigma, noise) =
            power_law(readings, &counts, &mut warnings).ok_or_else(unexplained)?;
        let fit = choose(readings, &sigma, &power_law, &counts);
        refuse_late(readings, &fit, &sigma, &at)?;
        if let Some(fall) = falls(readings, &fit, &sigma) {
            let first =
                readings.iter().find(|r| r.count == fall.counts.1 && r.is_lit()).unwrap_or(&readings[0]);
            return Err(at(first, format!("the {name} channel's response falls where the count rises"))
                .found(format!(
                    "{:.4e} W m^-2 a pixel at count {}, {:.4e} at count {}: {:.1} sigma",
                    fall.light.0, fall.counts.0, fall.light.1, fall.counts.1, fall.sigmas
                ))
                .expected("light that rises with the count, within its uncertainty")
                .help("was the display warm, and is no row from another channel or square? Measure these counts again"));
        }
        tell_inseparable(&power_law, &counts, &mut warnings);
        Ok(Self::of(channel, readings, &sigma, noise, &power_law, &fit, warnings))
    }

    /// The same display where a pixel's light at the pupil is `factor` times this. The readings' own figures
    /// (zero, noise) stay.
    pub(crate) fn scaled(mut self, factor: f64) -> Self {
        let mut curve = self.curve();
        curve.scale(factor);
        self.irradiance_w_m2 = curve.irradiance_w_m2;
        self.sigma_w_m2 = curve.sigma_w_m2;
        self.covariance = curve.covariance;
        self.measured.iter_mut().for_each(|(_, light, sigma)| {
            *light *= factor;
            *sigma *= factor;
        });
        self.full_w_m2 =
            Estimate { value: self.full_w_m2.value * factor, sigma: self.full_w_m2.sigma * factor };
        self
    }

    /// The same with light that is known but for a factor of this standard deviation.
    pub(crate) fn known_to(mut self, relative: f64) -> Self {
        let with = |sigma: f64, light: f64| sigma.hypot(relative * light);
        self.sigma_w_m2.iter_mut().zip(&self.irradiance_w_m2).for_each(|(s, light)| *s = with(*s, *light));
        self.full_w_m2.sigma = with(self.full_w_m2.sigma, self.full_w_m2.value);
        if let Some(ln_full) = self.covariance.first_mut().and_then(|row| row.first_mut()) {
            *ln_full += relative * relative;
        }
        self
    }

    /// Its curve alone.
    pub(crate) fn curve(&self) -> ChannelCurve {
        ChannelCurve {
            irradiance_w_m2: self.irradiance_w_m2.clone(),
            sigma_w_m2: self.sigma_w_m2.clone(),
            zero_w_m2: self.zero_w_m2.map(|zero| zero.value),
            covariance: self.covariance.clone(),
        }
    }

    fn of(
        channel: Channel,
        readings: &[Reading],
        sigma: &[f64],
        noise: Option<Noise>,
        power_law: &Fit,
        fit: &Fit,
        mut warnings: Vec<String>,
    ) -> Self {
        // Light cannot be negative: where the black comes out below 0 the curve is fitted again without it,
        // and keeps the uncertainty of the fit that had it.
        let constants = Constants { dark: false, ..fit.constants };
        let refitted =
            (fit.dark < 0.0).then(|| fit.clone().with_constants(constants).refine(readings, sigma));
        let curve = refitted.flatten().unwrap_or_else(|| fit.clone().with_dark_at_least_0());
        let table = |f: &dyn Fn(usize) -> f64| (0..COUNTS).map(f).collect::<Vec<f64>>();
        let outliers: Vec<(usize, usize)> =
            (0..readings.len()).filter(|&i| !fit.used[i]).map(|i| readings[i].place).collect();
        if outliers.len() * 10 > readings.len() {
            warnings.push(format!(
                "{} of {} readings are far from the response",
                outliers.len(),
                readings.len()
            ));
        }
        let used = || (0..readings.len()).filter(|&i| fit.used[i] && readings[i].is_lit());
        let relative: Vec<f64> = used()
            .filter_map(|i| {
                let light = fit.predicted(&readings[i]) - fit.zero;
                let off = (readings[i].irradiance_w_m2 - fit.zero - light) / light;
                (sigma[i] < FAINT * light).then_some(off * off)
            })
            .collect();
        let measured = used()
            .map(|i| {
                let area = fit.area(&readings[i]);
                let light = (readings[i].irradiance_w_m2 - fit.zero) / area;
                (readings[i].count, light, sigma[i] / area)
            })
            .collect();
        // Files state the power law alone, without the fall-off.
        let stated = power_law.fall_off_index().unwrap_or(power_law.covariance.len());
        let zero = fit.zero_index().map(|i| Estimate { value: fit.zero, sigma: fit.covariance[i][i].sqrt() });
        Self {
            channel,
            irradiance_w_m2: table(&|count| curve.pixel(count)),
            sigma_w_m2: table(&|count| fit.pixel_sigma(count)),
            gamma: Estimate { value: power_law.shape[1], sigma: power_law.covariance[1][1].sqrt() },
            full_w_m2: Estimate { value: curve.pixel(COUNTS - 1), sigma: fit.pixel_sigma(COUNTS - 1) },
            black: fit.black(),
            zero_w_m2: zero,
            fall_off: fit
                .fall_off_index()
                .map(|i| Estimate { value: fit.fall_off, sigma: fit.covariance[i][i].sqrt() }),
            covariance: power_law.covariance.iter().take(stated).map(|row| row[..stated].to_vec()).collect(),
            knots: fit.shape.len(),
            noise,
            readings: readings.len(),
            outliers,
            rms_relative: (relative.iter().sum::<f64>() / relative.len().max(1) as f64).sqrt(),
            measured,
            warnings,
        }
    }
}

impl Fit {
    /// I(0) / I(255) with its standard deviation.
    fn black(&self) -> Estimate {
        let full = self.pixel(COUNTS - 1);
        let value = self.dark / full;
        let lit = full - self.dark;
        let mut row: Vec<f64> = self.basis.row(COUNTS - 1).iter().map(|b| -value * lit * b / full).collect();
        row.extend(self.constants.dark.then_some((1.0 - value) / full));
        row.extend(self.constants.zero.then_some(0.0));
        row.extend(self.constants.fall_off.then_some(0.0));
        Estimate { value, sigma: quadratic(&self.covariance, &row).sqrt() }
    }

    fn with_dark_at_least_0(mut self) -> Self {
        self.dark = self.dark.max(0.0);
        self
    }
}

type At<'a> = &'a dyn Fn(&Reading, String) -> InputError;

/// What can be refused before a fit: a channel whose brightest readings are no light.
fn refuse_early(channel: Channel, readings: &[Reading], at: At<'_>) -> Result<(), InputError> {
    let brightest = readings
        .iter()
        .filter(|r| r.is_lit())
        .max_by(|a, b| (a.pixels() * a.count as f64).total_cmp(&(b.pixels() * b.count as f64)));
    match brightest {
        Some(reading) if reading.irradiance_w_m2 <= 0.0 => {
            Err(at(reading, format!("the {} channel shows no light where it is brightest", channel.name()))
                .found(format!("{:e} W m^-2 at count {}", reading.irradiance_w_m2, reading.count))
                .expected("irradiance above 0"))
        }
        _ => Ok(()),
    }
}

fn refuse_late(readings: &[Reading], fit: &Fit, sigma: &[f64], at: At<'_>) -> Result<(), InputError> {
    let lit_least =
        readings.iter().filter(|r| r.is_lit()).map(|r| r.irradiance_w_m2).fold(f64::MAX, f64::min);
    for (reading, &sigma) in readings.iter().zip(sigma).filter(|(reading, _)| reading.is_lit()) {
        let off = (reading.irradiance_w_m2 - fit.zero) / sigma;
        if off < -NEGATIVE_SIGMAS {
            return Err(at(reading, "the irradiance is negative beyond its noise".into())
                .found(format!("{:e} W m^-2, {:.1} sigma below the zero", reading.irradiance_w_m2, -off))
                .expected("light, or a little below the zero by noise")
                .help("take the row out, or measure it again"));
        }
    }
    for (reading, &sigma) in readings.iter().zip(sigma).filter(|(reading, _)| !reading.is_lit()) {
        let off = (reading.irradiance_w_m2 - fit.zero) / sigma;
        let beyond_lit = (reading.irradiance_w_m2 - lit_least) / sigma;
        if off > DARK_SIGMAS || beyond_lit > DARK_SIGMAS {
            return Err(at(reading, "a dark reading (square_px 0) shows light".into())
                .found(format!("{:e} W m^-2", reading.irradiance_w_m2))
                .expected(format!("the meter's zero, {:.3e} +- {sigma:.1e}", fit.zero))
                .help("was a square lit, or is `square_px` missing in this row?"));
        }
    }
    Ok(())
}

/// Standard deviations from which on a fall-off across the largest square is kept.
const FALL_OFF_SIGMAS: f64 = 3.0;

/// The power law with its readings' sigmas: stated ones, or those that the noise of a flexible fit gives.
pub(crate) fn power_law(
    readings: &[Reading],
    counts: &[usize],
    warnings: &mut Vec<String>,
) -> Option<(Fit, Vec<f64>, Option<Noise>)> {
    let dark_readings = readings.iter().any(|r| !r.is_lit());
    let mut squares: Vec<f64> = readings.iter().filter(|r| r.is_lit()).map(|r| r.square_px).collect();
    squares.sort_unstable_by(f64::total_cmp);
    squares.dedup();
    let zero = dark_readings || squares.len() > 1;
    if !zero {
        warnings.push(
            "black and the meter's zero cannot be told apart: one square size and no dark reading; the zero \
             is taken as 0"
                .into(),
        );
    }
    // Two squares tell the meter's zero, a third the fall-off.
    let constants = Constants { dark: true, zero, fall_off: squares.len() > 2 };
    let brightest = readings.iter().map(|r| r.irradiance_w_m2.abs()).fold(0.0, f64::max);
    let guess = Noise { floor_w_m2: 1e-4 * brightest, proportional: 0.02 };
    let stated =
        |i: usize, light: f64, noise: Noise| readings[i].sigma_w_m2.unwrap_or_else(|| noise.sigma(light));
    let mut sigma: Vec<f64> =
        (0..readings.len()).map(|i| stated(i, readings[i].irradiance_w_m2, guess)).collect();
    let mut fit = power_law_start(readings, &sigma, constants)?.refine(readings, &sigma)?;
    let all_stated = readings.iter().all(|r| r.sigma_w_m2.is_some());
    let flexible = |fit: &Fit, sigma: &[f64]| {
        let knots = (counts.len() / 2).min(6);
        let spline = (knots >= 3).then(|| fit.on_basis(Basis::spline(knots, counts), counts));
        spline.flatten().and_then(|start| start.refine(readings, sigma)).unwrap_or_else(|| fit.clone())
    };
    let mut noise = None;
    if !all_stated {
        for _ in 0..4 {
            let pilot = flexible(&fit, &sigma);
            let found = noise::estimate(readings, &pilot, &sigma);
            sigma = (0..readings.len()).map(|i| stated(i, pilot.predicted(&readings[i]), found)).collect();
            noise = Some(found);
        }
        fit = fit.refine(readings, &sigma)?;
    } else {
        let pilot = flexible(&fit, &sigma);
        let scale = scatter(readings, &pilot, &sigma);
        // The scale from a median scatters by 1.16 / sqrt(n) of itself (efficiency 0.37).
        if scale > 1.0 + 3.0 * 1.16 / (readings.len() as f64).sqrt() {
            warnings.push(format!(
                "the readings scatter {scale:.2} times as far as `sigma_w_m2` says; uncertainties are raised by that"
            ));
            sigma.iter_mut().for_each(|s| *s *= scale);
            fit = fit.refine(readings, &sigma)?;
        }
    }
    // A fall-off that does not show is none: it would only widen what else is told.
    let shows = fit
        .fall_off_index()
        .is_none_or(|i| fit.fall_off.abs() > FALL_OFF_SIGMAS * fit.covariance[i][i].sqrt());
    if !shows {
        let constants = Constants { fall_off: false, ..fit.constants };
        fit = fit.with_constants(constants).refine(readings, &sigma)?;
    }
    Some((fit, sigma, noise))
}

/// Robust scale of the residuals in sigmas: the median of their sizes over 0.6745, raised for the unknowns.
fn scatter(readings: &[Reading], fit: &Fit, sigma: &[f64]) -> f64 {
    let mut sizes: Vec<f64> =
        readings.iter().zip(sigma).map(|(r, s)| (r.irradiance_w_m2 - fit.predicted(r)).abs() / s).collect();
    sizes.sort_unstable_by(f64::total_cmp);
    let n = sizes.len() as f64;
    let raise = (n / (n - fit.covariance.len() as f64).max(1.0)).sqrt();
    sizes[sizes.len() / 2] / 0.6745 * raise
}

fn tell_inseparable(power_law: &Fit, counts: &[usize], warnings: &mut Vec<String>) {
    let Some(dark) = power_law.dark_index() else { return };
    let with_gamma = power_law.correlation(1, dark);
    if with_gamma.abs() > INSEPARABLE {
        warnings.push(format!(
            "gamma and black cannot be told apart (correlation {with_gamma:.4}; the lowest lit count is {}): \
             measure counts below 16, and count 0",
            counts[0]
        ));
    }
    if let Some(zero) = power_law.zero_index() {
        let with_zero = power_law.correlation(dark, zero);
        if with_zero.abs() > INSEPARABLE {
            warnings.push(format!(
                "black and the meter's zero cannot be told apart (correlation {with_zero:.4}): measure low \
                 counts with a large square, and dark readings"
            ));
        }
    }
}
