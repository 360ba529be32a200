//! The facility's calibration: `calibration.toml`, schema `retina.calibration/1`.

use std::path::{Path, PathBuf};

use retina_files::{InputError, read_toml};
use serde::Deserialize;

use crate::{Distortion, MAX_DEGREE, Setup};

/// What a calibration knows of a facility: today its distortion D.
#[derive(Debug, Clone)]
pub struct Calibration {
    /// Name of the setup it belongs to.
    pub setup: String,
    /// Where the figures come from.
    pub source: String,
    /// D: what the facility does to a line of sight.
    pub distortion: Distortion,
    /// The file it was read from.
    pub file: PathBuf,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CalibrationFile {
    schema: String,
    setup: String,
    #[serde(default)]
    source: String,
    distortion: DistortionFile,
    /// The display's measured response, which the radiometric calibration reads.
    #[serde(default, rename = "response")]
    _response: Option<serde::de::IgnoredAny>,
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
        let file: CalibrationFile = read_toml(path)?;
        if file.schema != "retina.calibration/1" {
            return Err(InputError::new(path, "is not a calibration")
                .at("key `schema`")
                .found(format!("`{}`", file.schema))
                .expected("`retina.calibration/1`"));
        }
        if file.setup != setup.name {
            return Err(InputError::new(path, "the calibration belongs to another setup")
                .at("key `setup`")
                .found(format!("`{}`", file.setup))
                .expected(format!("`{}`", setup.name))
                .help("use this setup's own calibration; distortion changes with the magnification"));
        }
        let mut terms = Vec::new();
        for (row, &(i, j, a, b)) in file.distortion.terms.iter().enumerate() {
            let place = format!("key `distortion.terms`, row {}", row + 1);
            let degree = f64::from(MAX_DEGREE);
            let whole = |power: f64| power.fract() == 0.0 && (0.0..=degree).contains(&power);
            if !whole(i) || !whole(j) || i + j > degree {
                return Err(InputError::new(path, "the powers of x and y do not fit")
                    .at(place)
                    .found(format!("x^{i} y^{j}"))
                    .expected(format!("whole numbers from 0, together at most {MAX_DEGREE}")));
            }
            if !a.is_finite() || !b.is_finite() {
                return Err(InputError::new(path, "a coefficient is not finite")
                    .at(place)
                    .found(format!("{a}, {b}")));
            }
            terms.push((i as u32, j as u32, a, b));
        }
        let distortion = Distortion::from_terms(&terms);
        distortion.check_over(&setup.facility_pinhole()).map_err(|error| {
            InputError::new(path, error.to_string())
                .at("key `distortion.terms`")
                .help("check the coefficients: D must be one-to-one over the screen")
        })?;
        Ok(Self { setup: file.setup, source: file.source, distortion, file: path.to_path_buf() })
    }
}
