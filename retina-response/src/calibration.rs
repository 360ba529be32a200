//! The radiometric calibration of a facility: three channels and a sensor (paper, eqs. 9 and 10).

use std::path::Path;

use retina_files::InputError;
use retina_geometry::Setup;
use retina_radiometry::{DigitalCounts, QuantumEfficiency, ScreenResponse, magnitude_of_irradiance};

use crate::channel::scale_covariance;
use crate::{ChannelResponse, PowerReadings};

/// A pixel's irradiance at the pupil against digital count.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelCurve {
    /// At each of the 256 counts, W m^-2; never negative, rising.
    pub irradiance_w_m2: Vec<f64>,
    /// Standard deviation of each, W m^-2.
    pub sigma_w_m2: Vec<f64>,
    /// What the meter showed where no square was lit, W m^-2; absent where the readings did not tell it.
    pub zero_w_m2: Option<f64>,
    /// Covariance of ln(lit part at 255), gamma, the light at count 0 and (where it was fitted) the zero, of the power law.
    pub covariance: Vec<Vec<f64>>,
}

/// The response of a facility: what a pixel of any digital counts sends into the camera's pupil.
#[derive(Debug, Clone, PartialEq)]
pub struct RadiometricCalibration {
    /// Name of the setup it belongs to.
    pub setup: String,
    /// Red, green, blue.
    pub channels: [ChannelCurve; 3],
    /// eta at the channels' wavelengths (eq. 9).
    pub efficiency: [f64; 3],
    /// Integral of eta, nm.
    pub bandwidth_nm: f64,
}

/// Ends of the range of magnitudes that one pixel can show.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MagnitudeRange {
    /// At counts 255.
    pub brightest: f64,
    /// At the lowest equal counts from which on neither the response's standard deviation nor the screen's
    /// black is more than 0.1 mag.
    pub faintest: f64,
    /// Those counts.
    pub faintest_count: u8,
}

/// Uncertainty and black that a magnitude may have, mag.
pub const FAINTEST_ERROR_MAG: f64 = 0.1;

/// White (all channels at one count) against the channels one by one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Additivity {
    /// White over r + g + b: median over the readings.
    pub ratio: f64,
    /// Its standard deviation.
    pub sigma: f64,
    /// White readings.
    pub readings: usize,
}

/// A calibration with the fits that it came from.
#[derive(Debug, Clone)]
pub struct Calibrated {
    /// The response.
    pub calibration: RadiometricCalibration,
    /// Red, green, blue.
    pub fits: [ChannelResponse; 3],
    /// Whether white is the sum of its channels, where white was measured.
    pub additivity: Option<Additivity>,
    /// The tables and their hashes.
    pub readings: PowerReadings,
}

/// The sensor's curve: the setup's, or that of the paper's camera.
pub fn quantum_efficiency(setup: &Setup) -> QuantumEfficiency {
    setup
        .noise
        .quantum_efficiency
        .clone()
        .map_or_else(QuantumEfficiency::paper_camera, QuantumEfficiency::new)
}

/// eta at the channels' wavelengths, and its integral, nm (eqs. 9 and 10).
pub fn efficiencies(setup: &Setup) -> ([f64; 3], f64) {
    let curve = quantum_efficiency(setup);
    (wavelengths_nm(setup).map(|nm| curve.relative(nm)), curve.bandwidth_nm())
}

/// Effective wavelengths of red, green, blue, nm.
pub fn wavelengths_nm(setup: &Setup) -> [f64; 3] {
    let w = setup.screen.wavelength_nm;
    [w.r, w.g, w.b]
}

/// A display so much brighter or fainter than its setup says is more likely a column in another unit.
const UNLIKELY_MAG: f64 = 3.0;
/// A channel whose light at full count is fewer sigmas than this has none.
const LEAST_SIGMAS: f64 = 5.0;

/// Refuses a channel in whose readings no light is seen.
fn significant(fit: &ChannelResponse, readings: &PowerReadings) -> Result<(), InputError> {
    let (full, sigma) = (fit.full_w_m2.value, fit.full_w_m2.sigma);
    if full > LEAST_SIGMAS * sigma && sigma.is_finite() {
        return Ok(());
    }
    let file = readings.files.first().map(|(path, _)| path.clone()).unwrap_or_default();
    Err(InputError::new(&file, format!("the {} channel's readings show no light of the display", fit.channel.name()))
        .found(format!("{full:.2e} +- {sigma:.2e} W m^-2 of a pixel at count 255"))
        .expected(format!("more than {LEAST_SIGMAS} standard deviations"))
        .help("are irradiance_w_m2 and sigma_w_m2 in each other's places, and does the light change with the count?"))
}

impl RadiometricCalibration {
    /// Fits the readings' response.
    ///
    /// # Errors
    /// Readings that no rising response explains, or a sensor that sees none of the display's light.
    pub fn fit(setup: &Setup, readings: PowerReadings) -> Result<Calibrated, InputError> {
        let fit = |channel: crate::Channel| {
            ChannelResponse::fit(channel, &readings.channels[channel as usize], &readings.files)
        };
        let [r, g, b] = crate::Channel::ALL;
        let mut fits = [fit(r)?, fit(g)?, fit(b)?];
        for fit in &fits {
            significant(fit, &readings)?;
        }
        let (efficiency, bandwidth_nm) = efficiencies(setup);
        if efficiency.iter().all(|&eta| eta == 0.0) {
            return Err(InputError::new(&setup.file, "the sensor sees none of the display's channels")
                .at("keys `noise.quantum_efficiency`, `screen.wavelength_nm`"));
        }
        let curve = |fit: &ChannelResponse| ChannelCurve {
            irradiance_w_m2: fit.irradiance_w_m2.clone(),
            sigma_w_m2: fit.sigma_w_m2.clone(),
            zero_w_m2: fit.zero_w_m2.map(|zero| zero.value),
            covariance: fit.covariance.clone(),
        };
        let channels = [curve(&fits[0]), curve(&fits[1]), curve(&fits[2])];
        let calibration = Self { setup: setup.name.clone(), channels, efficiency, bandwidth_nm };
        let additivity = additivity(&calibration, &fits, &readings);
        let [stated, found] = [setup.brightest_magnitude(), calibration.magnitude([255; 3])];
        if (found - stated).abs() > UNLIKELY_MAG {
            fits[0].warnings.push(format!(
                "a white pixel at full count would be of magnitude {found:.2}, the setup says {stated:.2}: is irradiance_w_m2 \
                 in W m^-2 at the camera's pupil?"
            ));
        }
        Ok(Calibrated { calibration, fits, additivity, readings })
    }

    /// I_eff of a pixel at these counts, W m^-2 (eq. 10, each channel at its own count), with the screen's
    /// black.
    pub fn effective_w_m2(&self, counts: DigitalCounts) -> f64 {
        self.weighed(counts, |curve, count, eta| eta * curve.irradiance_w_m2[count])
    }

    /// Standard deviation of [`Self::effective_w_m2`], W m^-2: the channels were measured one by one.
    pub fn effective_sigma_w_m2(&self, counts: DigitalCounts) -> f64 {
        self.weighed(counts, |curve, count, eta| (eta * curve.sigma_w_m2[count]).powi(2)).sqrt()
    }

    fn weighed(&self, counts: DigitalCounts, term: impl Fn(&ChannelCurve, usize, f64) -> f64) -> f64 {
        let each = self.channels.iter().zip(counts).zip(self.efficiency);
        each.map(|((curve, count), eta)| term(curve, usize::from(count), eta)).sum()
    }

    /// Spectral irradiance that a pixel at these counts adds to the black screen about it, W m^-2 nm^-1:
    /// what the camera can tell from its background.
    pub fn irradiance_w_m2_nm(&self, counts: DigitalCounts) -> f64 {
        (self.effective_w_m2(counts) - self.effective_w_m2([0; 3])) / self.bandwidth_nm
    }

    /// Magnitude of that (eq. 7); infinite for counts 0.
    pub fn magnitude(&self, counts: DigitalCounts) -> f64 {
        magnitude_of_irradiance(self.irradiance_w_m2_nm(counts))
    }

    /// Standard deviation of the magnitude at these counts, without the meter's own scale.
    pub fn magnitude_sigma(&self, counts: DigitalCounts) -> f64 {
        let light = self.effective_w_m2(counts) - self.effective_w_m2([0; 3]);
        2.5 / std::f64::consts::LN_10 * self.effective_sigma_w_m2(counts) / light
    }

    /// What one pixel can show.
    pub fn magnitude_range(&self) -> MagnitudeRange {
        let black = self.effective_w_m2([0; 3]);
        let usable = |count: u8| {
            let black_mag = -2.5 * (1.0 - black / self.effective_w_m2([count; 3])).log10();
            self.magnitude_sigma([count; 3]) <= FAINTEST_ERROR_MAG && black_mag <= FAINTEST_ERROR_MAG
        };
        let faintest_count = (1..=255u8).rev().take_while(|&count| usable(count)).last().unwrap_or(255);
        MagnitudeRange {
            brightest: self.magnitude([255; 3]),
            faintest: self.magnitude([faintest_count; 3]),
            faintest_count,
        }
    }

    /// The response that screen images are encoded with: light above the screen's black, which is all over
    /// the image and which the camera's background takes with it.
    ///
    /// # Errors
    /// White does not rise with every count; `file` is named.
    pub fn screen_response(&self, file: &Path) -> Result<ScreenResponse, InputError> {
        let mut curves = [const { Vec::new() }; 3];
        for (out, (curve, eta)) in curves.iter_mut().zip(self.channels.iter().zip(self.efficiency)) {
            let black = curve.irradiance_w_m2[0];
            *out = curve.irradiance_w_m2.iter().map(|i| eta * (i - black) / self.bandwidth_nm).collect();
        }
        ScreenResponse::measured(curves).ok_or_else(|| {
            InputError::new(file, "the response does not rise with the digital count")
                .at("table `response`")
                .help("calibrate again with `retina calibrate radiometry`")
        })
    }

    /// The same display and optics at another magnification: a pixel's irradiance at the pupil goes with
    /// its solid angle, 1 / (f_x f_y) of K_f (paper, eq. 12); the sensor's efficiencies are those of
    /// `other`.
    ///
    /// # Errors
    /// `other` has another display.
    pub fn for_setup(&self, own: &Setup, other: &Setup) -> Result<Self, InputError> {
        let pitch = |setup: &Setup| {
            let s = &setup.screen;
            [s.width_mm / f64::from(s.width_px), s.height_mm / f64::from(s.height_px)]
        };
        let same = pitch(own).iter().zip(pitch(other)).all(|(a, b)| (a / b - 1.0).abs() < 1e-3)
            && wavelengths_nm(own) == wavelengths_nm(other);
        if !same {
            return Err(InputError::new(
                &other.file,
                "the setup has another display than the calibrated one",
            )
            .at("table `screen`")
            .expected("the same pixel pitch and wavelengths: only the magnification may differ")
            .help("measure the other display"));
        }
        let factor =
            other.facility_pinhole().boresight_pixel_sr() / own.facility_pinhole().boresight_pixel_sr();
        let mut channels = self.channels.clone();
        for curve in &mut channels {
            curve.irradiance_w_m2.iter_mut().chain(&mut curve.sigma_w_m2).for_each(|value| *value *= factor);
            scale_covariance(&mut curve.covariance, factor);
        }
        let (efficiency, bandwidth_nm) = efficiencies(other);
        Ok(Self { setup: other.name.clone(), channels, efficiency, bandwidth_nm })
    }
}

impl Calibrated {
    /// As [`RadiometricCalibration::for_setup`], the fits as well.
    ///
    /// # Errors
    /// `other` has another display.
    pub fn for_setup(&self, own: &Setup, other: &Setup) -> Result<Self, InputError> {
        let calibration = self.calibration.for_setup(own, other)?;
        let factor =
            other.facility_pinhole().boresight_pixel_sr() / own.facility_pinhole().boresight_pixel_sr();
        let fits = self.fits.clone().map(|fit| fit.scaled(factor));
        Ok(Self { calibration, fits, ..self.clone() })
    }
}

/// White over the sum of the channels, by the median of the white readings that show light.
fn additivity(
    calibration: &RadiometricCalibration,
    fits: &[ChannelResponse; 3],
    readings: &PowerReadings,
) -> Option<Additivity> {
    let zeros: Vec<f64> = fits.iter().filter_map(|fit| fit.zero_w_m2.map(|zero| zero.value)).collect();
    let zero = zeros.iter().sum::<f64>() / zeros.len().max(1) as f64;
    let mut ratios: Vec<f64> = readings
        .white
        .iter()
        .filter(|reading| reading.is_lit() && reading.count > 0)
        .map(|reading| {
            let sum: f64 = calibration.channels.iter().map(|c| c.irradiance_w_m2[reading.count]).sum();
            (reading.irradiance_w_m2 - zero) / (reading.pixels() * sum)
        })
        .collect();
    if ratios.is_empty() {
        return None;
    }
    let ratio = median(&mut ratios);
    let mut far: Vec<f64> = ratios.iter().map(|r| (r - ratio).abs()).collect();
    // sigma of a median: sqrt(pi / 2) of that of a mean; a normal's sigma is 1.4826 times its median distance.
    let sigma = 1.4826 * median(&mut far) * (std::f64::consts::FRAC_PI_2 / ratios.len() as f64).sqrt();
    Some(Additivity { ratio, sigma, readings: ratios.len() })
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    let n = values.len();
    0.5 * (values[(n - 1) / 2] + values[n / 2])
}
