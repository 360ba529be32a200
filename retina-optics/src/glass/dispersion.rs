//! Dispersion formulas, wavelengths in um.

/// n(lambda), lambda in um. All formulas of refractiveindex.info (1-5) and of AGF files (1-13)
/// that make use of squares have one form.
#[derive(Debug, Clone, PartialEq)]
pub enum Dispersion {
    /// n^2 = constant + sum b lambda^2 / (lambda^2 - c) + sum p / (lambda^2 - q) + sum a lambda^e.
    Squared {
        /// The constant term (1 in Sellmeier's formula).
        constant: f64,
        /// (b, c in um^2): resonances in Sellmeier's form.
        sellmeier: Vec<(f64, f64)>,
        /// (p, q in um^2): resonances without lambda^2 above.
        poles: Vec<(f64, f64)>,
        /// (a, e): powers.
        powers: Vec<(f64, i32)>,
    },
    /// n = A + B L + C L^2 + D lambda^2 + E lambda^4 + F lambda^6, L = 1 / (lambda^2 - 0.028).
    Herzberger([f64; 6]),
    /// n = n0 + A / lambda + B / lambda^3.5.
    Conrady([f64; 3]),
}

impl Dispersion {
    /// Sellmeier's three-term formula with C in um^2.
    pub fn sellmeier(terms: &[(f64, f64)]) -> Self {
        Self::Squared { constant: 1.0, sellmeier: terms.to_vec(), poles: Vec::new(), powers: Vec::new() }
    }

    /// n^2 = constant + sum a lambda^e (refractiveindex.info formula 3; Schott's old formula).
    pub fn power_series(constant: f64, powers: &[(f64, i32)]) -> Self {
        Self::Squared { constant, sellmeier: Vec::new(), poles: Vec::new(), powers: powers.to_vec() }
    }

    /// The index at a wavelength in um; NaN where n^2 is negative.
    pub fn index(&self, wavelength_um: f64) -> f64 {
        let l2 = wavelength_um * wavelength_um;
        match self {
            Self::Squared { constant, sellmeier, poles, powers } => {
                let mut square = *constant;
                square += sellmeier.iter().map(|(b, c)| b * l2 / (l2 - c)).sum::<f64>();
                square += poles.iter().map(|(p, q)| p / (l2 - q)).sum::<f64>();
                square += powers.iter().map(|(a, e)| a * wavelength_um.powi(*e)).sum::<f64>();
                square.sqrt()
            }
            Self::Herzberger([a, b, c, d, e, f]) => {
                let l = 1.0 / (l2 - 0.028);
                a + b * l + c * l * l + d * l2 + e * l2 * l2 + f * l2 * l2 * l2
            }
            Self::Conrady([n0, a, b]) => n0 + a / wavelength_um + b / wavelength_um.powf(3.5),
        }
    }

    /// The formula of an AGF file's `NM` number with its `CD` coefficients (missing ones are 0);
    /// `None` for a number that is not 1 to 13. Numbering and forms: the Zemax manual, chapter
    /// "Using glass catalogs".
    pub fn agf(formula: u32, coefficients: &[f64]) -> Option<Self> {
        let c = |i: usize| coefficients.get(i).copied().unwrap_or(0.0);
        let pairs = |count: usize| (0..count).map(|i| (c(2 * i), c(2 * i + 1))).collect::<Vec<_>>();
        let powers = |exponents: &[i32]| {
            exponents.iter().enumerate().map(|(i, &e)| (c(i + 1), e)).collect::<Vec<(f64, i32)>>()
        };
        let squared =
            |constant, sellmeier, poles, powers| Self::Squared { constant, sellmeier, poles, powers };
        Some(match formula {
            1 => Self::power_series(c(0), &powers(&[2, -2, -4, -6, -8])),
            2 => Self::sellmeier(&pairs(3)),
            3 => Self::Herzberger([c(0), c(1), c(2), c(3), c(4), c(5)]),
            // lambda_1 and lambda_2 are squared here: the formula has them as wavelengths.
            4 => squared(1.0 + c(0), vec![(c(1), c(2) * c(2))], vec![(c(3), c(4) * c(4))], Vec::new()),
            5 => Self::Conrady([c(0), c(1), c(2)]),
            6 => Self::sellmeier(&pairs(4)),
            7 => squared(c(0), Vec::new(), vec![(c(1), c(2))], vec![(-c(3), 2)]),
            8 => squared(c(0), vec![(c(1), c(2))], Vec::new(), vec![(-c(3), 2)]),
            9 => squared(c(0), vec![(c(1), c(2)), (c(3), c(4))], Vec::new(), Vec::new()),
            10 => Self::power_series(c(0), &powers(&[2, -2, -4, -6, -8, -10, -12])),
            11 => Self::sellmeier(&pairs(5)),
            12 => Self::power_series(c(0), &powers(&[2, -2, -4, -6, -8, 4, 6])),
            13 => Self::power_series(c(0), &powers(&[2, 4, -2, -4, -6, -8, -10, -12])),
            _ => return None,
        })
    }
}

/// Index of air (Kohlrausch's formula, as Zemax and Schott's TIE-19 use it).
pub fn air_index(wavelength_um: f64, temperature_c: f64, pressure_atm: f64) -> f64 {
    let l2 = wavelength_um * wavelength_um;
    let reference =
        1e-8 * (6432.8 + 2_949_810.0 * l2 / (146.0 * l2 - 1.0) + 25_540.0 * l2 / (41.0 * l2 - 1.0));
    1.0 + reference * pressure_atm / (1.0 + (temperature_c - 15.0) * 3.4785e-3)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 1.00027717 at 587.6 nm, 15 degC: Edlen's value for standard air is 1.0002772.
    #[test]
    fn air() {
        assert!((air_index(0.5876, 15.0, 1.0) - 1.000_277_2).abs() < 1e-7);
        assert_eq!(air_index(0.5876, 20.0, 0.0), 1.0);
    }
}
