//! One facility configuration: `setup.toml`, schema `retina.setup/1`.

use std::path::{Path, PathBuf};

use retina_assets::SETUPS;
use retina_files::{InputError, hash_bytes, hash_file, parse_schema, read_text};
use serde::Deserialize;

use crate::{NoiseSetup, OpticsSetup, Pinhole, ScreenLimits};

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
    /// What it must not be asked to show.
    #[serde(default)]
    pub limits: ScreenLimits,
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
    /// The file cannot be read, holds an unknown key, or a value out of range.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        Self::parse(&read_text(path)?, path)
    }

    /// A setup that ships, by its name; without its calibration, which is a file.
    pub fn shipped(name: &Path) -> Option<Self> {
        let (name, text) = SETUPS.into_iter().find(|(own, _)| Path::new(own) == name)?;
        let mut setup = Self::parse(text, Path::new(&format!("{name}.toml"))).ok()?;
        setup.calibration.file = None;
        Some(setup)
    }

    /// Reads the setup that a file in `folder` or a command names: a file, or one that ships where no file has that name.
    ///
    /// # Errors
    /// As [`Setup::read`].
    pub fn named(name: &Path, folder: &Path) -> Result<Self, InputError> {
        let file = folder.join(name);
        let shipped = if file.is_file() { None } else { Self::shipped(name) };
        shipped.map_or_else(|| Self::read(&file), Ok).map_err(|error| {
            let names = SETUPS.map(|(name, _)| name);
            let is_name = !file.exists() && name.extension().is_none() && name.components().count() == 1;
            if is_name { error.help(format!("setups that ship: {}", names.join(", "))) } else { error }
        })
    }

    /// What [`Setup::named`] takes, without a folder, to read this setup again: its file, or its name where it ships.
    pub fn reference(&self) -> PathBuf {
        let name = self.file.with_extension("");
        match !self.file.is_file() && Self::shipped(&name).is_some() {
            true => name,
            false => self.file.clone(),
        }
    }

    /// Hash of what [`Setup::named`] read: of the file's bytes, else of what ships.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn hash_of_named(&self, name: &Path, folder: &Path) -> Result<String, InputError> {
        let file = folder.join(name);
        if file.is_file() { hash_file(&file) } else { Ok(hash_bytes(format!("{self:?}").as_bytes())) }
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
        let wavelengths_nm = self.screen.wavelength_nm;
        let k =
            self.facility.intrinsics.unwrap_or(Intrinsics { fx_px: 1.0, fy_px: 1.0, cx_px: 0.0, cy_px: 0.0 });
        // What is beyond these is a slip of the unit or of the hand; the widest that a facility may be.
        let (screen_px, camera_px) = ((1.0, 16_384.0), (1.0, 65_536.0));
        for (key, value, (least, most)) in [
            ("screen.width_px", f64::from(self.screen.width_px), screen_px),
            ("screen.height_px", f64::from(self.screen.height_px), screen_px),
            ("screen.width_mm", self.screen.width_mm, (0.1, 1e4)),
            ("screen.height_mm", self.screen.height_mm, (0.1, 1e4)),
            ("screen.wavelength_nm.r", wavelengths_nm.r, (300.0, 1100.0)),
            ("screen.wavelength_nm.g", wavelengths_nm.g, (300.0, 1100.0)),
            ("screen.wavelength_nm.b", wavelengths_nm.b, (300.0, 1100.0)),
            ("camera.width_px", f64::from(self.camera.width_px), camera_px),
            ("camera.height_px", f64::from(self.camera.height_px), camera_px),
            ("camera.pixel_um", self.camera.pixel_um, (0.1, 1000.0)),
            ("camera.focal_mm", self.camera.focal_mm, (0.1, 1e5)),
            ("camera.f_number", self.camera.f_number, (0.3, 1000.0)),
            ("camera.bits", f64::from(self.camera.bits), (1.0, 32.0)),
            ("facility.observed_rows_px", self.facility.observed_rows_px.unwrap_or(1.0), (1.0, 1e6)),
            ("facility.intrinsics.fx_px", k.fx_px, (1.0, 1e8)),
            ("facility.intrinsics.fy_px", k.fy_px, (1.0, 1e8)),
            ("facility.intrinsics.cx_px", k.cx_px, (-1e6, 1e6)),
            ("facility.intrinsics.cy_px", k.cy_px, (-1e6, 1e6)),
            ("response.gamma", self.response.gamma.unwrap_or(1.0), (0.1, 10.0)),
            ("response.brightest_magnitude", self.response.brightest_magnitude.unwrap_or(0.0), (-40.0, 40.0)),
        ] {
            if !(least..=most).contains(&value) {
                return Err(InputError::new(path, "the value is out of range")
                    .at(format!("key `{key}`"))
                    .found(value)
                    .expected(format!("{least} to {most}")));
            }
        }
        if self.screen.bits != 8 {
            return Err(InputError::new(path, "only displays of 8 bits a channel are supported")
                .at("key `screen.bits`")
                .found(self.screen.bits)
                .expected("8"));
        }
        self.screen.limits.check(path)?;
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

    #[test]
    fn values_that_cannot_be_are_refused() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/setups");
        let text = std::fs::read_to_string(folder.join("wide-fov.toml")).unwrap();
        let path = std::env::temp_dir().join(format!("retina-setup-{}.toml", std::process::id()));
        for (from, to, said) in [
            ("r = 605.0", "r = nan", "key `screen.wavelength_nm.r`: the value is out of range (found NaN"),
            ("r = 605.0", "r = 0.0", "(found 0, expected 300 to 1100)"),
            ("g = 544.0", "g = -544.0", "key `screen.wavelength_nm.g`"),
            ("b = 475.0", "b = 1e9", "key `screen.wavelength_nm.b`"),
            ("gamma = 2.2", "gamma = 1e300", "key `response.gamma`"),
            ("width_mm = 18.7", "width_mm = 1e300", "key `screen.width_mm`"),
            ("pixel_um = 3.45", "pixel_um = 1e-300", "key `camera.pixel_um`"),
            ("focal_mm = 25.0", "focal_mm = inf", "key `camera.focal_mm`"),
            ("f_number = 2.8", "f_number = 0.0", "key `camera.f_number`"),
            (
                "bits = 12",
                "bits = 0",
                "key `camera.bits`: the value is out of range (found 0, expected 1 to 32)",
            ),
            ("observed_rows_px = 1200", "observed_rows_px = 1e300", "key `facility.observed_rows_px`"),
        ] {
            assert!(text.contains(from), "{from}");
            std::fs::write(&path, text.replacen(from, to, 1)).unwrap();
            let error = Setup::read(&path).unwrap_err().to_string();
            assert!(error.contains(said), "{error}");
        }
        std::fs::remove_file(&path).unwrap();
    }

    /// A name stands for what ships, but a file of that name comes first; a name that is neither is told those there are.
    #[test]
    fn a_setup_that_ships_is_known_by_its_name() {
        let folder = std::env::temp_dir().join(format!("retina-named-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let shipped = Setup::named(Path::new("wide-fov"), &folder).unwrap();
        assert!(shipped.name == "wide-fov" && shipped.calibration_path().is_none());
        let error = Setup::named(Path::new("wide-fow"), &folder).unwrap_err();
        assert!(format!("{error:?}").contains("wide-fov, narrow-fov"), "{error:?}");
        std::fs::write(folder.join("wide-fov"), retina_assets::NARROW_FOV_SETUP).unwrap();
        let own = Setup::named(Path::new("wide-fov"), &folder).unwrap();
        assert_eq!(own.name, "narrow-fov");
        let hash = |setup: &Setup, name: &str| setup.hash_of_named(Path::new(name), &folder).unwrap();
        assert_ne!(hash(&own, "wide-fov"), hash(&shipped, "narrow-fov"));
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
