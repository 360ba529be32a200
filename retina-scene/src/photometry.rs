//! A body's `photometry` table as a photometric function.

use std::path::Path;

use retina_files::InputError;
use retina_radiometry::{Geometry, Hapke, Law, PhaseFunction, Photometry};

use crate::file::{LawName, PhaseFunctionName, PhaseFunctionTable, PhotometryTable};

/// McEwen's decay angle for the Moon, deg.
const LUNAR_DECAY_DEG: f64 = 60.0;

impl PhotometryTable {
    /// The photometric function of a body; `place` names the body in errors.
    ///
    /// # Errors
    /// A key that does not belong to the law, one that is missing, a value out of its range.
    pub fn resolve(&self, file: &Path, place: &str) -> Result<Photometry, InputError> {
        Reader { file, place, table: self }.read()
    }
}

struct Reader<'a> {
    file: &'a Path,
    place: &'a str,
    table: &'a PhotometryTable,
}

impl Reader<'_> {
    fn read(&self) -> Result<Photometry, InputError> {
        let table = self.table;
        let (law_name, own): (&str, &[&str]) = match table.model {
            LawName::Lambert => ("lambert", &[]),
            LawName::LommelSeeliger => ("lommel-seeliger", &[]),
            LawName::LunarLambert => ("lunar-lambert", &["decay_deg"]),
            LawName::OrenNayar => ("oren-nayar", &["roughness_deg"]),
            LawName::Hapke => ("hapke", HAPKE_KEYS),
        };
        self.refuse_foreign(law_name, own)?;
        let phase_function = match &table.phase_function {
            None => PhaseFunction::Constant,
            Some(function) => self.phase_function(function)?,
        };
        // Surfaces brighter than white at normal exist (strong opposition effects), but not twice.
        let albedo = self.within("normal_albedo", table.normal_albedo, 0.0, 2.0)?;
        if albedo == Some(0.0) {
            return Err(self
                .error("normal_albedo", "a body without albedo cannot be seen")
                .found(0.0)
                .expected("a value above 0"));
        }
        let law = match table.model {
            LawName::Hapke => return self.hapke(albedo, phase_function),
            LawName::Lambert => Law::Lambert,
            LawName::LommelSeeliger => Law::LommelSeeliger,
            LawName::LunarLambert => {
                let decay_deg =
                    self.within("decay_deg", table.decay_deg, 0.1, 1e6)?.unwrap_or(LUNAR_DECAY_DEG);
                Law::LunarLambert { decay_rad: decay_deg.to_radians() }
            }
            LawName::OrenNayar => {
                let roughness_deg = self.within("roughness_deg", table.roughness_deg, 0.0, 90.0)?;
                Law::OrenNayar { roughness_rad: self.required("roughness_deg", roughness_deg)?.to_radians() }
            }
        };
        let albedo = self.required("normal_albedo", albedo)?;
        Ok(Photometry::new(law, phase_function, Some(albedo)))
    }

    fn hapke(&self, albedo: Option<f64>, phase_function: PhaseFunction) -> Result<Photometry, InputError> {
        let table = self.table;
        let lunar = Hapke::lunar();
        let or = |key, value, low, high, default| Ok(self.within(key, value, low, high)?.unwrap_or(default));
        let w = self.within("single_scattering_albedo", table.single_scattering_albedo, 1e-6, 1.0)?;
        let law = Hapke {
            single_scattering_albedo: w.unwrap_or(lunar.single_scattering_albedo),
            lobe_width: or("lobe_width", table.lobe_width, 0.0, 0.999, lunar.lobe_width)?,
            lobe_weight: or("lobe_weight", table.lobe_weight, -1.0, 1.0, lunar.lobe_weight)?,
            shoe_amplitude: or("shoe_amplitude", table.shoe_amplitude, 0.0, 100.0, lunar.shoe_amplitude)?,
            shoe_width: or("shoe_width", table.shoe_width, 1e-6, 10.0, lunar.shoe_width)?,
            cboe_amplitude: or("cboe_amplitude", table.cboe_amplitude, 0.0, 100.0, lunar.cboe_amplitude)?,
            cboe_width: or("cboe_width", table.cboe_width, 1e-6, 10.0, lunar.cboe_width)?,
            roughness_rad: self
                .within("roughness_deg", table.roughness_deg, 0.0, 60.0)?
                .map_or(lunar.roughness_rad, f64::to_radians),
            porosity: or("porosity", table.porosity, 1e-3, 10.0, lunar.porosity)?,
        };
        match (w, albedo) {
            // The level is the normal albedo, the shape is the given albedo's.
            (Some(_), _) => Ok(Photometry::new(Law::Hapke(law), phase_function, albedo)),
            (None, Some(albedo)) => {
                let law = Hapke { single_scattering_albedo: self.solve_albedo(law, albedo)?, ..law };
                Ok(Photometry::new(Law::Hapke(law), phase_function, Some(albedo)))
            }
            (None, None) => Err(self
                .error("normal_albedo", "the level of the body's brightness is not given")
                .expected("`normal_albedo` or `single_scattering_albedo`")),
        }
    }

    /// w with which I/F at normal is `albedo`, by bisection: I/F grows with w.
    fn solve_albedo(&self, law: Hapke, albedo: f64) -> Result<f64, InputError> {
        let at_normal = |w: f64| {
            let law = Hapke { single_scattering_albedo: w, ..law };
            law.radiance_factor(Geometry { mu0: 1.0, mu: 1.0, phase_rad: 0.0 })
        };
        let (mut low, mut high) = (0.0, 1.0);
        if at_normal(high) < albedo {
            return Err(self
                .error(
                    "normal_albedo",
                    "no single-scattering albedo gives so bright a surface with these parameters",
                )
                .found(albedo)
                .expected(format!("at most {:.4}", at_normal(high))));
        }
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if at_normal(middle) < albedo { low = middle } else { high = middle }
        }
        Ok(0.5 * (low + high))
    }

    fn phase_function(&self, table: &PhaseFunctionTable) -> Result<PhaseFunction, InputError> {
        let (kind, own) = match table.kind {
            PhaseFunctionName::Constant => ("constant", ""),
            PhaseFunctionName::Exponential => ("exponential", "scale_deg"),
            PhaseFunctionName::HenyeyGreenstein => ("henyey-greenstein", "asymmetry"),
            PhaseFunctionName::Magnitudes => ("magnitudes", "coefficients"),
        };
        let there = [
            ("scale_deg", table.scale_deg.is_some()),
            ("asymmetry", table.asymmetry.is_some()),
            ("coefficients", table.coefficients.is_some()),
        ];
        for (key, given) in there {
            let place = format!("phase_function.{key}");
            if given && key != own {
                return Err(
                    self.error(&place, format!("the key does not belong to the phase function `{kind}`"))
                );
            }
            if !given && key == own {
                return Err(self.error(&place, format!("the phase function `{kind}` needs the key `{key}`")));
            }
        }
        let scale_deg = self.within("phase_function.scale_deg", table.scale_deg, 1e-3, 1e6)?;
        let asymmetry = self.within("phase_function.asymmetry", table.asymmetry, -0.999, 0.999)?;
        let coefficients = table.coefficients.unwrap_or_default();
        if coefficients.iter().any(|c| !c.is_finite()) {
            return Err(self.error("phase_function.coefficients", "a coefficient is not finite"));
        }
        Ok(match table.kind {
            PhaseFunctionName::Constant => PhaseFunction::Constant,
            PhaseFunctionName::Exponential => {
                PhaseFunction::Exponential { scale_rad: scale_deg.unwrap_or(1.0).to_radians() }
            }
            PhaseFunctionName::HenyeyGreenstein => {
                PhaseFunction::HenyeyGreenstein { asymmetry: asymmetry.unwrap_or(0.0) }
            }
            PhaseFunctionName::Magnitudes => PhaseFunction::Magnitudes { coefficients },
        })
    }

    fn refuse_foreign(&self, law: &str, own: &[&str]) -> Result<(), InputError> {
        let t = self.table;
        let given = [
            ("decay_deg", t.decay_deg.is_some()),
            ("roughness_deg", t.roughness_deg.is_some()),
            ("single_scattering_albedo", t.single_scattering_albedo.is_some()),
            ("lobe_width", t.lobe_width.is_some()),
            ("lobe_weight", t.lobe_weight.is_some()),
            ("shoe_amplitude", t.shoe_amplitude.is_some()),
            ("shoe_width", t.shoe_width.is_some()),
            ("cboe_amplitude", t.cboe_amplitude.is_some()),
            ("cboe_width", t.cboe_width.is_some()),
            ("porosity", t.porosity.is_some()),
        ];
        let Some((key, _)) = given.iter().find(|(key, given)| *given && !own.contains(key)) else {
            return Ok(());
        };
        let mut keys = vec!["normal_albedo", "phase_function"];
        keys.extend(own);
        Err(self
            .error(key, format!("the key does not belong to the law `{law}`"))
            .expected(format!("of {}", keys.join(", ")))
            .help(format!("remove `{key}`, or choose the law that it belongs to")))
    }

    fn within(&self, key: &str, value: Option<f64>, low: f64, high: f64) -> Result<Option<f64>, InputError> {
        match value {
            Some(v) if !(low..=high).contains(&v) => Err(self
                .error(key, "the value is out of its range")
                .found(v)
                .expected(format!("{low} to {high}"))),
            value => Ok(value),
        }
    }

    fn required(&self, key: &str, value: Option<f64>) -> Result<f64, InputError> {
        value.ok_or_else(|| self.error(key, format!("the key `{key}` is missing")).expected("a number"))
    }

    fn error(&self, key: &str, problem: impl Into<String>) -> InputError {
        InputError::new(self.file, problem).at(format!("{}, key `photometry.{key}`", self.place))
    }
}

const HAPKE_KEYS: &[&str] = &[
    "single_scattering_albedo",
    "lobe_width",
    "lobe_weight",
    "shoe_amplitude",
    "shoe_width",
    "cboe_amplitude",
    "cboe_width",
    "roughness_deg",
    "porosity",
];

#[cfg(test)]
mod tests {
    use super::*;
    use retina_files::parse_toml;

    fn read(text: &str) -> Result<Photometry, InputError> {
        let file = Path::new("s.toml");
        parse_toml::<PhotometryTable>(file, text)?.resolve(file, "body `x`")
    }

    fn normal(photometry: &Photometry) -> f64 {
        photometry.radiance_factor(Geometry { mu0: 1.0, mu: 1.0, phase_rad: 0.0 })
    }

    #[test]
    fn every_law_has_the_normal_albedo_asked_for() {
        for text in [
            "model = 'lambert'\nnormal_albedo = 0.12",
            "model = 'lommel-seeliger'\nnormal_albedo = 0.12",
            "model = 'lunar-lambert'\nnormal_albedo = 0.12",
            "model = 'oren-nayar'\nroughness_deg = 20\nnormal_albedo = 0.12",
            "model = 'hapke'\nnormal_albedo = 0.12",
            "model = 'hapke'\nnormal_albedo = 0.12\nsingle_scattering_albedo = 0.4",
        ] {
            assert!((normal(&read(text).unwrap()) - 0.12).abs() < 1e-12, "{text}");
        }
    }

    #[test]
    fn hapke_solves_for_the_albedo_it_is_not_given() {
        // Without opposition effect, roughness or lobes, and w small: I/F = w / 8 (1 + O(w)).
        let text =
            "model = 'hapke'\nnormal_albedo = 1e-5\nlobe_width = 0\nshoe_amplitude = 0\nroughness_deg = 0";
        let photometry = read(text).unwrap();
        let Law::Hapke(hapke) = photometry.law else { panic!("{photometry:?}") };
        assert!((hapke.single_scattering_albedo / 8e-5 - 1.0).abs() < 1e-3);
        assert!((photometry.factor - 1.0).abs() < 1e-9);
    }

    #[test]
    fn keys_of_another_law_are_refused_and_named() {
        for (text, words) in [
            ("model = 'lambert'\nnormal_albedo = 0.1\nroughness_deg = 3", "photometry.roughness_deg"),
            ("model = 'lunar-lambert'\nnormal_albedo = 0.1\nporosity = 1", "photometry.porosity"),
            ("model = 'lambert'", "normal_albedo"),
            ("model = 'oren-nayar'\nnormal_albedo = 0.1", "roughness_deg"),
            ("model = 'lambert'\nnormal_albedo = -0.1", "out of its range"),
            ("model = 'lambert'\nnormal_albedo = nan", "out of its range"),
            ("model = 'hapke'", "not given"),
            (
                "model = 'lambert'\nnormal_albedo = 0.1\nphase_function = { kind = 'constant', asymmetry = 0.1 }",
                "asymmetry",
            ),
            (
                "model = 'lambert'\nnormal_albedo = 0.1\nphase_function = { kind = 'exponential' }",
                "scale_deg",
            ),
        ] {
            let error = read(text).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
        assert_eq!(read("model = 'lambret'").unwrap_err().help.unwrap(), "did you mean `lambert`?");
    }
}
