//! A polynomial from screen to camera pixels, fitted to matches as they are found.

use faer::Mat;
use faer::linalg::solvers::SolveLstsq as _;
use glam::DVec2;

use super::form::{ModelForm, Scaling, Term};

/// A polynomial map with the distances that it leaves.
#[derive(Debug, Clone)]
pub(crate) struct Warping {
    terms: Vec<Term>,
    scaling: Scaling,
    coefficients: Vec<DVec2>,
    /// Typical distance that the matches keep, px: 1.2 times their median, the rms of normal errors in the plane.
    pub(crate) rms_px: f64,
    centre: DVec2,
    size: f64,
}

impl Warping {
    /// Fits matches (index into `from`, index into `to`), of a degree that their number bears; distant ones are left
    /// out of a second and third fit.
    pub(crate) fn fit(from: &[DVec2], to: &[DVec2], pairs: &[(usize, usize)]) -> Option<Self> {
        let degree = match pairs.len() {
            0..=5 => return None,
            6..=19 => 1,
            20..=49 => 2,
            50..=119 => 3,
            _ => 4,
        };
        let terms = ModelForm::plain(degree).terms();
        let scaling = Scaling::of(pairs.iter().map(|pair| (from[pair.0], 0.0)));
        let centre = pairs.iter().map(|pair| from[pair.0]).sum::<DVec2>() / pairs.len() as f64;
        let size =
            pairs.iter().map(|pair| (from[pair.0] - centre).length()).sum::<f64>() / pairs.len() as f64;
        let mut out = Self {
            terms,
            scaling,
            coefficients: Vec::new(),
            rms_px: f64::INFINITY,
            centre,
            size: size.max(1.0),
        };
        let mut kept: Vec<(usize, usize)> = pairs.to_vec();
        for _ in 0..3 {
            if kept.len() < out.terms.len() + 2 {
                return None;
            }
            out.solve(from, to, &kept);
            let distance = |pair: &(usize, usize)| (out.apply(from[pair.0]) - to[pair.1]).length();
            let mut distances: Vec<f64> = kept.iter().map(distance).collect();
            distances.sort_by(f64::total_cmp);
            let free = (kept.len() as f64 / (kept.len() - out.terms.len()) as f64).sqrt();
            let rms_px = 1.2 * free * distances[distances.len() / 2];
            let near: Vec<(usize, usize)> =
                pairs.iter().filter(|pair| distance(pair) <= 4.0 * rms_px).copied().collect();
            let settled = near.len() == kept.len();
            kept = near;
            out.rms_px = rms_px;
            if settled {
                break;
            }
        }
        Some(out)
    }

    fn solve(&mut self, from: &[DVec2], to: &[DVec2], pairs: &[(usize, usize)]) {
        let n = self.terms.len();
        let mut values = vec![0.0; n];
        let mut matrix = Mat::<f64>::zeros(pairs.len(), n);
        for (row, pair) in pairs.iter().enumerate() {
            self.scaling.fill(from[pair.0], 0.0, &self.terms, &mut values);
            for (column, value) in values.iter().enumerate() {
                matrix[(row, column)] = *value;
            }
        }
        let right = Mat::<f64>::from_fn(pairs.len(), 2, |row, axis| to[pairs[row].1][axis]);
        let solution = matrix.qr().solve_lstsq(&right);
        self.coefficients = (0..n).map(|i| DVec2::new(solution[(i, 0)], solution[(i, 1)])).collect();
    }

    pub(crate) fn apply(&self, at: DVec2) -> DVec2 {
        let mut values = [0.0; 36];
        let values = &mut values[..self.terms.len()];
        self.scaling.fill(at, 0.0, &self.terms, values);
        values.iter().zip(&self.coefficients).map(|(value, c)| *c * *value).sum()
    }

    /// Number of coefficients an axis.
    pub(crate) fn coefficients(&self) -> usize {
        self.terms.len()
    }

    fn derivative(&self) -> [DVec2; 2] {
        let step = 0.1 * self.size;
        [DVec2::X, DVec2::Y].map(|axis| {
            (self.apply(self.centre + axis * step) - self.apply(self.centre - axis * step)) / (2.0 * step)
        })
    }

    /// Camera px a screen px at the middle of the matches.
    pub(crate) fn scale(&self) -> f64 {
        let [x, y] = self.derivative();
        x.perp_dot(y).abs().sqrt()
    }

    pub(crate) fn mirrored(&self) -> bool {
        let [x, y] = self.derivative();
        x.perp_dot(y) < 0.0
    }
}
