//! The file as it stands: every key, read and written here alone.

use std::fmt::Write as _;
use std::path::Path;

use retina_files::{InputError, read_schema, write_atomic};
use retina_geometry::Setup;
use retina_radiometry::ScreenResponse;
use serde::de::IgnoredAny;
use serde::{Deserialize, Serialize};

use super::response::{MeasuredResponse, measured_or_power_law};
use crate::channel::{Channel, log10_irradiance};

/// A response may move L by this much where D^-1 depends on L: a twentieth of the calibrated range.
const MOST_L_MOVED: f64 = 0.1;
/// Schema of the file.
const SCHEMA: &str = "retina.calibration/1";

/// A calibration file, key by key. [`super::Calibration`] and [`super::RadiometricCalibration`] are what it means.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibrationFile {
    #[serde(rename = "schema")]
    schema: SchemaKey,
    /// Name of the setup it belongs to.
    pub setup: String,
    /// Where the figures come from.
    #[serde(default)]
    pub source: String,
    /// D.
    pub distortion: Option<DistortionRecord>,
    /// D^-1 with its dependence on irradiance.
    pub inverse: Option<InverseRecord>,
    /// Covariance of the coefficients of D^-1.
    pub covariance: Option<CovarianceRecord>,
    /// What the geometry was measured with: `k_f_px`, `camera_px`, and keys for people.
    pub provenance: Option<toml::Table>,
    /// The display's measured response.
    pub response: Option<ResponseRecord>,
}

/// [`read_schema`] has checked the key; it holds nothing else.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct SchemaKey;

impl<'de> Deserialize<'de> for SchemaKey {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        IgnoredAny::deserialize(deserializer).map(|_| Self)
    }
}

/// r = D(r_u): rows `[i, j, a, b]`, r_x gains a x^i y^j and r_y gains b x^i y^j.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DistortionRecord {
    /// The rows.
    pub terms: Vec<(f64, f64, f64, f64)>,
}

/// r_u = D^-1(r, L): rows `[i, j, k, a, b]`, x gains a x^i y^j L^k and y gains b x^i y^j L^k.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InverseRecord {
    /// L at which D is given.
    pub reference_log10_irradiance: f64,
    /// Lowest and highest L that were calibrated.
    pub range_log10_irradiance: [f64; 2],
    /// Where lines of sight were calibrated; D^-1 goes on straight beyond.
    pub field: Option<FieldRecord>,
    /// The rows.
    pub terms: Vec<(f64, f64, f64, f64, f64)>,
    /// What is added ring by ring.
    pub rings: Option<RingsRecord>,
}

/// Where lines of sight were calibrated: in this rectangle, and in this disc about its middle.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FieldRecord {
    /// The rectangle's corner of the smallest x and y.
    pub low: [f64; 2],
    /// That of the largest.
    pub high: [f64; 2],
    /// The disc's radius.
    pub radius: f64,
}

/// Added to r_u, for the cubic B-splines B of |r - center| about 2 h, 3 h, ... radius + h, with h = radius / rows:
/// x gains (a_x dx + a_y dy) B, y gains (b_x dx + b_y dy) B, where (dx, dy) = (r - center) / radius.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RingsRecord {
    /// The centre, a line of sight.
    pub center: [f64; 2],
    /// Distance of the last knot; farther out the splines keep their values.
    pub radius: f64,
    /// A row a spline: `[a_x, a_y, b_x, b_y]`.
    pub terms: Vec<[f64; 4]>,
}

/// Covariance of the coefficients a, in the order of the inverse's terms and then of its rings (a_x, a_y of the first, of
/// the second, ...), and then of b in the same order. With half as many rows it is that of a, and again of b, and the two
/// are independent.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CovarianceRecord {
    /// The lower triangle, row by row.
    pub lower_triangle: Vec<f64>,
}

/// The table `[response]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ResponseRecord {
    /// Effective wavelengths of red, green, blue, nm.
    pub wavelength_nm: [f64; 3],
    /// eta at those wavelengths (paper, eq. 9).
    pub efficiency: [f64; 3],
    /// Integral of eta, nm.
    pub bandwidth_nm: f64,
    /// Brightest and faintest magnitude that one pixel can show.
    pub magnitude_range: [f64; 2],
    /// The setup that was measured.
    pub measured_with: String,
    /// The readings' files.
    pub data: Vec<DataRecord>,
    /// Red.
    pub r: ChannelRecord,
    /// Green.
    pub g: ChannelRecord,
    /// Blue.
    pub b: ChannelRecord,
}

/// A file that a calibration came from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DataRecord {
    /// Its name without the folder.
    pub file: String,
    /// BLAKE3 of its bytes.
    pub blake3: String,
}

/// The response of one channel. Pairs are value and standard deviation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChannelRecord {
    /// Exponent of the power law that fits best.
    pub gamma: [f64; 2],
    /// A pixel's irradiance at count 255, W m^-2.
    pub full_w_m2: [f64; 2],
    /// A pixel's light at count 0 over that at 255.
    pub black: [f64; 2],
    /// The meter's reading where no square is lit, W m^-2.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub zero_w_m2: Option<[f64; 2]>,
    /// What the rows of `covariance` are.
    pub covariance_of: Vec<String>,
    /// Covariance of those.
    pub covariance: Vec<Vec<f64>>,
    /// Knots of ln I over ln B; 2 is the power law.
    pub knots: usize,
    /// Readings given.
    pub readings: usize,
    /// Readings set aside.
    pub outliers: usize,
    /// Rms of the relative residuals.
    pub rms_relative: f64,
    /// A pixel's irradiance at each of the 256 counts, W m^-2.
    pub irradiance_w_m2: Vec<f64>,
    /// Standard deviation of each, W m^-2.
    pub sigma_w_m2: Vec<f64>,
}

impl CovarianceRecord {
    /// Of a whole matrix, row by row, of `side` squared values.
    pub fn of_matrix(matrix: &[f64], side: usize) -> Self {
        let rows = (0..side).flat_map(|row| matrix[row * side..=row * side + row].iter().copied());
        Self { lower_triangle: rows.collect() }
    }
}

impl CalibrationFile {
    /// An empty file for a setup.
    pub fn new(setup: &Setup) -> Self {
        Self {
            schema: SchemaKey,
            setup: setup.name.clone(),
            source: String::new(),
            distortion: None,
            inverse: None,
            covariance: None,
            provenance: None,
            response: None,
        }
    }

    /// Reads a file for a setup. The values are checked by what is made of them.
    ///
    /// # Errors
    /// The file does not fit its schema, or belongs to another setup.
    pub fn read(path: &Path, setup: &Setup) -> Result<Self, InputError> {
        let file: Self = read_schema(path, SCHEMA, "a calibration")?;
        if file.setup != setup.name {
            return Err(InputError::new(path, "the calibration belongs to another setup")
                .at("key `setup`")
                .found(format!("`{}`", file.setup))
                .expected(format!("`{}`", setup.name))
                .help(
                    "geometry and response both change with the magnification: use this setup's own file. \
                     `retina calibrate radiometry --for-setup` carries a response over",
                ));
        }
        Ok(file)
    }

    /// The file at `path`, to be extended, or an empty one where there is none.
    ///
    /// # Errors
    /// There is a file that is no calibration, or that of another setup.
    pub fn read_or_new(path: &Path, setup: &Setup) -> Result<Self, InputError> {
        if !path.exists() {
            return Ok(Self::new(setup));
        }
        Self::read(path, setup)
    }

    /// Puts a response into the file. D^-1(r, L) was fitted with L by the response that held then, so that another one
    /// would have it read at the wrong irradiance.
    ///
    /// # Errors
    /// D^-1 depends on L, and L by this response differs by more than 0.1 from L by which it was fitted.
    pub fn set_response(
        &mut self,
        record: ResponseRecord,
        path: &Path,
        setup: &Setup,
    ) -> Result<(), InputError> {
        let curve = |file: &Self| {
            let measured = MeasuredResponse::of_file(file, path, setup)?;
            Ok::<_, InputError>(measured_or_power_law(measured.as_ref().map(|m| &m.curve), setup))
        };
        let before = curve(self)?;
        let old = self.response.replace(record);
        let after = curve(self)?;
        let depends =
            self.inverse.as_ref().is_some_and(|inverse| inverse.terms.iter().any(|term| term.2 > 0.0));
        let l =
            |response: &ScreenResponse, count: u8| log10_irradiance(response, Channel::W, f64::from(count));
        let moved = (4..=255).map(|count| (l(&after, count) - l(&before, count)).abs()).fold(0.0, f64::max);
        if depends && moved > MOST_L_MOVED {
            self.response = old;
            return Err(InputError::new(path, "the geometry in this file was fitted by another response")
                .at("table `inverse`")
                .found(format!("log10 of the irradiance moves by up to {moved:.2}"))
                .expected(format!("at most {MOST_L_MOVED}"))
                .help(
                    "give --out another name, then run `retina calibrate geometry --response` with it: D^-1 depends on \
                     the irradiance by the response",
                ));
        }
        Ok(())
    }

    /// The numbers in `[provenance]` by which a reader sees whether the setup was changed since.
    pub fn provenance_of(setup: &Setup) -> toml::Table {
        let (k, c) = (setup.facility_pinhole(), setup.camera_pinhole());
        let size = [f64::from(c.width_px), f64::from(c.height_px)];
        let numbers = |values: &[f64]| toml::Value::from(values.to_vec());
        toml::Table::from_iter([
            ("k_f_px".to_owned(), numbers(&[k.fx_px, k.fy_px, k.cx_px, k.cy_px])),
            ("camera_px".to_owned(), numbers(&[c.fx_px, c.fy_px, c.cx_px, c.cy_px, size[0], size[1]])),
            ("software".to_owned(), concat!("retina ", env!("CARGO_PKG_VERSION")).into()),
        ])
    }

    /// Its text. There is no time stamp: the same content gives the same bytes.
    pub fn text(&self) -> String {
        let quoted = |value: &str| toml::Value::String(value.to_owned()).to_string();
        let mut text = format!("schema = \"{SCHEMA}\"\nsetup = {}\n", quoted(&self.setup));
        if !self.source.is_empty() {
            let _ = writeln!(text, "source = {}", quoted(&self.source));
        }
        if let Some(distortion) = &self.distortion {
            text.push_str("\n# r = D(r_u) at the reference irradiance: rows [i, j, a, b], r_x gains a x^i y^j, r_y gains b x^i y^j.\n[distortion]\nterms = [\n");
            for (i, j, a, b) in &distortion.terms {
                let _ = writeln!(text, "  [{i}, {j}, {a:?}, {b:?}],");
            }
            text.push_str("]\n");
        }
        if let Some(inverse) = &self.inverse {
            text.push_str(
                "\n# r_u = D^-1(r, L): rows [i, j, k, a, b], x gains a x^i y^j L^k, y gains b x^i y^j L^k.\n",
            );
            text.push_str("# L = log10 of the irradiance relative to a white pixel at count 255, by the response below or the setup's;\n# L is held within the range.\n[inverse]\n");
            let [low, high] = inverse.range_log10_irradiance;
            let _ = writeln!(text, "reference_log10_irradiance = {:?}", inverse.reference_log10_irradiance);
            let _ = writeln!(text, "range_log10_irradiance = [{low:?}, {high:?}]");
            if let Some(FieldRecord { low, high, radius }) = &inverse.field {
                text.push_str("# The calibrated lines of sight: in a rectangle, and in a disc about its middle. Beyond, D^-1 goes on straight.\n");
                let _ = writeln!(text, "field = {{ low = {low:?}, high = {high:?}, radius = {radius:?} }}");
            }
            text.push_str("terms = [\n");
            for (i, j, k, a, b) in &inverse.terms {
                let _ = writeln!(text, "  [{i}, {j}, {k}, {a:?}, {b:?}],");
            }
            text.push_str("]\n");
            if let Some(RingsRecord { center: [x, y], radius, terms }) = &inverse.rings {
                text.push_str("\n# Added ring by ring: for the cubic B-splines B of |r - center| about 2 h, 3 h, ... radius + h, with h = radius / rows,\n");
                text.push_str("# rows [a_x, a_y, b_x, b_y]: x gains (a_x dx + a_y dy) B, y gains (b_x dx + b_y dy) B, (dx, dy) = (r - center) / radius.\n");
                let _ = writeln!(
                    text,
                    "[inverse.rings]\ncenter = [{x:?}, {y:?}]\nradius = {radius:?}\nterms = ["
                );
                for [ax, ay, bx, by] in terms {
                    let _ = writeln!(text, "  [{ax:?}, {ay:?}, {bx:?}, {by:?}],");
                }
                text.push_str("]\n");
            }
        }
        if let Some(covariance) = &self.covariance {
            text.push_str("\n# Covariance of the coefficients a in the order of inverse.terms, then of the rings (a_x, a_y of each), and then of b\n# in the same order.\n");
            text.push_str("# The matrix's lower triangle, row by row; all digits, since polynomials and rings are nearly dependent.\n[covariance]\nlower_triangle = [\n");
            let mut rest = covariance.lower_triangle.as_slice();
            for row in 1.. {
                let (cells, behind) = rest.split_at(row.min(rest.len()));
                if cells.is_empty() {
                    break;
                }
                let cells: Vec<String> = cells.iter().map(|value| format!("{value:e}")).collect();
                let _ = writeln!(text, "  {},", cells.join(", "));
                rest = behind;
            }
            text.push_str("]\n");
        }
        if let Some(provenance) = &self.provenance {
            text.push_str("\n# What the geometry was measured with. k_f_px: f_x, f_y, c_x, c_y of K_f; camera_px: of C, then width and height.\n[provenance]\n");
            for (key, value) in provenance {
                let _ = writeln!(text, "{key} = {value}");
            }
        }
        if let Some(response) = &self.response {
            text.push('\n');
            let table = toml::Table::try_from(response).expect("numbers, names and lists of them are TOML");
            let table = toml::Table::from_iter([("response".to_owned(), toml::Value::Table(table))]);
            text.push_str(&toml::to_string(&table).expect("a table of tables is TOML"));
        }
        text
    }

    /// Writes it.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), InputError> {
        write_atomic(path, self.text().as_bytes())
            .map_err(|error| InputError::new(path, format!("cannot be written: {error}")))
    }
}
