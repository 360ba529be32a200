//! The table `[response]` of `calibration.toml`, schema `retina.calibration/1`.

use std::path::Path;

use retina_files::{InputError, read_schema};
use retina_geometry::Setup;
use retina_radiometry::ScreenResponse;
use serde::{Deserialize, Serialize};

use crate::calibration::{efficiencies, wavelengths_nm};
use crate::channel::COVARIANCE_OF;
use crate::{Calibrated, ChannelCurve, ChannelResponse, Estimate, RadiometricCalibration};

/// Schema of the file.
const SCHEMA: &str = "retina.calibration/1";
/// Efficiencies that differ by more are of another sensor; files keep all digits.
const SAME_SENSOR: f64 = 1e-6;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ResponseTable {
    wavelength_nm: [f64; 3],
    efficiency: [f64; 3],
    bandwidth_nm: f64,
    magnitude_range: [f64; 2],
    /// The setup that was measured.
    measured_with: String,
    data: Vec<DataFile>,
    r: ChannelTable,
    g: ChannelTable,
    b: ChannelTable,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct DataFile {
    file: String,
    blake3: String,
}

/// Pairs are value and standard deviation.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ChannelTable {
    gamma: [f64; 2],
    full_w_m2: [f64; 2],
    black: [f64; 2],
    #[serde(skip_serializing_if = "Option::is_none")]
    zero_w_m2: Option<[f64; 2]>,
    covariance_of: Vec<String>,
    covariance: Vec<Vec<f64>>,
    knots: usize,
    readings: usize,
    outliers: usize,
    rms_relative: f64,
    irradiance_w_m2: Vec<f64>,
    sigma_w_m2: Vec<f64>,
}

impl ChannelTable {
    fn of(fit: &ChannelResponse) -> Self {
        let pair = |estimate: Estimate| [estimate.value, estimate.sigma];
        Self {
            gamma: pair(fit.gamma),
            full_w_m2: pair(fit.full_w_m2),
            black: pair(fit.black),
            zero_w_m2: fit.zero_w_m2.map(pair),
            covariance_of: COVARIANCE_OF[..fit.covariance.len()].iter().map(|&name| name.into()).collect(),
            covariance: fit.covariance.clone(),
            knots: fit.knots,
            readings: fit.readings,
            outliers: fit.outliers.len(),
            rms_relative: fit.rms_relative,
            irradiance_w_m2: fit.irradiance_w_m2.clone(),
            sigma_w_m2: fit.sigma_w_m2.clone(),
        }
    }

    fn curve(self, path: &Path, key: &str) -> Result<ChannelCurve, InputError> {
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
            irradiance_w_m2: self.irradiance_w_m2,
            sigma_w_m2: self.sigma_w_m2,
            zero_w_m2: self.zero_w_m2.map(|zero| zero[0]),
            covariance: self.covariance,
        })
    }
}

/// The text of `calibration.toml` with this response. Where `path` is a calibration of the same setup already,
/// its other tables are kept (comments are not).
///
/// # Errors
/// `path` holds something that is not a calibration, or one of another setup.
pub fn calibration_text(
    path: &Path,
    calibrated: &Calibrated,
    measured_with: &Setup,
) -> Result<String, InputError> {
    let calibration = &calibrated.calibration;
    let mut file = if path.exists() { existing(path, &calibration.setup)? } else { toml::Table::new() };
    let text = |value: &str| toml::Value::String(value.to_owned());
    file.insert("schema".into(), text(SCHEMA));
    file.insert("setup".into(), text(&calibration.setup));
    let [r, g, b] = [0, 1, 2].map(|c| ChannelTable::of(&calibrated.fits[c]));
    let range = calibration.magnitude_range();
    let name = |path: &Path| path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
    let table = ResponseTable {
        wavelength_nm: wavelengths_nm(measured_with),
        efficiency: calibration.efficiency,
        bandwidth_nm: calibration.bandwidth_nm,
        magnitude_range: [range.brightest, range.faintest],
        measured_with: measured_with.name.clone(),
        data: calibrated
            .readings
            .files
            .iter()
            .map(|(path, blake3)| DataFile { file: name(path), blake3: blake3.clone() })
            .collect(),
        r,
        g,
        b,
    };
    let unwritten = |error: toml::ser::Error| {
        InputError::new(path, format!("the calibration cannot be put into TOML: {error}"))
    };
    file.insert("response".into(), toml::Value::try_from(table).map_err(unwritten)?);
    toml::to_string(&file).map_err(unwritten)
}

/// A calibration file as it is, checked to be `setup`'s.
fn existing(path: &Path, setup: &str) -> Result<toml::Table, InputError> {
    let file: toml::Table = read_schema(path, SCHEMA, "a calibration")?;
    let found = |key: &str| file.get(key).and_then(toml::Value::as_str).unwrap_or("nothing").to_owned();
    if found("setup") != setup {
        return Err(InputError::new(path, "the calibration belongs to another setup")
            .at("key `setup`")
            .found(format!("`{}`", found("setup")))
            .expected(format!("`{setup}`"))
            .help("the response changes with the magnification: `retina calibrate radiometry --for-setup` carries it over"));
    }
    Ok(file)
}

/// The response that screen images are encoded with, of a calibration file; `None` where none was measured.
///
/// # Errors
/// As [`RadiometricCalibration::read`].
pub fn screen_response(path: &Path, setup: &Setup) -> Result<Option<ScreenResponse>, InputError> {
    RadiometricCalibration::read(path, setup)?.map(|read| read.screen_response(path)).transpose()
}

impl RadiometricCalibration {
    /// Reads the response of a calibration file; `None` where it has none.
    ///
    /// # Errors
    /// The file does not fit its schema, belongs to another setup or another sensor, or its response does
    /// not rise.
    pub fn read(path: &Path, setup: &Setup) -> Result<Option<Self>, InputError> {
        let mut file = existing(path, &setup.name)?;
        let Some(response) = file.remove("response") else { return Ok(None) };
        let table: ResponseTable = response.try_into().map_err(|error: toml::de::Error| {
            InputError::new(path, error.message().lines().next().unwrap_or("not a response").to_owned())
                .at("table `response`")
                .help("calibrate again with `retina calibrate radiometry`")
        })?;
        let (efficiency, bandwidth_nm) = efficiencies(setup);
        let differs = |a: f64, b: f64| (a - b).abs() > SAME_SENSOR * b.abs().max(1e-3) || a.is_nan();
        if (0..3).any(|c| differs(table.efficiency[c], efficiency[c]))
            || differs(table.bandwidth_nm, bandwidth_nm)
        {
            return Err(InputError::new(
                path,
                "the response was made for another sensor or other wavelengths",
            )
            .at("keys `response.efficiency`, `response.bandwidth_nm`")
            .found(format!("{:.4?}, {:.2} nm", table.efficiency, table.bandwidth_nm))
            .expected(format!("{efficiency:.4?}, {bandwidth_nm:.2} nm, of setup `{}`", setup.name))
            .help("calibrate again: the readings are the same, the weights of eq. 10 are not"));
        }
        let channels = [table.r.curve(path, "r")?, table.g.curve(path, "g")?, table.b.curve(path, "b")?];
        Ok(Some(Self { setup: setup.name.clone(), channels, efficiency, bandwidth_nm }))
    }
}
