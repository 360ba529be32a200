//! The response of a facility: what a pixel of any digital counts sends into the camera's pupil (paper, eqs. 9 and 10).

use std::path::Path;

use retina_files::InputError;
use retina_geometry::Setup;
use retina_radiometry::{DigitalCounts, QuantumEfficiency, ScreenResponse, magnitude_of_irradiance};

use super::file::{CalibrationFile, ChannelRecord, ResponseRecord};

/// Efficiencies that differ by more are of another sensor; files keep all digits.
const SAME_SENSOR: f64 = 1e-6;

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

/// The light at count 0 among the rows of [`ChannelCurve::covariance`].
const COVARIANCE_DARK: usize = 2;

impl ChannelCurve {
    /// The same display where a pixel's light at the pupil is `factor` times as much. The zero is the meter's own.
    pub fn scale(&mut self, factor: f64) {
        self.irradiance_w_m2.iter_mut().chain(&mut self.sigma_w_m2).for_each(|value| *value *= factor);
        for (i, row) in self.covariance.iter_mut().enumerate() {
            for (j, value) in row.iter_mut().enumerate() {
                *value *= factor.powi(i32::from(i == COVARIANCE_DARK) + i32::from(j == COVARIANCE_DARK));
            }
        }
    }
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

impl ChannelRecord {
    fn curve(&self, path: &Path, key: &str) -> Result<ChannelCurve, InputError> {
        let (light, sigma) = (&self.irradiance_w_m2, &self.sigma_w_m2);
        let length = |values: &[f64], name: &str| {
            if values.len() == 256 {
                return Ok(());
            }
            Err(InputError::new(path, "the response does not have a value a count")
                .at(format!("key `response.{key}.{name}`"))
                .found(format!("{} values", values.len()))
                .expected("256"))
        };
        length(light, "irradiance_w_m2")?;
        length(sigma, "sigma_w_m2")?;
        let fall =
            light.windows(2).position(|pair| !(pair[1] > pair[0] && pair[0] >= 0.0 && pair[1].is_finite()));
        if let Some(count) = fall {
            return Err(InputError::new(path, "the response does not rise with the count")
                .at(format!("key `response.{key}.irradiance_w_m2`"))
                .found(format!(
                    "{:e} at count {count}, {:e} at {}",
                    light[count],
                    light[count + 1],
                    count + 1
                ))
                .expected("0 or more at count 0, and more at each higher count"));
        }
        if let Some(count) = sigma.iter().position(|s| !(s.is_finite() && *s >= 0.0)) {
            return Err(InputError::new(path, "an uncertainty is no standard deviation")
                .at(format!("key `response.{key}.sigma_w_m2`"))
                .found(format!("{} at count {count}", sigma[count]))
                .expected("a finite number, 0 or more"));
        }
        let side = self.covariance_of.len();
        if self.covariance.len() != side || self.covariance.iter().any(|row| row.len() != side) {
            return Err(InputError::new(path, "the covariance is not as large as what it is of")
                .at(format!("key `response.{key}.covariance`"))
                .expected(format!("{side} rows of {side}")));
        }
        Ok(ChannelCurve {
            irradiance_w_m2: self.irradiance_w_m2.clone(),
            sigma_w_m2: self.sigma_w_m2.clone(),
            zero_w_m2: self.zero_w_m2.map(|zero| zero[0]),
            covariance: self.covariance.clone(),
        })
    }
}

/// A measured response as the file keeps it, with the curve that digital counts follow.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasuredResponse {
    /// The table `[response]`.
    pub record: ResponseRecord,
    /// The response that screen images are encoded with.
    pub curve: ScreenResponse,
}

impl MeasuredResponse {
    /// Reads the response of a calibration file; `None` where it has none.
    ///
    /// # Errors
    /// As [`RadiometricCalibration::read`].
    pub fn read(path: &Path, setup: &Setup) -> Result<Option<Self>, InputError> {
        Self::of_file(&CalibrationFile::read(path, setup)?, path, setup)
    }

    /// Of a file at hand; `path` names it in errors.
    ///
    /// # Errors
    /// As [`RadiometricCalibration::read`].
    pub fn of_file(file: &CalibrationFile, path: &Path, setup: &Setup) -> Result<Option<Self>, InputError> {
        let Some(record) = &file.response else { return Ok(None) };
        let curve = RadiometricCalibration::of_record(record, path, setup)?.screen_response(path)?;
        Ok(Some(Self { record: record.clone(), curve }))
    }
}

/// The measured curve, or the power law that the setup states.
pub fn measured_or_power_law(measured: Option<&ScreenResponse>, setup: &Setup) -> ScreenResponse {
    measured
        .cloned()
        .unwrap_or_else(|| ScreenResponse::power_law(setup.response_gamma(), setup.brightest_magnitude()))
}

impl RadiometricCalibration {
    /// Reads the response of a calibration file; `None` where it has none.
    ///
    /// # Errors
    /// The file does not fit its schema, belongs to another setup or another sensor, or its response does
    /// not rise.
    pub fn read(path: &Path, setup: &Setup) -> Result<Option<Self>, InputError> {
        Self::of_file(&CalibrationFile::read(path, setup)?, path, setup)
    }

    /// Of a file at hand; `path` names it in errors.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn of_file(file: &CalibrationFile, path: &Path, setup: &Setup) -> Result<Option<Self>, InputError> {
        file.response.as_ref().map(|record| Self::of_record(record, path, setup)).transpose()
    }

    /// Of a file's table.
    pub(crate) fn of_record(record: &ResponseRecord, path: &Path, setup: &Setup) -> Result<Self, InputError> {
        let (efficiency, bandwidth_nm) = efficiencies(setup);
        let differs = |a: f64, b: f64| (a - b).abs() > SAME_SENSOR * b.abs().max(1e-3) || a.is_nan();
        if (0..3).any(|c| differs(record.efficiency[c], efficiency[c]))
            || differs(record.bandwidth_nm, bandwidth_nm)
        {
            return Err(InputError::new(
                path,
                "the response was made for another sensor or other wavelengths",
            )
            .at("keys `response.efficiency`, `response.bandwidth_nm`")
            .found(format!("{:.4?}, {:.2} nm", record.efficiency, record.bandwidth_nm))
            .expected(format!("{efficiency:.4?}, {bandwidth_nm:.2} nm, of setup `{}`", setup.name))
            .help("calibrate again: the readings are the same, the weights of eq. 10 are not"));
        }
        let channels = [record.r.curve(path, "r")?, record.g.curve(path, "g")?, record.b.curve(path, "b")?];
        Ok(Self { setup: setup.name.clone(), channels, efficiency, bandwidth_nm })
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
        channels.iter_mut().for_each(|curve| curve.scale(factor));
        let (efficiency, bandwidth_nm) = efficiencies(other);
        Ok(Self { setup: other.name.clone(), channels, efficiency, bandwidth_nm })
    }
}
