//! Wavefronts over the unit disc as sums of Zernike polynomials, from their gradients.
//!
//! Source: R. J. Noll, "Zernike polynomials and atmospheric turbulence", J. Opt. Soc. Am. 66, 207 (1976).
//! Here unnormalised: each polynomial is 1 at most on the disc. Piston is left out.

use super::Wavefront;

/// Highest radial order.
pub(super) const DEGREE: usize = 9;
/// Number of polynomials: all orders up to the ninth without piston.
pub const WAVEFRONT_TERMS: usize = (DEGREE + 1) * (DEGREE + 2) / 2 - 1;

/// Order and signed frequency of each term: the tilts along x and y first. Positive frequencies are
/// cosines, negative sines.
fn indices() -> impl Iterator<Item = (usize, i32)> {
    (1..=DEGREE).flat_map(|n| {
        (0..=n).map(move |k| {
            let m = (n - 2 * (k / 2)) as i32;
            // n, -n, n - 2, -(n - 2), ..., and 0 once for even n.
            (n, if k % 2 == 0 { m } else { -m })
        })
    })
}

/// Indices of the tilts along x and y.
pub const TILT: [usize; 2] = [0, 1];
/// Indices of coma along x and y, (3 r^2 - 2) x and y.
pub const COMA: [usize; 2] = [7, 8];

/// Indices of the terms that vary with the first harmonic of the angle: the cosine (axis 0) or sine.
pub(super) fn first_harmonics(axis: usize) -> impl Iterator<Item = usize> {
    let wanted = if axis == 0 { 1 } else { -1 };
    indices().enumerate().filter(move |(_, (_, m))| *m == wanted).map(|(k, _)| k)
}

/// Values and derivatives along x and y of all terms at a point of the disc.
pub(super) fn terms(at: [f64; 2]) -> [[f64; 3]; WAVEFRONT_TERMS] {
    // Powers of z = x + i y: r^m cos(m a) and r^m sin(m a) are its parts, and d z^m / dx = m z^(m-1).
    let mut power = [[0.0; 2]; DEGREE + 1];
    power[0] = [1.0, 0.0];
    for m in 1..=DEGREE {
        let [re, im] = power[m - 1];
        power[m] = [re * at[0] - im * at[1], re * at[1] + im * at[0]];
    }
    let r2 = at[0] * at[0] + at[1] * at[1];
    let mut out = [[0.0; 3]; WAVEFRONT_TERMS];
    for (out, (n, signed)) in out.iter_mut().zip(indices()) {
        let m = signed.unsigned_abs() as usize;
        // R(r) / r^m is a polynomial in u = r^2.
        let (mut radial, mut slope) = (0.0, 0.0);
        for s in 0..=(n - m) / 2 {
            let sign = if s.is_multiple_of(2) { 1.0 } else { -1.0 };
            let c = sign * factorial(n - s)
                / (factorial(s) * factorial((n + m) / 2 - s) * factorial((n - m) / 2 - s));
            let k = (n - m) / 2 - s;
            radial += c * r2.powi(k as i32);
            if k > 0 {
                slope += c * k as f64 * r2.powi(k as i32 - 1);
            }
        }
        let part = usize::from(signed < 0);
        let angular = power[m][part];
        let (ax, ay) = if m == 0 {
            (0.0, 0.0)
        } else {
            let [re, im] = power[m - 1];
            let m = m as f64;
            if part == 0 { (m * re, -m * im) } else { (m * im, m * re) }
        };
        *out = [
            radial * angular,
            radial * ax + 2.0 * at[0] * slope * angular,
            radial * ay + 2.0 * at[1] * slope * angular,
        ];
    }
    out
}

/// Number of coefficients of a [`Polynomial`].
pub(super) const SIDE: usize = DEGREE + 1;

/// A polynomial in (x, y) of total degree at most [`DEGREE`]: the coefficient of x^i y^j at i + SIDE j.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Polynomial([f64; SIDE * SIDE]);

impl Polynomial {
    const ZERO: Self = Self([0.0; SIDE * SIDE]);

    /// a + b x + c y.
    fn linear(a: f64, b: f64, c: f64) -> Self {
        let mut out = Self::ZERO;
        (out.0[0], out.0[1], out.0[SIDE]) = (a, b, c);
        out
    }

    fn add(&mut self, other: &Self, weight: f64) {
        self.0.iter_mut().zip(&other.0).for_each(|(a, b)| *a += weight * b);
    }

    /// The product; the caller keeps the degrees within [`DEGREE`].
    fn times(&self, other: &Self) -> Self {
        let mut out = Self::ZERO;
        for j in 0..SIDE {
            for i in 0..SIDE - j {
                let c = self.0[i + SIDE * j];
                if c != 0.0 {
                    for l in 0..SIDE - j {
                        for k in 0..SIDE - i {
                            let d = other.0[k + SIDE * l];
                            if d != 0.0 {
                                out.0[i + k + SIDE * (j + l)] += c * d;
                            }
                        }
                    }
                }
            }
        }
        out
    }

    /// The sum of Zernike terms with these coefficients.
    pub(super) fn of_terms(coefficients: &[f64; WAVEFRONT_TERMS]) -> Self {
        static ALL: std::sync::LazyLock<Vec<Polynomial>> =
            std::sync::LazyLock::new(|| indices().map(|(n, m)| Polynomial::zernike(n, m)).collect());
        let mut sum = Self::ZERO;
        for (term, c) in ALL.iter().zip(coefficients) {
            sum.add(term, *c);
        }
        sum
    }

    fn zernike(n: usize, signed: i32) -> Self {
        let m = signed.unsigned_abs() as usize;
        let (x, y) = (Self::linear(0.0, 1.0, 0.0), Self::linear(0.0, 0.0, 1.0));
        let (mut re, mut im) = (Self::linear(1.0, 0.0, 0.0), Self::ZERO);
        for _ in 0..m {
            let (mut a, mut b) = (re.times(&x), im.times(&x));
            a.add(&im.times(&y), -1.0);
            b.add(&re.times(&y), 1.0);
            (re, im) = (a, b);
        }
        let mut r2 = x.times(&x);
        r2.add(&y.times(&y), 1.0);
        let mut radial = Self::ZERO;
        let mut power = Self::linear(1.0, 0.0, 0.0);
        let half = (n - m) / 2;
        for k in 0..=half {
            let s = half - k;
            let sign = if s.is_multiple_of(2) { 1.0 } else { -1.0 };
            let c =
                factorial(n - s) / (factorial(s) * factorial((n + m) / 2 - s) * factorial((n - m) / 2 - s));
            radial.add(&power, sign * c);
            if k < half {
                power = power.times(&r2);
            }
        }
        radial.times(if signed < 0 { &im } else { &re })
    }

    /// The polynomial in (u, v) for x = a u + b v, y = c u + d v.
    pub(super) fn transformed(&self, [[a, b], [c, d]]: [[f64; 2]; 2]) -> Self {
        let (x, y) = (Self::linear(0.0, a, b), Self::linear(0.0, c, d));
        let mut sum = Self::ZERO;
        let mut x_power = Self::linear(1.0, 0.0, 0.0);
        for i in 0..SIDE {
            let mut term = x_power.clone();
            for j in 0..SIDE - i {
                sum.add(&term, self.0[i + SIDE * j]);
                if i + j < DEGREE {
                    term = term.times(&y);
                }
            }
            if i < DEGREE {
                x_power = x_power.times(&x);
            }
        }
        sum
    }

    /// The derivatives along x and along y.
    pub(super) fn gradient(&self) -> [Self; 2] {
        let (mut dx, mut dy) = (Self::ZERO, Self::ZERO);
        for j in 0..SIDE {
            for i in 0..SIDE - j {
                let c = self.0[i + SIDE * j];
                if i > 0 {
                    dx.0[i - 1 + SIDE * j] = i as f64 * c;
                }
                if j > 0 {
                    dy.0[i + SIDE * (j - 1)] = j as f64 * c;
                }
            }
        }
        [dx, dy]
    }

    /// The polynomial in x that it is on the line of this y: coefficients by rising power.
    pub(super) fn on_row(&self, y: f64) -> [f64; SIDE] {
        let mut row = [0.0; SIDE];
        for j in (0..SIDE).rev() {
            for i in 0..SIDE - j {
                row[i] = row[i] * y + self.0[i + SIDE * j];
            }
        }
        row
    }
}

/// The polynomial with these coefficients, by rising power, at x.
#[inline(always)]
pub(super) fn horner(coefficients: &[f64; SIDE], x: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c)
}

fn factorial(n: usize) -> f64 {
    (1..=n).map(|k| k as f64).product()
}

/// The terms' slopes at fixed points of the pupil: directions of the rays of many wavefronts through them.
#[derive(Debug, Clone)]
pub struct PupilSlopes {
    /// Of each term: along x and y at each point in turn.
    slopes: Vec<f64>,
    columns: usize,
}

impl PupilSlopes {
    /// At these points (unit disc).
    pub fn new(points: impl IntoIterator<Item = [f64; 2]>) -> Self {
        let all: Vec<_> = points.into_iter().map(terms).collect();
        let of_term = |k: usize| all.iter().flat_map(move |terms| [terms[k][1], terms[k][2]]);
        Self { slopes: (0..WAVEFRONT_TERMS).flat_map(of_term).collect(), columns: 2 * all.len() }
    }

    /// Direction cosines of a wavefront's rays through the points: grad V.
    pub fn directions(&self, wavefront: &Wavefront) -> Vec<[f64; 2]> {
        let mut sums = vec![0.0; self.columns];
        for (slopes, c) in self.slopes.chunks_exact(self.columns.max(1)).zip(&wavefront.coefficients_mm) {
            sums.iter_mut().zip(slopes).for_each(|(sum, slope)| *sum += slope * c);
        }
        sums.chunks_exact(2)
            .map(|pair| [pair[0], pair[1]].map(|sum| sum / wavefront.pupil_radius_mm))
            .collect()
    }
}

/// Finds a wavefront from its slopes at fixed points of the pupil, by least squares.
#[derive(Debug, Clone)]
pub struct SlopeFit {
    /// Rows: coefficient; columns: slope along x, along y of each point in turn.
    inverse: Vec<f64>,
    columns: usize,
}

impl SlopeFit {
    /// For slopes at these points (unit disc). The points must determine all terms: 20 on a ring, on 8 rings, do.
    pub fn new(points: &[[f64; 2]]) -> Self {
        let columns = 2 * points.len();
        let mut design = vec![0.0; columns * WAVEFRONT_TERMS];
        for (i, &at) in points.iter().enumerate() {
            for (k, term) in terms(at).iter().enumerate() {
                design[2 * i * WAVEFRONT_TERMS + k] = term[1];
                design[(2 * i + 1) * WAVEFRONT_TERMS + k] = term[2];
            }
        }
        let mut normal = vec![0.0; WAVEFRONT_TERMS * WAVEFRONT_TERMS];
        for row in design.chunks_exact(WAVEFRONT_TERMS) {
            for a in 0..WAVEFRONT_TERMS {
                for b in 0..=a {
                    normal[a * WAVEFRONT_TERMS + b] += row[a] * row[b];
                }
            }
        }
        let factor = cholesky(normal);
        let mut inverse = vec![0.0; WAVEFRONT_TERMS * columns];
        for (column, row) in design.chunks_exact(WAVEFRONT_TERMS).enumerate() {
            let solved = solve(&factor, row);
            for (k, value) in solved.into_iter().enumerate() {
                inverse[k * columns + column] = value;
            }
        }
        Self { inverse, columns }
    }

    /// The wavefront of rays with these direction cosines, x and y in turn, through a pupil of this radius.
    pub fn wavefront(&self, cosines: &[f64], pupil_radius_mm: f64) -> Wavefront {
        Wavefront { coefficients_mm: self.fit(cosines).map(|c| c * pupil_radius_mm), pupil_radius_mm }
    }

    /// Coefficients of the wavefront whose slopes (x and y in turn) these are.
    fn fit(&self, slopes: &[f64]) -> [f64; WAVEFRONT_TERMS] {
        std::array::from_fn(|k| {
            let row = &self.inverse[k * self.columns..(k + 1) * self.columns];
            row.iter().zip(slopes).map(|(a, b)| a * b).sum()
        })
    }
}

/// Lower factor of a symmetric positive matrix whose lower half is given.
fn cholesky(mut a: Vec<f64>) -> Vec<f64> {
    for j in 0..WAVEFRONT_TERMS {
        for k in 0..j {
            let l = a[j * WAVEFRONT_TERMS + k];
            for i in j..WAVEFRONT_TERMS {
                a[i * WAVEFRONT_TERMS + j] -= a[i * WAVEFRONT_TERMS + k] * l;
            }
        }
        let pivot = a[j * WAVEFRONT_TERMS + j].sqrt();
        for i in j..WAVEFRONT_TERMS {
            a[i * WAVEFRONT_TERMS + j] /= pivot;
        }
    }
    a
}

fn solve(lower: &[f64], right: &[f64]) -> [f64; WAVEFRONT_TERMS] {
    let mut x = [0.0; WAVEFRONT_TERMS];
    for i in 0..WAVEFRONT_TERMS {
        let sum: f64 = (0..i).map(|k| lower[i * WAVEFRONT_TERMS + k] * x[k]).sum();
        x[i] = (right[i] - sum) / lower[i * WAVEFRONT_TERMS + i];
    }
    for i in (0..WAVEFRONT_TERMS).rev() {
        let sum: f64 = (i + 1..WAVEFRONT_TERMS).map(|k| lower[k * WAVEFRONT_TERMS + i] * x[k]).sum();
        x[i] = (x[i] - sum) / lower[i * WAVEFRONT_TERMS + i];
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pupil::gaussian;

    /// Closed forms: defocus 2 r^2 - 1, coma (3 r^2 - 2) x, spherical aberration 6 r^4 - 6 r^2 + 1.
    #[test]
    fn terms_are_zernikes() {
        let (x, y) = (0.4, -0.55);
        let r2: f64 = x * x + y * y;
        let all = terms([x, y]);
        let of = |n: usize, m: i32| all[indices().position(|index| index == (n, m)).unwrap()];
        assert_eq!(&all[0][..2], &[x, 1.0]);
        assert_eq!((all[1][0], all[1][2]), (y, 1.0));
        for (got, expected) in [
            (of(2, 0), [2.0 * r2 - 1.0, 4.0 * x, 4.0 * y]),
            (all[COMA[0]], [(3.0 * r2 - 2.0) * x, 9.0 * x * x + 3.0 * y * y - 2.0, 6.0 * x * y]),
            (of(2, -2), [2.0 * x * y, 2.0 * y, 2.0 * x]),
            (of(4, 0), [6.0 * r2 * r2 - 6.0 * r2 + 1.0, (24.0 * r2 - 12.0) * x, (24.0 * r2 - 12.0) * y]),
        ] {
            for k in 0..3 {
                assert!((got[k] - expected[k]).abs() < 1e-13, "{got:?} {expected:?}");
            }
        }
        let rim = terms([0.6, 0.8]);
        assert!(rim.iter().all(|t| t[0].abs() <= 1.0 + 1e-12));
    }

    /// As polynomials the terms are the same functions, in turned and stretched coordinates too.
    #[test]
    fn polynomials_are_the_terms() {
        let wanted: [f64; WAVEFRONT_TERMS] = std::array::from_fn(|k| ((k * 5 + 1) % 7) as f64 - 3.0);
        let sum = Polynomial::of_terms(&wanted);
        let map = [[0.97, 0.02], [0.03, 0.95]];
        let turned = sum.transformed(map);
        let value = |polynomial: &Polynomial, [x, y]: [f64; 2]| horner(&polynomial.on_row(y), x);
        for at in [[0.3, -0.7], [-0.5, 0.1], [0.0, 0.0]] {
            let expected: f64 = terms(at).iter().zip(wanted).map(|(t, c)| t[0] * c).sum();
            assert!((value(&sum, at) - expected).abs() < 1e-11, "{at:?}");
            for (k, slope) in sum.gradient().iter().enumerate() {
                let expected: f64 = terms(at).iter().zip(wanted).map(|(t, c)| t[1 + k] * c).sum();
                assert!((value(slope, at) - expected).abs() < 1e-10, "{at:?}");
            }
            let to = [map[0][0] * at[0] + map[0][1] * at[1], map[1][0] * at[0] + map[1][1] * at[1]];
            let expected: f64 = terms(to).iter().zip(wanted).map(|(t, c)| t[0] * c).sum();
            assert!((value(&turned, at) - expected).abs() < 1e-11, "{at:?}");
        }
    }

    #[test]
    fn a_wavefront_is_found_from_its_slopes() {
        let points: Vec<[f64; 2]> = gaussian(8, 20, 0.0).iter().map(|p| p.at).collect();
        let wanted: [f64; WAVEFRONT_TERMS] = std::array::from_fn(|k| ((k * 7 + 3) % 11) as f64 - 5.0);
        let slopes: Vec<f64> = points
            .iter()
            .flat_map(|&at| {
                let all = terms(at);
                [1, 2].map(|d| all.iter().zip(wanted).map(|(t, c)| t[d] * c).sum::<f64>())
            })
            .collect();
        let got = SlopeFit::new(&points).fit(&slopes);
        assert!(got.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-10), "{got:?}");
    }
}
