//! A body's `photometry` table as a photometric function.

use std::path::Path;

use retina_files::InputError;
use retina_radiometry::{Geometry, Key, KeyDefault, Law, PhaseFunction, Photometry};

use crate::PhotometryTable;
use crate::photometry_table::Choice;

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

/// I/F at incidence = emission = phase = 0.
fn at_normal(law: Law) -> f64 {
    law.radiance_factor(Geometry { mu0: 1.0, mu: 1.0, phase_rad: 0.0 })
}

impl Reader<'_> {
    fn read(&self) -> Result<Photometry, InputError> {
        let table = self.table;
        self.refuse_foreign()?;
        let phase_function = match &table.phase_function {
            None => PhaseFunction::CONSTANT,
            Some(function) => self.phase_function(function)?,
        };
        // Surfaces brighter than white at normal exist (strong opposition effects), but not twice.
        if let Some(albedo) = table.normal_albedo {
            self.within("normal_albedo", albedo, [0.0, 2.0])?;
            if albedo == 0.0 {
                return Err(self
                    .error("normal_albedo", "a body without albedo cannot be seen")
                    .found(0.0)
                    .expected("a value above 0"));
            }
        }
        let law = self.law()?;
        let level = at_normal(law);
        if !(level.is_finite() && level > 0.0) {
            return Err(self
                .error("model", format!("the law `{}` gives no light at normal incidence", law.name()))
                .found(level)
                .expected("I/F above 0 at incidence = emission = phase = 0"));
        }
        Ok(Photometry::new(law, phase_function, table.normal_albedo))
    }

    /// The law, with what its keys leave to defaults and to the normal albedo.
    fn law(&self) -> Result<Law, InputError> {
        let choice = &self.table.law;
        let mut values = Vec::with_capacity(choice.kind.value_count());
        let mut sought = None;
        let mut has_level = false;
        for key in choice.kind.keys {
            match (choice.get(key), key.default) {
                (Some(given), default) => {
                    self.check(key.name, key, given)?;
                    has_level |= default == KeyDefault::FromNormalAlbedo;
                    values.extend_from_slice(given);
                }
                (None, KeyDefault::Required) => return Err(self.missing(key.name)),
                (None, KeyDefault::Value(value)) => values.extend(std::iter::repeat_n(value, key.length)),
                (None, KeyDefault::FromNormalAlbedo) => {
                    sought = Some((key, values.len()));
                    values.push(key.range[0]);
                }
            }
        }
        match (sought, self.table.normal_albedo) {
            (Some((key, place)), Some(albedo)) => self.solve(key, place, values, albedo),
            (Some((key, _)), None) => Err(self
                .error("normal_albedo", "the level of the body's brightness is not given")
                .expected(format!("`normal_albedo` or `{}`", key.name))),
            (None, None) if !has_level => Err(self.missing("normal_albedo")),
            // If both are given, the level is the normal albedo and the shape is the key's.
            (None, _) => Ok((choice.kind.from_values)(&values)),
        }
    }

    /// The law whose I/F at normal is `albedo`, by bisection: I/F grows with the value at this place.
    fn solve(&self, key: &Key, place: usize, mut values: Vec<f64>, albedo: f64) -> Result<Law, InputError> {
        let from_values = self.table.law.kind.from_values;
        let [mut low, mut high] = key.range;
        values[place] = high;
        let most = at_normal(from_values(&values));
        if most < albedo {
            let problem = format!("no {} gives so bright a surface with these parameters", key.meaning);
            return Err(self
                .error("normal_albedo", problem)
                .found(albedo)
                .expected(format!("at most {most:.4}")));
        }
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            values[place] = middle;
            if at_normal(from_values(&values)) < albedo { low = middle } else { high = middle }
        }
        values[place] = 0.5 * (low + high);
        Ok(from_values(&values))
    }

    fn phase_function(&self, choice: &Choice<PhaseFunction>) -> Result<PhaseFunction, InputError> {
        let kind = choice.kind;
        let place = |name: &str| format!("phase_function.{name}");
        if let Some(name) = choice.foreign() {
            let problem = format!("the key does not belong to the phase function `{}`", kind.name);
            return Err(self.error(&place(name), problem));
        }
        let mut values = Vec::with_capacity(kind.value_count());
        for key in kind.keys {
            match (choice.get(key), key.default) {
                (Some(given), _) => {
                    self.check(&place(key.name), key, given)?;
                    values.extend_from_slice(given);
                }
                (None, KeyDefault::Value(value)) => values.extend(std::iter::repeat_n(value, key.length)),
                (None, _) => {
                    let problem = format!("the phase function `{}` needs the key `{}`", kind.name, key.name);
                    return Err(self.error(&place(key.name), problem));
                }
            }
        }
        Ok((kind.from_values)(&values))
    }

    fn refuse_foreign(&self) -> Result<(), InputError> {
        let Some(key) = self.table.law.foreign() else { return Ok(()) };
        let kind = self.table.law.kind;
        let mut keys = vec!["normal_albedo", "phase_function"];
        keys.extend(kind.keys.iter().map(|key| key.name));
        Err(self
            .error(key, format!("the key does not belong to the law `{}`", kind.name))
            .expected(format!("of {}", keys.join(", ")))
            .help(format!("remove `{key}`, or choose the law that it belongs to")))
    }

    /// A number within its range, or a list of them.
    fn check(&self, place: &str, key: &Key, values: &[f64]) -> Result<(), InputError> {
        if key.length > 1 && values.iter().any(|value| !value.is_finite()) {
            return Err(self.error(place, "a coefficient is not finite"));
        }
        values.iter().try_for_each(|value| self.within(place, *value, key.range))
    }

    fn within(&self, place: &str, value: f64, [low, high]: [f64; 2]) -> Result<(), InputError> {
        if (low..=high).contains(&value) {
            return Ok(());
        }
        Err(self
            .error(place, "the value is out of its range")
            .found(value)
            .expected(format!("{low} to {high}")))
    }

    fn missing(&self, key: &str) -> InputError {
        let list = self.table.law.kind.keys.iter().find(|own| own.name == key && own.length > 1);
        let expected = list.map_or("a number".to_owned(), |key| format!("a list of {}", key.length));
        self.error(key, format!("the key `{key}` is missing")).expected(expected)
    }

    fn error(&self, key: &str, problem: impl Into<String>) -> InputError {
        InputError::new(self.file, problem).at(format!("{}, key `photometry.{key}`", self.place))
    }
}

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
            "model = 'minnaert'\nk = 0.7\nnormal_albedo = 0.12",
            "model = 'akimov'\nnormal_albedo = 0.12",
            "model = 'rolo'\nnormal_albedo = 0.12\nsurge_amplitude = 0.05\nsurge_decay_per_deg = 0.2\npolynomial = [0.2, -3e-3, 0, 0, 0]",
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
            ("model = 'minnaert'\nnormal_albedo = 0.1", "the key `k` is missing"),
            ("model = 'minnaert'\nnormal_albedo = 0.1\nk = 2.5", "out of its range"),
            ("model = 'akimov'\nnormal_albedo = 0.1\nk = 0.5", "photometry.k"),
            (
                "model = 'rolo'\nnormal_albedo = 0.1\nsurge_amplitude = 0\nsurge_decay_per_deg = 0",
                "expected a list of 5",
            ),
            (
                "model = 'rolo'\nnormal_albedo = 0.1\nsurge_amplitude = 0\nsurge_decay_per_deg = 0\npolynomial = [0, 1, 0, 0, 0]",
                "no light at normal incidence",
            ),
            (
                "model = 'rolo'\nnormal_albedo = 0.1\nsurge_amplitude = 0\nsurge_decay_per_deg = 0\npolynomial = [0.1, inf, 0, 0, 0]",
                "not finite",
            ),
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

    #[test]
    fn keys_and_names_that_no_law_has_are_pointed_at() {
        for (text, line, column, words, help) in [
            ("model = 'lambert'\nnormal_albdeo = 0.1", 2, 1, "normal_albdeo", Some("normal_albedo")),
            ("normal_albedo = 0.1\nmodel = 'minaert'", 2, 9, "minaert", Some("minnaert")),
            ("model = 'minnaert'\nk = 'x'", 2, 5, "expected a number", None),
            ("model = 'rolo'\npolynomial = [1, 2]", 2, 14, "a list of 5", None),
            ("phase_function = { kind = 'magnitude' }", 1, 27, "`magnitude`", Some("magnitudes")),
            ("phase_function = { kind = 'exponential', scale = 1 }", 1, 42, "scale", Some("scale_deg")),
            ("normal_albedo = 0.1", 1, 1, "missing field `model`", None),
        ] {
            let error = read(text).unwrap_err();
            assert_eq!(error.place, retina_files::Place::LineColumn(line, column), "{text}: {error}");
            assert!(error.to_string().contains(words), "{text}: {error}");
            assert_eq!(
                error.help.clone(),
                help.map(|name| format!("did you mean `{name}`?")),
                "{text}: {error}"
            );
        }
    }
}
