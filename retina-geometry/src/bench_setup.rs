//! Tables of `setup.toml` that the virtual bench reads: `[optics]` and `[noise]`. Every key has a default.

use std::path::{Path, PathBuf};

use retina_files::InputError;
use serde::Deserialize;

/// The lenses between camera and screen.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OpticsSetup {
    /// A prescription from the camera's pupil to the screen (`.toml`, `.zmx`, relative to the setup, or
    /// the name of one that ships). By default stock doublets of 86.8 and 82.8 mm, placed at the
    /// magnification that eq. 13 implies.
    pub system: Option<PathBuf>,
    /// Width of each channel's spectral line, full width at half maximum, nm: red, green, blue. By default
    /// 40, 45 and 35, of an OLED behind colour filters.
    pub linewidth_nm: [f64; 3],
    /// Part of a sub-pixel's cell that shines, along x and y.
    pub emission_fill: [f64; 2],
    /// A screen's black: light at count 0 over light at 255.
    pub black_level: f64,
    /// Scatter of the screen's pixels, standard deviation of their light.
    pub mura: f64,
    /// Part of the light that lenses and barrel scatter over the whole image.
    pub veiling_glare: f64,
    /// Reflectance of a coated surface: two reflections make a ghost.
    pub coating_reflectance: f64,
}

impl Default for OpticsSetup {
    fn default() -> Self {
        Self {
            system: None,
            linewidth_nm: [40.0, 45.0, 35.0],
            emission_fill: [0.8, 0.8],
            black_level: 1e-6,
            mura: 0.01,
            veiling_glare: 0.002,
            coating_reflectance: 0.005,
        }
    }
}

/// The camera's sensor. Defaults are of the paper's camera (Sony IMX265).
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NoiseSetup {
    /// Rows [nm, electrons per photon], rising wavelengths. By default those of the paper's camera.
    pub quantum_efficiency: Option<Vec<[f64; 2]>>,
    /// Charge at which a pixel is full, electrons.
    pub full_well_e: f64,
    /// Electrons a digital number; by default the full well fills the range of the digitiser.
    pub gain_e_per_dn: Option<f64>,
    /// Read noise, electrons.
    pub read_noise_e: f64,
    /// Dark current at 20 degC, electrons a second; doubles every 6.5 K.
    pub dark_e_s: f64,
    /// Digital number of no light.
    pub offset_dn: f64,
    /// Scatter of the pixels' sensitivity.
    pub prnu: f64,
    /// Scatter of the pixels' offsets, electrons.
    pub dsnu_e: f64,
    /// Part of the pixels that are hot: their dark current is a hundred to ten thousand times the others'.
    pub hot_pixels: f64,
    /// Jitter of the line of sight from exposure to exposure, arcsec an axis.
    pub jitter_arcsec: f64,
}

impl Default for NoiseSetup {
    fn default() -> Self {
        Self {
            quantum_efficiency: None,
            full_well_e: 10_760.0,
            gain_e_per_dn: None,
            read_noise_e: 2.3,
            dark_e_s: 1.0,
            offset_dn: 32.0,
            prnu: 0.007,
            dsnu_e: 0.7,
            hot_pixels: 1e-5,
            jitter_arcsec: 0.3,
        }
    }
}

impl OpticsSetup {
    pub(crate) fn check(&self, file: &Path) -> Result<(), InputError> {
        let [r, g, b] = self.linewidth_nm;
        let share = 0.0..=1.0;
        let fill = f64::MIN_POSITIVE..=1.0;
        for (key, value, range, expected) in [
            ("optics.linewidth_nm", r, 0.0..=100.0, "0 to 100 nm"),
            ("optics.linewidth_nm", g, 0.0..=100.0, "0 to 100 nm"),
            ("optics.linewidth_nm", b, 0.0..=100.0, "0 to 100 nm"),
            ("optics.emission_fill", self.emission_fill[0], fill.clone(), "above 0, at most 1"),
            ("optics.emission_fill", self.emission_fill[1], fill, "above 0, at most 1"),
            ("optics.black_level", self.black_level, 0.0..=0.1, "0 to 0.1"),
            ("optics.mura", self.mura, 0.0..=0.2, "0 to 0.2"),
            ("optics.veiling_glare", self.veiling_glare, share.clone(), "0 to 1"),
            ("optics.coating_reflectance", self.coating_reflectance, share, "0 to 1"),
        ] {
            if !range.contains(&value) {
                return Err(out_of_range(file, key, value, expected));
            }
        }
        Ok(())
    }
}

impl NoiseSetup {
    pub(crate) fn check(&self, file: &Path) -> Result<(), InputError> {
        let any = 0.0..=1e9;
        for (key, value, range, expected) in [
            ("noise.full_well_e", self.full_well_e, 1.0..=1e9, "1 to 1e9 electrons"),
            ("noise.gain_e_per_dn", self.gain_e_per_dn.unwrap_or(1.0), 1e-6..=1e6, "1e-6 to 1e6"),
            ("noise.read_noise_e", self.read_noise_e, any.clone(), "0 or more"),
            ("noise.dark_e_s", self.dark_e_s, any.clone(), "0 or more"),
            ("noise.offset_dn", self.offset_dn, any.clone(), "0 or more"),
            ("noise.prnu", self.prnu, 0.0..=0.2, "0 to 0.2"),
            ("noise.dsnu_e", self.dsnu_e, any.clone(), "0 or more"),
            ("noise.hot_pixels", self.hot_pixels, 0.0..=0.1, "0 to 0.1"),
            ("noise.jitter_arcsec", self.jitter_arcsec, 0.0..=3600.0, "0 to 3600"),
        ] {
            if !range.contains(&value) {
                return Err(out_of_range(file, key, value, expected));
            }
        }
        let Some(rows) = &self.quantum_efficiency else { return Ok(()) };
        let rising = rows.windows(2).all(|pair| pair[1][0] > pair[0][0]);
        let usable = rows.iter().all(|[nm, qe]| *nm > 0.0 && nm.is_finite() && (0.0..=1.0).contains(qe));
        if rows.len() < 2 || !rising || !usable || rows.iter().all(|row| row[1] == 0.0) {
            return Err(InputError::new(file, "the quantum efficiency is no curve")
                .at("key `noise.quantum_efficiency`")
                .expected("at least two rows [nm, 0 to 1], wavelengths rising, not all 0"));
        }
        Ok(())
    }
}

fn out_of_range(file: &Path, key: &str, value: f64, expected: &str) -> InputError {
    InputError::new(file, "the value is out of range")
        .at(format!("key `{key}`"))
        .found(value)
        .expected(expected)
}
