//! The facility's calibration: `calibration.toml`, schema `retina.calibration/1`.

use std::path::{Path, PathBuf};

use retina_files::{InputError, read_schema};
use serde::Deserialize;
use serde::de::IgnoredAny;

use crate::{Distortion, InverseDistortion, MAX_DEGREE, Setup};
use glam::DVec2;

/// What a calibration knows of a facility: D, and D^-1 with its dependence on irradiance.
#[derive(Debug, Clone)]
pub struct Calibration {
    /// Name of the setup it belongs to.
    pub setup: String,
    /// Where the figures come from.
    pub source: String,
    /// D: what the facility does to a line of sight; of a calibration with an inverse, at its reference irradiance.
    pub distortion: Distortion,
    /// D^-1 as it was fitted, for points of light; absent in calibrations that state D alone.
    pub inverse: Option<InverseDistortion>,
    /// Covariance of the coefficients a of the inverse's terms, and again of b, row by row; absent where the file has
    /// none.
    pub covariance: Option<Vec<f64>>,
    /// The file it was read from.
    pub file: PathBuf,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CalibrationFile {
    #[serde(rename = "schema")]
    _schema: IgnoredAny,
    setup: String,
    #[serde(default)]
    source: String,
    distortion: DistortionFile,
    inverse: Option<InverseFile>,
    provenance: Option<ProvenanceFile>,
    covariance: Option<CovarianceFile>,
    /// The display's measured response, which the radiometric calibration reads.
    #[serde(default, rename = "response")]
    _response: Option<serde::de::IgnoredAny>,
}

/// D^-1(r, L): rows `[i, j, k, a, b]`, the undistorted x gains a x^i y^j L^k and y gains b x^i y^j L^k.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct InverseFile {
    reference_log10_irradiance: f64,
    range_log10_irradiance: [f64; 2],
    terms: Vec<(f64, f64, f64, f64, f64)>,
}

/// Of the coefficients a in the order of the inverse's terms, and again of b: the lower triangle, row by row.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CovarianceFile {
    lower_triangle: Vec<f64>,
}

/// What it was measured with; further keys are for people.
#[derive(Deserialize)]
struct ProvenanceFile {
    /// f_x, f_y, c_x, c_y of K_f.
    k_f_px: [f64; 4],
    /// f_x, f_y, c_x, c_y of C, and its size.
    camera_px: [f64; 6],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DistortionFile {
    /// Rows `[i, j, a, b]`: r_x gains a x^i y^j and r_y gains b x^i y^j.
    terms: Vec<(f64, f64, f64, f64)>,
}

impl Calibration {
    /// Reads a calibration and checks that it belongs to `setup` and that D can be inverted over
    /// the setup's screen.
    ///
    /// # Errors
    /// The file does not fit its schema, belongs to another setup, or its D folds over.
    pub fn read(path: &Path, setup: &Setup) -> Result<Self, InputError> {
        let file: CalibrationFile = read_schema(path, "retina.calibration/1", "a calibration")?;
        if file.setup != setup.name {
            return Err(InputError::new(path, "the calibration belongs to another setup")
                .at("key `setup`")
                .found(format!("`{}`", file.setup))
                .expected(format!("`{}`", setup.name))
                .help("use this setup's own calibration; distortion changes with the magnification"));
        }
        if let Some(provenance) = &file.provenance {
            provenance.check(path, setup)?;
        }
        let mut terms = Vec::new();
        for (row, &(i, j, a, b)) in file.distortion.terms.iter().enumerate() {
            let place = format!("key `distortion.terms`, row {}", row + 1);
            check_term(path, &place, &[i, j], &[a, b])?;
            terms.push((i as u32, j as u32, a, b));
        }
        let distortion = Distortion::from_terms(&terms);
        distortion.check_over(&setup.facility_pinhole()).map_err(|error| {
            InputError::new(path, error.to_string())
                .at("key `distortion.terms`")
                .help("check the coefficients: D must be one-to-one over the screen")
        })?;
        let inverse = file.inverse.map(|inverse| inverse.checked(path)).transpose()?;
        let terms = inverse.as_ref().map_or(0, |inverse| inverse.terms.len());
        let covariance = file.covariance.map(|covariance| covariance.checked(path, terms)).transpose()?;
        Ok(Self {
            setup: file.setup,
            source: file.source,
            distortion,
            inverse,
            covariance,
            file: path.to_path_buf(),
        })
    }
}

/// Powers (the first two of x and y, a third of L) and coefficients of a row.
fn check_term(path: &Path, place: &str, powers: &[f64], coefficients: &[f64]) -> Result<(), InputError> {
    let degree = f64::from(MAX_DEGREE);
    let whole = |power: &f64| power.fract() == 0.0 && (0.0..=degree).contains(power);
    if !powers.iter().all(whole) || powers[0] + powers[1] > degree {
        return Err(InputError::new(path, "the powers of x and y do not fit")
            .at(place)
            .found(format!("x^{} y^{}", powers[0], powers[1]))
            .expected(format!("whole numbers from 0, together at most {MAX_DEGREE}")));
    }
    if !coefficients.iter().all(|c| c.is_finite()) {
        return Err(InputError::new(path, "a coefficient is not finite")
            .at(place)
            .found(format!("{coefficients:?}")));
    }
    Ok(())
}

impl ProvenanceFile {
    /// The name alone does not say that nothing was changed since.
    fn check(&self, path: &Path, setup: &Setup) -> Result<(), InputError> {
        let (k, c) = (setup.facility_pinhole(), setup.camera_pinhole());
        let k_f_px = [k.fx_px, k.fy_px, k.cx_px, k.cy_px];
        let size = [f64::from(c.width_px), f64::from(c.height_px)];
        let camera_px = [c.fx_px, c.fy_px, c.cx_px, c.cy_px, size[0], size[1]];
        // Digits are lost where a file is written by hand; a millionth of a pixel focal length is none.
        let same =
            |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-6 * b.abs().max(1.0));
        let (key, what, found, expected) = if !same(&self.k_f_px, &k_f_px) {
            ("k_f_px", "K_f", &self.k_f_px[..], &k_f_px[..])
        } else if !same(&self.camera_px, &camera_px) {
            ("camera_px", "camera", &self.camera_px[..], &camera_px[..])
        } else {
            return Ok(());
        };
        Err(InputError::new(path, format!("the calibration was made with another {what}"))
            .at(format!("key `provenance.{key}`"))
            .found(format!("{found:?}"))
            .expected(format!("{expected:?}, those of setup `{}`", setup.name))
            .help("calibrate again after a change of the setup"))
    }
}

impl CovarianceFile {
    /// The whole matrix, row by row.
    fn checked(self, path: &Path, terms: usize) -> Result<Vec<f64>, InputError> {
        let triangle = self.lower_triangle;
        let refused = |problem: &str| InputError::new(path, problem).at("key `covariance.lower_triangle`");
        if triangle.len() != terms * (terms + 1) / 2 {
            return Err(refused("is no covariance of the inverse's coefficients")
                .found(format!("{} numbers", triangle.len()))
                .expected(format!("{} for {terms} terms", terms * (terms + 1) / 2)));
        }
        let mut out = vec![0.0; terms * terms];
        let mut next = triangle.into_iter();
        for row in 0..terms {
            for (column, value) in (0..=row).zip(&mut next) {
                if !value.is_finite() || (row == column && value < 0.0) {
                    return Err(refused("holds a number that is no covariance").found(value));
                }
                out[row * terms + column] = value;
                out[column * terms + row] = value;
            }
        }
        Ok(out)
    }
}

impl InverseFile {
    fn checked(self, path: &Path) -> Result<InverseDistortion, InputError> {
        let mut terms = Vec::new();
        for (row, &(i, j, k, a, b)) in self.terms.iter().enumerate() {
            let place = format!("key `inverse.terms`, row {}", row + 1);
            check_term(path, &place, &[i, j, k], &[a, b])?;
            terms.push(([i as u32, j as u32, k as u32], DVec2::new(a, b)));
        }
        let [low, high] = self.range_log10_irradiance;
        if !(low.is_finite()
            && high.is_finite()
            && low <= high
            && self.reference_log10_irradiance.is_finite())
        {
            return Err(InputError::new(path, "the range of irradiance is none")
                .at("key `inverse.range_log10_irradiance`")
                .found(format!("[{low}, {high}]"))
                .expected("two finite numbers, the lower one first, and a finite reference"));
        }
        Ok(InverseDistortion {
            terms,
            reference_log10_irradiance: self.reference_log10_irradiance,
            range_log10_irradiance: self.range_log10_irradiance,
        })
    }
}
