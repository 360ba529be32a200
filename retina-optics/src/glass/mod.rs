//! Optical media: dispersion formulas, their ranges, the embedded catalogue and users' AGF files.
//!
//! Indices are relative to air at the reference temperature (20 degC unless the catalogue says
//! otherwise) and one atmosphere, as catalogues print them; rays in air then see index 1.
//! A glass is found by its exact name: "SF5" is not "N-SF5".

mod agf;
mod catalogue;
mod dispersion;

use std::path::Path;
use std::sync::Arc;

use retina_files::{InputError, nearest};

pub use agf::read_agf;
pub use dispersion::{Dispersion, air_index};

/// Temperature dependence of the absolute index, Schott technical information TIE-19.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ThermalDispersion {
    /// D0 (1/K), D1 (1/K^2), D2 (1/K^3).
    pub d: [f64; 3],
    /// E0 (um^2/K), E1 (um^2/K^2).
    pub e: [f64; 2],
    /// Lambda_tk, um.
    pub lambda_tk_um: f64,
    /// Temperature of the catalogue's indices, degC.
    pub reference_c: f64,
}

/// A glass of a catalogue.
#[derive(Debug, Clone, PartialEq)]
pub struct Glass {
    /// Exact catalogue name.
    pub name: String,
    /// The catalogue it is from.
    pub catalogue: String,
    /// n(lambda).
    pub dispersion: Dispersion,
    /// Wavelengths for which the formula holds, um.
    pub range_um: [f64; 2],
    /// dn/dT, where the catalogue gives it.
    pub thermal: Option<ThermalDispersion>,
    /// Linear expansion -30..70 degC, 1/K, where the catalogue gives it.
    pub expansion_per_k: Option<f64>,
}

/// Why a medium has no index.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum IndexError {
    /// Outside the formula's range.
    #[error(
        "glass {glass} has no index at {wavelength_um} um: its formula holds from {} to {} um", range_um[0], range_um[1]
    )]
    OutOfRange {
        /// The glass.
        glass: String,
        /// The wavelength asked for, um.
        wavelength_um: f64,
        /// The range, um.
        range_um: [f64; 2],
    },
    /// The catalogue gives no dn/dT.
    #[error("glass {glass} has no dn/dT in its catalogue: read one from an AGF file that has it")]
    NoThermal {
        /// The glass.
        glass: String,
    },
    /// The formula gives no positive real index (coefficients at fault).
    #[error("the dispersion formula of glass {glass} gives no index at {wavelength_um} um")]
    NotReal {
        /// The glass.
        glass: String,
        /// The wavelength asked for, um.
        wavelength_um: f64,
    },
}

impl Glass {
    /// Index relative to air at the reference conditions.
    ///
    /// # Errors
    /// A wavelength outside the formula's range, or coefficients without a real index there.
    pub fn index(&self, wavelength_um: f64) -> Result<f64, IndexError> {
        let [low, high] = self.range_um;
        if !(low..=high).contains(&wavelength_um) {
            return Err(IndexError::OutOfRange {
                glass: self.name.clone(),
                wavelength_um,
                range_um: self.range_um,
            });
        }
        let n = self.dispersion.index(wavelength_um);
        if n.is_finite() && n > 0.0 {
            Ok(n)
        } else {
            Err(IndexError::NotReal { glass: self.name.clone(), wavelength_um })
        }
    }

    /// Index relative to air of the same temperature and of `pressure_atm`.
    ///
    /// # Errors
    /// As [`Glass::index`], and a glass without dn/dT.
    pub fn index_at(
        &self,
        wavelength_um: f64,
        temperature_c: f64,
        pressure_atm: f64,
    ) -> Result<f64, IndexError> {
        let relative = self.index(wavelength_um)?;
        let Some(t) = &self.thermal else {
            return Err(IndexError::NoThermal { glass: self.name.clone() });
        };
        let absolute = relative * air_index(wavelength_um, t.reference_c, 1.0);
        let dt = temperature_c - t.reference_c;
        let slope = t.d[0] * dt
            + t.d[1] * dt * dt
            + t.d[2] * dt * dt * dt
            + (t.e[0] * dt + t.e[1] * dt * dt)
                / (wavelength_um * wavelength_um - t.lambda_tk_um * t.lambda_tk_um);
        let absolute = absolute + (relative * relative - 1.0) / (2.0 * relative) * slope;
        Ok(absolute / air_index(wavelength_um, temperature_c, pressure_atm))
    }
}

/// Glasses by exact name. Later additions shadow earlier ones of the same name.
#[derive(Debug, Clone, Default)]
pub struct GlassCatalogue {
    glasses: Vec<Arc<Glass>>,
}

impl GlassCatalogue {
    /// The glasses that ship with RETINA (`assets/optics/glasses.csv`).
    pub fn embedded() -> Self {
        Self { glasses: catalogue::embedded().to_vec() }
    }

    /// Adds glasses, for example from [`read_agf`].
    pub fn extend(&mut self, glasses: impl IntoIterator<Item = Glass>) {
        self.glasses.extend(glasses.into_iter().map(Arc::new));
    }

    /// All glasses, in the order they were added.
    pub fn iter(&self) -> impl Iterator<Item = &Arc<Glass>> {
        self.glasses.iter()
    }

    /// The glass of exactly this name.
    pub fn get(&self, name: &str) -> Option<&Arc<Glass>> {
        self.glasses.iter().rev().find(|glass| glass.name == name)
    }

    /// As [`GlassCatalogue::get`]; `file` is named in the error.
    ///
    /// # Errors
    /// No glass of that name: names that are near it are suggested.
    pub fn require(&self, file: &Path, name: &str) -> Result<Arc<Glass>, InputError> {
        if let Some(glass) = self.get(name) {
            return Ok(glass.clone());
        }
        let names = || self.glasses.iter().map(|glass| glass.name.as_str());
        let bare = |text: &str| text.trim_start_matches("N-").to_ascii_uppercase();
        let mut near: Vec<&str> = names().filter(|other| bare(other) == bare(name)).collect();
        while near.len() < 3 {
            let Some(other) = nearest(name, names().filter(|other| !near.contains(other))) else { break };
            near.push(other);
        }
        let error = InputError::new(file, format!("glass `{name}` is in no catalogue that was read"))
            .found(format!("`{name}`"))
            .expected("a catalogue name, exactly as the maker spells it");
        Err(if near.is_empty() {
            error.help("name an AGF file that holds it, or give its index")
        } else {
            let near: Vec<String> = near.iter().map(|name| format!("`{name}`")).collect();
            error.help(format!(
                "did you mean {}? Glasses of like names are different glasses",
                near.join(" or ")
            ))
        })
    }
}

/// What light travels in behind a surface.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum Medium {
    /// Air: index 1, the reference of catalogue indices.
    #[default]
    Air,
    /// A catalogue glass.
    Glass(Arc<Glass>),
    /// A catalogue glass at another temperature and pressure, relative to the air there.
    GlassAt {
        /// The glass; its catalogue has dn/dT.
        glass: Arc<Glass>,
        /// degC.
        temperature_c: f64,
        /// Atmospheres.
        pressure_atm: f64,
    },
    /// A fixed index, relative to air, at all wavelengths.
    Index(f64),
}

impl Medium {
    /// Index relative to air.
    ///
    /// # Errors
    /// As [`Glass::index`] and [`Glass::index_at`].
    pub fn index(&self, wavelength_nm: f64) -> Result<f64, IndexError> {
        match self {
            Self::Air => Ok(1.0),
            Self::Index(n) => Ok(*n),
            Self::Glass(glass) => glass.index(wavelength_nm * 1e-3),
            Self::GlassAt { glass, temperature_c, pressure_atm } => {
                glass.index_at(wavelength_nm * 1e-3, *temperature_c, *pressure_atm)
            }
        }
    }

    /// The name to print: "air", the glass, or the index.
    pub fn name(&self) -> String {
        match self {
            Self::Air => "air".to_owned(),
            Self::Index(n) => format!("n = {n}"),
            Self::Glass(glass) | Self::GlassAt { glass, .. } => glass.name.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// nd and Vd printed by the makers stand in the asset beside the coefficients.
    #[test]
    fn every_embedded_glass_has_its_makers_nd_and_vd() {
        let rows = catalogue::printed();
        assert_eq!(rows.len(), 40);
        for (name, nd, vd) in rows {
            let glass = GlassCatalogue::embedded().require(Path::new("t"), &name).unwrap();
            let [d, f, c] = [0.5875618, 0.4861327, 0.6562725].map(|um| glass.index(um).unwrap());
            assert!((d - nd).abs() < 1.5e-5, "{name}: {d} against {nd}");
            assert!(((d - 1.0) / (f - c) - vd).abs() < 0.02, "{name}: Vd");
        }
    }

    #[test]
    fn names_are_exact_and_like_names_are_suggested() {
        let error = GlassCatalogue::embedded().require(Path::new("lens.toml"), "NSF57").unwrap_err();
        assert!(error.help.unwrap().contains("`N-SF57`"));
        let error = GlassCatalogue::embedded().require(Path::new("lens.toml"), "BK7").unwrap_err();
        assert!(error.to_string().starts_with("lens.toml: glass `BK7` is in no catalogue"), "{error}");
        assert!(error.help.unwrap().contains("`N-BK7`"));
        assert!(GlassCatalogue::embedded().get("SF5").is_some());
        assert_ne!(GlassCatalogue::embedded().get("SF5"), GlassCatalogue::embedded().get("N-SF5"));
    }

    #[test]
    fn no_index_outside_the_formulas_range() {
        let glass = GlassCatalogue::embedded().require(Path::new("t"), "E-BAF11").unwrap();
        let error = glass.index(0.71).unwrap_err();
        assert!(
            error.to_string().contains("E-BAF11") && error.to_string().contains("0.4 to 0.7 um"),
            "{error}"
        );
    }
}
