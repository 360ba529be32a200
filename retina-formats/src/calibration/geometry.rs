//! The geometry that a calibration file states: D, D^-1, and how uncertain it is.

use std::path::{Path, PathBuf};

use glam::DVec2;
use retina_files::InputError;
use retina_geometry::{CalibratedField, Distortion, InverseDistortion, MAX_DEGREE, RingField, Rings, Setup};
use retina_radiometry::ScreenResponse;

use super::file::{
    CalibrationFile, CovarianceRecord, DistortionRecord, FieldRecord, InverseRecord, RingsRecord,
};
use super::response::{MeasuredResponse, measured_or_power_law};

/// What a calibration knows of a facility: D, D^-1 with its dependence on irradiance, and the response by which
/// irradiance is meant.
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
    /// Covariance of the coefficients a of the inverse's terms and then of its rings, and then of b in the same order, row
    /// by row; absent where the file has none.
    pub covariance: Option<Vec<f64>>,
    /// The display's measured response; absent where the setup's power law holds.
    pub response: Option<MeasuredResponse>,
    /// The file it was read from.
    pub file: PathBuf,
}

/// D moves no line of sight by more than this, on the tangent plane: the rest is another file's numbers.
const MOST_SHIFT: f64 = 0.5;

impl Calibration {
    /// Reads a calibration and checks that it belongs to `setup` and that D can be inverted over the setup's screen.
    ///
    /// # Errors
    /// The file does not fit its schema, belongs to another setup, holds no geometry, or its D folds over.
    pub fn read(path: &Path, setup: &Setup) -> Result<Self, InputError> {
        Self::of_file(CalibrationFile::read(path, setup)?, path, setup)
    }

    /// Of a file at hand; `path` names it in errors.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn of_file(file: CalibrationFile, path: &Path, setup: &Setup) -> Result<Self, InputError> {
        check_provenance(path, &file, setup)?;
        let response = MeasuredResponse::of_file(&file, path, setup)?;
        let Some(record) = &file.distortion else {
            return Err(InputError::new(path, "the calibration has no geometry")
                .at("table `distortion`")
                .help(
                    "make one with `retina calibrate geometry --out` on the same file: it keeps the response",
                ));
        };
        let distortion = distortion(path, record, setup)?;
        let inverse = file.inverse.as_ref().map(|inverse| inverted(path, inverse)).transpose()?;
        let columns = inverse.as_ref().map_or(0, InverseDistortion::columns);
        let covariance = file.covariance.map(|covariance| matrix(path, covariance, columns)).transpose()?;
        Ok(Self {
            setup: file.setup,
            source: file.source,
            distortion,
            inverse,
            covariance,
            response,
            file: path.to_path_buf(),
        })
    }

    /// The response by which irradiance is meant: the measured one, or the setup's power law.
    pub fn screen_response(&self, setup: &Setup) -> ScreenResponse {
        measured_or_power_law(self.response.as_ref().map(|response| &response.curve), setup)
    }
}

fn distortion(path: &Path, record: &DistortionRecord, setup: &Setup) -> Result<Distortion, InputError> {
    let mut terms: Vec<(u32, u32, f64, f64)> = Vec::new();
    for (row, &(i, j, a, b)) in record.terms.iter().enumerate() {
        let place = format!("key `distortion.terms`, row {}", row + 1);
        check_term(path, &place, &[i, j], &[a, b])?;
        if let Some(before) = terms.iter().position(|term| (term.0, term.1) == (i as u32, j as u32)) {
            return Err(twice(path, &place, &format!("x^{i} y^{j}"), before));
        }
        terms.push((i as u32, j as u32, a, b));
    }
    let distortion = Distortion::from_terms(&terms);
    let screen = setup.facility_pinhole();
    distortion.check_over(&screen).map_err(|error| {
        InputError::new(path, error.to_string())
            .at("key `distortion.terms`")
            .help("check the coefficients: D must be one-to-one over the screen")
    })?;
    let (width, height) = (f64::from(screen.width_px), f64::from(screen.height_px));
    for corner in [DVec2::ZERO, DVec2::new(width, 0.0), DVec2::new(0.0, height), DVec2::new(width, height)] {
        let sight = screen.line_of_sight(corner);
        let shift = (distortion.distort(sight) - sight).length();
        if shift.is_nan() || shift > MOST_SHIFT {
            return Err(InputError::new(path, "D moves lines of sight beyond anything that lenses do")
                .at("key `distortion.terms`")
                .found(format!("a shift of {shift:.3e} (tangent) at the screen's corner"))
                .expected(format!("at most {MOST_SHIFT}"))
                .help("coefficients act on lines of sight (x, y, 1), not on pixels"));
        }
    }
    Ok(distortion)
}

fn twice(path: &Path, place: &str, term: &str, before: usize) -> InputError {
    InputError::new(path, "the term is given twice")
        .at(place)
        .found(term)
        .expected(format!("each term once; row {} has it, too", before + 1))
        .help("add the coefficients, or delete one of the rows")
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

/// The setup's name alone does not say that nothing was changed since.
fn check_provenance(path: &Path, file: &CalibrationFile, setup: &Setup) -> Result<(), InputError> {
    let Some(stated) = &file.provenance else { return Ok(()) };
    let expected = CalibrationFile::provenance_of(setup);
    for (key, what) in [("k_f_px", "K_f"), ("camera_px", "camera")] {
        let numbers = |table: &toml::Table| -> Option<Vec<f64>> {
            let values = table.get(key)?.as_array()?.iter();
            values.map(|v| v.as_float().or_else(|| v.as_integer().map(|i| i as f64))).collect()
        };
        let expected = numbers(&expected).unwrap_or_default();
        let Some(found) = numbers(stated).filter(|found| found.len() == expected.len()) else {
            return Err(InputError::new(
                path,
                format!("the calibration does not say with which {what} it was made"),
            )
            .at(format!("key `provenance.{key}`"))
            .expected(format!("{} numbers, as {expected:?}", expected.len()))
            .help("calibrate again, or delete the table [provenance] of a file written by hand"));
        };
        // Digits are lost where a file is written by hand; a millionth of a pixel focal length is none.
        if found.iter().zip(&expected).any(|(a, b)| a.is_nan() || (a - b).abs() > 1e-6 * b.abs().max(1.0)) {
            return Err(InputError::new(path, format!("the calibration was made with another {what}"))
                .at(format!("key `provenance.{key}`"))
                .found(format!("{found:?}"))
                .expected(format!("{expected:?}, those of setup `{}`", setup.name))
                .help("calibrate again after a change of the setup"));
        }
    }
    Ok(())
}

/// The whole matrix, a before b, row by row.
fn matrix(path: &Path, record: CovarianceRecord, terms: usize) -> Result<Vec<f64>, InputError> {
    let triangle = record.lower_triangle;
    let refused = |problem: &str| InputError::new(path, problem).at("key `covariance.lower_triangle`");
    let numbers = |rows: usize| rows * (rows + 1) / 2;
    let equal = triangle.len() == numbers(terms);
    if !equal && triangle.len() != numbers(2 * terms) {
        return Err(refused("is no covariance of the inverse's coefficients")
            .found(format!("{} numbers", triangle.len()))
            .expected(format!(
                "{} for {terms} coefficients a and as many b, or {} if both are alike",
                numbers(2 * terms),
                numbers(terms)
            )));
    }
    let side = 2 * terms;
    let mut out = vec![0.0; side * side];
    let mut next = triangle.into_iter();
    for row in 0..if equal { terms } else { side } {
        for (column, value) in (0..=row).zip(&mut next) {
            if !value.is_finite() || (row == column && value < 0.0) {
                return Err(refused("holds a number that is no covariance").found(value));
            }
            for first in if equal { vec![0, terms] } else { vec![0] } {
                out[(first + row) * side + first + column] = value;
                out[(first + column) * side + first + row] = value;
            }
        }
    }
    Ok(out)
}

fn inverted(path: &Path, record: &InverseRecord) -> Result<InverseDistortion, InputError> {
    let mut terms: Vec<([u32; 3], DVec2)> = Vec::new();
    for (row, &(i, j, k, a, b)) in record.terms.iter().enumerate() {
        let place = format!("key `inverse.terms`, row {}", row + 1);
        check_term(path, &place, &[i, j, k], &[a, b])?;
        let powers = [i as u32, j as u32, k as u32];
        if let Some(before) = terms.iter().position(|term| term.0 == powers) {
            return Err(twice(path, &place, &format!("x^{i} y^{j} L^{k}"), before));
        }
        terms.push((powers, DVec2::new(a, b)));
    }
    let [low, high] = record.range_log10_irradiance;
    let reference = record.reference_log10_irradiance;
    if !(low.is_finite() && high.is_finite() && low <= high && reference.is_finite()) {
        return Err(InputError::new(path, "the range of irradiance is none")
            .at("key `inverse.range_log10_irradiance`")
            .found(format!("[{low}, {high}]"))
            .expected("two finite numbers, the lower one first, and a finite reference"));
    }
    let field = record.field.as_ref().map(|field| field_of(path, field)).transpose()?;
    Ok(InverseDistortion {
        terms,
        field,
        rings: record.rings.as_ref().map(|rings| ringed(path, rings)).transpose()?,
        reference_log10_irradiance: reference,
        range_log10_irradiance: record.range_log10_irradiance,
    })
}

fn field_of(path: &Path, record: &FieldRecord) -> Result<CalibratedField, InputError> {
    let (low, high, radius) = (DVec2::from(record.low), DVec2::from(record.high), record.radius);
    let finite = low.is_finite() && high.is_finite() && radius.is_finite();
    if !(finite && low.cmple(high).all() && radius >= 0.0) {
        return Err(InputError::new(path, "the calibrated field is none")
            .at("key `inverse.field`")
            .found(format!("low {low}, high {high}, radius {radius}"))
            .expected("finite numbers, low not above high, a radius from 0"));
    }
    Ok(CalibratedField { low, high, radius })
}

/// More are a slip of the pen.
const MOST_RINGS: usize = 1000;

fn ringed(path: &Path, record: &RingsRecord) -> Result<RingField, InputError> {
    let refused = |key: &str| {
        InputError::new(path, "the rings of D^-1 do not fit").at(format!("key `inverse.rings.{key}`"))
    };
    let [x, y] = record.center;
    if !(x.is_finite() && y.is_finite()) {
        return Err(refused("center").found(format!("[{x}, {y}]")).expected("two finite numbers"));
    }
    if !(record.radius.is_finite() && record.radius > 0.0) {
        return Err(refused("radius").found(record.radius).expected("a finite number above 0"));
    }
    let count = record.terms.len();
    if !(1..=MOST_RINGS).contains(&count) {
        let expected = format!("1 to {MOST_RINGS}");
        return Err(refused("terms").found(format!("{count} rows")).expected(expected));
    }
    if let Some(row) = record.terms.iter().position(|row| row.iter().any(|value| !value.is_finite())) {
        let found = format!("{:?} in row {}", record.terms[row], row + 1);
        return Err(refused("terms").found(found).expected("finite numbers"));
    }
    let rings = Rings { center: DVec2::new(x, y), radius: record.radius, intervals: count as u32 };
    let columns = |[ax, ay, bx, by]: &[f64; 4]| [DVec2::new(*ax, *bx), DVec2::new(*ay, *by)];
    Ok(RingField { rings, coefficients: record.terms.iter().flat_map(columns).collect() })
}
