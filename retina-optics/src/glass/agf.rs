//! Glass catalogues in the AGF format (Zemax), UTF-8, UTF-16 or Latin-1.

use std::path::Path;

use retina_files::InputError;

use super::{Dispersion, Glass, ThermalDispersion};
use crate::text::{number, read_text_any};

/// Reads every glass of an AGF file.
///
/// Used: `NM` (name, formula 1-13), `CD` (coefficients), `LD` (range, um), `TD` (D0 D1 D2 E0 E1
/// lambda_tk and reference temperature), `ED` (expansion -30..70 degC in 1e-6/K). `GC`, `CC`,
/// `OD`, `IT`, `MD`, `AD`, `BD` hold comments, prices, transmission and mechanics, which do not
/// change a trace.
///
/// # Errors
/// A line of another kind, a formula number that is not 1 to 13, numbers that are none, a glass
/// without coefficients or range, an index outside 1 to 10 within its range, a file without glasses: each with its line.
pub fn read_agf(path: &Path) -> Result<Vec<Glass>, InputError> {
    parse_agf(path, &read_text_any(path)?)
}

/// Places of a glass's range where its index is looked at.
const RANGE_STEPS: u32 = 64;
/// Indices that a medium may have; a little below 1 is an absolute index of a gas against air.
const INDICES: std::ops::RangeInclusive<f64> = 0.999..=10.0;

struct Open {
    line: usize,
    name: String,
    formula: u32,
    coefficients: Vec<f64>,
    range_um: Option<[f64; 2]>,
    thermal: Option<ThermalDispersion>,
    expansion_per_k: Option<f64>,
}

impl Open {
    fn close(self, path: &Path, catalogue: &str) -> Result<Glass, InputError> {
        let error = |problem: String| InputError::new(path, problem).line(self.line);
        if self.coefficients.is_empty() {
            return Err(error(format!("glass {} has no coefficients", self.name)).expected("a CD line"));
        }
        let range_um = self.range_um.ok_or_else(|| {
            error(format!("glass {} has no wavelength range", self.name)).expected("an LD line")
        })?;
        let dispersion = Dispersion::agf(self.formula, &self.coefficients).ok_or_else(|| {
            error(format!("glass {} has an unknown formula", self.name))
                .found(self.formula)
                .expected("1 to 13")
        })?;
        let [low, high] = range_um;
        if !(low >= 0.01 && low < high && high <= 1000.0) {
            return Err(error(format!("glass {} has a wavelength range that is none", self.name))
                .found(format!("{low} to {high} um"))
                .expected("two wavelengths in um, the shorter one first"));
        }
        for step in 0..=RANGE_STEPS {
            let wavelength_um = low + (high - low) * f64::from(step) / f64::from(RANGE_STEPS);
            let index = dispersion.index(wavelength_um);
            if !INDICES.contains(&index) {
                return Err(error(format!("glass {} has an index that no glass has", self.name))
                    .found(format!("{index:.4} at {wavelength_um:.4} um"))
                    .expected(format!("1 to 10 over its range, {low} to {high} um"))
                    .help("check its CD and LD lines against the maker's catalogue"));
            }
        }
        Ok(Glass {
            name: self.name,
            catalogue: catalogue.to_owned(),
            dispersion,
            range_um,
            thermal: self.thermal,
            expansion_per_k: self.expansion_per_k,
        })
    }
}

fn parse_agf(path: &Path, text: &str) -> Result<Vec<Glass>, InputError> {
    let catalogue = path.file_stem().map(|stem| stem.to_string_lossy().to_lowercase()).unwrap_or_default();
    let mut glasses = Vec::new();
    let mut open: Option<Open> = None;
    for (i, content) in text.lines().enumerate() {
        let line = i + 1;
        let mut words = content.split_whitespace();
        let Some(key) = words.next() else { continue };
        let words: Vec<&str> = words.collect();
        let value = |n: usize| -> Result<f64, InputError> {
            let word = words.get(n).ok_or_else(|| {
                InputError::new(path, format!("the {key} line is too short"))
                    .line(line)
                    .found(format!("{} values", words.len()))
                    .expected(format!("at least {}", n + 1))
            })?;
            number(path, line, word)
        };
        if key == "NM" {
            if let Some(done) = open.take() {
                glasses.push(done.close(path, &catalogue)?);
            }
            let name =
                words.first().ok_or_else(|| InputError::new(path, "a glass without a name").line(line))?;
            open = Some(Open {
                line,
                name: (*name).to_owned(),
                formula: value(1)? as u32,
                coefficients: Vec::new(),
                range_um: None,
                thermal: None,
                expansion_per_k: None,
            });
            continue;
        }
        if matches!(key, "GC" | "CC" | "OD" | "IT" | "MD" | "AD" | "BD") || key.starts_with(['!', '#']) {
            continue;
        }
        let Some(glass) = open.as_mut() else {
            return Err(InputError::new(path, "is not an AGF file: no glass has begun")
                .line(line)
                .found(format!("`{key}`"))
                .expected("a line NM"));
        };
        match key {
            "CD" => glass.coefficients = (0..words.len()).map(value).collect::<Result<_, _>>()?,
            "LD" => glass.range_um = Some([value(0)?, value(1)?]),
            // The makers leave TCE out as "-" or 0: both mean that it is not known.
            "ED" => {
                glass.expansion_per_k = match words.first() {
                    Some(&"-") | None => None,
                    Some(_) => Some(value(0)? * 1e-6).filter(|&e| e != 0.0),
                }
            }
            "TD" if words.len() >= 7 => {
                let t: Vec<f64> = (0..7).map(value).collect::<Result<_, _>>()?;
                if t[..5].iter().any(|&x| x != 0.0) {
                    glass.thermal = Some(ThermalDispersion {
                        d: [t[0], t[1], t[2]],
                        e: [t[3], t[4]],
                        lambda_tk_um: t[5],
                        reference_c: t[6],
                    });
                }
            }
            "TD" if words.iter().all(|word| *word == "-") => {}
            _ => {
                return Err(InputError::new(path, "a line that is not understood")
                    .line(line)
                    .found(format!("`{content}`"))
                    .expected("NM, GC, ED, CD, TD, OD, LD or IT"));
            }
        }
    }
    if let Some(done) = open.take() {
        glasses.push(done.close(path, &catalogue)?);
    }
    if glasses.is_empty() {
        return Err(InputError::new(path, "holds no glass").expected("an AGF glass catalogue"));
    }
    Ok(glasses)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// N-BK7 of SCHOTT's catalogue of 2017-01-20. dn/dT absolute at 546.1 nm, +20/+40 degC, is
    /// 1.6e-6/K and relative 3.0e-6/K in SCHOTT's data sheet of N-BK7.
    const BK7: &str = "CC SCHOTT\nNM N-BK7 2 517642.251 1.5168 64.17 0 1\nGC\nED 7.1 8.3 2.51 -0.0009 0\n\
        CD 1.03961212 0.00600069867 0.231792344 0.0200179144 1.01046945 103.560653\n\
        TD 1.86E-06 1.31E-08 -1.37E-11 4.34E-07 6.27E-10 0.17 20\nOD -1 1 0 0 1 0\nLD 0.3 2.5\n";

    #[test]
    fn dispersion_and_dn_dt_of_n_bk7() {
        let glass = parse_agf(Path::new("schott.agf"), BK7).unwrap().remove(0);
        assert!((glass.index(0.5875618).unwrap() - 1.5168).abs() < 5e-6);
        let slope =
            (glass.index_at(0.5461, 40.0, 1.0).unwrap() - glass.index_at(0.5461, 20.0, 1.0).unwrap()) / 20.0;
        assert!((slope - 3.0e-6).abs() < 0.06e-6, "{slope}");
        assert!((glass.expansion_per_k.unwrap() - 7.1e-6).abs() < 1e-18);
    }

    /// The other formulas, evaluated by hand at 0.5 um (lambda^2 = 0.25) with round coefficients.
    #[test]
    fn formulas_by_hand() {
        let n = |formula, c: &[f64]| Dispersion::agf(formula, c).unwrap().index(0.5);
        let same = |a: f64, b: f64| assert!((a - b).abs() < 1e-14, "{a} {b}");
        same(n(1, &[2.0, 1.0, 0.01]), (2.0f64 + 0.25 + 0.04).sqrt());
        same(n(3, &[1.5, 0.001, 0.0, 0.1]), 1.5 + 0.001 / 0.222 + 0.025);
        same(n(4, &[0.5, 1.0, 0.1, 0.02, 0.3]), (1.5f64 + 0.25 / 0.24 + 0.02 / 0.16).sqrt());
        same(n(5, &[1.5, 0.01, 0.001]), 1.5 + 0.02 + 0.001 * 2f64.powf(3.5));
        same(n(7, &[2.0, 0.01, 0.05, 0.1]), (2.0f64 + 0.05 - 0.025).sqrt());
        same(n(8, &[2.0, 0.8, 0.05, 0.1]), (2.0f64 + 1.0 - 0.025).sqrt());
        same(n(9, &[1.0, 0.8, 0.05, 0.3, 0.15]), (2.0f64 + 0.75).sqrt());
        same(n(12, &[2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.16, 0.64]), (2.0f64 + 0.01 + 0.01).sqrt());
        same(n(13, &[2.0, 0.0, 0.16, 0.01]), (2.0f64 + 0.01 + 0.04).sqrt());
        assert!(Dispersion::agf(14, &[]).is_none());
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let refused = |text: &str, words: &str| {
            let error = parse_agf(Path::new("a.agf"), text).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        };
        refused("", "holds no glass");
        refused(&BK7.replace("LD 0.3 2.5\n", ""), "line 2: glass N-BK7 has no wavelength range");
        refused(&BK7.replace("0.231792344", "x"), "line 5");
        refused(&BK7.replace("N-BK7 2", "N-BK7 14"), "unknown formula");
        refused(
            &BK7.replace("CD 1.03961212", "CD 1039.61212"),
            "line 2: glass N-BK7 has an index that no glass has (found 3",
        );
        refused(
            &BK7.replace("CD 1.03961212", "CD -103"),
            "(found NaN at 0.3000 um, expected 1 to 10 over its range",
        );
        refused(
            &BK7.replace("LD 0.3 2.5", "LD 2.5 0.3"),
            "has a wavelength range that is none (found 2.5 to 0.3 um",
        );
        refused("QQ 1\n", "no glass has begun");
        refused(&(BK7.to_owned() + "QQ 1\n"), "line 9: a line that is not understood");
    }
}
