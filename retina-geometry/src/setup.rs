//! One facility configuration: `setup.toml`, schema `retina.setup/1`.

use std::path::{Path, PathBuf};

use retina_files::{InputError, parse_schema, read_text};
use serde::Deserialize;

use crate::{NoiseSetup, OpticsSetup, Pinhole};

/// A facility configuration: screen, camera, and how the one shows on the other.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Setup {
    /// `retina.setup/1`.
    pub schema: String,
    /// Name of the configuration, `wide-fov` for one.
    pub name: String,
    /// The display.
    pub screen: ScreenSetup,
    /// The camera under test.
    pub camera: CameraSetup,
    /// How the display fills the camera's field.
    pub facility: FacilitySetup,
    /// Response of the display; by default 2.2 and the paper's brightest magnitude, scaled.
    #[serde(default)]
    pub response: ResponseSetup,
    /// The lenses, for the virtual bench.
    #[serde(default)]
    pub optics: OpticsSetup,
    /// The sensor, for the virtual bench.
    #[serde(default)]
    pub noise: NoiseSetup,
    /// Where this setup's calibration lies, relative to the setup's file.
    #[serde(default)]
    pub calibration: CalibrationSetup,
    /// The file this was read from.
    #[serde(skip)]
    pub file: PathBuf,
}

/// The display.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScreenSetup {
    /// Width, pixels.
    pub width_px: u32,
    /// Height, pixels.
    pub height_px: u32,
    /// Width of the active area, mm.
    pub width_mm: f64,
    /// Height of the active area, mm.
    pub height_mm: f64,
    /// Bits of a digital count; 8.
    pub bits: u32,
    /// Effective wavelength of each channel, nm.
    #[serde(default)]
    pub wavelength_nm: Wavelengths,
}

/// Effective wavelengths of the three channels (paper, "Radiometric calibration").
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wavelengths {
    /// Red, nm.
    pub r: f64,
    /// Green, nm.
    pub g: f64,
    /// Blue, nm.
    pub b: f64,
}

impl Default for Wavelengths {
    fn default() -> Self {
        Self { r: 605.0, g: 544.0, b: 475.0 }
    }
}

/// The camera under test.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraSetup {
    /// Width, pixels.
    pub width_px: u32,
    /// Height, pixels.
    pub height_px: u32,
    /// Pixel pitch, micrometres.
    pub pixel_um: f64,
    /// Focal length of the objective, mm.
    pub focal_mm: f64,
    /// F-number of the objective.
    pub f_number: f64,
    /// Bits of a digital number.
    pub bits: u32,
}

/// How the display fills the camera's field: eq. 13's n_v, or a K of one's own.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FacilitySetup {
    /// n_v of eq. 13: rows of the display that the camera sees.
    pub observed_rows_px: Option<f64>,
    /// A K_f given outright; takes the place of eq. 13.
    pub intrinsics: Option<Intrinsics>,
}

/// A K_f given outright, pixels.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Intrinsics {
    /// Focal length along x, pixels.
    pub fx_px: f64,
    /// Focal length along y, pixels.
    pub fy_px: f64,
    /// Principal point x, pixels.
    pub cx_px: f64,
    /// Principal point y, pixels.
    pub cy_px: f64,
}

/// Response of the display.
#[derive(Debug, Clone, Copy, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ResponseSetup {
    /// Exponent of (B / 255)^gamma; 2.2 by default.
    pub gamma: Option<f64>,
    /// Magnitude of one pixel at 255; by default -1.44 + 5 log10(f_x / f_x of the wide configuration).
    pub brightest_magnitude: Option<f64>,
}

/// Where the calibration lies.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibrationSetup {
    /// Path relative to the setup's file.
    pub file: Option<PathBuf>,
}

/// f_x of the paper's wide configuration, 1200 / (2 tan(alpha_v / 2)) with a 25 mm objective
/// and 1536 rows of 3.45 um: the magnification at which -1.44 was measured (Fig. 7).
const WIDE_FX_PX: f64 = 1200.0 / (1536.0 * 3.45e-3 / 25.0);
/// Magnitude of one pixel at digital count 255 in the wide configuration (paper, Fig. 7).
const WIDE_BRIGHTEST_MAGNITUDE: f64 = -1.44;

impl Setup {
    /// Reads and checks a setup.
    ///
    /// # Errors
    /// The file cannot be read, holds an unknown key, or a size that is not positive.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        Self::parse(&read_text(path)?, path)
    }

    /// As [`Setup::read`], from text; `path` names it in errors, and paths in it are relative to `path`.
    ///
    /// # Errors
    /// As [`Setup::read`].
    pub fn parse(text: &str, path: &Path) -> Result<Self, InputError> {
        let mut setup: Self = parse_schema(path, text, "retina.setup/1", "a facility setup")?;
        setup.file = path.to_path_buf();
        setup.check(path)?;
        Ok(setup)
    }

    fn check(&self, path: &Path) -> Result<(), InputError> {
        let positive = [
            ("screen.width_px", f64::from(self.screen.width_px)),
            ("screen.height_px", f64::from(self.screen.height_px)),
            ("screen.width_mm", self.screen.width_mm),
            ("screen.height_mm", self.screen.height_mm),
            ("camera.width_px", f64::from(self.camera.width_px)),
            ("camera.height_px", f64::from(self.camera.height_px)),
            ("camera.pixel_um", self.camera.pixel_um),
            ("camera.focal_mm", self.camera.focal_mm),
            ("camera.f_number", self.camera.f_number),
            ("facility.observed_rows_px", self.facility.observed_rows_px.unwrap_or(1.0)),
            ("facility.intrinsics.fx_px", self.facility.intrinsics.map_or(1.0, |k| k.fx_px)),
            ("facility.intrinsics.fy_px", self.facility.intrinsics.map_or(1.0, |k| k.fy_px)),
            ("response.gamma", self.response.gamma.unwrap_or(1.0)),
        ];
        for (key, value) in positive {
            if !(value.is_finite() && value > 0.0) {
                return Err(InputError::new(path, "the value is not a positive number")
                    .at(format!("key `{key}`"))
                    .found(value)
                    .expected("a finite number above 0"));
            }
        }
        let finite = [
            ("facility.intrinsics.cx_px", self.facility.intrinsics.map_or(0.0, |k| k.cx_px)),
            ("facility.intrinsics.cy_px", self.facility.intrinsics.map_or(0.0, |k| k.cy_px)),
            ("response.brightest_magnitude", self.response.brightest_magnitude.unwrap_or(0.0)),
        ];
        for (key, value) in finite {
            if !value.is_finite() {
                return Err(InputError::new(path, "the value is not finite")
                    .at(format!("key `{key}`"))
                    .found(value));
            }
        }
        let largest = self.screen.width_px.max(self.screen.height_px);
        if largest > 16_384 {
            return Err(InputError::new(path, "the screen is larger than a texture can be")
                .at("table `screen`")
                .found(format!("{largest} pixels"))
                .expected("at most 16384 a side"));
        }
        if self.screen.bits != 8 {
            return Err(InputError::new(path, "only displays of 8 bits a channel are supported")
                .at("key `screen.bits`")
                .found(self.screen.bits)
                .expected("8"));
        }
        self.optics.check(path)?;
        self.noise.check(path)?;
        if self.facility.observed_rows_px.is_none() && self.facility.intrinsics.is_none() {
            return Err(InputError::new(path, "the facility's focal length is not given")
                .at("table `facility`")
                .expected("`observed_rows_px` (eq. 13) or a table `facility.intrinsics`"));
        }
        Ok(())
    }

    /// The camera's vertical field alpha_v, rad.
    pub fn camera_vertical_field_rad(&self) -> f64 {
        2.0 * self.camera_half_tan().atan()
    }

    /// tan(alpha_v / 2).
    fn camera_half_tan(&self) -> f64 {
        f64::from(self.camera.height_px) * self.camera.pixel_um * 1e-3 / (2.0 * self.camera.focal_mm)
    }

    /// K_f: f_x = f_y = n_v / (2 tan(alpha_v / 2)), centre of the screen (eqs. 12 and 13), or the
    /// intrinsics that the setup gives outright.
    pub fn facility_pinhole(&self) -> Pinhole {
        let (width_px, height_px) = (self.screen.width_px, self.screen.height_px);
        if let Some(k) = self.facility.intrinsics {
            return Pinhole {
                fx_px: k.fx_px,
                fy_px: k.fy_px,
                cx_px: k.cx_px,
                cy_px: k.cy_px,
                width_px,
                height_px,
            };
        }
        let rows = self.facility.observed_rows_px.unwrap_or(f64::from(height_px));
        let f_px = rows / (2.0 * self.camera_half_tan());
        let (cx_px, cy_px) = (f64::from(width_px) / 2.0, f64::from(height_px) / 2.0);
        Pinhole { fx_px: f_px, fy_px: f_px, cx_px, cy_px, width_px, height_px }
    }

    /// C, the camera under test as an ideal pinhole.
    pub fn camera_pinhole(&self) -> Pinhole {
        let f_px = self.camera.focal_mm * 1e3 / self.camera.pixel_um;
        Pinhole {
            fx_px: f_px,
            fy_px: f_px,
            cx_px: f64::from(self.camera.width_px) / 2.0,
            cy_px: f64::from(self.camera.height_px) / 2.0,
            width_px: self.camera.width_px,
            height_px: self.camera.height_px,
        }
    }

    /// Exponent of the display's response.
    pub fn response_gamma(&self) -> f64 {
        self.response.gamma.unwrap_or(2.2)
    }

    /// Magnitude that one pixel on the boresight shows at digital count 255.
    ///
    /// Default: the paper's -1.44 of the wide configuration; a pixel's irradiance at the pupil
    /// goes with its solid angle 1 / (f_x f_y), so 5 log10 of the focal length is added.
    pub fn brightest_magnitude(&self) -> f64 {
        let k = self.facility_pinhole();
        let ratio = (k.fx_px * k.fy_px).sqrt() / WIDE_FX_PX;
        self.response.brightest_magnitude.unwrap_or(WIDE_BRIGHTEST_MAGNITUDE + 5.0 * ratio.log10())
    }

    /// The prescription that the setup names, if it does: a path relative to the setup's file, or the name
    /// of one that ships.
    pub fn optics_system(&self) -> Option<PathBuf> {
        let folder = self.file.parent().unwrap_or(Path::new(""));
        let system = self.optics.system.as_ref()?;
        // The dot in "reference-1.3fc-wide" begins no extension.
        let is_file = system
            .extension()
            .is_some_and(|e| ["toml", "zmx"].iter().any(|known| e.eq_ignore_ascii_case(known)));
        Some(if is_file { folder.join(system) } else { system.clone() })
    }

    /// Path of the calibration that ships with the setup, if it names one.
    pub fn calibration_path(&self) -> Option<PathBuf> {
        let folder = self.file.parent().unwrap_or(Path::new(""));
        self.calibration.file.as_ref().map(|file| folder.join(file))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asset(name: &str) -> Setup {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/setups");
        Setup::read(&folder.join(name)).unwrap()
    }

    #[test]
    fn the_papers_two_configurations() {
        // Field of view 12.10 x 16.09 deg and 6.07 x 8.08 deg, full magnitude -1.44 and 0.07.
        for (name, field_deg, magnitude) in
            [("wide-fov.toml", 12.10, -1.44), ("narrow-fov.toml", 6.07, 0.065)]
        {
            let setup = asset(name);
            assert!((setup.camera_vertical_field_rad().to_degrees() - field_deg).abs() < 0.005);
            assert!((setup.brightest_magnitude() - magnitude).abs() < 0.001);
            let k = setup.facility_pinhole();
            let half_rows = 600.0 / k.fy_px;
            assert!((2.0 * half_rows.atan() - setup.camera_vertical_field_rad()).abs() < 1e-12);
        }
    }
}
