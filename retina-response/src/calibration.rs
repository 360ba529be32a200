//! A fitted radiometric calibration: three channels and a sensor (paper, eqs. 9 and 10).

use retina_files::InputError;
use retina_formats::{Channel, RadiometricCalibration, efficiencies};
use retina_geometry::Setup;

use crate::series::{self, SeriesScatter};
use crate::{ChannelResponse, PowerReadings};

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
    /// How far series repeat, where rows name theirs.
    pub series: Option<SeriesScatter>,
    /// The tables and their hashes.
    pub readings: PowerReadings,
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
    let file = readings.files.first().map(|file| file.path.clone()).unwrap_or_default();
    Err(InputError::new(&file, format!("the {} channel's readings show no light of the display", fit.channel.name()))
        .found(format!("{full:.2e} +- {sigma:.2e} W m^-2 of a pixel at count 255"))
        .expected(format!("more than {LEAST_SIGMAS} standard deviations"))
        .help("are irradiance_w_m2 and sigma_w_m2 in each other's places, and does the light change with the count?"))
}

impl Calibrated {
    /// Fits the readings' response.
    ///
    /// # Errors
    /// Readings that no rising response explains, or a sensor that sees none of the display's light.
    pub fn fit(setup: &Setup, mut readings: PowerReadings) -> Result<Self, InputError> {
        let series = series::settle(&mut readings);
        let fit = |channel: Channel| {
            let own = &readings.channels[channel as usize];
            let fit = ChannelResponse::fit(channel, own, &readings.files)?;
            Ok(fit.known_to(series.map_or(0.0, |series| series.channel_relative[channel as usize])))
        };
        let [r, g, b] = Channel::COLOURS;
        let mut fits = [fit(r)?, fit(g)?, fit(b)?];
        for fit in &fits {
            significant(fit, &readings)?;
        }
        let (efficiency, bandwidth_nm) = efficiencies(setup);
        if efficiency.iter().all(|&eta| eta == 0.0) {
            return Err(InputError::new(&setup.file, "the sensor sees none of the display's channels")
                .at("keys `noise.quantum_efficiency`, `screen.wavelength_nm`"));
        }
        let channels = [0, 1, 2].map(|c| fits[c].curve());
        let calibration =
            RadiometricCalibration { setup: setup.name.clone(), channels, efficiency, bandwidth_nm };
        let additivity = additivity(&calibration, &fits, &readings);
        let [stated, found] = [setup.brightest_magnitude(), calibration.magnitude([255; 3])];
        if (found - stated).abs() > UNLIKELY_MAG {
            fits[0].warnings.push(format!(
                "a white pixel at full count would be of magnitude {found:.2}, the setup says {stated:.2}: is irradiance_w_m2 \
                 in W m^-2 at the camera's pupil?"
            ));
        }
        fits[0].warnings.extend(series.as_ref().and_then(series::warning));
        Ok(Self { calibration, fits, additivity, series, readings })
    }

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
            (reading.irradiance_w_m2 - zero) / (reading.gain * reading.pixels() * sum)
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
