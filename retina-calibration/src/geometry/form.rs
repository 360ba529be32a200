//! The form of D^-1: which monomials x^i y^j L^k it has and how many rings, and their values in scaled coordinates.

use faer::Mat;
use glam::DVec2;
use retina_geometry::Rings;

/// Powers [i, j, k] of x^i y^j L^k.
pub type Term = [u32; 3];

/// Highest powers that occur in a form, plus one.
pub(crate) const SIDE: usize = retina_geometry::MAX_DEGREE as usize + 1;

/// A polynomial of `degree` in (x, y), for each power of L up to `irradiance_power` one of `irradiance_degree`, and rings
/// about the distortion's centre.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ModelForm {
    /// Total degree in x and y without irradiance, 1 to 9.
    pub degree: u32,
    /// Total degree in x and y of the coefficients of L, at most `degree`.
    pub irradiance_degree: u32,
    /// Highest power of L; 0: plain.
    pub irradiance_power: u32,
    /// Intervals between the rings' knots; 0: no rings.
    pub rings: u32,
}

impl ModelForm {
    /// Without irradiance (the paper's Fig. 10b).
    pub fn plain(degree: u32) -> Self {
        Self { degree, irradiance_degree: 0, irradiance_power: 0, rings: 0 }
    }

    /// Its terms, powers of L first, then of x, then of y.
    pub fn terms(&self) -> Vec<Term> {
        let mut out = Vec::new();
        for k in 0..=self.irradiance_power {
            let degree = if k == 0 { self.degree } else { self.irradiance_degree };
            for i in 0..=degree {
                out.extend((0..=degree - i).map(|j| [i, j, k]));
            }
        }
        out
    }

    /// Number of coefficients per axis.
    pub fn len(&self) -> usize {
        let triangle = |d: u32| ((d + 1) * (d + 2) / 2) as usize;
        triangle(self.degree)
            + self.irradiance_power as usize * triangle(self.irradiance_degree)
            + 2 * self.rings as usize
    }

    /// Never: every form has at least the constant.
    pub fn is_empty(&self) -> bool {
        false
    }
}

/// Maps the data's box to [-1, 1] in x, y and L, where products of Legendre polynomials are nearly orthogonal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Scaling {
    middle: [f64; 3],
    half: [f64; 3],
}

impl Scaling {
    pub(crate) fn of(points: impl Iterator<Item = (DVec2, f64)>) -> Self {
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for (r, l) in points {
            for (k, value) in [r.x, r.y, l].into_iter().enumerate() {
                low[k] = low[k].min(value);
                high[k] = high[k].max(value);
            }
        }
        let middle = [0, 1, 2].map(|k| 0.5 * (low[k] + high[k]));
        let half = [0, 1, 2].map(|k| {
            let half = 0.5 * (high[k] - low[k]);
            if half > 1e-9 { half } else { 1.0 }
        });
        Self { middle, half }
    }

    /// Values of the basis functions P_i(x) P_j(y) P_k(L) of `terms`, into `out`.
    pub(crate) fn fill(&self, r: DVec2, l: f64, terms: &[Term], out: &mut [f64]) {
        let at = [r.x, r.y, l];
        let p = [0, 1, 2].map(|k| legendre((at[k] - self.middle[k]) / self.half[k]));
        for (value, [i, j, k]) in out.iter_mut().zip(terms) {
            *value = p[0][*i as usize] * p[1][*j as usize] * p[2][*k as usize];
        }
    }

    /// The matrix that takes coefficients of the basis functions to those of the monomials x^i y^j L^k of the same
    /// terms; row by row, `terms.len()` squared. `terms` must hold every lower power of each of its terms.
    pub(crate) fn monomials_from_basis(&self, terms: &[Term]) -> Vec<f64> {
        let axes = [0, 1, 2].map(|k| shifted_legendre(self.middle[k], self.half[k]));
        let n = terms.len();
        let mut out = vec![0.0; n * n];
        for (row, to) in terms.iter().enumerate() {
            for (column, from) in terms.iter().enumerate() {
                out[row * n + column] =
                    (0..3).map(|axis| axes[axis][from[axis] as usize][to[axis] as usize]).product();
            }
        }
        out
    }
}

/// P_0 to P_13 at t.
fn legendre(t: f64) -> [f64; SIDE] {
    let mut p = [1.0; SIDE];
    p[1] = t;
    for n in 1..SIDE - 1 {
        let order = n as f64;
        p[n + 1] = ((2.0 * order + 1.0) * t * p[n] - order * p[n - 1]) / (order + 1.0);
    }
    p
}

/// Coefficients of the powers of z of P_n((z - middle) / half).
fn shifted_legendre(middle: f64, half: f64) -> [[f64; SIDE]; SIDE] {
    let mut out = [[0.0; SIDE]; SIDE];
    out[0][0] = 1.0;
    out[1][0] = -middle / half;
    out[1][1] = 1.0 / half;
    for n in 1..SIDE - 1 {
        let order = n as f64;
        for power in 0..SIDE {
            let raised = if power > 0 { out[n][power - 1] } else { 0.0 };
            let t_times = (raised - middle * out[n][power]) / half;
            out[n + 1][power] = ((2.0 * order + 1.0) * t_times - order * out[n - 1][power]) / (order + 1.0);
        }
    }
    out
}

/// Where a form's columns are taken: the box of the data, and the rings' centre and reach where there is one.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Domain {
    pub(crate) scaling: Scaling,
    /// Centre and radius.
    pub(crate) rings: Option<(DVec2, f64)>,
}

/// The columns of a form.
#[derive(Debug, Clone)]
pub(crate) struct Basis {
    pub(crate) form: ModelForm,
    pub(crate) terms: Vec<Term>,
    pub(crate) rings: Option<Rings>,
    scaling: Scaling,
}

/// What a ring may move its points by, as a standard deviation, tangent plane: 200 arcsec, against points of some arcsec next
/// to nothing. Where rings and polynomials are nearly the same, it keeps both small.
pub(crate) const RING_SIGMA: f64 = 1e-3;

impl Domain {
    /// Without a centre there are no rings.
    pub(crate) fn basis(&self, form: ModelForm) -> Basis {
        let rings = self.rings.filter(|_| form.rings > 0);
        let rings = rings.map(|(center, radius)| Rings { center, radius, intervals: form.rings });
        Basis { form, terms: form.terms(), rings, scaling: self.scaling }
    }
}

impl Basis {
    /// Number of columns.
    pub(crate) fn len(&self) -> usize {
        self.terms.len() + self.rings.map_or(0, |rings| rings.columns())
    }

    /// Values of the columns, into `out`.
    pub(crate) fn fill(&self, r: DVec2, l: f64, out: &mut [f64]) {
        let (polynomial, rings) = out.split_at_mut(self.terms.len());
        self.scaling.fill(r, l, &self.terms, polynomial);
        if let Some(own) = &self.rings {
            own.fill(r, rings);
        }
    }

    /// Inverse variance that a column's coefficient has before any data.
    pub(crate) fn prior(&self, column: usize) -> f64 {
        if column < self.terms.len() { 0.0 } else { RING_SIGMA.powi(-2) }
    }

    /// The matrix that takes coefficients of the columns to those of monomials and rings.
    pub(crate) fn to_monomials(&self) -> Mat<f64> {
        let n = self.terms.len();
        let change = self.scaling.monomials_from_basis(&self.terms);
        Mat::from_fn(self.len(), self.len(), |row, column| match (row < n, column < n) {
            (true, true) => change[row * n + column],
            (false, false) if row == column => 1.0,
            _ => 0.0,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn basis_and_monomials_are_the_same_polynomial() {
        let form = ModelForm { degree: 5, irradiance_degree: 3, irradiance_power: 2, rings: 0 };
        let terms = form.terms();
        assert_eq!(terms.len(), form.len());
        let scaling =
            Scaling::of([(DVec2::new(-0.15, -0.08), -3.0), (DVec2::new(0.13, 0.11), 0.0)].into_iter());
        let coefficients: Vec<f64> = (0..terms.len()).map(|i| ((i * 37 % 17) as f64 - 8.0) / 5.0).collect();
        let n = terms.len();
        let matrix = scaling.monomials_from_basis(&terms);
        let monomials: Vec<f64> =
            (0..n).map(|row| (0..n).map(|c| matrix[row * n + c] * coefficients[c]).sum()).collect();
        let (r, l) = (DVec2::new(0.05, -0.03), -1.2);
        let mut values = vec![0.0; n];
        scaling.fill(r, l, &terms, &mut values);
        let by_basis: f64 = values.iter().zip(&coefficients).map(|(a, b)| a * b).sum();
        let by_monomials: f64 = terms
            .iter()
            .zip(&monomials)
            .map(|([i, j, k], c)| c * r.x.powi(*i as i32) * r.y.powi(*j as i32) * l.powi(*k as i32))
            .sum();
        assert!((by_basis - by_monomials).abs() < 1e-10, "{by_basis} {by_monomials}");
        // P_3(t) = (5 t^3 - 3 t) / 2, at t = 0.5: -0.4375 (Abramowitz and Stegun 22.4).
        assert!((legendre(0.5)[3] + 0.4375).abs() < 1e-15);
    }
}
